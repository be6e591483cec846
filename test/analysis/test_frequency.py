"""The frequency of torques that are known."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.frequency import FrequencyFinder

STEP = 1_000_000


def line_of(torque, seconds=20.0, batch=700, ticks=None):
    finder = FrequencyFinder()
    k = np.arange(int(seconds * 1000)) if ticks is None else ticks
    values = torque(k * 1e-3)
    for start in range(0, len(k), batch):
        finder.feed(k[start:start + batch] * STEP, values[start:start + batch])
    return finder.line()


@pytest.mark.parametrize("frequency", [3.3, 41.234567, 150.0, 1000.0, 2900.0])
def test_a_sine_is_found_to_many_digits(frequency):
    found = line_of(lambda t: 300.0 + 250.0 * np.sin(frequency * t + 0.4))
    assert found.frequency == pytest.approx(frequency, rel=1e-7 if frequency > 10.0 else 1e-5)
    assert found.amplitude == pytest.approx(250.0, rel=1e-3)
    assert found.share == pytest.approx(1.0, abs=1e-2)


def test_half_a_second_is_enough():
    assert line_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t), seconds=0.5).frequency == pytest.approx(150.0, rel=1e-3)


def test_noise_and_harmonics_do_not_matter():
    rng = np.random.default_rng(1)
    found = line_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t) + 80.0 * np.sin(300.0 * t + 1.0) + 40.0
                    * rng.normal(size=len(t)))
    assert found.frequency == pytest.approx(150.0, rel=1e-5)


def test_held_samples_of_a_slower_command_do_not_matter():
    """A controller at 200 Hz: its zero-order hold delays the sine but keeps its frequency."""
    found = line_of(lambda t: 300.0 + 250.0 * np.sin(100.0 * np.floor(t * 200.0 + 1e-6) / 200.0))
    assert found.frequency == pytest.approx(100.0, rel=1e-5)


def test_gaps_do_not_break_the_phase():
    k = np.concatenate([np.arange(0, 6000), np.arange(6700, 20000), np.arange(20013, 30000)])
    assert line_of(lambda t: 250.0 * np.sin(150.0 * t), ticks=k).frequency == pytest.approx(150.0, rel=1e-7)


@pytest.mark.parametrize("lengths", [(3000, 20000), (20000, 3000)])
def test_the_longest_run_counts(lengths):
    k = np.concatenate([np.arange(0, length) for length in lengths])
    longest = (np.arange(len(k)) < lengths[0]) == (lengths[0] > lengths[1])
    values = np.where(longest, np.sin(150.0 * k * 1e-3), np.sin(60.0 * k * 1e-3))
    finder = FrequencyFinder()
    for start in range(0, len(k), 700):
        finder.feed(k[start:start + 700] * STEP, values[start:start + 700])
    assert finder.line().frequency == pytest.approx(150.0, rel=1e-6)


@pytest.mark.parametrize("torque", [
    lambda t: 300.0 + 0.0 * t,
    lambda t: 0.0 * t,
    lambda t: np.random.default_rng(2).normal(size=len(t)),
    lambda t: 250.0 * np.sin(150.0 * t + 3.0 * t * t),
], ids=["constant", "zero", "noise", "chirp"])
def test_what_is_not_periodic_has_no_line(torque):
    assert line_of(torque) is None


def test_nothing_is_nothing():
    assert FrequencyFinder().line() is None
    assert line_of(lambda t: np.sin(150.0 * t), seconds=0.01) is None


def test_samples_that_are_not_finite_are_left_out():
    assert line_of(lambda t: np.where(np.arange(len(t)) % 1000 == 5, math.nan,
                                      250.0 * np.sin(150.0 * t))).frequency == (
        pytest.approx(150.0, rel=1e-6))


@pytest.mark.parametrize("seconds", [0.1, 0.12, 0.2, 0.3])
def test_a_run_of_a_single_block_is_fitted_as_a_whole(seconds):
    """So short that there is one block, whose phase has no slope."""
    found = line_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t + 0.4), seconds=seconds)
    assert found.frequency == pytest.approx(150.0, rel=1e-5)
    assert found.amplitude == pytest.approx(250.0, rel=1e-4)
    assert line_of(lambda t: 300.0 + 250.0 * np.sin(150.0 * t), seconds=0.015) is None


def test_a_run_that_the_recording_numbers_anew_is_another_one():
    finder = FrequencyFinder()
    for run, frequency, start in ((0, 60.0, 0), (1, 150.0, 3000)):
        k = np.arange(start, start + 3000 + 7000 * run)
        finder.feed(k * STEP, np.sin(frequency * k * 1e-3), run)
    assert finder.line().frequency == pytest.approx(150.0, rel=1e-6)


def test_a_drift_that_is_larger_than_the_line_is_not_taken_for_it():
    """Half a swing over the whole run stands below the lowest frequency that the run can show."""
    found = line_of(lambda t: 300.0 + 80.0 * np.cos(math.pi * t / 16.384) + 50.0 * np.sin(150.0 * t), seconds=16.384)
    assert found.frequency == pytest.approx(150.0, rel=1e-4)
    assert found.amplitude == pytest.approx(50.0, rel=0.01)
