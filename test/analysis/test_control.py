"""Quality of control: figures of responses known in closed form."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import tcc_sim
from tcc_sim.analysis.control import CycleMeans, MeansOfCycles, tracking
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.result import json_of

CYCLE = 0.05


def test_an_exponential_settles_when_two_per_cent_of_the_step_are_left():
    n = np.arange(100)
    found = tracking(20.0, 20.0 + 80.0 * np.exp(-0.1 * n), CYCLE, 60)
    assert found.settling_time == pytest.approx(CYCLE * math.ceil(math.log(50.0) / 0.1))
    assert found.overshoot == 0.0
    assert found.mean_slip == pytest.approx(20.0 + 80.0 * np.exp(-0.1 * n[60:]).mean())
    assert found.largest_error == pytest.approx(80.0 * math.exp(-6.0))
    assert found.rms_error == pytest.approx(80.0 * math.sqrt(np.mean(np.exp(-0.2 * n[60:]))))


@pytest.mark.parametrize("side", [1.0, -1.0, 0.01, -0.01])
def test_overshoot_is_what_lies_beyond_the_target_seen_from_the_start(side):
    found = tracking(100.0, 100.0 + side * np.array([50.0, 10.0, -8.0, 3.0, 0.5, 0.4, 0.5, 0.5, 1.0]), CYCLE, 0)
    # A start that is within 2 % of the target is no step, and what counts then is the deviation to either side.
    assert found.overshoot == pytest.approx(8.0 if abs(side) == 1.0 else 0.5)
    assert found.largest_error == pytest.approx(50.0 * abs(side))
    # 2 % of the target, which is larger than the step.
    assert found.settling_time == pytest.approx(4 * CYCLE if abs(side) == 1.0 else 0.0)
    assert (found.peak_mean, found.iae) == (pytest.approx(50.0 * abs(side)), pytest.approx(73.9 * abs(side) * CYCLE))


def test_what_does_not_settle_and_what_was_never_away():
    assert math.isnan(tracking(10.0, np.array([50.0, 10.0, 12.0]), CYCLE, 0).settling_time)
    still = tracking(10.0, np.array([10.1, 10.0, 9.9, 10.0, 10.0]), CYCLE, 1)
    assert (still.settling_time, still.overshoot) == (0.0, pytest.approx(0.1))
    assert still.mean_slip == pytest.approx(9.975)


def test_a_disturbance_to_either_side_shows():
    """There is no step where the mean begins at the target, and none of the two directions is another one's."""
    for side in (1.0, -1.0):
        means = 20.0 + side * np.array([0.1, 0.0, 28.3, 9.0, 2.0, *[0.1] * 20])
        found = tracking(20.0, means, CYCLE, 15)
        assert (found.overshoot, found.peak_mean) == (pytest.approx(28.3), pytest.approx(28.3))
        assert found.settling_time == pytest.approx(5 * CYCLE)


@pytest.mark.parametrize(("last", "settles"), [(4, False), (5, True)])
def test_fewer_than_five_cycles_show_no_settling(last, settles):
    """An oscillation that happens to pass the target at the end has not settled."""
    means = 20.0 + np.concatenate([10.0 * np.cos(np.arange(60)) + 3.0, np.zeros(last)])
    assert math.isfinite(tracking(20.0, means, CYCLE, 10).settling_time) == settles


