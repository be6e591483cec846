"""Functions of the replay on states, commands and tables made by hand: times, holds, sentences, rates and orders."""

import math
from dataclasses import is_dataclass, replace
from importlib import import_module
from pkgutil import iter_modules
from types import SimpleNamespace

import numpy as np
import pytest
from driveline_bags import bag, ticked

import tcc_sim.replay
from tcc_sim.analysis.control import Event, Steps
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.errors import InputError
from tcc_sim.model.groups import Pressure
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.recording.reader import open_run
from tcc_sim.recording.stamps import Break
from tcc_sim.recording.window import Window
from tcc_sim.replay import verification
from tcc_sim.replay.applied import _from_start, _stretches
from tcc_sim.replay.control import _inferred_fallbacks, _thinned, signals_of
from tcc_sim.replay.given_inputs import (
    Twin,
    _lines,
    _lines_of_ticks,
    doubts_about,
    followed,
    input_table,
    of_table,
    smooth_inputs,
    twin_of,
)
from tcc_sim.replay.inputs import Ages, CommandAge, HeldInput, _acted, command_notes, held_commands, held_inputs
from tcc_sim.replay.measured import analyse_table, at_measured_speed
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import _end_of, _warnings, replay
from tcc_sim.replay.result import Verification
from tcc_sim.replay.segments import Segment, _steps_only, cuts_of
from tcc_sim.replay.timeline import Timeline, slip_between_gaps, timeline_of
from tcc_sim.replay.timing import Timing, _steps, default_of, frequency_changes, pace_of, timing_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.tables.measured_table import MeasuredTable

MS, NAN = 1_000_000, math.nan
MINIMAL, COMMANDS = load_scene("minimal"), load_scene("commands")


def states(stamps, log=None, index=0, run=0, **columns):
    stamps = np.array(stamps, np.int64)
    log = stamps + 10**18 if log is None else np.array(log, np.int64)
    return JointStates(stamps, log, log, *(columns.pop(name, np.zeros(len(stamps))) for name in (
        "flywheel_angle", "plate_angle", "flywheel_speed", "plate_speed", "engine_torque", "friction_torque")),
        index=index, run=run, **columns)


def line_of(*runs, commands=None, sources=(), scene=COMMANDS):
    return Timeline(runs, scene, [], (), commands or {}, {}, sources, {}, {})


def given(rows, values=None):
    return Commanded(np.array(rows), np.array(rows if values is None else values, dtype=float), np.full(len(rows), -1))


@pytest.mark.parametrize(("stamps", "received", "steps"), [
    ([100, 100, 100], [100, -5, 900], [False, True, False]), ([100] * 4, [100, 100, -1, 100], [False, False, True,
     False]),
    ([100] * 5, [100, 100, 201, 100, 100], [False, False, True, False, False]),
    ([100] * 5, [100, 100, 200, 100, 100], [False] * 5),   # The least step is 100 ms.
    ([100] * 5, [100, 100, 250, 20, 100], [False] * 5),    # Late by 150 ms, of which the next stretch makes up 80.
    ([100] * 5, [100, 100, 250, 60, 100], [False, False, True, False, False]),
    ([100] * 5, [100, 100, 100, 100, 350], [False] * 4 + [True]),
    ([0, *[100] * 4], [500, 100, 100, 100, 100], [True, *[False] * 4]),
    ([4000] * 4, [4000, 4000, 4900, 4000], [False] * 4), ([4000] * 4, [4000, 4000, 5100, 4000], [False, False, True,
     False]),
    ([100] * 6, [50, 50, 50, 200, 200, 200], [False, False, False, True, True, True])])
def test_steps_of_the_clock_of_receipt(stamps, received, steps):
    assert _steps(np.array(stamps) * MS, np.array(received) * MS).tolist() == steps


def received(*seconds):
    """States every 50 ms, received so much after their stamps, s, for each 100 ms."""
    stamps = np.arange(2 * len(seconds)) * 50 * MS
    return states(stamps, 10**18 + stamps + np.rint(np.repeat(seconds, 2) * 1e9).astype(np.int64))


@pytest.mark.parametrize(("runs", "pace", "note"), [
    ([received(0, 0, 0, 0)], 1.0, ""), ([received(9, 0, 0)], 1.0, "times of receipt went back by 9 s against "
     "simulation time, "
     "1 time, first after 0.05 s: the clock was set, or the driveline paused or stalled; the rate leaves this out"),
    ([received(0.0, 0.1, 0.2, 0.3)], 0.5, ""), ([received(0, 0)], NAN, ""), ([received(0, 0), received(0, 0)], 1.0, ""),
    ([received(0, 0, 0, 0, 5, 5, 5)], 1.0, "times of receipt went ahead by 5 s against simulation time, 1 time, first "
     "after 0.35 s: the clock was set, or the driveline paused or stalled; the rate leaves this out"),
    ([received(0, 0, 0, 0, 5, 5, 5), received(0, 0, 0, 0, 0, -3, -3)], 1.0, "times of receipt went ahead by 2 s "
     "against "
     "simulation time, 2 times, first after 0.35 s: the clock was set, or the driveline paused or stalled; the rate "
     "leaves this out"),
    ([states(np.arange(9) * 50 * MS, np.arange(9) * 50 * MS)], NAN, ""),
    ([states(np.arange(9) * 50 * MS, np.zeros(9))], NAN, "")])
def test_the_rate_is_that_of_receipts_within_runs(runs, pace, note):
    result = pace_of(line_of(*runs))
    assert result == (pytest.approx(pace, rel=1e-6, nan_ok=True), note)


def test_timing_given_or_of_the_scene():
    for given_, why in ((1e-3, None), (1e5, None), (0.999e-3, "frequency is 0.000999 rad/s"), (1.001e5, "is 100100 "
     "rad/s"),
                        (NAN, "is nan rad/s")):
        if why:
            with pytest.raises(InputError, match=f"{why}; it must be 0.001 to 100000 rad/s"):
                timing_of(MINIMAL, given_, [])
        else:
            timing = timing_of(MINIMAL, given_, [])
            assert (timing.source, timing.frequency, timing.frequency_range) == ("given", given_, (given_, given_))
            assert timing.segment_clock is timing.clock
            phase, when = timing.phase_of(SimpleNamespace(t=np.array([0.0, timing.clock.cycle])))
            assert (phase.tolist(), when(np.array([2.0])).tolist()) == ([0.0, 1.0], [2.0 * timing.clock.cycle])
    scene = timing_of(MINIMAL, None, [])
    assert (scene.source, scene.segment_clock, scene.phase_of(None), scene.note) == ("scene", None, None, "")
    assert scene.frequency == MINIMAL.system.engine.frequency
    swept = MINIMAL.with_values({"engine.frequency_times": [0.0, 2.0], "engine.frequency_values": [90.0, 200.0]})
    run_up = timing_of(swept, None, [])
    assert run_up.frequency_range == (90.0, 200.0)
    assert [default_of(*row) for row in ((None, run_up, swept), (None, scene, MINIMAL), (7, run_up, swept),
                                         (None, timing_of(swept, 90.0, []), swept))] == [0, None, 7, None]
    none = timing_of(COMMANDS.with_values({"engine.source": "topic"}), None, [])
    assert (none.source, none.sentence(), math.isnan(none.frequency)) == ("none", "unknown", True)
    assert none.note == ("periods of excitation could not be identified, so there is no section, period or cycle "
     "mean: there are no samples")
    assert isinstance(none, Timing)


