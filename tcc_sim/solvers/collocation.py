"""Tables of collocation: Radau IIA, and for steps of 16 nodes the linear part of the driveline.

With w = theta2' + kappa v, kappa = I1/(I1 + I2), M = I1 + I2 the equations of motion (2) of the paper read

    theta2' = w - kappa v,    M w' = Te - K23 theta2 - C23 (w - kappa v),
    v' = Te/I1 + (C23 theta2' + K23 theta2)/I2 - beta Ts mubar(v),

so that at the nodes of a step h (a = h A, A the Runge-Kutta matrix) theta2 and w are linear in their values at the
start, the torque at the nodes and the slip speeds V at the nodes. There remains

    b - L V - beta Ts mubar(V) = 0,    L = a^-1 - (C23 dU/dV + K23 dX/dV)/I2,    X = theta2, U = theta2' at the nodes.

The other coefficients of `model.equations.Linear` enter in the same way. NumPy computes all of it here for a ladder of
steps (step sizes), so that a step costs products only. The step sizes have the same absolute lengths for all scenes, so
that the points of a sweep over a frequency share them.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Sec. IV.5.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.equations import Linear, coefficients_of, decay_of_slip
from tcc_sim.trajectory import Floats

NODES = 16
DEGREE = NODES
TERMS = 20
"""Coefficients of a polynomial of degree 16, and three zeros: rows of a multiple of four numbers are faster."""
LEVELS = 22
"""Step sizes of a ladder, each shorter than the one before by sqrt 2: at least from an engine cycle down to 1/1448 of
it.
"""
GAP = 200.0
"""The shortest step size times the fastest rate of a scene, at most: shorter steps are series, which that rate limits
to about 5 times its inverse."""

STEP_SIZE = np.dtype([("length", np.float64), ("start", np.float64, NODES), ("diagonal", np.float64, NODES),
                      ("coupling", np.float64, (NODES, NODES)), ("angle", np.float64, (NODES, TERMS)),
                      ("speed", np.float64, (NODES, TERMS)), ("end_angle", np.float64, NODES),
                      ("end_speed", np.float64, NODES)])
"""A step size: h (s); a^-1 1, the share of v(0) in b; the diagonal and the columns of L; shares of each V_j in the
Chebyshev coefficients over the step, and in the end values, of theta2 and of w.
"""

SOURCE = np.dtype([("balance", np.float64, NODES), ("angle", np.float64, TERMS), ("speed", np.float64, TERMS),
                   ("end_angle", np.float64), ("end_speed", np.float64)])
"""Shares of a unit of a source in b, and in the Chebyshev coefficients and end values of theta2 and of w."""

TURN = np.dtype([("cosine", np.float64, NODES), ("sine", np.float64, NODES)])
"""Cosine and sine of the advance of the load's phase at the nodes."""

FROM_ANGLE, FROM_SPEED, FROM_MEAN, FROM_WAVES = 0, 1, 2, 3
"""Sources: theta2 and w at the start, a constant torque; then for every sine of the torque its value and quadrature."""


class Tables(NamedTuple):
    """Tables of a system, longest step first: arrays of STEP_SIZE (levels,), SOURCE (levels, FROM_WAVES + 2 waves),
    TURN (levels,); and `Response.torque` if there are derivatives.
    """

    step_sizes: NDArray[Any]
    sources: NDArray[Any]
    turns: NDArray[Any]
    torque: NDArray[Any] | None = None


class Response(NamedTuple):
    """Tables of a linear part: the step sizes, the sources without the waves (levels, FROM_WAVES, numbers of a SOURCE),
    and the matrices that make a source of a torque at the nodes, (levels, numbers of a SOURCE, NODES).
    """

    step_sizes: NDArray[Any]
    fixed: Floats
    torque: Floats


