"""Bordered systems: an orbit's equations and further scalars that vanish, solved by one Newton method.

The scalar of a smooth bifurcation comes from a bordered matrix. The derivatives M_k of the segments of an orbit make
L(mu) x = (M_1 x_1 - x_2, ..., M_m x_m - mu x_1), which is singular where mu is a multiplier: mu = 1 at a fold, -1 at a
doubling, exp(i theta) with theta as a further unknown at a Neimark-Sacker bifurcation. With A = L(mu) singular, g of
[A b; c 0] [v; g] = [0; 1] is 0 and smooth there, and its gradient is -w A_z v with w from the transposed system
(W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, Section 3.3; Yu. A. Kuznetsov,
Elements of Applied Bifurcation Theory, Section 10.7). Second derivatives are symmetric, so one difference of the
Jacobian along v gives all of w A_z v. At a branch point A is the Jacobian itself, with two borders. The scalar of a
change of the event sequence is the margin that vanishes there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.multipliers import multipliers_of
from tcc_sim.study.continuation.newton import NEWTON_PARTS
from tcc_sim.study.continuation.problem import FAILURES, MARGINS, Floats, Margin, Margins, differ
from tcc_sim.study.continuation.shooting import Linearised, Shooting, layout

LOCATED = 1e-8  # last Newton step of a bifurcation
BORDER = 1e-12  # margin, relative to its natural size, of a solution
BORDER_RESIDUAL = 1e-11  # residual of the orbit there
BORDER_HALVINGS = (24, 20, 0)  # bisections before Newton's method; further ones after it fails
BORDER_ITERATIONS = 40  # most steps of Newton's method on a bordered system
BORDER_LEFT = 0.1  # share of the margin that a Newton step leaves, to stay on the side that has one
# Distance from the border below which it is not resolved because the margin changes very fast, on canards; the
# distance is the residual then.
BORDER_FINEST = 1e-12
CURVE_STEP = 0.03  # longest step, for pictures
CURVE_REGROWTH = 2.0  # `regrowth` along a curve
CURVE_TOLERANCE = 1e-8  # last step and residual of a point
# Step along null vectors of length one for first derivatives of the Jacobian. Beside canards motions bend within
# 1e-7, and the Jacobian's noise is some 1e-14: by halving, the derivative is good to four digits in both cases.
DIFFERENCE = 1e-8

Vectors = NDArray[Any]
"""Real or complex, (m, n): one for every segment."""


class Bordered:
    """An orbit's equations and further ones, as many as unknowns.

    shooting : the equations of the orbit
    left : share of the further residuals that a Newton step leaves, so as to stay on one side of a border
    finest : Newton step below which a point is a solution
    """

    shooting: Shooting
    finest: float
    left: float = 0.0

    def linearise(self, u: Floats) -> Linearised:
        """Residual and Jacobian; the orbit's equations come first."""
        raise NotImplementedError

    def solved(self, u: Floats, reach: float = np.inf) -> tuple[Floats, Linearised, float] | None:
        """The solution near `u`, the linearisation beside it, and its error (last step, or residual of the scalar).

        The method returns None if Newton's method fails or goes further than `reach`.
        """
        size, start = self.shooting.size, u
        try:
            linearised = self.linearise(u)
            for _ in range(BORDER_ITERATIONS):
                value = float(np.abs(linearised.residual[size:]).max())
                if value <= BORDER and float(np.abs(linearised.residual).max()) <= BORDER_RESIDUAL:
                    return u, linearised, value
                aim = -linearised.residual
                if value > BORDER:
                    aim[size:] *= 1.0 - self.left
                step: Any = np.linalg.solve(linearised.jacobian, aim)
                length = float(np.linalg.norm(step))
                if length <= self.finest and value > BORDER:
                    return u + step, linearised, length
                new = None
                for part in NEWTON_PARTS:
                    try:
                        new = self.linearise(u + part * step)
                    except FAILURES:
                        continue
                    if float(np.abs(new.residual[size:]).max()) <= 2.0 * value + BORDER:
                        break
                else:
                    return None
                u, linearised = u + part * step, new
                if float(np.linalg.norm(u - start)) > reach:
                    return None
        except FAILURES:
            return None
        return None


def cyclic(blocks: Floats, mu: complex) -> Vectors:
    """L(mu) of the segments' derivatives (m, n, n)."""
    m, n = blocks.shape[:2]
    out = np.zeros((m * n, m * n), dtype=np.complex128 if np.imag(mu) else np.float64)
    for k in range(m):
        rows, following = slice(k * n, k * n + n), (k + 1) % m
        out[rows, rows] = blocks[k]
        out[rows, following * n:following * n + n] -= np.eye(n) * (mu if k + 1 == m else 1.0)
    return out


