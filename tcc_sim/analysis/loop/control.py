"""Signals of a controlled run for pictures and for its tracking: cycle means, target, pressures and events."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.engine_clock import EngineClock
from tcc_sim.analysis.measured.signals import BRIDGED_TICKS
from tcc_sim.trajectory import Floats, integral


@dataclass(frozen=True)
class Steps:
    """A signal that keeps its value until the next one: times (s) and values, (n,) arrays."""

    t: Floats
    values: Floats

    def until(self, end: float) -> Steps:
        """Return the steps with the last value repeated at `end`, for drawing."""
        if not len(self.t) or self.t[-1] >= end:
            return self
        return Steps(np.append(self.t, end), np.append(self.values, self.values[-1]))

    @staticmethod
    def none() -> Steps:
        """Return steps without a value."""
        return Steps(np.empty(0), np.empty(0))


def handovers(commanded: NDArray[np.bool_], least: int) -> list[tuple[int, bool]]:
    """Return the rows from which commands or the fallback hold an input, and whether they are commands.

    The first row is none. What holds for fewer than `least` rows is no handover.
    """
    edges = [0, *(np.flatnonzero(np.diff(commanded)) + 1).tolist(), len(commanded)]
    long = [begin for begin, end in pairwise(edges) if end - begin >= least]
    return [(begin, bool(commanded[begin])) for before, begin in pairwise(long)
            if commanded[before] != commanded[begin]]


@dataclass(frozen=True)
class Event:
    """A change of the run at a simulation time, s, other than by physics, with its description."""

    t: float
    text: str


@dataclass(frozen=True)
class Control:
    """One run of a recording as a test of a controller.

    t, mean_slip : (n,) ends of the whole engine cycles, s, and the mean slip speed in each, rad/s
    target : target of the slip controller, rad/s
    command, applied : actuation pressure as commanded and as applied at the end of each cycle, Pa
    events : changed parameters, fallbacks and resets
    """

    t: Floats
    mean_slip: Floats
    target: Steps = field(default_factory=Steps.none)
    command: Steps = field(default_factory=Steps.none)
    applied: Steps = field(default_factory=Steps.none)
    events: tuple[Event, ...] = ()

    @property
    def controlled(self) -> bool:
        """Whether a pressure or a target was recorded."""
        return bool(len(self.target.t) or len(self.command.t) or len(self.applied.t))


class CycleMeans:
    """Means over whole engine cycles by the trapezoidal rule, of samples in batches; none without known cycles.

    A gap (`BRIDGED_TICKS`) between batches leaves the cycles in it without a mean.
    """

    def __init__(self, clock: EngineClock) -> None:
        self._clock = clock
        self._t = self._v = np.empty(0)

    def restart(self) -> None:
        """Begin after a reset of time, or after a gap: the cycles in it have no mean."""
        self._t = self._v = np.empty(0)

    def feed(self, t: Floats, v: Floats, run: int = 0) -> list[tuple[int, Floats, Floats]]:
        """Take the next samples of a run, (n,) arrays: time, s, and the signal.

        returns : for each stretch of completed cycles, the number of the first, and ends (s) and means, (m,) arrays
        """
        if len(self._t) and len(t) > 1 and t[0] - self._t[-1] > BRIDGED_TICKS * float(np.median(np.diff(t))):
            self.restart()
        t, v = np.concatenate([self._t, t]), np.concatenate([self._v, v])
        if not self._clock.identified or (t[-1] - t[0]) / self._clock.cycle > len(t):
            # Fewer samples than cycles: time has leapt.
            self._t, self._v = t[-1:], v[-1:]
            return []
        stretches = self._clock.stretches(run, float(t[0]), float(t[-1]))
        whole = [(first, starts) for first, starts in stretches if len(starts) > 1]
        if not whole:
            self._t, self._v = (t, v) if stretches else (t[-1:], v[-1:])
            return []
        area = integral(v, t)
        means = []
        for first, starts in whole:
            ends = np.clip(starts, t[0], t[-1])
            left = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, len(t) - 2)
            part, slope = ends - t[left], (v[left + 1] - v[left]) / (t[left + 1] - t[left])
            area_at = area[left] + part * (v[left] + 0.5 * part * slope)
            means.append((first, starts[1:], np.diff(area_at) / np.diff(starts)))
        self._t, self._v = t[left[-1]:].copy(), v[left[-1]:].copy()
        return means


def joined_means(pieces: list[tuple[int, Floats, Floats]]) -> tuple[NDArray[np.int64], Floats]:
    """Return ends (ns) and means of the cycles of `CycleMeans.feed`, one after the other."""
    ends = np.concatenate([ends for _, ends, _ in pieces]) if pieces else np.empty(0)
    return np.rint(ends * 1e9).astype(np.int64), np.concatenate([m for *_, m in pieces]) if pieces else np.empty(0)
