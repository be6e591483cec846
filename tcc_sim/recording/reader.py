"""Reading: a bag or an MCAP file, complete, cut short or damaged, as columns in bounded memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from tcc_sim.errors import RecordingError, counted, one_line
from tcc_sim.messages import cdr
from tcc_sim.recording.announcements import SceneRecord
from tcc_sim.recording.batches import JointStates, PressureJoin, joint_states, layout_of, merged_batches, pressures
from tcc_sim.recording.contents import Channel, Contents, chunks, first_channels, together, unpack
from tcc_sim.recording.records import DamagedChunk, Expansion, McapRecord, Messages, RecordStream, Warnings
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.topics import FLUID_PRESSURE, JOINT_NAMES, JOINT_STATE

_MOST_NAMED, _LARGEST_COUNT, _MOST_PARTS = 50, 10**18, 100_000

Tap = Callable[[bytes, Messages, Mapping[int, Channel]], None]
"""Takes the bytes of an unpacked chunk, where its messages are, and the channels known so far."""


class Run:
    """A recording of one or several files. Made by `open_run`; iterate over `batches()`, then ask what was missing.

    topics : message type by topic
    complete : the recording was closed properly; False where it was cut short
    result : what the recorder said at the end (lost messages by topic), of all files together; None where it did not
    warnings : one sentence per damage, complete after `batches()`
    messages : messages read by topic, complete after `batches()`
    size : bytes of all files
    """

    def __init__(self, path: Path, paths: list[Path], topic: str | None, joints: Mapping[str, str] | None) -> None:
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
                self.complete &= _number(name) is None
        if not self._contents:
            raise RecordingError(self._left_out[0].removeprefix("left out: "))
        self.paths = list(self._contents)
        self.scenes = list(dict.fromkeys(self.scenes))  # Each part of a split recording says its scene again.
        self.joint_states_topic = topic or _choose(self.topics)
        self._joints = tuple((joints or {}).get(name, name) for name in JOINT_NAMES)
        self._layout: cdr.Layout | None = None

    def _open(self, path: Path) -> None:
        """Read what a file says of itself."""
        contents = Contents()
        with open_file(path) as file:
            size = file.seek(0, 2)
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
        """The (first) scene of the recording, YAML; None where it holds none."""
        return self.scenes[0].text if self.scenes else None

    @property
    def lost_messages(self) -> int:
        """joint_states messages that are missing between those read, by their stamps."""
        return self.stamps.lost

    def batches(self, tap: Tap | None = None) -> Iterator[JointStates]:
        """The joint_states in the order of the recording, about one batch per chunk; `tap` sees every chunk.

        Raises
        ------
        RecordingError
            Nothing can be read, there are no joint_states, or several publishers are mixed in them with nothing to tell
            them apart.
        """
        count = 0
        for batch in self.read(tap):
            yield replace(batch, index=count)
            count += len(batch)
        if not self.stamps.messages:
            raise RecordingError(f"{self.paths[0]}: no {self.joint_states_topic} can be read" +
                                 (f" ({self.warnings[0]})" if self.warnings else ""))

    def longest(self) -> JointStates:
        """All states of the run that has most of them; errors are those of `batches`."""
        runs: dict[int, list[JointStates]] = {}
        for batch in self.batches():
            runs.setdefault(batch.run, []).append(batch)
        return merged_batches(max(runs.values(), key=lambda batches: sum(map(len, batches))))

    def read(self, tap: Tap | None = None) -> Iterator[JointStates]:
        """As `batches`, for recordings that may hold no joint_states; `tap` sees every chunk that can be read."""
        self.warnings, self.messages, self.stamps = Warnings(), dict.fromkeys(self.topics, 0), StampCounter()
        self._began = Break.START
        pressure = self.joint_states_topic.rpartition("/")[0] + "/applied_pressure"
        join = PressureJoin() if self.topics.get(pressure) == FLUID_PRESSURE else None
        refused: Counter[str] = Counter()
        for path in self.paths:
            for data, messages, channels in self._chunks(path):
                if tap is not None:
                    tap(data, messages, channels)
                array = np.frombuffer(data, dtype=np.uint8)
                here = np.flatnonzero(np.bincount(messages.channel)).tolist() if len(messages.channel) else []
                if join is not None and (found := _of(channels, here, pressure, FLUID_PRESSURE)):
                    stamps, values, heads, left_out = pressures(array, messages, found)
                    refused[pressure] += left_out
                    join.add_pressures(stamps, values, self._publisher(heads, channels), heads["number"])
                if found := _of(channels, here, self.joint_states_topic, JOINT_STATE):
                    self._layout = self._layout or layout_of(data, messages, found, self._joints)
                    batch, heads, left_out = joint_states(array, messages, found, self._layout)
                    refused[self.joint_states_topic] += left_out
                    for part in self._runs(batch, self._publisher(heads, channels), heads["number"]):
                        yield from (part,) if join is None else join.add(part)
        if join is not None:
            yield from join.finish()
            if join.missing:
                self.warnings.append(f"the applied pressure is missing at {counted(join.missing, 'tick')}")
        self._conclude(refused)

    def _publisher(self, heads: NDArray[np.void], channels: Mapping[int, Channel]) -> NDArray[np.int64]:
        """A number for whoever published each message; 0 where the recording does not say."""
        numbers, place = np.unique(heads["channel"], return_inverse=True)
        known = [self._publishers.setdefault(channels[channel].publisher, len(self._publishers))
                 for channel in numbers.tolist()]
        return np.array(known, dtype=np.int64)[place]

    def _runs(self, batch: JointStates, publisher: NDArray[np.int64],
              numbers: NDArray[np.int64]) -> Iterator[JointStates]:
        """The batch, parted where simulation time starts again, without repeated stamps and what came too late."""
        run, kept = self.stamps.runs - 1, np.zeros(len(batch), dtype=np.bool_)
        starts = [0]
        began = [self._began]
        for piece, preceded in self.stamps.pieces(batch.stamp_ns, publisher, numbers):
            kept[piece] = True
            if preceded.begins_a_run:
                starts.append(piece.start)
                began.append(preceded)
        self._began = began[-1]
        for number, (start, end) in enumerate(zip(starts, [*starts[1:], len(batch)])):
            if kept[start:end].any():
                part = batch[start:end] if kept[start:end].all() else batch[start:end][kept[start:end]]
                yield replace(part, run=run + number, began=began[number])

    def _chunks(self, path: Path) -> Iterator[tuple[bytes, Messages, dict[int, Channel]]]:
        """Unpacked chunks of one file with their messages; damaged ones are passed over with a warning."""
        known = self._contents[path]
        contents = Contents(channels=dict(known.channels), schemas=dict(known.schemas))
        seen, unchecked = Counter[int](), False
        with open_file(path) as file:
            stream, expansion = RecordStream(file, warnings=self.warnings), Expansion(file.seek(0, 2))
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
            self.warnings.append("some messages carry no checksum: damage in them would go unnoticed")
        if (nameless := set(seen) - set(contents.channels)):
            count = sum(seen[channel] for channel in nameless)
            self.warnings.append(f"{counted(count, 'message')} of channels whose description is lost left out")
        short = sum(max(0, count - seen[channel]) for channel, count in contents.expected.items()) if complete else 0
        if short:
            self.warnings.append(f"{short} of {counted(sum(contents.expected.values()), 'message')} could not be read")

    def _conclude(self, refused: Counter[str]) -> None:
        """Add the warnings that only the whole recording allows."""
        for topic, count in refused.items():
            if count:
                self.warnings.append(f"{counted(count, 'message')} of {topic} with another layout left out")
        self.warnings.extend(self._left_out)
        if not self.complete and not self._left_out:
            self.warnings.append("the recording was cut short: what came after the last flush is missing")
        if missing := _missing_parts(self._given):
            self.warnings.append(f"part {missing[0]} is missing" if len(missing) == 1 else
                                 f"{len(missing)} parts are missing, the first is part {missing[0]}")
        stamps = self.stamps
        if stamps.lost:
            self.warnings.append(f"{counted(stamps.lost, 'message')} of {self.joint_states_topic} missing "
                                 "by the stamps")
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
            self.warnings.append(f"{counted(stamps.late, 'message')} of {self.joint_states_topic} left out: from "
                                 "a publisher that another one had taken over from; several drivelines ran at once")
        if stamps.mixed:
            raise RecordingError(f"{self.joint_states_topic}: simulation time jumps back and forth "
                                 f"{counted(stamps.returns, 'time')} between two runs; several publishers are mixed, "
                                 "and nothing tells them apart")


def open_run(path: Path | str, topic: str | None = None, joints: Mapping[str, str] | None = None) -> Run:
    """Open a bag directory or an MCAP file.

    Parameters
    ----------
    topic : the joint_states topic to read where a recording has several; the only one, or the shortest, by default
    joints : names that flywheel and clutch_plate have in the recording, where they have others

    Raises
    ------
    RecordingError
        No recording there, or nothing in it can be read.
    """
    path = Path(path)
    paths = [path]
    if path.is_dir():
        paths = sorted(path.glob("*.mcap"), key=lambda part: (_number(part) or 0, part.name))
    if path.suffix == ".db3" or (not paths and any(path.glob("*.db3"))):
        bag = path.parent if path.suffix == ".db3" else path
        raise RecordingError(f"{bag} is a bag in SQLite, which is not read; rosbags-convert --src {bag} --dst "
                             f"{bag}_mcap --dst-storage mcap (from pip install rosbags) makes one that is")
    if not paths:
        raise RecordingError(f"{path} holds no .mcap file")
    return Run(path, paths, topic, joints)


def _number(path: Path) -> int | None:
    """The number that rosbag2 puts last in the name of a part of a bag, None where there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() and digits.isascii() and len(digits) < 19 else None


