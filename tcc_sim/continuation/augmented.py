"""Bifurcations as minimally augmented systems: an orbit's equations and one more that a bordered matrix gives.

The derivatives M_k of the segments of an orbit make L(mu) x = (M_1 x_1 - x_2, ..., M_m x_m - mu x_1), which is singular
where mu is a multiplier: mu = 1 at a fold, -1 at a doubling, exp(i theta) with theta as a further unknown at a
Neimark-Sacker bifurcation. With A = L(mu) singular, g of [A b; c 0] [v; g] = [0; 1] is 0 and smooth there, and its
gradient is -w A_z v with w from the transposed system (W. Govaerts, Numerical Methods for Bifurcations of Dynamical
Equilibria, SIAM 2000, Section 3.3; Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.7). Second
derivatives are symmetric, so one difference of the Jacobian along v gives all of w A_z v.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tcc_sim.continuation.newton import multipliers_of
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import Linearised, ParameterRange, Shooting

Vectors = NDArray[Any]
"""Real or complex, (m, n): one for every segment."""


def cyclic(blocks: Floats, mu: complex) -> Vectors:
    """L(mu) of the segments' derivatives (m, n, n)."""
    m, n = blocks.shape[:2]
    out = np.zeros((m * n, m * n), dtype=np.complex128 if np.imag(mu) else np.float64)
    for k in range(m):
        rows, following = slice(k * n, k * n + n), (k + 1) % m
        out[rows, rows] = blocks[k]
        out[rows, following * n:following * n + n] -= np.eye(n) * (mu if k + 1 == m else 1.0)
    return out