@pytest.mark.parametrize(("texts", "firsts", "changed"), [
    ([" frequency: 1"], [0], False), ([" frequency: 1", " frequency: 2"], [0, 5], True),
    ([" frequency: 1", " frequency: 2"], [0, 0], False), ([" frequency: 1", " frequency: 1"], [0, 5], False),
    ([" frequency: 1", " frequency: 1", " frequency: 3"], [0, 5, 7], True)])
def test_a_changed_frequency_is_one_of_a_scene_changed_while_running(texts, firsts, changed):
    run = SimpleNamespace(scenes=[SimpleNamespace(parameters=text, first_stamp_ns=first)
                                  for text, first in zip(texts, firsts)])
    assert frequency_changes(run) is changed


@pytest.mark.parametrize(("held", "sentence"), [
    (HeldInput(None, None, 0.0, None, 0), "by commands or the fallback; the recording does not show which"),
    (HeldInput(0.0, 0.0, 0.0, None, 0), "for no time"), (HeldInput(0.0, 0.0, 2.5, 0, 0), "for 2.5 s by the scene"),
    (HeldInput(1.0, 2.0, 3.0, 4, 1, 9, 5, 3, 1), "for 1 s by commands, 2 s by the fallback, 3 s by the scene; 1 "
     "publisher; 5 of 9 commands applied; 3 superseded; 1 not applied; 4 refused"),
    (HeldInput(1.0, 0.0, 0.0, 0, 2, 1, 1), "for 1 s by commands; 2 publishers; 1 of 1 command applied")])
def test_sources_in_words(held, sentence):
    assert held.sentence() == sentence
    assert CommandAge(1e-3, 0.25, 3.0).sentence() == "median 0.001 s, 95 % within 0.25 s, largest 3 s"


@pytest.mark.parametrize(("result", "undecided", "sentence"), [
    (Verification(True, 0.0, 9, 9, 9, None, ""), False,
     "verified: 9 messages agree to the last bit with the solution from the recording alone"),
    (Verification(True, 0.0, 2, 1, 1, None, "; x"), False, "verified: 1 message agrees within 1e-06 (exactly for 1) "
     "with the solution from the recording alone; 1 message without a state before it to solve from; x"),
    (Verification(False, 0.0, 2, 1, 1, None, "why"), True, "not verified: why"),
    (Verification(False, 0.0, 0, 0, 0, None, "why"), False, "not verified: why"),
    (Verification(False, 0.0, 2, 1, 1, 5, "why"), False, "not verified: why")])
def test_verdicts_in_words(result, undecided, sentence):
    assert (result.undecided, result.sentence) == (undecided, sentence)


def test_a_segment_without_figures_in_words():
    segment = Segment(0.5, 1.25, "reset", {"engine.order": 2.0, "target_slip_speed": 5.0}, None, None)
    assert segment.rows(3) == [("segment 3", "0.5 to 1.25 s, reset: engine.order = 2.0, target_slip_speed = 5.0"),
                               ("", "no whole period of excitation after the dropped ones")]
    for torque, steps in (([1.0] * 50 + [2.0] * 51, True), ([1.0] * 50 + [2.0] * 50, False), ([NAN] * 9, False),
                          ([NAN, *[1.0] * 9], True)):
        assert bool(_steps_only(np.array(torque))) is steps


def test_parts_of_a_timeline_keep_the_last_command_before_them():
    first, second = states(np.arange(10) * MS), states(np.arange(5) * MS, index=10, run=1)
    commands = {"target_slip_speed": given([0, 2, 2, 7, 11, 13])}
    line = line_of(first, second, commands=commands)
    for window, rows, values, indices in (
            (Window(), [0, 2, 2, 7, 11, 13], [0, 2, 2, 7, 11, 13], [0, 10]),
            (Window(0, 0.002, 0.006), [2], [2], [2]), (Window(0, 0.003, 0.007), [3, 7], [2, 7], [3]),
            (Window(1), [10, 11, 13], [7, 11, 13], [10]), (Window(1, 0.004), [14], [13], [14]),
            (Window(None, 0.004), [4, 7, 14], [2, 7, 13], [4, 14])):
        part = line.within(window)
        given_ = part.commands["target_slip_speed"]
        assert (given_.rows.tolist(), given_.values.tolist()) == (rows, values)
        assert [run.index for run in part.runs] == indices
    targets = [(steps.t.tolist(), steps.values.tolist()) for steps in map(line.target_in, line.runs)]
    assert targets == [([0.0, 0.002, 0.007], [0.0, 2.0, 7.0]), ([0.0, 0.001, 0.003], [7.0, 11.0, 13.0])]
    other = line.with_target(Steps(np.array([0.0, 0.006]), np.array([20.0, 30.0]))).commands["target_slip_speed"]
    assert (other.rows.tolist(), other.values.tolist(), other.answers.tolist()) == ([0, 6, 10], [20, 30, 20], [-1] * 3)
    assert line.commanded(first)["engine_torque"].tolist() == [True] * 10
    told = line_of(first, second, sources=((0, frozenset()), (4, frozenset({"engine_torque"}))))
    assert told.commanded(first)["engine_torque"].tolist() == [False] * 4 + [True] * 6
    assert told.commanded(second)["actuation_pressure"].tolist() == [False] * 5
    silent = line_of(states([0, MS], engine_torque=np.full(2, NAN)))
    assert silent.absent == ("engine_torque",)
    assert silent.torques_note() == ("no state has a number for engine_torque (efforts): estimated from the recorded "
     "speeds by (2a) and (2b)")
    with pytest.raises(InputError, match=r"^plate_angle, plate_speed of the joint states: no state holds a number"):
        line_of(states([0], plate_angle=np.array([NAN]), plate_speed=np.array([NAN]))).with_torques()


