"""What was commanded during a recording, at the simulation time at which the driveline was then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.recording.announcements import read_source
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.records import Messages
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, HEADER

TARGET = "target_slip_speed"
COMMANDS = {"engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, TARGET: FLOAT64}
"""Topics that tell the driveline or its controller what to do, with their types."""

SOURCE = "input_source"
"""Topic that says which inputs a command holds; it stands among the signals as a sum of SOURCE_BITS."""
SOURCE_BITS = {name: 1 << place for place, name in enumerate(COMMANDS) if name != TARGET}
SET_BACK = 50_000_000
"""A sender's clock that goes back by more than this, ns, was set."""
LONGEST_WAIT = 4
"""Chunks after which a command is placed whatever the clocks say: a recorder drains all topics several times a second.
"""
Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
Rows = NDArray[np.int64]


class _Waiting(NamedTuple):
    """Commands of one topic that no state has come after yet, (n,) arrays: time (ns by the recorder's clock), value,
    whether their sender's clock was set back just before, and the chunk they came in.
    """

    times: Stamps
    values: Floats
    back: NDArray[np.bool_]
    chunk: Stamps

    def part(self, which: Any) -> _Waiting:
        """Some of them."""
        return _Waiting(*(column[which] for column in self))

    @staticmethod
    def joined(parts: Sequence[_Waiting]) -> _Waiting:
        """One after the other."""
        return _Waiting(*(np.concatenate(columns) for columns in zip(*parts)))


_NONE = _Waiting(np.empty(0, np.int64), np.empty(0), np.empty(0, np.bool_), np.empty(0, np.int64))


class Commands:
    """Takes the commands of every chunk (`take` is a `reader.Tap`) and gives them beside the joint_states.

    Commands and states are put in order by when they were sent. A reliable middleware hands over what it had to ask
    for again up to seconds late, so that times of receipt go back and forth on a busy machine; those of sending go back
    where a clock is set, and otherwise never at one sender.

    Parameters
    ----------
    joint_states_topic : whose namespace the commands share
    """

    def __init__(self, joint_states_topic: str) -> None:
        space = joint_states_topic.rpartition("/")[0]
        self._names = {f"{space}/{name}": name for name in (*COMMANDS, SOURCE)}
        self._waiting = dict.fromkeys(self._names.values(), _NONE)
        self._last_sent: dict[tuple[str, int], int] = {}
        self._last_state = -(2**62)
        self._last_ns = -(2**62)
        self._chunk = 0

    def has_target(self, topics: Mapping[str, str]) -> bool:
        """Whether a recording with these topics holds what a slip controller was asked for."""
        return any(self._names.get(topic) == TARGET for topic in topics)

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Take the commands of one chunk."""
        self._chunk += 1
        found: dict[str, list[tuple[Stamps, _Waiting]]] = {}
        for number, row in channels.items():
            name = self._names.get(row.topic)
            if name is None or row.type != COMMANDS.get(name, HEADER):
                continue
            mine = messages.channel == number
            if not mine.any():
                continue
            offset, log, sent, values = (_sources if name == SOURCE else _decoded)(
                np.frombuffer(data, dtype=np.uint8), messages.offset[mine], messages.length[mine], row.type)
            if len(offset):
                back = np.diff(sent, prepend=self._last_sent.get((name, number), int(sent[0]))) < -SET_BACK
                self._last_sent[name, number] = int(sent[-1])
                found.setdefault(name, []).append((offset, _Waiting(
                    sent + (log - sent).min(), values, back, np.full(len(offset), self._chunk))))
        for name, parts in found.items():
            fresh = _Waiting.joined([part for _, part in parts])
            key = np.concatenate([offset for offset, _ in parts]) if fresh.back.any() else fresh.times
            self._waiting[name] = _Waiting.joined([self._waiting[name], fresh.part(np.argsort(key, kind="stable"))])

    def until(self, batch: JointStates) -> dict[str, tuple[Rows, Floats]]:
        """The commands that were sent by the end of a batch, (n,) arrays: row of the first state that came after each,
        not descending, and value in the unit of its topic.

        A clock that is set back does so for the states and for the commands; what lies between two such steps of the
        one belongs to what lies between the same two of the other.
        """
        if not len(batch):
            return {}
        sent = batch.sent_ns
        times = sent + (batch.log_ns - sent).min()
        cuts = (1 + np.flatnonzero(np.diff(sent) < -SET_BACK)).tolist()
        stepped, before = int(sent[0]) < self._last_state - SET_BACK, self._last_ns
        self._last_state, self._last_ns = int(sent[-1]), int(times[-1])
        found = {}
        for name in self._waiting:
            late = self._overdue(name)
            places, values = [np.zeros(len(late), np.int64)], [late]
            if stepped:
                taken = self._taken(name, before, set_back=True)
                places.append(np.zeros(len(taken.times), np.int64))
                values.append(taken.values)
            for first, end in zip([0, *cuts], [*cuts, len(sent)]):
                piece = np.maximum.accumulate(times[first:end])
                taken = self._taken(name, int(piece[-1]), set_back=end < len(sent))
                row = np.searchsorted(piece, np.maximum.accumulate(taken.times), side="left").clip(max=len(piece) - 1)
                places.append(first + row)
                values.append(taken.values)
            place = np.concatenate(places)
            if len(place):
                found[name] = place, np.concatenate(values)
        return found

    def _overdue(self, name: str) -> Floats:
        """Take the commands that wait for a step of the states' clock that does not come."""
        waiting = self._waiting[name]
        count = int(np.count_nonzero(waiting.chunk <= self._chunk - LONGEST_WAIT))
        self._waiting[name] = waiting.part(slice(count, None))
        return waiting.values[:count]

    def _taken(self, name: str, until_ns: int, set_back: bool) -> _Waiting:
        """The commands that wait, up to a time; with `set_back` all that were sent before the clock was set."""
        waiting = self._waiting[name]
        steps = np.flatnonzero(waiting.back)
        count = int(steps[0]) if len(steps) else len(waiting.back)
        if not set_back or not len(steps):
            limit = until_ns + SET_BACK if set_back else until_ns
            count = int(np.searchsorted(np.maximum.accumulate(waiting.times[:count]), limit, side="right"))
        taken, rest = waiting.part(slice(None, count)), waiting.part(slice(count, None))
        if set_back and len(steps):
            rest.back[0] = False
        elif set_back:  # The next command, whose step this is, may come in a later chunk.
            self._last_sent = {key: sent for key, sent in self._last_sent.items() if key[0] != name}
        self._waiting[name] = rest
        return taken


