"""Branches of periodic orbits with their bifurcations: how they are followed, and the orbits on them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.result import Described, reported, reporting
from tcc_sim.study.continuation import arclength, orbits
from tcc_sim.study.continuation.arclength import Bracket, Continuation, CurvePoint, End, Rules, StopReason
from tcc_sim.study.continuation.bifurcations import (
    Bifurcation,
    ContinuationPoint,
    period_doubling_end,
    point_at,
    special_points_between,
)
from tcc_sim.study.continuation.orbits import Floats, Linearised, Orbit, Shooting

FAMILY = 1e-7  # distance of a multiplier from 1, and slope of the parameter, in a family at one value
FAMILY_LENGTH = 1e-2  # length of a branch in a family before it ends
NEXT_TO_ONE = 1e-3  # distance of a multiplier from 1 below which the halves of an orbit are compared
SAME_END = 1e-6  # distance, relative to the range, at which a fold is the doubling where its branch ends
CORNER_STEP = 1e-10  # smallest step beyond a corner
CORNER_DISTANCES = (1e-8, 1e-7, 1e-6, 1e-5)  # distances at which the other side of a corner is tried

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

    @property
    @reporting("start, or kind, value and number of the bifurcation's branch or attractor at which it "
               "begins", name="origin")
    def begun(self) -> str | dict[str, Any]:
        """Where it begins, as in JSON."""
        return self.origin.as_json()

    @property
    @reporting("the motions along it, in lists", listed=True, of=(orbits.OrbitFigures,))
    def motions(self) -> list[orbits.OrbitFigures]:
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


BranchTrack = Continuation[ContinuationPoint, Bifurcation]
"""One direction of a branch."""


def _every_start(track: BranchTrack) -> list[tuple[Floats, Floats]]:
    """Unknowns and tangent of single shooting at the first orbit, for every cycle in which it may begin."""
    out, first = arclength.own_start(track), track.here
    shooting, z = first.shooting, first.solution.z
    of, size, tangent = shooting.map, shooting.size, shooting.outer(first.solution.tangent)
    x, values = shooting.nodes(z)[0], shooting.values(z)
    sizes = np.concatenate([of.scales, shooting.widths])
    for k, shifted in enumerate(orbits.shifts(of, x, values, shooting.period)[1:], 1):
        image = of.evaluate(x, values, 0, k * of.forcing_period)
        way = np.concatenate([image.derivatives @ (sizes * tangent) / of.scales, tangent[of.dimension:]])
        out.append((np.concatenate([shifted / of.scales, z[size:]]), way / float(np.linalg.norm(way))))
    return out


def _unresolved(track: BranchTrack, new: ContinuationPoint) -> End | None:
    """The end before a point with a multiplier that double precision does not resolve."""
    if abs(new.orbit.multipliers[0]) <= track.settings.canard:
        return None
    return track.end(StopReason.CANARD, limit=track.settings.canard)


def _ended(track: BranchTrack, new: ContinuationPoint, special: list[Bifurcation],
           stop: End | None) -> tuple[ContinuationPoint, list[Bifurcation], End | None]:
    """The end of the branch where the orbit's period becomes shorter, or at its first point."""
    # Next to it rounding decides the sign of a determinant, but a multiplier is 1.
    turns = track.here.solution.sign != new.solution.sign or min(
        float(np.abs(point.orbit.multipliers - 1.0).min()) for point in (track.here, new)) < NEXT_TO_ONE
    shorter = period_doubling_end(track.here, new) if turns else None
    if shorter is not None:
        # Beyond it the branch is its own shift: the multiplier of 1 there is no fold and no branch point.
        special, span = [f for f in special if f.kind not in ("branch_point", "fold")], shorter.shooting.ranges[0]
        while not special and track.special and track.special[-1][1].kind in ("branch_point", "fold") and abs(
                span.scaled(track.special[-1][1].value) - span.scaled(shorter.value)) < SAME_END:
            track.special.pop()
        return shorter, special, stop or track.end(StopReason.DOUBLING, shorter)
    return arclength.back_at_start(track, new, special, stop)


def _stuck(track: BranchTrack) -> End | None:
    """The end where some length of the branch has motions with a multiplier of 1 at one parameter."""
    # Two points do not show it: beside a doubling, where the parameter grows as the square of the length, it hardly
    # changes and a multiplier is 1 as well.
    last = track.here
    for point in reversed(track.points):
        if abs(point.slope) > FAMILY or np.abs(point.orbit.multipliers - 1.0).min() > FAMILY:
            return None
        away = (last.orbit.section - point.orbit.section) / last.shooting.map.scales
        if float(np.linalg.norm(away)) >= FAMILY_LENGTH:
            return track.end(StopReason.FAMILY)
    return None


def _went_on(track: BranchTrack, before: ContinuationPoint, corner: bool) -> None:
    here = track.here
    arclength.predicted(track, before, corner or (before.shooting.map.piecewise
                                        and orbits.differ(before.orbit.seen.events, here.orbit.seen.events)))
    if not corner:
        _remesh(track)


def _cut_anew(track: BranchTrack) -> bool:
    # A segment may start at an onset of slip, and Newton's method then alternates between two event sequences. The
    # onset moves along a branch, so segments are cut by growth. This passes the canards behind both folds of period
    # two, with either law.
    if track.cut[0] == len(track.points):
        return False
    track.cut = len(track.points), math.inf
    if not _remesh(track, anew=True):
        return False
    track.length = arclength.FLAT_STEP
    return True