@pytest.mark.parametrize(("stamps", "tick", "parts"), [
    ([0, 1, 2, 4, 5], 1, [(False, [0, 1, 2, 4, 5])]), ([0, 1, 2, 5, 6], 1, [(False, [0, 1, 2]), (True, [5, 6])]),
    ([0, 1, 2, 50], 0, [(False, [0, 1, 2, 50])]), ([0, 1, 2, 3, 4], 1, [(False, [0, 1, 4])])])
def test_slip_speeds_between_gaps(stamps, tick, parts):
    speed = np.array(stamps, dtype=float)
    if len(parts[0][1]) == 3 and len(parts) == 1:
        speed[2:4], parts = NAN, [(False, [0, 1]), (True, [4])]
    result = slip_between_gaps(states(np.array(stamps) * MS, flywheel_speed=speed + 1.0,
     plate_speed=np.ones(len(speed))),
                               tick * MS)
    assert [(after, (t * 1e3).round(9).tolist(), slip.tolist()) for after, t, slip in result] == [
        (after, values, values) for after, values in parts]


def test_stretches_in_which_an_input_varies():
    varies = np.array([True, True, True, False, True, True, True, True])
    scenes = np.array([0, 0, 0, 0, 0, 0, 1, 1])
    assert _stretches(varies, scenes, np.ones(8)) == [(0, 3), (3, 6), (5, 8)]
    assert _stretches(varies, scenes, np.array([1.0, 1.0, NAN, 1.0, 1.0, 1.0, 1.0, 1.0])) == [(0, 2), (3, 6), (5, 8)]
    t = np.arange(7.0)
    for replaced, first in ((False, 99.0), (True, 1.0)):   # A cubic through four points gives its own start.
        assert _from_start(t, np.array([99.0, *(1.0 + t[1:] + t[1:] ** 3)]), replaced)[0] == pytest.approx(first)
    assert _from_start(t, np.array([NAN, *(2.0 - t[1:])]), False).tolist() == pytest.approx([2.0 - x for x in t])


def test_signals_of_a_picture_and_fallbacks():
    stamps = np.array([0, 9, 10, 19, 20, 45]) * MS
    steps = _thinned((stamps, np.arange(6.0)), 0.5)     # 50 parts of 10 ms.
    assert (steps.t.tolist(), steps.values.tolist()) == (pytest.approx([0.009, 0.019, 0.02, 0.045]), [1.0, 3.0, 4.0,
     5.0])
    signal = {"engine_torque": (np.array([0, 100, 600]) * MS, np.zeros(3))}
    for limit, times in ((0.5, []), (0.499, [0.599]), (0.05, [0.05, 0.15, 0.65]), (0.0, [])):
        scene = COMMANDS.with_values({"command_timeout": limit, "engine.source": "topic"})
        assert [event.t for event in _inferred_fallbacks(scene, signal, 0.7)] == pytest.approx(times)


def table(t, **columns):
    return MeasuredTable({"t": np.array(t, dtype=float), **{name: np.array(values, dtype=float)
                                                            for name, values in columns.items()}}, source="in.csv")


@pytest.mark.parametrize(("hold", "t", "values", "lines"), [
    ("previous", [0, 1, 2], [5, 6, 7], [[0, 5, 0], [1, 6, 0], [2, 7, 0]]),
    ("linear", [0, 1, 3], [5, 6, 8], [[0, 5, 1], [1, 6, 1], [3, 8, 0]]),
    ("next", [0, 1, 2], [5, 6, 7], [[0, 6, 0], [1, 7, 0]]), ("next", [0.5, 1, 2], [5, 6, 7], [[0, 5, 0], [0.5, 6, 0],
     [1, 7, 0]]),
    ("linear", [0, 1, 2], [5, NAN, 8], [[0, 5, 1.5], [2, 8, 0]]), ("linear", [0, 1], [NAN, NAN], None)])
def test_lines_through_samples(hold, t, values, lines):
    result = _lines(np.array(t, dtype=float), np.array(values, dtype=float), hold)
    assert (result if result is None else result.tolist()) == lines


@pytest.mark.parametrize(("ticks", "lines"), [
    ([[1, 1], [2, 2]], [[0, 1, 0], [1, 2, 0]]), ([[1, 2], [2, 4]], [[0, 1, 1], [1, 2, 2], [2, 4, 0]]),
    ([[NAN, NAN], [2, 4]], [[0, 2, 0], [1, 2, 2], [2, 4, 0]]), ([[1, 3], [NAN, NAN]], [[0, 1, 2], [1, 3, 0]]),
    ([[1, 1], [NAN, NAN]], [[0, 1, 0]])])
def test_lines_of_ticks(ticks, lines):
    assert _lines_of_ticks(np.arange(3.0), np.array(ticks, dtype=float)).tolist() == lines


def test_an_actuator_without_a_lag_shifts_and_with_one_decays():
    command = np.array([[0.0, 3e5, 0.0], [0.5, 1e5, 4e5]])
    late = followed(command, Pressure(source="topic", fallback="mean", mean=2e5, delay=0.25), 1.0)
    assert late[np.searchsorted(late[:, 0], [0.0, 0.2, 0.25, 0.7, 0.75])] == pytest.approx(np.array(
        [[0.0, 2e5, 0.0], [0.2, 2e5, 0.0], [0.25, 3e5, 0.0], [0.7, 3e5, 0.0], [0.75, 1e5, 4e5]]))
    assert late[-1] == pytest.approx([1.0, 2e5, 4e5])
    slow = followed(command[:1], Pressure(source="topic", fallback="mean", mean=2e5, time_constant=0.1), 1.0)
    assert slow[:, 1] == pytest.approx(3e5 - 1e5 * np.exp(-slow[:, 0] / 0.1), rel=1e-9)
    assert len(slow) == 1001


T = np.arange(40) * 0.01


@pytest.mark.parametrize(("columns", "why"), [
    ({"slip_speed": T}, "in.csv: the first line must name the column engine_torque, actuation_pressure or "
     "output_speed, or --columns one of the file's columns as such"),
    ({"engine_torque": np.where((T > 0.095) & (T < 0.135), NAN, 1.0)}, "in.csv has a hole without rows or values, "
     "0.09 to 0.14 "
     "s, beside steps of 0.01 s; a simulation needs inputs without holes: take a part by --from and --to, such as "
     "--from 0.14 --to 0.39, the longest one"),
    ({"engine_torque": np.where(T > 0.2, 2e5, 1.0)}, "in.csv: engine_torque is 200000 N m at 0.21 s; it must be "
     "-100000 to "
     "100000 N m"), ({"actuation_pressure": np.where(T > 0.2, -1.0, 1.0)}, "in.csv: actuation_pressure is -1 Pa at "
     "0.21 s; it must be 0 to 1e+07 Pa")])
