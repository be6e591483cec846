"""Read the records of an MCAP file so that damage affects only the damaged part; the mcap package decodes the fields.

Layout (MCAP 0): magic, then records of one opcode byte, eight length bytes and a body; messages sit in compressed
chunks, each followed by one index record per channel.
"""

from __future__ import annotations

import io
import struct
import zlib
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema, Statistics
from numpy.typing import NDArray

from tcc_sim.errors import counted

MAGIC = b"\x89MCAP0\r\n"
DECODERS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk,
                            Opcode.STATISTICS: Statistics, Opcode.METADATA: Metadata}
LARGEST_CHUNK = 256 << 20
"""Largest size of a chunk, packed or unpacked, and of a message outside chunks, bytes."""
LARGEST_EXPANSION = 100
"""Largest ratio of the messages that are used to the file, in addition to SMALLEST_EXPANSION; real ratios are 3 to 20.
"""
SMALLEST_EXPANSION = 16 << 20
"""Bytes of messages that any file may have."""
PASSED_OVER = 10
"""Ratio of the limit of everything that is unpacked, such as images beside the messages, to that of the messages."""
MOST_DESCRIPTIONS = 20_000
"""Largest number of records in a chunk that are not messages; a recorder writes two for each topic."""
MOST_SENTENCES = 20
"""Largest number of damaged places that are listed one by one."""
HEAD = np.dtype([("channel", "<u2"), ("number", "<u4"), ("log_ns", "<i8"), ("sent_ns", "<i8")])
MESSAGE_HEAD = HEAD.itemsize
"""Bytes of a message record before the message: channel, sequence number, times of receipt and sending."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of data compressed with zstd; a serialised message starts with 0."""
_LARGEST_RECORD, _HEAD_SIZE = 16 << 20, 24
_SMALLEST = {Opcode.MESSAGE: MESSAGE_HEAD, Opcode.CHUNK: 40}
"""Least lengths of records with messages, bytes."""
_DESCRIBING = frozenset({*DECODERS, Opcode.MESSAGE_INDEX} - {Opcode.CHUNK})
_RECORD = struct.Struct("<BQ")
_CHANNEL = struct.Struct("<H")
_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2")])


class DamagedChunk(Exception):
    """Chunk that cannot be used; the message gives the reason."""


class Warnings(list[str]):
    """One sentence for each damage; only the first MOST_SENTENCES damaged places are listed, the others counted."""

    def __init__(self) -> None:
        super().__init__()
        self._places = 0

    def place(self, sentence: str) -> None:
        """Add a damaged place."""
        self._places += 1
        if self._places <= MOST_SENTENCES:
            self.append(sentence)

    def conclude(self) -> None:
        """Add the number of places that were not listed."""
        if self._places > MOST_SENTENCES:
            self.append(f"{counted(self._places - MOST_SENTENCES, 'more place')} damaged")
            self._places = 0


class Expansion:
    """Bytes to which the chunks of a file may still unpack, and bytes of messages that may still be used."""

    def __init__(self, file_size: int) -> None:
        self.limit = SMALLEST_EXPANSION + LARGEST_EXPANSION * file_size
        self._left = {True: self.limit, False: PASSED_OVER * self.limit}

    def take(self, count: int, used: bool = True) -> None:
        """Subtract `count` bytes, of messages that are used or of everything unpacked; DamagedChunk if fewer are left.
        """
        if count > self._left[used]:
            limit = self.limit if used else PASSED_OVER * self.limit
            raise DamagedChunk(f"with it the recording would unpack to more than {limit} bytes, the most allowed "
                               "for a file of its size")
        self._left[used] -= count


class McapRecord(NamedTuple):
    """One record of a file: opcode, offset, length of its body, and the body; of a message or chunk only its head, of
    other records that are skipped nothing.
    """

    opcode: int
    offset: int
    length: int
    body: bytes


