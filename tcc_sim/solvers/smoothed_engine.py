"""The fast adaptive engine for the smoothed friction law (7).

Outside the layer |v| < about 10/sigma tanh is 1 to the tolerance and slip is not stiff: steps are Taylor series of high
order and variable length, without the exponential where that is below the tolerance. Inside the layer the series
contain tanh too, until the layer's own rate beta Ts sigma limits their length; then, in stick, one collocation step of
16 nodes replaces ten series or more. Steps end at the edges of these regions, which a certified search finds on the
step's polynomial, and run across the section points.

Derivatives by the state and by numbers of the scene are those of the method: a series step coefficient by coefficient
(`carry_series`), a collocation step at its nodes, by the matrix of its last Newton step. The largest slip speed of
every cycle has derivatives too. At the edges of the regions, of the clamp and at v = 0 the accelerations are
continuous, so that derivatives do not jump there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model.equations import completed
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import FREQUENCY, STARTED, TIME, profile_rows
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.polynomial import BERNSTEIN, to_bernstein
from tcc_sim.solvers import collocation, series, smoothed
from tcc_sim.solvers import engine as shell
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import LANES, carry_slip, changed_at, end_changes, expand_sines, hold_phase
from tcc_sim.solvers.collocation import DEGREE, FALLING, FROM_ANGLE, FROM_SPEED, LAYER, NODES, SLIDING, TERMS, C, Place
from tcc_sim.solvers.engine import EngineShell, Memory, Setup, Store, Stretch
from tcc_sim.solvers.law import mubar_at, numbers_of
from tcc_sim.solvers.series import ANGLE, FLYWHEEL, SLIP, SPEED, Pulsation, added, clamp_edge, excite, fastest_at
from tcc_sim.solvers.smoothed import Limits, Step, begin
from tcc_sim.solvers.terms import Problem, Terms, load_frequency, per_system, steps_allowed, terms_of
from tcc_sim.trajectory import Floats

EDGE = 1e-6
"""Relative width at the edge of a region within which a state counts as inside: steps end there to a tenth of it."""

COLLOCATION_REACH = 2.0
"""Longest collocation step that resolves a sine, per longest series step that does."""


SHARED = np.dtype([("basis", np.float64, TERMS), ("slip", np.float64, NODES + 1), ("angle", np.float64, NODES),
                   ("speed", np.float64, NODES), ("peak", np.float64), ("extended", np.int64),
                   ("slopes", np.float64, 3), ("fastest", np.float64)])
"""Values that the lanes share: Chebyshev polynomials where a step is evaluated, and what the slip speeds
at its nodes add there to slip speed (that at the start first), plate angle and plate speed + kappa slip speed; the
largest |slip speed| of the cycle so far; the integrals of `sensitivity.add_slopes`, which are the further results of
`engine.Tangent`.
"""
SINE = 0.7
"""Angle of a sine within a series step that resolves it, per `Limits.resolved`, which assumes a decay."""


@fast
def reach_of(limits: Limits, fastest: float) -> float:
    """Return the longest series step, s, that resolves the fastest sine with derivatives by its amplitude."""
    return SINE * limits.orders.resolved / fastest if fastest > 0.0 else math.inf


@fast
def resolved(step: Step, place: Place, friction: smoothed.LocalFriction, rows: Any, stribeck: Stribeck, control: Any,
             limits: Limits, terms: Terms, drive: Any, fastest: float) -> float:
    """Return the part of a series step over which the series of its derivatives hold too.

    In stick the motion is on its slow manifold, and a step is as long as the creep's series allow; a change of the
    start or of the scene is off it and decays with friction's own rate. Nor does the motion show an exponential or a
    sine of zero amplitude, by which there may be derivatives.
    """
    rate = terms.linear.damping / terms.linear.plate + limits.rates.slip_decay
    if place.region == LAYER:
        rate += limits.beta * drive.load * max(friction.slope, 0.0)
    x = min(step.x, reach_of(limits, fastest) / step.unit)
    if rate > 0.0:
        x = min(x, limits.orders.resolved / (rate * step.unit))
    if stribeck is not None and place.region != SLIDING:
        while fastest_at(stribeck, 0.0) * (abs(rows[SLIP, 1]) + abs(rows[SLIP, 2]) * x) * x > limits.orders.resolved:
            x *= 0.85
    control.unsettled -= rate * step.unit * x
    return x


@fast
def carry_series(tangent: Any, place: Place, step: Step, loaded: bool, limits: Limits, terms: Terms, waves: Any,
                 drive: Any, rows: Any, pulsation: Pulsation, stribeck: Stribeck) -> None:
    """Fill the coefficients of all derivatives over a series step; the law varies as in `series_step.expand_region`."""
    order, unit, sign, groups, along = step.degree, step.unit, place.sign, tangent.groups, tangent.along
    expand_sines(along.sines, order, unit, waves, pulsation, drive)
    if place.region == LAYER and loaded:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, stribeck, limits.sigma)
    elif place.region == SLIDING or not loaded or stribeck is None:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, None, None)
    else:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, stribeck, None)


GAUSS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(6))
"""Half the abscissae and weights of the six-point rule for integrals along a step."""
PIECES = 4
"""Parts of a step in which the rule is applied."""
SAMPLES = 8
"""Parts of a step whose ends are compared to start Newton's method for the largest |slip speed|."""


