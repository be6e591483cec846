"""`tcc-sim control` and `tcc-sim watch` beside a driveline process."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from benches import joined
from interpreter import environment, rerun_rows
from waiting import until, until_or_ended

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.context import Context
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError, RecordingError
from tcc_sim.nodes.children import CLOCK_STARTED, NodeProcess
from tcc_sim.nodes.middleware import COMMANDS
from tcc_sim.recording.reader import Run

Control = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def context(domain: str, discovery: Callable[[str], str]) -> Iterator[Context]:
    """A context in the domain of this module's processes, whose environment the test process has too."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("FASTDDS_DEFAULT_PROFILES_FILE", discovery("")), ("ROS_DOMAIN_ID", domain),
                            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")):
            patch.setenv(name, value)
        context = joined()
        yield context
        context.try_shutdown()


@pytest.fixture
def control(context: Context, capsys: pytest.CaptureFixture[str]) -> Control:
    """Function that runs `tcc-sim control` and returns status, output and messages."""
    def run(*words: str) -> tuple[int, str, str]:
        status = main(["control", *words])
        return (status, *capsys.readouterr())

    return run


@pytest.fixture(scope="module")
def driveline(context: Context) -> Iterator[NodeProcess]:
    """The driveline of all tests, which holds the last commands; ten states in a period of excitation."""
    node = NodeProcess("driveline", {"scene": "commands", "rate": 50.0, "engine.frequency": 30.0,
                                     "command_timeout": 0.0}, dict(os.environ))
    node.await_line(CLOCK_STARTED)
    yield node
    assert node.stop() == 0


def recorded(bag: Path) -> int:
    """Number of states that can be read now."""
    try:
        return sum(map(len, Run(bag).columns().runs))
    except RecordingError:
        return 0


def test_a_command_acts_and_the_recording_gives_the_same_run(control: Control, driveline: NodeProcess,
                                                             tmp_path: Path) -> None:
    recorder = NodeProcess("recorder", {"output": str(tmp_path / "run")}, dict(os.environ))
    try:
        until_or_ended(lambda: recorded(tmp_path / "run") > 0, recorder)
        assert control("reset")[0] == 0
        status, out, _ = control("pressure", "230000")
        assert status == 0
        assert "actuation_pressure 230000 Pa" in out
        seen = recorded(tmp_path / "run")
        until_or_ended(lambda: recorded(tmp_path / "run") > seen + 50, recorder)
    finally:
        assert recorder.stop() == 0
    (*_, last) = Run(tmp_path / "run").columns().runs
    assert set(last.of("applied_pressure")[-40:].tolist()) == {230000.0}
    assert tcc_sim.analyse(tmp_path / "run", verify=True, discard=0).verification.verified


def test_services_parameters_and_commands_answer_with_what_they_did(control: Control, driveline: NodeProcess) -> None:
    assert control("step")[0] == 1
    assert control("pause") == (0, "paused\n", "")
    assert control("reset")[0] == 0
    assert control("step") == (0, "at tick 1\n", "")
    status, out, _ = control("torque", "-60")
    assert (status, "-60 N m" in out, "paused" in out) == (0, True, True)
    assert control("resume") == (0, "running\n", "")
    assert control("set", "engine.mean_torque=2.5e2", "pressure.phase=1")[0] == 0
    status, out, _ = control("get", "scene", "engine.mean_torque", "rate", "friction.law", "pressure.phase",
                             "engine.harmonic_amplitudes")
    assert out.splitlines() == ["scene commands", "engine.mean_torque 250.0 N m", "rate 50.0 Hz",
                                "friction.law smoothed", "pressure.phase 1.0 rad", "engine.harmonic_amplitudes [] N m"]
    status, out, _ = control("pressure", "1.2")
    assert (status, "1.2 bar would be 120000" in out) == (0, True)
    driveline.check()


