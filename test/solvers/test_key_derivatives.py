"""Derivatives of the equations' numbers by scene keys, against differences of the numbers themselves."""

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers.key_derivatives import NUMBERS, OF_ITSELF, key_derivatives

SYSTEM = replace(System(), {"pressure.phase": 0.7, "pressure.amplitude": 4e4})
KEYS = [*OF_ITSELF, "engine.frequency", "friction.static_coefficient", "friction.kinetic_coefficient", "clutch.area",
        "clutch.radius", "pressure.mean", "pressure.amplitude"]


def numbers(system):
    """The numbers of the equations from the paper's formulas."""
    d, e, p, f = system.driveline, system.engine, system.pressure, system.friction
    load = f.kinetic_coefficient * system.clutch.area * system.clutch.radius
    ratio = f.static_coefficient / f.kinetic_coefficient
    return np.array([d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness, e.mean_torque, e.torque_amplitude,
                     load * p.mean, load * p.amplitude, p.phase, ratio - 1.0, f.decay, f.smoothing,
                     math.log(e.frequency), ratio, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_are_those_of_the_numbers(key):
    value = dict(values_of(SYSTEM))[key]
    step = 1e-4 * value
    one, two = (numbers(replace(SYSTEM, {key: value + s * step})) - numbers(replace(SYSTEM, {key: value - s * step}))
                for s in (1.0, 2.0))
    expected = (8.0 * one - two) / 4.0 / (3.0 * step)  # Both differences together: of fourth order.
    found = key_derivatives(SYSTEM, [key])[:, 0]
    np.testing.assert_allclose(found * value, expected * value, rtol=1e-10, atol=1e-10 * np.abs(numbers(SYSTEM)).max())
    assert found.shape == (len(NUMBERS),)


def test_several_keys_are_columns():
    found = key_derivatives(SYSTEM, KEYS)
    assert found.shape == (len(NUMBERS), len(KEYS))
    assert all(found[:, k] == pytest.approx(key_derivatives(SYSTEM, [key])[:, 0]) for k, key in enumerate(KEYS))


@pytest.mark.parametrize(("key", "words"), [
    ("friction.law", "continuously"), ("initial.slip_speed", "continuously"),
    ("pressure.frequency_ratio", "continuously"), ("friction.curve.rate_1", "no friction.slip_speeds"),
    ("engine.frequncy", "did you mean engine.frequency"), ("engine.harmonic_amplitudes", "continuously")])
def test_keys_without_a_derivative(key, words):
    with pytest.raises(InputError, match=words):
        key_derivatives(SYSTEM, [key])
