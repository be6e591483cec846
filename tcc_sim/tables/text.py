"""Tables in text: encoding, delimiter, decimal sign, line of names, line of units, date-times and empty cells."""

from __future__ import annotations

import csv
import math
import re
from array import array
from codecs import getincrementaldecoder
from collections.abc import Iterator, Sequence
from datetime import date
from functools import partial
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from tcc_sim.errors import InputError, counted, one_line
from tcc_sim.tables.file_columns import FileColumns, is_unit
from tcc_sim.trajectory import Floats

DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", " ": "spaces"}
"""Delimiters that are recognised, the first of equally good ones first, with their names."""
HEAD = 200
"""Lines, without comments, in which delimiter and line of names are looked for."""
LONGEST_LINE = 1 << 16
_START = 1 << 16
"""Bytes that show the encoding."""
_CONTROLS = bytes([*range(9), *range(14, 32)])  # No text has these bytes.
_LARGE = 1 << 20
"""Bytes from which the import of pyarrow takes less time than it saves."""
_ARROW = {"utf-8-sig": "utf8", "utf-8": "utf8", "cp1252": "utf8"}
"""Encodings in which a number has the bytes of another one that pyarrow reads without a conversion."""
_EMPTY = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "nat", "inf", "-inf", "+inf"}
"""Cells without a value, in lower case."""
_COMMENTS = ("#", "%", "//")
_HOLD, _SAID = "hold: ", re.compile(r"(\w+) (\w+)")
_IN_BRACKETS = re.compile(r"(.*?\S)\s*[\[(]\s*(.*?)\s*[\])]")
_AFTER_SLASH = re.compile(r"(\w+) ?/ ?(\S.*)")
_DATE = r"(?:(?P<y>\d{4})[-/.](?P<m>\d\d)[-/.](?P<d>\d\d)|(?P<D>\d\d?)\.(?P<M>\d\d?)\.(?P<Y>\d{4}))[T ]+"
_STAMP = re.compile(rf"(?:{_DATE})?(?P<h>\d\d?):(?P<min>\d\d)(?::(?P<s>\d\d(?:[.,]\d+)?))?\s*(?:Z|UTC|[+-]\d\d:?\d\d)?")


class _Layout(NamedTuple):
    """Encoding, delimiter, names, units, number of lines before the data, and the lines before the names."""

    encoding: str
    delimiter: str
    names: list[str]
    units: list[str]
    skipped: int
    preamble: int


