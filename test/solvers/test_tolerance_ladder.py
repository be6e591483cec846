"""The error of the adaptive engine follows its tolerance down to 1e-13, against SciPy near the end of double
precision.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.trajectory import State

SYSTEM = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 45e3, "pressure.frequency_ratio": 0.5,
                            "friction.kinetic_coefficient": 0.24, "engine.frequency": 142.0, "friction.smoothing": 8.0})
"""Stick and slip in turn; the smoothing is one that an explicit method affords."""
START = (5.0, 0.1, -5.0)
SIZE = np.array([10.0, 0.3, 20.0])


def rates(t: float, y: np.ndarray) -> list[float]:
    """(2a), (2b), (5b) and (7) written out."""
    v, angle, speed = y.tolist()
    load = 0.24 * 0.08 * 0.1 * (225e3 + 45e3 * math.sin(0.5 * 142.0 * t))
    torque = load * (1.0 + 0.25 * math.exp(-2.0 * abs(v))) * math.tanh(8.0 * v)
    plate = (torque - 0.6 * speed - 3000.0 * angle) / 0.02
    return [(300.0 + 250.0 * math.sin(142.0 * t) - torque) / 0.2 - plate, speed, plate]


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    found = solve_ivp(rates, (0.0, SYSTEM.cycle), START, "DOP853", rtol=3e-14, atol=1e-15)
    return np.array(found.y[:, -1])


@pytest.mark.parametrize("digits", range(3, 14))
def test_the_error_follows_the_tolerance(digits: int, truth: np.ndarray) -> None:
    rtol = 10.0**-digits
    found = solve(SYSTEM, cycles=1, solver="smoothed", rtol=rtol, state=State(*START)).raise_for_status()
    assert found.cycles is not None
    assert len(found.transitions.time) >= 3
    assert np.abs((found.cycles.section[-1] - truth) / SIZE).max() <= 0.1 * rtol + 5e-14


def test_the_tolerance_decides_and_not_a_step_that_is_short_anyway() -> None:
    steps = [solve(SYSTEM, cycles=1, solver="smoothed", rtol=10.0**-digits, state=State(*START)).statistics.steps
             for digits in (3, 6, 9, 12)]
    assert steps == sorted(set(steps))
    assert steps[-1] < 20 * steps[0]
