"""Radau IIA: nodes, matrix, and the polynomial through the nodes, for the collocation steps of both engines.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Sec. IV.5.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.trajectory import Floats


def radau(count: int) -> tuple[Floats, Floats]:
    """Nodes c (count,) and matrix A (count, count) of Radau IIA.

    The nodes are the zeros of P_s(2 c - 1) - P_(s-1)(2 c - 1), the last of them 1.
    """
    legendre = np.zeros(count + 1)
    legendre[count], legendre[count - 1] = 1.0, -1.0
    x = np.sort(np.real(np.polynomial.legendre.legroots(legendre)))
    slope = np.polynomial.legendre.legder(legendre)
    for _ in range(3):
        x[:-1] -= np.polynomial.legendre.legval(x[:-1], legendre) / np.polynomial.legendre.legval(x[:-1], slope)
    x[-1] = 1.0
    basis = np.polynomial.legendre.legvander(x, count - 1)
    integrals = np.stack([np.polynomial.legendre.legval(x, np.polynomial.legendre.legint(unit, lbnd=-1))
                          for unit in np.eye(count)], axis=1)
    return (x + 1.0) / 2.0, 0.5 * np.linalg.solve(basis.T, integrals.T).T


def to_chebyshev(nodes: Floats) -> Floats:
    """The matrix that makes Chebyshev coefficients over [0, 1] of values at 0 and at the nodes."""
    points = np.concatenate([[0.0], nodes])
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * points - 1.0, len(nodes))))


def chebyshev_to_powers(degree: int) -> Floats:
    """(degree + 1, degree + 1) matrix whose row i has the coefficients of T_i(2 x - 1) in powers of x."""
    out = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        out[i, :i + 1] = np.polynomial.Chebyshev.basis(i, domain=[0.0, 1.0]).convert(
            kind=np.polynomial.Polynomial).coef
    return np.rint(out)