def test_a_table_that_drives_nothing_is_refused(columns, why):
    with pytest.raises(InputError) as error:
        of_table(table(T, **columns))
    assert str(error.value) == why


def test_a_table_drives_with_the_hold_that_is_asked_for_or_stated():
    columns = table(T, engine_torque=T, output_speed=np.where((T > 0.095) & (T < 0.115), NAN, 2.0))
    inputs = of_table(columns)
    assert (inputs.pressure, inputs.end) == (None, 0.39)
    assert (inputs.torque[:, 2] == 0.0).all()
    assert inputs.output_speed[:2].tolist() == [[0.0, 2.0, 0.0], [0.01, 2.0, 0.0]]
    stated = MeasuredTable(columns.columns, {"engine_torque": "linear"})
    assert of_table(stated).torque[0].tolist() == pytest.approx([0.0, 0.0, 1.0])
    assert of_table(stated, "previous").torque[0].tolist() == [0.0, 0.0, 0.0]
    assert (smooth_inputs(columns), smooth_inputs(stated)) == (["engine_torque"], [])


@pytest.mark.parametrize(("t", "columns", "doubts"), [
    (T, {"engine_torque": np.ones(40)}, []),
    (T, {"engine_torque": np.where(np.arange(40) == 7, NAN, 1.0)}, ["in.csv: one or two rows are missing at 0.06 to "
     "0.08 s; the inputs are interpolated there as between other rows"]),
    (np.cumsum([0.125, 0.875] * 9), {"engine_torque": np.ones(18)}, ["in.csv: its rows are irregular in time, 0.125 "
     "to 0.875 s apart (at 0.125 s); the inputs are interpolated between them"]),
    (np.cumsum([0.125, 0.875] * 8)[:15], {"engine_torque": np.ones(15)}, []),
    (np.arange(1002) * 0.6, {"engine_torque": np.ones(1002)}, ["in.csv: its rows are 0.6 s apart; if its times are in "
     "ms, say so with --columns t=COLUMN:ms"]), (np.arange(1001) * 0.6, {"engine_torque": np.ones(1001)}, []),
    (np.arange(1002) * 0.5, {"engine_torque": np.ones(1002)}, []),
    (T, {"actuation_pressure": np.full(40, 2.5)}, ["in.csv: actuation_pressure is at most 2.5 Pa; if it is in bar, "
     "say so with --columns actuation_pressure=COLUMN:bar"]),
    (T, {"actuation_pressure": np.full(40, 1e3)}, []), (T, {"actuation_pressure": np.zeros(40)}, [])])
def test_doubts_about_a_table(t, columns, doubts):
    assert doubts_about(table(t, **columns)) == doubts


@pytest.mark.parametrize(("rows", "part", "t", "note"), [
    ([0.0, 2.0, 4.0], (None, None), [0.0, 2.0, 4.0], False), ([3.0, 5.0, 7.0], (None, None), [3.0, 5.0, 7.0], False),
    ([3.1, 5.1, 7.1], (None, None), [0.0, 2.0, 4.0], True), ([1.5, 2.5, 3.5], (None, None), [1.5, 2.5, 3.5], False),
    ([1.6, 2.6, 3.6], (None, None), [0.0, 1.0, 2.0], True), ([-0.5, 0.5, 1.5], (None, None), [0.0, 1.0, 2.0], False),
    ([-2.0, -1.0, 0.0], (None, None), [0.0, 1.0, 2.0], True), ([0.0, 1.0, 2.0], (1.0, None), [0.0, 1.0], False),
    ([0.0, 1.0, 2.0, 3.0], (2.0, 3.0), [0.0, 1.0], True), ([0.0, 1.0, 2.0], (None, 1.0), [0.0, 1.0], False)])
def test_a_simulation_starts_at_the_first_row_that_is_used(tmp_path, rows, part, t, note):
    path = tmp_path / "in.csv"
    path.write_text("t,engine_torque\n" + "".join(f"{x},{k}\n" for k, x in enumerate(rows)))
    result = input_table(path, None, *part)
    assert result.t.tolist() == pytest.approx(t)
    first = next(x for x in rows if part[0] is None or x >= part[0])
    assert result.notes == ((f"in.csv: the simulation starts at its time {first:g} s",) if note else ())
    for start, end, why in ((rows[-1], None, "it has 1 row in this part; it must have 2 or more"),
                            (None, rows[0], "it has 1 row in this part; it must have 2 or more")):
        with pytest.raises(InputError, match=f"in.csv: {why}$"):
            input_table(path, None, start, end)


def test_a_simulation_beside_measured_slip_speeds():
    run = SimpleNamespace(t=np.array([1.0, 3.0]), slip_speed=np.array([10.0, 30.0]))
    measured = table([0, 1, 2, 3, 4], slip_speed=[0, 13, NAN, 34, 9])
    twin = twin_of(measured, run)
    assert (twin.t.tolist(), twin.slip_speed.tolist(), twin.difference.tolist()) == ([1, 3], [13, 34], [-3, -4])
    assert str(twin) == "slip speed beside in.csv: 3.536 rad/s apart (rms), of 25.74 rad/s"
    assert twin_of(table([0, 1], engine_torque=[1, 2]), run) is None
    assert twin_of(table([0, 1, 4], slip_speed=[1, 2, 3]), run) is None
    assert isinstance(twin, Twin)


