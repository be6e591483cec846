"""Files of a few lines by hand: units, names, delimiters, empty cells, date-times, and the notes on them."""

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.tables.binary import write_mat, write_parquet
from tcc_sim.tables.chosen_columns import columns_in, is_table
from tcc_sim.tables.file_columns import is_unit, unit_factor, units_for
from tcc_sim.tables.measured_table import table_in
from tcc_sim.tables.text import HEAD, LONGEST_LINE

DEGREE = "\N{DEGREE SIGN}"
UNITS = {
    "s": {"s": 1, "sec": 1, "Second": 1, "seconds": 1, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "\N{MICRO SIGN}s": 1e-6,
          "\N{GREEK SMALL LETTER MU}s": 1e-6, "ns": 1e-9, "min": 60, "h": 3600, "S": 1, " s ": 1, "Nm": None, "": None},
    "rad/s": {"rad/s": 1, "rad s-1": 1, "rad s^-1": 1, "rad/sec": 1, "Hz": 2 * math.pi, "rps": 2 * math.pi,
              "rev/s": 2 * math.pi, "U/s": 2 * math.pi, "deg/s": math.pi / 180, f"{DEGREE}/s": math.pi / 180,
              **dict.fromkeys(("1/min", "min-1", "min^-1", "min\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}", "/min",
                               "U/min", "r/min", "rev/min", "rpm", "RPM"), math.pi / 30), "rad": None},
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
    """Columns of a text, and the notes on it."""
    path.write_text(text) if isinstance(text, str) else path.write_bytes(text)
    result = table_in(path, **options)
    return {name: values.tolist() for name, values in result.columns.items()}, " ".join(result.notes)


NAN = math.nan
AXES = "0,200\n0.1,250\n0.3,300\n"
READ = {"t": [0.0, 0.1, 0.3], "engine_torque": [200.0, 250.0, 300.0]}
SCALED = ["t from t in ms", "engine_torque from engine_torque in kN m"]


def torques(t, values):
    return {"t": t, "engine_torque": values}


@pytest.mark.parametrize(("text", "columns", "words"), [
    *((text, READ, []) for text in (
        "t,engine_torque\n" + AXES, "# Bench 7\n# more words\nt,engine_torque\n" + AXES, "#t,engine_torque\n" + AXES,
        "% t, engine_torque\n" + AXES, "t,engine_torque\n0,200\n\n# lost\n0.1,250\n  \n0.3,300\n",
        "t,engine_torque,\n0,200,\n0.1,250,\n0.3,300,\n", "t,engine_torque\n0,200,\n0.1,250\n0.3,300,\n",
        "t/s,engine_torque / Nm\n" + AXES, "t,engine_torque\ns,N m\n" + AXES, "t,engine_torque\n[s], (Nm)\n" + AXES,
        "t,engine_torque\ns,\n" + AXES, "# words\n\nt , engine_torque\n[s], (N*m)\n" + AXES,
        "t(s),engine_torque [Nm]\n" + AXES, "t,friction_torque,engine_torque\n0,7,200\n0.1,7,250\n0.3,7,300\n")),
    ("Bench 7\nt,engine_torque\n" + AXES, READ, ["1 line before"]),
    ("t|engine_torque\n" + AXES.replace(",", "|"), READ, ["bars"]),
    ("t  engine_torque\n" + AXES.replace(",", "  "), READ, ["spaces"]),
    ("t [s]   engine_torque [Nm]\n" + AXES.replace(",", "  "), READ, ["spaces"]),
    ("t,n,engine_torque\n0,-,200\n0.1,nan,250\n0.3,n/a,300\n", READ, ["passed over: n"]),
    ("t [ms],engine_torque (kN m)\n0,.2\n100,.25\n300,.3\n", READ, SCALED),
    ("t,engine_torque\ns,of the bench\nms,kN m\n0,.2\n100,.25\n300,.3\n", READ, SCALED),
    ("Time,Engine Torque\n" + AXES, READ, ["t from Time", "engine_torque from Engine Torque"]),
    ("t,a,b,c,d,e,f,g,engine_torque\n" + AXES.replace(",", ",1,1,1,1,1,1,1,"), READ, ["9 columns", "d, e, f and 1"]),
    # Rows and cells without values.
    ("t,engine_torque\n0,200\nnan,1\nna,2\n0.1,250\n0.2,\n0.3,300\n", READ,
     ["2 rows without a time", "1 row without values"]),
    ("t,engine_torque,slip_speed\n0,200,1\n0.1,250,\n0.3,300,inf\n", {**READ, "slip_speed": [1.0, NAN, NAN]},
     ["2 of 3 in slip_speed"]),
    ("t,engine_torque,tacho\n0,200,1\n0.1,,5\n", {**torques([0.0, 0.1], [200.0, NAN]), "tacho": [1.0, 5.0]},
     ["1 of 2 in engine_torque"]),
    ("t,engine_torque,tacho\n0,200,1\n0,200,2\n0.1,200,2\n0.1,200,2\n",
     {**torques([0.0, 0.05, 0.1], [200.0] * 3), "tacho": [1.0, 2.0, 2.0]}, ["1 row repeated", "even steps of 0.05 s"]),
    # Clocks: by dates, or over midnight without them; a clock set back a little is no midnight.
    ("t,engine_torque\n2026-02-28 23:00:00.5,1\n2026-03-02T00:00:00.5Z,2\n", torques([0.0, 90000.0], [1.0, 2.0]),
     ["date-times"]),
    ("t,engine_torque\n28.2.2026 23:00,1\n01.03.2026 0:30:00,2\n", torques([0.0, 5400.0], [1.0, 2.0]), ["date-times"]),
    ("t;engine_torque\n11:00:00,5;1,5\n23:59:59,5;2\n00:00:01,25;3\n12:00:00;4\n00:30:00;5\n",
     torques([0.0, 46799.0, 46800.75, 48599.5, 89999.5], [1.5, 2.0, 3.0, 5.0, 4.0]),
     ["semicolons", "decimal comma", "date-times", "1 row came before", "sorted"]),
    ("t,engine_torque\n46000.5,1\n46000.5000115741,2\n46000.5000231482,3\n",
     torques([0.0, 1.000002, 2.000004], [1.0, 2.0, 3.0]), ["days", "Excel"]),
    *((f"t,engine_torque\n17{'0' * 8}{'0' * zeros},1\n17{'0' * 7}15e{zeros - 1},2\n", torques([0.0, 1.5], [1.0, 2.0]),
       [f"times in {unit} since 1970"]) for zeros, unit in ((3, "ms"), (6, "us"))),
    ("t,engine_torque\n1700000000,1\n1700000001.5,2\n", torques([0.0, 1.5], [1.0, 2.0]), ["times in s since 1970"]),
    ("t,engine_torque\n4000000000,1\n4000000001,2\n", torques([0.0, 1.0], [1.0, 2.0]), ["times in s since 1970"]),
    *((f"t,engine_torque\n{t:.0f},1\n{t + 1:.0f},2\n", torques([t, t + 1.0], [1.0, 2.0]), []) for t in (9e8, 5e9))])
def test_a_text_gives_its_numbers_and_says_how(tmp_path, text, columns, words):
    result, said = read(tmp_path / "in.csv", text)
    assert {name: pytest.approx(values, nan_ok=True, abs=1e-9) for name, values in columns.items()} == result
    assert all(word in said for word in words), said
    assert bool(said) is bool(words)


CLEAN = "t,M_mot [Nm],engine_torque\n0,1,2\n0.1,2,3\n"


@pytest.mark.parametrize(("text", "columns", "result"), [
    (CLEAN, "engine_torque=M_mot", torques([0.0, 0.1], [1.0, 2.0])),
    (CLEAN, "engine_torque=M_mot:N m", torques([0.0, 0.1], [1.0, 2.0])),
    (CLEAN, {"t": "t:ms"}, torques([0.0, 1e-4], [2.0, 3.0])), (CLEAN, " t =t:ms", torques([0.0, 1e-4], [2.0, 3.0])),
    (CLEAN.replace("M_mot [Nm]", "n:rpm"), "engine_torque=n:rpm", torques([0.0, 0.1], [1.0, 2.0])),
    (CLEAN.replace("M_mot [Nm]", "T"), "tacho=T,t=t", {**torques([0.0, 0.1], [2.0, 3.0]), "tacho": [1.0, 2.0]}),
    ("t,engine_torque,gear\n0,1,1\n1,2\n", None, torques([0.0, 1.0], [1.0, 2.0])),
    # Words of the refusal.
    (CLEAN, "engine_torque=M_mot:kNm", ["M_mot", "Nm", "kNm", "--columns"]), (CLEAN, "t=xyz", ["xyz", "M_mot"]),
    (CLEAN, "engine_torque=Mmot", ["Mmot", "did you mean M_mot?"]), (CLEAN, "F=t", ["--columns", "'F'", "slip_speed"]),
    (CLEAN, "t=t,t=M_mot", ["--columns", "t twice"]), (CLEAN, "t=", ["--columns", "'t'", "=COLUMN"]),
    (CLEAN.replace("M_mot [Nm]", "t"), None, ["column t", "2 times"]),
    ("time,Time,engine_torque\n0,0,1\n1,1,2\n", None, ["column time", "2 times"]),
    ("t,engine_torque\ns,bananas\n0,1\n1,2\n", None, ["engine_torque", "bananas", "kN m"]),
    ("t,engine_torque [K]\n0,1\n1,2\n", None, ["engine_torque", "K", "kN m"]),
    ("x,engine_torque\n0,1\n1,2\n", None, ["column t", "x", "--columns t=COLUMN"]),
    ("engine_torque,slip_speed\n0,1\n1,2\n", None, ["column t"]), ("t,engine_torque\n,1\n,2\n", None, ["column t"]),
    ("t,engine_torque\n2026-02-28 1:00:00,1\n2026-02-30 1:00:00,2\n", None, ["line 3", "column t", "2026-02-30"]),
    ("t,gear,engine_torque\n0,1,1\n1,2\n", None, ["line 3", "2 values", "3"]),
    ("t,engine_torque\n0,1\n1,2,3\n", None, ["line 3", "3 values", "2", "decimal comma"]),
    ("a,b\nc,d\ns,Nm\n0,1\n1,2\n", None, ["column t", "c, d"]), ("words\n", None, ["slip_speed", "t"]),
    ("", None, ["column t", "empty"]), ("1,2\n2,3\n", None, ["slip_speed", "t"]),
    (b"t,engine_torque\n0,\x081\n", None, ["not a text file", ".csv"]), (bytes(20), None, ["not a text file", ".csv"])])
def test_chosen_and_missing_columns(tmp_path, text, columns, result):
    path = tmp_path / "in.csv"
    if isinstance(result, dict):
        assert read(path, text, columns=columns)[0] == {name: pytest.approx(x) for name, x in result.items()}
        return
    with pytest.raises(InputError) as error:
        read(path, text, columns=columns)
    assert all(word in str(error.value) for word in result), str(error.value)


def test_columns_of_another_list_of_names(tmp_path):
    """As a friction table has them: without times, in the order of the file, and any unit for None."""
    path, known = tmp_path / "mu.csv", {"speed": "rad/s", "coefficient": "", "load": None}
    path.write_text("coefficient [%],speed [Hz],load [kip]\n13,1,\n12,2,7\n")
    values, notes, hold = columns_in(path, known, ("speed", "coefficient"), 2)
    for name, column in {"coefficient": [0.13, 0.12], "speed": [math.tau, 2.0 * math.tau], "load": [NAN, 7]}.items():
        np.testing.assert_allclose(values[name], column)
    assert (len(notes), hold) == (1, {})
    for needed, most, words in ((("slope",), 2, "column slope"), (("speed",), 1, "1 rows")):
        with pytest.raises(InputError, match=words):
            columns_in(path, known, needed, most)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("padding", [0, 65_500, 65_501, 65_502, 65_503])
def test_the_encoding_is_that_of_the_first_bytes(tmp_path, encoding, padding):
    """One of the paddings cuts the sign of degrees at the end of the bytes that are looked at."""
    text = "# " + "x" * (padding % 60_000) + "\n# " + "y" * (60_000 * (padding > 0)) + "\n"
    text += f"t,T [{DEGREE}C],engine_torque\n{AXES.replace(',', ',0,')}"
    assert read(tmp_path / "in.csv", text.encode(encoding))[0] == READ


def test_names_may_stand_behind_long_comments_but_not_in_long_lines(tmp_path):
    path = tmp_path / "in.csv"
    for count in (0, HEAD - 2, HEAD, 3 * HEAD):
        path.write_text("# hold: engine_torque next, slip_speed odd\n" + "# x\n" * count + "t,engine_torque\n" + AXES)
        assert (table_in(path).hold, table_in(path).t.tolist()) == ({"engine_torque": "next"}, READ["t"])
    text = "t,engine_torque\n" + AXES + "#" * (LONGEST_LINE - 1)
    assert read(path, text + "\n")[0] == READ
    with pytest.raises(InputError, match=str(LONGEST_LINE)):
        read(path, text + "#\n")


def test_tables_are_known_by_their_names(tmp_path):
    assert [is_table(tmp_path / f"x{suffix}") for suffix in (".csv", ".TXT", ".pq", ".mf4", ".tdms", ".mcap", "")] == [
        True, True, True, True, True, False, False]
    with pytest.raises(InputError, match=r"x\.h5 .*HDF5.*\.csv.*\.mf4"):
        is_table(tmp_path / "x.h5")


@pytest.mark.parametrize("write", [write_parquet, write_mat])
def test_binary_tables_keep_units_holds_and_numbers(tmp_path, write):
    path = tmp_path / ("x.parquet" if write is write_parquet else "x.mat")
    if write is write_parquet:
        pytest.importorskip("pyarrow")
    write(path, {"t": np.array([0.0, 100.0]), "engine_torque": np.array([0.2, np.nan]), "tacho": np.array([1, 2])},
          {"t": "ms", "engine_torque": "kN m"}, {"engine_torque": "next"}, {"scene": "a: 1\n"})
    result = table_in(path, most=2)
    for name, column in {"t": [0.0, 0.1], "engine_torque": [200.0, NAN], "tacho": [1.0, 2.0]}.items():
        np.testing.assert_array_equal(result.columns[name], column)
    assert result.hold == {"engine_torque": "next"}
    assert all(word in " ".join(result.notes) for word in (*SCALED, "3 columns, 3 used", "1 of 2 in engine_torque"))
    with pytest.raises(InputError, match="1 rows"):
        table_in(path, most=1)


def test_dates_durations_and_texts_of_parquet(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "x.parquet"
    for unit, per_second in (("s", 1), ("ms", 1000), ("us", 10**6), ("ns", 10**9)):
        ticks = arrow.array([None, 3 * per_second, 5 * per_second])
        for kind in (arrow.timestamp(unit), arrow.duration(unit)):
            parquet.write_table(arrow.table({"a": ticks.cast(kind), "c": ["x", "y", "z"], "d": [1, 2, 3]}), path)
            assert table_in(path, columns="t=a,tacho=d").columns["tacho"].tolist() == [2.0, 3.0]
            assert table_in(path, columns="t=a,tacho=d").t.tolist() == [0.0, 2.0]
    with pytest.raises(InputError, match="column c holds string"):
        table_in(path, columns="t=a,tacho=c")


def test_vectors_of_matlab_structures(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "x.mat"
    savemat(path, {"one": {"t": [0.0, 1.0, 2.0], "slip_speed": [1.0, 2.0, 3.0], "flag": np.array([True, False, True])},
                   "two": {"t": [5.0, 6.0]}, "z": [1.0 + 1j, 2.0], "engine_torque": [7, 8, 9], "text": "abc"})
    result = table_in(path)
    assert {name: values.tolist() for name, values in result.columns.items()} == {
        "t": [0.0, 1.0, 2.0], "slip_speed": [1.0, 2.0, 3.0], "engine_torque": [7.0, 8.0, 9.0]}
    assert "flag, two.t" in result.notes[0]
    with pytest.raises(InputError, match=r"two\.t has 2 values.*3"):
        table_in(path, columns="tacho=two.t")
    savemat(path, {"a": 1.0, "b": np.eye(2), "units": {"a": "s"}})
    with pytest.raises(InputError, match="vectors"):
        table_in(path)


def test_channels_of_an_mdf_file_share_their_times(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file, t = asammdf.MDF(), np.array([0.0, 0.1, 0.2])
    for stamps, name, values, more in (
            (t, "slip_speed", t + 1.0, {}), (t, "twice", t, {}), (t, "twice", t, {}),
            (0.1 + 0.5 * t, "engine_torque", 9.0 * t, {"invalidation_bits": np.array([False, True, False])}),
            (t, "words", np.array([b"a"] * 3), {"encoding": "utf-8"})):
        file.append([asammdf.Signal(values, stamps, name=name, **more)])
    path = file.save(tmp_path / "a.mf4")
    file.close()
    result = table_in(path)
    assert result.t == pytest.approx([0.0, 0.1, 0.2])
    np.testing.assert_allclose(result.columns["slip_speed"], [1.0, 1.1, 1.2])
    np.testing.assert_allclose(result.columns["engine_torque"], [NAN, 0.0, 1.8])
    for columns, words in (("tacho=twice", "2 groups have a channel twice"), ("tacho=words", "words holds no numbers")):
        with pytest.raises(InputError, match=words):
            table_in(path, columns=columns)
    (tmp_path / "broken.mf4").write_bytes(b"MDF " * 99)
    with pytest.raises(InputError, match="MDF"):
        table_in(tmp_path / "broken.mf4")
