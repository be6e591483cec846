"""Summaries of trajectories with figures known by hand."""

import math
from dataclasses import replace as with_field

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import (
    CycleTimes,
    Span,
    Summary,
    cycle_parts_of,
    cycle_times_of,
    dropped_of,
    first_cycle_of,
    regime_of,
    runaway_cause,
    runs_away,
    section_of,
    slip_grows,
    summarise,
    summarise_cycles,
    sums_of,
    varying,
)
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.scatter import scatter
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.sweep import sweep
from tcc_sim.trajectory import Cycles, Loads, Statistics, Trajectory

FREQUENCY = 100.0
CYCLE = 2.0 * math.pi / FREQUENCY
SYSTEM = replace(System(), {"engine.frequency": FREQUENCY})


def trajectory_of(slip_speed, slip_acceleration, count, samples=400, start=0):
    """A sampled motion v(t) with the plate at rest: the torques are those with which (2a), (2b) hold exactly."""
    t = np.arange(start * samples, (start + count) * samples + 1) * (CYCLE / samples)
    zero = np.zeros_like(t)
    return Trajectory(t, slip_speed(t), zero, zero, SYSTEM.driveline.flywheel_inertia * slip_acceleration(t),
                      zero + 500.0, zero, np.zeros(len(t), np.int8), CYCLE, "by_hand", SYSTEM)


def part_of(whole, samples, first=0):
    """Samples of a trajectory."""
    names = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
             "state")
    return with_field(whole, **{name: getattr(whole, name)[first:samples] for name in names})


def sine(offset, amplitude, phase, ratio=1.0):
    w = ratio * FREQUENCY
    return lambda t: offset + amplitude * np.sin(w * t + phase), lambda t: amplitude * w * np.cos(w * t + phase)


def test_the_maxima_and_the_section_of_a_sine_are_exact():
    summary = summarise(trajectory_of(*sine(5.0, 20.0, 0.3), 30), 10)
    assert summary.max_slip_speed == pytest.approx(25.0, abs=1e-6)
    assert summary.min_slip_speed == pytest.approx(-15.0, abs=1e-6)
    assert summary.period == 1
    assert summary.settled
    assert "30 cycles, period 1, settled, " in repr(summary)
    assert summary.section == [(0.0, pytest.approx(5.0 + 20.0 * math.sin(0.3), abs=1e-9))]
    assert (summary.cycles, summary.discarded, summary.solver) == (30, 10, "by_hand")


@pytest.mark.parametrize("period", [2, 3, 5])
def test_a_subharmonic_has_its_period_and_its_points_in_order(period):
    v, a = sine(0.0, 20.0, 0.4, 1.0 / period)
    for count in range(40, 40 + period):
        summary = summarise(trajectory_of(v, a, count), 7)
        assert summary.period == period
        assert [p[1] for p in summary.section] == pytest.approx([float(v(n * CYCLE)) for n in range(period)], abs=1e-6)


def test_a_motion_without_period_lists_every_kept_cycle():
    summary = summarise(trajectory_of(*sine(0.0, 20.0, 0.0, (math.sqrt(5.0) - 1.0) / 2.0), 60), 20)
    assert summary.period == 0
    assert len(summary.section) == 40


def test_regimes_and_stick_fractions_end_at_their_bounds():
    assert [regime_of(x) for x in (0.0, 0.005, 0.00501, 0.5, 0.99499, 0.995, 1.0)] == [
        "slip", "slip", "stick-slip", "stick-slip", "stick-slip", "stick", "stick"]
    assert [sums_of(Cycles(np.zeros((2, 3)), *np.array([[1.0], [0.5], [stuck]])), 2.0)["stick_fraction"] for stuck in (
        -0.1, 1e-12, 3e-12, 0.5, 2.0 - 3e-12, 2.0 - 1e-12, 2.1)] == [0.0, 0.0, 1.5e-12, 0.25, 1.0 - 1.5e-12, 1.0, 1.0]
    stuck = trajectory_of(lambda t: 0.0 * t, lambda t: 0.0 * t, 10)
    assert (summarise(stuck, 2).stick_fraction, summarise(stuck, 2).regime) == (1.0, "stick")
    assert summarise(trajectory_of(*sine(30.0, 20.0, 0.0), 10), 2).regime == "slip"


