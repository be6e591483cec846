"""Odd cells and rows in short tables, read cell by cell, and in long ones, parsed by pyarrow: one answer for both."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.tables.chosen_columns import COLUMNS, columns_in

NAN = math.nan
NUMBERS = {"1.5": 1.5, "-0.0": -0.0, "+7": 7.0, ".5": 0.5, "5.": 5.0, "1e3": 1e3, "1.25E+03": 1250.0, "1E-05": 1e-5,
           " 2.5 ": 2.5, "0.1234567890123456789": 0.12345678901234568, "4.9e-324": 5e-324, "1.7976931348623157e308":
           1.7976931348623157e308, "9007199254740993": 9007199254740992.0, "1_000": 1000.0, "1e400": NAN, "": NAN,
           " ": NAN, "-": NAN, "nan": NAN, "NaN": NAN, "N/A": NAN, "NULL": NAN, "none": NAN, "inf": NAN, "-Inf": NAN,
           "Infinity": NAN}
"""A cell with a decimal point, and the double nearest to it; NaN for a cell without a finite number."""
LONG_CELLS = ["1_000", "", "-Inf", "1.25E+03", " ", "-", "NaN", "NULL", "1e400"]
"""Cells of long tables. One table without quotes and one with quotes have all cells, the others the first three."""
NO_NUMBERS = ["two", "0x10", "1d5", "1.2.3", "1 2", "1,234.5", "1.234,5"]
LONG, SHORT, WIDE = 3300, 12, 300 * "x"
"""Rows; the long table has more than a megabyte, most of it in a column that is not read."""


def read(path, most=10**6):
    """Columns of a table, and how it was read."""
    columns, notes, _ = columns_in(path, COLUMNS, ("t", "engine_torque"), most)
    return columns, " ".join(notes)


@cache
def body(count, delimiter, comma, quote):
    """All but the last row of a table of two columns after a text column."""
    remark = ("lost #7" if delimiter == "," else "lost, #7") + WIDE
    rows = [delimiter.join([f"{quote}{0.001 * k:.3f}{quote}", remark, f"{quote}{k + 0.5:.15f}{quote}"])
            for k in range(count)]
    text = "\n".join([delimiter.join(["t", "remark", "engine_torque"]), *rows])
    return text.replace(".", ",") if comma else text


@pytest.fixture
def lines(tmp_path):
    """Function that writes the table with a last row of its own."""
    def write(count, delimiter, comma, last, quote=""):
        path = tmp_path / "x.csv"
        path.write_text(f"{body(count, delimiter, comma, quote)}\n{last}\n")
        return path
    return write


@pytest.mark.parametrize("count", [SHORT, LONG])
@pytest.mark.parametrize(("delimiter", "comma", "quote"), [
    (",", False, ""), (";", False, ""), (";", True, ""), ("\t", True, ""), ("|", False, '"'), (";", True, '"'),
    (",", True, '"')])
def test_a_cell_has_one_value_in_every_table(lines, count, delimiter, comma, quote):
    for cell, value in NUMBERS.items():
        if count == LONG and cell not in LONG_CELLS[: None if (delimiter, quote) in ((",", ""), (";", '"')) else 3]:
            continue
        stamp = f"{quote}{0.001 * count:.3f}{quote}"
        last = delimiter.join([stamp, "", f"{quote}{cell}{quote}"])
        path = lines(count, delimiter, comma, last.replace(".", ",") if comma else last, quote)
        found = read(path)[0]["engine_torque"]
        expected = np.append(np.arange(count) + 0.5, value)
        assert found.tobytes() == expected.tobytes(), cell


@pytest.mark.parametrize(("count", "delimiter", "comma"), [
    (SHORT, ";", False), (SHORT, ";", True), (SHORT, "\t", True), (LONG, ";", False), (LONG, "\t", True)])
def test_a_wrong_cell_or_row_is_refused_by_its_line(lines, count, delimiter, comma):
    for cell in NO_NUMBERS if count == SHORT else NO_NUMBERS[-3:]:
        if comma and cell == "1.2.3":
            continue
        path = lines(count, delimiter, comma, delimiter.join([str(count), "", cell]))
        with pytest.raises(InputError) as error:
            read(path)
        assert f"line {count + 2} " in str(error.value)
    for last in (str(count), delimiter.join([str(count), "", "1", "2"])):
        with pytest.raises(InputError) as error:
            read(lines(count, delimiter, comma, last))
        assert f"line {count + 2} " in str(error.value)
    other = "1.5" if comma else "1,5"
    with pytest.raises(InputError) as error:
        read(lines(count, delimiter, comma, delimiter.join([str(count), "", other])))
    assert all(word in str(error.value) for word in (f"line {count + 2} ", "line 2 ", "point", "comma"))


@pytest.mark.parametrize("count", [SHORT, LONG])
def test_rows_and_times_of_other_kinds(lines, count):
    for last, kept in ((f"# {count};;7", 0), (f"// {count};;7", 0), ("", 0), ("   ", 0), (f"{count};;7;", 1)):
        assert len(read(lines(count, ";", True, last))[0]["t"]) == count + kept
    assert "comma" in read(lines(count, ";", True, ""))[1]
    path = lines(count, ";", False, "")
    with pytest.raises(InputError) as error:
        read(path, count - 1)
    assert str(count - 1) in str(error.value)
    rows = path.read_text().splitlines()
    for clock in ("{0:02d}:{1:02d}:{2:06.3f}", "2026-02-28 {0:02d}:{1:02d}:{2:06.3f}",
                  "28.2.2026 {0:02d}:{1:02d}:{2:06.3f}Z"):
        t = [0.001 * k + 82_000.0 for k in range(count)]
        stamps = [clock.format(int(x // 3600), int(x // 60 % 60), x % 60) for x in t]
        path.write_text("\n".join([rows[0], *(stamp + row[row.index(";"):] for stamp, row in zip(stamps, rows[1:]))]))
        found = read(path)[0]
        assert found["t"] == pytest.approx(0.001 * np.arange(count), abs=1e-9)
        assert found["engine_torque"].tolist() == (np.arange(count) + 0.5).tolist()
    # A comment in a column that is not read hides its row, wherever it is.
    path.write_text("remark,t,engine_torque\n" + "".join(
        f"{'#' * (k % 3 == 1)}{WIDE},{k},{k + 0.5:.15f}\n" for k in range(count)))
    assert read(path)[0]["t"].tolist() == [k for k in range(count) if k % 3 != 1]
