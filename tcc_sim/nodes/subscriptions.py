"""Subscriptions that are polled: raw messages, taken when their owner has time, without an executor."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription


class Polled(CallbackGroup):
    """A callback group that no executor ever executes: its subscriptions wait for `poll`."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing ends that never begins."""


def subscribe(node: Node, message_class: type, topic: str, qos: QoSProfile) -> Subscription[Any]:
    """A raw subscription that only `poll` reads."""
    return node.create_subscription(message_class, topic, _unused, qos, callback_group=Polled(), raw=True)


def _unused(message: bytes) -> None:
    """The callback that rclpy asks for and nothing calls."""


def poll(subscription: Subscription[Any], most: int = 100_000) -> list[tuple[bytes, dict[str, Any]]]:
    """Take up to `most` waiting messages: serialised bytes and message information each.

    It works on after the context was shut down, so that the last messages can still be saved.
    """
    taken: list[tuple[bytes, dict[str, Any]]] = []
    handle, message_class, raw = subscription.handle, subscription.msg_type, subscription.raw
    with handle:
        take = handle.take_message
        while len(taken) < most:
            item = take(message_class, raw)
            if item is None:
                break
            taken.append(item)
    return taken
