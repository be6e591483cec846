"""`excitation` where frequency and means vary in time: sines of a quadratic phase, and means that are linear.

A kernel is given one piece of a course (`model.course`) at a time, as a row: times are seconds into the engine cycle,
phases those since its start, so that no large angle loses digits however long a run is.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.series import ENGINE, INVERSE, LOAD, sine_and_cosine

BEGIN, PHASE, OMEGA, OMEGA_RATE, TORQUE, TORQUE_RATE, MEAN_LOAD, MEAN_LOAD_RATE, UNTIL, STARTED, SHIFT = range(11)
"""Of a row: where the piece begins, there phi, omega, Tm and the mean of Ts, each with its change in a second; how long
the piece holds; when the cycle started, s since time 0, and the load's phase there, rad.
"""
GRID = math.pi / 8.0
"""Step in the load's angle within which the load less its clamp has one extremum at most."""
BISECTIONS = 60
PAST = 1e-7
"""Part of such a step behind a root in which no other is looked for."""


@fast
def excite_varying(tau: float, loaded: bool, waves: Any, pulsation: tuple[float, float, float], row: Any,
                   drive: Any) -> None:
    """`excitation.excite` by a row; the rates of `waves` and of the load are per rad of phi."""
    past = tau - row[BEGIN]
    phase, omega = row[PHASE] + past * (row[OMEGA] + 0.5 * row[OMEGA_RATE] * past), row[OMEGA] + row[OMEGA_RATE] * past
    torque, torque_rate = row[TORQUE] + row[TORQUE_RATE] * past, row[TORQUE_RATE]
    for i in range(waves.shape[0]):
        sine, cosine = sine_and_cosine(waves[i].rate * phase + waves[i].phase)
        waves[i].sine = sine
        waves[i].cosine = cosine
        torque += waves[i].amplitude * sine
        torque_rate += waves[i].amplitude * waves[i].rate * omega * cosine
    drive.torque = torque
    drive.torque_rate = torque_rate
    sine, cosine = sine_and_cosine(pulsation[1] * phase + row[SHIFT])
    drive.load_sine = sine
    drive.load_cosine = cosine
    drive.load = 0.0
    drive.load_rate = 0.0
    if loaded:
        drive.load = max(row[MEAN_LOAD] + row[MEAN_LOAD_RATE] * past + pulsation[0] * sine, 0.0)
        drive.load_rate = row[MEAN_LOAD_RATE] + pulsation[0] * pulsation[1] * omega * cosine


@fast
def add_chirp(rows: Any, row: int, count: int, sine: float, cosine: float, rate: float, growth: float) -> None:
    """Add the first `count` coefficients of the sine of a quadratic angle to a row.

    Its derivative is (rate + growth x) times the cosine, which is the recurrence.
    """
    sine_before, cosine_before = 0.0, 0.0
    for k in range(count):
        rows[row, k] += sine
        following = (rate * cosine + growth * cosine_before) * INVERSE[k + 1]
        cosine_before, cosine = cosine, -(rate * sine + growth * sine_before) * INVERSE[k + 1]
        sine_before, sine = sine, following


@fast
def expand_varying(rows: Any, count: int, unit: float, tau: float, loaded: bool, waves: Any,
                   pulsation: tuple[float, float, float], row: Any, drive: Any) -> None:
    """`excitation.expand_excitation` by a row."""
    past = tau - row[BEGIN]
    rate, growth = (row[OMEGA] + row[OMEGA_RATE] * past) * unit, row[OMEGA_RATE] * unit * unit
    for k in range(count):
        rows[ENGINE, k] = 0.0
        rows[LOAD, k] = 0.0
    rows[ENGINE, 0] = row[TORQUE] + row[TORQUE_RATE] * past
    rows[ENGINE, 1] = row[TORQUE_RATE] * unit
    for i in range(waves.shape[0]):
        wave = waves[i]
        add_chirp(rows, ENGINE, count, wave.amplitude * wave.sine, wave.amplitude * wave.cosine, wave.rate * rate,
                  wave.rate * growth)
    if loaded:
        rows[LOAD, 0] = row[MEAN_LOAD] + row[MEAN_LOAD_RATE] * past
        rows[LOAD, 1] = row[MEAN_LOAD_RATE] * unit
        add_chirp(rows, LOAD, count, pulsation[0] * drive.load_sine, pulsation[0] * drive.load_cosine,
                  pulsation[1] * rate, pulsation[1] * growth)


@fast
def torque_beside_mean(tau: float, mean: float, waves: Any, row: Any) -> float:
    """Te at tau less a mean, N m."""
    past = tau - row[BEGIN]
    phase = row[PHASE] + past * (row[OMEGA] + 0.5 * row[OMEGA_RATE] * past)
    torque = float(row[TORQUE] + row[TORQUE_RATE] * past - mean)
    for i in range(waves.shape[0]):
        torque += waves[i].amplitude * sine_and_cosine(waves[i].rate * phase + waves[i].phase)[0]
    return torque


@fast
def load_and_rate(tau: float, pulsation: tuple[float, float, float], row: Any) -> tuple[float, float]:
    """Ts before the clamp, N m, and its change in a second."""
    past = tau - row[BEGIN]
    phase = row[PHASE] + past * (row[OMEGA] + 0.5 * row[OMEGA_RATE] * past)
    sine, cosine = sine_and_cosine(pulsation[1] * phase + row[SHIFT])
    return (row[MEAN_LOAD] + row[MEAN_LOAD_RATE] * past + pulsation[0] * sine,
            row[MEAN_LOAD_RATE] + pulsation[0] * pulsation[1] * (row[OMEGA] + row[OMEGA_RATE] * past) * cosine)


@fast
def bisected(low: float, high: float, which: int, pulsation: tuple[float, float, float], row: Any) -> float:
    """Where the load (`which` 0) or its rate (1) changes its sign between low and high: just behind it."""
    rising = load_and_rate(high, pulsation, row)[which] > 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if (load_and_rate(middle, pulsation, row)[which] > 0.0) == rising:
            high = middle
        else:
            low = middle
    return high


@fast
def edge_varying(tau: float, end: float, pulsation: tuple[float, float, float], row: Any) -> tuple[float, bool]:
    """`excitation.clamp_edge` by a row: at most where the piece ends."""
    until = min(end, row[UNTIL])
    before = row[MEAN_LOAD] + row[MEAN_LOAD_RATE] * (tau - row[BEGIN])
    after = row[MEAN_LOAD] + row[MEAN_LOAD_RATE] * (until - row[BEGIN])
    if abs(pulsation[0]) <= min(before, after):
        return until, max(before, after) > 0.0
    fastest = max(row[OMEGA] + row[OMEGA_RATE] * (tau - row[BEGIN]),
                  row[OMEGA] + row[OMEGA_RATE] * (until - row[BEGIN]))
    step = GRID / (pulsation[1] * fastest)
    low = min(tau + PAST * step, 0.5 * (tau + until))
    value, rate = load_and_rate(low, pulsation, row)
    loaded = value > 0.0
    while low < until:
        high = min(low + step, until)
        value, following = load_and_rate(high, pulsation, row)
        if (rate > 0.0) != (following > 0.0):
            turn = bisected(low, high, 1, pulsation, row)
            if (load_and_rate(turn, pulsation, row)[0] > 0.0) != loaded:
                return bisected(low, turn, 0, pulsation, row), loaded
        if (value > 0.0) != loaded:
            return bisected(low, high, 0, pulsation, row), loaded
        low, rate = high, following
    return until, loaded
