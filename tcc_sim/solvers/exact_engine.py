"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. After the end of slip the torques and their rates decide on the mode, never the sign of a rounded
slip speed: in stick v = 0 exactly, and slip begins at v = 0 exactly.

For derivatives by the state and by the numbers of the equations the coefficients of a step's polynomials are
differentiated (`changes`). An event multiplies the derivatives by a saltation matrix (R. I. Leine, H. Nijmeijer,
Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004, Section 7.2): S = I + (f+ - f-) e_v^T/v'-
where slip ends, I where it begins, the field being continuous there since mubar(0+) = mu_s/mu_k.

Margins of a motion to other event sequences vanish at bifurcations with sliding: M. di Bernardo, P. Kowalczyk, A.
Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002). A margin is the smallest value over the
motion, from the polynomials of the steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import compiled, fast
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.errors import OutOfRange
from tcc_sim.model.equations import Linear, coefficients_of, completed, decay_of_slip
from tcc_sim.model.friction import Stribeck, exponentials, largest_ratio, sliding
from tcc_sim.model.parameters import System
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers import changes, series
from tcc_sim.solvers import engine as shell
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import LANES, Rows, changed_at, changing, changing_linear, end_changes, hold_phase
from tcc_sim.solvers.collocation import WORK
from tcc_sim.solvers.engine import EngineShell, Memory, Setup, Store, Tangent
from tcc_sim.solvers.law import NARROW, Changing
from tcc_sim.solvers.model_kernels import exponentials_at, lost_torque, steepness
from tcc_sim.solvers.series import ANGLE, FLYWHEEL, INVERSE, LOAD, SLIP, SPEED, Pulsation, excite, expand_excitation
from tcc_sim.solvers.terms import Terms, excitation_frequency, largest_torque, per_system, steps_allowed, terms_of
from tcc_sim.trajectory import FREE, NEGATIVE, POSITIVE, STICK, Floats

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
    torque = max(largest_torque(terms, largest_ratio(terms.stribeck)), 1e-300)
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


UPWARD, DOWNWARD = series.ROWS, series.ROWS + 1
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
        torque = rows[series.ENGINE, k]
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
def stick_arc(bounds: Bounds, terms: Terms, waves: Any, pulsation: Pulsation, state: Any, drive: Any, remaining: float,
              rows: Any, workspace: Any) -> Step:
    """Return a step in stick of at most `remaining` seconds, to breakaway where |lambda| = r Ts."""
    unit = 1.0 / bounds.stick_rate
    expand_excitation(rows, LINEAR_ORDER + 1, unit, state.tau, True, terms, waves, pulsation, None, drive)
    for k in range(LINEAR_ORDER + 1):
        rows[SLIP, k] = 0.0
    rows[ANGLE, 0] = state.plate_angle
    rows[SPEED, 0] = state.plate_speed
    expand_stuck(LINEAR_ORDER, rows, unit, terms.linear, bounds.ratio, pulsation)
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
    if (rows[UPWARD, 0] > polynomial.variation(rows, UPWARD, order, x) + tolerance
            and rows[DOWNWARD, 0] > polynomial.variation(rows, DOWNWARD, order, x) + tolerance):
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
def slip_arc(bounds: Bounds, terms: Terms, waves: Any, pulsation: Pulsation, stribeck: Stribeck, state: Any, drive: Any,
             remaining: float, rows: Any, workspace: Any) -> Step:
    """Return a step in slip, or without load, of at most `remaining` s, to v = 0, or to the speed `far`."""
    mode, v, linear = state.mode, state.slip_speed, terms.linear
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
            expand_excitation(rows, order, unit, state.tau, True, terms, waves, pulsation, None, drive)
            series.expand(order, rows, unit, linear, sign, pulsation, stribeck, excess, None, None, None)
    if not falling:
        expand_excitation(rows, order, unit, state.tau, mode != FREE, terms, waves, pulsation, None, drive)
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
def mode_at_rest(state: Any, drive: Any, bounds: Bounds, linear: Linear) -> int:
    """Return the mode after v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within the torque's tolerance of breakaway the rate of the margin decides: stick if it grows.
    """
    ratio, tolerance, plate_speed = bounds.ratio, bounds.torque_tolerance, state.plate_speed
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    both = flywheel + plate
    spring = damping * plate_speed + stiffness * state.plate_angle
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
def begin(setup: Setup, state: Any, drive: Any) -> None:
    """Set the mode of a state, at the start of a run or where the load begins or ends, from the torques and their rates
    there, and the time at which the clamp next switches.
    """
    bounds, terms, _, waves, _ = setup
    state.load_edge = math.inf
    loaded = terms.mean_load > 0.0
    if bounds.clamped:
        state.load_edge, loaded = series.clamp_edge(state.tau, math.inf, state.shift, terms.mean_load, terms.pulsation,
                                                    None)
    excite(state.tau, state.shift, loaded, terms, waves, terms.pulsation, None, drive)
    if not loaded:
        state.mode = FREE
    elif state.slip_speed != 0.0:
        state.mode = POSITIVE if state.slip_speed > 0.0 else NEGATIVE
    else:
        state.mode = mode_at_rest(state, drive, bounds, terms.linear)
    state.at_rest = 1 if state.slip_speed == 0.0 and state.mode != FREE else 0


