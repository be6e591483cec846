"""What a recording gives back: columns of joint_states, with the pressure that each tick applied beside them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.recording.records import Messages
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.topics import topic

Floats = NDArray[np.float64]
_MOST_WAITING = 1 << 18
_MOST_NAMED = 20
HEAD = np.dtype([("channel", "<u2"), ("number", "<u4"), ("log_ns", "<i8"), ("sent_ns", "<i8")])
"""What stands before the bytes of a message: channel, number at the publisher, times (ns)."""


@dataclass(frozen=True)
class JointStates:
    """Consecutive joint_states messages, (n,) arrays: stamps of simulation time, of receipt and of sending (ns), angles
    (rad), speeds (rad/s), torques (N m). `applied_pressure` (Pa) is there where the run recorded it, NaN where one
    message of it is missing. `run` counts how often simulation time has started again within the recording, `began`
    says how this run came to start, `index` is the place of the first of them among all that the recording gives.
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
    run: int = 0
    began: Break = Break.START
    index: int = 0

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def __getitem__(self, kept: slice | NDArray[np.bool_]) -> JointStates:
        """Some of the rows."""
        columns: dict[str, Any] = {name: column[kept] for name,
                                   column in vars(self).items() if isinstance(column, np.ndarray)}
        first = kept.indices(len(self))[0] if isinstance(kept, slice) else 0
        return replace(self, index=self.index + first, **columns)


def merged_batches(batches: Sequence[JointStates]) -> JointStates:
    """Batches of one run one after the other; no applied pressure unless all of them have it."""
    columns: dict[str, Any] = {name: np.concatenate([getattr(batch, name) for batch in batches])
                               for name, column in vars(batches[0]).items() if isinstance(column, np.ndarray)
                               and all(getattr(batch, name) is not None for batch in batches)}
    return replace(batches[0], **{"applied_pressure": None, **columns})


def joint_states(data: NDArray[np.uint8], messages: Messages, channels: list[int],
                 layout: cdr.Layout) -> tuple[JointStates, NDArray[np.void], int]:
    """The joint_states of one chunk in their order, their HEADs, and how many messages have another layout and were
    left out.
    """
    heads, records, refused = _records(data, messages, channels, layout)
    columns: dict[str, Any] = {name: records[name].astype(np.float64) for name in topic("joint_states").fields}
    log_ns, sent_ns = heads["log_ns"].astype(np.int64), heads["sent_ns"].astype(np.int64)
    sent_ns = np.where(sent_ns > 0, sent_ns, log_ns)
    return JointStates(stamp_ns=cdr.stamps(records), log_ns=log_ns, sent_ns=sent_ns, **columns), heads, refused


def layout_of(data: bytes, messages: Messages, channels: list[int], joints: Sequence[str]) -> cdr.Layout:
    """Where the values of two joints stand, by the first message of these channels.

    Raises
    ------
    RecordingError
        It names other joints.
    """
    first = int(np.flatnonzero(np.isin(messages.channel, channels))[0])
    begin = int(messages.offset[first]) + 22
    try:
        frame, names = cdr.read_joint_names(data[begin:begin + int(messages.length[first]) - 22])
    except ValueError:
        return cdr.joint_state_layout()  # Damaged or no JointState: what has another layout is counted.
    if not set(joints) <= set(names):
        said = ", ".join(names[:_MOST_NAMED]) or "without names"
        raise RecordingError(f"its joints are {said}; say which of them are flywheel and clutch plate: "
                             "--joints flywheel=NAME,clutch_plate=NAME")
    return cdr.joint_state_layout(names, joints, frame)


def pressures(data: NDArray[np.uint8], messages: Messages,
              channels: list[int]) -> tuple[NDArray[np.int64], Floats, NDArray[np.void], int]:
    """Stamps (ns), values (Pa) and HEADs of the applied pressure in one chunk, and how many messages were left out."""
    heads, records, refused = _records(data, messages, channels, cdr.FLUID_PRESSURE)
    return cdr.stamps(records), records["fluid_pressure"].astype(np.float64), heads, refused


