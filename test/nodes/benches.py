"""Bench for tests of the nodes: a ROS 2 context with a driveline, and a node that listens, sends and calls services."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

from tcc_sim.nodes.shared_memory import clear


def overrides(parameters: Mapping[str, object]) -> list[Any]:
    """Parameters of a node; two underscores mean a dot."""
    from rclpy.parameter import Parameter

    return [Parameter(name.replace("__", "."), value=value) for name, value in parameters.items()]


def stamp_of(message: Any) -> int:
    """Stamp of a message with a header, ns."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Commander:
    """Publishers of both commands, connected to their subscribers."""

    def __init__(self, bench: Bench, namespace: str = "", connected: bool = True) -> None:
        from sensor_msgs.msg import FluidPressure
        from std_msgs.msg import Float64

        from tcc_sim.nodes.middleware import COMMANDS

        self.node = bench.node("sender", namespace)
        self.torques = self.node.create_publisher(Float64, "engine_torque", COMMANDS)
        self.pressures = self.node.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
        if connected:
            bench.until(self.ready)

    def ready(self) -> bool:
        return bool(self.torques.get_subscription_count() and self.pressures.get_subscription_count())


def joined() -> Any:
    """A context in the domain of the environment, whose nodes no killed process of an earlier test can hang."""
    import rclpy
    from rclpy.context import Context

    context = Context()
    rclpy.init(context=context, args=[])
    clear(context.get_domain_id())
    return context


class Bench:
    """Separate ROS 2 context that no other sees, with an executor for the nodes of the test."""

    def __init__(self) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self.context = joined()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Any] = []

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def node(self, name: str, namespace: str = "", **parameters: object) -> Any:
        """A plain node."""
        import rclpy

        return self.add(rclpy.create_node(name, namespace=namespace, context=self.context,
                                          parameter_overrides=overrides(parameters)))

    @cached_property
    def probe(self) -> Any:
        """The node through which the test listens and calls."""
        return self.node("test")

    def driveline(self, namespace: str = "", **parameters: object) -> Any:
        """A driveline before its start; two underscores in a parameter's name mean a dot."""
        from tcc_sim.nodes.driveline import DrivelineNode

        return self.add(DrivelineNode(context=self.context, namespace=namespace,
                                      parameter_overrides=overrides(parameters)))

    def started(self, **parameters: object) -> Any:
        """A driveline whose loop runs in its thread."""
        node = self.driveline(**parameters)
        node.start()
        return node

    def remove(self, node: Any) -> None:
        """Destroy a node before the end."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def listen(self, kind: type, topic: str, qos: Any = None) -> list[Any]:
        """A list that receives the messages on a topic."""
        from tcc_sim.nodes.middleware import states

        heard: list[Any] = []
        self.probe.create_subscription(kind, topic, heard.append, qos or states(10_000))
        return heard

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self.probe.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def until(self, predicate: Callable[[], Any], limit: float = 120.0) -> Any:
        """Spin until the predicate holds; fail after `limit` seconds, long enough for a busy machine."""
        end = time.monotonic() + limit
        while not (result := predicate()):
            assert time.monotonic() < end, "the condition did not come true in time"
            self.executor.spin_once(timeout_sec=0.01)
        return result

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.context.try_shutdown()
