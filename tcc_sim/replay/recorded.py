"""A recording as data: its runs, segments and commands, and any window of it as the same object as a solution."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.errors import InputError, counted, require
from tcc_sim.model.parameters import System
from tcc_sim.recording.announcements import MOST_SCENES, places_of
from tcc_sim.recording.batches import JointStates, merged_batches
from tcc_sim.recording.commands import SOURCE, Commands, Rows
from tcc_sim.recording.reader import open_run
from tcc_sim.replay.segments import Segment
from tcc_sim.replay.timing import Timing, frequency_changes, recorded_scene, timing_of
from tcc_sim.result import Result, html_of
from tcc_sim.scene import parse_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of, torques_at
from tcc_sim.trajectory import Floats, Modes, Trajectory, modes_of, no_cycles

Commanded = Mapping[str, tuple[Rows, Floats]]
LATEST = 4294967296.0
"""Seconds beyond which there is no stamp."""


class Window:
    """What is wanted of a recording.

    Parameters
    ----------
    run : number of the run, counted from 0; None for all
    start, end : simulation time, s, both included; None for the run's own

    Raises
    ------
    InputError
        A run below 0, a time that no stamp can have, or an end that is not after the start.
    """

    def __init__(self, run: int | None = None, start: float | None = None, end: float | None = None) -> None:
        if run is not None and run < 0:
            raise InputError(f"run is {run}; runs are counted from 0")
        for name, t in (("start", start), ("end", end)):
            if t is not None and not abs(t) <= LATEST:
                raise InputError(f"the window's {name} is {t:g} s; it must be a number from {-LATEST:g} to {LATEST:g}")
        if start is not None and end is not None and not start < end:
            raise InputError(f"the window goes from {start:g} to {end:g} s; it must end after it starts")
        self.run = run
        self._start = -(2**63) if start is None else round(start * 1e9)
        self._end = 2**63 - 1 if end is None else round(end * 1e9)
        self._any = False
        self._held: dict[str, float] = {}

    def sentence(self) -> str:
        """What it leaves out; empty where that is nothing."""
        parts = [f"run {self.run}"] if self.run is not None else []
        parts += [f"from {self._start * 1e-9:g} s on"] if self._start > -(2**63) else []
        parts += [f"up to {self._end * 1e-9:g} s"] if self._end < 2**63 - 1 else []
        return f"only {', '.join(parts)} is analysed" if parts else ""

    def of(self, batches: Iterable[JointStates]) -> Iterator[JointStates]:
        """The states that lie in it."""
        for batch in batches:
            rows = self._rows(batch)
            if rows.stop > rows.start:
                yield batch[rows]

    def cut(self, batch: JointStates, commanded: Commanded) -> Iterator[tuple[JointStates, Commanded]]:
        """The states of a batch that lie in it, if any, with the commands by their rows; what was commanded before it
        holds from its first state on.
        """
        rows = self._rows(batch)
        if rows == slice(0, len(batch)) and not self._held:
            self._any = self._any or len(batch) > 0
            yield batch, commanded
            return
        for name, (places, values) in commanded.items():
            if len(earlier := values[places < rows.start]):
                self._held[name] = float(earlier[-1])
        if rows.stop <= rows.start:
            self._held.update({name: float(values[-1]) for name, (_, values) in commanded.items() if len(values)})
            return
        found = {name: (places[inside] - rows.start, values[inside]) for name, (places, values) in commanded.items()
                 for inside in [(places >= rows.start) & (places < rows.stop)]}
        for name, value in self._held.items():
            places, values = found.get(name, (np.empty(0, np.int64), np.empty(0)))
            if not len(places) or places[0] > 0:
                found[name] = np.append(0, places), np.append(value, values)
        self._held, self._any = {}, True
        yield batch[rows], found

    def check(self, runs: int) -> None:
        """Raise InputError where nothing lay in it, of a recording with so many runs."""
        if self._any:
            return
        if self.run is not None and self.run >= runs:
            raise InputError(f"there is no run {self.run}: the recording holds {counted(runs, 'run')}, counted from 0")
        raise InputError("the recording holds no state in the window")

    def _rows(self, batch: JointStates) -> slice:
        """Which states lie in it; none where the batch is of another run."""
        if self.run not in (None, batch.run):
            return slice(0, 0)
        first, last = np.searchsorted(batch.stamp_ns, self._start), np.searchsorted(batch.stamp_ns, self._end, "right")
        return slice(int(first), int(last))


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


class Recording(Result):
    """A recording that is read when it is asked: nothing of it is held but what was asked for.

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
        self._run, self._given, self._joints = open_run(path, joints=joints), scene, joints
        self.scene = recorded_scene(self._run, scene)

    def __repr__(self) -> str:
        ended = "complete" if self._run.complete else "cut short"
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
        return self._run.complete

    @cached_property
    def runs(self) -> tuple[RecordedRun, ...]:
        """From each start, reset or restart to the next."""
        found: dict[int, RecordedRun] = {}
        for batch in self.batches():
            start, end = float(batch.stamp_ns[0]) * 1e-9, float(batch.stamp_ns[-1]) * 1e-9
            before = found.get(batch.run, RecordedRun(batch.run, start, end, 0, batch.began.value))
            found[batch.run] = replace(before, end=end, samples=before.samples + len(batch))
        return tuple(found.values())

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """From each start, reset, restart or change of parameters to the next, with the figures of each."""
        from tcc_sim.replay.replay import replay

        return replay(self.path, scene=self._given, joints=self._joints).segments

    @cached_property
    def commands(self) -> Mapping[str, Command]:
        """What was commanded, by topic: engine_torque (N m), actuation_pressure (Pa), target_slip_speed (rad/s)."""
        commands, parts = Commands(self._run.joint_states_topic), dict[str, list[tuple[int, Floats, Floats]]]()
        for batch in self._run.batches(commands.take):
            for name, (rows, values) in commands.until(batch).items():
                if name != SOURCE:
                    t = batch.stamp_ns[rows].astype(np.float64) * 1e-9
                    parts.setdefault(name, []).append((batch.run, t, values))
        return {name: Command(np.concatenate([np.full(len(t), run) for run, t, _ in found]),
                              np.concatenate([t for _, t, _ in found]), np.concatenate([v for *_, v in found]))
                for name, found in parts.items()}

    def batches(self, window: Window | None = None) -> Iterator[JointStates]:
        """The states in the order of the recording, some thousands at a time: for what does not fit into memory."""
        return (window or Window()).of(batch for batch in self._run.batches() if len(batch))

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
        batches = list(self.batches(window))
        if not batches:
            window.check(self._run.stamps.runs)
        system = self._system(batches[0].index)
        clock = self._timing.clock if self._timing.source == "found" else timing_of(
            replace(self.scene, system=system), None, batches).clock
        solver = self._run.result.get("solver") if self._run.result is not None else None
        found = trajectory_of(batches, system, clock, solver if isinstance(solver, str) else "fixed_step")
        if not clock.told:
            return found
        stream = CycleStream(system, clock)
        for batch in batches:
            stream.feed(batch.stamp_ns, batch.flywheel_speed - batch.plate_speed, batch.plate_angle, batch.plate_speed,
                        batch.engine_torque, batch.friction_torque, batch.run)
        longest = stream.longest()[1]
        return replace(found, cycles=longest.kept(0)[0] if longest.pieces else no_cycles())

    def to_pandas(self, run: int = 0, start: float | None = None, end: float | None = None) -> Any:
        """The same samples as a pandas.DataFrame; its `attrs` hold the unit of each column and the scene.

        Raises
        ------
        MissingPackage
            pandas is not installed.
        InputError
            As `trajectory`.
        """
        require("pandas", "to_pandas")
        from pandas import DataFrame

        found = self.trajectory(run, start, end)
        frame = DataFrame(found.columns())
        frame.attrs.update(units=dict(Trajectory.UNITS), scene=self.scene.text())
        return frame

    @cached_property
    def _timing(self) -> Timing:
        """How the engine cycles of all runs are counted."""
        return timing_of(self.scene, None, self.batches(), frequency_changes(self._run))

    def _system(self, index: int) -> System:
        """What the scene in force at the state with this index describes."""
        places = places_of(self._run.scenes[:MOST_SCENES], self._run.batches())
        place = max((place for place in places if place.index <= index), default=None, key=lambda place: place.number)
        if place is None:
            return self.scene.system
        try:
            return parse_scene(self._run.scenes[place.number].parameters, self.scene.name).system
        except InputError:
            return self.scene.system