@unrolled
def law_by_numbers(law: Any, slip: Any, sign: Any, sigma: Any, stribeck: Any) -> None:
    """Fill the rows of `law` (`at_nodes` of ALONG) with the derivatives of mubar at the nodes by its numbers."""
    mubar = mubar_at(slip.row(), sign, sigma, stribeck)
    for cause in numbers_of(stribeck, law.shape[0]):
        law.set_row(mubar.change[cause], cause, 0)


@unrolled
def change_law(nodes: Any, by: Any, law: Any, friction_rate: Any, stribeck: Any) -> None:
    """Add the derivatives of friction by the numbers of its law to the balance of the nodes, in every lane."""
    for lane in range(LANES):
        change = added([law.row(cause, 0) * by[number, lane]
                        for cause, number in numbers_of(stribeck, law.shape[0]).items()])
        nodes.set_row(nodes.row(lane, 0) - friction_rate.row() * change, lane, 0)


@fast
def change_at_nodes(group: Any, lane: int, level: int, loaded: bool, limits: Limits, waves: Any, tables: Any,
                    drive: Any, work: Any, pulsation: tuple[float, float, float] | None) -> None:
    """Fill one lane's derivatives of the torque on flywheel and plate together, and of the balance of the nodes, those
    by the numbers of the friction law excepted.
    """
    by, rows, turn, h = group.by, work.rows, tables.turns[level], tables.step_sizes[level].length
    for n in range(NODES):
        s = C[n] * h
        torque, load = by[of.MEAN_TORQUE, lane], 0.0
        if by[of.TORQUE_AMPLITUDE, lane] != 0.0:
            angle = waves[0].rate * s
            torque += by[of.TORQUE_AMPLITUDE, lane] * (
                waves[0].sine * math.cos(angle) + waves[0].cosine * math.sin(angle))
        if by[of.LOG_FREQUENCY, lane] != 0.0:
            for i in range(waves.shape[0]):
                angle = waves[i].rate * s
                torque += by[of.LOG_FREQUENCY, lane] * angle * waves[i].amplitude * (
                    waves[i].cosine * math.cos(angle) - waves[i].sine * math.sin(angle))
        if loaded:
            load = by[of.MEAN_LOAD, lane]
            if pulsation is not None:
                sine = drive.load_sine * turn.cosine[n] + drive.load_cosine * turn.sine[n]
                cosine = drive.load_cosine * turn.cosine[n] - drive.load_sine * turn.sine[n]
                turned = by[of.LOAD_PHASE, lane] + by[of.LOG_FREQUENCY, lane] * pulsation[1] * s
                load += by[of.LOAD_AMPLITUDE, lane] * sine + turned * pulsation[0] * cosine
        plate_speed = polynomial.value(rows, SPEED, DEGREE, C[n])
        plate = polynomial.value_and_slope(rows, SPEED, DEGREE, C[n])[1] / h
        slip = polynomial.value_and_slope(rows, SLIP, DEGREE, C[n])[1] / h
        v = polynomial.value(rows, SLIP, DEGREE, C[n])
        pull = -(by[of.PLATE_INERTIA, lane] * plate + by[of.DAMPING, lane] * plate_speed
                 + by[of.STIFFNESS, lane] * polynomial.value(rows, ANGLE, DEGREE, C[n])
                 + by[of.PLATE_BY_SLIP, lane] * v)
        torque -= by[of.FLYWHEEL_BY_SLIP, lane] * v
        group.applied[lane, n] = torque - by[of.FLYWHEEL_INERTIA, lane] * (slip + plate) + pull
        group.nodes[lane, n] -= limits.beta * (work.law[n] * load + pull)


