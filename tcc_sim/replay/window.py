"""A part of a recording: one run of it, and a stretch of that run's simulation time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from tcc_sim.errors import InputError, counted
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.commands import Rows
from tcc_sim.trajectory import Floats

Commanded = Mapping[str, tuple[Rows, Floats]]
LATEST = 4294967296.0
"""Seconds beyond which there is no stamp."""


class Window:
    """What is wanted of a recording.

    Parameters
    ----------
    run : number of the run, counted from 0; None for all
    start, end : simulation time, s, both included; None for the run's own

    Raises
    ------
    InputError
        A run below 0, a time that no stamp can have, or an end that is not after the start.
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
        self._any = False
        self._held: dict[str, float] = {}

    def sentence(self) -> str:
        """What it leaves out; empty where that is nothing."""
        parts = [f"run {self.run}"] if self.run is not None else []
        parts += [f"from {self._start * 1e-9:g} s on"] if self._start > -(2**63) else []
        parts += [f"up to {self._end * 1e-9:g} s"] if self._end < 2**63 - 1 else []
        return f"only {', '.join(parts)} is analysed" if parts else ""

    def of(self, batches: Iterable[JointStates]) -> Iterator[JointStates]:
        """The states that lie in it."""
        for batch in batches:
            rows = self._rows(batch)
            if rows.stop > rows.start:
                yield batch[rows]

    def cut(self, batch: JointStates, commanded: Commanded) -> Iterator[tuple[JointStates, Commanded]]:
        """The states of a batch that lie in it, if any, with the commands by their rows; what was commanded before it
        holds from its first state on.
        """
        rows = self._rows(batch)
        if rows == slice(0, len(batch)) and not self._held:
            self._any = self._any or len(batch) > 0
            yield batch, commanded
            return
        for name, (places, values) in commanded.items():
            if len(earlier := values[places < rows.start]):
                self._held[name] = float(earlier[-1])
        if rows.stop <= rows.start:
            self._held.update({name: float(values[-1]) for name, (_, values) in commanded.items() if len(values)})
            return
        found = {name: (places[inside] - rows.start, values[inside]) for name, (places, values) in commanded.items()
                 for inside in [(places >= rows.start) & (places < rows.stop)]}
        for name, value in self._held.items():
            places, values = found.get(name, (np.empty(0, np.int64), np.empty(0)))
            if not len(places) or places[0] > 0:
                found[name] = np.append(0, places), np.append(value, values)
        self._held, self._any = {}, True
        yield batch[rows], found

    def check(self, runs: int) -> None:
        """Raise InputError where nothing lay in it, of a recording with so many runs."""
        if self._any:
            return
        if self.run is not None and self.run >= runs:
            raise InputError(f"there is no run {self.run}: the recording holds {counted(runs, 'run')}, counted from 0")
        raise InputError("the recording holds no state in the window")

    def _rows(self, batch: JointStates) -> slice:
        """Which states lie in it; none where the batch is of another run."""
        if self.run not in (None, batch.run):
            return slice(0, 0)
        first, last = np.searchsorted(batch.stamp_ns, self._start), np.searchsorted(batch.stamp_ns, self._end, "right")
        return slice(int(first), int(last))
