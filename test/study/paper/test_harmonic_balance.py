"""The series (30) to (34) with their mean terms: against SciPy's integration, and where the printed ones fail."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.parameters import System, replace
from tcc_sim.study.paper.harmonic_balance import harmonic_balance, mean_friction_torque, series

BASE = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 0.25 * 225e3, "engine.frequency": 150.0,
                          "friction.kinetic_coefficient": 0.3, "friction.smoothing": 5.0})
"""Fig. 12 with a softer law, so that few harmonics and an explicit method are enough."""


def rates(system, t, y):
    e, p, d = system.engine, system.pressure, system.driveline
    load = system.torque_per_pressure * (p.mean + p.amplitude * math.sin(p.frequency_ratio * e.frequency * t + p.phase))
    torque = load * math.tanh(system.friction.smoothing * y[0])
    plate = (torque - d.damping * y[2] - d.stiffness * y[1]) / d.plate_inertia
    return [(e.mean_torque + e.torque_amplitude * math.sin(e.frequency * t) - torque) / d.flywheel_inertia - plate,
            y[2], plate]


@pytest.mark.parametrize(("ratio", "phase", "period"), [(1.0, 0.0, 1), (0.5, 1.0, 2)])
def test_the_corrected_series_is_the_motion(ratio, phase, period):
    system = replace(BASE, {"pressure.frequency_ratio": ratio, "pressure.phase": phase})
    result = harmonic_balance(system, period, 80)
    end = 60 * system.cycle
    t = np.linspace(end, end + period * system.cycle, 101)
    run = solve_ivp(lambda t, y: rates(system, t, y), (0.0, t[-1]), [5.0, 0.1, 0.0], t_eval=t, method="LSODA",
                    rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(result.slip_speed(t), run.y[0], atol=1e-2 * np.abs(run.y[0]).max())
    assert result.residual < 1e-7
    assert result.slip[0] > 0.1  # The mean that (30) has not.
    assert mean_friction_torque(system, result.coefficient, period) == pytest.approx(300.0, abs=1e-6)


def test_the_printed_series_cannot_carry_the_mean_torque():
    system = replace(BASE, {"pressure.frequency_ratio": 0.5})
    bound = 2.0 / math.pi * system.engine.torque_amplitude
    result = harmonic_balance(system, 2, 40)
    assert abs(mean_friction_torque(system, result.coefficient, 2, printed=True)) <= bound < 300.0
    # The bound itself: a coefficient of +-1 in step with the printed sine of omega/N.
    square = np.zeros(81)
    square[40 + 1:][::2] = 4.0 / math.pi / np.arange(1, 41, 2)
    assert series(square, 1.0, np.array([1.5]))[0] == pytest.approx(1.0, abs=0.05)
    assert mean_friction_torque(system, square, 2, printed=True) == pytest.approx(bound)


def test_a_falling_law_balances_too():
    system = replace(BASE, {"friction.kinetic_coefficient": 0.27, "friction.decay": 0.3})
    result = harmonic_balance(system, 1, 40)
    assert mean_friction_torque(system, result.coefficient, 1) == pytest.approx(300.0, abs=1e-6)
    assert result.residual < 1e-6


@pytest.mark.parametrize(("values", "period", "count", "word"), [
    ({"friction.law": "set_valued"}, 1, 9, "law"), ({}, 0, 9, "period"), ({}, 1, 0, "harmonics")])
def test_what_has_no_series_is_refused(values, period, count, word):
    with pytest.raises(InputError, match=word):
        harmonic_balance(replace(BASE, values), period, count)


def test_a_remainder_that_rounding_leaves_is_taken_and_a_larger_one_is_not():
    """Cut short, Newton's method has an answer where less than 1e-8 of the torque is left, and none before."""
    soft = replace(BASE, {"friction.smoothing": 3.0})
    cut = harmonic_balance(soft, 1, 16, iterations=6)
    assert 1e-8 < cut.residual < 1e-5
    with pytest.raises(NumericalFailure):
        harmonic_balance(soft, 1, 16, iterations=5)
    np.testing.assert_allclose(cut.slip, harmonic_balance(soft, 1, 16).slip, atol=1e-8)
