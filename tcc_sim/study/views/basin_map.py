"""Basins of attraction as a picture: the map of one plane, or the fractions of the plane against a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.shown_units import speed
from tcc_sim.study.basins.proximity import RUNAWAY, UNDECIDED
from tcc_sim.views import style
from tcc_sim.views.sweeps import draw_cells, edges

TINTS = ("#BFD9EC", "#F6D9A8", "#BFE3D4", "#F0C6AE", "#EBD2E0", "#D3ECF8", "#D0D0D0")
"""Light versions of the colours of `style.CYCLE`, in their order, so that attractors stand out on their basins."""
MARKERS = "os^Dvp*"
EXTRAS = {RUNAWAY: (style.RUNAWAY, "runaway slip"), UNDECIDED: ("#FFFFFF", "undecided")}


def draw_basins(path: Path, document: Any, title: str = "", width: float = style.PAGE) -> Path:
    """Draw one plane as a map, or several, one for each value of a key, as fractions against it.

    Parameters
    ----------
    document : one result or several, or their JSON; to JSON, which has no cells, add the `labels` of the .npz
    """
    planes = planes_of(document)
    with style.figure(width, (0.62 if planes[0]["over"] is None else 0.5) * width + 0.4, title) as drawn:
        axes = drawn.add_subplot()
        _into(axes, planes)
        if planes[0]["over"] is None:
            style.legend_below(drawn, [axes])
        return style.save(drawn, path)


def into(axes: Any, document: Any) -> None:
    """Draw the picture of `draw_basins` into axes."""
    planes = planes_of(document)
    _into(axes, planes)
    if planes[0]["over"] is None:
        style.legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize="small")


def planes_of(document: Any) -> list[dict[str, Any]]:
    """Return the planes of results or of their JSON as mappings: the keys of the JSON, `labels` (None without cells),
    and `over` (key and value; None for a single plane).
    """
    if not isinstance(document, Mapping):
        each = document if isinstance(document, Sequence) else [document]
        return [{**one.as_json(), "labels": one.labels, "over": one.over} for one in each]
    if "over" not in document:
        return [{**document, "labels": document.get("labels"), "over": None}]
    names = ("attractors", "undecided", "runaway", *(["labels"] if "labels" in document else []))
    return [{"labels": None, "plane": document["plane"], **{name: document[name][k] for name in names},
             "over": (document["over"], value)} for k, value in enumerate(document["values"])]


def _into(axes: Any, planes: Sequence[Mapping[str, Any]]) -> None:
    """Draw planes into axes."""
    if planes[0]["over"] is None:
        _map(axes, planes[0])
    else:
        _fractions(axes, planes)


def attractor_label(attractor: Mapping[str, Any]) -> str:
    """Return the legend entry of an attractor."""
    what = f"period {attractor['period']}" if attractor["period"] else "no period"
    return f"{what}, largest slip speed {speed(attractor['max_slip_speed'], 4)}"


def _map(axes: Any, plane: Mapping[str, Any]) -> None:
    """Draw the cells, if known, in the colours of their attractors, and the projected section points of these."""
    first, second = plane["plane"]
    count = len(plane["attractors"])
    x, y = np.array(first["values"]), np.array(second["values"])
    if plane["labels"] is not None:
        colours = [EXTRAS[RUNAWAY][0], EXTRAS[UNDECIDED][0], *(TINTS[k % len(TINTS)] for k in range(max(count, 1)))]
        draw_cells(axes, x, y, np.asarray(plane["labels"], np.float64) - RUNAWAY, colours)
    axes.set(xlabel=style.label_of(first["key"]), ylabel=style.label_of(second["key"]), xlim=edges(x)[[0, -1]],
             ylim=edges(y)[[0, -1]])
    states = ("initial.plate_angle", "initial.slip_speed", "initial.plate_speed")
    columns = [states.index(axis["key"]) for axis in plane["plane"]]
    third = next(key for key in states if key not in (first["key"], second["key"]))
    ends, first_mark = np.array([edges(x)[[0, -1]], edges(y)[[0, -1]]]), ""
    for k, attractor in enumerate(plane["attractors"]):
        points = np.array(attractor["section_states"]).reshape(-1, 3)[:, columns]
        points = points[((points >= ends.min(axis=1)) & (points <= ends.max(axis=1))).all(axis=1)]
        look: dict[str, Any] = {"marker": MARKERS[k % len(MARKERS)], "color": style.CYCLE[k % len(style.CYCLE)],
                                "linestyle": "", "markeredgecolor": "white"}
        periodic = bool(attractor["period"])
        axes.plot(*points.T, markersize=4.5 if periodic else 1.0, markeredgewidth=0.6 if periodic else 0.0,
                  scalex=False, scaley=False, clip_on=True, **look)
        name = f"{attractor_label(attractor)} ({100.0 * attractor['fraction']:.3g} %)"
        if plane["labels"] is not None and np.any(np.asarray(plane["labels"]) == k):
            style.key(axes, name, area=True, facecolor=TINTS[k % len(TINTS)], edgecolor=look["color"])
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
        beyond = style.label_of(third).removeprefix("initial ").partition(" (")[0]
        style.key(axes, f"their sections, projected along the {beyond}", linestyle="", marker=first_mark,
                  color=style.GREY, markersize=4.5)


def _fractions(axes: Any, planes: Sequence[Mapping[str, Any]]) -> None:
    """Draw stacked fractions of the plane: motions by period, without a period, runaway slip, undecided."""
    values = [plane["over"][1] for plane in planes]
    periods = sorted({a["period"] for plane in planes for a in plane["attractors"]}, key=lambda p: (p == 0, p))
    rows, names, colours = [], [], []
    for k, period in enumerate(periods):
        part = [sum(a["fraction"] for a in plane["attractors"] if a["period"] == period) for plane in planes]
        if not any(part):
            continue
        rows.append(part)
        names.append(f"period {period}" if period else "no period")
        colours.append(TINTS[k % len(TINTS)])
    for name, (colour, words) in zip(("runaway", "undecided"), EXTRAS.values()):
        part = [plane[name] for plane in planes]
        if any(part):
            rows.append(part)
            names.append(words)
            colours.append(colour)
    axes.stackplot(values, rows, labels=names, colors=colours, edgecolor=style.GREY, linewidth=0.4)
    axes.set(xlabel=style.label_of(planes[0]["over"][0]), ylabel="fraction of the plane", ylim=(0.0, 1.0),
             xlim=(min(values), max(values)))
    style.legend_above(axes)
