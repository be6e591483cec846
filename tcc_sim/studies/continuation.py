"""Pseudo-arclength continuation of any curve of solutions, one equation fewer than unknowns.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977. Each step is Newton's method in
the plane at right angles to the tangent, from a predictor of second order. A step is halved where the corrector goes
far from the predictor, where the tangent turns by more than a set angle, or where the determinant of Jacobian and
tangent changes sign: there the curve has met another one, or the corrector has jumped to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from tcc_sim.studies.maps import FAILURES, Floats
from tcc_sim.studies.shooting import Linearised

TOLERANCE = 1e-9
ROUNDING = 1e-12
ITERATIONS = 8
NOISE = 1e-5
"""Newton steps below this may stop shrinking where rounding is amplified; the residual then decides."""

Height = Callable[[Floats], tuple[float, Floats]]
"""A further coordinate of the arclength at a point, with its gradient by the unknowns, both in natural sizes."""


class Equations(Protocol):
    """d equations in d + 1 scaled unknowns."""

    def linearise(self, z: Floats) -> Linearised:
        """Residual and Jacobian."""


class Point(NamedTuple):
    """A solution: unknowns (d + 1,), unit tangent, linearisation, and the sign of det [Jacobian; tangent]."""

    z: Floats
    tangent: Floats
    found: Linearised
    sign: float


class Corrected(NamedTuple):
    """What the corrector came to: a solution, how far it went from its guess, and the tangent's direction."""

    z: Floats
    found: Linearised
    tangent: Floats
    distance: float


def correct(equations: Equations, guess: Floats, row: Floats, height: tuple[Height, float, float] | None = None,
            tolerance: float = TOLERANCE) -> Corrected | None:
    """Newton from `guess` to the solution with row . (z - guess) = 0; None where it does not converge.

    height : a further coordinate, its weight in the plane's equation, and its value at the guess
    """
    z, last = guess.copy(), np.inf
    size = len(guess)
    matrix, sides = np.empty((size, size)), np.zeros((size, 2))
    for _ in range(ITERATIONS):
        try:
            found = equations.linearise(z)
            matrix[:-1], matrix[-1] = found.jacobian, row
            sides[:-1, 0], sides[-1, 0] = -found.residual, -float(row @ (z - guess))
            sides[-1, 1] = 1.0
            if height is not None:
                high, gradient = height[0](z)
                matrix[-1] += height[1] * gradient
                sides[-1, 0] -= height[1] * (high - height[2])
            solved = np.linalg.solve(matrix, sides)
        except FAILURES:
            return None
        step = solved[:, 0]
        length = float(np.abs(step).max())
        if not length < 10.0:
            return None
        z = z + step
        settled = length <= tolerance or (length <= NOISE and float(np.abs(found.residual).max()) <= ROUNDING)
        if settled:
            tangent = solved[:, 1]
            return Corrected(z, found, tangent / float(np.linalg.norm(tangent)), float(np.linalg.norm(z - guess)))
        if length > last:
            return None
        last = length
    return None


def tangent_of(found: Linearised, along: Floats) -> Floats:
    """The unit tangent of the curve on the side of `along`."""
    matrix = np.vstack([found.jacobian, along])
    side = np.zeros(len(along))
    side[-1] = 1.0
    t = np.linalg.solve(matrix, side)
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
            height: Height | None = None) -> tuple[Point, float] | None:
    """The next point along the curve and the length of its step; None where no step is short enough.

    before : the point before `here` and the step between them, for the curvature
    height : a further coordinate of the arclength, where the curve climbs much more in it than in the unknowns
    """
    climb = None
    if height is not None:
        try:
            high, gradient = height(here.z)
        except FAILURES:
            return None
        climb = high, float(gradient @ here.tangent)
    curved = before is not None and climb is None
    while stride.length >= stride.smallest:
        length = stride.length
        guess = here.z + length * here.tangent
        extra = None
        if climb is not None and height is not None:
            length = stride.length / float(np.hypot(1.0, climb[1]))
            guess = here.z + length * here.tangent
            extra = height, climb[1], climb[0] + length * climb[1]
        elif curved and before is not None:
            guess = guess + 0.5 * length**2 / before[1] * (here.tangent - before[0].tangent)
        found = correct(equations, guess, here.tangent, extra)
        if found is not None:
            tangent = found.tangent if float(found.tangent @ here.tangent) > 0.0 else -found.tangent
            new = point_at(found.z, found.found, tangent)
            turned = float(tangent @ here.tangent) < stride.turn
            jumped = new.sign != here.sign and stride.length > stride.branching
            if found.distance <= stride.farthest * length and not turned and not jumped:
                stride.length = stride.after(found.distance)
                return new, float(np.linalg.norm(new.z - here.z))
        stride.length *= 0.5
        curved = False
    return None
