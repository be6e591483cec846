"""Curves of bifurcations in two parameters: fold, period doubling, Neimark-Sacker, and the border of pure stick.

The orbit's equations are extended by one, which a bordered matrix gives: with A singular at the bifurcation, the last
component g of [A b; c 0] [v; g] = [0; 1] is 0 there and smooth (W. Govaerts, Numerical Methods for Bifurcations of
Dynamical Equilibria, SIAM 2000, Section 3.3). A is M - I for a fold, M + I for a doubling, and the bialternate product
2 M . M - I for Neimark-Sacker. Its gradient is taken by differences, which only steers Newton.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tcc_sim.continuation.newton import multipliers_of
from tcc_sim.continuation.palc import (
    Equations,
    Solution,
    StepSize,
    corrector,
    next_solution,
    null_direction,
    solution_at,
)
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import Linearised, ParameterRange, Shooting, product_of
from tcc_sim.continuation.special_points import Bifurcation

KINDS = ("fold", "period_doubling", "neimark_sacker", "stick_border")
"""What can be followed in two parameters."""
STEP, SHORTEST = 1e-6, 1e-10
"""Steps of differences, in natural sizes: the usual one, and the shortest."""
LINEAR = 1e-3
"""Change of g over such a step up to which it is linear enough."""
FORETOLD = 0.2
"""Error of a foretold g, relative to its value before, with which the gradient is kept."""
MOST_POINTS = 400
CLOSE = 1e-8
"""Last Newton step, in natural sizes, at which a bifurcation counts as found."""


@dataclass(frozen=True)
class Curve:
    """A curve of one kind of bifurcation: first and second parameter along it, and two sentences for its ends."""

    kind: str
    values: tuple[float, ...]
    second: tuple[float, ...]
    ended: tuple[str, str]


def bialternate(m: Floats) -> Floats:
    """2 M . M: its eigenvalues are the products of two different eigenvalues of M."""
    pairs = [(i, j) for i in range(len(m)) for j in range(i)]
    return np.array([[m[p, r] * m[q, s] - m[p, s] * m[q, r] for r, s in pairs] for p, q in pairs])


def singular(kind: str, blocks: Floats) -> Floats:
    """The matrix that is singular at this kind of bifurcation, of the derivatives (m, n, n) of the segments of an
    orbit.

    For a fold or a doubling it is that of x_(k+1) = M_k x_k and M_m x_m = +-x_1.
    """
    m, n = blocks.shape[:2]
    if kind == "neimark_sacker":
        b = bialternate(product_of(blocks))
        return b - np.eye(len(b))
    out = np.zeros((m * n, m * n))
    for k in range(m):
        rows, following = slice(k * n, k * n + n), (k + 1) % m
        out[rows, rows] = blocks[k]
        closing = kind == "period_doubling" and k + 1 == m
        out[rows, following * n:following * n + n] += np.eye(n) if closing else -np.eye(n)
    return out


class Defining:
    """The equations of a bifurcation in the orbit's nodes and two parameters."""

    rounding: ClassVar[float] = 1e-9
    exact: ClassVar[bool] = False

    def __init__(self, kind: str, shooting: Shooting, z: Floats) -> None:
        self.kind, self.shooting, self.settings = kind, shooting, shooting.settings
        self.b = self.c = np.empty(0)
        self._known: tuple[Floats, float, Floats] | None = None
        self.border(shooting.linearise(z))

    def border(self, found: Linearised) -> None:
        """Take the borders from the singular vectors at a point, the best there; their signs stay."""
        left, _, right = np.linalg.svd(singular(self.kind, found.blocks))
        b, c = left[:, -1], right[-1]
        keep = len(self.b) == len(b)
        self.b = -b if keep and float(b @ self.b) < 0.0 else b
        self.c = -c if keep and float(c @ self.c) < 0.0 else c
        self._known = None

    def test(self, found: Linearised) -> float:
        """g of the bordered system."""
        a = singular(self.kind, found.blocks)
        d = len(a)
        matrix = np.zeros((d + 1, d + 1))
        matrix[:d, :d], matrix[:d, d], matrix[d, :d] = a, self.b, self.c
        return float(np.linalg.solve(matrix, np.eye(d + 1)[d])[d])

    def linearise(self, z: Floats) -> Linearised:
        """The orbit's equations and g, with derivatives."""
        found = self.shooting.linearise(z)
        g = self.test(found)
        gradient = self._gradient(z, g)
        self._known = z.copy(), g, gradient
        # On a canard g passes from one sign to the other within rounding of z: how far z is from there counts.
        size = max(float(np.linalg.norm(gradient)), 1.0)
        return found._replace(residual=np.append(found.residual, g / size),
                              jacobian=np.vstack([found.jacobian, gradient / size]))

    def _gradient(self, z: Floats, g: float) -> Floats:
        """The gradient of g: that of the point before, corrected (C. G. Broyden, Math. Comp. 19, 1965), where it has
        foretold g well, and by differences elsewhere.
        """
        if self._known is not None:
            before, value, gradient = self._known
            way = z - before
            square, missed = float(way @ way), g - value - float(gradient @ way)
            if square > 0.0 and abs(missed) <= FORETOLD * abs(value):
                return gradient + missed / square * way
        return np.array([self._difference(z, g, k) for k in range(len(z))])

    def _difference(self, z: Floats, g: float, k: int) -> float:
        """Derivative of g by one unknown; with a shorter step where the first one changes g much, as on a canard."""
        out, size = 0.0, STEP
        for _ in range(2):
            step = np.zeros(len(z))
            step[k] = size
            try:
                change = self.test(self.shooting.linearise(z + step)) - g
            except FAILURES:
                change = g - self.test(self.shooting.linearise(z - step))
            out = change / size
            if abs(change) <= LINEAR:
                break
            size = max(size * LINEAR / abs(change), SHORTEST)
        return out


