"""Columns of a table's file: which one is meant by each name, in which unit, and which are passed over."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path

from tcc_sim.errors import InputError, counted, one_line
from tcc_sim.tables.binary import READERS, reader_of
from tcc_sim.tables.file_columns import TIME, FileColumns, unit_factor, units_for
from tcc_sim.tables.text import text_contents
from tcc_sim.topics import FAR_END, INPUTS, topic
from tcc_sim.trajectory import UNITS, Floats

CHANNELS = {"slip_speed": "rad/s", "plate_speed": "rad/s", "plate_angle": "rad"}
"""Columns of measured outputs, with their units; further columns are the time, s, and DRIVING."""
DRIVING = (*INPUTS, FAR_END)
"""Columns of inputs: engine torque, pressure, and speed of the shaft's far end."""
REFERENCES = ("engine_speed", "tacho")
"""Columns that give the phase of the engine: speed of the crankshaft, rad/s, and pulses of a tacho, in any unit."""
COLUMNS: dict[str, str | None] = {
    TIME: "s", **{name: topic(name).unit for name in DRIVING}, **CHANNELS, "engine_speed": "rad/s", "tacho": None,
    "output_angle": "rad"}
"""Columns of measurements, with their SI units; None for any unit."""
SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc", *READERS)
"""Names of tables end in one of these."""
REFUSED = {".xlsx": "an Excel workbook", ".xls": "an Excel workbook", ".ods": "a spreadsheet", ".h5": "an HDF5 file",
           ".hdf5": "an HDF5 file", ".feather": "a Feather file", ".json": "a JSON file", ".blf": "a CAN log",
           ".asammdf": "an MDF file under another name", ".npz": "a NumPy archive", ".npy": "a NumPy array",
           ".uff": "a universal file", ".unv": "a universal file"}
"""Kind of file by suffix, for files that are neither tables nor recordings."""
LARGEST_TABLE = 1 << 30
"""Largest size of a table, bytes."""
_TIMES = ("time", "timestamp", "timestamps", "time stamp", "zeit")
_SHOWN = 6
"""Names of unused columns that a sentence lists."""


def is_table(path: Path) -> bool:
    """Return whether a file's name is that of a table; raise InputError if it is neither one nor a recording."""
    suffix = path.suffix.lower()
    if suffix in REFUSED:
        raise InputError(f"{path} is {REFUSED[suffix]}, which is not read; save it as {', '.join(SUFFIXES)}")
    return suffix in SUFFIXES


def named_columns(text: str | Mapping[str, str] | None, known: Mapping[str, str | None] = COLUMNS,
                  option: str = "--columns") -> dict[str, str]:
    """Return the column of the file, with its unit, for each name in NAME=COLUMN[:UNIT],...; raise InputError for
    another form, and for a name that is unknown or given twice.
    """
    if text is None:
        return {}
    pairs = list(text.items()) if isinstance(text, Mapping) else [
        (name.strip(), column) for name, _, column in (part.partition("=") for part in text.split(","))]
    names: dict[str, str] = {}
    for name, column in pairs:
        if name not in known or not column:
            raise InputError(f"{option} names {one_line(name)!r}{'' if column else ' without =COLUMN'}; it takes "
                             f"NAME=COLUMN[:UNIT],... with the names {', '.join(known)}")
        if name in names:
            raise InputError(f"{option} gives {name} twice")
        names[name] = column
    return names


