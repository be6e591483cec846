"""A recording is solved again from itself: unchanged ones give the same bits, and the first change is found."""

import math

import pytest
from driveline_bags import TICK, bag, readings, ticked

from tcc_sim.cli import main
from tcc_sim.code_version import code_version
from tcc_sim.recording.reader import Run
from tcc_sim.replay.replay import replay
from tcc_sim.replay.timeline import timeline_of
from tcc_sim.replay.verification import STEP_TOLERANCE, verify
from tcc_sim.scene import load_scene

SCENES = {name: load_scene(name) for name in ("fig02", "minimal", "chaos", "commands")}


def torque(k):
    return 300.0 + 250.0 * math.sin(0.15 * k)


def pressure(k):
    return 225e3 + 20e3 * math.sin(0.05 * k) if k > 40 else 225e3


def verified(directory, rows, scene, **keywords):
    result = replay(bag(directory, rows, scene, **keywords), verify=True, frequency=150.0)
    assert result.as_json()["verified"] == result.verification.verified
    return result.verification


def exactly(result, count):
    assert (result.verified, result.largest_difference, result.exact) == (True, 0.0, count)


STEPS = {"fig02": [(100, {"engine.mean_torque": 250.0}, False), (250, {"pressure.amplitude": 0.0}, True)],
         "minimal": [(100, {"friction.kinetic_coefficient": 0.2}, True), (101, {"pressure.phase": 1.0}, True),
                     (250, {}, False), (251, {"pressure.mean": 2e5, "pressure.amplitude": 3e4}, True)]}
COMMANDED = {"torque": torque, "pressure": pressure}
STEEPER = [(150, {"friction.static_coefficient": 0.4, "friction.kinetic_coefficient": 0.2}, False)]


@pytest.mark.parametrize(("name", "options", "cut"), [
    ("fig02", {}, False), ("minimal", {}, True), ("commands", {**COMMANDED, "resets": (150, 200)}, False),
    ("commands", {**COMMANDED, "resets": (200,), "changes": STEEPER}, False),
    ("fig02", {"changes": [(100, {"engine.frequency": 201.0}, True)], "resets": (250,)}, False),
    *((name, {"changes": STEPS[name], "resets": resets}, False)
      for name, resets in (("fig02", (99,)), ("fig02", (300, 301)), ("minimal", ()), ("minimal", (100, 250))))])
def test_inputs_resets_and_changes_of_parameters_are_followed_to_the_last_bit(tmp_path, name, options, cut):
    said = []
    rows = ticked(SCENES[name], 320, said=said, **options)
    result = verified(tmp_path / "run", rows, SCENES[name], said=said, cut=cut)
    exactly(result, len(rows))
    assert result.compared == len(rows)
    assert "to the last bit" in result.sentence


@pytest.mark.parametrize("means", ["engine", "pressure"])
def test_one_input_falls_back_to_its_mean_and_the_other_to_its_harmonics(tmp_path, means):
    scene, sources = SCENES["commands"].with_values({f"{means}.fallback": "mean"}), []
    rows = ticked(scene, 200, torque=lambda k: 250.0 if 50 < k <= 100 else None,
                  pressure=lambda k: 2e5 if 80 < k <= 120 else None, sources=sources)
    exactly(verified(tmp_path / "run", rows, scene, sources=sources), 200)


def test_progress_counts_every_state_and_may_be_left_out(tmp_path):
    line = timeline_of(Run(bag(tmp_path / "run", ticked(SCENES["fig02"], 300), SCENES["fig02"])), SCENES["fig02"])
    counts = []
    assert verify(line, 10**6, counts.append).verified
    assert sum(counts) == 300
    assert verify(line, 10**6).verified


@pytest.mark.parametrize("column", range(1, 7))
def test_one_changed_digit_is_found(tmp_path, column):
    rows = ticked(SCENES["fig02"], 230)
    changed = list(rows[217])
    changed[column] = math.nextafter(changed[column], math.inf)
    rows[217] = tuple(changed)
    result = verified(tmp_path / "run", rows, SCENES["fig02"])
    assert not result.verified
    assert result.first_difference_ns == 217 * TICK
    assert 0.0 < result.largest_difference < 1e-12
    assert "0.217 s" in result.sentence


def test_a_changed_pressure_is_found(tmp_path):
    rows = ticked(SCENES["commands"], 400, torque=torque, pressure=pressure)
    rows[300] = (*rows[300][:-1], rows[300][-1] * 1.01)
    result = verified(tmp_path / "run", rows, SCENES["commands"])
    assert not result.verified
    assert result.first_difference_ns == 300 * TICK
    assert main(["analyse", str(tmp_path / "run"), "--verify", "--frequency", "150"]) == 1


