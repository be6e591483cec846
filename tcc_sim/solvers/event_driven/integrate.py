"""The loop of the exact engine: from event to event through engine cycles, in one compiled call."""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.model.equations import Linear
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import to_bernstein
from tcc_sim.solvers.compiling.compiled import compiled, fast
from tcc_sim.solvers.engine import Memory, Setup
from tcc_sim.solvers.event_driven.modes import begin, finish, step_on
from tcc_sim.solvers.event_driven.sensitivity import (
    carry_event,
    carry_step,
    end_changes_of_cycle,
    resolved_step,
    start_changes,
)
from tcc_sim.solvers.event_driven.step import Step, monotone
from tcc_sim.solvers.excitation import load_phase
from tcc_sim.solvers.kept import (
    DEGENERATE,
    DONE,
    EVENT_LIMIT,
    FULL,
    NOT_FINITE,
    STEP_LIMIT,
    Store,
    begin_output,
    end_cycle,
    end_of_cycle,
    full,
    keep_cycle,
    keep_samples,
    keep_stick,
    note_move,
)
from tcc_sim.solvers.loads import keep_breakaway, keep_loads
from tcc_sim.solvers.series import FLYWHEEL, SLIP, add_integral
from tcc_sim.trajectory import STICK

AHEAD = 0.6
"""Longest step, in engine cycles: it meets the end of one cycle at most."""


@fast
def keep(step: Step, mode: int, tau: float, after: float, period: float, linear: Linear, rows: Any, output: Any,
         store: Store, angle: Any, workspace: Any) -> None:
    """Samples, extremes, time in stick, loads and section of a step from `tau` to `after`."""
    first, cycles = output.samples, store.cycles
    if store.per_cycle > 0:
        keep_samples(rows, step.degree, step.unit, step.x, tau, period, store.per_cycle, output, store.samples, angle)
        for i in range(first, output.samples):
            store.samples[i, 4] = mode
    cut = end_of_cycle(tau, after, period, step.unit, step.x)
    keep_loads(store.loads, rows, step.degree, step.unit, step.x, cut, output.cycle, linear, workspace)
    if mode == STICK:
        behind = keep_stick(output, 0.0, step.x, cut, step.unit)
        output.highest, output.lowest = max(output.highest, 0.0), min(output.lowest, 0.0)
        if cut <= step.x:
            _, plate_angle, plate_speed = polynomial.values(rows, step.degree, cut)
            end_cycle(output, cycles, 0.0, plate_angle, plate_speed, behind)
    else:
        highest, lowest = max(output.highest, 0.0), min(output.lowest, 0.0)
        keep_slip(step, cut, rows, output, cycles, store.moves, workspace)
        # Where slip ends the polynomial leaves a rounding of either sign.
        if mode == 1:
            output.lowest = max(output.lowest, lowest if cut > step.x else 0.0)
        elif mode == -1:
            output.highest = min(output.highest, highest if cut > step.x else 0.0)


@fast
def keep_slip(step: Step, cut: float, rows: Any, output: Any, cycles: Any, moves: Any, workspace: Any) -> None:
    """Extremes and section of a step in slip; only the section where `moves` are None."""
    if moves is None:
        if cut <= step.x:
            slip_speed, plate_angle, plate_speed = polynomial.values(rows, step.degree, cut)
            end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, 0.0)
    else:
        v = rows[SLIP, 0]
        if cut > step.x and v + step.reach <= output.highest and v - step.reach >= output.lowest:
            return
        if monotone(rows, step.degree, step.x, step.reach):
            if cut <= step.x:
                slip_speed, plate_angle, plate_speed = polynomial.values(rows, step.degree, cut)
                output.highest, output.lowest = max(output.highest, slip_speed), min(output.lowest, slip_speed)
                end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, 0.0)
            v = polynomial.value(rows, SLIP, step.degree, step.x)
            output.highest, output.lowest = max(output.highest, v), min(output.lowest, v)
            return
        to_bernstein(rows, SLIP, step.degree, step.x, workspace)
        keep_cycle(rows, step.degree, step.x, cut, 0.0, output, cycles, workspace)


@fast
def start(first: int, setup: Setup, memory: Memory, tangent: Any) -> None:
    """Set up all but the state, where a motion starts."""
    bounds, terms, ratio, waves, _ = setup
    state, _, drive, _, counters, output = memory
    counters.steps, counters.cycle, counters.cycle_steps, counters.cycle_events = 0, 0, 0, 0
    state.shift = load_phase(ratio, terms.pulsation, first)
    begin(bounds, terms, waves, state, drive)
    state.first_mode = state.mode
    begin_output(output, state.slip_speed, state.mode)
    if tangent is not None:
        start_changes(state, output, tangent)


@compiled
def integrate(first: int, whole: int, rest: float, step_limit: int, setup: Setup, memory: Memory, tangent: Any,
              store: Store, angle: Any) -> int:
    """Solve engine cycles from number `first` on: `whole` of them, and then `rest` seconds.

    Starts from the state, or goes on where `memory` is; returns how it ended. `tangent` and `angle` are None where
    derivatives and theta1 are not asked for. With derivatives steps end at the ends of cycles.
    """
    bounds, terms, ratio, waves, tables = setup
    state, _, drive, work, counters, output = memory
    rows, workspace = work.rows, work.bernstein
    period = bounds.period
    all_cycles = whole + (1 if rest > 0.0 else 0)
    if output.started == 0:
        start(first, setup, memory, tangent)
    while output.cycle < all_cycles:
        n = output.cycle
        if counters.cycle != n:
            counters.cycle = n
            counters.cycle_steps = 0
            counters.cycle_events = 0
        goal = rest if n == whole else period if n == whole - 1 else state.tau + AHEAD * period
        mode, tau = state.mode, state.tau
        if tangent is None:
            step = step_on(bounds, terms, waves, state, drive, goal, work, tables)
        else:
            step, goal = resolved_step(rest if n == whole else period, setup, memory, tangent)
        if not step.x >= 0.0:
            return NOT_FINITE
        if angle is not None:
            rows[FLYWHEEL, 0] = state.flywheel_angle
            add_integral(rows, step.degree, step.unit)
        if tangent is not None and step.x > 0.0:
            carry_step(step, setup, memory, tangent)
        event = finish(bounds, terms, waves, step, goal, state, drive, rows, angle)
        if not abs(state.slip_speed) + abs(state.plate_angle) + abs(state.plate_speed) < math.inf:
            return NOT_FINITE
        if tangent is not None:
            if event and step.x > 0.0 and not carry_event(mode, step, setup, memory, tangent):
                return DEGENERATE
            if state.tau >= period:
                end_changes_of_cycle(state, output, tangent, store.cycles)
        elif step.x > 0.0:
            keep(step, mode, tau, state.tau, period, terms.linear, rows, output, store, angle, workspace)
        if event and state.mode != mode:
            note_move((first + n) * period + state.tau, mode, state.mode, output, store.moves)
            if mode == STICK:
                keep_breakaway(store.loads, output.cycle)
        if output.cycle > n:
            state.tau -= period
            state.load_edge -= period
            state.shift = load_phase(ratio, terms.pulsation, first + output.cycle)
        counters.steps += 1
        counters.cycle_steps += 1
        if event:
            counters.cycle_events += 1
            if counters.cycle_events >= bounds.events:
                return EVENT_LIMIT
        if n == whole and state.tau >= rest:
            break
        if counters.cycle_steps >= step_limit:
            return STEP_LIMIT
        if tangent is None and output.cycle > n and full(store.moves, output.moves + bounds.events + 1):
            return FULL
    return DONE
