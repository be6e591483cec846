"""Terms of the equations of motion, the actuator and the friction law, against formulas written out here."""

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model import equations, friction
from tcc_sim.model.actuator import Actuator, approach_between, delay_ticks, pressure_after
from tcc_sim.model.closed_forms import engine_series
from tcc_sim.model.equations import Linear, saturation_torque
from tcc_sim.model.groups import Pressure
from tcc_sim.model.parameters import System, replace

FULL = Linear(0.2, 0.02, 0.6, 3000.0, 0.5, -0.4)
LAWS = [None, (0.5, 0.1), (-0.2, 0.7), (0.5, 0.1, -0.2, 0.7), (0.5, 0.1, -0.2, 0.7, 0.3, 2.0)]
SPEEDS = np.array([-3.0, -0.2, -0.01, 0.02, 0.3, 4.0])


def test_the_linear_part_has_the_keys_of_a_system_and_its_matrix() -> None:
    coupled = replace(System(), {"converter.coupling": 0.8, "driveline.damping": 0.0})
    assert equations.linear_of(System()) == (0.2, 0.02, 0.6, 3000.0, None, None)
    assert equations.completed(equations.linear_of(System())) == (0.2, 0.02, 0.6, 3000.0, 0.0, 0.0)
    assert equations.linear_of(coupled) == (0.2, 0.02, 0.0, 3000.0, 0.8, -0.8)
    assert equations.coefficients_of(FULL) == tuple(FULL)
    assert equations.coefficients_of(Linear(1.0, 2.0, 3.0, 4.0)) == (1.0, 2.0, 3.0, 4.0, 0.0, 0.0)
    matrix = equations.matrix_of(FULL)
    assert matrix == pytest.approx(np.array([[-22.5, 150e3, 30.0], [0.0, 0.0, 1.0], [20.0, -150e3, -30.0]]))
    assert equations.decay_of_slip(FULL) == pytest.approx(-matrix[0, 0])
    state = np.array([3.0, 0.01, -2.0])
    driven, plate = equations.accelerations(*state, 300.0, 200.0, FULL)
    assert (driven, plate) == pytest.approx(((matrix @ state)[0] + 1500.0 - 11000.0, (matrix @ state)[2] + 10000.0))
    moved = equations.accelerations(*state, 300.0, 200.0, FULL, 0.004, -5.0)
    assert np.subtract(moved, (driven, plate)) == pytest.approx([-450.0, 450.0])   # (3000 0.004 - 0.6 5)/0.02
    held = equations.interface_torque(0.01, -2.0, 300.0, FULL)
    assert equations.accelerations(0.0, 0.01, -2.0, 300.0, held, FULL)[0] == pytest.approx(0.0, abs=1e-9)
    assert [equations.lost_torque(3.0, by_slip) for by_slip in (None, 0.5)] == [0.0, 1.5]


def test_the_engine_has_a_mean_and_its_harmonics() -> None:
    t = np.array([0.0, 0.011, 0.3])
    rows = np.array([[300.0, 60.0, 0.4], [450.0, 20.0, -1.0]])
    first, second = 250.0 * np.sin(150.0 * t), sum(a * np.sin(w * t + p) for w, a, p in rows)
    for torque, harmonics, expected in ((None, None, 0.0 * t), ((250.0, 150.0), None, first), (None, rows, second),
                                        ((250.0, 150.0), rows, first + second)):
        assert equations.engine_torque(t, 300.0, torque, harmonics) == pytest.approx(300.0 + expected, abs=1e-11)


def test_the_load_swings_with_its_own_frequency_and_phase_and_is_never_negative():
    t = np.linspace(0.0, 0.2, 41)
    expected = [max(100.0 + 150.0 * math.sin(80.0 * x + 0.7), 0.0) for x in t]
    np.testing.assert_allclose(saturation_torque(t, 100.0, (150.0, 80.0, 0.7)), expected, atol=1e-11)
    np.testing.assert_array_equal(saturation_torque(t, 100.0, None), np.full(41, 100.0))


