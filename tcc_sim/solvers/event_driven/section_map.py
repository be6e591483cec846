"""The stroboscopic map of the set-valued law with its exact derivatives, and what is seen on the way.

The motion is that of the exact engine, step by step; disturbances of the state and of scene keys are carried along
(`variation`), and the margins to other event sequences on request (`margins`). Nothing is ever inverted or solved
backwards: stick forgets the slip speed, so one multiplier of a motion with stick is exactly 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.compiled import compiled, fast
from tcc_sim.solvers.event_driven.arcs import FALLING_ORDER, SHAPE
from tcc_sim.solvers.event_driven.bounds import Bounds, bounds_of
from tcc_sim.solvers.event_driven.margins import (
    ARRIVAL,
    GRADIENT,
    GRAZING,
    GROWS,
    STUCK,
    VALUE,
    note_arrival,
    note_gradient,
    note_step,
)
from tcc_sim.solvers.event_driven.modes import FREE, STATE, STICK
from tcc_sim.solvers.event_driven.sequence import AHEAD, UNKNOWN, advance, begin, keep, load_phase, note_move, settle
from tcc_sim.solvers.event_driven.variation import (
    LANES,
    VARIATION,
    Rates,
    add_force,
    expand_disturbed,
    friction_change,
    land,
    scale_step,
    unresolved,
)
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.key_derivatives import (
    DECAY,
    EXCESS_RATIO,
    LOAD_AMPLITUDE,
    LOAD_PHASE,
    NUMBERS,
    TORQUE_AMPLITUDE,
    key_derivatives,
)
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats

ARRIVED, LOST, DEGENERATE, CROWDED = range(4)
"""How `march` ends: at the end; where the state is not finite; where slip ends with v' = 0; after too many events."""
WHY = {LOST: "the state is not finite", DEGENERATE: "slip ends where its rate is 0 too",
       CROWDED: "too many events in one engine cycle"}
EVENTS_PER_CYCLE, STEPS_PER_CYCLE = 1000, 100_000
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, that stands for 0."""
LINEAR_REACH, FALLING_REACH = 3.3, 1.6
"""Rates times length at which the last term of a disturbance's series is 1e-14 of it, to the orders of the two."""
SHORTER = 0.6
"""Factor of a step in which the friction's exponential has not converged, though the motion has (mu_k near mu_s)."""


class StroboscopicMap(NamedTuple):
    """What some engine cycles make of a state, with derivatives, and what is seen on the way.

    state : (3,) slip speed, plate angle, plate speed
    derivative : (3, 3) by the state before; a start in stick is projected on v = 0
    by_parameter : (3, P) by the keys
    events : (time in s, mode before, mode after) of each change of mode
    first_mode : mode at the start
    heights : the largest |slip speed| in each cycle, rad/s
    stick_fraction : 0 to 1
    margins : (3, 2 + 3 + P) rows GRAZING, ARRIVAL, STUCK of `margins`: value, whether stick's margin grows, derivatives
        by the state and the keys; inf where there is no such place. None where they were not asked for
    """

    state: Floats
    derivative: Floats
    by_parameter: Floats
    events: list[tuple[float, int, int]]
    first_mode: int
    heights: tuple[float, ...]
    stick_fraction: float
    margins: Floats | None


@fast
def vary(mode: int, falls: bool, order: int, length: float, rates: Rates, terms: Terms, numbers: Any,
         block: int, columns: Any, work: Any) -> None:
    """Take a block of disturbances over a step whose series are in `work.rows`."""
    for i in range(3):
        for lane in range(LANES):
            work.lanes[i, lane] = columns[block, i, lane]
    for lane in range(LANES):
        number = numbers[block * LANES + lane]
        idle = True
        for i in range(number.shape[0]):
            idle = idle and number[i] == 0.0
        if idle:
            for k in range(3 * order):
                work.force[k, lane] = 0.0
        else:
            friction_change(mode if mode != FREE else 0, order, number, rates, length, terms.stribeck, falls, work.rows)
            add_force(mode, order, length, terms.linear, number, lane, work.rows, work.force)
    if falls:
        expand_disturbed(order, work.lanes, work.force, work.series, work.rows, length, terms.linear, True, True)
    elif mode == STICK:
        expand_disturbed(order, work.lanes, work.force, work.series, work.rows, length, terms.linear, None, None)
    else:
        expand_disturbed(order, work.lanes, work.force, work.series, work.rows, length, terms.linear, True, None)
    for i in range(3):
        for lane in range(LANES):
            columns[block, i, lane] = work.lanes[i, lane]


