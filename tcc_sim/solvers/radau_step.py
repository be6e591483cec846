"""A step of the smoothed model with its tangent: Radau IIA of order 5 with three stages and its error estimate.

E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Sections IV.5 and IV.8. The plate is linear and
v + omega2 is driven by the torques alone, so the stages are three coupled equations for the slip speed,
V + G F(V) = b with F the friction torque. The tangent of a step is that of its converged stages, so it is exact for the
step taken.

The workspace of a step holds the linear part in work[0:3], G in work[3:6, :3], the stages V in work[6, :3], F and dF/dv
in work[7, :3] and work[8, :3], the plate speeds in work[9, :3], and room for a linear system in work[10:13].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.solvers.compiling.compiled import compiled, engine_torque, saturation_torque, smoothed_and_slope
from tcc_sim.trajectory import Floats

NEWTON_LIMIT = 12
_S6 = math.sqrt(6.0)
NODES = np.array([0.1 * (4.0 - _S6), 0.1 * (4.0 + _S6), 1.0])
MATRIX = np.array([[(88.0 - 7.0 * _S6) / 360.0, (296.0 - 169.0 * _S6) / 1800.0, (-2.0 + 3.0 * _S6) / 225.0],
                   [(296.0 + 169.0 * _S6) / 1800.0, (88.0 + 7.0 * _S6) / 360.0, (-2.0 - 3.0 * _S6) / 225.0],
                   [(16.0 - _S6) / 36.0, (16.0 + _S6) / 36.0, 1.0 / 9.0]])
ERROR = np.array([-13.0 - 7.0 * _S6, -13.0 + 7.0 * _S6, -1.0]) / 3.0
FILTER = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))

Three = tuple[float, float, float]


def workspace(columns: int) -> Floats:
    """Room for the matrices of a step with a tangent of some columns, (13, max(7, 3 + columns))."""
    return np.zeros((13, max(7, 3 + columns)))


@compiled
def _eliminate(a: Floats, columns: int) -> None:
    """Solve the three equations a[:, :3] x = a[:, 3:3 + columns] in place by elimination with row exchanges."""
    for k in range(3):
        pivot = k
        for i in range(k + 1, 3):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(3 + columns):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        for i in range(k + 1, 3):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, 3 + columns):
                a[i, j] -= factor * a[k, j]
    for j in range(3, 3 + columns):
        a[2, j] /= a[2, 2]
        a[1, j] = (a[1, j] - a[1, 2] * a[2, j]) / a[1, 1]
        a[0, j] = (a[0, j] - a[0, 1] * a[1, j] - a[0, 2] * a[2, j]) / a[0, 0]


@compiled
def plate_of_step(h: float, linear: Any, plate: Floats, gain: Floats) -> None:
    """The linear part of a step of h: D B in plate[:, 3:6], D P 1 in plate[:, 6], and G in gain[:, :3].

    B = h A, P = B C23/I2 + B B K23/I2 and D = (I + P)^-1; U = omega2 (1 - D P 1) + D B (F - K23 theta2)/I2.
    """
    inertia1, inertia2, damping, stiffness = linear
    for i in range(3):
        plate[i, 6] = 0.0
        for j in range(3):
            square = 0.0
            for k in range(3):
                square += MATRIX[i, k] * MATRIX[k, j]
            p = h * (MATRIX[i, j] * damping + h * square * stiffness) / inertia2
            plate[i, j] = p
            plate[i, 6] += p
            plate[i, 3 + j] = h * MATRIX[i, j]
        plate[i, i] += 1.0
    _eliminate(plate, 4)
    for i in range(3):
        for j in range(3):
            gain[i, j] = h * MATRIX[i, j] / inertia1 + plate[i, 3 + j] / inertia2


@compiled
def stages_of_step(at: Three, h: float, tau: float, before: float, accuracy: float, terms: Any, work: Floats) -> bool:
    """Newton's method on V + G F(V) = b from the guesses in work[6, :3]; whether it converged.

    at : slip speed, plate angle and plate speed at the start of the step, the time tau of the cycle (s)
    before : s before the cycle
    accuracy : of the stages, rad/s
    """
    v, angle, speed = at
    stiffness, inertia1, inertia2 = terms.linear[3], terms.linear[0], terms.linear[1]
    known, matrix = work[9], work[10:13]
    torque = (engine_torque(tau + NODES[0] * h, terms.mean_torque, terms.torque, terms.harmonics),
              engine_torque(tau + NODES[1] * h, terms.mean_torque, terms.torque, terms.harmonics),
              engine_torque(tau + NODES[2] * h, terms.mean_torque, terms.torque, terms.harmonics))
    load = (saturation_torque(before + tau + NODES[0] * h, terms.mean_load, terms.pulsation),
            saturation_torque(before + tau + NODES[1] * h, terms.mean_load, terms.pulsation),
            saturation_torque(before + tau + NODES[2] * h, terms.mean_load, terms.pulsation))
    for i in range(3):
        pushed = h * (MATRIX[i, 0] * torque[0] + MATRIX[i, 1] * torque[1] + MATRIX[i, 2] * torque[2]) / inertia1
        turned = (work[i, 3] + work[i, 4] + work[i, 5]) * stiffness * angle / inertia2
        known[i] = v + work[i, 6] * speed + turned + pushed
    for _ in range(NEWTON_LIMIT):
        for i in range(3):
            value, slope = smoothed_and_slope(work[6, i], terms.smoothing, terms.stribeck)
            work[7, i], work[8, i] = load[i] * value, load[i] * slope
        for i in range(3):
            matrix[i, 3] = known[i] - work[6, i]
            for j in range(3):
                matrix[i, j] = work[3 + i, j] * work[8, j]
                matrix[i, 3] -= work[3 + i, j] * work[7, j]
            matrix[i, i] += 1.0
        _eliminate(matrix, 1)
        change = 0.0
        for i in range(3):
            work[6, i] += matrix[i, 3]
            change = max(change, abs(matrix[i, 3]))
        if not change < 1e12:
            return False
        if change <= accuracy:
            for i in range(3):
                value, slope = smoothed_and_slope(work[6, i], terms.smoothing, terms.stribeck)
                work[7, i], work[8, i] = load[i] * value, load[i] * slope
            return True
    return False


@compiled
def _filtered(error: Three, slope: float, g: float, linear: Any) -> Three:
    """(I - g J)^-1 g error with the Jacobian J at a friction slope dT/dv."""
    inertia1, inertia2, damping, stiffness = linear
    spring = g * (damping + g * stiffness) / inertia2
    a, b, c = g * error[0], g * error[1], g * error[2]
    push = g * stiffness / inertia2 * b
    p, q = 1.0 + g * slope * (1.0 / inertia1 + 1.0 / inertia2), -g * slope / inertia2
    r, s = a + push, c - push
    determinant = p * (1.0 + spring) + q * spring
    v = (r * (1.0 + spring) + s * spring) / determinant
    u = (p * s - q * r) / determinant
    return v, b + g * u, u


@compiled
def _rates(v: float, angle: float, speed: float, engine: float, friction: float, linear: Any) -> Three:
    """Right-hand sides of (2a), (2b)."""
    plate = (friction - linear[2] * speed - linear[3] * angle) / linear[1]
    return (engine - friction) / linear[0] - plate, speed, plate


@compiled
def end_of_step(at: Three, h: float, tau: float, before: float, sizes: Three, terms: Any,
                work: Floats) -> tuple[Three, float]:
    """The state at the end of a step whose stages are in the workspace, and its error over `sizes`."""
    v, angle, speed = at
    linear, stages = terms.linear, work[6, :3]
    shift, turn, swing = 0.0, 0.0, 0.0
    end = angle
    for i in range(3):
        u = speed * (1.0 - work[i, 6])
        for j in range(3):
            u += work[i, 3 + j] * (work[7, j] - linear[3] * angle) / linear[1]
        work[9, i] = u
    for i in range(3):
        end = angle
        for j in range(3):
            end += h * MATRIX[i, j] * work[9, j]
        shift += ERROR[i] * (stages[i] - v) / h
        turn += ERROR[i] * (end - angle) / h
        swing += ERROR[i] * (work[9, i] - speed) / h
    engine = engine_torque(tau, terms.mean_torque, terms.torque, terms.harmonics)
    load = saturation_torque(before + tau, terms.mean_load, terms.pulsation)
    far, slope, error = (0.0, 0.0, 0.0), 0.0, 2.0
    for again in range(2):
        # An error that is too large is looked at once more from where it points: the first may be that of stiff parts.
        if error > 1.0:
            value, steep = smoothed_and_slope(v + far[0], terms.smoothing, terms.stribeck)
            slope = steep if again == 0 else slope
            rate = _rates(v + far[0], angle + far[1], speed + far[2], engine, load * value, linear)
            far = _filtered((rate[0] + shift, rate[1] + turn, rate[2] + swing), load * slope, h * FILTER, linear)
            error = max(abs(far[0]) / sizes[0], abs(far[1]) / sizes[1], abs(far[2]) / sizes[2])
    return (stages[2], end, work[9, 2]), error


@compiled
def carry_tangent(h: float, tangent: Floats, linear: Any, work: Floats) -> None:
    """Take the tangent over the step whose stages are in the workspace."""
    inertia2, stiffness = linear[1], linear[3]
    columns = tangent.shape[1]
    matrix = work[10:13]
    for i in range(3):
        for j in range(3):
            matrix[i, j] = work[3 + i, j] * work[8, j]
        matrix[i, i] += 1.0
        turn = (work[i, 3] + work[i, 4] + work[i, 5]) * stiffness / inertia2
        for k in range(columns):
            matrix[i, 3 + k] = tangent[0, k] + work[i, 6] * tangent[2, k] + turn * tangent[1, k]
    _eliminate(matrix, columns)
    for k in range(columns):
        angle, speed, last = tangent[1, k], tangent[2, k], 0.0
        total = angle
        for i in range(3):
            last = speed * (1.0 - work[i, 6])
            for j in range(3):
                last += work[i, 3 + j] * (work[8, j] * matrix[j, 3 + k] - stiffness * angle) / inertia2
            total += h * MATRIX[2, i] * last
        tangent[0, k], tangent[1, k], tangent[2, k] = matrix[2, 3 + k], total, last


@compiled
def slip_within(x: float, start: float, stages: Floats) -> float:
    """The collocation polynomial of the slip speed at the part x of a step."""
    out: float = start * (x - NODES[0]) * (x - NODES[1]) * (x - NODES[2]) / -(NODES[0] * NODES[1] * NODES[2])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out += (stages[i] * x * (x - NODES[j]) * (x - NODES[k])
                / (NODES[i] * (NODES[i] - NODES[j]) * (NODES[i] - NODES[k])))
    return out
