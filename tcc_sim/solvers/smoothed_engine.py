"""The fast adaptive engine for the smoothed friction law (7).

Outside the layer |v| < about 10/sigma tanh is 1 to the tolerance and slip is not stiff: steps are Taylor series of high
order and variable length, without the exponential where that is below the tolerance. Inside the layer the series
contain tanh too, until the layer's own rate beta Ts sigma limits their length; then, in stick, one collocation step of
16 nodes replaces ten series or more. Steps end at the edges of these regions, which a certified search finds on the
step's polynomial, and run across the section points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.model import profile as of
from tcc_sim.model.equations import completed
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import STARTED
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import to_bernstein
from tcc_sim.solvers import collocation, run_output
from tcc_sim.solvers.collocation import FALLING, ITERATIONS_MAXIMUM, LAYER, SLIDING, WORK, Place
from tcc_sim.solvers.engine import COUNTERS, EngineShell, Memory, Setup, Stretch, loop_by
from tcc_sim.solvers.key_derivatives import EXCESSES
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.run_output import GOES_ON, NOT_FINITE, OUTPUT, STEP_TOO_SMALL, Store, keep_loads, wanted
from tcc_sim.solvers.series import DRIVE, FLYWHEEL, SLIP, add_integral, clamp_edge, excite, load_phase, waves_of
from tcc_sim.solvers.smoothed import (
    CONTROL,
    CREEP,
    REFUSED,
    SERIES,
    SETTLED,
    STATE,
    Limits,
    LocalFriction,
    Step,
    after_step,
    begin,
    begin_cycle,
    choose_method,
    collocation_step,
    fill_plate,
    friction_here,
    leave_if_short,
    limits_of,
    series_step,
    state_at_end,
)
from tcc_sim.solvers.smoothed_derivatives import SHARED, carry, reach_of, resolved
from tcc_sim.solvers.terms import Terms, load_frequency, per_system, steps_allowed, terms_of
from tcc_sim.trajectory import Floats

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
        control.waited, control.unsettled = SETTLED, limits.orders.forgotten
        tangent.shared.peak, tangent.shared.slopes[:] = -1.0, 0.0
    run_output.begin_output(memory.output, v, 0 if abs(v) <= limits.speeds.stick else 1 if v > 0.0 else -1)


@fast
def region_of(state: Any, loaded: bool, control: Any, limits: Limits, terms: Terms, drive: Any) -> Place:
    """Return region, sign and tolerances of the state."""
    v = state.slip_speed
    size = abs(v)
    control.slip_now = max(control.slip_now, size)
    control.speed_now = max(control.speed_now, abs(state.plate_speed))
    slip_scale = max(control.slip_now, control.slip_before)
    slip_tolerance = limits.errors.relative * max(slip_scale, limits.errors.slip_floor)
    speed_tolerance = limits.errors.relative * max(max(control.speed_now, control.speed_before),
                                        max(1e-3 * slip_scale, limits.errors.speed_floor))
    sign = 1.0 if v > 0.0 else -1.0
    region = SLIDING
    if not loaded:
        sign = 0.0
    elif size <= limits.speeds.layer * (1.0 + EDGE):
        region = LAYER
        slip_tolerance = min(slip_tolerance, limits.errors.layer)
        if size < 0.1 * limits.errors.nearly_zero:
            linear = terms.linear
            spring = linear.damping * state.plate_speed + linear.stiffness * state.plate_angle
            sign = 1.0 if drive.torque / linear.flywheel + spring / linear.plate >= 0.0 else -1.0
    elif size <= limits.speeds.far * (1.0 + EDGE):
        region = FALLING
        slip_tolerance = min(slip_tolerance, limits.errors.falling)
    return Place(region, sign, slip_tolerance, speed_tolerance)


@fast
def edge_of(place: Place, limits: Limits) -> float:
    """Return the slip speed, rad/s, at which a region outside the layer ends on the way down."""
    return limits.speeds.far if place.region == SLIDING else limits.speeds.layer


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
        level, accuracy = -limits.errors.nearly_zero, 0.1 * limits.errors.nearly_zero
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
             angle: bool) -> None:
    """Fill the rows that a step leaves out where the output does not need them: the plate's in creep, and theta1."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, output = memory
    if control.method == CREEP and (not whole or cut < math.inf or store.per_cycle > 0 or angle
                                    or wanted(store.loads, output.cycle)):
        fill_plate(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work)
    if angle:
        work.rows[FLYWHEEL, 0] = state.flywheel_angle
        add_integral(work.rows, degree, step.unit)


