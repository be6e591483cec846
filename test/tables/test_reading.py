"""One run-up in the files that engineers have: each gives the same table, and says how it was read."""

import csv
import math
import os

import numpy as np
import pytest

from tcc_sim.analysis.measured.measured_phase import signals_in
from tcc_sim.analysis.measured.orders import orders_of
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.output.samples import write_samples
from tcc_sim.replay.given_inputs import driven_by
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.tables.chosen_columns import is_table
from tcc_sim.tables.measured_table import table_in

T = np.round(np.arange(0.0, 1.5, 1e-3), 6)
PHASE = 150.0 * T + 10.0 * T * T
COLUMNS = {"t": T, "slip_speed": 20.0 + 5.0 * np.sin(PHASE + 0.4), "engine_torque": 300.0 + 100.0 * np.sin(PHASE),
           "engine_speed": 150.0 + 20.0 * T}
RPM = 30.0 / math.pi


def written(path, names, columns, units=None, delimiter=",", comma=False, encoding="utf-8", tail="", before=""):
    """A table in text, with every option of an export."""
    rows = [names, *([units] if units else []), *zip(*(
        column if isinstance(column, list) else [repr(float(x)) for x in column] for column in columns))]
    text = "\n".join(delimiter.join(row) + tail for row in rows) + "\n"
    path.write_bytes((before + (text.replace(".", ",") if comma else text)).encode(encoding))
    return path


def german(path):
    columns = [T, COLUMNS["slip_speed"] * RPM, COLUMNS["engine_torque"], COLUMNS["engine_speed"] * RPM]
    return written(path, ["Zeit", "n_slip", "M_Mot", "n_Mot"], columns, ["s", "1/min", "Nm", "U/min"], ";", comma=True,
                   encoding="utf-8-sig")


def utf16(path):
    return written(path, ["t [ms]", "slip_speed [rad/s]", "engine_torque (kN m)", "engine_speed [Hz]"],
                   [1e3 * T, COLUMNS["slip_speed"], 1e-3 * COLUMNS["engine_torque"],
                    COLUMNS["engine_speed"] / (2.0 * math.pi)], delimiter="\t", encoding="utf-16")


def without_mark(path):
    return written(path, [*COLUMNS], COLUMNS.values(), delimiter=";", encoding="utf-16-le")


def pandas_index(path):
    return written(path, ["", *COLUMNS, "gear", "comment"], [np.arange(len(T)), *COLUMNS.values(), ["D"] * len(T),
                                                           ["a, b" if k % 2 else "" for k in range(len(T))]],
                   delimiter=";", tail=";")


def date_times(path):
    stamps = [f"2026-03-31 23:59:{59.0 + t:09.6f}" if t < 1.0 else f"2026-04-01 00:00:{t - 1.0:09.6f}" for t in T]
    return written(path, ["Timestamp", *list(COLUMNS)[1:]], [stamps, *list(COLUMNS.values())[1:]],
                   before="Exported by a logger\nVehicle: 7\n\n")


def clock_times(path):
    stamps = [f"23:59:{59.0 + t:09.6f}" if t < 1.0 else f"00:00:{t - 1.0:09.6f}" for t in T]
    return written(path, ["Timestamp", *list(COLUMNS)[1:]], [stamps, *list(COLUMNS.values())[1:]])


def epoch(path):
    return written(path, ["time", "Slip Speed", "Engine-Torque", "ENGINE_SPEED"],
                   [1.7e12 + 1e3 * T, *list(COLUMNS.values())[1:]], delimiter=";")


def spaces(path):
    return written(path, [*COLUMNS], COLUMNS.values(), delimiter="   ")


def savetxt(path):
    np.savetxt(path, np.column_stack(list(COLUMNS.values())), delimiter=",", header=",".join(COLUMNS), fmt="%.17g")
    return path


def quoted(path):
    with path.open("w", newline="", encoding="cp1252") as stream:
        writer = csv.writer(stream, quoting=csv.QUOTE_ALL)
        writer.writerow([*COLUMNS, "T_\N{DEGREE SIGN}C"])
        writer.writerows([str(float(x)).replace(".", ",") for x in row] for row in zip(*COLUMNS.values(), T))
    return path


