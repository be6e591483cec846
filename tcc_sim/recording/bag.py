"""Writing: a rosbag2 bag (directory with one MCAP file and metadata.yaml), or one MCAP file by itself."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from tcc_sim import __version__
from tcc_sim.errors import RecordingError
from tcc_sim.messages.definitions import Definition, definition

SCENE_RECORD = "tcc_sim"
RESULT_RECORD = "tcc_sim_result"
RECOVERY_RECORD = "tcc_sim_recovery"
_CHUNK_SIZE = 1 << 20
_METADATA_VERSION = 9

RELIABLE: tuple[Mapping[str, Any], ...] = ({
    "history": "keep_last", "depth": 100, "reliability": "reliable", "durability": "volatile",
    "deadline": {"sec": 9223372036, "nsec": 854775807}, "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic", "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False},)
"""The quality of service that the driveline offers, as rosbag2 writes it."""


def digest(*texts: str) -> str:
    """SHA-256 of texts: MCAP checks its chunks but not its metadata records, which hold the scene."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


class _Output:
    """A new file, unbuffered, so that after a full disk nothing is left that could fail again."""

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, "xb")
        self._position = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`."""
        left = memoryview(data)
        while left:
            count = self._file.write(left)
            self._position += count
            left = left[count:]
        return len(data)

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Everything is with the operating system already."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class McapFile:
    """One MCAP file of profile ros2 that must not exist yet; chunks are compressed with zstd and carry a checksum.

    Raises
    ------
    RecordingError
        The file exists or cannot be created.
    """

    def __init__(self, path: Path, scene_text: str | None = None, version: str = __version__) -> None:
        try:
            self._output = _Output(path)
        except FileExistsError:
            raise RecordingError(f"{path} exists already and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{path} cannot be written: {error.strerror}") from None
        self.path = path
        self.scenes: list[str] = []
        self.counts: dict[int, int] = {}
        self.first_ns = (1 << 63) - 1
        self.last_ns = 0
        self._schemas: dict[tuple[str, str], int] = {}
        self._topics: dict[int, dict[str, Any]] = {}
        self._writer = Writer(self._output, chunk_size=_CHUNK_SIZE, compression=CompressionType.ZSTD)
        self._add_message = self._writer.add_message
        self._writer.start(profile="ros2", library=f"tcc_sim {__version__}")
        if scene_text is not None:
            self.describe(scene_text, version)

    def describe(self, scene_text: str, version: str = __version__, log_ns: int = 0) -> None:
        """Say which scene (YAML) the messages from here on come from; every driveline that is started writes one."""
        self.scenes.append(scene_text)
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
                schema: Definition | None = None) -> int:
        """Announce a topic (fully resolved name) and get its channel.

        Raises
        ------
        InputError
            The type has no definition here and none was given.
        """
        found = schema or definition(type_name)
        key = (type_name, found.text)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(type_name, "ros2msg", found.text.encode())
        profiles = [dict(profile) for profile in qos]
        channel: int = self._writer.register_channel(topic, "cdr", self._schemas[key], {
            "offered_qos_profiles": yaml.safe_dump(profiles, sort_keys=False) if profiles else "",
            "topic_type_hash": found.type_hash})
        self.counts[channel] = 0
        self._topics[channel] = {"name": topic, "type": type_name, "serialization_format": "cdr",
                                 "offered_qos_profiles": profiles, "type_description_hash": found.type_hash}
        return channel

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0) -> None:
        """Add one serialised message: when it was received and sent, and its number at the publisher."""
        self._add_message(channel, log_ns, data, publish_ns, sequence & 0xFFFFFFFF)
        self.counts[channel] += 1
        if log_ns < self.first_ns:
            self.first_ns = log_ns
        if log_ns > self.last_ns:
            self.last_ns = log_ns

    def flush(self) -> None:
        """Hand everything written so far to the operating system: a kill loses only what comes later."""
        self._writer.flush()

    def close(self, result: Mapping[str, Any] | None = None) -> None:
        """Write the result record, index and footer. No ROS call is needed."""
        self._writer.flush()
        if result is not None:
            self.note(RESULT_RECORD, result)
        self.metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(self.information(), sort_keys=False)})
        self._writer.finish()
        self._output.close()

    def abandon(self) -> None:
        """Close the file as it is, readable up to the last flush."""
        self._output.close()

    def information(self) -> dict[str, Any]:
        """What metadata.yaml says (rosbag2_bagfile_information, version 9)."""
        count = sum(self.counts.values())
        start = {"nanoseconds_since_epoch": self.first_ns}
        duration = {"nanoseconds": max(0, self.last_ns - self.first_ns) if count else 0}
        return {
            "version": _METADATA_VERSION, "storage_identifier": "mcap", "duration": duration, "starting_time": start,
            "message_count": count,
            "topics_with_message_count": [{"topic_metadata": self._topics[channel],
                                           "message_count": self.counts[channel]}
                                          for channel in self.counts],
            "compression_format": "", "compression_mode": "", "relative_file_paths": [self.path.name],
            "files": [{"path": self.path.name, "starting_time": start, "duration": duration, "message_count": count}],
            "custom_data": None, "ros_distro": os.environ.get("ROS_DISTRO", "")}


class BagWriter(McapFile):
    """A rosbag2 bag: a new directory NAME with NAME_0.mcap and, when it is closed, metadata.yaml.

    Raises
    ------
    RecordingError
        The directory exists or cannot be created.
    """

    def __init__(self, directory: Path, scene_text: str | None = None, version: str = __version__) -> None:
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            raise RecordingError(f"{directory} exists already and is not overwritten") from None
        except OSError as error:
            raise RecordingError(f"{directory} cannot be created: {error.strerror}") from None
        self.directory = directory
        super().__init__(directory / f"{directory.resolve().name}_0.mcap", scene_text, version)

    def close(self, result: Mapping[str, Any] | None = None) -> None:
        """Close the MCAP file and write metadata.yaml, which appears whole or not at all."""
        super().close(result)
        draft = self.directory / "metadata.yaml.part"
        draft.write_text(yaml.safe_dump({"rosbag2_bagfile_information": self.information()}, sort_keys=False),
                         encoding="utf-8")
        draft.replace(self.directory / "metadata.yaml")
