"""One recorded topic: its subscription, its channels in the bag, and what was lost of it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from rclpy.subscription import Subscription

from tcc_sim.recording.stamps import StampCounter
from tcc_sim.topics import JOINT_STATE

MOST_PUBLISHERS = 1000
"""Publishers of a topic that are told apart; a driveline that is restarted every minute reaches it in 16 hours."""
_MOST_ASKED = 20


class Track:
    """One recorded topic."""

    def __init__(self, topic: str, type_name: str) -> None:
        self.topic = topic
        self.type = type_name
        self.subscription: Subscription[Any] | None = None
        self.best_effort = False
        self.latched = False
        self.publishers: set[bytes] = set()
        self.channels: dict[bytes, int] = {}
        self.messages = 0
        self.lost = 0
        self.arrived = time.monotonic()
        self.silence_told = False
        self.stamps = StampCounter() if type_name == JOINT_STATE else None
        self._next: dict[bytes, int] = {}
        self._asked: Counter[bytes] = Counter()
        self._offered: set[bytes] = set()

    def count(self, publisher: bytes, number: int) -> None:
        """Count what is missing between this message and the one that the same publisher sent before it."""
        if publisher not in self._next and len(self._next) >= MOST_PUBLISHERS:
            del self._next[next(iter(self._next))]
        expected = self._next.get(publisher, number)
        if number > expected:
            self.lost += number - expected
        self._next[publisher] = number + 1

    def asks_again(self, publishers: Sequence[bytes]) -> bool:
        """Whether one of these has said nothing yet and should be asked again, which it is a limited number of times.

        What a publisher keeps for late subscribers comes seconds late where others were killed just before; a new
        subscription gets it at once.
        """
        if len(self._offered) > MOST_PUBLISHERS:
            self._offered, self._asked = set(), Counter({p: self._asked[p] for p in publishers})
        self._offered.update(publishers)
        if self._next and not self._offered & self._next.keys():
            return False  # This middleware names publishers in two ways, so who is silent cannot be known.
        silent = [publisher for publisher in publishers if publisher not in self._next
                  and self._asked[publisher] < _MOST_ASKED]
        self._asked.update(silent)
        return bool(silent)
