"""Records of a recording that describe it: scenes, topics, message counts, the recorder's result."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

from mcap.opcode import Opcode

from tcc_sim.errors import one_line
from tcc_sim.parameter_file import LARGEST_FILE
from tcc_sim.recording import records
from tcc_sim.recording.announcements import SceneRecord
from tcc_sim.recording.mcap_file import PUBLISHER_KEY, RECOVERY_RECORD, RESULT_RECORD, SCENE_RECORD, digest
from tcc_sim.recording.records import DamagedChunk, McapRecord, decoded

MOST_TOPICS = 4096
"""Largest number of channels, and of types, that a recording may describe; further records are ignored."""
_UNCHUNKED = 1 << 20
_LONGEST_RESULT = 1 << 18
_MOST_SENTENCES, _DIGITS = 20, 19
_T = TypeVar("_T")


@dataclass(frozen=True)
class Channel:
    """A topic of a recording: message type, its definition (ros2msg), and metadata (quality of service, type hash)."""

    topic: str
    type: str
    definition: str
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def publisher(self) -> str:
        """Identifier of the publisher in the middleware; empty if it was not recorded."""
        return self.metadata.get(PUBLISHER_KEY, "")


@dataclass
class Contents:
    """Content of the records that describe a recording, collected while it is read."""

    scenes: list[SceneRecord] = field(default_factory=list)
    result: dict[str, Any] | None = None
    channels: dict[int, Channel] = field(default_factory=dict)
    expected: dict[int, int] = field(default_factory=dict)
    schemas: dict[int, tuple[str, str]] = field(default_factory=dict)
    damaged: int = 0
    """Number of damaged records among them."""
    recovered: list[str] = field(default_factory=list)
    """Losses that were recorded when this recording was recovered from another."""

    def add(self, opcode: int, body: bytes, checked: bool = False) -> None:
        """Take one record and count it if it is damaged. Records under a chunk's checksum (`checked`) take precedence.
        """
        try:
            if opcode == Opcode.METADATA and not checked:
                self._metadata(decoded(opcode, body))
            elif opcode == Opcode.STATISTICS:
                self.expected = decoded(opcode, body).channel_message_counts
            elif opcode == Opcode.SCHEMA:
                schema = decoded(opcode, body)
                self._keep(self.schemas, schema.id, (schema.name, schema.data.decode()), checked)
            elif opcode == Opcode.CHANNEL:
                channel = decoded(opcode, body)
                schema = self.schemas.get(channel.schema_id, ("", ""))
                self._keep(self.channels, channel.id, Channel(channel.topic, *schema, channel.metadata), checked)
        except (KeyError, ValueError, RecursionError):
            self.damaged += 1

    def warnings(self) -> list[str]:
        """Return the warnings about these records."""
        found = []
        if self.damaged == 1:
            found.append("a record that describes the recording is damaged and was ignored")
        elif self.damaged:
            found.append(f"{self.damaged} records that describe the recording are damaged and were ignored")
        return found + self.recovered

    @staticmethod
    def _keep(table: dict[int, _T], number: int, value: _T, checked: bool) -> None:
        """Store a value under its number."""
        if number not in table and len(table) >= MOST_TOPICS:
            raise ValueError("too many topics")
        if checked or number not in table:
            table[number] = value

    def _metadata(self, record: Any) -> None:
        """Take a metadata record of this package; ignore others."""
        name, values = record.name, record.metadata
        if name not in (SCENE_RECORD, RESULT_RECORD, RECOVERY_RECORD):
            return
        if name == SCENE_RECORD:
            version, scene, log_time = values["version"], values["scene"], values["log_time"]
            if (len(scene) > LARGEST_FILE or len(log_time) > _DIGITS
                    or values["sha256"] != digest(version, scene, log_time)):
                raise ValueError(name)
            self.scenes.append(SceneRecord(scene, version, int(log_time)))
            return
        if values["sha256"] != digest(values["result"]) or len(values["result"]) > _LONGEST_RESULT:
            raise ValueError(name)
        result = json.loads(values["result"])
        if name == RESULT_RECORD and isinstance(result, dict):
            self.result = result
        elif name == RECOVERY_RECORD and isinstance(result, list) and all(isinstance(one, str) for one in result):
            self.recovered = [f"missing before the recovery: {one_line(sentence)}"
                              for sentence in result[:_MOST_SENTENCES]]
            if len(result) > _MOST_SENTENCES:
                more = len(result) - _MOST_SENTENCES
                self.recovered.append(f"missing before the recovery: {more} more places")
        else:
            raise ValueError(name)


def chunks(stream: Iterable[McapRecord], contents: Contents) -> Iterator[tuple[McapRecord, list[bytes]]]:
    """Iterate over chunks with their index records; put all other records into `contents`.

    Messages outside chunks are joined into records of opcode MESSAGE whose bodies hold many messages.
    """
    chunk: McapRecord | None = None
    indexes: list[bytes] = []
    loose = bytearray()
    for record in stream:
        if record.opcode == Opcode.MESSAGE_INDEX:
            indexes.append(record.body)
            continue
        if chunk is not None:
            yield chunk, indexes
            chunk, indexes = None, []
        if record.opcode == Opcode.CHUNK:
            chunk = record
        elif record.opcode == Opcode.MESSAGE:
            loose += struct.pack("<BQ", record.opcode, len(record.body)) + record.body
            if len(loose) > _UNCHUNKED:
                yield McapRecord(Opcode.MESSAGE, record.offset, bytes(loose)), []
                loose.clear()
        else:
            contents.add(record.opcode, record.body)
    if chunk is not None:
        yield chunk, indexes
    if loose:
        yield McapRecord(Opcode.MESSAGE, 0, bytes(loose)), []


def unpack(chunk: McapRecord, indexes: list[bytes], contents: Contents,
           expansion: records.Expansion) -> tuple[bytes, records.Messages]:
    """Return the bytes of a chunk and the positions of its messages; put its schemas and channels into `contents`.

    Raises
    ------
    DamagedChunk
        The chunk cannot be used.
    """
    data = chunk.body if chunk.opcode == Opcode.MESSAGE else records.unpack_chunk(chunk.body, expansion)
    messages = records.find_messages(data, indexes)
    for opcode, offset, length in messages.others:
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            contents.add(opcode, data[offset:offset + length], checked=True)
    return data, messages


def first_channels(stream: Iterable[McapRecord], contents: Contents, wanted: str, expansion: records.Expansion) -> None:
    """Read chunks up to the one after the first that has a channel of type `wanted`, for files without an index."""
    enough = False
    for chunk, indexes in chunks(stream, Contents()):
        try:
            unpack(chunk, indexes, contents, expansion)
        except DamagedChunk:
            continue
        if enough:
            return
        enough = any(channel.type == wanted for channel in contents.channels.values())


def together(one: dict[str, Any] | None, other: dict[str, Any] | None) -> dict[str, Any] | None:
    """Merge the results of two parts of a recording: add counts by topic; take all else from the later part."""
    if one is None or other is None:
        return one or other
    found = {**one, **other}
    for key, value in other.items():
        before = one.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            found[key] = {**before, **{topic: count + before.get(topic, 0) if isinstance(count, int) and isinstance(
                before.get(topic, 0), int) else count for topic, count in value.items()}}
    return found
