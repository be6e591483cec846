"""Messages of one type in all their layouts, such as other frames, further joints, and arrays without values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.messages import cdr
from tcc_sim.recording.announcements import Stamps, simulation_ns
from tcc_sim.recording.records import HEAD, MESSAGE_HEAD, Messages
from tcc_sim.topics import FLUID_PRESSURE, JOINT_STATE

MOST_LAYOUTS = 100
"""Largest number of layouts of the messages of a topic; messages of further layouts are left out."""
NO_ZEROS: Stamps = np.empty(0, np.int64)
NO_FRAMES: NDArray[np.bytes_] = np.empty(0, f"S{cdr.RUN_LENGTH}")
_FRAME = 16
"""Byte at which the frame of a message with a header begins."""
Floats = NDArray[np.float64]
Positions = NDArray[np.int64]


def heads_at(data: NDArray[np.uint8], offsets: NDArray[Any]) -> NDArray[np.void]:
    """Return the HEAD of the messages that begin at these bytes, (n,)."""
    heads: NDArray[np.void] = sliding_window_view(data, MESSAGE_HEAD)[offsets].view(HEAD)[:, 0]
    return heads


class Values(NamedTuple):
    """Messages of a chunk that hold the wanted values, in their order.

    rows : (n,) index of each message in the chunk
    heads : (n,) array of HEAD
    stamps : (n,) stamps, ns
    frames : (n,) frames of the length of a run's name, empty for others
    columns : (n,) values by field, NaN where a message has none
    """

    rows: Positions
    heads: NDArray[np.void]
    stamps: NDArray[np.int64]
    frames: NDArray[np.bytes_]
    columns: dict[str, Floats]


class SameLayout(NamedTuple):
    """Messages of one layout in a chunk: its joints, and index, HEAD, stamp (ns) and frame of each message."""

    names: tuple[str, ...]
    rows: Positions
    heads: NDArray[np.void]
    stamps: NDArray[np.int64]
    frames: NDArray[np.bytes_]


Group = tuple[tuple[str, ...], Positions, NDArray[np.void], NDArray[np.void], NDArray[np.bytes_]]
"""Joints, indices, HEADs, values and frames of the messages of one layout."""


class Layouts:
    """Layouts of the messages of one type that were met so far.

    Parameters
    ----------
    type : message type, JointState or FluidPressure
    joints : names of the joints whose values are wanted
    fields : names of the values
    zeros : stamps of simulation time 0, as in `simulation_ns`
    """

    def __init__(self, type: str, joints: Sequence[str] = (), fields: Sequence[str] = (),
                 zeros: Stamps = NO_ZEROS) -> None:
        self._zeros = zeros
        self.type, self.joints, self.fields = type, joints, fields
        self.refused = 0
        """Number of messages that could not be decoded."""
        self.why = ""
        """Reason of the first of them."""
        self._known: list[tuple[tuple[str, ...], cdr.Layout]] = []

    def groups(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> list[SameLayout]:
        """Return the messages of these channels by their layouts."""
        return [SameLayout(names, rows, heads, cdr.stamps(records), frames) for names, rows, heads, records, frames in
                self._sorted(data, messages, channels)]

    def take(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]) -> Values:
        """Return the messages of these channels that hold the wanted values."""
        groups = [group for group in self._sorted(data, messages, channels) if set(self.joints) <= set(group[0])]
        if not groups:
            return Values(np.empty(0, np.int64), np.empty(0, HEAD), np.empty(0, np.int64), NO_FRAMES,
                          {name: np.empty(0) for name in self.fields})
        rows, heads, frames = (np.concatenate([group[k] for group in groups]) for k in (1, 2, 4))
        order = np.argsort(rows) if len(groups) > 1 else slice(None)
        columns: dict[str, Any] = {}
        for name in self.fields:
            columns[name] = np.concatenate([
                values[name].astype(np.float64) if name in (values.dtype.names or ()) else np.full(len(values), np.nan)
                for *_, values, _ in groups])[order]
        stamps = np.concatenate([cdr.stamps(group[3]) for group in groups])
        return Values(rows[order], heads[order], simulation_ns(stamps[order], self._zeros), frames[order], columns)

    def _sorted(self, data: NDArray[np.uint8], messages: Messages, channels: Sequence[int]
                ) -> list[Group]:
        left: Positions = np.flatnonzero(np.isin(messages.channel, channels))
        groups: list[Group] = []
        for names, layout in self._known:
            left = self._of(data, messages, left, names, layout, groups)
        while len(left):
            names_of = self._new(data[messages.offset[left[0]] + MESSAGE_HEAD:][:int(messages.length[left[0]])
                                                                                 - MESSAGE_HEAD].tobytes())
            before = len(left)
            if names_of is not None:
                left = self._of(data, messages, left, *names_of, groups)
            if len(left) == before:  # It cannot be decoded; nor can those of the same length and start.
                self.refused += 1
                left = left[1:]
        return groups

    def _new(self, data: bytes) -> tuple[tuple[str, ...], cdr.Layout] | None:
        """Return the layout of a message and keep it; None if there is none, or there are too many."""
        if len(self._known) >= MOST_LAYOUTS:
            return None
        try:
            if self.type == FLUID_PRESSURE:
                made: tuple[tuple[str, ...], cdr.Layout] = (), cdr.fluid_pressure_layout(
                    cdr.read_frame(data, FLUID_PRESSURE), *self.fields)
            elif self.type == JOINT_STATE:
                shape = cdr.read_joints(data)
                wanted = set(self.joints) <= set(shape.names)
                made = shape.names, cdr.joint_state_layout(
                    shape.names, self.joints if wanted else (), shape.frame_id, self.fields if wanted else (),
                    shape.counts)
            else:
                return None
        except (ValueError, UnicodeError) as error:
            self.why = self.why or str(error)
            return None
        self._known.append(made)
        return made

    def _of(self, data: NDArray[np.uint8], messages: Messages, left: Positions, names: tuple[str, ...],
            layout: cdr.Layout, groups: list[Group]) -> Positions:
        """Add the messages of one layout to `found`; return the indices of the others."""
        expected = layout.example
        mine = messages.length[left] == MESSAGE_HEAD + len(expected)
        if not mine.any():
            return left
        offset = messages.offset[left[mine]]
        rows = sliding_window_view(data, len(expected))[offset + MESSAGE_HEAD]
        mask = np.where(layout.fixed, np.uint8(0xFF), np.uint8(0))
        if len(expected) % 4 == 0:
            wrong = ((rows.view("<u4") ^ expected.view("<u4")) & mask.view("<u4")).any(axis=1)
        else:
            wrong = ((rows ^ expected) & mask).any(axis=1)
        mine[mine] = ~wrong
        if mine.any():
            heads = heads_at(data, offset[~wrong])
            right = np.ascontiguousarray(rows[~wrong])
            length = int.from_bytes(expected[_FRAME - 4:_FRAME].tobytes(), "little") - 1
            frames = (np.ascontiguousarray(right[:, _FRAME:_FRAME + cdr.RUN_LENGTH]).view(NO_FRAMES.dtype)[:, 0]
                      if length == cdr.RUN_LENGTH else np.zeros(len(right), NO_FRAMES.dtype))
            groups.append((names, left[mine], heads, right.view(layout.record)[:, 0], frames))
        rest: Positions = left[~mine]
        return rest
