"""Tracking of a target: made-up loops by verdict, each also mirrored at another frequency, and with lost ticks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up_loops import LOOPS, MadeUp, loop
from scipy.interpolate import CubicSpline

import tcc_sim
from tcc_sim.analysis.control import Steps
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.analysis.stream import CyclePiece
from tcc_sim.analysis.tracking import (
    Counts,
    Loop,
    LoopCycles,
    LoopReader,
    Pressures,
    Tracking,
    at_level,
    mean_between,
    target_jumps,
    target_steps,
    value_at,
)
from tcc_sim.errors import InputError
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.result import json_of
from tcc_sim.trajectory import Cycles

CYCLE = 2.0 * math.pi / 150.0
WAYS = {"as it is": {}, "mirrored, at another frequency": {"sign": -1.0, "frequency": 210.0}, "losses": {"lost": 100}}


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


@pytest.mark.parametrize(("times", "values", "jumps"), [
    ([0.0, 1.0, 2.0, 2.05], [20.0, 20.5, 20.55, 25.0], [(1.0, 20.5), (2.05, 25.0)]), ([0.0], [20.0], []), ([], [], []),
    ([0.0, 1.0, 2.0], [20.0, 20.0, 18.0], [(2.0, 18.0)]), ([0.0, 1.0], [20.0, 20.125], []),
    ([0.0, 1.0], [20.0, 20.126], [(1.0, 20.126)]),
    ([0.0, 1.0, 1.25, 1.5], [20.0, 21.0, 25.0, 26.0], [(1.25, 25.0)]),   # Four times its neighbours, and less.
    ([0.0, 1.0, 1.25], [20.0, 21.125, 25.0], []), ([0.0, 1.0, 1.25], [20.0, 24.0, 25.125], []),
    ([0.0, 1.0, 1.26], [20.0, 21.125, 25.0], [(1.0, 21.125), (1.26, 25.0)])])
def test_a_jump_is_larger_than_the_least_and_than_its_neighbours(times, values, jumps):
    for sign in (1.0, -1.0):
        result = target_jumps(Steps(np.array(times), sign * np.array(values)), 0.125, 0.25)
        assert list(zip(result.t.tolist(), (sign * result.values).tolist())) == jumps


def test_the_target_of_a_cycle_in_which_it_jumps_is_its_mean():
    steps = Steps(np.array([0.0, 1.0, 1.75]), np.array([10.0, 20.0, 40.0]))
    assert mean_between(steps, np.array([-1.0, 0.5, 1.0, 3.0, 0.5, 1.0, -2.0]),
                        np.array([0.0, 1.5, 2.0, 4.0, 2.5, 1.0, -2.0])) == pytest.approx(
        [10.0, 15.0, 25.0, 40.0, (5.0 + 15.0 + 30.0) / 2.0, 20.0, 10.0])
    assert [value_at(steps, t) for t in (-1.0, 0.0, 0.999, 1.0 - 5e-10, 1.0, 1.74, 1.75, 9.0)] == [
        10.0, 10.0, 10.0, 20.0, 20.0, 20.0, 40.0, 40.0]


def test_a_pressure_is_at_a_level_within_1e_5_of_it():
    levels = np.array([2e5 - 2.1, 2e5 - 1.9, 2e5, 2e5 + 1.9, 2e5 + 2.1, math.nan])
    assert at_level(levels, 2e5).tolist() == [False, True, True, True, False, False]
    assert at_level(levels, 2e5, 1).tolist() == [False, True, True, True, True, False]
    assert at_level(levels, 2e5, -1).tolist() == [True, True, True, True, False, False]
    assert not at_level(levels, math.nan, 1).any()
    assert at_level(np.array([-1.0, 0.0, 1e-3, 3e-3, 2e5]), 0.0).tolist() == [False, True, True, False, False]


def hand_made(means, reference, begin=1.0, before=(), squares=2.5, stick=0.0, **more):
    """A loop of cycles of 0.1 s: these means from `begin` on, others before, and extremes 3 below and 4 above."""
    mean = np.array([*before, *means], dtype=float)
    starts = begin + 0.1 * (np.arange(len(mean)) - len(before))
    course = LoopCycles(starts, starts + 0.1, mean, mean**2 + squares, mean + 4.0, mean - 3.0, stick + 0.0 * mean)
    times, values = np.array(reference, dtype=float).T
    return Loop(course, Steps(times, values), **more)


APPROACH = 22.0, 26.0, 29.0, 31.0, 33.0, 32.0, 30.5, 29.9, 30.05, 30.02, 29.98, 30.03
ROWS = np.arange(45)
PRESSED = Pressures(0.05 * (ROWS + 1), np.where(ROWS < 25, 1e5, np.where(ROWS % 2, 3e5, 2e5)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_figure_of_a_segment_is_that_of_its_cycles(sign):
    """A step from a mean of 20.5 to 30, of which the figures are worked out here one by one."""
    made = hand_made(sign * np.array(APPROACH), [(0.0, sign * 20.0), (1.0, sign * 30.0)],
                     before=(sign * 20.1, sign * 20.5), pressures=PRESSED, limits=(1e5, 3e5), note="; noted")
    made.course.stick_time[2:] = [0.01, math.nan, *[0.0] * 10]
    error = np.array(APPROACH) - 30.0
    segment = made.tracking(1.0, 2.2, stepped=True, discard=2, commands=Counts(40, 3))
    pressure = PRESSED.values[20:44]
    rises = np.diff(pressure)
    expected = Tracking(
        target=sign * 30.0, mean_slip=sign * np.mean(APPROACH[2:]), rms_error=math.sqrt(np.mean(error[2:] ** 2)),
        largest_error=3.0, overshoot=3.0, overshoot_time=1.45, settling_time=0.7, target_low=sign * 30.0,
        target_high=sign * 30.0, verdict="settled", band=0.19,
        verdict_why="within 0.19 rad/s for the last 0.5 s; noted",
        peak_deviation=sign * 3.0, peak_time=1.45, peak_mean=8.0, peak_slip=11.0 if sign > 0.0 else 12.0,
        iae=0.1 * np.abs(error).sum(), ripple=math.sqrt(2.5), stick_fraction=0.01 / 1.1, pressure_low=1e5,
        pressure_high=3e5, pressure_rate=math.sqrt(np.sum(rises**2) / 0.05 / 1.2), limits=(1e5, 3e5),
        time_at_limit=np.mean((pressure == 1e5) | (pressure == 3e5)), command_rate=40.0 / 1.2, commands_applied=40,
        commands_superseded=3, seconds=1.2, lost_seconds=0.0)
    for name, value in vars(expected).items():
        assert getattr(segment, name) == (value if isinstance(value, str) else pytest.approx(
            value, rel=1e-9, abs=1e-12, nan_ok=True)), name


@pytest.mark.parametrize(("cycles", "run", "stepped", "over", "peak"), [
    ((20.5,), math.nan, None, 3.0, 3.0), ((20.5,), math.nan, True, 3.0, 3.0), ((20.5,), math.nan, False, 8.0, -8.0),
    ((), 20.5, None, 3.0, 3.0), ((), 29.95, None, 8.0, -8.0), ((), math.nan, None, 3.0, 3.0),
    ((30.4,), math.nan, None, 8.0, -8.0), ((30.4,), math.nan, True, 8.0, -8.0), ((28.1,), math.nan, None, 8.0, -8.0),
    ((27.9,), math.nan, None, 3.0, -8.0), ((28.1,), math.nan, True, 3.0, -8.0), ((20.5,), 30.4, None, 3.0, 3.0)])
def test_a_step_counts_from_the_last_mean_before_it(cycles, run, stepped, over, peak):
    """Of the cycles, else of the run; else from a start at 20. An uncertain one counts from a quarter of 8 rad/s on."""
    segment = replace(hand_made(APPROACH, [(0.0, 30.0)], before=cycles), before=run).tracking(1.0, 2.2, stepped=stepped)
    assert (segment.overshoot, segment.peak_deviation) == (pytest.approx(over), pytest.approx(peak))


def test_the_approach_to_a_target_is_no_peak():
    for late in (30.3, 29.7):
        means = [22.0, 26.0, 29.0, 29.9, late, *[30.0] * 7]
        segment = hand_made(means, [(0.0, 30.0)], before=(20.5,)).tracking(1.0, 2.2)
        assert (segment.peak_deviation, segment.peak_time) == (pytest.approx(late - 30.0), pytest.approx(1.45))


def test_a_band_is_at_least_a_step_of_a_moving_target():
    """Steps of 0.3 rad/s at every half of a cycle, and a jump of 9 rad/s: the loop cannot follow the former."""
    t = np.arange(0.0, 2.2, 0.05)
    moving = 30.0 - 0.3 * (np.arange(len(t)) % 2) + 9.0 * (t >= 0.99)
    segment = hand_made([38.9] * 12, list(zip(t, moving)), before=(38.9,)).tracking(1.0, 2.2)
    assert segment.band == pytest.approx(0.3)
    assert (segment.verdict, segment.target_low, segment.target_high) == ("settled", pytest.approx(38.7), 39.0)
    only = hand_made([22.0], [(0.0, 30.0)], squares=-1e-9).tracking(1.0, 1.1)
    assert (only.overshoot, only.ripple, only.verdict, only.verdict_why) == (
        0.0, 0.0, "too short", "1 whole period of excitation; a verdict needs 5")


def held(level, count=12, **more):
    """An error of 5 rad/s for 12 cycles while the pressure is at a level in this many of its last samples."""
    t = np.arange(1.005, 2.2, 0.01)
    pressure = np.where(np.arange(len(t)) >= len(t) - count, level, 2e5 + 1e3 * (np.arange(len(t)) % 2))
    return hand_made([35.1234] * 12, [(0.0, 30.0)], pressures=Pressures(t, pressure), **more).tracking(1.0, 2.2)


def test_a_verdict_on_pressure_or_stick_says_why_in_a_whole_sentence():
    """The end is the last half a second, five cycles: 50 samples."""
    assert held(4e5, 120, limits=(0.0, 4e5)).verdict_why == (
        "the pressure is at its upper limit, 400000 Pa, for 100 % of the last 0.5 s, and the mean 5.12 rad/s above the "
        "target")
    assert held(0.0, 40, limits=(0.0, 4e5)).verdict_why == (
        "the pressure is at its lower limit, 0 Pa, for 80 % of the last 0.5 s, and the mean 5.12 rad/s above the "
        "target")
    assert [held(4e5, count, limits=(0.0, 4e5)).verdict for count in (24, 25)] == ["off target", "saturated"]
    assert held(3.9e5, 120, limits=(0.0, 4e5)).verdict == "off target"
    stuck = hand_made([5.0] * 12, [(0.0, 30.0)], stick=0.025)
    assert (stuck.tracking(1.0, 2.2).verdict, stuck.tracking(1.0, 2.2).verdict_why) == (
        "sticking", "in stick for 25 % of the last 0.5 s")
    for time, verdict in ((0.00199, "off target"), (0.00201, "sticking")):
        assert hand_made([5.0] * 12, [(0.0, 30.0)], stick=time).tracking(1.0, 2.2).verdict == verdict
    for cycles, verdict in ((2, "off target"), (3, "sticking")):
        some = hand_made([5.0] * 12, [(0.0, 30.0)])
        some.course.stick_time[12 - cycles:] = 0.05
        assert some.tracking(1.0, 2.2).verdict == verdict


@pytest.mark.parametrize(("seconds", "error", "limits"), [
    (0.6, 5.0, (0.0, 4e5)), (0.48, 5.0, (0.0, math.nan)), (0.6, -5.0, (4e5, math.nan)), (0.6, 0.05, (0.0, math.nan))])
def test_a_pressure_that_is_held_for_five_cycles_while_the_error_keeps_its_sign_is_a_limit(seconds, error, limits):
    t = np.arange(1.01, 2.205, 0.01)
    pressure = np.where(t > 2.2 - seconds, 4e5, 2e5 + 1e3 * (np.arange(len(t)) % 2))
    segment = hand_made([30.0 + error] * 12, [(0.0, 30.0)], pressures=Pressures(t, pressure)).tracking(1.0, 2.2)
    assert segment.limits == pytest.approx(limits, nan_ok=True)


def test_a_cycle_belongs_to_a_segment_if_it_ends_in_it():
    course = hand_made(APPROACH, [(0.0, 30.0)]).course
    for begin, end, rows in ((1.0, 2.2, range(12)), (1.05, 2.15, range(11)), (1.1, 2.1, range(1, 11)), (1.3, 1.3, []),
                             (1.1 - 5e-8, 1.2, range(1, 2)), (1.1 + 5e-8, 1.2 - 5e-8, range(1, 2))):
        assert course.within(begin, end).mean.tolist() == [APPROACH[k] for k in rows]


def test_extremes_join_the_means_by_their_number_and_starts_follow_the_ends():
    reader = LoopReader(Uniform(0.1))
    for begin, end, level in ((0, 305, 2.0), (550, 801, 4.0)):
        reader.interrupt()
        reader.feed(np.arange(begin, end) * 1e-3, np.full(end - begin, level))
    x = np.arange(3.0)
    piece = Cycles(np.zeros((4, 3)), 10.0 + x, -x, 0.01 * x, starts=np.array([0.1, 0.2, 0.3, 0.4]))
    reader.extremes([CyclePiece(0, 1, piece)])
    course = reader.course()
    assert course.mean == pytest.approx([2.0, 2.0, 2.0, 4.0, 4.0])
    assert course.square == pytest.approx([4.0, 4.0, 4.0, 16.0, 16.0])
    assert course.ends == pytest.approx([0.1, 0.2, 0.3, 0.7, 0.8])
    assert course.starts == pytest.approx([0.0, 0.1, 0.2, 0.6, 0.7])
    assert course.highest == pytest.approx([math.nan, 10.0, 11.0, math.nan, math.nan], nan_ok=True)
    assert course.lowest == pytest.approx([math.nan, 0.0, -1.0, math.nan, math.nan], nan_ok=True)
    assert course.stick_time == pytest.approx([math.nan, 0.0, 0.01, math.nan, math.nan], nan_ok=True)


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


@pytest.mark.parametrize(("target", "sentence"), [
    ({}, "there is no target; give a slip speed, or times with slip speeds"),
    (1.001e5, "target is 100100 rad/s; it must be -100000 to 100000 rad/s"),
    (-1.001e5, "target is -100100 rad/s; it must be -100000 to 100000 rad/s"),
    (math.nan, "target is nan rad/s; it must be -100000 to 100000 rad/s"),
    ({math.nan: 20.0}, "a time of the target is not a number; it must be a time in s")])
def test_a_target_that_is_none_is_refused(target, sentence):
    with pytest.raises(InputError) as refusal:
        target_steps(target)
    assert str(refusal.value) == sentence


def test_targets_are_steps_in_order_of_time():
    steps = target_steps({3.0: 1e5, 0.5: -1e5, 2.0: 7})
    assert (steps.t.tolist(), steps.values.tolist()) == ([0.5, 2.0, 3.0], [-1e5, 7.0, 1e5])
    assert (target_steps(30).t.tolist(), target_steps(30).values.tolist()) == ([0.0], [30.0])


def test_a_step_counts_from_the_last_mean_before_it_unless_that_is_long_ago():
    """From the cycle that ended less than 1.5 cycles before; else from the mean that is known, or two means on."""
    ends = np.array([0.1, 0.2, 0.3, 0.7, 0.8, 0.9])
    mean = np.array([5.0, 6.0, 7.0, 10.0, 13.0, 15.0])
    course = LoopCycles(ends - 0.1, ends, mean, *[np.full(6, math.nan)] * 4)
    made = Loop(course, Steps(np.array([0.0]), np.array([20.0])))
    for begin, stepped, before, expected in (
            (0.3, True, math.nan, (13.0, True)), (0.3, None, math.nan, (13.0, False)),
            (0.3, False, math.nan, (0.0, True)), (0.44, None, math.nan, (13.0, False)),
            (0.46, None, math.nan, (20.0 - 8.5, False)), (0.46, None, 4.0, (16.0, True)),
            (0.0, None, 4.0, (16.0, True)), (0.0, True, math.nan, (20.0 - 4.5, False)),
            (0.8, None, math.nan, (7.0, False))):
        one = replace(made, before=before)
        assert one._step(course.within(begin, 2.0), begin, stepped) == pytest.approx(expected)
    assert replace(made, before=math.nan)._step(course.within(0.46, 0.75), 0.46, True) == (10.0, False)
