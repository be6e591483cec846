"""Several publishers in one recording are separated by identity, however often simulation time fell back."""

import numpy as np
import pytest
from driveline_bags import TICK, bag, ticked
from test_bag_round_trip import columns, read, write

from tcc_sim.errors import RecordingError
from tcc_sim.recording.reader import open_run
from tcc_sim.recording.recovery import recover
from tcc_sim.recording.stamps import Break
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene

MINIMAL, COMMANDS = load_scene("minimal"), load_scene("commands")


def test_a_thousand_resets_stay_readable(tmp_path):
    stamps = [n * TICK for _ in range(1200) for n in range(4)]
    write(tmp_path / "run", columns(len(stamps)), stamps, flush_every=500)
    run, batches, result, _ = read(tmp_path / "run")
    assert result.tolist() == stamps
    assert (run.stamps.runs, run.stamps.resets, batches[-1].run) == (1200, 1199, 1199)
    assert "simulation time started again 1199 times (1199 resets, 0 restarts): these are separate runs" in run.warnings


def two(tmp_path, order):
    """Recording of two drivelines at once, with states in this order of owners."""
    rows = {who: ticked(MINIMAL, 300) for who in "ab"}
    taken, mixed, owners = {"a": iter(rows["a"]), "b": iter(rows["b"])}, [], []
    for who in order:
        mixed.append(next(taken[who]))
        owners.append(who)
    cuts = [0] + [k for k in range(1, len(owners)) if owners[k] != owners[k - 1]]
    return bag(tmp_path / "run", mixed, MINIMAL, publishers=[(k, owners[k]) for k in cuts])


def test_a_restart_is_known_by_its_publisher_though_its_stamps_are_later(tmp_path):
    rows = ticked(MINIMAL, 500)
    path = bag(tmp_path / "run", rows[:200] + rows[260:], MINIMAL, publishers=[(0, "a1"), (200, "b2")])
    run = open_run(path)
    batches = list(run.states())
    assert (run.stamps.restarts, run.stamps.resets, run.lost_messages) == (1, 0, 0)
    assert {b.began for b in batches if b.run == 1} == {Break.RESTART}
    assert sum(len(b) for b in batches if b.run == 1) == 240


def test_of_two_at_once_the_latest_to_start_is_read_whole_and_the_other_on_request(tmp_path):
    path = two(tmp_path, "a" * 100 + "ab" * 100 + "b" * 150)
    for number, who, states in ((None, "b", 250), (1, "b", 250), (0, "a", 200)):
        run = open_run(path, driveline=number)
        kept = np.concatenate([batch.stamp_ns for batch in run.states()])
        assert kept.tolist() == [n * TICK for n in range(states)]
        assert (run.driveline.publisher, run.driveline.states) == (who, states)
        assert [one.read for one in run.drivelines] == [who == "a", who == "b"]
        other = 200 if who == "b" else 250
        assert any(f"not read: /joint_states of publisher {'ab'[who == 'a']}: {other} states" in sentence
                   for sentence in run.warnings)
        result = replay(path, discard=0, driveline=number)
        assert (result.continuity.restarts, result.messages) == (0, states)
        assert result.as_json()["drivelines"][number or 0]["topic"] == "/joint_states"


def test_where_nothing_tells_them_apart_they_are_refused(tmp_path):
    rows = ticked(MINIMAL, 900)
    mixed = [row for pair in zip(rows[500:800], rows[:300]) for row in pair]
    with pytest.raises(RecordingError, match="publishers are mixed and cannot be separated"):
        list(open_run(bag(tmp_path / "run", mixed, MINIMAL)).states())


def test_pressures_follow_their_own_publisher(tmp_path):
    solved = ticked(COMMANDS, 300, pressure=lambda k: 2e5)
    rows = [(stamp, *rest[:-1], 1e5 + n) for n, (stamp, *rest) in enumerate(solved)]
    path = bag(tmp_path / "run", rows[:150] + rows[200:], COMMANDS, publishers=[(0, "a1"), (150, "b2")])
    run = open_run(path)
    values = np.concatenate([batch.applied_pressure for batch in run.states()])
    assert values.tolist() == [row[-1] for row in rows[:150] + rows[200:]]
    assert not any("pressure is missing" in sentence for sentence in run.warnings)


