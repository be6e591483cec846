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

COMMANDS = {"engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, "target_slip_speed": FLOAT64}
"""Topics that tell the driveline or its controller what to do, with their types."""

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


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

    def has_target(self, topics: Mapping[str, str]) -> bool:
        """Whether a recording with these topics holds what a slip controller was asked for."""
        return any(self._names.get(topic) == "target_slip_speed" for topic in topics)

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Take the commands of one chunk."""
        for number, row in channels.items():
            name = self._names.get(row.topic)
            if name is None or row.type != COMMANDS[name]:
                continue
            mine = messages.channel == number
            times, values = _decoded(np.frombuffer(data, dtype=np.uint8), messages.offset[mine], messages.length[mine],
                                     row.type)
            before = self._waiting[name]
            self._waiting[name] = np.concatenate([before[0], times]), np.concatenate([before[1], values])

    def until(self, batch: JointStates) -> dict[str, tuple[Stamps, Floats]]:
        """The commands that were received by the end of a batch, (n,) arrays: simulation time (ns) of the first state
        that came after each, and value in the unit of its topic.
        """
        found = {}
        for name, (times, values) in self._waiting.items():
            due = int(np.searchsorted(times, batch.log_ns[-1], side="right")) if len(batch) else 0
            if due:
                place = np.searchsorted(batch.log_ns, times[:due], side="left").clip(max=len(batch) - 1)
                found[name] = batch.stamp_ns[place], values[:due]
                self._waiting[name] = times[due:], values[due:]
        return found


def _decoded(array: NDArray[np.uint8], offset: NDArray[np.int64], length: NDArray[np.int64],
             kind: str) -> tuple[Stamps, Floats]:
    """Times of receipt (ns) and finite values of messages of one type; others are passed over."""
    if not len(offset):
        return np.empty(0, np.int64), np.empty(0)
    body = offset + 22
    if kind == FLOAT64:
        place = body + 4
    else:
        whole = length >= 22 + 16
        offset, length, body = offset[whole], length[whole], body[whole]
        if not len(body):
            return np.empty(0, np.int64), np.empty(0)
        # The frame's name stands before the pressure, which starts on a multiple of eight bytes after the first four.
        name = sliding_window_view(array, 4)[body + 12].copy().view("<u4")[:, 0].astype(np.int64)
        place = body + 4 + (12 + name + 7) // 8 * 8
    inside = place + 8 <= np.minimum(offset + length, len(array))
    offset, place = offset[inside], place[inside]
    if not len(place):
        return np.empty(0, np.int64), np.empty(0)
    times = sliding_window_view(array, 8)[offset + 6].copy().view("<i8")[:, 0]
    values = sliding_window_view(array, 8)[place].copy().view("<f8")[:, 0]
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    finite = np.isfinite(values)
    return times[finite].astype(np.int64), values[finite].astype(np.float64)