class _Numbers:
    """Reader of cells: it notes which decimal signs it meets, the first day, and midnights of times without a day."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.points = self.commas = 0
        self.first_day: int | None = None
        self.midnights, self.clock = 0, 0.0

    def read(self, text: str, line: int, name: str) -> float:
        """Return the number in a cell, NaN for an empty one; InputError for any other text, and for both decimal signs.
        """
        text = text.strip()
        try:
            value = float(text)
        except ValueError:
            if text.lower() in _EMPTY:
                return math.nan
            try:
                value = float(text if "." in text else text.replace(",", ".", 1))
            except ValueError:
                thousands = "," in text and "." in text and not re.sub(r"[\d.,+-]", "", text)
                raise InputError(
                    f"{self.path}: line {line} has {text!r} in column {one_line(name)}; write numbers without "
                    "separators of thousands" if thousands else
                    f"{self.path}: line {line} has no number in column {one_line(name)}: {one_line(text[:40])!r}"
                ) from None
            self.commas = self.commas or line
        if not self.points and "." in text:
            self.points = line
        if self.points and self.commas:
            raise InputError(f"{self.path}: line {self.points} has a decimal point and line {self.commas} a decimal "
                             "comma; a table must use one of them")
        return value if math.isfinite(value) else math.nan

    def stamp(self, text: str, line: int, name: str) -> float:
        """Return a date-time in seconds from midnight of the first day, or a number."""
        match = _STAMP.fullmatch(text.strip())
        if match is None:
            return self.read(text, line, name)
        part = match.groupdict()
        day = 0
        if part["y"] or part["Y"]:
            try:
                day = date(*(int(part[a] or part[b]) for a, b in (("y", "Y"), ("m", "M"), ("d", "D")))).toordinal()
            except ValueError:
                raise InputError(f"{self.path}: line {line} has no date-time in column {name}: {text!r}") from None
        if self.first_day is None:
            self.first_day = day
        clock = 3600.0 * int(part["h"]) + 60.0 * int(part["min"]) + float((part["s"] or "0").replace(",", "."))
        if not day and clock < self.clock - 43200.0:
            self.midnights += 1
        self.clock = clock
        return 86400.0 * (day - self.first_day + self.midnights) + clock


def text_contents(path: Path, known: Sequence[str]) -> FileColumns:
    """Return names and units of a table in text; its numbers are read when they are asked for. `known` names show which
    line is that of the names. Raise InputError if the columns cannot be recognised.
    """
    layout, hold = _layout_of(path, {name.lower() for name in known})
    notes = []
    if layout.delimiter != ",":
        notes.append(DELIMITERS[layout.delimiter])
    if layout.encoding not in ("utf-8-sig", "utf-8"):
        notes.append(layout.encoding.upper())
    if layout.preamble:
        notes.append(f"{counted(layout.preamble, 'line')} before the names")
    return FileColumns(layout.names, layout.units, partial(_numbers_of, path, layout), notes, hold)


def encoding_of(path: Path) -> str:
    """Return the encoding of a text file, by its first bytes; InputError if it is not text."""
    with path.open("rb") as stream:
        head = stream.read(_START)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    zeros = [head[first:400:2].count(0) * 2 > len(head[first:400:2]) for first in (0, 1)]
    if zeros[0] is not zeros[1]:
        return "utf-16-be" if zeros[0] else "utf-16-le"
    if head != head.translate(None, _CONTROLS):
        raise InputError(f"{path}: not a text file, although its name ends in {path.suffix}")
    try:
        getincrementaldecoder("utf-8")().decode(head, final=len(head) < _START)   # The last character may be cut.
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _lines(path: Path, stream: TextIO) -> Iterator[str]:
    """Iterate over the lines of a file, each of bounded length."""
    while line := stream.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise InputError(f"{path}: it has a line of more than {LONGEST_LINE} characters")
        yield line


def _cells(lines: Iterator[str] | list[str], delimiter: str) -> Iterator[list[str]]:
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=True)


def _kind_of_cell(cell: str) -> str:
    """Return n for a number or a date-time, e for an empty cell, t for other text."""
    text = cell.strip()
    if text.lower() in _EMPTY:
        return "e"
    try:
        float(text if "." in text else text.replace(",", "."))
    except ValueError:
        return "n" if _STAMP.fullmatch(text) else "t"
    return "n"


def _layout_of(path: Path, known: set[str]) -> tuple[_Layout, dict[str, str]]:
    """Return the layout of a file, and the holds that its comments state."""
    encoding = encoding_of(path)
    hold: dict[str, str] = {}
    lines, left = list[str](), HEAD
    with path.open(newline="", encoding=encoding, errors="replace") as stream:
        for line in _lines(path, stream):
            lines.append(line)
            left -= not line.startswith(_COMMENTS)   # A scene stands before the names.
            if not left:
                break
    for line in lines:
        text = line.strip().strip(',;"').lstrip("# ")
        if line.lstrip('"').startswith("#") and text.startswith(_HOLD):
            hold.update(_SAID.findall(text))
    best: tuple[float, int, _Layout] | None = None
    for delimiter in DELIMITERS:
        layout = _with_delimiter(lines, encoding, delimiter, known)
        if layout is not None and (best is None or layout[:2] > best[:2]):
            best = layout
    if best is None:
        names = ", ".join(sorted(known & {"t", "slip_speed", "coefficient"}))
        raise InputError(f"{path}: no columns were recognised; the first line must have their names, such as {names}, "
                         "and the next ones a number for each" if lines else
                         f"{path}: there is no column {names.split(', ')[-1]} in its first line; the file is empty")
    return best[2], hold


def _with_delimiter(lines: list[str], encoding: str, delimiter: str,
                    known: set[str]) -> tuple[float, int, _Layout] | None:
    """Return how well a delimiter divides the first lines into columns, and the layout by it; None if it does not."""
    rows = [next(_cells([line], delimiter), []) for line in lines]
    comment = [line.lstrip('" ').startswith(_COMMENTS) for line in lines]
    filled = [k for k, row in enumerate(rows) if len(row) > 1 and not comment[k] and any(map(str.strip, row))]
    if not filled:
        return None
    tail = filled[-max(1, len(filled) // 3):]
    width = max((len(rows[k]) for k in tail), key=[len(rows[k]) for k in tail].count)
    kinds = [[_kind_of_cell(cell) for cell in rows[k]] for k in tail if len(rows[k]) == width]
    numeric = [j for j in range(width) if sum(row[j] != "t" for row in kinds) * 2 > len(kinds)
               and any(row[j] == "n" for row in kinds)]
    if not numeric:
        return None
    start = next((k for k in filled if abs(len(rows[k]) - width) <= 1 and all(
        j < len(rows[k]) and _kind_of_cell(rows[k][j]) != "t" for j in numeric)
        and any(_kind_of_cell(rows[k][j]) == "n" for j in numeric)), None)
    if start is None:
        return None
    head = _names_before(lines, rows, comment, start, width, delimiter, known)
    if head is None:
        return None
    at, names, units, start = head
    share = sum(row.count("n") + row.count("e") for row in kinds) / sum(map(len, kinds))
    before = sum(1 for k in range(at) if not comment[k] and any(map(str.strip, rows[k])))
    return share, len(numeric), _Layout(encoding, delimiter, names, units, start, before)


def _names_before(lines: list[str], rows: list[list[str]], comment: list[bool], start: int, width: int,
                  delimiter: str, known: set[str]) -> tuple[int, list[str], list[str], int] | None:
    """Return the line, the names and the units of the columns, and the first line of the data; None without names."""
    above: list[tuple[int, list[str]]] = []
    for k in range(start - 1, -1, -1):
        text = lines[k].strip()
        if not text or (comment[k] and above):
            continue
        cells = next(_cells([text.lstrip("#%/ ")], delimiter), []) if comment[k] else rows[k]
        if delimiter == " " and len(cells) != width:
            cells = re.split(r"\s{2,}|\t", text)
        cells = [cell.strip() for cell in cells]
        while len(cells) > 1 and not cells[-1] and len(cells) > width - 1:
            cells.pop()
        if abs(len(cells) - width) > 1 or len(above) == 3:
            break
        above.append((k, cells))
    if not above:
        return None
    above.reverse()
    place = next((i for i, (_, cells) in enumerate(above)
                  if known & {_parted(cell)[0].lower() for cell in cells}), max(len(above) - 2, 0))
    at, cells = above[place]
    parted = [_parted(cell) for cell in cells]
    names, units = [name for name, _ in parted], [unit for _, unit in parted]
    for line, below in above[place + 1:]:
        if any(_kind_of_cell(cell) == "n" and cell != "1" for cell in below):
            return at, names, units, line
        shown = [cell.strip("[]() ") for cell in below]
        if sum(map(is_unit, shown)) * 2 > len(shown) or len(above) == place + 2:
            units = [unit or unit_below for unit, unit_below in zip([*shown, *[""] * len(names)], units)]
            break
    return at, names, units, start


def _parted(text: str) -> tuple[str, str]:
    """Return the name and the unit of a column's head: name [unit], name (unit) or name/unit."""
    match = _IN_BRACKETS.fullmatch(text.strip()) or _AFTER_SLASH.fullmatch(text.strip())
    return (match[1].strip(), match[2].strip()) if match else (text.strip(), "")


