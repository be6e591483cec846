"""Pseudo-arclength continuation of any curve of solutions, one equation fewer than unknowns.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977. Each step is Newton's method in
the plane at right angles to the tangent, from a predictor of second order. A step is halved where the corrector goes
far from the predictor, where the tangent turns by more than a set angle, or where the determinant of Jacobian and
tangent changes sign: there the curve has met another one, or the corrector has jumped to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from tcc_sim.studies.maps import FAILURES, Floats
from tcc_sim.studies.shooting import Linearised

TOLERANCE = 1e-9
ITERATIONS = 8
NOISE = 1e-5
"""Newton steps below this may stop shrinking where rounding is amplified; the residual then decides."""

NO_CLIMB = np.empty(0)
Heights = Callable[[Floats], tuple[Floats, Floats]]
"""Further coordinates (k,) of the arclength at a point, with their gradients (k, d + 1), in natural sizes."""


class Equations(Protocol):
    """d equations in d + 1 scaled unknowns; `rounding` is the residual below which no Newton step is worth taking."""

    rounding: ClassVar[float]

    def linearise(self, z: Floats) -> Linearised:
        """Residual and Jacobian."""


class Point(NamedTuple):
    """A solution: unknowns (d + 1,), unit tangent, linearisation, and the sign of det [Jacobian; tangent]."""

    z: Floats
    tangent: Floats
    found: Linearised
    sign: float


class Corrected(NamedTuple):
    """What the corrector came to: a solution, the tangent's direction, how far it went from its guess (with the further
    coordinates, where there are any), and how these climb along the tangent.
    """

    z: Floats
    found: Linearised
    tangent: Floats
    distance: float
    climb: Floats


def correct(equations: Equations, guess: Floats, row: Floats, heights: tuple[Heights, Floats, Floats] | None = None,
            tolerance: float = TOLERANCE) -> Corrected | None:
    """Newton from `guess` to the solution with row . (z - guess) = 0; None where it does not converge.

    heights : further coordinates, their weights in the plane's equation, and their values at the guess
    """
    z, last, climb, away = guess.copy(), np.inf, NO_CLIMB, 0.0
    size = len(guess)
    matrix, sides = np.empty((size, size)), np.zeros((size, 2))
    for _ in range(ITERATIONS):
        try:
            found = equations.linearise(z)
            matrix[:-1], matrix[-1] = found.jacobian, row
            sides[:-1, 0], sides[-1, 0] = -found.residual, -float(row @ (z - guess))
            sides[-1, 1] = 1.0
            if heights is not None:
                high, gradient = heights[0](z)
                matrix[-1] += heights[1] @ gradient
                sides[-1, 0] -= float(heights[1] @ (high - heights[2]))
                away = float(np.linalg.norm(high - heights[2]))
            solved: Any = np.linalg.solve(matrix, sides)
        except FAILURES:
            return None
        step = solved[:, 0]
        length = float(np.abs(step).max())
        if not length < 10.0:
            return None
        z = z + step
        settled = length <= tolerance or (length <= NOISE and float(np.abs(found.residual).max()) <= equations.rounding)
        if settled:
            tangent: Floats = solved[:, 1] / float(np.linalg.norm(solved[:, 1]))
            if heights is not None:
                climb = gradient @ tangent
            return Corrected(z, found, tangent, float(np.hypot(np.linalg.norm(z - guess), away)), climb)
        if length > last:
            return None
        last = length
    return None


def tangent_of(found: Linearised, along: Floats) -> Floats:
    """The unit tangent of the curve on the side of `along`."""
    side = np.zeros(len(along))
    side[-1] = 1.0
    t: Any = np.linalg.solve(np.vstack([found.jacobian, along]), side)
    out: Floats = t / float(np.linalg.norm(t))
    return out


def null_direction(found: Linearised) -> Floats:
    """A unit vector that the Jacobian maps to 0."""
    out: Floats = np.linalg.svd(found.jacobian)[2][-1]
    return out


def point_at(z: Floats, found: Linearised, tangent: Floats) -> Point:
    """A point with the sign of its determinant."""
    return Point(z, tangent, found, float(np.sign(np.linalg.det(np.vstack([found.jacobian, tangent])))))


@dataclass
class Stride:
    """The step length of a walk and what bounds it; lengths are in natural sizes.

    wanted : distance between predictor and corrector that is aimed at
    farthest : the same, relative to the step, above which a step is refused
    turn : smallest cosine between neighbouring tangents
    """

    length: float = 0.01
    smallest: float = 1e-9
    largest: float = 0.1
    wanted: float = 2e-3
    farthest: float = 0.3
    turn: float = 0.9
    branching: float = 1e-4
    """A change of the determinant's sign is believed in steps this short."""

    def after(self, distance: float) -> float:
        """The next length after a step whose corrector went `distance`."""
        factor = 2.0 if distance <= 0.0 else (self.wanted / distance) ** (1.0 / 3.0)
        return min(self.length * min(max(factor, 0.5), 2.0), self.largest)


def advance(equations: Equations, here: Point, before: tuple[Point, float] | None, stride: Stride,
            heights: Heights | None = None) -> tuple[Point, float] | None:
    """The next point along the curve and the length of its step; None where no step is short enough.

    before : the point before `here` and the step between them, for the curvature
    heights : further coordinates of the arclength, where the curve climbs much more in them than in the unknowns
    """
    climb = NO_CLIMB
    high = NO_CLIMB
    if heights is not None:
        try:
            high, gradient = heights(here.z)
        except FAILURES:
            return None
        climb = gradient @ here.tangent
    reach = float(np.sqrt(1.0 + climb @ climb))
    curved = before is not None and heights is None
    while stride.length >= stride.smallest:
        length = stride.length / reach
        guess = here.z + length * here.tangent
        if curved and before is not None:
            guess = guess + 0.5 * length**2 / before[1] * (here.tangent - before[0].tangent)
        extra = None if heights is None else (heights, climb, high + length * climb)
        found = correct(equations, guess, here.tangent, extra)
        if found is not None:
            along = float(found.tangent @ here.tangent + found.climb @ climb)
            tangent = found.tangent if along > 0.0 else -found.tangent
            new = point_at(found.z, found.found, tangent)
            turned = abs(along) < stride.turn * reach * float(np.sqrt(1.0 + found.climb @ found.climb))
            jumped = new.sign != here.sign and stride.length > stride.branching
            if found.distance <= stride.farthest * stride.length and not turned and not jumped:
                stride.length = stride.after(found.distance)
                return new, float(np.linalg.norm(new.z - here.z))
        stride.length *= 0.5
        curved = False
    return None
