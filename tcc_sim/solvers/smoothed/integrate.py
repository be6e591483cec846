"""The smoothed engine's part of the loop: region of the state, method of the next step, its length and output."""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast, lost_torque
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.profile import STARTED
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import to_bernstein
from tcc_sim.solvers import run_output
from tcc_sim.solvers.engine import Memory, Setup, loop_by
from tcc_sim.solvers.excitation import clamp_edge, excite
from tcc_sim.solvers.loads import keep_loads, wanted
from tcc_sim.solvers.run_output import GOES_ON, NOT_FINITE, STEP_TOO_SMALL, Store
from tcc_sim.solvers.series import FLYWHEEL, SLIP, add_integral
from tcc_sim.solvers.shared_collocation import fill_plate, state_at_end
from tcc_sim.solvers.smoothed.collocation_step import collocation_step
from tcc_sim.solvers.smoothed.sensitivity import carry
from tcc_sim.solvers.smoothed.sensitivity_series import reach_of, resolved
from tcc_sim.solvers.smoothed.series_step import LocalFriction, friction_here, series_step
from tcc_sim.solvers.smoothed.setup import CREEP, REFUSED, SERIES, Limits, Step
from tcc_sim.solvers.smoothed.switching import SETTLED, after_step, begin, begin_cycle, choose_method, leave_if_short
from tcc_sim.solvers.stages import FALLING, LAYER, SLIDING, Place
from tcc_sim.solvers.terms import Terms

EDGE = 1e-6
"""Relative width at the edge of a region within which a state counts as inside: steps end there to a tenth of it."""

COLLOCATION_REACH = 2.0
"""Longest collocation step that resolves a sine, per longest series step that does."""


@fast
def start(setup: Setup, memory: Memory, tangent: Any) -> None:
    """Set up all but the state, where a motion starts."""
    limits, state, control = setup.limits, memory.state, memory.control
    v = state.slip_speed
    begin(state, control, limits)
    if tangent is not None:
        control.waited, control.unsettled = SETTLED, limits.forgotten
        tangent.shared.peak, tangent.shared.slopes[:] = -1.0, 0.0
    run_output.begin_output(memory.output, v, 0 if abs(v) <= limits.stick_speed else 1 if v > 0.0 else -1)


@fast
def region_of(state: Any, loaded: bool, control: Any, limits: Limits, terms: Terms, drive: Any) -> Place:
    """Return region, sign and tolerances of the state."""
    v = state.slip_speed
    size = abs(v)
    control.slip_now = max(control.slip_now, size)
    control.speed_now = max(control.speed_now, abs(state.plate_speed))
    slip_scale = max(control.slip_now, control.slip_before)
    slip_tolerance = limits.rtol * max(slip_scale, limits.slip_floor)
    speed_tolerance = limits.rtol * max(max(control.speed_now, control.speed_before),
                                        max(1e-3 * slip_scale, limits.speed_floor))
    sign = 1.0 if v > 0.0 else -1.0
    region = SLIDING
    if not loaded:
        sign = 0.0
    elif size <= limits.layer * (1.0 + EDGE):
        region = LAYER
        slip_tolerance = min(slip_tolerance, limits.layer_tolerance)
        if size < 0.1 * limits.nearly_zero:
            linear = terms.linear
            spring = linear.damping * state.plate_speed + linear.stiffness * state.plate_angle
            engine = drive.torque - lost_torque(0.0, state.plate_speed, None, linear.flywheel_by_speed)
            sign = 1.0 if engine / linear.flywheel + spring / linear.plate >= 0.0 else -1.0
    elif size <= limits.far * (1.0 + EDGE):
        region = FALLING
        slip_tolerance = min(slip_tolerance, limits.falling_tolerance)
    return Place(region, sign, slip_tolerance, speed_tolerance)


@fast
def edge_of(place: Place, limits: Limits) -> float:
    """Return the slip speed, rad/s, at which a region outside the layer ends on the way down."""
    return limits.far if place.region == SLIDING else limits.layer


@fast
def first_boundary(place: Place, degree: int, x: float, method: int, loaded: bool, limits: Limits, stribeck: Stribeck,
                   work: Any) -> float:
    """Return where the step leaves its region in [0, x], at v = 0 or on the way down at the region's edge; else inf.

    The first row of work.bernstein receives the slip speed over [0, x].
    """
    to_bernstein(work.rows, SLIP, degree, x, work.bernstein)
    if not loaded:
        return math.inf
    if place.region == LAYER or method == CREEP:
        level, accuracy = -limits.nearly_zero, 0.1 * limits.nearly_zero
        if stribeck is None:
            return math.inf
    else:
        level = edge_of(place, limits)
        accuracy = 0.1 * EDGE * level
    return float(polynomial.crossing_of(work.rows, SLIP, degree, x, place.sign, level, accuracy, work.bernstein))