@pytest.mark.parametrize(("words", "parts"), [
    (["set", "friction.static_coefficient=0.01"], ["friction.kinetic_coefficient", "0.24", "0.0005 to 0.2"]),
    (["set", "pressure.mean=.nan"], ["pressure.mean", "nan", "0 to 1e+07 Pa"]),
    (["set", "real_time_factor=-1.5"], ["real_time_factor", "-1.5", "0 to 1000"]),
    (["set", "friction.coefficients=x"], ["friction.coefficients", "'x'", "1e-06 to 2"]),
    (["set", "friction.coefficients[2]=0.1"], ["friction.coefficients[2]", "empty"]),
    (["set", "driveline.stiffness=3"], ["driveline.stiffness:=3"]),
    (["get", "engine.harmonic_phases[1]"], ["engine.harmonic_phases[1]", "empty"]),
    (["torque", "inf"], ["engine_torque", "inf N m", "-100000 to 100000 N m"]),
    (["pressure", "1e7"], ["actuation_pressure", "1e+07 Pa", "sub-steps"]), (["torque", "much"], ["much"]),
    (["set", "engine.mean_torqe=1"], ["engine.mean_torque"]), (["fly"], ["fly"]),
    (["reset", "--namespace", "no name"], ["no name"])])
def test_a_refusal_is_one_line_with_name_value_and_range(control: Control, driveline: NodeProcess, words: list[str],
                                                         parts: list[str]) -> None:
    status, out, errors = control(*words)
    assert (status, out, errors.count("\n")) == (2, "", 1)
    assert [part for part in parts if part not in errors] == []