class MinimallyAugmented:
    """The equations of a bifurcation in the orbit's nodes, one or two parameters and, for Neimark-Sacker, the angle."""

    rounding: ClassVar[float] = 1e-9

    def __init__(self, kind: str, shooting: Shooting, z: Floats) -> None:
        self.kind, self.shooting = kind, shooting
        # Differences, and what a canard makes of rounding, leave more of g than of the orbit's own equations.
        given = shooting.settings
        self.settings = replace(given, correct_tolerance=given.curve_tolerance, residual=given.curve_tolerance,
                                regrowth=given.curve_regrowth, largest_step=min(given.largest_step, given.curve_step))
        self.turning = kind == "neimark_sacker"
        self.bend = 0.0
        """Largest change of the segments' derivatives per unit along the null vector, of the last linearisation."""
        found = shooting.linearise(z)
        self.start = np.append(z, angle_of(found.blocks)) if self.turning else z
        left, _, right = np.linalg.svd(cyclic(found.blocks, self.multiplier(self.start)))
        self.b, self.c = left[:, -1], right[-1]

    @property
    def coarse(self) -> MinimallyAugmented:
        """These equations: there are none that cost less."""
        return self

    @property
    def ranges(self) -> tuple[ParameterRange, ...]:
        """The free parameters."""
        return self.shooting.ranges

    @property
    def first_parameter(self) -> int:
        """Number of the unknown that is the first parameter."""
        return self.shooting.size

    @property
    def unknowns(self) -> int:
        """Number of nodes' coordinates and parameters, without the angle."""
        return self.shooting.size + len(self.shooting.ranges)

    @property
    def doubled(self) -> bool:
        """Whether the orbits may become those of half the period: only a fold does, in a generalised doubling."""
        return self.kind == "fold" and self.shooting.period % (2 * self.shooting.map.forcing_period) == 0

    def outer(self, vector: Floats) -> Floats:
        """The part of a vector of unknowns that single shooting has too: the first node, and what is no node."""
        return self.shooting.outer(vector)

    def between_halves(self, u: Floats) -> Floats:
        """How far the first half of the orbit goes, in natural sizes."""
        of, z = self.shooting.map, u[:self.unknowns]
        x, half = self.shooting.nodes(z)[0], self.shooting.period // 2
        out: Floats = (of.evaluate(x, self.shooting.values(z), 0, half).value - x) / of.scales
        return out

    def multiplier(self, u: Floats) -> complex:
        """The one on the unit circle."""
        if self.turning:
            return complex(np.exp(1j * u[-1]))
        return 1.0 if self.kind == "fold" else -1.0

    def null_vectors(self, blocks: Floats, mu: complex) -> tuple[Vectors, Vectors, complex]:
        """v and w (m, n) of the bordered systems, and g."""
        a = cyclic(blocks, mu)
        d = len(a)
        matrix = np.zeros((d + 1, d + 1), dtype=a.dtype)
        matrix[:d, :d], matrix[:d, d], matrix[d, :d] = a, self.b, self.c
        side = np.eye(d + 1)[d]
        right, left = np.linalg.solve(matrix, side), np.linalg.solve(matrix.T, side)
        shape = blocks.shape[:2]
        return right[:d].reshape(shape), left[:d].reshape(shape), right[d]

    def update_borders(self, u: Floats, found: Linearised, like: MinimallyAugmented | None = None) -> None:
        """Take the borders from the null vectors at a point, the best there, with the signs of those before, or of
        those that the equations `like` these in other segments have: first nodes and last residuals are the same.
        """
        v, w, _ = self.null_vectors(found.blocks, self.multiplier(u))
        n, signs = self.shooting.map.dimension, (1.0, 1.0)
        if like is not None and not self.turning:
            signs = (-1.0 if float(w[-1] @ like.b[-n:]) < 0.0 else 1.0, -1.0 if float(v[0] @ like.c[:n]) < 0.0 else 1.0)
        self.b, self.c = (sign * x.conj().ravel() / np.linalg.norm(x) for sign, x in zip(signs, (w, v)))

    def linearise(self, u: Floats, longer: float = 1.0) -> Linearised:
        """The orbit's equations and g, with derivatives.

        longer : the step of their differences, relative to the usual one
        """
        z, mu = u[:self.unknowns], self.multiplier(u)
        found = self.shooting.linearise(z)
        v, w, g = self.null_vectors(found.blocks, mu)
        gradient = -sum(factor * self._along(z, found, part, w, longer) for factor, part in _parts(v))
        if self.turning:
            gradient = np.append(gradient, 1j * mu * (w[-1] @ v[0]))
        rows = np.array([gradient.real, gradient.imag] if self.turning else [gradient])
        values = np.array([np.real(g), np.imag(g)] if self.turning else [g])
        # On a canard g passes from one sign to the other within rounding of z: how far z is from there counts.
        size = max(float(np.linalg.norm(gradient)), 1.0)
        orbit = np.pad(found.jacobian, ((0, 0), (0, 1))) if self.turning else found.jacobian
        return Linearised(np.append(found.residual, values / size), np.vstack([orbit, rows / size]), found.blocks,
                          found.seen)

    def _along(self, z: Floats, found: Linearised, direction: Floats, w: Vectors, longer: float) -> Vectors:
        """w . (derivative of the Jacobian along nodes' changes): by the nodes and the parameters."""
        size, step = self.shooting.size, longer * self.settings.difference
        away = np.zeros(len(z))
        away[:size] = step * direction.ravel()
        try:
            changed = self.shooting.linearise(z + away)
        except FAILURES:  # The map ends there.
            changed, step = self.shooting.linearise(z - away), -step
        blocks = (changed.blocks - found.blocks) / step
        self.bend = float(np.abs(blocks).max() / max(np.linalg.norm(direction), 1e-300))
        parameters = (changed.jacobian[:, size:] - found.jacobian[:, size:]) / step
        return np.concatenate([np.einsum("ki,kij->kj", w, blocks).ravel(), w.ravel() @ parameters])

    def tests(self, u: Floats, found: Linearised, longer: float = 0.0) -> dict[str, float]:
        """Smooth functions with a simple root where the curve of this bifurcation has a special point, by its name.

        None of them has a pole: the normal form's coefficient of a doubling is multiplied by the tests of fold-flip and
        of 1:2, at which it has one each.

        found : from `linearise`, at u or near it
        longer : the step of differences, relative to the usual one, to fourth order; 0 for the usual one, to second
        """
        if self.turning:
            angle = float(u[-1])
            return {"resonance_1_1": float(np.sin(angle)) if angle < 0.5 * np.pi else 1.0,
                    "resonance_1_2": float(np.sin(angle)) if angle > 0.5 * np.pi else 1.0,
                    "resonance_1_3": angle - 2.0 * np.pi / 3.0, "resonance_1_4": angle - 0.5 * np.pi}
        mu = self.multiplier(u).real
        v, w, _ = self.null_vectors(found.blocks, mu)
        q, p, m = v / np.linalg.norm(v), w / np.linalg.norm(w), multipliers_of(*found.blocks)
        others = m[np.argsort(np.abs(m - mu))[1:]]
        simple, flip = float(p[-1] @ q[0]), float(np.prod((others + mu) / (1.0 + np.abs(others))).real)
        if self.kind == "fold":
            bend = float(found.jacobian[-1, :self.shooting.size] @ v.ravel()) / float(np.linalg.norm(v))
            return {"cusp": bend, "resonance_1_1": simple, "fold_flip": flip}
        out = {"resonance_1_2": simple, "fold_flip": flip}
        try:
            return out | {"generalised_doubling": flip * self._cubic(u, q, p, longer)}
        except FAILURES:
            return out

    def _cubic(self, u: Floats, q: Floats, p: Floats, longer: float) -> float:
        """The normal form's coefficient of third order at a doubling times p . E q: its sign, but for that of p . E q,
        says whether the doubled motions are stable.
        """
        # p . (C(q, q, q) + 3 B(q, h))/2 with L(1) h = -B(q, q) (Kuznetsov, Section 5.4.2; E q is what mu stands at in
        # L). The second difference needs all three Jacobians at u itself.
        step = (longer or 1.0) * self.settings.bend / max(self.bend, 1.0)
        z, unit = u[:self.unknowns], np.pad(q.ravel(), (0, self.unknowns - q.size))
        blocks = self.shooting.linearise(z).blocks

        def differences(step: float) -> Floats:
            ahead, behind = (self.shooting.linearise(z + s * step * unit).blocks for s in (1.0, -1.0))
            return np.array([(ahead - behind) / (2.0 * step), (ahead - 2.0 * blocks + behind) / step**2])

        first, second = (4.0 * differences(step) - differences(2.0 * step)) / 3.0 if longer else differences(step)
        b, c = (np.einsum("kij,kj->ki", x, q) for x in (first, second))
        h = np.linalg.solve(cyclic(blocks, 1.0), -b.ravel()).reshape(q.shape)
        return float(0.5 * np.sum(p * (c + 3.0 * np.einsum("kij,kj->ki", first, h))))


