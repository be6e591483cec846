"""The slip controller example closes the loop with the driveline node, and the recorded run shows what it holds."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.recorder import Recorder
from tcc_sim.nodes.slip_controller import SlipControllerNode
from tcc_sim.recording.reader import open_run
from tcc_sim.scene import load_scene

CYCLE = 2.0 * np.pi / 150.0


@pytest.fixture
def controller(bench: Any) -> Iterator[Callable[..., SlipControllerNode]]:
    """Starts the controller in a thread of its own, as it has a process of its own in use."""
    threads = []

    def spin(node: SlipControllerNode) -> None:
        executor = SingleThreadedExecutor(context=bench.context)
        executor.add_node(node)
        try:
            executor.spin()
        except (ExternalShutdownException, RuntimeError):
            assert not bench.context.ok()

    def start(**parameters: Any) -> SlipControllerNode:
        node = SlipControllerNode(context=bench.context,
                                  parameter_overrides=[Parameter(name, value=value) for name,
                                                       value in parameters.items()])
        threads.append(threading.Thread(target=spin, args=(node,)))
        threads[-1].start()
        return node

    yield start
    bench.context.try_shutdown()
    for thread in threads:
        thread.join()


def recorded(bench: Any, output: Path, until: Callable[[Any, Callable[[], int]], None]) -> Any:
    """Run the scene in lock-step with a recorder until `until` returns; the recording."""
    recorder_node = rclpy.create_node("recorder", context=bench.context, parameter_overrides=[
        Parameter("output", value=str(output)),
        Parameter("topics", value=["scene", "joint_states", "actuation_pressure", "applied_pressure"])])
    recorder = Recorder(recorder_node)
    # The controller is known to have joined when its subscription is there beside the recorder's.
    overrides = {"scene": "controlled", "pacing": "lockstep", "command_timeout": 0.0, "wait_for_subscribers": 2,
                 "publish_scalars": False}
    driveline = bench.add(DrivelineNode(context=bench.context, parameter_overrides=[
        Parameter(name, value=value) for name, value in overrides.items()]))
    driveline.start()

    def ticks() -> int:
        recorder.drain()
        return recorder.tracks["/joint_states"].messages

    until(driveline, ticks)
    driveline.loop.stop()
    recorder.close()
    recorder_node.destroy_node()
    return open_run(output)


def test_it_holds_the_mean_slip_under_pulsation_and_after_a_step(driveline: Any) -> None:
    plant = driveline("controlled")
    plant.add(SlipControllerNode())
    before = plant.run(seconds=1.6)
    plant.change({"engine.mean_torque": 300.0})
    after = plant.run(seconds=1.6)
    for run, torque in ((before, 200.0), (after, 300.0)):
        assert run.tracking.target == 20.0
        assert run.tracking.largest_error < 1.0
        assert 0.0 < run.tracking.settling_time < 25 * CYCLE
        # What the engine gave beyond the scene's harmonic; in the mean the clutch passes it on: 0.27 0.08 m^2 0.1 m P.
        mean_torque = run.engine_torque[1:] - 250.0 * np.sin(150.0 * run.t[1:])
        np.testing.assert_allclose(mean_torque, torque, rtol=1e-9)
        assert run.applied_pressure[-500:].mean() * 0.27 * 0.008 == pytest.approx(torque, rel=0.02)
    # The step was felt.
    assert np.abs(after.slip_speed[:209].mean() - 20.0) > 1.0


def test_lockstep_gives_the_same_run_to_the_last_bit_with_a_slow_controller(
        bench: Any, tmp_path: Path, controller: Callable[..., SlipControllerNode],
    monkeypatch: pytest.MonkeyPatch) -> None:
    """The second controller lets the driveline look in vain up to 40 times before it answers."""
    from tcc_sim.nodes import loop_topics

    looks, delays = 0, itertools.cycle([0, 3, 1, 17, 0, 0, 41])
    plain_poll = loop_topics.poll

    def counting(*words: Any, **options: Any) -> Any:
        nonlocal looks
        looks += 1
        return plain_poll(*words, **options)

    monkeypatch.setattr(loop_topics, "poll", counting)
    node = controller()
    messages = []
    for name, slow in (("quick", False), ("slow", True)):
        if slow:
            plain = node.controller.update

            def late(*words: float, plain: Any = plain) -> float:
                enough = looks + next(delays)
                while looks < enough and bench.context.ok():
                    threading.Event().wait(1e-5)
                return float(plain(*words))

            monkeypatch.setattr(node.controller, "update", late)
        run = recorded(bench, tmp_path / name, lambda _, ticks: bench.until(lambda: ticks() > 300))
        payloads: dict[str, list[bytes]] = {}

        def tap(data: bytes, found: Any, channels: Any, payloads: Any = payloads) -> None:
            for channel, offset, length in zip(found.channel.tolist(), found.offset.tolist(), found.length.tolist()):
                payloads.setdefault(channels[channel].topic, []).append(data[offset + 22:offset + length])

        list(run.read(tap))
        messages.append(payloads)
    for topic in ("/joint_states", "/applied_pressure"):
        assert len(messages[0][topic]) >= 300
        assert messages[0][topic][:300] == messages[1][topic][:300]
    # ROS 2 leaves the padding of its messages to chance, so only what they say can be the same.
    commands = [[cdr.read_fluid_pressure(data) for data in found["/actuation_pressure"]][:300] for found in messages]
    assert commands[0] == commands[1]
    assert [stamp for stamp, _ in commands[0]] == [k * 1_000_000 for k in range(300)]


def test_the_target_is_said_latched_and_the_demo_starts_a_controller_for_the_scenes_that_need_one(bench: Any) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Float64

    from tcc_sim.cli.demo import controller_of
    from tcc_sim.plant.slip_control import Tuning

    bench.add(SlipControllerNode(context=bench.context, parameter_overrides=[Parameter("target", value=30)]))
    heard: list[float] = []
    late = bench.add(rclpy.create_node("late", context=bench.context))
    late.create_subscription(Float64, "target_slip_speed", lambda message: heard.append(message.data),
                             QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    bench.until(lambda: heard == [30.0])
    given = controller_of(load_scene("controlled"))
    assert given is not None
    assert Tuning(**given) == Tuning()  # type: ignore[arg-type]
    assert [controller_of(load_scene(name)) for name in ("commands", "fig02")] == [None, None]


def test_states_that_waited_all_reach_the_law_and_the_newest_alone_is_answered(bench: Any) -> None:
    """Answered one by one they would be ever older where the machine is busy, and the loop unstable by that dead time.
    """
    from sensor_msgs.msg import FluidPressure, JointState

    from tcc_sim.nodes.slip_controller import QOS
    from tcc_sim.plant.slip_control import SlipController, Tuning

    node = SlipControllerNode(context=bench.context)
    driveline = bench.add(rclpy.create_node("driveline", context=bench.context))
    heard: list[FluidPressure] = []
    driveline.create_subscription(FluidPressure, "actuation_pressure", heard.append, QOS)
    states = driveline.create_publisher(JointState, "joint_states", QOS)
    assert states.get_subscription_count() == 1
    law = SlipController(Tuning())
    for tick in range(200):
        state = JointState(velocity=[20.0 + 0.1 * tick, 0.0], effort=[200.0, 0.0])
        state.header.stamp.nanosec = tick * 1_000_000
        states.publish(state)
        wanted = law.update(20.0 + 0.1 * tick, 200.0)
    bench.add(node)
    bench.until(lambda: bool(heard) and heard[-1].header.stamp.nanosec == 199_000_000)
    assert [command.header.stamp.nanosec for command in heard] == [199_000_000]
    assert heard[0].fluid_pressure == wanted


def test_a_state_that_is_none_is_said_and_the_next_one_answered(bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    from sensor_msgs.msg import FluidPressure, JointState

    from tcc_sim.nodes.process import Spinner
    from tcc_sim.nodes.slip_controller import QOS

    controller = SlipControllerNode(context=bench.context)
    spinner = Spinner(controller)
    driveline = bench.add(rclpy.create_node("driveline", context=bench.context))
    heard: list[FluidPressure] = []
    driveline.create_subscription(FluidPressure, "actuation_pressure", heard.append, QOS)
    states = driveline.create_publisher(JointState, "joint_states", QOS)
    whole = JointState(velocity=[20.0, 0.0], effort=[200.0, 0.0])
    for state in (JointState(), JointState(velocity=[1.0], effort=[1.0]), JointState(
            velocity=[math.nan, 0.0], effort=[200.0]), whole):
        states.publish(state)
        spinner.once(10.0)
    bench.until(lambda: bool(heard))
    assert len(heard) == 1
    assert math.isfinite(heard[0].fluid_pressure)
    assert capfd.readouterr().err.count("without finite speeds of two joints and a torque") == 1
    controller.destroy_node()


def test_a_parameter_of_a_type_that_there_is_not_is_said_and_the_node_goes_on(
        bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    from rcl_interfaces.msg import Parameter as ParameterMessage
    from rcl_interfaces.msg import ParameterValue
    from rcl_interfaces.srv import GetParameters

    from tcc_sim.nodes.process import Spinner

    controller = SlipControllerNode(context=bench.context)
    spinner = Spinner(controller)
    stranger = bench.add(rclpy.create_node("stranger", context=bench.context))
    wrong = stranger.create_client(SetParameters, "slip_controller/set_parameters")
    right = stranger.create_client(GetParameters, "slip_controller/get_parameters")
    bench.until(lambda: wrong.service_is_ready() and right.service_is_ready())
    said = ""

    def told() -> bool:
        nonlocal said
        wrong.call_async(SetParameters.Request(parameters=[
            ParameterMessage(name="target", value=ParameterValue(type=77))]))
        spinner.once(0.01)
        said += capfd.readouterr().err
        return "a message or request was not understood" in said

    bench.until(told)
    answer = right.call_async(GetParameters.Request(names=["target"]))
    bench.until(lambda: spinner.once(0.01) or answer.done())
    assert answer.result().values[0].double_value == controller.controller.tuning.target
    controller.destroy_node()


def test_a_senseless_parameter_is_refused(bench: Any) -> None:
    for name, value in (("target", -3.0), ("bandwidth", "fast"), ("step", 0)):
        with pytest.raises(InputError, match=f"{name} is"):
            SlipControllerNode(context=bench.context, parameter_overrides=[Parameter(name, value=value)])
    node = bench.add(SlipControllerNode(context=bench.context, parameter_overrides=[Parameter("target", value=30)]))
    assert node.controller.tuning.target == 30


def test_the_scene_is_the_one_that_the_controller_is_tuned_for() -> None:
    from tcc_sim.plant.slip_control import Tuning

    system = load_scene("controlled").system
    tuning = Tuning()
    assert tuning.torque_per_pressure == pytest.approx(system.torque_per_pressure, rel=1e-12)
    assert (tuning.frequency, tuning.inertia) == (system.engine.frequency, system.driveline.flywheel_inertia)