@pytest.mark.parametrize("stribeck", LAWS)
def test_every_form_of_the_law_is_a_constant_and_exponentials(stribeck) -> None:
    """Values, slopes by differences, and bounds."""
    pairs, sigma, h = list(zip((stribeck or ())[::2], (stribeck or ())[1::2])), 8.0, 1e-5

    def slid(v):
        return 1.0 + sum(c * np.exp(-a * np.abs(v)) for c, a in pairs) + 0.0 * v

    def law(v):
        return slid(v) * np.tanh(sigma * v)

    size = np.abs(SPEEDS)
    np.testing.assert_allclose(friction.smoothed_coefficient(SPEEDS, sigma, stribeck), law(SPEEDS), rtol=1e-13)
    for step in (None, np.tanh(sigma * SPEEDS)):
        value, slope = friction.smoothed_and_slope(SPEEDS, sigma, stribeck, step)
        np.testing.assert_allclose(value, law(SPEEDS), rtol=1e-13)
        np.testing.assert_allclose(slope, (law(SPEEDS + h) - law(SPEEDS - h)) / (2.0 * h), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(friction.sliding(SPEEDS, np.sign(SPEEDS), stribeck), np.sign(SPEEDS) * slid(SPEEDS))
    assert friction.sliding(0.0, -1.0, stribeck) == pytest.approx(-slid(0.0))
    slopes = (slid(size + h) - slid(size - h)) / (2.0 * h)
    np.testing.assert_allclose(friction.sliding_slope(SPEEDS, stribeck), slopes, rtol=1e-6, atol=1e-9)
    assert friction.exponentials(stribeck) == pairs
    assert friction.largest_ratio(stribeck) == pytest.approx(1.0 + sum(c for c, _ in pairs if c > 0.0))
    assert friction.steepest_fall(stribeck) == pytest.approx(sum(c * a for c, a in pairs if c > 0.0))
    if stribeck:
        first, total, fall = friction.exponentials_at(size, stribeck)
        steep = sum(abs(c) * a * np.exp(-a * size) for c, a in pairs)
        for found, expected in ((first, pairs[0][0] * np.exp(-pairs[0][1] * size)), (total, slid(size) - 1.0),
                                (fall, -slopes), (friction.steepness(size, stribeck), steep)):
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
        for tanh, rest, by in ((np.tanh(sigma * SPEEDS), 1.0 / np.cosh(sigma * SPEEDS) ** 2, law),
                               (np.sign(SPEEDS), 0.0, lambda v: slid(v) * np.sign(v))):
            value, slope = friction.with_slope(total, fall, np.sign(SPEEDS), sigma, tanh, rest)
            np.testing.assert_allclose(value, by(SPEEDS), rtol=1e-13)
            np.testing.assert_allclose(slope, (by(SPEEDS + h) - by(SPEEDS - h)) / (2.0 * h), rtol=1e-6, atol=1e-8)


def test_tanh_keeps_its_digits() -> None:
    """Beside 80 bits, also where it is nearly 1, and after a short or a long step."""
    for x in (-30.0, -1.0, -1e-9, 0.0, 0.5, 40.0):
        exact = np.tanh(np.longdouble(x)), 1.0 / np.cosh(np.longdouble(x)) ** 2
        assert friction.step_and_rest(x) == pytest.approx(tuple(map(float, exact)), rel=1e-15)
    for start in (0.0, 0.3, -1.2):
        for angle in (9.999e-3, -9.999e-3, 0.01, 0.5, -2.0):
            exact = float(np.tanh(np.longdouble(start) + np.longdouble(angle)))
            found = friction.step_after(math.tanh(start), 8.0, start / 8.0, (start + angle) / 8.0)
            assert found == pytest.approx(exact, rel=6e-16 if start == 0.0 else 5e-15)


def test_a_hump_to_which_friction_rises_from_rest_is_no_peak():
    assert friction.peak(1e3, (0.001, 10.0, -0.5, 2.0, 0.6, 1.0)) == (math.inf, 1.0)


def test_a_harmonic_of_amplitude_zero_is_none():
    system = replace(System(), {"engine.harmonic_amplitudes": (0.0, 35.0), "engine.harmonic_phases": (0.3, 0.4),
                                "engine.torque_amplitude": 0.5})
    w = system.engine.frequency
    assert engine_series(system).frequency.tolist() == [w, 3.0 * w]


@pytest.mark.parametrize(("time_constant", "limit", "seconds", "after", "straight"), [
    (0.0, 0.0, 0.01, 2e5, True), (0.1, 0.0, 0.01, 2e5 - 1e5 * math.exp(-0.1), False), (0.0, 3e6, 0.01, 1.3e5, True),
    (0.0, 3e6, 0.04, 2e5, True), (0.1, 5e5, 0.01, 1.05e5, True), (0.1, 5e5, 0.1, 1.5e5, True),
    (0.1, 5e5, 0.3, 2e5 - 5e4 * math.exp(-2.0), True), (0.1, 1e6, 0.1, 2e5 - 1e5 * math.exp(-1.0), False)])
def test_the_pressure_ramps_and_then_decays_towards_its_command(time_constant, limit, seconds, after, straight) -> None:
    """Up, down, and as the course within a tick from its two ends alone."""
    assert pressure_after(1e5, 2e5, time_constant, limit, seconds) == pytest.approx(after)
    assert pressure_after(2e5, 1e5, time_constant, limit, seconds) == pytest.approx(3e5 - after)
    rise, rate = approach_between(1e5, after, time_constant, limit, seconds)
    assert rate == (0.0 if straight else 1.0 / time_constant)
    assert rise == pytest.approx((after - 1e5) / (seconds if straight else 1.0 - math.exp(-seconds / time_constant)))


def test_an_actuator_delays_commands_by_whole_ticks() -> None:
    pressure = Pressure(source="topic", mean=1e5, delay=0.003, rate_limit=1e7)
    acted = Actuator(pressure, 0.001)
    ends = [(*acted.advance(command), acted.highest) for command in (1.2e5, 0.8e5, 0.9e5, 0.9e5, 0.9e5)]
    assert np.array(ends) == pytest.approx(1e5 * np.array([
        [1.0, 1.0, 1.2], [1.0, 1.0, 1.2], [1.0, 1.0, 1.2], [1.0, 1.1, 1.1], [1.1, 1.0, 1.0]]))
    acted.reset(-1.0)
    assert (acted.pressure, acted.highest, acted.advance(5.0)) == (-1.0, 0.0, (-1.0, -1.0))
    assert [delay_ticks(Pressure(source="topic", delay=x), 0.001) for x in (0.0, 0.003, 0.003 + 9e-10)] == [0, 3, 3]
    for delay in (0.0035, 0.003 + 1.1e-9, 0.003 - 1.1e-9):
        with pytest.raises(InputError, match=rf"pressure.delay.* {delay:g} s.*0.001 s"):
            delay_ticks(Pressure(source="topic", delay=delay), 0.001)