@fast
def step_on(setup: Setup, memory: Memory, goal: float) -> Step:
    """Return the next step, at most to `goal`, s into the cycle, or to the clamp's next switching."""
    bounds, terms, _, waves, _ = setup
    state, _, drive, work, _, _ = memory
    remaining = min(goal, state.load_edge) - state.tau
    excite(state.tau, state.shift, state.mode != FREE, terms, waves, terms.pulsation, None, drive)
    if state.mode == STICK:
        return stick_arc(bounds, terms, waves, terms.pulsation, state, drive, remaining, work.rows, work.bernstein)
    return slip_arc(bounds, terms, waves, terms.pulsation, terms.stribeck, state, drive, remaining, work.rows,
                    work.bernstein)


@fast
def finish(setup: Setup, memory: Memory, step: Step, goal: float, angle: bool) -> bool:
    """Bring the state to the end of a step and set the mode that follows; return whether there may be a new one."""
    bounds, terms, _, waves, _ = setup
    state, drive, rows = memory.state, memory.drive, memory.work.rows
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
        begin(setup, state, drive)
        return True
    stopped = (state.mode == POSITIVE and state.slip_speed <= 0.0) or (state.mode == NEGATIVE
                                                                       and state.slip_speed >= 0.0)
    if step.event == REST or (stopped and state.at_rest == 0 and step.event != LAW_VARIES):
        state.slip_speed = 0.0
        excite(state.tau, state.shift, True, terms, waves, terms.pulsation, None, drive)
        state.mode = mode_at_rest(state, drive, bounds, terms.linear)
        state.at_rest = 1
        return True
    return False


GRAZING, ARRIVAL, STUCK = range(3)
"""Rows of margins: |v| at its smallest extremum in slip, rad/s; r Ts + sgn(v) lambda at the end of slip, N m (negative
where slip goes on the other way), the one nearest to 0; r Ts - |lambda| at its smallest minimum in stick, N m."""