def test_orders_and_spectrum_of_a_table():
    """5 rad/s at order 1 of an engine at 150 rad/s; a hole divides the table at 0.5 s, and the spectrum takes the "
    "later part."""
    t = np.arange(2000) * 1e-3
    kept = (t < 0.5) | (t > 0.7005)
    rows = table(t[kept], slip_speed=(20.0 + 5.0 * np.sin(150.0 * t))[kept], engine_speed=np.full(kept.sum(), 150.0))
    result = analyse_table(rows, MINIMAL.system, orders=True, spectrum=True)
    assert (result.samples, result.seconds) == (kept.sum(), pytest.approx(1.999))
    assert result.orders.cut(1.0, "slip_speed") == pytest.approx(5.0, rel=0.01)
    assert result.warnings[-1] == "in.csv: the spectrum is that of 0.701 to 1.999 s, the longest part without a hole"
    assert [*result.columns()] == [*result.orders.columns()]
    alone = analyse_table(rows.part(0.7), MINIMAL.system, orders=False, spectrum=True)
    assert (alone.orders, [*alone.columns()]) == (None, [*alone.spectrum.columns()])
    assert not any("longest part" in sentence for sentence in alone.warnings)
    assert analyse_table(rows.part(0.7), MINIMAL.system, orders=True, spectrum=False).spectrum is None
    with pytest.raises(InputError, match=r"^in.csv: at least 4 rows are needed; 3 rows selected$"):
        analyse_table(rows.part(0.0, 0.002), MINIMAL.system, orders=True, spectrum=False)
    speed = 100.0 + 20.0 * t
    swept = table(t, engine_torque=np.ones(2000), engine_speed=speed)
    scene, signals = at_measured_speed(MINIMAL, swept)
    engine = scene.system.engine
    assert signals is None
    assert engine.frequency_times[0] == 0.0
    order = engine.order
    assert np.interp(1.0, engine.frequency_times, engine.frequency_values) == pytest.approx(120.0 * order, rel=1e-3)
    cycles = order * (100.0 * 1.999 + 10.0 * 1.999**2) / (2.0 * math.pi)
    assert len(engine.frequency_times) == int(cycles) + 1  # The ends of all whole cycles.
    assert at_measured_speed(MINIMAL, rows)[1] is not None


def test_results_are_frozen():
    for found in iter_modules(tcc_sim.replay.__path__, "tcc_sim.replay."):
        for one in vars(import_module(found.name)).values():
            if is_dataclass(one) and isinstance(one, type) and one.__module__ == found.name:
                assert one.__dataclass_params__.frozen, one


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return replay(bag(tmp_path_factory.mktemp("lines") / "run", ticked(MINIMAL, 400), MINIMAL), discard=0)


LATE = {"late_ticks": 5, "late_share": 0.0125}
CUT = {"complete": False}


@pytest.mark.parametrize(("changes", "rows"), [
    ({}, {"recording": "complete", "messages": "400 of joint_states, 0 lost", "stamps": "1 ms apart, no gap",
          "rate": "1000.00 Hz reached, 1.00000 of real time", "frequency": "150 rad/s, from the scene"}),
    ({"lost_messages": 1}, {"recording": "closed properly; 1 message lost", "messages": "400 of joint_states, 1 lost"}),
    (CUT, {"recording": "cut short; data up to the last flush is read"}),
    ({**CUT, "parts_missing": True}, {"recording": "not complete: a part is missing"}),
    ({"pace": NAN}, {"rate": "not known: the times of receipt do not show it"}), ({"pace": 0.5}, {
        "rate": "500.00 Hz reached, 0.50000 of real time"}),
    ({"missed_ticks": 0, "late_ticks": 0}, {"missed ticks": None, "late ticks": None}),
    ({"missed_ticks": 3, **LATE}, {"missed ticks": "3 in real time",
                                   "late ticks": "5, 1.25 % of the paced ones, by more than a period"}),
    ({**LATE, "late_share": NAN}, {"late ticks": "5, of an unknown number of paced ones, by more than a period"}),
    ({"command_age": CommandAge(0.001, 0.002, 0.003)}, {
        "command age": "median 0.001 s, 95 % within 0.002 s, largest 0.003 s"}),
    ({"inputs": {"engine_torque": HeldInput(1.0, 0.0, 0.0, None, 1)}}, {
        "engine torque": "held for 1 s by commands; 1 publisher",
        "command age": "not known: most commands have no stamp, or none was applied"}),
    ({"verification": Verification(False, 0.0, 1, 0, 0, None, "why")}, {"solved again": "not verified: why"}),
    ({"segments": (Segment(0.0, 1.0, "start", {}, None, None),)}, {"segment 1": None}),
    ({"segments": (Segment(0.0, 1.0, "start", {}, None, None),) * 2}, {
        "segment 2": "0 to 1 s, start", "--json has": None, "segment 3": None}),
    ({"segments": (Segment(0.0, 1.0, "start", {}, None, None),) * 20}, {"segment 20": "0 to 1 s, start", "--json "
     "has": None}),
    ({"segments": (Segment(0.0, 1.0, "start", {}, None, None),) * 22}, {
        "segment 20": "0 to 1 s, start", "segment 21": None, "--json has": "2 more segments"})])
def test_rows_of_a_replay(result, changes, rows):
    lines = replace(result, **changes).lines()
    found = {name: next((line.split(name, 1)[1].strip() for line in lines[1:] if line.strip().startswith(name)), None)
             for name in rows}
    assert found == rows
    page = replace(result, **changes).markdown().splitlines()
    assert page[:4] == ["# run", "", "| | |", "|---|---|"]
    assert len(page) == len(lines) + 3


def test_counts_of_a_replay(result):
    assert (result.frequency, result.frequency_source) == (MINIMAL.system.engine.frequency, "scene")
    assert [*result.columns()][:3] == ["start", "end", "began_by"]
    assert replace(result, segments=()).columns() == {}
    n = len(result.cycles)
    highest = result.cycles.highest.copy()
    assert result.unbroken == n
    for broken, left in ((0, n - 1), (n - 1, 0), (2, n - 3)):
        cut = np.where(np.arange(n) == broken, NAN, highest)
        assert replace(result, cycles=replace(result.cycles, highest=cut)).unbroken == left
    assert replace(result, summary=replace(result.summary, discarded=2)).unbroken == n - 2
    assert str(replace(result, lost_messages=2, complete=False)) == (
        f"<Replay of run: 400 messages, 2 lost, cut short; {n} cycles, no period, stick-slip; largest |slip speed| "
        f"{result.summary.max_slip_speed:.5g} rad/s>")


@pytest.mark.parametrize(("limit", "short"), [(29, None), (28, "solving it again takes more than")])
def test_work_is_bounded_tick_by_tick(tmp_path, monkeypatch, limit, short):
    rows = ticked(MINIMAL, 30)
    line = timeline_of(open_run(bag(tmp_path / "run", rows, MINIMAL)), MINIMAL)
    each = Stepper(MINIMAL.system, 1e-3).substeps + 20
    monkeypatch.setattr(verification, "SMALLEST_WORK", limit * each)
    monkeypatch.setattr(verification, "WORK_PER_BYTE", 0)
    verdict = verification.verify(line, 10**6)
    assert (verdict.verified, short is None or short in verdict.detail) == (short is None, True)
    # A gap of 11 ticks may use half of the work: 40 ticks less the 9 before it, less 20.
    line = timeline_of(open_run(bag(tmp_path / "gap", rows[:10] + rows[20:], MINIMAL)), MINIMAL)
    for work, exact in ((40 * each, 20), (40 * each - 2, 10)):
        monkeypatch.setattr(verification, "SMALLEST_WORK", work)
        verdict = verification.verify(line, 0)
        assert (verdict.exact, verdict.detail.startswith("; 1 gap could not be solved")) == (exact, exact == 10)


