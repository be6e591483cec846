"""Read files of results with bounds: the named arrays of a .npz, whose sizes are checked before they are read."""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Iterable
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.lib import format as npy

from tcc_sim.errors import InputError, one_line

LARGEST_RATIO, SMALLEST_LIMIT = 100, 16 << 20
"""Largest ratio of the arrays that are read to their file, and bytes that the arrays of any file may have."""
_KINDS = "biufcU"
_DAMAGED = (BadZipFile, zlib.error, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError, OverflowError,
            MemoryError, TokenError)


def read_arrays(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return those of the named arrays that a .npz holds; others are not read.

    Raises InputError: the file cannot be read or is damaged; an array is no array of numbers or text; or arrays are
    larger than the file or the memory can hold.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        left = min(LARGEST_RATIO * path.stat().st_size + SMALLEST_LIMIT,
                   os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2)
        arrays = {}
        with ZipFile(path) as file:
            names_in_file = set(file.namelist())
            for name in names:
                if f"{name}.npy" in names_in_file:
                    arrays[name] = _array(path, file, name, left)
                    left -= arrays[name].nbytes
        return arrays
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(f"{path} is damaged, or no .npz: {one_line(str(error)) or type(error).__name__}") from None


def _array(path: Path, file: ZipFile, name: str, left: int) -> Any:
    """Read an array of at most `left` bytes, after its header."""
    size = file.getinfo(f"{name}.npy").file_size
    with file.open(f"{name}.npy") as stream:
        version = npy.read_magic(stream)
        header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
        if header is None:
            raise InputError(f"{path}: array {name} has the unknown version {version}")
        shape, fortran, kind = header(stream)
        if kind.kind not in _KINDS or kind.hasobject:
            raise InputError(f"{path}: array {name} holds neither numbers nor text")
        claimed = math.prod(shape) * kind.itemsize
        if claimed > left:
            raise InputError(f"{path}: array {name} would take {claimed} bytes; at most {left} are accepted for a file "
                             "of its size")
        if claimed != size - stream.tell():
            raise InputError(f"{path}: array {name} claims {claimed} bytes and has {size - stream.tell()}")
        data = stream.read(claimed)
        stream.read(1)  # The checksum is compared at the end.
    if len(data) != claimed:
        raise InputError(f"{path}: array {name} ends after {len(data)} of {claimed} bytes")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C").copy()


def document_in(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    """Take the JSON of the command that wrote a .npz out of its arrays."""
    text = arrays.pop("document", None)
    if text is None or text.shape != () or text.dtype.kind != "U":
        raise InputError(f"{path} does not say which command wrote it; write it again with --out")
    try:
        document = json.loads(str(text))
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise InputError(f"{path}: the JSON of the command that wrote it is damaged")
    return document
