"""Timeline of a recording: its states with the scenes, commands and inputs that apply to them.

A commanded input is constant within a tick and has the value that the state after the tick records. On the fallback to
the scene's harmonics it varies within the tick, and each state records its value at that instant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop.control import Steps
from tcc_sim.analysis.measured.engine_clock import EngineClock
from tcc_sim.analysis.measured.signals import BRIDGED_TICKS
from tcc_sim.analysis.measured.stream import CyclePiece, CycleStream
from tcc_sim.errors import InputError
from tcc_sim.messages.held import COMMAND
from tcc_sim.model.equations import accelerations, linear_of
from tcc_sim.model.parameters import QUANTITIES, System
from tcc_sim.model.profile import START, Origin, smooth_corners
from tcc_sim.recording.announcements import MOST_SCENES, SceneRecord
from tcc_sim.recording.columns import Columns, Commanded, JointStates, Window
from tcc_sim.recording.reader import Run
from tcc_sim.recording.runs import commands_held, placed
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_from, terms_of, torques_at
from tcc_sim.topics import INPUTS, TARGET, topic
from tcc_sim.trajectory import Floats, Trajectory, modes_of, no_cycles

TORQUES = ("engine_torque", "friction_torque")
GROUPS = dict(zip(INPUTS, ("engine", "pressure")))
"""Group of the scene's keys that gives the source of each input."""
BEFORE = 4
"""Number of states from which the value of a smooth input at the start of its first tick is extrapolated."""


