"""Records of a recording that describe it: scenes, topics, message counts, the recorder's result."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from mcap.opcode import Opcode

from tcc_sim.errors import counted, one_line
from tcc_sim.parameter_file import LARGEST_FILE
from tcc_sim.recording import mcap_file, records
from tcc_sim.recording.announcements import SceneRecord
from tcc_sim.recording.records import DECODERS, DamagedChunk, McapRecord, RecordStream, decoded
from tcc_sim.topics import HEADER, TOPICS

MOST_DAMAGED = 10_000
"""Number of damaged records that describe a file, after which the others are only counted; and number of damaged chunks
beyond that of whole ones, after which no more are unpacked.
"""
MOST_TOPICS = 4096
"""Largest number of channels, and of types, that a recording may describe; further records are ignored."""
CDR = "cdr"
_TYPES_OF_TOPICS = {row.name.rpartition("/")[2]: row.type for row in TOPICS} | {"input_source": HEADER}
_UNCHUNKED = 1 << 20
_LONGEST_RESULT = 1 << 18
_MOST_SENTENCES, _DIGITS = 20, 19
_MESSAGE = struct.Struct("<BQ")
_T = TypeVar("_T")


@dataclass(frozen=True)
class Channel:
    """A topic of a recording: message type, its definition (ros2msg), and metadata (quality of service, type hash).

    `encoding` is that of the messages; only `cdr` is read.
    """

    topic: str
    type: str
    definition: str
    metadata: dict[str, str] = field(default_factory=dict)
    encoding: str = CDR

    @property
    def row(self) -> str:
        """Name of the topic in `topics.TOPICS`, whatever it was remapped to; the topic's last name if it is unknown."""
        return self.metadata.get(mcap_file.ROW_KEY) or self.topic.rpartition("/")[2]

    @property
    def publisher(self) -> str:
        """Identifier of the publisher in the middleware; empty if it was not recorded."""
        return self.metadata.get(mcap_file.PUBLISHER_KEY, "")


def _channel(record: Any, schema: tuple[str, str]) -> Channel:
    """Return the channel of a record: the topic with its leading slash, and the type with its folder, `msg`. Without a
    schema, the topic's last name gives the type.
    """
    topic = "/" + record.topic.removeprefix("/")
    kind, text = schema
    package, _, name = kind.partition("/")
    if record.message_encoding in ("", CDR):
        if name and "/" not in name:
            kind = f"{package}/msg/{name}"
        kind = kind or _TYPES_OF_TOPICS.get(topic.rpartition("/")[2], "")
    return Channel(topic, kind, text, record.metadata, record.message_encoding or CDR)


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
    attachments: int = 0
    foreign: int = 0
    """Number of metadata records of other programs."""
    passed_over: int = 0
    """Number of records after MOST_DAMAGED damaged ones."""
    complete: bool = False
    """Whether the footer was reached."""
    size: int = 0
    """Bytes of the file."""

    def add(self, opcode: int, body: bytes, checked: bool = False) -> None:
        """Take one record and count it if it is damaged. Records under a chunk's checksum (`checked`) take precedence.
        """
        if self.damaged >= MOST_DAMAGED and opcode not in (Opcode.CHUNK, Opcode.MESSAGE):
            self.passed_over += opcode in DECODERS
            return
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
                self._keep(self.channels, channel.id, _channel(channel, schema), checked)
            elif opcode == Opcode.ATTACHMENT:
                self.attachments += 1
        except (KeyError, ValueError, RecursionError, struct.error):
            self.damaged += 1

    def warnings(self) -> list[str]:
        """Return the warnings about these records."""
        warnings = []
        if self.damaged == 1:
            warnings.append("a record that describes the recording is damaged and was ignored")
        elif self.damaged:
            warnings.append(f"{self.damaged} records that describe the recording are damaged and were ignored")
        if self.passed_over:
            warnings.append(f"after them {counted(self.passed_over, 'more record')} that may describe the recording "
                            f"{'was' if self.passed_over == 1 else 'were'} not read")
        return warnings + self.recovered

    @staticmethod
    def _keep(table: dict[int, _T], number: int, value: _T, checked: bool) -> None:
        if number not in table and len(table) >= MOST_TOPICS:
            raise ValueError("too many topics")
        if checked or number not in table:
            table[number] = value

    def _metadata(self, record: Any) -> None:
        """Take a metadata record of this package; ignore others."""
        name, values = record.name, record.metadata
        if name not in (mcap_file.SCENE_RECORD, mcap_file.RESULT_RECORD, mcap_file.RECOVERY_RECORD):
            self.foreign += name != mcap_file.ROSBAG2_RECORD
            return
        if name == mcap_file.SCENE_RECORD:
            version, scene, log_time = values["version"], values["scene"], values["log_time"]
            if (len(scene) > LARGEST_FILE or len(log_time) > _DIGITS
                    or values["sha256"] != mcap_file.digest(version, scene, log_time)):
                raise ValueError(name)
            self.scenes.append(SceneRecord(scene, version, int(log_time)))
            return
        if values["sha256"] != mcap_file.digest(values["result"]) or len(values["result"]) > _LONGEST_RESULT:
            raise ValueError(name)
        result = json.loads(values["result"])
        if name == mcap_file.RESULT_RECORD and isinstance(result, dict):
            self.result = result
        elif name == mcap_file.RECOVERY_RECORD and isinstance(result, list) and all(
                isinstance(one, str) for one in result):
            self.recovered = [f"missing before the recovery: {one_line(sentence)}"
                              for sentence in result[:_MOST_SENTENCES]]
            if len(result) > _MOST_SENTENCES:
                more = len(result) - _MOST_SENTENCES
                self.recovered.append(f"missing before the recovery: {more} more places")
        else:
            raise ValueError(name)


