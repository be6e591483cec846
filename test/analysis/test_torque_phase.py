"""The phase of known torques: steady, drifting and interrupted."""

import math
import re

import numpy as np
import pytest

from tcc_sim.analysis.measured.engine_clock import PhaseTracker, clock_of

STEP = 1_000_000
TURN = 2.0 * math.pi


def phase_of(torque, seconds=20.0, batch=700, ticks=None):
    """Result of the longest run of a torque f(t)."""
    tracker = PhaseTracker()
    k = np.arange(int(seconds * 1000)) if ticks is None else ticks
    values = torque(k * 1e-3)
    for start in range(0, len(k), batch):
        tracker.feed(k[start:start + batch] * STEP, values[start:start + batch])
    return tracker.runs()[tracker.longest()]


def largest_error(result, phase):
    """Largest distance of the known phase at the cycle starts from a multiple of a turn, rad."""
    turns = phase(result.starts) / TURN
    assert np.array_equal(np.diff(np.rint(turns)), np.diff(result.numbers))
    return TURN * float(np.abs(turns - np.rint(turns)).max())


@pytest.mark.parametrize("frequency", [3.3, 41.234567, 150.0, 1000.0, 2900.0])
def test_a_sine_is_found_to_many_digits(frequency):
    phase = phase_of(lambda t: 300.0 + 250.0 * np.sin(frequency * t + 0.4), seconds=10.0)
    assert phase.low == phase.high == pytest.approx(frequency, rel=1e-7)
    assert largest_error(phase, lambda t: frequency * t + 0.4) < 1e-5
    assert phase.known == pytest.approx(1.0, abs=1e-9)
    # The phase at t = 0 is that of cycle 0, which began before the first sample.
    assert phase.numbers[0] == 1
    assert len(phase.starts) in {int((frequency * 9.999 + 0.4) / TURN), int((frequency * 9.999 + 0.4) / TURN) + 1}


def test_noise_and_harmonics_do_not_matter():
    rng = np.random.default_rng(1)
    phase = phase_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t) + 80.0 * np.sin(300.0 * t + 1.0) + 40.0
                     * rng.normal(size=len(t)))
    assert phase.low == phase.high == pytest.approx(150.0, rel=1e-5)
    assert largest_error(phase, lambda t: 150.0 * t) < 0.01


def test_held_samples_of_a_slower_command_delay_the_phase_by_half_a_hold():
    """A controller at 200 Hz."""
    phase = phase_of(lambda t: 300.0 + 250.0 * np.sin(100.0 * np.floor(t * 200.0 + 1e-6) / 200.0))
    assert phase.low == phase.high == pytest.approx(100.0, rel=1e-5)
    assert largest_error(phase, lambda t: 100.0 * (t - 2e-3)) < 0.02


def test_gaps_do_not_break_the_phase_and_have_no_cycles():
    k = np.concatenate([np.arange(0, 6000), np.arange(6700, 20000), np.arange(20013, 30000)])
    phase = phase_of(lambda t: 250.0 * np.sin(150.0 * t), ticks=k)
    assert phase.low == phase.high == pytest.approx(150.0, rel=1e-7)
    assert largest_error(phase, lambda t: 150.0 * t) < 1e-5
    assert np.array_equal(phase.numbers, np.rint(150.0 * phase.starts / TURN))
    assert not ((phase.starts > 6.0) & (phase.starts < 6.7)).any()


@pytest.mark.parametrize(("frequency", "rate"), [
    (60.0, 0.1), (60.0, -0.1), (600.0, 0.1), (600.0, -0.1), (150.0, 0.05), (150.0, 0.01)])
def test_a_frequency_that_drifts_by_up_to_ten_per_cent_a_second_is_followed(frequency, rate):
    def phase(t):
        return frequency / rate * np.expm1(rate * t)

    result = phase_of(lambda t: 300.0 + 250.0 * np.sin(phase(t)), seconds=10.0)
    assert largest_error(result, phase) < 0.02
    assert len(result.starts) >= abs(float(phase(9.99))) / TURN - 3
    assert np.array_equal(result.numbers, np.rint(phase(result.starts) / TURN))
    ends = sorted([frequency, frequency * math.exp(10.0 * rate)])
    assert [result.low, result.high] == pytest.approx(ends, rel=0.03)
    (stretch,) = clock_of({0: result}).stretches(0, 0.0, 10.0)
    assert np.array_equal(stretch[1], result.starts)


def test_a_slow_drift_is_followed_where_one_frequency_fits_almost_as_well():
    """A sine of one frequency holds as much of the variance within 2 %, and is 0.3 rad off."""
    def phase(t):
        return 150.0 / 0.01 * np.expm1(0.01 * t)

    assert largest_error(phase_of(lambda t: 300.0 + 250.0 * np.sin(phase(t)), seconds=1.5), phase) < 2e-3


