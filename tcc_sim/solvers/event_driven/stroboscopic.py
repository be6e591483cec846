"""The stroboscopic map of the set-valued law with its exact derivatives, by the state and by the scene's keys.

The motion is that of the exact engine, step by step; disturbances of the state and of scene keys are carried along
(`variation`), with the largest slip and, on request, the margins to other event sequences (`margins`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.solvers.bernstein import WORKSPACE
from tcc_sim.solvers.event_driven.margins import GRADIENT, VALUE
from tcc_sim.solvers.event_driven.sensitivity import LANES, VARIATION, Rates
from tcc_sim.solvers.event_driven.sensitivity_integrate import DEGENERATE, Disturbed, integrate_disturbed
from tcc_sim.solvers.event_driven.setup import COUNTERS, STATE, UNKNOWN, Bounds, Memory, Setup, Work, bounds_of
from tcc_sim.solvers.event_driven.step import SHAPE
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.key_derivatives import (
    DECAY,
    EXCESS_RATIO,
    LOAD_AMPLITUDE,
    LOAD_PHASE,
    NUMBERS,
    TORQUE_AMPLITUDE,
)
from tcc_sim.solvers.step_output import DONE, EVENT_LIMIT, MOVE, NOT_FINITE, OUTPUT, STEP_LIMIT
from tcc_sim.solvers.stroboscopic import Prepared, Stroboscopic
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import Floats, event_sequence

WHY = {NOT_FINITE: "the state is not finite", STEP_LIMIT: "its derivatives take too many steps in one engine cycle",
       DEGENERATE: "slip ends where its rate is 0 too", EVENT_LIMIT: "too many events in one engine cycle"}
EVENTS_PER_CYCLE = 1000
FINER = 1e-2
"""Tolerance of a step per that of a solve: derivatives want more digits than states."""
REACH = 10.0
"""Most that a step with derivatives is long, per time in which the fastest part dies down."""
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, that stands for 0."""


class SetValued(Prepared):
    """By the exact engine."""

    def __init__(self, system: System, keys: tuple[str, ...], rtol: float) -> None:
        super().__init__(system, keys)
        terms, numbers = self.terms, self.changes
        if terms.stribeck is not None:
            terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST)))
        bounds, waves = exact_bounds(terms, system, FINER * rtol, numbers), waves_of(terms)
        if bounds.stiff_slip and bounds.slip_rate * bounds.period > REACH * bounds.steps:
            raise InputError(f"driveline.damping is {system.driveline.damping:g} N m s/rad; over "
                             f"driveline.plate_inertia it decays at {bounds.slip_rate:.3g} 1/s, and the derivatives of "
                             f"the set-valued motion, which follow that decay, take more than {bounds.steps} steps a "
                             "cycle; those of friction.law smoothed step over it")
        rate, pressure = system.engine.frequency, system.pressure
        self.rates = Rates(rate, pressure.frequency_ratio * rate, system.saturation_amplitude,
                           bool(numbers[TORQUE_AMPLITUDE].any()), bool(numbers[LOAD_AMPLITUDE:LOAD_PHASE + 1].any()),
                           self.fastest)
        if terms.pulsation is None:
            terms = terms._replace(pulsation=(0.0, self.rates.load, pressure.phase))
        # The engine's sines are in the waves, and one compiled kernel serves with and without a pulsating load.
        self.setup = Setup(bounds, terms._replace(torque=None, harmonics=None, smoothing=None), waves,
                           pressure.frequency_ratio, EVENTS_PER_CYCLE)
        self.blocks = -(-self.count // LANES)
        self.numbers = np.zeros((self.blocks * LANES, len(NUMBERS)))
        self.numbers[3:self.count] = numbers.T

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3), one after the other."""
        return [self._over(*each, margins) for each in zip(states, starts, ends)]

    def _over(self, state: Floats, start: float, end: float, margins: bool) -> Stroboscopic:
        """See `over`."""
        first, last = math.floor(start), math.floor(end)
        tail = (end - last) * self.period
        n = last - first + (1 if tail > 0.0 else 0)
        columns = np.zeros((self.blocks, 3, LANES))
        columns[0, 0, 0] = columns[0, 1, 1] = columns[0, 2, 2] = 1.0
        work, at, drive, counters, output = (np.zeros(1, kind) for kind in (VARIATION, STATE, DRIVE, COUNTERS, OUTPUT))
        at[0] = (state[0], state[1], state[2], 0.0, UNKNOWN, (start - first) * self.period, 0.0, math.inf, 0, UNKNOWN,
                 0.0)
        moves, least = np.zeros(EVENTS_PER_CYCLE * n, MOVE), np.zeros((3, GRADIENT + self.blocks * LANES))
        least[:, VALUE] = np.inf
        heights, climbs = np.zeros(n), np.zeros((n, self.blocks, LANES))
        memory = Memory(at[0], drive[0], counters[0], output[0], Work(np.zeros(SHAPE), np.zeros(WORKSPACE), None, None))
        ended = integrate_disturbed(first, last - first, tail, self.setup, self.rates, memory, moves,
                                    Disturbed(self.numbers, columns, heights, climbs), margins, least, work[0],
                                    np.zeros(3))
        if ended != DONE:
            raise NumericalFailure(f"event_driven: {WHY[ended]}")
        last_state, seen = at[0], moves[:int(output[0]["moves"])]
        derivative, peaks = columns.transpose(1, 0, 2).reshape(3, -1), climbs.reshape(n, -1)
        return Stroboscopic(
            np.array([last_state["slip_speed"], last_state["plate_angle"], last_state["plate_speed"]]),
            derivative[:, :self.count],
            event_sequence([*seen["before"][:1], *seen["after"]] or [last_state["first_mode"]]), heights,
            peaks[:, :self.count], float(output[0]["stick_time"]), seen.tolist(),
            least[:, :GRADIENT + self.count] if margins else None)


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """The bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not (numbers[EXCESS_RATIO].any() or numbers[DECAY].any()):
        return bounds_of(terms, system.cycle, rtol)
    excess, decay = terms.stribeck
    wide = bounds_of(terms._replace(stribeck=(max(excess, 1.0), decay)), system.cycle, rtol)
    return wide._replace(ratio=1.0 + excess)
