"""The driveline node in the process of the test: states, commands, services, parameters, quality of service."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from benches import stamp_of

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import time
from pathlib import Path

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Int8
from std_srvs.srv import Trigger

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


def test_parameters_are_checked_together_and_applied_between_ticks(bench: Any) -> None:
    heard = bench.listen(JointState, "joint_states")
    node = bench.started(scene="minimal", publish_scalars=False)
    request = SetParametersAtomically.Request(parameters=[
        Parameter("friction.static_coefficient", value=0.2).to_parameter_msg(),
        Parameter("friction.kinetic_coefficient", value=0.005).to_parameter_msg()])
    answer = bench.call(SetParametersAtomically, "driveline/set_parameters_atomically", request).result
    assert not answer.successful
    assert all(part in answer.reason for part in ("friction.kinetic_coefficient", "0.005", "0.01 to 4"))
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
    assert parse_scene(node.get_parameter("scene_text").value, "minimal").system == node.scene.system
    for key, value, word in (("driveline.plate_inertia", -1.0, r"-1 kg m\^2.*1e-06 to 1000 kg m\^2"),
                             ("scene", "minimum", "minimal"), ("friction.law", "set_valued", "set_valued.*smoothed")):
        with pytest.raises(InputError, match=rf"{key}.*{word}"):
            DrivelineNode(context=bench.context, parameter_overrides=[Parameter(key, value=value)])


def test_the_page_says_the_quality_of_service_that_is_offered(bench: Any) -> None:
    page = (Path(__file__).parents[2] / ".github" / "guide" / "nodes.md").read_text().split("Quality of service, as")[1]
    said = {name.strip("`/ "): rest for names, *rest in re.findall(
        r"^\| (`[^|]*) \| (\w+) \| ([\w ]+) \| (last [^|]*|the last [^|]*) \|$", page, re.MULTILINE)
        for name in names.split(",")}
    assert set(said) == {row.name.strip("/") for row in TOPICS}
    ends: dict[str, list[Any]] = {}
    for more in ({}, {"pacing": "lockstep"}):
        node = bench.driveline(scene="commands", publish_shaft_torque=True, publish_stamped=True, **more)
        node.loop.clock.begin()
        node.loop.attach(CommandedInput(node, topic("output_speed")))
        node.loop.outputs.unsent["joint_states"] = 1
        node.loop.outputs.tell_unsent()
        for end in (*node.publishers, *node.subscriptions):
            ends.setdefault(end.topic_name.strip("/"), []).append(end.qos_profile)
    for name, (reliability, durability, history) in said.items():
        if name in ("target_slip_speed", "pressure_limits"):  # From the controller.
            continue
        profile, patient = ends[name]
        assert reliability == profile.reliability.name.lower()
        assert durability == profile.durability.name.lower().replace("_", " ")
        if history.startswith("the last 0.25 s"):
            assert (profile.depth, patient.history.name) == (250, "KEEP_ALL")
        else:
            assert history == f"last {profile.depth}"
