from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Int8
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.middleware import states
from tcc_sim.scene import load_scene, parse_scene
from tcc_sim.solvers import solve

STEP_NS = 1_000_000
MEANS = {"engine__fallback": "mean", "pressure__fallback": "mean"}


def start(bench: Any, **parameters: Any) -> DrivelineNode:
    overrides = [Parameter(key.replace("__", "."), value=value) for key, value in parameters.items()]
    return bench.add(DrivelineNode(context=bench.context, parameter_overrides=overrides))


def listener(bench: Any, kind: type, topic: str) -> list[Any]:
    node = bench.context_node = getattr(bench, "context_node", None) or bench.add(_plain_node(bench))
    heard: list[Any] = []
    node.create_subscription(kind, topic, heard.append, states(10_000))
    return heard


def _plain_node(bench: Any) -> Any:
    import rclpy

    return rclpy.create_node("listener", context=bench.context)


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def call(bench: Any, kind: Any, name: str, request: Any) -> Any:
    node = getattr(bench, "context_node", None) or bench.add(_plain_node(bench))
    bench.context_node = node
    client = node.create_client(kind, name)
    bench.until(client.service_is_ready)
    future = client.call_async(request)
    bench.until(future.done)
    return future.result()


def test_states_are_those_of_the_solver(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    slip, torque, state = (listener(bench, kind, topic) for kind, topic in (
        (Float64, "slip_speed"), (Float64, "friction_torque"), (Int8, "stick_slip_state")))
    node = start(bench, scene="minimal", wait_for_subscribers=1)
    node.start()
    bench.until(lambda: min(len(heard), len(slip), len(torque), len(state)) > 200)
    assert [stamp_of(m) for m in heard[:200]] == [k * STEP_NS for k in range(200)]
    # SciPy's Radau solves the same scene; 1 kHz ticks of the fixed-step solver are within 1e-4 of the largest slip
    # speed.
    system = load_scene("minimal").system
    reference = solve(system, duration=0.199, samples_per_cycle=0, solver="radau", rtol=1e-10).raise_for_status()
    last = heard[199]
    assert list(last.name) == ["flywheel", "clutch_plate"]
    assert last.velocity[0] - last.velocity[1] == pytest.approx(reference.slip_speed[-1], abs=1e-4 * 150.0)
    assert last.position[1] == pytest.approx(reference.plate_angle[-1], abs=1e-4 * np.abs(reference.plate_angle).max())
    assert last.effort[0] == pytest.approx(300.0 + 250.0 * math.sin(150.0 * 0.199))
    assert last.effort[1] == torque[199].data
    assert slip[199].data == pytest.approx(last.velocity[0] - last.velocity[1], abs=1e-12)
    assert {m.data for m in state[:200]} == {0, 1}


def test_only_what_the_scene_needs_is_created(bench: Any) -> None:
    node = start(bench, scene="minimal", publish_scalars=False, publish_diagnostics=False)
    topics = {name for name, _ in node.get_publisher_names_and_types_by_node("driveline", "/")}
    assert topics == {"/joint_states", "/scene", "/parameter_events", "/rosout"}
    assert not {name for name,
                _ in node.get_subscriber_names_and_types_by_node("driveline", "/")} - {"/parameter_events"}
    assert not list(node.timers)


def test_a_command_applies_from_the_next_tick_and_is_held(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    applied = listener(bench, FluidPressure, "applied_pressure")
    node = start(bench, scene="commands", wait_for_subscribers=1, command_timeout=0.0, **MEANS)
    node.start()
    sender = bench.context_node
    torque = sender.create_publisher(Float64, "engine_torque", 10)
    pressure = sender.create_publisher(FluidPressure, "actuation_pressure", 10)
    bench.until(lambda: len(heard) > 5 and torque.get_subscription_count() and pressure.get_subscription_count())
    assert {m.effort[0] for m in heard} == {300.0}
    torque.publish(Float64(data=123.0))
    pressure.publish(FluidPressure(fluid_pressure=1e5))
    bench.until(lambda: len(applied) > 100 and applied[-1].fluid_pressure == 1e5 and heard[-1].effort[0] == 123.0)
    count = len(heard)
    bench.until(lambda: len(heard) > count + 50)
    assert {m.effort[0] for m in heard[count:]} == {123.0}
    assert [stamp_of(m) for m in applied[:100]] == [k * STEP_NS for k in range(100)]
    by_stamp = {stamp_of(m): m.fluid_pressure for m in applied}
    for after in heard:
        load = by_stamp.get(stamp_of(after))
        if load is not None and abs(after.velocity[0] - after.velocity[1]) > 5.0:
            assert after.effort[1] == pytest.approx(0.24 * 0.008 * load, rel=1e-3)


def test_without_commands_the_mean_applies_and_diagnostics_say_so(bench: Any) -> None:
    heard = listener(bench, DiagnosticArray, "/diagnostics")
    node = start(bench, scene="commands", command_timeout=0.05, **MEANS)
    node.start()
    sender = bench.context_node
    publisher = sender.create_publisher(Float64, "engine_torque", 10)
    bench.until(publisher.get_subscription_count)
    publisher.publish(Float64(data=123.0))
    command = node.loop.engine_command
    assert command is not None
    bench.until(lambda: command.timeouts == 1)
    assert (command.received, command.value) == (1, None)
    assert node.loop.request(lambda: node.loop.plant.reading().engine_torque == 300.0)

    def spoken() -> Any:
        node.housekeeping()
        return heard

    status = bench.until(spoken)[0].status[0]
    values = {item.key: item.value for item in status.values}
    assert status.level == b"\x01"
    assert "engine_torque" in status.message
    assert values["engine_torque time-outs"] == "1"
    assert values["engine_torque source"] == "fallback"
    assert int(values["iterations max"]) <= int(values["iterations bound"])


def test_pause_step_and_reset(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    node = start(bench, scene="minimal")
    node.start()
    bench.until(lambda: len(heard) > 5)
    assert not call(bench, Trigger, "driveline/step", Trigger.Request()).success
    assert call(bench, SetBool, "driveline/pause", SetBool.Request(data=True)).success
    tick = node.loop.plant.stepper.tick
    answer = call(bench, Trigger, "driveline/step", Trigger.Request())
    assert answer.success
    assert node.loop.plant.stepper.tick == tick + 1
    bench.until(lambda: stamp_of(heard[-1]) == (tick + 1) * STEP_NS)
    assert call(bench, Trigger, "driveline/reset", Trigger.Request()).success
    bench.until(lambda: stamp_of(heard[-1]) == 0)
    assert heard[-1].velocity[0] == 150.0
    assert call(bench, SetBool, "driveline/pause", SetBool.Request(data=False)).success
    bench.until(lambda: stamp_of(heard[-1]) > 5 * STEP_NS)


def test_parameters_are_checked_together_and_applied_between_ticks(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    node = start(bench, scene="minimal", publish_scalars=False)
    node.start()
    request = SetParametersAtomically.Request(parameters=[
        Parameter("friction.static_coefficient", value=0.2).to_parameter_msg(),
        Parameter("friction.kinetic_coefficient", value=0.005).to_parameter_msg()])
    answer = call(bench, SetParametersAtomically, "driveline/set_parameters_atomically", request).result
    assert not answer.successful
    assert "friction.kinetic_coefficient is 0.005; it must be 0.01 to 4" in answer.reason
    assert node.scene.system.friction.static_coefficient == 0.3
    request.parameters = [Parameter("engine.mean_torque", value=100).to_parameter_msg(),
                          Parameter("friction.kinetic_coefficient", value=0.2).to_parameter_msg(),
                          Parameter("engine.torque_amplitude", value=0.0).to_parameter_msg()]
    answer = call(bench, SetParametersAtomically, "driveline/set_parameters_atomically", request).result
    assert answer.successful, answer.reason
    bench.until(lambda: heard and heard[-1].effort[0] == 100.0)
    assert node.loop.plant.stepper.terms.stribeck == pytest.approx((0.5, 2.0))
    request.parameters = [Parameter("driveline.stiffness", value=1.0).to_parameter_msg()]
    assert not call(bench, SetParametersAtomically, "driveline/set_parameters_atomically", request).result.successful


def test_overrides_are_coerced_checked_and_unknown_ones_ignored(bench: Any) -> None:
    node = start(bench, scene="minimal", engine__mean_torque=200, rate=500, engine__mean_torqe=7.0)
    assert node.scene.system.engine.mean_torque == 200.0
    assert node.loop.plant.stepper.step == 1.0 / 500.0
    assert not node.has_parameter("engine.mean_torqe")
    descriptor = node.describe_parameter("driveline.stiffness")
    assert descriptor.read_only
    assert "N m/rad" in descriptor.description
    assert descriptor.floating_point_range[0].to_value == 1e8
    assert parse_scene(node.get_parameter("scene_text").value, "minimal").system == node.scene.system
    with pytest.raises(InputError, match=r"driveline.plate_inertia is -1 kg m\^2; it must be 1e-06 to 1000 kg m\^2"):
        DrivelineNode(context=bench.context, parameter_overrides=[Parameter("driveline.plate_inertia", value=-1.0)])
    with pytest.raises(InputError, match="did you mean minimal"):
        DrivelineNode(context=bench.context, parameter_overrides=[Parameter("scene", value="minimum")])
    with pytest.raises(InputError, match="needs smoothed"):
        DrivelineNode(context=bench.context, parameter_overrides=[Parameter("friction.law", value="set_valued")])


def test_clock_follows_simulation_time(bench: Any) -> None:
    heard = listener(bench, Clock, "/clock")
    node = start(bench, scene="minimal", publish_clock=True, wait_for_subscribers=0, publish_scalars=False)
    node.start()
    bench.until(lambda: len(heard) > 20)
    stamps = [m.clock.sec * 10**9 + m.clock.nanosec for m in heard]
    assert set(np.diff(stamps)) == {STEP_NS}


def test_as_fast_as_possible_gives_the_same_states(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    node = start(bench, scene="fig02", real_time_factor=0.0, wait_for_subscribers=1, publish_scalars=False)
    node.start()
    bench.until(lambda: len(heard) > 300)
    node.loop.stop()
    system = load_scene("fig02").system
    again = solve(system, duration=0.3, samples_per_cycle=0, solver="fixed_step", flywheel_angle=True)
    at = heard[300]
    assert at.position[1] == pytest.approx(again.plate_angle[-1], rel=1e-12)
    assert [stamp_of(m) for m in heard[:300]] == [k * STEP_NS for k in range(300)]


def test_lockstep_waits_for_each_command(bench: Any) -> None:
    heard = listener(bench, JointState, "joint_states")
    node = start(bench, scene="commands", **MEANS, pressure__source="harmonic", pacing="lockstep", command_timeout=0.0,
                 wait_for_subscribers=1, publish_scalars=False)
    node.start()
    sender = bench.context_node
    publisher = sender.create_publisher(Float64, "engine_torque", 10)
    bench.until(publisher.get_subscription_count)
    torques = [100.0 + 10.0 * k for k in range(20)]
    for k, value in enumerate(torques):
        bench.until(lambda k=k: len(heard) == k + 1)
        publisher.publish(Float64(data=value))
    bench.until(lambda: len(heard) == len(torques) + 1)
    assert [m.effort[0] for m in heard[1:]] == torques
    assert node.loop.plant.stepper.tick == len(torques)


def test_lockstep_awaits_an_answer_every_command_period(bench: Any) -> None:
    node = start(bench, scene="controlled", pacing="lockstep", command_period=0.005, command_timeout=0.0,
                 wait_for_subscribers=0)
    heard = listener(bench, JointState, "joint_states")
    publisher = bench.context_node.create_publisher(FluidPressure, "actuation_pressure", 10)
    bench.until(publisher.get_subscription_count)
    node.start()
    for answered in range(4):
        bench.until(lambda n=5 * answered + 1: len(heard) == n and node.loop.waits_for)
        command = FluidPressure(fluid_pressure=2e5 + answered)
        command.header.stamp = heard[-1].header.stamp
        publisher.publish(command)
    bench.until(lambda: len(heard) == 21)


def test_set_pause_does_not_hold_up_the_end(bench: Any) -> None:
    node = start(bench, scene="minimal")
    node.start()
    assert call(bench, SetBool, "driveline/pause", SetBool.Request(data=True)).success
    node.loop.stop()
    assert not node.loop.running


@pytest.mark.parametrize(("scene", "stick"), [("slip", False), ("stick", True)])
def test_every_tick_counts_as_stick_or_slip(bench: Any, scene: str, stick: bool) -> None:
    node = start(bench, scene=scene, initial__slip_speed=0.0 if stick else 150.0)
    node.start()
    bench.until(lambda: node.loop.plant.stepper.tick > 20)
    node.loop.stop()
    ticks = node.loop.stick_ticks if stick else node.loop.slip_ticks
    assert ticks == node.loop.plant.stepper.tick + 1
    assert node.loop.stick_ticks + node.loop.slip_ticks == ticks