@fast
def keep(step: Step, degree: int, x: float, cut: float, first: int, limits: Limits, terms: Terms, memory: Memory,
         store: Store, angle: bool, profile: Any) -> None:
    """Store the output of [0, x] of a step; `cut` is the end of the engine cycle in it."""
    state, _, _, work, _, output = memory
    keep_loads(store.loads, work.rows, degree, step.unit, x, cut, output.cycle, terms.linear, work.bernstein)
    if profile is None:
        begun = (first + output.cycle) * limits.period
    else:
        begun = float(profile[STARTED])
    run_output.keep_step(work, degree, step.unit, x, cut, state.tau, begun + state.tau, limits.period,
                         limits.speeds.stick, output, store, angle)


@fast
def finish(degree: int, x: float, whole: bool, setup: Setup, memory: Memory, angle: bool) -> None:
    """Bring the state to the end of a step."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, _ = memory
    if whole and control.method != SERIES:
        state_at_end(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work, state)
    else:
        state.slip_speed, state.plate_angle, state.plate_speed = polynomial.values(work.rows, degree, x)
    if angle:
        state.flywheel_angle = polynomial.value(work.rows, FLYWHEEL, degree, x)
    if abs(state.plate_speed) < limits.errors.rest:
        state.plate_speed = 0.0


@fast
def take_step(first: int, count: int, tail: float, setup: Setup, memory: Memory, tangent: Any, store: Store,
              angle: bool) -> int:
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
    degree = step.degree if method == SERIES or not angle else step.degree + 1  # theta1 is an integral.
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


integrate = loop_by(start, take_step, "smoothed")


STEPS_AT_FIRST = 400_000
"""Steps of a solve beside those allowed to its cycles."""
MORE_STEPS = 10
"""Steps with derivatives per those of a solve."""
BATCH = 4096
"""Engine cycles in one call of the compiled loop."""
NEAR = 1e-9
"""Distance of a corner from the end of a cycle, in cycles, below which it counts as at the end."""


@per_system
def prepared(system: System, rtol: float) -> Setup:
    """Return `setup_of` the terms of a system; a solve copies `waves`."""
    setup = setup_of(system, terms_of(system), rtol)
    setup.waves.setflags(write=False)
    return setup._replace(terms=setup.terms._replace(pulsation=setup.terms.pulsation or (0.0, 1.0, 0.0)))


def setup_of(system: System, terms: Terms, rtol: float, excess: float = 0.0) -> Setup:
    """Return the setup of a system with given terms; `excess` is that of `limits_of`."""
    longest, period = system.cycle, system.cycle
    if terms.profile is not None:
        frequency = terms.profile[:, of.FREQUENCY]
        longest, period = 2.0 * math.pi / float(frequency.min()), 2.0 * math.pi / float(frequency.max())
    limits = limits_of(terms, terms_of(system), period, rtol, excess)
    waves = waves_of(terms)
    top, levels = collocation.ladder_of(limits.rates.fastest, longest)
    if terms.profile is None:
        tables = collocation.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms), top, levels)
    else:
        limits = limits._replace(steps=steps_allowed(terms, longest))
        tables = collocation.nodal_tables(terms.linear, top, levels + math.ceil(2.0 * math.log2(longest / period)))
        terms = terms._replace(pulsation=terms.pulsation or (0.0, 1.0, 0.0))
    terms = terms._replace(linear=completed(terms.linear), torque=None, harmonics=None)  # The sines are the waves.
    return Setup(limits, terms, system.pressure.frequency_ratio, waves, tables)


def _varying(problem: Problem, setup: Setup, profile: Floats) -> Iterator[Stretch]:
    """Yield the calls engine cycle by engine cycle, and within one from corner to corner."""
    first, count, terms = problem.start_cycle, problem.whole_cycles, setup.terms
    starts = problem.system.cycle_start(first + np.arange(count + 2)).tolist()
    for n in range(count + 1):
        start, following = starts[n], starts[n + 1]
        period, end = following - start, problem.end if n == count else following
        if end - start < NEAR * period:
            return
        near = NEAR * period
        times = profile[:, of.TIME]
        inner = times[(times > start + near) & (times < end - near)].tolist()
        shift = load_phase(setup.ratio, terms.pulsation, first + n)
        limits, phase = setup.limits._replace(period=period), 0.0
        for low, stop in zip([start, *inner], [*inner, end]):
            row = profile_row(profile, low, stop, start, phase, shift)
            whole = n < count and stop == following
            varied = setup._replace(limits=limits, terms=terms._replace(profile=row))
            yield varied, n + whole, 0.0 if whole else stop - start
            past = stop - low
            phase += past * (row[of.FREQUENCY] + 0.5 * row[of.FREQUENCY_RATE] * past)


def profile_row(profile: Floats, begin: float, stop: float, start: float, phase: float, shift: float) -> Floats:
    """Return the kernel's row from `begin` to `stop`, s, within the cycle that started at `start`; `phase` is the angle
    since then, and `shift` the load's angle at the start, rad.
    """
    k = int(of.pieces(profile, 0.5 * (begin + stop)))
    piece, past = profile[k], begin - profile[k, of.TIME]
    row: Floats = piece.copy()
    row[of.TIME], row[1] = begin - start, phase
    for column in (*range(of.FREQUENCY, of.LOAD_RATE, 2), *range(of.SWELLS + 2, len(piece), of.SWELL)):
        row[column] = piece[column] + piece[column + 1] * past
    ends = profile[k + 1, of.TIME] if k + 1 < len(profile) else math.inf
    row[of.UNTIL], row[of.STARTED], row[of.SHIFT] = max(ends, stop) - start, start, shift
    return row


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives."""
    # The derivative of mubar by mu_s/mu_k decays with slip as exp(-alpha |v|), even for mu_s/mu_k near 1.
    setup = setup_of(system, terms, rtol, 1.0 if changes[EXCESSES].any() else 0.0)
    ladder = collocation.ladder_of(setup.limits.rates.fastest, system.cycle)
    return setup._replace(tables=setup.tables._replace(torque=collocation.response(terms.linear, *ladder).torque))


def stretches(problem: Problem, setup: Setup) -> Iterator[Stretch]:
    """Yield calls of many cycles, or, where the excitation varies in time, piece by piece."""
    if setup.terms.profile is not None:
        yield from _varying(problem, setup, setup.terms.profile)
        return
    for cycles in range(BATCH, problem.whole_cycles, BATCH):
        yield setup, cycles, 0.0
    yield setup, problem.whole_cycles, problem.rest


ENGINE = EngineShell("smoothed", integrate, Memory(STATE, CONTROL, DRIVE, WORK, COUNTERS, OUTPUT), SHARED, prepared,
                setup_of_changes, lambda setup, cycles: STEPS_AT_FIRST + setup.limits.steps * cycles,
                lambda setup, cycles: MORE_STEPS * setup.limits.steps * cycles,
                lambda ended, *_: "the state grew without bound" if ended == NOT_FINITE else "",
                transitions_per_cycle=256, stretches=stretches, bound=ITERATIONS_MAXIMUM)
solve = ENGINE.solve
