"""Where motions are stable: stretches of branches between two bifurcations, and which one a motion of a sweep is on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tcc_sim.studies.bifurcations import Station
from tcc_sim.studies.branches import Branch
from tcc_sim.studies.jumps import nearest_bifurcation
from tcc_sim.studies.survey import SAME, Seen

DOUBLES = 1e-3
"""Distance, relative to the range, at which motions of twice the period are those that a doubling begets."""


@dataclass(frozen=True)
class End:
    """Where a stretch ends.

    value : of the parameter
    kind : of the bifurcation; empty at the end of the range, or where the branch could not be followed
    residual : of the bifurcation
    jumps : whether no stable motion goes on from it
    """

    value: float
    kind: str = ""
    residual: float = 0.0
    jumps: bool = False

    def __str__(self) -> str:
        """The end in words."""
        what = f"{self.kind.replace('_', ' ')}, residual {self.residual:.0e}" if self.kind else "not an end of its own"
        return f"{self.value:.6g} ({what})"


@dataclass(frozen=True)
class Stretch:
    """Stable motions of one branch over an interval of the parameter.

    period : cycles
    low, high : its ends
    values, heights : along it, values growing
    branch : number of the branch
    """

    period: int
    low: End
    high: End
    values: tuple[float, ...]
    heights: tuple[float, ...]
    branch: int = 0

    def height(self, value: float) -> float:
        """The largest size of the motion; NaN beyond the ends."""
        if not self.low.value <= value <= self.high.value:
            return math.nan
        return float(np.interp(value, self.values, self.heights))

    def __str__(self) -> str:
        """The stretch in words."""
        return f"period {self.period}, stable from {self.low} to {self.high}"


def stretches_of(branches: Sequence[Branch], low: float, high: float, unit: float = 1.0) -> list[Stretch]:
    """The stable stretches of branches over a range from `low` to `high`; their parameter is divided by `unit`."""
    size = max((s.orbit.seen.largest for b in branches for s in b.stations), default=0.0)
    out = []
    for number, branch in enumerate(branches):
        for first, last in _runs(branch.stations):
            ends = [_end(branch, k, beyond, size, low, high, unit) for k, beyond in ((first, -1), (last, 1))]
            part = branch.stations[first:last + 1]
            values, heights = [s.value / unit for s in part], [s.orbit.seen.largest for s in part]
            if values[-1] < values[0]:
                values, heights, ends = values[::-1], heights[::-1], ends[::-1]
            out.append(Stretch(branch.period, ends[0], ends[1], tuple(values), tuple(heights), number))
    near = DOUBLES * (high - low) / unit
    return [replace(s, low=_judged(s.low, s, out, near), high=_judged(s.high, s, out, near)) for s in out]


def _runs(stations: Sequence[Station]) -> list[tuple[int, int]]:
    """First and last numbers of the stable points in a row between which the parameter does not turn."""
    out: list[tuple[int, int]] = []
    start, way = -1, 0.0
    for k, station in enumerate(stations):
        step = np.sign(station.value - stations[k - 1].value) if k else 0.0
        if start >= 0 and station.orbit.stable and way * step < 0.0:
            out.append((start, k - 1))
            start, way = k, 0.0
        elif station.orbit.stable:
            start, way = (k, 0.0) if start < 0 else (start, step or way)
        elif start >= 0:
            out.append((start, k - 1))
            start = -1
    return [*out, (start, len(stations) - 1)] if start >= 0 else out


def _end(branch: Branch, point: int, beyond: int, size: float, low: float, high: float, unit: float) -> End:
    """What ends a stretch at one of its points, towards the neighbour `beyond`."""
    at = branch.stations[point]
    edge = 1e-9 * (high - low)
    if not 0 <= point + beyond < len(branch.stations) and (at.value <= low + edge or at.value >= high - edge):
        return End(at.value / unit)
    found = nearest_bifurcation(branch, point, size, high - low)
    return End(at.value / unit) if found is None else End(found.value / unit, found.kind, found.residual, True)


def _judged(end: End, own: Stretch, among: Sequence[Stretch], near: float) -> End:
    """The end, no jump where motions of twice the period go on stably from it, or those that this one doubled."""
    if end.kind != "period_doubling":
        return end
    goes_on = any(s.period in (2 * own.period, own.period // 2) and s is not own
                  and min(abs(s.low.value - end.value), abs(s.high.value - end.value)) <= near for s in among)
    return replace(end, jumps=not goes_on)


def stretch_of(seen: Seen, among: Sequence[Stretch], size: float, base: int = 1) -> int | None:
    """The number of the stretch that a motion of a sweep is on, by its period and largest size; None for none."""
    away = {k: abs(s.height(seen.value) - seen.height) for k, s in enumerate(among)
            if seen.period and s.period == math.lcm(seen.period, base)}
    near = {k: a for k, a in away.items() if a <= 2.0 * SAME * size}
    return min(near, key=lambda k: near[k]) if near else None