def _parts(v: Vectors) -> list[tuple[complex, Floats]]:
    """Real and imaginary part of a vector, each with its factor; a real one has one part."""
    return [(1.0, v.real), (1j, v.imag)] if np.iscomplexobj(v) else [(1.0, v)]


def angle_of(blocks: Floats) -> float:
    """The argument of the complex pair of multipliers nearest to the unit circle, 0 to pi."""
    m = multipliers_of(*blocks)
    pairs = m[m.imag > 1e-9]
    if not len(pairs):
        raise ArithmeticError("there is no complex pair of multipliers")
    return float(np.angle(pairs[np.argmin(np.abs(np.abs(pairs) - 1.0))]))


def locate_bifurcation(kind: str, shooting: Shooting, z: Floats) -> Floats | None:
    """Nodes and the one parameter of a bifurcation of this kind near `z`, by Newton; None where none is found."""
    try:
        equations = MinimallyAugmented(kind, shooting, z)
        u = equations.start
        for _ in range(shooting.settings.locate_iterations):
            found = equations.linearise(u)
            step = np.linalg.solve(found.jacobian, -found.residual)
            u = u + step
            if float(np.abs(step).max()) < shooting.settings.located:
                z = u[:equations.unknowns]
                return z if float(np.abs(shooting.linearise(z).residual).max()) <= shooting.settings.residual else None
    except FAILURES:
        return None
    return None
