"""The page on periodic motions: branches, charts and a basin, with what was found, as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from tcc_sim.basins.compute import Basins
from tcc_sim.basins.proximity import RUNAWAY, UNDECIDED
from tcc_sim.output.markdown import escape
from tcc_sim.paper.branch_panels import UNNAMED

Data = Mapping[str, Any]
NAMES = {19: "motions_chart_mu_k", 20: "motions_chart_psi"}
"""File names of the charts' pictures, without suffix."""
BRANCHES, BASINS = "motions_branches", "motions_basins"


def motions_page(branches: Data, charts: Mapping[int, Data], basins: Basins, beside: Sequence[str] = ()) -> str:
    """The page.

    Parameters
    ----------
    branches : the numbers of Fig. 6 with its branches
    charts : the numbers of the charts
    basins : the coexistence at omega/omega_n = 0.36 and mu_k/mu_s = 0.85
    beside : lines of the comparison with AUTO-07p
    """
    lines = ["# Periodic motions", "",
             "Written by `tcc-sim motions`. Constant load of 225 kPa and law (7) with sigma = 50 s/rad where nothing "
             "else is",
             "said. A sweep shows what one initial state leads to; branches show which motions there are, stable or "
             "not, and",
             "where each begins and ends. A residual is the distance of the multiplier from where the bifurcation has "
             "it.", "",
             "## Branches behind Fig. 6", "", f"![branches over mu_k/mu_s](pictures/{BRANCHES}.png)", "",
             *_branches(branches), "",
             "    tcc-sim figure 6 --branches",
             "    tcc-sim continue SCENE --over friction.kinetic_coefficient=0.165:0.3", "",
             "## Where motions begin and end in two parameters"]
    for number, data in charts.items():
        lines += ["", f"![Chart {number}](pictures/{NAMES[number]}.png)", "", *_chart(data), "",
                  f"    tcc-sim figure {number}"]
    lines += ["", "## Which initial state leads to which motion", "", f"![basins](pictures/{BASINS}.png)", "",
              *_basins(basins), *([""] if beside else []), *beside]
    return "\n".join(lines) + "\n"


def _branches(data: Data) -> list[str]:
    """Branches, bifurcations, and what each jump of the sweeps is."""
    curve, unit = data["curves"][0], data["unit"]
    lines = ["| branch | period | mu_k/mu_s | stable points | ends |", "| ---: | ---: | --- | ---: | --- |"]
    for k, branch in enumerate(curve["branches"]):
        lines.append(f"| {k} | {branch['period']} | {min(branch['value']) / unit:.6f} to "
                     f"{max(branch['value']) / unit:.6f} | {sum(branch['stable'])} of {len(branch['stable'])} | "
                     f"{escape('; '.join(dict.fromkeys(branch['ended'])))} |")
    lines += ["", "| bifurcation | branch | period | mu_k/mu_s | largest slip speed (rad/s) | residual |",
              "| --- | ---: | ---: | ---: | ---: | ---: |"]
    for found in curve["bifurcations"]:
        lines.append(f"| {found['kind'].replace('_', ' ')} | {found['branch']} | {found['period']} | "
                     f"{found['value'] / unit:.8f} | {found['max_slip_speed']:.4f} | {found['residual']:.0e} |")
    words = {"cold": "from the initial state (13)", "up": "continued upward", "down": "continued downward"}
    told = ["", "Jumps of the sweeps:", ""]
    for swept in data["curves"]:
        for cause, run in groupby(swept["jumps"], lambda jump: jump["cause"]):
            alike = list(run)
            for jumps in [alike] if cause in UNNAMED else [[jump] for jump in alike]:
                sizes = jumps[0]["max_slip_speed"][0], jumps[-1]["max_slip_speed"][1]
                where = " to ".join(dict.fromkeys(f"{jump['value'] / unit:.6f}" for jump in (jumps[0], jumps[-1])))
                many = f" in {len(jumps)} jumps" if len(jumps) > 1 else ""
                told.append(f"- {words[swept['direction']]}, at {where}: {sizes[0]:.2f} to {sizes[1]:.2f} rad/s{many}, "
                            f"{_cause(cause)}")
    return lines + (told if len(told) > 3 else [])


def _cause(cause: str) -> str:
    """The cause of a jump in words."""
    return {"basin_boundary": "both motions go on: the start is on the other side of the boundary of their basins",
            "steep": "one motion, which only changes steeply", "aperiodic": "a motion without a period beside it",
            "not_followed": "a motion beside it that lies on no branch followed"}.get(cause, cause.replace("_", " "))


def _chart(data: Data) -> list[str]:
    """The curves of a chart."""
    first, second = data["unit"], data["second_unit"]
    names = escape(data["axis"]), escape(data["second_axis"])
    lines = [f"{escape(data['title'].replace('$', '').replace(chr(92), ''))}.", "",
             f"| curve | points | {names[0]} | {names[1]} | ends |", "| --- | ---: | --- | --- | --- |"]
    for curve in data["curves"]:
        x, y = [v / first for v in curve["value"]], [v / second for v in curve["second"]]
        lines.append(f"| {escape(curve['label'])}{' (smoothed end of stick)' if curve['creep'] else ''} | {len(x)} | "
                     f"{min(x):.4f} to {max(x):.4f} | {min(y):.4f} to {max(y):.4f} | "
                     f"{escape('; '.join(dict.fromkeys(curve['ended'])))} |")
    return lines


def _basins(found: Basins) -> list[str]:
    """Attractors with their share of the plane, and what came to none."""
    first, second = found.plane
    lines = [f"omega/omega\\_n = 0.36, mu\\_k/mu\\_s = 0.85: {len(first.values)} by {len(second.values)} cells of "
             f"{escape(first.key)} ({first.values[0]:g} to {first.values[-1]:g} rad/s) and {escape(second.key)} "
             f"({second.values[0]:g} to {second.values[-1]:g} rad), {float(found.cycles.mean()):.1f} cycles a cell.",
             "",
             "| period | largest slip speed (rad/s) | largest multiplier | capture radius | part of the plane |",
             "| ---: | ---: | ---: | ---: | ---: |"]
    for k, attractor in enumerate(found.attractors):
        size = "none" if attractor.multipliers is None else f"{abs(attractor.multipliers[0]):.6f}"
        lines.append(f"| {attractor.period or 'none'} | {attractor.largest:.4f} | {size} | {attractor.radius:g} | "
                     f"{100.0 * found.fraction(k):.3f} % |")
    lines += ["",
              f"Undecided: {100.0 * found.fraction(UNDECIDED):.3g} %; runaway slip: "
              f"{100.0 * found.fraction(RUNAWAY):.3g} %."]
    edge = found.boundary()
    if edge is not None:
        lines.append(f"The boundary has the uncertainty exponent {edge.exponent:.3f} (standard error "
                     f"{edge.error:.3f}), dimension {edge.dimension:.3f}.")
    return lines