def parquet(path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as files

    path = path.with_suffix(".parquet")
    columns = {**COLUMNS, "t": (1_700_000_000_000_000_000 + np.rint(COLUMNS["t"] * 1e9)).astype("datetime64[ns]"),
               "note": ["x"] * len(T)}
    files.write_table(pyarrow.table(columns), path)
    return path


def matlab(path):
    from scipy.io import savemat

    path = path.with_suffix(".mat")
    savemat(path, {"data": {**COLUMNS, "rate": 1000.0}, "name": "run 7", "matrix": np.eye(3)}, oned_as="column")
    return path


def mdf(path, version="4.10", suffix=".mf4"):
    asammdf = pytest.importorskip("asammdf")
    made, file = path.with_suffix(".mf4" if version > "4" else ".mdf"), asammdf.MDF(version=version)
    for name, (unit, factor) in {"slip_speed": ("rpm", RPM), "engine_torque": ("Nm", 1.0),
                                 "engine_speed": ("rpm", RPM)}.items():
        file.append([asammdf.Signal(COLUMNS[name] * factor, T, unit=unit, name=name)])
    file.append([asammdf.Signal(np.arange(15.0), np.arange(15) * 0.1, unit="degC", name="oil")])
    file.save(made)
    file.close()
    return made.rename(made.with_suffix(suffix))


def mdf3(path):
    return mdf(path, "3.30", ".dat")


def tdms(path, waves=True):
    nptdms = pytest.importorskip("nptdms")
    path, start = path.with_suffix(".tdms"), np.datetime64("2026-03-31T23:59:59")
    shift = {"engine_torque": 100}  # Samples by which a waveform begins later.
    channels = [nptdms.ChannelObject(
        "run", name, COLUMNS[name][shift.get(name, 0) * waves:] * (RPM if unit == "rpm" else 1.0),
        properties={"unit_string": unit, **({"wf_increment": 1e-3, "wf_start_offset": 0.0, "wf_start_time":
                    start + np.timedelta64(shift.get(name, 0), "ms")} if waves else {})})
        for name, unit in (("slip_speed", "rpm"), ("engine_torque", "Nm"), ("engine_speed", "rpm"))]
    if not waves:
        channels.append(nptdms.ChannelObject("run", "Time", start + (1e9 * T).astype("timedelta64[ns]")))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)
    return path


def tdms_table(path):
    return tdms(path, waves=False)


EXPORTS = [german, utf16, without_mark, pandas_index, date_times, clock_times, epoch, spaces, savetxt, quoted, parquet,
           matlab, mdf, mdf3, tdms, tdms_table]
WORDS = {german: ["--columns", "slip_speed=n_slip,engine_torque=M_Mot,engine_speed=n_Mot"]}
SAID = {german: ["semicolons", "decimal comma", "n_slip in 1/min", "engine_torque from M_Mot", "t from Zeit"],
        utf16: ["tabs", "UTF-16", "t in ms", "engine_torque in kN m", "engine_speed in Hz"],
        without_mark: ["semicolons", "UTF-16-LE"], pandas_index: ["semicolons", "one without a name, gear"],
        date_times: ["2 lines before", "date-times from the first row", "t from Timestamp"],
        clock_times: ["date-times from the first row", "t from Timestamp"],
        epoch: ["semicolons", "engine_torque from Engine-Torque", "times in ms since 1970"], spaces: ["spaces"],
        savetxt: [], quoted: ["CP1252", "decimal comma", "passed over: T_"], parquet: ["Parquet", "passed over: note"],
        matlab: ["MATLAB"], mdf: ["MDF", "slip_speed in rpm", "passed over: oil"], mdf3: ["MDF", "slip_speed in rpm"],
        tdms: ["TDMS", "slip_speed in rpm", "100 of 1500 in engine_torque"], tdms_table: ["TDMS", "t from Time"]}


