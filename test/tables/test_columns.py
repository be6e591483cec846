"""Files of a few lines by hand: units, names, delimiters, cells, date-times, and whole sentences about them."""

import math
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.tables.binary import mdf_contents, parquet_contents, write_mat, write_parquet
from tcc_sim.tables.chosen_columns import columns_in, is_table, named_columns
from tcc_sim.tables.measured_table import table_in
from tcc_sim.tables.text import HEAD, LONGEST_LINE, encoding_of
from tcc_sim.tables.unit_names import is_unit, unit_factor, units_for

DEGREE = "\N{DEGREE SIGN}"
UNITS = {
    "s": {"s": 1, "sec": 1, "Second": 1, "seconds": 1, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "\N{MICRO SIGN}s": 1e-6,
          "\N{GREEK SMALL LETTER MU}s": 1e-6, "ns": 1e-9, "min": 60, "h": 3600, "S": 1, " s ": 1, "Nm": None, "": None},
    "rad/s": {"rad/s": 1, "rad s-1": 1, "rad s^-1": 1, "rad/sec": 1, "Hz": 2 * math.pi, "rps": 2 * math.pi,
              "rev/s": 2 * math.pi, "U/s": 2 * math.pi, "deg/s": math.pi / 180, f"{DEGREE}/s": math.pi / 180,
              **dict.fromkeys(("1/min", "min-1", "min^-1", "min\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}", "/min",
               "U/min",
                               "r/min", "rev/min", "rpm", "RPM"), math.pi / 30), "rad": None},
    "rad": {"rad": 1, "mrad": 1e-3, "deg": math.pi / 180, DEGREE: math.pi / 180, "rev": 2 * math.pi, "rad/s": None},
    "N m": {"Nm": 1, "N m": 1, "N*m": 1, "N.m": 1, "N-m": 1, "N_m": 1, "N\N{MIDDLE DOT}m": 1, "N\N{DOT OPERATOR}m": 1,
            "nm": 1, "kNm": 1e3, "kN m": 1e3, "mNm": 1e-3, "MNm": 1e6, "MNM": None, "Ncm": 1e-2, "-": None,
            **dict.fromkeys(("lbf ft", "ft-lbf", "lb ft", "ft lb"), 0.45359237 * 9.80665 * 0.3048)},
    "Pa": {"Pa": 1, "hPa": 100, "kPa": 1e3, "KPA": 1e3, "MPa": 1e6, "mPa": 1e-3, "MPA": None, "bar": 1e5, "mbar": 100,
           "psi": 0.45359237 * 9.80665 / 0.0254**2, "N/m2": 1, "N/m^2": 1, "N/m\N{SUPERSCRIPT TWO}": 1, "N/mm2": 1e6},
    "": {"": 1, "-": 1, "1": 1, "%": 0.01, "s": None}}


@pytest.mark.parametrize("si", UNITS)
def test_factors_of_units_follow_from_their_definitions(si):
    factors = {unit: unit_factor(unit, si) for unit in UNITS[si]}
    assert factors == {unit: None if factor is None else pytest.approx(factor, rel=1e-13)
                       for unit, factor in UNITS[si].items()}
    assert all(unit_factor(unit, si) is not None for unit in units_for(si).split(", "))
    assert all(is_unit(unit) for unit, factor in UNITS[si].items() if factor is not None)
    assert not is_unit("bananas")


def read(path, text, **options):
    """Columns and notes of a text, without the file's name."""
    path.write_text(text) if isinstance(text, str) else path.write_bytes(text)
    result = table_in(path, **options)
    return ({name: values.tolist() for name, values in result.columns.items()},
            [note.removeprefix(f"{path.name}: ") for note in result.notes])


NAN = math.nan
AXES = "0,200\n0.1,250\n0.3,300\n"
READ = {"t": [0.0, 0.1, 0.3], "engine_torque": [200.0, 250.0, 300.0]}


