"""Branches of periodic orbits with their bifurcations, and the motions that lie on them.

A motion lies on a branch by its section if that is known, else by its period and amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.continuation.bracket import Bracket
from tcc_sim.continuation.branch_track import BranchTrack
from tcc_sim.continuation.follow import End, StopReason
from tcc_sim.continuation.newton import Orbit, OrbitFigures, shifts
from tcc_sim.continuation.palc import corrector, null_direction, solution_at
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at, turned
from tcc_sim.result import Described, reported, reporting

Tick = Callable[[ContinuationPoint], None]
"""Callback for every point."""


@dataclass(frozen=True)
class BranchOrigin:
    """Where a branch begins: at a motion of the scene (start), a bifurcation, or an attractor.

    kind : start, attractor, or the kind of the bifurcation
    value : of the parameter there
    branch, attractor : number of the bifurcation's branch, or of the attractor
    """

    kind: str = "start"
    value: float | None = None
    branch: int | None = None
    attractor: int | None = None

    def as_json(self) -> str | dict[str, Any]:
        """As `origin` of `continue --json`."""
        if self.kind == "start":
            return self.kind
        return {name: value for name, value in vars(self).items() if value is not None}


START = BranchOrigin()


@dataclass(repr=False)
class Branch(Described):
    """One branch, with its points in order and its two ends."""

    period: int = field(metadata=reported("period of the motions", "periods of excitation"))
    origin: BranchOrigin
    points: list[ContinuationPoint]
    ended: tuple[End, End]
    closed: bool = field(default=False, metadata=reported("whether it closes in itself"))
    bifurcations: list[Bifurcation] = field(default_factory=list)

    def change_of_stability(self, after: int) -> Bifurcation | None:
        """The bifurcation after the point of this number at which motions become stable or unstable."""
        return next((f for f in self.bifurcations if f.after == after and f.changes_stability), None)

    @property
    @reporting("start, or the kind and value of the bifurcation or attractor that it was begun at, with the number of "
               "its branch or its own", name="origin")
    def begun(self) -> str | dict[str, Any]:
        """Where it begins, as in JSON."""
        return self.origin.as_json()

    @property
    @reporting("the motions along it, in lists", listed=True, of=(OrbitFigures,))
    def motions(self) -> list[OrbitFigures]:
        """The motion of every point."""
        return [point.orbit.figures for point in self.points]

    @property
    @reporting("a sentence for each end", name="ended")
    def sentences(self) -> list[str]:
        """Its two ends in words."""
        return [str(end) for end in self.ended]

    @property
    @reporting("a word for why each end is there")
    def reasons(self) -> list[str]:
        """The reasons of its two ends."""
        return [end.reason.name.lower() for end in self.ended]


def branch_through(first: ContinuationPoint, origin: BranchOrigin = START, number: int = 0, *, both: bool = True,
                   began: End | None = None, tick: Tick | None = None, keep: list[Branch] | None = None) -> Branch:
    """The branch through `first`, both ways, or only along its tangent.

    began : the end it starts at, where only one way is followed
    keep : takes the branch, also its part up to Ctrl-C
    """
    tracks = [BranchTrack(start) for start in ((first, turned(first)) if both else (first,))]
    ahead, behind = tracks[0], tracks[-1]
    try:
        for track in tracks:
            for point in track.follow():
                if tick is not None:
                    tick(point)
            if track.ended.reason is StopReason.CLOSED:
                break
    finally:
        points, found = ahead.points, ahead.special
        if both:
            nodes = [turned(s) for s in behind.points[:0:-1]]
            points = nodes + points
            found = [*((len(nodes) - 1 - after, f) for after, f in reversed(behind.special)),
                     *((len(nodes) + after, f) for after, f in found)]
        closed = ahead.ended.reason is StopReason.CLOSED
        start_end = ahead.ended if closed else behind.ended if both else began or ahead.ended
        branch = Branch(first.orbit.period, origin, points, (start_end, ahead.ended), closed,
                        [replace(f, branch=number, after=after) for after, f in found])
        branch.bifurcations = _with_changes_of_stability(branch)
        if keep is not None:
            keep.append(branch)
    return branch


def _with_changes_of_stability(branch: Branch) -> list[Bifurcation]:
    """Its bifurcations; the one next to the stable point separates a stable point from an unstable one."""
    out = list(branch.bifurcations)
    for k, (a, b) in enumerate(pairwise(branch.points)):
        between = [n for n, f in enumerate(out) if f.after == k]
        if between and a.orbit.stable != b.orbit.stable:
            n = between[0] if a.orbit.stable else between[-1]
            out[n] = replace(out[n], changes_stability=True)
    return out


def first_point(shooting: Shooting, z: Floats) -> ContinuationPoint:
    """The first point of a branch at a solution; its tangent points to growing parameters."""
    found = shooting.linearise(z)
    tangent = null_direction(found)
    if tangent[shooting.size] < 0.0:
        tangent = -tangent
    return point_at(shooting, solution_at(z, found, tangent))


def orbits_at(branch: Branch, value: float) -> list[Orbit]:
    """The orbits of a branch at exactly this value of its parameter, one for each crossing."""
    out: list[Orbit] = []
    for a, b in pairwise(branch.points):
        if a.value == value:
            out.append(a.orbit)
        elif (a.value - value) * (b.value - value) < 0.0:
            orbit = _crossing(a, b, value)
            if orbit is not None:
                out.append(orbit)
    if branch.points[-1].value == value and not branch.closed:
        out.append(branch.points[-1].orbit)
    return out


def _crossing(a: ContinuationPoint, b: ContinuationPoint, value: float) -> Orbit | None:
    """The orbit at `value` between two points; None where the corrector fails."""
    if a.shooting == b.shooting:
        at, size = a.shooting.ranges[0].scaled(value), a.shooting.size
        near = Bracket(a, b).locate(lambda s: float(s.solution.z[size]) - at)
        return None if near is None else _at(near, value) or near.orbit
    # Between two points in different segments the orbit is on the tangent of either one.
    chord = b.shooting.outer(b.solution.z) - a.shooting.outer(a.solution.z)
    for point in sorted((a, b), key=lambda s: abs(s.value - value)):
        orbit = _at(point, value)
        if orbit is not None and float(np.abs((orbit.section - point.orbit.section) / a.shooting.map.scales).max()) <= (
                2.0 * float(np.linalg.norm(chord))):
            return orbit
    return None


def _at(near: ContinuationPoint, value: float) -> Orbit | None:
    """The orbit at `value` from a guess on the tangent at a nearby point; None where the corrector fails."""
    shooting, z, tangent = near.shooting, near.solution.z, near.solution.tangent
    row, size = np.zeros(len(z)), near.shooting.size
    row[size], away = 1.0, shooting.ranges[0].scaled(value) - float(z[size])
    guess = z + (tangent * (away / near.slope) if abs(away) > DEFAULTS.same and near.slope else row * away)
    guess[size] = shooting.ranges[0].scaled(value)
    found = corrector(shooting, guess, row)
    if found is None:
        return None
    return replace(point_at(shooting, solution_at(found.z, found.found, tangent)).orbit, values=(value,))


@dataclass(frozen=True)
class SettledMotion:
    """A motion that a sweep found.

    value : of the parameter
    state : (n,) at the start of cycle `cycle`
    period : cycles; 0 for none
    amplitude : its largest size
    """

    value: float
    state: Floats
    cycle: int
    period: int
    amplitude: float

    def has_period(self, period: int, base: int = 1) -> bool:
        """Whether it repeats after `period` cycles, where the excitation repeats after `base`."""
        return self.period > 0 and math.lcm(self.period, base) == period


@dataclass(frozen=True)
class BranchPlace:
    """The branch on which a motion lies, and the number of the point before it."""

    branch: int
    after: int


class BranchPiece(NamedTuple):
    """A piece of a branch at a value: the number of the point before it, its ends, and the part of the chord there."""

    after: int
    a: ContinuationPoint
    b: ContinuationPoint
    part: float

    def holds(self, seen: SettledMotion, size: float) -> float:
        """Distance of a motion's amplitude from the piece; inf where too far for a largest amplitude of `size`."""
        low, high = self.a.orbit.seen.largest, self.b.orbit.seen.largest
        away = abs(low + self.part * (high - low) - seen.amplitude)
        return away if away <= DEFAULTS.alike * size + DEFAULTS.off_chord * abs(high - low) else math.inf


