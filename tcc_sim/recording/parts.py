"""The files of a recording: a bag directory, or an MCAP file by itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from tcc_sim.errors import RecordingError
from tcc_sim.recording.records import McapRecord, RecordStream

_MOST_PARTS = 100_000


def parts_of(path: Path) -> list[Path]:
    """The MCAP files of a recording, in their order.

    Raises
    ------
    RecordingError
        There are none.
    """
    paths = [path]
    if path.is_dir():
        paths = sorted(path.glob("*.mcap"), key=lambda part: (part_number(part) or 0, part.name))
    if path.suffix == ".db3" or (not paths and any(path.glob("*.db3"))):
        bag = path.parent if path.suffix == ".db3" else path
        raise RecordingError(f"{bag} is a bag in SQLite, which is not read; rosbags-convert --src {bag} --dst "
                             f"{bag}_mcap --dst-storage mcap (from pip install rosbags) makes one that is")
    if not paths:
        raise RecordingError(f"{path} holds no .mcap file")
    return paths


def part_number(path: Path) -> int | None:
    """The number that rosbag2 puts last in the name of a part of a bag, None where there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() and digits.isascii() and len(digits) < 19 else None


def missing_parts(paths: list[Path]) -> list[int]:
    """Numbers that are left out between those of the parts of a split recording, and before the first."""
    numbers = {part_number(path) or 0 for path in paths}
    return [n for n in range(min(max(numbers), _MOST_PARTS)) if n not in numbers] if len(paths) > 1 else []


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
