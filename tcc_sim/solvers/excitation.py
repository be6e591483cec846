"""Excitation of a kernel: engine torque and saturation torque, their Taylor coefficients, and the times at which the
clamp of the pressure at 0 begins and ends.

For the engines time is `tau`, seconds into an engine cycle. The sines of the engine torque repeat with the cycle; the
load's phase at the start of the cycle is `shift` (rad), so that no large angle loses digits however long a run is.

Where frequency, means or amplitudes vary in time there is a `profile`, one piece of `model.profile` as a row, else
None: sines have a quadratic phase then, means and amplitudes are linear. Times of the row are seconds into the engine
cycle, phases those since its start, and the rates of waves and load are per rad of phi.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import fast
from tcc_sim.model import profile as of
from tcc_sim.solvers.series import COLUMNS, ENGINE, INVERSE, LOAD, add_sine, set_sine, sine_and_cosine
from tcc_sim.solvers.terms import Terms

TWO_PI = 2.0 * math.pi
Pulsation = Any
"""(Tsp in N m, omega_f in rad/s or rad/rad, psi in rad), or None for a constant load; with a profile always there."""
GRID = math.pi / 8.0
"""Step in the load's angle within which the load less its clamp has one extremum at most."""
BISECTIONS = 60
PAST = 1e-7
"""Part of such a step behind a root in which no other is searched for."""

WAVE = np.dtype([("rate", np.float64), ("amplitude", np.float64), ("phase", np.float64), ("sine", np.float64),
                 ("cosine", np.float64)])
"""A sine of the engine torque: rad/s, N m, rad; the sine and the cosine of its angle now."""

DRIVE = np.dtype([("torque", np.float64), ("torque_rate", np.float64), ("load", np.float64), ("load_rate", np.float64),
                  ("load_sine", np.float64), ("load_cosine", np.float64)])
"""Te, Te' (N m, N m/s), Ts, Ts', and the sine and cosine of the load's angle, now."""


def waves_of(terms: Terms) -> NDArray[Any]:
    """Return the sines of the engine torque as an array of WAVE, the first harmonic first."""
    rows = [] if terms.torque is None else [(terms.torque[1], terms.torque[0], 0.0, 0.0, 1.0)]
    if terms.harmonics is not None:
        rows += [(rate, amplitude, phase, 0.0, 1.0) for rate, amplitude, phase in terms.harmonics.tolist()]
    return np.array(rows, WAVE)


reached = fast(of.reached)


@fast
def frequency_at(tau: float, row: Any) -> float:
    """Return omega at tau, rad/s."""
    return float(row[of.FREQUENCY] + row[of.FREQUENCY_RATE] * (tau - row[of.TIME]))


@fast
def swell_and_rate(tau: float, phase: float, omega: float, row: Any) -> tuple[float, float]:
    """Return the sum at tau of the harmonics whose amplitude varies, N m, and its rate, N m/s."""
    torque, rate, k = 0.0, 0.0, of.SWELLS
    while k < row.shape[0]:
        sine, cosine = sine_and_cosine(row[k] * phase + row[k + 1])
        amplitude = row[k + 2] + row[k + 3] * (tau - row[of.TIME])
        torque += amplitude * sine
        rate += row[k + 3] * sine + amplitude * row[k] * omega * cosine
        k += of.SWELL
    return torque, rate


