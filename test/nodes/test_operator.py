"""`tcc-sim control` and `tcc-sim watch` beside a driveline process."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from benches import joined
from interpreter import environment, rerun_rows
from waiting import until_or_ended

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.context import Context
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError, RecordingError, TccError
from tcc_sim.messages import cdr
from tcc_sim.nodes.children import CLOCK_STARTED, ChildProcess, NodeProcess
from tcc_sim.nodes.middleware import COMMANDS
from tcc_sim.nodes.operator import (
    COMMANDS_OF,
    COUNTED_WITHIN,
    DISCOVERY_LIMIT,
    HEARD_WITHIN,
    LISTENED_FOR,
    MET_WITHIN,
    NAMED_WITHIN,
    SETTLED,
    Operator,
    all_met,
)
from tcc_sim.recording.reader import open_run
from tcc_sim.topics import topic
from tcc_sim.views.rerun_layout import signals as entities

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
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


@pytest.fixture
def quick(control: Control, context: Context, monkeypatch: pytest.MonkeyPatch) -> Control:
    """The same without the time to find other nodes."""
    @contextmanager
    def known(name: str, namespace: str) -> Iterator[Any]:
        node = rclpy.create_node(name, context=context, namespace=namespace, enable_rosout=False)
        try:
            yield node
        finally:
            node.destroy_node()

    monkeypatch.setattr("tcc_sim.nodes.operator.node_of_command", known)
    monkeypatch.setattr("tcc_sim.nodes.operator.NAMED_WITHIN", 0.0)
    monkeypatch.setattr("tcc_sim.nodes.operator.SETTLED", 0.02)
    return control


OFTEN = """
from tcc_sim.nodes import signals
signals.take()
from tcc_sim.nodes import driveline, executables
driveline.DIAGNOSTICS_PERIOD = 0.05
executables.driveline_node()
"""
"""Program of a driveline whose diagnostics come twenty times a second: a command waits for them."""


@pytest.fixture(scope="module")
def begun(context: Context) -> Iterator[ChildProcess]:
    """The driveline of all tests, which holds the last commands; ten states in a period of excitation."""
    node = ChildProcess("driveline", [sys.executable, "-c", OFTEN, "--ros-args", *(
        word for value in ("scene:=commands", "rate:=50.0", "engine.frequency:=30.0", "command_timeout:=0.0")
        for word in ("-p", value))], dict(os.environ))
    yield node
    node.await_line(CLOCK_STARTED)  # A signal before the program takes signals may be lost.
    assert node.stop() == 0


@pytest.fixture(scope="module")
def driveline(begun: ChildProcess) -> ChildProcess:
    """The same when it runs."""
    begun.await_line(CLOCK_STARTED)
    return begun


def recorded(bag: Path) -> int:
    """Number of states that can be read now."""
    try:
        return sum(map(len, open_run(bag).states()))
    except RecordingError:
        return 0


def test_a_single_command_is_in_the_recording(control: Control, begun: ChildProcess, tmp_path: Path,
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with the slow discovery of Fast DDS's own settings."""
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE")
    recorder = NodeProcess("recorder", {"output": str(tmp_path / "run")}, dict(os.environ))
    try:
        until_or_ended(lambda: recorded(tmp_path / "run") > 0, recorder)
        assert control("pressure", "230000")[0] == 0
    finally:
        assert recorder.stop() == 0
    result = tcc_sim.read(tmp_path / "run")
    assert {name: command.value.tolist() for name, command in result.commands.items()} == {
        "actuation_pressure": [230000.0]}


