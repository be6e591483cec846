"""Records of a recording that describe it: scenes, topics, message counts, the recorder's result."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

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
    foreign: Counter[str] = field(default_factory=Counter)
    """Numbers of attachments and of metadata records of other programs, by kind."""
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
                self.foreign["attachment"] += 1
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
            self.foreign["metadata record"] += name != mcap_file.ROSBAG2_RECORD
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


def batches(stream: RecordStream, contents: Contents, wants: Callable[[Channel], bool], seen: Counter[int]
            ) -> Iterator[tuple[bytes, records.Messages, bool]]:
    """Iterate over the chunks with messages of wanted channels, or of channels that are not described, and over such
    messages outside chunks, joined: unpacked bytes, the positions of the messages, and whether these have a checksum.
    Damaged ones are left out with a warning.

    Schemas and channels in the chunks go into `contents`; `seen` receives the numbers of all messages by channel.
    """
    good, bad, loose, expansion = 0, 0, bytearray(), records.Expansion(contents.size)

    def wanted(channel: int) -> bool:
        return channel not in contents.channels or wants(contents.channels[channel])

    for record, indexes in _with_indexes(stream):
        counts = (records.indexed(indexes) if record.opcode == Opcode.CHUNK
                  else {int.from_bytes(record.body[:2], "little"): 1} if record.opcode == Opcode.MESSAGE else {})
        if counts and not any(map(wanted, counts)):
            seen.update(counts)
            continue
        packed = record.opcode == Opcode.CHUNK
        try:
            body = stream.read(record)
            if record.opcode == Opcode.MESSAGE:
                loose += _MESSAGE.pack(record.opcode, len(body)) + body
                if len(loose) <= _UNCHUNKED:
                    continue
            if packed:
                data = records.unpack_chunk(body, expansion)
            else:
                data, loose = bytes(loose), bytearray()
            messages = records.find_messages(data, indexes)
            for opcode, offset, length in messages.others:
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    contents.add(opcode, data[offset:offset + length], checked=True)
            numbers, inverse, found = np.unique(messages.channel, return_inverse=True, return_counts=True)
            mine = np.array(list(map(wanted, numbers.tolist())), np.bool_)[inverse]
            expansion.take(int(messages.length[mine].sum()))
            checked = packed and body[24:28] != bytes(4)
            batch = *records.uncompressed(data, messages, mine, expansion), checked
        except DamagedChunk as error:
            bad += 1
            if bad > good + MOST_DAMAGED:
                stream.warnings.append(f"nothing is read from byte {record.offset} on: {bad} chunks are damaged")
                return
            what = "chunk" if packed else "message"
            stream.warnings.place(f"the {what} at byte {record.offset} is left out: {error}")
            continue
        good += 1
        seen.update(dict(zip(numbers.tolist(), found.tolist())))
        if len(numbers):
            yield batch


def _with_indexes(stream: RecordStream) -> Iterator[tuple[McapRecord, list[bytes]]]:
    """Iterate over chunks with bytes, each with its index records, messages outside chunks, and a last empty record."""
    held: McapRecord | None = None
    indexes: list[bytes] = []
    for record in stream:
        if record.opcode == Opcode.MESSAGE_INDEX:
            indexes.append(record.body)
            continue
        if held is not None:
            yield held, indexes
        filled = record.opcode == Opcode.MESSAGE or (record.opcode == Opcode.CHUNK and record.body[16:24] != bytes(8))
        held, indexes = record if filled else None, []
    yield from [(held, indexes)] if held is not None else []
    yield McapRecord(Opcode.DATA_END, 0, 0, b""), []


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
