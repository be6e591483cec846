"""The slip controller example closes the loop with the driveline node; the recorded run shows its target."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

import tcc_sim
from tcc_sim.cli.nodes import controller_of
from tcc_sim.nodes.slip_controller import QOS, SlipControllerNode
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.scene import load_scene


def test_the_target_is_said_latched_and_the_demo_starts_a_controller_for_the_scenes_that_need_one(bench: Any) -> None:
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


def test_the_scene_is_the_one_that_the_controller_is_tuned_for() -> None:
    system = load_scene("controlled").system
    tuning = Tuning()
    assert tuning.torque_per_pressure == pytest.approx(system.torque_per_pressure, rel=1e-12)
    assert (tuning.frequency, tuning.inertia) == (system.engine.frequency, system.driveline.flywheel_inertia)


def test_target_bandwidth_and_limits_change_while_it_runs_and_are_published_and_judged_by(driveline: Any) -> None:
    rig = driveline("controlled")
    node = rig.add(SlipControllerNode())
    first = rig.run(seconds=0.4)
    assert first.tracking.limits == (0.0, 6e5)
    changes = {"target": 30.0, "bandwidth": 10.0, "pressure_limit": 95e3}
    assert node.set_parameters_atomically([Parameter(*pair) for pair in (
        (name, Parameter.Type.DOUBLE, value) for name, value in changes.items())]).successful
    second = rig.run(seconds=0.4)
    assert (second.target[0], second.tracking.limits) == (30.0, (0.0, 95e3))  # type: ignore[index]
    law, tuning = SlipController(Tuning()), Tuning(**changes)

    def answer(reading: Any) -> float:
        if reading.stamp_ns == 401_000_000:  # The state of 0.4 s came before the change.
            law.use(tuning)
            law.target = 30.0
        return law.update(reading.flywheel_speed - reading.plate_speed, reading.engine_torque)

    alone = tcc_sim.closed_loop("controlled", answer, 0.8)
    np.testing.assert_array_equal(second.slip_speed, alone.slip_speed[400:])
    for name, value, said in (("bandwidth", -1.0, "bandwidth is -1 rad/s; it must be above 0 rad/s"),
                              ("inertia", 0.3, "read-only")):
        (result,) = node.set_parameters([Parameter(name, value=value)])
        assert not result.successful
        assert said in result.reason
    with pytest.raises(AssertionError, match=r"settling time.*0\.001 s"):
        first.tracking.within(settling=0.001)
