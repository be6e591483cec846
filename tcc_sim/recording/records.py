"""Read the records of an MCAP file so that damage affects only the damaged part; the mcap package decodes the fields.

Layout (MCAP 0): magic, then records of one opcode byte, eight length bytes and a body; messages sit in compressed
chunks, each followed by one index record per channel.
"""

from __future__ import annotations

import io
import struct
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema, Statistics
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.errors import RecordingError, counted

MAGIC = b"\x89MCAP0\r\n"
DECODERS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk,
                            Opcode.STATISTICS: Statistics, Opcode.METADATA: Metadata}
LARGEST_CHUNK = 64 << 20
"""Largest size of a chunk, packed or unpacked, bytes."""
LARGEST_EXPANSION = 100
"""Largest ratio of the unpacked chunks to the file, in addition to SMALLEST_EXPANSION; real ratios are 3 to 20."""
SMALLEST_EXPANSION = 16 << 20
"""Bytes to which the chunks of any file may unpack."""
MOST_DESCRIPTIONS = 20_000
"""Largest number of records in a chunk that are not messages; a recorder writes two for each topic."""
MOST_SENTENCES = 20
"""Largest number of damaged places that are listed one by one."""
_LARGEST_RECORD = 16 << 20
_OF_MESSAGES = {Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX}
_WANTED = {*DECODERS, *_OF_MESSAGES}
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8"), ("channel", "<u2")])


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
    """Bytes to which the chunks of a file may still unpack."""

    def __init__(self, file_size: int) -> None:
        self.limit = self.left = SMALLEST_EXPANSION + LARGEST_EXPANSION * file_size

    def take(self, count: int) -> None:
        """Subtract `count` bytes.

        Raises
        ------
        DamagedChunk
            Fewer bytes are left.
        """
        if count > self.left:
            raise DamagedChunk(f"with it the recording would unpack to more than {self.limit} bytes, the most allowed "
                               "for a file of its size")
        self.left -= count


class McapRecord(NamedTuple):
    """One record of a file: opcode, offset and body (empty if it was skipped)."""

    opcode: int
    offset: int
    body: bytes


@dataclass
class RecordStream:
    """Iterator over the records of an open MCAP file, in order.

    chunks : whether to read chunk bodies too
    complete : whether the footer was reached
    warnings : one sentence for each damaged part
    """

    file: BinaryIO
    chunks: bool = True
    complete: bool = False
    warnings: Warnings = field(default_factory=Warnings)

    def __iter__(self) -> Iterator[McapRecord]:
        size = self.file.seek(0, 2)
        self.file.seek(0)
        if self.file.read(len(MAGIC)) != MAGIC:
            raise RecordingError("it is not an MCAP file, or its start is damaged")
        position = len(MAGIC)
        while position + _RECORD.size <= size:
            self.file.seek(position)
            opcode, length = _RECORD.unpack(self.file.read(_RECORD.size))
            end = position + _RECORD.size + length
            believable = 1 <= opcode <= Opcode.DATA_END
            if not believable or length > (LARGEST_CHUNK if opcode == Opcode.CHUNK else _LARGEST_RECORD):
                self.warnings.append(f"nothing can be read from byte {position} on")
                return
            if end > size:
                return
            wanted = opcode in _WANTED and (self.chunks or opcode not in _OF_MESSAGES)
            yield McapRecord(opcode, position, self.file.read(length) if wanted else b"")
            if opcode == Opcode.FOOTER:
                self.file.seek(end)
                self.complete = self.file.read(len(MAGIC)) == MAGIC
                return
            position = end


def decoded(opcode: int, body: bytes) -> Any:
    """Decode the fields of a record of one of DECODERS.

    Raises
    ------
    ValueError
        The fields do not fit into the record.
    """
    try:
        return DECODERS[opcode].read(ReadDataStream(io.BytesIO(body)))
    except (McapError, struct.error, OverflowError):
        raise ValueError("its fields do not fit into it") from None


def unpack_chunk(body: bytes, expansion: Expansion) -> bytes:
    """Unpack the records of a chunk and verify its checksum; `expansion` bounds the unpacked size.

    Raises
    ------
    DamagedChunk
        Lengths disagree, the size exceeds the limit, the compression is broken, or the checksum is wrong.
    """
    try:
        chunk = decoded(Opcode.CHUNK, body)
    except ValueError as error:
        raise DamagedChunk(str(error)) from None
    unpacked, checksum = chunk.uncompressed_size, chunk.uncompressed_crc
    if unpacked > LARGEST_CHUNK:
        raise DamagedChunk(f"it claims {unpacked} bytes; at most {LARGEST_CHUNK} are accepted")
    expansion.take(unpacked)
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


def find_messages(data: bytes, indexes: list[bytes]) -> Messages:
    """Find the messages by the chunk's index records if they cover the chunk without a gap, else record by record.

    Raises
    ------
    DamagedChunk
        The lengths of the records do not add up to the chunk.
    """
    starts = [np.frombuffer(body, dtype="<u8", offset=6)[1::2] for body in indexes
              if len(body) >= 22 and (len(body) - 6) % 16 == 0]
    if starts:
        found = _tiled(data, np.sort(np.concatenate(starts)))
        if found is not None:
            return found
    rows = array("q")
    others: list[tuple[int, int, int]] = []
    _walk(data, 0, len(data), rows, others)
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Messages(table[:, 0], table[:, 1], table[:, 2].astype(np.uint16), others)


def _walk(data: bytes, start: int, end: int, rows: array[int], others: list[tuple[int, int, int]]) -> None:
    """Walk through the records from `start` to exactly `end`; append offset, length and channel of each message."""
    position = start
    unpack, message_head = _RECORD.unpack_from, struct.Struct("<H").unpack_from
    while position < end:
        if position + _RECORD.size > end:
            raise DamagedChunk("its records do not fit into it")
        opcode, length = unpack(data, position)
        body = position + _RECORD.size
        position = body + length
        if position > end or (opcode == Opcode.MESSAGE and length < 22):
            raise DamagedChunk("its records do not fit into it")
        if opcode == Opcode.MESSAGE:
            rows.extend((body, length, message_head(data, body)[0]))
        elif len(others) < MOST_DESCRIPTIONS:
            others.append((opcode, body, length))
        else:
            raise DamagedChunk(f"more than {MOST_DESCRIPTIONS} of its records are not messages")


def _tiled(data: bytes, starts: NDArray[np.uint64]) -> Messages | None:
    """Return the indexed messages, or None if they and the records between them do not fill the chunk exactly."""
    size = len(data)
    if size < 31 or int(starts[-1]) > size - 31:
        return None
    offset = starts.astype(np.int64)
    heads = sliding_window_view(np.frombuffer(data, dtype=np.uint8), 11)[offset].view(_MESSAGE_HEAD)[:, 0]
    if not ((heads["opcode"] == Opcode.MESSAGE) & (heads["length"] >= 22) & (heads["length"] <= size)).all():
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