@pytest.mark.parametrize(("text", "columns", "notes"), [
    ("t,engine_torque\n" + AXES, READ, []), ("# Bench 7\n# more words\nt,engine_torque\n" + AXES, READ, []),
    ("Bench 7\nt,engine_torque\n" + AXES, READ, ["read as 1 line before the names, 2 columns, 2 used"]),
    ("#t,engine_torque\n" + AXES, READ, []), ("% t, engine_torque\n" + AXES, READ, []),
    ("t|engine_torque\n" + AXES.replace(",", "|"), READ, ["read as bars, 2 columns, 2 used"]),
    ("t  engine_torque\n" + AXES.replace(",", "  "), READ, ["read as spaces, 2 columns, 2 used"]),
    ("t [s]   engine_torque [Nm]\n" + AXES.replace(",", "  "), READ, ["read as spaces, 2 columns, 2 used"]),
    ("t,engine_torque\n0,200\n\n# lost\n0.1,250\n  \n0.3,300\n", READ, []),
    ("t,engine_torque,\n0,200,\n0.1,250,\n0.3,300,\n", READ, []),
    ("t,engine_torque\n0,200,\n0.1,250\n0.3,300,\n", READ, []),
    ("t,n,engine_torque\n0,-,200\n0.1,nan,250\n0.3,n/a,300\n", READ, ["3 columns, 2 used; passed over: n"]),
    ("t/s,engine_torque / Nm\n" + AXES, READ, []),
    ("t [ms],engine_torque (kN m)\n0,.2\n100,.25\n300,.3\n", READ,
     ["2 columns, 2 used; t from t in ms, engine_torque from engine_torque in kN m"]),
    *((head + AXES, READ, notes) for head, notes in (
        ("t,engine_torque\ns,N m\n", []), ("t,engine_torque\n[s], (Nm)\n", []), ("t,engine_torque\ns,\n", []),
        ("# words\n\nt , engine_torque\n[s], (N*m)\n", []), ("t(s),engine_torque [Nm]\n", []))),
    ("t,engine_torque\ns,of the bench\nms,kN m\n0,.2\n100,.25\n300,.3\n", READ,
     ["2 columns, 2 used; t from t in ms, engine_torque from engine_torque in kN m"]),
    ("Time,Engine Torque\n" + AXES, READ, ["2 columns, 2 used; t from Time, engine_torque from Engine Torque"]),
    ("t,a,b,c,d,e,f,engine_torque\n0,1,1,1,1,1,1,200\n0.1,1,1,1,1,1,1,250\n0.3,1,1,1,1,1,1,300\n", READ,
     ["8 columns, 2 used; passed over: a, b, c, d, e, f"]),
    ("t,a,b,c,d,e,f,g,engine_torque\n0,1,1,1,1,1,1,1,200\n0.1,1,1,1,1,1,1,1,250\n0.3,1,1,1,1,1,1,1,300\n", READ,
     ["9 columns, 2 used; passed over: a, b, c, d, e, f and 1 more"]),
    ("t,friction_torque,engine_torque\n0,7,200\n0.1,7,250\n0.3,7,300\n", READ, []),
    # Rows and cells without values.
    ("t,engine_torque\n0,200\nnan,1\nna,2\n0.1,250\n0.2,\n0.3,300\n", READ,
     ["2 rows without a time left out", "1 row without values left out"]),
    ("t,engine_torque,slip_speed\n0,200,1\n0.1,250,\n0.3,300,inf\n", {**READ, "slip_speed": [1.0, NAN, NAN]},
     ["empty cells: 2 of 3 in slip_speed"]),
    ("t,engine_torque,slip_speed,tacho\n0,200,1,\n0.1,,,5\n", {
        "t": [0.0, 0.1], "engine_torque": [200.0, NAN], "slip_speed": [1.0, NAN], "tacho": [NAN, 5.0]},
     ["empty cells: 1 of 2 in engine_torque, 1 of 2 in slip_speed, 1 of 2 in tacho"]),
    ("t,engine_torque,tacho\n0,200,1\n0,200,2\n0.1,200,2\n0.1,200,2\n", {"t": [0.0, 0.05, 0.1],
     "engine_torque": [200.0] * 3, "tacho": [1.0, 2.0, 2.0]},
     ["1 row repeated time and values of the row before and were left out", "1 of 3 rows repeat the time of the row "
      "before, because it is written in steps of 0.1 s; even steps of 0.05 s replace them"]),
    # Clocks: by dates, or over midnight without them; a clock set back a little is no midnight.
    ("t,engine_torque\n2026-02-28 23:00:00.5,1\n2026-03-02T00:00:00.5Z,2\n", {"t": [0.0, 90000.0],
     "engine_torque": [1.0, 2.0]}, ["read as date-times from the first row, 2 columns, 2 used"]),
    ("t,engine_torque\n28.2.2026 23:00,1\n01.03.2026 0:30:00,2\n", {"t": [0.0, 5400.0],
     "engine_torque": [1.0, 2.0]}, ["read as date-times from the first row, 2 columns, 2 used"]),
    ("t;engine_torque\n11:00:00,5;1,5\n23:59:59,5;2\n00:00:01,25;3\n12:00:00;4\n00:30:00;5\n", {
        "t": [0.0, 46799.0, 46800.75, 48599.5, 89999.5], "engine_torque": [1.5, 2.0, 3.0, 5.0, 4.0]},
     ["read as semicolons and decimal comma and date-times from the first row, 2 columns, 2 used",
      "1 row came before an earlier one in time; the rows were sorted by time"]),
    ("t,engine_torque\n1700000000,1\n1700000001.5,2\n", {"t": [0.0, 1.5], "engine_torque": [1.0, 2.0]},
     ["times in s since 1970, counted from the first row"]),
    ("t,engine_torque\n1700000000000,1\n1700000001500,2\n", {"t": [0.0, 1.5], "engine_torque": [1.0, 2.0]},
     ["times in ms since 1970, counted from the first row"]),
    ("t,engine_torque\n1700000000000000,1\n1700000001500000,2\n", {"t": [0.0, 1.5], "engine_torque": [1.0, 2.0]},
     ["times in us since 1970, counted from the first row"]),
    ("t,engine_torque\n46000.5,1\n46000.5000115741,2\n46000.5000231482,3\n", {
        "t": [0.0, 1.000002, 2.000004], "engine_torque": [1.0, 2.0, 3.0]},
     ["times in days as Excel counts them, counted from the first row"]),
    ("t,engine_torque\n900000000,1\n900000001,2\n", {"t": [9e8, 900000001.0], "engine_torque": [1.0, 2.0]}, []),
    ("t,engine_torque\n4000000000,1\n4000000001,2\n", {"t": [0.0, 1.0], "engine_torque": [1.0, 2.0]},
     ["times in s since 1970, counted from the first row"]),
    ("t,engine_torque\n5000000000,1\n5000000001,2\n", {"t": [5e9, 5000000001.0], "engine_torque": [1.0, 2.0]}, [])])