def locate(kind: str, shooting: Shooting, z: Floats) -> Floats | None:
    """Nodes and the one parameter of a bifurcation of this kind near `z`, by Newton; None where none is found."""
    try:
        defining = Defining(kind, shooting, z)
        for _ in range(15):
            found = defining.linearise(z)
            step = np.linalg.solve(found.jacobian, -found.residual)
            z = z + step
            if float(np.abs(step).max()) < CLOSE:
                left = float(np.abs(shooting.linearise(z).residual).max())
                return z if left <= shooting.settings.residual else None
    except FAILURES:
        return None
    return None


class Border:
    """One equation in two parameters: a margin that vanishes."""

    rounding: ClassVar[float] = 1e-12
    exact: ClassVar[bool] = True

    def __init__(self, margin: Callable[[float, float], float], ranges: tuple[ParameterRange, ParameterRange]) -> None:
        self.margin, self.ranges, self.settings = margin, ranges, DEFAULTS

    def linearise(self, z: Floats) -> Linearised:
        """The margin and its derivatives by central differences."""
        def at(p: Floats) -> float:
            return self.margin(self.ranges[0].value(float(p[0])), self.ranges[1].value(float(p[1])))

        gradient = np.empty((1, 2))
        for k in range(2):
            step = np.zeros(2)
            step[k] = STEP
            try:
                gradient[0, k] = (at(z + step) - at(z - step)) / (2.0 * STEP)
            except FAILURES:
                side = -1.0 if z[k] > 0.5 else 1.0
                gradient[0, k] = side * (at(z + side * step) - at(z)) / STEP
        return Linearised(np.array([at(z)]), gradient, np.zeros((0, 0)))


