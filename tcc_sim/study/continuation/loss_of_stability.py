"""Stable segments of branches, and the causes of jumps of a sweep from one to another.

A sweep jumps where a branch loses its stability, or where the initial state enters another basin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tcc_sim.result import reported
from tcc_sim.study.continuation.branch import Branch
from tcc_sim.study.continuation.diagram import ALIKE, MERGED, SettledMotion, amplitude_of, doubled, pieces_at, place_of
from tcc_sim.study.continuation.follow import StopReason
from tcc_sim.study.continuation.special_points import Bifurcation, ContinuationPoint

NEAR_END = 0.05  # distance of a bifurcation from a loss of stability, parts of range and largest size
SAME_SEGMENT = 1e-3  # relative difference of the largest sizes of one stable segment
NARROWEST = 1e-3  # least width of a segment, relative to the range: canards have many narrower ones

BASIN, STEEP, APERIODIC, NOT_FOLLOWED = "basin_boundary", "steep", "aperiodic", "not_followed"
"""Causes that are no bifurcation of a branch: a motion goes on, and the start enters another basin; one motion that
changes steeply; a motion without a period on either side; a motion on a branch that was not followed up to the other
one."""


@dataclass(frozen=True)
class SegmentEnd:
    """End of a segment.

    value : of the parameter
    kind, residual : of the bifurcation; None at the end of the range, or where the branch could not be followed
    jumps : whether a motion leaves the branch here: at a fold, and at a doubling whose doubled motions are unstable
    """

    value: float = field(metadata=reported("place on the axis"))
    kind: str | None = field(default=None, metadata=reported(
        "bifurcation; null where the motion was followed to there only"))
    residual: float | None = field(default=None, metadata=reported("residual of the bifurcation"))
    jumps: bool = field(default=False, metadata=reported("whether a motion that comes here goes elsewhere"))

    def __str__(self) -> str:
        """The end in words."""
        what = f"{self.kind.replace('_', ' ')}, residual {self.residual:.0e}" if self.kind else "followed no further"
        return f"{self.value:.6g} ({what})"


@dataclass(frozen=True)
class StableSegment:
    """Stable motions of one branch, with a period in cycles, over an interval of the parameter; `values` ascend."""

    period: int = field(metadata=reported("period of the motion", "periods of excitation"))
    low: SegmentEnd = field(metadata=reported("lower end"))
    high: SegmentEnd = field(metadata=reported("upper end"))
    values: tuple[float, ...]
    amplitudes: tuple[float, ...]
    branch: int = 0

    def amplitude(self, value: float) -> float:
        """The largest size of the motion at a value; NaN beyond the ends."""
        if not self.low.value <= value <= self.high.value:
            return math.nan
        return float(np.interp(value, self.values, self.amplitudes))

    def __str__(self) -> str:
        """The segment in words."""
        return f"period {self.period}, stable from {self.low} to {self.high}"


def stable_segments(branches: Sequence[Branch], low: float, high: float, unit: float = 1.0) -> list[StableSegment]:
    """The stable segments of branches over a range from `low` to `high`, in values of the parameter over `unit`."""
    span = low, high
    out = []
    for number, branch in enumerate(branches):
        for first, last in _runs(branch.points):
            ends = [_end_of_segment(branches, branch, point, beyond, span, unit)
                    for point, beyond in ((first, -1), (last, 1))]
            part = branch.points[first:last + 1]
            values, amplitudes = [s.value / unit for s in part], [s.orbit.seen.largest for s in part]
            if values[-1] < values[0]:
                values, amplitudes, ends = values[::-1], amplitudes[::-1], ends[::-1]
            if values[-1] - values[0] > NARROWEST * (high - low) / unit:
                out.append(StableSegment(branch.period, ends[0], ends[1], tuple(values), tuple(amplitudes), number))
    kept: list[StableSegment] = []  # Those that are not part of another one.
    for segment in sorted(out, key=lambda s: s.low.value - s.high.value):
        middle = 0.5 * (segment.low.value + segment.high.value)
        amplitude = segment.amplitude(middle)
        near = SAME_SEGMENT * amplitude
        if not any(s.period == segment.period and abs(s.amplitude(middle) - amplitude) <= near for s in kept):
            kept.append(segment)
    return sorted(kept, key=lambda s: (s.low.value, s.period))


def _runs(points: Sequence[ContinuationPoint]) -> list[tuple[int, int]]:
    """First and last numbers of stable points in a row along which the parameter does not turn."""
    out: list[tuple[int, int]] = []
    way = 0.0
    for k, point in enumerate(points):
        step = np.sign(point.value - points[k - 1].value)
        if point.orbit.stable and out and out[-1][1] == k - 1 and not way * step < 0.0:
            out[-1], way = (out[-1][0], k), step or way
        elif point.orbit.stable:
            out.append((k, k))
            way = 0.0
    return out


def _end_of_segment(branches: Sequence[Branch], branch: Branch, point: int, beyond: int, span: tuple[float, float],
         unit: float) -> SegmentEnd:
    """The end of a segment at one of its points, towards the neighbour `beyond`."""
    at, width = branch.points[point], span[1] - span[0]
    size = max((s.orbit.seen.largest for b in branches for s in b.points), default=0.0)
    inner = 0 <= point + beyond < len(branch.points)
    bifurcation = next((f for f in branch.bifurcations if inner and f.after == min(point, point + beyond)
                        and f.changes_stability), None)
    last = point + beyond if inner else point
    end, near = branch.ended[beyond > 0], MERGED * width
    rest = branch.points[last:] if beyond > 0 else branch.points[:last + 1]
    if bifurcation is None and all(abs(s.value - end.value) <= near for s in rest):
        # Where doubled motions end a multiplier is 1 to rounding, so points there may count as stable or not.
        begun = next((f for b in branches if 2 * b.period == branch.period for f in b.bifurcations
                      if f.kind == "period_doubling" and abs(f.value - end.value) <= near), None)
        if begun is not None and end.reason in (StopReason.BEGAN, StopReason.DOUBLING):
            return SegmentEnd(begun.value / unit, begun.kind, begun.residual)
    if not inner and min(at.value - span[0], span[1] - at.value) <= 1e-9 * width:
        return SegmentEnd(at.value / unit)
    bifurcation = bifurcation or nearest_bifurcation(branch, point, size, width)
    if bifurcation is None:
        return SegmentEnd(at.value / unit)
    jumps = bifurcation.kind == "fold"
    if bifurcation.kind == "period_doubling":
        first = doubled(bifurcation)
        jumps = first is None or not first.orbit.stable
    return SegmentEnd(bifurcation.value / unit, bifurcation.kind, bifurcation.residual, jumps)


def segment_of(seen: SettledMotion, among: Sequence[StableSegment], size: float, base: int = 1) -> int | None:
    """The number of the segment of a motion of a sweep, by its period and largest size; None where there is none."""
    away = {k: abs(s.amplitude(seen.value) - seen.amplitude) for k, s in enumerate(among)
            if seen.has_period(s.period, base)}
    near = {k: a for k, a in away.items() if a <= 2.0 * ALIKE * size}
    return min(near, key=lambda k: near[k]) if near else None


@dataclass(frozen=True)
class Jump:
    """Jump between two neighbouring values `low` and `high` of a sweep.

    before, after : the largest sizes there
    cause : kind of the bifurcation, or one of BASIN, STEEP, APERIODIC, NOT_FOLLOWED
    """

    low: float
    high: float
    before: float
    after: float
    cause: str
    bifurcation: Bifurcation | None = None

    @property
    def value(self) -> float:
        """Value of the bifurcation, or the middle between the two values."""
        return 0.5 * (self.low + self.high) if self.bifurcation is None else self.bifurcation.value


def jumps_of(seen: Sequence[SettledMotion], branches: Sequence[Branch], least: float, base: int = 1,
             direction: str = "cold") -> list[Jump]:
    """The jumps of a sweep, each with its cause.

    Parameters
    ----------
    seen : its motions in order of the parameter
    branches : from `bifurcation_diagram`
    least : smallest change of the largest size of a jump, relative to the largest periodic motion
    base : cycles after which the excitation repeats
    direction : up or down where every motion starts from its neighbour below or above, whose end is then the cause
    """
    size = amplitude_of(seen)
    width = abs(seen[-1].value - seen[0].value) if seen else 0.0
    out = []
    for a, b in pairwise(seen):
        if not abs(b.amplitude - a.amplitude) > least * size:
            continue
        cause, bifurcation = _cause(a, b, branches, size, width, base, direction)
        out.append(Jump(a.value, b.value, a.amplitude, b.amplitude, cause, bifurcation))
    return out


def _cause(a: SettledMotion, b: SettledMotion, branches: Sequence[Branch], size: float, width: float, base: int,
           direction: str) -> tuple[str, Bifurcation | None]:
    """The cause of a jump between two neighbouring motions of a sweep, and its bifurcation."""
    place_before, place_after = place_of(a, branches, size, base), place_of(b, branches, size, base)
    unplaced = NOT_FOLLOWED if any(s.period and p is None for s,
                                   p in ((a, place_before), (b, place_after))) else APERIODIC
    ends, goes_on = list[tuple[bool, Bifurcation]](), False
    for place, goal, other, seen in ((place_before, b.value, place_after, b), (place_after, a.value, place_before, a)):
        if place is None:
            continue
        branch = branches[place[0]]
        last, reached = _walk(branch, place[1], goal)
        same = other is not None and other[0] == place[0] and abs(last - other[1]) <= 1
        if reached and (same or (other is not None and seen.has_period(branch.period, base)
                                     and any(p.after == last and math.isfinite(p.holds(seen, size))
                                             for p in pieces_at(branch, seen.value)))):
            return STEEP, None
        goes_on = goes_on or reached
        if not reached:
            bifurcation = nearest_bifurcation(branch, last, size, width)
            if bifurcation is not None:
                ends.append((direction == ("up" if place is place_before else "down"), bifurcation))
    if ends:
        middle = 0.5 * (a.value + b.value)
        best = max(ends, key=lambda end: (end[0], -abs(end[1].value - middle)))[1]
        return best.kind, best
    if place_before is None or place_after is None:
        return unplaced, None
    return BASIN if goes_on else NOT_FOLLOWED, None


def _walk(branch: Branch, after: int, goal: float) -> tuple[int, bool]:
    """The last point of a branch towards a value along stable points without a turn, from the piece after one of them.

    Also whether the value is reached, between that point and its neighbour.
    """
    points = branch.points
    a, b = points[after], points[after + 1]
    toward = 1.0 if goal > min(a.value, b.value) and goal >= max(a.value, b.value) else -1.0
    if min(a.value, b.value) <= goal <= max(a.value, b.value):
        return after, a.orbit.stable and b.orbit.stable
    step = 1 if (b.value - a.value) * toward > 0.0 else -1
    at = after + 1 if step > 0 else after
    while True:
        if not points[at].orbit.stable:
            return at, False
        following = at + step
        if not 0 <= following < len(points) or (points[following].value - points[at].value) * toward <= 0.0:
            return at, False
        if (points[following].value - goal) * toward >= 0.0:
            return min(at, following), points[following].orbit.stable
        at = following


def nearest_bifurcation(branch: Branch, point: int, size: float, width: float) -> Bifurcation | None:
    """The bifurcation of a branch nearest to the pieces about one of its points; None for none nearby."""
    about = branch.points[max(point - 1, 0):point + 2]
    values, amplitudes = [s.value for s in about], [s.orbit.seen.largest for s in about]

    def away(bifurcation: Bifurcation) -> float:
        return (_beyond(bifurcation.value, values) / max(width, 1e-300)
                + _beyond(bifurcation.point.orbit.seen.largest, amplitudes) / max(size, 1e-300))

    best = min(branch.bifurcations, key=away, default=None)
    return best if best is not None and away(best) <= NEAR_END else None


def _beyond(x: float, among: Sequence[float]) -> float:
    """Distance of a number from the interval of some numbers."""
    return max(min(among) - x, x - max(among), 0.0)
