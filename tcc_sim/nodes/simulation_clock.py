"""Publish /clock where nodes need it, and detect its other publishers and its subscribers."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tcc_sim.messages import cdr
from tcc_sim.nodes.loop_topics import Outputs
from tcc_sim.scene import Operation
from tcc_sim.topics import CLOCK_TOPIC


class SimulationClock:
    """Publisher of /clock, active with `publish_clock`, and in lock-step if a node with use_sim_time subscribes.

    It stays inactive if another node publishes /clock.

    Parameters
    ----------
    node : node of the driveline
    outputs : topics of the driveline
    operation : options of the driveline

    Attributes
    ----------
    published : whether the driveline publishes /clock
    """

    def __init__(self, node: Node, outputs: Outputs, operation: Operation) -> None:
        self._node, self._outputs = node, outputs
        self._wanted, self._lockstep = operation.publish_clock, operation.pacing == "lockstep"
        self._topic = node.resolve_topic_name(CLOCK_TOPIC)
        self.published = False

    @property
    def followers(self) -> list[str]:
        """Names of the other nodes with use_sim_time, for which rclpy and rclcpp subscribe with best effort; others,
        such as a recorder, subscribe reliably.
        """
        me = self._node.get_fully_qualified_name()
        return [name for name in _names([info for info in self._node.get_subscriptions_info_by_topic(self._topic)
                                         if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT])
                if name != me]

    @property
    def rivals(self) -> list[str]:
        """Names of the other nodes that publish /clock."""
        names, me = _names(self._node.get_publishers_info_by_topic(self._topic)), self._node.get_fully_qualified_name()
        if self.published and me in names:
            names.remove(me)
        return names

    @property
    def due(self) -> bool:
        """Whether the driveline should publish /clock and does not yet."""
        return not self.published and (self._wanted or (self._lockstep and bool(self.followers))) and not self.rivals

    def begin(self, stamp_ns: int | None = None) -> None:
        """Publish /clock from the next state on, and `stamp_ns`, the simulation time of the last state, if given.

        Known subscribers are connected first, except by a driveline that runs in real time.
        """
        self._outputs.add(CLOCK_TOPIC)
        self.published = True
        if self._lockstep or stamp_ns is None:
            self._outputs.meet(CLOCK_TOPIC)
        if stamp_ns is not None:
            self._outputs.say(CLOCK_TOPIC, cdr.clock(stamp_ns + self._outputs.zero_ns))

    def sentence(self) -> str:
        """Return a warning about the clock; empty without a problem."""
        rivals = ", ".join(self.rivals)
        if rivals and self.published:
            return f"{self._topic} is published by {rivals} too, and simulation time jumps: end one of them"
        if rivals and self._wanted:
            return f"{self._topic} is published by {rivals} already, so this node does not publish it"
        followers = ", ".join(self.followers)
        if followers and not rivals and not self.published and not self._lockstep:
            return f"{followers} with use_sim_time waits for {self._topic}, which nobody publishes: set publish_clock"
        return ""


def _names(endpoints: Sequence[TopicEndpointInfo]) -> list[str]:
    return [f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints]
