"""A long step of collocation: stick on its slow manifold, and slip where the linear part is stiff.

Radau IIA with 16 nodes, order 31, on a ladder of rungs whose linear parts are precomputed (`collocation`). In stick
it is a forced oscillator with a slaved creep: mubar follows the demand, and a few steps make a cycle.

A step takes the longest rung whose error is expected to pass, the error of a polynomial of degree s going as h^s
(K. Gustafsson's elementary controller; E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Sec. IV.8).
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.solvers.collocation import DEGREE, FROM_ANGLE, FROM_MEAN, FROM_SPEED, FROM_WAVES, NODES, TERMS, C, Tables
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.excitation import Pulsation, load_and_rate, torque_beside_mean
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.solvers.smoothed.series_step import rate_of_law
from tcc_sim.solvers.smoothed.setup import ACCEPTED, CREEP, REFUSED, Limits, Place, Step
from tcc_sim.solvers.smoothed.stages import (
    add_share,
    add_slip,
    follow_manifold,
    guess,
    slip_polynomial,
    solve_stages,
    to_powers,
)
from tcc_sim.solvers.terms import Terms

BEFORE_FOLD = 0.8
"""Length of a step that ends before the demand passes the peak, per time to the node where it does."""
WORTH = 20.0
"""Step times rho above which a collocation step, the price of ten series steps, passes over more than those could."""
FLAT = 0.04
"""Least slope of mubar, relative to sigma, by which an error of v in stick is weighed: on a flat law friction is exact
without v, but v is what leaves stick."""
CONVERGED = 0.01
"""Error of Newton's method per tolerance of the step."""
SAFETY = 0.85
SHRINK_MOST = 0.25
SMALLEST_ERROR = 1e-9
"""Errors below are rounding, and say nothing of the length."""


@fast
def weigh(state: Any, h: float, limits: Limits, mean_torque: float, waves: Any, profile: Any, work: Any) -> None:
    """How much of every source there is: the start, and the sines of the torque and their quadratures, or the torque at
    the nodes.
    """
    weights = work.weights
    weights[FROM_ANGLE] = state.plate_angle
    weights[FROM_SPEED] = state.plate_speed + limits.kappa * state.slip_speed
    weights[FROM_MEAN] = mean_torque
    if profile is None:
        for i in range(waves.shape[0]):
            wave = waves[i]
            weights[FROM_WAVES + 2 * i] = wave.amplitude * wave.sine
            weights[FROM_WAVES + 2 * i + 1] = wave.amplitude * wave.cosine
    else:
        for i in range(NODES):
            weights[FROM_WAVES + i] = torque_beside_mean(state.tau + C[i] * h, mean_torque, waves, profile)


@fast
def grip_at_nodes(tau: float, h: float, turn: Any, loaded: bool, beta: float, mean_load: float, pulsation: Pulsation,
                  profile: Any, drive: Any, grip: Any) -> None:
    """beta Ts at the nodes of a collocation step."""
    cosine, sine = turn.cosine, turn.sine
    for i in range(NODES):
        load = mean_load
        if profile is not None:
            load = load_and_rate(tau + C[i] * h, pulsation, profile)[0]
        elif pulsation is not None:
            load += pulsation[0] * (drive.load_sine * cosine[i] + drive.load_cosine * sine[i])
        grip[i] = beta * load if loaded else 0.0


@fast
def balance(sources: Any, level: int, work: Any) -> None:
    """b without the share of v(0) at the nodes."""
    work.balance[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, work.balance, sources[level, k].balance, work.weights[k])


@fast
def first_beyond(peak: float, work: Any) -> int:
    """The first node at which friction would have to pass its peak to hold the plate; NODES if there is none."""
    demand, total, grip = work.demand, work.balance, work.grip
    for i in range(NODES):
        demand[i] = total[i] / grip[i]
    for i in range(NODES):
        if not abs(demand[i]) <= peak:
            return i
    return NODES


@fast
def fill_plate(rung: Any, sources: Any, level: int, kappa: float, work: Any) -> None:
    """The polynomials of theta2 and theta2' over the step, and the Chebyshev coefficients of theta2' in
    work.chebyshev.
    """
    rows, slip, weights, chebyshev = work.rows, work.slip, work.weights, work.chebyshev
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, chebyshev, sources[level, k].angle, weights[k])
    add_slip(0, slip, rung.angle, chebyshev)
    to_powers(0, chebyshev, rows[ANGLE])
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, chebyshev, sources[level, k].speed, weights[k])
    add_slip(0, slip, rung.speed, chebyshev)
    to_powers(0, chebyshev, rows[SPEED])
    for i in range(TERMS):
        rows[SPEED, i] -= kappa * rows[SLIP, i]


