"""Asks a driveline for its scene, so that a recording can be understood and solved again from itself."""

from __future__ import annotations

import time
from typing import Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tcc_sim.recording.bag import McapFile

_PATIENCE = 2.0


class SceneQuery:
    """Watches who publishes joint_states, asks every new publisher for its parameter scene_text, and never waits for it."""

    def __init__(self, node: Node, bag: McapFile) -> None:
        self._node = node
        self._bag = bag
        self._publishers: dict[str, dict[bytes, str]] = {}
        self._asked: list[tuple[str, float, Client[Any, Any], Future[Any] | None]] = []

    def look(self, topic: str, offered: list[TopicEndpointInfo]) -> None:
        """Note the publishers of a topic: ask new ones, tell of those that are gone."""
        before = self._publishers.get(topic, {})
        now = {bytes(o.endpoint_gid): f"{o.node_namespace.rstrip('/')}/{o.node_name}" for o in offered}
        for publisher, name in now.items():
            if publisher not in before:
                client = self._node.create_client(GetParameters, f"{name}/get_parameters")
                self._asked.append((name, time.monotonic() + _PATIENCE, client, None))
        if before and not now:
            self._node.get_logger().warning(f"the publisher of {topic} is gone; the recording goes on")
        self._publishers[topic] = now

    def collect(self) -> None:
        """Send what waits for its service, take in the answers, and give up on those that are late."""
        waiting = []
        for name, deadline, client, future in self._asked:
            if future is None and client.service_is_ready():
                future = client.call_async(GetParameters.Request(names=["scene_text"]))
            if future is not None and future.done():
                self._answer(name, future)
            elif time.monotonic() < deadline:
                waiting.append((name, deadline, client, future))
                continue
            else:
                self._node.get_logger().warning(f"{name} does not say its scene: the recording holds none of it")
            self._node.destroy_client(client)
        self._asked = waiting

    def _answer(self, name: str, future: Future[Any]) -> None:
        """Write the scene into the bag."""
        response = future.result()
        values = [] if response is None else response.values
        if len(values) == 1 and values[0].type == ParameterType.PARAMETER_STRING and values[0].string_value:
            self._bag.describe(values[0].string_value, log_ns=time.time_ns())
        else:
            self._node.get_logger().warning(f"{name} has no scene: the recording holds none of it")