@fast
def excite(tau: float, shift: float, loaded: bool, mean_torque: float, waves: Any, mean_load: float,
           pulsation: Pulsation, profile: Any, drive: Any) -> None:
    """Fill `drive` and the sines and cosines of `waves` at tau; Ts is 0 unless `loaded`."""
    phase, omega, torque, torque_rate, load, load_rate = tau, 1.0, mean_torque, 0.0, mean_load, 0.0
    if profile is not None:
        phase, torque, load = reached(tau, profile)
        omega, shift = frequency_at(tau, profile), profile[of.SHIFT]
        torque_rate, load_rate = profile[of.TORQUE_RATE], profile[of.LOAD_RATE]
        swell, swell_rate = swell_and_rate(tau, phase, omega, profile)
        torque += swell
        torque_rate += swell_rate
    for i in range(waves.shape[0]):
        sine, cosine = sine_and_cosine(waves[i].rate * phase + waves[i].phase)
        waves[i].sine = sine
        waves[i].cosine = cosine
        torque += waves[i].amplitude * sine
        torque_rate += waves[i].amplitude * waves[i].rate * omega * cosine
    drive.torque = torque
    drive.torque_rate = torque_rate
    drive.load = load if loaded else 0.0
    drive.load_rate = 0.0
    if pulsation is not None:
        sine, cosine = sine_and_cosine(pulsation[1] * phase + shift)
        drive.load_sine = sine
        drive.load_cosine = cosine
        if loaded:
            drive.load = max(load + pulsation[0] * sine, 0.0)
            drive.load_rate = load_rate + pulsation[0] * pulsation[1] * omega * cosine


@fast
def expand_excitation(rows: Any, count: int, unit: float, tau: float, loaded: bool, mean_torque: float, waves: Any,
                      mean_load: float, pulsation: Pulsation, profile: Any, drive: Any) -> None:
    """Fill the first `count` Taylor coefficients in t/unit of Te and Ts about tau, for which `drive` and `waves` are
    filled. Of a constant load only coefficient 0 is written.
    """
    if profile is not None:
        expand_varying(rows, count, unit, tau, loaded, waves, pulsation, profile, drive)
    else:
        if waves.shape[0] == 0:
            for k in range(COLUMNS):
                rows[ENGINE, k] = 0.0
            rows[ENGINE, 0] = mean_torque
        for i in range(waves.shape[0]):
            sine, cosine = waves[i].amplitude * waves[i].sine, waves[i].amplitude * waves[i].cosine
            if i == 0:
                set_sine(rows, ENGINE, count, mean_torque, sine, cosine, waves[i].rate * unit)
            else:
                add_sine(rows, ENGINE, count, sine, cosine, waves[i].rate * unit)
        if pulsation is None:
            rows[LOAD, 0] = mean_load if loaded else 0.0
        elif loaded:
            set_sine(rows, LOAD, count, mean_load, pulsation[0] * drive.load_sine, pulsation[0] * drive.load_cosine,
                     pulsation[1] * unit)
        else:
            for k in range(COLUMNS):
                rows[LOAD, k] = 0.0


@fast
def add_chirp(rows: Any, row: int, count: int, sine: float, cosine: float, rate: float, growth: float,
              ahead: int = 0) -> None:
    """Add the first `count` coefficients of the sine of a quadratic angle, times x^ahead, to a row.

    Its derivative is (rate + growth x) times the cosine, which is the recurrence.
    """
    sine_before, cosine_before = 0.0, 0.0
    for k in range(count):
        rows[row, k + ahead] += sine
        following = (rate * cosine + growth * cosine_before) * INVERSE[k + 1]
        cosine_before, cosine = cosine, -(rate * sine + growth * sine_before) * INVERSE[k + 1]
        sine_before, sine = sine, following


@fast
def add_swells(rows: Any, count: int, unit: float, tau: float, phase: float, rate: float, growth: float,
               row: Any) -> None:
    """Add to Te the first `count` coefficients of the harmonics with varying amplitude, chirps times a + b x."""
    k = of.SWELLS
    while k < row.shape[0]:
        sine, cosine = sine_and_cosine(row[k] * phase + row[k + 1])
        amplitude, gain = row[k + 2] + row[k + 3] * (tau - row[of.TIME]), row[k + 3] * unit
        add_chirp(rows, ENGINE, count, amplitude * sine, amplitude * cosine, row[k] * rate, row[k] * growth)
        add_chirp(rows, ENGINE, count - 1, gain * sine, gain * cosine, row[k] * rate, row[k] * growth, 1)
        k += of.SWELL


