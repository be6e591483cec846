"""The stroboscopic map of the smoothed law with its exact derivatives, by the state and by the scene's keys.

The derivatives are those of the method (`sensitivity`): what the engine returns for a start or a key that is a little
different, its steps being the same. Parts of engine cycles, each from a start of its own, are solved in one compiled
call.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.solvers import collocation
from tcc_sim.solvers.changes import ALONG, CHANGES, LANES
from tcc_sim.solvers.compiling.compiled import Partial, fast
from tcc_sim.solvers.kept import CYCLE, DONE, MOVE, STATUSES, Store
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO
from tcc_sim.solvers.smoothed.integrate import integrate
from tcc_sim.solvers.smoothed.sensitivity_series import SHARED, Tangent
from tcc_sim.solvers.smoothed.setup import Limits, Memory, Setup
from tcc_sim.solvers.smoothed.solve import KINDS, setup_of
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE, SETTLED
from tcc_sim.solvers.stroboscopic import Prepared, Stroboscopic
from tcc_sim.trajectory import Floats, event_sequence

STEPS_ALLOWED = 10
"""Steps of a part per those of a solve."""
MOVES = 256
"""Transitions of a part that are kept."""

PART = np.dtype([("first", np.int64), ("cycles", np.int64), ("tau", np.float64), ("tail", np.float64),
                 ("state", np.float64, 3), ("status", np.int64), ("moves", np.int64), ("stick_time", np.float64)])
"""A part: number of the cycle in which it starts, ends of cycles that it passes, time at its start within that cycle,
and at its end within the last one (s); the state at its start, then at its end; how it ended; the transitions on the
way; its time in stick (s)."""
SINE = 0.7
"""Angle of a sine within a series step that shows it, per `Limits.resolved`, which takes it that changes decay."""


@fast
def start_part(part: Any, limits: Limits, tangent: Any, state: Any, control: Any, output: Any) -> None:
    """Set the engine to the start of a part, with the tangent the identity."""
    v, angle, speed = part.state[0], part.state[1], part.state[2]
    state.slip_speed, state.plate_angle, state.plate_speed, state.tau = v, angle, speed, part.tau
    control.method, control.level, control.rate, control.last, control.streak = 0, 0, 0.0, 0.0, 0
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
    groups, along, shared, peaks : as in `Tangent`
    """

    parts: Any
    modes: Any
    ends: Any
    heights: Any
    climbs: Any
    groups: Any
    along: Any
    shared: Any
    peaks: Any
    memory: Memory
    store: Store


@fast
def integrate_parts(room: Room, setup: Setup, torque: Any) -> None:
    """Solve all parts; `torque` is that of `Tangent`."""
    parts, modes, ends, heights, climbs, groups, along, shared, peaks, memory, store = room
    tangent = Tangent(groups, along, shared, torque, peaks)
    state, output, cycles, moves = memory.state, memory.output, store.cycles, store.moves
    for k in range(parts.shape[0]):
        part = parts[k]
        start_part(part, setup.limits, tangent, state, memory.control, output)
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


def slope_integrals(system: System, state: Floats, cycle: int, rtol: float) -> Floats:
    """The integrals over engine cycle number `cycle` of dT/dv v^2, v^2 and min(dT/dv, 0), (3,), by quadrature on the
    polynomials of the steps; see (21).

    Raises
    ------
    NumericalFailure
        The engine stopped early.
    """
    shared = room_of(1, 2, 1)[0].shared
    shared["slopes"], shared["averaged"] = 0.0, 1
    try:
        Smoothed(system, (), rtol).over(state, cycle, cycle + 1)
        found: Floats = shared["slopes"].copy()
    finally:
        shared["averaged"] = 0
    return found


class Smoothed(Prepared):
    """By the engine of the smoothed law; a smooth flow has no margins."""

    def __init__(self, system: System, keys: tuple[str, ...], rtol: float) -> None:
        super().__init__(system, keys)
        terms, changes = self.terms, self.changes
        # What mubar changes by with mu_s/mu_k dies down with slip as exp(-alpha |v|), however near to 1 it is.
        self.setup = setup_of(system, terms, rtol, 1.0 if changes[EXCESS_RATIO].any() else 0.0)
        ladder = collocation.ladder_of(self.setup.limits.fastest, self.period)
        self.torque = collocation.response(terms.linear, *ladder).torque
        limits = self.setup.limits
        self.reach = SINE * limits.resolved / self.fastest if self.fastest > 0.0 else math.inf

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3), by one compiled call."""
        groups, count, period = len(self.by), len(states), self.period
        spans = [(math.floor(start), math.floor(end), start, end) for start, end in zip(starts, ends)]
        most = max([last - first for first, last, _, _ in spans]) + 1
        room, solve = room_of(groups, most, count)
        room.groups["by"], room.groups["forced"], room.shared["reach"] = self.by, self.forced, self.reach
        room.along["shaped"] = self.shaped
        for k, (first, last, start, end) in enumerate(spans):
            room.parts[k] = (first, last - first, (start - first) * period, (end - last) * period, states[k], DONE, 0,
                             0.0)
        solve(self.setup, self.torque)
        by = room.ends.transpose(0, 2, 1, 3).reshape(count, 3, -1)[..., :self.count].copy()
        heights, peaks = room.heights.copy(), room.climbs.reshape(count, most, -1)[..., :self.count].copy()
        out = []
        for k, part in enumerate(room.parts.copy()):
            _, cycles, _, tail, state, status, moves, stick_time = part.item()
            if status != DONE:
                raise NumericalFailure(f"smoothed: {STATUSES[status].value} after phase {starts[k]:g} of the engine "
                                       "cycle")
            n = cycles + (tail > 0.0)
            out.append(Stroboscopic(state, by[k], event_sequence(room.modes[k, :moves + 1].tolist()), heights[k, :n],
                                    peaks[k, :n], stick_time))
        return out


_rooms = threading.local()


def room_of(groups: int, most: int, count: int) -> tuple[Room, Partial]:
    """Room of this thread for so many groups of lanes, cycles in a part, and parts; and the kernel with it."""
    known: dict[tuple[int, int, int], tuple[Room, Partial]] = _rooms.__dict__.setdefault("known", {})
    found = known.get((groups, most, count))
    if found is None:
        room = Room(np.zeros(count, PART), np.empty((count, MOVES + 1), np.int8), np.empty((count, groups, 3, LANES)),
                    np.empty((count, most)), np.empty((count, most, groups, LANES)), np.zeros(groups, CHANGES),
                    np.zeros(1, ALONG)[0], np.zeros(1, SHARED)[0], np.zeros((most, groups, LANES)),
                    Memory(*(np.zeros(1, kind)[0] for kind in KINDS)),
                    Store(np.zeros(most + 1, CYCLE), np.empty((0, 3)), 0, np.zeros(MOVES, MOVE)))
        found = known[groups, most, count] = room, Partial(integrate_parts, room)
    return found