def trace(equations: Equations, z: Floats, forward: bool, inside: Callable[[Solution], bool], step_size: StepSize,
          bounds: tuple[tuple[int, float, float], ...], most: int = MOST_POINTS) -> tuple[list[Solution], str]:
    """Points of a curve from `z` one way until it leaves its bounds, each (index of an unknown, low, high).

    The last point lies on the bound. The second result says why it ended.
    """
    found = equations.linearise(z)
    tangent = null_direction(found)
    index = bounds[0][0]
    if (tangent[index] > 0.0) != forward:
        tangent = -tangent
    points = [solution_at(z, found, tangent)]
    while len(points) <= most:
        here = points[-1]
        for k, low, high in bounds:
            edge = high if here.tangent[k] > 0.0 else low
            room = edge - float(here.z[k])
            if abs(room) > abs(step_size.length * here.tangent[k]):
                continue
            row = np.zeros(len(here.z))
            row[k] = 1.0
            guess = here.z + room / float(here.tangent[k]) * here.tangent if room != 0.0 else here.z.copy()
            guess[k] = edge
            last = corrector(equations, guess, row)
            if last is not None and last.distance <= 0.5 * step_size.length + 1e-9:
                points.append(solution_at(last.z, last.found, here.tangent))
                return points, "reached the end of a range"
            step_size.length *= 0.5
        length = step_size.length
        new = next_solution(equations, here, points[:-1], step_size)
        if new is None:
            return points, "no further point was found"
        if any(not low <= new.z[k] <= high for k, low, high in bounds):
            step_size.length = 0.5 * min(length, step_size.length)
            if step_size.length < step_size.smallest:
                return points, "no further point was found"
            continue
        if not inside(new):
            return points, "the pair of multipliers on the unit circle became real"
        points.append(new)
        if isinstance(equations, Defining):
            equations.border(new.found)
    return points, f"stopped after {most} points"


def still_complex(point: Solution) -> bool:
    """Whether the pair of a Neimark-Sacker bifurcation is complex (real reciprocal ones are a neutral saddle)."""
    m = multipliers_of(*point.found.blocks)
    return bool(np.any((np.abs(m.imag) > 1e-9) & (np.abs(np.abs(m) - 1.0) < 1e-3)))


def bifurcation_curve(found: Bifurcation, of: ParameterMap, ranges: tuple[ParameterRange, ParameterRange],
                      second: float,
                      smallest: float = 1e-7, most: int = MOST_POINTS) -> Curve | None:
    """The curve of a located bifurcation in two parameters, both ways; None where it cannot be set up.

    of : the map with both parameters free
    second : present value of the second one
    smallest : step, in natural sizes, below which the curve is given up
    most : points either way
    """
    orbit = found.point.orbit
    shooting = replace(found.point.shooting, map=of, ranges=ranges)
    z = shooting.unknowns(orbit.nodes, (orbit.values[0], second))
    n = shooting.size
    bounds = ((n + 1, 0.0, 1.0), (n, 0.0, 1.0))
    inside = still_complex if found.kind == "neimark_sacker" else lambda _: True
    ways = []
    for forward in (True, False):
        try:
            ways.append(trace(Defining(found.kind, shooting, z), z, forward, inside, StepSize(smallest=smallest),
                              bounds,
                              most))
        except FAILURES:
            return None
    return _joined(found.kind, ways, ranges, n)


def border_curve(margin: Callable[[float, float], float], ranges: tuple[ParameterRange, ParameterRange], value: float,
                 second: float) -> Curve | None:
    """The curve of a margin that vanishes at (value, second), both ways; None where it cannot be set up."""
    border = Border(margin, ranges)
    z = np.array([ranges[0].scaled(value), ranges[1].scaled(second)])
    try:
        ways = [trace(border, z, forward, lambda _: True, StepSize(smallest=1e-7), ((1, 0.0, 1.0), (0, 0.0, 1.0)))
                for forward in (True, False)]
    except FAILURES:
        return None
    return _joined("stick_border", ways, ranges, 0)


def _joined(kind: str, ways: list[tuple[list[Solution], str]], ranges: tuple[ParameterRange, ParameterRange],
            n: int) -> Curve:
    """One curve of its two ways from the start."""
    (ahead, last), (behind, first) = ways
    points = behind[:0:-1] + ahead
    return Curve(kind, tuple(ranges[0].value(float(p.z[n])) for p in points),
                 tuple(ranges[1].value(float(p.z[n + 1])) for p in points), (first, last))
