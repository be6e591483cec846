"""Radau IIA collocation for the layer and for stick, its stages reduced to as many scalar equations.

The only nonlinearity is the friction torque f(v), and it enters through a constant vector, so the linear part is
eliminated by hand. With a = h A (A the Runge-Kutta matrix), V, W the stage slip and plate speeds and F the friction
torques,

    (I2 + C23 a + K23 a^2) (W - w0) = a F - h c (C23 w0 + K23 theta0) - a h c K23 w0,    V + W = v0 + w0 + a (Te -
    F)/I1,

hence V + G F = V_free with G = a/I1 + (I2 + C23 a + K23 a^2)^-1 a, solved by Newton's method.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Sec. IV.5 and IV.8.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.compiled import compiled_without_allocation, engine_torque
from tcc_sim.solvers.polynomial import value

STAGES = 5
ITERATIONS_MAXIMUM = 10

Floats = NDArray[np.float64]


def tableau(stages: int) -> tuple[Floats, Floats, Floats]:
    """Nodes c (s,), matrix A (s, s), and the matrix that gives a collocation polynomial's coefficients of x to x^s.

    The nodes are the zeros of P_s(2 c - 1) - P_(s-1)(2 c - 1), the last of them 1.
    """
    legendre = np.zeros(stages + 1)
    legendre[stages], legendre[stages - 1] = 1.0, -1.0
    nodes = np.sort(np.real(np.polynomial.legendre.legroots(legendre)))
    nodes[-1] = 1.0
    c = (nodes + 1.0) / 2.0
    c[-1] = 1.0
    k = np.arange(1, stages + 1)
    powers = c[:, None] ** (k - 1)
    matrix = (c[:, None] ** k / k) @ np.linalg.inv(powers)
    return c, np.asarray(matrix, np.float64), np.asarray(np.linalg.inv(c[:, None] ** k), np.float64)


NODES, MATRIX, MONOMIALS = tableau(STAGES)
SQUARE = MATRIX @ MATRIX
LAST_TERM = 0.5 ** (2 * STAGES - 1)
"""Size over [0, 1] of a polynomial's last term in shifted Chebyshev form, per coefficient of x^s."""


@compiled_without_allocation
def eliminate(matrix: Any, right: Any, columns: int) -> None:
    """Solve matrix X = right in place (right becomes X) by Gaussian elimination with partial pivoting."""
    n = STAGES
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            for j in range(columns):
                right[k, j], right[pivot, j] = right[pivot, j], right[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]
                for j in range(columns):
                    right[i, j] -= factor * right[k, j]
    for j in range(columns):
        for k in range(n - 1, -1, -1):
            total = right[k, j]
            for i in range(k + 1, n):
                total -= matrix[k, i] * right[i, j]
            right[k, j] = total / matrix[k, k]


@compiled_without_allocation
def prepare(matrix: Any, right: Any, gain: Any, h: float, linear: Linear) -> None:
    """What depends on the step only: (I2 + C23 a + K23 a^2)^-1 [a h c, h c, a] in `right`, and G in `gain`."""
    n = STAGES
    for i in range(n):
        right[i, 0] = 0.5 * (h * NODES[i]) ** 2
        right[i, 1] = h * NODES[i]
        for j in range(n):
            matrix[i, j] = linear[2] * h * MATRIX[i, j] + linear[3] * h * h * SQUARE[i, j]
            right[i, 2 + j] = h * MATRIX[i, j]
        matrix[i, i] += linear[1]
    eliminate(matrix, right, n + 2)
    for i in range(n):
        for j in range(n):
            gain[i, j] = h * MATRIX[i, j] / linear[0] + right[i, 2 + j]


@compiled_without_allocation
def law_and_slope(v: float, sign: float, sigma: float, stribeck: Stribeck) -> tuple[float, float]:
    """mubar of (7) and its slope, with |v| continued as sign * v through v = 0: the kink there is a step boundary."""
    e = math.exp(-2.0 * sigma * abs(v))
    tanh = math.copysign((1.0 - e) / (1.0 + e), v)
    slope = sigma * 4.0 * e / ((1.0 + e) * (1.0 + e))
    if stribeck is None:
        return tanh, slope
    else:
        decay = -stribeck[1] * sign
        falling = stribeck[0] * math.exp(min(decay * v, 1.0))
        return (1.0 + falling) * tanh, slope * (1.0 + falling) + decay * falling * tanh


