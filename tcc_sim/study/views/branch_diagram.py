"""Bifurcation diagram of `continue`: largest slip speed over the key, stable and unstable, with bifurcations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import quantities

MARKS = {"fold": ("o", "fold"), "period_doubling": ("s", "period doubling"), "neimark_sacker": ("D", "Neimark-Sacker"),
         "branch_point": ("X", "branch point"), "grazing_sliding": ("^", "grazing-sliding"),
         "crossing_sliding": ("<", "crossing-sliding"), "switching_sliding": (">", "switching-sliding"),
         "adding_sliding": ("v", "adding-sliding"), "stick_border": ("P", "stick border")}
"""Marker and name of every kind."""
UNSTABLE = (0, (3, 1.5))
"""Dashes of unstable motions."""


def branch_panels(values: Mapping[str, Any]) -> list[Panel]:
    """Return the branches of `continue --json`: solid where stable, dashed where not, one colour per period; and the
    curves of bifurcations in the plane of both keys.
    """
    def once(axis: Any, x: Any, y: Any, name: str, **look: Any) -> None:
        """Draw a line or a mark, whose name the legend has once."""
        axis.plot(x, y, label=None if name in axis.get_legend_handles_labels()[1] else name, **look)

    def branches(axis: Any) -> None:
        quantities(axis, style.quantity_of(values["over"]), style.MAX_SLIP)
        for number, branch in enumerate(values["branches"]):
            parts = zip(stable_and_unstable(values, number), ("-", UNSTABLE), ("stable", "unstable"))
            for (x, y), dashes, word in parts:
                if len(x):
                    once(axis, x, y, f"period {branch['period']}, {word}", linestyle=dashes,
                         color=style.colour_of(branch["period"]))
        for item in values["bifurcations"]:
            marker, name = MARKS[item["kind"]]
            once(axis, [item["value"]], [item["max_slip_speed"]], name, linestyle="none", marker=marker,
                 color=style.INK, markersize=4.5, zorder=4)

    def curves(axis: Any) -> None:
        kinds = list(MARKS)
        for curve in values["curves"]:
            once(axis, curve["value"], curve["second"], f"curve of {MARKS[curve['kind']][1]}",
                 color=style.CYCLE[kinds.index(curve["kind"]) % len(style.CYCLE)])
            for point in curve.get("special", []):
                axis.plot([point["value"]], [point["second"]], linestyle="none", marker="o", markersize=3.0,
                          color=style.INK)
                axis.annotate(point["kind"].replace("_", " "), (point["value"], point["second"]), (5.0, -10.0),
                              textcoords="offset points", fontsize=6.5)
        quantities(axis, style.quantity_of(values["over"]), style.quantity_of(values["second_over"]))

    return [Panel("Branches", branches, 2.9),
            *([Panel("Curves of bifurcations", curves, 2.6)] if values.get("curves") else [])]


def stable_and_unstable(document: Mapping[str, Any], number: int) -> list[tuple[Any, Any]]:
    """Return polylines of the stable and of the unstable parts of a branch: values of the key, largest slip speeds.

    NaN separates two parts. Each part ends at its bifurcation, not at the next point.

    document : `branches` and `bifurcations` as `continue --json` has them
    number : number of the branch
    """
    branch = document["branches"][number]
    nodes = [(x, y) for x, y, _ in zip(branch["value"], branch["max_slip_speed"], branch["stable"], strict=True)]
    parts: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for k, (a, b) in enumerate(pairwise(branch["stable"])):
        between = [f for f in document["bifurcations"] if (f["branch"], f.get("after")) == (number, k)]
        changes = [n for n, f in enumerate(between) if f["changes_stability"]]
        corners = [nodes[k], *((f["value"], f["max_slip_speed"]) for f in between), nodes[k + 1]]
        for n, (start, end) in enumerate(pairwise(corners)):
            stable = (a and b) if not changes else a if n <= changes[0] else b
            line = parts[bool(stable)]
            line += [end] if line and line[-1] == start else [(math.nan, math.nan), start, end]
    lines = (np.array(parts[stable], dtype=np.float64).reshape(-1, 2) for stable in (True, False))
    return [(xy[:, 0], xy[:, 1]) for xy in lines]
