"""A recording in segments, each with its figures; source of its inputs and age of its commands, by construction."""

from __future__ import annotations

import json
import math
from dataclasses import fields

import numpy as np
import pytest
from diagnostics_by_hand import diagnostics
from driveline_bags import START, TICK, bag, by_hand, ticked

import tcc_sim
from tcc_sim.analysis.loop.tracking import Tracking
from tcc_sim.analysis.steady.summary import cycles_of, summarise
from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.recording.announcements import holding_from
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay
from tcc_sim.replay.segments import MOST_SEGMENTS
from tcc_sim.scene import load_scene
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLUID_PRESSURE

SLIP = load_scene("slip")
LOAD = 300.0


def steady(seconds, speed, omega=150.0):
    """Steady pure slip by the corrected (17a), from `speed` upwards."""
    swing = 250.0 / (0.2 * omega)
    return by_hand(seconds, lambda t: speed + swing * (1.0 - np.cos(omega * t)), lambda t: LOAD / 3000.0,
                   lambda t: 0.0 * t, lambda t: 300.0 + 250.0 * np.sin(omega * t), lambda t: LOAD + 0.0 * t)


def shifted(rows, ticks):
    return [(stamp + ticks * TICK, *rest) for stamp, *rest in rows]


def said_at(row, stamp, **values):
    scene = SLIP.with_values({key.replace("__", "."): value for key, value in values.items()})
    return row, holding_from(scene.text(), stamp * TICK)


def test_one_run_is_one_segment_with_the_figures_of_the_whole(tmp_path):
    result = replay(bag(tmp_path / "run", steady(1.5, 150.0), SLIP))
    (segment,) = result.as_json()["segments"]
    assert (segment["start"], segment["end"], segment["began_by"], segment["changes"]) == (0.0, 1.5, "start", {})
    whole = result.as_json()
    shared = set(segment) & set(whole)
    assert {key: segment[key] for key in shared} == {key: whole[key] for key in shared}
    assert "tracking" not in segment
    assert not any("segment 1" in line for line in result.lines())


def test_resets_restarts_and_parameters_begin_segments(tmp_path):
    rows = [*steady(2.0, 150.0), *steady(1.0, 100.0), *shifted(steady(1.0, 50.0), 1001), *steady(1.5, 80.0)]
    said = [said_at(3002, 1001, engine__mean_torque=290.0)]
    path = bag(tmp_path / "run", rows, SLIP, said=said, publishers=[(0, "a1"), (4003, "b2")],
               named=True)
    result = replay(path, discard=2)
    json_rows = result.as_json()["segments"]
    assert [(s["began_by"], round(s["start"], 3), round(s["end"], 3)) for s in json_rows] == [
        ("start", 0.0, 2.0), ("reset", 0.0, 1.0), ("parameters", 1.001, 2.001), ("restart", 0.0, 1.5)]
    assert [s["changes"] for s in json_rows] == [{}, {}, {"engine.mean_torque": 290.0}, {}]
    assert [s["min_slip_speed"] for s in json_rows] == pytest.approx([150.0, 100.0, 50.0, 80.0], abs=0.2)
    assert [s["discarded"] for s in json_rows] == [2, 2, 2, 2]
    # The figures above the segments are those of the longest run.
    assert (result.as_json()["runs"], result.summary.min_slip_speed) == (3, pytest.approx(50.0, abs=0.2))
    table = "\n".join(result.lines())
    for words in ("segment 1", "0 to 1 s, reset", "parameters: engine.mean_torque = 290.0", "restart"):
        assert words in table


def test_a_scene_that_a_restart_brings_counts_from_there_on(tmp_path):
    other = SLIP.with_values({"engine.frequency": 100.0})
    rows = [*steady(1.2, 150.0), *steady(1.2, 120.0, omega=100.0)]
    path = bag(tmp_path / "run", rows, SLIP, said=[(1201, other.text())], publishers=[(0, "a1"), (1201, "b2")],
               named=True)
    first, second = replay(path, discard=2).as_json()["segments"]
    assert (second["began_by"], second["changes"]) == ("restart", {"engine.frequency": 100.0})
    assert (first["period"], second["period"], second["cycles"]) == (1, 1, 19)
    assert second["max_slip_speed"] == pytest.approx(120.0 + 2.0 * 250.0 / 20.0, rel=1e-5)
    assert [read(path).trajectory(n).system.engine.frequency for n in (0, 1)] == [150.0, 100.0]


@pytest.mark.parametrize("changes", [
    {"converter.coupling": 3.0}, {"friction.static_coefficient": 0.6},
    {"converter.coupling": 0.0, "friction.kinetic_coefficient": 0.29, "friction.static_coefficient": 0.29}])
