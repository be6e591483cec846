"""Pictures of both reports: error against run time, and errors on extreme scenes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.study.benchmarks.peers import SINGLE
from tcc_sim.study.benchmarks.precision import largest_error
from tcc_sim.views import style

GROUPS = {"this package": ("smoothed", "event_driven", "fixed_step"), "explicit": ("rk4", "rk45", "dop853"),
          "implicit": ("radau", "bdf", "lsoda", "solve_ivp LSODA"),
          "other programs": ("numbalsoda", "CVODE", "XPPAUT cvode", "XPPAUT stiff", "XPPAUT gear", "XPPAUT 2rb")}
"""Groups of solvers that share a panel; the engines of this package are in every panel."""
ENGINES = {"smoothed": (style.BLUE, "o"), "event_driven": (style.RED, "D"), "fixed_step": (style.GREEN, "s")}
OTHERS = [name for names in GROUPS.values() for name in names if name not in ENGINES]
COLOURS = (style.ORANGE, style.PURPLE, style.GREY, style.SKY, "#7A4B00", "#00A08A")
LOOKS = ENGINES | {name: (COLOURS[k % len(COLOURS)], marker) for k, (name, marker) in enumerate(
    zip(OTHERS, "x^v<>8pX*dPh+"))}
"""Colour and marker of every solver; the markers differ."""
SET_VALUED = ", set-valued"
TITLE = 24
"""Letters in a line of a panel's title."""


def draw_precision(stem: Path, report: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the largest of three errors over run time as `stem`.png and `stem`.svg, and return `stem`.

    On a page there is a column per scene and a row per group of solvers; in a column each scene has two rows of two
    groups. Set-valued runs are in the panel of their scene. `report` has the contents of precision.json.
    """
    wide, names = style.wide(width), list(dict.fromkeys(s["scene"].removesuffix(SET_VALUED) for s in report["scenes"]))
    panels = [(name, group) for group in GROUPS for name in names] if wide else [
        (name, group) for name in names for group in GROUPS]
    columns = len(names) if wide else 2
    count = len(panels) // columns
    with style.figure(width, (1.75 if wide else 1.0) * count + 1.4, title) as drawn:
        axes = drawn.subplots(count, columns, sharex=True, sharey=True, squeeze=False)
        handles: dict[str, Any] = {}
        for number, (axis, (name, group)) in enumerate(zip(axes.flat, panels)):
            for scene in report["scenes"]:
                if scene["scene"].removesuffix(SET_VALUED) == name:
                    _draw_curves(axis, scene, handles, {*GROUPS[group], *ENGINES})
            axis.set(xscale="log", yscale="log", ylim=(1e-15, 2.0))
            axis.set_yticks([1e-12, 1e-8, 1e-4, 1.0])
            place = textwrap.fill(f"({chr(97 + number)}) {name}", TITLE)
            axis.set_title(f"{place}\n{group}", fontsize=6.5, pad=3.0)
        for axis in axes[-1]:
            axis.set_xlabel("run time (s)")
        for axis in axes[:, 0]:
            axis.set_ylabel("relative error", fontsize=7.0)
        order = [name for name in (*LOOKS, *handles) if name in handles]
        drawn.legend([handles[name] for name in dict.fromkeys(order)], list(dict.fromkeys(order)),
                     loc="outside lower center", ncols=5 if wide else 3, fontsize=7.0 if wide else 6.0)
        style.save_both(drawn, stem)
    return stem


def _draw_curves(axis: Any, scene: Any, handles: dict[str, Any], shown: set[str]) -> None:
    """Draw the results of some solvers in one panel; errors below the floor, or an output's precision, are faded."""
    for name in dict.fromkeys(row["solver"] for row in scene["results"] if row["solver"] in shown):
        rows = [row for row in scene["results"] if row["solver"] == name]
        errors = np.array([max(largest_error(row), 1e-16) for row in rows])
        floor = max(scene["reference"]["floor"], SINGLE if name.startswith("XPPAUT") else 0.0)
        colour, marker = LOOKS[name]
        look = {"color": colour, "marker": marker, "linewidth": 1.8 if name in ENGINES else 1.0, "markersize": 3.0}
        seconds = [row["seconds"] for row in rows]
        axis.plot(seconds, errors, alpha=0.2, zorder=2, **look)
        handles[name], = axis.plot(seconds, np.where(errors >= floor, errors, np.nan), zorder=3, **look)
    law, colour = ("(7)", style.GREY) if scene["law"] == "smoothed" else ("(6)", style.RED)
    handles[f"reference floor, law {law}"] = axis.axhline(
        scene["reference"]["floor"], color=colour, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1)


def draw_stability(stem: Path, report: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw errors and power residuals of a stability.json as `stem`.png and `stem`.svg, and return `stem`."""
    with style.figure(width, 2.6, title) as drawn:
        panels = drawn.subplots(1, 2)
        for panel, key, name in zip(panels, ("error", "power_residual"), ("relative error", "residual")):
            _sorted(panel, report["cases"], key)
            panel.set(yscale="log", ylabel=name, xlabel="share of the cases (%)")
        style.panel_titles(panels, ["error", "power balance"])
        named = {name: handle for panel in panels for handle, name in zip(*style.entries(panel))}
        if named:
            drawn.legend(named.values(), named.keys(), loc="outside lower center", ncols=3)
        style.save_both(drawn, stem)
    return stem


def _sorted(axis: Any, cases: Sequence[Any], key: str) -> None:
    """Draw every engine's values in rising order over the share of its cases."""
    for engine, (colour, marker) in ENGINES.items():
        values = np.sort([row[key] for row in cases if row["solver"] == engine and row[key] is not None])
        if len(values):
            share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
            axis.plot(share, np.maximum(values, 1e-17), color=colour, marker=marker, markersize=2.0, linewidth=0.8,
                      label=engine)