def numbered(count, first=0):
    """Cycles of a motion of period two from this number on, with figures that tell them apart."""
    n = first + np.arange(count)
    sides = (first + np.arange(count + 1)) % 2
    section = np.stack([30.0 + 10.0 * sides, 0.1 + 0.2 * sides, 3.0 - sides], axis=1)
    loads = Loads(10.0 + n, 100.0 + n, 200.0 + 3.0 * n, -50.0 - 2.0 * n, 0.0 * n + 2.0, 0.5 * n)
    return Cycles(section, 50.0 + n, 20.0 - 3.0 * n, 0.01 + 0.0 * n, loads, 0.1 * (first + np.arange(count + 1)))


def test_every_figure_of_a_summary_is_that_of_its_cycles():
    """Twelve cycles from number 5 on, of which the third is not observed, and a part of one before and behind them."""
    cycles, before, behind = numbered(12, 5), numbered(1, 4)[:1], numbered(1, 17)[:1]
    for column in (cycles.highest, cycles.lowest, cycles.stick_time, *cycles.loads.columns()):
        column[2] = math.nan
    parts = [with_field(before, starts=np.array([0.42, 0.5])), with_field(behind, starts=np.array([1.7, 1.78]))]
    by = with_field(trajectory_of(*sine(0.0, 1.0, 0.0), 1), statistics=Statistics(seconds=0.75))
    summary = summarise_cycles(cycles, CycleTimes(0.1, 5, 0.5), dropped=5, broken=3, partial=parts, by=by)
    n = np.array([4.0, 5.0, 6.0, *range(8, 18)])
    expected = Summary(
        max_slip_speed=67.0, min_slip_speed=-31.0, period=0, section=[], stick_fraction=0.13 / 1.26,
        regime="stick-slip", cycles=19, discarded=5, settled=False, section_change=0.2 / 0.3, solver="by_hand",
        elapsed_s=0.75, transient=True, covers=(0.42, 1.78), seconds=1.26, lost_seconds=0.1, broken=3, longest_period=0,
        clutch_energy=float(np.sum(10.0 + n)), mean_power=float(np.sum(10.0 + n)) / 1.26, peak_power=117.0,
        max_shaft_torque=251.0, min_shaft_torque=-84.0, breakaways=26, coupling_energy=float(np.sum(0.5 * n)))
    row = summary.columns()
    assert set(row) == set(vars_of(summary)) - {"section", "section_states", "covers"}
    for name, (value,) in expected.columns().items():
        assert row[name] == [value if isinstance(value, str) else pytest.approx(value, nan_ok=True)], name
    assert summary.covers == pytest.approx(expected.covers)
    assert summary.section == [(angle, v) for v, angle, _ in cycles.section[1:].tolist()]
    assert summary.section_states == [(angle, v, w) for v, angle, w in cycles.section[1:].tolist()]


def vars_of(summary):
    return {name: getattr(summary, name) for name in Summary.__dataclass_fields__}


def test_lengths_of_cycles_that_differ_are_added_up():
    cycles = numbered(8)
    cycles.highest[3] = cycles.lowest[5] = cycles.stick_time[6] = math.nan
    summary = summarise_cycles(cycles, CycleTimes(0.1 + 0.01 * np.arange(8.0), since=2.0))
    assert summary.covers == pytest.approx((2.0, 2.0 + 0.8 + 0.28))
    assert (summary.lost_seconds, summary.seconds) == pytest.approx((0.3 + 0.14, 0.64), abs=1e-12)
    assert (summary.cycles, summary.breakaways) == (5, 10)
    given = summarise_cycles(numbered(3), CycleTimes(0.1), span=Span(1.0, 4.0, 0.5))
    assert (given.covers, given.seconds, given.lost_seconds, given.stick_fraction) == ((1.0, 4.0), 2.5, 0.5, 0.03 / 2.5)


