"""Pseudo-arclength continuation of any curve of solutions, with one equation fewer than unknowns, and its brackets.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977. Each step is Newton's method in
the plane at right angles to the tangent, from a polynomial predictor. The largest sizes of the motion (amplitudes) are
coordinates of the arclength beside the unknowns: they measure steps where a motion grows while its section hardly
moves. T. R. Chandrupatla's bracketing method (Adv. Eng. Softw. 28, 1997) finds roots of test functions between two
points of a curve to rounding, with a corrector in every evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.result import Described
from tcc_sim.study.continuation.problem import FAILURES, Floats
from tcc_sim.study.continuation.shooting import Linearised, ParameterRange, Settings

CORRECT_ITERATIONS = 8  # most steps
CORRECT_STEP = 10.0  # step above which the corrector fails
SQUARED = 1e-5  # step below which the error is its square, so that the residual before it decides too
SLOWEST = 0.7  # share of the last step above which the corrector fails: a shorter predictor costs less


class Equations(Protocol):
    """d equations in d + 1 scaled unknowns; below a residual of `rounding` no Newton step helps."""

    rounding: ClassVar[float]

    @property
    def settings(self) -> Settings:
        """Tolerances of the corrector."""

    @property
    def ranges(self) -> tuple[ParameterRange, ...]:
        """The free parameters."""

    @property
    def size(self) -> int:
        """Number of unknowns before the parameters."""

    def outer(self, vector: Floats) -> Floats:
        """The unknowns that do not depend on the segments: the first node, and those that are no nodes."""

    def linearise(self, z: Floats) -> Linearised:
        """Residual and Jacobian."""


class Solution(NamedTuple):
    """A solution: unknowns (d + 1,), unit tangent, linearisation, and the sign of det [Jacobian; tangent]."""

    z: Floats
    tangent: Floats
    linearised: Linearised
    sign: float


class Corrected(NamedTuple):
    """Result of the corrector.

    z, linearised, tangent : a solution, the last linearisation and the tangent's direction
    distance : from the guess, with the amplitudes where they are coordinates
    slopes : change of the amplitudes along the tangent
    contraction : Newton's second step over the first one
    """

    z: Floats
    linearised: Linearised
    tangent: Floats
    distance: float
    slopes: Floats
    contraction: float

    def facing(self, way: Floats) -> Solution:
        """The solution with the one of its two tangents that points along `way`."""
        return solution_at(self.z, self.linearised, self.tangent if float(self.tangent @ way) > 0.0 else -self.tangent)


FLAT = (np.empty(0), np.empty(0))
"""No amplitudes as coordinates of the arclength."""


def corrector(equations: Equations, guess: Floats, row: Floats, plane: tuple[Floats, Floats] = FLAT,
              start: Floats | None = None, farthest: float = math.inf) -> Corrected | None:
    """Newton to the solution with row . (z - guess) + weights . (amplitudes - those at the guess) = 0, from `start`.

    It starts at the guess by default. None where it does not converge or a step is longer than `farthest`.

    plane : weights (N,) of the amplitudes, and their values (N,) at the guess
    """
    weights, known = plane
    z, last, away = guess.copy() if start is None else start.copy(), np.inf, 0.0
    contraction, settings = 0.0, equations.settings
    size, by_amplitude = len(guess), len(weights) > 0
    matrix, sides = np.empty((size, size)), np.zeros((size, 2))
    sides[-1, 1] = 1.0
    for _ in range(CORRECT_ITERATIONS):
        try:
            linearised = equations.linearise(z)
            matrix[:-1], matrix[-1] = linearised.jacobian, row
            sides[:-1, 0], sides[-1, 0] = -linearised.residual, -float(row @ (z - guess))
            if by_amplitude:
                if len(linearised.amplitudes) != len(known):
                    return None
                matrix[-1] += weights @ linearised.amplitude_gradient
                apart = linearised.amplitudes - known
                sides[-1, 0] -= float(weights @ apart)
                away = math.sqrt(apart @ apart)
            solved: Any = np.linalg.solve(matrix, sides)
        except FAILURES:
            return None
        step = solved[:, 0]
        length, left = (float(np.maximum.reduce(np.abs(x))) for x in (step, linearised.residual))
        if not length < min(farthest, CORRECT_STEP):
            return None
        z = z + step
        if (length <= settings.correct_tolerance and left <= settings.residual) or (
                length <= SQUARED and left <= equations.rounding):
            tangent: Floats = np.ascontiguousarray(solved[:, 1])
            tangent = tangent / math.sqrt(tangent @ tangent)
            slopes = linearised.amplitude_gradient @ tangent if by_amplitude else weights
            way = z - guess
            return Corrected(z, linearised, tangent, float(np.hypot(math.sqrt(way @ way), away)), slopes, contraction)
        if length > (SLOWEST if length > SQUARED else 1.0) * last:
            return None
        contraction = contraction or (length / last if last < np.inf else 0.0)
        last = length
    return None


def over_border(here: Solution, new: Solution) -> bool:
    """Whether the event sequence differs between two solutions."""
    return here.linearised.seen.events != new.linearised.seen.events


def oriented(solution: Solution, sign: float) -> Solution:
    """The solution with the tangent for which det [Jacobian; tangent] has this sign.

    Where the event sequence changes, the Jacobians of a continuous map on both sides differ by c n^T, with n normal to
    the border, so det [Jacobian; n] is the same: a branch with tangents of one orientation crosses the border,
    whichever way its parameter goes there. M. di Bernardo, C. J. Budd, A. R. Champneys, P. Kowalczyk, Piecewise-smooth
    Dynamical Systems, Springer 2008, Section 3.1.
    """
    if solution.sign == sign:
        return solution
    return solution._replace(tangent=-solution.tangent, sign=-solution.sign)


def tangent_of(linearised: Linearised, along: Floats) -> Floats:
    """The unit tangent of the curve that points along `along`."""
    side = np.zeros(len(along))
    side[-1] = 1.0
    t = np.linalg.solve(np.vstack([linearised.jacobian, along]), side)
    return np.asarray(t / float(np.linalg.norm(t)))


def null_direction(linearised: Linearised) -> Floats:
    """A unit vector that the Jacobian maps to zero."""
    return np.asarray(np.linalg.svd(linearised.jacobian)[2][-1])


def solution_at(z: Floats, linearised: Linearised, tangent: Floats) -> Solution:
    """The solution at a point, with the sign of its determinant."""
    matrix = np.empty((len(z), len(z)))
    matrix[:-1], matrix[-1] = linearised.jacobian, tangent
    return Solution(z, tangent, linearised, float(np.sign(np.linalg.det(matrix))))


def cosine_between(here: Solution, new: Solution, by_amplitude: bool) -> float:
    """Cosine between the chord from one point to the next and the tangent there."""
    # Along a curve that bends little the chord lies between both tangents; else the corrector has left the curve.
    way, along = new.z - here.z, new.tangent
    if by_amplitude:
        way = np.concatenate([way, new.linearised.amplitudes - here.linearised.amplitudes])
        along = np.concatenate([along, new.linearised.amplitude_gradient @ new.tangent])
    return float(way @ along) / max(float(np.sqrt((way @ way) * (along @ along))), 1e-300)


def predictor_nodes(here: Solution, before: Sequence[Solution], slopes: Floats,
                    count: int) -> list[tuple[float, Floats]]:
    """Nodes of the predictor: the distance of each along the tangent, and its unknowns and amplitudes less those here.

    The first two are `here` itself; the second one holds the tangent.
    """
    size, used = len(here.z), len(slopes)
    nodes = [(0.0, np.zeros(size + used)), (0.0, np.concatenate([here.tangent, slopes]) / (1.0 + slopes @ slopes))]
    for point in before[:-count - 1:-1]:
        if len(point.z) != size or (used and len(point.linearised.amplitudes) != used):
            break
        away = np.concatenate([point.z - here.z, point.linearised.amplitudes[:used]
                               - here.linearised.amplitudes[:used]])
        at = float(here.tangent @ away[:size] + slopes @ away[size:])
        if not at < nodes[-1][0]:
            break
        nodes.append((at, away))
    return nodes


def predictor(nodes: list[tuple[float, Floats]], at: float) -> Floats:
    """The polynomial through nodes at a distance, by divided differences; a second node at one place is its slope."""
    places, column = [place for place, _ in nodes], [value for _, value in nodes]
    slope = column[1] if places[0] == places[1] else None
    if slope is not None:
        column[1] = column[0]
    out, product = column[0], 1.0
    for order in range(1, len(nodes)):
        column = [slope if slope is not None and order == 1 and k == 0 else
                  (column[k + 1] - column[k]) / (places[k + order] - places[k]) for k in range(len(nodes) - order)]
        product *= at - places[order - 1]
        out = out + product * column[0]
    return out


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
