"""The smoothed model over an engine cycle with its tangent and with integrals along the motion, to a tolerance.

Radau IIA of order 5 with three stages and its error estimate: E. Hairer and G. Wanner, Solving Ordinary Differential
Equations II, Sections IV.5 and IV.8. The plate is linear and v + omega2 is driven by the torques alone, so the stages
are three coupled equations for the slip speed, V + G F(V) = b with F the friction torque; the tangent of a step is that
of its converged stages, so it is exact for the step taken.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiled import compiled, engine_torque, saturation_torque, smoothed_and_slope
from tcc_sim.solvers.terms import Terms, excitation_frequency, natural_frequency, stick_speed_of, terms_of
from tcc_sim.trajectory import Floats

RESOLUTION = 0.3
"""Largest phase of the fastest oscillation in one step, rad: what lies between the stages is not looked at."""
STEP_LIMIT = 1_000_000
"""Steps of an engine cycle."""
NEWTON_LIMIT = 12
_S6 = math.sqrt(6.0)
NODES = np.array([0.1 * (4.0 - _S6), 0.1 * (4.0 + _S6), 1.0])
MATRIX = np.array([[(88.0 - 7.0 * _S6) / 360.0, (296.0 - 169.0 * _S6) / 1800.0, (-2.0 + 3.0 * _S6) / 225.0],
                   [(296.0 + 169.0 * _S6) / 1800.0, (88.0 + 7.0 * _S6) / 360.0, (-2.0 - 3.0 * _S6) / 225.0],
                   [(16.0 - _S6) / 36.0, (16.0 + _S6) / 36.0, 1.0 / 9.0]])
ERROR = np.array([-13.0 - 7.0 * _S6, -13.0 + 7.0 * _S6, -1.0]) / 3.0
FILTER = 1.0 / (3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0))
GAUSS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(6))
"""Half the abscissae and weights of the six-point rule."""


def passed(system: System, state: Floats, tangent: Floats, first: int, tolerance: float,
           integrals: Floats | None = None) -> bool:
    """Take state and tangent over engine cycle number `first`, in place; False where the steps do not get through.

    Parameters
    ----------
    system : with the smoothed law
    state : (3,) array: slip speed, plate angle, plate speed (rad/s, rad, rad/s)
    tangent : (3, k) array of disturbances of the state
    first : number of the cycle, which sets the phase of the load
    tolerance : local error relative to the size of the motion, and of the slip speed within its layer
    integrals : (3,) array to which the integrals over time of dT/dv v^2, v^2 and min(dT/dv, 0) are added; see (21)
    """
    terms = terms_of(system)
    return bool(pass_cycle(state, tangent, first, tolerance, system.cycle, longest_step(terms), scales_of(terms),
                           stick_speed_of(terms), terms, workspace(tangent.shape[1]), integrals))


def longest_step(terms: Terms) -> float:
    """The longest step, s."""
    return RESOLUTION / max(natural_frequency(terms), excitation_frequency(terms))


def scales_of(terms: Terms) -> tuple[float, float, float]:
    """The sizes of slip speed within its layer (rad/s), plate angle (rad) and plate speed (rad/s) of a motion."""
    assert terms.smoothing is not None
    torque = abs(terms.mean_torque) + abs(terms.mean_load) + (terms.torque[0] if terms.torque is not None else 0.0)
    angle = max(torque, 1.0) / terms.linear[3]
    speed = angle * natural_frequency(terms)
    return max(min(50.0 / terms.smoothing, speed), 1e-6 * speed), angle, speed


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
def _plate(h: float, linear: Any, plate: Floats, gain: Floats) -> None:
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
def _filtered(error: tuple[float, float, float], slope: float, g: float,
              linear: Any) -> tuple[float, float, float]:
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
def _rates(v: float, angle: float, speed: float, engine: float, friction: float,
           linear: Any) -> tuple[float, float, float]:
    """Right-hand sides of (2a), (2b)."""
    plate = (friction - linear[2] * speed - linear[3] * angle) / linear[1]
    return (engine - friction) / linear[0] - plate, speed, plate


@compiled
def _cubic(x: float, start: float, stages: Floats) -> float:
    """The collocation polynomial of the slip speed at the part x of a step."""
    out: float = start * (x - NODES[0]) * (x - NODES[1]) * (x - NODES[2]) / -(NODES[0] * NODES[1] * NODES[2])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out += (stages[i] * x * (x - NODES[j]) * (x - NODES[k])
                / (NODES[i] * (NODES[i] - NODES[j]) * (NODES[i] - NODES[k])))
    return out


@compiled
def _integrate(h: float, load_time: float, start: float, stages: Floats, peak: float, terms: Any,
               integrals: Floats) -> None:
    """Add a step's integrals, in parts that end where |v| crosses the peak of mubar: there dT/dv changes its sign."""
    a = 0.0
    while a < 1.0:
        b, within = 1.0, abs(_cubic(a + 1e-9, start, stages)) < peak
        for k in range(1, 9):
            x = a + (1.0 - a) * k / 8.0
            if (abs(_cubic(x, start, stages)) < peak) != within:
                low, high = a + (1.0 - a) * (k - 1) / 8.0 + (1e-9 if k == 1 else 0.0), x
                while high - low > 1e-13:
                    middle = 0.5 * (low + high)
                    if (abs(_cubic(middle, start, stages)) < peak) != within:
                        high = middle
                    else:
                        low = middle
                b = high
                break
        for k in range(len(GAUSS)):
            x = 0.5 * (a + b) + GAUSS[k] * (b - a)
            v = _cubic(x, start, stages)
            load = saturation_torque(load_time + x * h, terms.mean_load, terms.pulsation)
            slope = load * smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1]
            weight = WEIGHTS[k] * (b - a) * h
            integrals[0] += weight * slope * v * v
            integrals[1] += weight * v * v
            integrals[2] += weight * min(slope, 0.0)
        a = b


