"""Branches of periodic orbits with their bifurcations, and bifurcation diagrams.

A diagram has a branch through every motion of a sweep that lies on no other one, and doubled branches. A motion lies on
a branch by its section if that is known, else by its period and amplitude. A sweep jumps from one stable segment of a
branch to another where the branch loses its stability, or where the initial state enters another basin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.analysis.steady.exponents import product_of
from tcc_sim.result import Described, reported, reporting, result_class
from tcc_sim.study.continuation import arclength, orbits
from tcc_sim.study.continuation.arclength import Bracket, Continuation, End, Rules, StopReason, corrector
from tcc_sim.study.continuation.bifurcations import (
    Bifurcation,
    ContinuationPoint,
    period_doubling_end,
    special_points_between,
)
from tcc_sim.study.continuation.orbits import Floats, ParameterMap, Settings, Shooting

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


@result_class(frozen=False, repr=False)
class Branch(Described):
    """One branch, with its points in order and its two ends."""

    period: int = reported("period of the motions", "periods of excitation")
    origin: BranchOrigin
    points: list[ContinuationPoint]
    ended: tuple[End, End]
    closed: bool = reported("whether it closes in itself", default=False)
    bifurcations: list[Bifurcation] = field(default_factory=list)

    @reporting(
        "start, or kind, value and number of the bifurcation's branch or attractor at which it begins", name="origin")
    def begun(self) -> str | dict[str, Any]:
        return self.origin.as_json()

    @reporting("the motions along it, in lists", listed=True, of=(orbits.OrbitFigures,))
    def motions(self) -> list[orbits.OrbitFigures]:
        return [point.figures for point in self.points]

    @reporting("a sentence for each end", name="ended")
    def sentences(self) -> list[str]:
        return [str(end) for end in self.ended]

    @reporting("a word for why each end is there")
    def reasons(self) -> list[str]:
        return [end.reason.name.lower() for end in self.ended]


BranchTrack = Continuation[ContinuationPoint, Bifurcation]
"""One direction of a branch."""


def _every_start(track: BranchTrack) -> list[tuple[Floats, Floats]]:
    """Unknowns and tangent of single shooting at the first orbit, for every cycle in which it may begin."""
    out, shooting, z = arclength.own_start(track), track.here.equations, track.here.z
    of, size, tangent = shooting.map, shooting.size, shooting.outer(track.here.tangent)
    for cycle in range(of.forcing_period, shooting.period, of.forcing_period):
        image = of.evaluate(track.here.section, track.here.values, 0, cycle)
        way = np.concatenate([image.derivatives @ (shooting.sizes * tangent) / of.scales, tangent[of.dimension:]])
        out.append((np.concatenate([image.value / of.scales, z[size:]]), way / float(np.linalg.norm(way))))
    return out


def _unresolved(track: BranchTrack, new: ContinuationPoint) -> End | None:
    """The end before a point with a multiplier that double precision does not resolve."""
    if abs(new.multipliers[0]) <= track.settings.canard:
        return None
    return track.end(StopReason.CANARD, limit=track.settings.canard)


def _special(track: BranchTrack, new: ContinuationPoint) -> list[Bifurcation] | None:
    """The bifurcations up to a new point; None where the step has skipped a piece."""
    return special_points_between(track.here, new, track.by_amplitude)


def _ended(track: BranchTrack, new: ContinuationPoint, special: list[Bifurcation],
           stop: End | None) -> tuple[ContinuationPoint, list[Bifurcation], End | None]:
    """The end of the branch where the orbit's period becomes shorter, or at its first point."""
    # Next to it rounding decides the sign of a determinant, but a multiplier is 1.
    turns = track.here.sign != new.sign or min(
        float(np.abs(point.multipliers - 1.0).min()) for point in (track.here, new)) < NEXT_TO_ONE
    shorter = period_doubling_end(track.here, new) if turns else None
    if shorter is None:
        return arclength.back_at_start(track, new, special, stop)
    # Beyond it the branch is its own shift: the multiplier of 1 there is no fold and no branch point.
    special, span = [f for f in special if f.kind not in ("branch_point", "fold")], shorter.equations.ranges[0]
    while not special and track.special and track.special[-1][1].kind in ("branch_point", "fold") and abs(
            span.scaled(track.special[-1][1].value) - span.scaled(shorter.value)) < SAME_END:
        track.special.pop()
    return shorter, special, stop or track.end(StopReason.DOUBLING, shorter)


