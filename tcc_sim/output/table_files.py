"""Files of tables and arrays of any command: .npz, .csv, .parquet and .mat, each by the one writer of its format; and
reading of the arrays of a .npz, whose sizes are checked before.
"""

from __future__ import annotations

import csv
import json
import os
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.lib import format as npy

from tcc_sim.errors import InputError, one_line
from tcc_sim.output.files import draft
from tcc_sim.result import units_of_columns
from tcc_sim.tables.binary import write_mat, write_parquet

TABLES = (".npz", ".csv", ".parquet", ".mat")
"""Suffixes of files of a table or of arrays."""
LARGEST_RATIO, SMALLEST_LIMIT = 100, 16 << 20
"""Largest ratio of the arrays that are read to their file, and bytes that the arrays of any file may have."""
_KINDS = "biufcU"
_DAMAGED = (BadZipFile, zlib.error, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError, OverflowError,
            MemoryError, TokenError)


def write_columns(path: Path, suffix: str, columns: Mapping[str, Any], units: Mapping[str, str],
                  texts: Mapping[str, str], hold: Mapping[str, str], comments: Iterable[str] = ()) -> None:
    """Write a table as .csv, .parquet or .mat.

    A .csv has every digit, the names of the columns in its first line and their units in its second, behind the
    `comments` in lines that begin with #. A .parquet has units in the metadata of its fields, and `texts` and `hold` in
    its own; a .mat has column vectors, the structures `units` and `hold`, and the texts.
    """
    if suffix == ".parquet":
        write_parquet(path, columns, units, hold, texts)
    elif suffix == ".mat":
        write_mat(path, columns, units, hold, texts)
    else:
        with path.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(f"# {line}\n" for line in comments)
            rows = csv.writer(file, lineterminator="\n")
            rows.writerows([columns, [units.get(name, "") for name in columns]])
            rows.writerows(zip(*(np.asarray(values).tolist() for values in columns.values())))


def write_result(path: Path, kind: type, columns: Mapping[str, Any], document: Mapping[str, Any],
                 arrays: Mapping[str, Any] | None = None) -> None:
    """Write a result of a class as .npz, .csv, .parquet or .mat, with the JSON `document` except in a .csv.

    columns : the result as a table, each column of the same length
    arrays : what a .npz and a .mat have instead; None for the columns
    """
    named = columns if arrays is None else arrays
    with draft(path) as part:
        if path.suffix == ".npz":
            with part.open("wb") as stream:
                np.savez_compressed(stream, **named, **documented(document))
        else:
            shown = named if path.suffix == ".mat" else columns
            write_columns(part, path.suffix, shown, units_of_columns(kind, shown),
                          {"document": json.dumps(document, allow_nan=False)}, {})


def documented(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of a command as an array of a .npz, which thus names its origin and can be drawn again."""
    return {"document": np.array(json.dumps(document, allow_nan=False))}


def read_arrays(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return those of the named arrays that a .npz holds; others are not read.

    Raise InputError: the file cannot be read or is damaged; an array is no array of numbers or text; or arrays are
    larger than the file or the memory can hold.
    """
    place, arrays = f"{path}", {}
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        left = min(LARGEST_RATIO * path.stat().st_size + SMALLEST_LIMIT,
                   os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2)
        with ZipFile(path) as file:
            for name in (name for name in names if f"{name}.npy" in file.namelist()):
                place, size = f"{path}: array {name}", file.getinfo(f"{name}.npy").file_size
                if size > left:
                    raise InputError(f"{place} would take {size} bytes; at most {left} are accepted for a file of its "
                                     "size")
                left -= size
                with file.open(f"{name}.npy") as stream:
                    arrays[name] = npy.read_array(stream, allow_pickle=False)
                    if stream.read(1):  # At the end the checksum is compared.
                        raise ValueError("bytes follow its numbers")
                if arrays[name].dtype.kind not in _KINDS:
                    raise ValueError("it holds neither numbers nor text")
        return arrays
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(f"{place} is damaged, or no .npz: {one_line(str(error)) or type(error).__name__}") from None


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
