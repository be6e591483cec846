"""Files of friction tables, as tribometers write them: columns of slip speed (rad/s) and coefficient."""

from __future__ import annotations

from pathlib import Path

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE

TABLE_FILE, TABLE_COLUMNS = "friction.table", "friction.table_columns"
"""Key that names such a file instead of the keys TABLE, and key that names its columns as --columns does."""
_COLUMNS = {"slip_speed": "rad/s", "coefficient": ""}
_MOST_ROWS = 100_000
_APART = 0.05
"""Largest distance of a row from the mean of its slip speed, relative to the largest coefficient."""
_SLOWEST = 0.1
"""Largest slip speed of the slowest row, relative to the fastest one, in a table without a row at 0."""


def with_table(values: dict[str, object], folder: Path) -> dict[str, object]:
    """Return scene values with `friction.table`, a file relative to `folder`, replaced by its table.

    Rows with an empty cell are left out. Rows of both directions count by the amounts of slip speed and coefficient,
    where the coefficients of one direction have the sign of the slip speed or all are above 0. Rows are sorted, and
    those of one slip speed are averaged. Without a row at 0, the coefficient of the slowest row holds down to 0.

    Raises InputError: the file cannot be read or has other columns, a coefficient has the wrong sign, rows of one slip
    speed differ by more than 5 % of the largest coefficient from their mean, the slowest row is far from 0, or the
    values have a table already.
    """
    if TABLE_FILE not in values:
        if TABLE_COLUMNS in values:
            raise InputError(f"{TABLE_COLUMNS} names columns of {TABLE_FILE}, which is not given")
        return values
    for key in TABLE:
        if key in values:
            raise InputError(f"{TABLE_FILE} and {key} are both given; remove one of them")
    columns = values.get(TABLE_COLUMNS)
    try:
        table = _table_in(folder / str(values[TABLE_FILE]), None if columns is None else str(columns))
    except InputError as error:
        raise InputError(f"{TABLE_FILE}: {error}") from None
    return {**{key: value for key, value in values.items() if key not in (TABLE_FILE, TABLE_COLUMNS)},
            **dict(zip(TABLE, table))}


def _table_in(path: Path, names: str | None) -> tuple[list[float], list[float]]:
    """Return slip speeds, rising from 0, and coefficients of a file."""
    import numpy as np  # Few scenes have such a file.

    from tcc_sim.tables.chosen_columns import columns_in

    columns, _, _ = columns_in(path, _COLUMNS, list(_COLUMNS), _MOST_ROWS, names, TABLE_COLUMNS)
    speed, coefficient = (columns[name] for name in _COLUMNS)
    rows = np.flatnonzero(np.isfinite(speed) & np.isfinite(coefficient))
    if not len(rows):
        raise InputError(f"{path} has no row with a slip speed and a coefficient")
    speed, coefficient = speed[rows], coefficient[rows]
    wrong = coefficient * speed < 0.0
    if (coefficient < 0.0).any() and wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise InputError(f"{path}: row {rows[k] + 1} has a coefficient of {coefficient[k]:g} at {speed[k]:g} rad/s; "
                         "coefficients must be above 0, or have the sign of the slip speed")
    coefficient = np.abs(coefficient)
    speeds, place = np.unique(np.abs(speed), return_inverse=True)
    means = np.bincount(place, coefficient) / np.bincount(place)
    apart = np.abs(coefficient - means[place]) / coefficient.max()
    if apart.max() > _APART:
        k = int(apart.argmax())
        raise InputError(f"{path}: row {rows[k] + 1} has a coefficient of {coefficient[k]:g}, and the mean of the rows "
                         f"at {abs(speed[k]):g} rad/s is {means[place[k]]:g}; they may differ by {_APART:.0%} of the "
                         "largest one")
    if speeds[0] > _SLOWEST * speeds[-1]:
        raise InputError(f"{path}: the slowest row has {speeds[0]:g} rad/s; without a row at 0 it must have at most "
                         f"{_SLOWEST:.0%} of the fastest one, {_SLOWEST * speeds[-1]:g} rad/s")
    first = [0.0] if speeds[0] > 0.0 else []
    return [*first, *speeds.tolist()], [*(means[:1].tolist() if first else []), *means.tolist()]
