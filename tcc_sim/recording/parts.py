"""Find and open the files of a recording: a bag directory or a single MCAP file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from tcc_sim.errors import RecordingError, counted, one_line
from tcc_sim.recording.records import MAGIC, ZSTD

METADATA = "metadata.yaml"
_MOST_PARTS, _LONGEST_METADATA, _MOST_NAMED = 100_000, 1 << 22, 20
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Loader of YAML: that in C, where it is installed, since the other takes a second for 0.2 MB."""
_COUNTER_FIRST = re.compile(r"(\d{1,9})_(.*)_\d{4}_\d\d_\d\d-\d\d_\d\d_\d\d")
"""Names of rosbag2 since its pull request 2265: {counter}_{prefix}_{date}-{time}."""
_COUNTER_LAST = re.compile(r"(.*)_(\d{1,9})")
"""Names of older versions, and of this package: {prefix}_{counter}."""
KINDS = {r"\.db3(\.zstd)?$": "in SQLite", r"\.bag$": "of ROS 1", (PACKED := r"\.mcap\.zstd$"): "of compressed files"}
"""Kinds of bags that are only imported, by the names of their files."""
_STARTS = {b"SQLite format 3": "in SQLite", b"#ROSBAG V": "of ROS 1", ZSTD: "of compressed files"}


@dataclass(frozen=True)
class Parts:
    """Files of a recording.

    paths : files to read; in their order if `ordered`
    ordered : whether metadata.yaml gives the order; otherwise the numbers in the names do
    absent : names that metadata.yaml lists and that are not there
    unlisted : names of files that metadata.yaml does not list, which are left out
    note : a sentence if metadata.yaml cannot be read
    """

    paths: list[Path]
    ordered: bool = True
    absent: list[str] = field(default_factory=list)
    unlisted: list[str] = field(default_factory=list)
    note: str = ""

    @property
    def missing(self) -> list[int]:
        """Numbers that are missing among the names of parts that are not listed; none for other names."""
        numbers = numbers_of(self.paths) if not self.ordered and len(self.paths) > 1 else set()
        return sorted(set(range(min(max(numbers, default=0), _MOST_PARTS))) - numbers)

    def sentences(self) -> Iterator[str]:
        """Yield a sentence for every file that is absent or left out."""
        if self.note:
            yield self.note
        for name in self.absent[:_MOST_NAMED]:
            yield f"the part {one_line(name)}, which {METADATA} lists, is missing"
        if len(self.absent) > _MOST_NAMED:
            yield f"{len(self.absent) - _MOST_NAMED} more parts are missing"
        for name in self.unlisted[:_MOST_NAMED]:
            yield f"left out: {METADATA} does not list {one_line(name)}"
        if len(self.unlisted) > _MOST_NAMED:
            yield f"left out: {len(self.unlisted) - _MOST_NAMED} more files that {METADATA} does not list"
        if missing := self.missing:
            yield (f"part {missing[0]} is missing" if len(missing) == 1 else
                   f"{len(missing)} parts are missing, the first is part {missing[0]}")