@fast
def smallest_dip(c: Any, row: int, degree: int, x_end: float, sign: float, below: float,
                 workspace: Any) -> tuple[float, float]:
    """Return the smallest local minimum of sign * polynomial within (0, x_end), and its place; (below, -1) if none is
    lower. Descartes' rule finds every interval with one change of sign of the slope, as in `polynomial.extremes_of`.
    """
    polynomial.to_bernstein(c, row, degree, x_end, workspace)
    for i in range(polynomial.WORKSPACE[1]):
        workspace[1, i] = workspace[polynomial.BERNSTEIN, i]
    top, place = 1, -1.0
    shortest = x_end * 2.0 ** -polynomial.HALVINGS
    while top > 0:
        changes, last, least = 0, 0.0, math.inf
        for i in range(degree + 1):
            least = min(least, sign * workspace[top, i])
        if least < below:
            changes, _, last = polynomial.slope_changes(workspace, top, degree)
        if changes == 1 and sign * last > 0.0:
            left = workspace[top, polynomial.LEFT]
            right = left + workspace[top, polynomial.WIDTH]
            x = polynomial.turning(c, row, degree, left, right, 0.5 * (left + right), sign < 0.0, -1.0, 1e-15)
            value = sign * polynomial.value(c, row, degree, x)
            if value < below and 0.0 < x < x_end:
                below, place = value, x
        top = polynomial.search_on(workspace, top, degree, changes, shortest)
    return below, place


def arrival_change(out: Any, now: Any, by: Any, angle: Any, speed: Any, engine: Any, load: Any, sines: Any,
                   amplitude: Any, ratio: Any, side: Any, linear: Linear) -> None:
    """Fill the change of r Ts + side * lambda at constant phase, lambda in stick's form; staged function."""
    part = changing_linear(linear, by)
    flywheel, plate, turning = part.flywheel, part.plate, Changing(speed, now.row(2))
    sine, load_sine, load_cosine = sines
    spring = part.damping * turning + part.stiffness * Changing(angle, now.row(1))
    engine = Changing(engine, by.row(of.MEAN_TORQUE) + by.row(of.TORQUE_AMPLITUDE) * sine)
    load = Changing(load, by.row(of.MEAN_LOAD) + by.row(of.LOAD_AMPLITUDE) * load_sine
                    + by.row(of.LOAD_PHASE) * (amplitude * load_cosine))
    torque = (plate * engine + flywheel * spring) / (flywheel + plate)
    out.set_row((Changing(ratio, by.row(of.BREAKAWAY)) * load + Changing(side) * torque).change, 0)


change_arrival = unrolled(arrival_change)


@fast
def note_step(mode: int, order: int, x: float, rows: Any, least: Any, places: Any, workspace: Any) -> bool:
    """Search for smaller margins within a step; return whether there is one, at places[.] of the step."""
    places[GRAZING] = -1.0
    places[STUCK] = -1.0
    if mode == STICK:
        for row in (UPWARD, DOWNWARD):
            value, at = smallest_dip(rows, row, order, x, 1.0, least[STUCK, shell.VALUE], workspace)
            if at > 0.0:
                least[STUCK, shell.VALUE] = value
                places[STUCK] = at
                places[ARRIVAL] = 1.0 if row == UPWARD else -1.0
    elif mode != FREE:
        value, at = smallest_dip(rows, SLIP, order, x, float(mode), least[GRAZING, shell.VALUE], workspace)
        if at > 0.0 and value > 0.0:
            least[GRAZING, shell.VALUE] = value
            places[GRAZING] = at
    return bool(places[GRAZING] > 0.0 or places[STUCK] > 0.0)


@fast
def note_gradient(mode: int, order: int, block: int, group: Any, rows: Any, least: Any, places: Any) -> None:
    """Store the derivatives of the margins that `note_step` found in a step, by the disturbances of a group."""
    for lane in range(LANES):
        column = shell.GRADIENT + block * LANES + lane
        if places[GRAZING] > 0.0:
            least[GRAZING, column] = mode * changed_at(group, SLIP, lane, order, order, places[GRAZING], rows)
        if places[STUCK] > 0.0:
            row = UPWARD if places[ARRIVAL] > 0.0 else DOWNWARD
            least[STUCK, column] = changed_at(group, row, lane, order, order, places[STUCK], rows)