@fast
def step_on(place: Place, friction: LocalFriction, to_edge: float, to_stop: float, loaded: bool, setup: Setup,
            memory: Memory, tangent: Any) -> tuple[Step, float]:
    """Return a step of the method that was chosen, and its part to take: at most `to_stop` s; the excitation is smooth
    for `to_edge` s.
    """
    limits, terms, _, waves, tables = setup
    state, control, drive, work, counters, _ = memory
    if control.method == SERIES:
        step = series_step(place, friction, to_stop, loaded, state, limits, terms, waves, drive, work)
        x = step.x
        if tangent is not None:
            x = resolved(step, place, friction, work.rows, terms.stribeck, control, limits, terms, drive,
                         tangent.shared.fastest)
    else:
        longest = to_edge
        if tangent is not None:
            longest = min(longest, COLLOCATION_REACH * reach_of(limits, tangent.shared.fastest))
        step = collocation_step(place, longest, loaded, state, control, limits, terms, waves, drive, tables, work,
                                counters)
        x = min(step.x, to_stop / step.unit) if step.status != REFUSED else 0.0
    return step, x


@fast
def complete(step: Step, degree: int, whole: bool, cut: float, setup: Setup, memory: Memory, store: Store,
             angle: Any) -> None:
    """Fill the rows that a step leaves out where the output does not need them: the plate's in creep, and theta1."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, output = memory
    if control.method == CREEP and (not whole or cut < math.inf or store.per_cycle > 0 or angle is not None
                                    or wanted(store.loads, output.cycle)):
        fill_plate(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work)
    if angle is not None:
        work.rows[FLYWHEEL, 0] = state.flywheel_angle
        add_integral(work.rows, degree, step.unit)


@fast
def keep(step: Step, degree: int, x: float, cut: float, first: int, limits: Limits, terms: Terms, memory: Memory,
         store: Store, angle: Any, profile: Any) -> None:
    """Store the output of [0, x] of a step; `cut` is the end of the engine cycle in it."""
    state, _, _, work, _, output = memory
    keep_loads(store.loads, work.rows, degree, step.unit, x, cut, output.cycle, terms.linear, work.bernstein)
    if profile is None:
        begun = (first + output.cycle) * limits.period
    else:
        begun = float(profile[STARTED])
    run_output.keep_step(work, degree, step.unit, x, cut, state.tau, begun + state.tau, limits.period,
                         limits.stick_speed, output, store, angle)


@fast
def finish(degree: int, x: float, whole: bool, setup: Setup, memory: Memory, angle: Any) -> None:
    """Bring the state to the end of a step."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, _ = memory
    if whole and control.method != SERIES:
        state_at_end(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work, state)
    else:
        state.slip_speed, state.plate_angle, state.plate_speed = polynomial.values(work.rows, degree, x)
    if angle is not None:
        state.flywheel_angle = polynomial.value(work.rows, FLYWHEEL, degree, x)
    if abs(state.plate_speed) < limits.rest:
        state.plate_speed = 0.0


@fast
def take_step(first: int, count: int, tail: float, setup: Setup, memory: Memory, tangent: Any, store: Store,
              angle: Any) -> int:
    """Take a step, unless the state is moved to the slow manifold or to an edge, or the step is refused.

    Steps run across the ends of cycles, whose section points are values of the polynomial. They end at the edges of the
    clamp and of the regions, and at the end of the run.
    """
    limits, terms, _, waves, tables = setup
    state, control, drive, work, counters, output = memory
    tau, period = state.tau, limits.period
    edge, loaded = clamp_edge(tau, tau + 2.0 * period, state.shift, terms.mean_load, terms.pulsation, terms.profile)
    stop = min(edge, (count - output.cycle) * period + tail)
    excite(tau, state.shift, loaded, terms.mean_torque, waves, terms.mean_load, terms.pulsation, terms.profile, drive)
    place = region_of(state, loaded, control, limits, terms, drive)
    friction = friction_here(place, state, limits, terms, drive)
    if choose_method(place, friction, edge - tau, state, control, limits, terms, drive, tables):
        return GOES_ON
    method = control.method
    step, x = step_on(place, friction, edge - tau, stop - tau, loaded, setup, memory, tangent)
    if step.status == REFUSED:
        counters.rejected += 1
        control.streak = 0
        leave_if_short(control, limits, tables)
        return GOES_ON
    if not x > 0.0:
        return STEP_TOO_SMALL if x == 0.0 else NOT_FINITE
    degree = step.degree if method == SERIES or angle is None else step.degree + 1  # theta1 is an integral.
    crossing = first_boundary(place, degree, x, method, loaded, limits, terms.stribeck, work)
    reached = x * step.unit >= (stop - tau) * (1.0 - 1e-14)
    if crossing == 0.0 and place.region != LAYER:  # Rounding of a step that was cut there left the state outside.
        state.slip_speed = place.sign * edge_of(place, limits)
        return GOES_ON
    if 0.0 < crossing < x:
        x = crossing
        reached = False
        to_bernstein(work.rows, SLIP, degree, x, work.bernstein)
    whole = x == step.x
    after = stop if reached else tau + x * step.unit
    cut = run_output.end_of_cycle(tau, after, period, step.unit, x)
    complete(step, degree, whole, cut, setup, memory, store, angle)
    if tangent is not None:
        carry(tangent, method, place, friction, step, degree, x, whole, cut, loaded, setup, memory)
    keep(step, degree, x, cut, first, limits, terms, memory, store, angle, terms.profile)
    finish(degree, x, whole, setup, memory, angle)
    state.tau = after
    if not abs(state.slip_speed + state.plate_angle + state.plate_speed) < math.inf:
        return NOT_FINITE
    counters.steps += 1
    if after >= period:
        begin_cycle(state, control, limits)
    after_step(step, x, control, limits, tables)
    return GOES_ON


integrate = loop_by(start, take_step)
