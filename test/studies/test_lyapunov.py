"""The largest Lyapunov exponent where it is known: stick, slip, and a periodic motion from its Floquet multipliers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import State, solve
from tcc_sim.studies.lyapunov import diagnosis, largest_lyapunov_exponent

BASE = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
        "engine.frequency": 139.0}


def test_in_stick_it_is_the_decay_of_the_stuck_oscillator() -> None:
    system = replace(System(),
                     {**BASE, "pressure.mean": 400e3, "engine.torque_amplitude": 20.0, "friction.smoothing": 1e6})
    end = solve(system, cycles=40, solver="fixed_step").final
    found = largest_lyapunov_exponent(system, end, cycles=100)
    assert found.exponent == pytest.approx(-0.6 / (2.0 * 0.22), rel=1e-3)


def test_in_slip_at_constant_friction_it_is_zero() -> None:
    system = replace(System(), {**BASE, "engine.mean_torque": 540.0})
    found = largest_lyapunov_exponent(system, State(150.0, 0.18, 0.0), cycles=100)
    assert found.exponent == pytest.approx(0.0, abs=1e-2)


def test_on_a_periodic_motion_it_is_the_floquet_exponent() -> None:
    """The multipliers are those of the stroboscopic map, by central differences of SciPy's Radau method."""
    system = replace(System(), {**BASE, "friction.kinetic_coefficient": 0.94 * 0.3})
    end = solve(system, cycles=300, solver="fixed_step", step=1e-4).final
    at = np.array([end.slip_speed, end.plate_angle, end.plate_speed])

    def image(x: np.ndarray) -> np.ndarray:
        last = solve(system, cycles=1, solver="radau", rtol=1e-11, state=State(*x)).final
        return np.array([last.slip_speed, last.plate_angle, last.plate_speed])

    for _ in range(2):
        at = image(at)
    columns = []
    for k, step in enumerate((1e-3, 1e-6, 1e-3)):
        d = np.zeros(3)
        d[k] = step
        columns.append((image(at + d) - image(at - d)) / (2.0 * step))
    largest = float(np.abs(np.linalg.eigvals(np.stack(columns, axis=1))).max())
    found = largest_lyapunov_exponent(system, end, cycles=200, period=1)
    assert found.exponent == pytest.approx(math.log(largest) / system.cycle, rel=2e-2)
    assert found.low <= found.exponent <= found.high
    assert found.diagnosis == "periodic"


def test_diagnosis_looks_at_the_whole_interval() -> None:
    assert diagnosis(0.2, 0.1, 0) == "chaotic"
    assert diagnosis(0.2, 0.3, 0) == "unresolved"
    assert diagnosis(0.001, 0.004, 0) == "quasi-periodic"
    assert diagnosis(-0.2, 0.01, 0) == "unresolved"
    assert diagnosis(0.2, 0.1, 4) == "periodic"


def test_wrong_input_is_refused() -> None:
    with pytest.raises(InputError, match="set_valued"):
        largest_lyapunov_exponent(replace(System(), {"friction.law": "set_valued"}), State(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="cycles"):
        largest_lyapunov_exponent(System(), State(0.0, 0.0, 0.0), cycles=3)