@compiled
def _stages(v: float, angle: float, speed: float, h: float, tau: float, before: float, accuracy: float, terms: Any,
            work: Floats) -> bool:
    """Newton's method on V + G F(V) = b from the guesses in work[6, :3]; whether it converged.

    V stays in work[6, :3], F in work[7, :3], dF/dv in work[8, :3]; work[0:3] is the linear part, work[3:6, :3] is G.
    """
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
def _carry(h: float, tangent: Floats, linear: Any, work: Floats) -> None:
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
def pass_cycle(state: Floats, tangent: Floats, number: int, tolerance: float, cycle: float, longest: float,
               scales: tuple[float, float, float], peak: float, terms: Any, work: Floats,
               integrals: Floats | None) -> bool:
    """See `passed`."""
    v, angle, speed = state[0], state[1], state[2]
    linear, before = terms.linear, number * cycle
    stiffness, inertia2 = linear[3], linear[1]
    tau, h, previous = 0.0, 0.1 * longest, 0.0
    stages, old = work[6, :3], np.zeros(4)
    for _ in range(STEP_LIMIT):
        h = min(h, longest)
        last = tau + h * (1.0 + 1e-9) >= cycle
        if last:
            h = cycle - tau
        _plate(h, linear, work[:3], work[3:6])
        size = tolerance * (scales[0] + abs(v))
        for i in range(3):
            stages[i] = _cubic(1.0 + NODES[i] * h / previous, old[3], old[:3]) if previous > 0.0 else v
        if not _stages(v, angle, speed, h, tau, before, max(1e-4 * size, 4e-16 * abs(v)), terms, work):
            h *= 0.25
            previous = 0.0
            if not h > 1e-17 * cycle:
                return False
            continue
        shift, turn, swing = 0.0, 0.0, 0.0
        end_angle, end_speed = angle, speed
        for i in range(3):
            u = speed * (1.0 - work[i, 6])
            for j in range(3):
                u += work[i, 3 + j] * (work[7, j] - stiffness * angle) / inertia2
            work[9, i] = u
        for i in range(3):
            at = angle
            for j in range(3):
                at += h * MATRIX[i, j] * work[9, j]
            shift += ERROR[i] * (stages[i] - v) / h
            turn += ERROR[i] * (at - angle) / h
            swing += ERROR[i] * (work[9, i] - speed) / h
            end_angle, end_speed = at, work[9, i]
        engine = engine_torque(tau, terms.mean_torque, terms.torque, terms.harmonics)
        load = saturation_torque(before + tau, terms.mean_load, terms.pulsation)
        value, slope = smoothed_and_slope(v, terms.smoothing, terms.stribeck)
        rate = _rates(v, angle, speed, engine, load * value, linear)
        far = _filtered((rate[0] + shift, rate[1] + turn, rate[2] + swing), load * slope, h * FILTER, linear)
        error = max(abs(far[0]) / size, abs(far[1]) / (tolerance * scales[1]), abs(far[2]) / (tolerance * scales[2]))
        if error > 1.0:
            value = smoothed_and_slope(v + far[0], terms.smoothing, terms.stribeck)[0]
            rate = _rates(v + far[0], angle + far[1], speed + far[2], engine, load * value, linear)
            far = _filtered((rate[0] + shift, rate[1] + turn, rate[2] + swing), load * slope, h * FILTER, linear)
            error = max(abs(far[0]) / size, abs(far[1]) / (tolerance * scales[1]),
                        abs(far[2]) / (tolerance * scales[2]))
        factor = min(5.0, max(0.2, 0.9 * (error + 1e-12) ** -0.25))
        if not error <= 1.0:
            h *= min(factor, 0.9)
            previous = 0.0
            if not h > 1e-17 * cycle:
                return False
            continue
        if integrals is not None:
            _integrate(h, before + tau, v, stages, peak, terms, integrals)
        if tangent.shape[1] > 0:
            _carry(h, tangent, linear, work)
        old[:3], old[3], previous = stages, v, h
        v, angle, speed = stages[2], end_angle, end_speed
        tau += h
        h *= factor
        if last:
            state[0], state[1], state[2] = v, angle, speed
            return True
    return False