@fast
def expand_varying(rows: Any, count: int, unit: float, tau: float, loaded: bool, waves: Any,
                   pulsation: Pulsation, row: Any, drive: Any) -> None:
    """Fill the coefficients of `expand_excitation` by a row of the profile."""
    rate, growth = frequency_at(tau, row) * unit, row[of.FREQUENCY_RATE] * unit * unit
    phase, torque, load = reached(tau, row)
    for k in range(count):
        rows[ENGINE, k] = 0.0
        rows[LOAD, k] = 0.0
    rows[ENGINE, 0] = torque
    rows[ENGINE, 1] = row[of.TORQUE_RATE] * unit
    for i in range(waves.shape[0]):
        wave = waves[i]
        add_chirp(rows, ENGINE, count, wave.amplitude * wave.sine, wave.amplitude * wave.cosine, wave.rate * rate,
                  wave.rate * growth)
    add_swells(rows, count, unit, tau, phase, rate, growth, row)
    if loaded:
        rows[LOAD, 0] = load
        rows[LOAD, 1] = row[of.LOAD_RATE] * unit
        add_chirp(rows, LOAD, count, pulsation[0] * drive.load_sine, pulsation[0] * drive.load_cosine,
                  pulsation[1] * rate, pulsation[1] * growth)


@fast
def load_phase(ratio: float, pulsation: Pulsation, cycle: int) -> float:
    """Return the load's phase at the start of an engine cycle, rad, without its whole turns, which are exact.

    The ratio of the frequencies is split by T. J. Dekker's method (Numerische Mathematik 18, 1971), so that the product
    of its greater part and the number of the cycle is exact.
    """
    if pulsation is None:
        return 0.0
    else:
        large = 134217729.0 * ratio
        head = large - (large - ratio)
        whole, rest = head * cycle, (ratio - head) * cycle
        return float(TWO_PI * ((whole - math.floor(whole)) + (rest - math.floor(rest))) + pulsation[2])


@fast
def clamp_edge(tau: float, end: float, shift: float, mean_load: float, pulsation: Pulsation,
               profile: Any) -> tuple[float, bool]:
    """Return the next time at which the clamp of Ts at 0 switches or the profile has a corner, at most `end`, and
    whether Ts is above 0 until then.
    """
    if profile is not None:
        return edge_varying(tau, end, pulsation, profile)
    elif pulsation is None:
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
        if not until > tau:
            until = end
        middle = rate * (0.5 * (tau + until)) + shift
        return until, mean_load + amplitude * math.sin(middle) > 0.0


@fast
def torque_about_mean(tau: float, mean: float, waves: Any, row: Any) -> float:
    """Return Te at tau less a mean, N m."""
    phase, now, _ = reached(tau, row)
    torque = float(now - mean) + swell_and_rate(tau, phase, 1.0, row)[0]
    for i in range(waves.shape[0]):
        torque += waves[i].amplitude * sine_and_cosine(waves[i].rate * phase + waves[i].phase)[0]
    return torque


@fast
def load_and_rate(tau: float, pulsation: Pulsation, row: Any) -> tuple[float, float]:
    """Return Ts before the clamp, N m, and its rate, N m/s."""
    phase, _, load = reached(tau, row)
    sine, cosine = sine_and_cosine(pulsation[1] * phase + row[of.SHIFT])
    return (load + pulsation[0] * sine,
            row[of.LOAD_RATE] + pulsation[0] * pulsation[1] * frequency_at(tau, row) * cosine)


@fast
def bisected(low: float, high: float, which: int, pulsation: Pulsation, row: Any) -> float:
    """Return the time just behind a change of sign between low and high of the load (`which` 0) or its rate (1)."""
    rising = load_and_rate(high, pulsation, row)[which] > 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if (load_and_rate(middle, pulsation, row)[which] > 0.0) == rising:
            high = middle
        else:
            low = middle
    return high


@fast
def edge_varying(tau: float, end: float, pulsation: Pulsation, row: Any) -> tuple[float, bool]:
    """Return `clamp_edge` by a row of the profile, at most the end of the piece."""
    until = min(end, row[of.UNTIL])
    before, after = reached(tau, row)[2], reached(until, row)[2]
    if abs(pulsation[0]) <= min(before, after):
        return until, max(before, after) > 0.0
    step = GRID / (pulsation[1] * max(frequency_at(tau, row), frequency_at(until, row)))
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
