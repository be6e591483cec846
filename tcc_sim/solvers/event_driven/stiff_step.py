"""Steps of an arc whose damper is far faster than everything else: collocation on the ladder of step sizes.

Stability limits the Taylor series of an overdamped plate to steps of a few I2/C23. After the series have followed the
decay of the fast part, collocation (`collocation`, `stages`, `shared_collocation`) takes longer steps. Its result is a
polynomial too, so events and output are those of every other step.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast, lost_torque
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.collocation import DEGREE, NODES, TERMS, C, Tables
from tcc_sim.solvers.event_driven.setup import Bounds
from tcc_sim.solvers.event_driven.step import DOWNWARD, NO_EVENT, UPWARD, Step, slip_event, stick_event
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED, fastest_at
from tcc_sim.solvers.shared_collocation import (
    SHRINK_MOST,
    balance,
    fill_plate,
    friction_rate_at_nodes,
    growth,
    step_size_below,
    weigh,
)
from tcc_sim.solvers.stages import FALLING, SLIDING, Place, slip_polynomial, solve_stages
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, STICK

FRESH = -12
"""Step size of a state whose fast part has not decayed: so many series steps come first, 30 times I2/C23 or more."""
LEAST_TRUNCATION = 1e-11
"""Rounding of the last coefficients, of the size of the signal."""
CANCELLED = 2e-13
"""Rounding of the plate speed, which is a difference, of the size of the slip speed."""
CONVERGED = 0.01
"""Error of Newton's method per tolerance of the step."""


@fast
def law_ahead(state: Any, stribeck: Stribeck, far: float) -> tuple[Place, float, float]:
    """Return region and sign of the state (without tolerances), the law's rate by v, s/rad, and the slip speed at which
    the region ends.
    """
    region, sharpness, level, sign = SLIDING, 0.0, 0.0, 0.0 if state.mode == FREE else float(state.mode)
    if stribeck is not None:  # noqa: SIM102 (Numba leaves out what None rules out only where it is a test of its own)
        if state.mode != FREE:
            level = far
            if sign * state.slip_speed <= 1.01 * level:
                region, sharpness, level = FALLING, fastest_at(stribeck, 0.0), 0.0
    return Place(region, sign, 0.0, 0.0), sharpness, level


@fast
def breakaway_margins(bounds: Bounds, terms: Terms, pulsation: Pulsation, waves: Any, state: Any, drive: Any, h: float,
                      work: Any) -> None:
    """Fill rows UPWARD and DOWNWARD of a step in stick: the margins to breakaway."""
    rows, nodes = work.rows, work.demand
    linear = terms.linear
    flywheel, plate, damping, stiffness = linear.flywheel, linear.plate, linear.damping, linear.stiffness
    for i in range(NODES):
        nodes[i] = terms.mean_torque
        for k in range(waves.shape[0]):
            nodes[i] += waves[k].amplitude * math.sin(waves[k].rate * (state.tau + C[i] * h) + waves[k].phase)
    slip_polynomial(0, nodes, drive.torque, work.chebyshev, rows[UPWARD])
    for i in range(NODES):
        nodes[i] = terms.mean_load
        if pulsation is not None:
            nodes[i] += pulsation[0] * math.sin(pulsation[1] * (state.tau + C[i] * h) + state.shift)
    slip_polynomial(0, nodes, drive.load, work.chebyshev, rows[DOWNWARD])
    for k in range(TERMS):
        engine = rows[UPWARD, k] - lost_torque(0.0, rows[SPEED, k], None, linear.flywheel_by_speed)
        need = (plate * engine + flywheel * (damping * rows[SPEED, k] + stiffness * rows[ANGLE, k])) / (
            flywheel + plate)
        load = bounds.ratio * rows[DOWNWARD, k]
        rows[UPWARD, k], rows[DOWNWARD, k] = load - need, load + need


@fast
def error_of(chebyshev: Any, tolerance: float) -> float:
    """Return the size of a polynomial's last coefficients per tolerance."""
    return float(max(abs(chebyshev[DEGREE]), abs(chebyshev[DEGREE - 1])) / tolerance)


@fast
def error_of_step(bounds: Bounds, terms: Terms, waves: Any, place: Place, sharpness: float, state: Any, drive: Any,
                  tables: Tables, work: Any) -> float:
    """Solve on the step size state.level; return the error of its polynomials, infinite where there are none."""
    level, slip, chebyshev = state.level, work.slip, work.chebyshev
    step_size = tables.step_sizes[level]
    flywheel, plate = terms.linear.flywheel, terms.linear.plate
    kappa, goal = flywheel / (flywheel + plate), max(bounds.truncation, LEAST_TRUNCATION)
    weigh(state, step_size.length, kappa, terms.mean_torque, waves, None, work)
    for i in range(NODES):
        slip[i] = state.slip_speed
    error = 0.0
    if state.mode == STICK:
        for k in range(TERMS):
            work.rows[SLIP, k] = 0.0
    else:
        tolerance = goal * max(abs(state.slip_speed), bounds.creep)
        balance(tables.sources, level, work)
        friction_rate_at_nodes(state.tau, step_size.length, tables.turns[level], state.mode != FREE,
                               1.0 / flywheel + 1.0 / plate,
                               terms.mean_load, terms.pulsation, None, drive, work.friction_rate)
        if solve_stages(step_size, state.slip_speed, place, sharpness, None, terms.stribeck, CONVERGED * tolerance,
                        work) < 0:
            return math.inf
        slip_polynomial(0, slip, state.slip_speed, chebyshev, work.rows[SLIP])
        error = error_of(chebyshev, tolerance)
    fill_plate(step_size, tables.sources, level, kappa, work)
    speed = max(abs(state.plate_speed), bounds.creep)
    return max(error, error_of(chebyshev, max(goal * speed, CANCELLED * abs(state.slip_speed))))


@fast
def stiff_arc(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any, remaining: float, tables: Tables,
              work: Any) -> Step:
    """Return a step of any mode of at most `remaining` s, on the step size state.level or below, and adapt that; of
    degree 0 if no step size meets the tolerance, and series go on.
    """
    step_sizes = tables.step_sizes
    place, sharpness, end = law_ahead(state, terms.stribeck, bounds.far)
    state.level = step_size_below(step_sizes, state.level, remaining)
    while state.level < step_sizes.shape[0]:
        level, h = state.level, step_sizes[state.level].length
        error = error_of_step(bounds, terms, waves, place, sharpness, state, drive, tables, work)
        longest = h * (growth(error) if error < math.inf else SHRINK_MOST)
        if error <= 1.0:
            while level > 0 and step_sizes[level - 1].length <= longest:
                level -= 1
            state.level = level
            if state.mode == STICK:
                breakaway_margins(bounds, terms, terms.pulsation, waves, state, drive, h, work)
                return stick_event(bounds, h, 1.0, DEGREE, work.rows, work.bernstein)
            return slip_event(bounds, h, 1.0, DEGREE, end, state, work.rows, work.bernstein)
        state.level = step_size_below(step_sizes, level + 1, longest)
    return Step(0.0, 0.0, 0, NO_EVENT, 0, 0.0)