def test_a_recording_in_words_and_columns(tmp_path):
    recording = read(bag(tmp_path / "run", ticked(MINIMAL, 60, resets=(40,)), MINIMAL, cut=True))
    assert str(recording) == "<Recording run of run: 2 runs, cut short>"
    assert (recording.complete, [one.states for one in recording.drivelines]) == (False, [61])
    assert [(run.number, run.start, run.end, run.samples, run.began_by) for run in recording.runs] == [
        (0, 0.0, 0.04, 41, "start"), (1, 0.0, pytest.approx(0.019), 20, "reset")]
    columns = recording.columns(1, 0.002, 0.004)
    assert columns["t"].tolist() == pytest.approx([0.002, 0.003, 0.004])
    assert [*columns] == [*recording.trajectory(1).columns()]
    page = recording._repr_html_()
    assert page.startswith("<p>&lt;Recording run of run: 2 runs, cut short&gt;</p>")
    assert [name in page for name in ("number", "began_by", "reset")] == [True] * 3


@pytest.mark.parametrize(("texts", "sources", "note", "said"), [
    ([], 0, "", []), (["a"], 9, "odd", ["odd"]), (["a", "a"], 10, "", ["only the first 10 changes of the source of an "
     "input "
                                                                        "are used"]),
    (["a", "b"], 0, "", ["the recording holds 2 scenes that differ; the figures above the segments are computed with "
     "the first"]),
    (["a"] * 3, 0, "", ["only the first 2 scenes are used"])])
def test_warnings_about_scenes_and_sources(monkeypatch, texts, sources, note, said):
    monkeypatch.setattr("tcc_sim.replay.replay.MOST_SCENES", 2)
    monkeypatch.setattr("tcc_sim.replay.replay.MOST_SOURCES", 10)
    recording = SimpleNamespace(file=SimpleNamespace(scenes=[SimpleNamespace(parameters=text) for text in texts]))
    assert [*_warnings(recording, SimpleNamespace(sources=range(sources)), SimpleNamespace(note=note))] == said


def test_the_end_that_a_picture_shows_is_24_cycles_and_200_000_samples(monkeypatch):
    every = states(np.arange(1000) * MS)
    assert len(_end_of(every, 0.01)) == 241
    assert len(_end_of(every, 1.0)) == 1000
    monkeypatch.setattr("tcc_sim.replay.replay.TAIL_SAMPLES", 50)
    assert _end_of(every, 0.01).stamp_ns.tolist() == [k * MS for k in range(950, 1000)]


def sent(rows, values, answers=None):
    return Commanded(np.array(rows), np.array(values, dtype=float), np.array(
        [-1] * len(rows) if answers is None else answers, dtype=np.int64))


SHOWN = [3, 6, 6, 6, 6, 6, 7, 7, 7, 7]
"""Torque of ten states: of four commands the second replaces the first, the third acts late, the fourth never."""
FROM_5 = (0, frozenset()), (5, frozenset({"engine_torque"}))


@pytest.mark.parametrize(
    ("rows", "values", "shown", "publishers", "sources", "acts", "applied", "superseded", "held"), [
    ([1, 1, 4, 8], [5, 6, 7, 9], SHOWN, 1, (), [1, 1, 6, 8], [1, 2], [0], [-1, 1, 1, 1, 1, 1, 2, 2, 2, 2]),
    ([0, 3], [6, 7], SHOWN, 1, (), [1, 6], [0, 1], [], [-1, 0, 0, 0, 0, 0, 1, 1, 1, 1]),
    # The command of the second state is not in the input; one publisher's was replaced, one of two may be ignored.
    ([1, 2, 6], [6, 5, 7], SHOWN, 1, (), [1, 2, 6], [0, 2], [1], [-1, 0, 0, 0, 0, 0, 2, 2, 2, 2]),
    ([1, 2, 6], [6, 5, 7], SHOWN, 2, (), [1, 2, 6], [0, 2], [], [-1, 0, 0, 0, 0, 0, 2, 2, 2, 2]),
    # On an announced fallback no command acts, but perhaps after it; a value out of range never does.
    ([1, 6], [6, 7], SHOWN, 1, FROM_5, [5, 6], [0, 1], [], [-1] * 5 + [0] + [1] * 4),
    ([1, 6], [5, 7], SHOWN, 1, FROM_5, [1, 6], [1], [], [-1] * 6 + [1] * 4),
    ([1, 6], [1e6, 7], [3, *[1e6] * 5, *[7] * 4], 1, (), [1, 6], [1], [], [-1] * 6 + [1] * 4),
    ([], [], SHOWN, 0, (), [], [], [], [-1] * 10), ([10, 12], [6, 7], SHOWN, 1, (), [], [], [], [-1] * 10)])
def test_what_became_of_commands_by_the_torque_that_states_show(rows, values, shown, publishers, sources, acts, applied,
                                                                superseded, held):
    run = states(np.arange(10) * MS, engine_torque=np.array(shown, dtype=float))
    line = replace(line_of(run, commands={"engine_torque": sent(rows, values)}, sources=sources),
                   publishers={"engine_torque": publishers})
    result = held_commands(line, run, "engine_torque")
    assert (result.acts.tolist(), (result.t * 1e3).round(9).tolist()) == (acts, acts)
    assert [np.flatnonzero(one).tolist() for one in (result.applied, result.superseded)] == [applied, superseded]
    assert result.held.tolist() == held
    assert np.nan_to_num(result.values, nan=-1.0).tolist() == [values[k] if k >= 0 else -1.0 for k in held]
    assert held_commands(line, run, "actuation_pressure") is None
    inputs = held_inputs(line)
    # A source with the index of a state acted in the tick before it.
    seconds = 1e-3 * (5 if sources else 9 - max(acts[0] - 1, 0) if acts else 0)
    assert inputs["engine_torque"] == HeldInput(pytest.approx(seconds), pytest.approx(9e-3 - seconds), 0.0, None,
                                                publishers, len(acts), len(applied), len(superseded),
                                                len(acts) - len(applied) - len(superseded))
    assert inputs["actuation_pressure"] == HeldInput(*((0.0, pytest.approx(9e-3)) if sources else (None, None)), 0.0,
                                                     None, 0)


