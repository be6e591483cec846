"""Columns read from a recording: joint_states, applied pressure, far end and commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.recording.announcements import InputSource, Stamps
from tcc_sim.recording.layouts import Floats, Layouts, Values
from tcc_sim.recording.records import Messages
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.topics import FLUID_PRESSURE, JOINT_STATE, OUTPUT_JOINT, topic
from tcc_sim.trajectory import STILL, FarEnd

BLOCK = 1 << 16
"""Number of states processed at once where each takes memory."""
_COLUMNS = ("stamp_ns", "log_ns", "sent_ns", *topic("joint_states").fields)
NEVER = (1 << 63) - 1
_YEAR = 365 * 86_400 * 1_000_000_000


def receipt_times(log_ns: NDArray[np.int64], sent_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the times of receipt, ns, or the times of sending if the recorder logged simulation time (use_sim_time),
    which is years earlier.
    """
    return np.where(log_ns < sent_ns - _YEAR, sent_ns, log_ns)


@dataclass(frozen=True)
class JointStates:
    """Consecutive joint_states messages as (n,) arrays.

    Stamps of simulation time, of receipt and of sending (ns), angles (rad), speeds (rad/s), torques (N m).
    `applied_pressure` (Pa), `output_angle` (rad) and `output_speed` (rad/s) of the shaft's far end are None if they
    were not recorded, and NaN where a message is missing. `run` counts the starts of simulation time within the
    recording, `began` is the reason of this start, `index` is the index of the first state in the whole recording, and
    `moved_ns` the stamp of the first state of the run with a motion of the far end, which stands still before.
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
    applied_pressure: Floats | None = None
    output_angle: Floats | None = None
    output_speed: Floats | None = None
    run: int = 0
    began: Break = Break.START
    index: int = 0
    moved_ns: int = NEVER

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def far_end(self) -> FarEnd:
        """Angle (rad) and speed (rad/s) of the shaft's far end, (n,), NaN where a message is missing."""
        if self.output_angle is None or self.output_speed is None:
            return STILL
        before = self.stamp_ns < self.moved_ns
        return FarEnd(np.where(before, 0.0, self.output_angle), np.where(before, 0.0, self.output_speed))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which states have every value that the equations of motion need, (n,)."""
        far = self.far_end
        return np.isfinite(self.flywheel_speed + self.plate_speed + self.plate_angle + self.engine_torque
                           + self.friction_torque + far.angle + far.speed)

    def blocks(self, rows: int = BLOCK) -> Iterator[JointStates]:
        """Iterate over blocks of at most `rows` states, for work that needs memory for each state."""
        for begin in range(0, len(self), rows):
            yield self[begin:begin + rows]

    def __getitem__(self, rows: slice | NDArray[np.bool_]) -> JointStates:
        """Return the selected rows."""
        columns: dict[str, Any] = {name: column[rows] for name,
                                   column in vars(self).items() if isinstance(column, np.ndarray)}
        first = rows.indices(len(self))[0] if isinstance(rows, slice) else 0
        return replace(self, index=self.index + first, **columns)


class Commanded(NamedTuple):
    """Commands on one topic, (n,) arrays.

    rows : index of the first state after each command, not descending
    values : commanded values, in the unit of the topic
    answers : stamp of the state that each command answers, ns; negative if the message has no stamp
    """

    rows: NDArray[np.int64]
    values: Floats
    answers: NDArray[np.int64]

    def part(self, which: slice) -> Commanded:
        """Return a part of the commands."""
        return Commanded(self.rows[which], self.values[which], self.answers[which])

    @staticmethod
    def none() -> Commanded:
        """Return an empty set of commands."""
        return Commanded(np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))


@dataclass(frozen=True)
class Columns:
    """Data of one driveline in a recording.

    runs : the states of each run, views of common arrays
    commands : commands by the name of their topic
    further : likewise the numbers of other topics that a viewer shows by themselves
    sources : announced sources of the inputs, in the order of publication
    publishers : number of publishers of commands, by topic
    counts : counts of the driveline's diagnostics, by key
    limits : last limits of the pressure that a controller stated, Pa
    """

    runs: tuple[JointStates, ...]
    commands: Mapping[str, Commanded]
    further: Mapping[str, Commanded]
    sources: tuple[InputSource, ...]
    publishers: Mapping[str, int]
    counts: Mapping[str, int]
    limits: tuple[float, float] | None = None


class GrowingStates:
    """Arrays of states that grow in place while a recording is read."""

    def __init__(self) -> None:
        self.count = 0
        self._columns = {name: np.empty(0, np.int64 if name.endswith("_ns") else np.float64) for name in _COLUMNS}
        self._runs: list[tuple[int, Break, int]] = []

    def add(self, part: JointStates) -> None:
        """Append consecutive states of one run."""
        first, self.count = self.count, self.count + len(part)
        for name, column in self._columns.items():
            if self.count > len(column):
                column.resize(max(self.count, len(column) * 5 // 4, BLOCK), refcheck=False)
            column[first:self.count] = getattr(part, name)
        if not self._runs or self._runs[-1][0] != part.run:
            self._runs.append((part.run, part.began, first))

    def runs(self, joined: Sequence[JoinedTopic]) -> RunsAndMissing:
        """Return the states of every run with the columns of `beside`, and the number of states whose applied pressure
        is missing although the topic was recorded.
        """
        for column in self._columns.values():
            column.resize(self.count, refcheck=False)
        columns: dict[str, Any] = dict(self._columns)
        for one in joined:
            columns |= {name: np.full(self.count, np.nan) for name in one.columns}
        runs, missing = [], 0
        for (run, began, first), end in zip(self._runs, [*(first for *_, first in self._runs[1:]), self.count]):
            part = {name: column[first:end] for name, column in columns.items()}
            for one in joined:
                one.join(run, part)
            missing += int(np.isnan(part["applied_pressure"]).sum()) if "applied_pressure" in part else 0
            far = np.isfinite(part.get("output_angle", np.empty(0)))
            runs.append(JointStates(**part, run=run, began=began, index=first,
                                    moved_ns=int(part["stamp_ns"][far.argmax()]) if far.any() else NEVER))
        return tuple(runs), missing


RunsAndMissing = tuple[tuple[JointStates, ...], int]


class JoinedTopic:
    """A further topic with stamps, whose values are joined to the joint_states of equal stamps.

    Parameters
    ----------
    topic : fully resolved name
    layouts : layouts of its messages
    columns : column name -> message field that fills it
    """

    def __init__(self, topic: str, layouts: Layouts, columns: Mapping[str, str]) -> None:
        self.topic, self.type, self.columns, self.layouts = topic, layouts.type, columns, layouts
        self._stamps, self._run = StampCounter(), -1
        self._parts: dict[int, list[tuple[NDArray[Any], ...]]] = {}

    def take(self, data: NDArray[np.uint8], messages: Messages, channels: list[int], runs: int,
             publishers: Callable[[NDArray[np.void]], NDArray[np.int64]]) -> None:
        """Take the messages of these channels in one chunk.

        Parameters
        ----------
        runs : number of joint_states runs begun before the first of these messages, which belongs to the last of them
        publishers : function from HEADs to the numbers of their publishers
        """
        groups = self.layouts.take(data, messages, channels)
        if self._run < 0:
            self._run = max(runs, 1) - 2
        for piece, preceded in self._stamps.pieces(groups.stamps, publishers(groups.heads), groups.heads["number"]):
            self._run += preceded.begins_a_run
            self._parts.setdefault(self._run, []).append(
                (groups.stamps[piece], *(groups.columns[field][piece] for field in self.columns.values())))

    def join(self, run: int, columns: Mapping[str, Any]) -> None:
        """Fill the columns of a run at the stamps of its states."""
        if run not in self._parts:
            return
        recorded, *values = (np.concatenate(parts) for parts in zip(*self._parts[run]))
        stamps = columns["stamp_ns"]
        nearest = np.searchsorted(recorded, stamps).clip(max=len(recorded) - 1)
        same = recorded[nearest] == stamps
        for name, column in zip(self.columns, values):
            columns[name][same] = column[nearest[same]]


def joined_topics(joint_states_topic: str, zeros: Stamps) -> list[JoinedTopic]:
    """Return the further topics of a driveline; `zeros` are stamps of simulation time 0, as in `simulation_ns`."""
    space = joint_states_topic.rpartition("/")[0]
    far_end = topic("output_state").fields
    return [JoinedTopic(f"{space}/applied_pressure", Layouts(FLUID_PRESSURE, (), ("fluid_pressure",), zeros),
                        {"applied_pressure": "fluid_pressure"}),
            JoinedTopic(f"{space}/output_state", Layouts(JOINT_STATE, (OUTPUT_JOINT,), far_end, zeros),
                        {name: name for name in ("output_angle", "output_speed")})]


def joint_states(values: Values) -> JointStates:
    """Return decoded joint_states."""
    log_ns, sent_ns = (values.heads[name].astype(np.int64) for name in ("log_ns", "sent_ns"))
    sent_ns = np.where(sent_ns > 0, sent_ns, log_ns)
    columns: dict[str, Any] = dict(values.columns)
    return JointStates(stamp_ns=values.stamps, log_ns=receipt_times(log_ns, sent_ns), sent_ns=sent_ns, **columns)
