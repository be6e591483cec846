"""Tracking of a target: made-up loops by verdict, each also mirrored, at another frequency, and with lost ticks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up_loops import LOOPS, MadeUp, loop
from scipy.interpolate import CubicSpline

import tcc_sim
from tcc_sim.analysis.control import Steps
from tcc_sim.analysis.tracking import Loop, LoopCycles, Tracking, mean_between, target_jumps, target_steps
from tcc_sim.errors import InputError
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.result import json_of

CYCLE = 2.0 * math.pi / 150.0
WAYS = {"as it is": {}, "mirrored": {"sign": -1.0}, "another frequency": {"frequency": 210.0}, "losses": {"lost": 100}}


def last_segment(result) -> Tracking:
    """Judge from the last jump of the target, or its first value, on."""
    begin = float((result.jumps.t if len(result.jumps.t) else result.reference.t)[-1 if len(result.jumps.t) else 0])
    return result.tracking(begin, float(result.course.ends[-1]), stepped=True)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", LOOPS)
def test_a_made_up_loop_is_judged_by_its_truth(name, way):
    made, how = LOOPS[name], WAYS[way]
    segment = last_segment(loop(made, **how))
    sign = how.get("sign", 1.0)
    assert segment.verdict == made.verdict, segment.verdict_why
    assert segment.verdict_why
    assert math.isfinite(segment.settling_time) == (made.verdict == "settled")
    if math.isfinite(made.settles):
        assert segment.settling_time == pytest.approx(made.settles, abs=1.6 * CYCLE)
    if math.isfinite(made.peak):
        assert segment.peak_deviation == pytest.approx(sign * made.peak, rel=0.07)
    if math.isfinite(made.at):
        assert segment.peak_time == pytest.approx(made.at, abs=0.7 * CYCLE)
    if math.isfinite(made.overshoot):
        assert segment.overshoot == pytest.approx(made.overshoot, rel=0.07, abs=1e-2)
    if math.isfinite(made.amplitude):
        assert segment.hunting_amplitude == pytest.approx(made.amplitude, rel=0.2)
    if math.isfinite(made.period):
        assert segment.hunting_period == pytest.approx(made.period, rel=0.07)
    if made.limits:
        assert segment.limits == pytest.approx(made.limits, nan_ok=True)
        assert (segment.time_at_limit > 0.3) == (made.verdict == "saturated" or name == "saturated at first")
    else:
        assert not segment.time_at_limit > 0.0


def test_a_target_that_moves_has_no_jumps_and_one_that_steps_has():
    times = np.arange(0.0, 6.0, 0.02)
    moving = Steps(times, 20.0 + 5.0 * np.sin(math.pi * times))
    assert len(target_jumps(moving, 0.1, 0.2).t) == 0
    stepped = Steps(times, moving.values + 4.0 * (times >= 3.0))
    assert target_jumps(stepped, 0.1, 0.2).t == pytest.approx([3.0])
    alone = Steps(np.array([0.0, 1.0, 2.0, 2.05]), np.array([20.0, 20.5, 20.55, 25.0]))
    assert target_jumps(alone, 0.1, 0.2).t == pytest.approx([1.0, 2.05])


def test_the_target_of_a_cycle_in_which_it_jumps_is_its_mean():
    steps = Steps(np.array([0.0, 1.0, 1.75]), np.array([10.0, 20.0, 40.0]))
    assert mean_between(steps, np.array([-1.0, 0.5, 1.0, 3.0]), np.array([0.0, 1.5, 2.0, 4.0])) == pytest.approx(
        [10.0, 15.0, 25.0, 40.0])


def test_figures_of_an_exponential_cover_every_cycle():
    segment = last_segment(loop(LOOPS["good"]))
    n = np.arange(int(5.0 / CYCLE))
    error = 30.0 * 0.1 / CYCLE * (1.0 - math.exp(-CYCLE / 0.1)) * np.exp(-n * CYCLE / 0.1)
    assert segment.rms_error == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-3)
    assert segment.mean_slip == pytest.approx(20.0 + error.mean(), rel=1e-4)
    assert (segment.largest_error, segment.peak_mean) == (pytest.approx(error[0], rel=1e-3),) * 2
    assert segment.iae == pytest.approx(error.sum() * CYCLE, rel=1e-3)
    assert segment.ripple == pytest.approx(8.3 / math.sqrt(2.0), rel=0.05)
    assert (segment.seconds, segment.lost_seconds) == (pytest.approx(len(n) * CYCLE), 0.0)
    assert segment.stick_fraction == 0.0
    assert segment.peak_slip == pytest.approx(30.0 + 8.3 * math.sin(2.0), rel=0.02)


def test_lost_cycles_are_counted():
    segment = last_segment(loop(LOOPS["good"], lost=20))
    assert segment.seconds + segment.lost_seconds == pytest.approx(5.0, abs=3 * CYCLE)
    assert 0.2 < segment.lost_seconds < 2.0
    assert segment.verdict == "settled"


@pytest.mark.parametrize("name", ["slow limit cycle", "two periods that end at 0", "small, slow, at a zero", "noise"])
def test_a_band_of_ones_own_counts(name):
    segment = last_segment(replace(loop(LOOPS[name]), floor=1.2))
    assert (segment.verdict, segment.band) == ("settled", 1.2)


def test_without_a_cycle_the_reason_is_said():
    empty = Loop(LoopCycles(*(np.empty(0),) * 7), Steps(np.array([0.0]), np.array([20.0])), why="no cycle was found")
    tracking = empty.tracking(0.0, 1.0)
    assert (tracking.verdict, tracking.verdict_why) == (None, "no cycle was found")
    assert {key for key, value in json_of(tracking).items() if value is not None} == {
        "target", "verdict_why", "limits", "seconds", "lost_seconds"}
    short = loop(LOOPS["good"]).tracking(1.01, 1.02)
    assert (short.verdict, short.verdict_why) == ("too short", "no whole period of excitation")


def test_a_disturbance_counts_from_the_last_cycle_before_it():
    """A load step that begins within a cycle, seen from there on: nothing is dropped, and there is no step."""
    made = loop(MadeUp(6.0, lambda t: 20.0 - 8.0 * np.maximum(t - 2.0, 0.0) / 0.2 * np.exp(
        1.0 - np.maximum(t - 2.0, 0.0) / 0.2), "settled"))
    for stepped in (False, None):
        tracking = made.tracking(2.0, 6.0, stepped=stepped)
        assert tracking.peak_deviation == pytest.approx(-8.0, rel=0.02)
        assert (tracking.peak_time, tracking.overshoot) == (pytest.approx(2.2, abs=CYCLE), pytest.approx(8.0, rel=0.02))
        assert tracking.settling_time == pytest.approx(0.2 * 6.83, abs=2 * CYCLE)


def test_a_run_of_closed_loop_is_judged_with_what_lies_between_its_samples():
    """Pure sliding under a pressure of two values: v rises with the torque's sine and has known figures."""
    run = tcc_sim.closed_loop(tcc_sim.load_scene("controlled").with_values({
        "initial.slip_speed": 400.0, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3,
        "friction.static_coefficient": 0.3}), lambda reading: 150e3 if reading.slip_speed > 300.0 else 1e5, 0.4)
    tracking = run.tracking_of(390.0, limits=(1e5, 150e3))
    dense = np.linspace(0.0, 0.4, 400_001)
    v = CubicSpline(run.t, run.slip_speed)(dense)
    cycle = run.cycle
    count = int(0.4 / cycle)
    means = np.array([v[(dense >= k * cycle) & (dense < (k + 1) * cycle)].mean() for k in range(count)])
    inside = dense < count * cycle
    number = np.minimum((dense / cycle).astype(int), count - 1)
    assert tracking.peak_slip == pytest.approx(np.abs(v - 390.0)[inside].max(), rel=1e-6)
    assert tracking.peak_mean == pytest.approx(np.abs(means - 390.0).max(), rel=1e-4)
    assert tracking.ripple == pytest.approx(np.sqrt(np.mean((v - means[number])[inside] ** 2)), rel=2e-2)
    assert tracking.iae == pytest.approx(np.abs(means - 390.0).sum() * cycle, rel=1e-4)
    assert tracking.stick_fraction == 0.0
    assert (tracking.pressure_low, tracking.pressure_high) == (run.applied_pressure[1:].min(),
                                                               run.applied_pressure.max())
    assert (tracking.time_at_limit, tracking.limits) == (1.0, (1e5, 150e3))
    steps = np.count_nonzero(np.diff(run.applied_pressure[1:]))
    assert tracking.pressure_rate == pytest.approx(5e7 * math.sqrt(steps * 1e-3 / 0.4))
    assert steps > 0
    assert (tracking.commands_applied, tracking.commands_superseded, tracking.command_rate) == (400, 0, 1000.0)


