"""Measurements in a table: the columns of a CSV file, as numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tcc_sim.errors import InputError, one_line
from tcc_sim.model.parameters import unknown_key
from tcc_sim.topics import INPUTS
from tcc_sim.trajectory import Floats, Trajectory

TIME = "t"
CHANNELS = {"slip_speed": "rad/s", "plate_speed": "rad/s", "plate_angle": "rad"}
"""Columns of what a driveline did, with their units; beside them the time, s, and INPUTS, which drove it."""


def read_columns(path: Path, needed: Sequence[str] = (), most: int = 2_000_000) -> dict[str, Floats]:
    """The columns t, INPUTS and CHANNELS of a table, (n,) arrays of finite numbers, by name.

    Lines that begin with # are passed over before the header, so that what `analyse --out` writes is read; of its
    columns those that nobody measures are left out.

    Parameters
    ----------
    path : a CSV file in UTF-8 with a line of names
    needed : columns that must be there
    most : rows at most

    Raises
    ------
    InputError
        A file that cannot be read, a column that is unknown, missing or there twice, a line without its numbers, or
        too many rows.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = [(number, row) for number, row in enumerate(csv.reader(stream), 1) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or 'not a table of text in UTF-8'}") from None
    while lines and lines[0][1][0].startswith("#"):
        del lines[0]
    names = [name.strip() for name in lines[0][1]] if lines else []
    known = (TIME, *INPUTS, *CHANNELS)
    for name in names:
        if name not in known and name not in Trajectory.UNITS:
            raise InputError(f"{path}: {unknown_key(one_line(name), list(known), 'a column')}; columns are "
                             f"{', '.join(known)}")
    for name in needed:
        if name not in names:
            raise InputError(f"{path}: there is no column {name} in its first line")
    if len(set(names)) < len(names):
        raise InputError(f"{path} has a column twice")
    rows = lines[1:]
    if len(rows) > most:
        raise InputError(f"{path}: it has {len(rows)} rows; it must have at most {most}")
    for number, row in rows:
        if len(row) != len(names):
            raise InputError(f"{path}: line {number} has {len(row)} values; the first line names {len(names)}")
    return {name: _numbers(path, rows, place, name) for place, name in enumerate(names) if name in known}


def _numbers(path: Path, rows: Sequence[tuple[int, list[str]]], place: int, name: str) -> Floats:
    """A column of finite numbers."""
    found = np.empty(len(rows))
    for k, (number, row) in enumerate(rows):
        try:
            found[k] = float(row[place])
        except ValueError:
            found[k] = math.nan
        if not math.isfinite(found[k]):
            raise InputError(f"{path}: line {number} has no number in column {name}")
    return found
