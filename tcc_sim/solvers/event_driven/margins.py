"""How far a motion is from another event sequence, with derivatives: what vanishes at a bifurcation with sliding.

M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002). Each
margin is taken from the polynomials of the steps, its smallest value over the motion is kept.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.model.equations import Linear
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import (
    BERNSTEIN,
    HALVINGS,
    LEFT,
    WIDTH,
    WORKSPACE,
    search_on,
    slope_changes,
    to_bernstein,
)
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.event_driven.sensitivity import LANES, Rates
from tcc_sim.solvers.event_driven.step import DOWNWARD, UPWARD, Step
from tcc_sim.solvers.series import ANGLE, ENGINE, LOAD, SLIP, SPEED, sine_and_cosine
from tcc_sim.trajectory import FREE, STICK

GRAZING, ARRIVAL, STUCK = range(3)
"""Rows of margins: |v| at its smallest extremum in slip, rad/s; r Ts + sgn(v) lambda where slip ends, N m (negative
where slip goes on the other way), the one nearest to 0; r Ts - |lambda| at its smallest minimum in stick, N m."""
VALUE, GROWS, GRADIENT = 0, 1, 2
"""Columns of margins: the value; 1 where stick's margin grows at that end of slip; derivatives by the disturbances."""


@fast
def root_of_slope(c: Any, row: int, degree: int, low: float, high: float, sign: float) -> float:
    """Where the slope of sign * polynomial rises through 0 between low and high."""
    x = 0.5 * (low + high)
    for _ in range(80):
        slope, curvature = polynomial.slope_and_curvature(c, row, degree, x)
        if sign * slope < 0.0:
            low = x
        else:
            high = x
        following = polynomial.newton_within(low, high, x, slope, curvature)
        if abs(following - x) <= 1e-15 * high:
            return float(following)
        x = following
    return x


@fast
def smallest_dip(c: Any, row: int, degree: int, x_end: float, sign: float, below: float,
                 workspace: Any) -> tuple[float, float]:
    """The smallest local minimum of sign * polynomial within (0, x_end), and its place; (below, -1) where none is
    lower.

    Every interval on which the slope changes its sign once is found by Descartes' rule, as in `polynomial.extremes_of`.
    """
    to_bernstein(c, row, degree, x_end, workspace)
    for i in range(WORKSPACE[1]):
        workspace[1, i] = workspace[BERNSTEIN, i]
    top, place = 1, -1.0
    shortest = x_end * 2.0 ** -HALVINGS
    while top > 0:
        changes, last, least = 0, 0.0, math.inf
        for i in range(degree + 1):
            least = min(least, sign * workspace[top, i])
        if least < below:
            changes, _, last = slope_changes(workspace, top, degree)
        if changes == 1 and sign * last > 0.0:
            left, width = workspace[top, LEFT], workspace[top, WIDTH]
            x = root_of_slope(c, row, degree, left, left + width, sign)
            value = sign * polynomial.value(c, row, degree, x)
            if value < below and 0.0 < x < x_end:
                below, place = value, x
        top = search_on(workspace, top, degree, changes, shortest)
    return below, place


@fast
def torque_change(number: Any, plate_angle: float, plate_speed: float, engine: float, engine_change: float,
                  angle_change: float, speed_change: float, linear: Linear) -> float:
    """Derivative of the interface torque lambda = (I2 Te + I1 (C23 theta2' + K23 theta2))/(I1 + I2) in stick's form."""
    flywheel, plate, damping, stiffness = linear
    both = flywheel + plate
    spring = damping * plate_speed + stiffness * plate_angle
    torque = (plate * engine + flywheel * spring) / both
    inertia_change = number[of.FLYWHEEL_INERTIA] + number[of.PLATE_INERTIA]
    spring_change = (number[of.DAMPING] * plate_speed + number[of.STIFFNESS] * plate_angle
                     + damping * speed_change + stiffness * angle_change)
    return float((number[of.PLATE_INERTIA] * engine + number[of.FLYWHEEL_INERTIA] * spring + plate * engine_change
                  + flywheel * spring_change - torque * inertia_change) / both)


@fast
def lane_value(series: Any, which: int, lane: int, order: int, s: float) -> float:
    """A disturbance within a step, at the share s of its length."""
    out = 0.0
    for k in range(order, -1, -1):
        out = out * s + series[3 * k + which, lane]
    return out