@fast
def carry_collocation(tangent: Any, place: Place, level: int, loaded: bool, limits: Limits, waves: Any, tables: Any,
                      drive: Any, work: Any, pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Fill the derivatives of the slip speed at the nodes of a collocation step."""
    step_size, law = tables.step_sizes[level], tangent.along.at_nodes
    collocation.law_at_nodes(place, limits.sigma, stribeck, work)
    if tangent.groups[0].forced != 0:  # Keys fill the lanes from the fourth of the first group on.
        law_by_numbers(0, law, work.slip, place.sign, limits.sigma, stribeck)
    from_angle, from_speed = tables.sources[level, FROM_ANGLE].balance, tables.sources[level, FROM_SPEED].balance
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        now, nodes = group.now, group.nodes
        for lane in range(LANES):
            w = now[2, lane] + limits.kappa * now[0, lane]
            for n in range(NODES):
                nodes[lane, n] = now[1, lane] * from_angle[n] + w * from_speed[n] + now[0, lane] * step_size.start[n]
            if group.forced & (1 << lane):
                change_at_nodes(group, lane, level, loaded, limits, waves, tables, drive, work, pulsation)
                for m in range(NODES):
                    for n in range(NODES):
                        nodes[lane, m] += tables.torque[level, m, n] * group.applied[lane, n]
        if group.forced != 0:
            change_law(0, nodes, group.by, law, work.friction_rate, stribeck)
        collocation.eliminate_rows(0, nodes, step_size.coupling, work.friction_rate, work.slope)


@fast
def look_at(x: float, step_size: Any, shared: Any) -> None:
    """Fill `shared` with the weights of the node values of a collocation step in the state at x."""
    basis, t = shared.basis, 2.0 * x - 1.0
    basis[0], basis[1] = 1.0, t
    for i in range(2, DEGREE + 1):
        basis[i] = 2.0 * t * basis[i - 1] - basis[i - 2]
    for j in range(NODES + 1):
        shared.slip[j] = 0.0
        for i in range(DEGREE + 1):
            shared.slip[j] += collocation.TO_CHEBYSHEV[j, i] * basis[i]
    for j in range(NODES):
        shared.angle[j], shared.speed[j] = 0.0, 0.0
        for i in range(DEGREE + 1):
            shared.angle[j] += step_size.angle[j, i] * basis[i]
            shared.speed[j] += step_size.speed[j, i] * basis[i]


@fast
def end_collocation(tangent: Any, level: int, x: float, whole: bool, limits: Limits, tables: Any) -> None:
    """Fill the derivatives of the state at x of a collocation step, its end if it is taken whole."""
    step_size, shared = tables.step_sizes[level], tangent.shared
    if not whole:
        look_at(x, step_size, shared)
    from_angle, from_speed = tables.sources[level, FROM_ANGLE], tables.sources[level, FROM_SPEED]
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        now, nodes = group.now, group.nodes
        for lane in range(LANES):
            x0, w0 = now[1, lane], now[2, lane] + limits.kappa * now[0, lane]
            forced = (group.forced & (1 << lane)) != 0
            if whole:
                v = nodes[lane, NODES - 1]
                angle = x0 * from_angle.end_angle + w0 * from_speed.end_angle
                speed = x0 * from_angle.end_speed + w0 * from_speed.end_speed
                for n in range(NODES):
                    angle += step_size.end_angle[n] * nodes[lane, n]
                    speed += step_size.end_speed[n] * nodes[lane, n]
                    if forced:
                        angle += tables.torque[level, NODES + 2 * TERMS, n] * group.applied[lane, n]
                        speed += tables.torque[level, NODES + 2 * TERMS + 1, n] * group.applied[lane, n]
            else:
                v, angle, speed = shared.slip[0] * now[0, lane], 0.0, 0.0
                for k in range(DEGREE + 1):
                    at, to = x0 * from_angle.angle[k], x0 * from_angle.speed[k]
                    at += w0 * from_speed.angle[k]
                    to += w0 * from_speed.speed[k]
                    if forced:
                        for n in range(NODES):
                            at += tables.torque[level, NODES + k, n] * group.applied[lane, n]
                            to += tables.torque[level, NODES + TERMS + k, n] * group.applied[lane, n]
                    angle += shared.basis[k] * at
                    speed += shared.basis[k] * to
                for n in range(NODES):
                    v += shared.slip[n + 1] * nodes[lane, n]
                    angle += shared.angle[n] * nodes[lane, n]
                    speed += shared.speed[n] * nodes[lane, n]
            now[0, lane], now[1, lane], now[2, lane] = v, angle, speed - limits.kappa * v


@fast
def peak_between(rows: Any, degree: int, low: float, high: float) -> float:
    """Return the place of the largest |slip speed| in [low, high]."""
    part, best, at = (high - low) / SAMPLES, -1.0, low
    for i in range(SAMPLES + 1):
        size = abs(polynomial.value(rows, SLIP, degree, low + i * part))
        if size > best:
            best, at = size, low + i * part
    low, high = max(low, at - part), min(high, at + part)
    for _ in range(30):
        slope, curvature = polynomial.slope_and_curvature(rows, SLIP, degree, at)
        following = min(max(at - slope / curvature, low), high) if curvature != 0.0 else at
        if abs(following - at) <= 1e-15 * high:
            break
        at = following
    return at if abs(polynomial.value(rows, SLIP, degree, at)) >= best else low + (high - low) * 0.5


@fast
def carry_peak(tangent: Any, order: int, degree: int, low: float, high: float, taylor: bool, step_size: Any, rows: Any,
               work: Any) -> None:
    """Keep the largest |slip speed| of a part of a step, with its derivatives, if it is the cycle's largest so far;
    work.bernstein holds the Bernstein coefficients of the slip speed over the step.
    """
    shared, bound = tangent.shared, 0.0
    for i in range(degree + 1):
        bound = max(bound, abs(work.bernstein[BERNSTEIN, i]))
    if bound <= shared.peak or not high > low:
        return
    at = peak_between(rows, degree, low, high)
    v, slope = polynomial.value_and_slope(rows, SLIP, degree, at)
    if abs(v) <= shared.peak:
        return
    shared.peak = abs(v)
    sign = 1.0 if v > 0.0 else -1.0
    if not taylor:
        look_at(at, step_size, shared)
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        for lane in range(LANES):
            if taylor:
                group.peak[lane] = sign * changed_at(group, SLIP, lane, order, degree, at, rows)
            else:
                change = shared.slip[0] * group.now[0, lane]
                for n in range(NODES):
                    change += shared.slip[n + 1] * group.nodes[lane, n]
                group.peak[lane] = sign * (change - group.by[of.LOG_FREQUENCY, lane] * at * slope)


@fast
def add_slopes(slopes: Any, low: float, high: float, unit: float, degree: int, loaded: bool, limits: Limits,
               mean_load: float, pulsation: tuple[float, float, float] | None, stribeck: Stribeck, drive: Any,
               rows: Any) -> None:
    """Add the integrals of (21) over time in [low, high]: dT/dv v^2, v^2 and min(dT/dv, 0)."""
    for k in range(len(GAUSS)):
        at = 0.5 * (low + high) + GAUSS[k] * (high - low)
        v, weight, load = polynomial.value(rows, SLIP, degree, at), WEIGHTS[k] * (high - low) * unit, 0.0
        if loaded:
            load = mean_load
            if pulsation is not None:
                turned = pulsation[1] * at * unit
                load += pulsation[0] * (drive.load_sine * math.cos(turned) + drive.load_cosine * math.sin(turned))
        slope = load * smoothed.law_here(v, 1.0 if v > 0.0 else -1.0, LAYER, limits.sigma, stribeck)[1]
        slopes[0] += weight * slope * v * v
        slopes[1] += weight * v * v
        slopes[2] += weight * min(slope, 0.0)


@fast
def average_slopes(slopes: Any, x: float, unit: float, degree: int, loaded: bool, limits: Limits, terms: Terms,
                   drive: Any, rows: Any) -> None:
    """Call `add_slopes` for pieces of [0, x] that end where |v| passes the peak of mubar: min(dT/dv, 0) has a kink."""
    for i in range(PIECES):
        low, high = x * i / PIECES, x * (i + 1) / PIECES
        inside = abs(polynomial.value(rows, SLIP, degree, low)) < limits.speeds.stick
        at = high
        if (abs(polynomial.value(rows, SLIP, degree, high)) < limits.speeds.stick) != inside:
            begin = low
            for _ in range(50):
                middle = 0.5 * (begin + at)
                if (abs(polynomial.value(rows, SLIP, degree, middle)) < limits.speeds.stick) != inside:
                    at = middle
                else:
                    begin = middle
        add_slopes(slopes, low, at, unit, degree, loaded, limits, terms.mean_load, terms.pulsation, terms.stribeck,
                   drive, rows)
        if at < high:
            add_slopes(slopes, at, high, unit, degree, loaded, limits, terms.mean_load, terms.pulsation,
                       terms.stribeck, drive, rows)


@fast
def keep_peak(tangent: Any, cycle: int) -> None:
    """Keep the derivatives of the largest |slip speed| of a cycle."""
    for i in range(tangent.groups.shape[0]):
        for lane in range(LANES):
            tangent.peaks[cycle, i, lane] = tangent.groups[i].peak[lane]
    tangent.shared.peak = -1.0


@fast
def carry(tangent: Any, method: int, place: Place, step: Step, degree: int, x: float, whole: bool, cut: float,
          loaded: bool, setup: Setup, memory: Memory) -> None:
    """Carry the tangent over [0, x] of a step that starts where the state is now; the rest as `integrate.integrate`.

    degree : of the polynomial of the slip speed
    cut : where the engine cycle ends; beyond x where it does not
    """
    limits, terms, _, waves, tables = setup
    drive, work, level, order = memory.drive, memory.work, memory.control.level, step.degree
    rows, taylor = work.rows, method == smoothed.SERIES
    step_size = tables.step_sizes[level]
    if taylor:
        carry_series(tangent, place, step, loaded, limits, terms, waves, drive, rows, terms.pulsation, terms.stribeck)
    else:
        smoothed.fill_plate(step_size, tables.sources, level, limits.kappa, work)
        carry_collocation(tangent, place, level, loaded, limits, waves, tables, drive, work, terms.pulsation,
                          terms.stribeck)
    if tangent.shared.extended:
        average_slopes(tangent.shared.slopes, x, step.unit, degree, loaded, limits, terms, drive, rows)
    carry_peak(tangent, order, degree, 0.0, min(cut, x), taylor, step_size, rows, work)
    if cut <= x:
        keep_peak(tangent, memory.output.cycle)
        carry_peak(tangent, order, degree, cut, x, taylor, step_size, rows, work)
    if not taylor:
        end_collocation(tangent, level, x, whole, limits, tables)
    for i in range(tangent.groups.shape[0]):
        if taylor:
            end_changes(order, tangent.groups[i].now, tangent.groups[i].rows, x)
        if tangent.groups[i].forced != 0:
            hold_phase(tangent.groups[i], degree, x, rows)


@fast
def start(setup: Setup, memory: Memory, tangent: Any) -> None:
    """Set up all but the state, where a motion starts."""
    limits, state, control = setup.limits, memory.state, memory.control
    v = state.slip_speed
    begin(state, control, limits)
    if tangent is not None:
        control.waited, control.unsettled = smoothed.SETTLED, limits.orders.forgotten
        tangent.shared.peak, tangent.shared.slopes[:] = -1.0, 0.0
    shell.begin_output(memory.output, v, 0 if abs(v) <= limits.speeds.stick else 1 if v > 0.0 else -1)


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
    if place.region == LAYER or method == smoothed.CREEP:
        level, accuracy = -limits.errors.nearly_zero, 0.1 * limits.errors.nearly_zero
        if stribeck is None:
            return math.inf
    else:
        level = edge_of(place, limits)
        accuracy = 0.1 * EDGE * level
    return float(polynomial.crossing_of(work.rows, SLIP, degree, place.sign, level, accuracy, work.bernstein))


@fast
def step_on(place: Place, friction: smoothed.LocalFriction, to_edge: float, to_stop: float, loaded: bool, setup: Setup,
            memory: Memory, tangent: Any) -> tuple[Step, float]:
    """Return a step of the method that was chosen, and its part to take: at most `to_stop` s; the excitation is smooth
    for `to_edge` s.
    """
    limits, terms, _, waves, tables = setup
    state, control, drive, work, counters, _ = memory
    if control.method == smoothed.SERIES:
        step = smoothed.series_step(place, friction, to_stop, loaded, state, limits, terms, waves, drive, work)
        x = step.x
        if tangent is not None:
            x = resolved(step, place, friction, work.rows, terms.stribeck, control, limits, terms, drive,
                         tangent.shared.fastest)
    else:
        longest = to_edge
        if tangent is not None:
            longest = min(longest, COLLOCATION_REACH * reach_of(limits, tangent.shared.fastest))
        step = smoothed.collocation_step(place, longest, loaded, state, control, limits, terms, waves, drive, tables,
                                         work, counters)
        x = min(step.x, to_stop / step.unit) if step.status != smoothed.REFUSED else 0.0
    return step, x


@fast
def complete(step: Step, degree: int, whole: bool, cut: float, setup: Setup, memory: Memory, store: Store,
             angle: bool) -> None:
    """Fill the rows that a step leaves out where the output does not need them: the plate's in creep, and theta1."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, output = memory
    if control.method == smoothed.CREEP and (not whole or cut < math.inf or store.per_cycle > 0 or angle
                                             or shell.wanted(store.loads, output.cycle)):
        smoothed.fill_plate(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work)
    if angle:
        work.rows[FLYWHEEL, 0] = state.flywheel_angle
        series.add_integral(work.rows, degree, step.unit)


@fast
def keep(step: Step, degree: int, x: float, cut: float, first: int, limits: Limits, terms: Terms, memory: Memory,
         store: Store, angle: bool, profile: Any) -> None:
    """Store the output of [0, x] of a step; `cut` is the end of the engine cycle in it."""
    state, _, _, work, _, output = memory
    shell.keep_loads(store.loads, work.rows, degree, step.unit, x, cut, output.cycle, terms.linear, work.bernstein)
    if profile is None:
        begun = (first + output.cycle) * limits.period
    else:
        begun = float(profile[STARTED])
    if store.per_cycle > 0:
        shell.keep_samples(work.rows, degree, step.unit, x, state.tau, limits.period, store, output, angle)
    behind = shell.keep_modes(work.rows, degree, step.unit, x, cut, begun + state.tau, limits.speeds.stick, output,
                              store.transitions, store.loads, work.bernstein)
    shell.keep_cycle(work.rows, degree, x, cut, behind, output, store.cycles, work.bernstein)


@fast
def finish(degree: int, x: float, whole: bool, setup: Setup, memory: Memory, angle: bool) -> None:
    """Bring the state to the end of a step."""
    limits, _, _, _, tables = setup
    state, control, _, work, _, _ = memory
    if whole and control.method != smoothed.SERIES:
        smoothed.state_at_end(tables.step_sizes[control.level], tables.sources, control.level, limits.kappa, work,
                              state)
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
    excite(tau, state.shift, loaded, terms, waves, terms.pulsation, terms.profile, drive)
    place = region_of(state, loaded, control, limits, terms, drive)
    friction = smoothed.friction_here(place, state, limits, terms, drive)
    if smoothed.choose_method(place, friction, edge - tau, state, control, limits, terms, drive, tables):
        return shell.GOES_ON
    method = control.method
    step, x = step_on(place, friction, edge - tau, stop - tau, loaded, setup, memory, tangent)
    if step.status == smoothed.REFUSED:
        counters.rejected += 1
        control.streak = 0
        smoothed.leave_if_short(control, limits, tables)
        return shell.GOES_ON
    if not x > 0.0:
        return shell.STEP_TOO_SMALL if x == 0.0 else shell.NOT_FINITE
    degree = step.degree if method == smoothed.SERIES or not angle else step.degree + 1  # theta1 is an integral.
    crossing = first_boundary(place, degree, x, method, loaded, limits, terms.stribeck, work)
    reached = x * step.unit >= (stop - tau) * (1.0 - 1e-14)
    if crossing == 0.0 and place.region != LAYER:  # Rounding of a step that was cut there left the state outside.
        state.slip_speed = place.sign * edge_of(place, limits)
        return shell.GOES_ON
    if 0.0 < crossing < x:
        x = crossing
        reached = False
        to_bernstein(work.rows, SLIP, degree, x, work.bernstein)
    whole = x == step.x
    after = stop if reached else tau + x * step.unit
    cut = shell.end_of_cycle(tau, after, period, step.unit, x)
    complete(step, degree, whole, cut, setup, memory, store, angle)
    if tangent is not None:
        carry(tangent, method, place, step, degree, x, whole, cut, loaded, setup, memory)
    keep(step, degree, x, cut, first, limits, terms, memory, store, angle, terms.profile)
    finish(degree, x, whole, setup, memory, angle)
    state.tau = after
    if not abs(state.slip_speed + state.plate_angle + state.plate_speed) < math.inf:
        return shell.NOT_FINITE
    counters.steps += 1
    if after >= period:
        smoothed.begin_cycle(state, control, limits)
    smoothed.after_step(step, x, control, limits, tables)
    return shell.GOES_ON


integrate = shell.loop_by(start, take_step, "smoothed")
through = shell.loop_through(integrate, "smoothed")


STEPS_AT_FIRST, STEPS_OF_PIECE = 400_000, 100
"""Steps of a solve beside those allowed to its cycles, and those for each piece of an excitation that varies in time: a
measured one has a piece for each sample.
"""
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
        frequency = terms.profile[:, FREQUENCY]
        longest, period = 2.0 * math.pi / float(frequency.min()), 2.0 * math.pi / float(frequency.max())
    limits = smoothed.limits_of(terms, terms_of(system), period, rtol, excess)
    waves = series.waves_of(terms)
    top, levels = collocation.ladder_of(limits.rates.fastest, longest)
    if terms.profile is None:
        tables = collocation.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms), top, levels)
    else:
        limits = limits._replace(steps=steps_allowed(terms, longest))
        levels += math.ceil(2.0 * math.log2(longest / period))
        tables = collocation.tables(terms.linear, None, 0.0, top, levels)
    terms = terms._replace(linear=completed(terms.linear), torque=None, harmonics=None)  # The sines are the waves.
    return Setup(limits, terms, system.pressure.frequency_ratio, waves, tables)


