"""The excitation as the smoothed kernel asks for it: constant frequency and means, or a piece of a course."""

from __future__ import annotations

from typing import Any

from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.excitation import clamp_edge, excite, expand_excitation
from tcc_sim.solvers.smoothed.collocation_tables import FROM_WAVES, NODES, C
from tcc_sim.solvers.varying import (
    STARTED,
    edge_varying,
    excite_varying,
    expand_varying,
    load_and_rate,
    torque_beside_mean,
)

Pulsation = Any
"""(Tsp in N m, omega_f in rad/s or rad/rad, psi in rad), or None for a constant load; with a course always there."""


@fast
def edge_after(tau: float, end: float, shift: float, mean_load: float, pulsation: Pulsation,
               course: Any) -> tuple[float, bool]:
    """How far the excitation goes on as it is, at most to `end`, and whether there is a load until then."""
    if course is None:
        return clamp_edge(tau, end, shift, mean_load, pulsation)
    else:
        return edge_varying(tau, end, pulsation, course)


@fast
def excite_now(tau: float, shift: float, loaded: bool, mean_torque: float, waves: Any, mean_load: float,
               pulsation: Pulsation, course: Any, drive: Any) -> None:
    """Fill `drive` and the sines and cosines of `waves` at tau."""
    if course is None:
        excite(tau, shift, loaded, mean_torque, waves, mean_load, pulsation, drive)
    else:
        excite_varying(tau, loaded, waves, pulsation, course, drive)


@fast
def expand_drive(rows: Any, count: int, unit: float, tau: float, loaded: bool, mean_torque: float, waves: Any,
                 mean_load: float, pulsation: Pulsation, course: Any, drive: Any) -> None:
    """The first `count` Taylor coefficients in t/unit of Te and Ts about tau."""
    if course is None:
        expand_excitation(rows, count, unit, loaded, mean_torque, waves, mean_load, pulsation, drive)
    else:
        expand_varying(rows, count, unit, tau, loaded, waves, pulsation, course, drive)


@fast
def weigh_torque(tau: float, h: float, mean_torque: float, waves: Any, course: Any, weights: Any) -> None:
    """How much there is of the sources of a collocation step that are not its start: the sines and their quadratures,
    or the torque at the nodes.
    """
    if course is None:
        for i in range(waves.shape[0]):
            wave = waves[i]
            weights[FROM_WAVES + 2 * i] = wave.amplitude * wave.sine
            weights[FROM_WAVES + 2 * i + 1] = wave.amplitude * wave.cosine
    else:
        for i in range(NODES):
            weights[FROM_WAVES + i] = torque_beside_mean(tau + C[i] * h, mean_torque, waves, course)


@fast
def grip_at_nodes(tau: float, h: float, turn: Any, loaded: bool, beta: float, mean_load: float, pulsation: Pulsation,
                  course: Any, drive: Any, grip: Any) -> None:
    """beta Ts at the nodes of a collocation step."""
    cosine, sine = turn.cosine, turn.sine
    for i in range(NODES):
        load = mean_load
        if course is not None:
            load = load_and_rate(tau + C[i] * h, pulsation, course)[0]
        elif pulsation is not None:
            load += pulsation[0] * (drive.load_sine * cosine[i] + drive.load_cosine * sine[i])
        grip[i] = beta * load if loaded else 0.0


@fast
def started(cycle: int, period: float, course: Any) -> float:
    """When the engine cycle of this number started, s."""
    if course is None:
        return cycle * period
    else:
        return float(course[STARTED])
