"""How fast a recording ran: simulated against real time."""

from __future__ import annotations

import math

from tcc_sim.recording.batches import JointStates


class Pace:
    """Simulated time against the real time at which messages were received; resets and restarts count from anew.

    The first batch of a run only sets the start: its messages may have waited for the recorder to be discovered.
    """

    def __init__(self) -> None:
        self._simulated = self._real = 0.0
        self._last: tuple[int, int, int] | None = None

    def add(self, batch: JointStates) -> None:
        """Take the next messages, all of one run."""
        if len(batch):
            before, self._last = self._last, (batch.run, int(batch.stamp_ns[-1]), int(batch.log_ns[-1]))
            begin = before if before is not None and before[0] == batch.run else self._last
            if self._last[2] < begin[2]:
                return  # The clock was set back: this batch says nothing.
            self._simulated += self._last[1] - begin[1]
            self._real += self._last[2] - begin[2]

    def factor(self) -> float:
        """Simulated over real time; NaN where no real time passed, as in a recording that was not made live."""
        return self._simulated / self._real if self._real > 0.0 else math.nan