@fast
def note_arrival(mode: int, step: Step, state: Any, drive: Any, linear: Linear, ratio: float, pulsation: Pulsation,
                 tangent: Tangent) -> None:
    """Store the margin at the end of slip in direction `mode`, before the disturbances pass the event."""
    groups, sines, workspace, least = tangent.groups, tangent.along.sines, tangent.shared.workspace, tangent.margins
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    both = flywheel + plate
    spring = damping * state.plate_speed + stiffness * state.plate_angle
    margin = ratio * drive.load + mode * (plate * drive.torque + flywheel * spring) / both
    friction = mode * ratio * drive.load
    slip_rate, speed_rate = accelerations_at(linear, 0.0, state, drive.torque, friction)
    if abs(margin) >= abs(least[ARRIVAL, shell.VALUE]) or slip_rate == 0.0:
        return
    least[ARRIVAL, shell.VALUE] = margin
    stuck_rate = (drive.torque - spring) / both
    still = (ratio * drive.load_rate
             + mode * (plate * drive.torque_rate + flywheel * stiffness * state.plate_speed) / both)
    resisted = flywheel * damping
    least[ARRIVAL, shell.GROWS] = 1.0 if still + mode * resisted * stuck_rate / both > 0.0 else 0.0
    rate = still + mode * resisted * speed_rate / both
    sine = polynomial.value(sines, changes.OF_ENGINE, step.degree, step.x)
    load_sine, slope = polynomial.value_and_slope(sines, changes.OF_LOAD, step.degree, step.x)
    now = sine, load_sine, slope / (pulsation[1] * step.unit)
    for b in range(groups.shape[0]):
        group = groups[b]
        change_arrival(0, workspace, group.now, group.by, state.plate_angle, state.plate_speed, drive.torque,
                       drive.load, now, pulsation[0], ratio, float(mode), linear)
        for lane in range(LANES):
            least[ARRIVAL, shell.GRADIENT + b * LANES + lane] = workspace[lane] - rate / slip_rate * group.now[0, lane]


CONVERGED = 1e-10
"""Last terms of the friction's exponential, relative to its first, up to which its series has converged."""
SMALL = 0.02
"""Amplitude up to which the motion need not show an exponential, though its derivatives do."""
GONE = 40.0
"""Rate times slip speed above which one of several exponentials is below rounding."""
LINEAR_REACH, FALLING_REACH = 3.3, 1.6
"""Rates times length at which the last term of a derivative's series is 1e-14 of it, for the two orders."""
SHORTER = 0.6
"""Factor of a step in which the friction's exponential has not converged, though the motion has (mu_k near mu_s)."""
SHARED = np.dtype([("fastest", np.float64), ("extended", np.int64), ("places", np.float64, 3),
                   ("workspace", np.float64, LANES)])
"""Numbers that the lanes share, see `Tangent`, and work space; the further results are the margins."""


def changed_stick(rows: Any, changes: Any, now: Any, by: Any, sines: Any, unit: Any, linear: Linear, ratio: Any,
                  pulsation: Any, margins: Any) -> Iterator[int]:
    """Fill the derivatives of `exact.stuck`; staged function."""
    yield from stuck(Rows(rows, changes, now, by, sines, unit, pulsation, margins), Changing(unit),
                     changing_linear(linear, by), changing(ratio, by, of.BREAKAWAY), pulsation)


expand_stick_changes = unrolled(changed_stick)


@fast
def unresolved(step: Step, mode: int, later: bool, stribeck: Stribeck, rows: Any, workspace: Any) -> bool:
    """Return whether the last terms of an exponential over a step count, if its amplitude is too small for the motion
    to show them; `workspace` takes them. Several exponentials are looked at only if there are derivatives by them
    (`later`).
    """
    if stribeck is None or (len(stribeck) > 2 and not later):
        return False
    for i in range(0, len(stribeck), 2):
        gone = len(stribeck) > 2 and stribeck[i + 1] * abs(rows[SLIP, 0]) > GONE
        if abs(stribeck[i]) <= SMALL and not gone:
            series.expand_decayed(step.degree - 1, workspace, rows, -stribeck[i + 1] * mode)
            power = step.x ** (step.degree - 1)
            if max(abs(workspace[step.degree - 2]) / step.x, abs(workspace[step.degree - 1])) * power > CONVERGED:
                return True
    return False


