"""Bags of other programs: other names and orders of joints, other frames, SQLite, jittering stamps."""

import re
import struct

import numpy as np
import pytest
from driveline_bags import TICK, by_hand

from tcc_sim.cli import main
from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.reader import open_run
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE


def joint_state(stamp, frame, names, columns):
    """A JointState in CDR, encoded without the package."""
    out = bytearray(struct.pack("<iI", stamp // 10**9, stamp % 10**9))

    def align(size):
        out.extend(b"\xaa" * (-len(out) % size))

    def text(word):
        align(4)
        out.extend(struct.pack("<I", len(word) + 1) + word.encode() + b"\0")

    text(frame)
    align(4)
    out.extend(struct.pack("<I", len(names)))
    for name in names:
        text(name)
    for column in columns:
        align(4)
        out.extend(struct.pack("<I", len(column)))
        align(8)
        out.extend(struct.pack(f"<{len(column)}d", *column))
    return b"\0\1\0\0" + bytes(out)


def foreign(path, names, places, frame="base_link", scene="slip"):
    """1.5 s of steady slip with flywheel and plate at these places among the joints."""
    rows = by_hand(1.5, lambda t: 150.0 + 0.0 * t, lambda t: 0.1 + 0.0 * t, lambda t: 0.0 * t,
                   lambda t: 300.0 + 250.0 * np.sin(150.0 * t), lambda t: 300.0 + 0.0 * t)
    writer = BagWriter(path, load_scene(scene).text())
    channel = writer.channel("/joint_states", JOINT_STATE)
    for stamp, *values, _ in rows:
        columns = []
        for pair in zip(values[::2], values[1::2]):
            column = [7.0] * len(names)
            for place, value in zip(places, pair):
                column[place] = value
            columns.append(column)
        writer.write(channel, stamp, stamp, joint_state(stamp, frame, names, columns))
    writer.close()
    return rows


@pytest.mark.parametrize(("names", "places", "joints"), [
    (("clutch_plate", "flywheel"), (1, 0), None),
    (("wheel_left", "flywheel", "x", "clutch_plate"), (1, 3), None),
    (("engine", "turbine"), (0, 1), {"flywheel": "engine", "clutch_plate": "turbine"}),
    (("a_longer_name", "b", "clutch_plate"), (1, 2), {"flywheel": "b"}),
])
def test_joints_stand_where_their_names_do(tmp_path, names, places, joints):
    rows = np.array(foreign(tmp_path / "run", names, places))
    run = open_run(tmp_path / "run", joints=joints)
    (batch,) = run.states()
    for name, column in (("flywheel_angle", 1), ("plate_angle", 2), ("flywheel_speed", 3), ("plate_speed", 4),
                         ("engine_torque", 5), ("friction_torque", 6)):
        assert np.array_equal(getattr(batch, name), rows[:, column])
    assert run.warnings == []


def test_other_joints_are_asked_for(tmp_path, capsys):
    foreign(tmp_path / "run", ("engine", "turbine"), (0, 1))
    assert main(["analyse", str(tmp_path / "run")]) == 2
    assert ("its joints are engine, turbine; say which of them are flywheel and clutch plate: "
            "--joints flywheel=NAME,clutch_plate=NAME") in capsys.readouterr().err
    assert main(["analyse", str(tmp_path / "run"), "--joints", "flywheel=engine,clutch_plate=turbine"]) == 0
    assert re.search(r"largest \|slip speed\| +15\d", capsys.readouterr().out)
    assert main(["analyse", str(tmp_path / "run"), "--joints", "wheel=engine"]) == 2
    assert "must be flywheel=NAME,clutch_plate=NAME" in capsys.readouterr().err


def test_the_layout_of_our_own_names_is_our_own():
    layout = cdr.joint_state_layout()
    assert layout.record == cdr.JOINT_STATE
    assert layout.example.tobytes() == cdr.joint_state(0, *[0.0] * 6)


@pytest.mark.parametrize("name", ["run", "run/run_0.db3"])
def test_a_bag_in_sqlite_is_refused_with_the_command_that_converts_it(tmp_path, name):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_0.db3").write_bytes(b"SQLite format 3\0")
    with pytest.raises(RecordingError, match=r"rosbags-convert --src .*run --dst .*run_mcap --dst-storage mcap"):
        open_run(tmp_path / name)


@pytest.mark.parametrize("spread", [0.1, 0.4])
def test_stamps_that_jitter_are_no_losses(spread):
    random = np.random.default_rng(6)
    stamps = (np.arange(5000) * TICK + random.uniform(-spread, spread, 5000) * TICK).astype(np.int64)
    counter = StampCounter()
    for start in range(0, 5000, 700):
        counter.pieces(stamps[start:start + 700])
    assert (counter.lost, counter.gaps, counter.runs) == (0, 0, 1)
    assert counter.tick == pytest.approx(TICK, rel=0.05)
    lossy = StampCounter()
    lossy.pieces(np.delete(stamps, slice(2000, 2030)))
    assert (lossy.gaps, lossy.lost) == (1, 30)
