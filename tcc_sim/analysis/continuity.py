"""Where a stream of stamps is whole, and where it has gaps, repeats and new runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]


class Break(Enum):
    """What lies between a piece of a stream and the piece before it."""

    NOTHING = "nothing"
    GAP = "gap"
    RUN = "new run"


@dataclass
class Continuity:
    """Cuts batches of stamps, which come in the order of recording, into pieces without gaps, and counts what it finds.

    A stamp more than one and a half steps after the last is a gap; one before the last starts a new run (the driveline
    was reset or started again); one equal to the last is left out (nothing moves while the driveline is paused).
    """

    step: int = 0
    """Nominal distance of stamps, ns; taken from the first stamps where it is 0."""
    samples: int = 0
    gaps: int = 0
    missing: int = 0
    """Stamps that the gaps leave out."""
    repeated: int = 0
    uneven: int = 0
    """Distances, gaps apart, that differ from the step by more than a hundredth of it."""
    runs: int = 0
    _last: int = field(default=0, repr=False)

    def pieces(self, stamps: Stamps) -> Iterator[tuple[slice, Break]]:
        """The pieces of the next batch, each with what precedes it."""
        if not len(stamps):
            return
        stamps = np.asarray(stamps, dtype=np.int64)
        before = np.diff(stamps, prepend=self._last)
        if self.step == 0:
            forward = before[1:][before[1:] > 0]
            self.step = int(np.median(forward)) if len(forward) else 0
        step = self.step or np.iinfo(np.int64).max // 4
        regular = (before > 0) & (before <= step + step // 2)
        if self.runs == 0:
            regular[0] = False
        self.uneven += int(np.count_nonzero(regular & (np.abs(before - step) > max(step // 100,
                                                                                   2)))) if self.step else 0
        start, kind = 0, Break.NOTHING
        for k in np.flatnonzero(~regular).tolist():
            if k > start:
                yield slice(start, k), kind
            start, kind = k, Break.NOTHING
            if self.runs == 0 or before[k] < 0:
                self.runs += 1
                kind = Break.RUN
            elif before[k] == 0:
                self.repeated += 1
                start = k + 1
            else:
                self.gaps += 1
                self.missing += round(int(before[k]) / step) - 1
                kind = Break.GAP
        self.samples += len(stamps)
        self._last = int(stamps[-1])
        if start < len(stamps):
            yield slice(start, len(stamps)), kind