def test_a_run_up_between_two_speeds_is_followed_through_its_corners():
    """100 rad/s for 3 s, 300 rad/s from 15 s on, linear between; the mean torque drifts too, and there is noise."""
    rng, rate = np.random.default_rng(3), 200.0 / 12.0

    def phase(t):
        ramp = np.clip(t - 3.0, 0.0, 12.0)
        return 0.2 + 100.0 * np.minimum(t, 3.0) + ramp * (100.0 + 0.5 * rate * ramp) + 300.0 * np.maximum(t - 15.0, 0.0)

    result = phase_of(lambda t: 200.0 + 5.0 * t + 250.0 * np.sin(phase(t)) + 10.0 * rng.normal(size=len(t)))
    assert largest_error(result, phase) < 0.05
    assert (result.low, result.high) == (pytest.approx(100.0, rel=0.01), pytest.approx(300.0, rel=0.01))


@pytest.mark.parametrize("begin", [0.33, 2.33, 12.33])
def test_cycles_begin_where_the_oscillation_does(begin):
    phase = phase_of(lambda t: np.where(t < begin, 300.0, 300.0 + 250.0 * np.sin(150.0 * (t - begin))))
    assert largest_error(phase, lambda t: 150.0 * (t - begin)) < 5e-3
    assert begin - 0.01 < phase.starts[0] < begin + 6.0 * TURN / 150.0
    assert phase.known == pytest.approx(1.0 - begin / 20.0, abs=0.02)


@pytest.mark.parametrize(("torque", "why"), [
    (lambda t: 300.0 + 0.0 * t, "is constant"), (lambda t: 0.0 * t, "is constant"),
    (lambda t: np.random.default_rng(2).normal(size=len(t)), "does not oscillate with one frequency"),
    (lambda t: 250.0 * np.sin(60.0 * np.expm1(3.0 * t) / 3.0), "% of the time only|does not oscillate"),
    (lambda t: np.where(t < 16.0, 300.0, 300.0 + np.sin(150.0 * t)), "for 20 % of the time only; 25 % or more"),
], ids=["constant", "zero", "noise", "chirp", "mostly constant"])
def test_what_has_no_phase_has_no_cycles_and_says_why(torque, why):
    phase = phase_of(torque)
    assert len(phase.starts) == 0
    assert math.isnan(phase.low)
    assert re.search(why, phase.why)
    assert clock_of({0: phase}) is None


@pytest.mark.parametrize(("seconds", "batch"), [(1.0, 1), (2.0, 37), (2.03, 37), (2.03, 5000), (2.06, 37)])
def test_cycles_reach_from_the_first_sample_to_the_last(seconds, batch):
    """Also where half a block or less is left at the end."""
    result = phase_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t + 0.4), seconds, batch)
    numbers = np.arange(1, math.floor((150.0 * (seconds - 1e-3) + 0.4) / TURN) + 1)
    assert result.numbers.tolist() == numbers.tolist()
    assert result.starts == pytest.approx((TURN * numbers - 0.4) / 150.0, abs=1e-6)
    assert result.known == 1.0


@pytest.mark.parametrize(("lost", "known", "missing"), [
    ([1000], 1.0, []), ([1000, 1001], 1.0 - 0.003 / 3.999, []),
    ([*range(1000, 1100)], 1.0 - 0.101 / 3.999, [1.0, 1.1])])
def test_a_single_lost_sample_is_bridged(lost, known, missing):
    result = phase_of(lambda t: 250.0 * np.sin(150.0 * t + 0.4), ticks=np.delete(np.arange(4000), lost))
    assert result.known == pytest.approx(known)
    assert result.low == pytest.approx(150.0, rel=1e-6)
    every = (TURN * np.arange(1, 96) - 0.4) / 150.0
    kept = every if not missing else every[(every < missing[0]) | (every >= missing[1])]
    assert result.starts == pytest.approx(kept, abs=1e-6)


@pytest.mark.parametrize(("present", "known"), [
    (lambda t: t < 3.0, 2.9395 / 7.999), (lambda t: (t < 3.0) | (t > 5.0), 5.899 / 7.999)])
def test_a_torque_that_stops_oscillating_has_cycles_where_it_does(present, known):
    """Within two blocks of two cycles."""
    result = phase_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t + 0.4) * present(t), 8.0)
    assert result.known == pytest.approx(known, abs=0.17 / 7.999)
    assert largest_error(result, lambda t: 150.0 * t + 0.4) < 1e-3
    assert present(result.starts + 1e-3).all()
