"""Derivatives of the set-valued stroboscopic map: against differences of fourth order, closed forms and Den Hartog."""

import math

import numpy as np
import pytest

from tcc_sim.continuation.motions import ContinuationPlan, check
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.solvers import solve
from tcc_sim.solvers.event_driven.margins import ARRIVAL, GRADIENT, GRAZING, STUCK, VALUE
from tcc_sim.solvers.key_derivatives import OF_ITSELF
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.trajectory import State

MU_K, MU_S, OMEGA = "friction.kinetic_coefficient", "friction.static_coefficient", "engine.frequency"
BASE = replace(System(), {"friction.law": "set_valued", "pressure.mean": 225e3, "pressure.amplitude": 0.0})
KEYS = tuple(k for k in (*OF_ITSELF, OMEGA, MU_S, MU_K, "clutch.area", "clutch.radius", "pressure.mean",
                         "pressure.amplitude") if k != "friction.smoothing")
CASES = {
    "stick-slip": {"pressure.amplitude": 40e3, "pressure.phase": 0.7},
    "pressure at 3/2": {"pressure.amplitude": 100e3, "pressure.frequency_ratio": 1.5},
    "reversals": {"engine.mean_torque": 20.0, "engine.torque_amplitude": 900.0, "pressure.amplitude": 20e3},
    "clamped": {"pressure.amplitude": 300e3, "pressure.phase": 0.3},
    "harmonics": {"engine.harmonic_amplitudes": (100.0, 50.0), "engine.harmonic_phases": (0.3, 1.0),
                  "pressure.amplitude": 30e3},
    "r = 2": {MU_K: 0.15, "pressure.mean": 300e3, "pressure.amplitude": 50e3},
    "stick": {"pressure.mean": 600e3, "pressure.amplitude": 20e3},
}
START = np.array([3.0, 0.1, 2.0])


def difference(value, step):
    """The derivative at 0 of a function of one number, to fourth order."""
    at = [np.asarray(value(k * step)) for k in (-2.0, -1.0, 1.0, 2.0)]
    return (8.0 * (at[2] - at[1]) - (at[3] - at[0])) / (12.0 * step)


def by_key(system, key, function):
    """The derivative of a function of the system by one of its keys."""
    at = dict(values_of(system))[key]
    return difference(lambda d: function(replace(system, {key: at + d})), 1e-5 * max(abs(at), 1.0))


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_the_map(name):
    system, start = replace(BASE, CASES[name]), START if name != "stick" else START * [0.0, 1.0, 1.0]
    keys = [k for k in KEYS if k != "pressure.phase" or dict(values_of(system))["pressure.amplitude"] > 0.0]
    found = stroboscopic_map(system, start, 2, start_cycle=3, parameters=keys)
    solved = solve(system, cycles=2, start_cycle=3, state=State(*start), rtol=1e-12)
    np.testing.assert_allclose(found.state, solved.cycles.section[-1], rtol=1e-10, atol=1e-11)
    assert [(b, a) for _, b, a in found.moves] == list(zip(solved.transitions.before, solved.transitions.after))
    np.testing.assert_allclose([t for t, _, _ in found.moves], solved.transitions.time, atol=1e-12)
    np.testing.assert_allclose(found.heights, np.maximum(solved.cycles.highest, -solved.cycles.lowest), atol=1e-9)
    assert found.stick_time == pytest.approx(solved.cycles.stick_time.sum(), abs=1e-12)

    def end(of, x=start):
        return stroboscopic_map(of, np.asarray(x), 2, start_cycle=3).state

    first = 1 if name == "stick" else 0
    for k, step in list(enumerate((1e-3, 1e-5, 1e-3)))[first:]:
        expected = difference(lambda d, k=k: end(system, start + d * np.eye(3)[k]), step)
        np.testing.assert_allclose(found.derivative[:, k], expected, rtol=1e-7, atol=3e-9 / step * 1e-3)
    for k, key in enumerate(keys):
        expected = by_key(system, key, end)
        size = max(np.abs(expected).max(), 1e-1 / max(abs(dict(values_of(system))[key]), 1.0))
        np.testing.assert_allclose(found.by_parameter[:, k] / size, expected / size, atol=3e-7, err_msg=key)