def test_it_does_what_the_ros2_commands_do_and_refusals_are_the_nodes_own(quick: Control,
                                                                          driveline: ChildProcess) -> None:
    status, _, said = quick("step")
    assert (status, said) == (1, "tcc-sim: the driveline refuses: not paused\n")
    assert quick("pause") == (0, "paused\n", "")
    assert quick("reset") == (0, "at the initial state, simulation time 0\n", "")
    assert quick("step") == (0, "at tick 1\n", "")
    assert quick("resume") == (0, "running\n", "")
    assert quick("set", "engine.mean_torque=2.5e2", "pressure.phase=1") == (
        0, "engine.mean_torque 2.5e2, pressure.phase 1\n", "")
    status, _, said = quick("set", "friction.static_coefficient=0.01")
    assert (status, said) == (2, "tcc-sim: friction.kinetic_coefficient is 0.24; it must be 0.0005 to 0.2, one "
                                 "twentieth to twenty times friction.static_coefficient\n")
    for words, reason in {
            ("set", "pressure.mean=.nan"): "pressure.mean is nan Pa; it must be 0 to 1e+07 Pa",
            ("set", "real_time_factor=-1.5"): "real_time_factor is -1.5; it must be 0 to 1000",
            ("set", "friction.coefficients=x"):
                "friction.coefficients is 'x'; it must be a list of numbers, each 1e-06 to 2",
            ("set", "friction.coefficients[2]=0.1"):
                "friction.coefficients[2] does not exist: friction.coefficients is empty; give the whole list first",
            ("get", "rate", "engine.harmonic_phases[1]"):
                "engine.harmonic_phases[1] does not exist: engine.harmonic_phases is empty; give the whole list first",
            ("set", "friction.slip_speeds=[0,5,50]", "friction.coefficients=[0.12,0.125,0.126]"):
                "friction.slip_speeds: a running driveline can change a friction table, but cannot add or remove one; "
                "restart the driveline",
            ("torque", "inf"): "engine_torque command of inf N m refused; it must be -100000 to 100000 N m"}.items():
        assert quick(*words) == (2, "", f"tcc-sim: {reason}\n")
    status, _, said = quick("set", "driveline.stiffness=3")
    assert (status, said) == (2, "tcc-sim: driveline.stiffness cannot change while the driveline runs: start it again "
                                 "with --ros-args -p driveline.stiffness:=3, or with a parameter file\n")
    assert quick("get", "scene", "engine.mean_torque", "rate", "friction.law", "engine.harmonic_amplitudes") == (
        0, "scene commands\nengine.mean_torque 250.0 N m\nrate 50.0 Hz\nfriction.law smoothed\n"
           "engine.harmonic_amplitudes [] N m\n", "")
    status, out, _ = quick("torque", "-50")
    assert (status, out) == (0, "engine_torque -50 N m, held until the next command\n")
    status, out, _ = quick("pressure", "1.2")
    assert (status, out) == (0, "actuation_pressure 1.2 Pa, held until the next command; the unit is Pa: 1.2 bar "
                                "would be 120000\n")
    status, _, said = quick("pressure", "1e7")
    assert status == 2
    assert said.startswith("tcc-sim: actuation_pressure command of 1e+07 Pa refused: a ")
    assert "sub-steps" in said
    assert said.count("\n") == 1
    driveline.check()
    quick("pause")
    status, out, _ = quick("torque", "-60")
    assert (status, out) == (0, "engine_torque -60 N m, held until the next command, once the driveline goes on: it is "
                                "paused\n")
    assert quick("resume") == (0, "running\n", "")


@pytest.mark.parametrize(("after", "word"), [
    ([], ""), ([(1, 4, "slip")], ""), ([(2, 4, "slip")], "refused"),
    ([(1, 4, "slip")] * 20 + [(1, 5, "slip")], "applied"),
    ([(1, 4, "paused")], ""), ([(1, 4, "paused")] * 2, "waits"), ([(1, 4, "waiting")] * 2, "waits"),
    ([(1, 4, "paused"), (2, 4, "paused")], "refused")])
def test_a_command_is_judged_by_what_the_driveline_counts_and_not_by_the_time_that_it_takes(
        after: list[tuple[int, int, str]], word: str) -> None:
    statuses = [{"engine_torque refused": str(refused), "engine_torque received": str(received), "regime": regime}
                for refused, received, regime in ((1, 4, "slip"), *after)]
    assert Operator._counted("engine_torque", statuses, 1) == word


def test_other_publishers_and_other_drivelines_are_named(quick: Control, driveline: ChildProcess,
                                                         context: Context) -> None:
    other = rclpy.create_node("driveline", context=context, start_parameter_services=False)
    other.create_publisher(Float64, "engine_torque", COMMANDS)
    status, out, _ = quick("torque", "310")
    assert status == 0
    assert "; 1 other publisher on /engine_torque: the newest command counts; 2 nodes have the name /drivel" in out
    assert quick("pause") == (
        0, "paused; 2 nodes have the name /driveline and received this: give them namespaces\n", "")
    other.destroy_node()
    assert quick("resume") == (0, "running\n", "")


