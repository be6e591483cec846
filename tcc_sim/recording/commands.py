"""What was commanded during a recording, at the simulation time at which the driveline was then."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.records import Messages
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE

TARGET = "target_slip_speed"
COMMANDS = {"engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, TARGET: FLOAT64}
"""Topics that tell the driveline or its controller what to do, with their types."""

SET_BACK = 50_000_000
"""A clock that goes back by more than this, ns, was set; by less, messages of several senders were not in order."""
Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
Rows = NDArray[np.int64]


class Commands:
    """Takes the commands of every chunk (`take` is a `reader.Tap`) and gives them beside the joint_states.

    Parameters
    ----------
    joint_states_topic : whose namespace the commands share
    """

    def __init__(self, joint_states_topic: str) -> None:
        space = joint_states_topic.rpartition("/")[0]
        self._names = {f"{space}/{name}": name for name in COMMANDS}
        self._waiting: dict[str, tuple[Stamps, Floats]] = {
            name: (np.empty(0, np.int64), np.empty(0)) for name in COMMANDS}
        self._last_ns = -(2**62)
        self._taken_ns: dict[str, int] = {}

    def has_target(self, topics: Mapping[str, str]) -> bool:
        """Whether a recording with these topics holds what a slip controller was asked for."""
        return any(self._names.get(topic) == TARGET for topic in topics)

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Take the commands of one chunk, in its order."""
        found: dict[str, list[tuple[Stamps, Stamps, Floats]]] = {}
        for number, row in channels.items():
            name = self._names.get(row.topic)
            if name is None or row.type != COMMANDS[name]:
                continue
            mine = messages.channel == number
            part = _decoded(np.frombuffer(data, dtype=np.uint8), messages.offset[mine], messages.length[mine], row.type)
            found.setdefault(name, []).append(part)
        for name, parts in found.items():
            order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
            before = self._waiting[name]
            self._waiting[name] = (np.concatenate([before[0], np.concatenate([part[1] for part in parts])[order]]),
                                   np.concatenate([before[1], np.concatenate([part[2] for part in parts])[order]]))

    def until(self, batch: JointStates) -> dict[str, tuple[Rows, Floats]]:
        """The commands that were received by the end of a batch, (n,) arrays: row of the first state that came after
        each, not descending, and value in the unit of its topic.

        A clock that is set back does so for the states and for the commands; what lies between two such steps of the
        one belongs to what lies between the same two of the other.
        """
        if not len(batch):
            return {}
        log = batch.log_ns
        cuts = (1 + np.flatnonzero(np.diff(log) < -SET_BACK)).tolist()
        before, self._last_ns = self._last_ns, int(log[-1])
        found = {}
        for name in COMMANDS:
            places, values = [np.empty(0, np.int64)], [np.empty(0)]
            if int(log[0]) < before - SET_BACK:
                taken = self._taken(name, before, set_back=True)
                places.append(np.zeros(len(taken[0]), np.int64))
                values.append(taken[1])
            for first, end in zip([0, *cuts], [*cuts, len(log)]):
                piece = np.maximum.accumulate(log[first:end])
                taken = self._taken(name, int(piece[-1]), set_back=end < len(log))
                places.append(first + np.searchsorted(piece, taken[0], side="left").clip(max=len(piece) - 1))
                values.append(taken[1])
            place = np.concatenate(places)
            if len(place):
                found[name] = place, np.concatenate(values)
        return found

    def _taken(self, name: str, until_ns: int, set_back: bool) -> tuple[Stamps, Floats]:
        """The commands that wait, up to a time; with `set_back` all that were received before the clock was set."""
        times, values = self._waiting[name]
        back = np.flatnonzero(np.diff(times, prepend=self._taken_ns.get(name, times[:1])) < -SET_BACK)
        first = times[:back[0]] if len(back) else times
        if not set_back or not len(back):
            limit = until_ns + SET_BACK if set_back else until_ns
            first = first[:int(np.searchsorted(np.maximum.accumulate(first), limit, side="right"))]
        if set_back:
            self._taken_ns.pop(name, None)
        elif len(first):
            self._taken_ns[name] = int(first[-1])
        self._waiting[name] = times[len(first):], values[len(first):]
        return first, values[:len(first)]


def _decoded(array: NDArray[np.uint8], offset: NDArray[np.int64], length: NDArray[np.int64],
             kind: str) -> tuple[Stamps, Stamps, Floats]:
    """Places in the chunk, times of receipt (ns) and finite values of messages of one type; others are passed over."""
    nothing = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    if not len(offset):
        return nothing
    body = offset + 22
    if kind == FLOAT64:
        place = body + 4
    else:
        whole = length >= 22 + 16
        offset, length, body = offset[whole], length[whole], body[whole]
        if not len(body):
            return nothing
        # The frame's name stands before the pressure, which starts on a multiple of eight bytes after the first four.
        name = sliding_window_view(array, 4)[body + 12].copy().view("<u4")[:, 0].astype(np.int64)
        place = body + 4 + (12 + name + 7) // 8 * 8
    inside = place + 8 <= np.minimum(offset + length, len(array))
    offset, place = offset[inside], place[inside]
    little = (array[offset + 22] == 0) & (array[offset + 23] == 1)  # As cdr encodes; no other order of bytes is read.
    offset, place = offset[little], place[little]
    if not len(place):
        return nothing
    times = sliding_window_view(array, 8)[offset + 6].copy().view("<i8")[:, 0]
    values = sliding_window_view(array, 8)[place].copy().view("<f8")[:, 0]
    finite = np.isfinite(values)
    return offset[finite].astype(np.int64), times[finite].astype(np.int64), values[finite].astype(np.float64)
