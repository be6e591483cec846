"""The branches on which the motions of a sweep lie: one is followed from every motion that lies on none yet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tcc_sim.continuation.branch import Branch, first_point, follow
from tcc_sim.continuation.branch_switching import doubled
from tcc_sim.continuation.newton import find_orbit, shifts
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.shooting import ParameterRange, Shooting
from tcc_sim.continuation.special_points import ContinuationPoint
from tcc_sim.continuation.walk import Course

MOST_BRANCHES = 24
MOST_POINTS = 200
"""Points of a branch in one direction."""
LARGEST = 0.3
"""Longest step, in natural sizes: a hundredth of what a picture shows or so."""
LONGEST = 12
"""Longest period followed, in periods of the excitation."""
SAME = 0.01
"""Difference of two largest sizes, relative to the largest of the sweep, up to which they belong to one motion."""
BESIDE = 0.3
"""How far a motion may be off the chord between two points of its branch, relative to how much that chord climbs."""
NOTHING = 1e-3
"""Part of the largest size of a sweep below which that of its periodic motions is no measure."""
MET = 1e-5
"""Distance, relative to the range, at which a branch ends in a doubling."""


@dataclass(frozen=True)
class SettledMotion:
    """A motion that a sweep came to.

    value : of the parameter
    state : (n,) at the start of cycle `cycle`
    period : cycles; 0 where it has none
    amplitude : its largest size
    """

    value: float
    state: Floats
    cycle: int
    period: int
    amplitude: float


@dataclass(frozen=True)
class Place:
    """Where a motion lies: a branch, and the number of the point before it."""

    branch: int
    after: int


def bifurcation_diagram(of: ParameterMap, span: ParameterRange, name: str, seen: Sequence[SettledMotion],
           tick: Callable[[ContinuationPoint], None] | None = None, into: list[Branch] | None = None,
           longest: int = LONGEST, points: int | None = None, branches: int | None = None) -> list[Branch]:
    """Branches through the periodic motions of a sweep, and those that its doublings beget.

    Parameters
    ----------
    of, span, name : the map with one free parameter, its range, and its name for sentences
    seen : motions along the sweep, in order; the longest run of one period that lies on no branch is followed first
    tick : called with every point
    into : takes the branches as they are found
    longest : period followed, in periods of the excitation
    points, branches : most points of a branch in one direction, MOST_POINTS by default; most branches, MOST_BRANCHES
    """
    out: list[Branch] = [] if into is None else into
    course = Course(name, most=MOST_POINTS if points is None else points, tick=tick, largest=LARGEST)
    many = MOST_BRANCHES if branches is None else branches
    size = size_of(seen)
    left = {k: s for k, s in enumerate(seen) if 0 < s.period <= longest * of.forcing_period}
    while left and len(out) < many:
        left = {k: s for k, s in left.items() if place_of(s, out, size, of.forcing_period) is None}
        run = _longest_run(left)
        if not run:
            break
        middle = run[len(run) // 2]
        first = point_of(of, span, left.pop(middle))
        if first is not None and not any(holds(branch, first) for branch in out):
            follow(first, course, "start", len(out), keep=out)
    _doubled(out, course, longest, many)
    return out


def left_out(seen: Sequence[SettledMotion], branches: Sequence[Branch], base: int = 1,
             longest: int = LONGEST) -> list[str]:
    """Sentences on what a bifurcation_diagram did not come to: nothing where it came to an end by itself."""
    size, out = size_of(seen), []
    alone = [s for s in seen if s.period and place_of(s, branches, size, base) is None]
    long = sum(s.period > longest * base for s in alone)
    if len(alone) > long:
        reason = f"{MOST_BRANCHES} branches are followed" if len(branches) >= MOST_BRANCHES else "none was found there"
        out.append(f"{len(alone) - long} of {len(seen)} motions lie on no branch: {reason}")
    if long:
        out.append(f"{long} of {len(seen)} motions have a period above {longest * base} and lie on no branch")
    stopped = sum(any(sentence.startswith("stopped after") for sentence in branch.ended) for branch in branches)
    if stopped:
        out.append(f"{stopped} of {len(branches)} branches go on: {MOST_POINTS} points are followed either way")
    return out


def size_of(seen: Sequence[SettledMotion]) -> float:
    """The largest size of those motions of a sweep that have a period; of all where those are next to nothing."""
    most = max((s.amplitude for s in seen), default=0.0)
    periodic = max((s.amplitude for s in seen if s.period), default=0.0)
    return periodic if periodic > NOTHING * most else most


def point_of(of: ParameterMap, span: ParameterRange, seen: SettledMotion) -> ContinuationPoint | None:
    """The point of a branch at a motion of a sweep; None where Newton's method finds no orbit there."""
    shooting = Shooting.single(of, math.lcm(seen.period, of.forcing_period), span)
    try:
        z = find_orbit(shooting, (seen.value,), [state_at_phase_0(of, seen)])
        return None if z is None else first_point(shooting, z)
    except FAILURES:
        return None