@compiled_without_allocation
def balance(matrix: Any, gain: Any, newton: Any, free: Any, stage: Any, sigma: float, stribeck: Stribeck) -> None:
    """A better guess where the step is long beside 1/(beta Ts sigma): the torques G^-1 (V_free - V), and V again from
    them.

    An error of the guess shrinks by about the step over that time, however far it is beyond Newton's reach.
    """
    for i in range(STAGES):
        newton[i, 0] = free[i, 0] - stage[0, i]
        for j in range(STAGES):
            matrix[i, j] = gain[i, j]
    eliminate(matrix, newton, 1)
    for i in range(STAGES):
        mubar = newton[i, 0] / stage[5, i] if stage[5, i] > 0.0 else 2.0
        if stribeck is not None:
            mubar /= 1.0 + stribeck[0] * math.exp(-stribeck[1] * abs(stage[0, i]))
        if abs(mubar) < 0.9999:
            stage[0, i] = 0.5 * math.log((1.0 + mubar) / (1.0 - mubar)) / sigma


@compiled_without_allocation
def solve_stages(matrix: Any, right: Any, gain: Any, newton: Any, free: Any, stage: Any, h: float, state: Any,
                 sign: float,
                 linear: Linear, sigma: float, stribeck: Stribeck, accuracy: float, rate: float, stiff: bool) -> int:
    """Newton's method for the stage slip speeds: rows 0 to 5 of `stage` are V, W, theta2, F, Te, Ts.

    V holds the first guess, Te and Ts are given; `stiff` improves the guess by `balance`; `rate` (s/rad) is how fast
    mubar' changes with v. F comes out as the linear equations have it, so that momentum is kept to rounding whatever
    the last correction was. Returns the number of iterations, negative where it did not converge.
    """
    n = STAGES
    v, theta, speed = state[0], state[1], state[2]
    spring, stiffness = linear[2] * speed + linear[3] * theta, linear[3] * speed
    for i in range(n):
        impulse = 0.0
        for j in range(n):
            impulse += h * MATRIX[i, j] * stage[4, j]
        drop = spring * right[i, 1] + stiffness * right[i, 0]
        stage[1, i] = speed - drop
        free[i, 0] = v + (drop + impulse / linear[0])
    if stiff:
        balance(matrix, gain, newton, free, stage, sigma, stribeck)
    count = 0
    last = math.inf
    while True:
        count += 1
        for i in range(n):
            mubar, slope = law_and_slope(stage[0, i], sign, sigma, stribeck)
            stage[3, i] = stage[5, i] * mubar
            free[i, 1] = stage[5, i] * slope
        for i in range(n):
            residual = free[i, 0] - stage[0, i]
            for j in range(n):
                residual -= gain[i, j] * stage[3, j]
                matrix[i, j] = gain[i, j] * free[j, 1]
            matrix[i, i] += 1.0
            newton[i, 0] = residual
        eliminate(matrix, newton, 1)
        size = 0.0
        for i in range(n):
            size = max(size, abs(newton[i, 0]))
        if not size < math.inf:
            return -count
        limit = min(1.0, 2.0 / (rate * size)) if rate * size > 0.0 else 1.0
        for i in range(n):
            step = limit * newton[i, 0]
            stage[0, i] += step
            stage[3, i] += free[i, 1] * step
        if limit == 1.0 and rate * size * size <= accuracy:
            break
        if count >= ITERATIONS_MAXIMUM or (count > 4 and size > 2.0 * last):
            return -count
        last = size
    for i in range(n):
        for j in range(n):
            stage[1, i] += right[i, 2 + j] * stage[3, j]
    for i in range(n):
        stage[2, i] = theta
        for j in range(n):
            stage[2, i] += h * MATRIX[i, j] * stage[1, j]
    return count


@compiled_without_allocation
def collocation(trial: Any, row: int, first: float, stage: Any, kind: int) -> None:
    """Coefficients 0 to s in x = t/h of the polynomial through `first` at 0 and row `kind` of `stage` at the nodes."""
    trial[row, 0] = first
    for k in range(STAGES):
        total = 0.0
        for i in range(STAGES):
            total += MONOMIALS[k, i] * (stage[kind, i] - first)
        trial[row, k + 1] = total


@compiled_without_allocation
def fill(stage: Any, previous: Any, base: float, ratio: float, h: float, tau: float, shift: float, loaded: bool,
         mean_torque: float, torque: tuple[float, float] | None, harmonics: Any, mean_load: float,
         pulsation: tuple[float, float, float] | None) -> None:
    """Te and Ts at the nodes, and a first guess of V: the polynomial `previous` at base + ratio c."""
    for i in range(STAGES):
        t = tau + NODES[i] * h
        stage[4, i] = engine_torque(t, mean_torque, torque, harmonics)
        load = mean_load
        if pulsation is not None:
            load = max(mean_load + pulsation[0] * math.sin(pulsation[1] * t + shift), 0.0)
        stage[5, i] = load if loaded else 0.0
        stage[0, i] = value(previous, 0, STAGES, base + ratio * NODES[i])
