"""What the driveline announces beside its states, as it is written, read and placed at the state at which it comes into
force, whatever the clock did meanwhile: its scene, and which inputs a command held.

A driveline says all of it in one order, but on several topics. What the file keeps of that order is: the order within
each topic, the stamp from which on each message holds, and by the driveline's clock when everything was sent. A clock
may be set back, so it only decides where the rest leaves a choice.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.model.profile import START, Origin
from tcc_sim.topics import HEADER, INPUTS

if TYPE_CHECKING:
    from tcc_sim.recording.batches import JointStates
    from tcc_sim.recording.contents import Channel
    from tcc_sim.recording.reader import Run
    from tcc_sim.recording.records import Messages

COMMAND, FALLBACK = "command", "fallback"
MOST_SOURCES = 100_000
"""Announced sources of the inputs of a recording that are followed."""
MOST_SCENES = 10_000
"""Scenes of a recording that are followed."""
MOST_CANDIDATES = 1_000_000
"""States at which a message may have come into force that are weighed, beside those that the clock is sure of."""
_TIMES, _HEAD, _LONGEST = struct.Struct("<QQ"), 22, 4096
_NUMBER = r"(-?\d[\de.+-]{0,30})"
_LINE = re.compile(r"# holds from stamp (\d{1,19}) ns on(, in the kernel with every term)?"
                   rf"(?:, phase {_NUMBER} rad at {_NUMBER} s, the load's ahead by {_NUMBER} rad)?")


def holding_from(text: str, stamp_ns: int, general: bool, origin: Origin = START) -> str:
    """The text of a scene that was changed while running, with a last line, a comment, that says what it applies to.

    Parameters
    ----------
    text : the scene (YAML)
    stamp_ns : stamp of the first state that it leads to: the tick after the change, or 0 where it holds since a reset
    general : the kernel with every term solves it (`general_terms`), since the driveline started with other terms
    origin : where the phases are counted from
    """
    phases = (f", phase {origin.phase!r} rad at {origin.time!r} s, the load's ahead by {origin.lead!r} rad"
              if origin != START else "")
    return f"{text}# holds from stamp {stamp_ns} ns on{', in the kernel with every term' if general else ''}{phases}\n"


@dataclass(frozen=True)
class SceneRecord:
    """A scene (YAML) that a recording holds, the package version that ran it and when it was said, by the driveline's
    clock (ns; 0: before the start). States that were sent later are its own, from `first_stamp_ns` on.
    """

    text: str
    version: str
    log_ns: int

    @cached_property
    def _line(self) -> re.Match[str] | None:
        """What the last line says of a scene that was changed while running."""
        return _LINE.fullmatch(self.text.rstrip("\n").rpartition("\n")[2])

    @property
    def first_stamp_ns(self) -> int:
        """Stamp of the first state that it led to; 0 for the scene that a driveline starts with."""
        return int(self._line[1]) if self._line else 0

    @property
    def general(self) -> bool:
        """Whether the kernel with every term solved it."""
        return self._line is not None and self._line[2] is not None

    @property
    def origin(self) -> Origin:
        """Where the phases are counted from."""
        if self._line is None or self._line[3] is None:
            return START
        try:
            phase, time, lead = map(float, self._line.groups()[2:])
        except ValueError:
            return START
        return Origin(time, phase, lead)

    @property
    def parameters(self) -> str:
        """The text without that line."""
        return self.text.rstrip("\n").rpartition("\n")[0] + "\n" if self._line else self.text


@dataclass(frozen=True)
class InputSource:
    """What one message, sent at `log_ns` by the driveline's clock, says: from the state of `first_stamp_ns` on these
    topics held a command, the others fell back.
    """

    log_ns: int
    first_stamp_ns: int
    commanded: frozenset[str]


def source_text(commanded: Mapping[str, bool]) -> str:
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


@dataclass(frozen=True)
class ScenePlace:
    """The message with this number holds from the state with this index on (counted over the whole recording)."""

    index: int
    number: int


class Places:
    """Finds the places while a recording is read.

    Parameters
    ----------
    said : all messages of one kind in the recording, in its order
    """

    def __init__(self, said: Sequence[SceneRecord | InputSource]) -> None:
        self._said = np.array([min(one.log_ns, 2**63 - 1) for one in said], dtype=np.int64)
        stamps = np.array([min(one.first_stamp_ns, 2**63 - 1) for one in said], dtype=np.int64)
        self._order = np.argsort(stamps, kind="stable")
        self._stamps = stamps[self._order]
        self._sure: list[list[int]] = [[] for _ in stamps]
        self._likely: list[list[int]] = [[] for _ in stamps]
        self._possible: list[list[int]] = [[] for _ in stamps]
        self._weighed = 0
        self._end = 0
        self._run = -1
        self._last_stamp = self._last_sent = -(2**63)

    def feed(self, batch: JointStates) -> None:
        """Take the next states, all of one run."""
        if not len(batch):
            return
        before = self._last_stamp if batch.run == self._run else -(2**63)
        low = np.searchsorted(self._stamps, before, side="right")
        high = np.searchsorted(self._stamps, batch.stamp_ns[-1], side="right")
        if high > low:
            numbers = self._order[low:high]
            rows = np.searchsorted(batch.stamp_ns, self._stamps[low:high])
            said, sent = self._said[numbers], batch.sent_ns[rows]
            earlier = np.where(rows > 0, batch.sent_ns[rows - 1], self._last_sent)
            between, set_back = (earlier <= said) & (said <= sent), sent < earlier
            sure = between | (set_back & ((said <= sent) | (said >= earlier)))
            for number, row in zip(numbers[sure].tolist(), rows[sure].tolist()):
                self._sure[number].append(batch.index + row)
            others = np.flatnonzero(~sure)[:MOST_CANDIDATES - self._weighed]
            self._weighed += len(others)
            for number, row, before_it in zip(numbers[others].tolist(), rows[others].tolist(),
                                              (said <= sent)[others].tolist()):
                (self._likely if before_it else self._possible)[number].append(batch.index + row)
        self._run, self._end = batch.run, batch.index + len(batch)
        self._last_stamp, self._last_sent = int(batch.stamp_ns[-1]), int(batch.sent_ns[-1])

    def places(self) -> list[ScenePlace]:
        """The places in their order; a message that never came into force has none."""
        found: list[int | None] = []
        last = 0
        for sure in self._sure:
            where = next((index for index in sure if index >= last), None)
            found.append(where)
            last = last if where is None else where
        end = self._end
        ends = []
        for where in reversed(found):
            end = end if where is None else where
            ends.append(end)
        last = 0
        for number, end in enumerate(reversed(ends)):
            if found[number] is None:
                others = sorted(self._likely[number]) or sorted(self._possible[number])
                found[number] = next((index for index in others if last <= index <= end), None)
            last = found[number] or last
        return [ScenePlace(index, number) for number, index in enumerate(found) if index is not None]


def places_of(said: Sequence[SceneRecord | InputSource], batches: Iterable[JointStates]) -> list[ScenePlace]:
    """From which states on the messages of one kind hold; the recording is read for more than one of them."""
    if len(said) < 2:
        return [ScenePlace(0, 0)] if said else []
    found = Places(said)
    for batch in batches:
        found.feed(batch)
    return found.places()
