"""What the nodes ask of the middleware: message types by their names, qualities of service, and subscriptions that are
polled: raw messages, taken when their owner has time, without an executor, with what is missing between them.

The driveline's own messages are encoded by `tcc_sim.messages.cdr`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.subscription import Subscription

from tcc_sim.errors import InputError

COMMANDS = QoSProfile(depth=100)
"""What the driveline asks of those who send commands; reliable and volatile, as all where nothing else is said."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Whoever subscribes later still gets the last one."""

CHANGES = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Whoever subscribes later still gets the last thousand, none of which replaces the one before."""

DIAGNOSTICS = QoSProfile(depth=10)
"""For /diagnostics, as diagnostic_aggregator expects it."""

MOST_TAKEN = 100_000
"""Messages taken at once: whoever sends faster than they are taken does not hold who takes them."""
MOST_PUBLISHERS = 1000
"""Publishers of a topic that are told apart; a driveline that is restarted every minute reaches it in 16 hours."""
_NANOSECONDS = 1_000_000_000


def states(depth: int) -> QoSProfile:
    """What the driveline offers: nothing is lost as long as a subscriber falls back by less than `depth` messages.

    With depth 0 all are kept, so that the driveline waits for a slow subscriber.
    """
    return QoSProfile(history=HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL, depth=depth)


def message_class(type_name: str) -> type:
    """The Python class of `package/msg/Name`.

    Raises
    ------
    InputError
        Not a message type, or its package is not installed.
    """
    from tcc_sim.messages.definitions import type_parts

    package, short = type_parts(type_name)
    try:
        found: type = getattr(import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError):
        raise InputError(f"message type {type_name} is not installed") from None
    return found


def time_of(nanoseconds: int) -> Time:
    """A time as messages have it; what their 32 bits of seconds do not hold, from 2038 on, is their last second."""
    sec, nanosec = divmod(nanoseconds, _NANOSECONDS)
    return Time(sec=min(sec, 2**31 - 1), nanosec=nanosec)


def qos_fields(profile: QoSProfile) -> dict[str, Any]:
    """A quality of service as rosbag2 writes it."""
    return {"history": profile.history.name.lower(), "depth": profile.depth,
            "reliability": profile.reliability.name.lower(),
            "durability": profile.durability.name.lower(), "deadline": _duration(profile.deadline.nanoseconds),
            "lifespan": _duration(profile.lifespan.nanoseconds), "liveliness": profile.liveliness.name.lower(),
            "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
            "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions}


def _duration(nanoseconds: int) -> dict[str, int]:
    """Seconds and nanoseconds; ROS says 0 for no limit, rosbag2 the largest number."""
    sec, nsec = divmod(nanoseconds or 2**63 - 1, _NANOSECONDS)
    return {"sec": sec, "nsec": nsec}


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


def publisher_of(info: Mapping[str, Any]) -> bytes:
    """Who sent a message; empty where the middleware does not say."""
    publisher = info.get("publisher_gid")
    return bytes(publisher["data"]) if publisher else b""


class SequenceNumbers:
    """What is missing between the messages of one topic, by the numbers that each publisher gives its own.

    Attributes
    ----------
    lost : missing messages
    next : by publisher, the number that its next message has
    """

    def __init__(self) -> None:
        self.lost = 0
        self.next: dict[bytes, int] = {}

    def count(self, publisher: bytes, number: int) -> None:
        """Count what is missing between this message and the one that the same publisher sent before it."""
        if publisher not in self.next and len(self.next) >= MOST_PUBLISHERS:
            del self.next[next(iter(self.next))]
        expected = self.next.get(publisher, number)
        if number > expected:
            self.lost += number - expected
        self.next[publisher] = number + 1
