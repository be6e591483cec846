"""Files of friction tables: the columns slip_speed (rad/s) and coefficient."""

from __future__ import annotations

from pathlib import Path

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE
from tcc_sim.model.quantity import MOST_POINTS

TABLE_FILE = "friction.table"
"""Key that names such a file instead of the keys TABLE."""
_COLUMNS = {"slip_speed": "rad/s", "coefficient": ""}


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
    import numpy as np  # Few scenes have such a file.

    from tcc_sim.tables.chosen_columns import columns_in

    path = folder / str(values[TABLE_FILE])
    try:
        columns, _, _ = columns_in(path, _COLUMNS, list(_COLUMNS), MOST_POINTS)
    except InputError as error:
        raise InputError(f"{TABLE_FILE}: {error}") from None
    for name, column in columns.items():
        if not np.isfinite(column).all():
            raise InputError(f"{TABLE_FILE}: {path} has no number in column {name} of row "
                             f"{int(np.flatnonzero(~np.isfinite(column))[0]) + 1}")
    return {**{key: value for key, value in values.items() if key != TABLE_FILE},
            **dict(zip(TABLE, (columns[name].tolist() for name in _COLUMNS)))}