def test_equal_coefficients_have_one_sided_derivatives():
    system = replace(BASE, {MU_K: 0.3})
    found = stroboscopic_map(system, START, 2, parameters=(MU_K, OMEGA, "friction.decay"))
    ends = [stroboscopic_map(replace(system, {MU_K: 0.3 - k * 1e-5}), START, 2).state for k in range(5)]
    weights = np.array([25.0, -48.0, 36.0, -16.0, 3.0]) / (12.0 * 1e-5)
    np.testing.assert_allclose(found.by_parameter[:, 0], weights @ np.array(ends), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.by_parameter[:, 1],
                               by_key(system, OMEGA, lambda s: stroboscopic_map(s, START, 2).state),
                               rtol=1e-7, atol=1e-9)
    assert not found.by_parameter[:, 2].any()


def test_pure_stick_has_the_multipliers_of_one_oscillator_and_nought():
    system = replace(BASE, {"pressure.mean": 600e3})
    found = stroboscopic_map(system, np.array([0.0, 0.1, 0.0]), 1)
    assert found.events == "S"
    assert not found.derivative[:, 0].any()
    assert not found.derivative[0].any()
    roots = np.roots([0.22, 0.6, 3000.0]) * system.cycle
    own = np.linalg.eigvals(found.derivative)
    assert sorted(own, key=lambda m: (round(abs(m), 9), m.imag)) == pytest.approx(
        [0.0, *sorted(np.exp(roots), key=lambda m: m.imag)], abs=1e-12)


def den_hartog(flywheel):
    """Product of the multipliers of a plate on its spring whose flywheel is so heavy that friction hardly moves it.

    In the plate's angle relative to the flywheel this is x'' + x = cos(beta t) - s sgn x' with beta = 1.3, s = 0.2.
    """
    beta, s, plate = 1.3, 0.2, 0.01
    system = replace(System(), {
        "friction.law": "set_valued", "friction.kinetic_coefficient": 0.3, "driveline.flywheel_inertia": flywheel,
        "driveline.plate_inertia": plate, "driveline.stiffness": plate, "driveline.damping": 0.0, OMEGA: beta,
        "engine.mean_torque": 0.0, "engine.torque_amplitude": flywheel / abs(1.0 / beta**2 - 1.0),
        "pressure.amplitude": 0.0, "pressure.mean": s * plate / (0.3 * 0.008)})
    x = np.array([-1.0, 0.3, 0.5])
    for _ in range(30):
        found = stroboscopic_map(system, x, 1)
        step = np.linalg.solve(np.eye(3) - found.derivative, found.state - x)
        x = x + step * min(1.0, 0.5 / np.abs(step).max())
        if np.abs(step).max() < 1e-11:
            break
    assert found.events in ("+-+", "-+-")
    return float(np.linalg.det(found.derivative))


def test_den_hartogs_oscillator():
    gain, swing = 1.0 / (1.0 - 1.3**2), math.sin(math.pi / 1.3) / (1.3 * (1.0 + math.cos(math.pi / 1.3)))
    largest = math.sqrt(gain**2 - (0.2 * swing) ** 2)
    turning = abs(largest / gain - largest)
    expected = ((turning - 0.2) / (turning + 0.2)) ** 2
    assert expected == pytest.approx(0.7110227238, abs=1e-10)
    one, two = den_hartog(250.0), den_hartog(500.0)
    assert 2.0 * two - one == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("changes", "row", "start"), [
    ({MU_K: 0.3, OMEGA: 41.7}, STUCK, None), ({"engine.mean_torque": 20.0, "engine.torque_amplitude": 900.0}, ARRIVAL,
                                              None),
    ({MU_K: 0.3, OMEGA: 66.0, "pressure.amplitude": 1e3}, GRAZING, np.array([20.0, 0.12, 5.0]))])
