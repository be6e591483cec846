"""Others take the FMU: FMPy validates, simulates and compiles it, libcosim runs it, and the C of the tests links it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed")

import fmpy
from fmpy.validation import validate_fmu
from fmus import needs_compiler, written

from tcc_sim.cli import main
from tcc_sim.fmi.export import compiler, export, fmu_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper

HEADERS = Path(fmpy.__file__).parent / "c-code"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
HARMONICS = {"engine.harmonic_amplitudes": [60.0, 20.0], "engine.harmonic_phases": [0.3, 1.0]}


@pytest.mark.parametrize(("name", "version"), [("commands", 2), ("controlled", 3), ("harmonics", 2)])
def test_its_description_is_valid_and_says_what_the_keys_say(name: str, version: int, tmp_path: Path) -> None:
    scene = load_scene("fig02").with_values(HARMONICS) if name == "harmonics" else load_scene(name)
    export(scene, tmp_path / "a.fmu", version, sources_only=True)
    assert validate_fmu(str(tmp_path / "a.fmu")) == []
    described = fmpy.read_model_description(str(tmp_path / "a.fmu"))
    assert described.coSimulation.modelIdentifier == f"tcc_sim_{scene.name}"
    assert described.fmiVersion == f"{version}.0"
    assert described.buildConfigurations[0].sourceFileSets[0].sourceFiles == [f"fmi{version}.c"]
    rows = {row.name: row for row in described.modelVariables}
    units = {unit.name: unit.baseUnit for unit in described.unitDefinitions}
    stiffness = rows["driveline.stiffness"]
    assert (stiffness.causality, stiffness.variability, float(stiffness.start), float(stiffness.max)) == (
        "parameter", "fixed", 3000.0, 1e8)
    assert (stiffness.declaredType.name, stiffness.declaredType.unit) == ("Stiffness", "N.m/rad")
    base = units["N.m/rad"]
    assert (base.kg, base.m, base.s, base.rad) == (1, 2, -2, -1)
    assert rows["friction.static_coefficient"].variability == "tunable"
    assert {row for row in rows if rows[row].causality == "input"} == {
        "commands": {"engine_torque", "actuation_pressure"}, "controlled": {"actuation_pressure"}}.get(name, set()) | {
        "output_speed"}
    if name == "controlled":
        assert (float(rows["actuation_pressure"].start), rows["actuation_pressure"].min) == (100e3, "0.0")
    if name == "harmonics":
        assert float(rows["engine.harmonic_phases[2]"].start) == 1.0
    outputs = {row for row in rows if rows[row].causality == "output"}
    assert outputs == {"slip_speed", "friction_torque", "stick_slip_state", "flywheel_angle", "flywheel_speed",
                       "plate_angle", "plate_speed", "applied_engine_torque", "applied_pressure", "shaft_torque"}


@pytest.mark.parametrize(("name", "version"), [
    (b"a\x01b.yaml", 3), (b"caf\xe9.yaml", 2), ("ol\u00e9 \uffff.yaml".encode(), 3)])
def test_a_scene_whose_name_is_no_text_makes_a_valid_description(
        name: bytes, version: int, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / os.fsdecode(name)).write_text(load_scene("fig02").text(), encoding="utf-8")
    assert main(["fmu", os.fsdecode(name), "--sources-only", "--fmi", str(version)]) == 0
    said = capsys.readouterr()
    assert (said.out.count("\n"), said.err) == (1, "")
    path, = tmp_path.glob("*.fmu")
    shutil.copy(path, "copy.fmu")
    # Reading checks the description against the standard's schema.
    assert re.fullmatch(r"tcc_sim_\w+", fmpy.read_model_description("copy.fmu").modelName, re.ASCII)


def solved(seconds: float) -> np.ndarray:
    """Slip speeds of fig02 by the node's solver."""
    stepper, result = Stepper(load_scene("fig02").system, 1e-3), []
    for _ in range(round(seconds * 1e3)):
        stepper.advance()
        result.append(stepper.state[0])
    return np.array(result)


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no CMake")
def test_fmpy_compiles_it_from_its_sources_to_the_same_bits(tmp_path: Path) -> None:
    from fmpy.build import build_platform_binary

    export(load_scene("fig02"), tmp_path / "a.fmu", 3, sources_only=True)
    unpacked = fmpy.extract(str(tmp_path / "a.fmu"), unzipdir=str(tmp_path / "unpacked"))
    build_platform_binary(unpacked)
    result = fmpy.simulate_fmu(unpacked, stop_time=0.2, output_interval=1e-3, output=["slip_speed"])
    assert result["slip_speed"][1:].tobytes() == solved(0.2).tobytes()


