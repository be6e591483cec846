"""File of a sweep, to which completed points are appended and from which the sweep resumes: JSON, a line per point.

The first line identifies the sweep. Numbers are written so that reading restores them exactly. Every line ends with a
checksum of its text. A truncated last line is dropped, and its point is solved again.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tcc_sim.errors import InputError, check_folder

FORMAT = "tcc_sim sweep_points 1"
LONGEST_LINE = 1 << 28
"""Longest line, bytes; the first one of a sweep over a million values has a tenth of that."""
SUM = ', "crc32": "%08x"}\n'
SUM_LENGTH = len(SUM % 0)


class SweepFile:
    """An open file of a sweep.

    Raises InputError: the path holds something else, points of another sweep, or a damaged line, or its directory does
    not exist. Raises OSError: the file cannot be read or written.

    path : path of the file; None for no file: points are then not stored
    header : values that distinguish the sweep from others; they become the first line
    form : name and version of the file's format
    kind : contents of the file, for messages
    head : further values of the first line, such as scene and command, which do not distinguish sweeps
    take : function called with curve, index and record of every point in the file; KeyError, TypeError and ValueError
        mean that no sweep wrote the record
    """

    def __init__(self, path: Path | None, header: Mapping[str, Any], take: Callable[[int, int, dict[str, Any]], None],
                 *, form: str = FORMAT, kind: str = "sweep", head: Mapping[str, Any] | None = None) -> None:
        self._kind, self._stream = kind, None
        if path is None:
            return
        check_folder(path)
        wanted: dict[str, Any] = json.loads(json.dumps({"format": form, **header}))
        first = encoded_line({**wanted, **{key: value for key, value in (head or {}).items() if key not in wanted}})
        whole = self._read(path, wanted, first, take) if path.exists() else 0
        self._stream = path.open("ab")
        self._stream.truncate(whole)
        if not whole:
            self._write(first)

    def _read(self, path: Path, wanted: dict[str, Any], first: bytes,
              take: Callable[[int, int, dict[str, Any]], None]) -> int:
        """Take the points of an existing file; return the number of bytes in whole lines."""
        if not path.is_file():
            raise InputError(f"{path}: not a file")
        whole = 0
        with path.open("rb") as stream:
            for number in range(1, 1 << 62):
                line = stream.readline(LONGEST_LINE)
                if not line.endswith(b"\n") and len(line) < LONGEST_LINE:
                    # The end: nothing, or a truncated line. A truncated first line must be that of this sweep.
                    beginning = (json.dumps(wanted, allow_nan=False)[:-1] + ", ").encode()
                    if number == 1 and not (first.startswith(line) or line.startswith(beginning)):
                        raise InputError(f"{path}: not the file of a {self._kind}; it is left as it is")
                    return whole
                if number == 1:
                    self._check_header(path, line, wanted)
                else:
                    try:
                        row = decoded_line(line)
                        take(int(row["curve"]), int(row["index"]), dict(row["record"]))
                    except (TypeError, KeyError, ValueError, AttributeError, OverflowError) as error:
                        raise InputError(f"{path}: line {number} is damaged ({error}); the file is left as it "
                                         "is") from None
                whole += len(line)
        return whole

    def _check_header(self, path: Path, line: bytes, wanted: dict[str, Any]) -> None:
        try:
            header = _object(line)
        except ValueError:
            header = {}
        if header.get("format") != wanted["format"]:
            raise InputError(f"{path}: not the file of a {self._kind}; it is left as it is")
        try:
            decoded_line(line)
        except ValueError as error:
            raise InputError(f"{path}: line 1 is damaged ({error}); the file is left as it is") from None
        different = [key for key in wanted if header.get(key) != wanted[key]]
        if different:
            raise InputError(f"{path}: the file of another {self._kind} ({', '.join(different)} differ); it is left as "
                             "it is")

    def append(self, curve: int, index: int, record: Mapping[str, Any]) -> None:
        """Write one point and hand it to the operating system."""
        if self._stream is not None:
            self._write(encoded_line({"curve": curve, "index": index, "record": record}))

    def _write(self, line: bytes) -> None:
        assert self._stream is not None
        try:
            self._stream.write(line)
            self._stream.flush()
        except OSError as error:
            raise OSError(error.errno, error.strerror, self._stream.name) from None

    def close(self) -> None:
        """Close the file; errors of a full disk were raised by the writes."""
        if self._stream is not None:
            with suppress(OSError):
                self._stream.close()


def encoded_line(values: Mapping[str, Any]) -> bytes:
    """Return a line: a JSON object whose last key is the checksum of the text before it."""
    body = json.dumps(values, allow_nan=False)[:-1]
    return (body + SUM % zlib.crc32(body.encode())).encode()


def decoded_line(line: bytes) -> dict[str, Any]:
    """Return the object of a line; ValueError for a wrong checksum or anything but an object of finite numbers."""
    body, end = line[:-SUM_LENGTH], line[-SUM_LENGTH:]
    if end != (SUM % zlib.crc32(body)).encode():
        raise ValueError("its checksum is wrong or missing")
    return _object(body + b"}")


def _object(text: bytes) -> dict[str, Any]:
    """Return a JSON object of finite numbers; raise ValueError for anything else."""
    try:
        document = json.loads(text, parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    except UnicodeDecodeError:
        raise ValueError("not text in UTF-8") from None
    if not isinstance(document, dict):
        raise ValueError("not an object")
    return document


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value
