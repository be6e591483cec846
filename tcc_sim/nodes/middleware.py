"""Middleware for the nodes: message types by name, qualities of service, polled raw subscriptions, and lost messages.

`tcc_sim.messages.cdr` encodes the driveline's own messages.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tcc_sim.errors import InputError

COMMANDS = QoSProfile(depth=100)
"""Quality of service of commands: reliable and volatile, the default here."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber gets the last message."""

CHANGES = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber gets the last 1000 messages, for topics whose messages do not replace earlier ones."""

DIAGNOSTICS = QoSProfile(depth=10)
"""Quality of service of /diagnostics that diagnostic_aggregator expects."""

Found = TypeVar("Found")
MEETING, LOOK = 1.0, 1e-3
"""Longest real time to connect to a known peer, and between two checks, s."""
MOST_TAKEN = 100_000
"""Largest number of messages taken at once, so that a fast sender cannot block the reader."""
MOST_PUBLISHERS = 1000
"""Largest number of publishers distinguished on a topic; a driveline restarted every minute reaches it in 16 hours."""
_NANOSECONDS = 1_000_000_000


def states(depth: int) -> QoSProfile:
    """Return the quality of service of states.

    No message is lost while a subscriber lags by less than `depth` messages. With depth 0 all messages are stored, so
    that the driveline waits for a slow subscriber.
    """
    return QoSProfile(history=HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL, depth=depth)


def message_class(type_name: str) -> type:
    """Return the Python class of `package/msg/Name`.

    Raises InputError: the name is not a message type, or its package is not installed.
    """
    from tcc_sim.messages.definitions import type_parts

    package, short = type_parts(type_name)
    try:
        kind: type = getattr(import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError):
        raise InputError(f"message type {type_name} is not installed") from None
    return kind


def qos_fields(profile: QoSProfile) -> dict[str, Any]:
    """Return a quality of service in rosbag2's format."""
    return {"history": profile.history.name.lower(), "depth": profile.depth,
            "reliability": profile.reliability.name.lower(),
            "durability": profile.durability.name.lower(), "deadline": _duration(profile.deadline.nanoseconds),
            "lifespan": _duration(profile.lifespan.nanoseconds), "liveliness": profile.liveliness.name.lower(),
            "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
            "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions}


def _duration(nanoseconds: int) -> dict[str, int]:
    """Return seconds and nanoseconds; no limit is 0 in ROS and the largest number in rosbag2."""
    sec, nsec = divmod(nanoseconds or 2**63 - 1, _NANOSECONDS)
    return {"sec": sec, "nsec": nsec}


class Polled(CallbackGroup):
    """Callback group that no executor executes, for subscriptions that are read by `poll`."""

    def can_execute(self, entity: Any) -> bool:
        """Return False always."""
        return False

    beginning_execution = ending_execution = can_execute


def subscribe(node: Node, message_class: type, topic: str, qos: QoSProfile) -> Subscription[Any]:
    """Create a raw subscription that only `poll` reads."""
    # rclpy needs a callback, which is never called.
    return node.create_subscription(message_class, topic, lambda _: None, qos, callback_group=Polled(), raw=True)


def taker(subscription: Subscription[Any]) -> Callable[[], tuple[bytes, dict[str, Any]] | None]:
    """Return a function that takes the next waiting message or None; the caller keeps the subscription alive."""
    return partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)


def poll(subscription: Subscription[Any], most: int = MOST_TAKEN) -> list[tuple[bytes, dict[str, Any]]]:
    """Take up to `most` waiting messages, each with serialised bytes and message information.

    This also works after the context was shut down, so that the last messages can still be saved.
    """
    with subscription.handle:
        return list(islice(iter(taker(subscription), None), most))


def wait_until(met: Callable[[], Found], limit: float = MEETING) -> Found:
    """Wait until `met()` is true, at most `limit` seconds, and return its last value."""
    since = time.monotonic()
    while not (found := met()) and time.monotonic() - since < limit:
        time.sleep(LOOK)
    return found


def nodes_of(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Return the fully qualified names of the nodes of publishers or subscriptions."""
    return [f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints]


def publisher_of(info: Mapping[str, Any]) -> bytes:
    """Return the identifier of a message's publisher; empty if the middleware does not give it."""
    publisher = info.get("publisher_gid")
    return bytes(publisher["data"]) if publisher else b""


class SequenceNumbers:
    """Counter of lost messages of one topic by the publishers' sequence numbers.

    Attributes
    ----------
    lost : number of lost messages: newer ones replaced them in the queue, or they were lost on the way
    numbers : publisher -> sequence numbers from its first to its last message
    """

    def __init__(self) -> None:
        self.lost = 0
        self.numbers: dict[bytes, range] = {}

    def count(self, info: Mapping[str, Any]) -> bytes:
        """Count the messages missing between this message and its publisher's last one, and return the publisher."""
        publisher, number = publisher_of(info), info.get("publication_sequence_number")
        if not publisher or not number:
            return publisher
        if publisher not in self.numbers and len(self.numbers) >= MOST_PUBLISHERS:
            del self.numbers[next(iter(self.numbers))]
        known = self.numbers.get(publisher, range(number, number))
        self.lost += max(0, number - known.stop)
        self.numbers[publisher] = range(min(number, known.start), max(number + 1, known.stop))
        return publisher