def state_at_phase_0(of: ParameterMap, seen: SettledMotion) -> Floats:
    """The state of a motion where the excitation begins anew, in its cycle or in one of the next."""
    phase = seen.cycle % of.forcing_period
    return of.evaluate(seen.state, (seen.value,), phase, of.forcing_period - phase).value if phase else seen.state


def place_of(seen: SettledMotion, branches: Sequence[Branch], size: float, base: int = 1) -> Place | None:
    """Where a motion lies: on the stable piece with its period and largest size; the nearest one of several."""
    best, place = math.inf, None
    if not seen.period:
        return None
    for number, branch in enumerate(branches):
        if branch.period != math.lcm(seen.period, base):
            continue
        for k, (a, b, part) in _crossed(branch, seen.value):
            if not (a.orbit.stable or b.orbit.stable):
                continue
            low, high = a.orbit.seen.largest, b.orbit.seen.largest
            away = abs(low + part * (high - low) - seen.amplitude)
            if away <= SAME * size + BESIDE * abs(high - low) and away < best:
                best, place = away, Place(number, k)
    return place


def _crossed(branch: Branch, value: float) -> list[tuple[int, tuple[ContinuationPoint, ContinuationPoint, float]]]:
    """The pieces of a branch across a value: number of the first point, both points, and the part of the way."""
    out = []
    for k, a, b in _pieces(branch):
        if min(a.value, b.value) <= value <= max(a.value, b.value):
            width = b.value - a.value
            out.append((k, (a, b, (value - a.value) / width if width else 0.5)))
    return out


def _pieces(branch: Branch) -> Iterator[tuple[int, ContinuationPoint, ContinuationPoint]]:
    """Neighbouring points of a branch, its folds among them: a branch goes on to there beyond its last point."""
    pairs = list(pairwise(branch.points))
    folds: dict[int, list[ContinuationPoint]] = {}
    for found in branch.bifurcations:
        if found.kind == "fold" and pairs:
            aside = [_apart(a, found.point) + _apart(found.point, b) - _apart(a, b) for a, b in pairs]
            folds.setdefault(int(np.argmin(aside)), []).append(found.point)
    for k, (a, b) in enumerate(pairs):
        for one, two in pairwise([a, *folds.get(k, []), b]):
            yield k, one, two


def _apart(a: ContinuationPoint, b: ContinuationPoint) -> float:
    """Distance of two points of a branch, in natural sizes."""
    of, span = a.shooting.map, a.shooting.ranges[0]
    away = (b.orbit.section - a.orbit.section) / of.scales
    return math.hypot(float(np.linalg.norm(away)), span.scaled(b.value) - span.scaled(a.value))


def _longest_run(left: dict[int, SettledMotion]) -> list[int]:
    """The longest run of neighbours with one period."""
    runs: list[list[int]] = []
    for k, s in left.items():
        if runs and runs[-1][-1] == k - 1 and left[k - 1].period == s.period:
            runs[-1].append(k)
        else:
            runs.append([k])
    return max(runs, key=len, default=[])


def holds(branch: Branch, found: ContinuationPoint) -> bool:
    """Whether a branch passes through an orbit, whichever of its cycles it was taken up in."""
    of, orbit = found.shooting.map, found.orbit
    if branch.period != orbit.period:
        return False
    points = np.array(shifts(of, orbit.section, orbit.values, orbit.period))
    for _, (a, b, part) in _crossed(branch, found.value):
        chord = b.orbit.section - a.orbit.section
        away = np.abs((a.orbit.section + part * chord - points) / of.scales).max(axis=1)
        if away.min() <= 1e-3 + BESIDE * np.abs(chord / of.scales).max():
            return True
    return False


def _doubled(branches: list[Branch], course: Course, longest: int, most: int) -> None:
    """Append the branch of every period doubling in which none of the others ends."""
    for number, parent in enumerate(list(branches)):
        for found in parent.bifurcations:
            half = longest * found.point.shooting.map.forcing_period // 2
            if found.kind != "period_doubling" or parent.period > half:
                continue
            span = found.point.shooting.ranges[0]
            ends = [span.scaled(s.value) for b in branches if b.period == 2 * parent.period
                    for s in (b.points[0], b.points[-1])]
            if len(branches) >= most or any(abs(span.scaled(found.value) - x) < MET for x in ends):
                continue
            first = doubled(found)
            if first is not None and not any(holds(branch, first) for branch in branches):
                origin = {"kind": found.kind, "value": found.value, "branch": number}
                began = f"began in the period doubling at {course.name} = {found.value:.9g}"
                follow(first, course, origin, len(branches), both=False, began=began, keep=branches)
