"""Drive a scene by the engine torque, actuation pressure and far-end speed of a recording or a table, and compare the
simulation with the recorded slip speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tcc_sim.errors import InputError, counted, given_in, printable
from tcc_sim.model.actuator import pressure_after
from tcc_sim.model.groups import Pressure
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.model.profile import Inputs, lines_through, smooth_corners
from tcc_sim.model.quantity import Quantity
from tcc_sim.recording.columns import Window
from tcc_sim.replay.recorded import Recording, read
from tcc_sim.replay.timeline import applied_inputs, far_columns
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed
from tcc_sim.tables.chosen_columns import DRIVING, is_table
from tcc_sim.tables.file_columns import TIME
from tcc_sim.tables.measured_table import HOLDS, MeasuredTable, holes_in_words, longest_part, looks_smooth, table_in
from tcc_sim.tables.sampling import in_words
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats, Trajectory

MOST_PARTS = 100_000
"""Largest number of parts into which an actuator's response is divided."""
BRIDGED_ROWS = 3.5
"""Longest hole over which the inputs of a table are interpolated, relative to the usual step: two missing rows."""
LEAST_PRESSURE = 1e3
"""Largest pressure of a table, Pa, below which it looks as if it were in another unit."""


Source: TypeAlias = "Path | MeasuredTable | Recording"
"""A table or a recording, or the path of one."""


def opened(source: Source) -> MeasuredTable | Recording:
    """Return a table or a recording, read if it is given by its path."""
    if not isinstance(source, Path):
        return source
    return input_table(source) or read(source)


def input_table(path: Path, columns: str | Mapping[str, str] | None = None, start: float | None = None,
                end: float | None = None) -> MeasuredTable | None:
    """Return the table of inputs in a file, from the start of the simulation on; None for a recording, which takes no
    `columns`, `start` or `end`. Errors are those of `table_in`.

    columns : columns of the file by name, as `tables.chosen_columns.named_columns` takes them
    start, end : part of the table, s; its first row is then the start of the simulation
    """
    if not is_table(path):
        given = given_in({"columns": columns, "from": start, "to": end})
        if given:
            raise InputError(f"{', '.join(f'--{name}' for name in given)}: only for tables, and {path} is a recording")
        return None
    table = table_in(path, columns=columns).part(start, end)
    t = table.t
    if len(t) < 2:
        raise InputError(f"{path}: it has {counted(len(t), 'row')}"
                         f"{'' if start is end is None else ' in this part'}; it must have 2 or more")
    first = 1.5 * float(np.median(np.diff(t)))
    if start is not None or not 0.0 <= t[0] <= first:
        table = replace(table, columns={**table.columns, TIME: t - t[0]})
        if abs(t[0]) > first:
            table = table.noting(f"{path.name}: the simulation starts at its time {t[0]:.9g} s")
    return table


def driven_by(scene: Scene, source: Source, hold: str | None = None) -> Scene:
    """Return `scene` with the torque, pressure and far-end speed of a recording's first run or of a table.

    Inputs without data stay those of the scene. Recorded commands are held during the tick that applied them; inputs
    that the driveline computed from its scene are joined by straight lines. A table has the column t, s, and one
    or more of engine_torque, N m, actuation_pressure, Pa, and output_speed, rad/s; the far end starts at angle 0.

    Parameters
    ----------
    source : a table has the commanded pressure, which the scene's actuator follows; a recording has the pressure at
        the plates
    hold : interpolation of a table's inputs between rows, one of `tables.measured_table.HOLDS`; None for that stated in
        the file, else `previous`

    Raises
    ------
    InputError
        The file cannot be read, has a hole, values are out of range, or `hold` is given for a recording.
    """
    given = opened(source)
    if isinstance(given, MeasuredTable):
        inputs, pressure = of_table(given, hold), scene.system.pressure
        if inputs.pressure is not None and pressure.actuated:
            inputs = replace(inputs, pressure=followed(inputs.pressure, pressure, inputs.end))
    elif hold is not None:
        raise InputError(f"--hold is for tables; {given.path} is a recording, which defines how its inputs were held")
    else:
        inputs = of_recording(given)
    return replace(scene, system=replace(scene.system, inputs=inputs))


def of_recording(recording: Recording) -> Inputs:
    """Return the inputs of the first run of a recording, by ticks, as `applied_inputs`."""
    line = recording.line(Window(0))
    (states,) = line.runs
    if len(states) < 2:
        raise InputError(f"{recording.path} has no inputs: it holds fewer than two states")
    t = (states.stamp_ns - states.stamp_ns[0]).astype(np.float64) * 1e-9
    applied = applied_inputs(line, states)
    torque, pressure = (_lines_of_ticks(t, applied[name]) if name in applied else None for name in INPUTS)
    if torque is None and pressure is None:
        raise InputError(f"{recording.path}: neither torque nor pressure was recorded")
    speed = far_columns(states).get("output_speed")
    moved = None if speed is None else _lines(t, speed, "next")
    return Inputs(torque, pressure, float(t[-1]), moved)