def _remesh(track: BranchTrack, anew: bool = False) -> bool:
    """Cut the last orbit into other segments where the growth over one is large, or `anew`; now and then fewer."""
    here, shooting, settings = track.here, track.here.shooting, track.here.shooting.settings
    blocks, count = here.solution.linearised.blocks, len(shooting.segments)
    fewer = count > 1 and len(track.points) % settings.fewer_after == 0
    if shooting.keeps_segments(blocks, settings.regrowth, fewer or anew):
        return False
    finer, z = shooting.cut(here.solution.z)
    if len(finer.segments) == count and not anew and shooting.keeps_segments(blocks, settings.regrowth, False):
        return False
    if anew and finer.segments == shooting.segments:
        return False
    polished = orbits.newton(finer, z)
    if polished is None:
        return False
    linearised = finer.linearise(polished)
    along, n = np.zeros(len(z)), shooting.map.dimension
    along[:n], along[-1] = here.solution.tangent[:n], here.solution.tangent[-1]
    tangent = arclength.tangent_of(linearised, along)
    track.points[-1] = point_at(finer, arclength.solution_at(polished, linearised, tangent))
    track.before = []
    return True


def _beyond_corner(track: BranchTrack) -> ContinuationPoint | None:
    """The next point beyond a change of the event sequence at which the branch has a corner; None without one."""
    # An end of slip that passes phase 0 is a corner too, as motions that stick there have no slip speed.
    here, shooting = track.here, track.here.shooting
    if not shooting.map.piecewise:
        return None
    for distance in CORNER_DISTANCES:
        try:
            linearised = shooting.linearise(here.solution.z + distance * here.solution.tangent)
            tangent = arclength.null_direction(linearised)
            at = arclength.solution_at(here.solution.z, linearised, tangent)
            along = arclength.oriented(at, here.solution.sign).tangent
            z = here.solution.z + distance * along
            events = shooting.map.evaluate(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).seen.events
        except orbits.FAILURES:
            continue
        new = None if events == here.orbit.seen.events else _beyond(track, linearised, along, distance)
        if new is not None:
            return new
    return None


def _beyond(track: BranchTrack, linearised: Linearised, along: Floats, distance: float) -> ContinuationPoint | None:
    """The next point beyond a corner at the last one; None where none is found."""
    # linearised : derivative at a distance from the corner; where it belongs to neither piece, the one along the
    # other piece
    here, shooting, z = track.here, track.here.shooting, track.here.solution.z
    settings = replace(shooting.settings, first_step=distance, smallest_step=CORNER_STEP)
    for known in (linearised, None):
        try:
            start = known or shooting.linearise(z + distance * along)
            short: Continuation[CurvePoint, None] = Continuation(CurvePoint(
                arclength.solution_at(z, start, arclength.tangent_of(start, along)),
                replace(shooting, settings=settings)))
            moved = short.step(by_amplitude=False)
            new = None if moved is None else here.moved(moved, by_amplitude=False)
        except orbits.FAILURES:
            continue
        if new is not None and new.orbit.seen.events != here.orbit.seen.events:
            track.length = short.length
            return new
    return None


BRANCH = Rules(_every_start, _unresolved, lambda track, new: special_points_between(track.here, new), _ended, _stuck,
               _went_on, _cut_anew, beyond_corner=_beyond_corner)
"""A branch of periodic orbits along one parameter."""


def branch_through(first: ContinuationPoint, origin: BranchOrigin = START, number: int = 0, *, both: bool = True,
                   began: End | None = None, tick: Tick | None = None, keep: list[Branch] | None = None) -> Branch:
    """The branch through `first`, both ways, or only along its tangent.

    began : the end it starts at, where only one way is followed
    keep : takes the branch, also its part up to Ctrl-C
    """
    tracks = [Continuation(start, BRANCH) for start in ((first, first.turned()) if both else (first,))]
    ahead, behind = tracks[0], tracks[-1]
    try:
        for track in tracks:
            for point in track.follow():
                if tick is not None:
                    tick(point)
            if track.ended.reason is StopReason.CLOSED:
                break
    finally:
        points, special = ahead.points, ahead.special
        if both:
            nodes = [s.turned() for s in behind.points[:0:-1]]
            points = nodes + points
            special = [*((len(nodes) - 1 - after, f) for after, f in reversed(behind.special)),
                       *((len(nodes) + after, f) for after, f in special)]
        closed = ahead.ended.reason is StopReason.CLOSED
        start_end = ahead.ended if closed else behind.ended if both else began or ahead.ended
        branch = Branch(first.orbit.period, origin, points, (start_end, ahead.ended), closed,
                        [replace(f, branch=number, after=after) for after, f in special])
        for k, (a, b) in enumerate(pairwise(points)):
            between = [n for n, f in enumerate(branch.bifurcations) if f.after == k]
            if between and a.orbit.stable != b.orbit.stable:  # The one next to the stable point is the change.
                n = between[0] if a.orbit.stable else between[-1]
                branch.bifurcations[n] = replace(branch.bifurcations[n], changes_stability=True)
        if keep is not None:
            keep.append(branch)
    return branch


def first_point(shooting: Shooting, z: Floats) -> ContinuationPoint:
    """The first point of a branch at a solution; its tangent points to growing parameters."""
    linearised = shooting.linearise(z)
    tangent = arclength.null_direction(linearised)
    if tangent[shooting.size] < 0.0:
        tangent = -tangent
    return point_at(shooting, arclength.solution_at(z, linearised, tangent))


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
    guess = z + (tangent * (away / near.slope) if abs(away) > orbits.SAME and near.slope else row * away)
    guess[size] = shooting.ranges[0].scaled(value)
    corrected = arclength.corrector(shooting, guess, row)
    if corrected is None:
        return None
    solution = arclength.solution_at(corrected.z, corrected.linearised, tangent)
    return replace(point_at(shooting, solution).orbit, values=(value,))