@fast
def carry(mode: int, step: Step, ratio: float, linear: Linear, groups: Any, along: Any, rows: Any, pulsation: Pulsation,
          stribeck: Stribeck, margins: bool) -> None:
    """Fill the coefficients of all derivatives over a step, with the sines of `along` (ALONG); in stick those of the
    margins to breakaway too, if `margins`.
    """
    order, unit, sign = step.degree, step.unit, 0.0 if mode == FREE else float(mode)
    if mode == STICK:
        for i in range(groups.shape[0]):
            group = groups[i]
            for k in range(order + 1):
                for lane in range(LANES):
                    group.rows[SLIP, k, lane] = 0.0
            if margins:
                expand_stick_changes(order, rows, group.rows, group.now, group.by, along.sines, unit, linear, ratio,
                                     pulsation, True)
            else:
                expand_stick_changes(order, rows, group.rows, group.now, group.by, along.sines, unit, linear, ratio,
                                     pulsation, None)
    elif stribeck is None or order != FALLING_ORDER:
        changes.carry_slip(order, unit, sign, groups, along, rows, linear, pulsation, None, None)
    else:
        changes.carry_slip(order, unit, sign, groups, along, rows, linear, pulsation, stribeck, None)


@fast
def land(mode: int, following: int, state: Any, drive: Any, ratio: float, linear: Linear, groups: Any) -> bool:
    """Apply the saltation matrix of slip in direction `mode` that ends in mode `following`; return False if v' is 0."""
    slip_rate, speed_rate = accelerations_at(linear, 0.0, state, drive.torque, mode * ratio * drive.load)
    if slip_rate == 0.0:
        return False
    if following != STICK:
        share, new_rate = accelerations_at(linear, 0.0, state, drive.torque, following * ratio * drive.load)
        share /= slip_rate
    else:
        spring = linear.damping * state.plate_speed + linear.stiffness * state.plate_angle
        share, new_rate = 0.0, (drive.torque - spring) / (linear.flywheel + linear.plate)
    for b in range(groups.shape[0]):
        now = groups[b].now
        for lane in range(LANES):
            now[2, lane] += (new_rate - speed_rate) / slip_rate * now[0, lane]
            now[0, lane] *= share
    return True


@fast
def longest_step(bounds: Bounds, linear: Linear, load: float, stribeck: Stribeck, fastest: float, state: Any) -> float:
    """Return the length, s, up to which the series of derivatives hold, also at rates that the motion does not show."""
    mode, inertia = state.mode, linear.plate
    if mode == STICK:
        inertia += linear.flywheel
    rate = max(math.sqrt(linear.stiffness / inertia) + linear.damping / inertia + bounds.slip_decay, fastest)
    if stribeck is not None and mode != STICK and mode != FREE and abs(state.slip_speed) <= 1.01 * bounds.far:
        fall = steepness(abs(state.slip_speed), stribeck)
        return float(FALLING_REACH / (rate + fall * load * (1.0 / linear.flywheel + 1.0 / linear.plate)))
    return LINEAR_REACH / rate


