"""Work that collocation steps of both engines share: data at the nodes, the plate's motion, the next step size.

The error of a polynomial of degree s goes as h^s (K. Gustafsson's elementary controller; E. Hairer and G. Wanner,
Solving Ordinary Differential Equations II, Sec. IV.8).
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.compiling.compiled import fast
from tcc_sim.solvers.collocation import FROM_ANGLE, FROM_MEAN, FROM_SPEED, FROM_WAVES, NODES, TERMS, C
from tcc_sim.solvers.excitation import Pulsation, load_and_rate, torque_about_mean
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.solvers.stages import add_share, add_slip, to_powers

SAFETY = 0.85
SHRINK_MOST = 0.25
SMALLEST_ERROR = 1e-9
"""Smaller errors are rounding and do not depend on the length."""


@fast
def weigh(state: Any, h: float, kappa: float, mean_torque: float, waves: Any, profile: Any, work: Any) -> None:
    """Fill the weights of the sources: the start, and the torque's sines and quadratures, or that at the nodes."""
    weights = work.weights
    weights[FROM_ANGLE] = state.plate_angle
    weights[FROM_SPEED] = state.plate_speed + kappa * state.slip_speed
    weights[FROM_MEAN] = mean_torque
    if profile is None:
        for i in range(waves.shape[0]):
            wave = waves[i]
            weights[FROM_WAVES + 2 * i] = wave.amplitude * wave.sine
            weights[FROM_WAVES + 2 * i + 1] = wave.amplitude * wave.cosine
    else:
        for i in range(NODES):
            weights[FROM_WAVES + i] = torque_about_mean(state.tau + C[i] * h, mean_torque, waves, profile)


@fast
def friction_rate_at_nodes(tau: float, h: float, turn: Any, loaded: bool, beta: float, mean_load: float,
                           pulsation: Pulsation, profile: Any, drive: Any, friction_rate: Any) -> None:
    """Fill beta Ts at the nodes of a collocation step."""
    cosine, sine = turn.cosine, turn.sine
    for i in range(NODES):
        load = mean_load
        if profile is not None:
            load = load_and_rate(tau + C[i] * h, pulsation, profile)[0]
        elif pulsation is not None:
            load += pulsation[0] * (drive.load_sine * cosine[i] + drive.load_cosine * sine[i])
        friction_rate[i] = beta * load if loaded else 0.0


@fast
def balance(sources: Any, level: int, work: Any) -> None:
    """Fill b without the share of v(0) at the nodes."""
    work.balance[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, work.balance, sources[level, k].balance, work.weights[k])


@fast
def fill_plate(step_size: Any, sources: Any, level: int, kappa: float, work: Any) -> None:
    """Fill the polynomials of theta2 and theta2', and work.chebyshev with the Chebyshev coefficients of theta2'."""
    rows, slip, weights, chebyshev = work.rows, work.slip, work.weights, work.chebyshev
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, chebyshev, sources[level, k].angle, weights[k])
    add_slip(0, slip, step_size.angle, chebyshev)
    to_powers(0, chebyshev, rows[ANGLE])
    chebyshev[:] = 0.0
    for k in range(sources.shape[1]):
        add_share(0, chebyshev, sources[level, k].speed, weights[k])
    add_slip(0, slip, step_size.speed, chebyshev)
    to_powers(0, chebyshev, rows[SPEED])
    for i in range(TERMS):
        rows[SPEED, i] -= kappa * rows[SLIP, i]


@fast
def state_at_end(step_size: Any, sources: Any, level: int, kappa: float, work: Any, state: Any) -> None:
    """Set the state to that at the last node, the end of the step."""
    slip, weights, end_angle, end_speed = work.slip, work.weights, step_size.end_angle, step_size.end_speed
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
def step_size_below(step_sizes: Any, level: int, length: float) -> int:
    """Return the level of the longest step size from `level` on that is at most `length`; their number if none is."""
    while level < step_sizes.shape[0] and step_sizes[level].length > length:
        level += 1
    return level


@fast
def growth(error: float) -> float:
    """Return the factor to the length at which the relative error is expected to be a little below 1."""
    return max(SAFETY * math.exp(-math.log(max(error, SMALLEST_ERROR)) / NODES), SHRINK_MOST)