def radau(count: int) -> tuple[Floats, Floats]:
    """Return nodes c (count,) and matrix A (count, count) of Radau IIA.

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
    """Return the matrix that makes Chebyshev coefficients over [0, 1] of values at 0 and at the nodes."""
    points = np.concatenate([[0.0], nodes])
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * points - 1.0, len(nodes))))


def chebyshev_to_powers(degree: int) -> Floats:
    """Return the (degree + 1, degree + 1) matrix of exact coefficients of T_i(2 x - 1) in powers of x, row by row."""
    out = np.eye(degree + 1)
    out[1, 0], out[1, 1] = -1.0, 2.0
    for i in range(2, degree + 1):  # T_i(y) = 2 y T_(i-1)(y) - T_(i-2)(y)
        out[i] = -2.0 * out[i - 1] - out[i - 2]
        out[i, 1:] += 4.0 * out[i - 1, :-1]
    return out


C, A = radau(NODES)
INVERSE = np.linalg.inv(A)
TO_CHEBYSHEV = np.zeros((NODES + 1, TERMS))
TO_CHEBYSHEV[:, :DEGREE + 1] = to_chebyshev(C).T
"""Shares in the Chebyshev coefficients over the step of the value at the start (row 0), and at node j (row j)."""
TO_POWERS = np.zeros((TERMS, TERMS))
TO_POWERS[:DEGREE + 1, :DEGREE + 1] = chebyshev_to_powers(DEGREE)


def ladder_of(fastest: float, period: float) -> tuple[int, int]:
    """Return `top`, where the longest step size is 2^(-top/2) s, at most one engine cycle, and the number of step sizes
    for a fastest rate, 1/s.
    """
    top = math.ceil(-2.0 * math.log2(period) - 1e-9)
    return top, max(LEVELS, 1 + math.ceil(2.0 * math.log2(fastest / GAP) - top))


@lru_cache(maxsize=16)
def response(linear: Linear, top: int, levels: int) -> Response:
    """Return the response of theta2 and w on every step size to their start, the torque and the slip."""
    i1, i2, damping, stiffness, by_slip, by_speed, plate_by_slip = coefficients_of(linear)
    inertia, kappa = i1 + i2, i1 / (i1 + i2)
    # M w' = Te - K23 theta2 - (C23 + f_w) theta2' - (f_v + p_v) v, with theta2' = w - kappa v.
    damped, slipping = damping + by_speed, kappa * (damping + by_speed) - (by_slip + plate_by_slip)
    lengths = 2.0 ** (-0.5 * (top + np.arange(levels)))
    a = lengths[:, None, None] * A
    eye, one = np.broadcast_to(np.eye(NODES), a.shape), np.ones((levels, NODES, 1))
    matrix = np.block([[eye, -a], [a * (stiffness / inertia), eye + a * (damped / inertia)]])
    right = np.concatenate([np.block([[one, 0.0 * one, 0.0 * a, -kappa * a]]),
                            np.block([[0.0 * one, one, a / inertia, a * (slipping / inertia)]])], axis=1)
    solution = np.linalg.solve(matrix, right)
    x, w = solution[:, :NODES], solution[:, NODES:]
    start = 2 + NODES
    step_sizes = np.zeros(levels, STEP_SIZE)
    step_sizes["length"] = lengths
    step_sizes["start"] = INVERSE.sum(axis=1) / lengths[:, None]
    u = w[..., start:] - kappa * np.eye(NODES)
    coupling = INVERSE / lengths[:, None, None] - (damping * u + stiffness * x[..., start:]) / i2
    coupling = coupling + by_speed / i1 * u + decay_of_slip(linear) * np.eye(NODES)
    step_sizes["coupling"], step_sizes["diagonal"] = coupling.transpose(0, 2, 1), coupling.diagonal(axis1=1, axis2=2)
    step_sizes["angle"], step_sizes["speed"] = (_polynomials(y[..., start:]).transpose(0, 2, 1) for y in (x, w))
    step_sizes["end_angle"], step_sizes["end_speed"] = x[:, -1, start:], w[:, -1, start:]
    applied = np.concatenate([np.zeros((levels, NODES, 2)), eye], axis=2)
    balance = (applied - by_speed * w[..., :start]) / i1 + (damping * w[..., :start] + stiffness * x[..., :start]) / i2
    source = np.concatenate([balance, *(_polynomials(y[..., :start]) for y in (x, w)), x[:, -1:, :start],
                             w[:, -1:, :start]], axis=1)
    source[:, NODES:NODES + TERMS, FROM_ANGLE] += TO_CHEBYSHEV[0]
    source[:, NODES + TERMS:NODES + 2 * TERMS, FROM_SPEED] += TO_CHEBYSHEV[0]
    torque = np.ascontiguousarray(source[..., 2:])
    fixed = np.concatenate([source[..., :2], torque.sum(axis=2, keepdims=True)], axis=2)
    step_sizes.setflags(write=False)
    return Response(step_sizes, fixed.transpose(0, 2, 1), torque)


@lru_cache(maxsize=16)
def tables(linear: Linear, rates: tuple[float, ...], load_rate: float, top: int, levels: int) -> Tables:
    """Return the tables, read only, of a system whose torque has sines of these rates (rad/s), and its load one."""
    linear_response = response(linear, top, levels)
    times = linear_response.step_sizes["length"][:, None] * C
    sources = np.empty((levels, FROM_WAVES + 2 * len(rates), linear_response.fixed.shape[2]))
    sources[:, :FROM_WAVES] = linear_response.fixed
    waves = np.empty((levels, NODES, 2))
    for i, rate in enumerate(rates):
        angles = rate * times
        np.cos(angles, out=waves[:, :, 0])
        np.sin(angles, out=waves[:, :, 1])
        sources[:, FROM_WAVES + 2 * i:FROM_WAVES + 2 * i + 2] = (linear_response.torque @ waves).transpose(0, 2, 1)
    return _tables(linear_response, sources, load_rate, top)


@lru_cache(maxsize=16)
def nodal_tables(linear: Linear, top: int, levels: int) -> Tables:
    """Return the tables of a system whose torque is given at the nodes: each node is a source."""
    linear_response = response(linear, top, levels)
    return _tables(linear_response, np.concatenate([linear_response.fixed, linear_response.torque.transpose(0, 2, 1)],
                                                   axis=1), 0.0, top)


def _tables(linear_response: Response, sources: Floats, load_rate: float, top: int) -> Tables:
    """Return the tables with these sources, (levels, sources, numbers of a SOURCE)."""
    named = np.ascontiguousarray(sources).view(SOURCE)[..., 0]
    named.setflags(write=False)
    return Tables(linear_response.step_sizes, named, turns_of(load_rate, top, len(sources)))


@lru_cache(maxsize=16)
def turns_of(load_rate: float, top: int, levels: int) -> NDArray[Any]:
    """Return cosine and sine of the load's angle at the nodes of every step size, from its start."""
    angles = load_rate * (2.0 ** (-0.5 * (top + np.arange(levels))))[:, None] * C
    turns: NDArray[Any] = np.stack([np.cos(angles), np.sin(angles)], axis=1).reshape(levels, -1).view(TURN)[:, 0]
    turns.setflags(write=False)
    return turns


def _polynomials(nodal: Floats) -> Floats:
    """Return Chebyshev coefficients (levels, TERMS, columns) of nodal values (levels, NODES, columns); 0 at x = 0."""
    out: Floats = TO_CHEBYSHEV[1:].T @ nodal
    return out
