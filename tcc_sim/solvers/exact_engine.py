"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. The torques, never the sign of a rounded slip speed, decide on the next mode; in stick v = 0
exactly.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import compiled, fast
from tcc_sim.errors import OutOfRange
from tcc_sim.model.equations import completed
from tcc_sim.model.friction import exponentials
from tcc_sim.model.parameters import System
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import to_bernstein
from tcc_sim.solvers import run_output
from tcc_sim.solvers.collocation import WORK
from tcc_sim.solvers.engine import COUNTERS, EngineShell, Memory, Setup, loop_by
from tcc_sim.solvers.exact import EVENTS, STATE, Bounds, Step, begin, bounds_of, finish, monotone, step_on
from tcc_sim.solvers.exact_derivatives import (
    SHARED,
    carry_event,
    carry_step,
    end_changes_of_cycle,
    resolved_step,
    start_changes,
)
from tcc_sim.solvers.key_derivatives import DECAYS, EXCESSES
from tcc_sim.solvers.run_output import (
    DEGENERATE,
    EVENT_LIMIT,
    GOES_ON,
    NOT_FINITE,
    OUTPUT,
    STEP_LIMIT,
    Store,
    keep_breakaway,
    keep_loads,
)
from tcc_sim.solvers.series import DRIVE, FLYWHEEL, SLIP, add_integral, waves_of
from tcc_sim.solvers.terms import Terms, per_system, terms_of
from tcc_sim.trajectory import STICK, Floats

AHEAD = 0.6
"""Longest step, in engine cycles: it meets the end of one cycle at most."""


@fast
def keep(step: Step, mode: int, tau: float, setup: Setup, memory: Memory, store: Store, angle: bool) -> None:
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
              angle: bool) -> int:
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
    if angle:
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


integrate = loop_by(start, take_step, "event_driven")


STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""
FINER = 1e-2
"""Tolerance of a step with derivatives, which need more digits, per that of a solve."""
REACH = 10.0
"""Longest step with derivatives, per time in which the fastest part decays."""
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, in place of 0."""


@per_system
def setup_of(system: System, rtol: float) -> Setup:
    """Return the setup of a system; a solve copies `waves`."""
    terms = terms_of(system)
    if terms.stribeck is not None and not terms.stribeck[1] > 0.0:  # mu does not depend on the slip speed.
        ratio, load = 1.0 + terms.stribeck[0], terms.pulsation
        terms = terms._replace(stribeck=None, mean_load=ratio * terms.mean_load,
                               pulsation=None if load is None else (ratio * load[0], *load[1:]))
    waves = waves_of(terms)
    waves.setflags(write=False)
    return Setup(bounds_of(terms, system.cycle, rtol), without_torque(terms), system.pressure.frequency_ratio, waves,
                 None)


def without_torque(terms: Terms) -> Terms:
    """Return the terms without those of the engine torque, which are the waves, and without smoothing; with every
    linear coefficient.
    """
    return terms._replace(linear=completed(terms.linear), torque=None, harmonics=None, smoothing=None)


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """Return the bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not numbers[EXCESSES + DECAYS].any():
        return bounds_of(terms, system.cycle, rtol)
    pairs = exponentials(terms.stribeck)
    wide = tuple(number for share, rate in pairs for number in (max(abs(share), 1.0), rate))
    return bounds_of(terms._replace(stribeck=wide), system.cycle, rtol)._replace(
        ratio=1.0 + sum(share for share, _ in pairs))


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives; raise OutOfRange if a damper's decay takes too many steps."""
    if terms.stribeck is not None:
        terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST), *terms.stribeck[2:]))
    bounds, waves = exact_bounds(terms, system, FINER * rtol, changes), waves_of(terms)
    if decay_of_plate(terms) * bounds.period > REACH * bounds.steps:
        raise OutOfRange(f"driveline.damping is {system.driveline.damping:g} N m s/rad; over driveline.plate_inertia "
                         f"it decays at {decay_of_plate(terms):.3g} 1/s, and the derivatives of the set-valued motion, "
                         f"which follow that decay, take more than {bounds.steps} steps a cycle; those of "
                         "friction.law smoothed step over it")
    pressure = system.pressure
    if terms.pulsation is None:  # One compiled kernel serves with and without a pulsating load.
        terms = terms._replace(pulsation=(0.0, pressure.frequency_ratio * system.engine.frequency, pressure.phase))
    return Setup(bounds._replace(events=EVENTS), without_torque(terms), pressure.frequency_ratio, waves, None)


def decay_of_plate(terms: Terms) -> float:
    """Return C23/I2, 1/s, the decay that the steps of a heavy damper follow."""
    return terms.linear.damping / terms.linear.plate


def why(ended: int, steps: int, setup: Setup) -> str:
    """Return a sentence on a failure."""
    decay = decay_of_plate(setup.terms)
    heavy = (f"; driveline.damping over driveline.plate_inertia decays at {decay:.3g} 1/s, which friction.law smoothed "
             "steps over" if decay * setup.limits.period > REACH * steps else "")
    return {EVENT_LIMIT: f"{setup.limits.events} events in one period of excitation",
            NOT_FINITE: "the state is not finite",
            STEP_LIMIT: f"{steps} steps in one period of excitation{heavy}",
            DEGENERATE: "slip ends where its rate is 0 too"
            }.get(ended, "")


ENGINE = EngineShell("event_driven", integrate, Memory(STATE, None, DRIVE, WORK, COUNTERS, OUTPUT), SHARED, setup_of,
                     setup_of_changes, lambda _, cycles: STEP_MAXIMUM, lambda setup, cycles: setup.limits.steps, why,
                     transitions_per_cycle=EVENTS, columns=5, stride=2)
solve = ENGINE.solve
