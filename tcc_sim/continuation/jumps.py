"""Why a sweep jumps: the branch before it or that behind it ends there, or the basins change hands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.diagram import amplitude_of
from tcc_sim.continuation.on_branch import BranchPlace, SettledMotion, pieces_at, place_of
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.special_points import Bifurcation

BASIN, STEEP, APERIODIC, NOT_FOLLOWED = "basin_boundary", "steep", "aperiodic", "not_followed"
"""Causes that are no bifurcation of the branches: both motions go on, and the start is on the other side of the
boundary of their basins; one motion all the way, which only changes steeply; a motion without a period on either side,
whose end no branch tells; a motion with one on either side, but on no branch that was followed."""


@dataclass(frozen=True)
class Jump:
    """A jump between two neighbouring values of a sweep.

    low, high : the two values
    before, after : the largest sizes there
    cause : kind of the bifurcation, or one of BASIN, STEEP, APERIODIC
    found : the bifurcation
    """

    low: float
    high: float
    before: float
    after: float
    cause: str
    found: Bifurcation | None = None

    @property
    def value(self) -> float:
        """Of the bifurcation; else the middle between the two values."""
        return 0.5 * (self.low + self.high) if self.found is None else self.found.value

    def as_json(self, bifurcations: Sequence[Bifurcation]) -> dict[str, Any]:
        """The jump with the number of its bifurcation among all of them, None where it has none."""
        numbers = [k for k, f in enumerate(bifurcations) if f is self.found]
        return {"value": self.value, "between": [self.low, self.high], "max_slip_speed": [self.before, self.after],
                "cause": self.cause, "bifurcation": numbers[0] if numbers else None}


def jumps_of(seen: Sequence[SettledMotion], branches: Sequence[Branch], least: float, base: int = 1,
             direction: str = "cold") -> list[Jump]:
    """The jumps of a sweep, each with its cause.

    Parameters
    ----------
    seen : its motions in order of the parameter
    branches : as `bifurcation_diagram` found them
    least : smallest change of the largest size between neighbours that counts, relative to the largest with a period
    base : cycles after which the excitation repeats
    direction : up or down where every motion goes on from its neighbour below or above: the end of that one is the
        cause then
    """
    size = amplitude_of(seen)
    width = abs(seen[-1].value - seen[0].value) if seen else 0.0
    out = []
    for a, b in pairwise(seen):
        if not abs(b.amplitude - a.amplitude) > least * size:
            continue
        cause, found = _cause(a, b, branches, size, width, base, direction)
        out.append(Jump(a.value, b.value, a.amplitude, b.amplitude, cause, found))
    return out


def _cause(a: SettledMotion, b: SettledMotion, branches: Sequence[Branch], size: float, width: float, base: int,
           direction: str) -> tuple[str, Bifurcation | None]:
    """What ends between two neighbouring motions of a sweep."""
    here, there = place_of(a, branches, size, base), place_of(b, branches, size, base)
    unplaced = NOT_FOLLOWED if any(s.period and p is None for s, p in ((a, here), (b, there))) else APERIODIC
    ends: list[tuple[bool, Bifurcation]] = []
    for place, goal, other, seen in ((here, b.value, there, b), (there, a.value, here, a)):
        if place is None:
            continue
        branch = branches[place.branch]
        last, reached = _walk(branch, place, goal)
        same = other is not None and other.branch == place.branch and abs(last - other.after) <= 1
        if reached and (same or (other is not None and seen.has_period(branch.period, base)
                                     and any(p.after == last and math.isfinite(p.holds(seen, size))
                                             for p in pieces_at(branch, seen.value)))):
            return STEEP, None
        if not reached:
            found = nearest_bifurcation(branch, last, size, width)
            if found is not None:
                ends.append((direction == ("up" if place is here else "down"), found))
    if ends:
        middle = 0.5 * (a.value + b.value)
        best = max(ends, key=lambda end: (end[0], -abs(end[1].value - middle)))[1]
        return best.kind, best
    return (BASIN, None) if here is not None and there is not None else (unplaced, None)


def _walk(branch: Branch, place: BranchPlace, goal: float) -> tuple[int, bool]:
    """How far the branch goes on from a place towards a value of the parameter, stable and without turning.

    Returns
    -------
    The number of the last point, and whether the value was reached (it lies between that point and its neighbour).
    """
    points = branch.points
    a, b = points[place.after], points[place.after + 1]
    toward = 1.0 if goal > min(a.value, b.value) and goal >= max(a.value, b.value) else -1.0
    if min(a.value, b.value) <= goal <= max(a.value, b.value):
        return place.after, a.orbit.stable and b.orbit.stable
    step = 1 if (b.value - a.value) * toward > 0.0 else -1
    at = place.after + 1 if step > 0 else place.after
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
    """The bifurcation of a branch nearest to the pieces about one of its points; None where none is near."""
    about = branch.points[max(point - 1, 0):point + 2]
    values, amplitudes = [s.value for s in about], [s.orbit.seen.largest for s in about]

    def away(found: Bifurcation) -> float:
        return (_beyond(found.value, values) / max(width, 1e-300)
                + _beyond(found.point.orbit.seen.largest, amplitudes) / max(size, 1e-300))

    best = min(branch.bifurcations, key=away, default=None)
    return best if best is not None and away(best) <= DEFAULTS.near_end else None


def _beyond(x: float, among: Sequence[float]) -> float:
    """How far a number is outside of what some numbers span."""
    return max(min(among) - x, x - max(among), 0.0)
