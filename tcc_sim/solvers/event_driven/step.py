"""One step of an arc: Taylor polynomials of the motion in its mode, their length, and the event that ends it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from tcc_sim.compiling.compiled import exponentials_at, fast, lost_torque, steepness
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model import equations
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers import series
from tcc_sim.solvers.event_driven.setup import Bounds
from tcc_sim.solvers.excitation import expand_excitation
from tcc_sim.solvers.series import ANGLE, ENGINE, INVERSE, LOAD, ROWS, SLIP, SPEED
from tcc_sim.trajectory import FREE

UPWARD, DOWNWARD = ROWS, ROWS + 1
"""Rows of the margins to breakaway, N m: r Ts - lambda and r Ts + lambda."""

LINEAR_ORDER = 28
"""Order where all is linear: a term costs little there, and steps grow in proportion to it."""
FALLING_ORDER = 22
"""Order where the friction coefficient varies: a term costs in proportion to its order."""
SHORTENING = 0.95
TYPICAL = 2.0
"""About how many units of time a step lasts."""
NO_EVENT, BREAKAWAY, REST, LAW_VARIES = range(4)


class Step(NamedTuple):
    """A step of length x * unit (s), with polynomials of this degree in time/unit, to an event.

    direction : of slip after a breakaway
    reach : bound on the change of the slip speed, rad/s
    """

    unit: float
    x: float
    degree: int
    event: int
    direction: int
    reach: float


def stuck(rows: Any, unit: Any, linear: Any, ratio: Any, pulsation: Any) -> Iterator[int]:
    """Fill the coefficients of flywheel and plate as one, and of the margins to breakaway; staged function.

    (I1 + I2) theta2'' + C23 theta2' + K23 theta2 = Te, and lambda = (I2 Te + I1 (C23 theta2' + K23 theta2))/(I1 + I2).
    """
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    both = flywheel + plate
    share, other, pace = flywheel / both, plate / both, unit / both
    x, u = rows[ANGLE, 0], rows[SPEED, 0]
    for k in range(LINEAR_ORDER + 1):
        spring = damping * u + stiffness * x
        torque = rows[ENGINE, k] - equations.lost_torque(0.0, u, None, linear.flywheel_by_speed)
        need = share * spring + other * torque
        load = ratio * rows[LOAD, k] if pulsation is not None or k == 0 else 0.0
        rows[UPWARD, k] = load - need
        rows[DOWNWARD, k] = load + need
        if k < LINEAR_ORDER:
            part = 1.0 / (k + 1)
            x, u = part * unit * u, part * pace * (torque - spring)
            rows[ANGLE, k + 1], rows[SPEED, k + 1] = x, u
    yield LINEAR_ORDER


expand_stuck = unrolled(stuck)


@fast
def stick_arc(bounds: Bounds, linear: Linear, mean_torque: float, waves: Any, mean_load: float,
              pulsation: tuple[float, float, float] | None, state: Any, drive: Any, remaining: float, rows: Any,
              workspace: Any) -> Step:
    """Return a step in stick of at most `remaining` seconds, to breakaway where |lambda| = r Ts."""
    unit = 1.0 / bounds.stick_rate
    expand_excitation(rows, LINEAR_ORDER + 1, unit, state.tau, True, mean_torque, waves, mean_load, pulsation, None,
                      drive)
    for k in range(LINEAR_ORDER + 1):
        rows[SLIP, k] = 0.0
    rows[ANGLE, 0] = state.plate_angle
    rows[SPEED, 0] = state.plate_speed
    expand_stuck(LINEAR_ORDER, rows, unit, linear, bounds.ratio, pulsation)
    torque = bounds.torque_tolerance * 1e12
    longest = series.ENDLESS
    for k in range(LINEAR_ORDER - 1, LINEAR_ORDER + 1):
        size = max(abs(rows[UPWARD, k]), abs(rows[DOWNWARD, k])) / torque
        size = max(size, abs(rows[SPEED, k]) / bounds.speed_scale)
        if size > 0.0:
            longest = min(longest, series.logarithm(bounds.truncation / size) * INVERSE[k])
    x = min(remaining / unit, SHORTENING * series.power_of_two(longest))
    return stick_event(bounds, unit, x, LINEAR_ORDER, rows, workspace)


@fast
def stick_event(bounds: Bounds, unit: float, x: float, order: int, rows: Any, workspace: Any) -> Step:
    """Return a step in stick up to x, or to the first zero of a margin to breakaway."""
    tolerance = bounds.torque_tolerance
    power, upward, downward = x, 0.0, 0.0
    for k in range(1, order + 1):
        upward += abs(rows[UPWARD, k]) * power
        downward += abs(rows[DOWNWARD, k]) * power
        power *= x
    if rows[UPWARD, 0] > upward + tolerance and rows[DOWNWARD, 0] > downward + tolerance:
        return Step(unit, x, order, NO_EVENT, 0, 0.0)
    up = polynomial.first_crossing(rows, UPWARD, order, x, 1.0, 0.0, tolerance, workspace)
    down = polynomial.first_crossing(rows, DOWNWARD, order, x, 1.0, 0.0, tolerance, workspace)
    if min(up, down) <= x:
        return Step(unit, min(up, down), order, BREAKAWAY, 1 if up < down else -1, 0.0)
    return Step(unit, x, order, NO_EVENT, 0, 0.0)


@fast
def series_length(rows: Any, order: int, x: float, truncation: float, scale: float) -> float:
    """Return the length, at most x, at which the last two terms are `truncation` times the largest of the first terms
    of the slip speed, and times `scale` for the plate speed.
    """
    largest, at, power = 0.0, 0, 1.0
    for i in range(4):
        term = abs(rows[SLIP, i]) * power
        if term > largest:
            largest, at = term, i
        power *= TYPICAL
    longest = series.ENDLESS
    for k in range(order - 1, order + 1):
        last = abs(rows[SLIP, k])
        if last > 0.0 and largest > 0.0:
            longest = min(longest, series.logarithm(truncation * abs(rows[SLIP, at]) / last) * INVERSE[k - at])
        last = abs(rows[SPEED, k])
        if last > 0.0:
            longest = min(longest, series.logarithm(truncation * scale / last) * INVERSE[k])
    return float(min(x, SHORTENING * series.power_of_two(longest)))


@fast
def monotone(rows: Any, order: int, x: float, reach: float) -> bool:
    """Return whether the slip speed is certainly monotone over [0, x]; `reach` bounds its change."""
    first = abs(rows[SLIP, 1])
    if reach > 4.0 * first * x:
        return False
    rest, power = 0.0, x
    for k in range(2, order + 1):
        rest += k * abs(rows[SLIP, k]) * power
        power *= x
    return bool(rest < 0.999 * first)


@fast
def returning_at(stribeck: tuple[float, ...], speed: float) -> float:
    """Return the slip speed at which the next exponential that has died down at this speed counts again, 0 for none."""
    level, rate = 0.0, series.fastest_at(stribeck, speed)
    for j in range(0, len(stribeck), 2):
        if stribeck[j + 1] > rate:
            level = max(level, 36.0 / stribeck[j + 1])  # Below 40, where `fastest_at` counts it.
    return level


@fast
def accelerations_at(linear: Linear, v: float, state: Any, engine: float, friction: float) -> tuple[float, float]:
    """Return v' and omega2' of a state with the slip speed v, rad/s^2, for given engine and friction torque."""
    pull = (friction - linear.damping * state.plate_speed - linear.stiffness * state.plate_angle
            - lost_torque(v, state.plate_speed, linear.plate_by_slip, None))
    push = engine - friction - lost_torque(v, state.plate_speed, linear.flywheel_by_slip, linear.flywheel_by_speed)
    return push / linear.flywheel - pull / linear.plate, pull / linear.plate


@fast
def slip_arc(bounds: Bounds, linear: Linear, mean_torque: float, waves: Any, mean_load: float,
             pulsation: tuple[float, float, float] | None, stribeck: Stribeck, state: Any, drive: Any,
             remaining: float, rows: Any, workspace: Any) -> Step:
    """Return a step in slip, or without load, of at most `remaining` s, to v = 0, or to the speed `far`."""
    mode, v = state.mode, state.slip_speed
    sign = 0.0 if mode == FREE else float(mode)
    rows[SLIP, 0] = v
    rows[ANGLE, 0] = state.plate_angle
    rows[SPEED, 0] = state.plate_speed
    level = 0.0
    order = LINEAR_ORDER
    unit = 1.0 / bounds.slip_rate
    falling = False
    if stribeck is not None and mode != FREE:
        level = bounds.far
        if sign * v <= 1.01 * level:
            level = returning_at(stribeck, sign * v)
            falling = True
            order = FALLING_ORDER
            excess, total, _ = exponentials_at(sign * v, stribeck)
            friction = sign * drive.load * (1.0 + total)
            acceleration = abs(accelerations_at(linear, v, state, drive.torque, friction)[0])
            slope = (1.0 / linear.flywheel + 1.0 / linear.plate) * drive.load * steepness(sign * v, stribeck)
            unit = 1.0 / (bounds.slip_rate + series.fastest_at(stribeck, sign * v) * acceleration + slope)
            expand_excitation(rows, order, unit, state.tau, True, mean_torque, waves, mean_load, pulsation, None, drive)
            series.expand(order, rows, unit, linear, sign, pulsation, stribeck, excess, None, None, None)
    if not falling:
        expand_excitation(rows, order, unit, state.tau, mode != FREE, mean_torque, waves, mean_load, pulsation, None,
                          drive)
        series.expand(order, rows, unit, linear, sign, pulsation, None, None, None, None, None)
    longest = remaining / unit
    x = series_length(rows, order, longest, bounds.truncation, bounds.speed_scale)
    if stribeck is not None and falling:
        # Where alpha |change of v| is large the terms of the exponential rise before they fall.
        fastest = series.fastest_at(stribeck, sign * v)
        while fastest * (abs(rows[SLIP, 1]) * x + abs(rows[SLIP, 2]) * x * x) > 0.4 * order:
            x *= 0.8
    return slip_event(bounds, unit, x, order, level, state, rows, workspace)


@fast
def slip_event(bounds: Bounds, unit: float, x: float, order: int, level: float, state: Any, rows: Any,
               workspace: Any) -> Step:
    """Return a step in slip up to x, or to the fall of |v| to `level`: 0, or where mubar begins to vary."""
    sign = float(state.mode)
    reach = polynomial.variation(rows, SLIP, order, x)
    if state.mode == FREE or sign * rows[SLIP, 0] - reach > level + bounds.slip_tolerance:
        return Step(unit, x, order, NO_EVENT, 0, reach)
    if sign * rows[SLIP, 1] > 0.0 and sign * rows[SLIP, 0] >= level and monotone(rows, order, x, reach):
        return Step(unit, x, order, NO_EVENT, 0, reach)
    if state.at_rest == 1 and sign * rows[SLIP, 1] < 0.0:
        # The forces have set this direction; a fall of slip is the error of the arc before, up to its truncation.
        rows[SLIP, 1] = 0.0
    end = polynomial.first_crossing(rows, SLIP, order, x, sign, level, bounds.slip_tolerance, workspace)
    if end <= x:
        return Step(unit, end, order, REST if level == 0.0 else LAW_VARIES, 0, reach)
    return Step(unit, x, order, NO_EVENT, 0, reach)