@pytest.mark.parametrize(("torque", "limit", "verdict"), [(230.0, 6e5, "settled"), (400.0, 1.5e5, "saturated")])
def test_a_load_step_of_closed_loop_shows_its_peak(torque, limit, verdict):
    """The peak is that of the means over each cycle, worked out here from the samples alone."""
    law = SlipController(Tuning(pressure_limit=limit))
    run = tcc_sim.closed_loop("controlled", lambda r: law.update(r.slip_speed, r.engine_torque), 3.0,
                              at={1.5: {"engine.mean_torque": torque}})
    tracking = run.tracking_of(20.0, since=1500)
    edges = np.arange(math.ceil(1.5 / CYCLE) - 1, int(3.0 / CYCLE) + 1) * CYCLE
    area = np.interp(edges, run.t, np.append(0.0, np.cumsum(0.5 * (run.slip_speed[1:] + run.slip_speed[:-1]) * 1e-3)))
    means = np.diff(area) / CYCLE - 20.0
    assert tracking.peak_deviation == pytest.approx(means.max(), rel=1e-2)
    assert tracking.peak_deviation > 1.0
    assert tracking.overshoot == pytest.approx(tracking.peak_deviation)
    assert tracking.verdict == verdict
    assert (tracking.time_at_limit > 0.9) == (verdict == "saturated")


