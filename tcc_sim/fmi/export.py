"""Export the real-time tick of a scene as a co-simulation FMU: sources in C99, and a binary if there is a compiler."""

from __future__ import annotations

import hashlib
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, TccError
from tcc_sim.fmi.c_types import DOUBLE, INT, Keys, Kind, Row, Static, Struct, Table, struct_of
from tcc_sim.fmi.description import (
    SOURCES,
    Variable,
    build_description,
    model_description,
    variables,
    variables_header,
)
from tcc_sim.fmi.printer import Library
from tcc_sim.model import actuator, equations
from tcc_sim.model.equations import COEFFICIENTS, Linear
from tcc_sim.model.groups import Engine, Pressure
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import Origin, profile_of
from tcc_sim.model.supported_terms import check_supported
from tcc_sim.output.files import draft
from tcc_sim.plant import driveline
from tcc_sim.scene import Scene
from tcc_sim.solvers import fixed_step
from tcc_sim.solvers.terms import Terms, holding, stick_speed_of, substeps_needed, terms_from
from tcc_sim.topics import INPUTS, topic

COMPILERS = "cc", "gcc", "clang"
OPTIONS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
DATE = 2020, 1, 1, 0, 0, 0
"""Date of every file in an FMU, so that the same scene gives the same FMU."""
PLATFORMS = {("linux", "x86_64"): ("linux64", "x86_64-linux"), ("linux", "aarch64"): ("", "aarch64-linux"),
             ("darwin", "x86_64"): ("darwin64", "x86_64-darwin"), ("darwin", "arm64"): ("", "aarch64-darwin")}
"""Folders of binaries in FMI 2 (empty if it has no name for the machine) and in FMI 3."""


@dataclass(frozen=True)
class Fmu:
    """Content of an FMU: version of FMI, model identifier, texts by their path in the FMU, and variables."""

    version: int
    identifier: str
    files: dict[str, str]
    variables: list[Variable]


def fmu_of(scene: Scene, version: int = 2, step: float | None = None) -> Fmu:
    """Return the content of a scene's FMU; parameters and InputError as in `export`."""
    if version not in SOURCES:
        raise InputError(f"FMI version {version} is not known; it must be 2 or 3")
    step = 1.0 / scene.operation.rate if step is None else step
    if not 1.0 / 20000.0 <= step <= 1.0:
        raise InputError(f"step is {step:g} s; it must be 5e-05 to 1 s")
    actuator.delay_ticks(scene.system.pressure, step)
    fixed_step.Stepper(scene.system, step)  # Raises InputError for a scene that it cannot run.
    check_supported("FMU", scene.system, "an FMU")
    rows = variables(scene)
    identifier = f"tcc_sim_{re.sub(r'[^A-Za-z0-9_]', '_', scene.name)}"
    texts = {name: resources.files(__package__).joinpath(f"c/{name}").read_text(encoding="utf-8")
             for name in ("tcc_model.h", "fmi_shared.h", SOURCES[version])}
    texts["tcc_kernel.h"] = f"/* Terms and tick of tcc_sim, printed from its Python source. */\n{_kernel(scene, rows)}"
    parts = "".join([*texts.values(), variables_header(scene, rows, identifier, "", step),
                     model_description(version, scene, rows, identifier, "", step)])
    token = f"{{{uuid.UUID(hashlib.sha256(parts.encode()).hexdigest()[:32])}}}"
    texts["tcc_variables.h"] = variables_header(scene, rows, identifier, token, step)
    if version == 3:
        texts["buildDescription.xml"] = build_description(identifier)
    files = {"modelDescription.xml": model_description(version, scene, rows, identifier, token, step)}
    files |= {f"sources/{name}": text for name, text in sorted(texts.items())}
    files["documentation/licenses/license.txt" if version == 3 else "documentation/license.txt"] = (
        "Apache-2.0, see https://www.apache.org/licenses/LICENSE-2.0\n")
    return Fmu(version, identifier, files, rows)


def compiler() -> str | None:
    """Return the path of a C compiler on this machine, or None."""
    return next((path for name in COMPILERS if (path := shutil.which(name))), None)