@dataclass
class RecordStream:
    """Iterator over the records of an open MCAP file, in order. Records of unknown opcodes are skipped by their length,
    as MCAP prescribes.

    complete : whether the footer was reached
    warnings : one sentence for each damaged part
    """

    file: BinaryIO
    complete: bool = False
    warnings: Warnings = field(default_factory=Warnings)

    def __iter__(self) -> Iterator[McapRecord]:
        position, size = len(MAGIC), self.file.seek(0, 2)
        while position + _RECORD.size <= size:
            self.file.seek(position)
            opcode, length = _RECORD.unpack(self.file.read(_RECORD.size))
            head, end = b"", position + _RECORD.size + length
            if not opcode or length > size or (end > size and opcode > Opcode.DATA_END):
                self.warnings.append(f"nothing can be read from byte {position} on")
                return
            if end > size:
                return
            if opcode in _SMALLEST:
                head = self.file.read(min(length, _HEAD_SIZE))
                if length < _SMALLEST[opcode]:
                    kind = "chunk" if opcode == Opcode.CHUNK else "message"
                    self.warnings.place(f"the {kind} at byte {position} is left out: its fields do not fit into it")
                    position = end
                    continue
            elif opcode in _DESCRIBING and length <= _LARGEST_RECORD:
                head = self.file.read(length)
            elif opcode in _DESCRIBING:
                self.warnings.place(f"the record at byte {position} is left out: it has {length} bytes; at most "
                                    f"{_LARGEST_RECORD} are accepted")
            yield McapRecord(opcode, position, length, head)
            if opcode == Opcode.FOOTER:
                self.file.seek(end)
                self.complete = self.file.read(len(MAGIC)) == MAGIC
                return
            position = end

    def read(self, record: McapRecord) -> bytes:
        """Return the whole body of a chunk or message; DamagedChunk if it is too large, or the disk fails."""
        if record.length > LARGEST_CHUNK:
            raise DamagedChunk(f"it has {record.length} bytes; at most {LARGEST_CHUNK} are accepted")
        try:
            self.file.seek(record.offset + _RECORD.size)
            return self.file.read(record.length)
        except OSError as error:
            raise DamagedChunk(f"it cannot be read: {error.strerror}") from None


def decoded(opcode: int, body: bytes) -> Any:
    """Decode the fields of a record of one of DECODERS; ValueError if the fields do not fit into the record."""
    try:
        return DECODERS[opcode].read(ReadDataStream(io.BytesIO(body)))
    except (McapError, struct.error, OverflowError):
        raise ValueError("its fields do not fit into it") from None


def unpack_chunk(body: bytes, expansion: Expansion) -> bytes:
    """Unpack the records of a chunk and verify its checksum; `expansion` bounds the unpacked size; DamagedChunk if
    lengths disagree, the size exceeds the limit, or compression or checksum is wrong.
    """
    try:
        chunk = decoded(Opcode.CHUNK, body)
    except ValueError as error:
        raise DamagedChunk(str(error)) from None
    unpacked, checksum = chunk.uncompressed_size, chunk.uncompressed_crc
    if unpacked > LARGEST_CHUNK:
        raise DamagedChunk(f"it claims {unpacked} bytes; at most {LARGEST_CHUNK} are accepted")
    expansion.take(unpacked, used=False)
    try:
        data = _unpack(chunk.compression, chunk.data, unpacked)
    except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError) as error:
        raise DamagedChunk(f"it does not unpack ({error})") from None
    if len(data) != unpacked:
        raise DamagedChunk(f"it unpacks to {len(data)} bytes instead of {unpacked}")
    if checksum and zlib.crc32(data) != checksum:
        raise DamagedChunk("its checksum is wrong")
    return data


def _unpack(compression: str, packed: bytes, size: int) -> bytes:
    """Decompress without ever holding more than `size` bytes."""
    if compression == "zstd":
        if size == 0:
            return b""
        claimed = zstandard.frame_content_size(packed)
        if claimed not in (-1, size):
            raise DamagedChunk(f"it claims {claimed} bytes in one place and {size} in another")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    if not compression:
        return packed
    raise DamagedChunk(f"its compression {compression!r} is unknown")


class Messages(NamedTuple):
    """Positions of the messages of an unpacked chunk: offset and length of each record's body, and its channel."""

    offset: NDArray[np.int64]
    length: NDArray[np.int64]
    channel: NDArray[np.uint16]
    others: list[tuple[int, int, int]]
    """Opcode, offset and length of the bodies of all other records (schemas, channels)."""

    def of(self, data: bytes, channel: int) -> Iterator[tuple[np.void, bytes]]:
        """Iterate over HEAD and content of the messages of a channel."""
        mine = self.channel == channel
        for offset, length in zip(self.offset[mine].tolist(), self.length[mine].tolist()):
            yield np.frombuffer(data, HEAD, 1, offset)[0], data[offset + MESSAGE_HEAD:offset + length]


def indexed(indexes: Iterable[bytes]) -> dict[int, int]:
    """Return the number of messages in a chunk by channel, according to its index records."""
    places: dict[int, int] = {}
    for body in indexes:
        if len(body) >= 6:
            channel = _CHANNEL.unpack_from(body)[0]
            places[channel] = places.get(channel, 0) + len(_entries(body)) // 2
    return places


def _entries(body: bytes) -> NDArray[np.uint64]:
    """Return the entries of an index record, times and offsets in turn; none if its lengths disagree."""
    size = struct.unpack_from("<I", body, 2)[0] if len(body) >= 6 else 0
    return np.frombuffer(body[6:6 + size] if size % 16 == 0 and size <= len(body) - 6 else b"", dtype="<u8")


