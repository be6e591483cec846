"""Reading: a bag or an MCAP file, complete, cut short or damaged, as columns in bounded memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tcc_sim.errors import RecordingError
from tcc_sim.recording import records
from tcc_sim.recording.batches import JointStates, PressureJoin, joint_states, pressures
from tcc_sim.recording.contents import Channel, Contents, chunks, first_channels, unpack
from tcc_sim.recording.records import DamagedChunk, Messages, Record, RecordStream
from tcc_sim.recording.scene_records import SceneRecord
from tcc_sim.recording.stamps import StampCount
from tcc_sim.topics import FLUID_PRESSURE, JOINT_STATE

_MOST_RESTARTS = 1000

Tap = Callable[[bytes, Messages, Mapping[int, Channel]], None]
"""Takes the bytes of an unpacked chunk, where its messages are, and the channels known so far."""


class Run:
    """A recording. Made by `open_run`; iterate over `batches()`, then ask what was missing.

    topics : message type by topic
    complete : the recording was closed properly; False where it was cut short
    result : what the recorder said at the end (lost messages by topic), None where it did not
    warnings : one sentence per damage, complete after `batches()`
    messages : messages read by topic, complete after `batches()`
    """

    def __init__(self, paths: list[Path], topic: str | None = None) -> None:
        self.paths = paths
        self.warnings: list[str] = []
        self.messages: dict[str, int] = {}
        self.stamps = StampCount()
        self.complete = True
        self.scenes: list[SceneRecord] = []
        self.result: dict[str, Any] | None = None
        self.topics: dict[str, str] = {}
        self._contents: dict[Path, Contents] = {}
        for path in paths:
            contents = self._contents[path] = Contents()
            with open_file(path) as file:
                first_channels(named(path, RecordStream(file)), contents, JOINT_STATE)
                stream = RecordStream(file, chunks=False)
                for record in named(path, stream):
                    contents.add(record.opcode, record.body)
            self.complete &= stream.complete
            self.scenes += contents.scenes
            self.result = contents.result or self.result
            self.topics.update({channel.topic: channel.type for channel in contents.channels.values()})
        self.joint_states_topic = topic or _choose(self.topics)

    @property
    def scene_text(self) -> str | None:
        """The (first) scene of the recording, YAML; None where it holds none."""
        return self.scenes[0].text if self.scenes else None

    @property
    def version(self) -> str | None:
        """The package version that recorded it."""
        return self.scenes[0].version if self.scenes else None

    @property
    def lost_messages(self) -> int:
        """joint_states messages that are missing between those read, by their stamps."""
        return self.stamps.lost

    def batches(self, tap: Tap | None = None) -> Iterator[JointStates]:
        """The joint_states in the order of the recording, about one batch per chunk; `tap` sees every chunk.

        Raises
        ------
        RecordingError
            Nothing can be read, there are no joint_states, or several publishers are mixed in them.
        """
        yield from self.read(tap)
        if not self.stamps.messages:
            raise RecordingError(f"{self.paths[0]}: no {self.joint_states_topic} can be read" +
                                 (f" ({self.warnings[0]})" if self.warnings else ""))

    def read(self, tap: Tap | None = None) -> Iterator[JointStates]:
        """As `batches`, for recordings that may hold no joint_states; `tap` sees every chunk that can be read."""
        self.warnings, self.messages, self.stamps = [], dict.fromkeys(self.topics, 0), StampCount()
        pressure = _pressure_topic(self.joint_states_topic)
        join = PressureJoin() if self.topics.get(pressure) == FLUID_PRESSURE else None
        refused: Counter[str] = Counter()
        for path in self.paths:
            for data, messages, channels in self._chunks(path):
                if tap is not None:
                    tap(data, messages, channels)
                array = np.frombuffer(data, dtype=np.uint8)
                for channel, row in channels.items():
                    if join is not None and (row.topic, row.type) == (pressure, FLUID_PRESSURE):
                        stamps, values, left_out = pressures(array, messages, channel)
                        refused[row.topic] += left_out
                        join.add_pressures(stamps, values)
                for channel, row in channels.items():
                    if (row.topic, row.type) == (self.joint_states_topic, JOINT_STATE):
                        batch, left_out = joint_states(array, messages, channel)
                        refused[row.topic] += left_out
                        for part in self._runs(batch):
                            yield from (part,) if join is None else join.add(part)
        if join is not None:
            yield from join.finish()
            if join.missing:
                self.warnings.append(f"the applied pressure is missing at {join.missing} ticks")
        self._conclude(refused)

    def _runs(self, batch: JointStates) -> Iterator[JointStates]:
        """The batch, parted where simulation time starts again, without repeated stamps."""
        first, last = self.stamps.restarts, self.stamps.last
        starts = self.stamps.add(batch.stamp_ns).tolist()
        if self.stamps.restarts > _MOST_RESTARTS:
            raise RecordingError(f"{self.joint_states_topic}: simulation time falls back more than {_MOST_RESTARTS} times; "
                                 "several publishers are mixed")
        if self.stamps.repeated and len(batch):
            batch = batch[np.diff(batch.stamp_ns,
                                  prepend=batch.stamp_ns[0] - 1 if last is None else np.int64(last)) != 0]
            starts = np.flatnonzero(np.diff(batch.stamp_ns,
                                            prepend=np.int64(-1 if last is None else last)) < 0).tolist()
        for number, (start, end) in enumerate(zip([0, *starts], [*starts, len(batch)])):
            if end > start:
                part = batch[start:end]
                yield part if not first + number else replace(part, run=first + number)

    def _chunks(self, path: Path) -> Iterator[tuple[bytes, Messages, dict[int, Channel]]]:
        """Unpacked chunks of one file with their messages; damaged ones are passed over with a warning."""
        known = self._contents[path]
        contents = Contents(channels=dict(known.channels), schemas=dict(known.schemas))
        seen, unchecked = Counter[int](), False
        with open_file(path) as file:
            stream = RecordStream(file, warnings=self.warnings)
            for chunk, indexes in chunks(named(path, stream), contents):
                try:
                    data, messages = unpack(chunk, indexes, contents)
                except DamagedChunk as error:
                    self.warnings.append(f"the chunk at byte {chunk.offset} is left out: {error}")
                    continue
                unchecked = unchecked or chunk.opcode == records.MESSAGE or not records.has_checksum(chunk.body)
                counts = np.bincount(messages.channel)
                seen.update({channel: int(counts[channel]) for channel in np.flatnonzero(counts).tolist()})
                yield data, messages, contents.channels
            complete = stream.complete
        for channel, row in contents.channels.items():
            self.messages[row.topic] = self.messages.get(row.topic, 0) + seen[channel]
        self.warnings.extend(contents.damaged + contents.recovered)
        if unchecked:
            self.warnings.append("some messages carry no checksum: damage in them would go unnoticed")
        if (nameless := set(seen) - set(contents.channels)):
            self.warnings.append(f"{sum(seen[c] for c in nameless)} messages belong to channels whose description is lost")
        short = sum(max(0, count - seen[channel]) for channel, count in contents.expected.items()) if complete else 0
        if short:
            self.warnings.append(f"{short} of {sum(contents.expected.values())} messages could not be read")

    def _conclude(self, refused: Counter[str]) -> None:
        """Add the warnings that only the whole recording allows."""
        for topic, count in refused.items():
            if count:
                self.warnings.append(f"{count} messages of {topic} have another layout and were left out")
        if not self.complete:
            self.warnings.append("the recording was cut short: what came after the last flush is missing")
        if self.stamps.lost:
            self.warnings.append(f"{self.stamps.lost} messages of {self.joint_states_topic} are missing, by their stamps")
        lost = self.result.get("lost") if isinstance(self.result, dict) else None
        for topic, count in lost.items() if isinstance(lost, dict) else ():
            if isinstance(count, int) and count > 0 and topic != self.joint_states_topic:
                self.warnings.append(f"{count} messages of {topic} were lost while recording")
        if self.stamps.restarts:
            self.warnings.append(f"simulation time started again {self.stamps.restarts} times: these are separate runs")
        if self.stamps.repeated:
            self.warnings.append(f"{self.stamps.repeated} repeated stamps were left out")


def open_run(path: Path | str, topic: str | None = None) -> Run:
    """Open a bag directory or an MCAP file.

    Parameters
    ----------
    topic : the joint_states topic to read where a recording has several; the only one, or the shortest, by default

    Raises
    ------
    RecordingError
        No recording there, or nothing in it can be read.
    """
    path = Path(path)
    paths = sorted(path.glob("*.mcap"), key=_number) if path.is_dir() else [path]
    if not paths:
        raise RecordingError(f"{path} holds no .mcap file")
    return Run(paths, topic)


def _number(path: Path) -> tuple[int, str]:
    """Sort key: the number that rosbag2 puts last in the name of a split bag."""
    digits = path.stem.rpartition("_")[2]
    return (int(digits) if digits.isdecimal() and digits.isascii() and len(digits) < 19 else 0, path.name)


def open_file(path: Path) -> BinaryIO:
    """Open for reading."""
    try:
        return path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def named(path: Path, stream: RecordStream) -> Iterator[Record]:
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


def _pressure_topic(joint_states_topic: str) -> str:
    """The applied pressure beside this joint_states topic."""
    return joint_states_topic.rpartition("/")[0] + "/applied_pressure"
