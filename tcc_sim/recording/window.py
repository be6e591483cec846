"""Selection of a part of a recording: a run and an interval of its simulation time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, counted
from tcc_sim.recording.columns import JointStates

LATEST = 4294967296.0
"""Largest time of a stamp, s."""


class Window:
    """Selected part of a recording; InputError if the run is negative, a time is beyond the largest stamp, or the end
    is not after the start.

    run : number of the run, counted from 0; None for all
    start, end : simulation time, s, both included; None for the start and end of the run
    """

    def __init__(self, run: int | None = None, start: float | None = None, end: float | None = None) -> None:
        if run is not None and run < 0:
            raise InputError(f"run is {run}; runs are counted from 0")
        for name, t in (("start", start), ("end", end)):
            if t is not None and not abs(t) <= LATEST:
                raise InputError(f"the window's {name} is {t:g} s; it must be a number from {-LATEST:g} to {LATEST:g}")
        if start is not None and end is not None and not start < end:
            raise InputError(f"the window goes from {start:g} to {end:g} s; it must end after it starts")
        self.run = run
        self._start = -(2**63) if start is None else round(start * 1e9)
        self._end = 2**63 - 1 if end is None else round(end * 1e9)

    @property
    def all(self) -> bool:
        """Whether the window selects the whole recording."""
        return not self.sentence()

    def sentence(self) -> str:
        """Return a sentence that names the selection; empty for the whole recording."""
        parts = [f"run {self.run}"] if self.run is not None else []
        parts += [f"from {self._start * 1e-9:g} s on"] if self._start > -(2**63) else []
        parts += [f"up to {self._end * 1e-9:g} s"] if self._end < 2**63 - 1 else []
        return f"only {', '.join(parts)} is analysed" if parts else ""

    def rows(self, states: JointStates) -> slice:
        """Return the rows of a run's states that lie in the window."""
        if self.run not in (None, states.run):
            return slice(0, 0)
        first, last = np.searchsorted(states.stamp_ns, self._start), np.searchsorted(states.stamp_ns, self._end,
                                                                                     "right")
        return slice(int(first), int(last))

    def mask(self, stamps: NDArray[np.int64], run: NDArray[np.int64] | None) -> NDArray[np.bool_]:
        """Return which messages lie in the window, by stamp (ns) and number of the run (None: by the stamp alone)."""
        inside: NDArray[np.bool_] = (stamps >= self._start) & (stamps <= self._end)
        return inside if run is None or self.run is None else inside & (run == self.run)

    def refuse(self, runs: int) -> None:
        """Raise InputError because no state of a recording with `runs` runs lies in the window."""
        if self.run is not None and self.run >= runs:
            raise InputError(f"there is no run {self.run}: the recording holds {counted(runs, 'run')}, counted from 0")
        raise InputError("the recording holds no state in the window")
