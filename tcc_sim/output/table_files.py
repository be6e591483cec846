"""Files of tables and arrays of any command: .npz, .csv, .parquet and .mat, each by the one writer of its format."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.output.files import draft
from tcc_sim.result import units_of_columns
from tcc_sim.tables.binary import write_mat, write_parquet

TABLES = (".npz", ".csv", ".parquet", ".mat")
"""Suffixes of files of a table or of arrays."""


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