def test_a_text_gives_its_numbers_and_says_how(tmp_path, text, columns, notes):
    result, said = read(tmp_path / "in.csv", text)
    assert {name: pytest.approx(values, nan_ok=True, abs=1e-9) for name, values in columns.items()} == result
    assert said == notes


CLEAN = "t,M_mot [Nm],engine_torque\n0,1,2\n0.1,2,3\n"


@pytest.mark.parametrize(("text", "columns", "why"), [
    (CLEAN, "engine_torque=M_mot", {"t": [0.0, 0.1], "engine_torque": [1.0, 2.0]}),
    (CLEAN, "engine_torque=M_mot:kNm", "{path}: column M_mot is in Nm by the file and in kNm by --columns; leave out "
     "one of them"), (CLEAN, "engine_torque=M_mot:N m", {"t": [0.0, 0.1], "engine_torque": [1.0, 2.0]}),
    (CLEAN, " t =t:ms", {"t": [0.0, 1e-4], "engine_torque": [2.0, 3.0]}),
    (CLEAN.replace("M_mot [Nm]", "n:rpm"), "engine_torque=n:rpm", {"t": [0.0, 0.1], "engine_torque": [1.0, 2.0]}),
    (CLEAN, "engine_torque=xyz", "{path}: there is no column xyz, which --columns names for engine_torque; the file "
     "has t, M_mot, engine_torque"),
    (CLEAN, "engine_torque=Mmot", "{path}: there is no column Mmot, which --columns names for engine_torque; did you "
     "mean M_mot?"),
    (CLEAN.replace("M_mot [Nm]", "t"), None, "{path} has the column t 2 times"),
    (CLEAN.replace("M_mot [Nm]", "T"), "slip_speed=T,t=t", {"t": [0.0, 0.1], "slip_speed": [1.0, 2.0],
                                                             "engine_torque": [2.0, 3.0]}),
    ("time,Time,engine_torque\n0,0,1\n1,1,2\n", None, "{path} has the column time 2 times"),
    ("t,engine_torque\ns,bananas\n0,1\n1,2\n", None, "{path}: column engine_torque is in bananas; engine_torque must "
     "be in "
     "N m or one of N m, kN m, lbf ft"),
    ("t,engine_torque [K]\n0,1\n1,2\n", None, "{path}: column engine_torque is in K; engine_torque must be in N m or "
     "one of N m, kN m, lbf ft"),
    ("x,engine_torque\n0,1\n1,2\n", None, "{path}: there is no column t; the file has x, and --columns t=COLUMN names "
     "one of them"), ("engine_torque,slip_speed\n0,1\n1,2\n", None, "{path}: there is no column t"),
    ("t,engine_torque\n,1\n,2\n", None, "{path}: column t has no times"),
    ("t,engine_torque\n0,1\n1,two\n", None, "{path}: line 3 has no number in column engine_torque: 'two'"),
    ("t;engine_torque\n0;1.5\n1;2,5\n", None, "{path}: line 2 has a decimal point and line 3 a decimal comma; a table "
     "must use one of them"),
    ("t;engine_torque\n0;1\n1;2,500.5\n", None, "{path}: line 3 has '2,500.5' in column engine_torque; write numbers "
     "without separators of thousands"),
    ("t;engine_torque\n0;1\n1;2,5,5\n", None, "{path}: line 3 has no number in column engine_torque: '2,5,5'"),
    ("t;engine_torque\n0;1\n1;2,x\n", None, "{path}: line 3 has no number in column engine_torque: '2,x'"),
    ("t,engine_torque\n2026-02-28 1:00:00,1\n2026-02-30 1:00:00,2\n", None,
     "{path}: line 3 has no date-time in column t: '2026-02-30 1:00:00'"),
    ("t,engine_torque,gear\n0,1,1\n1,2\n", None, {"t": [0.0, 1.0], "engine_torque": [1.0, 2.0]}),
    ("t,gear,engine_torque\n0,1,1\n1,2\n", None, "{path}: line 3 has 2 values; the first line names 3"),
    ("t,engine_torque\n0,1\n1,2,3\n", None, "{path}: line 3 has 3 values; the first line names 2; with a decimal "
     "comma, another sign must stand between the columns"),
    ("t;engine_torque\n0;1\n1;2;3\n", None, "{path}: line 3 has 3 values; the first line names 2"),
    ("a,b\nc,d\ns,Nm\n0,1\n1,2\n", None, "{path}: there is no column t; the file has c, d, and --columns t=COLUMN "
     "names one of them"),
    ("words\n", None, "{path}: no columns were recognised; the first line must have their names, such as slip_speed, "
     "t, and "
     "the next ones a number for each"), ("", None, "{path}: there is no column t in its first line; the file is "
     "empty"),
    ("1,2\n2,3\n", None, "{path}: no columns were recognised; the first line must have their names, such as "
     "slip_speed, t, and the next ones a number for each")])
