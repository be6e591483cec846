"""The tangent over a step of any method, up to where the step is taken, and with it that of the largest slip speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import BERNSTEIN
from tcc_sim.solvers.collocation import NODES
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.key_derivatives import LOG_FREQUENCY
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.solvers.smoothed.collocation_step import fill_plate
from tcc_sim.solvers.smoothed.sensitivity_series import LANES
from tcc_sim.solvers.smoothed.sensitivity_step import carry_collocation, carry_series, end_collocation, look_at
from tcc_sim.solvers.smoothed.series_step import Friction, law_here
from tcc_sim.solvers.smoothed.setup import LAYER, SERIES, Limits, Memory, Place, Step
from tcc_sim.solvers.terms import Terms

GAUSS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(6))
"""Half the abscissae and weights of the six-point rule, by which integrals along a step are taken."""
PIECES = 4
"""Parts of a step that it is applied to."""
SAMPLES = 8
"""Parts of a step in which the largest |slip speed| is looked for before Newton's method."""


@fast
def slip_change(group: Any, lane: int, order: int, x: float, series: bool, shared: Any) -> float:
    """Change of the slip speed at x, at constant time; a collocation step has been looked at there."""
    if series:
        out = group.rows[0, order, lane]
        for k in range(order - 1, -1, -1):
            out = out * x + group.rows[0, k, lane]
        return float(out)
    out = shared.slip[0] * group.now[0, lane]
    for n in range(NODES):
        out += shared.slip[n + 1] * group.nodes[lane, n]
    return float(out)


@fast
def peak_between(rows: Any, degree: int, low: float, high: float) -> float:
    """Where |slip speed| is largest in [low, high]."""
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
def carry_peak(tangent: Any, order: int, degree: int, low: float, high: float, series: bool, rung: Any, rows: Any,
               work: Any) -> None:
    """Take the largest |slip speed| of a part of a step, with its change, where it is the largest of the cycle so far.

    The first row of work.bernstein holds the Bernstein coefficients of the slip speed over the step.
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
        look_at(at, rung, shared)
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        for lane in range(LANES):
            group.peak[lane] = sign * (slip_change(group, lane, order, at, series, shared)
                                       - group.by[LOG_FREQUENCY, lane] * at * slope)


@fast
def add_slopes(slopes: Any, low: float, high: float, unit: float, degree: int, loaded: bool, limits: Limits,
               mean_load: float, pulsation: tuple[float, float, float] | None, stribeck: Stribeck, drive: Any,
               rows: Any) -> None:
    """Add a piece's integrals over time of dT/dv v^2, v^2 and min(dT/dv, 0), those of (21)."""
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
    """`add_slopes` over [0, x] of a step, in pieces that end where |v| passes the peak of mubar: dT/dv has a kink there
    once it is limited.
    """
    for i in range(PIECES):
        low, high = x * i / PIECES, x * (i + 1) / PIECES
        inside = abs(polynomial.value(rows, SLIP, degree, low)) < limits.stick_speed
        at = high
        if (abs(polynomial.value(rows, SLIP, degree, high)) < limits.stick_speed) != inside:
            begin = low
            for _ in range(50):
                middle = 0.5 * (begin + at)
                if (abs(polynomial.value(rows, SLIP, degree, middle)) < limits.stick_speed) != inside:
                    at = middle
                else:
                    begin = middle
        add_slopes(slopes, low, at, unit, degree, loaded, limits, terms.mean_load, terms.pulsation, terms.stribeck,
                   drive, rows)
        if at < high:
            add_slopes(slopes, at, high, unit, degree, loaded, limits, terms.mean_load, terms.pulsation,
                       terms.stribeck, drive, rows)


@fast
def end_cycle(tangent: Any, cycle: int) -> None:
    """Keep what the largest |slip speed| of a cycle changes by."""
    for i in range(tangent.groups.shape[0]):
        for lane in range(LANES):
            tangent.peaks[cycle, i, lane] = tangent.groups[i].peak[lane]
    tangent.shared.peak = -1.0


@fast
def carry(tangent: Any, method: int, place: Place, friction: Friction, step: Step, degree: int, x: float, whole: bool,
          cut: float, loaded: bool, setup: Any, memory: Memory) -> None:
    """Carry the tangent over [0, x] of a step that starts where the state is now; the rest as `integrate.integrate`.

    Parameters
    ----------
    degree : of the polynomial of the slip speed
    cut : where the engine cycle ends; beyond x where it does not
    setup : `integrate.Setup`
    """
    limits, terms, _, waves, tables = setup
    drive, work, level, order = memory.drive, memory.work, memory.control.level, step.degree
    rows, series = work.rows, method == SERIES
    rung = tables.rungs[level]
    if series:
        carry_series(tangent, place, friction, step, loaded, limits, terms, waves, drive, rows, terms.pulsation,
                     terms.stribeck)
    else:
        fill_plate(rung, tables.sources, level, limits.kappa, work)
        carry_collocation(tangent, place, level, loaded, limits, waves, tables, drive, work, terms.pulsation,
                          terms.stribeck)
    if tangent.shared.averaged:
        average_slopes(tangent.shared.slopes, x, step.unit, degree, loaded, limits, terms, drive, rows)
    carry_peak(tangent, order, degree, 0.0, min(cut, x), series, rung, rows, work)
    if cut <= x:
        end_cycle(tangent, memory.output.cycle)
        carry_peak(tangent, order, degree, cut, x, series, rung, rows, work)
    if not series:
        end_collocation(tangent, level, x, whole, limits, tables)
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        now, by = group.now, group.by
        if series:
            for c in range(3):
                for lane in range(LANES):
                    now[c, lane] = group.rows[c, order, lane]
                for k in range(order - 1, -1, -1):
                    for lane in range(LANES):
                        now[c, lane] = now[c, lane] * x + group.rows[c, k, lane]
        if group.forced != 0:
            slip, angle, speed = (polynomial.value_and_slope(rows, SLIP, degree, x)[1],
                                  polynomial.value_and_slope(rows, ANGLE, degree, x)[1],
                                  polynomial.value_and_slope(rows, SPEED, degree, x)[1])
            for lane in range(LANES):
                now[0, lane] -= by[LOG_FREQUENCY, lane] * x * slip
                now[1, lane] -= by[LOG_FREQUENCY, lane] * x * angle
                now[2, lane] -= by[LOG_FREQUENCY, lane] * x * speed
