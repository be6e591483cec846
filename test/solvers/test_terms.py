"""Derivatives of the numbers of the equations by scene keys."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.equations import COEFFICIENTS
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers.key_derivatives import NUMBERS, OF_ITSELF, key_derivatives

SYSTEM = replace(System(), {"converter.coupling": 1.5, "pressure.phase": 0.7, "pressure.amplitude": 4e4})
KEYS = [*COEFFICIENTS, *OF_ITSELF, "engine.frequency", "friction.static_coefficient", "friction.kinetic_coefficient",
        "clutch.area", "clutch.radius", "pressure.mean", "pressure.amplitude"]


def numbers(system):
    """The numbers of the equations from the paper's formulas."""
    d, e, p, f = system.driveline, system.engine, system.pressure, system.friction
    load = f.kinetic_coefficient * system.clutch.area * system.clutch.radius
    ratio = f.static_coefficient / f.kinetic_coefficient
    return np.array([d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness, system.converter.coupling, 0.0,
                     -system.converter.coupling, e.mean_torque,
                     e.torque_amplitude, load * p.mean, load * p.amplitude, p.phase, ratio - 1.0, f.decay, f.smoothing,
                     math.log(e.frequency), ratio, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_are_those_of_the_numbers(key):
    value = dict(values_of(SYSTEM))[key]
    step = 1e-4 * value
    one, two = (numbers(replace(SYSTEM, {key: value + s * step})) - numbers(replace(SYSTEM, {key: value - s * step}))
                for s in (1.0, 2.0))
    expected = (8.0 * one - two) / 4.0 / (3.0 * step)  # Both differences together: of fourth order.
    result = key_derivatives(SYSTEM, [key])[:, 0]
    np.testing.assert_allclose(result * value, expected * value, rtol=1e-10, atol=1e-10 * np.abs(numbers(SYSTEM)).max())
    assert result.shape == (len(NUMBERS),)


def test_an_amplitude_that_no_excitation_has_changes_nothing():
    """Where torque and pressure come from topics and hold their mean without one."""
    held = replace(SYSTEM, {f"{part}.{name}": value for part in ("engine", "pressure")
                            for name, value in (("source", "topic"), ("fallback", "mean"))})
    for key in ("engine.torque_amplitude", "pressure.amplitude"):
        assert key_derivatives(SYSTEM, [key]).any()
        assert not key_derivatives(held, [key]).any()


@pytest.mark.parametrize(("key", "words"), [
    ("friction.law", "continuously"), ("initial.slip_speed", "continuously"),
    ("pressure.frequency_ratio", "continuously"), ("friction.curve.rate_1", "no friction.slip_speeds"),
    ("engine.frequncy", "did you mean engine.frequency"), ("engine.harmonic_amplitudes", "continuously")])
def test_keys_without_a_derivative(key, words):
    with pytest.raises(InputError, match=words):
        key_derivatives(SYSTEM, [key])
