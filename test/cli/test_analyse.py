"""`tcc-sim analyse` from the outside: figures, JSON, Rerun file, and what it refuses."""

import json
import math
import sys

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.recording.trajectory_bag import write_trajectory
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory

KEYS = {"max_slip_speed", "min_slip_speed", "period", "section", "stick_fraction", "regime", "cycles", "solver",
        "elapsed_s",
        "messages", "lost_messages", "complete"}
SWING = 250.0 / (0.2 * 150.0)


@pytest.fixture
def recording(tmp_path):
    """Steady pure slip, (17a) put right, for 2 s."""
    scene = load_scene("slip")
    t = np.arange(2001) * 1e-3
    zero = np.zeros_like(t)
    run = Trajectory(t, 150.0 + SWING * (1.0 - np.cos(150.0 * t)), zero + 0.1, zero, 300.0 + 250.0 * np.sin(150.0 * t),
                     zero + 300.0, zero + 300.0, zero.astype(np.int8) + 1, 2.0 * math.pi / 150.0, "by_hand",
                     scene.system)
    path = tmp_path / "run.mcap"
    write_trajectory(path, run, scene.text())
    return path


def refused(capsys, *arguments):
    assert main(["analyse", *map(str, arguments)]) == 2
    out = capsys.readouterr()
    assert out.out == ""
    assert out.err.count("\n") == 1
    return out.err


def test_json_on_standard_output_is_nothing_but_json(capsys, recording):
    assert main(["analyse", str(recording), "--json", "-", "--verify", "--discard", "10"]) == 0
    out = capsys.readouterr()
    found = json.loads(out.out)
    assert out.err == ""
    assert set(found) >= KEYS | {"verified", "largest_difference"}
    assert (found["messages"], found["lost_messages"], found["complete"]) == (2001, 0, True)
    assert (found["cycles"], found["discarded"], found["period"], found["regime"]) == (47, 10, 1, "slip")
    assert found["max_slip_speed"] == pytest.approx(150.0 + 2.0 * SWING, rel=1e-7)
    assert found["solver"] == "by_hand"
    # The closed form is not the solution of the ticks, which start from a plate at rest at angle 0.
    assert found["verified"] is False


def test_the_table_and_the_files(capsys, recording, tmp_path):
    assert main(["analyse", str(recording), "--json", str(tmp_path / "a.json"), "--frequency", "75"]) == 0
    out = capsys.readouterr().out
    for words in ("complete", "2001 of joint_states", "1 ms apart, no gap", "75 rad/s, as given",
                  "largest |slip speed|"):
        assert words in out
    assert json.loads((tmp_path / "a.json").read_text())["frequency"] == 75.0


def test_existing_files_are_replaced_only_by_force(capsys, recording, tmp_path):
    pytest.importorskip("rerun")
    figures, view = tmp_path / "a.json", tmp_path / "a.rrd"
    for path, option in ((figures, "--json"), (view, "--rrd")):
        path.write_text("mine")
        assert "exists" in refused(capsys, recording, option, path)
        assert path.read_text() == "mine"
    assert main(["analyse", str(recording), "--json", str(figures), "--rrd", str(view), "--force"]) == 0
    assert json.loads(figures.read_text())["messages"] == 2001
    assert view.read_bytes()[:4] == b"RRF2"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "a.rrd", "run.mcap"]


@pytest.mark.parametrize(("arguments", "words"), [
    (["--discard", "47"], "--discard 47"), (["--discard", "x"], "--discard"),
    (["--frequency", "0"], "frequency is 0 rad/s"),
    (["--rrd", "no/run.rrd"], "no directory"), (["--json", "."], "is a directory"),
    (["--rrd", "x", "--json", "x"], "same file"),
    (["--spawn", "--rrd", "x"], "not allowed with"), (["--connect", "http://x"], "is not the URL"),
])
def test_wrong_input_ends_with_status_2_and_writes_nothing(capsys, monkeypatch, recording, arguments, words):
    if "--connect" in arguments:
        pytest.importorskip("rerun")
    monkeypatch.chdir(recording.parent)
    assert words in refused(capsys, recording, *arguments)
    assert [p.name for p in recording.parent.iterdir()] == ["run.mcap"]


def test_what_is_no_recording(capsys, tmp_path):
    assert "cannot be read" in refused(capsys, tmp_path / "nowhere.mcap")
    assert "no .mcap file" in refused(capsys, tmp_path)
    (tmp_path / "a.mcap").write_bytes(b"nothing of the kind")
    refused(capsys, tmp_path / "a.mcap")


def test_without_rerun_the_extra_is_named_and_nothing_is_left(capsys, monkeypatch, recording):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["analyse", str(recording), "--rrd", str(recording.parent / "run.rrd")]) == 1
    assert "tcc_sim[view]" in capsys.readouterr().err
    assert [p.name for p in recording.parent.iterdir()] == ["run.mcap"]


def test_damping_is_that_of_pure_slip(capsys, recording):
    assert main(["analyse", str(recording), "--damping", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["equivalent_damping"], found["negative_slope_mean"]) == (0.0, 0.0)
    assert main(["analyse", str(recording), "--damping"]) == 0
    assert "0 N m s/rad, mean of the negative slope 0; -C23 is -0.6" in capsys.readouterr().out
