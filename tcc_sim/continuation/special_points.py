"""Tests along a branch and the location of their roots: fold, period doubling, Neimark-Sacker, branch point.

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.2. Each bifurcation is a root of a function of its
own along the chord between two points of the branch, found to rounding by T. R. Chandrupatla's bracketing method (Adv.
Eng. Softw. 28, 1997) with a corrector in every evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.continuation.newton import Orbit, orbit_at
from tcc_sim.continuation.palc import FLAT, AmplitudeRow, Solution, corrector, oriented, solution_at
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.errors import NumericalFailure
from tcc_sim.result import Described

SMOOTH = ("fold", "period_doubling", "neimark_sacker", "branch_point")
"""Kinds that are no change of the event sequence."""


@dataclass(frozen=True, repr=False)
class ContinuationPoint(Described):
    """A point of a branch: unknowns and tangent, the orbit there, and the equations they belong to."""

    solution: Solution
    orbit: Orbit
    shooting: Shooting
    by_amplitude: bool = True
    """Whether the amplitudes were coordinates of the arclength on the way to it."""

    @property
    def slope(self) -> float:
        """The parameter's share of the tangent: 0 at a fold."""
        return float(self.solution.tangent[self.shooting.size])

    @property
    def value(self) -> float:
        """The parameter."""
        return self.orbit.values[0]


def turned(point: ContinuationPoint) -> ContinuationPoint:
    """The point with its tangent the other way round."""
    return replace(point, solution=oriented(point.solution, -point.solution.sign))


@dataclass(frozen=True, repr=False)
class Bifurcation(Described):
    """A located bifurcation.

    residual : for a smooth one the distance of the multiplier from where it must be, or the scaled test function; for a
        change of the event sequence the margin that vanishes; never below the residual of the orbit itself
    branch : index of the branch it lies on
    after : number of the point of that branch before it
    changes_stability : whether motions are stable on one side of it
    """

    kind: str
    point: ContinuationPoint
    residual: float
    branch: int = 0
    after: int = 0
    changes_stability: bool = False

    @property
    def value(self) -> float:
        """The parameter."""
        return self.point.value

    def as_json(self) -> dict[str, Any]:
        """As an entry of `bifurcations`."""
        orbit = self.point.orbit.as_json()
        names = ("value", "slip_speed", "plate_angle", "plate_speed", "max_slip_speed", "multipliers")
        return {"kind": self.kind, **{n: orbit[n] for n in names}, "residual": self.residual, "branch": self.branch,
                "after": self.after,
                "changes_stability": self.changes_stability, "period": self.point.orbit.period}


def point_at(shooting: Shooting, solution: Solution, by_amplitude: bool = True) -> ContinuationPoint:
    """The continuation point of a solution."""
    return ContinuationPoint(solution, orbit_at(shooting, solution.z, solution.found), shooting, by_amplitude)


@dataclass(frozen=True)
class Bracket:
    """The piece of a branch between two points with the same equations."""

    a: ContinuationPoint
    b: ContinuationPoint
    by_amplitude: bool = True
    """Whether the amplitudes are coordinates of the arclength, as they were on the way from a to b."""

    kept: dict[float, ContinuationPoint] = field(default_factory=dict, compare=False, repr=False)
    """Points solved for already, by their part of the chord."""

    def at(self, part: float) -> ContinuationPoint | None:
        """The point at `part` (0 to 1) of the chord; None where the corrector fails."""
        p, q = self.a.solution, self.b.solution
        chord = q.z - p.z
        length = float(np.linalg.norm(chord))
        if part in (0.0, 1.0) or length == 0.0:
            return self.b if part == 1.0 else self.a
        if part in self.kept:
            return self.kept[part]
        start, plane, low, high = None, FLAT, p.found.amplitudes, q.found.amplitudes
        if self.by_amplitude and len(low) and len(low) == len(high):
            guess, plane = p.z + part * chord, AmplitudeRow((high - low) / length, low + part * (high - low))
            start = self._start(part, chord / length, plane.weights)
        else:
            guess = _hermite(p.z, q.z, p.tangent * length, q.tangent * length, part)
        found = corrector(self.a.shooting, guess, chord / length, plane, start=start)
        if found is None:
            return None
        self.kept[part] = point_at(self.a.shooting, found.facing(p.tangent + q.tangent))
        return self.kept[part]

    def _start(self, part: float, row: Floats, weights: Floats) -> Floats | None:
        """The cubic through the known points about `part`, with tangents; None where one goes back on the chord."""
        known = {0.0: self.a, 1.0: self.b, **self.kept}
        low, high = max(k for k in known if k < part), min(k for k in known if k > part)
        length = float(np.linalg.norm(self.b.solution.z - self.a.solution.z))
        whole, slopes = length * (1.0 + float(weights @ weights)), []
        for point in (known[low], known[high]):
            tangent = point.solution.tangent
            along = float(row @ tangent + weights @ (point.solution.found.amplitude_gradient @ tangent))
            if not along > self.a.shooting.settings.forward * float(np.sqrt(1.0 + weights @ weights)):
                return None
            slopes.append(tangent * (whole / along * (high - low)))
        return _hermite(known[low].solution.z, known[high].solution.z, slopes[0], slopes[1],
                        (part - low) / (high - low))

    def locate(self, test: Callable[[ContinuationPoint], float],
             residual: Callable[[ContinuationPoint], float] | None = None) -> ContinuationPoint | None:
        """The point where `test` changes sign; None where it does not or the branch is lost on the way, with the
        amplitudes as coordinates and without them.

        residual : of what is looked for; where it is small enough nothing better is
        """
        def value(part: float) -> float:
            point = self.at(part)
            if point is None:
                raise NumericalFailure("the branch is lost between two of its points")
            return 0.0 if residual is not None and residual(point) <= self.a.shooting.settings.enough else test(point)

        try:
            return self.at(chandrupatla(value, 0.0, 1.0))
        except ValueError:
            return None
        except NumericalFailure:
            return replace(self, by_amplitude=False, kept={}).locate(test, residual) if self.by_amplitude else None


