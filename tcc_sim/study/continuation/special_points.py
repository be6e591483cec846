"""Bifurcations between two neighbouring points of a branch.

A fold, a doubling or a Neimark-Sacker bifurcation is a root of a test function along the chord between the points
(Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.2). A bordered system is solved where the branch
is singular, at branch points and where the period halves, and where the test has no second sign: the margin of a change
of the event sequence is defined on one side only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tcc_sim.result import Described, reported, reporting
from tcc_sim.study.continuation.bordered import (
    BORDER_HALVINGS,
    BranchPoint,
    MinimallyAugmented,
    VanishingMargin,
    nearest_margins,
)
from tcc_sim.study.continuation.newton import NEUTRAL, SAME, Orbit, OrbitState, orbit_at
from tcc_sim.study.continuation.palc import (
    OPPOSITE,
    Bracket,
    CurvePoint,
    Solution,
    solution_at,
    tangent_of,
    turned_round,
)
from tcc_sim.study.continuation.problem import FAILURES, MARGINS, Margins, differ, kind_of_change, margin_residual, ring
from tcc_sim.study.continuation.shooting import Shooting

SPURIOUS = 1e-2  # residual above which a change of sign is rounding
COMPLEX_PAIR = 1e-6  # argument, rad, above which a pair of multipliers is complex
BRANCH_POINT_REACH = 1e-2  # largest distance of a branch point from where Newton's method begins
BRANCH_POINT_DEFECT = 1e-6  # largest defect of its equations
HALVES_REACH = 0.1  # largest distance of the doubling from the orbit whose halves are alike
MOST_BORDERS = 6  # most changes in one step
BORDER_ASTRAY = 10.0  # distance, in lengths of the bracket, beyond which another border has been found

SMOOTH = ("fold", "period_doubling", "neimark_sacker", "branch_point")
"""Kinds without a change of the event sequence."""


@dataclass(frozen=True, repr=False)
class ContinuationPoint(CurvePoint):
    """A point of a branch: unknowns and tangent, their equations, and the orbit."""

    equations: Shooting
    orbit: Orbit

    @property
    def shooting(self) -> Shooting:
        """The equations of the orbit."""
        return self.equations

    @property
    def slope(self) -> float:
        """The parameter's component of the tangent: 0 at a fold."""
        return float(self.solution.tangent[self.shooting.size])

    @property
    def value(self) -> float:
        """The parameter."""
        return self.orbit.values[0]

    def moved(self, solution: Solution, by_amplitude: bool = True) -> ContinuationPoint:
        """The point of another solution of the same equations."""
        return replace(point_at(self.equations, solution), by_amplitude=by_amplitude)


@dataclass(frozen=True, repr=False)
class Bifurcation(Described):
    """A located bifurcation."""

    kind: str = field(metadata=reported(
        "fold, period_doubling, neimark_sacker, branch_point, grazing_sliding, crossing_sliding, switching_sliding, "
        "adding_sliding or stick_border"))
    point: ContinuationPoint
    residual: float = field(metadata=reported(
        "of its condition, scaled; at least that of the orbit"))
    branch: int = field(default=0, metadata=reported("number of its branch"))
    after: int = field(default=0, metadata=reported("number of the point before it"))
    changes_stability: bool = field(default=False, metadata=reported(
        "whether motions are stable on one side of it only"))

    @property
    def value(self) -> float:
        """The parameter."""
        return self.point.value

    @property
    @reporting("the motion at it", spread=True)
    def state(self) -> OrbitState:
        """The motion at it."""
        return self.point.orbit.state

    @property
    @reporting("period of the motion", "periods of excitation")
    def period(self) -> int:
        """Cycles of the motion."""
        return self.point.orbit.period


def point_at(shooting: Shooting, solution: Solution) -> ContinuationPoint:
    """The continuation point of a solution."""
    return ContinuationPoint(solution, shooting, orbit_at(shooting, solution.z, solution.linearised))


def doubling(m: NDArray[np.complex128]) -> float:
    """det(M + I)."""
    return float(math.prod((1.0 + m).tolist()).real)


def torus(m: NDArray[np.complex128]) -> float:
    """Product of lambda_i lambda_j - 1 over pairs: 0 for a complex pair on the unit circle and for a neutral saddle."""
    return math.prod((x * y - 1.0 for x, y in combinations(m.tolist(), 2)), start=1.0 + 0.0j).real


