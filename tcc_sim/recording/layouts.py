"""Messages of one type in all their layouts, such as other frames, further joints, and arrays without values."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.messages import cdr
from tcc_sim.messages.held import RUN
from tcc_sim.recording.records import HEAD, MESSAGE_HEAD, Messages, windows_of

MOST_LAYOUTS = 100
"""Largest number of layouts of the messages of a topic; messages of further layouts are left out."""
_RUN = re.compile(RUN.encode())
_YEAR = 365 * 86_400 * 1_000_000_000
Floats = NDArray[np.float64]
Positions = NDArray[np.int64]
Frames = NDArray[np.bytes_]


class Decoded(NamedTuple):
    """Messages of a chunk, in their order.

    names : names of their joints; empty for several layouts
    rows : (n,) index of each message in the chunk
    heads : (n,) array of HEAD
    stamps : (n,) stamps, ns
    frames : (n,) frames that are names of runs, empty for others
    columns : (n,) values by field, NaN where a message has none
    """

    names: tuple[str, ...]
    rows: Positions
    heads: NDArray[np.void]
    stamps: NDArray[np.int64]
    frames: Frames
    columns: dict[str, Floats]

    def part(self, which: NDArray[Any]) -> Decoded:
        """Return some of the messages."""
        return Decoded(self.names, self.rows[which], self.heads[which], self.stamps[which], self.frames[which],
                       {name: column[which] for name, column in self.columns.items()})


def times_of(heads: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return times of receipt and of sending, ns; that of receipt for both where the message has no other."""
    log, sent = (heads[name].astype(np.int64) for name in ("log_ns", "sent_ns"))
    return log, np.where(sent > 0, sent, log)


