"""Pictures of branches (the largest slip speed over a key, stable and unstable, with bifurcations) and of basins of
attraction (the map of one plane, or the fractions of the plane against a parameter).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.shown_units import speed
from tcc_sim.study.basins.attractors import RUNAWAY
from tcc_sim.study.basins.results import Planes
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity
from tcc_sim.views.sweeps import draw_cells, edges

MARKS = {"fold": ("o", "fold"), "period_doubling": ("s", "period doubling"), "neimark_sacker": ("D", "Neimark-Sacker"),
         "branch_point": ("X", "branch point"), "grazing_sliding": ("^", "grazing-sliding"),
         "crossing_sliding": ("<", "crossing-sliding"), "switching_sliding": (">", "switching-sliding"),
         "adding_sliding": ("v", "adding-sliding"), "stick_border": ("P", "stick border")}
"""Marker and name of every kind."""
UNSTABLE = (0, (3, 1.5))
"""Dashes of unstable motions."""


def branch_panels(values: Mapping[str, Any], unstable: str = "period {}, unstable") -> list[Panel]:
    """Return the branches of `continue --json`: solid where stable, dashed where not, one colour per period; and the
    curves of bifurcations in the plane of both keys.

    unstable : name of unstable motions of a period
    """
    def once(axis: Any, x: Any, y: Any, name: str, **look: Any) -> None:
        """Draw a line or a mark, whose name the legend has once."""
        axis.plot(x, y, label=None if name in axis.get_legend_handles_labels()[1] else name, **look)

    over = style.quantity_of(values["over"])

    def branches(axis: Any) -> None:
        for number, branch in enumerate(values["branches"]):
            parts = zip(stable_and_unstable(values, number), ("-", UNSTABLE), ("period {}, stable", unstable))
            for (x, y), dashes, name in parts:
                if len(x):
                    once(axis, x, y, name.format(branch["period"]), linestyle=dashes,
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

    return [Panel("Branches", branches, 2.9, over, style.MAX_SLIP),
            *([Panel("Curves of bifurcations", curves, 2.6, over, style.quantity_of(values["second_over"]))]
              if values.get("curves") else [])]


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


MARKERS = "os^Dvp*"
EXTRAS: dict[str, tuple[Any, str]] = {"runaway": (style.RUNAWAY, "runaway slip"), "undecided": ("#FFFFFF", "undecided")}
"""Colours and names of starts that reach no attractor, in the order of their labels from RUNAWAY on."""


def basin_panels(document: Any) -> list[Panel]:
    """Return one plane as a map, or several, one for each value of a key, as fractions against it.

    document : one result or several, or their JSON; to JSON, which has no cells, add the `labels` of the .npz
    """
    if not isinstance(document, Mapping):
        planes = Planes(document if isinstance(document, Sequence) else [document])
        document = {**planes.as_json(), "labels": planes.planes[0].labels}
    if "over" in document:
        return [Panel("", partial(_fractions, planes=document), 3.4, style.quantity_of(document["over"]),
                      AxisQuantity("fraction of the plane"))]
    x, y = (style.quantity_of(axis["key"]) for axis in document["plane"])
    return [Panel("", partial(_map, plane=document, labels=document.get("labels")), 4.2, x, y)]


def _map(axes: Any, plane: Mapping[str, Any], labels: Any) -> None:
    """Draw the cells, if known, in the colours of their attractors, and the projected section points of these."""
    from matplotlib.colors import to_rgb

    (first, second), periods = plane["plane"], [attractor["period"] for attractor in plane["attractors"]]
    colours: list[Any] = [tuple(0.55 ** periods[:k].count(period) * part for part in to_rgb(style.colour_of(period)))
                          for k, period in enumerate(periods)]  # Darker for each further one of a period.
    x, y = np.array(first["values"]), np.array(second["values"])
    if labels is not None:
        cells: list[Any] = [*(colour for colour, _ in EXTRAS.values()), *map(style.tint, colours or ["white"])]
        draw_cells(axes, x, y, np.asarray(labels, np.float64) - RUNAWAY, cells)
    axes.set(xlim=edges(x)[[0, -1]], ylim=edges(y)[[0, -1]])
    states = ("initial.plate_angle", "initial.slip_speed", "initial.plate_speed")
    columns = [states.index(axis["key"]) for axis in plane["plane"]]
    third = next(key for key in states if key not in (first["key"], second["key"]))
    ends, first_mark = np.array([edges(x)[[0, -1]], edges(y)[[0, -1]]]), ""
    for k, attractor in enumerate(plane["attractors"]):
        points = np.array(attractor["section_states"]).reshape(-1, 3)[:, columns]
        points = points[((points >= ends.min(axis=1)) & (points <= ends.max(axis=1))).all(axis=1)]
        look: dict[str, Any] = {"marker": MARKERS[k % len(MARKERS)], "color": colours[k],
                                "linestyle": "", "markeredgecolor": "white"}
        periodic = bool(attractor["period"])
        axes.plot(*points.T, markersize=4.5 if periodic else 1.0, markeredgewidth=0.6 if periodic else 0.0,
                  scalex=False, scaley=False, clip_on=True, **look)
        name = (f"{f'period {periods[k]}' if periodic else 'no period'}, largest slip speed "
                f"{speed(attractor['max_slip_speed'], 4)} ({100.0 * attractor['fraction']:.3g} %)")
        if labels is not None and np.any(np.asarray(labels) == k):
            style.key(axes, name, area=True, facecolor=style.tint(colours[k]), edgecolor=look["color"])
        elif len(points):  # Without cells there is no area to name.
            style.key(axes, name, markersize=4.5, **look)
        else:
            style.key(axes, f"{name}, not drawn", linestyle="")
        first_mark = first_mark or (look["marker"] if len(points) else "")
    for name, (colour, words) in EXTRAS.items():
        if plane[name] > 0.0:
            blank = labels is None
            style.key(axes, f"{words} ({100 * plane[name]:.3g} %){', not drawn' * blank}", area=True,
                      facecolor="none" if blank else colour, edgecolor="none" if blank else style.GREY)
    if first_mark:
        beyond = style.quantity_of(third).name.removeprefix("initial ")
        style.key(axes, f"their sections, projected along the {beyond}", linestyle="", marker=first_mark,
                  color=style.GREY, markersize=4.5)


def _fractions(axes: Any, planes: Mapping[str, Any]) -> None:
    values, each = planes["values"], planes["attractors"]
    periods = sorted({a["period"] for attractors in each for a in attractors}, key=lambda p: (p == 0, p))
    bands = [(f"period {period}" if period else "no period", style.tint(style.colour_of(period)),
              [sum(a["fraction"] for a in attractors if a["period"] == period) for attractors in each])
             for period in periods]
    bands += [(words, colour, [share for share, _ in zip(planes[name], values, strict=True)])
              for name, (colour, words) in EXTRAS.items()]
    names, colours, rows = zip(*(band for band in bands if any(band[2])))
    axes.stackplot(values, rows, labels=names, colors=colours, edgecolor=style.GREY, linewidth=0.4)
    axes.set(ylim=(0.0, 1.0), xlim=(min(values), max(values)))