def test_the_whole_of_a_run_that_changed_has_the_sums_of_its_segments(changes, tmp_path):
    """In a recording, its trajectory and a closed loop; the tick between two segments, in stick here, is in no segment.
    """
    said, scene = [], load_scene("fig02").with_values({"converter.coupling": 0.5})
    path = bag(tmp_path / "run", ticked(scene, 2001, changes=[(1400, changes, False)], said=said), scene, said=said)
    result, read_back = replay(path, discard=0), read(path).trajectory()
    looped = tcc_sim.closed_loop(scene, lambda reading: None, 2.0, at={1.399: changes})
    slip, parts = read_back.slip_speed, [segment.summary for segment in result.segments]
    coupling = np.where(np.arange(2001) < 1400, 0.5, scene.with_values(changes).value("converter.coupling"))
    heat = 5e-4 * np.sum(coupling[1:] * (slip[1:] ** 2 + slip[:-1] ** 2))
    for whole in (result.summary, summarise(looped, 0)):
        assert whole.coupling_energy == pytest.approx(heat, rel=1e-3)
        for name in ("coupling_energy", "clutch_energy", "breakaways"):
            assert getattr(whole, name) == pytest.approx(sum(getattr(part, name) for part in parts), rel=2e-3)
        stuck = sum(part.stick_fraction * part.seconds for part in parts)
        assert whole.stick_fraction * whole.seconds == pytest.approx(stuck + 1e-3, abs=1e-5)
    for mine, other in zip(cycles_of(read_back).loads.columns(), cycles_of(looped).loads.columns()):
        np.testing.assert_allclose(mine, other, rtol=1e-4, atol=1e-6 * np.abs(other).max())


def test_a_segment_without_a_whole_cycle_has_no_figures(tmp_path):
    rows = [*steady(2.0, 150.0), *steady(0.02, 100.0)]
    result = replay(bag(tmp_path / "run", rows, SLIP))
    segment = result.as_json()["segments"][1]
    assert (segment["began_by"], segment["max_slip_speed"], segment["regime"]) == ("reset", None, None)
    assert "no whole period of excitation after the dropped ones" in "\n".join(result.lines())


def controlled(target, start=150.0, rate=4.0, seconds=2.0):
    """Slip that approaches the target exponentially, without ripple."""
    return by_hand(seconds, lambda t: target + (start - target) * np.exp(-rate * t), lambda t: 0.1 + 0.0 * t,
                   lambda t: 0.0 * t, lambda t: 300.0 + 0.0 * t, lambda t: LOAD + 0.0 * t)


def test_single_lost_states_are_lost_seconds_of_a_judged_loop(tmp_path):
    rows = [row for k, row in enumerate(controlled(20.0)) if k not in (700, 1500, 1510, 1900)]
    judged = replay(bag(tmp_path / "run", rows, SLIP, targets=[(0, 20.0)])).segments[0].tracking
    assert (judged.lost_seconds, judged.verdict) == (pytest.approx(4 * 2e-3), "settled")


def test_a_fallback_and_the_return_of_commands_begin_segments(tmp_path):
    """Commands from 0.3 s on, none from 1 to 1.6 s, and none in two ticks at 2.4 s, which is less than a cycle."""
    sources, scene = [], load_scene("controlled")
    rows = ticked(scene, 3000, torque=lambda k: 200.0, sources=sources, pressure=lambda k: None if (
        k < 300 or 1000 <= k < 1600 or k in (2400, 2401)) else 93e3)
    result = replay(bag(tmp_path / "run", rows, scene, sources=sources, targets=[(0, 20.0)]))
    assert [(s.began_by, s.start) for s in result.segments] == [
        ("start", 0.0), ("controller", pytest.approx(0.3, abs=2e-3)), ("fallback", pytest.approx(1.0, abs=2e-3)),
        ("controller", pytest.approx(1.6, abs=2e-3))]
    assert all(s.tracking is not None and s.tracking.seconds < 2.1 for s in result.segments)
    # `held` states a new command every 100 ticks.
    assert result.as_json()["command_age"] == pytest.approx(
        {"median": 0.0495, "p95": 0.094, "largest": 0.099}, abs=1e-3)


