"""Basins of attraction as a panel: the map of one plane, or the fractions of the plane against a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.shown_units import speed
from tcc_sim.study.basins.attractors import RUNAWAY, UNDECIDED
from tcc_sim.views import style
from tcc_sim.views.panels import Panel
from tcc_sim.views.style import AxisQuantity, quantities
from tcc_sim.views.sweeps import draw_cells, edges

MARKERS = "os^Dvp*"
EXTRAS: dict[int, tuple[Any, str]] = {RUNAWAY: (style.RUNAWAY, "runaway slip"), UNDECIDED: ("#FFFFFF", "undecided")}


def basin_panels(document: Any) -> list[Panel]:
    """Return one plane as a map, or several, one for each value of a key, as fractions against it.

    document : one result or several, or their JSON; to JSON, which has no cells, add the `labels` of the .npz
    """
    if not isinstance(document, Mapping):
        each = document if isinstance(document, Sequence) else [document]
        planes = [{**one.as_json(), "labels": one.labels, "over": one.over} for one in each]
    elif "over" not in document:
        planes = [{**document, "labels": document.get("labels"), "over": None}]
    else:
        planes = [{"over": (document["over"], value), **{name: document[name][k] for name in (
            "attractors", "undecided", "runaway")}} for k, value in enumerate(document["values"])]
    if planes[0]["over"] is None:
        return [Panel("", partial(_map, plane=planes[0]), 4.2)]
    return [Panel("", partial(_fractions, planes=planes), 3.4)]


def _map(axes: Any, plane: Mapping[str, Any]) -> None:
    """Draw the cells, if known, in the colours of their attractors, and the projected section points of these."""
    from matplotlib.colors import to_rgb

    (first, second), periods = plane["plane"], [attractor["period"] for attractor in plane["attractors"]]
    colours: list[Any] = [tuple(0.55 ** periods[:k].count(period) * part for part in to_rgb(style.colour_of(period)))
                          for k, period in enumerate(periods)]  # Darker for each further one of a period.
    x, y = np.array(first["values"]), np.array(second["values"])
    if plane["labels"] is not None:
        cells: list[Any] = [EXTRAS[RUNAWAY][0], EXTRAS[UNDECIDED][0], *map(style.tint, colours or ["white"])]
        draw_cells(axes, x, y, np.asarray(plane["labels"], np.float64) - RUNAWAY, cells)
    axes.set(xlim=edges(x)[[0, -1]], ylim=edges(y)[[0, -1]])
    quantities(axes, style.quantity_of(first["key"]), style.quantity_of(second["key"]))
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
        if plane["labels"] is not None and np.any(np.asarray(plane["labels"]) == k):
            style.key(axes, name, area=True, facecolor=style.tint(colours[k]), edgecolor=look["color"])
        elif len(points):  # Without cells there is no area to name.
            style.key(axes, name, markersize=4.5, **look)
        else:
            style.key(axes, f"{name}, not drawn", linestyle="")
        first_mark = first_mark or (look["marker"] if len(points) else "")
    for name, (colour, words) in zip(("runaway", "undecided"), EXTRAS.values()):
        if plane[name] > 0.0:
            blank = plane["labels"] is None
            style.key(axes, f"{words} ({100 * plane[name]:.3g} %){', not drawn' * blank}", area=True,
                      facecolor="none" if blank else colour, edgecolor="none" if blank else style.GREY)
    if first_mark:
        beyond = style.quantity_of(third).name.removeprefix("initial ")
        style.key(axes, f"their sections, projected along the {beyond}", linestyle="", marker=first_mark,
                  color=style.GREY, markersize=4.5)


def _fractions(axes: Any, planes: Sequence[Mapping[str, Any]]) -> None:
    values = [plane["over"][1] for plane in planes]
    periods = sorted({a["period"] for plane in planes for a in plane["attractors"]}, key=lambda p: (p == 0, p))
    bands = [(f"period {period}" if period else "no period", style.tint(style.colour_of(period)),
              [sum(a["fraction"] for a in plane["attractors"] if a["period"] == period) for plane in planes])
             for period in periods]
    bands += [(words, colour, [plane[name] for plane in planes])
              for name, (colour, words) in zip(("runaway", "undecided"), EXTRAS.values())]
    names, colours, rows = zip(*(band for band in bands if any(band[2])))
    axes.stackplot(values, rows, labels=names, colors=colours, edgecolor=style.GREY, linewidth=0.4)
    axes.set(ylim=(0.0, 1.0), xlim=(min(values), max(values)))
    quantities(axes, style.quantity_of(planes[0]["over"][0]), AxisQuantity("fraction of the plane"))