def _numbers_of(path: Path, layout: _Layout, chosen: Sequence[int], time: int | None,
                most: int) -> tuple[list[Floats], list[str]]:
    """Return the columns of these numbers, NaN for empty cells, and sentences on how they were read."""
    columns, reader = _parsed(path, layout, chosen, time, most) or _read(path, layout, chosen, time, most)
    notes = ["decimal comma"] if reader.commas else []
    if reader.first_day is not None and time is not None:
        notes.append("date-times from the first row")
        at = list(chosen).index(time)
        dated = columns[at][np.isfinite(columns[at])]
        columns[at] -= dated[0] if len(dated) else 0.0
    return columns, notes


def _parsed(path: Path, layout: _Layout, chosen: Sequence[int], time: int | None,
            most: int) -> tuple[list[Floats], _Numbers] | None:
    """Return what `_read` returns, parsed by pyarrow if it is installed; None where a row or a cell needs `_read`.

    300 000 rows of five columns take 0.1 s of processor time here, and 1.3 to 2.8 s in `_read`.
    """
    if path.stat().st_size < _LARGE or find_spec("pyarrow") is None:
        return None
    import pyarrow
    from pyarrow import csv as arrow

    with path.open(newline="", encoding=layout.encoding, errors="replace") as stream:
        dated = ":" in next(islice(stream, layout.skipped, None), "")
    texts = [time] if dated and time is not None else []
    texts += [0] if 0 not in chosen else []  # A comment may begin in this column.
    kinds = {str(j): pyarrow.string() if j in texts else pyarrow.float64() for j in (*chosen, *texts)}
    for point in (".", ","):
        reader = _Numbers(path)
        try:
            table = arrow.read_csv(
                path, arrow.ReadOptions(
                    column_names=[str(j) for j in range(len(layout.names))], skip_rows=layout.skipped,
                    block_size=LONGEST_LINE, encoding=_ARROW.get(layout.encoding, layout.encoding)),
                arrow.ParseOptions(delimiter=layout.delimiter, newlines_in_values=True),
                arrow.ConvertOptions(column_types=kinds, include_columns=[*kinds], decimal_point=point,
                                     check_utf8=False, null_values=[form(cell) for cell in _EMPTY
                                                                    for form in (str.lower, str.upper, str.title)]))
            columns = [np.array([reader.stamp(cell, 0, "") for cell in table[str(j)].to_pylist()]) if j in texts else
                       table[str(j)].to_numpy().copy() for j in chosen]
        except (pyarrow.ArrowException, ValueError, InputError):
            continue
        reader.commas |= point == ","
        if table.num_rows > most or (reader.commas and reader.points) or (0 not in chosen and any(
                cell.startswith(_COMMENTS) for cell in table["0"].to_pylist())):
            return None
        for column in columns:
            column[~np.isfinite(column)] = np.nan
        return columns, reader
    return None


