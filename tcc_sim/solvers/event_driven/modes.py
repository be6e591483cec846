"""Modes of the set-valued law (6): the mode of a state, the next step in it, and the mode that follows.

After the end of slip the torques and their rates decide on the mode, never the sign of a rounded slip speed: in stick
v = 0 exactly, and slip begins at v = 0 exactly.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast, lost_torque
from tcc_sim.model.equations import Linear
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers.event_driven.setup import Bounds
from tcc_sim.solvers.event_driven.step import BREAKAWAY, LAW_VARIES, NO_EVENT, REST, Step, slip_arc, stick_arc
from tcc_sim.solvers.excitation import clamp_edge, excite
from tcc_sim.solvers.series import FLYWHEEL
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, NEGATIVE, POSITIVE, STICK


@fast
def mode_at_rest(plate_angle: float, plate_speed: float, drive: Any, ratio: float, tolerance: float,
                 linear: Linear) -> int:
    """Return the mode after v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within `tolerance` (N m) of breakaway the rate of the margin decides: stick if it grows.
    """
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    both = flywheel + plate
    spring = damping * plate_speed + stiffness * plate_angle
    engine = drive.torque - lost_torque(0.0, plate_speed, None, linear.flywheel_by_speed)
    torque = (plate * engine + flywheel * spring) / both
    margin = ratio * drive.load - abs(torque)
    if margin > tolerance:
        return STICK
    direction = POSITIVE if torque > 0.0 else NEGATIVE
    if margin < -tolerance:
        return direction
    acceleration = (engine - spring) / both
    engine_rate = drive.torque_rate - lost_torque(0.0, acceleration, None, linear.flywheel_by_speed)
    torque_rate = (plate * engine_rate + flywheel * (damping * acceleration + stiffness * plate_speed)) / both
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
           angle: Any) -> bool:
    """Bring the state to the end of a step and set the mode that follows; return whether there may be a new one."""
    until = min(goal, state.load_edge)
    full = step.event == NO_EVENT and step.x * step.unit >= (until - state.tau) * (1.0 - 1e-13)
    if step.x > 0.0:
        slip_speed, state.plate_angle, state.plate_speed = polynomial.values(rows, step.degree, step.x)
        if angle is not None:
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