def test_a_domain_that_is_no_number_is_refused_as_such(control: Control, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    status, _, errors = control("reset")
    assert (status, "ROS_DOMAIN_ID" in errors, "namespace" in errors, errors.count("\n")) == (2, True, False, 1)


def test_an_input_of_the_scene_takes_no_command_and_lock_step_takes_one_as_the_answer(bench) -> None:
    loop = bench.driveline(scene="controlled", pacing="lockstep", command_timeout=0.0).loop
    loop.begin()
    with pytest.raises(InputError, match=r"engine_torque.*actuation_pressure"):
        loop.command({"engine_torque": 1.0, "actuation_pressure": 2e5})
    assert loop.inputs["actuation_pressure"].received == 0
    loop.command({"actuation_pressure": 2e5})
    assert loop.waits_for == []
    loop.step()
    assert loop.plant.reading().applied_pressure == 2e5


def test_other_publishers_and_other_drivelines_are_named(control: Control, driveline: NodeProcess,
                                                         context: Context) -> None:
    """The driveline, and each command, has to discover the other publisher and the other node before it can name them.
    """
    other = rclpy.create_node("driveline", context=context, start_parameter_services=False)
    other.create_publisher(Float64, "engine_torque", COMMANDS)

    def named() -> bool:
        status, out, _ = control("torque", "310")
        assert status == 0
        return "1 publisher on /engine_torque" in out and "2 nodes have the name /driveline" in out

    until(named)
    other.destroy_node()
    status, _, errors = control("--namespace", "/left", "reset")
    assert (status, "/left/driveline" in errors, "use --namespace" in errors) == (1, True, True)


def test_a_command_that_is_sent_again_and_again_says_so_until_it_is_interrupted(driveline: NodeProcess) -> None:
    process = subprocess.Popen([sys.executable, "-m", "tcc_sim", "control", "torque", "310", "--rate", "20"], text=True,
                               stdout=subprocess.PIPE, env=environment())
    assert process.stdout is not None
    assert "20 times a second" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert (process.communicate(timeout=60)[0].count("\n"), process.returncode) == (1, 0)


def test_watch_shows_states_commands_and_their_sources_until_ctrl_c(control: Control, driveline: NodeProcess,
                                                                    tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    assert control("reset")[0] == 0  # To the scene's own pressure, which pulsates.
    file = tmp_path / "live.rrd"
    process = subprocess.Popen([sys.executable, "-m", "tcc_sim", "watch", "--rrd", str(file)], text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment())
    assert process.stderr is not None
    assert "/driveline" in process.stderr.readline()
    for words in (("torque", "310"), ("pressure", "210000"), ("pressure", "220000")):
        assert control(*words)[0] == 0
    wanted = {"/pressure/command": 3, "/torque/engine_command": 2, "/pressure/applied": 11, "/events": 2,
              "/cycles/largest": 2, "/summary": 2, "/slip/speed": 12}  # A row of each entity says how it looks.

    looked_at = 0

    def shows_all() -> bool:
        nonlocal looked_at
        if not file.exists() or file.stat().st_size <= 1.2 * looked_at:
            return False
        looked_at = file.stat().st_size
        rows = rerun_rows(file)
        return all(rows.get(name, 0) >= count for name, count in wanted.items())

    until_or_ended(shows_all, process)
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    rows = rerun_rows(file)
    shown = int(re.match(r"(\d+) states shown", out)[1])  # type: ignore[index]
    assert rows["/slip/speed"] - 1 == shown


def test_watch_without_a_driveline_ends_with_one_line_and_no_file(tmp_path: Path, context: Context,
                                                                  capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    assert main(["watch", "--namespace", "/nobody", "--rrd", str(tmp_path / "none.rrd")]) == 1
    out, errors = capsys.readouterr()
    assert (out, errors.count("\n"), "/nobody/scene" in errors) == ("", 1, True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("pacing", ["real_time", "lockstep"])
def test_commands_of_joints_act_as_those_of_the_topics(bench: Any, pacing: str) -> None:
    """As joint_state_topic_hardware_interface of ros2_control sends them: names and efforts."""
    loop = bench.driveline(scene="commands", pacing=pacing, command_timeout=0.0).loop
    publisher = bench.probe.create_publisher(JointState, "command", 10)
    bench.until(publisher.get_subscription_count)
    loop.begin()
    sent = [(["flywheel", "clutch"], [120.0, 2e5]), (["clutch", "arm"], [1.5e5, 7.0]), (["flywheel"], [float("nan")]),
            (["clutch"], [-1.0])]
    publisher.publish(b"no message")
    for names, efforts in sent:
        publisher.publish(JointState(name=names, effort=efforts))
    torque, pressure = loop.commands
    bench.until(lambda: (loop.step(), pressure.refused == 2)[1])
    assert (torque.value, torque.received, torque.refused, "command" in torque.refusal) == (120.0, 1, 1, True)
    assert (pressure.value, pressure.received, pressure.refused) == (1.5e5, 2, 2)
    reading = loop.plant.reading()
    assert (reading.engine_torque, reading.applied_pressure) == (120.0, 1.5e5)


def test_in_lock_step_a_command_of_joints_answers_the_state_of_its_stamp(bench: Any) -> None:
    node = bench.driveline(scene="commands", pacing="lockstep", command_timeout=0.0, wait_for_subscribers=1)
    publisher = bench.probe.create_publisher(JointState, "command", 10)

    def answer(state: JointState) -> None:
        heard.append(state)
        message = JointState(name=["flywheel", "clutch"], effort=[100.0, 1e5 + state.header.stamp.nanosec / 1e6])
        for message.header.stamp.sec, message.header.stamp.nanosec in ((9, 0), (0, state.header.stamp.nanosec)):
            publisher.publish(message)

    heard: list[JointState] = []
    bench.probe.create_subscription(JointState, "joint_states", answer, 1000)
    node.start()
    bench.until(lambda: len(heard) > 60)
    node.loop.stop()
    assert {state.effort[0] for state in heard[1:]} == {100.0}
    assert node.loop.inputs["actuation_pressure"].received >= 60
    assert node.loop.inputs["actuation_pressure"].refused >= 60  # Those of another state.