def _in_a_family(track: BranchTrack) -> bool:
    """Whether some length of the branch has motions with a multiplier of 1 at one parameter."""
    # Two points do not show it: beside a doubling, where the parameter grows as the square of the length, it hardly
    # changes and a multiplier is 1 as well.
    last = track.here
    for point in reversed(track.points):
        if abs(point.slope) > FAMILY or np.abs(point.multipliers - 1.0).min() > FAMILY:
            return False
        away = (last.section - point.section) / last.equations.map.scales
        if float(np.linalg.norm(away)) >= FAMILY_LENGTH:
            return True
    return False


def _went_on(track: BranchTrack) -> None:
    if _in_a_family(track):
        track.stop = track.end(StopReason.FAMILY)
        return
    if track.here.equations.map.piecewise and orbits.differ(track.points[-2].events, track.here.events):
        track.before = []
    _remesh(track)


def _lost(track: BranchTrack) -> None:
    # A segment may start at an onset of slip, and Newton's method then alternates between two event sequences. The
    # onset moves along a branch, so segments are cut by growth. This passes the canards behind both folds of period
    # two, with either law.
    if track.cut[0] != len(track.points):
        track.cut = len(track.points), math.inf
        if _remesh(track, anew=True):
            track.length = arclength.FLAT_STEP
            return
    arclength.give_up(track)


def _remesh(track: BranchTrack, anew: bool = False) -> bool:
    """Cut the last orbit into other segments where the growth over one is large, or `anew`; now and then fewer."""
    here, shooting, settings = track.here, track.here.equations, track.here.equations.settings
    blocks, count = here.linearised.blocks, len(shooting.segments)
    fewer = count > 1 and len(track.points) % settings.fewer_after == 0
    if shooting.keeps_segments(blocks, settings.regrowth, fewer or anew):
        return False
    finer, z = shooting.cut(here.z)
    if len(finer.segments) == count and not anew and shooting.keeps_segments(blocks, settings.regrowth, False):
        return False
    if anew and finer.segments == shooting.segments:
        return False
    polished = orbits.newton(finer, z)
    if polished is None:
        return False
    linearised = finer.linearise(polished)
    along, n = np.zeros(len(z)), shooting.map.dimension
    along[:n], along[-1] = here.tangent[:n], here.tangent[-1]
    track.points[-1] = ContinuationPoint(finer, polished, linearised, arclength.tangent_of(linearised, along))
    track.before = []
    return True


def _beyond_corner(track: BranchTrack) -> ContinuationPoint | None:
    """The next point beyond a change of the event sequence at which the branch has a corner; None without one."""
    # An end of slip that passes phase 0 is a corner too, as motions that stick there have no slip speed.
    here, shooting = track.here, track.here.equations
    if not shooting.map.piecewise:
        return None
    for distance in CORNER_DISTANCES:
        try:
            linearised = shooting.linearise(here.z + distance * here.tangent)
            at = replace(here, linearised=linearised, tangent=arclength.null_direction(linearised))
            along = at.oriented(here.sign).tangent
            z = here.z + distance * along
            events = shooting.map.evaluate(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).seen.events
        except orbits.FAILURES:
            continue
        # Where the derivative belongs to neither piece, the one along the other piece is taken.
        for known in (linearised, None) if events != here.events else ():
            try:
                start = known or shooting.linearise(z)
                near = replace(shooting, settings=replace(shooting.settings, first_step=distance,
                                                          smallest_step=CORNER_STEP))
                short = Continuation[ContinuationPoint, None](ContinuationPoint(
                    near, here.z, start, arclength.tangent_of(start, along)))
                new = short.step(by_amplitude=False)
            except orbits.FAILURES:
                continue
            if new is not None and new.events != here.events:
                track.length = short.length
                return replace(new, equations=shooting)
    return None


BRANCH = Rules(
    _every_start, _unresolved, lambda track, new: special_points_between(track.here, new, track.by_amplitude), _ended,
    _went_on, _lost, _beyond_corner)
"""A branch of periodic orbits along one parameter."""


