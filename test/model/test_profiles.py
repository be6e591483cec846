"""Profiles in time: the phase against quadrature, its inverse, and refusals."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import (
    Inputs,
    far_end_at,
    lines_through,
    motion_of_far_end,
    phase_at,
    smooth_corners,
    time_at,
)
from tcc_sim.scene import parse_profiles

TIMES, VALUES = [0.0, 0.3, 0.4, 2.0], [80.0, 400.0, 90.0, 90.0]
VARYING = replace(System(), {"engine.frequency_times": TIMES, "engine.frequency_values": VALUES,
                             "pressure.mean_times": [0.0, 1.0], "pressure.mean_values": [0.0, 3e5]})


def test_the_phase_is_the_integral_of_the_frequency():
    for t in (0.0, 0.1, 0.3, 0.37, 1.9, 2.5):
        exact = quad(lambda s: np.interp(s, TIMES, VALUES), 0.0, t, points=TIMES[1:], epsabs=1e-12)[0]
        assert phase_at(VARYING.profile, t) == pytest.approx(exact, abs=1e-9)


def test_cycles_start_where_the_phase_is_a_whole_turn():
    starts = VARYING.cycle_start(np.arange(40))
    np.testing.assert_allclose(phase_at(VARYING.profile, starts), 2.0 * np.pi * np.arange(40), atol=1e-10)
    assert starts[0] == 0.0
    assert VARYING.cycles_until(float(starts[17])) == pytest.approx(17.0, abs=1e-12)
    t = np.linspace(0.0, 3.0, 301)
    slow = replace(System(), {"engine.frequency_times": [0.0, 3.0], "engine.frequency_values": [0.5, 0.002]})
    for profile in (VARYING.profile, slow.profile):
        np.testing.assert_allclose(time_at(profile, phase_at(profile, t)), t, atol=1e-13)


def test_a_system_without_profiles_has_no_course():
    system = replace(System(), {"engine.frequency": 20.0 * math.pi})
    assert (system.profile, system.varying, system.span) == (None, [], 0.0)
    assert system.cycle_start(7) == pytest.approx(0.7)
    assert (system.cycles_until(0.25), system.whole_cycles(3, 0.25), system.whole_cycles(3, 0.3)) == (
        pytest.approx(2.5), 2, 3)
    system.check_repeats("it")
    start = float(VARYING.cycle_start(3))
    for count in range(1, 300):
        assert system.whole_cycles(0, count * system.cycle) == count
        assert VARYING.whole_cycles(3, float(VARYING.cycle_start(3 + count)) - start) == count
    for cycles, number in ((2.0, 2), (1.999, 1), (0.0, 0)):   # Whole to the last bit.
        assert VARYING.whole_cycles(3, float(VARYING.cycle_start(3.0 + cycles)) - start) == number
    assert (VARYING.span, VARYING.cycle) == (2.0, pytest.approx(2.0 * math.pi / 400.0))
    assert VARYING.varying == ["engine.frequency_times", "pressure.mean_times"]
    driven = dataclasses.replace(System(), inputs=Inputs(None, np.array([[0.0, 1e5, 0.0]]), 3.5))
    assert (driven.varying, driven.span) == (["inputs"], 3.5)
    assert driven != dataclasses.replace(driven, inputs=Inputs(None, driven.inputs.pressure, 3.5))
    with pytest.raises(InputError, match="it needs a periodic excitation, and this scene has inputs; simulate and the "
                                         "driveline node solve it"):
        driven.check_repeats("it")


def test_lines_run_through_points_or_hold_them():
    t, values = np.array([0.5, 1.0, 3.0]), np.array([2.0, 4.25, 0.0])
    for held, rates in ((False, [4.5, -2.125, 0.0]), (True, [0.0, 0.0, 0.0])):
        lines = lines_through(t, values, held)
        assert lines.tolist() == [[0.0, 2.0, 0.0], *([x, y, rate] for x, y, rate in zip(t, values, rates))]
        for early in (0.5, 0.75):
            assert lines_through(t - early, values, held).tolist() == [[x - early, *y] for x, *y in lines[1:].tolist()]


def test_corners_of_a_parabola_are_lower_by_a_twelfth_of_its_bend():
    """x - h h' x''/12 for the steps h, h' on both sides, and within limits."""
    t = np.array([0.0, 1.0, 3.0, 4.0])
    for low, high, expected in ((-np.inf, np.inf, [0.0, 2.0, 26.0, 48.0]), (2.5, 20.0, [2.5, 2.5, 20.0, 20.0])):
        assert smooth_corners(t, 3.0 * t**2, low, high) == pytest.approx(expected)


def test_a_pressure_from_data_is_never_below_0():
    """At any line's start or end, the last of which is that of the data; by more than rounding."""
    falling = (0.0, 5.0, -4.0), (1.0, 1.0, -2.0)
    for lines, end, words in (
            (falling, 1.5, ""), (falling, 2.0, "-1 Pa at 2 s"),
            (((0.0, 5.0, -6.0), (1.0, 1.0, 0.0)), 2.0, "-1 Pa at 1 s"),
            (((0.0, -3.0, 4.0),), 9.0, "-3 Pa at 0 s"), (((0.0, 1.0, 0.0), (1.0, -0.9e-9, 1.0)), 2.0, ""),
            (((0.0, 1.0, 0.0), (1.0, -2e-9, 1.0)), 2.0, "-2e-09 Pa at 1 s"),
            (((0.0, 1.0, 0.0), (3.0, 2.0, -1.0)), 1.0, "")):
        if words:
            with pytest.raises(InputError, match=f"{words}.* 0 or more"):
                Inputs(None, np.array(lines), end)
        else:
            Inputs(None, np.array(lines), end)
    Inputs(np.array([[0.0, -5.0, 0.0]]), None, 1.0)