def read(path: Path | str, scene: str | None = None, joints: Mapping[str, str] | None = None) -> Recording:
    """A recording as data (see `Recording`).

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.read(folder / "read.mcap").runs[0].began_by
    'start'
    """
    return Recording(path, scene, joints)


def trajectory_of(batches: Sequence[JointStates], system: System, clock: EngineClock, solver: str) -> Trajectory:
    """Recorded states of one run as a trajectory, without its cycles.

    The saturation torque is that of the pressure that was applied, or of the scene; NaN where nobody says.
    """
    states, terms = merged_batches(batches), terms_of(system)
    t, slip_speed = states.stamp_ns.astype(np.float64) * 1e-9, states.flywheel_speed - states.plate_speed
    load = np.full(len(t), math.nan)
    if system.pressure.source != "topic":
        load = np.broadcast_to(torques_at(terms, t)[1], t.shape)
    elif states.applied_pressure is not None:
        load = system.torque_per_pressure * states.applied_pressure
    return Trajectory(
        t=t, slip_speed=slip_speed, plate_angle=states.plate_angle, plate_speed=states.plate_speed,
        engine_torque=states.engine_torque, saturation_torque=load, friction_torque=states.friction_torque,
        state=modes_of(np.nan_to_num(slip_speed), stick_speed_of(terms)), cycle=clock.cycle, solver=solver,
        system=system, flywheel_angle=states.flywheel_angle, cycles=None if clock.told else no_cycles())