def binary_of(fmu: Fmu, command: str, options: Sequence[str] = ()) -> bytes:
    """Return the binary for this machine; raise TccError with the compiler's message if it refuses the sources.

    options : of the compiler, after those of this package
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in fmu.files.items():
            if path.startswith("sources/"):
                (folder / Path(path).name).write_text(text, encoding="utf-8")
        ended = subprocess.run([command, *OPTIONS, *options, SOURCES[fmu.version], "-o", "binary", "-lm"], cwd=folder,
                               check=False, capture_output=True, text=True)
        if ended.returncode:
            raise TccError(f"{command} does not compile the sources of the FMU: {ended.stderr.strip() or 'no reason'}")
        return (folder / "binary").read_bytes()


def export(scene: Scene, path: Path, version: int = 2, step: float | None = None, *,
           sources_only: bool = False, options: Sequence[str] = ()) -> str:
    """Write a scene's FMU to a new file; return the folder of its binary, empty without a binary.

    Parameters
    ----------
    version : version of FMI, 2 or 3
    step : length of a tick, s; None for the scene's rate
    sources_only : whether to omit the binary
    options : further options of the compiler

    Raises
    ------
    InputError
        The real-time solver cannot run the scene, or the version or step is not allowed.
    TccError
        The compiler of this machine refuses the sources.
    """
    fmu = fmu_of(scene, version, step)
    command, names = compiler(), PLATFORMS.get((sys.platform, platform.machine()))
    folder = names[version - 2] if names else ""
    with_binary = not sources_only and command is not None and bool(folder)
    binary = binary_of(fmu, command, options) if with_binary and command is not None else b""
    with draft(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
        for name, text in fmu.files.items():
            file.writestr(zipfile.ZipInfo(name, DATE), text, zipfile.ZIP_DEFLATED)
        if with_binary:
            suffix = ".dylib" if sys.platform == "darwin" else ".so"
            file.writestr(zipfile.ZipInfo(f"binaries/{folder}/{fmu.identifier}{suffix}", DATE), binary,
                          zipfile.ZIP_DEFLATED)
    return folder if with_binary else ""


def _kernel(scene: Scene, rows: list[Variable]) -> str:
    """Return everything from the values of the variables to the state after a tick in C99, printed from its Python
    source. Friction tables are fitted in Python, and C has the numbers of the fit.
    """
    system = scene.system
    known = {row.name.partition("[")[0]: row.word for row in reversed(rows)}
    keys, engine, pressure = (Keys(value, name, known.get) for name, value in (
        ("", system), ("engine", system.engine), ("pressure", system.pressure)))
    without: frozenset[str] = frozenset()
    for printed in range(2):  # The first time finds the terms that the scene lacks, and a parameter cannot bring.
        library = Library(frozenset({"Friction.curve", "System.varying"}), {
            equations.linear_of: ("py_linear_of", struct_of(Linear, {}, {})),
            **({} if system.varying else {profile_of: _constant_profile})})
        origin = library.structure(Origin)
        _, profile = library.function(profile_of, (engine, pressure, Static(None), origin))
        assert isinstance(profile, Table)
        tables = {"harmonics": Table(3, max(1, len(system.engine.harmonic_amplitudes))), "approach": Table(4, 1),
                  "far": Table(4, 1), "profile": profile}
        terms = struct_of(Terms, tables, {"stribeck": len(system.friction.stribeck or (0.0, 0.0))}, without)
        library.structures[Terms] = terms
        library.declared(terms)
        library.texts.insert(0, _linear_part())
        if not printed:
            library.function(terms_from, (keys, origin))
            filled = {"far", "approach"} if topic(INPUTS[1]).wanted(scene.value) else {"far"}
            without = frozenset(library.absent[Terms] - filled)
    for name, function, kinds in _entries(scene, terms, origin, keys, pressure,
                                          Keys(system.driveline, "driveline", known.get)):
        library.entry(f"tcc_{name}", function, *kinds)
    return library.text()


def _constant_profile(engine: Engine, pressure: Pressure, inputs: Any, origin: Origin) -> NDArray[np.float64]:
    """Return what `profile_of` does for means that do not vary: one row, which holds the phase after a change."""
    return np.array([[origin.time, origin.phase, engine.frequency, 0.0, engine.mean_torque, 0.0, pressure.mean, 0.0,
                      0.0, 0.0, 0.0]])


def _entries(scene: Scene, terms: Struct, origin: Struct, keys: Keys, pressure: Keys,
             shaft: Keys) -> list[tuple[str, Any, tuple[Kind, ...]]]:
    """Return the functions that tcc_model.h calls: name there, the Python, and types of its arguments."""
    absent = Static(None)
    of_torque = [("hold_torque", holding, (terms, DOUBLE, absent))] * topic(INPUTS[0]).wanted(scene.value)
    commanded = [
        ("hold_pressure", driveline.with_commands, (keys, terms, absent, DOUBLE)),
        ("torque_per_pressure", _getter(System, "torque_per_pressure"), (keys,)),
        ("lagged", _getter(Pressure, "lagged"), (pressure,)),
        ("largest", driveline.largest, (pressure, DOUBLE, DOUBLE)),
        ("pressure_after", actuator.pressure_after, (DOUBLE,) * 5), ("course", fixed_step.course, (DOUBLE,) * 7)]
    of_scene = [("pressure_at", driveline.pressure_at, (DOUBLE, keys, terms, DOUBLE))]
    return [
        ("terms_of", terms_from, (keys, origin)), *of_torque,
        *(commanded if topic(INPUTS[1]).wanted(scene.value) else of_scene),
        ("substeps", substeps_needed, (terms, DOUBLE, DOUBLE)), ("stick_speed", stick_speed_of, (terms,)),
        ("origin_after", driveline.origin_after, (keys, keys, origin, DOUBLE)),
        ("initial_state", fixed_step.initial_state, (keys,)),
        ("advance", fixed_step.advance, (Row(writable=True), DOUBLE, DOUBLE, INT, terms, Static(True), absent)),
        ("engine_and_friction", fixed_step.engine_and_friction, (DOUBLE, DOUBLE, terms)),
        ("shaft_torque", driveline.shaft_torque, (shaft, DOUBLE, DOUBLE)),
        ("side_of_slip", driveline.side_of_slip, (DOUBLE, DOUBLE))]


def _getter(owner: type[Any], name: str) -> Any:
    return vars(owner)[name].fget


def _linear_part() -> str:
    """Return a C function printed from `model.equations.COEFFICIENTS`: the linear part of the values."""
    lines = "\n".join(f"    linear->{name} += {share!r} * x[at_{key.replace('.', '_')}];"
                      for key, shares in COEFFICIENTS.items() for name, share in shares.items())
    return f"""\
static void py_linear_of(const double *x, Linear *linear)
{{
    memset(linear, 0, sizeof *linear);
{lines}
}}"""
