"""Excitation that varies in time: engine frequency, mean torque and mean pressure, linear between given points, or
torque and pressure from data.

The phase phi is the integral of the engine frequency omega from t = 0, exact for a linear omega, and the excitation is
a function of it: Te = Tm(t) + sum_n Tpn sin(n phi + phi_n), P = Pm(t) + Pp sin(r phi + psi). Engine cycle n lasts from
phi = 2 pi n to 2 pi (n + 1).

A *course* is all of it as rows, one for every piece of time within which omega, Tm and Pm are linear. Without profiles
there is none, and the phase is omega t.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tcc_sim.model.parameters import Engine, Pressure, System

Floats = NDArray[np.float64]

TIME, PHASE, FREQUENCY, FREQUENCY_RATE, TORQUE, TORQUE_RATE, LOAD, LOAD_RATE = range(8)
"""Columns of a course: start of the piece, s; there phi (rad), omega (rad/s), Tm (N m) and Pm (Pa; as the terms of a
solver Tsm, N m), and what each changes by in a second.
"""


class Origin(NamedTuple):
    """Where the phase is counted from, after omega or r were changed while running: phi at a time, and by how much the
    load's angle is ahead of r phi + psi. Time in s, angles in rad.
    """

    time: float = 0.0
    phase: float = 0.0
    lead: float = 0.0


START = Origin()


@dataclass(frozen=True, eq=False)
class Inputs:
    """What drives a plant from outside, as lines: (k, 3) arrays of time (s), value there and change in a second.

    torque : N m; None leaves the scene's own
    pressure : Pa; None leaves the scene's own
    end : time up to which they are known, s
    """

    torque: Floats | None
    pressure: Floats | None
    end: float


def held_lines(t: Floats, values: Floats) -> Floats:
    """Values held from each time to the next, as lines; before the first time it is the first value."""
    return _from_the_start(np.stack([t, values, np.zeros(len(t))], axis=1))


def joined_lines(t: Floats, values: Floats) -> Floats:
    """Values joined by straight lines, constant outside."""
    return _from_the_start(np.stack([t, values, np.append(np.diff(values) / np.diff(t), 0.0)], axis=1))


def _from_the_start(lines: Floats) -> Floats:
    """Lines that begin at time 0."""
    return lines if lines[0, 0] <= 0.0 else np.concatenate([[[0.0, lines[0, 1], 0.0]], lines])


def moved(origin: Origin, before: System, after: System, t: float) -> Origin:
    """Where the phases are counted from where `after` takes the place of `before` at time t, s, so that neither that of
    the engine nor the load's jumps.
    """
    ratios = before.pressure.frequency_ratio, after.pressure.frequency_ratio
    if before.engine.frequency == after.engine.frequency and ratios[0] == ratios[1]:
        return origin
    phase = float(phase_at(course_of(before.engine, before.pressure, before.inputs, origin), t))
    lead = origin.lead + (ratios[0] - ratios[1]) * phase
    if before.engine.frequency == after.engine.frequency:
        return origin._replace(lead=lead)
    return Origin(t, phase, lead)


def course_of(engine: Engine, pressure: Pressure, inputs: Inputs | None = None, origin: Origin = START) -> Floats:
    """The course, (m, 8) array of pieces in order of time.

    Parameters
    ----------
    inputs : torque and pressure from data, which take the place of the scene's own
    origin : where the phase is counted from; nothing before it is in the course
    """
    torque = _lines(engine.mean_torque_times, engine.mean_torque_values, engine.mean_torque)
    load = _lines(pressure.mean_times, pressure.mean_values, pressure.mean)
    if inputs is not None:
        torque = torque if inputs.torque is None else inputs.torque
        load = load if inputs.pressure is None else inputs.pressure
    frequency = _lines(engine.frequency_times, engine.frequency_values, engine.frequency)
    origin = START if engine.frequency_times else origin
    times = np.unique(np.concatenate([[origin.time], *(line[:, 0] for line in (frequency, torque, load))]))
    times = times[times >= origin.time]
    course = np.zeros((len(times), 8))
    course[:, TIME] = times
    for column, line in ((FREQUENCY, frequency), (TORQUE, torque), (LOAD, load)):
        place = np.maximum(np.searchsorted(line[:, 0], times, side="right") - 1, 0)
        course[:, column] = line[place, 1] + line[place, 2] * (times - line[place, 0])
        course[:, column + 1] = line[place, 2]
    steps = np.diff(times)
    gained = steps * (course[:-1, FREQUENCY] + 0.5 * course[:-1, FREQUENCY_RATE] * steps)
    course[:, PHASE] = origin.phase + np.concatenate([[0.0], np.cumsum(gained)])
    return course


def _lines(times: tuple[float, ...], values: tuple[float, ...], constant: float) -> Floats:
    """A profile as rows of time, value and rate; one row where there is none."""
    return joined_lines(np.array(times), np.array(values)) if times else np.array([[0.0, constant, 0.0]])


def reached(t: Any, row: Any) -> Any:
    """(phi, Tm, Pm or Tsm) at time t by one row of a course: floats, or arrays of times and of rows' columns."""
    past = t - row[TIME]
    return (row[PHASE] + past * (row[FREQUENCY] + 0.5 * row[FREQUENCY_RATE] * past),
            row[TORQUE] + row[TORQUE_RATE] * past, row[LOAD] + row[LOAD_RATE] * past)


def along(course: Floats, t: Any) -> Any:
    """`reached` at every time of an array or at a float, each by the piece that it lies in."""
    return reached(t, np.moveaxis(course[pieces(course, t)], -1, 0))


def pieces(course: Floats, t: Any) -> Any:
    """The number of the piece that each time lies in; before the first it is the first."""
    return np.maximum(np.searchsorted(course[:, TIME], t, side="right") - 1, 0)


def phase_at(course: Floats, t: Any) -> Any:
    """phi at times t, rad."""
    return along(course, t)[0]


def time_at(course: Floats, phase: Any) -> Any:
    """When phi reaches `phase`, s: the inverse of `phase_at`."""
    row = course[np.maximum(np.searchsorted(course[:, PHASE], phase, side="right") - 1, 0)].T
    ahead = phase - row[PHASE]
    # The root of phi + omega x + omega'/2 x^2 = phase, without a difference of near numbers.
    root = np.sqrt(np.maximum(row[FREQUENCY] ** 2 + 2.0 * row[FREQUENCY_RATE] * ahead, 0.0))
    return row[TIME] + 2.0 * ahead / (row[FREQUENCY] + root)