def test_chosen_and_missing_columns(tmp_path, text, columns, why):
    path = tmp_path / "in.csv"
    if isinstance(why, dict):
        assert read(path, text, columns=columns)[0] == {name: pytest.approx(values) for name, values in why.items()}
        return
    with pytest.raises(InputError) as error:
        read(path, text, columns=columns)
    assert str(error.value) == why.format(path=path)


def channel(unit, conversion=None):
    return SimpleNamespace(unit=unit, conversion=None if conversion is None else SimpleNamespace(unit=conversion))


class Mdf:
    """Stands for asammdf's reader: two groups, each with its times in the first channel."""

    def __init__(self, path):
        if path.name == "broken.mf4":
            raise KeyError("it is broken")
        self.masters_db = {0: 0, 1: 0}
        self.channels_db = {"t": ((0, 0), (1, 0)), "slip": ((0, 1),), "torque": ((1, 1),), "twice": ((0, 2), (1, 2)),
                            "words": ((1, 3),), "time": ((0, 3),)}
        self.groups = [SimpleNamespace(channels=each) for each in (
            [channel("s"), channel("rad/s "), channel(""), channel("s")],
            [channel("s"), channel("", "Nm\0"), channel("x"), channel(None)])]

    def get(self, group, index):
        samples = {(0, 1): [1, 2, 3], (1, 1): [7.0, 8.0, 9.0], (1, 3): ["a", "b", "c"]}[group, index]
        bits = {(1, 1): [False, True, False], (0, 1): [True]}.get((group, index))
        return SimpleNamespace(samples=samples, timestamps=[[0.0, 0.1, 0.2], [0.1, 0.15, 0.2]][group],
                               invalidation_bits=bits)


