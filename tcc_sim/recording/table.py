"""Read measurements from a CSV file: its columns, and how inputs are interpolated between rows."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from tcc_sim.errors import InputError, one_line
from tcc_sim.model.parameters import unknown_key
from tcc_sim.topics import FAR_END, INPUTS, topic
from tcc_sim.trajectory import UNITS, Floats

TIME = "t"
CHANNELS = {"slip_speed": "rad/s", "plate_speed": "rad/s", "plate_angle": "rad"}
"""Columns of measured outputs, with their units; further columns are the time, s, and DRIVING."""
DRIVING = (*INPUTS, FAR_END)
"""Columns of inputs: engine torque, pressure, and speed of the shaft's far end."""
REFERENCES = ("engine_speed", "tacho")
"""Columns that give the phase of the engine: speed of the crankshaft, rad/s, and pulses of a tacho, in any unit."""
HOLDS = ("previous", "linear", "smooth", "next")
"""Values of an input between two rows: that of the row before, a straight line, a line with the corners of
`model.profile.smooth_corners`, or that of the row after."""
LARGEST_TABLE = 1 << 30
"""Largest size of a table, bytes."""
SMOOTH = 1.0
"""Ratio of second to first differences (rms) of a column below which it was sampled from a smooth signal: that of a
sine with 6 samples in a period; held steps have 1.4 or more.
"""
_HOLD, _SAID = "hold: ", re.compile(r"(\w+) (" + "|".join(HOLDS) + ")")
_NAMED = re.compile(r"(\w+)\s*[\[(](.*)[\])]")
"""A name with its unit in brackets."""
_PRODUCT = re.compile(r"[\s.*]")
"""Separators between factors of a unit."""
_LONGEST_LINE = 1 << 16


@dataclass(frozen=True)
class HeldColumns:
    """Columns of a CSV file, and how inputs are interpolated between rows.

    columns : (n,) arrays of finite numbers by name: t, DRIVING, CHANNELS, REFERENCES and output_angle
    hold : interpolation of inputs between rows, one of HOLDS by column name, if the file states it
    """

    columns: Mapping[str, Floats]
    hold: Mapping[str, str] = field(default_factory=dict)


def hold_line(hold: Mapping[str, str]) -> str:
    """Return the line of a table that states the interpolation of its columns, without the leading #."""
    return _HOLD + ", ".join(f"{name} {how}" for name, how in hold.items())


def looks_smooth(values: Floats) -> bool:
    """Return whether a column looks sampled from a smooth signal rather than held in steps."""
    first, second = np.diff(values), np.diff(values, 2)
    if len(second) < 8 or 2 * np.count_nonzero(first) < len(first):
        return False
    return bool(np.sqrt(np.mean(second**2)) < SMOOTH * np.sqrt(np.mean(first**2)))


def table_of(path: Path, needed: Sequence[str] = (), most: int = 2_000_000) -> HeldColumns:
    """Read a table.

    Lines before the header that begin with # are skipped, so that files of `analyse --out` can be read; their columns
    that cannot be measured are left out. Units may follow the names in brackets, or in a second line.

    Parameters
    ----------
    path : a CSV file in UTF-8 with a line of names and optionally a line of units
    needed : names of required columns
    most : largest number of rows

    Raises
    ------
    InputError
        The path is not a regular file, or the file is too large or cannot be read; a column is unknown, missing,
        repeated or in another unit; a line has wrong or missing numbers; or there are too many rows.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        if (size := path.stat().st_size) > LARGEST_TABLE:
            raise InputError(f"{path} has {size} bytes; a table has at most {LARGEST_TABLE}")
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return _read(path, stream, needed, most)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or 'not a text file in UTF-8'}") from None


def read_columns(path: Path, needed: Sequence[str] = (), most: int = 2_000_000) -> dict[str, Floats]:
    """Return the columns of a table, read by `table_of`."""
    return dict(table_of(path, needed, most).columns)


def _lines(path: Path, stream: TextIO) -> Iterator[str]:
    """Iterate over the lines of a file, each of bounded length."""
    while line := stream.readline(_LONGEST_LINE + 1):
        if len(line) > _LONGEST_LINE:
            raise InputError(f"{path}: it has a line of more than {_LONGEST_LINE} characters")
        yield line


def _read(path: Path, stream: TextIO, needed: Sequence[str], most: int) -> HeldColumns:
    """Read a table from an open file."""
    rows = ((number, row) for number, row in enumerate(csv.reader(_lines(path, stream)), 1) if row)
    hold: dict[str, str] = {}
    names: list[str] = []
    for _, row in rows:
        if not row[0].startswith("#"):
            names = [name.strip() for name in row]
            break
        text = ",".join(row).lstrip("# ")
        if text.startswith(_HOLD):
            hold = {name: how for name, how in _SAID.findall(text) if name in DRIVING}
    given = [_NAMED.fullmatch(name) for name in names]
    names = [found[1] if found else name for found, name in zip(given, names)]
    units = [found[2] if found else "" for found in given]
    _check_names(path, names, needed)
    first = next(rows, None)
    if first is not None and len(first[1]) == len(names):
        cells = [cell.strip("[]() ") for cell in first[1]]
        time = cells[names.index(TIME) if TIME in names else 0]
        if math.isnan(_number(time)) and time.lower() != "nan":
            units, first = cells, None
    _check_units(path, names, units)
    positions = {name: place for place, name in enumerate(names) if name in (TIME, *DRIVING, *CHANNELS, *REFERENCES,
                                                                               "output_angle")}
    columns = {name: array("d") for name in positions}
    for count, (number, row) in enumerate(rows if first is None else chain([first], rows)):
        if count >= most:
            raise InputError(f"{path}: it has more than {most} rows; it must have at most {most}")
        if len(row) != len(names):
            raise InputError(f"{path}: line {number} has {len(row)} values; the first line names {len(names)}")
        for name, column in columns.items():
            value = _number(row[positions[name]])
            if not math.isfinite(value):
                raise InputError(f"{path}: line {number} has no number in column {name}")
            column.append(value)
    return HeldColumns({name: np.array(column) for name, column in columns.items()}, hold)


def _number(text: str) -> float:
    """Return a number; NaN for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _check_units(path: Path, names: Sequence[str], units: Sequence[str]) -> None:
    """Raise InputError if a column that is used has a unit other than its own."""
    for name, unit in zip(names, units):
        own = "rad/s" if name == REFERENCES[0] else UNITS.get(name, topic(name).unit if name in DRIVING else "")
        used = name in (TIME, *DRIVING, *CHANNELS, REFERENCES[0])
        if unit and _PRODUCT.sub("", unit) != _PRODUCT.sub("", own) and used:
            raise InputError(f"{path}: column {name} is in {one_line(unit)}; it must be in {own}")


def _check_names(path: Path, names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise InputError if a column's name is unknown or repeated, or a needed column is missing."""
    known = (TIME, *DRIVING, *CHANNELS, *REFERENCES)
    for name in names:
        if name not in known and name not in UNITS:
            raise InputError(f"{path}: {unknown_key(one_line(name), list(known), 'a column')}; columns are "
                             f"{', '.join(known)}")
    for name in needed:
        if name not in names:
            raise InputError(f"{path}: there is no column {name} in its first line")
    if len(set(names)) < len(names):
        raise InputError(f"{path} has a column twice")
