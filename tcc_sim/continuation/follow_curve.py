"""A curve of bifurcations in two parameters as a stream, each point with what is special between it and the one before.

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, chapter 9: cusp, generalised doubling, fold-flip, the strong
resonances 1:1 to 1:4, Chenciner; and changes of the event sequence.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tcc_sim.continuation.augmented import MinimallyAugmented
from tcc_sim.continuation.detection import StopReason, passing
from tcc_sim.continuation.palc import (
    Equations,
    Solution,
    StepSize,
    corrector,
    next_solution,
    null_direction,
    solution_at,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.sliding import differ, kind_of_change, nearest_margins
from tcc_sim.continuation.special_points import chandrupatla, turned_round

ENDING = {"neimark_sacker": ("resonance_1_1", "resonance_1_2")}
"""Special points in which curves of a kind end: the pair of multipliers becomes real there."""
Bounds = tuple[tuple[int, float, float], ...]
"""(index of an unknown, low, high) of both parameters."""


class CurveStep(NamedTuple):
    """A point of a curve, what is special between it and the one before (names and unknowns), and its equations."""

    solution: Solution
    special: list[tuple[str, Floats]]
    equations: Equations


@dataclass
class CurveState:
    """A curve on its way, from its last point."""

    equations: Equations
    here: Solution
    bounds: Bounds
    step_size: StepSize
    before: list[Solution] = field(default_factory=list)
    cut_to: float = np.inf
    """Growth over a segment down to which the orbit has been cut anew at this point for want of a step."""

    @property
    def augmented(self) -> MinimallyAugmented | None:
        """The equations, where they are those of orbits."""
        return self.equations if isinstance(self.equations, MinimallyAugmented) else None


def follow_curve(equations: Equations, u: Floats, forward: bool, bounds: Bounds,
                 step_size: StepSize | None = None) -> Generator[CurveStep, None, tuple[StopReason, int]]:
    """Points of a curve from `u` one way, each with what is special between it and the one before.

    forward : whether the first of the bounded unknowns grows at the start

    Returns
    -------
    Why it ended and, at the end of a range, the number of the bound; as the value of the generator.
    """
    settings = equations.settings
    found = equations.linearise(u)
    tangent = null_direction(found)
    first = solution_at(u, found, tangent if (tangent[bounds[0][0]] > 0.0) == forward else -tangent)
    state = CurveState(equations, first, bounds, step_size or StepSize(settings))
    tests = _tests(state, first)
    origin = _of_single_shooting(equations, first.z), _of_single_shooting(equations, first.tangent)
    yield CurveStep(first, [], equations)
    count = 0
    while count < settings.max_points:
        if state.step_size.tried > settings.max_tries:
            return StopReason.TRIES, 0
        edge = _at_a_bound(state)
        length = state.step_size.length
        new = edge[0] if edge else _next(state)
        if new is None:
            if _remesh_for_want_of_a_step(state):
                tests = _tests(state, state.here)
                continue
            if _halves_meet(state):
                yield CurveStep(state.here, [("generalised_doubling", state.here.z)], state.equations)
                return StopReason.SPECIAL, 0
            return StopReason.STEP, 0
        if edge is None and any(not low <= new.z[k] <= high for k, low, high in state.bounds):
            state.step_size.length = 0.5 * length
            continue
        if state.augmented is not None and growth_over_parts(new.found.blocks) > settings.canard:
            return StopReason.CANARD_CURVE, 0
        after = _tests(state, new)
        special = _special_between(state, new, tests, after, last=edge is not None)
        end = _end_between(state, new, special)
        if end is not None:
            yield CurveStep(new._replace(z=end[1]), special, state.equations)
            return StopReason.SPECIAL, 0
        p, q = (_of_single_shooting(state.equations, point.z) for point in (state.here, new))
        if count > 3 and passing(*origin, p, q, settings) is not None:
            yield CurveStep(first, special, equations)
            return StopReason.CLOSED, 0
        count += 1
        yield CurveStep(new, special, state.equations)
        if edge is not None:
            return StopReason.RANGE, edge[1]
        state.before, state.here, tests = [*state.before[1 - settings.nodes:], state.here], new, after
        state.cut_to = np.inf
        if state.augmented is not None:
            state.augmented.update_borders(new.z, new.found)
            if _remesh(state, others=count % settings.fewer_after == 0):
                tests = _tests(state, state.here)
    return StopReason.POINTS, 0


def growth_over_parts(blocks: Floats) -> float:
    """The largest growth of a disturbance from any node to any later one, once round at most; blocks (m, n, n)."""
    count, most = len(blocks), 0.0
    ahead = np.broadcast_to(np.eye(blocks.shape[1]), blocks.shape)
    for k in range(count):
        ahead = np.roll(blocks, -k, axis=0) @ ahead
        most = max(most, float(np.abs(ahead).max()))
    return most


def _next(state: CurveState) -> Solution | None:
    """The next point along the curve."""
    try:
        return next_solution(state.equations, state.here, state.before, state.step_size)
    except FAILURES:
        return None


def _at_a_bound(state: CurveState) -> tuple[Solution, int] | None:
    """The point on a bound that the next step would pass, and the number of the bound; None where it passes none."""
    here, step_size = state.here, state.step_size
    for number, (k, low, high) in enumerate(state.bounds):
        edge = high if here.tangent[k] > 0.0 else low
        while abs(room := edge - float(here.z[k])) <= abs(step_size.length * here.tangent[k]):
            row = np.zeros(len(here.z))
            row[k] = 1.0
            guess = here.z + room / float(here.tangent[k]) * here.tangent if room != 0.0 else here.z.copy()
            guess[k] = edge
            last = corrector(state.equations, guess, row)
            if last is not None and last.distance <= 0.5 * step_size.length + 1e-9:
                return solution_at(last.z, last.found, here.tangent), number
            step_size.length *= 0.5
            if step_size.length < step_size.smallest:
                break
    return None


def _remesh_for_want_of_a_step(state: CurveState) -> bool:
    """Go on in segments over which disturbances grow by less, from now on; whether there are any."""
    # What grows by some 1e3 in slip and is taken back by stick within one segment leaves no large derivative, but one
    # that bends within 1e-5 and has the state's own error times the reciprocal of that: cusps are passed in segments
    # over which it grows by some 10, and not in one.
    old = state.augmented
    if old is None:
        return False
    for growth in old.settings.finer_growths:
        if growth <= old.shooting.settings.growth and growth < state.cut_to:
            state.cut_to = growth
            if _remesh(state, growth=growth):
                state.step_size.length = old.settings.flat_step
                return True
    return False


def _remesh(state: CurveState, growth: float | None = None, others: bool = False) -> bool:
    """Go on in other segments where growth is large, to be below `growth`, or `others` may do; False for none."""
    old = state.augmented
    if old is None or not len(state.here.found.blocks):
        return False
    settings, shooting = old.settings, old.shooting
    large = float(np.abs(state.here.found.blocks).max()) > settings.regrowth * settings.growth
    # Growth that a segment takes back is seen by a thorough look alone.
    others = others and (settings.thorough or len(shooting.segments) > 1)
    if not (large or growth or others) or (
            not shooting.map.divisible and len(shooting.segments) == shooting.period):
        return False
    if growth is not None:
        shooting = replace(shooting, settings=replace(shooting.settings, growth=growth, thorough=True))
    try:
        finer, z = shooting.cut(state.here.z[:old.unknowns])
        if finer.segments == shooting.segments:
            return False
        other = MinimallyAugmented(old.kind, finer, z)
        start = np.append(z, state.here.z[-1:]) if old.turning else z
        polished = corrector(other, start, null_direction(other.linearise(start)))
    except FAILURES:
        return False
    if polished is None:
        return False
    # The first node and what is no node are the same in all segments; the motion carries errors on to the others.
    before, after = (_of_single_shooting(of, tangent) for of, tangent in ((old, state.here.tangent),
                                                                          (other, polished.tangent)))
    sign = 1.0 if float(before @ after) > 0.0 else -1.0
    moved = finer.size - shooting.size
    state.equations, state.here, state.before = other, solution_at(polished.z, polished.found,
                                                                   sign * polished.tangent), []
    state.bounds = tuple((k + moved, low, high) for k, low, high in state.bounds)
    return True


def _tests(state: CurveState, at: Solution) -> dict[str, float]:
    """The test functions at a point, those that have a value there."""
    out: dict[str, float] = {}
    if state.augmented is not None:
        for name, test in state.augmented.tests(at.z, at.found).items():
            try:
                out[name] = test()
            except FAILURES:
                continue
    return out


def _special_between(state: CurveState, new: Solution, before: dict[str, float], after: dict[str, float],
                     last: bool) -> list[tuple[str, Floats]]:
    """Name and unknowns of what is special between two points of a curve, in order, or in the last point itself."""
    out, here, augmented = [], state.here, state.augmented
    if augmented is None:
        return []
    one, two = here.found.seen, new.found.seen
    if augmented.shooting.map.piecewise and one is not None and two is not None and differ(one.events, two.events):
        near = [nearest_margins(augmented.shooting, u[:augmented.unknowns]).margins for u in (here.z, new.z)]
        return [(kind_of_change(one.events, two.events, (near[0], near[1])), new.z)]
    neutral, noise = augmented.settings.neutral, augmented.settings.noise
    for name in before.keys() & after.keys():
        crossed = before[name] * after[name] < 0.0 or (last and abs(after[name]) <= noise * abs(before[name]))
        if not crossed or max(abs(before[name]), abs(after[name])) < neutral:
            continue
        at = _located(augmented, here, new, name)
        if at is not None:
            out.append((name, at))
    way = new.z - here.z
    return sorted(out, key=lambda s: float(way @ s[1]))


def _end_between(state: CurveState, new: Solution, special: list[tuple[str, Floats]]) -> tuple[str, Floats] | None:
    """That special point at which the curve ends; one more where the halves of the orbits meet, which joins them."""
    equations = state.augmented
    if equations is None:
        return None
    halves = [equations.between_halves(s.z) for s in (state.here, new)] if equations.doubled else []
    if halves and turned_round(halves[0], halves[1], equations.settings.opposite):
        at = _root(equations, state.here, new, lambda z: float(halves[0] @ equations.between_halves(z)))
        if at is not None:
            special.append(("generalised_doubling", at))
            return special[-1]
    return next((s for s in special if s[0] in ENDING.get(equations.kind, ())), None)


def _halves_meet(state: CurveState) -> bool:
    """Whether a curve is lost beside a generalised doubling: folds of doubled motions of amplitude a lie within the
    order of a^2 of one, and the doublings of the halves meet them there, so that the equations are singular.
    """
    equations = state.augmented
    return equations is not None and equations.doubled and float(
        np.linalg.norm(equations.between_halves(state.here.z))) <= equations.settings.halves_met


def _located(equations: MinimallyAugmented, here: Solution, new: Solution, name: str) -> Floats | None:
    """Unknowns where a test function vanishes between two points; None where it jumps or the curve is lost."""
    return _root(equations, here, new, lambda z: equations.tests(z, equations.linearise(z))[name]())


def _root(equations: MinimallyAugmented, here: Solution, new: Solution,
          function: Callable[[Floats], float]) -> Floats | None:
    """Unknowns where a function of them vanishes between two points; None where it jumps or the curve is lost."""
    way, known = new.z - here.z, dict[float, tuple[Floats, float]]()

    def test(part: float) -> float:
        found = corrector(equations, here.z + part * way, way / float(np.linalg.norm(way)))
        if found is None:
            raise ValueError("the curve is lost")
        known[part] = found.z, function(found.z)
        # Solved anew, what vanishes in an end of the step may have either sign there.
        other = max((abs(value) for _, value in known.values()), default=0.0)
        return 0.0 if part in {0.0, 1.0} and abs(known[part][1]) <= equations.settings.noise * other else known[part][1]

    try:
        at, left = known[chandrupatla(test, 0.0, 1.0, equations.settings.curve_root)]
        return at if abs(left) <= equations.settings.curve_jump * max(abs(known[k][1]) for k in (0.0, 1.0)) else None
    except FAILURES:
        return None


def _of_single_shooting(of: Equations, vector: Floats) -> Floats:
    """The part of a vector of unknowns that is there whatever the segments: the first node, and what is no node."""
    if not isinstance(of, MinimallyAugmented):
        return vector
    return np.concatenate([vector[:of.shooting.map.dimension], vector[of.shooting.size:]])
