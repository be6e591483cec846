"""Commands as functions: the same options give the same results."""

import inspect
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tcc_sim
from tcc_sim.cli import build_parser, main
from tcc_sim.errors import InputError

OUTPUT = {"json", "out", "force", "plot", "width", "title", "style", "units", "verb", "words", "samples", "layout",
          "scene", "recording", "measured"}
"""Arguments that name the input, or are about files and pictures."""


@pytest.mark.parametrize(("name", "words"), [
    ("simulate", ["simulate", "fig02"]), ("analyse", ["analyse", "run"]), ("explain", ["explain", "fig02"]),
    ("fmu", ["fmu", "fig02"]), ("figure", ["figure", "2"]),
    ("identify", ["identify", "x.csv", "--free", "driveline.stiffness"])])
def test_a_function_has_the_options_of_its_command(name, words):
    options = set(vars(build_parser(words[0]).parse_args(words))) - OUTPUT
    keywords = set(inspect.signature(getattr(tcc_sim, name)).parameters)
    assert options - {"set"} <= keywords


@pytest.fixture
def table(tmp_path):
    t = np.arange(0.0, 1.5, 1e-3)
    columns = {"t": t, "slip_speed": 20.0 + 5.0 * np.sin(150.0 * t), "engine_torque": 300.0 + 100.0 * np.sin(150.0 * t),
               "n": np.full(len(t), 150.0 * 30.0 / np.pi)}
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def test_simulate_takes_what_the_command_takes(table, tmp_path):
    words = ["--inputs", str(table), "--hold", "linear", "--columns", "engine_speed=n:rpm", "--from", "0.2", "--orders",
             "--set", "pressure.amplitude=0"]
    assert main(["simulate", "minimal", *words, "--json", str(tmp_path / "out.json")]) == 0
    by = json.loads((tmp_path / "out.json").read_text())
    result = tcc_sim.simulate("minimal", set={"pressure.amplitude": 0.0}, inputs=table, hold="linear",
                              columns={"engine_speed": "n:rpm"}, from_=0.2, orders=True)
    assert result.summary.max_slip_speed == by["max_slip_speed"]
    np.testing.assert_array_equal(result.orders.slip_speed, by["orders"]["slip_speed"])
    np.testing.assert_array_equal(result.measured_orders.slip_speed, by["measured_orders"]["slip_speed"])
    assert result.warnings == by["warnings"]
    assert "engine_speed from n in rpm" in by["warnings"][0]
    assert "the simulation starts at its time 0.2 s" in by["warnings"][1]


def test_profiles_and_spectra(tmp_path):
    words = ["simulate", "minimal", "--profile", "engine.speed=0:800rpm,1:1600rpm", "--json", str(tmp_path / "o.json")]
    assert main(words) == 0
    by = json.loads((tmp_path / "o.json").read_text())["max_slip_speed"]
    for profile in (["engine.speed=0:800rpm,1:1600rpm"], {"engine.speed": "0:800rpm,1:1600rpm"}):
        assert tcc_sim.simulate("minimal", profile=profile).summary.max_slip_speed == by
    result = tcc_sim.simulate("slip", cycles=60, spectrum=True)
    for scene in ("slip", None):
        np.testing.assert_array_equal(result.spectrum.slip_speed, tcc_sim.spectrum(result, scene).slip_speed)
    assert len(result.trajectory.t) == 2  # The ends alone.
    with pytest.raises(InputError, match="summary"):
        tcc_sim.spectrum(replace(result, summary=None))
    for wrong in ({"hold": "linear"}, {"from_": 0.0}, {"to": 0.0}, {"columns": "t=t"}, {"pulses": 1}):
        with pytest.raises(InputError, match="inputs"):
            tcc_sim.simulate("slip", **wrong)
    with pytest.raises(InputError, match="a spectrum needs a periodic excitation"):
        tcc_sim.simulate("runup", spectrum=True)


def test_analyse_takes_tables(table, tmp_path):
    words = ["analyse", str(table), "--orders", "--columns", "engine_speed=n:rpm"]
    assert main([*words, "--json", str(tmp_path / "o.json")]) == 0
    by = json.loads((tmp_path / "o.json").read_text())["orders"]
    result = tcc_sim.analyse(table, orders=True, columns="engine_speed=n:rpm")
    np.testing.assert_array_equal(result.orders.slip_speed, by["slip_speed"])
    with pytest.raises(InputError, match="--orders or --spectrum"):
        tcc_sim.analyse(table)
    for wrong in ({"run": 0}, {"joints": {}}, {"topic": ""}, {"driveline": 0, "discard": 0}, {"frequency": 0.0},
                  {"verify": True, "damping": True}, {"target": 0.0}, {"rrd": tmp_path},
                  {"spawn": True, "connect": ""}):
        with pytest.raises(InputError, match=", ".join(f"--{name}" for name in wrong)):
            tcc_sim.analyse(table, spectrum=True, **wrong)
    for wrong in ("columns", "pulses"):
        with pytest.raises(InputError, match=wrong):
            tcc_sim.analyse(tmp_path, **{wrong: 1})


def test_a_recording_has_the_orders_and_the_spectrum_of_its_command(table, tmp_path):
    path = tmp_path / "run.mcap"
    assert main(["simulate", "minimal", "--cycles", "30", "--samples", "40", "--out", str(path)]) == 0
    assert main(["analyse", str(path), "--orders", "--spectrum", "--json", str(tmp_path / "o.json")]) == 0
    by = json.loads((tmp_path / "o.json").read_text())
    for wanted in ((True, False), (False, True)):
        found = tcc_sim.analyse(path, orders=wanted[0], spectrum=wanted[1])
        assert (found.orders is not None, found.spectrum is not None) == wanted
        part, name = (found.orders, "orders") if wanted[0] else (found.spectrum, "spectrum")
        np.testing.assert_array_equal(part.slip_speed, by[name]["slip_speed"])
    with pytest.raises(InputError, match="pulses"):
        tcc_sim.simulate("minimal", inputs=table, pulses=2)


def test_scenes_are_explained_with_their_changes():
    found = tcc_sim.explain("fig02", set={"friction.law": "set_valued"})
    assert (found["solver"], found["step"]) == ("event_driven", None)


def test_an_fmu_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert tcc_sim.fmu("slip", sources_only=True, step=2e-3) == Path("tcc_sim_slip.fmu")
    with zipfile.ZipFile("tcc_sim_slip.fmu") as file:
        assert b'fmiVersion="2.0"' in file.read("modelDescription.xml")
        assert b"#define TCC_STEP 0.002" in file.read("sources/tcc_variables.h")
        assert not any(name.startswith("binaries") for name in file.namelist())
    path = tcc_sim.fmu("fig02", set={"engine.speed": 100.0}, fmi=3, sources_only=True, out=tmp_path / "it.fmu")
    assert path.stat().st_size > 1000
    with pytest.raises(InputError, match="it is not overwritten"):
        tcc_sim.fmu("fig02", out=path)
    with pytest.raises(InputError, match=r"must end in \.fmu"):
        tcc_sim.fmu("fig02", out=tmp_path / "it.zip")