def pieces_at(branch: Branch, value: float) -> list[BranchPiece]:
    """The pieces of a branch across a value."""
    out = []
    for k, a, b in _pieces(branch):
        if min(a.value, b.value) <= value <= max(a.value, b.value):
            width = b.value - a.value
            out.append(BranchPiece(k, a, b, (value - a.value) / width if width else 0.5))
    return out


def _pieces(branch: Branch) -> Iterator[tuple[int, ContinuationPoint, ContinuationPoint]]:
    """Neighbouring points of a branch and its folds, which extend it beyond its extreme points."""
    folds: dict[int, list[ContinuationPoint]] = {}
    for found in branch.bifurcations:
        if found.kind == "fold":
            folds.setdefault(found.after, []).append(found.point)
    for k, (a, b) in enumerate(pairwise(branch.points)):
        for one, two in pairwise([a, *folds.get(k, []), b]):
            yield k, one, two


def place_of(seen: SettledMotion, branches: Sequence[Branch], size: float, base: int = 1) -> BranchPlace | None:
    """The stable piece with the period and amplitude of a motion, the nearest one of several; None for no piece."""
    best, place = math.inf, None
    for number, branch in enumerate(branches):
        if not seen.has_period(branch.period, base):
            continue
        for piece in pieces_at(branch, seen.value):
            if (piece.a.orbit.stable or piece.b.orbit.stable) and (away := piece.holds(seen, size)) < best:
                best, place = away, BranchPlace(number, piece.after)
    return place


def passes_through(branch: Branch, found: ContinuationPoint) -> bool:
    """Whether a branch passes through an orbit, which may begin in any of its cycles."""
    of, orbit = found.shooting.map, found.orbit
    if branch.period != orbit.period:
        return False
    sections = np.array(shifts(of, orbit.section, orbit.values, orbit.period))
    for piece in pieces_at(branch, found.value):
        chord = piece.b.orbit.section - piece.a.orbit.section
        away = np.abs((piece.a.orbit.section + piece.part * chord - sections) / of.scales).max(axis=1)
        if away.min() <= DEFAULTS.on_chord + DEFAULTS.off_chord * np.abs(chord / of.scales).max():
            return True
    return False
