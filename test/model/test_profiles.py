"""Profiles in time: the phase against quadrature, its inverse, and refusals."""

import numpy as np
import pytest
from scipy.integrate import quad

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.profile import along, phase_at, time_at
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
    np.testing.assert_allclose(time_at(VARYING.profile, phase_at(VARYING.profile, t)), t, atol=1e-13)


def test_means_are_linear_between_points_and_constant_outside():
    t = np.linspace(0.0, 2.5, 101)
    _, torque, pressure = along(VARYING.profile, t)
    np.testing.assert_allclose(pressure, np.interp(t, [0.0, 1.0], [0.0, 3e5]), atol=1e-9)
    np.testing.assert_array_equal(torque, System().engine.mean_torque)


def test_a_system_without_profiles_has_no_course():
    assert System().profile is None
    assert System().cycle_start(7) == 7 * System().cycle


@pytest.mark.parametrize(("values", "message"), [
    ({"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0]}, "has 1 values; it must have as many"),
    ({"engine.frequency_times": [0.5, 1.0], "engine.frequency_values": [100.0, 90.0]}, "begins at 0.5 s"),
    ({"pressure.mean_times": [0.0, 1.0, 1.0], "pressure.mean_values": [1e5, 1e5, 2e5]}, "1 s after 1 s"),
    ({"engine.frequency_times": [0.0, 1.0], "engine.frequency_values": [100.0, 0.0]}, "must be 0.001 to 100000"),
    ({"engine.mean_torque_times": [0.0, float("nan")], "engine.mean_torque_values": [1.0, 1.0]}, "must be 0 to 1e"),
    ({"pressure.mean_times": list(map(float, range(1001))), "pressure.mean_values": [1e5] * 1001}, "at most 1000"),
])
def test_what_is_no_profile_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        replace(System(), values)


def test_a_key_in_whose_place_a_profile_stands_cannot_be_changed_alone():
    with pytest.raises(InputError, match=r"engine\.frequency is not used where engine\.frequency_times is given"):
        replace(VARYING, {"engine.frequency": 100.0})
    assert replace(VARYING, {"engine.frequency_times": [], "engine.frequency_values": [],
                             "engine.frequency": 100.0}).engine.frequency == 100.0


def test_profiles_of_a_command_line():
    result = parse_profiles(["engine.frequency=0:60,20:600", "pressure.mean=0:1e5"])
    assert result == {"engine.frequency_times": [0.0, 20.0], "engine.frequency_values": [60.0, 600.0],
                      "pressure.mean_times": [0.0], "pressure.mean_values": [1e5]}
    for words, message in ((["engine.speeds=0:1"], "the keys that have a profile are engine.frequency"),
                           (["engine.frequency=0:60,20"], "is not KEY=TIME:VALUE"),
                           (["engine.frequency=0:a"], "is not KEY=TIME:VALUE"),
                           (["engine.frequency"], "is not KEY=TIME:VALUE"),
                           (["engine.frequency=0:800rpm"], "give the crankshaft's speed in rpm as engine.speed=800rpm"),
                           (["pressure.mean=0:8rpm"], "is not KEY=TIME:VALUE"),
                           (["pressure.mean=0:1", "pressure.mean=0:2"], "given twice")):
        with pytest.raises(InputError, match=message):
            parse_profiles(words)


def test_who_cannot_says_who_can():
    from tcc_sim.model.pure_stick import stick_margin
    from tcc_sim.study.continuation.driveline import DrivelineMap

    for work in (lambda: DrivelineMap(VARYING, ()), lambda: stick_margin(VARYING)):
        with pytest.raises(InputError, match=r"engine\.frequency_times, pressure\.mean_times; simulate and the drive"):
            work()


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
    ({"engine.harmonic_amplitudes[4]": 1.0}, r"has 3 values, \[1\] to \[3\]"),
    ({"engine.harmonic_amplitudes[0]": 1.0}, "does not exist"),
    ({"engine.frequency[1]": 1.0}, "engine.frequency is not a list"),
    ({"engine.harmonic_amplitudes[1]": "loud"}, "'loud'; it must be a number"),
    ({"engine.harmonic_amplitudes[1]": -1.0}, "must be 0 to 100000"),
    ({"engine.harmonic_phases[1]_times": [0.0], "engine.harmonic_phases[1]_values": [0.0]}, "lists with profiles are"),
    ({"engine.harmonic_amplitudes_times": [0.0, 1.0], "engine.harmonic_amplitudes_values": [1.0, 2.0]},
     "must have 3 for each of the 2"),
    ({"engine.torque_amplitude_times": [0.0, 1.0], "engine.torque_amplitude_values": [1.0]}, "must have as many as"),
])
def test_numbers_of_a_list_and_their_profiles_that_do_not_fit_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        replace(HARMONICS, values)
