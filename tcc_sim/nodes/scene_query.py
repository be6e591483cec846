"""Asks a driveline for its scene, so that a recording can be understood and solved again from itself."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo

_ASK_AGAIN = 1.0
_PATIENCE = 5.0


@dataclass
class _Question:
    """A publisher that has not said its scene yet."""

    driveline: str
    since: float
    sent: float = 0.0
    future: Future[Any] | None = None
    warned: bool = False


class SceneQuery:
    """Watches who publishes joint_states, asks every new publisher for its parameter scene_text, and never waits for it.

    Discovery takes up to some seconds where a process has just been killed, so it goes on asking as long as the publisher is
    there. The client of a driveline of the usual name exists from the start, which saves one round of discovery.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publishers: dict[str, dict[bytes, str]] = {}
        self._open: dict[bytes, _Question] = {}
        self._clients: dict[str, Client[Any, Any]] = {}
        self._client(f"{node.get_namespace().rstrip('/')}/driveline")

    def look(self, topic: str, offered: list[TopicEndpointInfo]) -> None:
        """Note the publishers of a topic: ask new ones, tell of those that are gone."""
        before = self._publishers.get(topic, {})
        now = {bytes(o.endpoint_gid): f"{o.node_namespace.rstrip('/')}/{o.node_name}" for o in offered}
        for publisher in now.keys() - before.keys():
            self._open[publisher] = _Question(now[publisher], time.monotonic())
        for publisher in before.keys() - now.keys():
            self._open.pop(publisher, None)
        if before and not now:
            self._node.get_logger().warning(f"the publisher of {topic} is gone; the recording goes on")
        self._publishers[topic] = now

    def collect(self) -> list[str]:
        """Send what waits for its service; gives the scenes (YAML) that were answered."""
        answers = []
        now = time.monotonic()
        for publisher, question in list(self._open.items()):
            client = self._client(question.driveline)
            if question.future is not None and question.future.done():
                answers.append(self._answer(question))
                del self._open[publisher]
                continue
            if now - question.sent > _ASK_AGAIN and client.service_is_ready():
                if question.future is not None:
                    client.remove_pending_request(question.future)
                question.future, question.sent = client.call_async(GetParameters.Request(names=["scene_text"])), now
            if not question.warned and now - question.since > _PATIENCE:
                question.warned = True
                self._node.get_logger().warning(f"{question.driveline} does not say its scene; the recording holds none yet")
        return list(filter(None, answers))

    def _client(self, driveline: str) -> Client[Any, Any]:
        """The client of a driveline's parameter service, made once."""
        if driveline not in self._clients:
            self._clients[driveline] = self._node.create_client(GetParameters, f"{driveline}/get_parameters")
        return self._clients[driveline]

    def _answer(self, question: _Question) -> str:
        """The scene that was answered; empty where the driveline has none."""
        assert question.future is not None
        response = question.future.result()
        values = [] if response is None else response.values
        if len(values) == 1 and values[0].type == ParameterType.PARAMETER_STRING and values[0].string_value:
            return str(values[0].string_value)
        self._node.get_logger().warning(f"{question.driveline} has no scene; the recording holds none of it")
        return ""
