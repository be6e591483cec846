"""Curves of bifurcations in two keys, with points of codimension two: folds, doublings, Neimark-Sacker, stick border.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from tcc_sim.continuation.bordered import MinimallyAugmented
from tcc_sim.continuation.bracket import CurvePoint
from tcc_sim.continuation.codim2_points import SpecialPoint, parameters
from tcc_sim.continuation.curve_track import CurveTrack, facing, start_of_curve
from tcc_sim.continuation.follow import Bounds, End, StopReason, follow
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import Linearised, ParameterRange
from tcc_sim.continuation.special_points import Bifurcation
from tcc_sim.result import Described, reported, reporting

TRACED = ("fold", "period_doubling", "neimark_sacker")
"""Kinds that have a minimally augmented system."""
KINDS = (*TRACED, "stick_border")
"""Kinds that can be followed in two keys."""
Ranges = tuple[ParameterRange, ParameterRange]


@dataclass(frozen=True)
class Special:
    """A point of codimension two: its kind and both parameters, each with its error."""

    kind: str = field(metadata=reported(
        "cusp, generalised_doubling, fold_flip, resonance_1_1 to 1_4, or the border that it meets"))
    value: float = field(metadata=reported("value of the key of --over", "{over}"))
    second: float = field(metadata=reported("value of the key of --second", "{second_over}"))
    error: float = field(metadata=reported("error of `value`", "{over}"))
    second_error: float = field(metadata=reported("error of `second`", "{second_over}"))
    located: bool = field(default=True, metadata=reported(
        "whether it was found; else a test has two signs, each larger than its noise, within the errors"))

    def __str__(self) -> str:
        """In words."""
        values = f"{with_error(self.value, self.error)}  {with_error(self.second, self.second_error)}"
        return f"{self.kind:>22}  {values}{'' if self.located else '  not located: its test changes sign in between'}"


def with_error(value: float, error: float) -> str:
    """A number and its error, with no more digits than the error allows."""
    digits = max(0, min(12, 1 - int(np.floor(np.log10(max(error, 1e-12))))))
    return f"{value:.{digits}f} +- {error:.1g}"


@dataclass(frozen=True, repr=False)
class BifurcationCurve(Described):
    """A curve of one kind of bifurcation: both parameters along it, its special points, and its two ends."""

    kind: str = field(metadata=reported("kind of bifurcation"))
    values: tuple[float, ...] = field(metadata=reported("values of the key of --over", "{over}", name="value"))
    second: tuple[float, ...] = field(metadata=reported("values of the key of --second", "{second_over}"))
    ended: tuple[End, End]
    special: tuple[Special, ...] = field(default=(), metadata=reported("points of codimension two on it"))

    @property
    @reporting("a sentence for each end", name="ended")
    def sentences(self) -> list[str]:
        """Its two ends in words."""
        return [str(end) for end in self.ended]


class Border:
    """The equation of a border in two parameters: a margin vanishes."""

    rounding: ClassVar[float] = 1e-12
    settings: ClassVar[Settings] = DEFAULTS
    first_parameter: ClassVar[int] = 0

    def __init__(self, margin: Callable[[float, float], float], ranges: Ranges) -> None:
        self.margin, self.ranges, self.coarse = margin, ranges, self

    def outer(self, vector: Floats) -> Floats:
        """All unknowns; there are no segments."""
        return vector

    def linearise(self, z: Floats) -> Linearised:
        """The margin and its derivatives by central differences; one-sided ones where the keys' own ranges end."""
        def at(p: Floats) -> float:
            return self.margin(self.ranges[0].value(float(p[0])), self.ranges[1].value(float(p[1])))

        gradient, step = np.empty((1, 2)), self.settings.margin_step
        for k, away in enumerate(step * np.eye(2)):
            try:
                gradient[0, k] = (at(z + away) - at(z - away)) / (2.0 * step)
            except FAILURES:
                side = -1.0 if z[k] > 0.5 else 1.0
                gradient[0, k] = side * (at(z + side * away) - at(z)) / step
        return Linearised(np.array([at(z)]), gradient)


def bifurcation_curve(found: Bifurcation, of: ParameterMap, ranges: Ranges, second: float,
                      settings: Settings | None = None) -> BifurcationCurve:
    """The curve of a bifurcation in two parameters, both ways; the bifurcation alone where it cannot be set up.

    of : the map with both parameters free
    second : value of the second parameter at the bifurcation
    """
    orbit, shooting = found.point.orbit, found.point.shooting
    shooting = replace(shooting, map=of, ranges=ranges, settings=settings or shooting.settings)

    def start() -> CurvePoint:
        finer, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], second)))
        equations = MinimallyAugmented(found.kind, finer, z)
        return start_of_curve(equations, equations.start)

    return _both_ways(found.kind, start, End(StopReason.STEP, ranges[0].name, found.value, shooting.settings.residual),
                      second)


def border_curve(margin: Callable[[float, float], float], ranges: Ranges, value: float,
                 second: float) -> BifurcationCurve:
    """The curve of a margin that vanishes at (value, second), both ways; that point alone where it cannot be set up."""
    at = np.array([ranges[0].scaled(value), ranges[1].scaled(second)])
    return _both_ways("stick_border", lambda: start_of_curve(Border(margin, ranges), at),
                      End(StopReason.STEP, ranges[0].name, value, DEFAULTS.residual), second)


def _both_ways(kind: str, start: Callable[[], CurvePoint], lost: End, second: float) -> BifurcationCurve:
    """The curve through a point, both ways from it or once round.

    lost, second : the end where no way can be set up, and the second parameter there
    """
    tracks: list[CurveTrack] = []
    for forward in (True, False):
        try:
            tracks.append(CurveTrack(facing(start(), forward), BOUNDS))
            deque(follow(tracks[-1]), 0)
        except FAILURES:
            if not tracks:
                return BifurcationCurve(kind, (lost.value,), (second,), (lost, lost))
            tracks[-1].stop = tracks[-1].stop or tracks[-1].end(StopReason.STEP, limit=lost.limit)
        if tracks[-1].ended.reason is StopReason.CLOSED:
            del tracks[:-1]
            break
    ahead, behind = tracks[0], tracks[-1]
    points, special = ahead.points, [s for _, s in ahead.special]
    if behind is not ahead:
        points, special = behind.points[:0:-1] + points, [s for _, s in reversed(behind.special)] + special
    values, others = zip(*map(parameter_values, points))
    return BifurcationCurve(kind, values, others, (behind.ended, ahead.ended), tuple(map(_reported, special)))


BOUNDS: Bounds = ((1, 0.0, 1.0), (0, 0.0, 1.0))
"""Bounds of both parameters; those of the second one first."""


def parameter_values(point: CurvePoint) -> tuple[float, float]:
    """Both parameters at a point of a curve."""
    one, two = (w.value(float(u)) for w, u in zip(point.equations.ranges, parameters(point, point.solution.z)))
    return one, two


def _reported(found: SpecialPoint) -> Special:
    """A special point with both parameters and their errors."""
    one, two = (abs(w.width(0.0)) * float(e) for w, e in zip(found.point.equations.ranges, found.error))
    return Special(found.kind, *parameter_values(found.point), one, two, found.located)
