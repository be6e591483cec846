"""The stroboscopic map of the smoothed law with its exact derivatives, by the state and by the scene's keys.

The derivatives are those of the method (`tangent_series`, `tangent_step`): what the engine returns for a start or a key
that is a little different, its steps being the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO, LOAD_AMPLITUDE, NUMBERS, TORQUE_AMPLITUDE, key_derivatives
from tcc_sim.solvers.smoothed import collocation_tables, kernel
from tcc_sim.solvers.smoothed.limits import limits_of
from tcc_sim.solvers.smoothed.solve import STATUSES
from tcc_sim.solvers.smoothed.state import CONTROL, COUNTERS, DONE, STATE, WORK
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.smoothed.tangent_series import CHANGES, LANES, SHARED, Tangent
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats, event_sequence

STEPS_PER_CYCLE = 20_000
MOVES_PER_CYCLE = 64
NOT_SETTLED = 1e300
"""Rate since which stick counts as left at the start, 1/s. A change off the slow manifold, which the start may have though
the state is on it, decays over some series steps before collocation steps over stick."""


class Stroboscopic(NamedTuple):
    """What some engine cycles make of a state.

    state : (3,) slip speed, plate angle, plate speed after them
    derivative : (3, 3) by the state before them
    by_parameter : (3, P) by the keys, each at constant phase omega t
    events : modes in order: S stick, + and - slip
    heights : (N,) the largest |slip speed| of every cycle, rad/s; a part of a cycle counts as one
    heights_by_state, heights_by_parameter : (N, 3), (N, P) derivatives of `heights`
    stick_time : s
    """

    state: Floats
    derivative: Floats
    by_parameter: Floats
    events: str
    heights: Floats
    heights_by_state: Floats
    heights_by_parameter: Floats
    stick_time: float


def stroboscopic_map(system: System, state: Floats, cycles: float, *, start_cycle: float = 0, rtol: float = 1e-12,
                     parameters: Sequence[str] = ()) -> Stroboscopic:
    """The state after engine cycles (whole ones or parts), and its derivatives.

    Parameters
    ----------
    state : (3,) slip speed (rad/s), plate angle (rad), plate speed (rad/s)
    cycles, start_cycle : number of engine cycles, and the phase of the start in cycles
    rtol : relative tolerance of the steps
    parameters : scene keys that are one number each

    Raises
    ------
    InputError
        A key that is not one number, or that only says where a solution starts.
    NumericalFailure
        The engine stopped early.
    """
    return prepared(system, tuple(parameters), rtol).over(state, start_cycle, start_cycle + cycles)


def terms_for(system: System, changes: Floats) -> Terms:
    """The scene's terms, and those that it has not but that `changes` (numbers, keys) take a derivative by."""
    terms, omega, p = terms_of(system), system.engine.frequency, system.pressure
    changed = changes.any(axis=1)
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
        changes = key_derivatives(system, keys)
        terms = terms_for(system, changes)
        self.period, self.count = system.cycle, 3 + len(keys)
        self.ratio = system.pressure.frequency_ratio
        self.limits = limits_of(terms, terms_of(system), self.period, rtol)
        self.waves = waves_of(terms)
        load_rate = 0.0 if terms.pulsation is None else terms.pulsation[1]
        top, levels = collocation_tables.top_of(self.period), collocation_tables.levels_of(self.limits.sigma)
        self.tables = collocation_tables.tables(terms.linear, tuple(self.waves["rate"].tolist()), load_rate, top, levels)
        self.torque = collocation_tables.response(terms.linear, top, levels).torque
        self.terms = terms._replace(torque=None, harmonics=None)
        groups = math.ceil(self.count / LANES)
        lanes = np.zeros((len(NUMBERS), groups * LANES))
        lanes[:, 3:self.count] = changes
        self.by = np.ascontiguousarray(lanes.reshape(len(NUMBERS), groups, LANES).transpose(1, 0, 2))
        self.forced = self.by.any(axis=1) @ (1 << np.arange(LANES))

    def over(self, state: Floats, start: float, end: float) -> Stroboscopic:
        """From the phase `start` to the phase `end`, in engine cycles; see `stroboscopic_map`."""
        first, last = math.floor(start), math.floor(end)
        tail, cycles = (end - last) * self.period, last - first
        known: Any = np.zeros(1, STATE)[0]
        control: Any = np.zeros(1, CONTROL)[0]
        output: Any = np.zeros(1, OUTPUT)[0]
        drive, work, counters, shared = (np.zeros(1, kind)[0] for kind in (DRIVE, WORK, COUNTERS, SHARED))
        groups = np.zeros(len(self.by), CHANGES)
        v, angle, speed = map(float, state)
        known["slip_speed"], known["plate_angle"], known["plate_speed"] = v, angle, speed
        known["tau"] = (start - first) * self.period
        control["patience"], control["calm"], control["released"] = PATIENCE, CALM, NOT_SETTLED
        control["slip_now"], control["speed_now"] = abs(v), abs(speed)
        output["mode"] = 0 if abs(v) <= self.limits.stick_speed else (1 if v > 0.0 else -1)
        output["highest"] = output["lowest"] = v
        shared["peak"] = -1.0
        groups["by"], groups["forced"] = self.by, self.forced
        for k in range(3):
            groups["now"][0, k, k] = 1.0
        kept, moves = np.zeros(cycles + 2, CYCLE), np.empty(MOVES_PER_CYCLE * (cycles + 1), MOVE)
        tangent = Tangent(groups, shared, self.torque, np.zeros((cycles + 1, len(groups), LANES)))
        status = kernel.integrate(first, cycles, tail, STEPS_PER_CYCLE * (cycles + 1), self.limits, self.terms, self.ratio,
                                  self.waves, self.tables, known, control, drive, work, counters, output, kept,
                                  np.empty((0, 3)), 0, moves, None, tangent)
        if status != DONE:
            raise NumericalFailure(f"smoothed: {STATUSES[status].value} at phase {start:g} of the engine cycle")
        filled = moves[:int(output["moves"])]
        heights = np.maximum(kept["highest"], -kept["lowest"])[:cycles + 1]
        stick = float(kept["stick_time"][:cycles].sum())
        if tail > 0.0:
            heights[cycles] = max(float(output["highest"]), -float(output["lowest"]))
            tangent.peaks[cycles] = groups["peak"]
            stick += float(output["stick_time"])
        whole = cycles + (1 if tail > 0.0 else 0)
        by = groups["now"].transpose(1, 0, 2).reshape(3, -1)
        peaks = tangent.peaks[:whole].reshape(whole, -1)
        end_state = np.array([known["slip_speed"], known["plate_angle"], known["plate_speed"]])
        mode = int(output["mode"])
        return Stroboscopic(end_state, by[:, :3], by[:, 3:self.count], event_sequence(filled["before"], filled["after"], mode),
                            heights[:whole], peaks[:, :3], peaks[:, 3:self.count], stick)


@lru_cache(maxsize=16)
def prepared(system: System, keys: tuple[str, ...], rtol: float) -> Prepared:
    """One for every system, keys and tolerance."""
    return Prepared(system, keys, rtol)