def _missing_parts(paths: list[Path]) -> list[int]:
    """Numbers that are left out between those of the parts of a split recording, and before the first."""
    numbers = {_number(path) or 0 for path in paths}
    return [n for n in range(min(max(numbers), _MOST_PARTS)) if n not in numbers] if len(paths) > 1 else []


def _of(channels: Mapping[int, Channel], here: list[int], topic: str, type_name: str) -> list[int]:
    """Which of the channels that a chunk has messages of are of this topic and type."""
    return [number for number in here if number in channels
            and (channels[number].topic, channels[number].type) == (topic, type_name)]


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; a pipe would keep its reader waiting."""
    try:
        if path.exists() and not path.is_file():
            raise RecordingError(f"{path} is not a regular file")
        return path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def records_of(path: Path, stream: RecordStream) -> Iterator[McapRecord]:
    """The stream's records; errors name the file."""
    try:
        yield from stream
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def _choose(topics: dict[str, str]) -> str:
    """The joint_states topic: of that type, if possible of that name, the shortest of several."""
    found = [name for name, type_name in topics.items() if type_name == JOINT_STATE]
    named_so = [name for name in found if name.rpartition("/")[2] == "joint_states"]
    return min(named_so or found or ["/joint_states"], key=lambda name: (len(name), name))
