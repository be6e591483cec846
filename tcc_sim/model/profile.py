"""Excitation that varies in time: engine frequency, mean torque, amplitudes of its harmonics and mean pressure, linear
between given points, or torque and pressure from data.

The phase phi is the integral of the engine frequency omega from t = 0, exact for a linear omega, and the excitation is
a function of it: Te = Tm(t) + sum_n Tpn(t) sin(n phi + phi_n), P = Pm(t) + Pp sin(r phi + psi). Engine cycle n lasts
from phi = 2 pi n to 2 pi (n + 1).

The *profile* of a system is an array with one row for each interval of time in which omega, Tm, Tpn and Pm are linear.
A system without profiles of keys has no such array; its phase is omega t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.groups import Engine, Pressure

Floats = NDArray[np.float64]

TIME, PHASE, FREQUENCY, FREQUENCY_RATE, TORQUE, TORQUE_RATE, LOAD, LOAD_RATE = range(8)
"""Columns of a profile: start of the interval, s; at the start phi (rad), omega (rad/s), Tm (N m) and Pm (Pa; in the
terms of a solver Tsm, N m), and the rates of change per second.
"""
UNTIL, STARTED, SHIFT = range(LOAD_RATE + 1, LOAD_RATE + 4)
"""Columns that a solver fills in its own row: end of the interval; start of the cycle, s since time 0, and phase of
the load there, rad.
"""
SWELLS, SWELL = SHIFT + 1, 4
"""First column of the harmonics with varying amplitude, and columns per harmonic: n, phi_n (rad), Tpn (N m) and its
rate per second; n is 0 where the amplitude stays 0.
"""

FAR_ANGLE, FAR_SPEED, FAR_RATE = range(1, 4)
"""Columns of the motion of the shaft's far end after TIME: theta3 (rad), w3 (rad/s) and its rate (rad/s^2)."""


class Origin(NamedTuple):
    """Reference of the phase after a change of omega or r in a running system: time (s), phi then (rad), and the
    lead of the load's angle on r phi + psi (rad).
    """

    time: float = 0.0
    phase: float = 0.0
    lead: float = 0.0


