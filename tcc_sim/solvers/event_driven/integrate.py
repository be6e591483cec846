"""The exact engine's part of the loop: one step from event to event, and its output."""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import compiled, fast
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import to_bernstein
from tcc_sim.solvers import run_output
from tcc_sim.solvers.engine import Memory, Setup, loop_by
from tcc_sim.solvers.event_driven.modes import begin, finish, step_on
from tcc_sim.solvers.event_driven.sensitivity import (
    carry_event,
    carry_step,
    end_changes_of_cycle,
    resolved_step,
    start_changes,
)
from tcc_sim.solvers.event_driven.step import Step, monotone
from tcc_sim.solvers.loads import keep_breakaway, keep_loads
from tcc_sim.solvers.run_output import DEGENERATE, EVENT_LIMIT, GOES_ON, NOT_FINITE, Store
from tcc_sim.solvers.series import FLYWHEEL, SLIP, add_integral
from tcc_sim.trajectory import STICK

AHEAD = 0.6
"""Longest step, in engine cycles: it meets the end of one cycle at most."""


@fast
def keep(step: Step, mode: int, tau: float, setup: Setup, memory: Memory, store: Store, angle: Any) -> None:
    """Store samples, extremes, time in stick, loads and section of a step from `tau` to the state."""
    state, _, _, work, _, output = memory
    period, rows = setup.limits.period, work.rows
    first = output.samples
    if store.per_cycle > 0:
        run_output.keep_samples(rows, step.degree, step.unit, step.x, tau, period, store.per_cycle, output,
                                store.samples, angle)
        for i in range(first, output.samples):
            store.samples[i, 4] = mode
    cut = run_output.end_of_cycle(tau, state.tau, period, step.unit, step.x)
    keep_loads(store.loads, rows, step.degree, step.unit, step.x, cut, output.cycle, setup.terms.linear, work.bernstein)
    highest, lowest = max(output.highest, 0.0), min(output.lowest, 0.0)
    if mode == STICK:
        behind = run_output.keep_stick(output, 0.0, step.x, cut, step.unit)
        output.highest, output.lowest = highest, lowest
        if cut <= step.x:
            _, plate_angle, plate_speed = polynomial.values(rows, step.degree, cut)
            run_output.end_cycle(output, store.cycles, 0.0, plate_angle, plate_speed, behind)
    else:
        keep_slip(step, cut, rows, output, store.cycles, store.transitions, work.bernstein)
        # Where slip ends the polynomial leaves a rounding of either sign.
        if mode == 1:
            output.lowest = max(output.lowest, lowest if cut > step.x else 0.0)
        elif mode == -1:
            output.highest = min(output.highest, highest if cut > step.x else 0.0)


@fast
def keep_slip(step: Step, cut: float, rows: Any, output: Any, cycles: Any, transitions: Any, workspace: Any) -> None:
    """Store extremes and section of a step in slip; only the section where `transitions` is None."""
    if transitions is None:
        if cut <= step.x:
            run_output.keep_section(rows, step.degree, cut, 0.0, output, cycles)
    else:
        v = rows[SLIP, 0]
        if cut > step.x and v + step.reach <= output.highest and v - step.reach >= output.lowest:
            return
        if monotone(rows, step.degree, step.x, step.reach):
            if cut <= step.x:
                slip_speed, plate_angle, plate_speed = polynomial.values(rows, step.degree, cut)
                output.highest, output.lowest = max(output.highest, slip_speed), min(output.lowest, slip_speed)
                run_output.end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, 0.0)
            v = polynomial.value(rows, SLIP, step.degree, step.x)
            output.highest, output.lowest = max(output.highest, v), min(output.lowest, v)
            return
        to_bernstein(rows, SLIP, step.degree, step.x, workspace)
        run_output.keep_cycle(rows, step.degree, step.x, cut, 0.0, output, cycles, workspace)


@fast
def start(setup: Setup, memory: Memory, tangent: Any) -> None:
    """Set up all but the state, where a motion starts."""
    state, _, drive, _, _, output = memory
    begin(setup.limits, setup.terms, setup.waves, state, drive)
    state.first_mode = state.mode
    run_output.begin_output(output, state.slip_speed, state.mode)
    if tangent is not None:
        start_changes(state, output, tangent)


@compiled
def take_step(first: int, count: int, tail: float, setup: Setup, memory: Memory, tangent: Any, store: Store,
              angle: Any) -> int:
    """Take a step up to the next event at most; with derivatives it ends at the end of its cycle at the latest."""
    bounds, terms, _, waves, _ = setup
    state, _, drive, work, counters, output = memory
    rows, period, n, mode, tau = work.rows, bounds.period, output.cycle, state.mode, state.tau
    goal = tail if n == count else period if n == count - 1 else tau + AHEAD * period
    if tangent is None:
        step = step_on(bounds, terms, waves, state, drive, goal, work)
    else:
        step, goal = resolved_step(tail if n == count else period, setup, memory, tangent)
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
        keep(step, mode, tau, setup, memory, store, angle)
    if event and state.mode != mode:
        run_output.store_transition((first + n) * period + state.tau, mode, state.mode, output, store.transitions)
        if mode == STICK:
            keep_breakaway(store.loads, output.cycle)
    counters.steps += 1
    if event:
        counters.events += 1
        if counters.events >= bounds.events:
            return EVENT_LIMIT
    if state.tau >= period:
        state.load_edge -= period
        counters.limited, counters.events = 0, 0
    return GOES_ON


integrate = loop_by(start, take_step, effort=0.7)