def test_commands_count_from_after_the_begin_and_inputs_of_a_scene_are_the_scenes():
    run = states(np.arange(10) * MS, engine_torque=np.array(SHOWN, dtype=float))
    line = line_of(run, commands={"engine_torque": sent([1, 1, 4, 8], [5, 6, 7, 9])})
    held = held_commands(line, run, "engine_torque")
    for begin, end, counts in ((0.0, 6e-3, (2, 1)), (1e-3, 6e-3, (1, 0)), (0.0, 5.9e-3, (1, 1)), (6e-3, 1.0, (0, 0))):
        assert held.counts(begin, end) == counts
    scene = replace(line_of(run, commands={"engine_torque": sent([1], [6])}, scene=MINIMAL), counts={
        "engine_torque refused": 3})
    assert held_inputs(scene)["engine_torque"] == HeldInput(0.0, 0.0, pytest.approx(9e-3), 3, 0, 1, 0, 0, 1)
    assert held_commands(scene, run, "engine_torque").held.tolist() == [-1] * 10


YEAR = 365 * 86_400 * 10**9
SET_TIME = "carry stamps of the wall clock, not of the state that they answer, so their age is unknown; copy the " \
           "state's stamp, or set use_sim_time"
AHEAD = "carry stamps that are later than the state before which they acted, so their age is unknown"
AGAIN = "repeat the stamp of the command before, from which their age counts; copy the stamp of the newest state"