def _opposite(one: float, two: float, factors: Iterable[float]) -> bool:
    """Whether a test function, the product of `factors`, has changed its sign by more than rounding of one factor."""
    return one * two < 0.0 and max(abs(one), abs(two)) > NEUTRAL * math.prod(factors)


def smooth_bifurcations(bracket: Bracket[ContinuationPoint]) -> list[Bifurcation]:
    """The bifurcations between two points of one smooth piece of a branch, in order along it."""
    a, b, out = bracket.a, bracket.b, []
    m, n = a.orbit.multipliers, b.orbit.multipliers
    crossed = a.solution.sign != b.solution.sign
    tests: list[tuple[str, Callable[[ContinuationPoint], float], Callable[[ContinuationPoint], float]]] = []
    sizes = [max(pair) for pair in zip(map(abs, m.tolist()), map(abs, n.tolist()))]
    if a.slope * b.slope < 0.0:
        tests.append(("fold", lambda s: s.slope, lambda s: float(np.abs(s.orbit.multipliers - 1.0).min())))
    if _opposite(doubling(m), doubling(n), (1.0 + x for x in sizes)):
        tests.append(("period_doubling", lambda s: doubling(s.orbit.multipliers),
                      lambda s: float(np.abs(s.orbit.multipliers + 1.0).min())))
    if _opposite(torus(m), torus(n), (1.0 + x * y for x, y in combinations(sizes, 2))):
        tests.append(("neimark_sacker", lambda s: torus(s.orbit.multipliers), _from_circle))
    if crossed:
        tests.append(("branch_point", lambda s: s.solution.sign,
                      lambda s: float(np.linalg.svd(s.solution.linearised.jacobian, compute_uv=False)[-1])))
    for kind, test, residual in tests:
        point = branch_point(bracket.b) if kind == "branch_point" else bracket.locate(test, residual)
        if point is None or (kind == "neimark_sacker" and not np.isfinite(_from_circle(point))):
            continue
        left = max(residual(point), point.orbit.residual)
        if left < SPURIOUS:
            out.append(Bifurcation(kind, point, left))
    along = b.solution.z - a.solution.z
    return sorted(out, key=lambda f: float(along @ f.point.solution.z))


def branch_point(near: ContinuationPoint) -> ContinuationPoint | None:
    """The point where two branches cross; None where there is none."""
    shooting = near.shooting
    try:
        system = BranchPoint(shooting, near.solution.z)
        solved = system.solved(system.start, BRANCH_POINT_REACH)
        if solved is None or abs(solved[0][-1]) > BRANCH_POINT_DEFECT:
            return None
        z = solved[0][:-1]
        return point_at(shooting, solution_at(z, shooting.linearise(z), near.solution.tangent))
    except FAILURES:
        return None


def _from_circle(point: ContinuationPoint) -> float:
    """Distance of the nearest complex pair from the unit circle; inf where there is none (a neutral saddle)."""
    pairs = [abs(abs(x) ** 2 - 1.0) for x in point.orbit.multipliers if abs(np.angle(x)) > COMPLEX_PAIR
             and abs(np.angle(x)) < np.pi - COMPLEX_PAIR]
    return float(min(pairs, default=np.inf))


def sliding_bifurcation(
        bracket: Bracket[ContinuationPoint]) -> tuple[ContinuationPoint, ContinuationPoint, Bifurcation | None]:
    """The points on both sides of a change of the event sequence, and the bifurcation there.

    None in place of the bifurcation where friction is not the cause (the pressure reaches 0), or no margin vanishes.
    """
    low, high = 0.0, 1.0
    left, right = bracket.a, bracket.b
    best: tuple[ContinuationPoint, ContinuationPoint, Bifurcation] | None = None
    for count in BORDER_HALVINGS:
        if not count:
            left, right = bracket.a, bracket.b
        for _ in range(count):
            middle = 0.5 * (low + high)
            point = bracket.at(middle)
            if point is None:
                break
            # The corrector's observation is from before its last step.
            seen = point.shooting.linearise(point.solution.z).seen
            point = replace(point, orbit=replace(point.orbit, seen=seen))
            if differ(point.orbit.seen.events, bracket.a.orbit.seen.events):
                high, right = middle, point
            else:
                low, left = middle, point
        events = left.orbit.seen.events, right.orbit.seen.events
        if differ(events[0].replace("F", ""), events[1].replace("F", "")) is False:
            return left, right, None
        near = nearest_margins(left.shooting, left.solution.z), nearest_margins(right.shooting, right.solution.z)
        kind = kind_of_change(*events, near)
        border = _on_border(kind, left, right, near)
        if border is not None:
            return left, right, border
        # The margin may vanish on one side only, and the bracket need not be narrow.
        residual, at = min(((max(margin_residual(kind, (m,)), s.orbit.residual), s)
                            for s, m in zip((left, right), near)), key=lambda side: side[0])
        # In a bracket as narrow as rounding both ends may be on the side without the margin; then the next, wider
        # brackets are tried.
        if best is None or residual < best[2].residual:
            best = left, right, Bifurcation(kind, at, residual)
    assert best is not None
    # Slip that begins at phase 0 to rounding changes the sequence too, but no margin vanishes there.
    return best if best[2].residual < SPURIOUS else (best[0], best[1], None)


