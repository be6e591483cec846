"""Messages that the driveline could not send, as it tells the recorder: no gap in a publisher's numbers shows them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message, serialize_message

from tcc_sim.errors import counted
from tcc_sim.nodes.track import MOST_PUBLISHERS

MOST_TOPICS = 100
"""Topics of one driveline that are counted; it has a dozen."""


def encoded(name: str, counts: Mapping[str, int]) -> bytes:
    """The counts of the node `name` since its start, by topic, as the message on `unsent_messages`."""
    message = DiagnosticStatus(level=DiagnosticStatus.WARN, name=name,
                               message=f"{counted(sum(counts.values()), 'message')} not sent",
                               values=[KeyValue(key=topic, value=str(count)) for topic, count in counts.items()])
    data: bytes = serialize_message(message)
    return data


class UnsentCount:
    """Adds up what every driveline of a recording says of itself; `most` of them are told apart."""

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