@fast
def note_step(mode: int, order: int, x: float, rows: Any, least: Any, places: Any,
              workspace: Any) -> bool:
    """Look for smaller margins within a step; True where there is one, at the share places[.] of the step's length."""
    places[GRAZING] = -1.0
    places[STUCK] = -1.0
    if mode == STICK:
        for row in (UPWARD, DOWNWARD):
            value, at = smallest_dip(rows, row, order, x, 1.0, least[STUCK, VALUE], workspace)
            if at > 0.0:
                least[STUCK, VALUE] = value
                places[STUCK] = at / x
                places[ARRIVAL] = 1.0 if row == UPWARD else -1.0
    elif mode != FREE:
        value, at = smallest_dip(rows, SLIP, order, x, float(mode), least[GRAZING, VALUE], workspace)
        if at > 0.0 and value > 0.0:
            least[GRAZING, VALUE] = value
            places[GRAZING] = at / x
    return bool(places[GRAZING] > 0.0 or places[STUCK] > 0.0)


@fast
def excitation_change(number: Any, tau: float, shift: float, rates: Rates) -> tuple[float, float]:
    """Derivatives of Te and Ts by a disturbance, tau seconds into the cycle."""
    sine, _ = sine_and_cosine(rates.engine * tau)
    load_sine, load_cosine = sine_and_cosine(rates.load * tau + shift)
    engine = number[of.MEAN_TORQUE] + number[of.TORQUE_AMPLITUDE] * sine
    return engine, (number[of.MEAN_LOAD] + number[of.LOAD_AMPLITUDE] * load_sine
                    + number[of.LOAD_PHASE] * rates.amplitude * load_cosine)


@fast
def note_gradient(mode: int, step: Step, block: int, tau: float, shift: float, rates: Rates, numbers: Any,
                  linear: Linear, ratio: float, work: Any, least: Any, places: Any) -> None:
    """Derivatives of the margins that `note_step` has found in a step from `tau`, by the disturbances of a block."""
    order, length = step.degree, step.x * step.unit
    for lane in range(LANES):
        column = GRADIENT + block * LANES + lane
        if places[GRAZING] > 0.0:
            least[GRAZING, column] = mode * lane_value(work.series, 0, lane, order, places[GRAZING])
        if places[STUCK] > 0.0:
            s, number = places[STUCK], numbers[block * LANES + lane]
            engine, load = excitation_change(number, tau + s * length, shift, rates)
            need = torque_change(number, polynomial.value(work.rows, ANGLE, order, s),
                                 polynomial.value(work.rows, SPEED, order, s),
                                 polynomial.value(work.rows, ENGINE, order, s), engine,
                                 lane_value(work.series, 1, lane, order, s),
                                 lane_value(work.series, 2, lane, order, s), linear)
            strength = ratio * load + number[of.EXCESS_RATIO] * polynomial.value(work.rows, LOAD, order, s)
            least[STUCK, column] = strength - places[ARRIVAL] * need


@fast
def note_arrival(mode: int, state: Any, drive: Any, rates: Rates, numbers: Any,
                 linear: Linear, ratio: float, columns: Any, least: Any) -> None:
    """The margin where slip in direction `mode` ends, before the disturbances are taken over."""
    flywheel, plate, damping, stiffness = linear
    both = flywheel + plate
    spring = damping * state.plate_speed + stiffness * state.plate_angle
    margin = ratio * drive.load + mode * (plate * drive.torque + flywheel * spring) / both
    friction = mode * ratio * drive.load
    speed_rate = (friction - spring) / plate
    slip_rate = (drive.torque - friction) / flywheel - speed_rate
    if abs(margin) >= abs(least[ARRIVAL, VALUE]) or slip_rate == 0.0:
        return
    least[ARRIVAL, VALUE] = margin
    stuck_rate = (drive.torque - spring) / both
    still = (ratio * drive.load_rate
             + mode * (plate * drive.torque_rate + flywheel * stiffness * state.plate_speed) / both)
    least[ARRIVAL, GROWS] = 1.0 if still + mode * flywheel * damping * stuck_rate / both > 0.0 else 0.0
    rate = still + mode * flywheel * damping * speed_rate / both
    for b in range(columns.shape[0]):
        for lane in range(LANES):
            number = numbers[b * LANES + lane]
            engine, load = excitation_change(number, state.tau, state.shift, rates)
            need = torque_change(number, state.plate_angle, state.plate_speed, drive.torque, engine,
                                 columns[b, 1, lane], columns[b, 2, lane], linear)
            least[ARRIVAL, GRADIENT + b * LANES + lane] = (ratio * load + number[of.EXCESS_RATIO] * drive.load
                                                           + mode * need - rate / slip_rate * columns[b, 0, lane])