def bordered(a: Vectors, b: Vectors, c: Vectors) -> tuple[Vectors, Vectors, Vectors]:
    """v (k, q), w (d,) and g (k,) of [A b; c 0] [v; g] = [0; I] and of the transposed system; A (d, q), c (k, q)."""
    d, q = a.shape
    matrix = np.zeros((q + 1, q + 1), dtype=a.dtype)
    matrix[:d, :q], matrix[:d, q], matrix[d:, :q] = a, b, c
    unit = np.eye(q + 1)
    right, left = np.linalg.solve(matrix, unit[:, d:]), np.linalg.solve(matrix.T, unit[q])
    return right[:q].T, left[:d], right[q]


class MinimallyAugmented(Bordered):
    """An orbit and the scalar g of a fold, a doubling or a Neimark-Sacker bifurcation, whose angle is an unknown.

    One free parameter makes it a system with as many equations as unknowns, two make it a curve.
    """

    rounding: ClassVar[float] = 1e-9

    def __init__(self, kind: str, shooting: Shooting, z: Floats) -> None:
        self.kind, self.shooting = kind, shooting
        # Differences leave a larger residual of g than of the orbit, and so does rounding on a canard.
        given = shooting.settings
        self.settings = replace(given, correct_tolerance=CURVE_TOLERANCE, residual=CURVE_TOLERANCE,
                                regrowth=CURVE_REGROWTH, largest_step=min(given.largest_step, CURVE_STEP))
        self.ranges, self.size = shooting.ranges, shooting.size
        self.outer = shooting.outer
        self.turning, self.unknowns = kind == "neimark_sacker", shooting.size + len(shooting.ranges)
        # The period of a fold may halve, in a generalised doubling.
        self.doubled = kind == "fold" and shooting.period % (2 * shooting.map.forcing_period) == 0
        self.finest, self.bend = LOCATED, 0.0
        """Last Newton step of a solution, and by how much the segments' derivatives change along the null vector."""
        linearised = shooting.linearise(z)
        self.start = z
        if self.turning:  # The argument of the complex pair of multipliers nearest to the unit circle.
            pairs = [m for m in multipliers_of(*linearised.blocks).tolist() if m.imag > 1e-9]
            if not pairs:
                raise ArithmeticError("there is no complex pair of multipliers")
            self.start = np.append(z, np.angle(min(pairs, key=lambda m: abs(abs(m) - 1.0))))
        left, _, right = np.linalg.svd(cyclic(linearised.blocks, self.multiplier(self.start)))
        self.b, self.c = left[:, -1], right[-1]

    def between_halves(self, u: Floats) -> Floats:
        """Distance between the starts of the orbit's halves, in natural sizes."""
        of, z = self.shooting.map, u[:self.unknowns]
        x, half = self.shooting.nodes(z)[0], self.shooting.period // 2
        return np.asarray((of.evaluate(x, self.shooting.values(z), 0, half).value - x) / of.scales)

    def multiplier(self, u: Floats) -> complex:
        """The multiplier on the unit circle."""
        if self.turning:
            return complex(np.exp(1j * u[-1]))
        return 1.0 if self.kind == "fold" else -1.0

    def null_vectors(self, blocks: Floats, mu: complex) -> tuple[Vectors, Vectors, complex]:
        """v and w (m, n) of the bordered systems, and g."""
        v, w, g = bordered(cyclic(blocks, mu), self.b, self.c[None])
        return v[0].reshape(blocks.shape[:2]), w.reshape(blocks.shape[:2]), g[0]

    def update_borders(self, u: Floats, linearised: Linearised, like: MinimallyAugmented | None = None) -> None:
        """Set the borders to the null vectors at a point, the best ones there.

        like : equations in other segments, whose signs they take; first nodes and last residuals are the same
        """
        v, w, _ = self.null_vectors(linearised.blocks, self.multiplier(u))
        n, signs = self.shooting.map.dimension, (1.0, 1.0)
        if like is not None and not self.turning:
            signs = (-1.0 if float(w[-1] @ like.b[-n:]) < 0.0 else 1.0, -1.0 if float(v[0] @ like.c[:n]) < 0.0 else 1.0)
        self.b, self.c = (sign * x.conj().ravel() / np.linalg.norm(x) for sign, x in zip(signs, (w, v)))

    def linearise(self, u: Floats, longer: float = 1.0) -> Linearised:
        """The orbit's equations and g, with derivatives.

        longer : the step of their differences, relative to the usual one
        """
        z, mu = u[:self.unknowns], self.multiplier(u)
        linearised = self.shooting.linearise(z)
        v, w, g = self.null_vectors(linearised.blocks, mu)
        parts: list[tuple[complex, Floats]] = [(1.0, v.real), (1j, v.imag)] if self.turning else [(1.0, v)]
        gradient = -sum(factor * self._along(z, linearised, part, w, longer) for factor, part in parts)
        if self.turning:
            gradient = np.append(gradient, 1j * mu * (w[-1] @ v[0]))
        rows = np.array([gradient.real, gradient.imag] if self.turning else [gradient])
        values = np.array([np.real(g), np.imag(g)] if self.turning else [g])
        # On a canard g changes its sign within the rounding of z, so the residual is the distance of z from there.
        size = max(float(np.linalg.norm(gradient)), 1.0)
        orbit = np.pad(linearised.jacobian, ((0, 0), (0, 1))) if self.turning else linearised.jacobian
        return Linearised(np.append(linearised.residual, values / size), np.vstack([orbit, rows / size]),
                          linearised.blocks, linearised.seen)

    def _along(self, z: Floats, linearised: Linearised, direction: Floats, w: Vectors, longer: float) -> Vectors:
        """w . (derivative of the Jacobian along a change of the nodes), by the nodes and the parameters."""
        size, step = self.shooting.size, longer * DIFFERENCE
        away = np.zeros(len(z))
        away[:size] = step * direction.ravel()
        try:
            changed = self.shooting.linearise(z + away)
        except FAILURES:  # The map ends there.
            changed, step = self.shooting.linearise(z - away), -step
        blocks = (changed.blocks - linearised.blocks) / step
        self.bend = float(np.abs(blocks).max() / max(np.linalg.norm(direction), 1e-300))
        parameters = (changed.jacobian[:, size:] - linearised.jacobian[:, size:]) / step
        return np.concatenate([np.einsum("ki,kij->kj", w, blocks).ravel(), w.ravel() @ parameters])


