"""precision.png and precision_section.png: error against run time, a column per scene, a row per error or one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.benchmarks.peers import SINGLE
from tcc_sim.views import style

Look = tuple[str, str, Any, float]
LOOKS: dict[str, Look] = {
    "smoothed": (style.BLUE, "o", "-", 1.8), "event_driven": (style.RED, "D", "-", 1.8),
    "fixed_step": (style.GREEN, "s", "-", 1.8),
    "rk4": (style.GREY, "x", ":", 0.9), "rk45": (style.ORANGE, "^", "-", 1.1), "dop853": ("#8A8A00", "v", ":", 0.9),
    "radau": (style.PURPLE, "^", "--", 0.9), "bdf": (style.SKY, "v", "--", 0.9), "lsoda": (style.INK, "<", "--", 0.9),
    "solve_ivp LSODA": ("#E7298A", ">", ":", 0.9), "XPPAUT cvode": ("#7A4B00", "*", "-.", 1.1),
    "XPPAUT stiff": ("#C49A6C", "X", "-.", 0.9), "XPPAUT gear": ("#1F7A6D", "P", "-.", 0.9),
    "XPPAUT 2rb": ("#1B3A6F", "d", "-.", 0.9), "CVODE": ("#00A08A", "X", "-", 1.1),
    "Siconos theta 1/2": ("#5B2A86", "h", "--", 0.9), "Siconos theta 1": ("#7FBF3F", "p", "--", 0.9)}
"""Colour, marker, line and width of every solver; the package's own stand out, and no two share a colour or a marker
with the same line."""
SPARE = [(colour, marker, (0, (3, 1, 1, 1)), 0.9) for colour, marker in zip(style.MANY, "8H|_1234+,.")]
"""Looks for solvers that LOOKS does not know."""
ROWS = (("error_final", "final state"), ("error_section", "section"), ("error_max_slip", "largest slip speed"),
        ("error_steady", "steady state"))
SET_VALUED = ", set-valued"
FADED = 0.2
"""Opacity of what no reference resolves."""


def precision(stem: Path, scenes: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Draw `stem`.png and `stem`.svg with all errors, and `stem`_section.png and .svg with that of the section alone.
    """
    _draw(stem.with_name(f"{stem.name}_section"), scenes, ("error_section",))
    return _draw(stem, scenes, tuple(key for key, _ in ROWS))


def looks_of(names: list[str]) -> dict[str, Look]:
    """A look for each solver, no two alike; one that is not known gets a spare one."""
    unknown = [name for name in names if name not in LOOKS]
    return {name: LOOKS[name] if name in LOOKS else SPARE[unknown.index(name) % len(SPARE)] for name in names}


def _draw(stem: Path, scenes: list[dict[str, Any]], keys: tuple[str, ...]) -> tuple[Path, Path]:
    """One picture with a row for each of some errors; a scene's set-valued runs are in the column of its smoothed ones.
    """
    columns = list(dict.fromkeys(record["scene"].removesuffix(SET_VALUED) for record in scenes))
    rows = [(key, name) for key, name in ROWS if key in keys]
    with style.figure(max(2.5 * len(columns), 5.0) + 0.6, 2.0 * len(rows) + 1.6) as drawn:
        axes = drawn.subplots(len(rows), max(len(columns), 1), sharex=True, sharey=True, squeeze=False)
        handles: dict[str, Any] = {}
        for record in scenes:
            column = columns.index(record["scene"].removesuffix(SET_VALUED))
            smoothed = record["law"] == "smoothed"
            for axis, (key, _) in zip(axes[:, column], rows):
                draw_curves(axis, record, key, handles)
                floor = record["reference"]["floor"]
                line = axis.axhline(floor, color=style.GREY if smoothed else style.RED, linewidth=0.9,
                                    linestyle=(0, (1, 1.5)), zorder=1)
                handles["floor of the references, law (7)" if smoothed else "floor of the references, law (6)"] = line
        for row, (_, name) in zip(axes, rows):
            row[0].set_ylabel(f"relative error, {name}")
        for letter, name in zip("abcd", columns):
            head = next((r for r in scenes if r["scene"] == name), scenes[0])
            title = axes[0, columns.index(name)]
            title.set_title(f"({letter}) {name}", pad=26.0)
            title.text(0.0, 1.02, _wrapped(head["description"]), transform=title.transAxes, fontsize=7.5, va="bottom")
        for axis in axes[-1]:
            axis.set_xlabel("run time (s)")
        for axis in axes.flat:
            axis.set(xscale="log", yscale="log", ylim=(1e-15, 2.0))
        order = [n for n in LOOKS if n in handles] + [n for n in handles if n not in LOOKS]
        drawn.legend([handles[n] for n in order], order, loc="outside lower center", ncols=6)
        return style.save_both(drawn, stem)


def draw_curves(axis: Any, record: dict[str, Any], key: str, handles: dict[str, Any]) -> None:
    """Every solver's ladder in one panel; what is below its floor is faded."""
    for name, look in looks_of(list(dict.fromkeys(row["solver"] for row in record["results"]))).items():
        rows = [row for row in record["results"] if row["solver"] == name and row[key] is not None]
        colour, marker, line, width = look
        seconds, found = [row["seconds"] for row in rows], np.array([max(row[key], 1e-16) for row in rows])
        floor = floor_of(record, name, key)
        drawn = {"color": colour, "marker": marker, "linestyle": line, "linewidth": width, "markersize": 4.0}
        axis.plot(seconds, found, alpha=FADED, zorder=2, **drawn)
        handle, = axis.plot(seconds, np.where(found >= floor, found, np.nan), zorder=3, **drawn)
        handles[name] = handle


def floor_of(record: dict[str, Any], solver: str, key: str) -> float:
    """The error below which one of this solver says nothing: that of the references, or of the precision it writes in.
    """
    floor: float = (record["steady"]["closure"] or 0.0) if key == "error_steady" else record["reference"]["floor"]
    return max(floor, SINGLE) if solver.startswith("XPPAUT") else floor


def _wrapped(text: str) -> str:
    """A description on lines that fit a column."""
    import textwrap

    lines = "\n".join(textwrap.wrap(text.replace(" N m", "\u00a0N\u00a0m"), 44))
    for plain, symbol in (("mu_s/mu_k", "$\\mu_s/\\mu_k$"), ("mu_k = mu_s", "$\\mu_k = \\mu_s$"),
                          ("sigma", "$\\sigma$"), ("Tm", "$T_m$"), ("Tp", "$T_p$")):
        lines = lines.replace(plain, symbol)
    return lines
