"""Choice of the method of the next step.

Series are cheapest as long as the motion itself, not a decaying rate, limits their step. In stick the decaying rate is
friction's rho = beta Ts mubar': on its slow manifold collocation takes longer steps (Hairer and Wanner, Solving
Ordinary Differential Equations II, Sec. VI.3). Where the linear part is stiff (a light plate, or a coupling at a light
flywheel), stability limits the series, whose steps then have equal lengths.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast, lost_torque
from tcc_sim.solvers.collocation import LEVELS, NODES, Tables
from tcc_sim.solvers.shared_collocation import growth, step_size_below
from tcc_sim.solvers.smoothed.collocation_step import FLAT, WORTH
from tcc_sim.solvers.smoothed.series_step import LocalFriction
from tcc_sim.solvers.smoothed.setup import CREEP, SERIES, STIFF, Limits, Step
from tcc_sim.solvers.stages import FALLING, LAYER, Place
from tcc_sim.solvers.terms import Terms

WORTH_USUAL = 2.0
"""Step times rho, for the shortest step size of a usual ladder, below which collocation is not even tried in stick."""
RETURN = 3.0
"""Growth of rho since the series took over in stick after which collocation is tried again."""
CALM, CALM_MOST = 8, 256
"""Half the series steps after which it is tried again in any case; doubled each time."""
PROJECTED = 2.0
"""Longest projection onto the slow manifold, in tolerances in stick: samples contain its first-order effect; its
second-order effect on the motion afterwards, sigma delta^2, would allow much more."""
SETTLED = 32
"""Series steps within the layer after which transients have decayed: the state is on the slow manifold itself, not on
the first-order one, and collocation starts without a projection."""
CURVED = 0.3
"""Largest distance of the two then, as sigma delta^2 per tolerance in stick."""
SLOW = 3.0
"""Least slip speed in projections, so that a projection does not pass v = 0."""
FIRST = 0.2
"""Length of the first step in stick, per engine cycle."""
PATIENCE, PATIENCE_MOST = 16, 1024
"""Series steps of equal length after which collocation is tried, doubled each time until it succeeds; and collocation
steps of one step size after which a longer one is tried."""
HURRY = 2
"""PATIENCE with the series where the linear part lets the slip speed decay fast, which alone limits their steps."""
SMALL = 2.0 ** (-0.5 * NODES)
"""Error there below which the next longer collocation step passes by the power law; the error of a start off the slow
manifold does not depend on the length."""
NEARING, CAUTIOUS = 0.5, 8
"""Length there of a collocation step in slip that falls towards the layer, per time in which it would reach it (as slip
falls friction brakes it more, and across v = 0 Newton's method fails); steps since a refused one to which this holds.
"""
ALIKE = 0.1
"""Relative difference of lengths that count as equal."""
SERIES_REACH = 3.0
"""Step of a series that stability limits, times the sum of the rates; a shorter collocation step is not worth it."""


@fast
def distance_to_creep(friction: LocalFriction, rho: float, state: Any, limits: Limits, terms: Terms,
                      drive: Any) -> float:
    """Return the distance of the slow manifold above v, rad/s: delta = (v' - v_s')/rho to first order in 1/rho.

    v_s' is that of the balance v' = 0 with w' = (Te - C23 theta2' - K23 theta2)/M.
    """
    linear = terms.linear
    i1, i2, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    push = (drive.torque - damping * state.plate_speed - stiffness * state.plate_angle
            - lost_torque(0.0, state.plate_speed, None, linear.flywheel_by_speed)) / (i1 + i2)
    creep = (drive.torque_rate / i1 + (damping * push + stiffness * state.plate_speed) / i2
             - lost_torque(0.0, push, None, linear.flywheel_by_speed) / i1
             - limits.beta * drive.load_rate * friction.law) / rho
    return float((friction.acceleration - creep) / rho)


@fast
def enter_creep(place: Place, friction: LocalFriction, remaining: float, state: Any, control: Any, limits: Limits,
                terms: Terms, drive: Any, tables: Tables) -> bool:
    """Change to collocation in stick if the state is on the slow manifold, or project it if it is near.

    The projection keeps w = theta2' + kappa v, and corrects theta2 by its change during the decay of delta.
    """
    v = state.slip_speed
    rho = limits.beta * drive.load * friction.slope + limits.slip_decay
    waits = not (rho > RETURN * control.released or control.waited >= control.calm)
    if waits or control.unsettled > 0.0 or abs(v) >= limits.creep_speed:
        return False
    shortest = tables.step_sizes[tables.step_sizes.shape[0] - 1].length
    if not rho * tables.step_sizes[LEVELS - 1].length > WORTH_USUAL or remaining < shortest:
        return False
    delta = distance_to_creep(friction, rho, state, limits, terms, drive)
    near = (abs(delta) * max(friction.slope / limits.sigma, FLAT) < PROJECTED * limits.creep_tolerance
            and abs(v) >= SLOW * abs(delta))
    decayed = control.waited >= SETTLED or (limits.fast_slip and control.streak > control.patience)
    settled = decayed and delta * delta * limits.sigma < CURVED * limits.creep_tolerance
    if not (near or settled):
        return False
    if near:
        state.slip_speed += delta
        state.plate_speed -= limits.kappa * delta
        state.plate_angle += limits.kappa * delta / rho
    control.method = CREEP
    control.rate = rho
    control.level = step_size_below(tables.step_sizes, 0, FIRST * limits.period)
    return True


@fast
def choose_method(place: Place, friction: LocalFriction, remaining: float, state: Any, control: Any, limits: Limits,
                  terms: Terms, drive: Any, tables: Tables) -> bool:
    """Set control.method for the next step; return whether collocation in stick begins, which may move the state."""
    room, near = math.inf, False
    if limits.fast_slip and place.region == FALLING and place.sign * friction.acceleration < 0.0:
        room = NEARING * (abs(state.slip_speed) - limits.layer) / abs(friction.acceleration)
        near = room < max(SERIES_REACH / limits.base_rate, tables.step_sizes[tables.step_sizes.shape[0] - 1].length)
        if control.method == STIFF and control.streak <= CAUTIOUS:
            if near:
                control.method, control.streak = SERIES, 0
            else:
                control.level = step_size_below(tables.step_sizes, control.level, room)
    if control.method != SERIES:
        return False
    if place.region != LAYER:
        control.released = 0.0
        control.calm = CALM
        control.waited = 0
    elif enter_creep(place, friction, remaining, state, control, limits, terms, drive, tables):
        return True
    if control.streak > control.patience and not near:
        control.streak = 0
        control.patience = min(2 * control.patience, PATIENCE_MOST)
        control.method = STIFF
        control.level = min(step_size_below(tables.step_sizes, 0, min(8.0 * control.last, room)),
                            tables.step_sizes.shape[0] - 1)
    return False


@fast
def leave_if_short(control: Any, limits: Limits, tables: Tables) -> None:
    """Return to the series if the next step size is too short for its cost, or if there is none."""
    length = tables.step_sizes[control.level].length if control.level < tables.step_sizes.shape[0] else 0.0
    if control.method == CREEP and length * control.rate < WORTH:
        control.method = SERIES
        control.released = control.rate
        control.waited = 0
        control.calm = min(2 * control.calm, CALM_MOST)
    elif control.method == STIFF and length * (limits.base_rate + abs(control.rate)) < SERIES_REACH:
        control.method = SERIES


@fast
def after_collocation(error: float, length: float, control: Any, limits: Limits, tables: Tables) -> None:
    """Choose the step size of the next step, or the series.

    `growth` assumes a power law, which errors of rounding, or of a start off the slow manifold, do not follow.
    Therefore after many steps of one length a longer one is tried.
    """
    longest = length * growth(error)
    control.streak += 1
    level = control.level
    eager = limits.fast_slip and control.method == STIFF and error < SMALL
    if (control.streak > PATIENCE or eager) and level > 0:
        longest = max(longest, tables.step_sizes[level - 1].length)
    while level > 0 and tables.step_sizes[level - 1].length <= longest:
        level -= 1
    control.level = step_size_below(tables.step_sizes, level, longest)
    if control.method == STIFF:
        control.patience = patience_of(limits)
    leave_if_short(control, limits, tables)


@fast
def after_step(step: Step, x: float, control: Any, limits: Limits, tables: Tables) -> None:
    """Update `control` after [0, x] of a step was taken."""
    if control.method == SERIES:
        length = x * step.unit
        control.waited += 1
        control.streak = control.streak + 1 if abs(length - control.last) < ALIKE * length else 0
        control.last = length
    elif x == step.x:
        after_collocation(step.error, step.unit, control, limits, tables)


@fast
def patience_of(limits: Limits) -> int:
    """Return the number of series steps of equal length after which collocation is tried for the first time."""
    return HURRY if limits.fast_slip else PATIENCE


@fast
def begin(state: Any, control: Any, limits: Limits) -> None:
    """Reset `control` at the start of a motion."""
    control.method, control.level, control.rate, control.last, control.streak = SERIES, 0, 0.0, 0.0, 0
    control.released, control.waited, control.calm, control.patience = 0.0, 0, CALM, patience_of(limits)
    control.unsettled, control.slip_before, control.speed_before = 0.0, 0.0, 0.0
    control.slip_now, control.speed_now = abs(state.slip_speed), abs(state.plate_speed)


@fast
def begin_cycle(state: Any, control: Any, limits: Limits) -> None:
    """Begin a cycle: sizes of the motion are those of this cycle and of the one before."""
    control.slip_before, control.slip_now = control.slip_now, abs(state.slip_speed)
    control.speed_before, control.speed_now = control.speed_now, abs(state.plate_speed)
    control.streak = 0
    control.patience = patience_of(limits)
