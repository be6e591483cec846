"""Bifurcations as minimally augmented systems: an orbit's equations and one more that a bordered matrix gives.

The derivatives M_k of the segments of an orbit make L(mu) x = (M_1 x_1 - x_2, ..., M_m x_m - mu x_1), which is singular
where mu is a multiplier: mu = 1 at a fold, -1 at a doubling, exp(i theta) with theta as a further unknown at a
Neimark-Sacker bifurcation. With A = L(mu) singular, g of [A b; c 0] [v; g] = [0; 1] is 0 and smooth there, and its
gradient is -w A_z v with w from the transposed system (W. Govaerts, Numerical Methods for Bifurcations of Dynamical
Equilibria, SIAM 2000, Section 3.3; Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Section 10.7). Second
derivatives are symmetric, so one difference of the Jacobian along v gives all of w A_z v.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tcc_sim.continuation.newton import multipliers_of
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import Linearised, Shooting

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
        found = shooting.linearise(z)
        self.start = np.append(z, angle_of(found.blocks)) if self.turning else z
        left, _, right = np.linalg.svd(cyclic(found.blocks, self.multiplier(self.start)))
        self.b, self.c = left[:, -1], right[-1]

    @property
    def unknowns(self) -> int:
        """Number of nodes' coordinates and parameters, without the angle."""
        return self.shooting.size + len(self.shooting.ranges)

    @property
    def doubled(self) -> bool:
        """Whether the orbits may come to be those of half the period: only a fold does, in a generalised doubling."""
        return self.kind == "fold" and self.shooting.period % (2 * self.shooting.map.forcing_period) == 0

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

    def update_borders(self, u: Floats, found: Linearised) -> None:
        """Take the borders from the null vectors at a point, the best there; their signs go on."""
        v, w, _ = self.null_vectors(found.blocks, self.multiplier(u))
        self.b, self.c = (x.conj().ravel() / np.linalg.norm(x) for x in (w, v))

    def linearise(self, u: Floats) -> Linearised:
        """The orbit's equations and g, with derivatives."""
        z, mu = u[:self.unknowns], self.multiplier(u)
        found = self.shooting.linearise(z)
        v, w, g = self.null_vectors(found.blocks, mu)
        gradient = -sum(factor * self._along(z, found, part, w) for factor, part in _parts(v))
        if self.turning:
            gradient = np.append(gradient, 1j * mu * (w[-1] @ v[0]))
        rows = np.array([gradient.real, gradient.imag] if self.turning else [gradient])
        values = np.array([np.real(g), np.imag(g)] if self.turning else [g])
        # On a canard g passes from one sign to the other within rounding of z: how far z is from there counts.
        size = max(float(np.linalg.norm(gradient)), 1.0)
        orbit = np.pad(found.jacobian, ((0, 0), (0, 1))) if self.turning else found.jacobian
        return Linearised(np.append(found.residual, values / size), np.vstack([orbit, rows / size]), found.blocks,
                          found.seen)

    def _along(self, z: Floats, found: Linearised, direction: Floats, w: Vectors) -> Vectors:
        """w . (derivative of the Jacobian along nodes' changes): by the nodes and the parameters."""
        changed, sign = self._moved(z, direction)
        step = sign * self.settings.difference
        blocks = (changed.blocks - found.blocks) / step
        size = self.shooting.size
        by = (changed.jacobian[:, size:] - found.jacobian[:, size:]) / step
        return np.concatenate([np.einsum("ki,kij->kj", w, blocks).ravel(), w.ravel() @ by])

    def _moved(self, z: Floats, direction: Floats) -> tuple[Linearised, float]:
        """The orbit's equations a step along nodes' changes, or against them where the map ends, and its sign."""
        away = np.zeros(len(z))
        away[:self.shooting.size] = self.settings.difference * direction.ravel()
        try:
            return self.shooting.linearise(z + away), 1.0
        except FAILURES:
            return self.shooting.linearise(z - away), -1.0

    def tests(self, u: Floats, found: Linearised) -> dict[str, Callable[[], float]]:
        """Functions that change their sign where the curve of this bifurcation has a special point, by its name.

        found : from `linearise`
        """
        mu = self.multiplier(u)
        v, w, _ = self.null_vectors(found.blocks, mu)
        if self.turning:
            angle = float(u[-1])
            return {"resonance_1_1": lambda: float(np.sin(angle)) if angle < 0.5 * np.pi else 1.0,
                    "resonance_1_2": lambda: float(np.sin(angle)) if angle > 0.5 * np.pi else 1.0,
                    "resonance_1_3": lambda: angle - 2.0 * np.pi / 3.0, "resonance_1_4": lambda: angle - 0.5 * np.pi,
                    "chenciner": lambda: self._cubic(u, found, v, w)}

        def flip() -> float:
            m = multipliers_of(*found.blocks)
            others = m[np.argsort(np.abs(m - mu))[1:]]
            return float(np.prod((others + mu) / (1.0 + np.abs(others))).real)

        def simple() -> float:
            return float(w[-1] @ v[0]) / float(np.linalg.norm(w) * np.linalg.norm(v))

        if self.kind == "fold":
            bend = found.jacobian[-1, :self.shooting.size] @ v.ravel()
            return {"cusp": lambda: float(bend) / float(np.linalg.norm(v)), "resonance_1_1": simple, "fold_flip": flip}
        # At a fold-flip the coefficient has a pole.
        return {"generalised_doubling": lambda: self._cubic(u, found, v, w) * flip(), "resonance_1_2": simple,
                "fold_flip": flip}

    def _cubic(self, u: Floats, found: Linearised, v: Vectors, w: Vectors) -> float:
        """The coefficient of third order of the normal form: whether what branches off is stable, by its sign."""
        # Re conj(mu) w . (C(q, q, q')/2 + B(q, h) + B(q', k)/2) / (w . E q) with L(1) h = -B(q, q'), L(mu^2) k = -B(q,
        # q) and q' the conjugate of q (Kuznetsov, Sections 4.7 and 9.6); E q is what mu stands at in L.
        z, mu, blocks = u[:self.unknowns], self.multiplier(u), found.blocks
        q = v / np.linalg.norm(v)
        first, second = np.zeros(blocks.shape, dtype=q.dtype), np.zeros(blocks.shape)
        for factor, part in _parts(q):
            changed, _ = self._moved(z, part)
            bend = float(np.abs(changed.blocks - blocks).max()) / self.settings.difference
            step = self.settings.bend / max(bend, 1.0)
            away = step * np.pad(part.ravel(), (0, len(z) - part.size))
            ahead, behind = (self.shooting.linearise(z + s * away).blocks for s in (1.0, -1.0))
            first = first + factor * (ahead - behind) / (2.0 * step)
            second += (ahead - 2.0 * blocks + behind) / step**2

        def b(x: Vectors, y: Vectors) -> Vectors:
            return (x @ y[:, :, None])[:, :, 0]

        h = np.linalg.solve(cyclic(blocks, 1.0), -b(first, q.conj()).ravel()).reshape(q.shape)
        k = np.linalg.solve(cyclic(blocks, mu**2), -b(first, q).ravel()).reshape(q.shape)
        cubic = 0.5 * b(second, q) + b(first, h) + 0.5 * b(first.conj(), k)
        return float(np.real(np.conj(mu) * np.sum(w * cubic) / (w[-1] @ q[0])))


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