@pytest.mark.parametrize(("first", "count", "period", "rows"), [
    (0, 6, 3, [2, 3, 4]), (1, 6, 3, [1, 2, 3]), (2, 6, 3, [3, 4, 5]), (0, 6, 1, [5]), (5, 6, 2, [4, 5]),
    (4, 6, 2, [3, 4]), (0, 3, 0, [0, 1, 2])])
def test_a_section_begins_at_a_multiple_of_its_period(first, count, period, rows):
    """Point k lies at the end of cycle first + k."""
    points = np.arange(3.0 * count).reshape(count, 3)
    assert section_of(points, first, period).tolist() == points[rows].tolist()
    assert not period or (first + rows[0] + 1) % period == 0


@pytest.mark.parametrize(("torque", "words"), [
    (300.0, ["432 N m", "instants"]), (-431.9, ["432 N m", "instants"]),
    (-440.0, ["-440 N m", "432 N m", "225000 Pa"])])
def test_a_runaway_has_its_cause_in_a_sentence(torque, words):
    values = {"engine.mean_torque": torque, "pressure.mean": 225e3, "friction.kinetic_coefficient": 0.24}
    cause = runaway_cause(replace(load_scene("fig02").system, values))
    assert [word for word in words if word not in cause] == []


@pytest.mark.parametrize(("cycles", "discard", "sentence"), [
    (0, None, "no whole period"), (3, -1, "--discard is -1.* 0 or more"), (3, 3, "--discard 3 .* 3 cycles"),
    (1, 1, "--discard 1 .* only cycle"), (0, 2, "no whole period")])
def test_what_leaves_no_cycle_is_refused(cycles, discard, sentence):
    with pytest.raises(InputError, match=sentence):
        dropped_of(cycles, discard)
    assert (dropped_of(3, 2), dropped_of(3, None), dropped_of(1, 0)) == (2, 1, 0)


def test_times_of_a_profile_are_those_of_its_phase():
    """omega goes from 100 to 200 rad/s in 2 s: phi = 100 t + 25 t^2, and 300 + 200 (t - 2) later, 47.7 cycles."""
    assert cycle_times_of(None, 0.25, 3, 4) == (0.25, 3, 0.75, 0, False)
    assert cycle_times_of(SYSTEM, 0.25, 3, 4) == (CYCLE, 3, 3.0 * CYCLE, 0, False)
    values = {"engine.frequency_times": (0.0, 2.0), "engine.frequency_values": (100.0, 200.0),
              "engine.mean_torque_times": (0.0, 2.0), "engine.mean_torque_values": (0.0, -430.0),
              "pressure.mean": 225e3, "friction.kinetic_coefficient": 0.24}
    system = load_scene("fig02").with_values(values).system
    turn = 2.0 * math.pi

    def start(n):
        phase = turn * n
        return -2.0 + math.sqrt(4.0 + phase / 25.0) if phase < 300.0 else 2.0 + (phase - 300.0) / 200.0

    for first, count, varied in ((3, 50, 45), (47, 4, 1), (48, 4, 0)):
        times = cycle_times_of(system, 0.25, first, count)
        assert times.since == pytest.approx(start(first))
        assert times.cycle == pytest.approx(np.diff([start(n) for n in range(first, first + count + 1)]))
        assert (times.first, times.varied, times.carried) == (first, varied, True)
    whole = replace(System(), {"engine.frequency": 20.0 * math.pi, "engine.mean_torque_times": (0.0, 0.5),
                               "engine.mean_torque_values": (0.0, 1.0)})
    assert cycle_times_of(whole, 0.1, 0, 9).varied == 5
    heavier = replace(system, {"engine.mean_torque_values": (0.0, -433.0)})
    assert cycle_times_of(heavier, 0.25, 47, 4).carried is False


