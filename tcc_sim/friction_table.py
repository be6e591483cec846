"""Files of friction tables: CSV with the columns slip_speed (rad/s) and coefficient."""

from __future__ import annotations

import csv
from itertools import islice
from pathlib import Path

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE
from tcc_sim.model.quantity import MOST_POINTS

TABLE_FILE = "friction.table"
"""Key that names such a file instead of the keys TABLE."""


def with_table(values: dict[str, object], folder: Path) -> dict[str, object]:
    """Return scene values with `friction.table`, a file relative to `folder`, replaced by its table.

    Raises
    ------
    InputError
        The file cannot be read, has other columns or no number in a field, or the values have a table already.
    """
    if TABLE_FILE not in values:
        return values
    for key in TABLE:
        if key in values:
            raise InputError(f"{TABLE_FILE} and {key} are both given; remove one of them")
    path = folder / str(values[TABLE_FILE])
    if path.exists() and not path.is_file():
        raise InputError(f"{TABLE_FILE}: {path} is not a regular file")
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
