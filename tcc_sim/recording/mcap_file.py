"""Write one MCAP file, and the metadata.yaml of a bag of such files."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

from mcap.writer import CompressionType, Writer

from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError, RecordingError
from tcc_sim.messages.definitions import Definition, definition
from tcc_sim.parameter_file import LARGEST_FILE, dumped

SCENE_RECORD = "tcc_sim"
RESULT_RECORD = "tcc_sim_result"
RECOVERY_RECORD = "tcc_sim_recovery"
ROSBAG2_RECORD = "rosbag2"
PUBLISHER_KEY = "publisher"
"""Key in a channel's metadata: identifier of the publisher in the middleware (hexadecimal digits)."""
ROW_KEY = "tcc_sim_topic"
"""Key in a channel's metadata: name of the topic in `topics.TOPICS`, whatever it was remapped to."""
MOST_CHUNKS = 200_000
"""Largest number of chunks in a file; each takes 0.6 kB of memory until the index is written."""
_CHUNK_SIZE = 1 << 20
_METADATA_VERSION = 9

RELIABLE: tuple[Mapping[str, Any], ...] = ({
    "history": "keep_last", "depth": 100, "reliability": "reliable", "durability": "volatile",
    "deadline": {"sec": 9223372036, "nsec": 854775807}, "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic", "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False},)
"""The quality of service that the driveline offers, as rosbag2 writes it."""


def digest(*texts: str) -> str:
    """Return the SHA-256 of texts: MCAP has checksums of chunks but not of metadata records, which hold the scene."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


class _Output:
    """A new unbuffered file: after an error such as a full disk, no buffered data remains that could fail again."""

    def __init__(self, name: Path | str, folder: int | None) -> None:
        self.file = FileIO(name, "xb", opener=partial(os.open, mode=0o666, dir_fd=folder))
        self.flush, self.tell = self.file.flush, self.file.tell
        self.size = 0  # A call of `tell` for each message would take a tenth of the time of writing.

    def write(self, data: bytes) -> int:
        """Write all of `data`."""
        left = memoryview(data)
        while left:
            left = left[self.file.write(left):]
        self.size += len(data)
        return len(data)


class TopicMetadata(NamedTuple):
    """An announced channel: the arguments of `McapFile.channel`."""

    name: str
    type: str
    profiles: Sequence[Mapping[str, Any]]
    definition: Definition
    publisher: str
    row: str


class McapFile:
    """Writer of a new MCAP file of profile ros2; chunks are compressed with zstd and have a checksum. RecordingError if
    it exists or cannot be created.

    Parameters
    ----------
    scene_text, version : the scene (YAML), and the code version that runs it (default: this one)
    folder : descriptor of the directory of `path`, which stays valid if the directory is renamed
    """

    def __init__(self, path: Path, scene_text: str | None = None, version: str = "",
                 folder: int | None = None) -> None:
        self._name, self._folder = path if folder is None else path.name, folder
        try:
            self._output = _Output(self._name, folder)
        except FileExistsError:
            raise RecordingError(f"{path} exists already and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{path} cannot be written: {error.strerror}") from None
        self.path, self.summary = path, FileSummary(path.name)
        self.chunks = 0
        self._waiting = 0
        self._schemas: dict[tuple[str, str], int] = {}
        self._writer = Writer(self._output, chunk_size=_CHUNK_SIZE, compression=CompressionType.ZSTD)
        self._add_message = self._writer.add_message
        try:
            self._writer.start(profile="ros2", library=f"tcc_sim {code_version()}")
            if scene_text is not None:
                self.describe(scene_text, version)
        except BaseException:
            self.remove()
            raise

    def describe(self, scene_text: str, version: str = "", log_ns: int = 0) -> None:
        """Record the scene (YAML) that the following messages come from; each start of a driveline records one;
        InputError if the text is longer than a scene may be.
        """
        if len(scene_text) > LARGEST_FILE:
            raise InputError(f"the scene has {len(scene_text)} characters; it must have at most {LARGEST_FILE}")
        version = version or code_version()
        self.metadata(SCENE_RECORD, {"version": version, "scene": scene_text, "log_time": str(log_ns),
                                     "sha256": digest(version, scene_text, str(log_ns))})

    def note(self, name: str, result: Mapping[str, Any] | Sequence[str]) -> None:
        """Write a metadata record of plain values (JSON) with its digest."""
        text = json.dumps(result)
        self.metadata(name, {"result": text, "sha256": digest(text)})

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record at once, outside any chunk."""
        self._writer.add_metadata(name, values)

    def channel(self, topic: str, type_name: str, qos: Sequence[Mapping[str, Any]] = RELIABLE,
                schema: Definition | None = None, publisher: str = "", row: str = "") -> int:
        """Announce a topic (fully resolved name), optionally of one publisher, and return its channel; InputError if
        the type's definition is neither given as `schema` nor available.

        `row` is the topic's name in `topics.TOPICS`, which says what the topic is if it was remapped.
        """
        schema = schema or definition(type_name)
        key = (type_name, schema.text)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(type_name, "ros2msg", schema.text.encode())
        profiles = [dict(profile) for profile in qos]
        metadata = {"offered_qos_profiles": dumped(profiles) if profiles else "", "topic_type_hash": schema.type_hash}
        if publisher:
            metadata[PUBLISHER_KEY] = publisher
        if row:
            metadata[ROW_KEY] = row
        channel: int = self._writer.register_channel(topic, "cdr", self._schemas[key], metadata)
        self.summary.topics[channel] = TopicMetadata(topic, type_name, profiles, schema, publisher, row)
        self.summary.counts[channel] = 0
        return channel

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add one serialised message with its times of receipt and sending (ns) and its publisher's sequence number."""
        self._add_message(channel, log_ns, data, publish_ns, sequence & 0xFFFFFFFF)
        summary = self.summary
        summary.counts[channel] += 1
        self._waiting += len(data) + 31
        if self._waiting > _CHUNK_SIZE:
            self.chunks, self._waiting = self.chunks + 1, 0
        if log_ns < summary.first_ns:
            summary.first_ns = log_ns
        if log_ns > summary.last_ns:
            summary.last_ns = log_ns

    @property
    def size(self) -> int:
        """Number of bytes written to the operating system."""
        return self._output.size

    def flush(self) -> None:
        """Write all data so far to the operating system, so that a kill loses only later data."""
        self._writer.flush()
        self.chunks, self._waiting = self.chunks + (self._waiting > 0), 0

    def sync(self) -> None:
        """Wait until all data so far is on the disk, so that a power cut loses only later data."""
        self.flush()
        os.fsync(self._output.file.fileno())

    def close(self, result: Mapping[str, Any] | None = None, sync: bool = False) -> None:
        """Write the result record, index and footer, without any ROS call."""
        self._writer.flush()
        if result is not None:
            self.note(RESULT_RECORD, result)
        self.metadata(ROSBAG2_RECORD, {"serialized_metadata": dumped(information([self.summary]))})
        self._writer.finish()
        if sync:
            os.fsync(self._output.file.fileno())
        self.abandon()

    def abandon(self) -> None:
        """Close the file without an index; it is readable up to the last flush."""
        self._output.file.close()

    def remove(self) -> None:
        """Close and delete the file."""
        self.abandon()
        os.unlink(self._name, dir_fd=self._folder)

    def linked(self) -> bool:
        """Return whether the file still has a name."""
        return os.fstat(self._output.file.fileno()).st_nlink > 0


@dataclass
class FileSummary:
    """Data of one file for metadata.yaml: name, times of the first and the last message (ns), topics and message counts
    by channel.
    """

    name: str
    first_ns: int = (1 << 63) - 1
    last_ns: int = 0
    topics: dict[int, TopicMetadata] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


def _times(files: Sequence[FileSummary]) -> dict[str, dict[str, int]]:
    """Return the common start and duration of files, ignoring files without messages."""
    filled = [file for file in files if file.count]
    first = min((file.first_ns for file in filled), default=(1 << 63) - 1)
    last = max((file.last_ns for file in filled), default=first)
    return {"duration": {"nanoseconds": last - first}, "starting_time": {"nanoseconds_since_epoch": first}}


def information(files: Sequence[FileSummary]) -> dict[str, Any]:
    """Return the content of metadata.yaml for a bag of these files (rosbag2_bagfile_information, version 9)."""
    topics, counts = dict[tuple[str, str], TopicMetadata](), Counter[tuple[str, str]]()
    for file in files:
        for channel, topic in file.topics.items():
            topics.setdefault((topic.name, topic.type), topic)
            counts[topic.name, topic.type] += file.counts[channel]
    return {
        "version": _METADATA_VERSION, "storage_identifier": "mcap", **_times(files),
        "message_count": sum(file.count for file in files),
        "topics_with_message_count": [{"topic_metadata": {
            "name": topic.name, "type": topic.type, "serialization_format": "cdr",
            "offered_qos_profiles": topic.profiles,
            "type_description_hash": topic.definition.type_hash}, "message_count": counts[key]}
            for key, topic in topics.items()],
        "compression_format": "", "compression_mode": "", "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **_times([file]), "message_count": file.count} for file in files],
        "custom_data": None, "ros_distro": os.environ.get("ROS_DISTRO", "")}
