"""The real-time solver's ticks from many starts, with the exact derivatives of what they return.

Each stage x = known + h gamma f(x) of a sub-step is differentiated as it stands, so that the derivatives are those of
the discrete solution, its count of sub-steps being held, and not approximations to those of the motion. The friction
torque's slope enters where the scalar equation is solved: (1 + a dmubar/dv) dv is what the rest of the stage changes
by (`scalar`), which is above 0 wherever sub-steps are small enough for one root.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.profile import LOAD, TORQUE
from tcc_sim.solvers.compiling.compiled import compiled, smoothed_and_slope
from tcc_sim.solvers.fixed_step import A21, B1, B2, GAMMA, plate_of, stages
from tcc_sim.solvers.key_derivatives import (
    DAMPING,
    DECAY,
    EXCESS_RATIO,
    FLYWHEEL_INERTIA,
    MEAN_LOAD,
    MEAN_TORQUE,
    NUMBERS,
    PLATE_INERTIA,
    SMOOTHING,
    STIFFNESS,
)
from tcc_sim.solvers.terms import Terms
from tcc_sim.solvers.torques import break_after
from tcc_sim.trajectory import Floats

LOAD_SCALE, OTHER_PAIRS, ROWS = len(NUMBERS), len(NUMBERS) + 1, len(NUMBERS) + 5
"""Rows after those of NUMBERS: the relative change of the whole saturation torque, however it comes about; and
amplitude and rate of the second and of the third exponential.
"""
_START, _SLOPE1, _SLOPE2, _LAW = 0, 1, 2, 3


@compiled
def _stage(weights: tuple[float, float], keep: float, rate: float, at: tuple[float, float, float, float, float],
           hg: float, linear: Linear, plate: tuple[float, float, float, float, float, float], smoothing: Any,
           stribeck: Stribeck, by: Floats, room: Floats, to: int) -> None:
    """Put into `room[to]` the derivatives of a stage's value less `keep` times those of what was known, by `rate`.

    What was known is the step's start with `weights` times the slopes of the stages before; `at` is the stage's v,
    theta2, omega2, Te and Ts.
    """
    v, theta, omega, engine, load = at
    inertia1, inertia2, damping, stiffness = linear
    share, gain, _, push, slip, _ = plate
    one, two = weights
    tanh = np.tanh(smoothing * v)
    value, slope = smoothed_and_slope(v, smoothing, stribeck, tanh)
    by_excess, by_decay, falling = 0.0, 0.0, 0.0
    if stribeck is not None:
        fade = np.exp(-stribeck[1] * np.abs(v))
        falling = stribeck[0] * fade
        by_excess, by_decay = fade * tanh, -np.abs(v) * falling * tanh
        for j in range(2, len(stribeck), 2):
            fade = np.exp(-stribeck[j + 1] * np.abs(v))
            falling += stribeck[j] * fade
            room[_LAW, j // 2, 0], room[_LAW, j // 2, 1] = fade * tanh, -np.abs(v) * stribeck[j] * fade * tanh
    by_smoothing = (1.0 + falling) * (1.0 - tanh * tanh) * v
    torque = load * value
    plate_rate = (torque - damping * omega - stiffness * theta) / inertia2
    flywheel_rate = (engine - torque) / inertia1
    loaded = 1.0 if load > 0.0 else 0.0
    steep, over = load * slope, 1.0 / (1.0 + slip * load * slope)
    for c in range(by.shape[1]):
        v_known = room[_START, 0, c] + one * room[_SLOPE1, 0, c] + two * room[_SLOPE2, 0, c]
        theta_known = room[_START, 1, c] + one * room[_SLOPE1, 1, c] + two * room[_SLOPE2, 1, c]
        omega_known = room[_START, 2, c] + one * room[_SLOPE1, 2, c] + two * room[_SLOPE2, 2, c]
        pull = -(by[DAMPING, c] * omega + by[STIFFNESS, c] * theta + plate_rate * by[PLATE_INERTIA, c]
                 + stiffness * theta_known)
        rub = (load * (by_excess * by[EXCESS_RATIO, c] + by_decay * by[DECAY, c] + by_smoothing * by[SMOOTHING, c])
               + torque * by[LOAD_SCALE, c] + loaded * value * by[MEAN_LOAD, c])
        if stribeck is not None:
            for j in range(2, len(stribeck), 2):
                rub += load * (room[_LAW, j // 2, 0] * by[OTHER_PAIRS + j - 2, c]
                               + room[_LAW, j // 2, 1] * by[OTHER_PAIRS + j - 1, c])
        drive = by[MEAN_TORQUE, c] - flywheel_rate * by[FLYWHEEL_INERTIA, c]
        free = share * omega_known + gain * pull
        dv = (v_known + omega_known - free + push * drive - slip * rub) * over
        domega = free + gain * (rub + steep * dv)
        room[to, 0, c] = (dv - keep * v_known) * rate
        room[to, 1, c] = (theta_known + hg * domega - keep * theta_known) * rate
        room[to, 2, c] = (domega - keep * omega_known) * rate


@compiled
def _sub_step(state: Floats, start: float, h: float, plate: tuple[float, float, float, float, float, float],
              terms: Terms, by: Floats, room: Floats) -> None:
    """One step of SDIRK3 on `state` and on its derivatives, `room[0]`."""
    v1, theta1, omega1, engine1, load1, v2, theta2, omega2, engine2, load2, v, theta, omega, engine, load, _, _ = \
        stages(state[0], state[1], state[2], start, h, plate, terms)
    hg, rate, linear, smoothing, stribeck = h * GAMMA, 1.0 / GAMMA, terms.linear, terms.smoothing, terms.stribeck
    room[_SLOPE1:] = 0.0
    _stage((0.0, 0.0), 1.0, rate, (v1, theta1, omega1, engine1, load1), hg, linear, plate, smoothing, stribeck, by,
           room, _SLOPE1)
    _stage((A21, 0.0), 1.0, rate, (v2, theta2, omega2, engine2, load2), hg, linear, plate, smoothing, stribeck, by,
           room, _SLOPE2)
    _stage((B1, B2), 0.0, 1.0, (v, theta, omega, engine, load), hg, linear, plate, smoothing, stribeck, by, room,
           _START)
    state[0], state[1], state[2] = v, theta, omega


@compiled
def _over(terms: Terms, profile: Floats | None, torque: float, load: float) -> Terms:
    """`terms` with so much more of engine torque and saturation torque; `profile` is room for that of the sum."""
    if profile is not None:
        for i in range(len(profile)):
            profile[i, TORQUE] = terms.profile[i, TORQUE] + torque  # type: ignore[index]
            profile[i, LOAD] = terms.profile[i, LOAD] + load  # type: ignore[index]
    return Terms(terms.linear, terms.mean_torque + torque, terms.torque, terms.harmonics, terms.mean_load + load,
                 terms.pulsation, terms.smoothing, terms.stribeck, profile, terms.approach, terms.far)


@compiled
def _keep(state: Floats, room: Floats, values: Floats, derivatives: Floats) -> None:
    """Copy the state and its derivatives."""
    for i in range(3):
        values[i] = state[i]
        for c in range(room.shape[2]):
            derivatives[i, c] = room[_START, i, c]


@compiled
def _advance(starts: Floats, first: float, step: float, n: int, terms: Terms, profile: Floats | None, held: Floats,
             by: Floats, states: Floats, derivatives: Floats, state: Floats, room: Floats) -> None:
    """See `advance_windows`, whose results are filled in."""
    h, width = step / n, states.shape[1] - 1
    whole = plate_of(h * GAMMA, terms.linear)
    for j in range(len(starts)):
        room[_START] = 0.0
        for i in range(3):
            state[i] = starts[j, i]
            room[_START, i, i] = 1.0
        _keep(state, room, states[j, 0], derivatives[j, 0])
        for k in range(width):
            tick = j * width + k
            for i in range(n):
                start, left = first + tick * step + i * h, h
                # An input that is linear over the tick is held over each sub-step at its value in the middle.
                share = (i + 0.5) / n
                applied = _over(terms, profile, held[tick, 0, 0] + share * (held[tick, 1, 0] - held[tick, 0, 0]),
                                held[tick, 0, 1] + share * (held[tick, 1, 1] - held[tick, 0, 1]))
                part = break_after(profile, start, left)
                while part < left:
                    _sub_step(state, start, part, plate_of(part * GAMMA, terms.linear), applied, by, room)
                    start += part
                    left -= part
                    part = break_after(profile, start, left)
                _sub_step(state, start, left, whole if left == h else plate_of(left * GAMMA, terms.linear), applied,
                          by, room)
            _keep(state, room, states[j, k + 1], derivatives[j, k + 1])


def advance_windows(starts: Floats, first: float, step: float, width: int, n: int, terms: Terms, held: Floats | None,
                    by: Floats) -> tuple[Floats, Floats]:
    """Every window of `width` ticks from its start, one window after the other in time.

    Parameters
    ----------
    starts : (m, 3) slip speed, plate angle, plate speed
    first, step : time of the first window's start and length of a tick, s
    n : sub-steps of a tick
    terms : of the smoothed law
    held : (m width, 2, 2) engine torque and saturation torque, N m, at the start and at the end of each tick, linear
        between, beside those of `terms`, whose sum with the latter is at least 0; None where there are none
    by : (ROWS, P) derivatives of the numbers of the equations by the keys: `key_derivatives`, LOAD_SCALE, OTHER_PAIRS

    Returns
    -------
    the states, (m, width + 1, 3), and their derivatives by the window's start and by the keys, (m, width + 1, 3, 3 + P)
    """
    shape, count = (len(starts), width + 1, 3), 3 + by.shape[1]
    states, derivatives, columns = np.empty(shape), np.empty((*shape, count)), np.zeros((ROWS, count))
    columns[:, 3:] = by
    if held is None:
        held = np.zeros((len(starts) * width, 2, 2))
    _advance(starts, first, step, n, terms, None if terms.profile is None else terms.profile.copy(), held, columns,
             states, derivatives, np.empty(3), np.empty((4, 3, count)))
    return states, derivatives
