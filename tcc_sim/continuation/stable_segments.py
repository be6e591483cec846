"""Where motions are stable: segments of branches between two bifurcations, and which one a motion of a sweep is on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.branch_switching import doubled
from tcc_sim.continuation.jumps import nearest_bifurcation
from tcc_sim.continuation.on_branch import SettledMotion
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint
from tcc_sim.continuation.stopping import StopReason


@dataclass(frozen=True)
class SegmentEnd:
    """Where a segment ends.

    value : of the parameter
    kind : of the bifurcation; empty at the end of the range, or where the branch could not be followed
    residual : of the bifurcation
    jumps : whether a motion that comes here goes elsewhere: at a fold, and at a doubling whose motions are unstable
    """

    value: float
    kind: str = ""
    residual: float = 0.0
    jumps: bool = False

    def __str__(self) -> str:
        """The end in words."""
        what = f"{self.kind.replace('_', ' ')}, residual {self.residual:.0e}" if self.kind else "followed no further"
        return f"{self.value:.6g} ({what})"


@dataclass(frozen=True)
class StableSegment:
    """Stable motions of one branch over an interval of the parameter.

    period : cycles
    low, high : its ends
    values, amplitudes : along it, values growing
    branch : number of the branch
    """

    period: int
    low: SegmentEnd
    high: SegmentEnd
    values: tuple[float, ...]
    amplitudes: tuple[float, ...]
    branch: int = 0

    def amplitude(self, value: float) -> float:
        """The largest size of the motion; NaN beyond the ends."""
        if not self.low.value <= value <= self.high.value:
            return math.nan
        return float(np.interp(value, self.values, self.amplitudes))

    def __str__(self) -> str:
        """The segment in words."""
        return f"period {self.period}, stable from {self.low} to {self.high}"


def stable_segments(branches: Sequence[Branch], low: float, high: float, unit: float = 1.0) -> list[StableSegment]:
    """The stable segments of branches over a range from `low` to `high`; their parameter is divided by `unit`."""
    span = low, high
    out = []
    for number, branch in enumerate(branches):
        for first, last in _runs(branch.points):
            ends = [_end(branches, branch, first, -1, span, unit), _end(branches, branch, last, 1, span, unit)]
            part = branch.points[first:last + 1]
            values, amplitudes = [s.value / unit for s in part], [s.orbit.seen.largest for s in part]
            if values[-1] < values[0]:
                values, amplitudes, ends = values[::-1], amplitudes[::-1], ends[::-1]
            if values[-1] - values[0] > DEFAULTS.narrowest * (high - low) / unit:
                out.append(StableSegment(branch.period, ends[0], ends[1], tuple(values), tuple(amplitudes), number))
    return _different(out)


def _different(found: list[StableSegment]) -> list[StableSegment]:
    """The segments without those that are part of another one."""
    out: list[StableSegment] = []
    for segment in sorted(found, key=lambda s: s.low.value - s.high.value):
        middle = 0.5 * (segment.low.value + segment.high.value)
        amplitude = segment.amplitude(middle)
        near = DEFAULTS.same_segment * amplitude
        if not any(s.period == segment.period and abs(s.amplitude(middle) - amplitude) <= near for s in out):
            out.append(segment)
    return sorted(out, key=lambda s: (s.low.value, s.period))


def _runs(points: Sequence[ContinuationPoint]) -> list[tuple[int, int]]:
    """First and last numbers of the stable points in a row between which the parameter does not turn."""
    out: list[tuple[int, int]] = []
    start, way = -1, 0.0
    for k, point in enumerate(points):
        step = np.sign(point.value - points[k - 1].value) if k else 0.0
        if start >= 0 and point.orbit.stable and way * step < 0.0:
            out.append((start, k - 1))
            start, way = k, 0.0
        elif point.orbit.stable:
            start, way = (k, 0.0) if start < 0 else (start, step or way)
        elif start >= 0:
            out.append((start, k - 1))
            start = -1
    return [*out, (start, len(points) - 1)] if start >= 0 else out


def _end(branches: Sequence[Branch], branch: Branch, point: int, beyond: int, span: tuple[float, float],
         unit: float) -> SegmentEnd:
    """What ends a segment at one of its points, towards the neighbour `beyond`."""
    at, width = branch.points[point], span[1] - span[0]
    size = max((s.orbit.seen.largest for b in branches for s in b.points), default=0.0)
    inner = 0 <= point + beyond < len(branch.points)
    found = branch.change_of_stability(min(point, point + beyond)) if inner else None
    # Where doubled motions end a multiplier is 1, more or less: that point may count as stable or not.
    last = point + beyond if inner else point
    if found is None and last in (0, len(branch.points) - 1):
        begun = _doubling_of(branches, branch, last, width)
        if begun is not None:
            return SegmentEnd(begun.value / unit, begun.kind, begun.residual)
    if not inner and min(at.value - span[0], span[1] - at.value) <= 1e-9 * width:
        return SegmentEnd(at.value / unit)
    found = found or nearest_bifurcation(branch, point, size, width)
    return SegmentEnd(at.value / unit) if found is None else SegmentEnd(found.value / unit, found.kind, found.residual,
                                                                        _jumps(found))


def _doubling_of(branches: Sequence[Branch], branch: Branch, point: int, width: float) -> Bifurcation | None:
    """The doubling of motions of half the period in which a branch begins or ends; None where it is none."""
    end = branch.ended[0] if point == 0 else branch.ended[1]
    if end.reason not in (StopReason.BEGAN, StopReason.DOUBLING):
        return None
    near = branch.points[0].shooting.settings.merged * width
    return next((f for b in branches if 2 * b.period == branch.period for f in b.bifurcations
                 if f.kind == "period_doubling" and abs(f.value - end.value) <= near), None)


def _jumps(found: Bifurcation) -> bool:
    """Whether a motion goes elsewhere beyond a bifurcation; a doubling is asked for the motions that it begets."""
    if found.kind == "period_doubling":
        first = doubled(found)
        return first is None or not first.orbit.stable
    return found.kind == "fold"


def segment_of(seen: SettledMotion, among: Sequence[StableSegment], size: float, base: int = 1) -> int | None:
    """The number of the segment that a motion of a sweep is on, by its period and largest size; None for none."""
    away = {k: abs(s.amplitude(seen.value) - seen.amplitude) for k, s in enumerate(among)
            if seen.has_period(s.period, base)}
    near = {k: a for k, a in away.items() if a <= 2.0 * DEFAULTS.alike * size}
    return min(near, key=lambda k: near[k]) if near else None
