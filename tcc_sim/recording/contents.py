"""What the records of a recording say about it, beside the messages: scenes, topics, counts, the recorder's result."""

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
"""Channels, and types, that a recording may describe; records of more are passed over."""
_UNCHUNKED = 1 << 20
_LONGEST_RESULT = 1 << 18
_MOST_SENTENCES, _DIGITS = 20, 19
_T = TypeVar("_T")


@dataclass(frozen=True)
class Schema:
    """A message type and its definition (ros2msg)."""

    type: str
    text: str


@dataclass(frozen=True)
class Channel:
    """A topic of a recording, its message type and what else was said of it (quality of service, type hash)."""

    topic: str
    schema: Schema
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def type(self) -> str:
        """Message type."""
        return self.schema.type

    @property
    def publisher(self) -> str:
        """Who published its messages, as the middleware identifies it; empty where the recording does not say."""
        return self.metadata.get(PUBLISHER_KEY, "")


@dataclass
class Contents:
    """What the records outside the messages say, gathered as they are read."""

    scenes: list[SceneRecord] = field(default_factory=list)
    result: dict[str, Any] | None = None
    channels: dict[int, Channel] = field(default_factory=dict)
    expected: dict[int, int] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    damaged: int = 0
    """Records that describe the recording and cannot be used."""
    recovered: list[str] = field(default_factory=list)
    """What was missing when this recording was recovered from another."""

    def add(self, opcode: int, body: bytes, checked: bool = False) -> None:
        """Take in one record; a damaged one is noted. What a chunk's checksum covers outranks what stands elsewhere."""
        try:
            if opcode == Opcode.METADATA and not checked:
                self._metadata(decoded(opcode, body))
            elif opcode == Opcode.STATISTICS:
                self.expected = decoded(opcode, body).channel_message_counts
            elif opcode == Opcode.SCHEMA:
                schema = decoded(opcode, body)
                self._keep(self.schemas, schema.id, Schema(schema.name, schema.data.decode()), checked)
            elif opcode == Opcode.CHANNEL:
                channel = decoded(opcode, body)
                schema = self.schemas.get(channel.schema_id, Schema("", ""))
                self._keep(self.channels, channel.id, Channel(channel.topic, schema, channel.metadata), checked)
        except (KeyError, ValueError, RecursionError):
            self.damaged += 1

    def warnings(self) -> list[str]:
        """What is to be said of these records."""
        found = []
        if self.damaged == 1:
            found.append("a record that describes the recording is damaged and was passed over")
        elif self.damaged:
            found.append(f"{self.damaged} records that describe the recording are damaged and were passed over")
        return found + self.recovered

    @staticmethod
    def _keep(table: dict[int, _T], number: int, value: _T, checked: bool) -> None:
        """Enter a value under its number."""
        if number not in table and len(table) >= MOST_TOPICS:
            raise ValueError("too many topics")
        if checked or number not in table:
            table[number] = value

    def _metadata(self, record: Any) -> None:
        """A metadata record of this package; others are of no interest."""
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
            self.recovered = [f"missing since its recovery: {one_line(sentence)}"
                              for sentence in result[:_MOST_SENTENCES]]
            if len(result) > _MOST_SENTENCES:
                self.recovered.append(f"missing since its recovery: {len(result) - _MOST_SENTENCES} more places")
        else:
            raise ValueError(name)


def chunks(stream: Iterable[McapRecord], contents: Contents) -> Iterator[tuple[McapRecord, list[bytes]]]:
    """Chunks with their index records; everything else goes into `contents`.

    Messages outside chunks come as one record of opcode MESSAGE whose body holds many of them.
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
    """The bytes of a chunk and where its messages are; schemas and channels in it go into `contents`.

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
    """Read chunks until one more than the first with a channel of type `wanted`: where no index names the topics."""
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
    """The results of two parts of a recording: counts by topic added, all else as the later one has it."""
    if one is None or other is None:
        return one or other
    found = {**one, **other}
    for key, value in other.items():
        before = one.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            found[key] = {**before, **{topic: count + before.get(topic, 0) if isinstance(count, int) and isinstance(
                before.get(topic, 0), int) else count for topic, count in value.items()}}
    return found
