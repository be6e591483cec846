"""Parts of engine cycles, each from a start of its own, solved with their tangents in one compiled call."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.smoothed.integrate import integrate
from tcc_sim.solvers.smoothed.sensitivity_series import LANES, Tangent
from tcc_sim.solvers.smoothed.setup import Limits, Memory, Setup
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE, SETTLED
from tcc_sim.solvers.step_output import DONE, Store

STEPS_ALLOWED = 10
"""Steps of a part per those of a solve."""
MOVES = 256
"""Transitions of a part that are kept."""

PART = np.dtype([("first", np.int64), ("cycles", np.int64), ("tau", np.float64), ("tail", np.float64),
                 ("state", np.float64, 3), ("status", np.int64), ("moves", np.int64), ("stick_time", np.float64)])
"""A part: number of the cycle in which it starts, ends of cycles that it passes, time at its start within that cycle,
and at its end within the last one (s); the state at its start, then at its end; how it ended; the transitions on the
way; its time in stick (s)."""


@fast
def begin(part: Any, limits: Limits, tangent: Any, state: Any, control: Any, output: Any) -> None:
    """Set the engine to the start of a part, with the tangent the identity."""
    v, angle, speed = part.state[0], part.state[1], part.state[2]
    state.slip_speed, state.plate_angle, state.plate_speed, state.tau = v, angle, speed, part.tau
    control.method, control.level, control.slope, control.last, control.streak = 0, 0, 0.0, 0.0, 0
    control.released, control.calm, control.waited, control.patience = 0.0, CALM, SETTLED, PATIENCE
    control.unsettled = limits.forgotten
    control.slip_before, control.speed_before = 0.0, 0.0
    control.slip_now, control.speed_now = abs(v), abs(speed)
    output.cycle, output.samples, output.moves, output.mode = 0, 0, 0, 0
    if abs(v) > limits.stick_speed:
        output.mode = 1 if v > 0.0 else -1
    output.highest, output.lowest, output.stick_time = v, v, 0.0
    tangent.shared.peak = -1.0
    for i in range(tangent.groups.shape[0]):
        for c in range(3):
            for lane in range(LANES):
                tangent.groups[i].now[c, lane] = 1.0 if i == 0 and c == lane else 0.0


class Room(NamedTuple):
    """What parts are given in, what becomes of them, and work space; all of it is used again by the next ones.

    parts : (m,) array of PART
    modes : (m, MOVES + 1) array, their modes in order
    ends : (m, groups, 3, LANES) array, the tangents at their ends
    heights, climbs : (m, n), (m, n, groups, LANES) arrays, the largest |slip speed| of every cycle or part of one, and
        what it changes by
    groups, shared, peaks : as in `Tangent`
    """

    parts: Any
    modes: Any
    ends: Any
    heights: Any
    climbs: Any
    groups: Any
    shared: Any
    peaks: Any
    memory: Memory
    store: Store


@fast
def integrate_parts(room: Room, setup: Setup, torque: Any) -> None:
    """Solve all parts; `torque` is that of `Tangent`."""
    parts, modes, ends, heights, climbs, groups, shared, peaks, memory, store = room
    tangent = Tangent(groups, shared, torque, peaks)
    state, output, cycles, moves = memory.state, memory.output, store.cycles, store.moves
    for k in range(parts.shape[0]):
        part = parts[k]
        begin(part, setup.limits, tangent, state, memory.control, output)
        memory.counters.steps, memory.counters.rejected = 0, 0
        steps = STEPS_ALLOWED * setup.limits.steps * (part.cycles + 1)
        part.status = integrate(part.first, part.cycles, part.tail, steps, setup, memory, tangent, store, None)
        if part.status != DONE:
            return
        part.state[0], part.state[1], part.state[2] = state.slip_speed, state.plate_angle, state.plate_speed
        part.moves = min(output.moves, MOVES)
        modes[k, 0] = moves[0].before if part.moves > 0 else output.mode
        for i in range(part.moves):
            modes[k, i + 1] = moves[i].after
        part.stick_time = output.stick_time if part.tail > 0.0 else 0.0
        for n in range(part.cycles):
            part.stick_time += cycles[n].stick_time
            heights[k, n] = max(cycles[n].highest, -cycles[n].lowest)
        if part.tail > 0.0:
            heights[k, part.cycles] = max(output.highest, -output.lowest)
        for i in range(groups.shape[0]):
            for lane in range(LANES):
                for c in range(3):
                    ends[k, i, c, lane] = groups[i].now[c, lane]
                for n in range(part.cycles):
                    climbs[k, n, i, lane] = peaks[n, i, lane]
                if part.tail > 0.0:
                    climbs[k, part.cycles, i, lane] = groups[i].peak[lane]