def branch_through(first: ContinuationPoint, origin: BranchOrigin = START, keep: list[Branch] | None = None, *,
                   both: bool = True, began: End | None = None, tick: Tick | None = None) -> Branch:
    """The branch through `first`, both ways, or only along its tangent.

    keep : branches to which it is added, also its part up to Ctrl-C; their number is that of the branch
    began : the end it starts at, where only one way is followed
    """
    keep = [] if keep is None else keep
    tracks = [Continuation(start, BRANCH) for start in ((first, first.turned()) if both else (first,))]
    try:
        for track in tracks:
            for point in track.follow():
                if tick is not None:
                    tick(point)
            if track.ended.reason is StopReason.CLOSED:
                break
    finally:
        closed = tracks[0].ended.reason is StopReason.CLOSED
        points, special, ended = arclength.joined(tracks[:1] if closed else tracks)
        start_end = ended[0] if closed else began or ended[0]
        branch = Branch(first.period, origin, points, (start_end, ended[1]), closed,
                        [replace(f, branch=len(keep), after=after) for after, f in special])
        for k, (a, b) in enumerate(pairwise(points)):
            between = [n for n, f in enumerate(branch.bifurcations) if f.after == k]
            if between and a.stable != b.stable:  # The one next to the stable point is the change.
                n = between[0] if a.stable else between[-1]
                branch.bifurcations[n] = replace(branch.bifurcations[n], changes_stability=True)
        keep.append(branch)
    return branch


def first_point(shooting: Shooting, z: Floats) -> ContinuationPoint:
    """The first point of a branch at a solution; its tangent points to growing parameters."""
    point = ContinuationPoint.at(shooting, z)
    return point.turned() if point.slope < 0.0 else point


def orbits_at(branch: Branch, value: float) -> list[ContinuationPoint]:
    """The orbits of a branch at this value of its parameter, one for each crossing."""
    found = [_crossing(a, b, value) for a, b in pairwise(branch.points)]
    if branch.points[-1].value == value and not branch.closed:
        found.append(branch.points[-1])
    return [point for point in found if point is not None]


def _crossing(a: ContinuationPoint, b: ContinuationPoint, value: float) -> ContinuationPoint | None:
    """The orbit at `value` from one point up to the next; None where there is none, or where the corrector fails."""
    if a.value == value or not (a.value - value) * (b.value - value) < 0.0:
        return a if a.value == value else None
    if a.equations == b.equations:
        at, size = a.equations.ranges[0].scaled(value), a.equations.size
        near = Bracket(a, b).locate(lambda s: float(s.z[size]) - at)
        return None if near is None else _at(near, value) or near
    # Between two points in different segments the orbit is on the tangent of either one.
    chord = b.equations.outer(b.z) - a.equations.outer(a.z)
    for point in sorted((a, b), key=lambda s: abs(s.value - value)):
        orbit = _at(point, value)
        if orbit is not None and float(np.abs((orbit.section - point.section) / a.equations.map.scales).max()) <= (
                2.0 * float(np.linalg.norm(chord))):
            return orbit
    return None


def _at(near: ContinuationPoint, value: float) -> ContinuationPoint | None:
    """The orbit at `value` from a guess on the tangent at a nearby point; None where the corrector fails."""
    shooting, z, tangent = near.equations, near.z, near.tangent
    row, size = np.zeros(len(z)), near.equations.size
    row[size], away = 1.0, shooting.ranges[0].scaled(value) - float(z[size])
    guess = z + (tangent * (away / near.slope) if abs(away) > orbits.SAME and near.slope else row * away)
    guess[size] = shooting.ranges[0].scaled(value)
    corrected = arclength.corrector(shooting, guess, row)
    return None if corrected is None else replace(near, z=corrected.z, linearised=corrected.linearised)


MERGED = 1e-5  # distance, relative to the range, at which two ends of branches are one doubling
# Distances from a doubling at which its branch is tried; beside a canard, where the map bends within 1e-5, only the
# smallest ones lie on it.
AMPLITUDES = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
ALIKE = 0.01  # difference of two amplitudes of one motion, relative to the largest of a sweep
NEXT_TO_NOTHING = 1e-3  # part of a sweep's largest size below which its periodic motions are no measure
OFF_CHORD = 0.3  # distance of a motion from the chord between two points, relative to its rise
ON_CHORD = 1e-3  # the same where the chord does not rise

SWEPT = Settings(max_points=200, largest_step=0.3)
"""Settings for pictures: steps of about a hundredth of their width, and bounded branches."""


