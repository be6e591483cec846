"""The smoothed model over an engine cycle with its tangent and with integrals along the motion, to a tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiling.compiled import compiled, saturation_torque, smoothed_and_slope
from tcc_sim.solvers.radau_step import (
    NODES,
    carry_tangent,
    end_of_step,
    plate_of_step,
    slip_within,
    stages_of_step,
    workspace,
)
from tcc_sim.solvers.terms import Terms, excitation_frequency, natural_frequency, stick_speed_of, terms_of
from tcc_sim.trajectory import Floats

RESOLUTION = 0.3
"""Largest phase of the fastest oscillation in one step, rad: what lies between the stages is not looked at."""
STEP_LIMIT = 1_000_000
"""Steps of an engine cycle."""
SHORTEST = 1e-17
"""Step, relative to the cycle, below which the motion is given up."""
GAUSS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(6))
"""Half the abscissae and weights of the six-point rule."""


def passed(system: System, state: Floats, tangent: Floats, first: int, tolerance: float,
           integrals: Floats | None = None) -> bool:
    """Take state and tangent over engine cycle number `first`, in place; False where the steps do not get through.

    Parameters
    ----------
    system : with the smoothed law
    state : (3,) array: slip speed, plate angle, plate speed (rad/s, rad, rad/s)
    tangent : (3, k) array of disturbances of the state
    first : number of the cycle, which sets the phase of the load
    tolerance : local error relative to the size of the motion, and of the slip speed within its layer
    integrals : (3,) array to which the integrals over time of dT/dv v^2, v^2 and min(dT/dv, 0) are added; see (21)
    """
    terms = terms_of(system)
    return bool(pass_cycle(state, tangent, first, tolerance, system.cycle, longest_step(terms), scales_of(terms),
                           stick_speed_of(terms), terms, workspace(tangent.shape[1]), integrals))


def longest_step(terms: Terms) -> float:
    """The longest step, s."""
    return RESOLUTION / max(natural_frequency(terms), excitation_frequency(terms))


def scales_of(terms: Terms) -> tuple[float, float, float]:
    """The sizes of slip speed within its layer (rad/s), plate angle (rad) and plate speed (rad/s) of a motion."""
    assert terms.smoothing is not None
    torque = abs(terms.mean_torque) + abs(terms.mean_load) + (terms.torque[0] if terms.torque is not None else 0.0)
    angle = max(torque, 1.0) / terms.linear[3]
    speed = angle * natural_frequency(terms)
    return max(min(50.0 / terms.smoothing, speed), 1e-6 * speed), angle, speed


@compiled
def _integrate(h: float, load_time: float, start: float, stages: Floats, peak: float, terms: Any,
               integrals: Floats) -> None:
    """Add a step's integrals, in parts that end where |v| crosses the peak of mubar: there dT/dv changes its sign."""
    a = 0.0
    while a < 1.0:
        b, within = 1.0, abs(slip_within(a + 1e-9, start, stages)) < peak
        for k in range(1, 9):
            x = a + (1.0 - a) * k / 8.0
            if (abs(slip_within(x, start, stages)) < peak) != within:
                low, high = a + (1.0 - a) * (k - 1) / 8.0 + (1e-9 if k == 1 else 0.0), x
                while high - low > 1e-13:
                    middle = 0.5 * (low + high)
                    if (abs(slip_within(middle, start, stages)) < peak) != within:
                        high = middle
                    else:
                        low = middle
                b = high
                break
        for k in range(len(GAUSS)):
            x = 0.5 * (a + b) + GAUSS[k] * (b - a)
            v = slip_within(x, start, stages)
            load = saturation_torque(load_time + x * h, terms.mean_load, terms.pulsation)
            slope = load * smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1]
            weight = WEIGHTS[k] * (b - a) * h
            integrals[0] += weight * slope * v * v
            integrals[1] += weight * v * v
            integrals[2] += weight * min(slope, 0.0)
        a = b


@compiled
def pass_cycle(state: Floats, tangent: Floats, number: int, tolerance: float, cycle: float, longest: float,
               scales: tuple[float, float, float], peak: float, terms: Any, work: Floats,
               integrals: Floats | None) -> bool:
    """See `passed`. The step size is controlled by the error to the power -1/4, as in Hairer and Wanner, IV.8."""
    at, before = (state[0], state[1], state[2]), number * cycle
    tau, h, previous = 0.0, 0.1 * longest, 0.0
    stages, old = work[6, :3], np.zeros(4)
    for _ in range(STEP_LIMIT):
        h = min(h, longest)
        last = tau + h * (1.0 + 1e-9) >= cycle
        if last:
            h = cycle - tau
        if not h > SHORTEST * cycle:
            return False
        plate_of_step(h, terms.linear, work[:3], work[3:6])
        size = tolerance * (scales[0] + abs(at[0]))
        for i in range(3):
            stages[i] = slip_within(1.0 + NODES[i] * h / previous, old[3], old[:3]) if previous > 0.0 else at[0]
        if not stages_of_step(at, h, tau, before, max(1e-4 * size, 4e-16 * abs(at[0])), terms, work):
            h, previous = 0.25 * h, 0.0
            continue
        sizes = (size, tolerance * scales[1], tolerance * scales[2])
        end, error = end_of_step(at, h, tau, before, sizes, terms, work)
        factor = min(5.0, max(0.2, 0.9 * (error + 1e-12) ** -0.25))
        if not error <= 1.0:
            h, previous = h * min(factor, 0.9), 0.0
            continue
        if integrals is not None:
            _integrate(h, before + tau, at[0], stages, peak, terms, integrals)
        if tangent.shape[1] > 0:
            carry_tangent(h, tangent, terms.linear, work)
        old[:3], old[3], previous = stages, at[0], h
        at = end
        tau += h
        h *= factor
        if last:
            state[0], state[1], state[2] = at
            return True
    return False