def test_the_far_end_turns_by_the_integral_of_its_speed():
    speed = lines_through(np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 0.0]))
    at = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0])
    expected = [0.0, 1.25, 3.0, 6.0, 7.0, 7.0], [2.0, 3.0, 4.0, 2.0, 0.0, 0.0], [2.0, 2.0, -2.0, -2.0, 0.0, 0.0]
    motion = motion_of_far_end(speed, at)
    np.testing.assert_allclose(motion.T, [at, *expected])
    assert np.array(far_end_at(motion, at + 0.0)) == pytest.approx(np.array(expected))
    assert far_end_at(motion, 0.75) == pytest.approx((2.0625, 3.5, 2.0))


@pytest.mark.parametrize(("values", "message"), [
    ({"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0]}, "1 values.* 2"),
    ({"engine.frequency_times": [0.5, 1.0], "engine.frequency_values": [100.0, 90.0]}, "begins at 0.5 s"),
    ({"pressure.mean_times": [0.0, 1.0, 1.0], "pressure.mean_values": [1e5, 1e5, 2e5]}, "1 s after 1 s"),
    ({"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0, 0.0]}, "0 rad/s.* 0.001 to 100000"),
    ({"engine.mean_torque_times": [0.0, float("nan")], "engine.mean_torque_values": [1.0, 1.0]}, "nan s.* 0 to 1e"),
    ({"pressure.mean_times": list(map(float, range(1001))), "pressure.mean_values": [1e5] * 1001}, "at most 1000"),
])
def test_what_is_no_profile_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        replace(System(), values)


def test_a_key_whose_profile_is_taken_away_may_change():
    assert replace(VARYING, {"engine.frequency_times": [], "engine.frequency_values": [],
                             "engine.frequency": 100.0}).engine.frequency == 100.0


HARMONICS = replace(System(), {"engine.harmonic_amplitudes": [60.0, 0.0, 20.0],
                               "engine.harmonic_phases": [0.3, 0.0, 1.0]})


def test_one_harmonic_of_the_list_is_set_and_profiled():
    assert replace(HARMONICS, {"engine.harmonic_amplitudes[3]": 5}).engine.harmonic_amplitudes == (60.0, 0.0, 5.0)
    given = replace(System(), {"engine.harmonic_amplitudes[1]": 7.0, "engine.harmonic_amplitudes": [1.0, 2.0],
                               "engine.harmonic_phases": [0.0, 0.0]})
    assert given.engine.harmonic_amplitudes == (7.0, 2.0)
    words = ["engine.harmonic_amplitudes[1]=0:60,2:10", "engine.harmonic_amplitudes[3]=0:0,1:40"]
    engine = replace(HARMONICS, parse_profiles(words)).engine
    assert engine.harmonic_amplitudes_times == (0.0, 1.0, 2.0)
    assert engine.harmonic_amplitudes_values == (60.0, 0.0, 0.0, 35.0, 0.0, 40.0, 10.0, 0.0, 40.0)


@pytest.mark.parametrize(("values", "message"), [
    ({"engine.harmonic_amplitudes[4]": 1.0}, r"\[4\].*\[3\]"), ({"engine.harmonic_amplitudes[0]": 1.0}, r"\[0\]"),
    ({"engine.frequency[1]": 1.0}, "engine.frequency"),
    ({"engine.harmonic_amplitudes[1]": "loud"}, r"engine.harmonic_amplitudes\[1\].*'loud'"),
    ({"engine.harmonic_amplitudes[1]": -1.0}, "-1 N m.* 0 to 100000"),
    ({"engine.harmonic_phases[1]_times": [0.0], "engine.harmonic_phases[1]_values": [0.0]}, "engine.harmonic_phases"),
    ({"engine.harmonic_amplitudes_times": [0.0, 1.0], "engine.harmonic_amplitudes_values": [1.0, 2.0]}, "3 .*2"),
    ({"engine.torque_amplitude_times": [0.0, 1.0], "engine.torque_amplitude_values": [1.0]},
     "engine.torque_amplitude_values.* 1 .* 2")])
def test_numbers_of_a_list_and_their_profiles_that_do_not_fit_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        replace(HARMONICS, values)