@pytest.mark.parametrize("left_out", [range(40, 47), range(5), range(195, 200)])
def test_missing_pressures_are_counted_and_nan(tmp_path, left_out):
    rows = columns(200)
    path = write(tmp_path / "run", rows, [n * TICK for n in range(200)], pressures=[float(n) for n in range(200)])
    from mcap.reader import make_reader

    from tcc_sim.recording.mcap_file import McapFile
    from tcc_sim.topics import topic

    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages(log_time_order=False))
    output = McapFile(tmp_path / "less.mcap")
    numbers = {name: output.channel(name, topic(name[1:]).type) for name in ("/joint_states", "/slip_speed",
                                                                           "/applied_pressure")}
    for _, channel, message in messages:
        if channel.topic != "/applied_pressure" or message.sequence not in left_out:
            output.write(numbers[channel.topic], message.log_time, message.publish_time, message.data, message.sequence)
    output.close()
    run = open_run(tmp_path / "less.mcap")
    values = np.concatenate([batch.applied_pressure for batch in run.states()])
    assert np.flatnonzero(np.isnan(values)).tolist() == list(left_out)
    assert f"the applied pressure is missing at {len(left_out)} ticks" in run.warnings


def test_recovery_keeps_who_published(tmp_path):
    path = two(tmp_path, "a" * 100 + "b" * 200)
    recovered = recover(open_run(path), tmp_path / "saved")
    assert recovered.messages["/joint_states"] == 300
    again = open_run(tmp_path / "saved")
    list(again.states())
    assert again.stamps.restarts == 1


def test_a_cut_recording_in_a_namespace_is_read(tmp_path):
    """Without an index the reader finds the topics in the first chunks."""
    from tcc_sim.messages import cdr
    from tcc_sim.recording.bag import BagWriter
    from tcc_sim.topics import JOINT_STATE

    writer = BagWriter(tmp_path / "run", MINIMAL.text())
    joints = writer.channel("/left/driveline/joint_states", JOINT_STATE)
    for n in range(300):
        writer.write(joints, n, n, cdr.joint_state(n * TICK, *[0.0] * 6), n)
    writer.file.flush()
    writer.abandon()
    run = open_run(tmp_path / "run")
    assert run.joint_states_topic == "/left/driveline/joint_states"
    assert sum(map(len, run.states())) == 300
    assert not run.complete


def test_a_recording_without_quality_of_service_is_recovered(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from tcc_sim.messages import cdr
    from tcc_sim.recording.mcap_file import McapFile
    from tcc_sim.topics import JOINT_STATE

    output = McapFile(tmp_path / "x.mcap", MINIMAL.text())
    joints = output.channel("/joint_states", JOINT_STATE, [])
    for n in range(30):
        output.write(joints, n, n, cdr.joint_state(n * TICK, *[0.0] * 6), n)
    output.close()
    assert recover(open_run(tmp_path / "x.mcap"), tmp_path / "saved").messages == {"/joint_states": 30}
    with rosbag2.Reader(tmp_path / "saved") as reader:
        (connection,) = reader.connections
        assert connection.ext.offered_qos_profiles[0].reliability.name == "RELIABLE"


@pytest.mark.parametrize(("given", "kept"), [(2**32 - 1, 2**32 - 1), (2**32, 0), (2**32 + 5, 5)])
def test_a_number_of_a_message_wraps_at_32_bits(tmp_path, given, kept):
    from mcap.reader import make_reader

    from tcc_sim.messages import cdr
    from tcc_sim.recording.mcap_file import McapFile
    from tcc_sim.topics import JOINT_STATE

    output = McapFile(tmp_path / "x.mcap")
    output.write(output.channel("/joint_states", JOINT_STATE), 0, 0, cdr.joint_state(0, *[0.0] * 6), given)
    output.close()
    with (tmp_path / "x.mcap").open("rb") as file:
        ((_, _, message),) = make_reader(file).iter_messages()
    assert message.sequence == kept