def test_channels_of_an_mdf_file_share_their_times(tmp_path, monkeypatch):
    """With a stand-in for asammdf; a cell is empty where its channel has no sample, or one that is invalid."""
    package = ModuleType("asammdf")
    package.MDF, package.__spec__ = Mdf, ModuleSpec("asammdf", None)
    monkeypatch.setitem(sys.modules, "asammdf", package)
    contents = mdf_contents(tmp_path / "a.mf4")
    assert (contents.names, contents.units, contents.read_as, contents.hold) == (
        ["t", "slip", "torque", "twice", "words"], ["s", "rad/s", "Nm", "", ""], ["MDF"], {})
    columns, said = contents.numbers([0, 2, 1], 0, 4)
    assert said == []
    np.testing.assert_array_equal(columns, [[0.0, 0.1, 0.15, 0.2], [NAN, 7.0, NAN, 9.0], [1.0, 2.0, NAN, 3.0]])
    np.testing.assert_array_equal(contents.numbers([1], None, 3)[0], [[1.0, 2.0, 3.0]])
    for chosen, most, why in (([0, 2, 1], 3, "it has more than 3 rows; it must have at most 3"),
                              ([0], 9, "no channel was chosen; --columns NAME=CHANNEL names one"),
                              ([0, 3], 9, "2 groups have a channel twice; export one of them"),
                              ([4], 9, "channel words holds no numbers")):
        with pytest.raises(InputError) as error:
            contents.numbers(chosen, 0, most)
        assert str(error.value) == f"{tmp_path / 'a.mf4'}: {why}"
    with pytest.raises(InputError, match=r"broken.mf4 cannot be read as an MDF file: 'it is broken'$"):
        mdf_contents(tmp_path / "broken.mf4")


