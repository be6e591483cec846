"""One recorded topic: its subscription, its channels in the bag, and what was lost of it on its way or never sent."""

from __future__ import annotations

import time
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
from tcc_sim.nodes.middleware import MOST_PUBLISHERS, SequenceNumbers, message_class, poll, publisher_of, subscribe
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.topics import JOINT_STATE

DEPTH = 20_000
"""Messages that wait per topic while the recorder is held up: 4 s at 5 kHz. Only those that wait take memory."""
MOST_TOPICS = 100
"""Topics of one driveline whose unsent messages are counted; it has a dozen."""
_MOST_ASKED = 20

Taken = list[tuple[bytes, dict[str, Any]]]
"""Serialised messages, each with what the middleware says of it."""


class Track(SequenceNumbers):
    """One recorded topic.

    Publishers that offer best effort alone have a second subscription, so that the reliable one of the others stays as
    it is.
    """

    def __init__(self, node: Node, topic: str, type_name: str, latched: bool = False) -> None:
        super().__init__()
        self.topic = topic
        self.type = type_name
        self.latched = latched
        self._node = node
        self.subscription = self._subscription(latched=latched)
        self._best_effort: Subscription[Any] | None = None
        self._heard_reliably: set[bytes] = set()
        self.publishers: set[bytes] = set()
        self.channels: dict[bytes, int] = {}
        self.messages = 0
        self.arrived = time.monotonic()
        self.silence_told = False
        self.stamps = StampCounter() if type_name == JOINT_STATE else None
        self._asked: Counter[bytes] = Counter()
        self._offered: set[bytes] = set()

    def subscribe(self, latched: bool) -> Taken:
        """Have a new reliable subscription; gives what waited in the one before."""
        before = self.take()
        self._node.destroy_subscription(self.subscription)
        self.latched, self.subscription = latched, self._subscription(latched=latched)
        return before

    def _subscription(self, reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
                      latched: bool = False) -> Subscription[Any]:
        """A subscription that is polled."""
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        return subscribe(self._node, message_class(self.type), self.topic,
                         QoSProfile(depth=DEPTH, reliability=reliability, durability=durability))

    def take(self) -> Taken:
        """What waits, every message once. It needs no valid context."""
        taken = poll(self.subscription)
        if len(self._heard_reliably) > MOST_PUBLISHERS:
            self._heard_reliably.clear()
        self._heard_reliably.update(who for _, info in taken if (who := publisher_of(info)))
        if self._best_effort is not None:
            taken += [(data, info) for data, info in poll(self._best_effort)
                      if publisher_of(info) not in self._heard_reliably]
        return taken

    def follow_best_effort(self, offered: Sequence[TopicEndpointInfo]) -> Taken:
        """Have the second subscription as long as a publisher offers best effort; gives what waited where it goes."""
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
        return waited

    def asks_again(self, publishers: Sequence[bytes]) -> bool:
        """Whether one of these has said nothing yet and should be asked again, which it is a limited number of times.

        What a publisher keeps for late subscribers comes seconds late where others were killed just before; a new
        subscription gets it at once.
        """
        if len(self._offered) > MOST_PUBLISHERS:
            self._offered, self._asked = set(), Counter({p: self._asked[p] for p in publishers})
        self._offered.update(publishers)
        if self.next and not self._offered & self.next.keys():
            return False  # This middleware names publishers in two ways, so who is silent cannot be known.
        silent = [publisher for publisher in publishers if publisher not in self.next
                  and self._asked[publisher] < _MOST_ASKED]
        self._asked.update(silent)
        return bool(silent)


def unsent_message(name: str, counts: Mapping[str, int]) -> bytes:
    """How many messages the node `name` could not send since its start, by topic, as the message on `unsent_messages`:
    no gap in a publisher's numbers shows them.
    """
    message = DiagnosticStatus(level=DiagnosticStatus.WARN, name=name,
                               message=f"{counted(sum(counts.values()), 'message')} not sent",
                               values=[KeyValue(key=topic, value=str(count)) for topic, count in counts.items()])
    data: bytes = serialize_message(message)
    return data


class UnsentCount:
    """Adds up what every driveline of a recording could not send, as it says; `most` of them are told apart."""

    def __init__(self, most: int = MOST_PUBLISHERS) -> None:
        self._most = most
        self._by_publisher: dict[bytes, dict[str, int]] = {}
        self._earlier: Counter[str] = Counter()

    def add(self, publisher: bytes, data: bytes) -> None:
        """Take a message; what is no such message says nothing."""
        try:
            values = deserialize_message(data, DiagnosticStatus).values
        except Exception:
            # Whatever rclpy makes of bytes that a stranger sent.
            return
        counts = {item.key: int(item.value) for item in values[:MOST_TOPICS]
                  if item.value.isdecimal() and len(item.value) < 19}
        if publisher not in self._by_publisher and len(self._by_publisher) >= self._most:
            self._earlier.update(self._by_publisher.pop(next(iter(self._by_publisher))))
        self._by_publisher[publisher] = counts

    def by_topic(self) -> dict[str, int]:
        """Messages of all drivelines."""
        total = Counter(self._earlier)
        for counts in self._by_publisher.values():
            total.update(counts)
        return dict(total)