ROWS = [*controlled(20.0), *shifted(controlled(50.0, start=20.0), 2001)]


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Recording of a target of 20 rad/s, and of 50 rad/s from the second half on."""
    return bag(tmp_path_factory.mktemp("judged") / "run", ROWS, SLIP, targets=[(0, 20.0), (2001, 50.0)])


def test_a_recorded_target_is_judged_and_a_new_one_begins_a_segment(tmp_path, judged, capsys):
    assert main(["analyse", str(judged), "--json", str(tmp_path / "a.json"), "--discard", "30"]) == 0
    first, second = json.loads((tmp_path / "a.json").read_text())["segments"]
    assert (second["began_by"], second["changes"]) == ("parameters", {"target_slip_speed": 50.0})
    for segment, target, step in ((first, 20.0, 130.0), (second, 50.0, -30.0)):
        judged = segment["tracking"]
        assert set(judged) == {item.name for item in fields(Tracking)}
        assert (judged["target"], judged["verdict"]) == (target, "settled")
        assert judged["mean_slip"] == pytest.approx(target, abs=0.01 * abs(step))
        assert judged["overshoot"] == pytest.approx(0.0, abs=1e-9)
        assert judged["band"] == pytest.approx(0.02 * abs(step), rel=0.02)
        assert judged["settling_time"] == pytest.approx(math.log(50.0) / 4.0, abs=2 * 2.0 * math.pi / 150.0)
    text = capsys.readouterr().out
    assert "target 20 rad/s: mean 20" in text
    assert "settled after" in text
    assert "target_slip_speed = 50.0" in text


def test_a_target_that_is_given_is_that_of_a_recorded_one(tmp_path, judged):
    recorded, bare = replay(judged).segments, bag(tmp_path / "bare", ROWS, SLIP, named=True)
    given = replay(bare, target={0.0: 20.0, 2.0005: 50.0})
    # By their text: a nan equals itself there, and from Python 3.13 on no longer as a field.
    assert [repr(s.tracking) for s in given.segments] == [repr(s.tracking) for s in recorded]
    assert given.segments[1].changes == {"target_slip_speed": 50.0}
    assert {segment.summary.elapsed_s for segment in read(bare).segments} == {0.0}  # Nothing was solved.
    (whole,) = replay(bare, target=20.0).segments
    assert whole.tracking.verdict == "off target"
    assert "target_slip_speed" not in whole.changes


@pytest.mark.parametrize(("words", "parts"), [
    (["--target", "fast"], ["'fast'", "rad/s"]), (["--target", "0:20,0:30"], ["0:20,0:30"]),
    (["--target", "1e7"], ["target", "1e+07 rad/s", "-100000 to 100000 rad/s"]),
    (["--target", "20", "--band", "0"], ["band", "0 rad/s", "10000 rad/s"])])
def test_a_wrong_target_or_band_is_refused(tmp_path, refused, words, parts):
    line = refused("analyse", bag(tmp_path / "run", controlled(20.0, seconds=0.3), SLIP), *words)
    assert [part for part in parts if part not in line] == []


def test_a_run_and_its_recording_have_one_tracking(tmp_path):
    """The same samples by closed_loop and from a bag; the target jumps at 1.5 s."""
    law = SlipController(Tuning())

    def answer(reading):
        law.target = 20.0 if reading.stamp_ns <= 1.5e9 else 30.0
        return law.update(reading.slip_speed, reading.engine_torque)

    scene = load_scene("controlled")
    run = tcc_sim.closed_loop(scene, answer, 3.0)
    rows = [(round(t * 1e9), angle, plate, v + speed, speed, engine, friction, pressure) for
            t, angle, plate, v, speed, engine, friction, pressure in zip(
                run.t, run.flywheel_angle, run.plate_angle, run.slip_speed, run.plate_speed, run.engine_torque,
                run.friction_torque, run.applied_pressure)]
    path = bag(tmp_path / "run", rows, scene, targets=[(0, 20.0), (1500, 30.0)])
    of_bag = [s.tracking for s in replay(path).segments]
    whole, jump = run.tracking_of({0.0: 20.0, 1.5: 30.0}), run.tracking_of({0.0: 20.0, 1.5: 30.0}, since=1500)
    assert len(of_bag) == 2
    others = {"command_rate", "commands_applied", "commands_superseded"}
    for name in {item.name for item in fields(Tracking)} - others:
        expected = getattr(jump, name)
        if isinstance(expected, float):
            assert getattr(of_bag[1], name) == pytest.approx(expected, rel=1e-9, abs=1e-9, nan_ok=True), name
        elif name != "limits":
            assert getattr(of_bag[1], name) == expected, name
    assert jump.verdict == "settled"
    assert whole.target_low < whole.target_high == 30.0


def test_a_target_is_judged_from_when_it_is_known_and_one_that_is_no_number_is_none(tmp_path):
    targets = [(1500, 20.0), (1700, math.nan), (1900, math.inf)]
    path = bag(tmp_path / "run", controlled(20.0), SLIP, targets=targets)
    (segment,) = replay(path, discard=0).as_json()["segments"]
    assert segment["tracking"]["target"] == 20.0
    assert segment["tracking"]["largest_error"] < 130.0 * math.exp(-4.0 * 1.4)


def test_more_segments_than_are_told_are_counted(tmp_path):
    nothing = [(k * TICK, *[math.nan] * 7) for k in range(2)]
    rows = steady(0.06, 150.0) + nothing * MOST_SEGMENTS
    result = replay(bag(tmp_path / "run", rows, SLIP), discard=0)
    assert len(result.segments) == MOST_SEGMENTS
    assert [text for text in result.warnings if "segments" in text] == [
        f"only the first {MOST_SEGMENTS} of {MOST_SEGMENTS + 1} segments are analysed"]
    assert len(result.lines()) < 65


def test_verification_and_segments_agree_on_where_parameters_changed(tmp_path):
    said = []
    fig02 = load_scene("fig02")
    rows = ticked(fig02, 1500, changes=[(700, {"engine.mean_torque": 250.0}, False)], resets=(1000,), said=said)
    result = replay(bag(tmp_path / "run", rows, fig02, said=said), verify=True)
    assert result.verification.verified
    assert [(s.began_by, round(s.start * 1e3), dict(s.changes)) for s in result.segments] == [
        ("start", 0, {}), ("parameters", 700, {"engine.mean_torque": 250.0}), ("reset", 0, {})]


@pytest.mark.filterwarnings("error")
def test_a_run_of_nothing_but_nan_has_no_figures_and_takes_none_from_another(tmp_path):
    nothing = [(stamp, *[math.nan] * 6, math.nan) for stamp, *_ in steady(0.3, 1.0)]
    result = replay(bag(tmp_path / "run", [*steady(1.0, 150.0), *nothing, *steady(0.5, 90.0)], SLIP), discard=0)
    assert [s.summary is None for s in result.segments] == [False, True, False]
    assert result.segments[2].summary.min_slip_speed == pytest.approx(90.0, abs=0.2)


def test_a_frequency_that_was_changed_while_running_counts_from_there_on_and_keeps_its_phase(tmp_path):
    """150 rad/s up to 2 s, then 180 rad/s, without a jump of phase."""
    def phase(t):
        return 150.0 * np.minimum(t, 2.0) + 180.0 * np.maximum(t - 2.0, 0.0)

    rows = by_hand(4.0, lambda t: 150.0 + 8.0 * np.cos(phase(t)), lambda t: LOAD / 3000.0, lambda t: 0.0 * t,
                   lambda t: 300.0 + 250.0 * np.sin(phase(t)), lambda t: LOAD + 0.0 * t)
    path = bag(tmp_path / "run", rows, SLIP, said=[said_at(2001, 2001, engine__frequency=180.0)])
    result = replay(path, discard=0)
    assert (result.frequency_source, result.timing.low, result.timing.high) == (
        "found", pytest.approx(150.0, rel=0.02), pytest.approx(180.0, rel=0.02))
    first, second = result.segments
    assert second.changes == {"engine.frequency": 180.0}
    for segment, frequency in ((first, 150.0), (second, 180.0)):
        assert segment.summary.cycles == pytest.approx(2.0 * frequency / (2.0 * math.pi), abs=8)
        assert segment.summary.period == 1
        assert segment.summary.section[0][1] == pytest.approx(158.0, abs=0.1)


@pytest.mark.parametrize(("frequencies", "source"), [((150.0, 150.0), "scene"), ((180.0, 180.0), "found"),
                                                     ((150.0, 180.0), "found"), ((300.0, 300.0), "scene")])
def test_without_a_recorded_scene_the_torque_decides_on_the_cycles_of_a_verdict(tmp_path, frequencies, source):
    """A controlled run of another program, whose engine does not keep the scene's 150 rad/s: by such cycles, the
    ripple of 180 would look like hunting."""
    def phase(t):
        return frequencies[0] * np.minimum(t, 1.5) + frequencies[1] * np.maximum(t - 1.5, 0.0)

    rows = by_hand(3.0, lambda t: 20.0 + 8.0 * np.cos(phase(t)), lambda t: LOAD / 3000.0, lambda t: 0.0 * t,
                   lambda t: 300.0 + 250.0 * np.sin(phase(t)), lambda t: LOAD + 0.0 * t)
    result = replay(read(bag(tmp_path / "run", rows, None, targets=[(0, 20.0)]), "controlled"))
    (segment,) = result.segments
    assert result.frequency_source == source
    assert segment.tracking.verdict == "settled"
    assert any("differs from that of the recorded torque" in text for text in result.warnings) is (source == "found")


COMMANDS = load_scene("commands")


def test_a_constant_commanded_torque_has_no_cycles_and_is_judged_by_slices(tmp_path):
    rows = by_hand(4.0, lambda t: 20.0 + 30.0 * np.exp(-t / 0.2), lambda t: LOAD / 3000.0, lambda t: 0.0 * t,
                   lambda t: 300.0 - 20.0 * (t > 2.0), lambda t: LOAD + 0.0 * t)
    (segment,) = replay(bag(tmp_path / "run", rows, COMMANDS, targets=[(0, 20.0)]), discard=0).segments
    tracking = segment.tracking
    assert (tracking.verdict, tracking.settling_time) == ("settled", pytest.approx(0.2 * math.log(50.0), abs=0.15))
    assert tracking.verdict_why.endswith("; means over 0.1 s, as the engine torque does not pulsate")
    noisy = [(stamp, *rest[:4], rest[4] + 40.0 * math.sin(7.0 * k * k), *rest[5:]) for k, (stamp, *rest) in
             enumerate(rows)]
    (segment,) = replay(bag(tmp_path / "noisy", noisy, COMMANDS, targets=[(0, 20.0)]), discard=0).segments
    assert (segment.tracking.verdict, segment.tracking.rms_error) == (None, pytest.approx(math.nan, nan_ok=True))
    assert segment.tracking.verdict_why.startswith("periods of excitation could not be identified")


def torque(k):
    return 300.0 + 250.0 * math.sin(0.15 * k)


def test_the_seconds_of_commands_and_fallback_are_those_of_the_ticks(tmp_path):
    """Ticks 101 to 400 of 1200 have a pressure command; a reset after tick 600 begins 600 more without one."""
    sources = []
    rows = ticked(COMMANDS, 1200, torque=torque, pressure=lambda k: 2e5 if 100 < k <= 400 else None, resets=(600,),
                  sources=sources)
    result = replay(bag(tmp_path / "run", rows, COMMANDS, sources=sources), discard=0)
    pressure, engine = result.as_json()["inputs"]["actuation_pressure"], result.as_json()["inputs"]["engine_torque"]
    assert pressure["topic"] == pytest.approx(0.3)
    assert pressure["fallback"] == pytest.approx(1.199 - 0.3)
    assert (engine["topic"], engine["fallback"], engine["scene"]) == pytest.approx((1.199, 0.0, 0.0))
    assert result.as_json()["command_age"] is None
    replayed = replay(bag(tmp_path / "own", ticked(load_scene("fig02"), 900), "fig02")).inputs
    assert {name: held.scene for name, held in replayed.items()} == pytest.approx(dict.fromkeys(replayed, 0.899))


def test_the_counts_of_diagnostics_are_those_of_the_driveline(tmp_path):
    pytest.importorskip("diagnostic_msgs", reason="diagnostic_msgs is not installed")
    rows, others = ticked(COMMANDS, 1500, torque=torque, pressure=lambda k: 2e5), {}
    for k, (stamp, *_) in enumerate(rows):
        log = START + k * TICK
        others[k] = [("/actuation_pressure", FLUID_PRESSURE, log + 1000, log + 1000,
                      cdr.fluid_pressure(stamp - 7 * TICK, 2e5), ("aa", "bb")[k % 2])] if k >= 7 else []
        if k in (500, 1000, 1400):  # After a restart counts begin at 0.
            counts = {500: (3, 5), 1000: (4, 6), 1400: (2, 1)}[k]
            data = diagnostics({"missed ticks": counts[0], "actuation_pressure refused": counts[1], "regime": "slip",
                                "late ticks": 10 * counts[0], "paced ticks": 100 * counts[1],
                                "first late tick (s)": 0.004, "last late tick (s)": 0.001 * k,
                                "lateness max (s)": 0.002 * counts[0]})
            others[k].append(("/diagnostics", DIAGNOSTIC_ARRAY, log, log, data, str(k > 1200)))
    bag(tmp_path / "run", rows, COMMANDS, joined=others)
    result = replay(tmp_path / "run", discard=0)
    held = result.inputs["actuation_pressure"]
    assert (held.publishers, held.refused, result.missed_ticks) == (2, 7, 6)
    assert (result.late_ticks, result.late_share) == (60, 60 / 700)
    assert (result.late_first, result.late_last, result.latest_tick) == pytest.approx((0.004, 1.4, 0.008))
    assert any("8.57 % of the ticks came more than a period late" in text for text in result.warnings)
