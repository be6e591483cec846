"""The loop of the exact engine: from event to event through whole engine cycles, in one compiled call."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_driven.arcs import (
    ARC,
    C23,
    COUNT,
    ENGINE,
    FIRST_INPUT,
    FREE,
    HERE,
    HIGHEST,
    I1,
    I2,
    K23,
    LOAD,
    LOAD_INDEX,
    LOAD_PHASE,
    LOWEST,
    MOST,
    NEGATIVE,
    PER_INPUT,
    POSITIVE,
    ROW,
    STICK,
    TM,
    TSM,
    TSP,
    Floats,
    Tables,
    set_phases,
    sines,
    slip_angle,
    start_arc,
)
from tcc_sim.solvers.event_driven.search import EXHAUSTED, NONE, look, note, search
from tcc_sim.solvers.event_driven.slip_series import expand, measure

CHATTERING, EXHAUSTED_STEPS, NOT_FINITE = 1, 2, 3


@compiled
def mode_at_rest(u: float, angle: float, rate: float, ratio: float, tolerance: float, inputs: Floats) -> int:
    """The mode that follows v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within `tolerance` (N m) of breakaway the rate of the margin decides: stick if it grows.
    """
    i1, i2, damping, stiffness = inputs[I1], inputs[I2], inputs[C23], inputs[K23]
    engine, engine_rate = sines(u, inputs[TM], ENGINE, inputs)
    load, load_rate = sines(u, inputs[TSM], LOAD, inputs)
    spring = damping * rate + stiffness * angle
    torque = (i2 * engine + i1 * spring) / (i1 + i2)
    margin = ratio * load - abs(torque)
    if margin > tolerance:
        return STICK
    direction = POSITIVE if torque > 0.0 else NEGATIVE
    if margin < -tolerance:
        return direction
    bend = (engine - spring) / (i1 + i2)
    torque_rate = (i2 * engine_rate + i1 * (damping * bend + stiffness * rate)) / (i1 + i2)
    growth = ratio * load_rate - (torque_rate if torque > 0.0 else -torque_rate)
    return STICK if growth >= 0.0 else direction


@compiled
def until_clamp(u: float, loaded: bool, inputs: Floats) -> float:
    """Time until the pressure next meets 0, where its amplitude is above its mean: the end of the loaded or free part.
    """
    k = int(inputs[LOAD_INDEX])
    i = FIRST_INPUT + PER_INPUT * k
    w = inputs[i]
    angle = np.arcsin(inputs[TSM] / inputs[TSP])
    x = w * u + inputs[i + 2] + inputs[LOAD_PHASE]
    if loaded:
        x -= 2.0 * np.pi * np.floor((x + 0.5 * np.pi) / (2.0 * np.pi))
        return max(np.pi + angle - x, 0.0) / w  # type: ignore[no-any-return]
    x -= 2.0 * np.pi * np.floor((x - 0.5 * np.pi) / (2.0 * np.pi))
    return max(2.0 * np.pi - angle - x, 0.0) / w  # type: ignore[no-any-return]


@compiled
def friction_torque(u: float, mode: int, speed: float, pad: Floats, stribeck: Any, inputs: Floats) -> float:
    """Tf, N m: the law in slip, lambda in stick (from the two margins), 0 when free."""
    if mode == STICK:
        return 0.5 * (pad[HERE + 3] - pad[HERE])  # type: ignore[no-any-return]
    if mode == FREE:
        return 0.0
    sign = 1.0 if mode == POSITIVE else -1.0
    load = max(sines(u, inputs[TSM], LOAD, inputs)[0], 0.0)
    if stribeck is None:
        return sign * load
    else:
        return sign * load * (1.0 + stribeck[0] * np.exp(-stribeck[1] * abs(speed)))  # type: ignore[no-any-return]


@compiled
def slip_angle_of(tau: float, u: float, kind: int, mode: int, pad: Floats, series: Any) -> float:
    """The integral of v over [u, u + tau], rad."""
    if series is None:
        return slip_angle(tau, u, mode, pad)
    else:
        if kind >= 0:
            return slip_angle(tau, u, mode, pad)
        total = 0.0
        for i in range(series.shape[1] - 1, -1, -1):
            total = (total + series[0, i] / (i + 1.0)) * tau if i > 0 else (total + series[0, 0]) * tau
        return total if mode == POSITIVE else -total


@compiled
def record(tau: float, u: float, kind: int, mode: int, offset: float, slipped: float, inputs: Floats, pad: Floats,
           stribeck: Any, series: Any, flywheel: Any, kept: Floats) -> None:
    """Fill a sample at u + tau of the arc that starts at u with theta1 - theta2 = slipped."""
    look(tau, u, kind, 3, pad, series)
    v = 0.0
    if mode != STICK:
        v = pad[HERE] + offset if mode != NEGATIVE else -pad[HERE] - offset
    kept[0], kept[1], kept[2], kept[4] = v, pad[HERE + 6], pad[HERE + 7], float(mode)
    kept[3] = friction_torque(u + tau, mode, v, pad, stribeck, inputs)
    kept[5] = pad[HERE + 6]
    if flywheel is not None:
        turned = offset * tau if mode != NEGATIVE else -offset * tau
        kept[5] += slipped + turned + slip_angle_of(tau, u, kind, mode, pad, series)


@compiled
def march(first: int, whole: int, state: Floats, settings: Floats, progress: Any, tables: Tables, stribeck: Any,
          series: Any,
          flywheel: Any, rows: Floats, section: Floats, highest: Floats, lowest: Floats, stick_time: Floats,
          buffer: Floats,
          kinds: Any) -> None:
    """March through the engine cycles from progress[5] on, until the end, a failure, or a nearly full transition
    buffer.

    state : v, theta2, theta2', theta1 - theta2
    settings : cycle, part of a cycle after the whole ones (s), torque tolerance, slip speed beyond which the law is
        constant,
        tolerance of the series, scale of theta2', samples per cycle
    progress : mode (-1: not known yet), loaded, samples filled, transitions in the buffer, failure, cycles done,
        evaluations,
        most evaluations and events per cycle
    rows : samples (v, theta2, theta2', Tf, row of the mode, theta1)
    """
    cycle, rest, tolerance, far = settings[0], settings[1], settings[2], settings[3]
    truncation, scale, per_cycle = settings[4], settings[5], int(settings[6])
    modes, inputs = tables.modes, tables.inputs
    ratio = 1.0
    if stribeck is not None:
        ratio = 1.0 + stribeck[0]
    clamped = inputs[TSP] > inputs[TSM]
    steepest = 2.0 * tolerance * (1.0 / inputs[I1] + 1.0 / inputs[I2])
    pad, scratch = np.zeros(ROW + modes.shape[1]), np.zeros((5, 32))
    cycles = whole + (1 if rest > 0.0 else 0)
    mode, loaded = progress[0], progress[1] == 1
    v, angle, rate, slipped = state[0], state[1], state[2], state[3]
    while progress[5] < cycles:
        n = progress[5]
        set_phases(float(first + n), tables)
        end = cycle if n < whole else rest
        u, stuck, events = 0.0, 0.0, 0
        pad[COUNT], pad[MOST] = 0.0, float(progress[7])
        if mode < 0:
            load, load_rate = sines(0.0, inputs[TSM], LOAD, inputs)
            loaded = inputs[TSM] > 0.0 and (not clamped or load > 0.0 or (load == 0.0 and load_rate > 0.0))
            mode = FREE if not loaded else POSITIVE if v > 0.0 else NEGATIVE if v < 0.0 else mode_at_rest(
                0.0, angle, rate, ratio, tolerance, inputs)
            section[0, 0], section[0, 1], section[0, 2] = v, angle, rate
            start_arc(0.0, mode, v, angle, rate, modes, pad)
            record(0.0, 0.0, mode, mode, 0.0, slipped, inputs, pad, stribeck, series, flywheel, rows[0])
            rows[0, 0], rows[0, 1], rows[0, 2] = v, angle, rate
            progress[2] = 1
        pad[HIGHEST], pad[LOWEST] = v, v
        while u < end:
            stop = end - u
            clamp = False
            if clamped:
                gap = until_clamp(u, loaded, inputs)
                if gap <= stop:
                    stop, clamp = gap, True
            upward = -1.0 if mode == NEGATIVE else 1.0
            kind, offset, bend, size, limit = mode, 0.0, 0.0, 0.0, 0.1 * tables.noise * scale
            far_off = False
            if mode == STICK:
                limit = tolerance
            if stribeck is not None and series is not None and mode in (POSITIVE, NEGATIVE):
                if upward * v > 1.01 * far:
                    offset, far_off = far, True
                else:
                    kind = -1 - mode
                    step = expand(u, upward, v, angle, rate, stribeck, inputs, scale, truncation, series, scratch)
                    pad[COUNT] += 8.0
                    if step < stop:
                        stop, clamp = step, False
                    bend, size = measure(stop, series)
            if kind >= 0:
                start_arc(u, mode, v, angle, rate, modes, pad)
                if far_off:
                    pad[ARC] -= far
            found, tau = search(stop, u, kind, upward, offset, limit, steepest, 1e-13 * cycle, pad, series, bend,
                                size)
            last_stop = clamp or u + stop >= end
            finish = end if found == NONE and not clamp and kind >= 0 else u + tau
            if found == NONE and not clamp and kind < 0 and last_stop and stop == end - u:
                finish = end
            while progress[2] < len(rows) - 1:
                number = progress[2] - n * per_cycle
                at = cycle if number == per_cycle else number * (cycle / per_cycle)
                if number > per_cycle or at > finish:
                    break
                record(at - u, u, kind, mode, offset, slipped, inputs, pad, stribeck, series, flywheel,
                       rows[progress[2]])
                progress[2] += 1
            look(tau, u, kind, 3, pad, series)
            if flywheel is not None:
                slipped += slip_angle_of(tau, u, kind, mode, pad, series) + offset * upward * tau
            if mode == STICK:
                stuck += tau
            else:
                v = upward * (pad[HERE] + offset)
            angle, rate = pad[HERE + 6], pad[HERE + 7]
            u = finish
            if found == EXHAUSTED or not (np.isfinite(v) and np.isfinite(angle) and np.isfinite(rate)):
                progress[4] = EXHAUSTED_STEPS if np.isfinite(v) and np.isfinite(angle) and np.isfinite(rate) else NOT_FINITE
                progress[6] += int(pad[COUNT])
                return
            following = mode
            if clamp and found == NONE:
                loaded = not loaded
                following = FREE if not loaded else POSITIVE if v > 0.0 else NEGATIVE if v < 0.0 else -1
            elif mode == STICK and found >= 0:
                following = POSITIVE if found == 0 else NEGATIVE
            elif mode in (POSITIVE, NEGATIVE) and not (far_off and found >= 0) and (found >= 0 or upward * v <= 0.0):
                following = -1
            if following < 0:
                v = 0.0
                following = mode_at_rest(u, angle, rate, ratio, tolerance, inputs)
            if mode != STICK:
                note(v, pad)
            if following != mode:
                buffer[progress[3], 0], buffer[progress[3], 1] = first + n, u
                kinds[progress[3], 0], kinds[progress[3], 1] = mode, following
                progress[3] += 1
                mode = following
            if found >= 0 or clamp:
                events += 1
                if events >= progress[8]:
                    progress[4] = CHATTERING
                    progress[6] += int(pad[COUNT])
                    return
        progress[6] += int(pad[COUNT])
        if n < whole:
            highest[n], lowest[n], stick_time[n] = pad[HIGHEST], pad[LOWEST], stuck
            section[n + 1, 0], section[n + 1, 1], section[n + 1, 2] = v, angle, rate
        progress[5] += 1
        if progress[5] == cycles and progress[2] < len(rows):
            record(tau, u - tau, kind, mode, offset, 0.0, inputs, pad, stribeck, series, flywheel,
                   rows[progress[2]])
            rows[progress[2], 0], rows[progress[2], 1], rows[progress[2], 2] = v, angle, rate
            rows[progress[2], 5] = slipped + angle
            progress[2] += 1
        if progress[3] + progress[8] > len(buffer):
            break
    progress[0], progress[1] = mode, 1 if loaded else 0
    state[0], state[1], state[2], state[3] = v, angle, rate, slipped