def find_messages(data: bytes, indexes: list[bytes]) -> Messages:
    """Find the messages by the chunk's index records if they cover the chunk without a gap, else record by record;
    DamagedChunk if the lengths of the records do not add up to the chunk.
    """
    starts = np.concatenate([np.empty(0, np.uint64), *(_entries(body)[1::2] for body in indexes)])
    if len(starts):
        messages = _tiled(data, np.sort(starts))
        if messages is not None:
            return messages
    rows = array("q")
    others: list[tuple[int, int, int]] = []
    _walk(data, 0, len(data), rows, others)
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Messages(table[:, 0], table[:, 1], table[:, 2].astype(np.uint16), others)


def _walk(data: bytes, start: int, end: int, rows: array[int], others: list[tuple[int, int, int]]) -> None:
    """Walk through the records from `start` to exactly `end`; append offset, length and channel of each message."""
    position = start
    unpack, message_head = _RECORD.unpack_from, _CHANNEL.unpack_from
    while position < end:
        if position + _RECORD.size > end:
            raise DamagedChunk("its records do not fit into it")
        opcode, length = unpack(data, position)
        body = position + _RECORD.size
        position = body + length
        if position > end or (opcode == Opcode.MESSAGE and length < MESSAGE_HEAD):
            raise DamagedChunk("its records do not fit into it")
        if opcode == Opcode.MESSAGE:
            rows.extend((body, length, message_head(data, body)[0]))
        elif len(others) < MOST_DESCRIPTIONS:
            others.append((opcode, body, length))
        else:
            raise DamagedChunk(f"more than {MOST_DESCRIPTIONS} of its records are not messages")


def windows_of(data: bytes | NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return every `size` consecutive bytes as a view, (n - size + 1, size); NumPy's own function takes long."""
    out: NDArray[np.uint8] = np.ndarray((len(data) - size + 1, size), np.uint8, data, strides=(1, 1))
    return out


def _tiled(data: bytes, starts: NDArray[np.uint64]) -> Messages | None:
    """Return the indexed messages, or None if they and the records between them do not fill the chunk exactly."""
    size = len(data)
    if size < 31 or int(starts[-1]) > size - 31:
        return None
    offset = starts.astype(np.int64)
    heads = windows_of(data, 11)[offset].view(_HEAD)[:, 0]
    if not ((heads["opcode"] == Opcode.MESSAGE) & (heads["length"] >= MESSAGE_HEAD) & (heads["length"] <= size)).all():
        return None
    length = heads["length"].astype(np.int64)
    ends = offset + _RECORD.size + length
    before, after = np.concatenate(([0], ends)), np.concatenate((offset, [size]))
    if (after < before).any():
        return None
    others: list[tuple[int, int, int]] = []
    rows = array("q")
    try:
        for gap in np.flatnonzero(after > before):
            _walk(data, int(before[gap]), int(after[gap]), rows, others)
    except DamagedChunk:
        return None
    return None if rows else Messages(offset + _RECORD.size, length, heads["channel"], others)


def uncompressed(data: bytes, messages: Messages, which: NDArray[np.bool_],
                 expansion: Expansion) -> tuple[bytes, Messages]:
    """Return the chosen messages of a chunk, each unpacked if it was compressed by itself (as rosbag2 does in the
    compression mode message), or all as they are; DamagedChunk if one does not unpack or is too large.
    """
    long = messages.offset[which & (messages.length >= MESSAGE_HEAD + len(ZSTD))] + MESSAGE_HEAD
    starts = windows_of(data, len(ZSTD))[long] if len(long) else long[:, None]
    if not (starts == np.frombuffer(ZSTD, np.uint8)).all(axis=1).any():
        return data, messages
    parts: list[bytes] = []
    unpacker = zstandard.ZstdDecompressor()
    for offset, length in zip(messages.offset[which].tolist(), messages.length[which].tolist()):
        content = data[offset + MESSAGE_HEAD:offset + length]
        if content.startswith(ZSTD):
            size = zstandard.frame_content_size(content)
            if not 0 <= size <= LARGEST_CHUNK:
                raise DamagedChunk("a compressed message in it does not give its size, or one above "
                                   f"{LARGEST_CHUNK} bytes")
            expansion.take(size, used=False)
            try:
                content = unpacker.decompress(content, max_output_size=size) if size else b""
            except zstandard.ZstdError as error:
                raise DamagedChunk(f"a compressed message in it does not unpack ({error})") from None
        parts.append(data[offset:offset + MESSAGE_HEAD] + content)
    length = np.array([len(part) for part in parts], dtype=np.int64)
    return b"".join(parts), Messages(np.cumsum(length) - length, length, messages.channel[which], [])