def _varying(problem: Problem, setup: Setup, profile: Floats) -> Iterator[Stretch]:
    """Yield the calls engine cycle by engine cycle, each from corner to corner."""
    first, count, terms = problem.start_cycle, problem.whole_cycles, setup.terms
    starts = problem.system.cycle_start(first + np.arange(count + 2)).tolist()
    times, row = profile[:, TIME].copy(), np.empty(profile.shape[1])  # A search in a column would copy it each time.
    for n in range(count + 1):
        start, following = starts[n], starts[n + 1]
        period, end = following - start, problem.end if n == count else following
        if end - start < NEAR * period:
            return
        near = NEAR * period
        inner = times[np.searchsorted(times, start + near, "right"):np.searchsorted(times, end - near)]
        edges = np.concatenate([[start], inner, [end]])
        whole = (n < count) & (edges[1:] == following)
        rows = profile_rows(profile, times, edges, series.load_phase(setup.ratio, terms.pulsation, first + n))
        varied = setup._replace(limits=setup.limits._replace(period=period), terms=terms._replace(profile=row))
        tails = np.where(whole, 0.0, edges[1:] - start)
        yield through, (n + whole.astype(np.int64), tails, rows, np.zeros(1, np.int64)), varied


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives."""
    # The derivative of mubar by mu_s/mu_k decays with slip as exp(-alpha |v|), even for mu_s/mu_k near 1.
    setup = setup_of(system, terms, rtol, 1.0 if changes[of.EXCESSES].any() else 0.0)
    ladder = collocation.ladder_of(setup.limits.rates.fastest, system.cycle)
    return setup._replace(tables=setup.tables._replace(torque=collocation.response(terms.linear, *ladder).torque))


def most_steps(setup: Setup, cycles: int) -> int:
    """Return the most steps of a solve of so many engine cycles."""
    count = 0 if setup.terms.profile is None else len(setup.terms.profile)
    allowed: int = setup.limits.steps * cycles
    return STEPS_AT_FIRST + allowed + STEPS_OF_PIECE * count


def stretches(problem: Problem, setup: Setup) -> Iterator[Stretch]:
    """Yield calls of many cycles, or, where the excitation varies in time, piece by piece."""
    if setup.terms.profile is not None:
        yield from _varying(problem, setup, setup.terms.profile)
        return
    for cycles in range(BATCH, problem.whole_cycles, BATCH):
        yield integrate, (cycles, 0.0), setup
    yield integrate, (problem.whole_cycles, problem.rest), setup


MEMORY = Memory(smoothed.STATE, smoothed.CONTROL, series.DRIVE, collocation.WORK, shell.COUNTERS, shell.OUTPUT)
ENGINE = EngineShell("smoothed", integrate, MEMORY, SHARED, prepared, setup_of_changes, most_steps,
                     lambda setup, cycles: MORE_STEPS * setup.limits.steps * cycles,
                     lambda ended, *_: "the state grew without bound" if ended == shell.NOT_FINITE else "",
                     transitions_per_cycle=256, stretches=stretches, bound=collocation.ITERATIONS_MAXIMUM)
solve = ENGINE.solve