def _decoded(array: NDArray[np.uint8], offset: NDArray[np.int64], length: NDArray[np.int64],
             kind: str) -> tuple[Stamps, Stamps, Stamps, Floats]:
    """Places in the chunk, times of receipt and of sending (ns) and finite values of messages of one type; others are
    passed over.
    """
    if kind == FLOAT64:
        place = offset + 22 + 4
    else:
        whole = length >= 22 + 16
        offset, length = offset[whole], length[whole]
        body = offset + 22
        # The frame's name stands before the pressure, which starts on a multiple of eight bytes after the first four.
        name = sliding_window_view(array, 4)[body + 12].copy().view("<u4")[:, 0].astype(np.int64)
        place = body + 4 + (12 + name + 7) // 8 * 8
    inside = place + 8 <= np.minimum(offset + length, len(array))
    offset, place = offset[inside], place[inside]
    little = (array[offset + 22] == 0) & (array[offset + 23] == 1)  # As cdr encodes; no other order of bytes is read.
    offset, place = offset[little], place[little]
    values = sliding_window_view(array, 8)[place].copy().view("<f8")[:, 0]
    finite = np.isfinite(values)
    return offset[finite].astype(np.int64), *_times(array, offset[finite]), values[finite].astype(np.float64)


def _sources(array: NDArray[np.uint8], offset: NDArray[np.int64], length: NDArray[np.int64],
             kind: str) -> tuple[Stamps, Stamps, Stamps, Floats]:
    """The same of what says which inputs a command holds, as sums of SOURCE_BITS."""
    said = [(place, source) for place, size in zip(offset.tolist(), length.tolist())
            if (source := read_source(array[place:place + size].tobytes())) is not None]
    places = np.array([place for place, _ in said], dtype=np.int64)
    values = [float(sum(bit for name, bit in SOURCE_BITS.items() if name in source.commanded)) for _, source in said]
    return places, *_times(array, places), np.array(values)


def _times(array: NDArray[np.uint8], offset: Stamps) -> tuple[Stamps, Stamps]:
    """When the messages were received and sent, ns; where it is not said when they were sent, the former for both."""
    received, sent = (sliding_window_view(array, 8)[offset + place].copy().view("<i8")[:, 0].astype(np.int64)
                      for place in (6, 14))
    return received, np.where(sent > 0, sent, received)