@dataclass(frozen=True)
class Timeline(Columns):
    """Data of a recording, or its part in a window, with the scenes; indices count over the whole recording.

    scene : the first scene
    places : (index of the first state, number of the scene that applies from it on), not descending
    whole : whether it is the whole recording
    """

    scene: Scene
    scenes: Sequence[SceneRecord]
    places: tuple[tuple[int, int], ...]
    whole: bool = True

    def within(self, window: Window) -> Timeline:
        """Return the part in a window; the last command before the window applies from its first state on."""
        if window.all:
            return self
        runs = tuple(states[rows] for states in self.runs for rows in [window.rows(states)] if rows.stop > rows.start)
        return replace(self, runs=runs, commands=commands_held(runs), whole=False)

    @cached_property
    def absent(self) -> tuple[str, ...]:
        """Names of the columns of joint_states that hold no number in any state."""
        return tuple(name for name in topic("joint_states").fields
                     if not any(np.isfinite(getattr(states, name)).any() for states in self.runs))

    def with_torques(self) -> Timeline:
        """Return the timeline with torques that were not recorded, as estimates: (2a) and (2b) with central differences
        of the recorded speeds; InputError if an angle of the plate or a speed was not recorded.
        """
        missing = [name for name in self.absent if name not in (*TORQUES, "flywheel_angle")]
        if missing:
            raise InputError(f"{', '.join(missing)} of the joint states: no state holds a number; positions and "
                             "velocities of flywheel and clutch plate are needed")
        if not set(self.absent) & set(TORQUES):
            return self
        return replace(self, runs=tuple(_with_torques(states, self.scene_at(states.index).system, self.absent)
                                        for states in self.runs))

    @cached_property
    def changes(self) -> list[tuple[int, Scene, Origin]]:
        """Index of the first state, scene, and origin of the phases of each readable scene except the first."""
        changes = []
        for index, number in self.places:
            if number:
                with suppress(InputError):  # The verification reports this error.
                    changes.append((index, *self.scene_of(number)))
        return changes

    def scene_of(self, number: int) -> tuple[Scene, Origin]:
        """Return the scene with this number and the origin of its phases, the first one where there is none; InputError
        if it cannot be read.
        """
        if number >= len(self.scenes):
            return self.scene, START
        if number not in self._parsed:
            self._parsed[number] = parse_scene(self.scenes[number].parameters, self.scene.name)
        return self._parsed[number], self.scenes[number].origin

    @cached_property
    def _parsed(self) -> dict[int, Scene]:
        """Scenes by number, each after its first use."""
        return {}

    def scene_at(self, index: int) -> Scene:
        """Return the scene that applies to a state."""
        return next((scene for at, scene, _ in reversed(self.changes) if at <= index), self.scene)

    def load_of(self, states: JointStates) -> Floats:
        """Return the saturation torque at the states of a run, (n,), N m, from the applied pressure or from the scenes;
        NaN if neither is known.
        """
        if self.scene_at(states.index).system.pressure.source == "topic":
            per_pressure = self.along(states, lambda system: system.torque_per_pressure)
            return per_pressure * states.of("applied_pressure")
        t = states.stamp_ns.astype(np.float64) * 1e-9
        return np.concatenate([np.broadcast_to(torques_at(terms_from(system, origin), t[rows])[1], t[rows].shape)
                               for rows, system, origin in self.parts_of(states)])

    def along(self, states: JointStates, quantity: Callable[[System], float]) -> Floats:
        """Return a quantity of the system at each state of a run, (n,)."""
        return np.concatenate([np.full(rows.stop - rows.start, quantity(system))
                               for rows, system, _ in self.parts_of(states)])

    def feed(self, stream: CycleStream, states: JointStates) -> list[CyclePiece]:
        """Feed states to a stream with the systems that held at them, and return the completed cycles."""
        return [piece for rows, system, _ in self.parts_of(states)
                for piece in stream.feed_states(states[rows], system)]

    def parts_of(self, states: JointStates) -> list[tuple[slice, System, Origin]]:
        """Return the parts of a run with one system each: rows, system, and origin of its phases."""
        first = next((origin for at, _, origin in reversed(self.changes) if at <= states.index),
                     self.scenes[0].origin if self.scenes else START)
        parts = [(0, self.scene_at(states.index).system, first),
                 *((at - states.index, scene.system, origin) for at, scene, origin in self.changes
                   if states.index < at < states.index + len(states))]
        return [(slice(begin, end), system, origin)
                for (begin, system, origin), end in zip(parts, [*(at for at, *_ in parts[1:]), len(states)])]

    @property
    def longest(self) -> JointStates:
        """The run with the most states, the last of several."""
        return max(self.runs, key=lambda states: (len(states), states.run))

    def stamps_at(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the stamps of states, ns, by their index in the whole recording; 0 outside."""
        out = np.zeros(len(rows), np.int64)
        for states in self.runs:
            inside = (rows >= states.index) & (rows < states.index + len(states))
            out[inside] = states.stamp_ns[rows[inside] - states.index]
        return out

    def target_in(self, states: JointStates) -> Steps:
        """Return the target slip speed in a run, rad/s."""
        rows, values, _ = self.commands.get(TARGET, Commanded.none())
        low, high = np.searchsorted(rows, [states.index, states.index + len(states)])
        at, targets = rows[low:high] - states.index, values[low:high]
        last = np.diff(at, append=-1) != 0
        return Steps(states.stamp_ns[at[last]] * 1e-9, targets[last])

    def with_target(self, target: Steps) -> Timeline:
        """Return the timeline with a target, rad/s from times (s) of every run on, in place of the recorded one."""
        rows, values = [], []
        for states in self.runs:
            at = np.searchsorted(states.stamp_ns, np.rint(target.t * 1e9).astype(np.int64))
            inside = at < len(states)
            rows.append(states.index + at[inside])
            values.append(target.values[inside])
        row = np.concatenate([np.empty(0, np.int64), *rows])
        given = Commanded(row, np.concatenate([np.empty(0), *values]), np.full(len(row), -1))
        return replace(self, commands={**self.commands, TARGET: given})


def _with_torques(states: JointStates, system: System, absent: Sequence[str]) -> JointStates:
    """Return states of a run with estimates of the torques that are absent."""
    linear, t = linear_of(system), states.stamp_ns * 1e-9
    if len(states) < 2:
        return states
    slip = states.flywheel_speed - states.plate_speed
    far = states.far_end
    # Both accelerations are linear in the torques, with the coefficients 1/I1, and -1/I1 - 1/I2 and 1/I2.
    slip_free, plate_free = accelerations(slip, states.plate_angle, states.plate_speed, 0.0, 0.0, linear,
                                           far.angle, far.speed)
    friction = states.friction_torque
    if "friction_torque" in absent:
        friction = (np.gradient(states.plate_speed, t) - plate_free) * linear.plate
    engine = states.engine_torque
    if "engine_torque" in absent:
        engine = (np.gradient(slip, t) - slip_free) * linear.flywheel
        engine += friction * (1.0 + linear.flywheel / linear.plate)
    return replace(states, friction_torque=friction, engine_torque=engine)


def timeline_of(run: Run, scene: Scene, window: Window | None = None) -> Timeline:
    """Read the timeline of a recording, or of the states in a window; errors are those of `Run.columns`."""
    columns = run.columns(window)
    scenes = run.scenes[:MOST_SCENES]
    places = placed(scenes, columns.runs, run.driveline.runs)
    line = Timeline(**vars(columns), scene=scene, scenes=run.scenes, places=tuple(places))
    return line if window is None else line.within(window)


def slip_between_gaps(states: JointStates, tick: int) -> Iterator[tuple[bool, Floats, Floats]]:
    """Iterate over gap-free parts of the finite slip speeds of a run: whether a gap precedes, times (s), slip speeds.

    A single lost state is no gap. `tick` is the time between stamps, ns; 0 if unknown.
    """
    before = int(states.stamp_ns[0])
    for block in states.blocks():
        slip = block.flywheel_speed - block.plate_speed
        finite = np.isfinite(slip)
        stamps, slip = block.stamp_ns[finite], slip[finite]
        gaps = np.flatnonzero(np.diff(stamps, prepend=before) > BRIDGED_TICKS * tick).tolist() if tick else []
        for begin, end in zip([0, *gaps], [*gaps, len(stamps)]):
            if end > begin:
                yield begin in gaps, stamps[begin:end].astype(np.float64) * 1e-9, slip[begin:end]
        before = int(stamps[-1]) if len(stamps) else before


def trajectory_of(line: Timeline, states: JointStates, system: System, clock: EngineClock, run: Run) -> Trajectory:
    """Return the states of one run with every value as a Trajectory without cycles; `system` holds at its begin."""
    load, stick_speed = line.load_of(states), line.along(states, lambda held: stick_speed_of(terms_of(held)))
    systems = (float(states.stamp_ns[0]) * 1e-9, system), *((float(states.stamp_ns[rows.start]) * 1e-9, later)
                                                            for rows, later, _ in line.parts_of(states)[1:])
    states, load, stick_speed = states[states.known], load[states.known], stick_speed[states.known]
    far = far_columns(states)
    slip_speed = states.flywheel_speed - states.plate_speed
    return Trajectory(
        t=states.stamp_ns.astype(np.float64) * 1e-9, slip_speed=slip_speed, plate_angle=states.plate_angle,
        plate_speed=states.plate_speed, engine_torque=states.engine_torque, saturation_torque=load,
        friction_torque=states.friction_torque, state=modes_of(slip_speed, stick_speed), cycle=clock.cycle,
        solver=run.solver, largest_step=1e-9 * run.stamps.longest if run.stamps.tick else math.inf,
        system=system, flywheel_angle=states.flywheel_angle, cycles=None if clock.identified else no_cycles(),
        output_angle=far.get("output_angle"), output_speed=far.get("output_speed"),
        systems=systems)


def far_columns(states: JointStates) -> dict[str, Floats]:
    """Return angle and speed of the shaft's far end by name, (n,); none if it did not move."""
    if not len(states) or states.moved_ns > states.stamp_ns[-1]:
        return {}
    return dict(zip(("output_angle", "output_speed"), (np.asarray(column) for column in states.far_end[:2])))


class TickInput(NamedTuple):
    """An input of a recorded driveline tick by tick: (n,) arrays, of the tick that ends at each of n states.

    recorded : value at each state, N m or Pa, NaN where none was recorded
    commanded : whether it has the recorded value throughout the tick, or an actuator goes to it from the value before;
        otherwise it varies as the scene's sines and profiles do
    known : whether the recording states what acted
    """

    recorded: Floats
    commanded: NDArray[np.bool_]
    known: NDArray[np.bool_]


def inputs_of_ticks(line: Timeline, states: JointStates) -> dict[str, TickInput]:
    """Return the inputs of a run by name; the scene at its begin tells the source of each.

    On the fallback to its mean an input counts as commanded, as it does where the recording does not state the source.
    """
    out, system = {}, line.scene_at(states.index).system
    for name, recorded in zip(INPUTS, (states.engine_torque, states.of("applied_pressure"))):
        group, never = getattr(system, GROUPS[name]), np.zeros(len(states), np.bool_)
        if group.source != "topic":
            out[name] = TickInput(recorded, never, ~never)
            continue
        source = states.input(name, "source")
        stated = np.isfinite(source) if states.held is not None or line.keyed else ~never
        commanded = (source == COMMAND) | np.isnan(source).all() | (not group.harmonic)
        there = np.isfinite(recorded)
        if name == INPUTS[1]:
            there = there | ~commanded  # The engine torque of a fallback is recorded too.
        out[name] = TickInput(recorded, commanded, there & (stated | (not group.harmonic)))
    return out


def applied_inputs(line: Timeline, states: JointStates) -> dict[str, Floats]:
    """Return each input at the start and the end of the tick after each state, (n - 1, 2), N m and Pa.

    An input is linear within a tick: constant on a command, and between the corners of `smooth_corners` where it
    varies. An actuator's pressure is joined by straight lines. NaN stands for values that were not recorded; an input
    without any is left out.
    """
    applied, system = {}, line.scene_at(states.index).system
    t = states.stamp_ns.astype(np.float64) * 1e-9
    scenes = np.searchsorted([index for index, *_ in line.changes], states.index + np.arange(len(states)), side="right")
    for name, (values, commanded, _) in inputs_of_ticks(line, states).items():
        if name == INPUTS[1] and system.pressure.source != "topic":
            values = line.load_of(states) / line.along(states, lambda held: held.torque_per_pressure)
        if name == INPUTS[1] and system.pressure.lagged:
            ticks = np.stack([values[:-1], values[1:]], axis=1)
        else:
            ticks = np.stack([values[1:], values[1:]], axis=1)
            meant = QUANTITIES[topic(name).key]
            for begin, end in _stretches(~commanded, scenes, values):
                corners = smooth_corners(t[begin:end], _from_start(t[begin:end], values[begin:end], begin > 0),
                                         meant.low, meant.high)
                ticks[begin:end - 1] = np.stack([corners[:-1], corners[1:]], axis=1)
        if np.isfinite(ticks).any():
            applied[name] = ticks
    return applied


def measured_run(run: Run, scene: Scene) -> tuple[JointStates, dict[str, Floats], Scene]:
    """Return the longest run of a recording with this first scene, its inputs from topics, as `applied_inputs`, and the
    run's scene; InputError if it changed during the run or cannot be read.
    """
    line = timeline_of(run, scene)
    states = line.longest
    first = [number for index, number in line.places if index <= states.index][-1:]
    later = [number for index, number in line.places if states.index < index < states.index + len(states)]
    texts = {line.scenes[number].parameters for number in (*first, *later)}  # Readable or not.
    if len(texts) > 1:
        raise InputError(f"{run.path}: the scene changed while it ran; identification needs one scene")
    for text in texts:
        scene = parse_scene(text, scene.name)
    applied = applied_inputs(line, states)
    return states, {name: ticks for name, ticks in applied.items()
                    if getattr(scene.system, GROUPS[name]).source == "topic"}, scene


def _stretches(varies: NDArray[np.bool_], scenes: NDArray[np.int64], values: Floats) -> list[tuple[int, int]]:
    """Return first and last state, the latter not included, of each stretch of ticks in which an input of one scene
    varies; the flags and numbers of a tick are those of the state after it.
    """
    number = np.where(varies & np.isfinite(values), scenes, -1)[1:]
    cuts = [0, *(1 + np.flatnonzero(np.diff(number))).tolist(), len(number)]
    return [(a, b + 1) for a, b in pairwise(cuts) if b > a and number[a] >= 0]


def _from_start(t: Floats, values: Floats, replaced: bool) -> Floats:
    """Return the values of a stretch; the first is extrapolated if it is of another source (`replaced`) or unknown."""
    if not replaced and np.isfinite(values[0]):
        return values
    near = slice(1, 1 + BEFORE)
    out: Floats = values.copy()
    out[0] = np.polyfit(t[near] - t[0], values[near], len(values[near]) - 1)[-1]
    return out
