"""Drive a scene by the engine torque, actuation pressure and far-end speed of a recording or a table, and compare the
simulation with the recorded slip speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tcc_sim.errors import InputError, counted, printable
from tcc_sim.model.actuator import pressure_after
from tcc_sim.model.groups import Pressure
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.model.profile import Inputs, lines_through, smooth_corners
from tcc_sim.model.quantity import Quantity
from tcc_sim.recording.table import DRIVING, HOLDS, TIME, looks_smooth, read_columns, table_of
from tcc_sim.recording.window import Window
from tcc_sim.replay.applied import applied_inputs
from tcc_sim.replay.recorded import Recording, read
from tcc_sim.replay.timeline import from_first_motion
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats, Trajectory

MOST_PARTS = 100_000
"""Largest number of parts into which an actuator's response is divided."""


def driven_by(scene: Scene, measured: Path | Recording, hold: str | None = None) -> Scene:
    """Return `scene` with the torque, pressure and far-end speed of a recording's first run or of a table.

    Inputs without data stay those of the scene. Recorded commands are held during the tick that applied them; inputs
    that the driveline computed from its scene are joined by straight lines. A table (CSV) has the column t, s, and one
    or more of engine_torque, N m, actuation_pressure, Pa, and output_speed, rad/s; the far end starts at angle 0.

    Parameters
    ----------
    measured : the table, or the recording or its path; a table has the commanded pressure, which the scene's actuator
        follows; a recording has the pressure at the plates
    hold : interpolation of a table's inputs between rows, one of `recording.table.HOLDS`; None for that stated in the
        file, else `previous`

    Raises
    ------
    InputError
        The file cannot be read, values are out of range, or `hold` is given for a recording.
    """
    path = measured.path if isinstance(measured, Recording) else measured
    if path.suffix != ".csv" and hold is not None:
        raise InputError(f"--hold is for tables; {path} is a recording, which defines how its inputs were held")
    if path.suffix == ".csv":
        inputs, own = of_table(path, hold), scene.system.pressure
        if inputs.pressure is not None and own.actuated:
            inputs = replace(inputs, pressure=followed(inputs.pressure, own, inputs.end))
    else:
        inputs = of_recording(read(path) if isinstance(measured, Path) else measured)
    return replace(scene, system=replace(scene.system, inputs=inputs))


def of_recording(recording: Recording) -> Inputs:
    """Return the inputs of the first run of a recording, by ticks, as `applied_inputs`."""
    line = recording.line(Window(0))
    (states,) = line.runs
    if len(states) < 2:
        raise InputError(f"{recording.path} has no inputs: it holds fewer than two states")
    t = (states.stamp_ns - states.stamp_ns[0]).astype(np.float64) * 1e-9
    found = applied_inputs(line, states)
    torque, pressure = (_lines_of_ticks(t, found[name]) if name in found else None for name in INPUTS)
    if torque is None and pressure is None:
        raise InputError(f"{recording.path}: neither torque nor pressure was recorded")
    speed = from_first_motion(states.output_speed)
    moved = None if speed is None else _lines(t, speed, "next")
    return Inputs(torque, pressure, float(t[-1]), moved)


def _lines_of_ticks(t: Floats, ticks: Floats) -> Floats:
    """Return lines by the values at both ends of each tick, (n - 1, 2); after a tick without values the last holds."""
    known = np.asarray(np.isfinite(ticks).all(axis=1))
    rates = (ticks[:, 1] - ticks[:, 0]) / np.diff(t)
    lines = np.stack([t[:-1], ticks[:, 0], rates], axis=1)
    ends = np.stack([t[1:], ticks[:, 1], np.zeros(len(ticks))], axis=1)
    last = known & (rates != 0.0) & ~np.append(known[1:], False)
    found = np.concatenate([lines[known], ends[last]])
    found = found[np.argsort(found[:, 0], kind="stable")]
    return found if found[0, 0] <= 0.0 else np.concatenate([[[0.0, found[0, 1], 0.0]], found])


