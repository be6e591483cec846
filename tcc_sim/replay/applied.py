"""Inputs that a recorded driveline applied, tick by tick: the timeline that `--verify`, `--inputs` and `identify` take.

A commanded input is constant within a tick and has the value that the state after the tick records. On the fallback to
the scene's harmonics it varies within the tick, and each state records its value at that instant.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.messages.held import COMMAND
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.model.profile import smooth_corners
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.reader import Run
from tcc_sim.replay.inputs import GROUPS
from tcc_sim.replay.timeline import Timeline, timeline_of
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

BEFORE = 4
"""Number of states from which the value of a smooth input at the start of its first tick is extrapolated."""


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
    texts = line.scenes_in(states)
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
