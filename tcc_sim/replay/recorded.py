"""A recording as data: runs, segments, commands, and any window of it as a Trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop.control import Control
from tcc_sim.analysis.measured.stream import CycleStream
from tcc_sim.errors import InputError, counted, require
from tcc_sim.recording.columns import Window
from tcc_sim.recording.commands import COMMANDS
from tcc_sim.recording.drivelines import RecordedDriveline
from tcc_sim.recording.reader import Run, TooManyStates
from tcc_sim.replay.control import signals_of
from tcc_sim.replay.segments import Segment, segments_of
from tcc_sim.replay.timeline import Timeline, timeline_of, trajectory_of
from tcc_sim.replay.timing import Timing, default_of, frequency_changes, timing_of
from tcc_sim.result import Result, html_of
from tcc_sim.scene import load_scene, parse_scene
from tcc_sim.topics import TARGET, topic
from tcc_sim.trajectory import UNITS, Floats, Modes, Trajectory, no_cycles


@dataclass(frozen=True)
class RecordedRun:
    """One run of a recording, from a start, reset or restart of the driveline to the next.

    number : number of the run, counted from 0
    start, end : simulation time of its first and last state, s
    samples : number of joint_states
    began_by : start, reset or restart
    """

    number: int
    start: float
    end: float
    samples: int
    began_by: str


@dataclass(frozen=True, repr=False)
class Command:
    """Commands on one topic, (n,) arrays: number of the run, simulation time (s) of the first state after each command,
    and value in the unit of the topic.
    """

    run: NDArray[np.int64]
    t: Floats
    value: Floats

    def __repr__(self) -> str:
        return f"<Command: {counted(len(self.t), 'message')}>"


@dataclass(frozen=True, repr=False)
class RecordedTrajectory(Trajectory):
    """Trajectory of a recorded run.

    control : cycle means of the slip speed, target, commanded and applied pressure and events, for pictures
    """

    control: Control | None = None


class Recording(Result):
    """A recording, read on first use.

    Parameters
    ----------
    path : bag directory or .mcap file, complete or cut short
    scene : name or file of the scene, for a recording without one
    joints : names of flywheel and clutch_plate in the recording, if they differ
    topic : topic of the joint_states to read, if there are several
    driveline : number of the driveline to read, counted from 0; None for one with a scene, on the shortest topic, and
        there the latest run or, without names of runs, the one with the most states

    Raises
    ------
    InputError
        There is no recording, nothing in it can be read, or no scene is available.

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

    def __init__(self, path: Path | str, scene: str | None = None, joints: Mapping[str, str] | None = None,
                 topic: str | None = None, driveline: int | None = None) -> None:
        self.path = Path(path)
        self.file = Run(path, joints, topic, driveline)
        given = None if scene is None else load_scene(scene)
        if self.file.scene_text is not None:
            given = parse_scene(self.file.scene_text, self.path.stem)
        if given is None:
            raise InputError(f"{path} holds no scene of the recorded driveline; name it with --scene")
        self.scene = given
        self._line: Timeline | None = None

    def _text(self) -> str:
        ended = "complete" if self.file.complete else "cut short"
        return f"Recording {self.path.name} of {self.scene.name}: {counted(len(self.runs), 'run')}, {ended}"

    def columns(self, run: int = 0, start: float | None = None, end: float | None = None) -> dict[str, Floats | Modes]:
        """Return the samples of `trajectory` by name."""
        return self.trajectory(run, start, end).columns()

    def _repr_html_(self) -> str:
        names = [item.name for item in fields(RecordedRun)]
        return f"<p>{escape(repr(self))}</p>{html_of({name: [getattr(r, name) for r in self.runs] for name in names})}"

    @property
    def drivelines(self) -> tuple[RecordedDriveline, ...]:
        """Drivelines of the recording, and other nodes with joint states; `read` marks the one that is read."""
        return tuple(self.file.drivelines)

    @property
    def complete(self) -> bool:
        """Whether the recording was closed properly; False if it was cut short."""
        return self.file.complete

    @cached_property
    def runs(self) -> tuple[RecordedRun, ...]:
        """Runs, from each start, reset or restart to the next."""
        return tuple(RecordedRun(states.run, float(states.stamp_ns[0]) * 1e-9, float(states.stamp_ns[-1]) * 1e-9,
                                 len(states), states.began.value) for states in self.line().runs)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """Segments, from each start, reset, restart or change of parameters to the next, with their figures."""
        timing = self._timing
        return segments_of(self.line(), timing.segment_clock, default_of(None, timing, self.scene),
                           solver=self.file.solver)[0]

    @cached_property
    def commands(self) -> Mapping[str, Command]:
        """Commands by topic: engine_torque (N m), actuation_pressure (Pa), target_slip_speed (rad/s)."""
        line, commands = self.line(), dict[str, Command]()
        firsts, numbers = [states.index for states in line.runs], np.array([states.run for states in line.runs])
        for name, (rows, values, _) in line.commands.items():
            if name in COMMANDS:
                run = numbers[np.searchsorted(firsts, rows, side="right") - 1]
                commands[name] = Command(run, line.stamps_at(rows).astype(np.float64) * 1e-9, values)
        return commands

    def line(self, window: Window | None = None) -> Timeline:
        """Return the timeline of the recording or of a window; the whole recording is cached if it fits into memory."""
        part = window or Window()
        if self._line is None:
            try:
                self._line = timeline_of(self.file, self.scene)
            except TooManyStates:
                if part.all:
                    raise
        line = self._line.within(part) if self._line is not None else timeline_of(self.file, self.scene, part)
        if not line.runs:
            part.refuse(self.file.stamps.runs)
        return line

    def trajectory(self, run: int = 0, start: float | None = None, end: float | None = None) -> RecordedTrajectory:
        """Return one run or a part of it as a Trajectory, which every analysis accepts.

        Engine cycles are counted as in `analyse`; there are none if they cannot be identified. Samples more than a tick
        apart have a gap between them.

        Parameters
        ----------
        run : number of the run, counted from 0
        start, end : simulation time, s, both included; None for the start and end of the run

        Raises
        ------
        InputError
            The run does not exist, or the window has no state.
        """
        window = Window(run, start, end)
        line = self.line(window)
        (states,) = line.with_torques().runs
        system = line.scene_at(states.index).system
        timing = self._timing if self._line is not None else self._timing_of(line)
        clock = timing.clock if timing.source == "found" else timing_of(replace(self.scene, system=system), None,
                                                                        line.runs).clock
        samples = trajectory_of(line, states, system, clock, self.file)
        control = signals_of(line, states, clock, self.file.stamps.tick).control(clock.cycle)
        trajectory = RecordedTrajectory(**vars(samples), control=control)
        if not clock.identified:
            return trajectory
        stream = CycleStream(system, clock)
        for block in states.blocks():
            line.feed(stream, block)
        longest = stream.longest()[1]
        return replace(trajectory, cycles=longest.kept(0).cycles if longest.pieces else no_cycles())

    def to_pandas(self, run: int = 0, start: float | None = None, end: float | None = None) -> Any:
        """Return the samples of `trajectory` as a pandas.DataFrame, with the recorded pressures and target; its `attrs`
        hold the unit of each column and the scene.

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
        columns |= states.shown()
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
        return self._timing_of(self.line())

    def _timing_of(self, line: Timeline) -> Timing:
        return timing_of(self.scene, None, line.runs, frequency_changes(self.file), self.file.scene_text is None)


def read(path: Path | str, scene: str | None = None, joints: Mapping[str, str] | None = None,
         topic: str | None = None, driveline: int | None = None) -> Recording:
    """Return a recording as data (see `Recording`).

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.read(folder / "read.mcap").runs[0].began_by
    'start'
    """
    return Recording(path, scene, joints, topic, driveline)
