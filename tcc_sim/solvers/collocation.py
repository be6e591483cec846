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

The nonlinear equations are solved by Newton's method, with the diagonal alone where friction outweighs the rest.
Operations on all nodes are straight-line code on rows of 16 numbers (`unrolled`), which the processor handles four or
eight at a time.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import folded, largest_size, lesser, limited, row_of, unrolled
from tcc_sim.model.equations import Linear, coefficients_of, decay_of_slip
from tcc_sim.model.friction import Stribeck, with_slope
from tcc_sim.polynomials.polynomial import WORKSPACE
from tcc_sim.solvers.law import exponentials_at, law_on, step_and_rest
from tcc_sim.solvers.series import COLUMNS, ROWS, added
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


def lagrange(points: Floats) -> Floats:
    """Return the Chebyshev coefficients over [0, 1], row by row, of the polynomials that are 1 at one of the points and
    0 at the others (n,).

    They are products at the zeros of T_n, without a linear solve: LAPACK's last bits depend on the processor.
    """
    n = len(points)
    cosines = np.array([[math.cos(k * (m + 0.5) * math.pi / n) for k in range(n)] for m in range(n)])
    at = 0.5 + 0.5 * cosines[:, 1]
    out = np.empty((n, n))
    for j, point in enumerate(points):
        others = np.delete(points, j)[:, None]
        values: Floats = np.prod((at - others) / (point - others), axis=0)
        out[j] = (cosines * values[:, None]).sum(axis=0) * (2.0 / n)
    out[:, 0] *= 0.5
    return out


def chebyshev_to_powers(degree: int) -> Floats:
    """Return the (degree + 1, degree + 1) matrix of exact coefficients of T_i(2 x - 1) in powers of x, row by row."""
    out = np.eye(degree + 1)
    out[1, 0], out[1, 1] = -1.0, 2.0
    for i in range(2, degree + 1):  # T_i(y) = 2 y T_(i-1)(y) - T_(i-2)(y)
        out[i] = -2.0 * out[i - 1] - out[i - 2]
        out[i, 1:] += 4.0 * out[i - 1, :-1]
    return out


C = np.array([0.00564068897251171, 0.029482298647942485, 0.07141295311515884, 0.12983102555359105, 0.20249275505010406,
              0.28660608625752704, 0.37893868864697805, 0.4759423084632349, 0.5738891609066858, 0.6690151950299599,
              0.7576647390313427, 0.8364309606056102, 0.902286700679378, 0.9527004099058333, 0.9857305452631743, 1.0])
"""Nodes of Radau IIA: the zeros of P_16(2 c - 1) - P_15(2 c - 1) to the last bit."""
A: Floats = chebyshev.chebval(2.0 * C - 1.0, chebyshev.chebint(lagrange(C).T, lbnd=-1.0, scl=0.5)).T.copy()
"""Runge-Kutta matrix (NODES, NODES)."""
TO_CHEBYSHEV = np.zeros((NODES + 1, TERMS))
TO_CHEBYSHEV[:, :DEGREE + 1] = lagrange(np.append(0.0, C))
"""Shares in the Chebyshev coefficients over the step of the value at the start (row 0), and at node j (row j)."""
RATES: Floats = chebyshev.chebval(2.0 * C - 1.0, chebyshev.chebder(TO_CHEBYSHEV[:, :DEGREE + 1].T, scl=2.0)).T.copy()
"""Derivative at every node by the value at the start (column 0), and at node j (column j): the inverse of A."""
TO_POWERS = np.zeros((TERMS, TERMS))
TO_POWERS[:DEGREE + 1, :DEGREE + 1] = chebyshev_to_powers(DEGREE)
SQUARE = np.array([(row[:, None] * A).sum(axis=0) for row in A])
"""A A, to the same bits on every processor, as `@` is not."""
SIDES = 2 + 2 * NODES
"""Causes of theta2 and w in a step: their values at its start, the torque and the slip speed at every node."""


