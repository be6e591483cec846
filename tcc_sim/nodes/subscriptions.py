"""Subscriptions that are polled: raw messages, taken when their owner has time, without an executor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

MOST_TAKEN = 100_000
"""Messages taken at once: whoever sends faster than they are taken does not hold who takes them."""


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


def taker(subscription: Subscription[Any]) -> Callable[[], tuple[bytes, dict[str, Any]] | None]:
    """What takes the next waiting message, None where there is none; who calls it sees to it that the subscription is
    there.
    """
    return partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)


def poll(subscription: Subscription[Any], most: int = MOST_TAKEN) -> list[tuple[bytes, dict[str, Any]]]:
    """Take up to `most` waiting messages: serialised bytes and message information each.

    It works on after the context was shut down, so that the last messages can still be saved.
    """
    with subscription.handle:
        return list(islice(iter(taker(subscription), None), most))
