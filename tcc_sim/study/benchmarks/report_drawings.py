"""Pictures of both reports: error against run time, and errors on extreme scenes."""

from __future__ import annotations

import textwrap
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.study.benchmarks.peers import SINGLE
from tcc_sim.study.benchmarks.precision import largest_error
from tcc_sim.views import style
from tcc_sim.views.panels import Panel, compose

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
TITLE = 18
"""Letters in a line of a panel's title."""


def draw_precision(stem: Path, report: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw the largest of three errors over run time, a panel for every scene and group of solvers, to `stem`, or to
    `stem`.png and `stem`.svg if it has no suffix. Set-valued runs are in the panel of their scene.

    report : contents of precision.json
    """
    scenes, names = report["scenes"], list(dict.fromkeys(s["scene"].removesuffix(SET_VALUED) for s in report["scenes"]))
    times = [row["seconds"] for scene in scenes for row in scene["results"]] or [1.0]

    def draw(axis: Any, name: str, group: str, first: bool) -> None:
        for scene in (s for s in scenes if s["scene"].removesuffix(SET_VALUED) == name):
            draw_curves(axis, scene, {*GROUPS[group], *ENGINES})
        axis.set(xscale="log", yscale="log", ylim=(1e-15, 2.0), xlim=(0.7 * min(times), 1.4 * max(times)),
                 xlabel="run time (s)", ylabel="relative error" if first else "")
        axis.set_yticks([1e-12, 1e-8, 1e-4, 1.0])
        axis.tick_params(labelleft=first)

    return compose(stem, [
        Panel(f"{textwrap.fill(name, TITLE)}\n{group}", partial(draw, name=name, group=group, first=k % 2 == 0),
              2.0 if name == names[-1] else 1.4, beside=k > 0, close=k % 2 == 1, over=True)
        for name in names for k, group in enumerate(GROUPS)], title, width, below=True)


def draw_curves(axis: Any, scene: Any, shown: set[str]) -> None:
    """Draw the results of some solvers in one panel; errors below the floor, or an output's precision, are faded."""
    for name in dict.fromkeys(row["solver"] for row in scene["results"] if row["solver"] in shown):
        rows = [row for row in scene["results"] if row["solver"] == name]
        errors = np.array([max(largest_error(row), 1e-16) for row in rows])
        floor = max(scene["reference"]["floor"], SINGLE if name.startswith("XPPAUT") else 0.0)
        colour, marker = LOOKS[name]
        look = {"color": colour, "marker": marker, "linewidth": 1.8 if name in ENGINES else 1.0, "markersize": 3.0}
        seconds = [row["seconds"] for row in rows]
        axis.plot(seconds, errors, alpha=0.2, zorder=2, **look)
        axis.plot(seconds, np.where(errors >= floor, errors, np.nan), zorder=3, label=name, **look)
    law, colour = ("(7)", style.GREY) if scene["law"] == "smoothed" else ("(6)", style.RED)
    axis.axhline(scene["reference"]["floor"], color=colour, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1,
                 label=f"reference floor, law {law}")


def draw_stability(stem: Path, report: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw every engine's errors and power residuals of a stability.json, in rising order over the share of its cases,
    to files as `draw_precision` does.
    """
    def draw(axis: Any, key: str, name: str) -> None:
        for engine, (colour, marker) in ENGINES.items():
            values = np.sort([row[key] for row in report["cases"] if row["solver"] == engine and row[key] is not None])
            share = 100.0 * (np.arange(len(values)) + 0.5) / max(len(values), 1)
            axis.plot(share, np.maximum(values, 1e-17), color=colour, marker=marker, markersize=2.0, linewidth=0.8,
                      label=engine)
        axis.set(yscale="log", ylabel=name, xlabel="share of the cases (%)")

    return compose(stem, [
        Panel("error", partial(draw, key="error", name="relative error"), 2.2),
        Panel("power balance", partial(draw, key="power_residual", name="residual"), 2.2, beside=True, close=True)],
        title, width, below=True)