def followed(command: Floats, actuator: Pressure, end: float) -> Floats:
    """Return an actuator's response to a commanded pressure, both as lines, Pa; the response starts at the mean.

    Each line is divided into parts of a hundredth of the time constant, at most MOST_PARTS in all. The pressure is
    exact at their ends if the command is held, and linear between; the error is 1.3e-5 of the remaining difference.
    """
    delayed = np.concatenate([[[-np.inf, actuator.mean, 0.0]], command + np.array([actuator.delay, 0.0, 0.0])])
    step = max(actuator.time_constant / 100.0 or end / 1000.0, end / MOST_PARTS)
    times = np.unique(np.concatenate([np.arange(0.0, end, step), delayed[1:, 0], [end]]))
    times = times[times <= end]
    line = np.searchsorted(delayed[:, 0], times, side="right") - 1
    rate = delayed[line, 2]
    begin = np.where(rate == 0.0, 0.0, delayed[line, 0])
    commanded = delayed[line, 1] + np.where(rate == 0.0, 0.0, rate * (times - begin))
    if not actuator.lagged:
        return np.stack([times, commanded, rate], axis=1)
    halves = np.diff(times, append=times[-1]) * 0.5
    values = [actuator.mean]
    for target, seconds in zip((commanded + rate * halves)[:-1].tolist(), (2.0 * halves)[:-1].tolist()):
        values.append(pressure_after(values[-1], target, actuator.time_constant, actuator.rate_limit, seconds))
    return lines_through(times, np.array(values))


def _lines(t: Floats, values: Floats, hold: str, meant: Quantity | None = None) -> Floats | None:
    """Return the finite values as lines, within the range of their key; None without any."""
    if hold == "next":  # The first row holds until its time.
        t, values = (np.append(0.0, t[:-1]), values) if t[0] > 0.0 else (t[:-1], values[1:])
    finite = np.isfinite(values)
    t, values = t[finite], values[finite]
    if hold == "smooth":
        values = smooth_corners(t, values, *((meant.low, meant.high) if meant is not None else ()))
    return lines_through(t, values, held=hold in ("previous", "next")) if len(t) else None


def smooth_inputs(path: Path) -> list[str]:
    """Return the inputs of a table that look sampled from a smooth signal although the table does not state a hold."""
    if path.suffix != ".csv":
        return []
    table = table_of(path)
    return [name for name in DRIVING if name in table.columns and name not in table.hold
            and looks_smooth(table.columns[name])]


def of_table(path: Path, hold: str | None = None) -> Inputs:
    """Return the inputs in the columns of a CSV file."""
    table = table_of(path, (TIME,))
    columns = {name: values for name, values in table.columns.items() if name in (TIME, *DRIVING)}
    t = columns.pop(TIME)
    if not columns:
        raise InputError(f"{path}: the first line must name the column {', '.join(DRIVING[:-1])} or {DRIVING[-1]}")
    if len(t) < 2:
        raise InputError(f"{path}: it has {counted(len(t), 'row')}; it must have 2 or more")
    if t[0] < 0.0 or not np.all(np.diff(t) > 0.0):
        raise InputError(f"{path}: the times in column t must begin at 0 or later and increase")
    for name, values in columns.items():
        meant = QUANTITIES[topic(name).key]
        wrong = np.flatnonzero((values < meant.low) | (values > meant.high))
        if len(wrong):
            raise InputError(f"{path}: {name} is {values[wrong[0]]:g} {meant.unit} at {t[wrong[0]]:g} s; it must be "
                             f"{meant.interval()}")
    torque, pressure, speed = (_lines(t, columns[name], hold or table.hold.get(name, HOLDS[0]),
                                      QUANTITIES[topic(name).key]) if name in columns else None for name in DRIVING)
    return Inputs(torque, pressure, float(t[-1]), speed)


@dataclass(frozen=True)
class Twin:
    """Simulation driven by recorded inputs, with the recorded slip speed.

    trajectory : the simulation
    t, slip_speed : (n,) times from the start of the recording, s, and recorded slip speed, rad/s
    source : name of the recording or table
    """

    trajectory: Trajectory
    t: Floats
    slip_speed: Floats
    source: str

    @property
    def difference(self) -> Floats:
        """Simulated minus recorded slip speed, (n,) array, rad/s."""
        return np.interp(self.t, self.trajectory.t, self.trajectory.slip_speed) - self.slip_speed

    def __str__(self) -> str:
        wrong, size = (float(np.sqrt(np.mean(x**2))) for x in (self.difference, self.slip_speed))
        return f"slip speed beside {self.source}: {speed(wrong, 4)} apart (rms), of {speed(size, 4)}"


def twin_of(measured: Path | Recording, trajectory: Trajectory) -> Twin | None:
    """Return a simulation with the slip speed of a recording's first run or of a table; None without a slip speed
    within the simulation's time.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    path = measured.path if isinstance(measured, Recording) else measured
    if path.suffix == ".csv":
        columns = read_columns(path, (TIME,))
        if "slip_speed" not in columns:
            return None
        t, slip = columns[TIME], columns["slip_speed"]
    else:
        run = (read(measured) if isinstance(measured, Path) else measured).trajectory(0)
        t, slip = run.t - run.t[0], run.slip_speed
    within = (t >= trajectory.t[0]) & (t <= trajectory.t[-1])
    return Twin(trajectory, t[within], slip[within], printable(path.name)) if np.count_nonzero(within) > 1 else None
