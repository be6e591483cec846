"""The stroboscopic map of the smoothed law with its exact derivatives, by the state and by the scene's keys.

The derivatives are those of the method (`tangent_series`, `tangent_step`): what the engine returns for a start or a key
that is a little different, its steps being the same.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.solvers import collocation
from tcc_sim.solvers.compiling.compiled import Partial
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO, NUMBERS
from tcc_sim.solvers.smoothed.sensitivity_integrate import MOVES, PART, Room, integrate_parts
from tcc_sim.solvers.smoothed.sensitivity_series import CHANGES, LANES, SHARED
from tcc_sim.solvers.smoothed.setup import Memory
from tcc_sim.solvers.smoothed.solve import KINDS, setup_of
from tcc_sim.solvers.step_output import CYCLE, DONE, MOVE, STATUSES, Store
from tcc_sim.solvers.stroboscopic import Prepared, Stroboscopic
from tcc_sim.trajectory import Floats, event_sequence

SINE = 0.7
"""Angle of a sine within a series step that shows it, per `Limits.resolved`, which takes it that changes decay."""


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
        limits, groups = self.setup.limits, math.ceil(self.count / LANES)
        self.reach = SINE * limits.resolved / self.fastest if self.fastest > 0.0 else math.inf
        self.forced = [(1 << self.count) - 8 >> LANES * k & (1 << LANES) - 1 for k in range(groups)]
        self.by = np.zeros((groups, len(NUMBERS), LANES))
        for k in range(3, self.count):
            self.by[k // LANES, :, k % LANES] = changes[:, k - 3]

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3), by one compiled call."""
        groups, count, period = len(self.by), len(states), self.period
        spans = [(math.floor(start), math.floor(end), start, end) for start, end in zip(starts, ends)]
        most = max([last - first for first, last, _, _ in spans]) + 1
        room, solve = room_of(groups, most, count)
        room.groups["by"], room.groups["forced"], room.shared["reach"] = self.by, self.forced, self.reach
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
                    np.zeros(1, SHARED)[0], np.zeros((most, groups, LANES)),
                    Memory(*(np.zeros(1, kind)[0] for kind in KINDS)),
                    Store(np.zeros(most + 1, CYCLE), np.empty((0, 3)), 0, np.zeros(MOVES, MOVE)))
        found = known[groups, most, count] = room, Partial(integrate_parts, room)
    return found
