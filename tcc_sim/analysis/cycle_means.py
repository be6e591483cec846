"""The mean of a signal over each whole engine cycle, from samples as they come."""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.trajectory import Floats

_SLACK = 1e-9


class CycleMeans:
    """Means over whole engine cycles by the trapezoidal rule; cycle n starts at t = n cycle.

    Parameters
    ----------
    cycle : engine cycle, s
    """

    def __init__(self, cycle: float) -> None:
        self.cycle = cycle
        self._t = self._v = np.empty(0)

    def restart(self) -> None:
        """Time has started again, or there is a gap: the cycles that it touches have no mean."""
        self._t = self._v = np.empty(0)

    def feed(self, t: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Take the next samples, (n,) arrays: s, and the signal; ends (s) and means of the cycles that they
        complete.
        """
        t, v = np.concatenate([self._t, t]), np.concatenate([self._v, v])
        first, last = math.ceil(t[0] / self.cycle - _SLACK), math.floor(t[-1] / self.cycle + _SLACK)
        if last - first > len(t):
            # Fewer samples than cycles: time has leapt.
            self._t, self._v = t[-1:], v[-1:]
            return np.empty(0), np.empty(0)
        self._t, self._v = t, v
        if last <= first:
            return np.empty(0), np.empty(0)
        numbers = np.arange(first, last + 1)
        ends = np.clip(numbers * self.cycle, t[0], t[-1])
        area = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        left = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, len(t) - 2)
        part, slope = ends - t[left], (v[left + 1] - v[left]) / (t[left + 1] - t[left])
        means: Floats = np.diff(area[left] + part * (v[left] + 0.5 * part * slope)) / self.cycle
        self._t, self._v = t[left[-1]:].copy(), v[left[-1]:].copy()
        return numbers[1:] * self.cycle, means


class MeansOfCycles:
    """The same, kept from the first cycle to the last, NaN where a gap was."""

    def __init__(self, cycle: float) -> None:
        self._running = CycleMeans(cycle)
        self._parts: list[Floats] = []
        self._next: int | None = None

    def interrupt(self) -> None:
        """A gap."""
        self._running.restart()

    def feed(self, t: Floats, v: Floats) -> None:
        """Take the next samples, (n,) arrays: s, and the signal."""
        ends, means = self._running.feed(t, v)
        if not len(ends):
            return
        first = round(float(ends[0]) / self._running.cycle) - 1
        if self._next is not None and first > self._next:
            self._parts.append(np.full(min(first - self._next, len(t)), math.nan))
        self._parts.append(means)
        self._next = first + len(means)

    def means(self) -> Floats:
        """(n,) array of the cycle means."""
        return np.concatenate(self._parts) if self._parts else np.empty(0)
