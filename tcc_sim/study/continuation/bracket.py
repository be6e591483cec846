"""The piece of a curve between two of its points, and roots of test functions along it.

T. R. Chandrupatla's bracketing method (Adv. Eng. Softw. 28, 1997) finds a root to rounding, with a corrector in every
evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.result import Described
from tcc_sim.study.continuation.palc import FLAT, Equations, Solution, corrector, oriented
from tcc_sim.study.continuation.problem import Floats

ROOT = 1e-13  # width of a bracket, relative to the step, of a root
ENOUGH = 1e-11  # residual of a root, however wide the bracket is
NOISE = 1e-6  # part of the larger end value below which a test may be rounding
IDLE = 2  # evaluations in a row that may then fail to halve the least one: a narrower bracket is noise
FORWARD = 0.1  # least cosine between tangent and chord of a cubic through the ends of a bracket
OPPOSITE = 0.8  # cosine, but for its sign, above which the halves of two orbits are opposite


@dataclass(frozen=True, repr=False)
class CurvePoint(Described):
    """A point of a curve: unknowns and tangent, and the equations they belong to."""

    solution: Solution
    equations: Equations
    by_amplitude: bool = field(default=True, kw_only=True)
    """Whether the amplitudes were coordinates of the arclength on the step to this point."""

    def moved(self: P, solution: Solution, by_amplitude: bool = True) -> P:
        """The point of another solution of the same equations."""
        return replace(self, solution=solution, by_amplitude=by_amplitude)

    def turned(self: P) -> P:
        """The point with its tangent reversed."""
        return replace(self, solution=oriented(self.solution, -self.solution.sign))


P = TypeVar("P", bound=CurvePoint)
"""Kind of point of a curve."""


@dataclass(frozen=True)
class Bracket(Generic[P]):
    """The piece of a curve between two points of the same equations."""

    a: P
    b: P
    by_amplitude: bool = True
    """Whether the amplitudes are coordinates of the arclength, as they were on the step from a to b."""

    kept: dict[float, P] = field(default_factory=dict, compare=False, repr=False)
    """Solved points, by their part of the chord."""

    def at(self, part: float) -> P | None:
        """The point at `part` (0 to 1) of the chord; None where the corrector fails."""
        p, q = self.a.solution, self.b.solution
        chord = q.z - p.z
        length = float(np.linalg.norm(chord))
        if part in (0.0, 1.0) or length == 0.0:
            return self.b if part == 1.0 else self.a
        if part in self.kept:
            return self.kept[part]
        start, plane, low, high = None, FLAT, p.linearised.amplitudes, q.linearised.amplitudes
        if self.by_amplitude and len(low) and len(low) == len(high):
            guess, plane = p.z + part * chord, ((high - low) / length, low + part * (high - low))
            start = self._start(part, chord / length, plane[0])
        else:
            guess = _hermite(p.z, q.z, p.tangent * length, q.tangent * length, part)
        corrected = corrector(self.a.equations, guess, chord / length, plane, start=start)
        if corrected is None:
            return None
        self.kept[part] = self.a.moved(corrected.facing(p.tangent + q.tangent))
        return self.kept[part]

    def _start(self, part: float, row: Floats, weights: Floats) -> Floats | None:
        """The cubic through the known points about `part`, with tangents; None where a tangent points backwards."""
        known = {0.0: self.a, 1.0: self.b, **self.kept}
        low, high = max(k for k in known if k < part), min(k for k in known if k > part)
        length = float(np.linalg.norm(self.b.solution.z - self.a.solution.z))
        whole, slopes = length * (1.0 + float(weights @ weights)), []
        for point in (known[low], known[high]):
            tangent = point.solution.tangent
            along = float(row @ tangent + weights @ (point.solution.linearised.amplitude_gradient @ tangent))
            if not along > FORWARD * float(np.sqrt(1.0 + weights @ weights)):
                return None
            slopes.append(tangent * (whole / along * (high - low)))
        return _hermite(known[low].solution.z, known[high].solution.z, slopes[0], slopes[1],
                        (part - low) / (high - low))

    def locate(self, test: Callable[[P], float],
             residual: Callable[[P], float] | None = None) -> P | None:
        """The point where `test` changes sign; None where it does not, or where the corrector fails.

        residual : of the bifurcation; the search ends where it is small enough
        """
        def value(part: float) -> float:
            point = self.at(part)
            if point is None:
                raise NumericalFailure("the branch is lost between two of its points")
            return 0.0 if residual is not None and residual(point) <= ENOUGH else test(point)

        try:
            return self.at(chandrupatla(value, 0.0, 1.0))
        except SameSign:
            return None
        except NumericalFailure:
            return replace(self, by_amplitude=False, kept={}).locate(test, residual) if self.by_amplitude else None


def _hermite(p: Floats, q: Floats, dp: Floats, dq: Floats, t: float) -> Floats:
    """The cubic through p and q with derivatives dp and dq, at t from 0 to 1."""
    s = 1.0 - t
    return s * s * (1.0 + 2.0 * t) * p + t * s * s * dp + t * t * (3.0 - 2.0 * t) * q - t * t * s * dq


class SameSign(ArithmeticError):
    """A function has the same sign at both ends of a bracket."""


def chandrupatla(f: Callable[[float], float], a: float, b: float, tolerance: float = ROOT) -> float:
    """A root of `f` between `a` and `b`, where its signs differ: the argument at which it was least.

    The search ends where the bracket is as narrow as `tolerance`, or where `f` is only rounding.

    Raises
    ------
    SameSign
        The signs do not differ.
    """
    fa, fb = f(a), f(b)
    if fa == 0.0 or fb == 0.0:
        return a if fa == 0.0 else b
    if (fa > 0.0) == (fb > 0.0):
        raise SameSign("no change of sign")
    c, fc, part = a, fa, 0.5
    noise, idle = NOISE * max(abs(fa), abs(fb)), 0
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
        if fa == 0.0 or width > 0.5 or abs(b - a) <= tolerance or idle >= IDLE:
            return best
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        if phi**2 < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            part = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        else:
            part = 0.5
        part = min(max(part, width), 1.0 - width)
    return best


def turned_round(one: Floats, two: Floats, opposite: float) -> bool:
    """Whether two vectors are opposite: the cosine between them is below -`opposite`."""
    return float(one @ two) < -opposite * float(np.linalg.norm(one) * np.linalg.norm(two))
