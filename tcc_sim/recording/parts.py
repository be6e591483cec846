"""Find and open the files of a recording: a bag directory or a single MCAP file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from tcc_sim.errors import RecordingError, counted
from tcc_sim.recording.records import McapRecord, RecordStream

_MOST_PARTS, _LONGEST_METADATA = 100_000, 1 << 22


def parts_of(path: Path) -> list[Path]:
    """Return the MCAP files of a recording, in their order.

    Raises
    ------
    RecordingError
        No MCAP file is there.
    """
    paths = [path]
    if path.is_dir():
        paths = sorted(path.glob("*.mcap"), key=lambda part: (part_number(part) or 0, part.name))
    if path.suffix == ".db3" or (not paths and any(path.glob("*.db3"))):
        bag = path.parent if path.suffix == ".db3" else path
        raise RecordingError(f"{bag} is a bag in SQLite, which is not read; convert it to MCAP with rosbags-convert "
                             f"--src {bag} --dst {bag}_mcap --dst-storage mcap (from pip install rosbags)")
    if not paths:
        inside = sorted({part.parent for part in path.glob("*/*.mcap")})
        if len(inside) == 1:
            return parts_of(inside[0])
        where = (f"; {inside[0]} and {counted(len(inside) - 1, 'more folder')} in it hold some: name one of them"
                 if inside else "")
        raise RecordingError(f"{path} holds no .mcap file{where}")
    return paths


def part_number(path: Path) -> int | None:
    """Return the number at the end of the name of a bag's part, or None."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() and digits.isascii() and len(digits) < 19 else None


def missing_parts(path: Path, paths: list[Path]) -> list[int]:
    """Return the numbers of missing parts: gaps in the numbers of a split recording, and parts that only its
    metadata.yaml names.
    """
    there = {part_number(part) or 0 for part in paths}
    last = min(max(there), _MOST_PARTS) if len(paths) > 1 else 0
    listed = {part_number(Path(name)) or 0 for name in _listed(paths[0].parent if path.is_dir() else path)}
    return sorted((set(range(last)) | listed) - there)


def unlisted_parts(path: Path, paths: list[Path]) -> list[str]:
    """Return the names of the files that the recording's metadata.yaml does not name; empty without metadata.yaml."""
    listed = _listed(paths[0].parent if path.is_dir() else path)
    return [part.name for part in paths if part.name not in listed] if listed else []


def _listed(path: Path) -> set[str]:
    """Return the names of the parts in a bag directory's metadata.yaml."""
    try:
        file = path / "metadata.yaml"
        if file.stat().st_size > _LONGEST_METADATA:
            return set()
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return set()
    return {line.strip()[2:].strip("'\"") for line in lines if line.strip().startswith("- ") and line.endswith(".mcap")}


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; refuse a pipe, which could block."""
    try:
        if path.exists() and not path.is_file():
            raise RecordingError(f"{path} is not a regular file")
        return path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def records_of(path: Path, stream: RecordStream) -> Iterator[McapRecord]:
    """Iterate over the stream's records; errors name the file."""
    try:
        yield from stream
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None
