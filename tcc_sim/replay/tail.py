"""The last samples of a recording's longest run, in bounded memory."""

from __future__ import annotations

from collections import deque

import numpy as np

from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.model.parameters import System
from tcc_sim.recording.batches import JointStates
from tcc_sim.replay.recorded import trajectory_of
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import Trajectory

TAIL_CYCLES = 24
"""Engine cycles kept as samples, for a picture of the end of the run."""
TAIL_SAMPLES = 200_000
"""Most samples kept."""


class Tail:
    """The last samples of the longest run so far, bounded."""

    def __init__(self, system: System, clock: EngineClock) -> None:
        self.stick_speed = stick_speed_of(terms_of(system))
        self.run_started = False
        self._system, self._clock, self._cycle = system, clock, clock.cycle
        self._parts: deque[JointStates] = deque()
        self._held = 0
        self._kept: tuple[int, deque[JointStates]] | None = None
        self._number = -1

    def add(self, batch: JointStates, stream: CycleStream) -> None:
        """Take the next batch; `stream` has it already."""
        number = len(stream.runs) - 1
        self.run_started = number != self._number and self._number >= 0
        if self.run_started:
            self._keep_longer(stream)
            self._parts, self._held = deque(), 0
        self._number = number
        self._parts.append(batch)
        self._held += len(batch)
        self._stream = stream
        start = int(batch.stamp_ns[-1]) - round(TAIL_CYCLES * self._cycle * 1e9)
        while len(self._parts) > 1 and (self._parts[0].stamp_ns[-1] < start or self._held > 2 * TAIL_SAMPLES):
            self._held -= len(self._parts.popleft())

    def trajectory(self, solver: str) -> Trajectory:
        """The samples of the longest run's end."""
        self._keep_longer(self._stream)
        assert self._kept is not None
        parts, left = self._kept[1], TAIL_SAMPLES
        start = int(parts[-1].stamp_ns[-1]) - round(TAIL_CYCLES * self._cycle * 1e9)
        late = []
        for part in reversed(parts):
            first = max(int(np.searchsorted(part.stamp_ns, start)), len(part) - left)
            left -= len(part) - first
            late.append(part[first:])
        return trajectory_of(late[::-1], self._system, self._clock, solver)

    def _keep_longer(self, stream: CycleStream) -> None:
        """Keep the end of the run at hand unless the one kept has more whole cycles."""
        if self._kept is None or stream.runs[self._number].observed() >= stream.runs[self._kept[0]].observed():
            self._kept = self._number, self._parts

