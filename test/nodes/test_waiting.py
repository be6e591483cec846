"""Every reason why commands do not act is reported: publishers, lock-step and the first tick."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Int8

from tcc_sim.nodes.driveline import PATIENCE, DrivelineNode, Waiting


class Judged:
    """The sentences of a driveline on its waits, by a clock of the test."""

    def __init__(self, node: DrivelineNode) -> None:
        self.node, self.now = node, 0.0
        self.waiting = Waiting(node, node.loop, lambda: self.now)

    def said(self, after: float = PATIENCE) -> dict[str, str]:
        self.waiting.sentences()
        self.now += after
        return self.waiting.sentences()

    def holds(self, name: str, *parts: str, after: float = PATIENCE) -> bool:
        """Return whether the sentence on a subject has these parts."""
        sentence = self.said(after).get(name, "")
        return all(part in sentence for part in parts)


def begun(bench: Any, **parameters: Any) -> Judged:
    node = bench.started(scene="controlled", wait_for_subscribers=0, **parameters)
    bench.until(node.loop.clock_started.is_set)
    return Judged(node)


def publisher(bench: Any, name: str, reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE) -> Any:
    profile = QoSProfile(depth=10, reliability=reliability)
    return bench.node(name).create_publisher(FluidPressure, "actuation_pressure", profile)


def test_an_input_on_its_fallback_names_its_topic_and_who_publishes_there(bench: Any) -> None:
    judged = begun(bench)
    assert judged.said(0.9 * PATIENCE) == {}
    assert judged.holds("actuation_pressure", "/actuation_pressure", "mean", "0 publishers", "since 4 s", after=3.0)
    hasty = publisher(bench, "hasty", reliability=ReliabilityPolicy.BEST_EFFORT)
    bench.until(lambda: judged.node.get_publishers_info_by_topic("actuation_pressure"))
    hasty.publish(FluidPressure(fluid_pressure=2e5))
    assert judged.holds("actuation_pressure", "1 publisher", "hasty (best effort, volatile", "reliably")


def test_refused_commands_are_the_reason_and_a_command_ends_it(bench: Any) -> None:
    judged = begun(bench, command_timeout=0.0)
    sender = publisher(bench, "sender")
    command = judged.node.loop.inputs["actuation_pressure"]
    bench.until(sender.get_subscription_count)
    for _ in range(3):
        sender.publish(FluidPressure(fluid_pressure=math.nan))
    bench.until(lambda: command.refused == 3)
    assert judged.holds("actuation_pressure", "3 commands refused", "nan Pa")
    sender.publish(FluidPressure(fluid_pressure=2e5))
    bench.until(lambda: command.received == 1)
    assert judged.said() == {}
    publisher(bench, "second")
    bench.until(lambda: command.subscription.get_publisher_count() == 2)
    assert judged.holds("actuation_pressure publishers", "2 publishers", "sender (reliable, volatile)",
                        "second (reliable, volatile)")
    judged.node.loop.request(lambda: (judged.node.loop.reset(), judged.node.loop.pause(True)))
    assert "actuation_pressure" not in judged.said()


def test_lockstep_says_what_it_waits_for_and_since_when(bench: Any) -> None:
    judged = begun(bench, pacing="lockstep", command_timeout=0.0)
    sender = publisher(bench, "sender")
    bench.until(sender.get_subscription_count)
    for tick, after in ((1, 7.0), (2, 2.0)):
        sender.publish(FluidPressure(fluid_pressure=2e5))
        bench.until(lambda n=tick: judged.node.loop.plant.stepper.tick == n and judged.node.loop.waits_for)
        judged.now += 7.0
        assert judged.waiting.sentences() == {}  # A slow controller answered: this is another wait.
        judged.now += after
        said = judged.waiting.sentences()["actuation_pressure"]
        assert all(part in said for part in (f"{0.001 * tick:g} s", "1 publisher", "sender", f"since {after:g} s"))
    # The command for the state at 0 has its stamp, the second has none.
    assert "no stamp" in judged.waiting.unstamped()["actuation_pressure"]


def test_subscribers_that_do_not_come_are_asked_for(bench: Any) -> None:
    node = bench.driveline(scene="minimal", wait_for_subscribers=2)
    bench.listen(JointState, "joint_states")
    bench.listen(Int8, "stick_slip_state")
    bench.until(lambda: node.loop.outputs.subscriptions()[0] == 1)
    assert Judged(node).holds("subscribers", "wait_for_subscribers 2", "1 subscriber", "since 2 s", after=2.0)
