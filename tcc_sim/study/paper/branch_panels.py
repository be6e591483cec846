"""Drawings of `figure --branches`: branches over points, and the cause of each jump; marks of points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.study.paper.figure_results import Labelled, MotionsBehind
from tcc_sim.study.views.branch_diagram import MARKS, UNSTABLE, stable_and_unstable
from tcc_sim.views import style
from tcc_sim.views.sweeps import numbers

CAUSES = {"basin_boundary": "basin", "period_doubling": "doubling", "neimark_sacker": "torus"}
"""Labels of jumps whose cause has a longer name."""
UNNAMED = ("aperiodic", "not_followed")
"""Causes without a label in drawings, because there may be dozens; JSON and pages name them."""
UNSEEN = ("steep",)
"""Causes without a mark, because one motion continues."""
OFF_BRANCHES: dict[str, Any] = {"linewidth": 0.4, "linestyle": (0, (1, 3))}
"""Line of a jump whose cause is UNNAMED."""
NARROWEST = 0.021
"""Least distance of neighbouring labels, as a fraction of the axis."""
AXES = {"omega/omega_n": r"frequency ratio $\omega/\omega_n$", "mu_k/mu_s": r"friction ratio $\mu_k/\mu_s$"}


def draw_branches(axis: Any, curve: Labelled, unit: float, colour: str) -> None:
    """Draw the largest slip speed of every branch: solid if stable, dashed if unstable, thicker for longer periods."""
    motions = behind([curve])
    periods = sorted({b["period"] for b in motions.branches})
    for number, branch in enumerate(motions.branches):
        thicker = 0.35 * min(periods.index(branch["period"]), 3)
        for (x, height), dashes, width in zip(stable_and_unstable(vars(motions), number), ("-", UNSTABLE), (1.1, 0.7)):
            axis.plot(x / unit, height, linestyle=dashes, linewidth=width + thicker, color=colour, zorder=2.5)
    for item in motions.bifurcations:
        axis.plot([item["value"] / unit], [item["max_slip_speed"]], linestyle="none", marker=MARKS[item["kind"]][0],
                  color=style.INK, markersize=2.8, markeredgewidth=0.0, zorder=4)


def behind(curves: Sequence[Labelled]) -> MotionsBehind:
    """Join the motions behind some curves."""
    parts = [curve.behind for curve in curves if curve.behind is not None]
    return MotionsBehind(**{item.name: [x for part in parts for x in getattr(part, item.name)]
                            for item in fields(MotionsBehind)})


def room_above(curves: Sequence[Labelled]) -> float:
    """Return the height above the axes for the labels of `label_jumps`, if there are any, and a title, points."""
    return 64.0 if any(jump.cause not in UNNAMED + UNSEEN for jump in behind(curves).jumps) else 6.0


def label_jumps(axis: Any, curves: Sequence[Labelled], unit: float, colours: Sequence[str]) -> None:
    """Label every jump due to a bifurcation or a basin above the axes, without overlap, with a thin line to it.

    Jumps beside a motion without a period or a branch have a dotted line and no label.
    """
    low, high = axis.get_xlim()
    named: dict[tuple[str, str], tuple[float, str]] = {}
    for curve, colour in zip(curves, colours):
        for jump in behind([curve]).jumps:
            x, cause = jump.value / unit, jump.cause
            if cause in UNNAMED:
                axis.axvline(x, color=colour, alpha=0.6, zorder=1.4, **OFF_BRANCHES)
            elif cause not in UNSEEN:
                axis.axvline(x, color=colour, linewidth=0.5, alpha=0.7, zorder=1.5)
                name = CAUSES.get(cause, cause.removesuffix("_sliding").replace("_", " "))
                named.setdefault((name, f"{x:.4f}"), (x, colour))
    labels = sorted((x, f"{name} {value}", colour) for (name, value), (x, colour) in named.items())
    least = NARROWEST if style.wide(axis.figure.get_figwidth()) else 1.4 * NARROWEST
    places = spread([x for x, _, _ in labels], least * (high - low), low, high)
    for place, (x, text, colour) in zip(places, labels):
        axis.annotate(text, (x, 1.0), (place, 1.06), xycoords=("data", "axes fraction"), rotation=90,
                      textcoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=5.2, color=colour,
                      annotation_clip=False, arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": colour,
                                                         "shrinkA": 0.0, "shrinkB": 0.0})


def spread(places: Sequence[float], least: float, low: float, high: float) -> list[float]:
    """Move sorted positions apart to at least `least` by minimal shifts, within `low` to `high` if possible.

    Isotonic regression by the max-min formula (R. E. Barlow and others (1972), Sec. 1.2).
    """
    count = len(places)
    steps = least * np.arange(count)
    sums = np.concatenate([[0.0], np.cumsum(np.array(places) - steps)])
    moved = np.array([max(min((sums[end] - sums[k]) / (end - k) for end in range(n + 1, count + 1))
                          for k in range(n + 1)) for n in range(count)])
    if count * least <= high - low:
        moved = np.clip(moved, low, high - least * max(count - 1, 0))
    return [float(x) for x in moved + steps]


def top_of(curves: Sequence[Labelled]) -> tuple[float, int]:
    """Return the end of the axis of maxima, above branches and settled motions, and the number of points beyond."""
    inside = [0.0]
    for curve in curves:
        inside += [max(b["max_slip_speed"]) for b in behind([curve]).branches]
        inside += bounded(curve)[dict(marked(curve))[SETTLED]].tolist()
    top = max(1.12 * max(inside), 1e-6)
    return top, sum(int((bounded(curve) > top).sum()) for curve in curves)


def legend_of(axis: Any, curves: Sequence[Labelled], swept: Sequence[Labelled], beyond: int) -> None:
    """Draw the legend in axes of its own: lines of branches, marks of `swept` curves, number of points beyond."""
    followed = behind(curves)
    some = any(any(b["stable"]) for b in followed.branches)
    rows: list[dict[str, Any]] = [{"label": "stable (thicker: longer period)"}] * some
    whole = all(all(b["stable"]) for b in followed.branches)
    rows += [{"label": "unstable", "linewidth": 0.7, "linestyle": UNSTABLE}] * (not whole)
    rows += [{"label": mark.name, **mark.look(style.INK, 2.4)} for mark in marks_met(swept)]
    rows += [{"label": f"({counted(beyond, 'point')} beyond the axes)", "linestyle": "none"}] * bool(beyond)
    rows += [{"label": name, "marker": marker, "markersize": 3.2, "markeredgewidth": 0.0, "linestyle": "none"}
             for marker, name in (MARKS[kind] for kind in dict.fromkeys(f["kind"] for f in followed.bifurcations))]
    causes = {jump.cause for jump in behind(swept).jumps}
    rows += [{"label": "jump, with its cause", "linewidth": 0.5}] * bool(causes.difference(UNNAMED, UNSEEN))
    rows += [{"label": "jump off the branches", **OFF_BRANCHES}] * bool(causes.intersection(UNNAMED))
    axis.set_axis_off()
    for row in rows:
        style.key(axis, **{"color": style.INK, **row})
    columns = 4 if style.wide(axis.figure.get_figwidth()) else 2
    if (named := style.legend(axis, loc="center", ncols=columns, fontsize=6.2)) is not None:
        named.set_in_layout(False)


@dataclass(frozen=True)
class Mark:
    """Look of points; `face` and `colour` override the colour of the curve, and `size` that of the picture."""

    name: str
    marker: str
    face: str = ""
    edge: float = 0.0
    size: float = 0.0
    colour: str = ""

    def look(self, colour: str, size: float = 1.8) -> dict[str, Any]:
        """Return the keywords of a plot."""
        colour = self.colour or colour
        return {"linestyle": "none", "marker": self.marker, "color": colour, "markersize": self.size or size,
                "markerfacecolor": self.face or colour, "markeredgewidth": self.edge}


SETTLED = Mark("settled in a period", "o")
APERIODIC = Mark("no period up to 16", "o", "white", 0.5)
SETTLING = Mark("still settling to a period", "x", "white", 0.5)
AWAY = Mark("slip grows without end", "^", colour=style.RUNAWAY)
OTHER = Mark("coexists: reached from a neighbour's state", "D", "none", 0.7, 3.2)
SPIKE = Mark("transient outlasting the dropped cycles", "v", "none", 0.8, 4.5)


def marked(curve: Labelled) -> list[tuple[Mark, np.ndarray]]:
    """Return every kind of point with (n,) whether each point of a curve is of this kind."""
    away, period, done = (np.array([other if v is None else v for v in values]) for values, other in (
        (curve.runaway, False), (curve.period, 0), (curve.settled, True)))
    where = (~away & (period > 0) & done, ~away & (period > 0) & ~done, ~away & (period == 0), away)
    return list(zip((SETTLED, SETTLING, APERIODIC, AWAY), (w.astype(bool) for w in where)))


def draw_runaways(axis: Any, x: Sequence[float], curve: Labelled) -> None:
    """Mark runaway slip at the upper edge, since its size depends on the solved time only."""
    where = dict(marked(curve))[AWAY]
    axis.plot(np.array(x)[where], np.full(int(where.sum()), 0.97), transform=axis.get_xaxis_transform(), zorder=2,
              **AWAY.look("", 3.0))


def bounded(curve: Labelled) -> np.ndarray:
    """Return (n,) largest slip speeds, NaN for a failure or runaway slip."""
    return np.where(dict(marked(curve))[AWAY], np.nan, numbers(curve.max_slip_speed))


def marks_met(curves: Sequence[Labelled]) -> list[Mark]:
    """Return the kinds of points on some curves."""
    return list(dict.fromkeys(mark for curve in curves for mark, where in marked(curve) if where.any()))