@pytest.mark.parametrize(("begin", "end", "early", "whole", "late"), [
    (0, 1200, False, 3, False), (100, 1200, True, 2, False), (0, 1100, False, 2, True), (100, 1100, True, 1, True),
    (100, 300, False, 0, True), (0, 400, False, 1, False), (390, 410, True, 0, True), (400, 700, False, 0, True)])
def test_a_run_has_whole_cycles_between_parts_of_cycles(begin, end, early, whole, late):
    """Slip of 10 + t/cycle rad/s, samples of a four-hundredth of a cycle."""
    run = part_of(trajectory_of(lambda t: 10.0 + t / CYCLE, lambda t: 1.0 / CYCLE + 0.0 * t, 3), end + 1, begin)
    before, cycles, behind = cycle_parts_of(run)
    first = -(-begin // 400)
    assert (before is not None, len(cycles), behind is not None) == (early, whole, late)
    assert cycles.highest == pytest.approx([11.0 + first + k for k in range(whole)])
    assert cycles.lowest == pytest.approx([10.0 + first + k for k in range(whole)])
    if before is not None:
        assert before.starts == pytest.approx([begin / 400.0 * CYCLE, first * CYCLE])
        assert before.lowest == pytest.approx([10.0 + begin / 400.0])
    if behind is not None:
        assert behind.starts == pytest.approx([(first + whole) * CYCLE if whole or early or begin == 400 else
                                               begin / 400.0 * CYCLE, end / 400.0 * CYCLE])
        assert behind.highest == pytest.approx([10.0 + end / 400.0])
    assert (first_cycle_of(run), varying(run)) == (first, None)


def test_samples_without_a_system_or_too_few_have_no_cycles():
    run = trajectory_of(*sine(5.0, 20.0, 0.3), 3)
    for without, sentence in ((with_field(run, system=None), "system"), (part_of(run, 1), "two samples")):
        with pytest.raises(InputError, match=sentence):
            cycle_parts_of(without)
    assert len(cycle_parts_of(part_of(run, 2))[1]) == 0


def test_a_trajectory_shorter_than_a_cycle_is_refused():
    with pytest.raises(InputError, match="no whole period of excitation"):
        summarise_cycles(Cycles(np.zeros((1, 3)), np.empty(0), np.empty(0), np.empty(0)), CycleTimes(CYCLE))
    with pytest.raises(InputError, match="no whole period of excitation"):
        summarise(part_of(trajectory_of(*sine(5.0, 20.0, 0.3), 1), 200), 1)
    part = summarise(part_of(trajectory_of(*sine(5.0, 20.0, 0.3), 1), 201))
    assert (part.cycles, part.discarded, part.covers) == (0, 0, (0.0, pytest.approx(0.5 * CYCLE)))


def speeds(size: np.ndarray, swing: float = 5.0, stick: float = 0.0) -> Cycles:
    """Cycles in slip that swings about a mean."""
    section = np.stack([size, np.full(len(size), 0.1), np.zeros(len(size))], axis=1)
    return Cycles(np.vstack([section[:1], section]), size + swing, size - swing, np.full(len(size), stick))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("slip", "stick", "grows"), [
    (lambda n: 20.0 + 0.3 * n, lambda n: 0.0 * n, True), (lambda n: 150.0 + 2e-3 * n, lambda n: 0.0 * n, True),
    (lambda n: 50.0 - 20.0 * 0.96**n, lambda n: 0.0 * n, False), (lambda n: 50.0 - 0.3 * n, lambda n: 0.0 * n, False),
    (lambda n: 50.0 + 1e-5 * n, lambda n: 0.0 * n, False), (lambda n: 4.0 + 0.01 * n, lambda n: 0.0 * n, False),
    (lambda n: 20.0 + 0.3 * n, lambda n: 1e-3 + 0.0 * n, False),   # The last third must be in slip.
    (lambda n: np.where(n < 30, 4.0, 20.0 + 0.3 * n), lambda n: 0.0 * n, True),
    (lambda n: 20.0 + 0.3 * n, lambda n: 1e-3 * (n < 60), True),
    (lambda n: 20.0 + 0.3 * n, lambda n: 1e-3 * (n < 61), False)])
