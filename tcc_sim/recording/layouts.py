"""Messages of one type in all their layouts, such as other frames, further joints, and arrays without values."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

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


ROW, NUMBER, LOG, SENT, STAMP, ORIGIN = range(6)
"""Rows of the heads of messages, (6, n): place in the chunk, sequence number, times of receipt and sending, and stamp,
ns, and number of the run or publisher that each is from.
"""


class Decoded(NamedTuple):
    """Messages of a chunk, in their order.

    names : names of their joints; empty for several layouts
    heads : (6, n) as ROW, NUMBER and so on say, without the origin
    frames : (n,) frames that are names of runs, empty for others
    values : (fields, n) values, NaN where a message has none
    """

    names: tuple[str, ...]
    heads: Positions
    frames: Frames
    values: Floats

    def part(self, which: NDArray[np.bool_]) -> Decoded:
        """Return some of the messages."""
        return Decoded(self.names, self.heads.compress(which, axis=1), self.frames[which],
                       self.values.compress(which, axis=1))


def sent_ns(heads: Positions) -> Positions:
    """Return the times of sending, ns; that of receipt where a message has no other."""
    times: Positions = np.where(heads[SENT] > 0, heads[SENT], heads[LOG])
    return times


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
        groups = [group for group in self.groups(data, messages, channels) if set(self.joints) <= set(group.names)]
        if len(groups) == 1:
            return groups[0]
        none = Decoded((), np.empty((6, 0), np.int64), np.empty(0, f"S{cdr.RUN_LENGTH}"),
                       np.empty((len(self.fields), 0)))
        heads, frames, values = (np.concatenate(parts, axis=-1) for parts in zip(*(one[1:] for one in (none, *groups))))
        order = np.argsort(heads[ROW])
        return Decoded((), heads.take(order, axis=1), frames[order], values.take(order, axis=1))

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
            records = windows_of(data, MESSAGE_HEAD)[offset[same]].view(HEAD)[:, 0]
            heads = np.array([left[mine], records["number"], records["log_ns"], records["sent_ns"], cdr.stamps(values),
                              np.zeros(len(values), np.int64)])
            frames = np.zeros(len(values), f"S{cdr.RUN_LENGTH}")
            if int.from_bytes(layout.example[cdr.FRAME - 4:cdr.FRAME].tobytes(), "little") == cdr.RUN_LENGTH + 1:
                bodies = values.view(np.uint8).reshape(-1, size)[:, cdr.FRAME:cdr.FRAME + cdr.RUN_LENGTH]
                found, at = np.unique(np.ascontiguousarray(bodies).view(frames.dtype)[:, 0], return_inverse=True)
                frames = np.array([name if _RUN.fullmatch(name) else b"" for name in found.tolist()], frames.dtype)[at]
            nothing = np.full(len(values), np.nan)
            columns = [values[name] if name in (values.dtype.names or ()) else nothing for name in self.fields]
            groups.append(Decoded(names, heads, frames, np.array(columns).reshape(-1, len(values))))
        rest: Positions = left[~mine]
        return rest


@dataclass(frozen=True)
class StampedMessages:
    """Messages of one kind in the order of reading.

    heads : (6, n) as in `Decoded`; ROW is that in the columns, -1 for a message outside the window, and LOG the time of
        sending if the recorder logged simulation time (use_sim_time), which is years earlier
    columns : values by field
    """

    heads: Positions
    columns: dict[str, Floats]


class Collected:
    """Messages of one kind that are collected while a recording is read.

    place : function that returns the run or publisher of each message (-1: another driveline's), its simulation time
        (ns), and whether it lies in the window, each (n,)
    """

    def __init__(self, layouts: Layouts, place: Callable[[Decoded], tuple[Positions, Positions, NDArray[np.bool_]]]
                 ) -> None:
        self.layouts, self._place = layouts, place
        self._heads = [np.empty((6, 0), np.int64)]
        self._values = [np.empty((len(layouts.fields), 0))]
        self.kept = 0
        """Number of messages in the window."""
        self.unnamed = 0
        """Number of messages whose frame names no run."""

    def take(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> None:
        """Take the messages of these channels in one chunk: all with their stamps and times, those in the window with
        their values.
        """
        found = self.layouts.take(data, messages, channels)
        heads, (origin, stamps, inside) = found.heads, self._place(found)
        kept, sent = inside & (origin >= 0), sent_ns(heads)
        heads[ORIGIN], heads[STAMP], heads[SENT] = origin, stamps, sent
        heads[LOG] = np.where(heads[LOG] < sent - _YEAR, sent, heads[LOG])
        heads[ROW] = np.where(kept, self.kept + np.cumsum(kept) - 1, -1)
        self._heads.append(heads.compress(origin >= 0, axis=1))
        self._values.append(found.values.compress(kept, axis=1))
        self.kept += int(np.count_nonzero(kept))
        self.unnamed += int(np.count_nonzero(found.frames == b""))

    def messages(self) -> StampedMessages:
        """Return all messages, which are no longer kept here."""
        heads, values = np.concatenate(self._heads, axis=1), np.concatenate(self._values, axis=1)
        self._heads, self._values = [], []
        return StampedMessages(heads, dict(zip(self.layouts.fields, values)))
