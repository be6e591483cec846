"""Recordings in parts, readable singly and as one; and the rest of a failed start."""

import errno
import os
import shutil

import numpy as np
import pytest
import yaml
from driveline_bags import START, TICK, bag, ticked
from full_disk import full_disk
from mcap.reader import make_reader

from tcc_sim.cli import main
from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.reader import Run
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.topics import HEADER, JOINT_STATE

FIG02 = load_scene("fig02")


def split(tmp_path, **limits):
    """1 s of a run whose parameters change at 0.35 s, in parts."""
    said = []
    rows = ticked(FIG02, 1000, changes=[(350, {"engine.mean_torque": 250.0}, False)], said=said)
    return bag(tmp_path / "run", rows, FIG02, said=said, **limits), rows


def test_the_parts_together_and_each_by_itself_are_the_recording(tmp_path):
    path, rows = split(tmp_path, max_duration=0.3)
    assert sorted(p.name for p in path.iterdir()) == ["metadata.yaml", *(f"run_{n}.mcap" for n in range(4))]
    run = Run(path)
    assert stamps_of(path) == list(range(1000))
    assert (run.complete, run.warnings, len(run.scenes), run.messages) == (True, [], 2, {"/joint_states": 1000})
    for n, part in enumerate((path, *(path / f"run_{n}.mcap" for n in range(4)))):
        result = replay(part, discard=0, verify=True)
        assert result.verification.verified
        assert n or result.verification.exact == 1000
        if n:
            assert stamps_of(part) == [row[0] // TICK for row in rows[300 * n - 300:300 * n]]
            assert Run(part).complete
            assert result.scene.system.engine.mean_torque == (300.0 if n < 3 else 250.0)


def test_metadata_lists_the_parts_as_rosbag2_does(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    path, _ = split(tmp_path, max_duration=0.3)
    document = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = [f"run_{n}.mcap" for n in range(4)]
    assert document["relative_file_paths"] == [entry["path"] for entry in document["files"]] == names
    assert [entry["message_count"] for entry in document["files"]] == [300, 300, 300, 100]
    assert [entry["starting_time"]["nanoseconds_since_epoch"] for entry in document["files"]] == [
        START + 300 * n * TICK for n in range(4)]
    assert [entry["duration"]["nanoseconds"] for entry in document["files"]] == [299 * TICK] * 3 + [99 * TICK]
    assert (document["message_count"], document["duration"]["nanoseconds"]) == (1000, 999 * TICK)
    assert [(t["topic_metadata"]["name"], t["message_count"]) for t in document["topics_with_message_count"]] == [
        ("/joint_states", 1000)]
    with rosbag2.Reader(path) as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count == 1000
        assert (reader.start_time, reader.duration) == (START, 999 * TICK + 1)


@pytest.mark.parametrize("limits", [{"max_size": 20_000}, {"max_chunks": 3}])
def test_a_part_ends_at_its_size_or_where_its_index_would_take_too_much_memory(tmp_path, limits):
    path, _ = split(tmp_path, **limits)
    sizes = [p.stat().st_size for p in sorted(path.glob("*.mcap"), key=lambda p: int(p.stem.split("_")[1]))]
    if "max_size" in limits:
        assert len(sizes) > 2
        assert all(20_000 < size < 60_000 for size in sizes[:-1])
    else:
        assert len(sizes) == 4  # Ten flushes of a chunk each.
    assert (stamps_of(path), Run(path).complete) == (list(range(1000)), True)


def test_every_part_begins_with_the_last_latched_message_of_each_channel(tmp_path):
    """Messages of a publisher that is gone are not repeated."""
    writer = BagWriter(tmp_path / "run", max_duration=0.1)
    joints, first, second = writer.channel("/joint_states", JOINT_STATE), *(
        writer.channel("/input_source", HEADER, publisher=who) for who in "ab")
    for n in range(350):
        log = START + n * TICK
        if n in (5, 6, 150):
            writer.write(second if n == 6 else first, log, log - 7, cdr.header(n, f"source {n}"), n, latched=True)
        if n == 220:
            writer.unlatch(second)
        writer.write(joints, log, log, cdr.joint_state(n * TICK, *[0.0] * 6), n)
    writer.close()
    values = []
    for number in range(4):
        with (tmp_path / "run" / f"run_{number}.mcap").open("rb") as file:
            values.append([(m.log_time - START, m.publish_time - START, m.sequence, cdr.read_header(m.data)[1])
                           for _, _, m in make_reader(file).iter_messages(topics=["/input_source"])])
    again = [(n * TICK, n * TICK - 7, n, f"source {n}") for n in (5, 6, 150)]
    assert values == [again[:2], [(100 * TICK, *again[0][1:]), (100 * TICK, *again[1][1:]), again[2]],
                      [(200 * TICK, *again[2][1:]), (200 * TICK, *again[1][1:])], [(300 * TICK, *again[2][1:])]]
    assert stamps_of(tmp_path / "run") == list(range(350))


def test_results_of_the_parts_are_added(tmp_path):
    counts = []

    def result():
        counts.append(len(counts) + 1)
        return {"lost": {"/slip_speed": counts[-1]}, "messages": {"/slip_speed": 10}}

    writer = BagWriter(tmp_path / "run", FIG02.text(), max_duration=0.1, result=result)
    filled(writer, range(250))
    writer.close({"lost": {"/slip_speed": 10, "/x": 1}, "solver": "fixed_step", "unsent": {"/joint_states": 64}})
    run = Run(tmp_path / "run")
    list(run.columns().runs)
    assert run.result == {"lost": {"/slip_speed": 13, "/x": 1}, "messages": {"/slip_speed": 20}, "solver": "fixed_step",
                          "unsent": {"/joint_states": 64}}
    assert "13 messages of /slip_speed lost while recording" in run.warnings
    assert "64 messages of /joint_states could not be sent by their publisher" in run.warnings


def test_killed_while_it_writes_a_later_part_and_a_part_that_is_gone(tmp_path, capsys):
    path, _ = split(tmp_path, max_duration=0.3, cut=True)
    run = Run(path)
    assert len(np.concatenate([batch.stamp_ns for batch in run.columns().runs])) == 1000
    assert not run.complete
    assert main(["recover", str(path)]) == 0
    assert "cut short" in capsys.readouterr().out
    assert Run(tmp_path / "run_recovered").complete
    (path / "run_1.mcap").unlink()
    run = Run(path)
    assert len(np.concatenate([batch.stamp_ns for batch in run.columns().runs])) == 700
    assert (run.stamps.lost, "part 1 is missing" in run.warnings) == (300, True)


def test_parts_are_synchronised_where_that_is_asked_for(tmp_path, monkeypatch):
    synced, real = [], os.fsync

    def sync(number):
        synced.append(os.path.relpath(os.readlink(f"/proc/self/fd/{number}"), tmp_path))
        real(number)

    monkeypatch.setattr(os, "fsync", sync)
    split(tmp_path, max_duration=0.3)
    assert synced == []
    writer = BagWriter(tmp_path / "safe", max_duration=0.3, sync=True)
    filled(writer, range(500))
    assert set(synced) == {".", "safe", "safe/safe_0.mcap"}
    writer.file.sync()
    assert synced[-1] == "safe/safe_1.mcap"
    assert sum(map(len, Run(tmp_path / "safe" / "safe_1.mcap").columns().runs)) == 200
    writer.close()
    assert synced[-1] == "safe"


def test_a_place_that_cannot_be_written_is_refused_and_left_alone(tmp_path):
    with full_disk(), pytest.raises(OSError, match=os.strerror(errno.EFBIG)):
        BagWriter(tmp_path / "a" / "b" / "run")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for place, why in (*((where, "cannot be created") for where in ("file/run", "/proc/run", "/dev/null/run")),
                       ("link", "exists already"), *(("x" * n, "too long") for n in (244, 255, 300))):
        with pytest.raises(RecordingError, match=why):
            BagWriter(tmp_path / place)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["elsewhere", "file", "link"]
    assert list((tmp_path / "elsewhere").iterdir()) == []
    BagWriter(tmp_path / ("x" * 243)).close()


def filled(writer, numbers):
    """Write states with these numbers, 1 ms apart."""
    joints = writer.channel("/joint_states", JOINT_STATE)
    for n in numbers:
        writer.write(joints, START + n * TICK, START + n * TICK, cdr.joint_state(n * TICK, *[0.0] * 6), n)


def stamps_of(path):
    return (np.concatenate([batch.stamp_ns for batch in Run(path).columns().runs]) // TICK).tolist()


def test_a_bag_whose_directory_is_renamed_shares_nothing_with_one_made_under_its_name(tmp_path):
    first = BagWriter(tmp_path / "run", FIG02.text(), max_duration=0.1)
    filled(first, range(150))
    (tmp_path / "run").rename(tmp_path / "moved")
    second = BagWriter(tmp_path / "run", FIG02.text(), max_duration=0.1)
    filled(first, range(150, 450))
    filled(second, range(1000, 1250))
    second.close()
    with pytest.raises(RecordingError, match=r"run was renamed or removed while it was recorded to"):
        first.check()
    first.close()
    assert stamps_of(tmp_path / "moved") == list(range(450))
    assert stamps_of(tmp_path / "run") == list(range(1000, 1250))
    for folder in ("moved", "run"):
        assert Run(tmp_path / folder).complete
        assert sorted(path.name for path in (tmp_path / folder).glob("*.part")) == []


@pytest.mark.parametrize("taken", ["run_1.mcap", "metadata.yaml"])
def test_a_name_that_another_has_taken_is_left_to_it_and_the_parts_are_whole(tmp_path, taken):
    writer = BagWriter(tmp_path / "run", FIG02.text(), max_duration=0.1)
    (tmp_path / "run" / taken).write_text("another's")

    def record():
        filled(writer, range(150))
        writer.close()

    with pytest.raises(RecordingError, match=f"run/{taken} exists already and is not overwritten"):
        record()
    if taken == "run_1.mcap":
        writer.close()
    assert (tmp_path / "run" / taken).read_text() == "another's"
    assert stamps_of(tmp_path / "run" / "run_0.mcap") == list(range(100))
    assert Run(tmp_path / "run" / "run_0.mcap").complete
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"run_0.mcap", taken} | (
        {"metadata.yaml"} if taken == "run_1.mcap" else {"run_1.mcap"})


@pytest.mark.parametrize("gone", ["directory", "file"])
def test_what_is_removed_while_it_is_written_is_noticed(tmp_path, gone):
    writer = BagWriter(tmp_path / "run")
    writer.check()
    if gone == "file":
        writer.file.path.unlink()
    else:
        shutil.rmtree(tmp_path / "run")
    with pytest.raises(RecordingError, match="renamed or removed"):
        writer.check()
    writer.abandon()


def test_a_scene_longer_than_the_limit_of_a_part_does_not_fill_it(tmp_path):
    writer = BagWriter(tmp_path / "run", "# " + "x" * 50_000, max_size=10_000)
    filled(writer, range(100))
    writer.close()
    assert [path.name for path in (tmp_path / "run").glob("*.mcap")] == ["run_0.mcap"]


def test_a_bag_in_the_folder_is_taken_and_of_several_one_is_to_be_named(tmp_path, capsys, refused):
    bag(tmp_path / "out" / "recording", ticked(load_scene("fig02"), 900), "fig02")
    assert main(["analyse", str(tmp_path / "out")]) == 0
    bag(tmp_path / "out" / "second", ticked(load_scene("fig02"), 10), "fig02")
    capsys.readouterr()
    assert "in it hold some: name one of them" in refused("analyse", tmp_path / "out")
