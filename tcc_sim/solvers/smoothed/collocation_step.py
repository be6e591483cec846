"""A long step of collocation: stick on its slow manifold, and slip where the linear part is stiff.

Radau IIA with 16 nodes, order 31, on a ladder of step sizes whose linear parts are precomputed (`collocation`). In
stick mubar follows the demand, and a few steps make a cycle. A step takes the longest step size whose error is expected
to pass.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast
from tcc_sim.solvers.collocation import DEGREE, NODES, C, Tables
from tcc_sim.solvers.series import SLIP
from tcc_sim.solvers.shared_collocation import (
    SHRINK_MOST,
    balance,
    fill_plate,
    friction_rate_at_nodes,
    growth,
    step_size_below,
    weigh,
)
from tcc_sim.solvers.smoothed.series_step import rate_of_law
from tcc_sim.solvers.smoothed.setup import ACCEPTED, CREEP, REFUSED, Limits, Step
from tcc_sim.solvers.stages import Place, follow_manifold, guess, slip_polynomial, solve_stages
from tcc_sim.solvers.terms import Terms

BEFORE_FOLD = 0.92
"""Longest step per time until the demand passes the peak: a longer one would be refused, since slip speed bends there
as a square root does.
"""
WORTH = 20.0
"""Step times rho above which a collocation step, which costs ten series steps, is longer than those."""
FLAT = 0.04
"""Least slope of mubar, relative to sigma, that weighs an error of v in stick: flat friction does not depend on v, but
the end of stick does."""
CONVERGED = 0.01
"""Error of Newton's method per tolerance of the step."""
ROUNDED = 2e-15
"""Rounding of the last coefficients of slip and plate speed in slip, of the size of the slip speed, since the plate
speed is a difference. Smaller coefficients count as so large: the next step's length must not depend on rounding."""
NEXT = 2.5e-4
"""Error from which `growth` leads to the next longer step, a factor of 2^0.5; at most so much counts for rounding."""


@fast
def time_to_fold(peak: float, work: Any) -> float:
    """Return the time, per length of the step, at which friction would have to pass its peak to hold the plate.

    Lines join the demand at the nodes, and the last one goes on; infinity where it does not rise.
    """
    demand, total, friction_rate = work.demand, work.balance, work.friction_rate
    for i in range(NODES):
        demand[i] = total[i] / friction_rate[i]
    beyond = 0
    while beyond < NODES and abs(demand[beyond]) <= peak:
        beyond += 1
    end = min(beyond, NODES - 1)
    if end == 0:
        return float(C[0])
    before = abs(demand[end - 1])
    rise = abs(demand[end]) - before
    if rise > 0.0:
        return float(C[end - 1] + (peak - before) / rise * (C[end] - C[end - 1]))
    return math.inf if beyond == NODES else float(C[end])


@fast
def collocation_step(place: Place, remaining: float, loaded: bool, state: Any, control: Any, limits: Limits,
                     terms: Terms, waves: Any, drive: Any, tables: Tables, work: Any, counters: Any) -> Step:
    """Solve on the step size control.level, or the longest below it that fits into `remaining` s.

    Fills the polynomial of the slip speed in work.rows; `fill_plate` fills the others. A refused step sets
    control.level to the step size to try next, or to the number of step sizes if there is none.
    """
    level = step_size_below(tables.step_sizes, control.level, remaining)
    worth = -math.inf  # A falling slope of friction does not refuse a step.
    while True:
        control.level = level
        if level >= tables.step_sizes.shape[0] or tables.step_sizes[level].length * control.rate < worth:
            return Step(REFUSED, 0.0, 0.0, DEGREE, math.inf)
        h = tables.step_sizes[level].length
        weigh(state, h, limits.kappa, terms.mean_torque, waves, terms.profile, work)
        balance(tables.sources, level, work)
        friction_rate_at_nodes(state.tau, h, tables.turns[level], loaded, limits.beta, terms.mean_load, terms.pulsation,
                               terms.profile, drive, work.friction_rate)
        longest = BEFORE_FOLD * time_to_fold(limits.peak, work) if control.method == CREEP else math.inf
        if longest >= 1.0:
            break
        level, worth = step_size_below(tables.step_sizes, level + 1, longest * h), WORTH
    step_size = tables.step_sizes[level]
    accuracy, sharpness = CONVERGED * limits.creep_tolerance, limits.sigma
    if control.method == CREEP:
        guess(0, work.demand, work.slip, place.sign, limits.sigma, terms.stribeck)
        follow_manifold(step_size, state.slip_speed, place.sign, limits.sigma, terms.stribeck, work)
    else:
        accuracy = CONVERGED * place.slip_tolerance
        sharpness = rate_of_law(place.region, limits.sigma, terms.stribeck)
        start = work.slip
        for i in range(NODES):
            start[i] = state.slip_speed
    used = solve_stages(step_size, state.slip_speed, place, sharpness, limits.sigma, terms.stribeck, accuracy, work)
    counters.iterations += abs(used)
    counters.iterations_max = max(counters.iterations_max, abs(used))
    if used < 0:
        control.level = step_size_below(tables.step_sizes, level + 1, 0.5 * h)
        return Step(REFUSED, h, 0.0, DEGREE, math.inf)
    slip_polynomial(0, work.slip, state.slip_speed, work.chebyshev, work.rows[SLIP])
    chebyshev = work.chebyshev
    error = max(abs(chebyshev[DEGREE]), abs(chebyshev[DEGREE - 1]))
    if control.method == CREEP:
        slope = work.slope
        steepest = 0.0
        for i in range(NODES):
            steepest = max(steepest, slope[i])
        error *= max(steepest / limits.sigma, FLAT) / limits.creep_tolerance
    else:
        rounding = ROUNDED * abs(state.slip_speed)
        fill_plate(step_size, tables.sources, level, limits.kappa, work)
        last = max(abs(chebyshev[DEGREE]), abs(chebyshev[DEGREE - 1]))
        error = max((error - rounding) / place.slip_tolerance, (last - rounding) / place.speed_tolerance)
        error = max(error, min(rounding / place.speed_tolerance, NEXT))
    if not error <= 1.0:
        factor = growth(error) if error < math.inf else SHRINK_MOST
        control.level = step_size_below(tables.step_sizes, level + 1, factor * h)
        return Step(REFUSED, h, 0.0, DEGREE, error)
    control.rate = work.friction_rate[NODES - 1] * work.slope[NODES - 1]
    return Step(ACCEPTED, h, 1.0, DEGREE, error)
