"""Basins of attraction as a picture: the map of one plane, or the fractions of the plane against a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.basins.compute import Basins
from tcc_sim.basins.proximity import RUNAWAY, UNDECIDED, Attractor
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.views import style
from tcc_sim.views.sweeps import draw_cells

TINTS = ("#BFD9EC", "#F6D9A8", "#BFE3D4", "#F0C6AE", "#EBD2E0", "#D3ECF8", "#D0D0D0")
"""Light versions of the colours of `style.CYCLE`, in their order, so that attractors stand out on their basins."""
MARKERS = "os^Dvp*"
EXTRAS = {RUNAWAY: (style.RUNAWAY, "runaway slip"), UNDECIDED: ("#FFFFFF", "undecided")}


def draw_basins(path: Path, found: Basins | Sequence[Basins], title: str = "", width: float = style.PAGE) -> Path:
    """Draw one plane as a map, or several, one for each value of a key, as fractions against it."""
    planes = [found] if isinstance(found, Basins) else found
    with style.figure(width, (0.62 if planes[0].over is None else 0.5) * width) as picture:
        axes = picture.add_subplot()
        into(axes, planes, {"loc": "outside upper left"})
        if title:
            axes.set_title(title)
        return style.save(picture, path)


def into(axes: Any, found: Basins | Sequence[Basins], legend: Mapping[str, Any] | None = None) -> None:
    """Draw the same into axes; `legend` says where that of a map is, in its figure."""
    planes = [found] if isinstance(found, Basins) else found
    if planes[0].over is None:
        handles = _map(axes, planes[0])
        if legend is None:
            axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize="small")
        else:
            axes.figure.legend(handles=handles, ncols=1, **legend)
    else:
        _fractions(axes, planes, planes[0].over[0], [one.over[1] for one in planes if one.over is not None])


def attractor_label(attractor: Attractor) -> str:
    """An attractor in a legend."""
    what = f"period {attractor.period}" if attractor.period else "no period"
    return f"{what}, largest slip speed {attractor.largest:.4g} rad/s"


def _map(axes: Any, found: Basins) -> list[Any]:
    """Cells coloured by their attractor, the attractors' section points on them where they lie in the plane; what
    stands in the legend.
    """
    from matplotlib.patches import Patch

    first, second = found.plane
    count = len(found.attractors)
    colours = [EXTRAS[RUNAWAY][0], EXTRAS[UNDECIDED][0], *(TINTS[k % len(TINTS)] for k in range(max(count, 1)))]
    draw_cells(axes, np.array(first.values), np.array(second.values), np.asarray(found.labels - RUNAWAY, np.float64),
               colours)
    axes.set(xlabel=_label(first.key), ylabel=_label(second.key))
    columns = [("initial.slip_speed", "initial.plate_angle", "initial.plate_speed").index(a.key) for a in found.plane]
    handles = []
    for k, attractor in enumerate(found.attractors):
        part = 100.0 * found.fraction(k)
        x, y = attractor.section[:, columns].T
        style_of = {"marker": MARKERS[k % len(MARKERS)], "color": style.CYCLE[k % len(style.CYCLE)]}
        axes.plot(x, y, linestyle="", markersize=4.5 if attractor.period else 1.0, markeredgecolor="white",
                  markeredgewidth=0.6 if attractor.period else 0.0, scalex=False, scaley=False, clip_on=True,
                  **style_of)
        handles.append(Patch(facecolor=TINTS[k % len(TINTS)], edgecolor=style.CYCLE[k % len(style.CYCLE)],
                             label=f"{attractor_label(attractor)} ({part:.3g} %)"))
    for label, (colour, name) in EXTRAS.items():
        if found.fraction(label) > 0.0:
            handles.append(Patch(facecolor=colour, edgecolor=style.GREY,
                                 label=f"{name} ({100 * found.fraction(label):.3g} %)"))
    return handles


def _fractions(axes: Any, found: Sequence[Basins], key: str, values: Sequence[float]) -> None:
    """Parts of the plane, stacked: motions in order of their period, those without one, runaway slip, undecided."""
    periods = sorted({a.period for one in found for a in one.attractors}, key=lambda p: (p == 0, p))
    rows, names, colours = [], [], []
    for k, period in enumerate(periods):
        rows.append([sum(one.fraction(i) for i, a in enumerate(one.attractors) if a.period == period) for one in found])
        names.append(f"period {period}" if period else "no period")
        colours.append(TINTS[k % len(TINTS)])
    for label, (colour, name) in EXTRAS.items():
        part = [one.fraction(label) for one in found]
        if any(part):
            rows.append(part)
            names.append(name)
            colours.append(colour)
    axes.stackplot(values, rows, labels=names, colors=colours, edgecolor=style.GREY, linewidth=0.4)
    axes.set(xlabel=_label(key), ylabel="fraction of the plane", ylim=(0.0, 1.0), xlim=(min(values), max(values)))
    style.legend_above(axes)


def _label(key: str) -> str:
    """A key with its unit."""
    unit = QUANTITIES[key].unit
    return f"{key.split('.')[1].replace('_', ' ')} ({unit})" if unit else key.split(".")[1].replace("_", " ")