def test_slip_that_grows_to_the_end_is_a_runaway(slip, stick, grows, sign) -> None:
    n = np.arange(90.0)
    cycles = speeds(sign * slip(n), sign * 5.0)
    cycles.stick_time[:] = stick(n)
    assert slip_grows(cycles) is grows
    summary = summarise_cycles(cycles, CycleTimes(CYCLE))
    assert summary.runaway is grows
    assert not (grows and (summary.period or summary.settled))
    few = speeds(sign * (20.0 + 0.3 * n), sign * 5.0)
    assert (slip_grows(few[:3]), slip_grows(few[:2])) == (True, False)


@pytest.mark.parametrize(("ratio", "grows"), [(0.49, False), (0.51, True)])
def test_the_second_step_of_growth_is_more_than_half_of_the_first(ratio, grows):
    """Means of the thirds of 20 + 30 u - b u^2, u = 0 to 3, rise by 30 - 2 b and by 30 - 4 b."""
    u = (np.arange(96.0) + 0.5) / 32.0
    assert slip_grows(speeds(20.0 + 30.0 * u - 30.0 * (1.0 - ratio) / (4.0 - 2.0 * ratio) * u**2)) is grows


def test_a_run_up_runs_away_if_slip_grows_after_it_or_over_all_and_its_end():
    """Slip that rises by 0.3 rad/s a cycle; from cycle 45 on it is constant, or grows only from there on."""
    n = np.arange(90.0)
    grown, late = 20.0 + 0.3 * np.minimum(n, 45.0), 20.0 + 0.3 * np.maximum(n - 45.0, 0.0)
    for values, varied, away in ((20.0 + 0.3 * n, 0, True), (20.0 + 0.3 * n, 60, True), (20.0 + 0.3 * n, 90, True),
                                 (grown, 50, False), (grown, 75, False), (late, 45, True), (late, 74, True),
                                 (20.0 + 0.3 * n, 200, True), (late, 0, True)):
        assert runs_away(speeds(values), varied) is away
    lag = 20.0 + 0.3 * np.where(n < 74, n, 74.0)
    assert [runs_away(speeds(lag), varied) for varied in (74, 75)] == [False, False]


def filtered(noise: np.ndarray, keep: float) -> np.ndarray:
    """Noise with a memory, of the same variance."""
    out = np.zeros(len(noise))
    for k in range(1, len(noise)):
        out[k] = keep * out[k - 1] + math.sqrt(1.0 - keep**2) * noise[k]
    return out


MADE_UP = {
    "noise": lambda n, noise: 30.0 + 0.1 * noise,
    "noise with a memory": lambda n, noise: 30.0 + 0.1 * filtered(noise, 0.8),
    "a motion that settles, in noise": lambda n, noise: 30.0 - 0.95**n + 0.1 * noise,
    "a motion that has settled, in noise": lambda n, noise: 30.0 - 0.7**n + 0.1 * noise,
    "a swing of three cycles": lambda n, noise: 30.0 + np.sin(2.1 * n + noise[0]) + 0.01 * noise,
    "slip that falls": lambda n, noise: 40.0 - 0.02 * n + 0.1 * noise}
"""Recorded slip of one sign that does not run away."""


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", MADE_UP)
def test_the_scatter_of_a_recording_is_no_growth(kind: str, sign: float) -> None:
    """Of 150 recordings of 12 to 161 cycles; by the tolerance of a solver alone 13 to 30 grew of the first five kinds.
    """
    random = np.random.default_rng(8)
    found = sum(slip_grows(speeds(sign * MADE_UP[kind](np.arange(12.0 + k), random.normal(size=12 + k)), sign * 5.0))
                for k in range(150))
    assert found <= 4