def _on_border(kind: str, left: ContinuationPoint, right: ContinuationPoint,
               near: tuple[Margins, Margins]) -> Bifurcation | None:
    """The border between two points by Newton's method on its margin; None where that fails."""
    name = MARGINS[kind]
    sides = [(s, m[name]) for s, m in zip((left, right), near) if name in m]
    if not sides:
        return None
    # The margin that is to vanish belongs to the side without the event that it would make.
    start, _ = min(sides, key=lambda side: (len(ring(side[0].orbit.seen.events)), abs(side[1].value)))
    shooting, size = start.shooting, start.shooting.size
    apart = max(float(np.linalg.norm(right.solution.z - left.solution.z)), 1e-9)
    solved = VanishingMargin(shooting, kind).solved(start.solution.z, BORDER_ASTRAY * apart)
    if solved is None:
        return None
    z, linearised, error = solved
    linearised = linearised._replace(residual=linearised.residual[:size], jacobian=linearised.jacobian[:size])
    point = point_at(shooting, solution_at(z, linearised, tangent_of(linearised, start.solution.tangent)))
    return Bifurcation(kind, point, max(error, point.orbit.residual))


def special_points_between(a: ContinuationPoint, b: ContinuationPoint) -> list[Bifurcation] | None:
    """The bifurcations between two neighbouring points, in order; None where the step has skipped a piece."""
    bracket = Bracket(a, b, b.by_amplitude)
    if not (a.shooting.map.piecewise and differ(a.orbit.seen.events, b.orbit.seen.events)):
        return smooth_bifurcations(bracket)
    out: list[Bifurcation] = []
    for _ in range(MOST_BORDERS):
        left, right, points = sliding_bifurcation(bracket)
        if float(np.linalg.norm(right.solution.z - left.solution.z)) > SAME:
            return None
        out += smooth_bifurcations(Bracket(bracket.a, left, b.by_amplitude))
        if points is not None:
            out.append(points)
        bracket = Bracket(right, b, b.by_amplitude)
        if not differ(right.orbit.seen.events, b.orbit.seen.events):
            break
    return out + smooth_bifurcations(bracket)


def period_doubling_end(here: ContinuationPoint, new: ContinuationPoint) -> ContinuationPoint | None:
    """The point between two at which the period of the orbit becomes shorter; None where it does not."""
    # The distance between the halves of the orbit changes its sign there. The branch is singular, so the doubling of
    # the shorter motion is solved instead.
    shooting = here.shooting
    of, period = shooting.map, shooting.period
    for shorter in range(of.forcing_period, period, of.forcing_period):
        if period % shorter:
            continue
        one, two = ((of.evaluate(p.orbit.section, p.orbit.values, 0, shorter).value - p.orbit.section) / of.scales
                    for p in (here, new))
        if turned_round(one, two, OPPOSITE):
            simple = Shooting.single(of, shorter, *shooting.ranges, settings=shooting.settings)
            near = simple.unknowns((here.orbit.section + 0.5 * one * of.scales)[None], here.orbit.values)
            whole = Shooting.single(of, period, *shooting.ranges, settings=shooting.settings)
            try:
                solved = MinimallyAugmented("period_doubling", simple, near).solved(near)
                if solved is None or not np.abs(solved[0] - near).max() < HALVES_REACH:
                    return here
                linearised = whole.linearise(solved[0])
            except FAILURES:
                return here
            if float(np.abs(linearised.residual).max()) > shooting.settings.residual:
                return here
            return point_at(whole, solution_at(solved[0], linearised, shooting.outer(here.solution.tangent)))
    return None
