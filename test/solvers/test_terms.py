"""Numbers of the equations: derivatives by scene keys, and the cache of results of a system."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.equations import COEFFICIENTS
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers.key_derivatives import NUMBERS, OF_ITSELF, key_derivatives
from tcc_sim.solvers.terms import RESULTS_KEPT, per_system

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


def test_several_keys_are_columns():
    result = key_derivatives(SYSTEM, KEYS)
    assert result.shape == (len(NUMBERS), len(KEYS))
    assert all(result[:, k] == pytest.approx(key_derivatives(SYSTEM, [key])[:, 0]) for k, key in enumerate(KEYS))


@pytest.mark.parametrize(("key", "words"), [
    ("friction.law", "continuously"), ("initial.slip_speed", "continuously"),
    ("pressure.frequency_ratio", "continuously"), ("friction.curve.rate_1", "no friction.slip_speeds"),
    ("engine.frequncy", "did you mean engine.frequency"), ("engine.harmonic_amplitudes", "continuously")])
def test_keys_without_a_derivative(key, words):
    with pytest.raises(InputError, match=words):
        key_derivatives(SYSTEM, [key])


def test_a_result_is_worked_out_once_for_an_object_and_a_number():
    calls = []

    @per_system
    def doubled(system, rtol):
        calls.append((system, rtol))
        return system.engine.frequency * 2.0 + rtol

    one, equal = System(), System()
    assert doubled(one, 1.0) == doubled(one, 1.0) == doubled(equal, 1.0)
    assert doubled(one, 2.0) == doubled(one, 1.0) + 1.0
    assert [(system is one, rtol) for system, rtol in calls] == [(True, 1.0), (False, 1.0), (True, 2.0)]


def test_only_the_last_are_kept_and_threads_do_not_mix_them_up():
    calls = []

    @per_system
    def frequency(system):
        calls.append(system)
        return system.engine.frequency

    systems = [replace(System(), {"engine.frequency": 100.0 + k}) for k in range(3 * RESULTS_KEPT)]
    with ThreadPoolExecutor(4) as executor:
        assert list(executor.map(frequency, systems * 3)) == [system.engine.frequency for system in systems] * 3
    before = len(calls)
    assert frequency(systems[-1]) == systems[-1].engine.frequency
    assert len(calls) == before
    frequency(systems[0])
    assert len(calls) == before + 1