def parts_of(path: Path) -> Parts:
    """Return the files of a recording; RecordingError if no MCAP file is there, or the bag is stored or compressed in a
    way that is not read.
    """
    if not path.is_dir():
        return Parts([path])
    try:
        inside = sorted(path.iterdir(), key=lambda each: [  # Numbers in names count as numbers.
            (text, int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d{0,18})", each.name)])
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None
    names, note = listed(path)
    found = [part for part in inside if re.search(rf"\.mcap$|{PACKED}", part.name)]
    needed = needed_of(found, names)
    files = [part for part in needed if part.suffix == ".mcap"]
    for pattern, kind in KINDS.items():  # Other kinds beside MCAP are no parts of it.
        among = needed if pattern == PACKED else inside
        first = next((part for part in among if re.search(pattern, part.name)), None)
        if first and (pattern == PACKED or not files):
            raise RecordingError(importable(first if first.suffix == ".bag" else path, kind))
    if files and names is not None:
        by_name = {part.name: part for part in files}
        paths = [by_name[name] for name in names if name in by_name]
        unlisted = [part.name for part in found if paths and _plain(part) not in names]
        return Parts(paths or files, bool(paths), [name for name in names if name not in by_name], unlisted)
    if files:
        return Parts(files, len(files) == 1, note=note)
    if first := next((part for part in inside if ".mcap." in part.name), None):
        raise RecordingError(f"{first} is compressed as {first.suffix}, which is not read; unpack it")
    below = sorted({part.parent for part in path.glob("*/*.mcap")})
    if len(below) == 1:
        return parts_of(below[0])
    where = (f"; {below[0]} and {counted(len(below) - 1, 'more folder')} in it hold some: name one of them"
             if below else "")
    raise RecordingError(f"{path} holds no .mcap file{where}")


def needed_of(files: Sequence[Path], names: Sequence[str] | None) -> list[Path]:
    """Return those files of a bag that metadata.yaml lists (`names`); all if it lists none of them. A compressed one
    beside its plain one is not needed.
    """
    needed = [part for part in files if part.suffix != ".zstd" or part.with_suffix("") not in files]
    return [part for part in needed if _plain(part) in (names or ())] or needed


def _plain(part: Path) -> str:
    """Return the name of a file once it is unpacked."""
    return part.name.removesuffix(".zstd")


def importable(bag: Path, kind: str) -> str:
    """Return the sentence that refuses a bag of another kind and names the command that imports it."""
    extra = "" if kind == KINDS[PACKED] else " (pip install 'tcc_sim[bags]')"
    return f"{bag} is a bag {kind}, which is not read; tcc-sim import {bag} RUN makes a recording of it{extra}"


def listed_counts(path: Path) -> dict[str, int]:
    """Return the numbers of messages of the files in a bag's metadata.yaml, by name; none without them."""
    try:
        return {Path(one["path"]).name: int(one["message_count"]) for one in _information(path)["files"]}
    except (ValueError, TypeError, KeyError):
        return {}


def _information(folder: Path) -> dict[str, Any]:
    """Return the content of a bag's metadata.yaml; empty if it is not valid."""
    try:
        if (folder / METADATA).stat().st_size <= _LONGEST_METADATA:
            content = yaml.load((folder / METADATA).read_text(encoding="utf-8"), Loader=LOADER)  # noqa: S506
            return dict(content["rosbag2_bagfile_information"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError, yaml.YAMLError):
        pass
    return {}


def listed(folder: Path) -> tuple[list[str] | None, str]:
    """Return the names of the parts in a bag's metadata.yaml, once unpacked (None without it), and a sentence if it is
    not valid.
    """
    if not (folder / METADATA).is_file():
        return None, ""
    names = _information(folder).get("relative_file_paths")
    if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
        return list(dict.fromkeys(_plain(Path(name)) for name in names)), ""
    return None, f"{METADATA} lists no parts that can be read: the names of the parts give their order"


def numbers_of(paths: Sequence[Path]) -> set[int]:
    """Return the numbers in the names of parts; none if they are no names of parts of one bag."""
    stems = [path.name.partition(".mcap")[0] for path in paths]
    for pattern, number, prefix in ((_COUNTER_FIRST, 1, 2), (_COUNTER_LAST, 2, 1)):
        matches = [match for stem in stems if (match := pattern.fullmatch(stem))]
        if len(matches) == len(stems) and len({match[prefix] for match in matches}) == 1:
            return {int(match[number]) for match in matches}
    return set()


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open an MCAP file; RecordingError if it is none or cannot be read, and for errors of the disk while it is open.
    """
    try:
        if path.exists() and not path.is_file():  # A pipe could block.
            raise RecordingError(f"{path} is not a regular file")
        with path.open("rb") as file:
            start = file.read(16)
            for first, kind in _STARTS.items():
                if start.startswith(first):
                    raise RecordingError(importable(path, kind))
            if not start.startswith(MAGIC):
                raise RecordingError(f"{path}: it is not an MCAP file, or its start is damaged")
            yield file
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None