@fast
def longest_step(bounds: Bounds, linear: Linear, load: float, stribeck: Stribeck, state: Any) -> float:
    """Length up to which the series of disturbances hold, s, whatever the motion shows of the rates they have."""
    mode, inertia = state.mode, linear[1]
    if mode == STICK:
        inertia += linear[0]
    rate = math.sqrt(linear[3] / inertia) + linear[2] / inertia
    if stribeck is not None and mode != STICK and mode != FREE and abs(state.slip_speed) <= 1.01 * bounds.far:
        fall = stribeck[1] * stribeck[0] * math.exp(-stribeck[1] * abs(state.slip_speed))
        return FALLING_REACH / (rate + fall * load * (1.0 / linear[0] + 1.0 / linear[1]))
    return LINEAR_REACH / rate


@compiled
def march(first: int, whole: int, phase: tuple[float, float], rates: Rates, bounds: Bounds, terms: Terms,
          waves: Any, state: Any, drive: Any, output: Any, cycles: Any, moves: Any, numbers: Any, columns: Any,
          wanted: bool, least: Any, work: Any) -> int:
    """`whole` engine cycles from number `first` on; see `stroboscopic_map`.

    numbers : (lanes, numbers of the equations) a disturbance's share in each of them
    columns : (blocks, 3, LANES) the disturbances of slip speed, plate angle and plate speed
    wanted, least : whether margins are looked for, and where they are kept
    """
    rows, workspace, places = np.zeros(SHAPE), np.zeros(polynomial.WORKSPACE), np.zeros(3)
    period = bounds.period
    events, steps = 0, 0
    state.shift = load_phase(phase[0], phase[1], float(first))
    begin(bounds, terms, waves, state, drive)
    state.first_mode = state.mode
    if state.mode == STICK:
        columns[:, 0, :] = 0.0
    while output.cycle < whole:
        n = output.cycle
        end = period if n == whole - 1 else state.tau + AHEAD * period
        mode, tau, shift = state.mode, state.tau, state.shift
        goal = min(end, tau + longest_step(bounds, terms.linear, terms.mean_load + rates.amplitude, terms.stribeck, state))
        while True:
            step = advance(bounds, terms, waves, state, drive, goal, rows, None, None, workspace)
            steps += 1
            if not step.x >= 0.0 or steps > STEPS_PER_CYCLE * whole:
                return LOST
            length = step.x * step.unit
            falls = False
            if terms.stribeck is not None:
                falls = step.degree == FALLING_ORDER and mode != STICK and mode != FREE
            if length > 0.0:
                scale_step(mode, falls, step.degree, step.x, rows, rates, tau, shift, length, terms.pulsation,
                           terms.stribeck, work.rows)
            if not (falls and length > 0.0 and unresolved(work.rows, terms.stribeck)):
                break
            goal = tau + SHORTER * length
        if length > 0.0:
            found = wanted and note_step(mode, step.degree, step.x, rows, least, places, workspace)
            for block in range(columns.shape[0]):
                vary(mode, falls, step.degree, length, rates, terms, numbers, block, columns, work)
                if found:
                    note_gradient(mode, step.degree, block, tau, shift, length, rates, numbers, terms.linear,
                                  bounds.ratio, work, least, places)
        event = settle(bounds, terms, waves, step, goal, state, drive, rows, None)
        if not abs(state.slip_speed) + abs(state.plate_angle) + abs(state.plate_speed) < math.inf:
            return LOST
        if length > 0.0:
            keep(step, mode, tau, period, 0, n == whole - 1 and state.tau == end, rows, output, cycles, rows, None,
                 workspace)
        if event and state.mode != mode:
            note_move((first + n) * period + state.tau, mode, state.mode, output, moves)
            events += 1
            if output.moves >= moves.shape[0]:
                return CROWDED
            if mode != STICK and mode != FREE and state.mode != FREE and length > 0.0:
                if wanted:
                    note_arrival(mode, state, drive, rates, numbers, terms.linear, bounds.ratio, columns, least)
                if not land(mode, state.mode, state, drive, bounds.ratio, terms.linear, columns):
                    return DEGENERATE
        if output.cycle > n:
            state.tau -= period
            state.load_edge -= period
            state.shift = load_phase(phase[0], phase[1], float(first + output.cycle))
    return ARRIVED