def test_margins_have_the_derivatives_of_their_values(changes, row, start):
    system = replace(BASE, changes)
    start = START if start is None else start
    keys = (OMEGA, "pressure.mean", "driveline.stiffness", "engine.torque_amplitude", "driveline.plate_inertia", MU_S)
    keys = keys if MU_K not in changes else keys[:-1]

    def value(of, x=start):
        return stroboscopic_map(of, np.asarray(x), 1, margins=True).margins[row, VALUE]

    found = stroboscopic_map(system, start, 1, parameters=keys, margins=True).margins[row]
    assert math.isfinite(found[VALUE])
    for k, step in enumerate((1e-3, 1e-5, 1e-3)):
        expected = difference(lambda d, k=k: value(system, start + d * np.eye(3)[k]), step)
        assert found[GRADIENT + k] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    for k, key in enumerate(keys):
        expected = by_key(system, key, value)
        assert found[GRADIENT + 3 + k] == pytest.approx(expected, rel=1e-6, abs=1e-6), key


def test_parts_of_cycles_join_to_the_whole():
    system = replace(BASE, CASES["stick-slip"])
    whole = stroboscopic_map(system, START, 2, start_cycle=3, parameters=(OMEGA,))
    x, derivative, by_parameter, stick = START, np.eye(3), np.zeros(3), 0.0
    for start, end in ((3.0, 3.4), (3.4, 4.0), (4.0, 4.3), (4.3, 5.0)):
        part = stroboscopic_map(system, x, end - start, start_cycle=start, parameters=(OMEGA,))
        x, derivative = part.state, part.derivative @ derivative
        by_parameter = part.derivative @ by_parameter + part.by_parameter[:, 0]
        stick += part.stick_time
    np.testing.assert_allclose(x, whole.state, rtol=1e-11)
    np.testing.assert_allclose(derivative, whole.derivative, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(by_parameter, whole.by_parameter[:, 0], rtol=1e-9)
    assert stick == pytest.approx(whole.stick_time, rel=1e-11)


@pytest.mark.parametrize("name", ["reversals", "clamped", "stick-slip"])
def test_heights_have_the_derivatives_of_their_values(name):
    system = replace(BASE, CASES[name])
    found = stroboscopic_map(system, START, 2, parameters=(OMEGA, "pressure.mean"))
    for k, step in enumerate((1e-3, 1e-5, 1e-3)):
        expected = difference(lambda d, k=k: stroboscopic_map(system, START + d * np.eye(3)[k], 2).heights, step)
        np.testing.assert_allclose(found.heights_by_state[:, k], expected, rtol=1e-6, atol=1e-7)
    for k, key in enumerate((OMEGA, "pressure.mean")):
        expected = by_key(system, key, lambda of: stroboscopic_map(of, START, 2).heights)
        np.testing.assert_allclose(found.heights_by_parameter[:, k], expected, rtol=1e-6, atol=1e-9)


def test_keys_without_a_derivative():
    with pytest.raises(InputError, match="continuously"):
        stroboscopic_map(BASE, START, 1, parameters=("pressure.frequency_ratio",))


def test_a_damper_too_stiff_for_derivatives_is_refused_with_the_reason():
    """Stiff arcs step over what decays at C23/I2; derivatives do not, and 1e5 of their steps would make a hundredth of
    a cycle. At a thousandth of that rate they are those of the motion all the same.
    """
    light = {"friction.law": "set_valued", "driveline.damping": 1e4, "driveline.plate_inertia": 1e-5}
    with pytest.raises(InputError, match=r"driveline.damping is 10000 N m s/rad.* more than \d+ steps a cycle"):
        stroboscopic_map(replace(System(), light), np.array([5.0, 0.1, 0.0]), 1)
    with pytest.raises(InputError, match=r"driveline\.damping is 10000"):
        check(replace(System(), light), ContinuationPlan("engine.mean_torque", 299.0, 301.0))
    system = replace(System(), {**light, "driveline.damping": 10.0})
    found = stroboscopic_map(system, np.array([5.0, 0.1, 0.0]), 1)
    run = solve(system, cycles=1, state=State(5.0, 0.1, 0.0))
    assert found.state[0] == pytest.approx(run.final.slip_speed, rel=1e-9)
