"""A branch as a stream: its points one way from a first one, each with the special points on the way to it.

`follow` predicts, corrects and adapts the step; what is found between two points is told by `detection`, which knows no
loop, and what is to become of the points is their reader's affair. After the iterator of BifurcationKit.jl.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tcc_sim.continuation.detection import ClosedBranch, End, StopReason, period_doubling_end, special_points_between
from tcc_sim.continuation.newton import newton
from tcc_sim.continuation.palc import (
    FLAT,
    Solution,
    StepSize,
    corrector,
    next_solution,
    null_direction,
    oriented,
    predictor,
    predictor_nodes,
    solution_at,
    tangent_of,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import Linearised
from tcc_sim.continuation.sliding import differ
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at


class BranchStep(NamedTuple):
    """A point of a branch, and what is special since the one before; or the last point `again`, in other segments."""

    point: ContinuationPoint
    special: list[Bifurcation]
    again: bool = False


@dataclass
class ContinuationState:
    """A continuation on its way.

    points : all until now
    before : solutions behind the last point, from which the next one is predicted
    step_size : its control
    remeshed : number of points when the orbit was last cut anew for want of a step
    longest : next step, after one that has left the range or left out a piece of the branch
    """

    points: list[ContinuationPoint]
    step_size: StepSize
    before: list[Solution] = field(default_factory=list)
    remeshed: int = 0
    longest: float = np.inf

    @property
    def here(self) -> ContinuationPoint:
        """The last point."""
        return self.points[-1]


def follow(first: ContinuationPoint) -> Generator[BranchStep, None, End]:
    """The points behind `first` along its tangent, until the branch ends; the settings are those of its equations.

    Returns
    -------
    Why it ended, as the value of the generator.
    """
    settings = first.shooting.settings
    state, closed = ContinuationState([first], StepSize(settings)), ClosedBranch(first)
    while True:
        here = state.here
        stop = _exhausted(state)
        if stop is not None:
            return stop
        state.step_size.length = min(state.step_size.length, state.longest)
        edge = _at_the_end_of_the_range(state)
        if edge is here:
            return _end(StopReason.RANGE, here)
        new = _onward(state) if edge is None else edge
        turned_at_corner = new is None and (new := beyond_corner(here, state.step_size)) is not None
        if new is None:
            if not _remesh_for_want_of_a_step(state):
                return _end(StopReason.STEP, here, settings.residual)
            yield BranchStep(state.here, [], True)
            continue
        if edge is None and not turned_at_corner and not 0.0 <= new.solution.z[new.shooting.size] <= 1.0:
            _shorten(state, new)
            continue
        if not turned_at_corner and not abs(new.orbit.multipliers[0]) <= settings.canard:
            return _end(StopReason.CANARD, here, settings.canard)
        special = special_points_between(here, new) if settings.detect else []
        if special is None:
            if not turned_at_corner:
                _shorten(state, new)
                continue
            special = []
        state.longest = np.inf
        stop = None if edge is None else _end(StopReason.RANGE, edge)
        shorter = period_doubling_end(here, new) if here.solution.sign != new.solution.sign else None
        if shorter is not None:
            # Beyond it the branch is its own shift, and what was found on the way to there is that end itself.
            new, special = shorter, [f for f in special if f.kind not in ("branch_point", "fold")]
            stop = stop or _end(StopReason.DOUBLING, new)
        if len(state.points) > 3 and shorter is None and closed.between(here, new):
            new, stop = first, stop or _end(StopReason.CLOSED, first)
        state.points.append(new)
        if stop is None and not turned_at_corner and _in_family(state.points):
            stop = _end(StopReason.FAMILY, new)
        if stop is not None:
            yield BranchStep(new, special)
            return stop
        corner = here.shooting.map.piecewise and differ(here.orbit.seen.events, new.orbit.seen.events)
        state.before = [] if corner or turned_at_corner else [*state.before[1 - settings.nodes:], here.solution]
        finer = None if turned_at_corner else remeshed(new, len(state.points))
        if finer is not None:
            state.points[-1], state.before = finer, []
        yield BranchStep(state.here, special)


def _end(reason: StopReason, point: ContinuationPoint, limit: float = 0.0) -> End:
    """An end at a point."""
    return End(reason, point.shooting.ranges[0].name, point.value, limit)


def _shorten(state: ContinuationState, refused: ContinuationPoint) -> None:
    """Halve the step that led to a point which is not the next one."""
    way = float(np.linalg.norm(refused.solution.z - state.here.solution.z))
    state.longest = 0.5 * min(way, state.longest)


def _exhausted(state: ContinuationState) -> End | None:
    """The end where as many points or tries as are allowed have been made."""
    settings = state.here.shooting.settings
    if len(state.points) > settings.max_points:
        return _end(StopReason.POINTS, state.here, settings.max_points)
    if state.step_size.tried > settings.max_tries:
        return _end(StopReason.TRIES, state.here, state.step_size.tried)
    return None


def _onward(state: ContinuationState) -> ContinuationPoint | None:
    """The next point; where steps with the amplitudes as further coordinates fail, by the unknowns alone."""
    here, step_size = state.here, state.step_size
    for by_amplitude in (True, False):
        if not by_amplitude:
            if not len(here.solution.found.amplitudes):
                return None
            step_size.length = min(step_size.settings.flat_step, state.longest)
        try:
            moved = next_solution(here.shooting, here.solution, state.before, step_size, by_amplitude,
                                  here.shooting.coarse)
            if moved is not None:
                return point_at(here.shooting, moved, by_amplitude)
        except FAILURES:
            continue
    return None


def _at_the_end_of_the_range(state: ContinuationState) -> ContinuationPoint | None:
    """The point at the end of the range where the next step would pass it; the step is shortened until one is found."""
    here, step_size, solution = state.here, state.step_size, state.here.solution
    size, slope, settings = here.shooting.size, here.slope, step_size.settings
    while step_size.length > step_size.smallest:
        bound = 1.0 if slope > 0.0 else 0.0
        room = bound - float(solution.z[size])
        if abs(step_size.length * slope) <= abs(room):
            return None
        if room == 0.0 and len(state.points) == 1:
            return here
        row = np.zeros(len(solution.z))
        row[size] = 1.0
        known, way = predictor_nodes(solution, state.before, FLAT.weights, settings.nodes), room / slope
        for _ in range(2):
            way += (room - float(predictor(known, way)[size])) / slope
        guess = solution.z + predictor(known, way)
        guess[size] = bound
        farthest = settings.farthest * step_size.length
        found = corrector(here.shooting, guess, row, farthest=farthest,
                          first=here.shooting.coarse if step_size.missed > settings.missed else None)
        if found is not None and found.distance <= farthest:
            new = found.facing(solution.tangent)
            if float(new.tangent @ solution.tangent) > settings.turn and new.sign == solution.sign:
                return point_at(here.shooting, new)
        step_size.length *= settings.shorter
    return None


def beyond_corner(here: ContinuationPoint, step_size: StepSize) -> ContinuationPoint | None:
    """The next point beyond a change of the event sequence at which the branch has a corner; None where there is none.

    An end of slip that passes phase 0 makes one too: of motions that stick there none has a slip speed.
    """
    shooting = here.shooting
    if not shooting.map.piecewise:
        return None
    for beside in shooting.settings.beside:
        try:
            found = shooting.linearise(here.solution.z + beside * here.solution.tangent)
            along = oriented(solution_at(here.solution.z, found, null_direction(found)), here.solution.sign).tangent
            z = here.solution.z + beside * along
            events = shooting.map.observe(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).events
        except FAILURES:
            continue
        new = None if events == here.orbit.seen.events else _beyond(here, found, along, beside, step_size)
        if new is not None:
            return new
    return None


def _beyond(here: ContinuationPoint, found: Linearised, along: Floats, beside: float,
            step_size: StepSize) -> ContinuationPoint | None:
    """The next point on the other piece of a branch that has a corner at `here`; None where none is found."""
    # found : derivative `beside` the corner; where it is neither piece's, that along the other one is taken
    shooting, z = here.shooting, here.solution.z
    for known in (found, None):
        short = StepSize(shooting.settings, length=beside, smallest=shooting.settings.corner_step)
        try:
            start = known or shooting.linearise(z + beside * along)
            moved = next_solution(shooting, solution_at(z, start, tangent_of(start, along)), [], short, False)
            new = None if moved is None else point_at(shooting, moved, False)
        except FAILURES:
            continue
        if new is not None and new.orbit.seen.events != here.orbit.seen.events:
            step_size.length = short.length
            return new
    return None


def _remesh_for_want_of_a_step(state: ContinuationState) -> bool:
    """Go on in other segments where no step is possible in these: one of them may start where slip does, and Newton's
    method then goes to and fro between two event sequences. Whether there are other ones.

    That is why segments are cut by growth and no node is put at an onset of slip: the onset moves along a branch, and a
    node on it would be in the way at every step, not at one. The canards behind both folds of period two are passed so
    with either law.
    """
    if state.remeshed == len(state.points):
        return False
    state.remeshed, here = len(state.points), state.here
    other = remeshed(here, len(state.points), anew=True)
    if other is None or other.shooting.segments == here.shooting.segments:
        return False
    state.points[-1], state.step_size.length, state.before = other, here.shooting.settings.flat_step, []
    return True


def remeshed(point: ContinuationPoint, count: int, anew: bool = False) -> ContinuationPoint | None:
    """The point in other segments, where the growth over one of them is large or fewer may do, or `anew`; None where
    these stay.

    count : of points until now; fewer segments are tried now and then
    """
    shooting, settings = point.shooting, point.shooting.settings
    large = float(np.abs(point.solution.found.blocks).max()) > settings.regrowth * settings.growth
    if not shooting.map.divisible and (shooting.period == 1 or len(shooting.segments) == shooting.period):
        return None
    fewer = len(shooting.segments) > 1 and count % settings.fewer_after == 0
    if not (large or fewer or anew):
        return None
    finer, z = shooting.cut(point.solution.z)
    if len(finer.segments) == len(shooting.segments) and not (large or anew):
        return None
    polished = newton(finer, z)
    if polished is None:
        return None
    found = finer.linearise(polished)
    along, n = np.zeros(len(z)), shooting.map.dimension
    along[:n], along[-1] = point.solution.tangent[:n], point.solution.tangent[-1]
    return point_at(finer, solution_at(polished, found, tangent_of(found, along)))


def _in_family(points: list[ContinuationPoint]) -> bool:
    """Whether a branch has run for some length through motions with a multiplier of exactly 1 at one parameter."""
    # Two points alone tell nothing: beside a doubling, where the parameter goes as the square of the way, it stands
    # still and a multiplier is 1 as well.
    last, settings = points[-1], points[-1].shooting.settings
    for point in reversed(points):
        if abs(point.slope) > settings.family or np.abs(point.orbit.multipliers - 1.0).min() > settings.family:
            return False
        away = (last.orbit.section - point.orbit.section) / last.shooting.map.scales
        if float(np.linalg.norm(away)) >= settings.family_length:
            return True
    return False