class Layouts:
    """Layouts of the messages of one type that were met so far: JointState, FluidPressure or Float64, of which the
    values `fields` of `joints` are wanted.
    """

    def __init__(self, type: str, joints: Sequence[str] = (), fields: Sequence[str] = ()) -> None:
        self.type, self.joints, self.fields = type, joints, fields
        self.refused = 0
        """Number of messages that could not be decoded."""
        self.why = ""
        """Reason of the first of them."""
        self._known: list[tuple[tuple[str, ...], cdr.Layout]] = []

    def take(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> Decoded:
        """Return the messages of these channels that hold the wanted values."""
        none = Decoded((), np.empty(0, np.int64), np.empty(0, HEAD), np.empty(0, np.int64),
                       np.empty(0, f"S{cdr.RUN_LENGTH}"), {name: np.empty(0) for name in self.fields})
        groups = [group for group in self.groups(data, messages, channels) if set(self.joints) <= set(group.names)]
        if len(groups) < 2:
            return groups[0] if groups else none
        rows, heads, stamps, frames = (np.concatenate(columns) for columns in zip(*(group[1:5] for group in groups)))
        columns = {name: np.concatenate([group.columns[name] for group in groups]) for name in self.fields}
        return Decoded((), rows, heads, stamps, frames, columns).part(np.argsort(rows))

    def groups(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> list[Decoded]:
        """Return the messages of these channels by their layouts."""
        left: Positions = np.flatnonzero(np.isin(messages.channel, channels))
        groups: list[Decoded] = []
        for names, layout in self._known:
            left = self._of(data, messages, left, names, layout, groups)
        while len(left):
            begin = messages.offset[left[0]]
            body = data[begin + MESSAGE_HEAD:begin + messages.length[left[0]]].tobytes()
            try:
                if len(self._known) == MOST_LAYOUTS:
                    raise ValueError(f"they have more than {MOST_LAYOUTS} layouts")
                self._known.append(cdr.layout_of(body, self.type, self.fields, self.joints))
                left = self._of(data, messages, left, *self._known[-1], groups)
            except ValueError as error:
                self.why = self.why or str(error)
                self.refused += 1
                left = left[1:]
        return groups

    def _of(self, data: NDArray[np.uint8], messages: Messages, left: Positions, names: tuple[str, ...],
            layout: cdr.Layout, groups: list[Decoded]) -> Positions:
        """Add the messages of one layout to `groups`; return the indices of the others."""
        size = len(layout.example)
        mine = messages.length[left] == MESSAGE_HEAD + size
        if not mine.any():
            return left
        offset = messages.offset[left[mine]]
        values, same = layout.found(windows_of(data, size)[offset + MESSAGE_HEAD])
        mine[mine] = same
        if len(values):
            heads: NDArray[np.void] = windows_of(data, MESSAGE_HEAD)[offset[same]].view(HEAD)[:, 0]
            frames = np.zeros(len(values), f"S{cdr.RUN_LENGTH}")
            if int.from_bytes(layout.example[cdr.FRAME - 4:cdr.FRAME].tobytes(), "little") == cdr.RUN_LENGTH + 1:
                bodies = values.view(np.uint8).reshape(-1, size)[:, cdr.FRAME:cdr.FRAME + cdr.RUN_LENGTH]
                found, at = np.unique(np.ascontiguousarray(bodies).view(frames.dtype)[:, 0], return_inverse=True)
                frames = np.array([name if _RUN.fullmatch(name) else b"" for name in found.tolist()], frames.dtype)[at]
            columns = {name: values[name].astype(np.float64) if name in (values.dtype.names or ())
                       else np.full(len(values), np.nan) for name in self.fields}
            groups.append(Decoded(names, left[mine], heads, cdr.stamps(values), frames, columns))
        rest: Positions = left[~mine]
        return rest


@dataclass(frozen=True)
class StampedMessages:
    """Messages of one kind in the order of reading, (n,) arrays.

    origin : number of the run or publisher that each is from
    stamp_ns, number, log_ns, sent_ns : stamp, sequence number, times of receipt and sending, ns; of receipt, the time
        of sending if the recorder logged simulation time (use_sim_time), which is years earlier
    kept : index of each message in the columns, -1 for one outside the window
    columns : values by field
    """

    origin: NDArray[np.int64]
    stamp_ns: NDArray[np.int64]
    number: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    kept: NDArray[np.int64]
    columns: Mapping[str, Floats]

    def __len__(self) -> int:
        return len(self.origin)

    def at(self, order: Positions) -> StampedMessages:
        """Return the messages in another order."""
        return StampedMessages(self.origin[order], self.stamp_ns[order], self.number[order], self.log_ns[order],
                               self.sent_ns[order], self.kept[order], self.columns)


class Collected:
    """Messages of one kind that are collected while a recording is read.

    place : function that returns the run or publisher of each message (-1: another driveline's), its simulation time
        (ns), and whether it lies in the window, each (n,)
    """

    def __init__(self, layouts: Layouts, place: Callable[[Decoded], tuple[Positions, Positions, NDArray[np.bool_]]]
                 ) -> None:
        self.layouts, self._place = layouts, place
        self._parts: list[tuple[NDArray[np.int64], ...]] = []
        self._columns: list[dict[str, Floats]] = []
        self.kept = 0
        """Number of messages in the window."""
        self.unnamed = 0
        """Number of messages whose frame names no run."""

    def take(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> None:
        """Take the messages of these channels in one chunk: all with their stamps and times, those in the window with
        their values.
        """
        found = self.layouts.take(data, messages, channels)
        origin, stamps, inside = self._place(found)
        ours = origin >= 0
        heads, kept = found.heads[ours], inside[ours]
        log, sent = times_of(heads)
        self._parts.append((origin[ours], stamps[ours], heads["number"].astype(np.int64),
                            np.where(log < sent - _YEAR, sent, log), sent,
                            np.where(kept, self.kept + np.cumsum(kept) - 1, -1)))
        self._columns.append({name: column[ours & inside] for name, column in found.columns.items()})
        self.kept += int(np.count_nonzero(kept))
        self.unnamed += int(np.count_nonzero(found.frames == b""))

    def messages(self) -> StampedMessages:
        """Return all messages."""
        none = (np.empty(0, np.int64),) * 6
        origin, stamp, number, log, sent, kept = (np.concatenate(columns) for columns in zip(none, *self._parts))
        return StampedMessages(origin, stamp, number, log, sent, kept, {
            name: np.concatenate([np.empty(0), *(part[name] for part in self._columns)])
            for name in self.layouts.fields})
