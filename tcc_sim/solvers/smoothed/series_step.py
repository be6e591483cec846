"""Taylor series of the equations of motion about a point, with friction law (7) by recurrence.

The recurrences are those of automatic differentiation (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, Sec. I.8): E = exp(-alpha |v|) from E' = -alpha sgn(v) v' E, T = tanh(sigma v) from T' = sigma (1 - T^2)
v', sines by their own recurrence. Coefficients are in scaled time x = t/H, so that none of them overflows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.compiled import compiled_without_allocation
from tcc_sim.solvers.step_output import ANGLE, FLYWHEEL, SLIP, SPEED

SLIDING, FALLING, LAYER = 0, 1, 2
"""Which parts of mubar vary: none (|v| so large that mubar = sgn v to the last bit), the exponential, all."""

ENGINE, LOAD, EXCESS, TANH, SECH, WEIGHTED, LAW = range(4, 11)
"""Rows of the recurrences, after those of the states: Te, Ts, E, T, 1 - T^2, (k + 1) v_(k+1), mubar."""

ORDER_MAXIMUM = 30
TWO_PI = 2.0 * math.pi

INVERSE = 1.0 / np.maximum(np.arange(ORDER_MAXIMUM + 2), 1.0)
"""1/k: the recurrences multiply by it, a division being the slowest thing in them."""


@compiled_without_allocation
def add_sine(series: Any, row: int, count: int, amplitude: float, rate: float, angle: float) -> None:
    """Add the first `count` Taylor coefficients of amplitude sin(angle + rate x) to a row."""
    a, b = amplitude * math.sin(angle), amplitude * math.cos(angle)
    for k in range(count):
        series[row, k] += a
        g = rate * INVERSE[k + 1]
        a, b = g * b, -g * a


@compiled_without_allocation
def excitation(series: Any, count: int, scale: float, tau: float, shift: float, loaded: bool, mean_torque: float,
               torque: tuple[float, float] | None, harmonics: Any, mean_load: float,
               pulsation: tuple[float, float, float] | None) -> None:
    """Taylor coefficients in t/scale of Te and Ts at time `tau` into a cycle that starts at pressure angle `shift`."""
    for k in range(count):
        series[ENGINE, k] = 0.0
    series[ENGINE, 0] = mean_torque
    if torque is not None:
        add_sine(series, ENGINE, count, torque[0], torque[1] * scale, torque[1] * tau)
    if harmonics is not None:
        for i in range(harmonics.shape[0]):
            rate = harmonics[i, 0]
            add_sine(series, ENGINE, count, harmonics[i, 1], rate * scale, rate * tau + harmonics[i, 2])
    if pulsation is None:
        series[LOAD, 0] = mean_load
    else:
        for k in range(count):
            series[LOAD, k] = 0.0
        if loaded:
            series[LOAD, 0] = mean_load
            add_sine(series, LOAD, count, pulsation[0], pulsation[1] * scale, pulsation[1] * tau + shift)


@compiled_without_allocation
def segment_end(tau: float, end: float, shift: float, mean_load: float,
                pulsation: tuple[float, float, float] | None) -> tuple[float, bool]:
    """The next time at which the clamp of Ts at 0 sets in or ends, at most `end`, and whether Ts is above 0 until then.
    """
    if pulsation is None:
        return end, mean_load > 0.0
    else:
        amplitude, rate = pulsation[0], pulsation[1]
        if abs(amplitude) <= mean_load:
            return end, mean_load > 0.0
        angle = (rate * tau + shift) % TWO_PI
        below = math.asin(mean_load / abs(amplitude))
        closing = math.pi + below if amplitude > 0.0 else below
        opening = TWO_PI - below if amplitude > 0.0 else math.pi - below
        ahead = math.inf
        for turn in range(3):
            for edge in (closing, opening):
                distance = edge + (turn - 1) * TWO_PI - angle
                if distance > 1e-11:
                    ahead = min(ahead, distance)
        until = min(end, tau + ahead / rate)
        middle = rate * (0.5 * (tau + until)) + shift
        return until, mean_load + amplitude * math.sin(middle) > 0.0


@compiled_without_allocation
def product(series: Any, a: int, b: int, k: int) -> float:
    """Coefficient k of the product of the series in rows a and b."""
    total = 0.0
    for j in range(k + 1):
        total += series[a, j] * series[b, k - j]
    return total


@compiled_without_allocation
def expand(series: Any, order: int, base_rate: float, state: Any, tau: float, shift: float, region: int, sign: float,
           loaded: bool, linear: Linear, mean_torque: float, torque: tuple[float, float] | None, harmonics: Any,
           mean_load: float, pulsation: tuple[float, float, float] | None, sigma: float,
           stribeck: Stribeck) -> tuple[float, float]:
    """Taylor coefficients 0 to `order` of slip speed, plate angle and plate speed (rows 0, 1, 2 of `series`).

    Parameters
    ----------
    series : (11, ORDER_MAXIMUM + 2) array, filled; the rows from ENGINE on are work space
    base_rate : sum of the rates (1/s) that are there in every region; it scales time together with those of friction
    state : (3,) array, slip speed, plate angle, plate speed
    region, sign : SLIDING, FALLING or LAYER; the sign of v, which is kept over the step
    loaded : False where Ts is clamped at 0

    Returns
    -------
    H (s), the unit of time of the coefficients, and the slope -d(v')/dv of friction, 1/s
    """
    flywheel, plate = 1.0 / linear[0], 1.0 / linear[1]
    scale = 1.0 / base_rate
    excitation(series, order, scale, tau, shift, loaded, mean_torque, torque, harmonics, mean_load, pulsation)
    v, angle, speed = state[0], state[1], state[2]
    series[SLIP, 0] = v
    series[ANGLE, 0] = angle
    series[SPEED, 0] = speed
    series[LAW, 0] = sign
    slope = 0.0
    excess = 0.0
    decay = 0.0
    if stribeck is not None and region != SLIDING:
        excess = stribeck[0]
        decay = -stribeck[1] * sign
        series[EXCESS, 0] = excess * math.exp(decay * v)
        series[LAW, 0] = sign * (1.0 + series[EXCESS, 0])
        slope = sign * decay * series[EXCESS, 0]
    if region == LAYER:
        e = math.exp(-2.0 * sigma * abs(v))
        series[TANH, 0] = math.copysign((1.0 - e) / (1.0 + e), v)
        series[SECH, 0] = 4.0 * e / ((1.0 + e) * (1.0 + e))
        if stribeck is None:
            series[LAW, 0] = series[TANH, 0]
            slope = sigma * series[SECH, 0]
        else:
            series[LAW, 0] = series[TANH, 0] * (1.0 + series[EXCESS, 0])
            slope = sigma * series[SECH, 0] * (1.0 + series[EXCESS, 0]) + decay * series[EXCESS, 0] * series[TANH, 0]
    if not loaded:
        series[LAW, 0] = 0.0
        slope = 0.0
    beta = flywheel + plate
    friction = series[LAW, 0] * series[LOAD, 0]
    spring = linear[2] * speed + linear[3] * angle
    rate = abs((series[ENGINE, 0] - friction) * flywheel - (friction - spring) * plate)
    rho = beta * series[LOAD, 0] * slope
    if region == SLIDING:
        unit = scale
    elif region == FALLING:
        unit = 1.0 / (base_rate + abs(decay) * rate + abs(rho))
    else:
        unit = 1.0 / (base_rate + (abs(decay) + sigma) * rate + abs(rho))
    ratio = unit * base_rate
    power = 1.0
    for k in range(order):
        if region == SLIDING:
            friction = series[LAW, 0] * series[LOAD, k] * power if (pulsation is not None or k == 0) else 0.0
        else:
            if k > 0:
                series[WEIGHTED, k - 1] = k * series[SLIP, k]
                if stribeck is not None:
                    series[EXCESS, k] = decay * product(series, WEIGHTED, EXCESS, k - 1) * INVERSE[k]
                    series[LAW, k] = sign * series[EXCESS, k]
                if region == LAYER:
                    series[TANH, k] = sigma * product(series, WEIGHTED, SECH, k - 1) * INVERSE[k]
                    series[SECH, k] = -product(series, TANH, TANH, k)
                    if stribeck is None:
                        series[LAW, k] = series[TANH, k]
                    else:
                        series[LAW, k] = series[TANH, k] + product(series, EXCESS, TANH, k)
            if pulsation is None:
                friction = series[LAW, k] * series[LOAD, 0]
            else:
                series[LOAD, k] *= power
                friction = product(series, LAW, LOAD, k)
        spring = linear[2] * series[SPEED, k] + linear[3] * series[ANGLE, k]
        step = unit * INVERSE[k + 1]
        pull = (friction - spring) * plate
        series[SLIP, k + 1] = step * ((series[ENGINE, k] * power - friction) * flywheel - pull)
        series[SPEED, k + 1] = step * pull
        series[ANGLE, k + 1] = step * series[SPEED, k]
        power *= ratio
    return unit, rho


@compiled_without_allocation
def step_length(series: Any, order: int, slip_tolerance: float, speed_tolerance: float) -> float:
    """The step, in units of the series' own time, at which its last two terms reach the tolerance."""
    x = math.inf
    for k in range(order - 1, order + 1):
        size = max(abs(series[SLIP, k]) / slip_tolerance, abs(series[SPEED, k]) / speed_tolerance)
        if size > 0.0:
            x = min(x, size ** (-1.0 / k))
    return x


@compiled_without_allocation
def add_angle(series: Any, order: int, unit: float, state: Any) -> None:
    """Taylor coefficients of theta1, the integral of slip speed + plate speed."""
    series[FLYWHEEL, 0] = state[3]
    for k in range(order):
        series[FLYWHEEL, k + 1] = unit * (series[SLIP, k] + series[SPEED, k]) / (k + 1.0)


@compiled_without_allocation
def falling_length(series: Any, order: int, x: float, sign: float, stribeck: tuple[float, float], strength: float,
                   slip_tolerance: float) -> float:
    """A step of at most x over which the series of exp(-alpha |v|) is accurate too.

    While slip dies down the coefficients of that series rise up to order z = alpha |change of v|, far beyond the last
    ones kept where z is large, which the last two terms do not show. (Below z = order/2 they do: each is at most half
    of the one before.) Lagrange's remainder z^(p + 1)/(p + 1)! does, times the larger of the two end values of the
    exponential.
    """
    excess, decay = stribeck
    goal = math.log(slip_tolerance) + math.lgamma(order + 2.0)
    while True:
        change = decay * sign * (series[SLIP, 1] * x + series[SLIP, 2] * x * x)
        z = abs(change)
        if z <= 0.5 * order:
            return x
        remainder = math.log(strength * excess * x) - decay * abs(series[SLIP, 0]) + max(-change, 0.0)
        if not remainder + (order + 1.0) * math.log(z) > goal:
            return x
        x *= 0.85