START = Origin()
ROUNDING = 1e-9
"""Rounding of a pressure relative to its largest value."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """External piecewise linear inputs of a driveline: (k, 3) arrays of time (s), value and rate per second.

    torque : N m; None keeps the scene's input
    pressure : Pa; None keeps the scene's input
    end : time up to which the inputs are known, s
    output_speed : speed of the shaft's far end, rad/s; None for a fixed end

    Raises InputError: the pressure falls below 0, by more than rounding: friction would drive the clutch.
    """

    torque: Floats | None
    pressure: Floats | None
    end: float
    output_speed: Floats | None = None

    def __post_init__(self) -> None:
        if self.pressure is None:
            return
        t, values, rates = self.pressure.T
        until = np.append(t[1:], max(self.end, t[-1]))
        ends = values + rates * (until - t)
        place = int(np.minimum(values, ends).argmin())
        least = float(min(values[place], ends[place]))
        if least < -ROUNDING * float(np.abs(values).max()):
            raise InputError(f"the pressure at the plates is {least:g} Pa at "
                             f"{(t if values[place] <= ends[place] else until)[place]:g} s; it must be 0 or more")


def lines_through(t: Floats, values: Floats, held: bool = False) -> Floats:
    """Return lines through points, or with each value held to the next time; constant from 0 to the first time."""
    rates = np.zeros(len(t)) if held else np.append(np.diff(values) / np.diff(t), 0.0)
    lines = np.stack([t, values, rates], axis=1)
    return lines if lines[0, 0] <= 0.0 else np.concatenate([[[0.0, lines[0, 1], 0.0]], lines])


def smooth_corners(t: Floats, values: Floats, low: float = -np.inf, high: float = np.inf) -> Floats:
    """Return the corners of lines that keep the amplitudes of a smooth signal, given its samples.

    Lines through the samples lower a sine of frequency w by (w h)^2/12 at a sampling step h. Corners at x - h^2 x''/12,
    with x'' from three samples, lower it by about (w h)^4/90. Steps in the signal overshoot by a twelfth; `low` and
    `high` are the limits that no corner exceeds.
    """
    steps = np.diff(t)
    slopes = np.diff(values) / steps
    curved = 2.0 * np.diff(slopes) / (steps[1:] + steps[:-1])
    corners: Floats = values.copy()
    corners[1:-1] -= steps[1:] * steps[:-1] * curved / 12.0
    return np.asarray(np.clip(corners, low, high))


def profile_of(engine: Engine, pressure: Pressure, inputs: Inputs | None = None, origin: Origin = START) -> Floats:
    """Return the profile, (m, SWELLS + SWELL k), with m intervals in order of time, k harmonics of varying amplitude.

    inputs : torque and pressure from data, which replace those of the scene
    origin : reference of the phase; the profile starts there
    """
    frequency = _lines(engine.frequency_times, engine.frequency_values, engine.frequency)
    torque = _lines(engine.mean_torque_times, engine.mean_torque_values, engine.mean_torque)
    load = _lines(pressure.mean_times, pressure.mean_values, pressure.mean)
    own_torque = engine.harmonic and (inputs is None or inputs.torque is None)
    moved: list[Floats] = []
    if inputs is not None:
        torque = torque if inputs.torque is None else inputs.torque
        load = load if inputs.pressure is None else inputs.pressure
        moved = [] if inputs.output_speed is None else [inputs.output_speed]
    origin = START if engine.frequency_times else origin
    lines: list[Floats] = [frequency, torque, load]
    swells: list[tuple[int, float]] = []
    if own_torque and engine.torque_amplitude_times:
        swells.append((1, 0.0))
        lines.append(_lines(engine.torque_amplitude_times, engine.torque_amplitude_values, 0.0))
    if own_torque and engine.harmonic_amplitudes_times:
        for k in range(len(engine.harmonic_phases)):
            values = engine.harmonic_amplitudes_values[k::len(engine.harmonic_phases)]
            swells.append((k + 2 if any(values) else 0, engine.harmonic_phases[k]))
            lines.append(_lines(engine.harmonic_amplitudes_times, values, 0.0))
    times = np.unique(np.concatenate([[origin.time], *(line[:, 0] for line in (*lines, *moved))]))
    times = times[np.searchsorted(times, origin.time, side="right") - 1:]
    profile = np.zeros((len(times), SWELLS + SWELL * len(swells)))
    profile[:, TIME] = times
    for k, (n, phase) in enumerate(swells):
        profile[:, SWELLS + SWELL * k], profile[:, SWELLS + SWELL * k + 1] = n, phase
    for column, line in zip((FREQUENCY, TORQUE, LOAD, *range(SWELLS + 2, profile.shape[1], SWELL)), lines):
        place = pieces(line, times)
        profile[:, column] = line[place, 1] + line[place, 2] * (times - line[place, 0])
        profile[:, column + 1] = line[place, 2]
    steps = np.diff(times)
    gained = steps * (profile[:-1, FREQUENCY] + 0.5 * profile[:-1, FREQUENCY_RATE] * steps)
    profile[1:, PHASE] = np.cumsum(gained)
    profile[:, PHASE] += origin.phase
    return profile


def motion_of_far_end(speed: Floats, times: Floats) -> Floats:
    """Return the motion of the shaft's far end from each time on, (m, 4) with the columns TIME, FAR_ANGLE, FAR_SPEED
    and FAR_RATE; its angle is 0 at time 0.

    speed : lines, rad/s, that begin at time 0
    times : (m,) s, from 0 on, including the times of the lines
    """
    past = np.diff(speed[:, 0])
    angle = np.concatenate([[0.0], np.cumsum(past * (speed[:-1, 1] + 0.5 * speed[:-1, 2] * past))])
    known = np.column_stack([speed[:, 0], angle, speed[:, 1:]])
    return np.column_stack([times, *far_end_at(known, times)])


def far_end_at(far: Floats, t: Any) -> tuple[Floats, Floats, Floats]:
    """Return angle (rad), speed (rad/s) and acceleration (rad/s^2) of the shaft's far end at times t, s."""
    row = np.moveaxis(far[pieces(far, t)], -1, 0)
    past, rate = t - row[TIME], row[FAR_RATE]
    return row[FAR_ANGLE] + past * (row[FAR_SPEED] + 0.5 * rate * past), row[FAR_SPEED] + rate * past, rate


