"""Floquet multipliers of a periodic motion, and its largest Lyapunov exponent as a result."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.result import Described, reported
from tcc_sim.trajectory import Floats

LOST = 1e-8
"""Reciprocal of a multiplier below which the pencil of several segments has lost half its digits (its error is some
1e-16 of the largest multiplier): such multipliers are those of the product.
"""
PAIR = 1e-9
"""Relative difference of two multipliers that are one pair."""


def multipliers_of(*blocks: Floats) -> NDArray[np.complex128]:
    """Floquet multipliers, in the order of `largest_first`.

    Of several segments, given in order, they are the finite eigenvalues of the pencil whose rows are x_(k+1) = M_k x_k
    and M_m x_m = lambda x_1: the product of the M_k, which may grow and shrink by many orders, is never formed.
    """
    m, n = len(blocks), len(blocks[0])
    if m == 1:
        values = np.linalg.eigvals(blocks[0])
    else:
        from scipy.linalg import eig  # Nobody else of those who ask for multipliers needs it.

        left, right = np.zeros((m * n, m * n)), np.zeros((m * n, m * n))
        for k, block in enumerate(blocks):
            rows = slice(k * n, k * n + n)
            left[rows, rows] = block
            if k + 1 < m:
                left[rows, (k + 1) * n:(k + 2) * n] = -np.eye(n)
        right[(m - 1) * n:, :n] = np.eye(n)
        top, bottom = eig(left, right, right=False, homogeneous_eigvals=True)
        finite = np.argsort(-np.abs(bottom))[:n]
        large = np.abs(bottom[finite]) < LOST * np.abs(top[finite])
        values = np.where(large, 0.0, top[finite] / np.where(large, 1.0, bottom[finite]))
        if large.any():
            whole = np.linalg.eigvals(product_of(np.array(blocks)))
            values[large] = whole[np.argsort(-np.abs(whole))][:int(large.sum())]
    return largest_first(values)


def product_of(blocks: Floats) -> Floats:
    """The product of the blocks, the first one rightmost."""
    return reduce(lambda whole, block: np.asarray(block @ whole), blocks)


def largest_first(multipliers: NDArray[Any]) -> NDArray[np.complex128]:
    """Multipliers, largest modulus first; the positive imaginary part first in a pair, whose moduli rounding may tell
    apart.
    """
    ordered = sorted(multipliers.tolist(), key=lambda m: (-abs(m), -m.imag))
    for k in range(len(ordered) - 1):
        if ordered[k].imag < 0.0 and abs(ordered[k] - ordered[k + 1].conjugate()) <= PAIR * abs(ordered[k]):
            ordered[k:k + 2] = ordered[k + 1], ordered[k]
    return np.array(ordered, np.complex128)


@dataclass(frozen=True, repr=False)
class Lyapunov(Described):
    """The largest Lyapunov exponent.

    Examples
    --------
    >>> Lyapunov(1.51, 1.4, 1.6, 0.95, 2000, "chaotic")
    <Lyapunov 1.51 1/s (1.4 to 1.6): chaotic>
    """

    exponent: float = field(metadata=reported("mean growth rate of a small disturbance", "1/s"))
    low: float = field(metadata=reported(
        "lower end of its interval, for errors of steps and of sampling", "1/s"))
    high: float = field(metadata=reported("upper end", "1/s"))
    confidence: float = field(metadata=reported("confidence of the sampling, by batch means"))
    cycles: int = field(metadata=reported("cycles averaged, or those of the period"))
    diagnosis: str = field(metadata=reported(
        "periodic (up to `long_period`), chaotic (interval above 0), contracting (below 0, but no period "
        "found), quasi-periodic (interval around 0, averages converge as on a torus), runaway, or "
        "unresolved"))

    def _text(self) -> str:
        return f"Lyapunov {self.exponent:.6g} 1/s ({self.low:.6g} to {self.high:.6g}): {self.diagnosis}"