RISING = {"friction.static_coefficient": 0.1, "friction.kinetic_coefficient": 0.13, "friction.decay": 0.05,
          "engine.mean_torque": 250.0, "pressure.amplitude": 0.0, "initial.plate_angle": 250.0 / 3000.0}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("slip", "swing"), [(0.3, 20.0), (0.35, 20.0), (0.4, 30.0), (0.5, 25.0), (0.5, 30.0)])
def test_a_periodic_motion_of_slow_slip_is_no_runaway(slip, swing, sign):
    """On a rising characteristic the motion repeats while the flywheel turns back on every section."""
    carried = 0.008 * (0.13 - 0.03 * math.exp(-0.05 * slip))
    scene = load_scene("fig02").with_values({
        **RISING, "engine.torque_amplitude": swing, "engine.frequency": 200.0, "pressure.mean": 250.0 / carried,
        "initial.slip_speed": sign * slip, "initial.plate_angle": sign * 250.0 / 3000.0,
        "engine.mean_torque": sign * 250.0})
    summary = simulate(scene).summary
    assert summary.section_change < 1e-9
    assert (summary.runaway, summary.period, summary.settled) == (False, 1, True)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("swing", [0.0, 60.0])
@pytest.mark.parametrize(("torque", "away"), [(200.0, False), (400.0, True)])
def test_slip_runs_away_where_the_torque_exceeds_what_friction_carries(torque, away, swing, sign):
    """mu_k N R is 300 N m."""
    summary = simulate(load_scene("slip").with_values({
        "engine.mean_torque": sign * torque, "engine.torque_amplitude": swing, "initial.slip_speed": sign * 150.0,
        "pressure.amplitude": 0.0}), cycles=100).summary
    assert summary.runaway is away


@pytest.mark.parametrize(("pressure", "away"), [(1e5, True), (2.25e5, False)])
def test_a_profile_that_ends_the_run_hides_no_runaway(pressure, away, tmp_path):
    """The run-up's torque of 300 N m is above 0.2 x 100 kPa x 0.008 m^3 throughout."""
    scene = load_scene("runup").with_values({"pressure.mean": pressure})
    whole = simulate(scene, duration=1.0).summary
    assert whole.runaway is away
    assert sweep(scene, "friction.decay", [2.0], duration=1.0).points[0].summary.runaway is away
    assert scatter(scene, {"friction.decay": (1.9, 2.1)}, 2, duration=1.0).left_out["runaway"] == 2 * away


def test_slip_that_follows_a_torque_which_friction_carries_is_no_runaway():
    """A rising characteristic carries 0.13 x 2.5 MPa x 0.008 m^3 in fast slip; the torque rises to the end."""
    ramp = {"engine.mean_torque_times": (0.0, 4.0), "engine.mean_torque_values": (210.0, 255.0)}
    scene = load_scene("fig02").with_values({**RISING, "engine.torque_amplitude": 0.0, "pressure.mean": 2.5e5,
                                             "initial.slip_speed": 1.0, **ramp})
    summary = simulate(scene, duration=4.0).summary
    assert summary.min_slip_speed > 0.0
    assert summary.max_slip_speed > 10.0
    assert not summary.runaway


@pytest.mark.parametrize(("kept", "grows"), [(3, False), (15, False), (16, True)])
def test_few_cycles_after_a_gap_show_no_growth(kept: int, grows: bool) -> None:
    result = speeds(20.0 + 0.3 * np.arange(9.0 if kept < 9 else 24.0))
    result.highest[-kept - 1] = np.nan
    assert slip_grows(result) is grows
    assert summarise_cycles(result, CycleTimes(CYCLE)).runaway is grows
