"""Detect and count gaps, resets and restarts in the stamps of a stream."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.result import reported, reporting, result_class

Stamps = NDArray[np.int64]
MOST_DIFFERENCES = 100_000
"""Largest number of distinct stamp differences stored for a run; a recording has few unless stamps jitter."""
REGULAR, JITTERED = 0.2, 20_000
"""Stamps jitter if no difference makes up more than the fraction REGULAR of all; JITTERED is the number of messages at
the start of a run that decide it.
"""
MOST_RETURNS = 3
"""Number of times that a run of unidentified publishers may continue at the end of the run before it by chance."""


class Break(Enum):
    """Kind of boundary between a piece of a stream and the piece before it."""

    NOTHING = "nothing"
    GAP = "gap"
    START = "start"
    RESET = "reset"
    RESTART = "restart"

    @property
    def begins_a_run(self) -> bool:
        """Whether simulation time starts again here."""
        return self in (Break.START, Break.RESET, Break.RESTART)


@dataclass
class _Run:
    """Stamp differences in one run, and the tick that follows from them. If stamps jitter, each difference is also
    compared with the one before it: in a run-up sampled at fixed crank angles, differences change steadily.
    """

    messages: int = 0
    differences: Counter[int] = field(default_factory=Counter)
    tick: int = 0
    jitter: int = 0
    before: int = 0
    gaps: int = 0
    lost: int = 0

    def add(self, steps: Stamps) -> None:
        """Count positive differences, ns; the tick is the most frequent one, so a gap at the start does no harm."""
        values, counts = np.unique(steps, return_counts=True)
        for value, count in zip(values.tolist(), counts.tolist()):
            if value in self.differences or len(self.differences) < MOST_DIFFERENCES:
                self.differences[value] += count
                if not self.jitter and self.differences[value] > self.differences[self.tick]:
                    self.tick = value

    @property
    def longest(self) -> int:
        """Largest difference that is not a gap, ns: one and a half ticks, and more if stamps jitter."""
        return self.tick + self.tick // 2 + self.jitter

    def gaps_in(self, steps: Stamps) -> NDArray[np.bool_]:
        """Return which of the next differences (ns, in the order of recording) are gaps."""
        over: NDArray[np.bool_] = steps > (self.longest if self.tick else np.iinfo(np.int64).max)
        if not self.jitter or not len(steps):
            return over
        before = np.concatenate([[self.before or steps[0]], steps[:-1]])
        self.before = int(steps[-1])
        over &= 2 * steps > 3 * before
        self.gaps += int(over.sum())
        self.lost += int((np.round(steps[over] / self.tick) - 1).sum())
        return over

    def settle(self, newly: int) -> None:
        """Set the tick to the median difference if stamps jitter; `newly` is the number of messages just added."""
        count = sum(self.differences.values())
        if self.messages - newly > JITTERED or not count or self.differences[self.tick] > REGULAR * count:
            return
        values = np.sort(np.array(list(self.differences)))
        self.tick = int(np.median(values))
        self.jitter = int(np.percentile(np.abs(values - self.tick), 95.0))

    def figures(self, tick: int) -> tuple[int, int, int]:
        """Return the numbers of gaps, of stamps missing in them, and of uneven differences that are not gaps."""
        if self.jitter:
            uneven = sum(n for step, n in self.differences.items() if abs(step - tick) > max(tick // 100, 2))
            return self.gaps, self.lost, uneven - self.gaps
        gaps = lost = uneven = 0
        for step, count in self.differences.items():
            if 2 * step > 3 * tick:
                gaps += count
                lost += count * (round(step / tick) - 1)
            elif abs(step - tick) > max(tick // 100, 2):
                uneven += count
        return gaps, lost, uneven


@result_class(frozen=False)
class StampCounter:
    """Split batches of stamps, in the order of recording, into pieces without gaps, and count gaps and runs.

    A difference of more than one and a half ticks is a gap; a repeated stamp is left out (a paused driveline repeats
    it). A run begins where a stamp decreases (a reset) and where another publisher takes over (a restart). Each run has
    its own tick.
    """

    messages: int = 0
    runs: int = reported("starts, resets and restarts", default=0)
    resets: int = 0
    restarts: int = 0
    repeated: int = 0
    returns: int = 0
    """Number of times that a run of unidentified publishers continued at the end of the run before it."""
    last: int | None = None
    _run: _Run = field(default_factory=_Run)
    _longest: tuple[int, int, int] = (0, 0, 0)
    _settled: tuple[int, int, int] = (0, 0, 0)
    _publisher: int = 0
    _former: int | None = None
    _gone: set[int] = field(default_factory=set)

    def feed_run(self, stamps: Stamps, kind: Break, end: int | None = None) -> None:
        """Count a whole run whose begin is known: (n,) stamps, ns since its zero, rising.

        Ticks before the first state are lost, and those between the last one and `end`, the stamp of the last state
        that was sent (None if it is unknown).
        """
        self._begin(kind)
        self._cut(stamps, kind, 0, [])
        self.last = int(stamps[-1])
        if self._run.tick:
            for missing in (int(stamps[0]), (end or 0) - int(stamps[-1])):
                if (count := round(missing / self._run.tick)) > 0:
                    self._run.differences[self._run.tick * (count + 1)] += 1
                    self._run.gaps += self._run.jitter > 0
                    self._run.lost += count * (self._run.jitter > 0)

    def pieces(self, stamps: Stamps, publisher: NDArray[np.int64] | int = 0) -> list[tuple[slice, Break]]:
        """Return the pieces of the next batch, each with the break before it.

        Parameters
        ----------
        stamps : (n,) array, ns
        publisher : number of each stamp's publisher, one number or (n,) array; 0 if it is not identified
        """
        pieces: list[tuple[slice, Break]] = []
        stamps = np.asarray(stamps, dtype=np.int64)
        who = np.broadcast_to(np.asarray(publisher, dtype=np.int64), stamps.shape)
        cuts = (1 + np.flatnonzero((np.diff(who) != 0) | (np.diff(stamps) < 0))).tolist()
        for begin, end in pairwise([0, *cuts, len(stamps)] if len(stamps) else []):
            now = int(who[begin])
            if now in self._gone:
                continue
            kind = Break.NOTHING
            if self.last is None:
                kind = Break.START
            elif now != self._publisher:
                kind = Break.RESTART
                self._gone.add(self._publisher)
            elif stamps[begin] < self.last:
                kind = Break.RESET
                self._former = self.last if now == 0 else self._former
            self._begin(kind)
            self._cut(stamps[begin:end], kind, begin, pieces)
            self._publisher, self.last = now, int(stamps[end - 1])
        return pieces

    def _begin(self, kind: Break) -> None:
        """Count the begin of a run."""
        if kind.begins_a_run:
            self._settle()
            self.runs += 1
            self.resets += kind is Break.RESET
            self.restarts += kind is Break.RESTART

    def _cut(self, stamps: Stamps, kind: Break, offset: int, pieces: list[tuple[slice, Break]]) -> None:
        """Split stamps of one run at gaps, and leave repeated stamps out."""
        first = int(kind.begins_a_run)
        steps = np.diff(stamps) if first or self.last is None else np.diff(stamps, prepend=np.int64(self.last))
        self.messages += len(stamps)
        self._run.messages += len(stamps)
        self._run.add(steps[steps > 0])
        later = stamps[first:]
        if self._former is not None and len(later) and later[-1] > self._former:
            # A jump to just after the end of the run before, as two alternating publishers make.
            k = int(np.argmax(later > self._former))
            self.returns += int(later[k] - self._former < steps[k])
            self._former = None
        self._run.settle(len(stamps))
        start = 0
        for k in (first + np.flatnonzero((steps == 0) | self._run.gaps_in(steps))).tolist():
            if k > start:
                pieces.append((slice(offset + start, offset + k), kind))
                kind = Break.NOTHING
            start = k
            if steps[k - first] == 0:
                self.repeated += 1
                start = k + 1
            else:
                kind = Break.GAP
        if start < len(stamps):
            pieces.append((slice(offset + start, offset + len(stamps)), kind))

    def _settle(self) -> None:
        """Add the counts of the run that ends to those of the recording."""
        if self.last is None:
            return
        self._settled = self._figures()
        self._longest = self._of_longest()
        self._run = _Run(tick=self._run.tick)

    def _figures(self) -> tuple[int, int, int]:
        """Return the numbers of gaps, missing stamps and uneven differences so far."""
        gaps, lost, uneven = self._run.figures(self._run.tick)
        return self._settled[0] + gaps, self._settled[1] + lost, self._settled[2] + uneven

    @property
    def tick(self) -> int:
        """Time between stamps in the run with the most messages, ns; 0 with fewer than two stamps."""
        return self._of_longest()[1]

    @property
    def longest(self) -> int:
        """Largest difference in the same run that is not a gap, ns."""
        return self._of_longest()[2]

    def _of_longest(self) -> tuple[int, int, int]:
        """Return messages, tick and largest difference without a gap of the run with the most messages."""
        return max(self._longest, (self._run.messages, self._run.tick, self._run.longest))

    @reporting("time between stamps", "s")
    def tick_s(self) -> float:
        """Time between stamps in the run with the most messages, s."""
        return self.tick * 1e-9

    @reporting("gaps between stamps")
    def gaps(self) -> int:
        return self._figures()[0]

    @property
    def lost(self) -> int:
        """Number of stamps missing in gaps."""
        return self._figures()[1]

    @reporting("stamps that are not multiples of the tick", name="uneven_stamps")
    def uneven(self) -> int:
        """Number of differences, except gaps, that deviate from the tick by more than 1 %."""
        return self._figures()[2]

    @property
    def mixed(self) -> bool:
        """Whether messages of several publishers are mixed and cannot be separated."""
        return self.returns > MOST_RETURNS and 10 * self.returns > self.resets + self.restarts