def test_columns_of_another_list_of_names(tmp_path):
    """As a friction table has them: without times, in the order of the file, and any unit for None."""
    path, known = tmp_path / "mu.csv", {"speed": "rad/s", "coefficient": "", "load": None}
    path.write_text("coefficient [%],speed [Hz],load [kip]\n13,1,\n12,2,7\n")
    values, notes, hold = columns_in(path, known, ("speed", "coefficient"), 2)
    assert {name: column.tolist() for name, column in values.items()} == {
        "coefficient": [0.13, 0.12], "speed": [2.0 * math.pi, 4.0 * math.pi], "load": [pytest.approx(NAN,
         nan_ok=True), 7.0]}
    assert (notes, hold) == (["3 columns, 3 used; speed from speed in Hz, coefficient from coefficient in %"], {})
    for needed, most, why in ((("slope",), 2, "there is no column slope"), (("speed",), 1, "it has more than 1 rows; "
     "it must have at most 1")):
        with pytest.raises(InputError) as error:
            columns_in(path, known, needed, most)
        assert str(error.value) == f"{path}: {why}"
    assert named_columns({"load": "F:kN"}, known) == {"load": "F:kN"}
    assert named_columns(None) == {}
    with pytest.raises(InputError, match=r"^--columns names 'F'; it takes NAME"):
        named_columns("F=load", known)
    with pytest.raises(InputError, match=r"^--columns gives load twice$"):
        named_columns("load=a,load=b", known)
    with pytest.raises(InputError, match=r"^--columns names 'load' without =COLUMN; it takes NAME=COLUMN\[:UNIT\],... "
     r"with "
                       "the names speed, coefficient, load$"):
        named_columns("load", known)


@pytest.mark.parametrize(("content", "encoding"), [
    (b"t,x\n", "utf-8-sig"), ("\ufefft,x\n".encode(), "utf-8-sig"), ("t,x\n".encode("utf-16"), "utf-16"),
    (b"\xfe\xff" + "t".encode("utf-16-be"), "utf-16"), ("t,x\n1,2".encode("utf-16-le"), "utf-16-le"),
    ("t,x\n1,2".encode("utf-16-be"), "utf-16-be"), ("t,\N{DEGREE SIGN}\n1,2\n".encode("cp1252"), "cp1252"),
    ("t,\N{DEGREE SIGN}\n1,2\n".encode(), "utf-8-sig"), (b"a" * 65534 + "\N{DEGREE SIGN}\n".encode(), "utf-8-sig"),
    (b"a" * 65535 + "\N{DEGREE SIGN}\n".encode(), "utf-8-sig"), (b"a\tb\x0b\x0c\r\n", "utf-8-sig"),
    (b"a\x08b", None), (b"a\x0eb", None), (b"a\x1fb", None), (bytes(20), None)])
def test_the_encoding_is_that_of_the_first_bytes(tmp_path, content, encoding):
    path = tmp_path / "in.dat"
    path.write_bytes(content)
    if encoding is None:
        with pytest.raises(InputError, match=r"not a text file, although its name ends in .dat$"):
            encoding_of(path)
    else:
        assert encoding_of(path) == encoding


def test_names_may_stand_behind_long_comments_but_not_in_long_lines(tmp_path):
    path = tmp_path / "in.csv"
    for count in (0, HEAD - 2, HEAD, 3 * HEAD):
        path.write_text("# hold: engine_torque next, slip_speed odd\n" + "# x\n" * count + "t,engine_torque\n" + AXES)
        assert (table_in(path).hold, table_in(path).t.tolist()) == ({"engine_torque": "next"}, READ["t"])
    for more, why in ((0, None), (1, f"{path}: it has a line of more than {LONGEST_LINE} characters")):
        path.write_text("t,engine_torque\n" + AXES + "#" * (LONGEST_LINE - 1 + more) + "\n")
        if why is None:
            assert table_in(path).t.tolist() == READ["t"]
        else:
            with pytest.raises(InputError) as error:
                table_in(path)
            assert str(error.value) == why


def test_tables_are_known_by_their_names(tmp_path):
    assert [is_table(tmp_path / f"x{suffix}") for suffix in (".csv", ".TXT", ".pq", ".mf4", ".mcap", "")] == [
        True, True, True, True, False, False]
    with pytest.raises(InputError, match=r"x\.h5 is an HDF5 file, which is not read; save it as \.csv, \.txt, \.tsv, "
     r"\.dat, "
                       r"\.asc, \.parquet, \.pq, \.mat, \.mf4, \.mdf$"):
        is_table(tmp_path / "x.h5")


