"""Derivatives of the smoothed engine's steps by the state and by numbers of the scene.

The method is differentiated: a series step coefficient by coefficient (`carry_series`), a collocation step at its
nodes, by the matrix of its last Newton step. The largest slip speed of every cycle has derivatives too. At the edges of
the regions, of the clamp and at v = 0 the accelerations are continuous, so that derivatives do not jump there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model.friction import Stribeck
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import BERNSTEIN
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import LANES, carry_slip, changed_at, end_changes, expand_sines, hold_phase
from tcc_sim.solvers.collocation import (
    DEGREE,
    FROM_ANGLE,
    FROM_SPEED,
    LAYER,
    NODES,
    SLIDING,
    TERMS,
    TO_CHEBYSHEV,
    C,
    Place,
    eliminate_rows,
    law_at_nodes,
)
from tcc_sim.solvers.engine import Memory, Setup
from tcc_sim.solvers.law import mubar_at, numbers_of
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED, Pulsation, added, fastest_at
from tcc_sim.solvers.smoothed import SERIES, Limits, LocalFriction, Step, fill_plate, law_here
from tcc_sim.solvers.terms import Terms

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
def resolved(step: Step, place: Place, friction: LocalFriction, rows: Any, stribeck: Stribeck, control: Any,
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
def carry_series(tangent: Any, place: Place, friction: LocalFriction, step: Step, loaded: bool, limits: Limits,
                 terms: Terms, waves: Any, drive: Any, rows: Any, pulsation: Pulsation, stribeck: Stribeck) -> None:
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
    law_at_nodes(place, limits.sigma, stribeck, work)
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
        eliminate_rows(0, nodes, step_size.coupling, work.friction_rate, work.slope)


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
            shared.slip[j] += TO_CHEBYSHEV[j, i] * basis[i]
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
def slip_change(group: Any, lane: int, shared: Any) -> float:
    """Return the derivative of the slip speed at the x of `look_at`, at constant time."""
    out = shared.slip[0] * group.now[0, lane]
    for n in range(NODES):
        out += shared.slip[n + 1] * group.nodes[lane, n]
    return float(out)


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
def carry_peak(tangent: Any, order: int, degree: int, low: float, high: float, series: bool, step_size: Any, rows: Any,
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
    if not series:
        look_at(at, step_size, shared)
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        for lane in range(LANES):
            if series:
                group.peak[lane] = sign * changed_at(group, SLIP, lane, order, degree, at, rows)
            else:
                group.peak[lane] = sign * (slip_change(group, lane, shared)
                                           - group.by[of.LOG_FREQUENCY, lane] * at * slope)


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
        slope = load * law_here(v, 1.0 if v > 0.0 else -1.0, LAYER, limits.sigma, stribeck)[1]
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
def carry(tangent: Any, method: int, place: Place, friction: LocalFriction, step: Step, degree: int, x: float,
          whole: bool, cut: float, loaded: bool, setup: Setup, memory: Memory) -> None:
    """Carry the tangent over [0, x] of a step that starts where the state is now; the rest as `integrate.integrate`.

    Parameters
    ----------
    degree : of the polynomial of the slip speed
    cut : where the engine cycle ends; beyond x where it does not
    """
    limits, terms, _, waves, tables = setup
    drive, work, level, order = memory.drive, memory.work, memory.control.level, step.degree
    rows, series = work.rows, method == SERIES
    step_size = tables.step_sizes[level]
    if series:
        carry_series(tangent, place, friction, step, loaded, limits, terms, waves, drive, rows, terms.pulsation,
                     terms.stribeck)
    else:
        fill_plate(step_size, tables.sources, level, limits.kappa, work)
        carry_collocation(tangent, place, level, loaded, limits, waves, tables, drive, work, terms.pulsation,
                          terms.stribeck)
    if tangent.shared.extended:
        average_slopes(tangent.shared.slopes, x, step.unit, degree, loaded, limits, terms, drive, rows)
    carry_peak(tangent, order, degree, 0.0, min(cut, x), series, step_size, rows, work)
    if cut <= x:
        keep_peak(tangent, memory.output.cycle)
        carry_peak(tangent, order, degree, cut, x, series, step_size, rows, work)
    if not series:
        end_collocation(tangent, level, x, whole, limits, tables)
    for i in range(tangent.groups.shape[0]):
        if series:
            end_changes(order, tangent.groups[i].now, tangent.groups[i].rows, x)
        if tangent.groups[i].forced != 0:
            hold_phase(tangent.groups[i], degree, x, rows)
