"""The compiled march of the smoothed engine: which method takes the next step, how long it is, and what is kept of it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import polynomial
from tcc_sim.solvers import step_output as keeping
from tcc_sim.solvers.compiled import accelerations, compiled, engine_torque, smoothed
from tcc_sim.solvers.smoothed import collocation_step as radau
from tcc_sim.solvers.smoothed import series_step as taylor
from tcc_sim.solvers.smoothed.collocation_step import LAST_TERM, STAGES
from tcc_sim.solvers.smoothed.series_step import FALLING, LAYER, ORDER_MAXIMUM, SLIDING, TWO_PI
from tcc_sim.solvers.step_output import (
    ANGLE,
    CYCLES,
    FLYWHEEL,
    ITERATIONS,
    ITERATIONS_MAX,
    REJECTED,
    SAMPLES,
    SLIP,
    SPEED,
    STATUS,
    STEPS,
)

DONE, STEP_LIMIT, STEP_TOO_SMALL, NOT_FINITE = range(4)
CALM = 4
"""Series steps on the slow manifold after which Radau is tried again, where its error had sent it away; doubles each
time.
"""
PATIENCE = 16
"""Series steps of equal length, the mark of a step that stability limits, after which Radau is tried; doubles each
time.
"""


@compiled
def march(state: Any, tally: Any, scales: Any, first: int, count: int, tail: float, period: float,
          frequency_ratio: float,
          step_limit: int, rtol: float, order: int, linear_order: int, per_cycle: int, samples: Any, section: Any,
          highest: Any, lowest: Any, stick_time: Any, times: Any, before: Any, after: Any, stick_speed: float,
          angle: Any,
          linear: Linear, mean_torque: float, torque: tuple[float, float] | None, harmonics: Any, mean_load: float,
          pulsation: tuple[float, float, float] | None, sigma: float, stribeck: Stribeck) -> None:
    """Solve `count` engine cycles from cycle `first` on, and then `tail` seconds of one more."""
    series = np.zeros((11, ORDER_MAXIMUM + 2))
    trial = np.zeros((4, STAGES + 1))
    previous = np.zeros((1, STAGES + 1))
    matrix, gain = np.zeros((STAGES, STAGES)), np.zeros((STAGES, STAGES))
    right, newton, free = np.zeros((STAGES, STAGES + 2)), np.zeros((STAGES, 1)), np.zeros((STAGES, 2))
    stage = np.zeros((7, STAGES))
    extent = np.zeros(3)
    i1, i2, damping, stiffness = linear
    beta = 1.0 / i1 + 1.0 / i2
    base_rate = math.sqrt(stiffness / i2) + damping / i2 + TWO_PI / period
    if harmonics is not None:
        base_rate += harmonics[:, 0].max()
    if pulsation is not None:
        base_rate += pulsation[1]
    strength = beta * mean_load
    if pulsation is not None:
        strength += beta * abs(pulsation[0])
    layer = max(19.0 / sigma, 1.01 * stick_speed)
    far = layer
    if stribeck is not None and stribeck[0] > 0.0:
        far = max(layer, (math.log(stribeck[0]) + 39.2) / stribeck[1]) if stribeck[1] > 0.0 else math.inf
    nearly_zero = 1e-7 / sigma
    dense = min(0.03 * rtol ** 0.6, 1e-2)
    stiff = False
    released = 0.0
    calm = 0
    calm_enough = CALM
    h_radau = 0.0
    h_before = 0.0
    h_accepted = 0.0
    error_accepted = 0.0
    streak = 0
    patience = PATIENCE
    prepared = 0.0
    base = 0.0
    h_previous = 1.0
    status = DONE
    sign = 1.0
    tau = 0.0
    for n in range(count + (1 if tail > 0.0 else 0)):
        cycle = first + n
        time = cycle * period
        cycle_end = period if n < count else tail
        shift = 0.0
        if pulsation is not None:
            shift = TWO_PI * ((frequency_ratio * cycle) % 1.0) + pulsation[2]
        if n <= count:
            for i in range(3):
                section[n, i] = state[i]
        extent[0] = state[0]
        extent[1] = state[0]
        extent[2] = 0.0
        scales[0] = max(scales[2], abs(state[0]))
        scales[1] = max(scales[3], abs(state[2]))
        scales[2] = 0.0
        scales[3] = 0.0
        first_sample = tally[SAMPLES]
        tau = 0.0
        while tau < cycle_end and status == DONE:
            until, loaded = taylor.segment_end(tau, cycle_end, shift, mean_load, pulsation)
            if not until > tau:
                until = cycle_end
            while tau < until:
                v = state[0]
                scales[0] = max(scales[0], abs(v))
                scales[1] = max(scales[1], abs(state[2]))
                scales[2] = max(scales[2], abs(v))
                scales[3] = max(scales[3], abs(state[2]))
                slip_tolerance = rtol * max(scales[0], 0.01 / sigma)
                speed_tolerance = rtol * max(scales[1], 1e-3 * scales[0], scales[4])
                if tally[STEPS] + tally[REJECTED] >= step_limit:
                    status = STEP_LIMIT
                    break
                remaining = until - tau
                region = SLIDING
                if loaded:
                    if abs(v) <= layer * (1.0 + 1e-6):
                        region = LAYER
                    elif stribeck is not None and abs(v) <= far * (1.0 + 1e-6):
                        region = FALLING
                sign = 1.0 if v > 0.0 else -1.0
                if region == LAYER and abs(v) < 0.1 * nearly_zero:
                    te = engine_torque(tau, mean_torque, torque, harmonics)
                    ts = mean_load
                    if pulsation is not None:
                        ts = max(mean_load + pulsation[0] * math.sin(pulsation[1] * tau + shift), 0.0)
                    rate, _ = accelerations(state[1], state[2], te, ts * smoothed(v, sigma, stribeck), linear)
                    sign = 1.0 if rate >= 0.0 else -1.0
                if stiff:
                    h = h_radau
                    full = h >= remaining * (1.0 - 1e-9)
                    if full:
                        h = remaining
                    if h != prepared:
                        radau.prepare(matrix, right, gain, h, linear)
                        prepared = h
                    radau.fill(stage, previous, base, h / h_previous, h, tau, shift, loaded, mean_torque, torque,
                               harmonics,
                               mean_load, pulsation)
                    slope = radau.law_and_slope(v, sign, sigma, stribeck)[1]
                    bend = 0.0
                    if stribeck is not None:
                        bend = stribeck[1]
                    if region == LAYER:
                        bend += sigma
                    used = radau.solve_stages(matrix, right, gain, newton, free, stage, h, state, sign, linear, sigma,
                                              stribeck,
                                              min(0.01 * slip_tolerance, 1e-5 / sigma), bend,
                                              region == LAYER and h * beta * stage[5, 0] * slope > 20.0)
                    tally[ITERATIONS] += abs(used)
                    tally[ITERATIONS_MAX] = max(tally[ITERATIONS_MAX], abs(used))
                    error = math.inf
                    crossing = math.inf
                    if used < 0:
                        base = 0.0
                        previous[0, 0] = v
                        for i in range(STAGES):
                            previous[0, i + 1] = 0.0
                    else:
                        radau.collocation(trial, 0, v, stage, 0)
                        radau.collocation(trial, 2, state[2], stage, 1)
                        allowed = min(dense / rtol * slip_tolerance, min(0.02, 1e3 * dense) / sigma)
                        error = LAST_TERM * max(abs(trial[0, STAGES]) / allowed,
                                                abs(trial[2, STAGES]) * rtol / (dense * speed_tolerance))
                    if not error <= 1.0:
                        tally[REJECTED] += 1
                        shrink = max(0.2, 0.85 * error ** -0.2) if error < math.inf else 0.25
                        h_radau = h * shrink
                        explicit = 3.0 / base_rate
                        if region == LAYER:
                            explicit = 6.0 / (beta * stage[5, 0] * abs(slope) + base_rate)
                        elif region == FALLING:
                            explicit = 3.0 / (base_rate + bend * abs(stage[0, STAGES - 1] - v) / h)
                        if h_radau < explicit:
                            stiff = False
                            released = beta * stage[5, 0] * slope
                            calm = 0
                        continue
                    if region == LAYER and stribeck is not None:
                        crossing = polynomial.first_crossing(trial, SLIP, STAGES, 1.0, sign, -2.0 * nearly_zero,
                                                             0.1 * nearly_zero)
                        if crossing <= 1.0:
                            crossing = polynomial.first_crossing(trial, SLIP, STAGES, 1.0, sign, -nearly_zero,
                                                                 0.1 * nearly_zero)
                    elif loaded and region != LAYER:
                        crossing = polynomial.first_crossing(trial, SLIP, STAGES, 1.0, sign, layer * (1.0 - 1e-6),
                                                             1e-7 * layer)
                        if crossing <= 1.0:
                            crossing = polynomial.first_crossing(trial, SLIP, STAGES, 1.0, sign, layer, 1e-7 * layer)
                    if 0.0 < crossing < 1.0:
                        for i in range(STAGES + 1):
                            previous[0, i] = trial[0, i]
                        base = 0.0
                        h_previous = h
                        h_radau = h * crossing
                        tally[REJECTED] += 1
                        continue
                    radau.collocation(trial, 1, state[1], stage, 2)
                    if angle is not None:
                        for i in range(STAGES):
                            stage[6, i] = state[3]
                            for j in range(STAGES):
                                stage[6, i] += h * radau.MATRIX[i, j] * (stage[0, j] + stage[1, j])
                        radau.collocation(trial, 3, state[3], stage, 6)
                    keeping.record(trial, STAGES, h, 1.0, tau, time, True, sign, stick_speed, tally, extent, period,
                                   per_cycle,
                           first_sample, samples, times, before, after, angle)
                    state[0] = stage[0, STAGES - 1]
                    state[1] = stage[2, STAGES - 1]
                    state[2] = stage[1, STAGES - 1]
                    if angle is not None:
                        state[3] = stage[6, STAGES - 1]
                    for i in range(STAGES + 1):
                        previous[0, i] = trial[0, i]
                    base = 1.0
                    h_previous = h
                    error = max(error, 1e-12)
                    h_next = h * min(5.0, 0.85 * error ** -0.2)
                    if error_accepted > 0.0:
                        # Gustafsson's predictive controller (Hairer and Wanner, Sec. IV.8): error grows from step to
                        # step on the
                        # way to breakaway.
                        h_next = min(h_next,
                                     h * max(0.2, 0.7 * h / h_accepted * (error_accepted / (error * error)) ** 0.2))
                    if 0.9 * h < h_next < 1.2 * h:
                        h_next = h
                    error_accepted = error
                    h_accepted = h
                    if full:
                        h_next = max(h_next, h_radau)
                    h_radau = h_next
                    tau = until if full else tau + h
                    tally[STEPS] += 1
                    slope = radau.law_and_slope(state[0], sign, sigma, stribeck)[1]
                    explicit = 3.0 / base_rate
                    if abs(state[0]) <= layer and loaded:
                        explicit = 6.0 / (beta * stage[5, STAGES - 1] * abs(slope) + base_rate)
                    elif region == FALLING:
                        explicit = 3.0 / (base_rate + bend * abs(state[0] - v) / h)
                    if h_radau < explicit:
                        stiff = False
                        released = beta * stage[5, STAGES - 1] * slope
                        calm = 0
                    continue
                p = linear_order if region == SLIDING else order
                unit, rho = taylor.expand(series, p, base_rate, state, tau, shift, region, sign, loaded, linear,
                                          mean_torque,
                                          torque, harmonics, mean_load, pulsation, sigma, stribeck)
                if region == LAYER:
                    slip_tolerance = min(slip_tolerance, min(1e-3, 300.0 * rtol) / sigma)
                x = 0.9 * taylor.step_length(series, p, slip_tolerance, speed_tolerance)
                if region == FALLING and loaded and stribeck is not None:
                    x = taylor.falling_length(series, p, min(x, remaining / unit), sign, stribeck, strength * unit,
                                              slip_tolerance)
                if region == LAYER and sigma * abs(v) > 3.0:
                    # tanh(sigma |v|) is 1 - 2 exp(-2 sigma |v|) here.
                    x = taylor.falling_length(series, p, min(x, remaining / unit), sign, (2.0, 2.0 * sigma),
                                              strength * unit,
                                              slip_tolerance)
                if not x > 0.0:
                    status = STEP_TOO_SMALL if x == 0.0 else NOT_FINITE
                    break
                full = x * unit >= remaining * (1.0 - 1e-9)
                if full:
                    x = remaining / unit
                if loaded and (region != LAYER or stribeck is not None):
                    level = layer
                    accuracy = 1e-10 * layer
                    if region == LAYER:
                        level = -nearly_zero
                        accuracy = 0.1 * nearly_zero
                    elif region == SLIDING and stribeck is not None:
                        level = far
                        accuracy = 1e-7 * far
                    crossing = polynomial.first_crossing(series, SLIP, p, x, sign, level, accuracy)
                    if 0.0 < crossing < x:
                        x = crossing
                        full = False
                if angle is not None:
                    taylor.add_angle(series, p, unit, state)
                keeping.record(series, p, unit, x, tau, time, region == LAYER or not loaded, sign, stick_speed, tally,
                               extent,
                       period, per_cycle, first_sample, samples, times, before, after, angle)
                h = x * unit
                state[0], slope = polynomial.value_and_slope(series, SLIP, p, x)
                state[1] = polynomial.value(series, ANGLE, p, x)
                state[2] = polynomial.value(series, SPEED, p, x)
                if angle is not None:
                    state[3] = polynomial.value(series, FLYWHEEL, p, x)
                if not abs(state[0]) + abs(state[1]) + abs(state[2]) < math.inf:
                    status = NOT_FINITE
                    break
                tau = until if full else tau + h
                tally[STEPS] += 1
                streak = streak + 1 if abs(h - h_before) < 0.1 * h else 0
                h_before = h
                if region == LAYER:
                    slope /= unit
                    settled = h * rho > 2.0 and abs(slope) < 0.02 * rho / sigma and abs(state[0]) < layer
                    if released > 0.0:
                        calm = calm + 1 if settled else 0
                        if calm >= calm_enough:
                            calm_enough = min(2 * calm_enough, 64 * CALM)
                            released = 0.0
                        elif rho > 2.0 * released:
                            released = 0.0
                    if released == 0.0 and settled:
                        stiff = True
                        error_accepted = 0.0
                        h_radau = 3.0 / rho
                        h_previous = h_radau
                        base = 0.0
                        for i in range(STAGES + 1):
                            previous[0, i] = 0.0
                        previous[0, 0] = state[0]
                        previous[0, 1] = slope * h_radau
                else:
                    released = 0.0
                    calm_enough = CALM
                if streak > patience and not stiff:
                    streak = 0
                    patience = min(2 * patience, 1024)
                    stiff = True
                    error_accepted = 0.0
                    h_radau = 2.0 * h
                    h_previous = h
                    base = 0.0
                    for i in range(STAGES + 1):
                        previous[0, i] = 0.0
                    previous[0, 0] = state[0]
        if status != DONE:
            break
        streak = 0
        patience = PATIENCE
        if n < count:
            highest[n] = extent[0]
            lowest[n] = extent[1]
            stick_time[n] = extent[2]
            tally[CYCLES] += 1
            if per_cycle > 0:
                tally[SAMPLES] = first_sample + per_cycle
        if n + 1 == count:
            for i in range(3):
                section[count, i] = state[i]
    scales[5] = tau
    tally[STATUS] = status


