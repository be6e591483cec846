"""Gaps and restarts in the stamps of a run, which are whole multiples of the tick."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_MOST_DIFFERENCES = 100_000


@dataclass
class StampCount:
    """Counts stamps as they arrive, in pieces of any size, and works out at the end how many are missing.

    The tick is the most frequent difference between stamps, so a gap at the very start does no harm. A stamp that falls
    back starts a new run (a reset, or a driveline that was started again).
    """

    messages: int = 0
    restarts: int = 0
    repeated: int = 0
    last: int | None = None
    _differences: Counter[int] = field(default_factory=Counter)

    def add(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count consecutive stamps, ns; gives the positions in `stamps` at which a new run starts."""
        if not len(stamps):
            return np.empty(0, np.int64)
        before = stamps[0] if self.last is None else self.last
        steps = np.diff(stamps, prepend=np.int64(before))
        if self.last is None:
            values, counts = np.unique(steps[1:], return_counts=True)
        else:
            values, counts = np.unique(steps, return_counts=True)
        self.messages += len(stamps)
        self.last = int(stamps[-1])
        for value, count in zip(values.tolist(), counts.tolist()):
            if value > 0 and (value in self._differences or len(self._differences) < _MOST_DIFFERENCES):
                self._differences[value] += count
            elif value == 0:
                self.repeated += count
        starts: NDArray[np.int64] = np.flatnonzero(steps < 0)
        self.restarts += len(starts)
        return starts

    @property
    def tick(self) -> int:
        """The most frequent difference, ns; 0 where there are fewer than two stamps."""
        return self._differences.most_common(1)[0][0] if self._differences else 0

    @property
    def lost(self) -> int:
        """Stamps that are missing between those that were counted."""
        tick = self.tick
        return sum(count * (round(step / tick) - 1) for step, count in self._differences.items() if step > 1.5 * tick)