@pytest.mark.parametrize("write", [write_parquet, write_mat])
def test_binary_tables_keep_units_holds_and_numbers(tmp_path, write):
    path = tmp_path / ("x.parquet" if write is write_parquet else "x.mat")
    if write is write_parquet:
        pytest.importorskip("pyarrow")
    write(path, {"t": np.array([0.0, 100.0]), "engine_torque": np.array([0.2, np.nan]), "tacho": np.array([1, 2])},
          {"t": "ms", "engine_torque": "kN m"}, {"engine_torque": "next"}, {"scene": "a: 1\n"})
    result = table_in(path)
    assert {name: values.tolist() for name, values in result.columns.items()} == {
        "t": [0.0, 0.1], "engine_torque": [200.0, pytest.approx(NAN, nan_ok=True)], "tacho": [1.0, 2.0]}
    how = "Parquet" if write is write_parquet else "a MATLAB file"
    assert result.hold == {"engine_torque": "next"}
    assert [note.partition(": ")[2] for note in result.notes] == [
        f"read as {how}, 3 columns, 3 used; t from t in ms, engine_torque from engine_torque in kN m",
        "empty cells: 1 of 2 in engine_torque"]
    for most, why in ((2, None), (1, f"{path}: it has more than 1 rows; it must have at most 1")):
        if why is None:
            table_in(path, most=most)
        else:
            with pytest.raises(InputError) as error:
                table_in(path, most=most)
            assert str(error.value) == why


def test_dates_durations_and_texts_of_parquet(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "x.parquet"
    for unit, per_second in (("s", 1), ("ms", 1000), ("us", 10**6), ("ns", 10**9)):
        ticks = arrow.array([None, 3 * per_second, 5 * per_second])
        parquet.write_table(arrow.table({"a": ticks.cast(arrow.timestamp(unit)), "b": ticks.cast(arrow.duration(unit)),
                                         "c": ["x", "y", "z"], "d": [1, 2, 3]}), path)
        contents = parquet_contents(path)
        values, notes = contents.numbers([0, 1, 3], 0, 3)
        np.testing.assert_array_equal(values, [[NAN, 0.0, 2.0], [NAN, 0.0, 2.0], [1.0, 2.0, 3.0]])
        assert (contents.names, contents.units, contents.read_as, contents.hold, notes) == (
            ["a", "b", "c", "d"], [""] * 4, ["Parquet"], {}, [])
    with pytest.raises(InputError, match="column c holds string, no numbers"):
        contents.numbers([2], None, 3)


def test_vectors_of_matlab_structures(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "x.mat"
    savemat(path, {"one": {"t": [0.0, 1.0, 2.0], "slip_speed": [1.0, 2.0, 3.0], "flag": np.array([True, False, True])},
                   "two": {"t": [5.0, 6.0]}, "z": [1.0 + 1j, 2.0], "engine_torque": [7, 8, 9], "text": "abc"})
    result = table_in(path)
    assert {name: values.tolist() for name, values in result.columns.items()} == {
        "t": [0.0, 1.0, 2.0], "slip_speed": [1.0, 2.0, 3.0], "engine_torque": [7.0, 8.0, 9.0]}
    assert result.notes == ("x.mat: read as a MATLAB file, 5 columns, 3 used; passed over: flag, two.t",)
    with pytest.raises(InputError) as error:
        table_in(path, columns="tacho=two.t")
    assert str(error.value) == f"{path}: two.t has 2 values; the times have 3"
    savemat(path, {"a": 1.0, "b": np.eye(2), "units": {"a": "s"}})
    with pytest.raises(InputError, match=r"has no vectors of numbers; a timetable must be saved as vectors$"):
        table_in(path)
