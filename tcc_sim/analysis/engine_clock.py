"""When the engine cycles of a run start: counted in time, told from the torque, or not known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import System
from tcc_sim.solvers.per_cycle import cycle_starts, starts_of
from tcc_sim.trajectory import Floats

SLACK = 1e-9
"""Part of an engine cycle by which a sample may miss the instant at which the cycle starts."""
Stretch = tuple[int, Floats]
"""Engine cycles one after the other: the number of the first, and when each starts and the last ends, s."""


@dataclass(frozen=True)
class Uniform:
    """Cycle n starts at t = n cycle, in every run. What is not `told` are slices of time in place of engine cycles that
    nobody knows: their extremes hold, section and period do not exist.
    """

    cycle: float
    told: bool = True

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Of which EngineClock tells."""
        first = math.ceil(begin / self.cycle - SLACK)
        return [(first, cycle_starts(first, end, self.cycle))]


@dataclass(frozen=True)
class Scheduled:
    """Cycles of a scene whose frequency varies in time as it says, in every run from its reset on."""

    system: System
    told: bool = True

    @property
    def cycle(self) -> float:
        """The shortest, s."""
        return self.system.cycle

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Of which EngineClock tells."""
        first = math.ceil(self.system.cycles_until(begin) - SLACK)
        return [(first, starts_of(self.system, first, end))]


@dataclass(frozen=True)
class Tracked:
    """Cycles of a frequency that may vary, known for stretches of some runs.

    cycle : median length, s
    runs : by number, the cycles whose start is known, (n,), and these times, s, ascending; a number that is left out
        begins another stretch
    """

    cycle: float
    runs: Mapping[int, tuple[NDArray[np.int64], Floats]] = field(default_factory=dict)
    told: bool = True

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Of which EngineClock tells; the last start before a stretch that nobody knows is none."""
        if run not in self.runs:
            return []
        numbers, starts = self.runs[run]
        slack = SLACK * self.cycle
        low, high = (int(np.searchsorted(starts, t)) for t in (begin - slack, end + slack))
        cuts = (1 + low + np.flatnonzero(np.diff(numbers[low:high]) > 1)).tolist()
        found = []
        for a, b in zip([low, *cuts], [*cuts, high]):
            if b > a and (b - a > 1 or (b < len(numbers) and numbers[b] == numbers[a] + 1)):
                found.append((int(numbers[a]), starts[a:b]))
        return found


EngineClock = Uniform | Scheduled | Tracked
"""Where the engine cycles of every run of a recording lie: `cycle` is a typical one, s, `told` whether what is counted
are engine cycles, and `stretches` gives those of a run that start between two times, s, cycles that do not follow each
other apart.
"""


def clock_of_scene(system: System) -> EngineClock:
    """When the engine cycles start where torque and frequency are those of a scene."""
    return Uniform(system.cycle) if system.course is None else Scheduled(system)
