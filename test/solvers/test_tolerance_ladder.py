"""The error of the adaptive engine follows its tolerance down to 1e-13, against SciPy near the end of double
precision.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracle import equations
from scipy.integrate import solve_ivp

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.trajectory import State

SYSTEM = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 45e3, "pressure.frequency_ratio": 0.5,
                            "friction.kinetic_coefficient": 0.24, "engine.frequency": 142.0, "friction.smoothing": 8.0})
"""Stick and slip in turn; the smoothing is one that an explicit method affords."""
START = (5.0, 0.1, -5.0)
SIZE = np.array([10.0, 0.3, 20.0])


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    rates, _ = equations(SYSTEM)
    found = solve_ivp(rates, (0.0, SYSTEM.cycle), [*START, 0.0], "DOP853", rtol=3e-14, atol=1e-15)
    return np.array(found.y[:3, -1])


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