def test_cycles_follow_a_frequency_that_changes_while_running():
    """Free slip under a constant clutch torque: the mean over each whole cycle changes by the mean torque alone."""
    scene = tcc_sim.load_scene("controlled").with_values({
        "initial.slip_speed": 300.0, "friction.kinetic_coefficient": 0.3, "friction.static_coefficient": 0.3})
    run = tcc_sim.closed_loop(scene, lambda r: 200.0 / (0.3 * 0.08 * 0.1), 3.0, at={1.003: {"engine.frequency": 231.0}})
    loops = run._loop(Steps(np.array([0.0]), np.array([300.0])))
    lengths = loops.course.ends - loops.course.starts
    assert lengths[0] == pytest.approx(2.0 * math.pi / 150.0)
    assert lengths[-1] == pytest.approx(2.0 * math.pi / 231.0)
    phase = 150.0 * np.minimum(loops.course.ends, 1.003) + 231.0 * np.maximum(loops.course.ends - 1.003, 0.0)
    assert phase / (2.0 * math.pi) == pytest.approx(np.arange(1, len(phase) + 1), abs=1e-6)


def test_a_target_is_checked():
    for wrong, text in (({}, "no target"), (1e9, r"target is 1e\+09 rad/s"), ({math.nan: 20.0}, "not a number")):
        with pytest.raises(InputError, match=text):
            target_steps(wrong)
