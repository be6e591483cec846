"""The mean of a signal over each whole engine cycle, from samples as they come."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.trajectory import Floats, integral


class CycleMeans:
    """Means over whole engine cycles by the trapezoidal rule; none where nobody knows when the cycles start.

    Samples that begin more than one and a half steps after the last ones leave a gap: the cycles that it touches have
    no mean.
    """

    def __init__(self, clock: EngineClock) -> None:
        self._clock = clock
        self._t = self._v = np.empty(0)

    def restart(self) -> None:
        """Time has started again, or there is a gap: the cycles that it touches have no mean."""
        self._t = self._v = np.empty(0)

    def feed(self, t: Floats, v: Floats, run: int = 0) -> list[tuple[int, Floats, Floats]]:
        """Take the next samples of a run, (n,) arrays: s, and the signal.

        Returns
        -------
        for each stretch of cycles that they complete, the number of the first, ends (s) and means, (m,) arrays
        """
        if len(self._t) and len(t) > 1 and t[0] - self._t[-1] > 1.5 * float(np.median(np.diff(t))):
            self.restart()
        t, v = np.concatenate([self._t, t]), np.concatenate([self._v, v])
        if not self._clock.told or (t[-1] - t[0]) / self._clock.cycle > len(t):
            # Fewer samples than cycles: time has leapt.
            self._t, self._v = t[-1:], v[-1:]
            return []
        stretches = self._clock.stretches(run, float(t[0]), float(t[-1]))
        whole = [(first, starts) for first, starts in stretches if len(starts) > 1]
        if not whole:
            self._t, self._v = (t, v) if stretches else (t[-1:], v[-1:])
            return []
        area = integral(v, t)
        found = []
        for first, starts in whole:
            ends = np.clip(starts, t[0], t[-1])
            left = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, len(t) - 2)
            part, slope = ends - t[left], (v[left + 1] - v[left]) / (t[left + 1] - t[left])
            area_at = area[left] + part * (v[left] + 0.5 * part * slope)
            found.append((first, starts[1:], np.diff(area_at) / np.diff(starts)))
        self._t, self._v = t[left[-1]:].copy(), v[left[-1]:].copy()
        return found


def joined_means(found: list[tuple[int, Floats, Floats]]) -> tuple[NDArray[np.int64], Floats]:
    """Ends (ns) and means of the cycles that `CycleMeans.feed` gave, one after the other."""
    ends = np.concatenate([ends for _, ends, _ in found]) if found else np.empty(0)
    return np.rint(ends * 1e9).astype(np.int64), np.concatenate([m for *_, m in found]) if found else np.empty(0)


class MeansOfCycles:
    """The same, kept from the first cycle to the last, NaN where a gap was."""

    def __init__(self, clock: EngineClock) -> None:
        self._running = CycleMeans(clock)
        self._parts: list[Floats] = []
        self._next: int | None = None

    def interrupt(self) -> None:
        """A gap."""
        self._running.restart()

    def feed(self, t: Floats, v: Floats, run: int = 0) -> None:
        """Take the next samples of a run, (n,) arrays: s, and the signal."""
        for first, _, means in self._running.feed(t, v, run):
            if self._next is not None and first > self._next:
                self._parts.append(np.full(min(first - self._next, len(t)), math.nan))
            self._parts.append(means)
            self._next = first + len(means)

    def means(self) -> Floats:
        """(n,) array of the cycle means."""
        return np.concatenate(self._parts) if self._parts else np.empty(0)