@needs_compiler
def test_libcosim_runs_it_to_the_same_bits(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("libcosimpy", reason="libcosim is not installed")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(step_size=1e6)
    path = str(written("fig02", 2).with_name("model.fmu"))
    place = execution.add_local_slave(CosimLocalSlave(fmu_path=path, instance_name="plant"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    assert execution.step(step_count=400)
    values = observer.last_real_values(slave_index=place, variable_references=[1])
    assert values == [solved(0.4)[-1]]
    assert "[error]" not in capfd.readouterr().err


@needs_compiler
@pytest.mark.parametrize(("name", "standard", "declared", "version"), [
    ("controlled", "c99", True, 2), ("commands", "gnu17", False, 3)])
def test_it_compiles_without_a_warning_as_the_standard_declares_it_and_may_be_linked_beside_others(
        name: str, standard: str, declared: bool, version: int, tmp_path: Path) -> None:
    sources, built = unpacked_sources(name, version, tmp_path), str(tmp_path / "a.o")
    prefix = "" if declared else "a_"
    words = (f"-I{HEADERS}", "-include", f"fmi{version}Functions.h") if declared else (
        f"-DFMI{version}_FUNCTION_PREFIX={prefix}",)
    compile_c([f"-std={standard}", *WARNINGS, *words, "-c", f"{sources}/fmi{version}.c", "-o", built])
    symbols = subprocess.run(["nm", "-g", "--defined-only", built], capture_output=True, text=True, check=True).stdout
    assert f"{prefix}fmi{version}GetVersion" in symbols
    assert all(line.split()[-1].startswith(f"{prefix}fmi{version}") for line in symbols.splitlines())


@needs_compiler
def test_long_profiles_are_not_on_the_stack(tmp_path: Path) -> None:
    """An importer's thread may have a stack of a megabyte."""
    times = [0.01 * k for k in range(500)]
    scene = load_scene("fig02").with_values({
        "engine.harmonic_amplitudes": [10.0] * 4, "engine.harmonic_phases": [0.1] * 4,
        "engine.harmonic_amplitudes_times": times, "engine.harmonic_amplitudes_values": [10.0] * 2000,
        "engine.frequency_times": times, "engine.frequency_values": [100.0 + t for t in times]})
    (tmp_path / "long.yaml").write_text(scene.text())
    sources = unpacked_sources(str(tmp_path / "long.yaml"), 3, tmp_path)
    compile_c(["-O0", "-std=c99", *WARNINGS, "-Wframe-larger-than=65536", "-c", f"{sources}/fmi3.c", "-o", "/dev/null"])


@needs_compiler
def test_what_rounds_otherwise_is_refused_by_the_compiler(tmp_path: Path) -> None:
    sources = unpacked_sources("fig02", 2, tmp_path)
    with pytest.raises(AssertionError, match="-ffast-math changes the results of this model; compile it without"):
        compile_c(["-ffast-math", "-c", f"{sources}/fmi2.c", "-o", "/dev/null"])


def unpacked_sources(name: str, version: int, folder: Path) -> Path:
    fmu = fmu_of(load_scene(name), version)
    for path, text in fmu.files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder / "sources"


def compile_c(words: list[str], command: str | None = None) -> None:
    ended = subprocess.run([command or str(compiler()), *words], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


class Linked:
    """The tests' own importer, linked with an FMU."""

    def __init__(self, folder: Path, name: str, *options: str, command: str | None = None) -> None:
        sources = unpacked_sources(name, 2, folder)
        shutil.copy(Path(__file__).parent / "importer.c", folder)
        shutil.copytree(HEADERS, folder / "headers")
        compile_c([*WARNINGS, *options, "-c", str(sources / "fmi2.c"), "-o",
                   str(folder / "model.o")], command)
        compile_c([*WARNINGS, *options, f"-I{folder / 'headers'}", str(folder / "importer.c"), str(folder / "model.o"),
                   "-o", str(folder / "importer"), "-lm"], command)
        described = fmpy.read_model_description(str(folder))
        self._references = {row.name: row.valueReference for row in described.modelVariables}
        self._words = [str(folder / "importer"), described.guid, "0.001"]

    def run(self, script: str) -> list[str]:
        """Return its answers to the lines of a script, with names in place of references."""
        lines = [" ".join(str(self._references.get(word, word)) for word in line.split())
                 for line in script.strip().splitlines()]
        ended = subprocess.run(self._words, input="\n".join(lines) + "\n", capture_output=True, text=True, check=False)
        assert (ended.returncode, ended.stderr) == (0, "")
        return ended.stdout.splitlines()


WRONG = """
step 1
get slip_speed
begin
set pressure.mean nan
set pressure.mean -1
set pressure.mean 1e8
set driveline.stiffness 4000
set slip_speed 1
set 999 1
set stick_slip_state 1
setinteger stick_slip_state
get 999
get stick_slip_state
getinteger slip_speed
step 10
part 0 0.00105
part 0 nan
part 0 0
part 0 -0.001
part 0 1e300
elsewhere 0 0.5
elsewhere 0 nan
set friction.kinetic_coefficient 0.01
step 1
set friction.kinetic_coefficient 0.24
restorenothing
save
serialise 1
serialise
damage
deserialise
getinteger stick_slip_state
time
step 1
get slip_speed
begin
terminate
step 1
set pressure.mean 1e5
terminate
reset
begin
step 11
get slip_speed
save
free
"""
"""Everything that is wrong, the same run beside it: ticks 1 to 11, before and after a reset."""


@needs_compiler
def test_wrong_calls_are_refused_with_a_sentence_and_change_nothing_and_no_sanitizer_says_a_word(
        tmp_path: Path) -> None:
    linked = Linked(tmp_path, "fig02", "-std=c99", "-O0", "-fsanitize=address,undefined",
                    "-fno-sanitize-recover=all")
    said = linked.run(WRONG)
    statuses = [int(line[2:]) for line in said if line.startswith("= ")]
    expected = [3, 0, 0, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3, 0, 2, 2, 2, 2, 2, 3, 3, 0, 2, 0, 3, 0, 3, 0, 0, 3, 0, 0, 0,
                0, 3, 0, 3, 3, 3, 0, 0, 0, 0, 0, 0]
    assert statuses == expected
    assert sum(line.startswith("one ") for line in said) == sum(status > 0 for status in expected)
    sentences = "\n".join(said)
    for sentence in ("other 3 logStatusError: the GUID is not that of this FMU",
                     "one 3 logStatusError: a step needs a simulation that runs",
                     "one 2 logStatusDiscard: pressure.mean is -1",
                     "one 3 logStatusError: driveline.stiffness is fixed; it can be set until the simulation runs",
                     "one 3 logStatusError: slip_speed is calculated and cannot be set",
                     "one 3 logStatusError: stick_slip_state has another type",
                     "the communication step is 0.00105", "ticks of 0.001 s", "0 to 1e+07",
                     "the communication point is 0.5 s; the step before ended at 0.01",
                     "friction.kinetic_coefficient is 0.01; with friction.static_coefficient 0.3 ",
                     "that is no state of this FMU, or it is damaged"):
        assert sentence in sentences
    values = [float.fromhex(line) for line in said if line.startswith(("0x", "-0x"))]
    expected_slip = solved(0.011)[-1]
    assert values == [0.0, 10 * 0.001, expected_slip, expected_slip]


@needs_compiler
def test_products_are_not_fused_where_the_processor_could(tmp_path: Path) -> None:
    if "fma" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no fused products")
    linked = Linked(tmp_path, "fig02", "-std=gnu17", "-O3", "-mfma", "-march=native")
    *_, value, status = linked.run("begin\nstep 400\nget slip_speed")
    assert (float.fromhex(value), status) == (solved(0.4)[-1], "= 0")