@fast
def note_height(mode: int, step: Step, rows: Any, height: float, workspace: Any) -> tuple[float, float, float]:
    """Return the largest |slip speed| up to the end of a step, its place in the step (-1: earlier), and its sign."""
    place, sign = -1.0, 0.0
    if mode == STICK or abs(rows[SLIP, 0]) + step.reach <= height:
        return height, place, sign
    one_way = monotone(rows, step.degree, step.x, step.reach)
    end = polynomial.value(rows, SLIP, step.degree, step.x)
    for k in range(2):
        side = 1.0 - 2.0 * k
        if mode != FREE and side != mode:
            continue
        if not one_way:
            value, at = smallest_dip(rows, SLIP, step.degree, step.x, -side, -height, workspace)
            if at > 0.0:
                height, place, sign = -value, at, side
        if side * end > height:
            height, place, sign = side * end, step.x, side
    return height, place, sign


@fast
def start_changes(state: Any, output: Any, tangent: Tangent) -> None:
    """Project a start in stick on v = 0, reset the margins, and begin a cycle."""
    groups, margins = tangent.groups, tangent.margins
    margins[:] = 0.0
    margins[:, shell.VALUE] = math.inf
    if state.mode == STICK:
        for block in range(groups.shape[0]):
            groups[block].now[0, :] = 0.0
    start_height(state, output, groups)


@fast
def start_height(state: Any, output: Any, groups: Any) -> None:
    """Set the largest |slip speed| of a cycle, `output.highest`, at its start; `output.lowest` is not used."""
    output.highest, output.lowest = abs(state.slip_speed), 0.0
    for block in range(groups.shape[0]):
        for lane in range(LANES):
            groups[block].peak[lane] = math.copysign(1.0, state.slip_speed) * groups[block].now[0, lane]


@fast
def end_changes_of_cycle(state: Any, output: Any, tangent: Tangent, cycles: Any) -> None:
    """Keep the results of a cycle, and begin the next one."""
    done, groups = cycles[output.cycle], tangent.groups
    done.highest, done.lowest, done.stick_time = output.highest, output.lowest, output.stick_time
    for block in range(groups.shape[0]):
        for lane in range(LANES):
            tangent.peaks[output.cycle, block, lane] = groups[block].peak[lane]
    output.cycle += 1
    output.stick_time = 0.0
    start_height(state, output, groups)


@compiled
def resolved_step(until: float, setup: Setup, memory: Memory, tangent: Tangent) -> tuple[Step, float]:
    """Return the next step, no longer than the series of derivatives hold, and the time that it aimed at, at most
    `until`, s into the cycle.
    """
    state, terms, along = memory.state, setup.terms, tangent.along
    later = along.law.shape[1] > NARROW
    amplitude: float = terms.pulsation[0]  # type: ignore[index]
    goal = min(until, state.tau + longest_step(setup.limits, terms.linear, terms.mean_load + amplitude, terms.stribeck,
                                               tangent.shared.fastest, state))
    while True:
        step = step_on(setup, memory, goal)
        if not (step.degree == FALLING_ORDER and step.x > 0.0 and unresolved(
                step, state.mode, later, terms.stribeck, memory.work.rows, along.sines[0])):
            return step, goal
        goal = state.tau + SHORTER * step.x * step.unit


@compiled
def carry_step(step: Step, setup: Setup, memory: Memory, tangent: Tangent) -> None:
    """Carry derivatives, the largest |slip speed|, the time in stick and, if asked for, the margins over a step."""
    bounds, terms, _, waves, _ = setup
    state, _, drive, work, _, output = memory
    groups, along, shared, _, margins = tangent
    rows, mode, degree, places = work.rows, state.mode, step.degree, shared.places
    noted = shared.extended != 0 and note_step(mode, degree, step.x, rows, margins, places, work.bernstein)
    output.highest, peak, side = note_height(mode, step, rows, output.highest, work.bernstein)
    if mode == STICK:
        output.stick_time += step.x * step.unit
    changes.expand_sines(along.sines, degree + 1, step.unit, waves, terms.pulsation, drive)
    carry(mode, step, bounds.ratio, terms.linear, groups, along, rows, terms.pulsation, terms.stribeck, noted)
    for block in range(groups.shape[0]):
        group = groups[block]
        if peak > 0.0:
            for lane in range(LANES):
                group.peak[lane] = side * changed_at(group, SLIP, lane, degree, degree, peak, rows)
        if noted:
            note_gradient(mode, degree, block, group, rows, margins, places)
        end_changes(degree, group.now, group.rows, step.x)
        hold_phase(group, degree, step.x, rows)


