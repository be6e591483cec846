"""A recording as data: its runs, segments and commands, and any window of it as the same object as a solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.control import Control
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.errors import counted, require
from tcc_sim.recording.commands import TARGET
from tcc_sim.recording.reader import TooManyStates, open_run
from tcc_sim.recording.window import Window
from tcc_sim.replay.control import signals_of
from tcc_sim.replay.segments import Segment, segments_of
from tcc_sim.replay.timeline import Timeline, timeline_of, trajectory_of
from tcc_sim.replay.timing import Timing, default_of, frequency_changes, recorded_scene, timing_of
from tcc_sim.result import Result, html_of
from tcc_sim.topics import topic
from tcc_sim.trajectory import UNITS, Floats, Modes, Trajectory, no_cycles


@dataclass(frozen=True)
class RecordedRun:
    """One run of a recording, from a start, a reset or a restart of the driveline to the next.

    number : counted from 0
    start, end : simulation time of its first and last state, s
    samples : joint_states in it
    began_by : start, reset or restart
    """

    number: int
    start: float
    end: float
    samples: int
    began_by: str


@dataclass(frozen=True, repr=False)
class Command:
    """What was commanded on one topic, (n,) arrays: number of the run, simulation time (s) of the first state after it,
    and value in the unit of its topic.
    """

    run: NDArray[np.int64]
    t: Floats
    value: Floats

    def __repr__(self) -> str:
        return f"<Command: {counted(len(self.t), 'message')}>"


@dataclass(frozen=True, repr=False)
class RecordedTrajectory(Trajectory):
    """The samples of a recorded run.

    control : cycle means of the slip speed, target, commanded and applied pressure and events, as pictures show them
    """

    control: Control | None = None


class Recording(Result):
    """A recording, which is read once, when it is asked.

    Parameters
    ----------
    path : bag directory or .mcap file, complete or cut short
    scene : name or file, for a recording that holds none
    joints : names that flywheel and clutch_plate have in it, where they have others

    Raises
    ------
    InputError
        No recording there, nothing in it that can be read, or no scene.

    Examples
    --------
    >>> import tcc_sim
    >>> from tcc_sim.output.samples import write_trajectory
    >>> scene = tcc_sim.load_scene("slip")
    >>> run = tcc_sim.solve(scene, cycles=60, samples_per_cycle=50)
    >>> write_trajectory(folder / "read.mcap", run, scene.text())
    >>> tcc_sim.read(folder / "read.mcap").trajectory(start=0.5, end=1.0).t[[0, -1]].round(2).tolist()
    [0.5, 1.0]
    """

    def __init__(self, path: Path | str, scene: str | None = None, joints: Mapping[str, str] | None = None) -> None:
        self.path = Path(path)
        self.file = open_run(path, joints=joints)
        self.scene = recorded_scene(self.file, scene)
        self._line: Timeline | None = None

    def __repr__(self) -> str:
        ended = "complete" if self.file.complete else "cut short"
        return f"<Recording {self.path.name} of {self.scene.name}: {counted(len(self.runs), 'run')}, {ended}>"

    def columns(self, run: int = 0, start: float | None = None, end: float | None = None) -> dict[str, Floats | Modes]:
        """The samples of `trajectory`, by name."""
        return self.trajectory(run, start, end).columns()

    def _repr_html_(self) -> str:
        names = [item.name for item in fields(RecordedRun)]
        return f"<p>{escape(repr(self))}</p>{html_of({name: [getattr(r, name) for r in self.runs] for name in names})}"

    @property
    def complete(self) -> bool:
        """False where it was cut short."""
        return self.file.complete

    @cached_property
    def runs(self) -> tuple[RecordedRun, ...]:
        """From each start, reset or restart to the next."""
        return tuple(RecordedRun(states.run, float(states.stamp_ns[0]) * 1e-9, float(states.stamp_ns[-1]) * 1e-9,
                                 len(states), states.began.value) for states in self.line().runs)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """From each start, reset, restart or change of parameters to the next, with the figures of each."""
        timing = self._timing
        return segments_of(self.line(), timing.segment_clock, default_of(None, timing, self.scene),
                           controlled=self.file.controlled, solver=self.file.solver)[0]

    @cached_property
    def commands(self) -> Mapping[str, Command]:
        """What was commanded, by topic: engine_torque (N m), actuation_pressure (Pa), target_slip_speed (rad/s)."""
        runs, found = self.line().runs, {}
        firsts = [states.index for states in runs]
        for name, (rows, values, _) in self.line().commands.items():
            number = np.searchsorted(firsts, rows, side="right") - 1
            t = np.concatenate([np.empty(0), *(states.stamp_ns[rows[number == k] - states.index] * 1e-9
                                               for k, states in enumerate(runs))])
            found[name] = Command(np.array([runs[k].run for k in number.tolist()]), t, values)
        return found

    def line(self, window: Window | None = None) -> Timeline:
        """The states and what holds from each of them on, of all of it or of a window; all of it is read and kept
        where it fits into memory.
        """
        part = window or Window()
        if self._line is None:
            try:
                self._line = timeline_of(self.file, self.scene)
            except TooManyStates:
                if part.all:
                    raise
        found = self._line.within(part) if self._line is not None else timeline_of(self.file, self.scene, part)
        if not found.runs:
            part.refuse(self.file.stamps.runs)
        return found

    def trajectory(self, run: int = 0, start: float | None = None, end: float | None = None) -> Trajectory:
        """One run, or a stretch of it, as a solution is.

        Engine cycles are counted as `analyse` counts them, so that every analysis takes it; where no cycle can be told
        there is none. A gap stands between samples that are more than a tick apart.

        Parameters
        ----------
        run : number, counted from 0
        start, end : simulation time, s, both included; None for the run's own

        Raises
        ------
        InputError
            There is no such run, or no state in the window.
        """
        window = Window(run, start, end)
        line = self.line(window)
        (states,) = line.runs
        system = line.scene_at(states.index).system
        timing = self._timing if self._line is not None else self._timing_of(line)
        clock = timing.clock if timing.source == "found" else timing_of(replace(self.scene, system=system), None,
                                                                        line.runs).clock
        samples = trajectory_of(states, system, clock, self.file.solver)
        control = signals_of(line, states, clock, self.file.stamps.tick).control(clock.cycle)
        found = RecordedTrajectory(**vars(samples), control=control)
        if not clock.told:
            return found
        stream = CycleStream(system, clock)
        for block in states.blocks():
            stream.feed_states(block)
        longest = stream.longest()[1]
        return replace(found, cycles=longest.kept(0)[0] if longest.pieces else no_cycles())

    def to_pandas(self, run: int = 0, start: float | None = None, end: float | None = None) -> Any:
        """The same samples as a pandas.DataFrame, with the recorded pressures and target; its `attrs` hold the unit of
        each column and the scene.

        Raises
        ------
        MissingPackage
            pandas is not installed.
        InputError
            As `trajectory`.
        """
        require("pandas", "to_pandas")
        from pandas import DataFrame

        columns: dict[str, Any] = dict(self.trajectory(run, start, end).columns())
        line = self.line(Window(run, start, end))
        (states,) = line.runs
        if states.applied_pressure is not None:
            columns["applied_pressure"] = states.applied_pressure
        for name in ("actuation_pressure", TARGET):
            if name in line.commands:
                rows, values, _ = line.commands[name]
                last = np.searchsorted(rows, states.index + np.arange(len(states)), side="right") - 1
                columns[name] = np.where(last >= 0, values[last], np.nan)
        frame = DataFrame(columns)
        units = {name: topic(name).unit for name in columns if name not in UNITS}
        frame.attrs.update(units={**UNITS, **units}, scene=self.scene.text())
        return frame

    @cached_property
    def _timing(self) -> Timing:
        """How the engine cycles of all runs are counted."""
        return self._timing_of(self.line())

    def _timing_of(self, line: Timeline) -> Timing:
        """The same of a part of it."""
        return timing_of(self.scene, None, line.runs, frequency_changes(self.file))


def read(path: Path | str, scene: str | None = None, joints: Mapping[str, str] | None = None) -> Recording:
    """A recording as data (see `Recording`).

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.read(folder / "read.mcap").runs[0].began_by
    'start'
    """
    return Recording(path, scene, joints)