def contents_of(path: Path, known: Sequence[str]) -> FileColumns:
    """Return the contents of a file of any of the SUFFIXES; `known` are names that a text file may have in its line of
    names. Raise InputError if the file is not a regular one, is too large or cannot be read, and MissingPackage if the
    package that reads it is not installed.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        if (size := path.stat().st_size) > LARGEST_TABLE:
            raise InputError(f"{path} has {size} bytes; a table has at most {LARGEST_TABLE}")
        reader = reader_of(path)
        return text_contents(path, known) if reader is None else reader(path)
    except (OSError, csv.Error) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def columns_in(path: Path, known: Mapping[str, str | None], needed: Sequence[str], most: int,
               columns: str | Mapping[str, str] | None = None,
               option: str = "--columns") -> tuple[dict[str, Floats], list[str], dict[str, str]]:
    """Return the columns of a file whose names are known, (n,) in SI units and in the order of the rows, a sentence on
    how they were read, and the holds that the file states; see `measured_table.table_in`.
    """
    chosen = named_columns(columns, known, option)
    contents = contents_of(path, [*known, *_TIMES, *UNITS, *(word.rpartition(":")[0] or word
                                                             for word in chosen.values())])
    places = _columns_by_name(path, contents, known, chosen, option)
    for name in needed:
        if name not in places:
            raise InputError(_lacking(path, contents, name, places, option))
    order = sorted(places)
    factors = [_factor(path, contents, name, places[name], known[name]) for name in order]
    time = places[TIME][0] if TIME in places else None
    values, read_as = contents.numbers([places[name][0] for name in order], time, most)
    arrays = {name: column if factor == 1.0 else column * factor
              for name, column, factor in zip(order, values, factors)}
    return arrays, _notes_on(contents, read_as, places, dict(zip(order, factors))), dict(contents.hold)


def _columns_by_name(path: Path, contents: FileColumns, known: Mapping[str, str | None],
            chosen: Mapping[str, str], option: str) -> dict[str, tuple[int, str]]:
    """Return number and unit of the file's column for each known name that it has."""
    names = [name.strip() for name in contents.names]
    places: dict[str, tuple[int, str]] = {}
    for name, word in chosen.items():
        column, colon, unit = word.rpartition(":")
        column, unit = (column, unit) if colon and word not in names else (word, "")
        if column not in names:
            near = difflib.get_close_matches(column, names, n=1, cutoff=0.5)
            raise InputError(f"{path}: there is no column {one_line(column)}, which {option} names for {name}; "
                             + (f"did you mean {one_line(near[0])}?" if near else f"the file has {_listed(names)}"))
        _check_once(path, names, column)
        column_unit = contents.units[names.index(column)]
        if unit and column_unit and unit_factor(unit, known[name] or "") != unit_factor(column_unit, known[name] or ""):
            raise InputError(f"{path}: column {one_line(column)} is in {one_line(column_unit)} by the file and in "
                             f"{one_line(unit)} by {option}; leave out one of them")
        places[name] = names.index(column), unit or column_unit
    spelled = [name.lower().replace(" ", "_").replace("-", "_") for name in names]
    for name in known:
        if name in places:
            continue
        also = [name, *(_TIMES if name == TIME else ())]
        for words, word in [(names, name), *((spelled, word.replace(" ", "_")) for word in also)]:
            if word in words:
                _check_once(path, words, word)
                places[name] = words.index(word), contents.units[words.index(word)]
                break
    return places


def _check_once(path: Path, names: Sequence[str], column: str) -> None:
    if names.count(column) > 1:
        raise InputError(f"{path} has the column {one_line(column)} {counted(names.count(column), 'time')}")


def _factor(path: Path, contents: FileColumns, name: str, place: tuple[int, str], si: str | None) -> float:
    """Return the factor of a column to SI; raise InputError for an unknown unit."""
    unit = place[1]
    if si is None or not unit:
        return 1.0
    factor = unit_factor(unit, si)
    if factor is None:
        raise InputError(f"{path}: column {one_line(contents.names[place[0]])} is in {one_line(unit)}; {name} must be "
                         f"in {si or 'no unit'} or one of {units_for(si)}")
    return factor


def _listed(names: Sequence[str]) -> str:
    """Return the first of some names."""
    shown = ", ".join(one_line(name) if name else "one without a name" for name in names[:_SHOWN])
    return shown + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def _lacking(path: Path, contents: FileColumns, name: str, places: Mapping[str, tuple[int, str]],
             option: str) -> str:
    """Return the sentence for a missing column."""
    used = {place for place, _ in places.values()}
    others = [other for j, other in enumerate(contents.names) if j not in used]
    return f"{path}: there is no column {name}" + (
        f"; the file has {_listed(others)}, and {option} {name}=COLUMN names one of them" if others else "")


def _notes_on(contents: FileColumns, read_as: Sequence[str], places: Mapping[str, tuple[int, str]],
              factors: Mapping[str, float]) -> list[str]:
    """Return the sentence on how a file was read, if it is not plain CSV with known columns in SI."""
    used = {place for place, _ in places.values()}
    others = [name for j, name in enumerate(contents.names) if j not in used and name not in UNITS]
    changed = [f"{name} from {contents.names[place].strip()}" + (f" in {unit}" if factors[name] != 1.0 else "")
               for name, (place, unit) in places.items()
               if contents.names[place].strip() != name or factors[name] != 1.0]
    words = [*contents.read_as, *read_as]
    if not (words or changed or others):
        return []
    count = counted(len(contents.names), "column")
    parts = [f"read as {' and '.join(words)}, {count}, {len(used)} used" if words else f"{count}, {len(used)} used"]
    parts += [", ".join(map(one_line, changed))] if changed else []
    parts += [f"passed over: {_listed(others)}"] if others else []
    return ["; ".join(parts)]