def stroboscopic_map(system: System, state: Floats, cycles: int, *, start_cycle: int = 0, rtol: float = 1e-12,
                     parameters: Sequence[str] = (), margins: bool = False) -> StroboscopicMap:
    """The state after whole engine cycles, and its derivatives by the state and by scene keys.

    Parameters
    ----------
    system : with the set-valued law
    state : (3,) slip speed, plate angle, plate speed (rad/s, rad, rad/s) at the start of cycle `start_cycle`
    parameters : scene keys, each one number; the engine frequency at fixed phase
    margins : whether the margins to other event sequences are wanted

    Raises
    ------
    InputError
        A key that the motion does not depend on continuously.
    NumericalFailure
        The state is not finite, or has no derivative.
    """
    numbers = key_derivatives(system, parameters)
    terms = exact_terms(system, numbers)
    bounds, waves = exact_bounds(terms, system, rtol, numbers), waves_of(terms)
    rate, pressure = system.engine.frequency, system.pressure
    rates = Rates(rate, pressure.frequency_ratio * rate, system.saturation_amplitude, bool(numbers[TORQUE_AMPLITUDE].any()),
                  bool(numbers[LOAD_AMPLITUDE:LOAD_PHASE + 1].any()))
    if terms.pulsation is None:
        terms = terms._replace(pulsation=(0.0, rates.load, pressure.phase))
    # The engine's sines are in the waves, and one compiled kernel serves with and without a pulsating load.
    terms = terms._replace(torque=None, harmonics=None, smoothing=None)
    count = 3 + len(parameters)
    blocks = -(-count // LANES)
    shares = np.zeros((blocks * LANES, len(NUMBERS)))
    shares[3:count] = numbers.T
    columns = np.zeros((blocks, 3, LANES))
    columns[0, :, :3] = np.eye(3)
    work, at, drive, output = (np.zeros(1, kind) for kind in (VARIATION, STATE, DRIVE, OUTPUT))
    at[0] = (state[0], state[1], state[2], 0.0, UNKNOWN, 0.0, 0.0, math.inf, 0, UNKNOWN, 0.0)
    kept, moves = np.zeros(cycles + 2, CYCLE), np.zeros(EVENTS_PER_CYCLE * cycles, MOVE)
    output[0]["highest"] = output[0]["lowest"] = state[0]
    least = np.zeros((3, GRADIENT + blocks * LANES))
    least[:, VALUE] = np.inf
    ended = march(start_cycle, cycles, (pressure.frequency_ratio, pressure.phase), rates, bounds, terms, waves, at[0],
                  drive[0], output[0], kept, moves, shares, columns, margins, least, work[0])
    if ended != ARRIVED:
        raise NumericalFailure(f"event_driven: {WHY[ended]}")
    last = at[0]
    derivative = columns.transpose(1, 0, 2).reshape(3, -1)
    highest, lowest = kept["highest"][:cycles], kept["lowest"][:cycles]
    return StroboscopicMap(
        np.array([last["slip_speed"], last["plate_angle"], last["plate_speed"]]), derivative[:, :3],
        derivative[:, 3:count], moves[:int(output[0]["moves"])].tolist(), int(last["first_mode"]),
        tuple(np.maximum(highest, -lowest).tolist()), float(kept["stick_time"][:cycles].sum()) / (cycles * bounds.period),
        least[:, :GRADIENT + count] if margins else None)


def exact_terms(system: System, numbers: Floats) -> Terms:
    """The terms of a system, with the decay of the friction coefficient where derivatives need it."""
    terms = terms_of(system)
    if terms.stribeck is None and not numbers[EXCESS_RATIO].any():
        return terms
    excess = terms.stribeck[0] if terms.stribeck is not None else 0.0
    return terms._replace(stribeck=(excess, max(system.friction.decay, SLOWEST)))


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """The bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not (numbers[EXCESS_RATIO].any() or numbers[DECAY].any()):
        return bounds_of(terms, system.cycle, rtol)
    excess, decay = terms.stribeck
    wide = bounds_of(terms._replace(stribeck=(max(excess, 1.0), decay)), system.cycle, rtol)
    return wide._replace(ratio=1.0 + excess)


__all__ = ["ARRIVAL", "GRAZING", "GROWS", "STUCK", "VALUE", "StroboscopicMap", "stroboscopic_map"]
