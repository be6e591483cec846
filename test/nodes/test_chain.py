"""The commands that run real nodes in separate processes: demo and realtime."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from documents import valid

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from interpreter import environment, python, without_compiling
from waiting import until_or_ended

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import TccError
from tcc_sim.recording.reader import Run
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve


@pytest.fixture(autouse=True)
def domain_of_its_own(monkeypatch: pytest.MonkeyPatch, discovery: Callable[[str], str]) -> None:
    """Let commands take a domain, with quick discovery."""
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", discovery(""))
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)


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


def test_demo_records_a_controller_of_the_users_in_lock_step_until_ctrl_c_analyses_and_draws(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Ctrl-C comes once 0.5 s of simulated time are recorded: then there are whole engine cycles to analyse."""
    pytest.importorskip("rerun")
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN_CONTROLLER)
    scene = load_scene("controlled").with_values({"pacing": "lockstep", "real_time_factor": 0.0})
    Path("controlled.yaml").write_text(scene.text())
    made = tmp_path / "made"
    process = subprocess.Popen(
        [sys.executable, "-m", "tcc_sim", "demo", "--controller", f"{sys.executable} own.py", "--scene",
         "controlled.yaml", "--duration", "600", "--out", "made"], text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env=environment())

    def enough() -> bool:
        with suppress(TccError):
            return tcc_sim.read(made / "recording").runs[0].samples > 500
        return False

    until_or_ended(enough, process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, without_compiling(err)) == (0, "")
    assert "controller: " in out
    assert "stopped early" in out
    assert sorted(p.name for p in made.iterdir()) == ["analysis.json", "overview.png", "recording", "run.rrd"]
    document = valid("analyse", json.loads((made / "analysis.json").read_text()))
    assert (document["lost_messages"], document["complete"], document["gaps"]) == (0, True, 0)
    assert document["messages"] > 500
    recording = tcc_sim.read(made / "recording")
    assert set(recording.commands["actuation_pressure"].value.tolist()) == {123456.0}
    # The settled cycles are those of the scene with this pressure, solved by SciPy.
    first = document["discarded"]
    held = scene.with_values({"pressure.source": "harmonic", "pressure.mean": 123456.0, "pressure.amplitude": 0.0})
    reference = solve(held.system, cycles=first + 3, solver="lsoda", rtol=1e-5).raise_for_status()
    assert reference.cycles is not None
    assert document["max_slip_speed"] == pytest.approx(reference.cycles.highest[first:].max(), rel=1e-3)
    assert main(["analyse", str(made / "recording"), "--verify", "--json", "verified.json"]) == 0
    verified = json.loads(Path("verified.json").read_text())
    assert (verified["verified"], verified["largest_difference"]) == (True, 0.0)
    capsys.readouterr()
    assert main(["demo", "--out", str(made)]) == 2
    assert str(made) in capsys.readouterr().err


@pytest.mark.parametrize(("words", "sentence"), [
    (["--controller", "no_such_program"], "there is no program 'no_such_program'"),
    (["--controller", "python '"], "no closing quotation"),
    (["--controller", sys.executable, "--scene", "fig02"], "scene fig02 takes no commands"),
])
def test_a_controller_that_cannot_run_is_refused_before_anything_starts(words: list[str], sentence: str, tmp_path: Path,
                                                                        refused: Callable[..., str]) -> None:
    assert sentence in refused("demo", "--out", tmp_path / "made", *words)
    assert not (tmp_path / "made").exists()


def test_demo_names_the_last_words_of_a_controller_that_ends(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("raise SystemExit('no such sensor')")
    assert main(["demo", "--controller", f"{sys.executable} own.py", "--out", "made"]) == 1
    assert "own.py ended with status 1: no such sensor" in capsys.readouterr().err


def test_a_killed_command_leaves_no_node_of_its_real_time_session_behind(tmp_path: Path) -> None:
    code = ("import os, sys; from pathlib import Path; from tcc_sim.nodes.children import Session, grants_priority\n"
            "session = Session(Path('recording'), {'scene': 'commands'}, ('commander', {}), real_time=True)\n"
            "nodes = [session.driveline, session.recorder, *session.controllers]\n"
            "threads = [map(int, os.listdir(f'/proc/{node.pid}/task')) for node in nodes]\n"
            "policies = (max(os.sched_getscheduler(k) % os.SCHED_RESET_ON_FORK for k in each) for each in threads)\n"
            "print(int(grants_priority()), *(node.pid for node in nodes), *policies, flush=True); sys.stdin.read()")
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, env=environment())
    assert process.stdout is not None
    granted, *numbers = (int(word) for word in process.stdout.readline().split())
    nodes, policies = numbers[:3], numbers[3:]
    assert policies == [os.SCHED_FIFO if granted else os.SCHED_OTHER] * 3
    process.kill()
    process.wait()
    for pid in nodes:
        while Path(f"/proc/{pid}/stat").exists() and Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z":
            os.sched_yield()
    assert Run(tmp_path / "recording").scene_text is not None


def test_realtime_gives_every_figure(tmp_path: Path) -> None:
    core = min(os.sched_getaffinity(0))
    ended = python("-m", "tcc_sim", "realtime", "--rate", "500", "--duration", "0.5", "--json", "pacing.json",
                   "--cpu-affinity", str(core), cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    document = valid("realtime", json.loads((tmp_path / "pacing.json").read_text()))
    assert [trial["name"].split()[0] for trial in document["settings"]] == ["nothing", "timer", *["slack,"] * 4, "all"]
    assert document["settings"][0]["refused"] == document["settings"][1]["refused"] == []
    assert (document["rate"], document["scene"]["cpu_affinity"]) == (500.0, [core])
    assert 0.0 <= document["late_share"] <= 1.0
    assert document["ticks"] > 0