def _records(data: NDArray[np.uint8], messages: Messages, channels: list[int],
             layout: cdr.Layout) -> tuple[NDArray[np.void], NDArray[np.void], int]:
    """HEADs and values of the channels' messages that have this layout, and the number of the others."""
    expected = layout.example
    mine = np.isin(messages.channel, channels)
    right_length = messages.length[mine] == 22 + len(expected)
    offset = messages.offset[mine][right_length]
    refused = len(right_length) - len(offset)
    if not len(offset):
        return np.empty(0, HEAD), np.empty(0, layout.record), refused
    rows = sliding_window_view(data, len(expected))[offset + 22]
    mask = np.where(layout.fixed, np.uint8(0xFF), np.uint8(0))
    wrong = ((rows.view("<u4") ^ expected.view("<u4")) & mask.view("<u4")).any(axis=1)
    if wrong.any():
        rows, offset, refused = rows[~wrong], offset[~wrong], refused + int(wrong.sum())
    heads = sliding_window_view(data, HEAD.itemsize)[offset].view(HEAD)[:, 0]
    return heads, rows.view(layout.record)[:, 0], refused


class PressureJoin:
    """Puts the applied pressure beside the joint_states of the same stamp, though the two arrive in blocks of their
    own.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._waiting: deque[JointStates] = deque()
        self._held = 0
        self._known: deque[tuple[int, NDArray[np.int64], Floats]] = deque()
        self._stamps = StampCounter()
        self._run = -1

    def add_pressures(self, stamps: NDArray[np.int64], values: Floats, publisher: NDArray[np.int64],
                      numbers: NDArray[np.int64]) -> None:
        """Add applied pressures in the order of the recording; `publisher` and `numbers` as in StampCounter.pieces."""
        for piece, preceded in self._stamps.pieces(stamps, publisher, numbers):
            self._run += preceded.begins_a_run
            self._known.append((self._run, stamps[piece], values[piece]))

    def add(self, batch: JointStates) -> Iterator[JointStates]:
        """Add joint_states; gives those whose pressure is known by now."""
        self._waiting.append(batch)
        self._held += len(batch)
        return self._ready(finished=False)

    def finish(self) -> Iterator[JointStates]:
        """The rest: what has no pressure gets NaN."""
        return self._ready(finished=True)

    def _ready(self, finished: bool) -> Iterator[JointStates]:
        """Batches, or their first parts, up to the last pressure that is known."""
        while self._waiting:
            batch = self._waiting[0]
            late = finished or batch.run < self._run or self._held > _MOST_WAITING
            count = len(batch)
            if not late:
                known = self._stamps.last if self._stamps.last is not None and batch.run == self._run else None
                count = int(np.searchsorted(batch.stamp_ns, known, side="right")) if known is not None else 0
            self._held -= count
            if count:
                yield self._joined(batch[:count])
            if count < len(batch):
                self._waiting[0] = batch[count:]
                return
            self._waiting.popleft()

    def _joined(self, batch: JointStates) -> JointStates:
        """The batch with its pressures; forgets those that came before it."""
        first, last = int(batch.stamp_ns[0]), int(batch.stamp_ns[-1])
        while self._known and (self._known[0][0], int(self._known[0][1][-1])) < (batch.run, first):
            self._known.popleft()
        pressure = np.full(len(batch), np.nan)
        for run, stamps, values in self._known:
            if run > batch.run or stamps[0] > last:
                break
            place = np.searchsorted(stamps, batch.stamp_ns).clip(max=len(stamps) - 1)
            same = stamps[place] == batch.stamp_ns
            pressure[same] = values[place[same]]
        self.missing += int(np.isnan(pressure).sum())
        return replace(batch, applied_pressure=pressure)
