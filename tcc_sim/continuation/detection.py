"""Bifurcations between two neighbouring points of a branch, its end at a period doubling, and why branches end.

Both are found from the two points alone. The reason for an end is a value with its sentence, as `Status` is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from tcc_sim.continuation.augmented import locate_bifurcation
from tcc_sim.continuation.bracket import Bracket, turned_round
from tcc_sim.continuation.palc import solution_at
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.continuation.sliding import differ, sliding_bifurcation
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at, smooth_bifurcations


class StopReason(Enum):
    """Each with its sentence: the parameter's `name` and `value`, a `limit` that was met, `what` special point."""

    RANGE = "{name} reached {value:.9g}, the end of the range"
    CLOSED = "closed: back at its first point, {name} = {value:.9g}"
    DOUBLING = "ended in a period doubling of motions of a shorter period at {name} = {value:.9g}"
    BEGAN = "began in the period doubling at {name} = {value:.9g}"
    CANARD = ("ended at {name} = {value:.9g}: beyond it a multiplier is above {limit:g}, a canard, which double "
              "precision does not resolve")
    CANARD_CURVE = ("ended at {name} = {value:.9g}: beyond it a disturbance grows by more than {limit:g} along a part "
                    "of the motion, a canard, which double precision does not resolve")
    FAMILY = ("met a family of motions with a multiplier of exactly 1 at {name} = {value:.9g}: no branch can be "
              "followed through it")
    POINTS = "stopped after {limit:g} points at {name} = {value:.9g}"
    TRIES = "given up after {limit:g} steps tried at {name} = {value:.9g}: no progress"
    STEP = ("no further point was found beyond {name} = {value:.9g}: no step, however short, met a residual of "
            "{limit:g}")
    SPECIAL = "ended in a {what} at {name} = {value:.9g}"
    INTERRUPTED = "interrupted at {name} = {value:.9g}"


@dataclass(frozen=True)
class End:
    """One end of a branch: the reason, and the parameter there."""

    reason: StopReason
    name: str
    value: float
    limit: float = 0.0
    what: str = ""

    def __str__(self) -> str:
        """The sentence."""
        return self.reason.value.format(name=self.name, value=self.value, limit=self.limit, what=self.what)


def special_points_between(a: ContinuationPoint, b: ContinuationPoint) -> list[Bifurcation] | None:
    """The bifurcations between two neighbouring points, in order; None where these lie on pieces of the branch that do
    not meet at a change of the event sequence between them: the step has left out what lies between.
    """
    if a.shooting is not b.shooting and a.shooting != b.shooting:
        return []
    bracket = Bracket(a, b, b.by_amplitude)
    if not (a.shooting.map.piecewise and differ(a.orbit.seen.events, b.orbit.seen.events)):
        return smooth_bifurcations(bracket)
    out: list[Bifurcation] = []
    for _ in range(a.shooting.settings.most_borders):
        left, right, found = sliding_bifurcation(bracket)
        if float(np.linalg.norm(right.solution.z - left.solution.z)) > a.shooting.settings.same:
            return None
        out += smooth_bifurcations(Bracket(bracket.a, left, b.by_amplitude))
        if found is not None:
            out.append(found)
        bracket = Bracket(right, b, b.by_amplitude)
        if not differ(right.orbit.seen.events, b.orbit.seen.events):
            break
    return out + smooth_bifurcations(bracket)


def period_doubling_end(here: ContinuationPoint, new: ContinuationPoint) -> ContinuationPoint | None:
    """The point between two at which the orbit is one of a shorter period; None where there is none.

    What tells the halves of the orbit apart changes its sign there. It is a period doubling of the shorter motions, and
    solved as such: the branch itself is singular there.
    """
    shooting = here.shooting
    of, period = shooting.map, shooting.period
    for shorter in range(of.forcing_period, period, of.forcing_period):
        if period % shorter:
            continue
        one, two = ((of.evaluate(p.orbit.section, p.orbit.values, 0, shorter).value - p.orbit.section) / of.scales
                    for p in (here, new))
        if turned_round(one, two, shooting.settings.opposite):
            simple = Shooting.single(of, shorter, *shooting.ranges, settings=shooting.settings)
            near = simple.unknowns((here.orbit.section + 0.5 * one * of.scales)[None], here.orbit.values)
            z = locate_bifurcation("period_doubling", simple, near)
            if z is None or not np.abs(z - near).max() < shooting.settings.halves_reach:
                return here
            whole = Shooting.single(of, period, *shooting.ranges, settings=shooting.settings)
            return point_at(whole, solution_at(z, whole.linearise(z), shooting.outer(here.solution.tangent)))
    return None
