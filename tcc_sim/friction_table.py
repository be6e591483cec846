"""Friction tables in files of their own: CSV with the columns slip_speed (rad/s) and coefficient."""

from __future__ import annotations

import csv
from itertools import islice
from pathlib import Path

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE
from tcc_sim.model.quantity import MOST_POINTS

TABLE_FILE = "friction.table"
"""The key that names such a file in the place of TABLE."""


def with_table(values: dict[str, object], folder: Path) -> dict[str, object]:
    """Scene values with the table that `friction.table` names, relative to `folder`, in its place.

    Raises
    ------
    InputError
        A file that cannot be read, has other columns or no number in a field, or values that have a table already.
    """
    if TABLE_FILE not in values:
        return values
    for key in TABLE:
        if key in values:
            raise InputError(f"{TABLE_FILE} and {key} are both given; leave one of them out")
    path = folder / str(values[TABLE_FILE])
    if path.exists() and not path.is_file():
        raise InputError(f"{TABLE_FILE}: {path} is no regular file")
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(islice(csv.DictReader(stream), MOST_POINTS + 1))
        found = {key: [float(row[name]) for row in rows] for key, name in zip(TABLE, ("slip_speed", "coefficient"))}
    except OSError as error:
        raise InputError(f"{TABLE_FILE}: {path}: {error.strerror}") from None
    except (KeyError, TypeError, ValueError, csv.Error):
        raise InputError(f"{TABLE_FILE}: {path} must have the columns slip_speed (rad/s) and coefficient, and a number "
                         "in each field") from None
    return {**{key: value for key, value in values.items() if key != TABLE_FILE}, **found}
