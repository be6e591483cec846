"""Written recordings are read back unchanged, by this package and by other programs."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from tcc_sim.errors import InputError, RecordingError
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import CARRIED, definition, installed_text
from tcc_sim.output.samples import write_trajectory
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.reader import Run
from tcc_sim.topics import topic

SCENE = "/**:\n  ros__parameters:\n    rate: 1000.0\n"
TICK = 1_000_000


def columns(count, seed=1):
    return np.random.default_rng(seed).normal(size=(count, 6)) * 100.0


def write(directory, rows, stamps, *, pressures=None, close=True, flush_every=50, lost=0):
    """Write a bag like the recorder: topics in blocks, flushed now and then."""
    bag = BagWriter(directory, SCENE, "1.2.3")
    joints = bag.channel("/joint_states", topic("joint_states").type)
    slip = bag.channel("/slip_speed", topic("slip_speed").type)
    pressure = bag.channel("/applied_pressure", topic("applied_pressure").type) if pressures is not None else 0
    late, times = 0, [10**18 + (n * TICK if pressures is not None else stamp) for n, stamp in enumerate(stamps)]
    for start in range(0, len(rows), flush_every):
        block = range(start, min(start + flush_every, len(rows)))
        for n in block:
            bag.write(joints, times[n], times[n] - 5, cdr.joint_state(stamps[n], *rows[n]), n)
        for n in block:
            bag.write(slip, times[n], times[n] - 5, cdr.float64(rows[n][2] - rows[n][3]), n)
        if pressures is not None:
            # Half a block late, because the recorder drains topics in turn.
            for n in range(late, block[-1] + 1 if block[-1] + 1 == len(rows) else start + 25):
                bag.write(pressure, times[n], 0, cdr.fluid_pressure(stamps[n], pressures[n]), n)
            late = start + 25
        bag.file.flush()
    if close:
        bag.close({"lost": {"/joint_states": 0, "/slip_speed": lost}})
    else:
        bag.file.flush()
        bag.abandon()
    return directory / f"{directory.name}_0.mcap"


def read(path, topic=None):
    run = Run(path, topic)
    batches = list(run.columns().runs)
    names = ("flywheel_angle", "plate_angle", "flywheel_speed", "plate_speed", "engine_torque", "friction_torque")
    table = np.column_stack([np.concatenate([getattr(batch, name) for batch in batches]) for name in names])
    return run, batches, np.concatenate([batch.stamp_ns for batch in batches]), table


def test_a_complete_bag_comes_back_bit_for_bit(tmp_path):
    rows, stamps = columns(333), [n * TICK for n in range(333)]
    path = write(tmp_path / "run", rows, stamps)
    for place in (tmp_path / "run", path):
        run, batches, result, table = read(place)
        assert (result == stamps).all()
        assert (table == rows).all()
        assert (np.concatenate([batch.log_ns for batch in batches]) == 10**18 + np.array(stamps)).all()
        assert all(not batch.further and batch.run == 0 for batch in batches)
        assert (run.complete, run.warnings, run.stamps.lost) == (True, [], 0)
        assert run.messages == {"/joint_states": 333, "/slip_speed": 333}
        assert (run.scene_text, run.scenes[0].version, run.result) == (
            SCENE, "1.2.3", {"lost": {"/joint_states": 0, "/slip_speed": 0}})


def test_what_the_recorder_counted_as_lost_is_told(tmp_path):
    write(tmp_path / "run", columns(10), [n * TICK for n in range(10)], lost=7)
    assert read(tmp_path / "run")[0].warnings == ["7 messages of /slip_speed lost while recording"]


def test_an_existing_output_is_refused_and_left_alone(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in ("run", "loop", "loop/run"):
        with pytest.raises(RecordingError, match=name):
            BagWriter(tmp_path / name)
    assert list((tmp_path / "run").iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"hello world", bytes(100)])
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    for path in (tmp_path, tmp_path / "x.mcap"):
        with pytest.raises(RecordingError) as caught:
            list(Run(path).columns().runs)
        assert "\n" not in str(caught.value)
    for path in (tmp_path / "none", tmp_path / "none.mcap"):
        with pytest.raises(RecordingError, match="cannot be read"):
            Run(path)


def test_rosbags_reads_messages_and_metadata(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    rows, stamps = columns(120), [n * TICK for n in range(120)]
    write(tmp_path / "run", rows, stamps)
    store = get_typestore(Stores.ROS2_JAZZY)
    with rosbag2.Reader(tmp_path / "run") as reader:
        assert reader.message_count == 240
        assert {c.topic: (c.msgtype, c.msgcount) for c in reader.connections} == {
            "/joint_states": ("sensor_msgs/msg/JointState", 120), "/slip_speed": ("std_msgs/msg/Float64", 120)}
        for connection in reader.connections:
            assert connection.digest == store.hash_rihs01(connection.msgtype)
            (profile,) = connection.ext.offered_qos_profiles
            assert (profile.reliability.name, profile.avoid_ros_namespace_conventions) == ("RELIABLE", False)
        n = 0
        for connection, log_time, data in reader.messages():
            if connection.topic == "/joint_states":
                message = store.deserialize_cdr(data, connection.msgtype)
                assert log_time == 10**18 + stamps[n]
                assert message.name == ["flywheel", "clutch_plate"]
                assert [*message.position, *message.velocity, *message.effort] == rows[n].tolist()
                n += 1
        assert n == 120
    information = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")


def test_a_trajectory_becomes_a_recording(tmp_path):
    from tcc_sim.model.parameters import System
    from tcc_sim.solvers.terms import Problem, assemble

    t = np.linspace(0.0, 0.1, 101)
    states = np.column_stack([np.cos(t), np.sin(t), np.cos(2 * t)])
    system = System()
    trajectory = assemble(Problem(system, state=None, duration=0.1), "test", t, states)
    write_trajectory(tmp_path / "run.mcap", trajectory, SCENE)
    run, _, result, table = read(tmp_path / "run.mcap")
    assert (result == np.arange(101) * TICK).all()
    assert run.complete
    assert run.scene_text == SCENE
    assert table[:, 2] - table[:, 3] == pytest.approx(np.cos(t), abs=1e-12)
    assert table[:, 0] - table[:, 1] == pytest.approx(np.sin(t), abs=1e-6)
    assert (table[:, 5] == trajectory.friction_torque).all()
    with pytest.raises(RecordingError, match="exists already"):
        write_trajectory(tmp_path / "run.mcap", trajectory, SCENE)


def test_carried_definitions_are_those_of_the_installed_ros(tmp_path, monkeypatch):
    compared = 0
    for name, (text, type_hash) in CARRIED.items():
        message, described = installed_text(name, ".msg"), installed_text(name, ".json")
        if message is None or described is None:
            continue
        fields = [" ".join(line.split("#")[0].split()) for line in message.splitlines()]
        assert "".join(f"{field}\n" for field in fields if field) == text
        assert {entry["type_name"]: entry["hash_string"]
                for entry in json.loads(described)["type_hashes"]}[name] == type_hash
        compared += 1
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.fspath(tmp_path))
    monkeypatch.setattr(sys, "prefix", os.fspath(tmp_path))
    assert definition("sensor_msgs/msg/JointState").text.count("MSG: ") == 2
    for wrong in ("sensor_msgs/msg/Imu", "../../etc/passwd", "std_msgs/msg/../x", "std_msgs/Float64"):
        with pytest.raises(InputError):
            definition(wrong)
    if not compared:
        pytest.skip("no ROS 2 here to compare with")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write(tmp_path_factory.mktemp("foreign") / "run", columns(300), [n * TICK for n in range(300)])


def run(*words, **options):
    return subprocess.run(words, capture_output=True, text=True, timeout=120, **options)


def test_rerun_converts_and_verifies_a_recording(path, tmp_path):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if rerun is None:
        pytest.skip("rerun is not installed")
    if run(rerun, "mcap", "--help").returncode:
        pytest.skip("this rerun has no mcap command")
    converted = run(rerun, "mcap", "convert", str(path), "-o", str(tmp_path / "run.rrd"))
    assert converted.returncode == 0, converted.stderr
    assert run(rerun, "rrd", "verify", str(tmp_path / "run.rrd")).returncode == 0