Skip = Callable[[Iterable[int]], bool]
"""Function of the channels of a chunk: whether no message of them is wanted."""


class Packed(NamedTuple):
    """A chunk with its index records; or messages outside chunks, joined into one (`loose`)."""

    record: McapRecord
    indexes: list[bytes]
    loose: bytes | None = None


def chunks(stream: RecordStream, skip: Skip, skipped: Counter[int]) -> Iterator[Packed]:
    """Iterate over the chunks of which some messages are wanted; `skipped` counts those in others by channel."""
    chunk: McapRecord | None = None
    indexes: list[bytes] = []
    loose = bytearray()

    def ended() -> Iterator[Packed]:
        counts = records.indexed(indexes)
        if chunk is not None and counts and skip(counts):
            skipped.update(counts)
        elif chunk is not None:
            yield Packed(chunk, indexes)

    for record in stream:
        if record.opcode == Opcode.MESSAGE_INDEX:
            indexes.append(record.body)
            continue
        yield from ended()
        chunk, indexes = None, []
        if record.opcode == Opcode.CHUNK and record.body[16:24] != bytes(8):  # It has bytes.
            chunk = record
        elif record.opcode == Opcode.MESSAGE:
            if skip([channel := int.from_bytes(record.body[:2], "little")]):
                skipped[channel] += 1
                continue
            try:
                body = stream.read(record)
            except DamagedChunk as error:
                stream.warnings.place(f"the message at byte {record.offset} is left out: {error}")
                continue
            loose += _MESSAGE.pack(record.opcode, len(body)) + body
            if len(loose) > _UNCHUNKED:
                yield Packed(record, [], bytes(loose))
                loose.clear()
    yield from ended()
    if loose:
        yield Packed(McapRecord(Opcode.MESSAGE, 0, 0, b""), [], bytes(loose))


class Batch(NamedTuple):
    """Messages of a chunk: its unpacked bytes, the positions of the messages, whether they have a checksum, and the
    numbers of all messages of the chunk by channel.
    """

    data: bytes
    messages: records.Messages
    checked: bool
    counts: dict[int, int]


def unpack(stream: RecordStream, packed: Packed, contents: Contents, expansion: records.Expansion, skip: Skip) -> Batch:
    """Return the messages of a chunk; put its schemas and channels into `contents`; DamagedChunk if it cannot be used.
    """
    checked = packed.loose is None
    if packed.loose is not None:
        data = packed.loose
    else:
        body = stream.read(packed.record)
        checked = body[24:28] != bytes(4)
        data = records.unpack_chunk(body, expansion)
    messages = records.find_messages(data, packed.indexes)
    for opcode, offset, length in messages.others:
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            contents.add(opcode, data[offset:offset + length], checked=True)
    numbers, inverse, counts = np.unique(messages.channel, return_inverse=True, return_counts=True)
    mine = np.array([not skip([number]) for number in numbers.tolist()], np.bool_)[inverse]
    expansion.take(int(messages.length[mine].sum()))
    data, messages = records.uncompressed(data, messages, mine, expansion)
    return Batch(data, messages, checked, dict(zip(numbers.tolist(), counts.tolist())))


def together(one: dict[str, Any] | None, other: dict[str, Any] | None) -> dict[str, Any] | None:
    """Merge the results of two parts of a recording: add counts by topic; take all else from the later part."""
    if one is None or other is None:
        return one or other
    joined = {**one, **other}
    for key, value in other.items():
        before = one.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            joined[key] = {**before, **{topic: count + before.get(topic, 0) if isinstance(count, int) and isinstance(
                before.get(topic, 0), int) else count for topic, count in value.items()}}
    return joined
