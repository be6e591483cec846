"""Tests along a branch and the location of their roots: fold, period doubling, Neimark-Sacker, branch point.

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.2. Each bifurcation is a root of a test function
along the chord between two points of the branch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tcc_sim.continuation.bracket import Bracket, CurvePoint
from tcc_sim.continuation.newton import Orbit, OrbitState, orbit_at
from tcc_sim.continuation.palc import Solution, oriented, solution_at
from tcc_sim.continuation.problem import FAILURES
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.result import Described, reported, reporting

SMOOTH = ("fold", "period_doubling", "neimark_sacker", "branch_point")
"""Kinds that are no change of the event sequence."""


@dataclass(frozen=True, repr=False)
class ContinuationPoint(CurvePoint):
    """A point of a branch: unknowns and tangent, the equations they belong to, and the orbit there."""

    equations: Shooting
    orbit: Orbit
    by_amplitude: bool = True
    """Whether the amplitudes were coordinates of the arclength on the way to it."""

    @property
    def shooting(self) -> Shooting:
        """The equations of the orbit."""
        return self.equations

    @property
    def slope(self) -> float:
        """The parameter's share of the tangent: 0 at a fold."""
        return float(self.solution.tangent[self.shooting.size])

    @property
    def value(self) -> float:
        """The parameter."""
        return self.orbit.values[0]

    def moved(self, solution: Solution) -> ContinuationPoint:
        """The point of another solution of the same equations."""
        return point_at(self.equations, solution)


def turned(point: ContinuationPoint) -> ContinuationPoint:
    """The point with its tangent the other way round."""
    return replace(point, solution=oriented(point.solution, -point.solution.sign))


@dataclass(frozen=True, repr=False)
class Bifurcation(Described):
    """A located bifurcation."""

    kind: str = field(metadata=reported(
        "fold, period_doubling, neimark_sacker, branch_point, grazing_sliding, crossing_sliding, switching_sliding, "
        "adding_sliding or stick_border"))
    point: ContinuationPoint
    residual: float = field(metadata=reported(
        "for a smooth one the distance of the multiplier from where it must be, or the scaled test function; for a "
        "change of the event sequence the margin that vanishes; never below the residual of the orbit itself"))
    branch: int = field(default=0, metadata=reported("number of the branch that it lies on"))
    after: int = field(default=0, metadata=reported("number of the point of that branch before it"))
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
    @reporting("period of the motion", "engine cycles")
    def period(self) -> int:
        """Cycles of the motion."""
        return self.point.orbit.period


def point_at(shooting: Shooting, solution: Solution, by_amplitude: bool = True) -> ContinuationPoint:
    """The continuation point of a solution."""
    return ContinuationPoint(solution, shooting, orbit_at(shooting, solution.z, solution.found), by_amplitude)


def doubling(m: NDArray[np.complex128]) -> float:
    """det(M + I)."""
    return float(math.prod((1.0 + m).tolist()).real)


def torus(m: NDArray[np.complex128]) -> float:
    """Product of lambda_i lambda_j - 1 over pairs: 0 for a complex pair on the unit circle, or a neutral saddle."""
    return math.prod((x * y - 1.0 for x, y in combinations(m.tolist(), 2)), start=1.0 + 0.0j).real


def _opposite(one: float, two: float, factors: Iterable[float]) -> bool:
    """Whether a test function has changed its sign, and not by rounding: of its factors, one may be none."""
    return one * two < 0.0 and max(abs(one), abs(two)) > DEFAULTS.neutral * math.prod(factors)


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
                      lambda s: float(np.linalg.svd(s.solution.found.jacobian, compute_uv=False)[-1])))
    for kind, test, residual in tests:
        point = branch_point(bracket) if kind == "branch_point" else bracket.locate(test, residual)
        if point is None or (kind == "neimark_sacker" and not np.isfinite(_from_circle(point))):
            continue
        left = max(residual(point), point.orbit.residual)
        if left < a.shooting.settings.spurious:
            out.append(Bifurcation(kind, point, left))
    along = b.solution.z - a.solution.z
    return sorted(out, key=lambda f: float(along @ f.point.solution.z))


def branch_point(bracket: Bracket[ContinuationPoint]) -> ContinuationPoint | None:
    """The point where two branches cross, by Newton on a regular system that holds it; None where there is none.

    G + beta w = 0, J^T w = 0, w . w = 1 (G. Moore, The numerical treatment of non-trivial bifurcation points, Numer.
    Funct. Anal. Optim. 2, 1980); the derivative of J^T w is taken by differences.
    """
    near = bracket.b
    shooting, z, found = near.shooting, near.solution.z, near.solution.found
    w, beta, d = np.linalg.svd(found.jacobian)[0][:, -1], 0.0, len(near.solution.z) - 1
    settings, away = shooting.settings, shooting.settings.branch_point_step
    try:
        for _ in range(settings.branch_point_iterations):
            matrix, side = np.zeros((2 * d + 2, 2 * d + 2)), np.zeros(2 * d + 2)
            matrix[:d, :d + 1], matrix[:d, -1] = found.jacobian, w
            matrix[:d, d + 1:-1] = beta * np.eye(d)
            matrix[d:-1, d + 1:-1], matrix[-1, d + 1:-1] = found.jacobian.T, 2.0 * w
            for k in range(d + 1):
                step = np.zeros(d + 1)
                step[k] = away
                matrix[d:-1, k] = (shooting.linearise(z + step).jacobian - found.jacobian).T @ w / away
            side[:d], side[d:-1], side[-1] = found.residual + beta * w, found.jacobian.T @ w, w @ w - 1.0
            change = np.linalg.solve(matrix, -side)
            z, w, beta = z + change[:d + 1], w + change[d + 1:-1], beta + float(change[-1])
            found = shooting.linearise(z)
            if np.abs(change).max() < settings.branch_point_tolerance:
                break
        if (np.linalg.norm(z - near.solution.z) > settings.branch_point_reach
                or abs(beta) > settings.branch_point_defect):
            return None
        return point_at(shooting, solution_at(z, found, near.solution.tangent))
    except FAILURES:
        return None


def _from_circle(point: ContinuationPoint) -> float:
    """Distance of the nearest complex pair from the unit circle; inf where there is none (a neutral saddle)."""
    settings = point.shooting.settings
    pairs = [abs(abs(x) ** 2 - 1.0) for x in point.orbit.multipliers if abs(np.angle(x)) > settings.complex_pair
             and abs(np.angle(x)) < np.pi - settings.complex_pair]
    return float(min(pairs, default=np.inf))