def _lines_of_ticks(t: Floats, ticks: Floats) -> Floats:
    """Return lines by the values at both ends of each tick, (n - 1, 2); after a tick without values the last holds."""
    known = np.asarray(np.isfinite(ticks).all(axis=1))
    rates = (ticks[:, 1] - ticks[:, 0]) / np.diff(t)
    lines = np.stack([t[:-1], ticks[:, 0], rates], axis=1)
    ends = np.stack([t[1:], ticks[:, 1], np.zeros(len(ticks))], axis=1)
    last = known & (rates != 0.0) & ~np.append(known[1:], False)
    merged = np.concatenate([lines[known], ends[last]])
    merged = merged[np.argsort(merged[:, 0], kind="stable")]
    return merged if merged[0, 0] <= 0.0 else np.concatenate([[[0.0, merged[0, 1], 0.0]], merged])


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


def smooth_inputs(table: MeasuredTable) -> list[str]:
    """Return the inputs of a table that look sampled from a smooth signal although the table does not state a hold."""
    return [name for name in _inputs_of(table) if name not in table.hold and looks_smooth(table.filled(name)[1])]


def _inputs_of(table: MeasuredTable) -> list[str]:
    """Return the columns of a table that drive, if they hold any value."""
    return [name for name in DRIVING if name in table.columns and np.isfinite(table.columns[name]).any()]


def of_table(table: MeasuredTable, hold: str | None = None) -> Inputs:
    """Return the inputs in the columns of a table; InputError for a hole of more than two rows."""
    names, lines = _inputs_of(table), []
    if not names:
        raise InputError(f"{table.source}: the first line must name the column {', '.join(DRIVING[:-1])} or "
                         f"{DRIVING[-1]}, or --columns one of the file's columns as such"
                         + (f" ({table.notes[0].partition(': ')[2]})" if table.notes else ""))
    step = table.usual_step(*names)
    holes = table.holes(*names) if step else np.empty((0, 2))
    holes = holes[np.diff(holes)[:, 0] > BRIDGED_ROWS * step]
    if len(holes):
        begin, end = longest_part(table.t, holes)
        raise InputError(f"{holes_in_words(table, holes, step)}; a simulation needs inputs without holes: take a part "
                         f"by --from and --to, such as --from {begin:.6g} --to {end:.6g}, the longest one")
    for name in names:
        t, values = table.filled(name)
        meant = QUANTITIES[topic(name).key]
        wrong = np.flatnonzero((values < meant.low) | (values > meant.high))
        if len(wrong):
            raise InputError(f"{table.source}: {name} is {values[wrong[0]]:g} {meant.unit} at {t[wrong[0]]:g} s; it "
                             f"must be {meant.interval()}")
        lines.append(_lines(t, values, hold or table.hold.get(name, HOLDS[0]), meant))
    torque, pressure, speed = (dict(zip(names, lines)).get(name) for name in DRIVING)
    return Inputs(torque, pressure, float(table.t[-1]), speed)


def doubts_about(table: MeasuredTable) -> list[str]:
    """Return sentences on inputs that are bridged, irregular, or look as if they were in another unit."""
    names, doubts = _inputs_of(table), []
    step, steps = table.usual_step(*names), np.diff(table.t)
    short = table.holes(*names) if step else np.empty((0, 2))
    if len(short):
        doubts.append(f"{table.source}: one or two rows are missing at {in_words(short)}; the inputs are interpolated "
                      "there as between other rows")
    if not step and len(table.t) >= 16:
        worst = int(np.argmax(steps))
        doubts.append(f"{table.source}: its rows are irregular in time, {steps.min():.3g} to {steps.max():.3g} s apart "
                      f"(at {table.t[worst]:.6g} s); the inputs are interpolated between them")
    if len(steps) > 1000 and float(np.median(steps)) > 0.5:
        doubts.append(f"{table.source}: its rows are {np.median(steps):.3g} s apart; if its times are in ms, say so "
                      "with --columns t=COLUMN:ms")
    if "actuation_pressure" in names and 0.0 < float(np.nanmax(table.columns["actuation_pressure"])) < LEAST_PRESSURE:
        doubts.append(f"{table.source}: actuation_pressure is at most "
                      f"{np.nanmax(table.columns['actuation_pressure']):.4g} Pa; if it is in bar, say so with "
                      "--columns actuation_pressure=COLUMN:bar")
    return doubts


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


def twin_of(source: Source, trajectory: Trajectory) -> Twin | None:
    """Return a simulation with the slip speed of a recording's first run or of a table; None without a slip speed
    within the simulation's time; InputError if the file cannot be read.
    """
    given = opened(source)
    if isinstance(given, MeasuredTable):
        if "slip_speed" not in given.columns:
            return None
        (t, slip), name = given.filled("slip_speed"), Path(given.source).name
    else:
        run, name = given.trajectory(0), given.path.name
        t, slip = run.t - run.t[0], run.slip_speed
    within = (t >= trajectory.t[0]) & (t <= trajectory.t[-1])
    return Twin(trajectory, t[within], slip[within], printable(name)) if np.count_nonzero(within) > 1 else None