@fast
def _respond(lengths: Floats, stiffness: float, damping: float, slipping: float, kappa: float, push: float, a: Floats,
             square: Floats, to_chebyshev: Floats, system: Floats, nodal: Floats, series: Floats) -> None:
    """Fill theta2 and w at the nodes, and in Chebyshev coefficients without the values at the start, by every cause.

    With theta2 eliminated, (1 + h A damping + h^2 A^2 stiffness) w is the sum of the causes; `push` is 1/M. Elimination
    with pivots, row by row, gives the same bits on every processor.
    """
    for level in range(lengths.shape[0]):
        h = lengths[level]
        angle, speed = nodal[level, 0], nodal[level, 1]
        for i in range(NODES):
            angle[i, 0], speed[i, 0], speed[i, 1] = 1.0, 0.0, 1.0
            for j in range(NODES):
                step, twice = h * a[i, j], h * h * square[i, j]
                system[i, j] = step * damping + twice * stiffness + (1.0 if i == j else 0.0)
                speed[i, 0] -= step * stiffness
                speed[i, 2 + j], speed[i, 2 + NODES + j] = step * push, step * slipping + kappa * stiffness * twice
        for k in range(NODES):
            pivot = k
            for i in range(k + 1, NODES):
                if abs(system[i, k]) > abs(system[pivot, k]):
                    pivot = i
            for j in range(NODES):
                system[k, j], system[pivot, j] = system[pivot, j], system[k, j]
            for j in range(SIDES):
                speed[k, j], speed[pivot, j] = speed[pivot, j], speed[k, j]
            for i in range(k + 1, NODES):
                share = system[i, k] / system[k, k]
                for j in range(k + 1, NODES):
                    system[i, j] -= share * system[k, j]
                for j in range(SIDES):
                    speed[i, j] -= share * speed[k, j]
        for k in range(NODES - 1, -1, -1):
            for j in range(SIDES):
                speed[k, j] /= system[k, k]
            for i in range(k):
                for j in range(SIDES):
                    speed[i, j] -= system[i, k] * speed[k, j]
        for i in range(NODES):
            angle[i, 0], angle[i, 1:] = 1.0, 0.0
            for k in range(NODES):
                angle[i, 2 + NODES + k] -= kappa * h * a[i, k]
                for j in range(SIDES):
                    angle[i, j] += h * a[i, k] * speed[k, j]
        for i in range(TERMS):
            series[level, :, i] = 0.0
            for k in range(NODES):
                share = to_chebyshev[1 + k, i]
                for j in range(SIDES):
                    series[level, 0, i, j] += share * angle[k, j]
                    series[level, 1, i, j] += share * speed[k, j]


@fast
def _add_waves(lengths: Floats, rates: Floats, torque: Floats, c: Floats, waves: Floats) -> None:
    """Add the sources of the cosine and the sine of every rate to `waves`, (levels, 2 rates, numbers of a SOURCE)."""
    for level in range(lengths.shape[0]):
        for k in range(rates.shape[0]):
            for j in range(NODES):
                angle = rates[k] * lengths[level] * c[j]
                cosine, sine = math.cos(angle), math.sin(angle)
                for i in range(torque.shape[1]):
                    waves[level, 2 * k, i] += torque[level, i, j] * cosine
                    waves[level, 2 * k + 1, i] += torque[level, i, j] * sine


def ladder_of(fastest: float, period: float) -> tuple[int, int]:
    """Return `top`, where the longest step size is 2^(-top/2) s, at most one engine cycle, and the number of step sizes
    for a fastest rate, 1/s.
    """
    top = math.ceil(-2.0 * math.log2(period) - 1e-9)
    return top, max(LEVELS, 1 + math.ceil(2.0 * math.log2(fastest / GAP) - top))


