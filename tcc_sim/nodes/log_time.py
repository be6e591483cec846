"""Log times of a recorder with use_sim_time: the simulation time at which a message was sent."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from typing import Any

from tcc_sim.messages import cdr
from tcc_sim.nodes.track import DEPTH, Taken


class SimulatedTime:
    """Times of /clock with their times of sending, by which messages on other topics are dated.

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
        """Return the simulation time, ns, at which a message was sent: the last time on /clock before it, or the first
        if none was before it.
        """
        sent = info["source_timestamp"] or info["received_timestamp"]
        return self._stamps[max(bisect_right(self._sent, sent) - 1, 0)]
