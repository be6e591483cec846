"""The bifurcation diagram of `continue`: largest slip speed over the key, stable and unstable, with what was found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.views import style

MARKS = {"fold": ("o", "fold"), "period_doubling": ("s", "period doubling"), "neimark_sacker": ("D", "Neimark-Sacker"),
         "branch_point": ("X", "branch point"), "grazing_sliding": ("^", "grazing-sliding"),
         "crossing_sliding": ("<", "crossing-sliding"), "switching_sliding": (">", "switching-sliding"),
         "adding_sliding": ("v", "adding-sliding"), "stick_border": ("P", "stick border")}
"""Marker and name of every kind."""


def branch_diagram(path: Path, found: Mapping[str, Any], title: str = "", width: float = style.PAGE) -> Path:
    """Draw the branches of `continue --json`: solid where stable, dashed where not, one colour per period.

    Parameters
    ----------
    path : png, svg or pdf file
    found : what `Motions.as_json` gives
    title : name of the scene
    width : inch

    Raises
    ------
    MissingPackage
        matplotlib is not installed.
    """
    curves = found.get("curves", [])
    with style.figure(width, 3.6 if not curves else 6.4) as drawn:
        axes = drawn.subplots(2 if curves else 1, 1, squeeze=False)[:, 0]
        _branches(axes[0], found)
        axes[0].set_xlabel(found["over"])
        axes[0].set_ylabel("max |slip speed| (rad/s)")
        if title:
            axes[0].set_title(title)
        _legend(axes[0])
        if curves:
            _curves(axes[1], found)
        return style.save(drawn, path)


def _branches(axis: Any, found: Mapping[str, Any]) -> None:
    """Lines of the branches and marks of their bifurcations."""
    periods = sorted({b["period"] for b in found["branches"]})
    named: set[str] = set()
    for branch in found["branches"]:
        colour = style.CYCLE[periods.index(branch["period"]) % len(style.CYCLE)]
        value, height = np.array(branch["value"]), np.array(branch["max_slip_speed"])
        stable = np.array(branch["stable"], dtype=bool)
        for wanted, dashes, word in ((True, "-", "stable"), (False, (0, (3, 1.5)), "unstable")):
            part = stable == wanted
            # A piece between two points is drawn as its first point is.
            keep = part | np.concatenate([[False], part[:-1]])
            if not part.any():
                continue
            name = f"period {branch['period']}, {word}"
            axis.plot(value, np.where(keep, height, np.nan), linestyle=dashes, color=colour,
                      label=None if name in named else name)
            named.add(name)
    for item in found["bifurcations"]:
        marker, name = MARKS[item["kind"]]
        axis.plot([item["value"]], [item["max_slip_speed"]], linestyle="none", marker=marker, color=style.INK,
                  markersize=4.5, label=None if name in named else name, zorder=4)
        named.add(name)


def _curves(axis: Any, found: Mapping[str, Any]) -> None:
    """Curves of bifurcations in the plane of both keys."""
    kinds = list(dict.fromkeys(c["kind"] for c in found["curves"]))
    named: set[str] = set()
    for curve in found["curves"]:
        name = MARKS[curve["kind"]][1]
        axis.plot(curve["value"], curve["second"], color=style.CYCLE[kinds.index(curve["kind"]) % len(style.CYCLE)],
                  label=None if name in named else name)
        named.add(name)
    axis.set_xlabel(found["over"])
    axis.set_ylabel(found["second_over"])
    _legend(axis)


def _legend(axis: Any) -> None:
    """The legend below the axes, where it hides nothing."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=min(len(handles), 4))