def test_a_value_that_is_not_finite_is_found(tmp_path):
    rows = ticked(SCENES["fig02"], 400)
    rows[100] = (rows[100][0], math.nan, *rows[100][2:])
    result = replay(bag(tmp_path / "run", rows, SCENES["fig02"]), verify=True)
    assert not result.verification.verified
    assert result.verification.first_difference_ns == 100 * TICK
    assert result.as_json()["largest_difference"] is None


@pytest.mark.parametrize(("name", "changes"), [("fig02", ()), ("minimal", STEPS["minimal"])])
def test_a_gap_does_not_matter_where_the_inputs_are_known_and_a_change_in_it_is_made_at_its_tick(tmp_path, name,
                                                                                                 changes):
    said = []
    rows = ticked(SCENES[name], 400, changes=changes, said=said)
    exactly(verified(tmp_path / "run", rows[:90] + rows[130:], SCENES[name],
                     said=[(min(row, 90) if row < 130 else row - 40, text) for row, text in said]), 360)


def test_a_change_that_nobody_said_is_a_difference(tmp_path):
    rows = ticked(SCENES["fig02"], 400, changes=[(250, {"friction.static_coefficient": 0.31}, False)])
    result = verified(tmp_path / "run", rows, SCENES["fig02"])
    assert not result.verified
    assert result.first_difference_ns == 250 * TICK
    assert result.largest_difference > 1e-6


def test_a_scene_counts_from_its_stamp_on_even_if_the_clock_was_set_back_before(tmp_path):
    said = []
    rows = ticked(SCENES["fig02"], 400, changes=STEPS["fig02"], said=said)
    result = verified(tmp_path / "run", rows, SCENES["fig02"], said=[(row - 50, text) for row, text in said])
    exactly(result, 400)


def test_a_recording_that_starts_late_is_checked_tick_by_tick(tmp_path):
    rows = ticked(SCENES["chaos"], 350)[137:]
    result = verified(tmp_path / "run", rows, SCENES["chaos"])
    assert result.verified
    assert (result.compared, result.exact) == (213, 0)
    assert result.largest_difference < STEP_TOLERANCE
    assert "within 1e-06" in result.sentence
    changed = list(rows[200])
    changed[2] += 1e-4
    rows[200] = tuple(changed)
    result = verified(tmp_path / "changed", rows, SCENES["chaos"])
    assert result.first_difference_ns == (137 + 200) * TICK


def test_after_a_gap_in_commanded_inputs_it_goes_on_tick_by_tick(tmp_path):
    rows = ticked(SCENES["commands"], 400, torque=torque, pressure=pressure)
    result = verified(tmp_path / "run", rows[:90] + rows[130:], SCENES["commands"])
    assert result.verified
    assert (result.compared, result.exact) == (360, 90)


def test_what_the_node_did_not_make_is_said(tmp_path):
    rows = [(stamp + 100, *rest) for stamp, *rest in ticked(SCENES["fig02"], 200)]
    result = verified(tmp_path / "run", rows, SCENES["fig02"])
    assert not result.verified
    assert "is not that of a tick" in result.sentence
    set_valued = SCENES["fig02"].with_values({"friction.law": "set_valued"})
    result = verified(tmp_path / "other", ticked(SCENES["fig02"], 200), set_valued)
    assert not result.verified
    assert "set_valued" in result.sentence


def test_states_without_a_known_input_are_not_verified(tmp_path, capsys):
    rows = ticked(SCENES["commands"], 400, torque=torque, pressure=pressure)
    unknown = [row if k < 200 else (*row[:-1], math.nan) for k, row in enumerate(rows)]
    path = bag(tmp_path / "run", [*unknown[:-1], rows[-1]], SCENES["commands"])
    result = replay(path, verify=True, frequency=150.0)
    assert not result.verification.verified
    assert result.verification.sentence == "not verified: 199 of 400 states have no known input"
    assert (result.as_json()["states"], result.as_json()["solved"]) == (400, 201)
    assert main(["analyse", str(path), "--verify", "--frequency", "150"]) == 1
    assert "199 of 400 states have no known input" in capsys.readouterr().out


def test_messages_in_the_wrong_order_are_not_verified(tmp_path):
    """Two swapped messages begin a run, which would hide a lasting difference."""
    rows = ticked(SCENES["fig02"], 400)
    shifted = [(*row[:3], row[3] + 777.0, *row[4:]) if 201 <= k < 300 else row for k, row in enumerate(rows)]
    for name, given in (("clean", rows), ("shifted", shifted)):
        mixed = [*given[:200], given[300], *given[201:300], given[200], *given[301:]]
        result = verified(tmp_path / name, mixed, SCENES["fig02"])
        assert not result.verified
        assert name == "shifted" or "begins at 0.201 s after a reset, which must lead to 0" in result.sentence


