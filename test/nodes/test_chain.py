"""The commands that run real nodes in separate processes: demo, realtime, soak."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from documents import valid
from waiting import until_or_ended

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from interpreter import environment, python, without_compiling

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import TccError
from tcc_sim.recording.reader import open_run
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve


@pytest.fixture(autouse=True)
def domain_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands take a domain."""
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)


def test_demo_records_analyses_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    pytest.importorskip("matplotlib")
    # At a pace that waits for the recorder: a busy machine loses messages in real time.
    (tmp_path / "minimal.yaml").write_text(load_scene("minimal").with_values({"real_time_factor": 0.0}).text())
    ended = python("-m", "tcc_sim", "demo", "--scene", "minimal.yaml", "--duration", "0.5", "--out", "made",
                   cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert without_compiling(ended.stderr) == ""
    made = tmp_path / "made"
    assert sorted(p.name for p in made.iterdir()) == ["analysis.json", "overview.png", "recording", "run.rrd"]
    found = valid("analyse", json.loads((made / "analysis.json").read_text()))
    assert (found["lost_messages"], found["complete"], found["gaps"]) == (0, True, 0)
    assert found["messages"] > 300
    # The settled cycles are those of the scene, solved by SciPy.
    first = found["discarded"]
    reference = solve(load_scene("minimal").system, cycles=first + 5, solver="lsoda", rtol=1e-9).raise_for_status()
    assert reference.cycles is not None
    assert found["max_slip_speed"] == pytest.approx(reference.cycles.highest[first:].max(), rel=1e-3)
    assert (made / "overview.png").stat().st_size > 50_000
    assert main(["analyse", str(made / "recording"), "--verify", "--json", str(tmp_path / "verified.json")]) == 0
    verified = json.loads((tmp_path / "verified.json").read_text())
    assert (verified["verified"], verified["largest_difference"]) == (True, 0.0)
    assert main(["demo", "--out", str(made)]) == 2
    assert capsys.readouterr().err == f"tcc-sim: {made} exists; name a directory that does not\n"


OWN_CONTROLLER = """
import signal

import rclpy
from sensor_msgs.msg import FluidPressure, JointState

signal.signal(signal.SIGINT, signal.SIG_DFL)
with rclpy.init():
    node = rclpy.create_node("own")
    command = node.create_publisher(FluidPressure, "actuation_pressure", 100)
    def answer(state):
        message = FluidPressure(fluid_pressure=123456.0)
        message.header.stamp = state.header.stamp
        command.publish(message)
    node.create_subscription(JointState, "joint_states", answer, 100)
    try:
        rclpy.spin(node)
    except Exception:
        if rclpy.ok():
            raise
"""


def test_demo_starts_a_controller_of_the_users_and_stopped_by_ctrl_c_keeps_what_it_has(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN_CONTROLLER)
    recording = tmp_path / "made" / "recording"

    def enough() -> bool:
        """Whether a command and 0.5 s of simulated time are on disk: then there are whole engine cycles to analyse."""
        try:
            found = tcc_sim.read(recording)
            return "actuation_pressure" in found.commands and found.runs[0].samples > 500
        except TccError:
            return False

    process = subprocess.Popen(
        [sys.executable, "-m", "tcc_sim", "demo", "--controller", f"{sys.executable} own.py", "--duration", "600",
         "--out", "made"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(PYTHONUNBUFFERED="1"))
    try:
        assert process.stdout is not None
        lines = [process.stdout.readline()]
        while "recording" not in lines[-1]:
            lines.append(process.stdout.readline())
        until_or_ended(enough, process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "controller: " in "".join(lines)
    assert "stopped early" in out
    found = json.loads((tmp_path / "made" / "analysis.json").read_text())
    assert found["scene"]["pressure.source"] == "topic"
    pressures = tcc_sim.read(recording).commands["actuation_pressure"]
    assert {float(value) for value in pressures.value} == {123456.0}


@pytest.mark.parametrize(("words", "sentence"), [
    (["--controller", "no_such_program"], "there is no program 'no_such_program'"),
    (["--controller", "python '"], "no closing quotation"),
    (["--controller", sys.executable, "--scene", "fig02"], "scene fig02 takes no commands"),
])
def test_a_controller_that_cannot_run_is_refused_before_anything_starts(words: list[str], sentence: str, tmp_path: Path,
                                                                        refused: Callable[..., str]) -> None:
    assert sentence in refused("demo", "--out", tmp_path / "made", *words)
    assert not (tmp_path / "made").exists()


def test_demo_names_the_last_words_of_a_controller_that_ends(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("raise SystemExit('no such sensor')")
    ended = python("-m", "tcc_sim", "demo", "--controller", f"{sys.executable} own.py", "--out", "made", cwd=tmp_path)
    assert ended.returncode == 1
    assert "own.py ended with status 1: no such sensor" in ended.stderr


def test_a_killed_command_leaves_no_node_behind(tmp_path: Path) -> None:
    code = ("import sys; from pathlib import Path; from tcc_sim.nodes.children import Session\n"
            "session = Session(Path('recording'), {'scene': 'minimal'})\n"
            "print(session.driveline.pid, session.recorder.pid, flush=True); sys.stdin.read()")
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, env=environment())
    assert process.stdout is not None
    nodes = [int(word) for word in process.stdout.readline().split()]
    assert len(nodes) == 2
    process.kill()
    process.wait()
    for pid in nodes:
        while Path(f"/proc/{pid}/stat").exists() and Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z":
            os.sched_yield()
    assert open_run(tmp_path / "recording").scene_text is not None


def test_realtime_gives_every_figure(tmp_path: Path) -> None:
    ended = python("-m", "tcc_sim", "realtime", "--rate", "500", "--duration", "1", "--json", "pacing.json",
                   cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    found = valid("realtime", json.loads((tmp_path / "pacing.json").read_text()))
    names = {"lateness_p50_s", "lateness_p99_s", "lateness_max_s", "cpu_fraction"}
    about = {"format", "version", "scene", "command", "units"}
    assert set(found) - about == {"rate", "ticks", "missed_ticks", "drift_s", "settings", *names,
                                  *(f"bare_{n}" for n in names)}
    assert [trial["name"].split()[0] for trial in found["settings"]] == ["nothing", "timer", *["slack,"] * 4, "all"]
    assert all(names | {"name", "refused"} == set(trial) for trial in found["settings"])
    assert found["settings"][0]["refused"] == found["settings"][1]["refused"] == []
    assert found["rate"] == 500.0
    assert found["ticks"] > 0


def test_soak_counts_what_is_lost(tmp_path: Path) -> None:
    ended = python("-m", "tcc_sim", "soak", "--rate", "500", "--duration", "3", "--json", "soak.json", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    found = valid("soak", json.loads((tmp_path / "soak.json").read_text()))
    assert found["lost_messages"] == 0
    assert found["complete"]
    assert found["messages"]["/joint_states"] > 50
    assert found["messages"]["/engine_torque"] > 0
    assert {"memory_growth_bytes", "cpu_fraction"} <= set(found["driveline"]) & set(found["recorder"])