def _hermite(p: Floats, q: Floats, dp: Floats, dq: Floats, t: float) -> Floats:
    """The cubic through p and q with derivatives dp and dq at t in 0 to 1."""
    s = 1.0 - t
    return s * s * (1.0 + 2.0 * t) * p + t * s * s * dp + t * t * (3.0 - 2.0 * t) * q - t * t * s * dq


def chandrupatla(f: Callable[[float], float], a: float, b: float, tolerance: float = DEFAULTS.root) -> float:
    """A root of `f` between `a` and `b`, where its signs differ; the argument at which it was found to be least.

    It ends where the bracket is as narrow as `tolerance`, or where `f` is no more than its own rounding.

    Raises
    ------
    ValueError
        The signs do not differ.
    """
    fa, fb = f(a), f(b)
    if fa == 0.0 or fb == 0.0:
        return a if fa == 0.0 else b
    if (fa > 0.0) == (fb > 0.0):
        raise ValueError("no change of sign")
    c, fc, part = a, fa, 0.5
    noise, idle = DEFAULTS.noise * max(abs(fa), abs(fb)), 0
    best, least = (a, abs(fa)) if abs(fa) < abs(fb) else (b, abs(fb))
    for _ in range(100):
        t = a + part * (b - a)
        ft = f(t)
        idle = 0 if abs(ft) < 0.5 * least or least > noise else idle + 1
        if abs(ft) < least:
            best, least = t, abs(ft)
        if (ft > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, b, fc, fb = b, a, fb, fa
        a, fa = t, ft
        width = tolerance / max(abs(b - c), 1e-300)
        if fa == 0.0 or width > 0.5 or abs(b - a) <= tolerance or idle >= DEFAULTS.idle:
            return best
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        if phi**2 < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            part = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        else:
            part = 0.5
        part = min(max(part, width), 1.0 - width)
    return best


def turned_round(one: Floats, two: Floats, opposite: float) -> bool:
    """Whether two vectors point in opposite directions, to a cosine of `opposite`."""
    return float(one @ two) < -opposite * float(np.linalg.norm(one) * np.linalg.norm(two))


def doubling(m: NDArray[np.complex128]) -> float:
    """det(M + I)."""
    return float(math.prod((1.0 + m).tolist()).real)


def torus(m: NDArray[np.complex128]) -> float:
    """Product of lambda_i lambda_j - 1 over pairs: 0 for a complex pair on the unit circle, or a neutral saddle."""
    return math.prod((x * y - 1.0 for x, y in combinations(m.tolist(), 2)), start=1.0 + 0.0j).real


def _opposite(one: float, two: float, factors: Iterable[float]) -> bool:
    """Whether a test function has changed its sign, and not by rounding: of its factors, one may be none."""
    return one * two < 0.0 and max(abs(one), abs(two)) > DEFAULTS.neutral * math.prod(factors)


def smooth_bifurcations(bracket: Bracket) -> list[Bifurcation]:
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


def branch_point(bracket: Bracket) -> ContinuationPoint | None:
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
