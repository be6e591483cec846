"""Steps of the exact engine: its bounds, the arcs of each mode up to the event that ends them, and the next mode.

After the end of slip the torques and their rates decide on the mode, never the sign of a rounded slip speed: in stick
v = 0 exactly, and slip begins at v = 0 exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import exponentials_at, fast, lost_torque, steepness
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model.equations import Linear, coefficients_of, decay_of_slip
from tcc_sim.model.friction import Stribeck, exponentials, largest_ratio, sliding
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers import series
from tcc_sim.solvers.series import (
    ANGLE,
    ENGINE,
    FLYWHEEL,
    INVERSE,
    LOAD,
    ROWS,
    SLIP,
    SPEED,
    clamp_edge,
    excite,
    expand_excitation,
)
from tcc_sim.solvers.terms import Terms, excitation_frequency, peak_load, steps_allowed, torque_swing
from tcc_sim.trajectory import FREE, NEGATIVE, POSITIVE, STICK

EXACT = 1e-16
"""Truncation where every arc is linear: the arcs are exact to rounding at any tolerance."""
SHARE = 1.0
"""Truncation of one step per tolerance of a solve: sections are then good to that (medians over 50 starts of fig02 and
chaos, rtol 1e-4 to 1e-10), since it is the size of the last two terms, not of the error."""
FAR_SHARE = 1.5e-2
"""Exponential of (5), in tolerances, at the slip speed from which on it counts as 0."""

EVENTS = 1000
"""Events that any engine cycle may have."""
STEPS_ALLOWED = 50
"""Steps of an engine cycle with its sensitivity per those of `steps_allowed`: a heavy damper makes them short."""


class Bounds(NamedTuple):
    """Constants of a run; s, 1/s, rad/s, N m.

    period : one engine cycle
    ratio : r = mu_s/mu_k
    clamped : whether the pressure reaches 0
    slip_rate : sum of the rates of the plate on its spring and of the excitation
    stick_rate : the same for flywheel and plate as one
    slip_decay : sum of the rates of the linear part beside those of the plate on its shaft
    far : slip speed from which on mubar is 1 to the tolerance; 0 where it is 1 everywhere
    truncation : largest share of the last terms of a series
    torque_tolerance, slip_tolerance : torques, and slip speeds, closer than this are equal
    speed_scale : size of the plate speed
    steps : most steps of an engine cycle with derivatives
    events : most events of an engine cycle
    """

    period: float
    ratio: float
    clamped: bool
    slip_rate: float
    stick_rate: float
    slip_decay: float
    far: float
    truncation: float
    torque_tolerance: float
    slip_tolerance: float
    speed_scale: float
    steps: int
    events: int


def bounds_of(terms: Terms, period: float, rtol: float) -> Bounds:
    """Return the constants of a system whose engine cycle is `period`, for a relative tolerance.

    A cycle may have 1000 events, and 40 for each natural or excitation period in it.
    """
    flywheel, plate, damping, stiffness, _, _ = coefficients_of(terms.linear)
    slip_decay = decay_of_slip(terms.linear)
    pairs = exponentials(terms.stribeck)
    ratio = float(sliding(0.0, 1.0, terms.stribeck))
    friction = largest_ratio(terms.stribeck) * peak_load(terms)
    torque = max(abs(terms.mean_torque) + torque_swing(terms) + friction, 1e-300)
    tolerance = 1e-12 * torque
    scale = torque / math.sqrt(stiffness * plate)
    excitation = excitation_frequency(terms)
    truncation, far = EXACT, 0.0
    if terms.stribeck is not None:
        truncation = max(SHARE * rtol, EXACT)
        far = max(max(math.log(abs(share) / (FAR_SHARE * rtol)), 1.0) / rate for share, rate in pairs)

    return Bounds(
        period=period, ratio=ratio, clamped=terms.pulsation is not None and terms.pulsation[0] > terms.mean_load,
        slip_rate=math.sqrt(stiffness / plate) + damping / plate + slip_decay + excitation,
        stick_rate=math.sqrt(stiffness / (flywheel + plate)) + damping / (flywheel + plate) + excitation,
        far=far, truncation=truncation, torque_tolerance=tolerance, slip_tolerance=1e-14 * scale, speed_scale=scale,
        slip_decay=slip_decay, steps=STEPS_ALLOWED * steps_allowed(terms, period),
        events=EVENTS + int(min(40.0 * max(math.sqrt(stiffness / plate), excitation) * period / (2.0 * math.pi), 1e6)))


STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("mode", np.int64), ("tau", np.float64), ("shift", np.float64),
                  ("load_edge", np.float64), ("at_rest", np.int64), ("first_mode", np.int64)])
"""State of a run (rad/s, rad, rad/s, rad); its mode; time into the engine cycle, s; the load's phase at its start, rad;
when the clamp next switches, s into the cycle; whether slip has just begun at v = 0; the mode at the start of the run.
"""


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
        torque = rows[ENGINE, k]
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
            - lost_torque(v, linear.plate_by_slip))
    push = engine - friction - lost_torque(v, linear.flywheel_by_slip)
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


@fast
def mode_at_rest(plate_angle: float, plate_speed: float, drive: Any, ratio: float, tolerance: float,
                 linear: Linear) -> int:
    """Return the mode after v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within `tolerance` (N m) of breakaway the rate of the margin decides: stick if it grows.
    """
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
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
    """Return the mode of a state at the start of a run, or where the load begins or ends."""
    if not loaded:
        return FREE
    if slip_speed != 0.0:
        return POSITIVE if slip_speed > 0.0 else NEGATIVE
    return int(mode_at_rest(plate_angle, plate_speed, drive, ratio, tolerance, linear))


@fast
def begin(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any) -> None:
    """Set the mode of a state from the torques and their rates there, and the time at which the clamp next switches."""
    state.load_edge = math.inf
    loaded = terms.mean_load > 0.0
    if bounds.clamped:
        state.load_edge, loaded = clamp_edge(state.tau, math.inf, state.shift, terms.mean_load, terms.pulsation,
                                             None)
    excite(state.tau, state.shift, loaded, terms.mean_torque, waves, terms.mean_load, terms.pulsation, None, drive)
    state.mode = mode_of(state.slip_speed, loaded, state.plate_angle, state.plate_speed, drive, bounds.ratio,
                         bounds.torque_tolerance, terms.linear)
    state.at_rest = 1 if state.slip_speed == 0.0 and state.mode != FREE else 0


@fast
def step_on(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any, goal: float, work: Any) -> Step:
    """Return the next step, at most to `goal`, s into the cycle, or to the clamp's next switching."""
    remaining = min(goal, state.load_edge) - state.tau
    excite(state.tau, state.shift, state.mode != FREE, terms.mean_torque, waves, terms.mean_load, terms.pulsation,
           None, drive)
    rows, workspace = work.rows, work.bernstein
    if state.mode == STICK:
        return stick_arc(bounds, terms.linear, terms.mean_torque, waves, terms.mean_load, terms.pulsation, state, drive,
                         remaining, rows, workspace)
    return slip_arc(bounds, terms.linear, terms.mean_torque, waves, terms.mean_load, terms.pulsation, terms.stribeck,
                    state, drive, remaining, rows, workspace)


@fast
def finish(bounds: Bounds, terms: Terms, waves: Any, step: Step, goal: float, state: Any, drive: Any, rows: Any,
           angle: bool) -> bool:
    """Bring the state to the end of a step and set the mode that follows; return whether there may be a new one."""
    until = min(goal, state.load_edge)
    full = step.event == NO_EVENT and step.x * step.unit >= (until - state.tau) * (1.0 - 1e-13)
    if step.x > 0.0:
        slip_speed, state.plate_angle, state.plate_speed = polynomial.values(rows, step.degree, step.x)
        if angle:
            state.flywheel_angle = polynomial.value(rows, FLYWHEEL, step.degree, step.x)
        if state.mode != STICK:
            state.slip_speed = slip_speed
            state.at_rest = 0
    state.tau = until if full else state.tau + step.x * step.unit
    if abs(state.plate_speed) < 1e-26 * bounds.speed_scale:
        # An arc that has decayed: products of smaller numbers would be denormal, and slow.
        state.plate_speed = 0.0
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