@pytest.mark.parametrize(("rows", "answers", "age", "said"), [
    ([2, 5], [1, 2], (2.0, 4.7, 5.0), []), ([2, 5], [1, 1], (3.0, 5.7, 6.0), []),
    ([2, 5, 6, 7], [1, 1, 1, 1], (3.0, 5.7, 6.0), [f"3 of 4 pressure commands {AGAIN}"]),
    ([2, 5], [0, 0], None, []), ([3, 6], [0, 2], None, []), ([2, 5], [0, 2], (3.5, 4.85, 5.0), []),
    ([2, 5], [2, 5], (1.0, 1.8, 2.0), [f"2 of 2 pressure commands {AHEAD}"]),
    ([2, 5], [2 + YEAR // MS, 6], None, [f"2 of 2 pressure commands {AHEAD}"]),
    ([2, 5], [3 + YEAR // MS, 4], (1.5, 2.85, 3.0), [f"1 of 2 pressure commands {SET_TIME}"]),
    ([2], [3 + YEAR // MS], None, [f"1 of 1 pressure command {SET_TIME}"])])
def test_ages_of_commands_and_stamps_that_answer_nothing(rows, answers, age, said):
    """Eight states from 1 ms on; the stamps of commands in ms."""
    run = states((np.arange(8) + 1) * MS)
    line = line_of(run, commands={"actuation_pressure": sent(
        [row - 1 for row in rows], range(1, len(rows) + 1), np.array(answers) * MS)})
    ages = Ages(line, MS)
    assert list(ages.stamps()) == said
    assert ages.largest == len(rows)
    assert ages.age == (age and CommandAge(*(pytest.approx(1e-3 * one) for one in age)))
    assert (Ages(line_of(run), MS).age, Ages(line_of(run), MS).largest) == (None, 0.0)


@pytest.mark.parametrize(("counts", "median", "tracked", "largest", "said"), [
    ((9, 0), None, True, 0.0, ["none of the 9 recorded commands on actuation_pressure was applied: the driveline takes "
     "commands where its source is topic, and from reliable publishers only, so check the scene and the publisher's "
     "quality of service"]), ((9, 1), None, True, 0.0, []), ((0, 0), None, False, 0.0, []),
    ((9, 9), 2e-3, True, 0.0, ["the held pressure command was 0.002 s old (median), 2 ticks: this delay adds to the "
     "tracking error"]), ((9, 9), 1e-3, True, 0.0, ["the held pressure command was 0.001 s old (median), 1 tick: this "
     "delay adds to the tracking error"]), ((9, 9), 0.9e-3, True, 0.0, []),
    ((9, 9), 2e-3, False, 0.0, ["a controller commanded the pressure, but no target was recorded; give --target "
     "RAD_PER_S for tracking errors and a verdict"]),
    ((9, 9), None, True, 2.0, ["the largest actuation_pressure command is 2 Pa; the unit is Pa: 2 bar would be "
     "200000"])])
def test_notes_on_commands(counts, median, tracked, largest, said):
    ages = SimpleNamespace(stamps=list, largest=largest, age=median and CommandAge(median, median, median))
    inputs = {"actuation_pressure": HeldInput(1.0, 0.0, 0.0, None, 1, *counts)}
    assert list(command_notes(inputs, ages, MS, tracked)) == said
    assert not any("old" in text for text in command_notes(inputs, ages, 0, tracked))


WHY = "the message of 0.5 s is the first that differs; the largest difference is 0.75 of its signal's maximum " \
      "(possible reasons: a changed value, a missing scene, another version or machine)"


@pytest.mark.parametrize(("fields", "verdict"), [
    ({}, (True, 0.75, 9, 8, 7, None, "")),
    ({"_compared": 0}, (False, math.inf, 0, 0, 0, None, "the recording holds no joint_states")),
    ({"_refusal": "why"}, (False, math.inf, 0, 0, 0, None, "why")),
    ({"_leapt": 1}, (True, 0.75, 9, 8, 7, None, "; 1 gap could not be solved through within the limit of 60 "
     "sub-steps")),
    ({"_first": 5 * 10**8, "_leapt": 2}, (False, 0.75, 9, 8, 7, 5 * 10**8, WHY)),
    ({"_first": 5 * 10**8, "_harmonic": (False, True)}, (False, 0.75, 9, 8, 7, 5 * 10**8, f"{WHY}; the topic "
     "input_source was not recorded, so every input counts as commanded")),
    ({"_unknown": 1}, (False, 0.75, 9, 8, 7, None, "1 of 9 states have no known input")),
    ({"_broken": 0.25}, (False, 0.75, 9, 8, 7, None, "a run begins at 0.25 s after a reset, which must lead to 0: "
     "messages are missing or mixed up")),
    ({"_solved": 0}, (False, 0.75, 9, 0, 7, None, "there is no state before any of them to solve from")),
    ({"_absent": np.array([True] + [False] * 5)}, (True, 0.75, 9, 8, 7, None, "; not recorded, so not compared: x, y")),
    ({"_largest": np.array([1.0, 0.0, 0.0, 3.0, 0.0, 0.0])}, (True, 3.0, 9, 8, 7, None, ""))])
def test_verdicts_by_what_was_compared(fields, verdict):
    """Differences are relative to the largest value of the signal, where that is not 0."""
    verifier = verification._Verifier(replace(line_of(states([0])), scenes=[]), 0)
    given_ = {"_largest": np.array([1.0, 0.375, 0.0, 0.0, 0.0, 0.0]), "_size": np.array([2.0, 0.5, 1.0, 0.0, 1.0, 1.0]),
              "_compared": 9, "_solved": 8, "_exactly": 7, "_work_limit": 60, "_absent": np.zeros(6, bool), **fields}
    for name, value in given_.items():
        setattr(verifier, name, value)
    verifier._line = SimpleNamespace(sources=(), absent=("x", "y"))
    assert verifier.result() == Verification(*verdict)


def test_signals_and_events_of_a_run():
    changed = COMMANDS.with_values({"engine.mean_torque": 210.0, "engine.order": 2.0})
    stamps = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 13, 14, 15, 16, 17]) * MS
    pressure = np.array([1, 1, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1]) * 1e5
    first = states(stamps, flywheel_speed=np.where(stamps < 5 * MS, 3.0, 5.0), plate_speed=np.ones(14), index=3,
                   applied_pressure=pressure)
    second = states(np.array([0, 1, 2, 3, 4, 9]) * MS, index=17, run=1)
    line = replace(line_of(first, second, commands={
        "engine_torque": given([0, 4, 6, 17], [1, 2, 3, 4]), "target_slip_speed": given([3, 8], [7.0, 9.0])},
        sources=((3, frozenset({"engine_torque", "actuation_pressure"})), (5, frozenset({"actuation_pressure"})),
                 (8, frozenset({"engine_torque"})), (16, frozenset()))), further={"shaft_torque": given([5], [8.0])},
        publishers={})
    line.__dict__["changes"] = [(2, COMMANDS), (3, changed), (7, COMMANDS), (8, COMMANDS), (17, changed)]
    result = signals_of(line, first, Uniform(0.004), MS)
    assert {name: [*zip((times // MS).tolist(), values.tolist())]
            for name, (times, values) in result.signals.items() if name != "mean_slip"} == {
        "engine_torque": [(1, 2.0), (3, 3.0)],
        "shaft_torque": [(2, 8.0)], "target_slip_speed": [(0, 7.0), (5, 9.0)],
        "applied_pressure": [(0, 1e5), (2, 2e5), (13, 1e5)]}
    ends, means = result.signals["mean_slip"]  # A gap of 5 ms ends the line.
    assert (ends // MS).tolist() == [4, 8, 13]
    assert means.tolist() == pytest.approx([2.0, 3.75, np.nan], nan_ok=True)
    assert result.ended == Event(0.017, "reset or restart")
    limit = f"{COMMANDS.operation.command_timeout:g} s"
    assert result.events == [
        Event(pytest.approx(0.004), f"engine.mean_torque = {COMMANDS.system.engine.mean_torque:g}, engine.order = 1"),
        Event(pytest.approx(0.002), f"engine torque falls back: no command for {limit}"),
        Event(pytest.approx(0.005), f"pressure falls back: no command for {limit}")]
    control = result.control(0.004)
    assert [event.t for event in control.events] == pytest.approx([0.002, 0.004, 0.005, 0.017])
    assert (control.target.values.tolist(), control.command.values.tolist()) == ([7.0, 9.0], [])
    last = signals_of(line, second, Uniform(0.004), MS)
    assert (last.ended, sorted(last.signals)) == (None, ["engine_torque", "mean_slip", "target_slip_speed"])
    ends, means = last.signals["mean_slip"]
    assert (ends // MS).tolist() == [4, 9]
    assert np.isnan(means).tolist() == [False, True]  # None of a gap, even before a single state.


def test_runs_are_cut_where_scenes_change_and_targets_jump():
    """Band 2 rad/s, and cycles so short that jumps are apart."""
    first, second = states(np.arange(10) * MS), states(np.arange(6) * MS, index=10, run=1, began=Break.RESET)
    more, less = COMMANDS.with_values({"engine.mean_torque": 310.0}), COMMANDS.with_values({"pressure.mean": 1e5})
    line = line_of(first, second, commands={"target_slip_speed": given([0, 4, 6, 8, 13], [20.0, 22.0, 25.0, 5.0, 9.0])})
    line.__dict__["changes"] = [(3, more), (6, COMMANDS), (6, less), (9, less), (12, COMMANDS)]
    told = [[(cut.states.index, len(cut.states), cut.began_by, dict(cut.changes), cut.stepped) for cut in cuts]
            for cuts in cuts_of(line, 2.0, Uniform(1e-9))]
    torque = COMMANDS.system.engine.mean_torque
    assert told == [
        [(0, 3, "start", {}, True), (3, 3, "parameters", {"engine.mean_torque": 310.0}, False),
         (6, 2, "parameters", {"engine.mean_torque": torque, "pressure.mean": 1e5, "target_slip_speed": 25.0}, True),
         (8, 2, "parameters", {"target_slip_speed": 5.0}, True)],
        [(10, 2, "reset", {}, True), (12, 1, "parameters", {"pressure.mean": COMMANDS.system.pressure.mean}, False),
         (13, 3, "parameters", {"target_slip_speed": 9.0}, True)]]
    assert [cut.scene for cut in cuts_of(line, 2.0, Uniform(1e-9))[0]] == [COMMANDS, more, less, less]
    # A jump of just the band does not begin a segment, and near jumps are a ramp.
    for how in ((3.0, Uniform(1e-9)), (2.0, Uniform(1.0))):
        assert [sorted(cut.changes) for cut in cuts_of(line, *how)[0]] == [
            [], ["engine.mean_torque"], ["engine.mean_torque", "pressure.mean"], ["target_slip_speed"]]


@pytest.mark.parametrize(("due", "late", "acts"), [
    (1, 250 * MS, 2), (1, 250 * MS + 1, 1), (2, 5, 2), (3, 5, 3), (0, 240 * MS, 2)])
def test_a_command_acts_at_a_later_change_to_its_value_within_a_quarter_of_a_second(due, late, acts):
    """The input changes to 7 at the third state and to 3 at the last."""
    stamps = np.array([0, 0, late, late + 1, late + 2])
    shown = np.array([3.0, 3.0, 7.0, 7.0, 3.0])
    result = _acted(np.array([due]), np.array([7.0]), np.array([True]), shown, stamps)
    assert result.tolist() == [acts]
    for value in (3.0, 8.0):  # The last change is that of another value, or of a command that is seen.
        assert _acted(np.array([4]), np.array([value]), np.array([value == 8.0]), shown, stamps).tolist() == [4]
