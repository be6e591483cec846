"""Inputs that a recorded driveline applied, tick by tick: the timeline that `--verify`, `--inputs` and `identify` take.

A commanded input is constant within a tick and has the value that the state after the tick records. On the fallback to
the scene's harmonics it varies within the tick, and each state records its value at that instant.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import QUANTITIES, System
from tcc_sim.model.profile import smooth_corners
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.reader import Run
from tcc_sim.replay.inputs import GROUPS
from tcc_sim.replay.timeline import Timeline, timeline_of
from tcc_sim.scene import Scene
from tcc_sim.solvers.terms import terms_of, torques_at
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

BEFORE = 4
"""Number of states from which the value of a smooth input at the start of its first tick is extrapolated."""


def applied_inputs(line: Timeline, states: JointStates) -> dict[str, Floats]:
    """Return each input at the start and the end of the tick after each state, (n - 1, 2), N m and Pa.

    An input is linear within a tick: constant on a command, and between the corners of `smooth_corners` where it
    varies. An actuator's pressure is joined by straight lines. NaN stands for values that were not recorded; an input
    without any is left out.
    """
    applied = {}
    t = states.stamp_ns.astype(np.float64) * 1e-9
    scenes = np.searchsorted([index for index, _ in line.changes], states.index + np.arange(len(states)), side="right")
    for name in INPUTS:
        values, system = _recorded(line, states, name), line.scene_at(states.index).system
        if values is None:
            continue
        group = getattr(system, GROUPS[name])
        varies = np.full(len(t), group.source != "topic")
        if group.source == "topic" and group.harmonic:
            varies = ~line.commanded(states)[name]
        if name == INPUTS[1] and system.pressure.lagged:
            ticks = np.stack([values[:-1], values[1:]], axis=1)
        else:
            ticks = np.stack([values[1:], values[1:]], axis=1)
            meant = QUANTITIES[topic(name).key]
            for begin, end in _stretches(varies, scenes, values):
                corners = smooth_corners(t[begin:end], _from_start(t[begin:end], values[begin:end], begin > 0),
                                         meant.low, meant.high)
                ticks[begin:end - 1] = np.stack([corners[:-1], corners[1:]], axis=1)
        if np.isfinite(ticks).any():
            applied[name] = ticks
    return applied


def measured_run(run: Run, scene: Scene) -> tuple[JointStates, dict[str, Floats]]:
    """Return the longest run of a recording and its inputs from topics, as `applied_inputs`."""
    line = timeline_of(run, scene)
    states = max(line.runs, key=len)
    applied = applied_inputs(line, states)
    return states, {name: ticks for name, ticks in applied.items()
                    if getattr(scene.system, GROUPS[name]).source == "topic"}


def _recorded(line: Timeline, states: JointStates, name: str) -> Floats | None:
    """Return the values of an input at the states of a run, (n,); None if it was not recorded."""
    if name == INPUTS[0]:
        return states.engine_torque
    system: System = line.scene_at(states.index).system
    if system.pressure.source != "topic":
        t = states.stamp_ns.astype(np.float64) * 1e-9
        return np.broadcast_to(torques_at(terms_of(system), t)[1] / system.torque_per_pressure, t.shape)
    return states.applied_pressure


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
