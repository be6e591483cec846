"""A recording cut once: its states with the scenes, sources and commands that hold from each of them on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.recording.announcements import MOST_SCENES, SceneRecord
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.recording.commands import TARGET, Rows
from tcc_sim.recording.places import places_of
from tcc_sim.recording.reader import Run
from tcc_sim.recording.window import Window
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of, torques_at
from tcc_sim.trajectory import Floats, Trajectory, modes_of, no_cycles

Held = tuple[tuple[int, frozenset[str]], ...]


@dataclass(frozen=True)
class Timeline:
    """A recording's states and what holds from each of them on; states are counted over the whole recording.

    runs : the states of every run, or those of it that lie in a window
    scene : the first
    scenes : all that the recording holds
    places : (index of a state, number of the scene that holds from it on), not descending
    commands : by topic
    sources : index of a state, and the inputs that a command held from there on
    starts : (n,) index of the first state of each chunk and run
    publishers : number of those who commanded, by topic
    counts : what the driveline's diagnostics counted, by key; of the whole recording
    """

    runs: tuple[JointStates, ...]
    scene: Scene
    scenes: Sequence[SceneRecord]
    places: tuple[tuple[int, int], ...]
    commands: Mapping[str, Commanded]
    sources: Held
    starts: Rows
    publishers: Mapping[str, int]
    counts: Mapping[str, int]

    def within(self, window: Window) -> Timeline:
        """The part of it that lies in a window; what was commanded before it holds from its first state on."""
        if window.all:
            return self
        runs = tuple(states[rows] for states in self.runs for rows in [window.rows(states)] if rows.stop > rows.start)
        return replace(self, runs=runs, commands={name: _within(runs, said) for name, said in self.commands.items()})

    @cached_property
    def changes(self) -> list[tuple[int, Scene]]:
        """Index of a state, and the scene that holds from it on, for all but the first scene that can be read."""
        found = []
        for index, number in self.places:
            if number:
                try:
                    found.append((index, parse_scene(self.scenes[number].parameters, self.scene.name)))
                except InputError:  # Whoever solves it again says what is wrong with it.
                    continue
        return found

    def scene_at(self, index: int) -> Scene:
        """The scene in force at a state."""
        return next((scene for at, scene in reversed(self.changes) if at <= index), self.scene)

    def target_before(self, index: int) -> float | None:
        """The target slip speed that was said last before a state."""
        rows, values, _ = self.commands.get(TARGET, Commanded.none())
        count = int(np.searchsorted(rows, index))
        return float(values[count - 1]) if count else None


def _within(runs: Sequence[JointStates], said: Commanded) -> Commanded:
    """The commands beside states; of those before each stretch of them the last, at its first state."""
    found, done, rows = [Commanded.none()], 0, said.rows
    for states in runs:
        begin, end = np.searchsorted(rows, [states.index + 1, states.index + len(states)]).tolist()
        if begin > done:
            found.append(said.part(slice(begin - 1, begin))._replace(rows=np.array([states.index])))
        found.append(said.part(slice(begin, end)))
        done = end
    return Commanded(*(np.concatenate(columns) for columns in zip(*found)))


def timeline_of(run: Run, scene: Scene, window: Window | None = None) -> Timeline:
    """Read a recording, or the states in a window, and cut it.

    Raises
    ------
    RecordingError, TooManyStates
        As `Run.columns`.
    """
    found = run.columns(window)
    places, sources = places_of(run.scenes[:MOST_SCENES], found.runs), places_of(found.sources, found.runs)
    held = tuple((place.index, found.sources[place.number].commanded) for place in sources)
    line = Timeline(found.runs, scene, run.scenes, tuple((place.index, place.number) for place in places),
                    found.commands, held, found.parts, found.publishers, found.counts)
    return line if window is None else line.within(window)


def slip_between_gaps(states: JointStates, tick: int) -> Iterator[tuple[bool, Floats, Floats]]:
    """Stretches without a gap of the finite slip speeds of a run: whether a gap is before it, times (s), slip speeds.

    Parameters
    ----------
    tick : distance of stamps, ns; 0 where it is not known
    """
    before = int(states.stamp_ns[0])
    for block in states.blocks():
        slip = block.flywheel_speed - block.plate_speed
        finite = np.isfinite(slip)
        stamps, slip = block.stamp_ns[finite], slip[finite]
        gaps = np.flatnonzero(2 * np.diff(stamps, prepend=before) > 3 * tick).tolist() if tick else []
        for begin, end in zip([0, *gaps], [*gaps, len(stamps)]):
            if end > begin:
                yield begin in gaps, stamps[begin:end].astype(np.float64) * 1e-9, slip[begin:end]
        before = int(stamps[-1]) if len(stamps) else before


def trajectory_of(states: JointStates, system: System, clock: EngineClock, solver: str) -> Trajectory:
    """Recorded states of one run as a trajectory, without its cycles.

    The saturation torque is that of the pressure that was applied, or of the scene; NaN where nobody says.
    """
    terms = terms_of(system)
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
        system=system, flywheel_angle=states.flywheel_angle, cycles=None if clock.told else no_cycles(),
        output_angle=_moved(states.output_angle), output_speed=_moved(states.output_speed))


def _moved(column: Floats | None) -> Floats | None:
    """What was recorded of the shaft's far end: 0 until it first moved, None where it never did."""
    if column is None or not (known := np.isfinite(column)).any():
        return None
    return np.where(np.arange(len(column)) < int(known.argmax()), 0.0, column)