@compiled
def carry_event(mode: int, step: Step, setup: Setup, memory: Memory, tangent: Tangent) -> bool:
    """Carry the derivatives over a change of mode, and note the margin; return False if there is no derivative."""
    bounds, terms, _, _, _ = setup
    state, drive, groups = memory.state, memory.drive, tangent.groups
    memory.output.mode = state.mode
    if mode in (STICK, FREE) or state.mode in (mode, FREE):
        return True
    if tangent.shared.extended != 0:
        note_arrival(mode, step, state, drive, terms.linear, bounds.ratio, terms.pulsation, tangent)
    return land(mode, state.mode, state, drive, bounds.ratio, terms.linear, groups)


AHEAD = 0.6
"""Longest step, in engine cycles: it meets the end of one cycle at most."""


@fast
def keep(step: Step, mode: int, tau: float, setup: Setup, memory: Memory, store: Store, angle: bool) -> None:
    """Store samples, extremes, time in stick, loads and section of a step from `tau` to the state."""
    state, _, _, work, _, output = memory
    period, rows = setup.limits.period, work.rows
    first = output.samples
    if store.per_cycle > 0:
        shell.keep_samples(rows, step.degree, step.unit, step.x, tau, period, store, output, angle)
        for i in range(first, output.samples):
            store.samples[i, 4] = mode
    cut = shell.end_of_cycle(tau, state.tau, period, step.unit, step.x)
    shell.keep_loads(store.loads, rows, step.degree, step.unit, step.x, cut, output.cycle, setup.terms.linear,
                     work.bernstein)
    highest, lowest = max(output.highest, 0.0), min(output.lowest, 0.0)
    if mode == STICK:
        behind = shell.keep_stick(output, 0.0, step.x, cut, step.unit)
        output.highest, output.lowest = highest, lowest
        if cut <= step.x:
            shell.end_cycle(rows, step.degree, cut, behind, output, store.cycles)
    else:
        keep_slip(step, cut, rows, output, store.cycles, work.bernstein)
        # Where slip ends the polynomial leaves a rounding of either sign.
        if mode == 1:
            output.lowest = max(output.lowest, lowest if cut > step.x else 0.0)
        elif mode == -1:
            output.highest = min(output.highest, highest if cut > step.x else 0.0)


@fast
def keep_slip(step: Step, cut: float, rows: Any, output: Any, cycles: Any, workspace: Any) -> None:
    """Store extremes and section of a step in slip."""
    v = rows[SLIP, 0]
    if cut > step.x and v + step.reach <= output.highest and v - step.reach >= output.lowest:
        return
    if monotone(rows, step.degree, step.x, step.reach):
        if cut <= step.x:
            shell.end_cycle(rows, step.degree, cut, 0.0, output, cycles)
        v = polynomial.value(rows, SLIP, step.degree, step.x)
        output.highest, output.lowest = max(output.highest, v), min(output.lowest, v)
    else:
        polynomial.to_bernstein(rows, SLIP, step.degree, step.x, workspace)
        shell.keep_cycle(rows, step.degree, step.x, cut, 0.0, output, cycles, workspace)


@fast
def start(setup: Setup, memory: Memory, tangent: Any) -> None:
    """Set up all but the state, where a motion starts."""
    state, output = memory.state, memory.output
    begin(setup, state, memory.drive)
    state.first_mode = state.mode
    shell.begin_output(output, state.slip_speed, state.mode)
    if tangent is not None:
        start_changes(state, output, tangent)


