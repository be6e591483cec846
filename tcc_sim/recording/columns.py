"""Columns read from a recording (joint_states, applied pressure, far end, commands) and the selection of a part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, counted
from tcc_sim.messages import held
from tcc_sim.messages.held import index_in_held
from tcc_sim.recording.layouts import Floats
from tcc_sim.recording.stamps import Break
from tcc_sim.topics import INPUTS, shown
from tcc_sim.trajectory import STILL, FarEnd

BLOCK = 1 << 16
"""Number of states processed at once where each takes memory."""
NEVER = (1 << 63) - 1
LATEST = 4294967296.0
"""Largest time of a stamp, s."""


@dataclass(frozen=True)
class JointStates:
    """Consecutive joint_states messages as (n,) arrays.

    Stamps of simulation time, of receipt and of sending (ns), angles (rad), speeds (rad/s), torques (N m). `run` counts
    the starts of simulation time within the recording, `began` is the reason of this start, and `cut` whether it came
    before the recording, as far as is known. `index` is the index of the first state in the whole recording, and
    `moved_ns` the stamp of the first state of the run with a motion of the far end, which stands still before.
    `held` has the messages on the inputs, (m, messages.held.SIZE), NaN for values that were not recorded; the one of
    number `held_row` holds at each state (-1: unknown). Both are None without such messages.
    `further` has the fields of all other topics of `topics.stamped` that were recorded, NaN where a message is missing;
    `applied_pressure` (Pa), `output_angle` (rad) and `output_speed` (rad/s) of the shaft's far end are among them.
    """

    stamp_ns: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    flywheel_angle: Floats
    plate_angle: Floats
    flywheel_speed: Floats
    plate_speed: Floats
    engine_torque: Floats
    friction_torque: Floats
    run: int = 0
    began: Break = Break.START
    cut: bool = False
    index: int = 0
    moved_ns: int = NEVER
    held: Floats | None = None
    held_row: NDArray[np.int64] | None = None
    further: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def of(self, name: str) -> Floats:
        """Return a column of `further`, (n,), of NaN if it was not recorded."""
        return self.further[name] if name in self.further else np.full(len(self), np.nan)

    def shown(self) -> dict[str, Floats]:
        """Return the values at each state, (n,), of those topics of `topics.shown` that state them and were recorded.
        """
        return {row.name: self.further[row.fields[0]] for row in shown()
                if row.fields and row.fields[0] in self.further}

    def input(self, name: str, field: str) -> Floats:
        """Return a field of `messages.held.FIELDS` of an input at each state, (n,), NaN where it is not known, as the
        source `nobody` of an imported bag is for torque and pressure.
        """
        if self.held is None or self.held_row is None:
            return np.full(len(self), np.nan)
        values: Floats = self.held[self.held_row, index_in_held(name, field)]
        unknown = (values == held.NOBODY) & (field == "source" and name in INPUTS)
        out: Floats = np.where((self.held_row >= 0) & ~unknown, values, np.nan)
        return out

    @property
    def far_end(self) -> FarEnd:
        """Angle (rad) and speed (rad/s) of the shaft's far end, (n,), NaN where a message is missing."""
        if self.moved_ns == NEVER:
            return STILL
        before = self.stamp_ns < self.moved_ns
        return FarEnd(*(np.where(before, 0.0, self.of(name)) for name in ("output_angle", "output_speed")))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which states have every value that the equations of motion need, (n,)."""
        far = self.far_end
        return np.isfinite(self.flywheel_speed + self.plate_speed + self.plate_angle + self.engine_torque
                           + self.friction_torque + far.angle + far.speed)

    def blocks(self) -> Iterator[JointStates]:
        """Iterate over blocks of states, for work that needs memory for each state."""
        for begin in range(0, len(self), BLOCK):
            yield self[begin:begin + BLOCK]

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.int64]) -> JointStates:
        """Return the selected rows."""
        columns: dict[str, Any] = {name: column[rows] for name, column in vars(self).items()
                                   if isinstance(column, np.ndarray) and name != "held"}
        first = rows.indices(len(self))[0] if isinstance(rows, slice) else 0
        further = {name: column[rows] for name, column in self.further.items()}
        return replace(self, index=self.index + first, further=further, **columns)


class Commanded(NamedTuple):
    """Commands on one topic, (n,) arrays.

    rows : index of the first state after each command, not descending
    values : commanded values, in the unit of the topic
    answers : stamp of the state that each command answers, ns; negative if the message has no stamp
    """

    rows: NDArray[np.int64]
    values: Floats
    answers: NDArray[np.int64]

    @staticmethod
    def none() -> Commanded:
        """Return an empty set of commands."""
        return Commanded(np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))


@dataclass(frozen=True)
class Columns:
    """Data of one driveline in a recording.

    runs : the states of each run, views of common arrays
    commands : commands that acted and speeds of the far end, by the name of their topic; none in a recording that does
        not state them
    publishers, recorded : numbers of publishers of commands, and of recorded messages, by topic; of a window too those
        of the whole recording
    received : likewise the number of commands that the driveline received or that may have been on their way at the
        end; None where it is not known
    counts : counts of the driveline's diagnostics, by key
    keyed : whether the states name their runs
    limits : last limits of the pressure that a controller stated, Pa
    """

    runs: tuple[JointStates, ...]
    commands: Mapping[str, Commanded]
    publishers: Mapping[str, int]
    recorded: Mapping[str, int]
    received: Mapping[str, int | None]
    counts: Mapping[str, int]
    keyed: bool
    limits: tuple[float, float] | None


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