def test_without_a_node_it_says_so(control: Control, domain: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tcc_sim.nodes.operator.DISCOVERY_LIMIT", 0.1)
    assert control("--namespace", "/left", "reset") == (
        1, "", f"tcc-sim: no driveline answers at /left/driveline within 0.1 s (ROS_DOMAIN_ID {domain})\n")


@pytest.mark.parametrize("words", [("fly",), ("set", "engine.mean_torqe=1"), ("set", "x"), ("torque", "much"),
                                   ("reset", "--namespace", "no name")])
def test_wrong_words_are_one_line_and_status_2(control: Control, words: tuple[str, ...]) -> None:
    status, out, said = control(*words)
    assert (status, out, said.count("\n")) == (2, "", 1)


def test_a_command_that_is_sent_again_and_again_says_so_until_it_is_interrupted(
        control: Control, driveline: ChildProcess) -> None:
    process = subprocess.Popen([sys.executable, "-m", "tcc_sim", "control", "torque", "310", "--rate", "20"], text=True,
                               stdout=subprocess.PIPE, env=environment())
    assert process.stdout is not None
    assert process.stdout.readline() == "sending engine_torque 310 N m 20 times a second; Ctrl-C ends it\n"
    process.send_signal(signal.SIGINT)
    assert (process.communicate(timeout=60)[0], process.returncode) == ("interrupted; no more commands are sent\n", 0)


STATIC = 1
"""Rows of an entity that say how it looks."""


def test_watch_shows_what_the_driveline_does_and_what_held_its_inputs_to_the_state_before_ctrl_c(
        quick: Control, driveline: ChildProcess, context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    """Ctrl-C comes between taking the last states and showing them."""
    pytest.importorskip("rerun")
    from tcc_sim.views.rerun_stream import RerunStream

    quick("reset")  # To the scene's own pressure, which pulsates.
    commander = rclpy.create_node("commander", context=context)
    sends = [(commander.create_publisher(Float64, "engine_torque", COMMANDS), Float64(data=310.0)),
             (commander.create_publisher(FluidPressure, "actuation_pressure", COMMANDS),
              FluidPressure(fluid_pressure=2.1e5))]
    samples, control, rows, given = RerunStream.samples, RerunStream.control, Counter[str](), []

    def shown(stream: RerunStream, stamps: Any, *columns: Any, **run: Any) -> None:
        rows["/slip/speed"] += len(stamps)
        if not sends and not rows["interrupts"] and "fallback" not in given[-1]:
            rows["interrupts"] += 1
            os.kill(os.getpid(), signal.SIGINT)
        elif rows["/control/mean"] and all(publisher.get_subscription_count() == 2 for publisher, _ in sends):
            for publisher, message in sends:
                publisher.publish(message)
            sends.clear()
        samples(stream, stamps, *columns, **run)

    def controlled(stream: RerunStream, signals: Any, events: Any) -> None:
        rows.update({f"/{entities()[name]}": len(stamps) for name, (stamps, _) in signals.items()})
        given.extend(event.text for event in events)
        control(stream, signals, events)

    monkeypatch.setattr(RerunStream, "samples", shown)
    monkeypatch.setattr(RerunStream, "control", controlled)
    monkeypatch.setattr("tcc_sim.nodes.watcher.FILE_PERIOD", 0.1)
    monkeypatch.setattr("tcc_sim.nodes.process._INTERRUPTED", threading.Event())
    assert main(["watch", "--rrd", str(tmp_path / "live.rrd")]) == 0
    commander.destroy_node()
    out, said = capsys.readouterr()
    states, missed = (int(word) for word in out.split() if word.isdigit())
    assert states == rows["/slip/speed"]
    # A watcher that misses states on a busy machine reports them.
    assert bool(missed) == ("missed " in said)
    assert said.startswith("watching /driveline: ")
    assert rows.pop("interrupts") == 1
    rows["/events"], result = 1 + len(given), rerun_rows(tmp_path / "live.rrd")
    assert {entity: result[entity] - STATIC * (entity != "/events") for entity in rows} == rows
    assert rows.keys() >= {"/torque/engine_command", "/pressure/command", "/pressure/applied", "/control/mean"}
    assert result["/cycles/largest"] > STATIC
    assert result["/summary"] > 1


@pytest.mark.parametrize("what", ["torque", "pressure"])
def test_states_of_another_robot_say_nothing_of_a_command(bench: Any, what: str) -> None:
    """Topics of these names are common; the newest message may be another robot's."""
    other: Any
    if what == "torque":
        name, kind, mine, other = "joint_states", JointState, cdr.joint_state(
            5, 0.0, 0.0, 0.0, 0.0, 250.0, 0.0), JointState(name=["arm"], position=[1.0])
    else:
        name, kind, mine, other = "applied_pressure", FluidPressure, cdr.fluid_pressure(5, 250.0), FluidPressure()
        other.header.frame_id, other.fluid_pressure = "hydraulics", 3.0
    publisher = bench.add(rclpy.create_node("others", context=bench.context)).create_publisher(kind, name, 10)
    operator = Operator(rclpy.create_node("operator", context=bench.context))
    applied = operator._applied(topic(COMMANDS_OF[what]).type)

    def said() -> float | None:
        publisher.publish(mine)
        publisher.publish(other)
        return applied()

    assert bench.until(said) == 250.0


class Asked:
    """An operator whose driveline is made up: what `command` gets to know, and what it does."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **given: Any) -> None:
        self.given = {"source": "topic", "timeout": 0.0, "counts": [], "after": [], "applied": None, "heard": [],
                      "known": 1, "connected": 1, "publishers": 1, "names": [], **given}
        self.sent: list[bytes] = []
        self.limits: list[float] = []
        self.acknowledged: list[int] = []
        self.statuses = [self.status(*counts) for counts in self.given["counts"]]
        publisher = SimpleNamespace(topic_name="/left/input", publish=self.sent.append,
                                    get_subscription_count=lambda: self.given["connected"],
                                    wait_for_all_acked=lambda limit: self.acknowledged.append(limit.nanoseconds))
        names = [("".join("driveline"), "/left"), ("rviz", "/right"), *self.given["names"]]
        self.operator: Any = Operator.__new__(Operator)
        self.operator._driveline = "/left/driveline"
        self.operator._node = SimpleNamespace(
            create_publisher=lambda *how: publisher, count_subscribers=lambda name: self.given["known"],
            count_publishers=lambda name: self.given["publishers"], get_node_names_and_namespaces=lambda: names)
        options = {f"{one}.source": "".join(self.given["source"]) for one in ("engine", "pressure")} | {
            "publish_diagnostics": bool(self.statuses), "command_timeout": self.given["timeout"]}
        for name, stub in {"_until": self.until, "_statuses": lambda published: self.statuses,
                           "_refusals": lambda name: self.given["heard"], "_applied": lambda kind: self.applied,
                           "values": lambda keys: options}.items():
            monkeypatch.setattr(self.operator, name, stub)

    def status(self, received: int, refused: int, regime: str = "slip", why: str = "") -> dict[str, str]:
        return {f"{name} {what}": value for name in COMMANDS_OF.values() for what, value in (
            ("received", str(received)), ("refused", str(refused)), ("listeners", "1"), ("last refusal", why))} | {
                "regime": regime}

    def applied(self) -> float | None:
        """The number in a state; never the same object as the command."""
        return None if self.given["applied"] is None else float(str(self.given["applied"]))

    def until(self, condition: Callable[[], Any], limit: float) -> Any:
        self.limits.append(limit)
        if self.sent and self.given["after"]:
            self.statuses += [self.status(*counts) for counts in self.given["after"]]
            self.given["after"] = []
        return condition()


HELD = "engine_torque 310 N m, held until the next command"
OTHER = "; this acted on /left/driveline, not on /driveline or /right/driveline"


@pytest.mark.parametrize(("given", "within", "said"), [
    ({"applied": 310.0}, HEARD_WITHIN, HELD),
    ({"applied": 310.0, "timeout": 0.25}, HEARD_WITHIN,
     "engine_torque 310 N m, held for 0.25 s of simulated time (command_timeout)"),
    ({"applied": 300.0}, HEARD_WITHIN, f"{HELD}; not seen applied within 1.5 s"),
    ({"applied": 300.0, "counts": [(4, 0)], "after": [(5, 0)]}, COUNTED_WITHIN, HELD),
    ({"applied": 300.0, "counts": [(4, 0)], "after": [(4, 0, "paused")] * 2}, COUNTED_WITHIN,
     f"{HELD}, once the driveline goes on: it is paused"),
    ({"counts": [(4, 0)], "after": [(4, 0)]}, COUNTED_WITHIN,
     TccError("/left/driveline has not taken the command within 30 s")),
    ({"counts": [(4, 1, "slip", "an earlier one")], "after": [(4, 2, "slip", "this one")]}, COUNTED_WITHIN,
     InputError("this one")),
    ({"heard": ["from the log"], "counts": [(4, 1)]}, COUNTED_WITHIN, InputError("from the log")),
    ({"counts": [(4, 0)], "after": [(5, 0)], "publishers": 2}, HEARD_WITHIN,
     f"{HELD}; not seen applied within 1.5 s; 1 other publisher on /left/input: the newest command counts"),
    ({"applied": 310.0, "publishers": 3}, HEARD_WITHIN,
     f"{HELD}; 2 other publishers on /left/input: the newest command counts"),
    ({"applied": 310.0, "names": [("driveline", "/right"), ("driveline", "/")]}, HEARD_WITHIN, HELD + OTHER),
    ({"applied": 310.0, "names": [("driveline", "/left")] * 2}, HEARD_WITHIN,
     f"{HELD}; 3 nodes have the name /left/driveline and received this: give them namespaces"),
    ({"connected": 0}, None, TccError("the driveline runs, but nothing subscribes to /left/input")),
    ({"source": "harmonic"}, None, InputError("engine_torque: the driveline takes this input from its scene "
                                              "(engine.source: harmonic)"))])
def test_a_command_is_told_with_its_effect_its_duration_and_who_else_is_there(
        monkeypatch: pytest.MonkeyPatch, given: dict[str, Any], within: float | None,
        said: str | Exception) -> None:
    asked = Asked(monkeypatch, **given)
    if isinstance(said, str):
        assert asked.operator.command("torque", 310.0) == said
        assert asked.limits == [DISCOVERY_LIMIT, LISTENED_FOR, MET_WITHIN, within, NAMED_WITHIN]
        assert asked.acknowledged == [round(1e9 * HEARD_WITHIN)]
    else:
        with pytest.raises(type(said), match=f"^{re.escape(str(said))}$"):
            asked.operator.command("torque", 310.0)
        assert within is None or within == asked.limits[-1]
    assert asked.sent == [cdr.float64(310.0)] * (within is not None)


def test_a_command_is_sent_until_a_refusal_or_once_and_a_pressure_in_bar_is_doubted(
        monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    asked = Asked(monkeypatch, applied=1.2)
    assert asked.operator.command("pressure", 1.2, tell=told.append) == (
        "actuation_pressure 1.2 Pa, held until the next command; the unit is Pa: 1.2 bar would be 120000")
    assert (asked.sent, told) == ([cdr.fluid_pressure(0, 1.2)], [])
    asked = Asked(monkeypatch, applied=310.0)

    def tell(sentence: str) -> None:
        told.append(sentence)
        monkeypatch.setattr(asked.operator, "_until", lambda condition, limit: (
            asked.limits.append(limit), len(asked.sent) == 4 and asked.given["heard"].append("refused")))

    with pytest.raises(InputError, match=r"^refused$"):
        asked.operator.command("torque", 310.0, 20.0, tell)
    assert told == ["sending engine_torque 310 N m 20 times a second; Ctrl-C ends it"]
    assert (asked.sent, asked.limits[-3:]) == ([cdr.float64(310.0)] * 4, [0.05] * 3)


def test_refusals_and_statuses_are_those_of_this_driveline_from_now_on(monkeypatch: pytest.MonkeyPatch) -> None:
    callbacks: list[Callable[[Any], None]] = []
    asked: Any = Operator.__new__(Operator)
    asked._node = SimpleNamespace(create_subscription=lambda kind, topic, callback, qos: callbacks.append(callback))
    asked._driveline = "/left/driveline"
    monkeypatch.setattr("tcc_sim.nodes.operator.time.time_ns", lambda: 7_000_000_005)
    heard = asked._refusals("engine_torque")
    for sec, nanosec, name, text in ((7, 4, "left.driveline", "engine_torque command A (1 so far)"),
                                     (6, 999_999_999, "left.driveline", "engine_torque command B (1 so far)"),
                                     (7, 5, "left.driveline", "engine_torque command C (D) (2 so far)"),
                                     (8, 0, "right.driveline", "engine_torque command E (1 so far)"),
                                     (8, 0, "left.driveline", "no engine_torque command (1 so far)"),
                                     (8, 0, "left.driveline", "engine_torque command F (3 so far)")):
        callbacks[0](SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), name=name, msg=text))
    assert heard == ["engine_torque command C (D)", "engine_torque command F"]
    limits: list[float] = []
    monkeypatch.setattr(asked, "_until", lambda condition, limit: limits.append(limit))
    assert asked._statuses(False) == asked._statuses(True) == []
    assert limits == [DISCOVERY_LIMIT]
    statuses = asked._statuses(False)
    callbacks[-1](SimpleNamespace(status=[SimpleNamespace(name=f"/{side}/driveline: driveline", values=[
        SimpleNamespace(key="side", value=side)]) for side in ("right", "left")]))
    assert statuses == [{"side": "left"}]


def test_what_is_awaited_comes_or_its_time_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    now, spun = [5.0], []
    monkeypatch.setattr("tcc_sim.nodes.operator.time.monotonic", lambda: now[0])

    def once(seconds: float) -> None:
        spun.append(seconds)
        now[0] += 0.0625

    asked: Any = Operator.__new__(Operator)
    asked._spinner = SimpleNamespace(once=once)
    assert asked._until(lambda: "there", 0.0) == "there"
    assert asked._until(lambda: now[0] > 5.1 and "late", 1.0) == "late"
    assert spun == [0.05] * 2
    assert asked._until(lambda: "", 0.09375) is False
    assert spun[2:] == [0.05, 0.03125]
    asked._driveline, asked._clients = "/left/driveline", {}
    asked._node = SimpleNamespace(
        create_client=lambda kind, name: SimpleNamespace(service_is_ready=lambda: name.endswith("/reset"),
                                                         call_async=lambda request: SimpleNamespace(done=bool)),
        get_node_names_and_namespaces=lambda: [("driveline", "/right"), ("driveline", "/"), ("other", "/")])
    monkeypatch.setenv("ROS_DOMAIN_ID", "17")
    for name, said in (("step", "no driveline answers at /left/driveline within 4 s (ROS_DOMAIN_ID 17); there is "
                                "/driveline and /right/driveline: use --namespace"),
                       ("reset", "/left/driveline does not answer within 4 s")):
        with pytest.raises(TccError, match=f"^{re.escape(said)}$"):
            asked._call(None, name, None)


def test_a_command_waits_until_all_who_listen_are_connected_and_nobody_more_comes() -> None:
    times = iter([0.0, 0.0, 0.0, 0.9, 0.95, 0.95, 0.94 + SETTLED, 0.96 + SETTLED, 0.97 + SETTLED, 0.97 + SETTLED])
    counts = iter([(1, 1), (1, 1), (2, 2), (2, 2), (2, 2), (2, 3), (3, 3)])
    complete = all_met(lambda: next(counts), lambda: next(times))
    # `all_met` reads the clock when the count changes and when all known subscribers are connected.
    assert [complete() for _ in range(7)] == [False, False, False, False, True, False, False]


def test_watch_without_a_node_says_so(control: Control, capsys: pytest.CaptureFixture[str], tmp_path: Path,
                                      monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setattr("tcc_sim.nodes.watcher.DISCOVERY_LIMIT", 0.1)
    assert main(["watch", "--rrd", str(tmp_path / "none.rrd")]) == 1
    assert capsys.readouterr().err == "tcc-sim: no driveline published its scene on /scene within 0.1 s\n"
    assert not (tmp_path / "none.rrd").exists()
