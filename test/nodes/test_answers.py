"""The loop answers requests in every wait, no message ends it, and messages that cannot be sent wait or are counted."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from benches import Commander, overrides

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import DrivelineNode, spin
from tcc_sim.nodes.loop_topics import CommandedInput

MEANS = {"engine__fallback": "mean", "pressure__fallback": "mean"}


def change(bench: Any, name: str, value: float) -> Any:
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return bench.call(SetParameters, "driveline/set_parameters", request).results[0]


class Sender(Commander):
    """Sends commands and waits until the driveline accepts or refuses them."""

    def __init__(self, bench: Any, node: DrivelineNode) -> None:
        super().__init__(bench)
        self.bench, self.node = bench, node

    def torque(self, value: float) -> CommandedInput:
        return self._sent(self.torques, cdr.float64(value), self.node.loop.inputs["engine_torque"])

    def pressure(self, value: float) -> CommandedInput:
        return self._sent(self.pressures, cdr.fluid_pressure(0, value), self.node.loop.inputs["actuation_pressure"])

    def _sent(self, publisher: Any, data: bytes, command: CommandedInput | None) -> CommandedInput:
        assert command is not None
        count = command.received + command.refused
        publisher.publish(data)
        self.bench.until(lambda: command.received + command.refused > count)
        return command


WAITING = [
    pytest.param({"scene": "minimal", "real_time_factor": 1e-4}, id="for a deadline of 10 s"),
    pytest.param({"scene": "commands", "pacing": "lockstep", "command_timeout": 0.0}, id="for a command in lock-step"),
    pytest.param({"scene": "minimal", "wait_for_subscribers": 7}, id="for subscribers"),
]


@pytest.mark.parametrize("parameters", WAITING)
def test_whatever_the_loop_waits_for_it_answers(bench: Any, parameters: dict[str, Any]) -> None:
    node = bench.started(**parameters)
    assert change(bench, "engine.mean_torque", 260.0).successful
    assert node.scene.system.engine.mean_torque == 260.0
    assert bench.call(Trigger, "driveline/reset", Trigger.Request()).success
    paused = bench.call(SetBool, "driveline/pause", SetBool.Request(data=True))
    assert (paused.success, paused.message) == (True, "paused")
    stepped = bench.call(Trigger, "driveline/step", Trigger.Request())
    assert stepped.success == node.loop.clock_started.is_set()
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=False)).success
    assert change(bench, "command_timeout", 0.25).successful
    node.loop.stop()
    assert not node.loop.running


def test_a_live_real_time_factor_sets_the_pace(bench: Any) -> None:
    node = bench.started(scene="minimal", real_time_factor=1e-4)
    assert node.loop.pacer.period_ns == pytest.approx(1e10)
    assert change(bench, "real_time_factor", 1.0).successful
    assert node.loop.pacer.period_ns == pytest.approx(1e6)
    bench.until(lambda: node.loop.plant.stepper.tick > 20)
    for refused in (0.0, 1001.0):
        assert not change(bench, "real_time_factor", refused).successful
    assert node.loop.pacer.period_ns == pytest.approx(1e6)


def test_a_valid_command_that_cannot_be_computed_is_refused_counted_and_said_and_the_last_one_holds(
        bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.started(scene="commands", command_timeout=0.0, rate=50.0)
    sender = Sender(bench, node)
    assert sender.pressure(2e5).value == 2e5
    command = sender.pressure(1e7)
    assert (command.received, command.refused, command.value) == (1, 1, 2e5)
    assert "actuation_pressure command of 1e+07 Pa refused: a tick of " in command.refusal or \
        "actuation_pressure command of 1e+07 Pa refused: a step of " in command.refusal
    capfd.readouterr()
    for _ in range(3):
        sender.pressure(1e7)
        node.housekeeping()
    assert capfd.readouterr().err.count(" so far)") == 1
    tick = node.loop.plant.stepper.tick
    bench.until(lambda: node.loop.plant.stepper.tick > tick + 2)
    assert node.loop.failure is None
    assert sender.pressure(4e6).value == 4e6
    answer = change(bench, "friction.static_coefficient", 2.0)
    assert not answer.successful
    assert "sub-steps" in answer.reason
    assert node.scene.system.friction.static_coefficient == 0.3
    assert node.loop.running


@pytest.fixture
def spun(bench: Any) -> Iterator[Callable[..., DrivelineNode]]:
    """Function that starts a driveline and spins it in a thread, as its process does."""
    threads = []

    def begin(**parameters: Any) -> DrivelineNode:
        node = DrivelineNode(context=bench.context, parameter_overrides=overrides(parameters))
        node.start()
        threads.append((threading.Thread(target=spin, args=(node,)), node))
        threads[-1][0].start()
        return node

    yield begin
    for _, node in threads:
        node.loop.stop()
    bench.context.try_shutdown()
    for thread, _ in threads:
        thread.join()


def test_a_request_that_makes_no_sense_is_told_and_does_not_end_the_node(
        bench: Any, spun: Callable[..., DrivelineNode], capfd: pytest.CaptureFixture[str]) -> None:
    node = spun(scene="minimal")
    client = bench.node("stranger").create_client(
        SetParameters, "driveline/set_parameters")
    bench.until(client.service_is_ready)
    said, kinds = "", itertools.cycle((77, 255))

    def answered() -> bool:
        # A request may be lost while the middleware still matches client and service, so the client repeats it.
        nonlocal said
        client.call_async(SetParameters.Request(parameters=[
            ParameterMessage(name="engine.mean_torque", value=ParameterValue(type=next(kinds)))]))
        said += capfd.readouterr().err
        return "a message or request could not be handled" in said

    bench.until(answered)
    assert change(bench, "engine.mean_torque", 250.0).successful
    assert node.loop.running


class Refusing:
    """A publisher, and its handle, that refuses messages unless it is open."""

    def __init__(self, publisher: Any) -> None:
        self.publisher, self.open, self.refused, self.taken = publisher, True, 0, []
        self.topic_name, self.handle = publisher.topic_name, self

    def __enter__(self) -> None:
        self.publisher.handle.__enter__()

    def __exit__(self, *error: object) -> None:
        self.publisher.handle.__exit__(*error)

    def publish_raw(self, data: bytes) -> None:
        if not self.open:
            self.refused += 1
            raise RuntimeError("cannot publish data")
        self.taken.append(cdr.read_stamp(data))
        self.publisher.publish(data)

    def get_subscription_count(self) -> int:
        return self.publisher.get_subscription_count()


class Unheard(DrivelineNode):
    """A driveline whose publisher of joint_states can be made to refuse."""

    def create_publisher(self, kind: Any, name: str, *options: Any, **more: Any) -> Any:
        result = super().create_publisher(kind, name, *options, **more)
        if name != "joint_states":
            return result
        self.refusing = Refusing(result)
        return self.refusing


@pytest.mark.parametrize("parameters", [{"scene": "minimal", "real_time_factor": 0.0},
                                        {"scene": "commands", "pacing": "lockstep", "command_timeout": 1e-9}])
def test_where_time_does_not_matter_nothing_is_dropped_and_requests_are_answered_meanwhile(
        bench: Any, parameters: dict[str, Any]) -> None:
    node = bench.add(Unheard(context=bench.context, parameter_overrides=overrides(parameters)))
    publisher = node.refusing
    node.start()
    bench.until(lambda: len(publisher.taken) > 50)
    publisher.open = False
    bench.until(lambda: publisher.refused > 3)
    tick = node.loop.plant.stepper.tick
    assert change(bench, "engine.mean_torque", 260.0).successful
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=True)).success
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=False)).success
    assert node.loop.plant.stepper.tick == tick
    publisher.open = True
    bench.until(lambda: node.loop.plant.stepper.tick > tick + 50)
    node.loop.stop()
    assert publisher.taken == [k * 1_000_000 for k in range(len(publisher.taken))]
    assert not node.loop.outputs.unsent


def test_in_real_time_what_was_not_sent_is_counted_and_the_count_is_recorded(bench: Any, tmp_path: Any) -> None:
    from tcc_sim.nodes.recorder import Recorder
    from tcc_sim.recording.reader import Run

    recorder = Recorder(rclpy.create_node("recorder", context=bench.context, parameter_overrides=[
        Parameter("output", value=str(tmp_path / "run"))]))
    node = bench.add(Unheard(context=bench.context,
                             parameter_overrides=overrides({"scene": "minimal", "wait_for_subscribers": 1})))
    publisher = node.refusing
    node.start()
    bench.until(lambda: (recorder.drain(), len(publisher.taken) > 100)[1])
    publisher.open = False
    bench.until(lambda: (recorder.drain(), publisher.refused >= 20)[1])
    publisher.open = True
    bench.until(lambda: (recorder.drain(), len(publisher.taken) > 300)[1])
    node.housekeeping()
    node.loop.stop()
    assert node.loop.failure is None

    def known() -> bool:
        recorder.drain()
        return recorder.unsent.by_topic == {"/joint_states": publisher.refused}

    bench.until(known)
    assert f"0 lost, {publisher.refused} never sent" in recorder.close()
    recorder.node.destroy_node()
    run = Run(tmp_path / "run")
    stamps = list(itertools.chain.from_iterable(batch.stamp_ns.tolist() for batch in run.columns().runs))
    assert stamps == publisher.taken[:len(stamps)]
    assert run.result is not None
    assert (run.result["unsent"], run.stamps.lost) == ({"/joint_states": publisher.refused}, publisher.refused)
    assert f"{publisher.refused} messages of /joint_states could not be sent by their publisher" in run.warnings
