"""The reader of tables of measurements: columns in SI units, rows in the order of time, and holes between them.

Inputs of `simulate`, orders and spectra of `analyse`, `identify` and the friction table of a scene are read by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tcc_sim.errors import InputError, counted
from tcc_sim.tables.chosen_columns import COLUMNS, DRIVING, columns_in
from tcc_sim.tables.file_columns import TIME
from tcc_sim.tables.flaws import without_flaws
from tcc_sim.tables.sampling import (
    HOLE,
    LEAST_JITTER,
    Spans,
    holes_in,
    in_words,
    jitter_of,
    merged,
    rows_in_order,
    usual_steps,
)
from tcc_sim.trajectory import Floats

HOLDS = ("previous", "linear", "smooth", "next")
"""Values of an input between two rows: that of the row before, a straight line, a line with the corners of
`model.profile.smooth_corners`, or that of the row after."""
MOST_ROWS = 2_000_000
SMOOTH = 1.0
"""Ratio of second to first differences (rms) of a column below which it was sampled from a smooth signal: that of a
sine with 6 samples in a period; held steps have 1.4 or more.
"""
EXCEL, LONGEST_OF_DAY = (25_569.0, 80_000.0), 2e-5
"""Days since 1900 from 1970 to 2119, and longest step of rows in days, 1.7 s."""
_EPOCH = {1.0: "s", 1e3: "ms", 1e6: "us", 1e9: "ns"}
@dataclass(frozen=True)
class MeasuredTable:
    """Columns of a table in SI units and in the order of time.

    columns : (n,) arrays by name, t (strictly increasing, s) and those of COLUMNS that the file has; NaN for an empty
        cell
    hold : interpolation of inputs between rows, one of HOLDS by column name, if the file states it
    source : name of the file, for messages
    notes : sentences on how it was read, and on what was converted, mended and passed over
    """

    columns: Mapping[str, Floats]
    hold: Mapping[str, str] = field(default_factory=dict)
    source: str = "the table"
    notes: tuple[str, ...] = ()

    @property
    def t(self) -> Floats:
        """(n,) times, s."""
        return self.columns[TIME]

    def filled(self, name: str) -> tuple[Floats, Floats]:
        """Return times and values of a column where it has any."""
        finite = np.isfinite(self.columns[name])
        return self.t[finite], self.columns[name][finite]

    def holes(self, *names: str) -> Spans:
        """Return the stretches, (k, 2), s, in which one of the columns has no values though it was sampled regularly;
        without names, those without rows.
        """
        holes = [holes_in(self.t)]
        for name in names:
            t, _ = self.filled(name)
            if len(t) < len(self.t):
                ends = [[self.t[0], t[0]], [t[-1], self.t[-1]]] if len(t) else [[self.t[0], self.t[-1]]]
                usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
                holes += [holes_in(t), np.array([[a, b] for a, b in ends if b - a > HOLE * usual]).reshape(-1, 2)]
        return merged(np.concatenate(holes))

    def usual_step(self, *names: str) -> float:
        """Return the median of the usual steps of the columns, s, of the largest of them; 0 if rows are irregular."""
        steps = [usual_steps(self.filled(name)[0]) for name in names] or [usual_steps(self.t)]
        return max((0.0 if step is None else float(np.median(step)) for step in steps), default=0.0)

    def part(self, start: float | None = None, end: float | None = None) -> MeasuredTable:
        """Return the rows between two times, s."""
        within = (self.t >= (-np.inf if start is None else start)) & (self.t <= (np.inf if end is None else end))
        return replace(self, columns={name: values[within] for name, values in self.columns.items()})

    def noting(self, *sentences: str) -> MeasuredTable:
        """Return the table with further notes."""
        return replace(self, notes=(*self.notes, *sentences))


def hold_line(hold: Mapping[str, str]) -> str:
    """Return the line of a table that states the interpolation of its columns, without the leading #."""
    return "hold: " + ", ".join(f"{name} {how}" for name, how in hold.items())