@lru_cache(maxsize=16)
def response(linear: Linear, top: int, levels: int) -> Response:
    """Return the response of theta2 and w on every step size to their start, the torque and the slip."""
    i1, i2, damping, stiffness, by_slip, plate_by_slip = coefficients_of(linear)
    inertia, kappa = i1 + i2, i1 / (i1 + i2)
    # M w' = Te - K23 theta2 - C23 theta2' - (f_v + p_v) v, with theta2' = w - kappa v.
    slipping = kappa * damping - (by_slip + plate_by_slip)
    roots = 1.0, math.sqrt(2.0)
    lengths = np.array([math.ldexp(roots[k % 2], -((k + 1) // 2)) for k in range(top, top + levels)])
    nodal, series = np.empty((levels, 2, NODES, SIDES)), np.empty((levels, 2, TERMS, SIDES))
    _respond(lengths, stiffness / inertia, damping / inertia, slipping / inertia, kappa, 1.0 / inertia, A, SQUARE,
             TO_CHEBYSHEV, np.empty((NODES, NODES)), nodal, series)
    (x, w), (x_series, w_series) = nodal.transpose(1, 0, 2, 3), series.transpose(1, 0, 2, 3)
    eye = np.broadcast_to(np.eye(NODES), (levels, NODES, NODES))
    start = 2 + NODES
    step_sizes = np.zeros(levels, STEP_SIZE)
    step_sizes["length"] = lengths
    step_sizes["start"] = -RATES[:, 0] / lengths[:, None]
    u = w[..., start:] - kappa * np.eye(NODES)
    coupling = RATES[:, 1:] / lengths[:, None, None] - (damping * u + stiffness * x[..., start:]) / i2
    coupling = coupling + decay_of_slip(linear) * np.eye(NODES)
    step_sizes["coupling"], step_sizes["diagonal"] = coupling.transpose(0, 2, 1), coupling.diagonal(axis1=1, axis2=2)
    step_sizes["angle"], step_sizes["speed"] = (y[..., start:].transpose(0, 2, 1) for y in (x_series, w_series))
    step_sizes["end_angle"], step_sizes["end_speed"] = x[:, -1, start:], w[:, -1, start:]
    applied = np.concatenate([np.zeros((levels, NODES, 2)), eye], axis=2)
    balance = applied / i1 + (damping * w[..., :start] + stiffness * x[..., :start]) / i2
    source = np.concatenate([balance, x_series[..., :start], w_series[..., :start], x[:, -1:, :start],
                             w[:, -1:, :start]], axis=1)
    source[:, NODES:NODES + TERMS, FROM_ANGLE] += TO_CHEBYSHEV[0]
    source[:, NODES + TERMS:NODES + 2 * TERMS, FROM_SPEED] += TO_CHEBYSHEV[0]
    torque = np.ascontiguousarray(source[..., 2:])
    fixed = np.concatenate([source[..., :2], torque.sum(axis=2, keepdims=True)], axis=2)
    step_sizes.setflags(write=False)
    return Response(step_sizes, fixed.transpose(0, 2, 1), torque)


@lru_cache(maxsize=16)
def tables(linear: Linear, rates: tuple[float, ...] | None, load_rate: float, top: int, levels: int) -> Tables:
    """Return the tables, read only, of a system whose torque has sines of these rates (rad/s), and its load one.

    Without rates the torque is given at the nodes, each of which is a source.
    """
    linear_response = response(linear, top, levels)
    sources = linear_response.torque.transpose(0, 2, 1)
    if rates is not None:
        sources = np.zeros((levels, 2 * len(rates), linear_response.fixed.shape[2]))
        _add_waves(linear_response.step_sizes["length"].copy(), np.array(rates), linear_response.torque, C, sources)
    named = np.ascontiguousarray(np.concatenate([linear_response.fixed, sources], axis=1)).view(SOURCE)[..., 0]
    angles = (load_rate * linear_response.step_sizes["length"][:, None] * C).ravel().tolist()
    waves = np.array([[*map(math.cos, angles)], [*map(math.sin, angles)]]).reshape(2, levels, NODES)
    turns = waves.transpose(1, 0, 2).reshape(levels, -1).view(TURN)[:, 0]
    named.setflags(write=False)
    turns.setflags(write=False)
    return Tables(linear_response.step_sizes, named, turns)


ITERATIONS_MAXIMUM = 20
DOMINANT = 6.0
"""Ratio of beta Ts mubar' to the last, largest diagonal term of L above which Newton's matrix counts as diagonal."""
FOLLOWED = 0.7
"""Largest change of sigma V in an iteration of Newton's method: over a longer one tanh changes too much."""
LEAST_SLOPE = 0.05
"""Slope of mubar, relative to sigma, below which a residual does not measure the distance of V from the solution."""
STALLED, ROUNDED = 0.3, 100.0
"""Corrections are rounding if they shrink by less than the first factor and are below the second times `accuracy`."""
LARGEST, LEAST = range(2)
"""Entries of `measure`: Newton's largest correction, and the least beta Ts mubar' at the nodes."""
WIDTH = 4
"""Numbers in a part of a column."""

SLIDING, FALLING, LAYER = range(3)
"""Regions by |v|: mubar is constant, its exponential varies, tanh varies too."""

WAVES_MAXIMUM = 33
"""Sines of the engine torque: the first and 32 harmonics."""

WORK = np.dtype([
    ("rows", np.float64, (ROWS + 2, COLUMNS)), ("bernstein", np.float64, WORKSPACE),
    ("slip", np.float64, NODES), ("law", np.float64, NODES), ("slope", np.float64, NODES),
    ("friction_rate", np.float64, NODES),
    ("balance", np.float64, NODES), ("demand", np.float64, NODES), ("change", np.float64, NODES),
    ("chebyshev", np.float64, TERMS), ("measure", np.float64, 2),
    ("weights", np.float64, FROM_WAVES + 2 * WAVES_MAXIMUM)])
"""Work space.

rows, bernstein : the polynomials of a step, in powers of its time, two of them an engine's own; work space of searches
slip, law, slope, friction_rate : at the nodes, V, mubar(V), mubar'(V) and beta Ts
balance, demand : at the nodes, b without the share of v(0), and b/(beta Ts), what mubar would be without inertia
change, measure : Newton's correction of V; LARGEST and LEAST
chebyshev : coefficients over the step of the polynomial in hand
weights : factors of the sources
"""


class Place(NamedTuple):
    """Region of the state, sign of v, and tolerances of v and theta2' of a step."""

    region: int
    sign: float
    slip_tolerance: float
    speed_tolerance: float


@unrolled
def evaluate_law(slip: Any, law: Any, slope: Any, sign: Any, sigma: Any, stribeck: Any) -> None:
    """Fill mubar of (7) and its slope at the nodes, with |v| continued as sign * v through v = 0, where a step ends."""
    v, total, fall = slip.row(), 0.0, 0.0
    if stribeck is not None:
        _, total, fall = exponentials_at(v * sign, stribeck)
    values, falls = with_slope(total, fall, sign, sigma, *step_and_rest(v * sigma))
    law.set_row(values)
    slope.set_row(falls)


@unrolled
def guess(demand: Any, slip: Any, sign: Any, sigma: Any, stribeck: Any) -> None:
    """Fill the slip speeds at which mubar meets the demand on its rising branch, to two per cent."""
    required = demand.row()
    if stribeck is None:
        v = inverse_tanh(limited(required, -0.98, 0.98))
    else:
        v = inverse_tanh(limited(required * (1.0 / (1.0 + added(stribeck[::2]))), -0.98, 0.98)) / sigma
        _, total, _ = law_on(quadratic).exponentials_at(v * sign, stribeck)
        v = inverse_tanh(limited(required / (1.0 + total), -0.985, 0.985))
    slip.set_row(v / sigma)


def quadratic(x: Any) -> Any:
    """Return e^x to second order within [-1, 1]."""
    x = limited(x, -1.0, 1.0)
    return 1.0 + x * (1.0 + 0.5 * x)


def inverse_tanh(y: Any) -> Any:
    """Return a number whose tanh is y to two per cent, for |y| up to 0.985."""
    s = y * y
    return y * (1.0 - s * (0.7789 - 0.0936 * s)) / (1.0 - s * (1.1122 - 0.2236 * s))


@unrolled
def evaluate_residual(coupling: Any, slip: Any, law: Any, slope: Any, friction_rate: Any, balance: Any, start: Any,
                      v: Any, change: Any, measure: Any) -> None:
    """Fill `change` with b - L V - beta Ts mubar(V), and measure[LEAST]."""
    speeds = slip.row()
    sums = [0.0, 0.0, 0.0, 0.0]
    for j in range(NODES):
        sums[j % 4] = sums[j % 4] + coupling.row(j, 0) * speeds[j]
    change.set_row((balance.row() - friction_rate.row() * law.row() + start.row() * v)
                   - ((sums[0] + sums[1]) + (sums[2] + sums[3])))
    measure[LEAST,] = folded(lesser, friction_rate.row() * slope.row())


@unrolled
def correct_by_friction(change: Any, slip: Any, friction_rate: Any, slope: Any, sigma: Any) -> None:
    """Correct V by the residual over the slope of friction alone, at most by FOLLOWED."""
    stiffness = friction_rate.row() * limited(slope.row() / sigma, LEAST_SLOPE, 1e300)
    correction = limited(change.row() / stiffness, -FOLLOWED, FOLLOWED)
    slip.set_row(slip.row() + correction / sigma)


@unrolled
def divide(change: Any, diagonal: Any, friction_rate: Any, slope: Any, measure: Any) -> None:
    """Fill Newton's correction by the diagonal of its matrix alone."""
    out = change.row() / (diagonal.row() + friction_rate.row() * slope.row())
    change.set_row(out)
    measure[LARGEST,] = largest_size(out)


@unrolled
def eliminate(change: Any, coupling: Any, friction_rate: Any, slope: Any, measure: Any) -> None:
    """Fill Newton's correction: (L + beta Ts mubar') x = change, by Gauss and Jordan's elimination.

    It needs no pivoting: L is dominated by a^-1, whose leading minors do not vanish, and friction adds to the diagonal
    where it is strong.
    """
    correction, = eliminated(coupling, friction_rate, slope,
                             [[change.row(WIDTH * p, count=WIDTH) for p in range(NODES // WIDTH)]])
    change.set_row(correction)
    measure[LARGEST,] = largest_size(correction)


@unrolled
def eliminate_rows(rows: Any, coupling: Any, friction_rate: Any, slope: Any) -> None:
    """Solve the same equations for every row of `rows`."""
    count, parts = rows.shape[0], range(NODES // WIDTH)
    right = [[rows.row(i, WIDTH * p, count=WIDTH) for p in parts] for i in range(count)]
    for i, correction in enumerate(eliminated(coupling, friction_rate, slope, right)):
        rows.set_row(correction, i, 0)


def eliminated(coupling: Any, friction_rate: Any, slope: Any, sides: list[list[Any]]) -> list[Any]:
    """Return the solutions for right-hand sides, each in parts of WIDTH numbers."""
    parts = range(NODES // WIDTH)
    columns = [[coupling.row(j, WIDTH * p, count=WIDTH) for p in parts] for j in range(NODES)]
    for p in parts:
        added = friction_rate.row(WIDTH * p, count=WIDTH) * slope.row(WIDTH * p, count=WIDTH)
        for lane in range(WIDTH):
            columns[WIDTH * p + lane][p] = columns[WIDTH * p + lane][p] + added * _lanes(lambda i, lane=lane: i == lane)
    inverses = []
    for k in range(NODES):
        vector, lane = divmod(k, WIDTH)
        inverses.append(1.0 / columns[k][vector][lane])
        factors = [part * inverses[k] for part in columns[k]]
        factors[vector] = factors[vector] * _lanes(lambda i, lane=lane: i != lane)
        for column in [*columns[k + 1:], *sides]:
            head = column[vector][lane]
            for p, factor in enumerate(factors):
                column[p] = column[p] - factor * head
    return [row_of([right[k // WIDTH][k % WIDTH] * inverses[k] for k in range(NODES)]) for right in sides]


def _lanes(chosen: Any) -> tuple[float, ...]:
    """Return 1 in the chosen lanes of a part of a column, 0 elsewhere."""
    return tuple(1.0 if chosen(i) else 0.0 for i in range(WIDTH))


@unrolled
def add_share(total: Any, share: Any, weight: Any) -> None:
    """Add a source times its weight."""
    total.set_row(total.row() + share.row() * weight)


@unrolled
def add_slip(slip: Any, shares: Any, chebyshev: Any) -> None:
    """Add the shares of the slip speeds at the nodes to Chebyshev coefficients."""
    speeds, out = slip.row(), chebyshev.row()
    for j in range(NODES):
        out = out + shares.row(j, 0) * speeds[j]
    chebyshev.set_row(out)


@unrolled
def slip_polynomial(slip: Any, v: Any, chebyshev: Any, powers: Any) -> None:
    """Fill the polynomial through v at the start and V at the nodes: Chebyshev coefficients, and powers of x."""
    speeds = slip.row()
    sums = [v * TO_CHEBYSHEV[0], 0.0]
    for j in range(NODES):
        sums[(j + 1) % 2] = sums[(j + 1) % 2] + speeds[j] * TO_CHEBYSHEV[j + 1]
    chebyshev.set_row(sums[0] + sums[1])
    staged_powers(chebyshev, powers)


def staged_powers(chebyshev: Any, powers: Any) -> None:
    """Fill powers of x from Chebyshev coefficients over [0, 1]."""
    coefficients = chebyshev.row()
    out: Any = 0.0
    for i in range(NODES + 1):
        out = out + coefficients[i] * TO_POWERS[i]
    powers.set_row(out, 0)


to_powers = unrolled(staged_powers)


@fast
def follow_manifold(step_size: Any, v: float, sign: float, sigma: float, stribeck: Stribeck, work: Any) -> None:
    """Improve the guess in stick, where V changes little from node to node, by b - L V - beta Ts mubar(V) = 0 with the
    guess in L V. It costs a third of an iteration, and saves one.
    """
    evaluate_law(0, work.slip, work.law, work.slope, sign, sigma, stribeck)
    evaluate_residual(0, step_size.coupling, work.slip, work.law, work.slope, work.friction_rate, work.balance,
                      step_size.start, v, work.change, work.measure)
    correct_by_friction(0, work.change, work.slip, work.friction_rate, work.slope, sigma)


@fast
def law_at_nodes(place: Place, sigma: float, stribeck: Stribeck, work: Any) -> None:
    """Fill mubar and its slope at the nodes; mubar stays constant past the region's edge, where the step is cut."""
    if place.region == SLIDING:
        for i in range(NODES):
            work.law[i], work.slope[i] = place.sign, 0.0
    else:
        evaluate_law(0, work.slip, work.law, work.slope, place.sign, sigma, stribeck)


@fast
def solve_stages(step_size: Any, v: float, place: Place, sharpness: float, sigma: float, stribeck: Stribeck,
                 accuracy: float, work: Any) -> int:
    """Solve by Newton's method from the guess in work.slip; mubar changes with v as fast as `sharpness`, s/rad.

    Returns the iterations, negative where they did not converge to `accuracy` (rad/s).
    """
    slip, law, slope, friction_rate, change = work.slip, work.law, work.slope, work.friction_rate, work.change
    measure, coupling, diagonal = work.measure, step_size.coupling, step_size.diagonal
    law_at_nodes(place, sigma, stribeck, work)
    last = 1e300
    for count in range(1, ITERATIONS_MAXIMUM + 1):
        evaluate_residual(0, coupling, slip, law, slope, friction_rate, work.balance, step_size.start, v, change,
                          measure)
        contraction = 0.0
        if measure[LEAST] > DOMINANT * diagonal[NODES - 1]:
            divide(0, change, diagonal, friction_rate, slope, measure)
            contraction = 0.5
        else:
            eliminate(0, change, coupling, friction_rate, slope, measure)
        size = measure[LARGEST]
        if not size < 1e300:
            return -count
        step = FOLLOWED / (sharpness * size) if sharpness * size > FOLLOWED else 1.0
        for i in range(NODES):
            slip[i] += step * change[i]
        if count > 1:
            contraction = min(size / last, contraction)
        if step == 1.0 and (2.0 * sharpness * size + contraction) * size <= accuracy:
            return count
        if STALLED * last < size <= ROUNDED * accuracy:
            return count
        if count > 4 and size > 2.0 * last:
            return -count
        last = size
        law_at_nodes(place, sigma, stribeck, work)
    return -ITERATIONS_MAXIMUM