@fast
def state_at_end(rung: Any, sources: Any, level: int, kappa: float, work: Any, state: Any) -> None:
    """The state at the last node, the end of the rung."""
    slip, weights, end_angle, end_speed = work.slip, work.weights, rung.end_angle, rung.end_speed
    angle, speed = 0.0, 0.0
    for k in range(sources.shape[1]):
        source = sources[level, k]
        angle += weights[k] * source.end_angle
        speed += weights[k] * source.end_speed
    for j in range(NODES):
        angle += slip[j] * end_angle[j]
        speed += slip[j] * end_speed[j]
    state.slip_speed = slip[NODES - 1]
    state.plate_angle = angle
    state.plate_speed = speed - kappa * slip[NODES - 1]


@fast
def rung_below(rungs: Any, level: int, length: float) -> int:
    """The longest rung from `level` on that is at most `length`; their number where there is none."""
    while level < rungs.shape[0] and rungs[level].length > length:
        level += 1
    return level


@fast
def growth(error: float) -> float:
    """Factor to the length at which the error, relative to what is allowed, is expected to be a little below 1."""
    return max(SAFETY * math.exp(-math.log(max(error, SMALLEST_ERROR)) / NODES), SHRINK_MOST)


@fast
def collocation_step(place: Place, room: float, loaded: bool, state: Any, control: Any, limits: Limits, terms: Terms,
                     waves: Any, drive: Any, tables: Tables, work: Any, counters: Any) -> Step:
    """Solve for the rung control.level, or the longest below it that fits into `room` s.

    The polynomial of the slip speed is left in work.rows; `fill_plate` leaves the others. A step that is refused leaves
    the rung to try next, the number of rungs where there is none.
    """
    level = rung_below(tables.rungs, control.level, room)
    worth = -math.inf  # A slope of friction that falls is not a step refused.
    while True:
        control.level = level
        if level >= tables.rungs.shape[0] or tables.rungs[level].length * control.rate < worth:
            return Step(REFUSED, 0.0, 0.0, DEGREE, math.inf)
        h = tables.rungs[level].length
        weigh(state, h, limits, terms.mean_torque, waves, terms.profile, work)
        balance(tables.sources, level, work)
        grip_at_nodes(state.tau, h, tables.turns[level], loaded, limits.beta, terms.mean_load, terms.pulsation,
                      terms.profile, drive, work.grip)
        beyond = first_beyond(limits.peak, work) if control.method == CREEP else NODES
        if beyond == NODES:
            break
        level, worth = rung_below(tables.rungs, level + 1, BEFORE_FOLD * C[beyond] * h), WORTH
    rung = tables.rungs[level]
    accuracy, sharpness = CONVERGED * limits.creep_tolerance, limits.sigma
    if control.method == CREEP:
        guess(0, work.demand, work.slip, place.sign, limits.sigma, terms.stribeck)
        follow_manifold(rung, state.slip_speed, place.sign, limits.sigma, terms.stribeck, work)
    else:
        accuracy = CONVERGED * place.slip_tolerance
        sharpness = rate_of_law(place.region, limits.sigma, terms.stribeck)
        start = work.slip
        for i in range(NODES):
            start[i] = state.slip_speed
    used = solve_stages(rung, state.slip_speed, place, sharpness, limits.sigma, terms.stribeck, accuracy, work)
    counters.iterations += abs(used)
    counters.iterations_max = max(counters.iterations_max, abs(used))
    if used < 0:
        control.level = rung_below(tables.rungs, level + 1, 0.5 * h)
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
        error /= place.slip_tolerance
        fill_plate(rung, tables.sources, level, limits.kappa, work)
        error = max(error, max(abs(chebyshev[DEGREE]), abs(chebyshev[DEGREE - 1])) / place.speed_tolerance)
    if not error <= 1.0:
        factor = growth(error) if error < math.inf else SHRINK_MOST
        control.level = rung_below(tables.rungs, level + 1, factor * h)
        return Step(REFUSED, h, 0.0, DEGREE, error)
    control.rate = work.grip[NODES - 1] * work.slope[NODES - 1]
    return Step(ACCEPTED, h, 1.0, DEGREE, error)
