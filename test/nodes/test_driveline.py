"""The driveline node in the process of the test: states, commands, services, parameters, quality of service."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from benches import Commander, stamp_of

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Int8
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.scene import load_scene, parse_scene
from tcc_sim.solvers import solve
from tcc_sim.topics import TOPICS, topic

STEP_NS = 1_000_000
MEANS = {"engine__fallback": "mean", "pressure__fallback": "mean"}


def test_states_are_those_of_the_solver(bench: Any) -> None:
    heard = bench.listen(JointState, "joint_states")
    slip, torque, state = (bench.listen(kind, topic) for kind, topic in (
        (Float64, "slip_speed"), (Float64, "friction_torque"), (Int8, "stick_slip_state")))
    bench.started(scene="minimal", wait_for_subscribers=1)
    bench.until(lambda: min(len(heard), len(slip), len(torque), len(state)) > 200)
    assert [stamp_of(m) for m in heard[:200]] == [k * STEP_NS for k in range(200)]
    # SciPy's LSODA solves the same scene; 1 kHz ticks of the fixed-step solver are within 1e-4 of the largest slip
    # speed.
    system = load_scene("minimal").system
    reference = solve(system, duration=0.199, samples_per_cycle=0, solver="lsoda", rtol=1e-9).raise_for_status()
    last = heard[199]
    assert list(last.name) == ["flywheel", "clutch_plate"]
    assert last.velocity[0] - last.velocity[1] == pytest.approx(reference.slip_speed[-1], abs=1e-4 * 150.0)
    assert last.position[1] == pytest.approx(reference.plate_angle[-1], abs=1e-4 * np.abs(reference.plate_angle).max())
    assert last.effort[0] == pytest.approx(300.0 + 250.0 * math.sin(150.0 * 0.199))
    assert last.effort[1] == torque[199].data
    assert slip[199].data == pytest.approx(last.velocity[0] - last.velocity[1], abs=1e-12)
    assert {m.data for m in state[:200]} == {0, 1}


def test_stamps_of_the_wall_clock_are_simulation_time_from_the_first_tick_on(bench: Any) -> None:
    heard, pressure, clock = (bench.listen(kind, topic) for kind, topic in (
        (JointState, "joint_states"), (FluidPressure, "applied_pressure"), (Clock, "/clock")))
    slip, torque = (bench.listen(JointState, f"{name}_stamped") for name in ("slip_speed", "friction_torque"))
    began = time.time_ns()
    bench.started(scene="commands", wait_for_subscribers=1, stamp="wall", publish_stamped=True, publish_clock=True)
    bench.until(lambda: min(map(len, (heard, pressure, clock, slip, torque))) > 100)
    first, ended = stamp_of(heard[0]), time.time_ns()
    assert began <= first <= ended
    stamps = [first + k * STEP_NS for k in range(100)]
    assert all([stamp_of(m) for m in given[:100]] == stamps for given in (heard, pressure, slip, torque))
    assert [m.clock.sec * 10**9 + m.clock.nanosec for m in clock[:100]] == stamps
    for state, speed, effort in zip(heard[:100], slip, torque):
        assert list(speed.name) == list(effort.name) == ["clutch"]
        assert list(speed.velocity) == [pytest.approx(state.velocity[0] - state.velocity[1], abs=1e-12)]
        assert list(effort.effort) == [state.effort[1]]
        assert not [*speed.position, *speed.effort, *effort.position, *effort.velocity]
    bench.call(Trigger, "/driveline/reset", Trigger.Request())
    bench.until(lambda: [*heard[-1].position] != [0.0, 0.0])
    after = [stamp_of(m) for m in heard]
    assert after == sorted(set(after))  # A reset begins at the wall clock's time again.


def test_only_what_the_scene_needs_is_created(bench: Any) -> None:
    node = bench.driveline(scene="minimal", publish_scalars=False, publish_diagnostics=False)
    topics = {name for name, _ in node.get_publisher_names_and_types_by_node("driveline", "/")}
    assert topics == {"/joint_states", "/scene", "/parameter_events", "/rosout"}
    assert not {name for name,
                _ in node.get_subscriber_names_and_types_by_node("driveline", "/")} - {"/parameter_events"}
    assert not list(node.timers)


def test_a_command_applies_from_the_next_tick_and_is_held(bench: Any) -> None:
    heard = bench.listen(JointState, "joint_states")
    applied = bench.listen(FluidPressure, "applied_pressure")
    bench.started(scene="commands", wait_for_subscribers=1, command_timeout=0.0, **MEANS)
    sender = Commander(bench)
    bench.until(lambda: len(heard) > 5)
    assert {m.effort[0] for m in heard} == {300.0}
    sender.torques.publish(Float64(data=123.0))
    sender.pressures.publish(FluidPressure(fluid_pressure=1e5))
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
    heard = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.started(scene="commands", command_timeout=0.05, **MEANS)
    sender = bench.probe
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
    heard = bench.listen(JointState, "joint_states")
    node = bench.started(scene="minimal")
    bench.until(lambda: len(heard) > 5)
    assert not bench.call(Trigger, "driveline/step", Trigger.Request()).success
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=True)).success
    tick = node.loop.plant.stepper.tick
    answer = bench.call(Trigger, "driveline/step", Trigger.Request())
    assert answer.success
    assert node.loop.plant.stepper.tick == tick + 1
    bench.until(lambda: stamp_of(heard[-1]) == (tick + 1) * STEP_NS)
    assert bench.call(Trigger, "driveline/reset", Trigger.Request()).success
    bench.until(lambda: stamp_of(heard[-1]) == 0)
    assert heard[-1].velocity[0] == 150.0
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=False)).success
    bench.until(lambda: stamp_of(heard[-1]) > 5 * STEP_NS)
    assert bench.call(SetBool, "driveline/pause", SetBool.Request(data=True)).success
    node.loop.stop()
    assert not node.loop.running


def test_parameters_are_checked_together_and_applied_between_ticks(bench: Any) -> None:
    heard = bench.listen(JointState, "joint_states")
    node = bench.started(scene="minimal", publish_scalars=False)
    request = SetParametersAtomically.Request(parameters=[
        Parameter("friction.static_coefficient", value=0.2).to_parameter_msg(),
        Parameter("friction.kinetic_coefficient", value=0.005).to_parameter_msg()])
    answer = bench.call(SetParametersAtomically, "driveline/set_parameters_atomically", request).result
    assert not answer.successful
    assert "friction.kinetic_coefficient is 0.005; it must be 0.01 to 4" in answer.reason
    assert node.scene.system.friction.static_coefficient == 0.3
    request.parameters = [Parameter("engine.mean_torque", value=100).to_parameter_msg(),
                          Parameter("friction.kinetic_coefficient", value=0.2).to_parameter_msg(),
                          Parameter("engine.torque_amplitude", value=0.0).to_parameter_msg()]
    answer = bench.call(SetParametersAtomically, "driveline/set_parameters_atomically", request).result
    assert answer.successful, answer.reason
    bench.until(lambda: heard and heard[-1].effort[0] == 100.0)
    assert node.loop.plant.stepper.terms.stribeck == pytest.approx((0.5, 2.0))
    request.parameters = [Parameter("driveline.stiffness", value=1.0).to_parameter_msg()]
    assert not bench.call(SetParametersAtomically, "driveline/set_parameters_atomically", request).result.successful


def test_overrides_are_coerced_checked_and_unknown_ones_ignored(bench: Any) -> None:
    node = bench.driveline(scene="minimal", engine__mean_torque=200, rate=500, engine__mean_torqe=7.0)
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


def test_lockstep_awaits_an_answer_every_command_period(bench: Any) -> None:
    node = bench.driveline(scene="controlled", pacing="lockstep", command_period=0.005, command_timeout=0.0,
                 wait_for_subscribers=0)
    heard = bench.listen(JointState, "joint_states")
    publisher = bench.probe.create_publisher(FluidPressure, "actuation_pressure", 10)
    bench.until(publisher.get_subscription_count)
    node.start()
    for answered in range(4):
        bench.until(lambda n=5 * answered + 1: len(heard) == n and node.loop.waits_for)
        command = FluidPressure(fluid_pressure=2e5 + answered)
        command.header.stamp = heard[-1].header.stamp
        publisher.publish(command)
    bench.until(lambda: len(heard) == 21)


@pytest.mark.parametrize(("scene", "stick"), [("slip", False), ("stick", True)])
def test_every_tick_counts_as_stick_or_slip(bench: Any, scene: str, stick: bool) -> None:
    node = bench.started(scene=scene, initial__slip_speed=0.0 if stick else 150.0)
    bench.until(lambda: node.loop.plant.stepper.tick > 20)
    node.loop.stop()
    ticks = node.loop.stick_ticks if stick else node.loop.slip_ticks
    assert ticks == node.loop.plant.stepper.tick + 1
    assert node.loop.stick_ticks + node.loop.slip_ticks == ticks


def test_the_page_says_the_quality_of_service_that_is_offered(bench: Any) -> None:
    page = (Path(__file__).parents[2] / ".github" / "guide" / "nodes.md").read_text().split("Quality of service, as")[1]
    said = {}
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and cells[0].startswith("`"):
            said |= {name.strip("`/ "): cells[1:] for name in cells[0].split(",")}
        elif said:
            break
    patient = bench.driveline(scene="commands", publish_shaft_torque=True, publish_stamped=True, pacing="lockstep")
    node = bench.driveline(scene="commands", publish_shaft_torque=True, publish_stamped=True)
    for one in (patient, node):
        one.loop.clock.begin()
        one.loop.attach(CommandedInput(one, topic("output_speed")))
    kept = {p.topic_name.strip("/"): p.qos_profile.history.name for p in patient.publishers}
    node.loop.outputs.unsent["joint_states"] = 1
    node.loop.outputs.tell_unsent()
    ends = {end.topic_name.strip("/"): end.qos_profile for end in (*node.publishers, *node.subscriptions)}
    assert set(said) == {row.name.strip("/") for row in TOPICS}
    for name, (reliability, durability, history) in said.items():
        if name == "target_slip_speed":  # From the controller.
            continue
        profile = ends[name]
        assert reliability == profile.reliability.name.lower()
        assert durability == profile.durability.name.lower().replace("_", " ")
        if history.startswith("the last 0.25 s"):
            assert (profile.depth, kept[name]) == (250, "KEEP_ALL")
        else:
            assert history == f"last {profile.depth}"