def _read(path: Path, layout: _Layout, chosen: Sequence[int], time: int | None,
          most: int) -> tuple[list[Floats], _Numbers]:
    """Return the columns of these numbers, read cell by cell, and the reader; raise InputError for a wrong line."""
    numbers = [array("d") for _ in chosen]
    reader, count, width = _Numbers(path), 0, len(layout.names)
    reads = [(j, column, reader.stamp if j == time else reader.read, layout.names[j])
             for j, column in zip(chosen, numbers)]
    with path.open(newline="", encoding=layout.encoding, errors="replace") as stream:
        lines = islice(_lines(path, stream), layout.skipped, None)
        for number, row in enumerate(_cells(lines, layout.delimiter), layout.skipped + 1):
            if not row or (len(row) == 1 and not row[0].strip()) or row[0].startswith(_COMMENTS):
                continue
            if count >= most:
                raise InputError(f"{path}: it has more than {most} rows; it must have at most {most}")
            if len(row) != width and not (len(row) == width + 1 and not row[-1].strip()):
                if len(row) == width - 1 and width - 1 not in chosen:
                    row = [*row, ""]
                else:
                    raise InputError(
                        f"{path}: line {number} has {len(row)} values; the first line names {width}"
                        + ("; with a decimal comma, another sign must stand between the columns"
                           if layout.delimiter == "," and len(row) > width else ""))
            count += 1
            for j, column, read, name in reads:
                column.append(read(row[j], number, name))
    return [np.array(column) for column in numbers], reader
