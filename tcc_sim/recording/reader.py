"""Read a bag or an MCAP file, complete, truncated or damaged, into columns."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from tcc_sim import topics
from tcc_sim.errors import InputError, RecordingError, counted, one_line
from tcc_sim.recording.announcements import SceneRecord, zeros_of
from tcc_sim.recording.columns import Columns, GrowingStates, JoinedTopic, JointStates, joined_topics, joint_states
from tcc_sim.recording.commands import COMMANDS, DIAGNOSTICS, TARGET, Commands, signal_types
from tcc_sim.recording.contents import CDR, Batch, Channel, Contents, chunks, together, unpack
from tcc_sim.recording.drivelines import Choice, Inventory, RecordedDriveline, joints_sentence, same_process
from tcc_sim.recording.layouts import Layouts
from tcc_sim.recording.parts import (
    Parts,
    in_order,
    missing_parts,
    named_as_part,
    open_file,
    parts_of,
    records_of,
    unpacked_file,
)
from tcc_sim.recording.records import DamagedChunk, Expansion, Messages, RecordStream, Warnings, joined, with_places
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.recording.window import Window
from tcc_sim.topics import JOINT_STATE, LIMITS

ReadChunk = tuple[bytes, Messages, Mapping[int, Channel]]
_READ = ("applied_pressure", "output_state", "input_source", "held", LIMITS)
_TOPICS_OF_DRIVELINE = {"applied_pressure", "output_state", "input_source", "held", DIAGNOSTICS.removeprefix("/")}
"""Topics that the driveline itself publishes."""
_MOST_TOPICS = 20
BYTES_A_STATE = 110
"""Memory for one state and its derived quantities, bytes."""
_MOST_NAMED, _LARGEST_COUNT = 50, 10**18
_SAME_CLOCK = 1000
"""Largest variation of the difference of log time and stamp, ns, with which log times are simulation time."""
_SORTED = 20_000
"""Number of messages in a batch that is sorted by log time."""
_CALLED_BY_MESSAGE = 150
"""Bytes of memory for a message that waits to be sorted, in addition to its own."""

Tap = Callable[[bytes, Messages, Mapping[int, Channel]], None]
"""Function of the bytes of an unpacked chunk, the positions of its messages, and the channels described so far."""


class TooManyStates(InputError):
    """A recording needs more memory than is allowed."""


class Run:
    """A recording of one or several files, opened by `open_run`.

    topics : message type by topic
    drivelines : its drivelines, and other nodes with joint states
    complete : whether the recording was closed properly; False if it was cut short
    result : the recorder's final record (lost messages by topic), merged over all files; None without one
    warnings : one sentence for each damage, complete after `states()`
    messages : number of messages read by topic, complete after `states()`
    size : size of all files, bytes
    """

    def __init__(self, path: Path, parts: Parts, choice: Choice) -> None:
        self.path = path
        self.warnings = Warnings()
        self.messages: dict[str, int] = {}
        self.stamps = StampCounter()
        self.complete = True
        self.recorded_scenes: list[SceneRecord] = []
        self.result: dict[str, Any] | None = None
        self.topics: dict[str, str] = {}
        self.size = 0
        self._unpacked: dict[Path, BinaryIO] = {}
        self._contents: dict[Path, Contents] = {}
        self._publishers: dict[str, int] = {"": 0}
        self._left_out = list(parts.sentences())
        self._incomplete = False
        self.complete &= not parts.absent
        unreadable: list[str] = []
        for name in parts.paths:
            try:
                self._open(name)
            except RecordingError as error:
                if len(parts.paths) == 1:
                    raise
                unreadable.append(f"left out: {error}")
        self._left_out += unreadable
        if not self._contents:
            raise RecordingError(unreadable[0].removeprefix("left out: "))
        missing = [] if parts.ordered else missing_parts(parts.paths)
        if missing:
            self._left_out.append(f"part {missing[0]} is missing" if len(missing) == 1 else
                                  f"{len(missing)} parts are missing, the first is part {missing[0]}")
        self.parts_missing = bool(missing or parts.absent)
        """Whether a part of the recording is not there."""
        self.complete &= not missing and not any(parts.ordered or named_as_part(part) for part in parts.paths
                                                 if part not in self._contents)
        self.paths = list(self._contents)
        if not parts.ordered:
            self.paths = in_order(self.paths, [self._contents[name].first_ns for name in self.paths])
        for name in self.paths:
            contents = self._contents[name]
            self.recorded_scenes += contents.scenes
            self.result = together(self.result, contents.result)
        self.recorded_scenes = list(dict.fromkeys(self.recorded_scenes))  # Each part of a split recording repeats it.
        self._choice = choice
        inventory = self._inventory()
        self.drivelines = inventory.drivelines(self.recorded_scenes, choice)
        self._driveline = next((one for one in self.drivelines if one.read), None)
        self._refused = inventory.refused(self.joint_states_topic)

    def _open(self, path: Path) -> None:
        """Read the records that describe a file."""
        contents = Contents()
        with self._opened(path) as file:
            size = file.seek(0, os.SEEK_END)
            stream = RecordStream(file, indexes=False)
            for record in records_of(path, stream):
                contents.add(record.opcode, record.body)
        self._contents[path] = contents
        self.size += size
        self._incomplete |= not stream.complete
        self.complete &= stream.complete

    @contextmanager
    def _opened(self, path: Path) -> Iterator[BinaryIO]:
        """Open a file; one that is compressed is unpacked once."""
        if path in self._unpacked:
            yield self._unpacked[path]
            return
        with open_file(path) as file:
            unpacked = unpacked_file(path, file)
            if unpacked is None:
                yield file
        if unpacked is not None:
            finalize(self, unpacked.close)
            self._unpacked[path] = unpacked
            yield unpacked

    def _inventory(self) -> Inventory:
        """Read what tells the drivelines apart."""
        inventory = Inventory(self._choice.names)
        kept, self.warnings = self.warnings, Warnings()
        for path in self.paths:
            for batch, channels in self._batches(path, inventory.wants):
                inventory.take(batch, channels)
                self.topics.update({channel.topic: channel.type for channel in channels.values()})
            self.topics.update({channel.topic: channel.type for channel in self._contents[path].channels.values()})
        self._damage, self.warnings = next(iter(self.warnings), ""), kept
        return inventory

    @property
    def driveline(self) -> RecordedDriveline:
        """The driveline to read.

        Raises
        ------
        RecordingError
            The recording holds none.
        """
        if self._driveline is not None:
            return self._driveline
        if self.drivelines:
            raise RecordingError(joints_sentence(self.drivelines))
        damage = f" ({self._damage})" if self._damage else ""
        channels = [channel for contents in self._contents.values() for channel in contents.channels.values()]
        for channel in channels:
            if channel.type.replace("/msg/", "/") == "sensor_msgs/JointState" and channel.encoding != CDR:
                how = "; rosbags-convert converts a bag of ROS 1" if channel.encoding == "ros1" else ""
                raise RecordingError(f"{self.paths[0]}: the messages of {one_line(channel.topic)} are in the encoding "
                                     f"{one_line(channel.encoding)}; only {CDR}, that of ROS 2, is read{how}")
        states = min((name for name, kind in self.topics.items() if kind == JOINT_STATE),
                     key=lambda name: (name.rpartition("/")[2] != "joint_states", len(name), name), default="")
        if states or not self.topics or damage:
            raise RecordingError(f"{self.paths[0]}: no {states or '/joint_states'} can be read{damage}")
        topics = [f"{name} ({kind or 'of unknown type'})" for name, kind in sorted(self.topics.items())]
        more = f" and {len(topics) - _MOST_TOPICS} more" if len(topics) > _MOST_TOPICS else ""
        raise RecordingError(f"{self.paths[0]} holds no {JOINT_STATE}, so no driveline; its topics are "
                             f"{', '.join(topics[:_MOST_TOPICS])}{more}")

    @property
    def joint_states_topic(self) -> str:
        """Topic of the driveline's joint_states."""
        return self._driveline.topic if self._driveline is not None else "/joint_states"

    @property
    def scenes(self) -> list[SceneRecord]:
        """Scenes of the driveline; without a driveline all recorded scenes."""
        return list(self._driveline.scenes) if self._driveline is not None else self.recorded_scenes

    @property
    def scene_text(self) -> str | None:
        """The (first) scene of the driveline, YAML; None if it has no scene."""
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

        Messages are read in the order of the file. If simulation time goes back there together with the log time,
        blocks or parts of the file overlap or are out of order, and the order of log times is taken if simulation time
        goes back less often in it.

        Raises
        ------
        RecordingError
            Nothing can be read, there are no joint_states, or publishers are mixed and cannot be separated.
        TooManyStates
            The states would need more than half of the machine's memory.
        """
        topic = self.driveline.topic
        columns = self._read(window, self._in_file_order)
        if self._set_back:
            back, repeated = self._backwards, self.stamps.repeated
            real = self._clock[1] - self._clock[0] > _SAME_CLOCK
            columns = self._read(window, self._in_log_order)
            too_large = not self.stamps.messages
            # Where log times are simulation time, those of a reset are the same again.
            if too_large or self._backwards >= back or (self.stamps.repeated > repeated and not real):
                columns = self._read(window, self._in_file_order)
            if too_large:
                self.warnings.append("the blocks of the recording are out of order, and it is too large to sort them "
                                     "by log time")
        self._conclude()
        if not self.stamps.messages:
            raise RecordingError(f"{self.paths[0]}: no {topic} can be read" +
                                 (f" ({self.warnings[0]})" if self.warnings else ""))
        if self.stamps.repeated == self.stamps.messages - 1 > 0:
            raise RecordingError(f"all {self.stamps.messages} stamps of {topic} are "
                                 f"{int(columns.runs[0].stamp_ns[0]) * 1e-9:g} s: its publisher does not set them, and "
                                 "without times nothing can be analysed")
        if self.stamps.mixed:
            raise RecordingError(f"{topic}: simulation time jumps back and forth "
                                 f"{counted(self.stamps.returns, 'time')} between two runs; publishers are mixed and "
                                 "cannot be separated")
        return columns

    @property
    def _backwards(self) -> int:
        """Number of times that simulation time goes back."""
        return self.stamps.resets + self.stamps.restarts

    def tapped(self, tap: Tap) -> None:
        """Call a function with every readable chunk of all files, in their order."""
        self.warnings, self.messages = Warnings(), dict.fromkeys(self.topics, 0)
        for path in self.paths:
            for batch, channels in self._batches(path, lambda _: True):
                tap(batch.data, batch.messages, channels)
        self.warnings.extend(self._left_out)
        self._warn_of_cut()
        for what in ("attachments", "foreign"):
            if count := sum(getattr(contents, what) for contents in self._contents.values()):
                kind = "attachment" if what == "attachments" else "metadata record"
                self.warnings.append(f"{counted(count, kind)} of other programs not copied")

    def _read(self, window: Window | None, order: Callable[[], Iterator[ReadChunk]]) -> Columns:
        """Read the driveline's messages in an order."""
        self.warnings, self.messages, self.stamps = Warnings(), dict.fromkeys(self.topics, 0), StampCounter()
        self._began, self._last, self._set_back, self._clock = Break.START, (0, 0), False, (1 << 63, -1 << 63)
        topic, publishers = self.driveline.topic, set(self.driveline.publishers)
        if window is None:
            self._check_memory(self.driveline.states)
        self._comparable = any(one.publisher and one.topic != topic and same_process(one.publisher, publishers)
                               for one in self._every_channel())
        types = {(channel.topic, channel.type) for channel in self._every_channel() if self._ours(channel)}
        zeros = zeros_of(scene.text for scene in self.scenes)
        every = [one for one in joined_topics(topic, zeros) if (one.topic, one.type) in types]
        layouts = Layouts(JOINT_STATE, self._choice.names, topics.topic("joint_states").fields, zeros)
        states, commands = GrowingStates(), Commands(topic, zeros)
        place = self._untimed = 0
        for data, messages, channels in order():
            if (numbered := with_places(data, messages, place)) is not None:
                data, self._untimed = numbered, self._untimed + len(messages.channel)
            place += len(messages.channel)
            ours = {number: channel for number, channel in channels.items() if self._ours(channel)}
            array, before = np.frombuffer(data, dtype=np.uint8), states.count
            here = np.flatnonzero(np.bincount(messages.channel)).tolist() if len(messages.channel) else []
            begun = np.empty(0, np.int64)
            if mine := [number for number in _of(ours, here, topic, JOINT_STATE)
                        if channels[number].publisher in publishers]:
                values = layouts.take(array, messages, mine)
                batch = joint_states(values)
                for part in self._runs(batch, self._publisher(values.heads, channels), values.heads):
                    rows = window.rows(part) if window is not None else slice(0, len(part))
                    if rows.stop > rows.start:
                        states.add(part[rows])
                begun = values.rows[self._starts]
                self._check_memory(states.count)
            for one in every:
                if mine := _of(ours, here, one.topic, one.type):
                    first = int(np.isin(messages.channel, mine).argmax())
                    one.take(array, messages, mine, self.stamps.runs - int(np.count_nonzero(begun > first)),
                             partial(self._publisher, channels=channels))
            commands.take(data, messages, ours, before, states.count)
        runs, missing = states.runs(every)
        if missing:
            self.warnings.append(f"the applied pressure is missing at {counted(missing, 'tick')}")
        self._pass_over(every)
        if 2 * self._untimed > place:
            self.warnings.append("no time of receipt or sending was recorded (all are 0): a command belongs to the "
                                 "next state in the file")
        aligned = commands.aligned(runs)
        if commands.coarse and not self._untimed:
            self.warnings.append("times of receipt are coarse: commands stand where their times of sending alone put "
                                 "them")
        given = {name: values for name, values in aligned.items() if name in COMMANDS}
        further = {name: values for name, values in aligned.items() if name not in COMMANDS}
        return Columns(runs, given, further, commands.sources,
                       {name: len(who) for name, who in commands.publishers.items()}, commands.counts,
                       commands.limits)

    def _every_channel(self) -> Iterator[Channel]:
        """Iterate over the channels of all files."""
        for contents in self._contents.values():
            yield from contents.channels.values()

    def _ours(self, channel: Channel) -> bool:
        """Return whether a channel belongs to the driveline: commands by anyone; other topics by its own process, if
        their publishers are known.
        """
        name, publishers = channel.topic.rpartition("/")[2], self.driveline.publishers
        published = {row.name for row in topics.shown() if row.direction == "out"}
        if name not in _TOPICS_OF_DRIVELINE | published or channel.topic == self.driveline.topic:
            return True
        return not self._comparable or same_process(channel.publisher, publishers)

    def _in_file_order(self) -> Iterator[ReadChunk]:
        """Iterate over the driveline's messages as they stand in the files."""
        wants = self._wants()
        for path in self.paths:
            for batch, channels in self._batches(path, wants):
                yield batch.data, batch.messages, channels

    def _in_log_order(self) -> Iterator[ReadChunk]:
        """Iterate over the driveline's messages of all files in the order of their log times; over none if they would
        take more than a quarter of the machine's memory.
        """
        bodies, numbers, logs = list[bytes](), list[int](), list[int]()
        channels: dict[int, Channel] = {}
        known: dict[tuple[str, str, str], int] = {}
        wants, memory, taken = self._wants(), _memory() // 4, 0
        for path in self.paths:
            for batch, channels_of in self._batches(path, wants):
                for offset, length, number in zip(*(column.tolist() for column in batch.messages[:3])):
                    if number not in channels_of or not wants(channels_of[number]):
                        continue
                    key = channels_of[number].topic, channels_of[number].type, channels_of[number].publisher
                    channel = known.setdefault(key, len(known) + 1)
                    channels[channel] = channels_of[number]
                    body = batch.data[offset:offset + length]
                    bodies.append(channel.to_bytes(2, "little") + body[2:])
                    numbers.append(channel)
                    logs.append(int.from_bytes(body[6:14], "little"))
                    taken += length + _CALLED_BY_MESSAGE
                if taken > memory:
                    return
        order = np.argsort(np.array(logs, np.uint64), kind="stable").tolist()
        for begin in range(0, len(order), _SORTED):
            which = order[begin:begin + _SORTED]
            yield *joined([bodies[k] for k in which], np.array([numbers[k] for k in which], np.uint16)), channels

    def _wants(self) -> Callable[[Channel], bool]:
        """Return a function that tells whether messages of a channel are needed for the columns."""
        space = self.driveline.topic.rpartition("/")[0]
        names = {self.driveline.topic, DIAGNOSTICS, *(f"{space}/{name}" for name in (*_READ, *signal_types()))}
        return lambda channel: channel.topic in names

    def _check_memory(self, count: int) -> None:
        """Raise TooManyStates if `count` states need more than half of the machine's memory."""
        memory = _memory()
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

    def _runs(self, batch: JointStates, publisher: NDArray[np.int64], heads: NDArray[np.void]) -> Iterator[JointStates]:
        """Split a batch where simulation time starts again; leave out repeated stamps and late messages."""
        run, kept = self.stamps.runs - 1, np.zeros(len(batch), dtype=np.bool_)
        starts = [0]
        began = [self._began]
        logs, sent = (heads[name].astype(np.int64) for name in ("log_ns", "sent_ns"))
        sent = np.where(sent > 0, sent, logs)
        if len(logs):
            ahead = logs - batch.stamp_ns
            self._clock = min(self._clock[0], int(ahead.min())), max(self._clock[1], int(ahead.max()))
        for piece, preceded in self.stamps.pieces(batch.stamp_ns, publisher, heads["number"]):
            kept[piece] = True
            if preceded.begins_a_run:
                starts.append(piece.start)
                began.append(preceded)
                k = piece.start
                before = (logs[k - 1], sent[k - 1]) if k else self._last
                self._set_back |= bool(logs[k] < before[0] and sent[k] < before[1])
        self._began, self._starts = began[-1], starts[1:]
        self._last = (int(logs[-1]), int(sent[-1])) if len(logs) else self._last
        for number, (start, end) in enumerate(zip(starts, [*starts[1:], len(batch)])):
            if kept[start:end].any():
                part = batch[start:end] if kept[start:end].all() else batch[start:end][kept[start:end]]
                yield replace(part, run=run + number, began=began[number])

    def _batches(self, path: Path, wants: Callable[[Channel], bool]) -> Iterator[tuple[Batch, dict[int, Channel]]]:
        """Iterate over the chunks of one file with wanted messages; skip damaged ones with a warning."""
        known = self._contents[path]
        contents = Contents(channels=dict(known.channels), schemas=dict(known.schemas))
        seen, unchecked = Counter[int](), False

        def skip(channels: Iterable[int]) -> bool:
            return all(number in contents.channels and not wants(contents.channels[number]) for number in channels)

        with self._opened(path) as file:
            stream, expansion = RecordStream(file, warnings=self.warnings), Expansion(file.seek(0, os.SEEK_END))
            for packed in chunks(stream, records_of(path, stream), contents, skip, seen):
                try:
                    batch = unpack(stream, packed, contents, expansion, skip)
                except DamagedChunk as error:
                    self.warnings.place(f"the chunk at byte {packed.record.offset} is left out: {error}")
                    continue
                if len(batch.messages.channel):
                    unchecked = unchecked or not batch.checked
                    seen.update(batch.counts)
                    yield batch, contents.channels
        known.channels = {**contents.channels, **known.channels}
        for channel, row in contents.channels.items():
            self.messages[row.topic] = self.messages.get(row.topic, 0) + seen[channel]
        self.warnings.conclude()
        self.warnings.extend(contents.warnings())
        if unchecked:
            self.warnings.append("some messages have no checksum: damage in them would go unnoticed")
        if nameless := set(seen) - set(contents.channels):
            count = sum(seen[channel] for channel in nameless)
            self.warnings.append(f"{counted(count, 'message')} left out: the description of the channel is lost")
        short = (sum(max(0, count - seen[channel]) for channel, count in contents.expected.items())
                 if stream.complete else 0)
        if short:
            self.warnings.append(f"{short} of {counted(sum(contents.expected.values()), 'message')} could not be read")

    def _pass_over(self, every: Sequence[JoinedTopic]) -> None:
        """Add warnings for messages and drivelines that were passed over."""
        topic = self.driveline.topic
        for name, refused in ((topic, self._refused), *((one.topic, one.layouts.refused) for one in every)):
            if refused:
                self.warnings.append(f"{counted(refused, 'message')} of {name} left out: their layout differs")
        others = [(number, one) for number, one in enumerate(self.drivelines) if not one.read]
        for number, one in others[:_MOST_TOPICS]:
            how = f"; --driveline {number} reads it" if one.able else ""
            self.warnings.append(f"not read: {one.sentence()}{how}")
        if len(others) > _MOST_TOPICS:
            self.warnings.append(f"not read: {len(others) - _MOST_TOPICS} more publishers of joint states")

    def _warn_of_cut(self) -> None:
        """Add the warning of a recording that was cut short."""
        if self._incomplete:
            self.warnings.append("the recording was cut short: data after the last flush is missing")

    def _conclude(self) -> None:
        """Add the warnings that need the whole recording."""
        self.warnings.extend(self._left_out)
        self._warn_of_cut()
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
        if again := self._backwards:
            self.warnings.append(f"simulation time started again {counted(again, 'time')} "
                                 f"({counted(stamps.resets, 'reset')}, {counted(stamps.restarts, 'restart')}): "
                                 "these are separate runs")
        if stamps.repeated:
            self.warnings.append(f"{counted(stamps.repeated, 'repeated stamp')} left out")
        if stamps.late:
            self.warnings.append(f"{counted(stamps.late, 'message')} of {self.joint_states_topic} left out: their "
                                 "publisher had ended and another had begun")


def open_run(path: Path | str, joints: Mapping[str, str] | None = None, topic: str | None = None,
             driveline: int | None = None) -> Run:
    """Open a bag directory or an MCAP file.

    Parameters
    ----------
    joints, topic, driveline : see `Choice`

    Raises
    ------
    RecordingError
        There is no recording, or nothing in it can be read.
    InputError
        The driveline does not exist.
    """
    path = Path(path)
    return Run(path, parts_of(path), Choice(joints, topic, driveline))


def _memory() -> int:
    """Return the memory of the machine, bytes."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _of(channels: Mapping[int, Channel], here: list[int], topic: str, type_name: str) -> list[int]:
    """Return the channels of this topic and type among those with messages in a chunk."""
    return [number for number in here if number in channels
            and (channels[number].topic, channels[number].type) == (topic, type_name)]