@compiled
def take_step(first: int, count: int, tail: float, setup: Setup, memory: Memory, tangent: Any, store: Store,
              angle: bool) -> int:
    """Take a step up to the next event at most; with derivatives it ends at the end of its cycle at the latest."""
    state, _, _, work, counters, output = memory
    period, n, mode, tau = setup.limits.period, output.cycle, state.mode, state.tau
    goal = tail if n == count else period if n == count - 1 else tau + AHEAD * period
    if tangent is None:
        step = step_on(setup, memory, goal)
    else:
        step, goal = resolved_step(tail if n == count else period, setup, memory, tangent)
    if not step.x >= 0.0:
        return shell.NOT_FINITE
    if angle:
        work.rows[FLYWHEEL, 0] = state.flywheel_angle
        series.add_integral(work.rows, step.degree, step.unit)
    if tangent is not None and step.x > 0.0:
        carry_step(step, setup, memory, tangent)
    event = finish(setup, memory, step, goal, angle)
    if not abs(state.slip_speed) + abs(state.plate_angle) + abs(state.plate_speed) < math.inf:
        return shell.NOT_FINITE
    if tangent is not None:
        if event and step.x > 0.0 and not carry_event(mode, step, setup, memory, tangent):
            return shell.DEGENERATE
        if state.tau >= period:
            end_changes_of_cycle(state, output, tangent, store.cycles)
    elif step.x > 0.0:
        keep(step, mode, tau, setup, memory, store, angle)
    if event and state.mode != mode:
        shell.store_transition((first + n) * period + state.tau, mode, state.mode, output, store.transitions)
        if mode == STICK:
            shell.keep_breakaway(store.loads, output.cycle)
    counters.steps += 1
    if event:
        counters.events += 1
        if counters.events >= setup.limits.events:
            return shell.EVENT_LIMIT
    if state.tau >= period:
        state.load_edge -= period
        counters.limited, counters.events = 0, 0
    return shell.GOES_ON


integrate = shell.loop_by(start, take_step, "event_driven")


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
    waves = series.waves_of(terms)
    waves.setflags(write=False)
    return Setup(bounds_of(terms, system.cycle, rtol), without_torque(terms), system.pressure.frequency_ratio, waves,
                 None)


def without_torque(terms: Terms) -> Terms:
    """Return the terms without those of the engine torque, which are the waves, and without smoothing; with every
    linear coefficient.
    """
    return terms._replace(linear=completed(terms.linear), torque=None, harmonics=None, smoothing=None)


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives; raise OutOfRange if a damper's decay takes too many steps."""
    if terms.stribeck is not None:
        terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST), *terms.stribeck[2:]))
    waves = series.waves_of(terms)
    if terms.stribeck is not None and changes[of.EXCESSES + of.DECAYS].any():  # Their derivatives decay later.
        pairs = exponentials(terms.stribeck)
        wide = tuple(number for share, rate in pairs for number in (max(abs(share), 1.0), rate))
        bounds = bounds_of(terms._replace(stribeck=wide), system.cycle, FINER * rtol)._replace(
            ratio=1.0 + sum(share for share, _ in pairs))
    else:
        bounds = bounds_of(terms, system.cycle, FINER * rtol)
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
    return {shell.EVENT_LIMIT: f"{setup.limits.events} events in one period of excitation",
            shell.NOT_FINITE: "the state is not finite",
            shell.STEP_LIMIT: f"{steps} steps in one period of excitation{heavy}",
            shell.DEGENERATE: "slip ends where its rate is 0 too"
            }.get(ended, "")


MEMORY = Memory(STATE, None, series.DRIVE, WORK, shell.COUNTERS, shell.OUTPUT)
ENGINE = EngineShell("event_driven", integrate, MEMORY, SHARED, setup_of, setup_of_changes, lambda *_: STEP_MAXIMUM,
                     lambda setup, _: setup.limits.steps, why, transitions_per_cycle=EVENTS, columns=5, stride=2)
solve = ENGINE.solve