def _lines(times: Sequence[float], values: Sequence[float], constant: float) -> Floats:
    """Return a profile as rows of time, value and rate; one row for a constant."""
    return lines_through(np.array(times or [0.0]), np.array(values if times else [constant]))


def reached(t: Any, row: Any) -> Any:
    """Return (phi, Tm, Pm or Tsm) at time t from a row of a profile: floats, or arrays of times and of columns."""
    past = t - row[TIME]
    return (row[PHASE] + past * (row[FREQUENCY] + 0.5 * row[FREQUENCY_RATE] * past),
            row[TORQUE] + row[TORQUE_RATE] * past, row[LOAD] + row[LOAD_RATE] * past)


def swelling(t: Any, phase: Any, row: Any) -> Any:
    """Return the sum of the harmonics with varying amplitude, N m, at time t and phase phi; arrays as in `reached`."""
    torque = 0.0
    k = SWELLS
    while k < row.shape[0]:
        torque = torque + (row[k + 2] + row[k + 3] * (t - row[TIME])) * np.sin(row[k] * phase + row[k + 1])
        k += SWELL
    return torque


def along(profile: Floats, t: Any) -> Any:
    """Return (phi, Tm, Pm) at a time or an array of times, as `reached` in the interval of each."""
    return reached(t, np.moveaxis(profile[pieces(profile, t)], -1, 0))


def pieces(profile: Floats, t: Any, column: int = TIME) -> Any:
    """Return the index of the interval that contains each time (or value of an increasing column); at least 0."""
    return np.maximum(np.searchsorted(profile[:, column], t, side="right") - 1, 0)  # As `latest`; the FMU prints it.


def latest(times: Floats | Sequence[float], t: Any) -> Any:
    """Return the index of the last of ascending times that is not after each t; that of the first before them."""
    return np.maximum(np.searchsorted(times, t, side="right") - 1, 0)


def profile_rows(profile: Floats, times: Floats, edges: Floats, shift: float) -> Floats:
    """Return the kernel's rows between successive times `edges`, s, of an engine cycle, which starts at the first of
    them; the load's angle is `shift` there, rad. `times` are those of the profile.
    """
    begins, ends = edges[:-1], edges[1:]
    k = latest(times, 0.5 * (begins + ends))
    piece: Floats = profile[k]
    past = begins - piece[:, TIME]
    rows: Floats = piece.copy()
    for column in (*range(FREQUENCY, LOAD_RATE, 2), *range(SWELLS + 2, piece.shape[1], SWELL)):
        rows[:, column] = piece[:, column] + piece[:, column + 1] * past
    after = ends - begins
    angles = np.cumsum(after * (rows[:, FREQUENCY] + 0.5 * rows[:, FREQUENCY_RATE] * after))
    rows[:, TIME], rows[0, PHASE], rows[1:, PHASE] = begins - edges[0], 0.0, angles[:-1]
    until = np.where(k + 1 < len(times), times[np.minimum(k + 1, len(times) - 1)], np.inf)
    rows[:, UNTIL], rows[:, STARTED], rows[:, SHIFT] = np.maximum(until, ends) - edges[0], edges[0], shift
    return rows


def phase_at(profile: Floats, t: Any) -> Any:
    """Return phi at times t, rad."""
    return along(profile, t)[0]


def time_at(profile: Floats, phase: Any) -> Any:
    """Return the time at which phi reaches `phase`, s: the inverse of `phase_at`."""
    row = profile[pieces(profile, phase, PHASE)].T
    ahead = phase - row[PHASE]
    # The root of phi + omega x + omega'/2 x^2 = phase, without a difference of near numbers.
    root = np.sqrt(np.maximum(row[FREQUENCY] ** 2 + 2.0 * row[FREQUENCY_RATE] * ahead, 0.0))
    return row[TIME] + 2.0 * ahead / (row[FREQUENCY] + root)