def looks_smooth(values: Floats) -> bool:
    """Return whether a column looks sampled from a smooth signal rather than held in steps."""
    first, second = np.diff(values), np.diff(values, 2)
    if len(second) < 8 or 2 * np.count_nonzero(first) < len(first):
        return False
    return bool(np.sqrt(np.mean(second**2)) < SMOOTH * np.sqrt(np.mean(first**2)))


def table_in(path: Path, needed: Sequence[str] = (), most: int = MOST_ROWS,
             columns: str | Mapping[str, str] | None = None) -> MeasuredTable:
    """Read a table of measurements.

    columns : column of the file, with its unit, by name, as `named_columns` takes them

    Raise InputError and MissingPackage as `contents_of` and `named_columns`, and InputError if a needed column is
    missing, a column is there twice, has an unknown unit or no numbers, or the rows cannot be put in order of time.
    """
    arrays, notes, hold = columns_in(path, COLUMNS, (TIME, *needed), most, columns)
    t = arrays[TIME]
    if not np.isfinite(t).any():
        raise InputError(f"{path}: column {TIME} has no times")
    dated = np.isfinite(t)
    if not dated.all():
        notes.append(f"{counted(int((~dated).sum()), 'row')} without a time left out")
    filled = np.any([np.isfinite(arrays[name]) for name in arrays if name != TIME] or [dated], axis=0)
    if (dated & ~filled).any():
        notes.append(f"{counted(int((dated & ~filled).sum()), 'row')} without values left out")
    arrays = {name: values[dated & filled] for name, values in arrays.items()}
    arrays[TIME] = _from_epoch(arrays[TIME], notes)
    stacked = np.stack([values for name, values in arrays.items() if name != TIME] or [arrays[TIME]])
    before, after = stacked[:, :-1], stacked[:, 1:]
    same = np.append(False, ((before == after) | (np.isnan(before) & np.isnan(after))).all(axis=0))
    rows, t, said = rows_in_order(arrays[TIME], same, f"{path}: column {TIME}")
    arrays = {name: t if name == TIME else values[rows] for name, values in arrays.items()}
    arrays, flaws = without_flaws(arrays, t, str(path))
    notes += flaws
    counts = {name: int(np.count_nonzero(~np.isfinite(values))) for name, values in arrays.items()}
    if any(counts.values()):
        notes.append("empty cells: " + ", ".join(f"{count} of {len(t)} in {name}"
                                                 for name, count in counts.items() if count))
    if (varying := jitter_of(t)) > LEAST_JITTER:
        notes.append(f"steps between rows vary by {100.0 * varying:.0f} %; each row is used at its own time")
    return MeasuredTable(arrays, {name: how for name, how in hold.items() if name in DRIVING and how in HOLDS},
                         str(path), tuple(f"{path.name}: {note}" for note in (*notes, *said)))


def _from_epoch(t: Floats, notes: list[str]) -> Floats:
    """Return times from the first row on where they are seconds, or parts of them, since 1970."""
    if len(t) > 1 and EXCEL[0] < t[0] < EXCEL[1] and 0.0 < np.median(np.abs(np.diff(t))) < LONGEST_OF_DAY:
        notes.append("times in days as Excel counts them, counted from the first row")
        return np.asarray(np.round((t - t[0]) * 86400.0, 6))
    if not len(t) or not abs(t[0]) > 9e8:
        return t
    for per_second, unit in _EPOCH.items():
        if 9e8 <= t[0] / per_second <= 4e9:
            notes.append(f"times in {unit} since 1970, counted from the first row")
            return np.asarray((t - t[0]) / per_second)
    return t


def holes_in_words(table: MeasuredTable, holes: Spans, step: float) -> str:
    """Return the sentence on holes in a table."""
    return (f"{table.source} has {'a hole' if len(holes) == 1 else f'{len(holes)} holes'} without rows or values, "
            f"{in_words(holes)}, beside steps of {step:.4g} s")


def longest_part(t: Floats, holes: Spans) -> tuple[float, float]:
    """Return begin and end of the longest stretch of time without a hole, s."""
    begins, ends = np.append(t[0], holes[:, 1]), np.append(holes[:, 0], t[-1])
    k = int(np.argmax(ends - begins))
    return float(begins[k]), float(ends[k])
