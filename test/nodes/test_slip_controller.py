"""The slip controller example closes the loop with the driveline node; the recorded run shows its target."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.parameter import Parameter

from tcc_sim.errors import InputError
from tcc_sim.nodes import slip_controller
from tcc_sim.nodes.slip_controller import SlipControllerNode
from tcc_sim.scene import load_scene


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
    node, given = controller_of(load_scene("controlled")) or ("", {})
    assert (node, Tuning(**given)) == ("slip_controller", Tuning())  # type: ignore[arg-type]
    assert [controller_of(load_scene(name)) for name in ("commands", "fig02")] == [None, None]


def test_states_that_waited_all_reach_the_law_and_the_newest_alone_is_answered(bench: Any) -> None:
    """Single answers would lag more and more on a busy machine, and the dead time would make the loop unstable."""
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


def test_states_reach_the_law_by_their_simulation_time_and_a_repeated_time_begins_anew(
        bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller waits for recorders before its first command, and never again."""
    from sensor_msgs.msg import JointState

    from tcc_sim.messages import cdr

    waited: list[Any] = []
    monkeypatch.setattr(slip_controller, "await_peer", waited.append)
    node = bench.add(SlipControllerNode(context=bench.context, parameter_overrides=[
        Parameter("target_times", value=[0.0, 1.0, 3.0]), Parameter("target_values", value=[10.0, 10.0, 30.0])]))
    updates, targets, resets, commands, behind = [], [], [], [], []
    scenes = [b"", cdr.string("\n# holds from stamp 0 ns on, simulation time 0 is 4000000000 ns of the wall clock\n")]
    law = SimpleNamespace(tuning=node.controller.tuning, target=10.0, reset=lambda: resets.append(len(updates)),
                          update=lambda slip_speed, torque: updates.append((slip_speed, torque)) or 5.0)
    monkeypatch.setattr(node, "controller", law)
    monkeypatch.setattr(node._target, "publish", lambda message: targets.append(message.data))
    monkeypatch.setattr(node._command, "publish", lambda command: commands.append(
        (command.header.stamp.sec, command.header.stamp.nanosec, command.fluid_pressure)))
    monkeypatch.setattr(slip_controller, "poll", lambda subscription, most=0: [
        (scenes.pop(), {})] if subscription is node._scenes and len(updates) == 5 and len(scenes) > 1 else [
            (behind.pop(), {})] if behind and subscription is node._states else [])

    def state(sec: int, nanosec: int, velocity: list[float], effort: list[float]) -> JointState:
        message = JointState(velocity=velocity, effort=effort)
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        return message

    for velocity, effort in (([], []), ([2.0], [1.0]), ([2.0, 1.0], []), ([math.inf, 1.0], [1.0]),
                             ([2.0, 1.0], [1.0, math.nan])):
        with pytest.raises(InputError, match=r"^/joint_states without finite speeds of two joints and a torque$"):
            node._on_state(state(0, 0, velocity, effort))
    assert not waited
    assert not commands
    for sec, nanosec in ((0, 0), (1, 500_000_000), (1, 500_000_000), (2, 0), (1, 999_999_999), (6, 500_000_000)):
        node._on_state(state(sec, nanosec, [7.0, 4.0], [2.0]))
        assert len(waited) == 1
    assert updates == [(3.0, 2.0)] * 6
    assert commands[-2:] == [(1, 999_999_999, 5.0), (6, 500_000_000, 5.0)]
    behind.append(JointState())
    with pytest.raises(InputError, match="without finite speeds"):  # The others are answered.
        node._on_state(state(6, 600_000_000, [7.0, 4.0], [2.0]))
    assert commands[6:] == [(6, 600_000_000, 5.0)]
    del targets[-1]
    # The law is reset where time does not advance; the last stamp is one of the wall clock, 2.5 s after its start.
    assert resets == [2, 4]
    assert targets == pytest.approx([15.0, 15.0, 20.0, 20.0, 10.0 + 10.0 * 0.999999999, 25.0])


def test_the_node_logs_what_it_controls(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(slip_controller, "log", lambda node, sentence: said.append(sentence))
    bench.add(SlipControllerNode(context=bench.context, parameter_overrides=[Parameter("target", value=30)])).report()
    assert said == ["holds a mean slip speed of 30 rad/s by /actuation_pressure, from /joint_states: bandwidth 15 "
                    "rad/s, period of excitation 41.89 states of 0.001 s, at most 600000 Pa"]


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
