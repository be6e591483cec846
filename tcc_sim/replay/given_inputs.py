"""Engine torque, actuation pressure and speed of the shaft's far end from a recording or from a table, to drive a scene
by, and its digital twin: the simulation beside what was recorded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tcc_sim.errors import InputError, counted, printable
from tcc_sim.model.actuator import pressure_after
from tcc_sim.model.groups import Pressure
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.model.profile import Inputs, held_lines, joined_lines
from tcc_sim.recording.table import DRIVING, HOLDS, TIME, looks_smooth, read_columns, table_of
from tcc_sim.replay.recorded import read
from tcc_sim.scene import Scene
from tcc_sim.topics import topic
from tcc_sim.trajectory import Floats, Trajectory

MOST_PARTS = 100_000
"""Parts of a commanded pressure that an actuator follows."""


def driven_by(scene: Scene, path: Path, hold: str | None = None) -> Scene:
    """`scene` with the torque and the pressure of a recording's first run, or of a table's columns, in the place of its
    own, and with a far end of the shaft that moves as they tell; what these do not tell stays the scene's.

    What a command held in a recording is held through the tick that applied it; what the driveline made by itself is
    joined by straight lines. A table (CSV) has the column t, s, and one or more of engine_torque, N m,
    actuation_pressure, Pa, and output_speed, rad/s; the far end starts at angle 0.

    Parameters
    ----------
    path : the recording or the table; the scene's actuator follows the pressure of a table, which is commanded, while
        that of a recording was at the plates
    hold : how a table's inputs go on between two rows, one of `recording.table.HOLDS`; None takes what the file says,
        else `previous`

    Raises
    ------
    InputError
        A file that cannot be read, values that are no inputs, or `hold` of a recording.
    """
    if path.suffix != ".csv" and hold is not None:
        raise InputError(f"--hold is for tables; {path} is a recording, which tells by itself how its inputs held")
    if path.suffix == ".csv":
        inputs, own = of_table(path, hold), scene.system.pressure
        if inputs.pressure is not None and own.actuated:
            inputs = replace(inputs, pressure=followed(inputs.pressure, own, inputs.end))
    else:
        inputs = of_recording(path)
    return replace(scene, system=replace(scene.system, inputs=inputs))


def of_recording(path: Path) -> Inputs:
    """The inputs of the first run of a recording."""
    run = read(path).trajectory(0)
    if run.system is None or len(run.t) < 2:
        raise InputError(f"{path}: there are no inputs in it, since it has fewer than two states")
    t, system = run.t - run.t[0], run.system
    pressure = run.saturation_torque / system.torque_per_pressure
    lines: list[Floats | None] = []
    for values, source in ((run.engine_torque, system.engine.source), (pressure, system.pressure.source)):
        # A command was held through the tick before the state that tells it.
        lagged = values is pressure and system.pressure.lagged
        lines.append(_lines(t, values, "next" if source == "topic" and not lagged else "linear"))
    if all(line is None for line in lines):
        raise InputError(f"{path}: neither torque nor pressure was recorded")
    moved = None if run.output_speed is None else _lines(t, run.output_speed, "next")
    return Inputs(lines[0], lines[1], float(t[-1]), moved)


def followed(command: Floats, actuator: Pressure, end: float) -> Floats:
    """Return the pressure with which an actuator follows a commanded one, both as lines, Pa; it starts at the mean.

    Each line is cut into parts of a hundredth of the time constant, at most MOST_PARTS in all; the pressure is exact at
    their ends where the command is held, and straight between, which errs by 1.3e-5 of the pressure that is missing.
    """
    known = np.concatenate([[[-np.inf, actuator.mean, 0.0]], command + np.array([actuator.delay, 0.0, 0.0])])
    step = max(actuator.time_constant / 100.0 or end / 1000.0, end / MOST_PARTS)
    times = np.unique(np.concatenate([np.arange(0.0, end, step), known[1:, 0], [end]]))
    times = times[times <= end]
    place = np.searchsorted(known[:, 0], times, side="right") - 1
    rate = known[place, 2]
    asked = known[place, 1] + np.where(rate == 0.0, 0.0, rate * (times - np.where(rate == 0.0, 0.0, known[place, 0])))
    if not actuator.lagged:
        return np.stack([times, asked, rate], axis=1)
    halves = np.diff(times, append=times[-1]) * 0.5
    values = [actuator.mean]
    for target, seconds in zip((asked + rate * halves)[:-1].tolist(), (2.0 * halves)[:-1].tolist()):
        values.append(pressure_after(values[-1], target, actuator.time_constant, actuator.rate_limit, seconds))
    return joined_lines(times, np.array(values))


def _lines(t: Floats, values: Floats, hold: str) -> Floats | None:
    """Values as lines, of those that are known; None where there are none."""
    if hold == "next":
        t, values = t[:-1], values[1:]
    known = np.isfinite(values)
    line = joined_lines if hold == "linear" else held_lines
    return line(t[known], values[known]) if known.any() else None


def smooth_inputs(path: Path) -> list[str]:
    """The inputs of a table that are held though they look sampled from something smooth, where it does not say how."""
    if path.suffix != ".csv":
        return []
    table = table_of(path)
    return [name for name in DRIVING if name in table.columns and name not in table.hold
            and looks_smooth(table.columns[name])]


def of_table(path: Path, hold: str | None = None) -> Inputs:
    """The inputs in the columns of a CSV file."""
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
    torque, pressure, speed = (_lines(t, columns[name], hold or table.hold.get(name, HOLDS[0]))
                               if name in columns else None for name in DRIVING)
    return Inputs(torque, pressure, float(t[-1]), speed)


@dataclass(frozen=True)
class Twin:
    """What was recorded and what was simulated of it.

    trajectory : the simulation
    t, slip_speed : (n,) s from the start of the recording, and rad/s
    source : where they are from
    """

    trajectory: Trajectory
    t: Floats
    slip_speed: Floats
    source: str

    @property
    def difference(self) -> Floats:
        """(n,) simulated less recorded slip speed, rad/s."""
        return np.interp(self.t, self.trajectory.t, self.trajectory.slip_speed) - self.slip_speed

    def __str__(self) -> str:
        wrong, size = (float(np.sqrt(np.mean(x**2))) for x in (self.difference, self.slip_speed))
        return f"slip speed beside {self.source}: {wrong:.4g} rad/s apart (rms), of {size:.4g} rad/s"


def twin_of(path: Path, trajectory: Trajectory) -> Twin | None:
    """A simulation beside what a recording's first run or a table says of the slip speed within its time; None where
    that is nothing.

    Raises
    ------
    InputError
        A file that cannot be read.
    """
    if path.suffix == ".csv":
        columns = read_columns(path, (TIME,))
        if "slip_speed" not in columns:
            return None
        t, slip = columns[TIME], columns["slip_speed"]
    else:
        run = read(path).trajectory(0)
        t, slip = run.t - run.t[0], run.slip_speed
    within = (t >= trajectory.t[0]) & (t <= trajectory.t[-1])
    return Twin(trajectory, t[within], slip[within], printable(path.name)) if np.count_nonzero(within) > 1 else None