@dataclass(frozen=True)
class SettledMotion:
    """A motion that a sweep found.

    value : of the parameter
    state : (n,) at the start of cycle `cycle`
    period : cycles after which it and the excitation repeat; 0 for none
    amplitude : its largest size
    """

    value: float
    state: Floats
    cycle: int
    period: int
    amplitude: float


def bifurcation_diagram(of: ParameterMap, span: orbits.ParameterRange, seen: Sequence[SettledMotion],
                        tick: Tick | None = None, settings: Settings = SWEPT) -> list[Branch]:
    """Branches through the periodic motions of a sweep, and the branches from their doublings.

    of, span : the map with one free parameter, and its range
    seen : motions along the sweep, in order; the longest run of one period that lies on no branch is followed first
    """
    out: list[Branch] = []
    size, longest = amplitude_of(seen), settings.longest_period * of.forcing_period
    left = {k: s for k, s in enumerate(seen) if 0 < s.period <= longest}
    while left and len(out) < settings.max_branches:
        left = {k: s for k, s in left.items() if place_of(s, out, size) is None}
        # Numbers that follow each other without a gap differ from their places by one number.
        runs = [[k for _, (k, _) in run] for _, run in groupby(enumerate(left.items()), lambda item: (
            item[1][0] - item[0], item[1][1].period))]
        if not runs:
            break
        run = max(runs, key=len)
        first = point_of(of, span, left.pop(run[len(run) // 2]), settings)
        if first is not None and not any(passes_through(branch, first) for branch in out):
            branch_through(first, keep=out, tick=tick)
    switch(out, 1, longest, settings.max_branches, tick)
    return out


def left_out(seen: Sequence[SettledMotion], branches: Sequence[Branch], base: int = 1,
             settings: Settings = SWEPT) -> list[str]:
    """Sentences on motions and branches that a diagram leaves out, where the excitation repeats after `base` cycles."""
    size, longest, out = amplitude_of(seen), settings.longest_period * base, list[str]()
    alone = [s for s in seen if s.period and place_of(s, branches, size) is None]
    long = sum(s.period > longest for s in alone)
    if len(alone) > long:
        full = len(branches) >= settings.max_branches
        reason = f"{settings.max_branches} branches are followed" if full else "none was found there"
        out.append(f"{len(alone) - long} of {len(seen)} motions lie on no branch: {reason}")
    if long:
        out.append(f"{long} of {len(seen)} motions have a period above {longest} and lie on no branch")
    stopped = sum(any(end.reason is StopReason.POINTS for end in branch.ended) for branch in branches)
    if stopped:
        out.append(f"{stopped} of {len(branches)} branches go on: {settings.max_points} points are followed either way")
    return out


class BranchPiece(NamedTuple):
    """A piece of a branch at a value: the number of the point before it, its ends, and the part of the chord there."""

    after: int
    a: ContinuationPoint
    b: ContinuationPoint
    part: float

    def holds(self, seen: SettledMotion, size: float) -> float:
        """Distance of a motion's amplitude from the piece; inf where too far for a largest amplitude of `size`."""
        low, high = self.a.seen.largest, self.b.seen.largest
        away = abs(low + self.part * (high - low) - seen.amplitude)
        return away if away <= ALIKE * size + OFF_CHORD * abs(high - low) else math.inf


def pieces_at(branch: Branch, value: float) -> list[BranchPiece]:
    """The pieces of a branch across a value; its folds extend it beyond its extreme points."""
    folds, out = dict[int, list[ContinuationPoint]](), []
    for bifurcation in branch.bifurcations:
        if bifurcation.kind == "fold":
            folds.setdefault(bifurcation.after, []).append(bifurcation.point)
    for k, ends in enumerate(pairwise(branch.points)):
        for a, b in pairwise([ends[0], *folds.get(k, []), ends[1]]):
            if min(a.value, b.value) <= value <= max(a.value, b.value):
                width = b.value - a.value
                out.append(BranchPiece(k, a, b, (value - a.value) / width if width else 0.5))
    return out


def place_of(seen: SettledMotion, branches: Sequence[Branch], size: float) -> tuple[int, int] | None:
    """The stable piece with the period and amplitude of a motion, the nearest one of several; None for no piece.

    The piece is the number of its branch and that of the point before it.
    """
    away, number, after = min(
        ((piece.holds(seen, size), number, piece.after)
         for number, branch in enumerate(branches) if seen.period == branch.period
         for piece in pieces_at(branch, seen.value) if piece.a.stable or piece.b.stable), default=(math.inf, 0, 0))
    return None if math.isinf(away) else (number, after)


def passes_through(branch: Branch, point: ContinuationPoint) -> bool:
    """Whether a branch passes through an orbit, which may begin in any of its cycles."""
    of = point.equations.map
    if branch.period != point.period:
        return False
    sections = np.array(orbits.shifts(of, point.section, point.values, point.period))
    for piece in pieces_at(branch, point.value):
        chord = piece.b.section - piece.a.section
        away = np.abs((piece.a.section + piece.part * chord - sections) / of.scales).max(axis=1)
        if away.min() <= ON_CHORD + OFF_CHORD * np.abs(chord / of.scales).max():
            return True
    return False


def amplitude_of(seen: Sequence[SettledMotion]) -> float:
    """The largest size of the periodic motions of a sweep; of all motions where these are too small."""
    most = max((s.amplitude for s in seen), default=0.0)
    periodic = max((s.amplitude for s in seen if s.period), default=0.0)
    return periodic if periodic > NEXT_TO_NOTHING * most else most


def point_of(of: ParameterMap, span: orbits.ParameterRange, seen: SettledMotion,
             settings: Settings = orbits.DEFAULTS) -> ContinuationPoint | None:
    """The point of a branch at a motion of a sweep; None where Newton's method finds no orbit there."""
    shooting = Shooting.single(of, math.lcm(seen.period, of.forcing_period), span, settings=settings)
    try:
        z = orbits.find_orbit(shooting, (seen.value,), [state_at_phase_0(of, seen)])
        return None if z is None else first_point(shooting, z)
    except orbits.FAILURES:
        return None


def state_at_phase_0(of: ParameterMap, seen: SettledMotion) -> Floats:
    """The state of a motion at the next cycle in which the excitation repeats."""
    phase = seen.cycle % of.forcing_period
    return of.evaluate(seen.state, (seen.value,), phase, of.forcing_period - phase).value if phase else seen.state


def doubled(bifurcation: Bifurcation) -> ContinuationPoint | None:
    """A first point on the branch of doubled motions; None where none is found.

    It lies in the plane phi . (x - x*) = eps, phi the eigenvector of the multiplier -1, so the orbit of the simple
    period is not in it; the tangent points away from the doubling.
    """
    point = bifurcation.point
    single = point.equations
    of, blocks = single.map, point.linearised.blocks
    values, vectors = np.linalg.eig(product_of(blocks))
    phi = np.real(vectors[:, int(np.abs(values + 1.0).argmin())])
    phi = phi / np.linalg.norm(phi)
    along = [phi]
    for block in blocks[:-1]:
        along.append(block @ along[-1])
    x, directions, segments = single.nodes(point.z), np.array(along), single.segments
    if len(segments) == 1:
        shooting = Shooting.single(of, 2 * single.period, *single.ranges, settings=single.settings)
    else:
        shooting = replace(single, period=2 * single.period, segments=segments + segments)
        x, directions = np.vstack([x, x]), np.vstack([directions, -directions])
    start = shooting.unknowns(x, point.values)
    direction, row = np.zeros(len(start)), np.zeros(len(start))
    direction[:-1], row[:len(phi)] = directions.ravel(), phi
    for amplitude in AMPLITUDES:
        for sign in (1.0, -1.0):
            got = corrector(shooting, start + sign * amplitude * direction, row)
            if got is None or not 0.0 <= got.z[-1] <= 1.0:
                continue
            try:
                at = shooting.nodes(got.z)[0]
                half = orbits.minimal_period(shooting.map, at, shooting.values(got.z), shooting.period, 0.1 * amplitude)
                if half != shooting.period:
                    continue
                return replace(point, equations=shooting).moved(got, sign * row)
            except orbits.FAILURES:
                continue
    return None


def switch(branches: list[Branch], depth: int, longest: float = math.inf, most: float = math.inf,
           tick: Tick | None = None) -> None:
    """Append the doubled branch of every period doubling in which none of the others ends, and theirs, to `depth`.

    longest, most : bounds of the period followed, in cycles, and of the number of branches
    """
    first = 0
    for _ in range(depth):
        generation, first = list(enumerate(branches))[first:], len(branches)
        for number, parent in generation:
            for bifurcation in parent.bifurcations:
                if bifurcation.kind != "period_doubling" or 2 * parent.period > longest or len(branches) >= most:
                    continue
                scaled, merged = bifurcation.point.equations.ranges[0].scaled, MERGED
                if any(abs(scaled(bifurcation.value) - scaled(end.value)) < merged for b in branches
                       if b.period == 2 * parent.period for end in (b.points[0], b.points[-1])):
                    continue
                start = doubled(bifurcation)
                if start is not None and not any(passes_through(branch, start) for branch in branches):
                    began = End(StopReason.BEGAN, start.equations.ranges[0].name, bifurcation.value)
                    origin = BranchOrigin(bifurcation.kind, bifurcation.value, number)
                    branch_through(start, origin, branches, both=False, began=began, tick=tick)


NEAR_END = 0.05  # distance of a bifurcation from a loss of stability, parts of range and largest size
SAME_SEGMENT = 1e-3  # relative difference of the largest sizes of one stable segment
NARROWEST = 1e-3  # least width of a segment, relative to the range: canards have many narrower ones

BASIN, STEEP, APERIODIC, NOT_FOLLOWED = "basin_boundary", "steep", "aperiodic", "not_followed"
"""Causes that are no bifurcation of a branch: a motion goes on, and the start enters another basin; one motion that
changes steeply; a motion without a period on either side; a motion on a branch that was not followed up to the other
one."""


@result_class
class SegmentEnd:
    """End of a segment.

    value : of the parameter
    kind, residual : of the bifurcation; None at the end of the range, or where the branch could not be followed
    jumps : whether a motion leaves the branch here: at a fold, and at a doubling whose doubled motions are unstable
    """

    value: float = reported("place on the axis")
    kind: str | None = reported("bifurcation; null where the motion was followed to there only", default=None)
    residual: float | None = reported("residual of the bifurcation", default=None)
    jumps: bool = reported("whether a motion that comes here goes elsewhere", default=False)

    def __str__(self) -> str:
        """The end in words."""
        what = f"{self.kind.replace('_', ' ')}, residual {self.residual:.0e}" if self.kind else "followed no further"
        return f"{self.value:.6g} ({what})"


@result_class
class StableSegment:
    """Stable motions of one branch, with a period in cycles, over an interval of the parameter; `values` ascend."""

    period: int = reported("period of the motion", "periods of excitation")
    low: SegmentEnd = reported("lower end")
    high: SegmentEnd = reported("upper end")
    values: tuple[float, ...]
    amplitudes: tuple[float, ...]

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
    for branch in branches:
        for first, last in _runs(branch.points):
            ends = [_end_of_segment(branches, branch, point, beyond, span, unit)
                    for point, beyond in ((first, -1), (last, 1))]
            part = branch.points[first:last + 1]
            values, amplitudes = [s.value / unit for s in part], [s.seen.largest for s in part]
            if values[-1] < values[0]:
                values, amplitudes, ends = values[::-1], amplitudes[::-1], ends[::-1]
            if values[-1] - values[0] > NARROWEST * (high - low) / unit:
                out.append(StableSegment(branch.period, ends[0], ends[1], tuple(values), tuple(amplitudes)))
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
        if point.stable and out and out[-1][1] == k - 1 and not way * step < 0.0:
            out[-1], way = (out[-1][0], k), step or way
        elif point.stable:
            out.append((k, k))
            way = 0.0
    return out


def _end_of_segment(branches: Sequence[Branch], branch: Branch, point: int, beyond: int, span: tuple[float, float],
         unit: float) -> SegmentEnd:
    """The end of a segment at one of its points, towards the neighbour `beyond`."""
    at, width = branch.points[point], span[1] - span[0]
    size = max((s.seen.largest for b in branches for s in b.points), default=0.0)
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
    if inner or min(at.value - span[0], span[1] - at.value) > 1e-9 * width:
        bifurcation = bifurcation or nearest_bifurcation(branch, point, size, width)
    if bifurcation is None:
        return SegmentEnd(at.value / unit)
    jumps = bifurcation.kind == "fold"
    if bifurcation.kind == "period_doubling":
        first = doubled(bifurcation)
        jumps = first is None or not first.stable
    return SegmentEnd(bifurcation.value / unit, bifurcation.kind, bifurcation.residual, jumps)


def segment_of(seen: SettledMotion, among: Sequence[StableSegment], size: float) -> int | None:
    """The number of the segment of a motion of a sweep, by its period and largest size; None where there is none."""
    away = {k: abs(s.amplitude(seen.value) - seen.amplitude) for k, s in enumerate(among) if seen.period == s.period}
    near = {k: a for k, a in away.items() if a <= 2.0 * ALIKE * size}
    return min(near, key=lambda k: near[k]) if near else None


@result_class
class Jump:
    """Jump between two neighbouring values of a sweep."""

    value: float = reported("value of the key: at the bifurcation, or in the middle", "{over}")
    between: tuple[float, float] = reported("the two values of the key", "{over}")
    max_slip_speed: tuple[float, float] = reported("largest |slip speed| before and after", "rad/s")
    cause: str = reported(
        "kind of the bifurcation, or basin_boundary (both motions go on), steep (one motion), aperiodic (beside a "
        "motion without a period) or not_followed")
    bifurcation: int | None = reported("its number in bifurcations")


def jumps_of(seen: Sequence[SettledMotion], branches: Sequence[Branch], least: float,
             direction: str = "cold") -> list[Jump]:
    """The jumps of a sweep, each with its cause and the number of its bifurcation among those of all branches.

    seen : its motions in order of the parameter
    branches : from `bifurcation_diagram`
    least : smallest change of the largest size of a jump, relative to the largest periodic motion
    direction : up or down where every motion starts from its neighbour below or above, whose end is then the cause
    """
    size = amplitude_of(seen)
    width = abs(seen[-1].value - seen[0].value) if seen else 0.0
    out = []
    for a, b in pairwise(seen):
        if not abs(b.amplitude - a.amplitude) > least * size:
            continue
        cause, bifurcation = _cause(a, b, branches, size, width, direction)
        value = 0.5 * (a.value + b.value) if bifurcation is None else bifurcation.value
        every = (f for branch in branches for f in branch.bifurcations)
        number = next((k for k, f in enumerate(every) if f is bifurcation), None)
        out.append(Jump(value, (a.value, b.value), (a.amplitude, b.amplitude), cause, number))
    return out


def _cause(a: SettledMotion, b: SettledMotion, branches: Sequence[Branch], size: float, width: float,
           direction: str) -> tuple[str, Bifurcation | None]:
    """The cause of a jump between two neighbouring motions of a sweep, and its bifurcation."""
    place_before, place_after = place_of(a, branches, size), place_of(b, branches, size)
    unplaced = NOT_FOLLOWED if any(s.period and p is None for s,
                                   p in ((a, place_before), (b, place_after))) else APERIODIC
    ends, goes_on = list[tuple[bool, Bifurcation]](), False
    for place, goal, other, seen in ((place_before, b.value, place_after, b), (place_after, a.value, place_before, a)):
        if place is None:
            continue
        branch = branches[place[0]]
        last, reached = _walk(branch, place[1], goal)
        same = other is not None and other[0] == place[0] and abs(last - other[1]) <= 1
        if reached and (same or (other is not None and seen.period == branch.period
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
    low, high = sorted((a.value, b.value))
    if low <= goal <= high:
        return after, a.stable and b.stable
    toward = 1.0 if goal > high else -1.0
    at, step = (after + 1, 1) if (b.value - a.value) * toward > 0.0 else (after, -1)
    while points[at].stable:
        following = at + step
        if not 0 <= following < len(points) or (points[following].value - points[at].value) * toward <= 0.0:
            break
        if (points[following].value - goal) * toward >= 0.0:
            return min(at, following), points[following].stable
        at = following
    return at, False


def nearest_bifurcation(branch: Branch, point: int, size: float, width: float) -> Bifurcation | None:
    """The bifurcation of a branch nearest to the pieces about one of its points; None for none nearby."""
    about = np.array([(s.value, s.seen.largest) for s in branch.points[max(point - 1, 0):point + 2]])
    low, high, sizes = about.min(axis=0), about.max(axis=0), np.maximum((width, size), 1e-300)

    def away(bifurcation: Bifurcation) -> float:
        at = np.array((bifurcation.value, bifurcation.point.seen.largest))
        return float(np.sum(np.maximum(np.maximum(low - at, at - high), 0.0) / sizes))

    best = min(branch.bifurcations, key=away, default=None)
    return best if best is not None and away(best) <= NEAR_END else None
