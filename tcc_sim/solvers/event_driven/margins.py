"""Margins of a motion to other event sequences, with derivatives: they vanish at bifurcations with sliding.

M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002). A
margin is the smallest value over the motion, from the polynomials of the steps.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.changing import Changing
from tcc_sim.compiling.compiled import fast, lost_torque
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model import equations
from tcc_sim.model.equations import Linear
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import (
    BERNSTEIN,
    HALVINGS,
    LEFT,
    WIDTH,
    WORKSPACE,
    search_on,
    slope_changes,
    to_bernstein,
)
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import LANES, OF_ENGINE, OF_LOAD, changed_at, changing_linear
from tcc_sim.solvers.engine import GRADIENT, GROWS, VALUE
from tcc_sim.solvers.event_driven.step import DOWNWARD, UPWARD, Step, accelerations_at
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.series import SLIP
from tcc_sim.trajectory import FREE, STICK

GRAZING, ARRIVAL, STUCK = range(3)
"""Rows of margins: |v| at its smallest extremum in slip, rad/s; r Ts + sgn(v) lambda at the end of slip, N m (negative
where slip goes on the other way), the one nearest to 0; r Ts - |lambda| at its smallest minimum in stick, N m."""


@fast
def root_of_slope(c: Any, row: int, degree: int, low: float, high: float, sign: float) -> float:
    """Return the place between low and high at which the slope of sign * polynomial rises through 0."""
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
    """Return the smallest local minimum of sign * polynomial within (0, x_end), and its place; (below, -1) if none is
    lower. Descartes' rule finds every interval with one change of sign of the slope, as in `polynomial.extremes_of`.
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


def arrival_change(out: Any, now: Any, by: Any, angle: Any, speed: Any, engine: Any, load: Any, sines: Any,
                   amplitude: Any, ratio: Any, side: Any, linear: Linear) -> None:
    """Fill the change of r Ts + side * lambda at constant phase, lambda in stick's form; staged function."""
    part = changing_linear(linear, by)
    flywheel, plate, turning = part.flywheel, part.plate, Changing(speed, now.row(2))
    sine, load_sine, load_cosine = sines
    spring = part.damping * turning + part.stiffness * Changing(angle, now.row(1))
    engine = Changing(engine, by.row(of.MEAN_TORQUE) + by.row(of.TORQUE_AMPLITUDE) * sine)
    engine = engine - equations.lost_torque(0.0, turning, None, part.flywheel_by_speed)
    load = Changing(load, by.row(of.MEAN_LOAD) + by.row(of.LOAD_AMPLITUDE) * load_sine
                    + by.row(of.LOAD_PHASE) * (amplitude * load_cosine))
    torque = (plate * engine + flywheel * spring) / (flywheel + plate)
    out.set_row((Changing(ratio, by.row(of.BREAKAWAY)) * load + Changing(side) * torque).change, 0)


change_arrival = unrolled(arrival_change)


@fast
def note_step(mode: int, order: int, x: float, rows: Any, least: Any, places: Any,
              workspace: Any) -> bool:
    """Search for smaller margins within a step; return whether there is one, at places[.] of the step."""
    places[GRAZING] = -1.0
    places[STUCK] = -1.0
    if mode == STICK:
        for row in (UPWARD, DOWNWARD):
            value, at = smallest_dip(rows, row, order, x, 1.0, least[STUCK, VALUE], workspace)
            if at > 0.0:
                least[STUCK, VALUE] = value
                places[STUCK] = at
                places[ARRIVAL] = 1.0 if row == UPWARD else -1.0
    elif mode != FREE:
        value, at = smallest_dip(rows, SLIP, order, x, float(mode), least[GRAZING, VALUE], workspace)
        if at > 0.0 and value > 0.0:
            least[GRAZING, VALUE] = value
            places[GRAZING] = at
    return bool(places[GRAZING] > 0.0 or places[STUCK] > 0.0)


@fast
def note_gradient(mode: int, order: int, block: int, group: Any, rows: Any, least: Any, places: Any) -> None:
    """Store the derivatives of the margins that `note_step` found in a step, by the disturbances of a group."""
    for lane in range(LANES):
        column = GRADIENT + block * LANES + lane
        if places[GRAZING] > 0.0:
            least[GRAZING, column] = mode * changed_at(group, SLIP, lane, order, order, places[GRAZING], rows)
        if places[STUCK] > 0.0:
            row = UPWARD if places[ARRIVAL] > 0.0 else DOWNWARD
            least[STUCK, column] = changed_at(group, row, lane, order, order, places[STUCK], rows)


@fast
def note_arrival(mode: int, step: Step, state: Any, drive: Any, linear: Linear, ratio: float, groups: Any,
                 sines: Any, pulsation: Pulsation, workspace: Any, least: Any) -> None:
    """Store the margin at the end of slip in direction `mode`, before the disturbances pass the event.

    sines : coefficients of `changes.expand_sines` over that step
    workspace : (LANES,)
    """
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    both = flywheel + plate
    spring = damping * state.plate_speed + stiffness * state.plate_angle
    engine = drive.torque - lost_torque(0.0, state.plate_speed, None, linear.flywheel_by_speed)
    margin = ratio * drive.load + mode * (plate * engine + flywheel * spring) / both
    friction = mode * ratio * drive.load
    slip_rate, speed_rate = accelerations_at(linear, 0.0, state, drive.torque, friction)
    if abs(margin) >= abs(least[ARRIVAL, VALUE]) or slip_rate == 0.0:
        return
    least[ARRIVAL, VALUE] = margin
    stuck_rate = (engine - spring) / both
    still = (ratio * drive.load_rate
             + mode * (plate * drive.torque_rate + flywheel * stiffness * state.plate_speed) / both)
    resisted = flywheel * damping - plate * lost_torque(0.0, 1.0, None, linear.flywheel_by_speed)
    least[ARRIVAL, GROWS] = 1.0 if still + mode * resisted * stuck_rate / both > 0.0 else 0.0
    rate = still + mode * resisted * speed_rate / both
    sine = polynomial.value(sines, OF_ENGINE, step.degree, step.x)
    load_sine, slope = polynomial.value_and_slope(sines, OF_LOAD, step.degree, step.x)
    now = sine, load_sine, slope / (pulsation[1] * step.unit)
    for b in range(groups.shape[0]):
        group = groups[b]
        change_arrival(0, workspace, group.now, group.by, state.plate_angle, state.plate_speed, drive.torque,
                       drive.load, now, pulsation[0], ratio, float(mode), linear)
        for lane in range(LANES):
            least[ARRIVAL, GRADIENT + b * LANES + lane] = workspace[lane] - rate / slip_rate * group.now[0, lane]
