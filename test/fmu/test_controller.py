"""A controller in an FMU is a law: the same run as the law in Python, without ROS and in the test kit."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fmus import needs_compiler, written

import tcc_sim
from tcc_sim.errors import InputError, TccError
from tcc_sim.fmi.export import PLATFORMS, compiler
from tcc_sim.scene import load_scene

pytestmark = needs_compiler
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="pi" guid="{pi}">
<CoSimulation modelIdentifier="pi" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>
<ScalarVariable name="slip_speed" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="1" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="gain" valueReference="2" causality="parameter" variability="fixed"><Real start="1400"/>
</ScalarVariable></ModelVariables><ModelStructure><Outputs><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>
"""
NAMES = {"actuation_pressure": "y"}


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of controller.c."""
    folder = tmp_path_factory.mktemp("controller")
    subprocess.run([str(compiler()), "-O0", "-fPIC", "-shared", str(Path(__file__).with_name("controller.c")), "-o",
                    "pi.so"], cwd=folder, check=True)
    with zipfile.ZipFile(folder / "pi.fmu", "w") as file:
        file.writestr("modelDescription.xml", DESCRIPTION)
        file.write(folder / "pi.so", f"binaries/{PLATFORMS['linux', 'x86_64'][0]}/pi.so")
    return folder / "pi.fmu"


def pi(gain: float = 1400.0) -> Callable[[Any], float]:
    """The same law in Python."""
    integral, before = 0.0, None

    def law(reading: Any) -> float:
        nonlocal integral, before
        now, error = reading.stamp_ns, reading.slip_speed - 20.0
        integral += 0.0 if before is None else 5200.0 * ((now - before) * 1e-9) * error
        before = now
        return 90000.0 + integral + gain * error

    return law


def test_it_gives_the_run_of_the_same_law_and_begins_anew_with_the_next_run(controller: Path) -> None:
    for gain, given in ((1400.0, {}), (700.0, {"gain": 700.0})):
        law = tcc_sim.fmu_controller(controller, NAMES, given)
        for seconds, rate in ((0.3, 1000.0), (0.2, 500.0)):
            runs = [tcc_sim.closed_loop("controlled", each, seconds, rate) for each in (law, pi(gain))]
            assert runs[0].slip_speed.tobytes() == runs[1].slip_speed.tobytes()
            np.testing.assert_array_equal(*(run.commands["actuation_pressure"] for run in runs))


def test_an_fmu_of_version_3_answers_both_inputs_from_its_own_time() -> None:
    """Here the FMU is a driveline, whose excitation is the command."""
    law = tcc_sim.fmu_controller(written("fig02", 3).with_name("model.fmu"), {
        "engine_torque": "applied_engine_torque", "actuation_pressure": "applied_pressure"})
    run = tcc_sim.closed_loop("commands", law, 0.1)
    engine, pressure = load_scene("fig02").system.engine, load_scene("fig02").system.pressure
    phase, t = pressure.frequency_ratio * engine.frequency, run.t[:-1]
    np.testing.assert_allclose(run.commands["engine_torque"][1:], engine.mean_torque + engine.torque_amplitude
                               * np.sin(engine.frequency * t), rtol=1e-9)
    np.testing.assert_allclose(run.commands["actuation_pressure"][1:], pressure.mean + pressure.amplitude
                               * np.sin(phase * t + pressure.phase), rtol=1e-9)


@pytest.mark.parametrize(("file", "names", "parts"), [
    ("pi.fmu", {}, ["no output", "actuation_pressure", "y"]), ("text.fmu", NAMES, ["text.fmu", "cannot be read"]),
    ("pi.fmu", {"actuation_pressure": "z"}, ["z", "slip_speed"]), ("none.fmu", NAMES, ["none.fmu"]),
    ("sources.fmu", NAMES, ["does not run on this machine"])])
def test_what_is_no_controller_is_refused_by_its_name(controller: Path, file: str, names: dict[str, str],
                                                      parts: list[str]) -> None:
    (controller.parent / "text.fmu").write_text("text")
    with zipfile.ZipFile(controller.parent / "sources.fmu", "w") as written:
        written.writestr("modelDescription.xml", DESCRIPTION)
    with pytest.raises(InputError) as refused:
        tcc_sim.fmu_controller(controller.parent / file, names)
    assert [part for part in parts if part not in str(refused.value)] == []
    with pytest.raises(InputError, match="weight"):
        tcc_sim.fmu_controller(controller, NAMES, {"weight": 1.0})


def test_a_call_that_it_refuses_ends_the_run_and_names_the_time(controller: Path) -> None:
    law = tcc_sim.fmu_controller(controller, NAMES)
    law(SimpleNamespace(stamp_ns=0, slip_speed=0.0))
    with pytest.raises(TccError, match=r"pi\.fmu failed at 0\.5 s"):
        law(SimpleNamespace(stamp_ns=500_000_000, slip_speed=2000.0))