class BranchPoint(Bordered):
    """A point where two branches cross: G + beta b = 0 and two scalars, as the Jacobian has one rank less there."""

    def __init__(self, shooting: Shooting, z: Floats) -> None:
        self.shooting, self.finest, self.start = shooting, LOCATED, np.append(z, 0.0)
        left, _, right = np.linalg.svd(shooting.linearise(z).jacobian)
        self.b, self.c = left[:, -1], right[-2:]

    def linearise(self, u: Floats) -> Linearised:
        """The equations in the orbit's unknowns and beta; their derivatives by differences."""
        linearised, step = self.shooting.linearise(u[:-1]), DIFFERENCE
        v, w, g = bordered(linearised.jacobian, self.b, self.c)
        changes = [(self.shooting.linearise(u[:-1] + step * x).jacobian - linearised.jacobian) / step for x in v]
        rows = np.array([-w @ change for change in changes])
        jacobian = np.block([[linearised.jacobian, self.b[:, None]], [rows, np.zeros((2, 1))]])
        return linearised._replace(residual=np.append(linearised.residual + u[-1] * self.b, g), jacobian=jacobian)


class VanishingMargin(Bordered):
    """An orbit and the margin that vanishes where its event sequence changes.

    It is regular up to the border, from the side on which the margin is defined.
    """

    def __init__(self, shooting: Shooting, kind: str) -> None:
        self.shooting, self.name, self.events = shooting, MARGINS[kind], ""
        self.left = 0.0 if self.name == "arrival" else BORDER_LEFT
        self.finest = BORDER_FINEST

    def linearise(self, z: Floats) -> Linearised:
        """The orbit's equations and the margin; ArithmeticError beyond the border."""
        linearised = self.shooting.linearise(z)
        if self.left:
            self.events = self.events or linearised.seen.events
            if differ(linearised.seen.events, self.events):
                raise ArithmeticError("the event sequence has changed")
        margin = nearest_margins(self.shooting, z).get(self.name)
        if margin is None:
            raise ArithmeticError("the motion has no such margin")
        return linearised._replace(residual=np.append(linearised.residual, margin.value),
                                   jacobian=np.vstack([linearised.jacobian, margin.slopes]))


def nearest_margins(shooting: Shooting, z: Floats) -> Margins:
    """The margins of an orbit that are least in size over all segments, with derivatives by the scaled unknowns."""
    nodes, values, n, size = shooting.nodes(z), shooting.values(z), shooting.map.dimension, shooting.size
    out: dict[str, Margin] = {}
    for k, (first, length) in enumerate(zip(layout(shooting.segments, n)[0], shooting.segments)):
        for name, margins in shooting.map.margins(nodes[k], values, first, length).items():
            if name not in out or abs(margins.value) < abs(out[name].value):
                slopes = np.zeros(len(z))
                slopes[k * n:k * n + n] = margins.slopes[:n] * shooting.map.scales
                slopes[size:] = margins.slopes[n:] * shooting.widths
                out[name] = margins._replace(slopes=slopes)
    return out
