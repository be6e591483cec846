"""Which inputs a command held and which the fallback, tick by tick, as the driveline says it on `input_source`."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.topics import HEADER, TOPICS

if TYPE_CHECKING:
    from tcc_sim.recording.contents import Channel
    from tcc_sim.recording.reader import Run
    from tcc_sim.recording.records import Messages

COMMAND, FALLBACK = "command", "fallback"
INPUTS = frozenset(row.name for row in TOPICS if row.direction == "in")
MOST_SOURCES = 100_000
"""Messages of a recording that are followed."""
_TIMES, _HEAD, _LONGEST = struct.Struct("<QQ"), 22, 4096


@dataclass(frozen=True)
class InputSource:
    """What one message, sent at `log_ns` by the driveline's clock, says: from the state of `first_stamp_ns` on these
    topics held a command, the others fell back.
    """

    log_ns: int
    first_stamp_ns: int
    commanded: frozenset[str]


def written(commanded: Mapping[str, bool]) -> str:
    """The text of a message: `engine_torque: command, actuation_pressure: fallback`."""
    return ", ".join(f"{name}: {COMMAND if held else FALLBACK}" for name, held in commanded.items())


def input_sources(run: Run) -> list[InputSource]:
    """What the driveline of a recording said, in the order in which it said it, each message once though a recorder
    that subscribed again got what is latched again; reads the recording once.
    """
    name = run.joint_states_topic.rpartition("/")[0] + "/input_source"
    found: dict[InputSource, None] = {}

    def tap(data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        wanted = [number for number, row in channels.items() if (row.topic, row.type) == (name, HEADER)]
        mine = np.isin(messages.channel, wanted) & (messages.length <= _LONGEST)
        for offset, length in zip(messages.offset[mine].tolist(), messages.length[mine].tolist()):
            source = read_source(data[offset:offset + length])
            if source is not None and len(found) < MOST_SOURCES:
                found.setdefault(source)

    # A recording that was cut short has no list of its topics.
    if run.topics.get(name) == HEADER or not run.complete:
        for _ in run.read(tap):
            pass
    return list(found)


def read_source(record: bytes) -> InputSource | None:
    """A message record: channel, number, two times and the serialised Header; None where it is none."""
    if not _HEAD < len(record) <= _LONGEST:
        return None
    received, sent = _TIMES.unpack_from(record, 6)
    try:
        stamp, text = cdr.read_header(record[_HEAD:])
    except ValueError:
        return None
    said = dict(part.partition(": ")[::2] for part in text.split(", "))
    return InputSource(sent or received, stamp, frozenset(name for name in INPUTS if said.get(name) == COMMAND))
