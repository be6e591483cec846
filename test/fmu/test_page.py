"""The examples of the page on FMUs run, and the command names its files or the error."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tcc_sim import closed_loop
from tcc_sim.cli import main
from tcc_sim.errors import InputError, TccError
from tcc_sim.fmi.export import binary_of, compiler, fmu_of
from tcc_sim.plant.driveline import Reading
from tcc_sim.scene import load_scene

PAGE = Path(__file__).resolve().parents[2] / ".github" / "guide" / "fmu.md"


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
def test_the_closed_loop_of_the_page_holds_its_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                      capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("fmpy", reason="FMPy is not installed")
    from fmus import written

    monkeypatch.chdir(tmp_path)
    assert main(["fmu", "controlled"]) == 0
    assert "tcc_sim_controlled.fmu: FMI 2.0 for co-simulation, sources in C99 and a binary" in capsys.readouterr().out
    code, vehicle, _ = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    exec(compile(code, str(PAGE), "exec"), {})
    mean, = re.findall(r"mean slip speed of the last second: ([0-9.]+) rad/s", capsys.readouterr().out)
    assert float(mean) == pytest.approx(20.0, abs=0.5)
    shutil.copy(written("fig02", 2).with_name("model.fmu"), "tcc_sim_fig02.fmu")
    by_name: dict[str, Any] = {}
    exec(compile(vehicle, str(PAGE), "exec"), by_name)
    speed = 0.0

    def law(reading: Reading) -> tuple[None, None, float]:
        nonlocal speed
        speed += 1e-3 * (reading.shaft_torque - 2.0 * speed) / 1.5
        return None, None, speed

    run = closed_loop("fig02", law, 1.0)
    assert by_name["slip_speed"] == run.slip_speed[1:].tolist()
    assert by_name["speed"] == speed == pytest.approx(111.1964, abs=0.3)   # LSODA's, with the vehicle in its equations


def test_the_command_writes_sources_alone_the_same_each_time_and_never_over_a_file(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]) -> None:
    for name in ("a.fmu", "b.fmu"):
        assert main(["fmu", "commands", "--fmi", "3", "--step", "0.0005", "--sources-only", "--set",
                     "friction.decay=3", "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.fmu") as file:
        names = set(file.namelist())
        text = file.read("sources/tcc_variables.h").decode()
    assert "#define TCC_STEP 0.0005" in text
    assert '"friction.decay", TCC_FIXED, TCC_REAL, 3.0, 0.0, 1000.0' in text
    assert {"modelDescription.xml", "sources/buildDescription.xml", "sources/fmi3.c", "sources/tcc_kernel.h",
            "sources/tcc_model.h", "sources/tcc_variables.h"} <= names
    assert not any(name.startswith("binaries") for name in names)
    capsys.readouterr()
    assert "a.fmu exists; it is not overwritten" in refused("fmu", "commands", "--out", tmp_path / "a.fmu")


@pytest.mark.parametrize(("words", "parts"), [
    (["fig02", "--set", "friction.law=set_valued"], ["friction.law", "set_valued", "smoothed"]),
    (["fig02", "--step", "1", "--set", "pressure.mean=1e7"], ["sub-steps", "20000"]),
    (["fig02", "--out", "fig02.zip"], ["--out", "fig02.zip", ".fmu"]), (["fig02", "--fmi", "1"], ["1", "2 or 3"])])
def test_what_cannot_be_written_is_one_line_and_no_file(words: list[str], parts: list[str],
                                                        refused: Callable[..., str]) -> None:
    line = refused("fmu", *words)
    assert [part for part in parts if part not in line] == []


def test_step_and_version_have_ranges() -> None:
    soft = load_scene("slip").with_values({"pressure.mean": 1.0, "pressure.amplitude": 0.0, "friction.smoothing": 1.0})
    assert fmu_of(soft, 3, 1.0).version == 3
    for version, step in ((2, 4.999e-5), (2, 1.001), (1, None), (4, None)):
        with pytest.raises(InputError):
            fmu_of(soft, version, step)
    with pytest.raises(TccError, match="false"):
        binary_of(fmu_of(soft, 2, 1.0), "false")