ACTUATED = load_scene("controlled").with_values({"pressure.time_constant": 0.02, "pressure.delay": 0.003,
                                                 "pressure.rate_limit": 2e6})


def commanded(k):
    return 1e5 + 5e4 * (k // 50 % 2) if k > 20 else None


def far_speed(k):
    return 30.0 * math.sin(0.02 * k) if k > 100 else None


PROFILED = load_scene("runup").with_values({"pressure.source": "topic"})


@pytest.mark.parametrize("scene", [ACTUATED, PROFILED])
def test_a_lagged_pressure_profiles_and_a_far_end_are_solved_again_to_the_last_bit(tmp_path, scene):
    rows, ends = readings(scene, 400, commanded, far_speed)
    result = verified(tmp_path / "run", rows, scene, ends=ends)
    exactly(result, 400)
    without = verified(tmp_path / "without", rows, scene)
    assert (without.verified, without.first_difference_ns) == (False, 101 * TICK)


@pytest.mark.parametrize(("which", "column"), [("rows", 7), ("ends", 1), ("ends", 2)])
def test_one_changed_pressure_or_far_end_is_found(tmp_path, which, column):
    rows, ends = readings(ACTUATED, 300, commanded, far_speed)
    changed = {"rows": rows, "ends": ends}[which]
    place = next(k for k, row in enumerate(changed) if row[0] == 217 * TICK)
    row = list(changed[place])
    row[column] *= 1.0 + 1e-9
    changed[place] = tuple(row)
    result = verified(tmp_path / "run", rows, ACTUATED, ends=ends)
    assert not result.verified
    assert result.first_difference_ns in (217 * TICK, 218 * TICK)


def test_a_gap_is_bridged_from_the_state_behind_it(tmp_path):
    rows, ends = readings(ACTUATED, 400, commanded, far_speed)
    kept = [row for row in rows if not 200 <= row[0] // TICK < 210]
    result = verified(tmp_path / "run", kept, ACTUATED, ends=ends)
    assert result.verified
    assert (result.exact, result.solved) == (200, 389)


def test_the_shaft_torque_of_a_recording_is_that_against_the_far_end(tmp_path):
    rows, ends = readings(load_scene("fig02"), 400, lambda _: None, lambda k: 40.0 + 20.0 * math.sin(0.01 * k))
    result = replay(bag(tmp_path / "run", rows, load_scene("fig02"), ends=ends), discard=0)
    torques = [torque for *_, torque in ends]
    assert max(torques) == pytest.approx(result.summary.max_shaft_torque, rel=0.02)
    assert min(torques) == pytest.approx(result.summary.min_shaft_torque, rel=0.02)
    still = replay(bag(tmp_path / "still", rows, load_scene("fig02")), discard=0)
    assert still.summary.max_shaft_torque > 10.0 * max(torques)


def test_a_vehicle_that_attaches_after_a_reset_in_one_chunk_belongs_to_the_second_run(tmp_path):
    scene = load_scene("fig02")
    first, _ = readings(scene, 30, lambda _: None)
    second, ends = readings(scene, 200, lambda _: None, lambda k: 30.0 if k > 40 else None)
    assert len(first) + 42 < 100  # Rows in a chunk.
    result = verified(tmp_path / "run", [*first, *second], scene, ends=ends)
    exactly(result, 230)


@pytest.mark.parametrize(("version", "words"), [
    ("", ()), ("1.0.0", ("friction table", "last bits")), ("1.1.0+00000000", ("no recorded value",)),
    ("99.0.0", ("older",)), ("two", ("not known",))])
def test_a_recording_of_another_version_names_the_values_that_may_differ(tmp_path, version, words):
    """An empty version is written as that of the running code."""
    rows = ticked(SCENES["fig02"], 60)
    warnings = replay(bag(tmp_path / "run", rows, SCENES["fig02"], version=version), verify=True).warnings
    named = [line for line in warnings if code_version() in line]
    assert len(named) == bool(version)
    assert all(word in line for line in named for word in (version, *words))


@pytest.mark.parametrize(("pacing", "slowness"), [("real_time", 2.5), ("lockstep", 1.0)])
def test_only_a_run_that_is_paced_by_real_time_can_stall(tmp_path, pacing, slowness):
    """The machine was busy for 2 s after 0.8 s; in lock-step this is part of the run's rate."""
    scene = SCENES["minimal"].with_values({"pacing": pacing})
    rows = ticked(scene, 2000)
    late = [round(slowness * number * TICK) + 2_000_000_000 * (number > 800) for number in range(len(rows))]
    result = replay(bag(tmp_path / "run", rows, scene, clock=late.__getitem__))
    assert result.pace == pytest.approx(1.0 / slowness if pacing == "real_time" else 2.0 / 4.0, rel=0.1)
    assert any("stalled" in line for line in result.warnings) == (pacing == "real_time")
