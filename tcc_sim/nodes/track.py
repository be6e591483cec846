"""A recorded topic: subscriptions, channels in the bag, log times, and counts of lost and unsent messages."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tcc_sim.errors import counted
from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import MOST_PUBLISHERS, SequenceNumbers, message_class, poll, publisher_of, subscribe
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.topics import JOINT_STATE

DEPTH = 20_000
"""Depth of the queue of each topic. Fast DDS stores 5000 messages, 1 s at 5 kHz, and refuses more until some are taken;
with a depth below that it would drop the oldest instead, even where the driveline waits.
"""
SILENCE = 3.0
"""Real time without messages that is reported, s; the middleware needs 20 s to detect a dead publisher."""
MOST_TOPICS = 100
"""Largest number of topics of one driveline whose unsent messages are counted; it has a dozen."""
_MOST_REQUESTS = 20

Taken = list[tuple[bytes, dict[str, Any]]]
"""Serialised messages, each with the middleware's message information."""


class SimulatedTime:
    """Times of /clock with their times of sending, by which a recorder with use_sim_time dates other messages.

    Times of receipt would not do: one thread sends all topics of a driveline, but several receive them.
    """

    def __init__(self) -> None:
        self._sent: list[int] = []
        self._stamps: list[int] = []

    @property
    def known(self) -> bool:
        """Whether a message on /clock has been received."""
        return bool(self._sent)

    def follow(self, taken: Taken) -> None:
        """Add messages of /clock."""
        for data, info in taken:
            sent = info["source_timestamp"] or info["received_timestamp"]
            self._sent.append(max(sent, self._sent[-1] if self._sent else sent))
            self._stamps.append(cdr.read_stamp(data))
        if len(self._sent) > 2 * DEPTH:
            del self._sent[:-DEPTH], self._stamps[:-DEPTH]

    def of(self, info: Mapping[str, Any]) -> int:
        """Return the last time on /clock, ns, before a message was sent, or the first if none was before it."""
        sent = info["source_timestamp"] or info["received_timestamp"]
        return self._stamps[max(bisect_right(self._sent, sent) - 1, 0)]


class Track(SequenceNumbers):
    """A recorded topic.

    Best-effort publishers get a second subscription, so that the reliable subscription for the others stays unchanged.
    """

    def __init__(self, node: Node, topic: str, type_name: str, latched: bool = False) -> None:
        super().__init__()
        self.topic = topic
        self.type = type_name
        self.latched = latched
        self._node = node
        self.subscription = self._subscription(latched=latched)
        self._before: dict[bytes, range] = {}  # Numbers of messages from replaced subscriptions; they may come again.
        self._best_effort: Subscription[Any] | None = None
        self._heard_reliably: set[bytes] = set()
        self.publishers: set[bytes] = set()
        self.channels: dict[bytes, int] = {}
        self.messages = 0
        self.arrived = time.monotonic()
        self._silent = False
        self.stamps = StampCounter() if type_name == JOINT_STATE else None
        self._requests: Counter[bytes] = Counter()
        self._offered: set[bytes] = set()

    def _subscription(self, reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
                      latched: bool = False) -> Subscription[Any]:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        return subscribe(self._node, message_class(self.type), self.topic,
                         QoSProfile(depth=DEPTH, reliability=reliability, durability=durability))

    def take(self) -> Taken:
        """Take the waiting messages, each once, and count the lost ones; this needs no valid context."""
        taken = poll(self.subscription)
        if self._before:
            taken = [(data, info) for data, info in taken
                     if info.get("publication_sequence_number") not in self._before.get(publisher_of(info), ())]
        if len(self._heard_reliably) > MOST_PUBLISHERS:
            self._heard_reliably.clear()
        self._heard_reliably.update(who for _, info in taken if (who := self.count(info)))
        if self._best_effort is not None:
            others = [(data, info) for data, info in poll(self._best_effort)
                      if publisher_of(info) not in self._heard_reliably]
            for _, info in others:
                self.count(info)
            taken += others
        if taken:
            self.arrived = time.monotonic()
        return taken

    def fell_silent(self) -> bool | None:
        """Return True once when no message has arrived for SILENCE seconds, and False once when they arrive again."""
        silent = time.monotonic() - self.arrived > SILENCE
        changed, self._silent = silent != self._silent, silent
        return silent if changed else None

    def follow(self, offered: Sequence[TopicEndpointInfo], again: bool = False) -> Taken:
        """Adapt to the publishers: keep the second subscription while one offers best effort, and subscribe to latched
        messages while all are latched, with `again` once more for a publisher that has sent nothing.

        Return the messages that waited in subscriptions that are replaced.
        """
        needed = False
        for publisher in offered:
            if publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                needed = True
            else:
                self._heard_reliably.add(bytes(publisher.endpoint_gid))
        waited: Taken = []
        if needed and self._best_effort is None:
            self._best_effort = self._subscription(ReliabilityPolicy.BEST_EFFORT)
        elif self._best_effort is not None and not needed:
            waited = self.take()
            self._node.destroy_subscription(self._best_effort)
            self._best_effort = None
        if offered:
            latched = all(one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in offered)
            late = latched and again and self._asks_again([bytes(one.endpoint_gid) for one in offered])
            if late or latched != self.latched:
                waited += self.take()
                self._node.destroy_subscription(self.subscription)
                self.latched, self.subscription = latched, self._subscription(latched=latched)
                self._before = dict(self.numbers)
        return waited

    def _asks_again(self, publishers: Sequence[bytes]) -> bool:
        """Return whether to subscribe again because one of these publishers has sent nothing, within a limit.

        Latched messages arrive seconds late if other processes were killed just before; a new subscription gets them
        at once.
        """
        if len(self._offered) > MOST_PUBLISHERS:
            self._offered, self._requests = set(), Counter({p: self._requests[p] for p in publishers})
        self._offered.update(publishers)
        if self.numbers and not self._offered & self.numbers.keys():
            return False  # This middleware has two identifiers of a publisher, so silent ones cannot be identified.
        silent = [publisher for publisher in publishers if publisher not in self.numbers
                  and self._requests[publisher] < _MOST_REQUESTS]
        self._requests.update(silent)
        return bool(silent)


def unsent_message(name: str, counts: Mapping[str, int]) -> bytes:
    """Return the message on `unsent_messages` with the numbers of messages, by topic, that the node `name` could not
    send since its start; sequence numbers do not show them.
    """
    message = DiagnosticStatus(level=DiagnosticStatus.WARN, name=name,
                               message=f"{counted(sum(counts.values()), 'message')} not sent",
                               values=[KeyValue(key=topic, value=str(count)) for topic, count in counts.items()])
    data: bytes = serialize_message(message)
    return data


class UnsentCount:
    """Sum of the unsent messages of all drivelines of a recording; at most MOST_PUBLISHERS are distinguished."""

    def __init__(self) -> None:
        self.by_topic: Counter[str] = Counter()
        self._last: dict[bytes, Counter[str]] = {}

    def add(self, publisher: bytes, data: bytes) -> None:
        """Add a message; ignore bytes that are not a valid message."""
        try:
            values = deserialize_message(data, DiagnosticStatus).values
        except Exception:
            # rclpy raises various exceptions on invalid bytes.
            return
        counts = Counter({item.key: int(item.value) for item in values[:MOST_TOPICS]
                          if item.value.isdecimal() and len(item.value) < 19})
        self.by_topic.update(counts)
        self.by_topic.subtract(self._last.get(publisher, {}))
        if publisher not in self._last and len(self._last) >= MOST_PUBLISHERS:
            del self._last[next(iter(self._last))]
        self._last[publisher] = counts
