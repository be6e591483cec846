"""The stroboscopic map of the smoothed law with its exact derivatives, by the state and by the scene's keys.

The derivatives are those of the method (`tangent_series`, `tangent_step`): what the engine returns for a start or a key
that is a little different, its steps being the same.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO, LOAD_AMPLITUDE, NUMBERS, TORQUE_AMPLITUDE, key_derivatives
from tcc_sim.solvers.smoothed import collocation_tables
from tcc_sim.solvers.smoothed.sensitivity_integrate import MOVES, PART, integrate_parts
from tcc_sim.solvers.smoothed.sensitivity_series import CHANGES, LANES, SHARED, Tangent
from tcc_sim.solvers.smoothed.setup import far_of
from tcc_sim.solvers.smoothed.solve import KINDS, STATUSES, setup_of
from tcc_sim.solvers.smoothed.state import DONE, Memory
from tcc_sim.solvers.step_output import CYCLE, MOVE, Store
from tcc_sim.solvers.stroboscopic import Stroboscopic
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats, event_sequence

BITS = 1 << np.arange(LANES)


def slope_integrals(system: System, state: Floats, cycle: int, rtol: float) -> Floats:
    """The integrals over engine cycle number `cycle` of dT/dv v^2, v^2 and min(dT/dv, 0), (3,), by quadrature on the
    polynomials of the steps; see (21).

    Raises
    ------
    NumericalFailure
        The engine stopped early.
    """
    shared = room_of(1, 2).tangent.shared
    shared["slopes"], shared["averaged"] = 0.0, 1
    try:
        Prepared(system, (), rtol).over(state, cycle, cycle + 1)
        found: Floats = shared["slopes"].copy()
    finally:
        shared["averaged"] = 0
    return found


def terms_for(system: System, changes: Floats) -> Terms:
    """The scene's terms, and those that it has not but that `changes` (numbers, keys) take a derivative by."""
    terms, omega, p = terms_of(system), system.engine.frequency, system.pressure
    changed: list[bool] = np.any(changes, axis=1).tolist()
    if changed[TORQUE_AMPLITUDE] and terms.torque is None:
        terms = terms._replace(torque=(0.0, omega))
    if changed[LOAD_AMPLITUDE] and terms.pulsation is None:
        terms = terms._replace(pulsation=(0.0, p.frequency_ratio * omega, p.phase))
    if changed[EXCESS_RATIO] and terms.stribeck is None:
        terms = terms._replace(stribeck=(0.0, system.friction.decay))
    return terms


class Prepared:
    """A system with keys, ready to be evaluated at many states."""

    def __init__(self, system: System, keys: tuple[str, ...], rtol: float) -> None:
        system.check_repeats("a map of the section")
        changes = key_derivatives(system, keys)
        terms = terms_for(system, changes)
        self.period, self.count = system.cycle, 3 + len(keys)
        setup = setup_of(system, terms, rtol)
        limits = setup.limits
        if changes[EXCESS_RATIO].any() and terms.stribeck is not None:
            # What mubar changes by with mu_s/mu_k dies down with slip as exp(-alpha |v|), however near to 1 it is.
            limits = limits._replace(far=max(limits.far, far_of(1.0, terms.stribeck[1], rtol, limits.layer)))
        self.setup = setup._replace(waves=setup.waves.copy(), limits=limits)
        ladder = collocation_tables.ladder_of(limits.fastest, self.period)
        self.torque = collocation_tables.response(terms.linear, *ladder).torque
        groups = math.ceil(self.count / LANES)
        lanes = np.zeros((len(NUMBERS), groups * LANES))
        lanes[:, 3:self.count] = changes
        self.by = np.ascontiguousarray(lanes.reshape(len(NUMBERS), groups, LANES).transpose(1, 0, 2))
        self.forced = lanes.any(axis=0).reshape(groups, LANES) @ BITS

    def over(self, state: Floats, start: float, end: float, margins: bool = False) -> Stroboscopic:
        """From the phase `start` to the phase `end`, in engine cycles; a smooth flow has no margins."""
        return self.each(state[None], [start], [end])[0]

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float]) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3), by one compiled call."""
        groups, count, period = len(self.by), len(states), self.period
        firsts, lasts = list(map(math.floor, starts)), list(map(math.floor, ends))
        tails = [(end - last) * period for end, last in zip(ends, lasts)]
        whole = [last - first + (tail > 0.0) for first, last, tail in zip(firsts, lasts, tails)]
        most = max(last - first for first, last in zip(firsts, lasts)) + 1
        parts = np.zeros(count, PART)
        parts["first"], parts["cycles"] = firsts, [last - first for first, last in zip(firsts, lasts)]
        parts["tau"], parts["tail"] = [(start - first) * period for start, first in zip(starts, firsts)], tails
        parts["state"] = states
        tangents, heights = np.empty((count, groups, 3, LANES)), np.empty((count, most))
        climbs = np.empty((count, most, groups, LANES))
        room = room_of(groups, most)
        room.tangent.groups["by"], room.tangent.groups["forced"] = self.by, self.forced
        tangent = room.tangent._replace(torque=self.torque)
        integrate_parts(parts, self.setup, room.memory, room.store, tangent, tangents, heights, climbs)
        for start, status in zip(starts, parts["status"].tolist()):
            if status != DONE:
                raise NumericalFailure(f"smoothed: {STATUSES[status].value} after phase {start:g} of the engine cycle")
        by, peaks = tangents.transpose(0, 2, 1, 3).reshape(count, 3, -1), climbs.reshape(count, most, -1)
        moves, modes, stuck = parts["moves"].tolist(), parts["mode"].tolist(), parts["stick_time"].tolist()
        before, after, passed, end = parts["before"], parts["after"], parts["state"], self.count
        return [Stroboscopic(passed[k], by[k, :, :3], by[k, :, 3:end],
                             event_sequence(before[k, :moves[k]], after[k, :moves[k]], modes[k]), heights[k, :n],
                             peaks[k, :n, :3], peaks[k, :n, 3:end], stuck[k]) for k, n in enumerate(whole)]


class Room(NamedTuple):
    """Work space of the compiled call, used again by every one of a thread."""

    tangent: Tangent
    memory: Memory
    store: Store


_rooms = threading.local()


def room_of(groups: int, most: int) -> Room:
    """Work space for so many groups of lanes, and cycles in a part."""
    known: dict[tuple[int, int], Room] = _rooms.__dict__.setdefault("known", {})
    if (groups, most) not in known:
        memory = Memory(*(np.zeros(1, kind)[0] for kind in KINDS))
        tangent = Tangent(np.zeros(groups, CHANGES), np.zeros(1, SHARED)[0], np.empty((0, 0, 0)),
                          np.zeros((most, groups, LANES)))
        known[groups, most] = Room(tangent, memory, Store(np.zeros(most + 1, CYCLE), np.empty((0, 3)), 0,
                                                          np.zeros(MOVES, MOVE)))
    return known[groups, most]