def test_a_run_is_judged_with_what_lies_between_its_samples():
    """Pure sliding under a constant pressure: v rises with the torque's sine and has known figures."""
    run = tcc_sim.closed_loop(tcc_sim.load_scene("controlled").with_values({
        "initial.slip_speed": 400.0, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
        "friction.static_coefficient": 0.3}), lambda reading: 150e3 if reading.slip_speed > 300.0 else 1e5, 0.4)
    found = run.tracking_of(390.0, limits=(1e5, 150e3))
    dense = np.linspace(0.0, 0.4, 400_001)
    v = CubicSpline(run.t, run.slip_speed)(dense)
    assert found.peak_slip == pytest.approx(np.abs(v - 390.0).max(), rel=1e-6)
    cycle = run.cycle
    means = np.array([v[(dense >= k * cycle) & (dense < (k + 1) * cycle)].mean() for k in range(int(0.4 / cycle))])
    number = np.minimum((dense / cycle).astype(int), len(means) - 1)
    inside = dense < len(means) * cycle
    assert found.peak_mean == pytest.approx(np.abs(means - 390.0).max(), rel=1e-4)
    assert found.ripple == pytest.approx(np.sqrt(np.mean((v - means[number])[inside] ** 2)), rel=2e-2)
    assert found.iae == pytest.approx(np.abs(means - 390.0).sum() * cycle, rel=1e-4)
    assert found.stick_fraction == 0.0
    assert (found.pressure_low, found.pressure_high) == (run.applied_pressure[1:].min(), run.applied_pressure.max())
    assert found.time_at_limit == 1.0
    steps = np.count_nonzero(np.diff(run.applied_pressure[1:]))
    assert found.pressure_rate == pytest.approx(5e7 * math.sqrt(steps * 1e-3 / 0.4))
    assert steps > 0
    assert run.tracking_of(390.0).time_at_limit == 0.0
    assert math.isnan(tracking(20.0, np.zeros(9), CYCLE, 0).pressure_low)


def test_cycles_that_were_not_observed_do_not_count_as_settled():
    found = tracking(10.0, np.array([math.nan, 12.0, math.nan, *[10.0] * 5]), CYCLE, 0)
    assert found.settling_time == pytest.approx(3 * CYCLE)
    assert found.rms_error == pytest.approx(math.sqrt(4.0 / 6.0))
    nothing = tracking(10.0, np.full(3, math.nan), CYCLE, 0)
    assert json_of(nothing) == {"target": 10.0, "mean_slip": None, "rms_error": None, "largest_error": None,
                                 "overshoot": None, "settling_time": None, "peak_mean": None, "peak_slip": None,
                                 "iae": None, "ripple": None, "stick_fraction": None, "pressure_low": None,
                                 "pressure_high": None, "pressure_rate": None, "time_at_limit": None}
    assert math.isnan(tracking(10.0, np.array([12.0, math.nan]), CYCLE, 1).rms_error)


@pytest.mark.parametrize("size", [1, 7, 10**6])
def test_the_mean_of_a_sine_over_its_cycle_is_its_offset(size):
    t = np.arange(3000) * 1e-3
    means = MeansOfCycles(Uniform(CYCLE * math.sqrt(2.0) / 1.3))
    v = 5.0 + 3.0 * np.sin(2.0 * math.pi * t / (CYCLE * math.sqrt(2.0) / 1.3))
    for start in range(0, len(t), size):
        means.feed(t[start:start + size], v[start:start + size])
    assert len(means.means()) == int(2.999 / (CYCLE * math.sqrt(2.0) / 1.3))
    assert means.means() == pytest.approx(5.0, abs=2e-3)


def test_a_gap_leaves_out_the_cycles_that_it_touches():
    means = MeansOfCycles(Uniform(0.1))
    means.feed(np.arange(0, 255) * 1e-3, np.full(255, 2.0))
    means.interrupt()
    means.feed(np.arange(430, 701) * 1e-3, np.full(271, 4.0))
    assert means.means() == pytest.approx([2.0, 2.0, math.nan, math.nan, math.nan, 4.0, 4.0], nan_ok=True)


def test_a_leap_of_time_costs_no_memory_and_gives_no_mean():
    means = CycleMeans(Uniform(0.1))
    assert means.feed(np.array([0.0, 0.05, 1e6]), np.full(3, 2.0)) == []
    ((_, ends, found),) = means.feed(1e6 + np.arange(1, 400) * 1e-3, np.full(399, 2.0))
    assert found == pytest.approx(2.0)
    assert len(ends) in (2, 3)


def test_slices_of_time_have_no_means():
    means = MeansOfCycles(Uniform(0.1, told=False))
    means.feed(np.arange(1000) * 1e-3, np.full(1000, 2.0))
    assert len(means.means()) == 0