@pytest.mark.parametrize("export", EXPORTS, ids=lambda export: export.__name__)
def test_every_export_gives_the_same_table(tmp_path, export):
    result = table_in(export(tmp_path / "run.csv"), columns=WORDS.get(export, [None, None])[1])
    assert set(result.columns) == set(COLUMNS)
    np.testing.assert_allclose(result.t - result.t[0], T, atol=2e-6)
    late = 100 * (export is tdms)
    for name in ("slip_speed", "engine_torque", "engine_speed"):
        first = late if name == "engine_torque" else 0
        np.testing.assert_allclose(result.columns[name][first:], COLUMNS[name][first:], rtol=1e-9)
        assert np.isnan(result.columns[name][:first]).all()
    assert len(result.holes(*COLUMNS)) == bool(late)
    orders = orders_of(signals_in(result, System()))
    assert np.abs(20.0 * np.log10(orders.cut(1.0, "slip_speed") / 5.0)).max() < 0.1
    assert all(word in " ".join(result.notes) for word in SAID[export])
    assert bool(result.notes) is bool(SAID[export])


def test_files_of_other_kinds_are_called_by_their_names(tmp_path, refused):
    assert "is an Excel workbook, which is not read; save it as .csv" in refused("analyse", "run.xlsx", "--orders")
    (tmp_path / "new.mat").write_bytes(b"\0" * 512 + b"\x89HDF" + b"\0" * 512)
    assert "of version 7.3 (HDF5); save it with the option -v7" in refused("analyse", "new.mat", "--orders")
    (tmp_path / "no.mat").write_bytes(b"no file" * 100)
    assert "cannot be read as a MATLAB file" in refused("analyse", "no.mat", "--orders")
    if pytest.importorskip("pyarrow"):
        (tmp_path / "no.parquet").write_bytes(b"no file" * 100)
        assert "cannot be read as Parquet" in refused("analyse", "no.parquet", "--orders")
    assert is_table(tmp_path / "x.MF4")
    assert not is_table(tmp_path / "run_0.mcap")


@pytest.mark.parametrize(("words", "why"), [
    (["analyse", "run", "--columns", "t=Time"], "--columns is for tables, and run is a recording"),
    (["simulate", "fig02", "--inputs", "run", "--from", "1"], "--from: only for tables, and run is a recording"),
    (["simulate", "fig02", "--from", "1"], "--from: only for inputs"),
    (["identify", "run", "--free", "driveline.stiffness", "--to", "1"], "--to are for tables, and run is a recording")])
def test_options_of_tables_are_for_tables(tmp_path, refused, words, why):
    (tmp_path / "run").mkdir()
    assert why in refused(*words)


def test_a_table_without_inputs_names_what_it_has(tmp_path):
    (tmp_path / "in.csv").write_text("t,torque\n0,1\n1,1\n")
    with pytest.raises(InputError, match=r"must name the column .* or --columns one .*passed over: torque"):
        driven_by(load_scene("commands"), tmp_path / "in.csv")


def test_what_is_no_file_of_a_bounded_size_is_refused_unread(tmp_path, refused):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    with (tmp_path / "sparse.csv").open("wb") as file:
        file.truncate(5 << 30)
    (tmp_path / "line.csv").write_bytes(b"t,engine_torque\n" + b"1" * (1 << 20))
    (tmp_path / "zeros.csv").write_bytes(b"t,engine_torque\n" + bytes(1 << 20))
    for name, why in (("pipe", "is not a regular file"), ("zero", "is not a regular file"),
                      ("sparse", "a table has at most"), ("line", "a line of more than 65536 characters"),
                      ("zeros", "not a text file")):
        assert why in refused("simulate", "commands", "--inputs", tmp_path / f"{name}.csv")
    with pytest.raises(InputError, match="3 rows"):  # The rest, with a wrong line, is not read.
        table_in(written(tmp_path / "long.csv", ["t", "engine_torque"], [np.arange(9), [*"12345x789"]]), most=3)
    assert "/proc/self/mem cannot be read" in refused("simulate", "commands", "--inputs", "/proc/self/mem")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_samples_come_back_from_every_kind_of_table(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    run = solve(load_scene("fig02"), cycles=2, samples_per_cycle=50)
    write_samples(tmp_path / f"run{suffix}", run, load_scene("fig02").text(), recorded=True)
    result = table_in(tmp_path / f"run{suffix}")
    for name in ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque"):
        assert result.columns[name].tolist() == getattr(run, name).tolist()
    assert result.hold == {"engine_torque": "linear", "actuation_pressure": "linear"}
    torque = driven_by(load_scene("commands"), tmp_path / f"run{suffix}").system.inputs.torque
    assert torque[:, 1].tolist() == run.engine_torque.tolist()
