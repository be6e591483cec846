"""A branch of the set-valued law beyond a corner: where the event sequence changes, its two pieces meet at an angle."""

from __future__ import annotations

from tcc_sim.continuation.palc import StepSize, next_solution, null_direction, oriented, solution_at, tangent_of
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import Linearised
from tcc_sim.continuation.special_points import ContinuationPoint, point_at


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
    """The next point on the other piece of a branch that has a corner at `here`; None where none is found.

    found : derivative `beside` the corner; where it is neither piece's, that along the other one is taken
    """
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
