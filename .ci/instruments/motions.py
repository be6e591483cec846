"""The page on periodic motions: branches, a basin, and a summary.

`python .ci/instruments/motions.py` writes it, its pictures and the JSON behind them; the branches are those of
`tcc-sim figure 6 --branches`; AUTO-07p follows two of them too (`branch_speed`).
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from branch_speed import compared, page_lines

from tcc_sim.errors import InputError, counted, require
from tcc_sim.output.files import new_directory, write_json
from tcc_sim.output.provenance import document
from tcc_sim.output.tables import escape
from tcc_sim.output.terminal import say
from tcc_sim.study.basins.attractors import RUNAWAY, UNDECIDED
from tcc_sim.study.basins.compute import basins
from tcc_sim.study.basins.results import Axis, Basins
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, STATIC, FigureOptions, paper_system, series_system
from tcc_sim.study.paper.drawings import UNNAMED, UNSEEN, draw_figure
from tcc_sim.study.paper.figures import Figure, figure_data
from tcc_sim.views.plots import plot
from tcc_sim.views.stored import Record

AT_036_085 = {"friction.kinetic_coefficient": 0.85 * STATIC, "engine.frequency": 0.36 * OMEGA_N}
"""Where period one and a large period two coexist behind Fig. 6."""
CELLS, QUICK_CELLS = 500, 60
BRANCHES, BASINS = "motions_branches", "motions_basins"
LOST = "without a further point"
ENDINGS = {"range": "at the end of a range", "closed": "closed", "doubling": "in a doubling", "began": "in a doubling",
           "canard": "in a canard", "canard_curve": "in a canard", "special": "in a point of codimension two",
           "points": "after the most points", "family": "at a family of motions"}
"""Where a branch ends; the other reasons are `LOST`."""
CAUSES = {"basin_boundary": "both motions go on, and the start crosses the boundary of their basins",
          "steep": "one motion, which only changes steeply", "aperiodic": "a motion without a period beside it",
          "not_followed": "a motion beside it that lies on no branch followed"}
"""Causes of a jump of a sweep other than a bifurcation."""
WAYS = {"cold": "from (13)", "up": "upward", "down": "downward"}


def main(words: Sequence[str] | None = None) -> int:
    """Write the page; exit status 2 and one line for wrong input, 130 after an interrupt."""
    parser = argparse.ArgumentParser(prog="python .ci/instruments/motions.py", description=__doc__)
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("motions"),
                        help="new directory for motions.md, its pictures and the JSON behind them (default: motions)")
    parser.add_argument("--quick", action="store_true",
                        help="a quarter of the values, a basin of 60 by 60 cells, and no comparison with AUTO-07p")
    parser.add_argument("--jobs", metavar="N", type=int, help="threads (default: all cores)")
    given = list(sys.argv[1:] if words is None else words)
    try:
        return run(parser.parse_args(given), given)
    except InputError as error:
        sys.stderr.write(f"motions: {error}\n")
        return 2


def run(arguments: argparse.Namespace, words: list[str]) -> int:
    """Compute branches and basin, and write the page and its pictures; nothing after an interrupt."""
    folder = new_directory(arguments.out)
    if arguments.jobs is not None and not 1 <= arguments.jobs <= 1024:
        raise InputError(f"jobs is {arguments.jobs}; it must be 1 to 1024")
    require("matplotlib", "a picture")
    cells = QUICK_CELLS if arguments.quick else CELLS
    plane = [Axis(key, tuple(np.linspace(low, high, cells).tolist()))
             for key, low, high in (("initial.slip_speed", 0.0, 120.0), ("initial.plate_angle", -0.1, 0.3))]
    try:
        options = FigureOptions(arguments.quick, jobs=arguments.jobs, progress=True, branches=True)
        branches = figure_data(FIGURES[6], options)
        result, = basins(paper_system(AT_036_085), plane, jobs=arguments.jobs, progress=True)
        side_lines = [] if arguments.quick else page_lines(compared())
    except KeyboardInterrupt:
        sys.stderr.write("motions: interrupted; nothing is written\n")
        return 130
    _write(folder, branches, result, words)
    (folder / "motions.md").write_text(motions_page(branches, result, side_lines), encoding="utf-8")
    say(repr(result))
    say(f"{folder}/motions.md, {folder}/pictures")
    return 0


def _write(folder: Any, branches: Figure, result: Any, words: list[str]) -> None:
    """Pictures and JSON."""
    pictures = folder / "pictures"
    pictures.mkdir(parents=True)
    values = document("figure", branches, series_system(FIGURES[6].series[0], FigureOptions()), words)
    write_json(folder / f"{BRANCHES}.json", values)
    draw_figure(pictures / BRANCHES, Record.of(values))
    plot(result, pictures / f"{BASINS}.png")
    write_json(folder / f"{BASINS}.json", document("basins", result, paper_system(AT_036_085), words))


def motions_page(branches: Figure, basins: Basins, side_lines: Sequence[str] = ()) -> str:
    """The page: results in counts and tables; the JSON beside it has every point of the branches.

    Parameters
    ----------
    branches : the numbers of Fig. 6 with its branches
    basins : the coexistence at omega/omega_n = 0.36 and mu_k/mu_s = 0.85
    beside : lines of the comparison with AUTO-07p
    """
    lines = ["# Periodic motions", "", *_summary(branches, basins), "",
             "This page is generated: `python .ci/instruments/motions.py` writes it, its pictures, and all branches "
             "by their points as",
             "JSON. Constant load of 225 kPa and law (7) with sigma = 50 s/rad unless stated. A sweep "
             "shows what one",
             "initial state leads to; branches show the motions, stable or not, and where each begins and "
             "ends.", "",
             "## Branches behind Fig. 6", "", f"![branches over mu_k/mu_s](pictures/{BRANCHES}.png)", "",
             *_branches(branches), "", *_jumps(branches), "", "    tcc-sim figure 6 --branches", "",
             "`continue --second` follows where these motions begin and end in the plane of two keys:", "",
             "    tcc-sim continue minimal --set pressure.mean=225000 --set engine.frequency=139.4 --switch "
             "--over friction.kinetic_coefficient=0.18:0.29 --second engine.frequency=60:190"]
    lines += ["", "## Which initial state leads to which motion", "", f"![basins](pictures/{BASINS}.png)", "",
              *_basins(basins), *([""] if side_lines else []), *side_lines]
    return "\n".join(lines) + "\n"


def _summary(branches: Figure, basins: Basins) -> list[str]:
    """Summary, a line for each part."""
    curves = branches.curves
    followed = curves[0].behind
    periods = sorted({b["period"] for b in followed.branches})
    causes = Counter(jump.cause for curve in curves for jump in curve.behind.jumps)
    boundary, unnamed = causes["basin_boundary"], sum(causes[c] for c in UNNAMED)
    ends = sum(causes.values()) - boundary - unnamed - sum(causes[c] for c in UNSEEN)
    lines = [f"- Branches behind Fig. 6: {len(followed.branches)}, of period {', '.join(map(str, periods))}, with "
             f"{counted(len(followed.bifurcations), 'bifurcation')}. Of {counted(sum(causes.values()), 'jump')} in "
             f"three sweeps {ends} are bifurcations, {boundary} cross the boundary of two basins, and {unnamed} lie "
             "beside motions on no branch."]
    shares = ", ".join(f"{100.0 * basins.fraction(k):.1f} % to period {a.period or 'none'} of {a.largest:.1f} rad/s"
                       for k, a in enumerate(basins.attractors))
    return [*lines, f"- Initial states at omega/omega\\_n = 0.36, mu\\_k/mu\\_s = 0.85 lead: {shares}."]


def _branches(data: Figure) -> list[str]:
    """Branches with their ends and bifurcations."""
    result, unit = data.curves[0].behind, data.unit
    lines = ["| period | mu\\_k/mu\\_s | stable points | ends | bifurcations |", "| ---: | --- | ---: | --- | --- |"]
    for k, branch in enumerate(result.branches):
        ends = "; ".join(f"{ENDINGS.get(reason, LOST)}, {branch['value'][end] / unit:.6f}"
                         for end, reason in zip((0, -1), branch["reasons"]))
        met = ", ".join(f"{f['kind'].replace('_', ' ')} {f['value'] / unit:.6f}" for f in result.bifurcations
                        if f["branch"] == k)
        lines.append(f"| {branch['period']} | {min(branch['value']) / unit:.4f} to {max(branch['value']) / unit:.4f} | "
                     f"{sum(branch['stable'])} of {len(branch['stable'])} | {ends} | {met or 'none'} |")
    worst = max((f["residual"] for f in result.bifurcations), default=0.0)
    return [*lines, "", f"The multiplier of every bifurcation is within {worst:.0e} of its value at a bifurcation."]


def _jumps(data: Figure) -> list[str]:
    """The jumps of the sweeps by cause and place, with the sweeps that have them."""
    unit, places = data.unit, dict[tuple[str, str], list[str]]()
    for swept in data.curves:
        for jump in swept.behind.jumps:
            at = places.setdefault((jump.cause, f"{jump.value / unit:.6f}"), [])
            at += [WAYS[swept.direction]] * (WAYS[swept.direction] not in at)
    lines = ["Jumps of the sweeps, at mu\\_k/mu\\_s:", ""] if places else []
    for cause in dict.fromkeys(cause for cause, _ in places):
        by_name = {place: ways for (name, place), ways in places.items() if name == cause}
        where = ", ".join(f"{place} ({', '.join(ways)})" for place, ways in sorted(by_name.items()))
        if cause in UNNAMED:
            where = f"{counted(len(by_name), 'place')} from {min(by_name)} to {max(by_name)}"
        lines.append(f"- {CAUSES.get(cause, cause.replace('_', ' '))}: {where}")
    return lines


def _basins(result: Basins) -> list[str]:
    """Attractors with their share of the plane, and the share that reached none."""
    first, second = result.plane
    lines = [f"omega/omega\\_n = 0.36, mu\\_k/mu\\_s = 0.85: {len(first.values)} by {len(second.values)} cells of "
             f"{escape(first.key)} ({first.values[0]:g} to {first.values[-1]:g} rad/s) and {escape(second.key)} "
             f"({second.values[0]:g} to {second.values[-1]:g} rad), {float(result.cycles.mean()):.1f} cycles a cell.",
             "",
             "| period | largest slip speed (rad/s) | largest multiplier | capture radius | part of the plane |",
             "| ---: | ---: | ---: | ---: | ---: |"]
    for k, attractor in enumerate(result.attractors):
        size = "none" if attractor.multipliers is None else f"{abs(attractor.multipliers[0]):.6f}"
        lines.append(f"| {attractor.period or 'none'} | {attractor.largest:.4f} | {size} | {attractor.radius:g} | "
                     f"{100.0 * result.fraction(k):.3f} % |")
    lines += ["", f"Undecided: {100.0 * result.fraction(UNDECIDED):.3g} %; runaway slip: "
              f"{100.0 * result.fraction(RUNAWAY):.3g} %."]
    edge = result.boundary()
    if edge is not None:
        lines.append(f"The boundary has the uncertainty exponent {edge.exponent:.3f} (standard error "
                     f"{edge.error:.3f}), dimension {edge.dimension:.3f}.")
    return lines


if __name__ == "__main__":
    raise SystemExit(main())
