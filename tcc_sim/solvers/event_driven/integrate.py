"""The loop of the exact engine: from event to event through engine cycles, in one compiled call.

Which mode of the set-valued law (6) holds after slip has ended is decided from torques and their rates, never from the
sign of a rounded slip speed: in stick v = 0 exactly, and slip begins at v = 0 exactly.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.model.equations import Linear
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import to_bernstein
from tcc_sim.solvers.collocation import Tables
from tcc_sim.solvers.compiling.compiled import compiled, fast
from tcc_sim.solvers.event_driven.setup import UNKNOWN, Bounds, Memory, Setup
from tcc_sim.solvers.event_driven.step import (
    BREAKAWAY,
    LAW_VARIES,
    NO_EVENT,
    REST,
    Step,
    monotone,
    slip_arc,
    stick_arc,
)
from tcc_sim.solvers.event_driven.stiff_step import FRESH, stiff_arc
from tcc_sim.solvers.excitation import clamp_edge, excite, load_phase
from tcc_sim.solvers.kept import (
    DONE,
    EVENT_LIMIT,
    FULL,
    NOT_FINITE,
    STEP_LIMIT,
    Store,
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
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, NEGATIVE, POSITIVE, STICK

AHEAD = 0.6
"""Longest step, in engine cycles: it meets the end of one cycle at most."""


@fast
def mode_at_rest(plate_angle: float, plate_speed: float, drive: Any, ratio: float, tolerance: float,
                 linear: Linear) -> int:
    """The mode that follows v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within `tolerance` (N m) of breakaway the rate of the margin decides: stick if it grows.
    """
    flywheel, plate, damping, stiffness = linear
    both = flywheel + plate
    spring = damping * plate_speed + stiffness * plate_angle
    torque = (plate * drive.torque + flywheel * spring) / both
    margin = ratio * drive.load - abs(torque)
    if margin > tolerance:
        return STICK
    direction = POSITIVE if torque > 0.0 else NEGATIVE
    if margin < -tolerance:
        return direction
    acceleration = (drive.torque - spring) / both
    torque_rate = (plate * drive.torque_rate + flywheel * (damping * acceleration + stiffness * plate_speed)) / both
    growth = ratio * drive.load_rate - (torque_rate if torque > 0.0 else -torque_rate)
    return STICK if growth >= 0.0 else direction


@fast
def mode_of(slip_speed: float, loaded: bool, plate_angle: float, plate_speed: float, drive: Any, ratio: float,
            tolerance: float, linear: Linear) -> int:
    """The mode of a state where a run starts, or where the load sets in or ends."""
    if not loaded:
        return FREE
    if slip_speed != 0.0:
        return POSITIVE if slip_speed > 0.0 else NEGATIVE
    return int(mode_at_rest(plate_angle, plate_speed, drive, ratio, tolerance, linear))


@fast
def begin(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any) -> None:
    """The mode in which a state moves on, from the torques and their rates there; and when the clamp next acts."""
    state.load_edge = math.inf
    state.level = FRESH
    loaded = terms.mean_load > 0.0
    if bounds.clamped:
        state.load_edge, loaded = clamp_edge(state.tau, math.inf, state.shift, terms.mean_load, terms.pulsation,
                                             None)
    excite(state.tau, state.shift, loaded, terms.mean_torque, waves, terms.mean_load, terms.pulsation, None, drive)
    state.mode = mode_of(state.slip_speed, loaded, state.plate_angle, state.plate_speed, drive, bounds.ratio,
                         bounds.torque_tolerance, terms.linear)
    state.at_rest = 1 if state.slip_speed == 0.0 and state.mode != FREE else 0


@fast
def step_on(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any, goal: float, work: Any,
            tables: Tables | None) -> Step:
    """The next step, at most to `goal` (s into the cycle) or to where the clamp acts; the state stays where it is."""
    remaining = min(goal, state.load_edge) - state.tau
    excite(state.tau, state.shift, state.mode != FREE, terms.mean_torque, waves, terms.mean_load, terms.pulsation,
           None, drive)
    rows, workspace = work.rows, work.bernstein
    if tables is not None:  # noqa: SIM102 (Numba leaves out what None rules out only where it is a test of its own)
        if (bounds.stiff_stick and state.mode == STICK) or (bounds.stiff_slip and state.mode != STICK):
            if state.level >= 0:
                step = stiff_arc(bounds, terms, waves, state, drive, remaining, tables, work.stages)
                if step.degree > 0:
                    return step
                state.level = FRESH
            state.level += 1
    if state.mode == STICK:
        return stick_arc(bounds, terms.linear, terms.mean_torque, waves, terms.mean_load, terms.pulsation, state, drive,
                         remaining, rows, workspace)
    return slip_arc(bounds, terms.linear, terms.mean_torque, waves, terms.mean_load, terms.pulsation, terms.stribeck,
                    state, drive, remaining, rows, workspace)


@fast
def finish(bounds: Bounds, terms: Terms, waves: Any, step: Step, goal: float, state: Any, drive: Any, rows: Any,
           angle: Any) -> bool:
    """Bring the state to the end of a step and decide the mode that follows; True where it may be another one."""
    until = min(goal, state.load_edge)
    full = step.event == NO_EVENT and step.x * step.unit >= (until - state.tau) * (1.0 - 1e-13)
    if step.x > 0.0:
        slip_speed, state.plate_angle, state.plate_speed = polynomial.values(rows, step.degree, step.x)
        if angle is not None:
            state.flywheel_angle = polynomial.value(rows, FLYWHEEL, step.degree, step.x)
        if state.mode != STICK:
            state.slip_speed = slip_speed
            state.at_rest = 0
    state.tau = until if full else state.tau + step.x * step.unit
    if abs(state.plate_speed) < 1e-26 * bounds.speed_scale:
        # An arc that has died down: products of what is left would be denormal, and slow.
        state.plate_speed = 0.0
    if step.event != NO_EVENT or state.load_edge <= state.tau:
        state.level = FRESH
    if step.event == BREAKAWAY:
        state.mode = step.direction
        state.at_rest = 1
        return True
    if state.load_edge <= state.tau:
        if abs(state.slip_speed) <= bounds.slip_tolerance:
            state.slip_speed = 0.0
        begin(bounds, terms, waves, state, drive)
        return True
    stopped = (state.mode == POSITIVE and state.slip_speed <= 0.0) or (state.mode == NEGATIVE
                                                                       and state.slip_speed >= 0.0)
    if step.event == REST or (stopped and state.at_rest == 0 and step.event != LAW_VARIES):
        state.slip_speed = 0.0
        excite(state.tau, state.shift, True, terms.mean_torque, waves, terms.mean_load, terms.pulsation, None, drive)
        state.mode = mode_at_rest(state.plate_angle, state.plate_speed, drive, bounds.ratio, bounds.torque_tolerance,
                                  terms.linear)
        state.at_rest = 1
        return True
    return False


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


@compiled
def integrate(first: int, whole: int, rest: float, step_limit: int, setup: Setup, memory: Memory, store: Store,
              angle: Any) -> int:
    """Solve engine cycles from number `first` on: `whole` of them, and then `rest` seconds.

    Goes on where `memory` is; returns how it ended. `angle` is None where theta1 is not asked for.
    """
    bounds, terms, waves, ratio, event_limit = setup
    state, drive, counters, output, work = memory
    rows, workspace = work.rows, work.bernstein
    period = bounds.period
    all_cycles = whole + (1 if rest > 0.0 else 0)
    while output.cycle < all_cycles:
        n = output.cycle
        if counters.cycle != n:
            counters.cycle = n
            counters.cycle_steps = 0
            counters.cycle_events = 0
        if state.mode == UNKNOWN:
            state.shift = load_phase(ratio, terms.pulsation, first + n)
            begin(bounds, terms, waves, state, drive)
            state.first_mode = state.mode
        goal = rest if n == whole else period if n == whole - 1 else state.tau + AHEAD * period
        mode, tau = state.mode, state.tau
        step = step_on(bounds, terms, waves, state, drive, goal, work, work.tables)
        if not step.x >= 0.0:
            return NOT_FINITE
        if angle is not None:
            rows[FLYWHEEL, 0] = state.flywheel_angle
            add_integral(rows, step.degree, step.unit)
        event = finish(bounds, terms, waves, step, goal, state, drive, rows, angle)
        if not abs(state.slip_speed) + abs(state.plate_angle) + abs(state.plate_speed) < math.inf:
            return NOT_FINITE
        if step.x > 0.0:
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
            if counters.cycle_events >= event_limit:
                return EVENT_LIMIT
        if n == whole and state.tau >= rest:
            break
        if counters.cycle_steps >= step_limit:
            return STEP_LIMIT
        if output.cycle > n and full(store.moves, output.moves + event_limit + 1):
            return FULL
    return DONE
