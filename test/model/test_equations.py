"""Terms of the equations of motion, and the friction law's slope, against formulas written out here."""

import math

import numpy as np
import pytest

from tcc_sim.model.equations import saturation_torque
from tcc_sim.model.friction import peak, smoothed_and_slope
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import smooth_corners
from tcc_sim.model.sines import engine_series


@pytest.mark.parametrize("stribeck", [None, (0.5, 0.1), (0.5, 0.1, -0.2, 0.7), (0.5, 0.1, -0.2, 0.7, 0.3, 2.0)])
def test_the_slope_is_the_derivative_of_the_coefficient(stribeck):
    v, sigma, h = np.array([-3.0, -0.2, -0.01, 0.02, 0.3, 4.0]), 8.0, 1e-5

    def coefficient(v):
        falling = sum(c * np.exp(-a * abs(v)) for c, a in zip((stribeck or ())[::2], (stribeck or ())[1::2]))
        return (1.0 + falling) * np.tanh(sigma * v)

    value, slope = smoothed_and_slope(v, sigma, stribeck)
    np.testing.assert_allclose(value, coefficient(v), rtol=1e-13)
    np.testing.assert_allclose(slope, (coefficient(v + h) - coefficient(v - h)) / (2.0 * h), rtol=1e-6, atol=1e-8)


def test_the_load_swings_with_its_own_frequency_and_phase_and_is_never_negative():
    t = np.linspace(0.0, 0.2, 41)
    expected = [max(100.0 + 150.0 * math.sin(80.0 * x + 0.7), 0.0) for x in t]
    np.testing.assert_allclose(saturation_torque(t, 100.0, (150.0, 80.0, 0.7)), expected, atol=1e-11)
    np.testing.assert_array_equal(saturation_torque(t, 100.0, None), np.full(41, 100.0))


def test_a_hump_to_which_friction_rises_from_rest_is_no_peak():
    assert peak(1e3, (0.001, 10.0, -0.5, 2.0, 0.6, 1.0)) == (math.inf, 1.0)


def test_lines_through_smoothed_corners_keep_the_amplitude_of_a_sine():
    """A period has 25 samples, so that the mean over two periods leaves no other part of the course."""
    t = np.linspace(0.0, 0.2, 81)
    w = 2.0 * np.pi / (25.0 * t[1])
    corners = smooth_corners(t, 0.3 * np.sin(w * t))
    at = np.linspace(t[5], t[55], 4001)[:-1]
    for course, error in ((corners, (w * t[1])**4 / 90.0), (0.3 * np.sin(w * t), (w * t[1])**2 / 12.0)):
        amplitude = 2.0 * np.mean(np.interp(at, t, course) * np.sin(w * at))
        assert abs(amplitude / 0.3 - 1.0) == pytest.approx(error, rel=0.05)


def test_a_harmonic_of_amplitude_zero_is_none():
    system = replace(System(), {"engine.harmonic_amplitudes": (0.0, 35.0), "engine.harmonic_phases": (0.3, 0.4)})
    w = system.engine.frequency
    assert 2.0 * w not in engine_series(system).frequency
