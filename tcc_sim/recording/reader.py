"""Read a bag or an MCAP file, complete, truncated or damaged, into columns."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from tcc_sim.errors import InputError, RecordingError, counted, one_line
from tcc_sim.messages import cdr
from tcc_sim.recording.announcements import SceneRecord, zeros_of
from tcc_sim.recording.columns import (
    Columns,
    GrowingStates,
    JointStates,
    all_beside,
    joint_states,
    layout_of,
)
from tcc_sim.recording.commands import TARGET, Commands
from tcc_sim.recording.contents import Channel, Contents, chunks, first_channels, together, unpack
from tcc_sim.recording.parts import missing_parts, open_file, part_number, parts_of, records_of, unlisted_parts
from tcc_sim.recording.records import DamagedChunk, Expansion, Messages, RecordStream, Warnings
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.recording.window import Window
from tcc_sim.topics import JOINT_NAMES, JOINT_STATE

BYTES_A_STATE = 110
"""Memory for one state and its derived quantities, bytes."""
_MOST_NAMED, _LARGEST_COUNT = 50, 10**18

Tap = Callable[[bytes, Messages, Mapping[int, Channel]], None]
"""Function of the bytes of an unpacked chunk, the positions of its messages, and the channels described so far."""


class TooManyStates(InputError):
    """A recording needs more memory than is allowed."""


class Run:
    """A recording of one or several files, opened by `open_run`.

    topics : message type by topic
    complete : whether the recording was closed properly; False if it was cut short
    result : the recorder's final record (lost messages by topic), merged over all files; None without one
    warnings : one sentence for each damage, complete after `states()`
    messages : number of messages read by topic, complete after `states()`
    size : size of all files, bytes
    """

    def __init__(self, path: Path, paths: list[Path], joints: Mapping[str, str] | None) -> None:
        self.path, self._given = path, paths
        self.warnings = Warnings()
        self.messages: dict[str, int] = {}
        self.stamps = StampCounter()
        self.complete = True
        self.scenes: list[SceneRecord] = []
        self.result: dict[str, Any] | None = None
        self.topics: dict[str, str] = {}
        self.size = 0
        self._contents: dict[Path, Contents] = {}
        self._publishers: dict[str, int] = {"": 0}
        self._began = Break.START
        self._left_out: list[str] = []
        for name in paths:
            try:
                self._open(name)
            except RecordingError as error:
                if len(paths) == 1:
                    raise
                self._left_out.append(f"left out: {error}")
                self.complete &= part_number(name) is None
        self._missing = missing_parts(path, paths)
        self.complete &= not self._missing
        if not self._contents:
            raise RecordingError(self._left_out[0].removeprefix("left out: "))
        self.paths = list(self._contents)
        self.scenes = list(dict.fromkeys(self.scenes))  # Each part of a split recording repeats the scene.
        # The only topic of JointStates, or the shortest name, preferably one that ends in joint_states.
        found = [name for name, type_name in self.topics.items() if type_name == JOINT_STATE]
        named_so = [name for name in found if name.rpartition("/")[2] == "joint_states"]
        self.joint_states_topic = min(named_so or found or ["/joint_states"], key=lambda name: (len(name), name))
        self._joints = tuple((joints or {}).get(name, name) for name in JOINT_NAMES)
        self._layout: cdr.Layout | None = None

    def _open(self, path: Path) -> None:
        """Read the records that describe a file."""
        contents = Contents()
        with open_file(path) as file:
            size = os.fstat(file.fileno()).st_size
            first_channels(records_of(path, RecordStream(file)), contents, JOINT_STATE, Expansion(size))
            stream = RecordStream(file, chunks=False)
            for record in records_of(path, stream):
                contents.add(record.opcode, record.body)
        self._contents[path] = contents
        self.size += size
        self.complete &= stream.complete
        self.scenes += contents.scenes
        self.result = together(self.result, contents.result)
        self.topics.update({channel.topic: channel.type for channel in contents.channels.values()})

    @property
    def scene_text(self) -> str | None:
        """The (first) scene of the recording, YAML; None if the recording has no scene."""
        return self.scenes[0].text if self.scenes else None

    @property
    def controlled(self) -> bool:
        """Whether a target slip speed was recorded."""
        return f"{self.joint_states_topic.rpartition('/')[0]}/{TARGET}" in self.topics

    @property
    def solver(self) -> str:
        """Name of the solver in the result record; `fixed_step`, the driveline's, by default."""
        name = (self.result or {}).get("solver")
        return name if isinstance(name, str) else "fixed_step"

    @property
    def lost_messages(self) -> int:
        """Number of joint_states messages that are missing according to the stamps."""
        return self.stamps.lost

    def states(self) -> tuple[JointStates, ...]:
        """Return the joint_states of every run; errors are those of `columns`."""
        return self.columns().runs

    def columns(self, window: Window | None = None) -> Columns:
        """Read the recording, or the states in a window, once and return it as columns.

        Raises
        ------
        RecordingError
            Nothing can be read, there are no joint_states, or publishers are mixed and cannot be separated.
        TooManyStates
            The states would need more than half of the machine's memory.
        """
        found = self.read(window=window)
        if not self.stamps.messages:
            raise RecordingError(f"{self.paths[0]}: no {self.joint_states_topic} can be read" +
                                 (f" ({self.warnings[0]})" if self.warnings else ""))
        return found

    def read(self, tap: Tap | None = None, window: Window | None = None) -> Columns:
        """Read as `columns` does, also without joint_states. With a `tap`, which is called for every readable chunk, no
        states are stored.
        """
        self.warnings, self.messages, self.stamps = Warnings(), dict.fromkeys(self.topics, 0), StampCounter()
        self._began = Break.START
        if window is None and tap is None:
            self._check_memory(sum(count for contents in self._contents.values()
                                   for number, count in contents.expected.items()
                                   if number in contents.channels
                                   and contents.channels[number].topic == self.joint_states_topic))
        zeros = zeros_of(scene.text for scene in self.scenes)
        every = all_beside(self.joint_states_topic, self.topics, zeros)
        refused = Counter[str]()
        states, commands = GrowingStates(), Commands(self.joint_states_topic, zeros)
        for path in self.paths:
            for data, messages, channels in self._chunks(path):
                if tap is not None:
                    tap(data, messages, channels)
                array, before = np.frombuffer(data, dtype=np.uint8), states.count
                here = np.flatnonzero(np.bincount(messages.channel)).tolist() if len(messages.channel) else []
                begun = np.empty(0, np.int64)
                if found := _of(channels, here, self.joint_states_topic, JOINT_STATE):
                    self._layout = self._layout or layout_of(data, messages, found, self._joints)
                    batch, heads, left_out = joint_states(array, messages, found, self._layout, zeros)
                    refused[self.joint_states_topic] += left_out
                    for part in self._runs(batch, self._publisher(heads, channels), heads["number"]):
                        rows = window.rows(part) if window is not None else slice(0, len(part))
                        if tap is None and rows.stop > rows.start:
                            states.add(part[rows])
                    begun = np.full(len(self._starts), len(messages.channel))
                    if not left_out:  # Otherwise the message of each state is unknown.
                        begun = np.flatnonzero(np.isin(messages.channel, found))[self._starts]
                    self._check_memory(states.count)
                for one in every:
                    if found := _of(channels, here, one.topic, one.type):
                        first = int(np.isin(messages.channel, found).argmax())
                        refused[one.topic] += one.take(array, messages, found,
                                                       self.stamps.runs - int(np.count_nonzero(begun > first)),
                                                       partial(self._publisher, channels=channels))
                commands.take(data, messages, channels, before, states.count)
        runs, parts, missing = states.runs(every)
        if missing:
            self.warnings.append(f"the applied pressure is missing at {counted(missing, 'tick')}")
        self._conclude(refused)
        return Columns(runs, parts, commands.beside(runs, parts), commands.sources,
                       {name: len(who) for name, who in commands.publishers.items()}, commands.counts)

    def _check_memory(self, count: int) -> None:
        """Raise TooManyStates if `count` states need more than half of the machine's memory."""
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if count * BYTES_A_STATE > memory // 2:
            raise TooManyStates(f"{self.path}: its {count} states take {count * BYTES_A_STATE / 1e9:.3g} GB, "
                                f"more than half of the {memory / 1e9:.3g} GB of this machine; ask for a window: "
                                "--from and --to (simulation time, s), or start and end in Python")

    def _publisher(self, heads: NDArray[np.void], channels: Mapping[int, Channel]) -> NDArray[np.int64]:
        """Return the number of each message's publisher; 0 if the recording does not identify it."""
        numbers, inverse = np.unique(heads["channel"], return_inverse=True)
        publishers = [self._publishers.setdefault(channels[channel].publisher, len(self._publishers))
                      for channel in numbers.tolist()]
        return np.array(publishers, dtype=np.int64)[inverse]

    def _runs(self, batch: JointStates, publisher: NDArray[np.int64],
              numbers: NDArray[np.int64]) -> Iterator[JointStates]:
        """Split a batch where simulation time starts again; leave out repeated stamps and late messages."""
        run, kept = self.stamps.runs - 1, np.zeros(len(batch), dtype=np.bool_)
        starts = [0]
        began = [self._began]
        for piece, preceded in self.stamps.pieces(batch.stamp_ns, publisher, numbers):
            kept[piece] = True
            if preceded.begins_a_run:
                starts.append(piece.start)
                began.append(preceded)
        self._began, self._starts = began[-1], starts[1:]
        for number, (start, end) in enumerate(zip(starts, [*starts[1:], len(batch)])):
            if kept[start:end].any():
                part = batch[start:end] if kept[start:end].all() else batch[start:end][kept[start:end]]
                yield replace(part, run=run + number, began=began[number])

    def _chunks(self, path: Path) -> Iterator[tuple[bytes, Messages, dict[int, Channel]]]:
        """Iterate over the unpacked chunks of one file with their messages; skip damaged ones with a warning."""
        known = self._contents[path]
        contents = Contents(channels=dict(known.channels), schemas=dict(known.schemas))
        seen, unchecked = Counter[int](), False
        with open_file(path) as file:
            stream, expansion = RecordStream(file, warnings=self.warnings), Expansion(os.fstat(file.fileno()).st_size)
            for chunk, indexes in chunks(records_of(path, stream), contents):
                try:
                    data, messages = unpack(chunk, indexes, contents, expansion)
                except DamagedChunk as error:
                    self.warnings.place(f"the chunk at byte {chunk.offset} is left out: {error}")
                    continue
                unchecked = unchecked or chunk.opcode == Opcode.MESSAGE or chunk.body[24:28] == bytes(4)
                if len(messages.channel):
                    counts = np.bincount(messages.channel)
                    seen.update({channel: int(counts[channel]) for channel in np.flatnonzero(counts).tolist()})
                yield data, messages, contents.channels
            complete = stream.complete
        for channel, row in contents.channels.items():
            self.messages[row.topic] = self.messages.get(row.topic, 0) + seen[channel]
        self.warnings.conclude()
        self.warnings.extend(contents.warnings())
        if unchecked:
            self.warnings.append("some messages have no checksum: damage in them would go unnoticed")
        if (nameless := set(seen) - set(contents.channels)):
            count = sum(seen[channel] for channel in nameless)
            self.warnings.append(f"{counted(count, 'message')} left out: the description of the channel is lost")
        short = sum(max(0, count - seen[channel]) for channel, count in contents.expected.items()) if complete else 0
        if short:
            self.warnings.append(f"{short} of {counted(sum(contents.expected.values()), 'message')} could not be read")

    def _conclude(self, refused: Counter[str]) -> None:
        """Add the warnings that need the whole recording."""
        for topic, count in refused.items():
            if count:
                self.warnings.append(f"{counted(count, 'message')} of {topic} left out: their layout differs")
        self.warnings.extend(self._left_out)
        if not self.complete and not self._left_out and not self._missing:
            self.warnings.append("the recording was cut short: data after the last flush is missing")
        for name in unlisted_parts(self.path, self._given):
            self.warnings.append(f"metadata.yaml does not name the part {one_line(name)}")
        if missing := self._missing:
            self.warnings.append(f"part {missing[0]} is missing" if len(missing) == 1 else
                                 f"{len(missing)} parts are missing, the first is part {missing[0]}")
        stamps = self.stamps
        if stamps.lost:
            self.warnings.append(f"{counted(stamps.lost, 'message')} of {self.joint_states_topic} missing, according "
                                 "to the stamps")
        result = self.result or {}
        for key, what in (("lost", "lost while recording"), ("unsent", "could not be sent by their publisher")):
            counts = result.get(key)
            for topic, count in list(counts.items())[:_MOST_NAMED] if isinstance(counts, dict) else ():
                if isinstance(count, int) and count > 0 and not (key == "lost" and topic == self.joint_states_topic):
                    lost = counted(min(count, _LARGEST_COUNT), "message")
                    self.warnings.append(f"{lost} of {one_line(topic)} {what}")
        again = stamps.resets + stamps.restarts
        if again:
            self.warnings.append(f"simulation time started again {counted(again, 'time')} "
                                 f"({counted(stamps.resets, 'reset')}, {counted(stamps.restarts, 'restart')}): "
                                 "these are separate runs")
        if stamps.repeated:
            self.warnings.append(f"{counted(stamps.repeated, 'repeated stamp')} left out")
        if stamps.late:
            self.warnings.append(f"{counted(stamps.late, 'message')} of {self.joint_states_topic} left out: several "
                                 "drivelines published at once, and only the latest to start is read")
        if stamps.mixed:
            raise RecordingError(f"{self.joint_states_topic}: simulation time jumps back and forth "
                                 f"{counted(stamps.returns, 'time')} between two runs; publishers are mixed and cannot "
                                 "be separated")


def open_run(path: Path | str, joints: Mapping[str, str] | None = None) -> Run:
    """Open a bag directory or an MCAP file.

    Parameters
    ----------
    joints : names of flywheel and clutch_plate in the recording, if they differ

    Raises
    ------
    RecordingError
        There is no recording, or nothing in it can be read.
    """
    path = Path(path)
    return Run(path, parts_of(path), joints)


def _of(channels: Mapping[int, Channel], here: list[int], topic: str, type_name: str) -> list[int]:
    """Return the channels of this topic and type among those with messages in a chunk."""
    return [number for number in here if number in channels
            and (channels[number].topic, channels[number].type) == (topic, type_name)]
