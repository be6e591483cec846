"""Export the real-time tick of a scene as a co-simulation FMU: sources in C99, and a binary if there is a compiler."""

from __future__ import annotations

import hashlib
import math
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError, TccError
from tcc_sim.fmi.c_types import DOUBLE, INT, Keys, Kind, Row, Static, Table, struct_of
from tcc_sim.fmi.printer import Library
from tcc_sim.model import actuator, equations
from tcc_sim.model.actuator import delay_ticks
from tcc_sim.model.equations import COEFFICIENTS, Linear, check_supported
from tcc_sim.model.groups import LARGEST_RATIO, TABLE, TABULATED, Pressure
from tcc_sim.model.parameters import QUANTITIES, System, values_of
from tcc_sim.model.profile import SWELL, SWELLS, Origin, profile_of
from tcc_sim.output.files import draft
from tcc_sim.plant import driveline
from tcc_sim.scene import Scene
from tcc_sim.solvers import fixed_step
from tcc_sim.solvers.terms import SUBSTEP_LIMIT, Terms, holding, stick_speed_of, substeps_needed, terms_from
from tcc_sim.topics import FAR_END, INPUTS, topic

COMPILERS = "cc", "gcc", "clang"
OPTIONS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
TOKEN = "\0"
"""Place of the token for instantiation, a digest of all texts; a scene's texts come without this character."""
DATE = 2020, 1, 1, 0, 0, 0
"""Date of every file in an FMU, so that the same scene gives the same FMU."""
PLATFORMS = {("linux", "x86_64"): ("linux64", "x86_64-linux"), ("linux", "aarch64"): ("", "aarch64-linux"),
             ("darwin", "x86_64"): ("darwin64", "x86_64-darwin"), ("darwin", "arm64"): ("", "aarch64-darwin")}
"""Folders of binaries in FMI 2 (empty if it has no name for the machine) and in FMI 3."""


@dataclass(frozen=True)
class Fmu:
    """Content of an FMU: version of FMI, model identifier, and texts by their path in the FMU."""

    version: int
    identifier: str
    files: dict[str, str]


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
             for name in ("tcc_model.h", "tcc_profile.h", "fmi_shared.h", SOURCES[version])}
    texts["tcc_kernel.h"] = f"/* Terms and tick of tcc_sim, printed from its Python source. */\n{_kernel(scene, rows)}"
    header = variables_header(scene, rows, identifier, step)
    description = model_description(version, scene, rows, identifier, step)
    parts = "".join([*texts.values(), header, description]).replace(TOKEN, "")
    token = f"{{{uuid.UUID(hashlib.sha256(parts.encode()).hexdigest()[:32])}}}"
    texts["tcc_variables.h"] = header.replace(TOKEN, token)
    if version == 3:
        texts["buildDescription.xml"] = build_description(identifier)
    files = {"modelDescription.xml": description.replace(TOKEN, token)}
    files |= {f"sources/{name}": text for name, text in sorted(texts.items())}
    files["documentation/licenses/license.txt" if version == 3 else "documentation/license.txt"] = (
        "Apache-2.0, see https://www.apache.org/licenses/LICENSE-2.0\n")
    return Fmu(version, identifier, files)


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
           sources_only: bool = False, options: Sequence[str] = ()) -> None:
    """Write a scene's FMU to a new file.

    step : length of a tick, s; None for the scene's rate
    options : further options of the compiler

    Raises InputError: the real-time solver cannot run the scene, or the version or step is not allowed; TccError: the
    compiler of this machine refuses the sources.
    """
    fmu = fmu_of(scene, version, step)
    command, folder = compiler(), folder_of_binary(version, sources_only)
    binary = binary_of(fmu, command, options) if folder and command is not None else b""
    with draft(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
        for name, text in fmu.files.items():
            file.writestr(zipfile.ZipInfo(name, DATE), text, zipfile.ZIP_DEFLATED)
        if folder:
            suffix = ".dylib" if sys.platform == "darwin" else ".so"
            file.writestr(zipfile.ZipInfo(f"binaries/{folder}/{fmu.identifier}{suffix}", DATE), binary,
                          zipfile.ZIP_DEFLATED)


def folder_of_binary(version: int, sources_only: bool = False) -> str:
    """Return the folder of the binary that `export` writes on this machine; empty without one."""
    names = PLATFORMS.get((sys.platform, platform.machine()))
    return names[version - 2] if names and not sources_only and compiler() is not None else ""


def _kernel(scene: Scene, rows: list[Variable]) -> str:
    """Return everything from the values of the variables to the state after a tick in C99, printed from its Python
    source. Friction tables are fitted in Python, and C has the numbers of the fit.
    """
    system = scene.system
    known = {row.name.partition("[")[0]: row.word for row in reversed(rows)}
    keys, pressure = Keys(system, "", known.get), Keys(system.pressure, "pressure", known.get)
    shaft, absent = Keys(system.driveline, "driveline", known.get), Static(None)
    torque_commanded, pressure_commanded = (topic(name).wanted(scene.value) for name in INPUTS)
    profile, its_text = _profile_part(system)
    without: frozenset[str] = frozenset()
    for printed in range(2):  # The first time finds the terms that the scene lacks, and a parameter cannot bring.
        library = Library(frozenset({"Friction.curve", "System.varying"}), {
            equations.linear_of: ("py_linear_of", struct_of(Linear, {}, {})), profile_of: ("py_profile_of", profile)})
        origin = library.structure(Origin)
        tables = {"harmonics": Table(3, max(1, len(system.engine.harmonic_amplitudes))), "approach": Table(4, 1),
                  "far": Table(4, 1), "profile": profile}
        terms = struct_of(Terms, tables, {"stribeck": len(system.friction.stribeck or (0.0, 0.0))}, without)
        library.structures[Terms] = terms
        library.declared(terms)
        library.texts[:0] = [_linear_part(), its_text]
        if not printed:
            library.function(terms_from, (keys, origin))
            filled = {"far", "approach"} if pressure_commanded else {"far"}
            without = frozenset(library.absent[Terms] - filled)
    of_torque = [("hold_torque", holding, (terms, DOUBLE, absent))] * torque_commanded
    commanded: list[tuple[str, Any, tuple[Kind, ...]]] = [
        ("hold_pressure", driveline.with_commands, (keys, terms, absent, DOUBLE)),
        ("torque_per_pressure", vars(System)["torque_per_pressure"].fget, (keys,)),
        ("lagged", vars(Pressure)["lagged"].fget, (pressure,)),
        ("largest", driveline.largest, (pressure, DOUBLE, DOUBLE)),
        ("pressure_after", actuator.pressure_after, (DOUBLE,) * 5), ("course", fixed_step.course, (DOUBLE,) * 7)]
    of_scene = [("pressure_at", driveline.pressure_at, (DOUBLE, keys, terms, DOUBLE))]
    for name, function, kinds in [
            ("terms_of", terms_from, (keys, origin)), *of_torque, *(commanded if pressure_commanded else of_scene),
            ("substeps", substeps_needed, (terms, DOUBLE, DOUBLE)), ("stick_speed", stick_speed_of, (terms,)),
            ("origin_after", driveline.origin_after, (keys, keys, origin, DOUBLE)),
            ("initial_state", fixed_step.initial_state, (keys,)),
            ("advance", fixed_step.advance, (Row(writable=True), DOUBLE, DOUBLE, INT, terms, absent)),
            ("engine_and_friction", fixed_step.engine_and_friction, (DOUBLE, DOUBLE, terms)),
            ("shaft_torque", driveline.shaft_torque, (shaft, DOUBLE, DOUBLE)),
            ("side_of_slip", driveline.side_of_slip, (DOUBLE, DOUBLE))]:
        library.entry(f"tcc_{name}", function, *kinds)
    return library.text()


def _profile_part(system: System) -> tuple[Table, str]:
    """Return the type of a scene's profile, and a C function that fills it by the lines of the excitation."""
    engine = system.engine
    names = ["engine.frequency", "engine.mean_torque", "pressure.mean"]
    lines = [(name, len(system.value(f"{name}_times")), 1, 0, 0, -1) for name in names]
    if engine.harmonic and engine.torque_amplitude_times:
        lines.append(("engine.torque_amplitude", len(engine.torque_amplitude_times), 1, 0, 1, -1))
    if engine.harmonic and engine.harmonic_amplitudes_times:
        count = len(engine.harmonic_phases)
        lines += [("engine.harmonic_amplitudes", len(engine.harmonic_amplitudes_times), count, k, k + 2, k)
                  for k in range(count)]
    rows = []
    for name, points, apart, first, number, phase in lines:
        word = f"at_{name.replace('.', '_')}"
        values = f"{word}_values + {first}" if points else word
        rows.append(f"{{{f'{word}_times' if points else 0}, {values}, {apart}, {points}, {number}, "
                    f"{'-1' if phase < 0 else f'at_engine_harmonic_phases + {phase}'}}}")
    kind = Table(SWELLS + SWELL * (len(lines) - len(names)), 1 + sum(line[1] for line in lines))
    time, phase_then = ("0.0", "0.0") if engine.frequency_times else ("origin->time", "origin->phase")
    return kind, f"""\
static void py_profile_of(const double *x, const double *pressure, const Origin *origin, {kind.title} *made)
{{
    static const tcc_line lines[] = {{{", ".join(rows)}}};
    (void)pressure;
    (void)origin;
    made->has = 1;
    made->rows = tcc_profile(x, lines, {len(lines)}, {time}, {phase_then}, &made->at[0][0], {kind.columns});
}}"""


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


BASE_UNITS = {"N": {"kg": 1, "m": 1, "s": -2}, "Pa": {"kg": 1, "m": -1, "s": -2}, "m": {"m": 1}, "s": {"s": 1},
              "kg": {"kg": 1}, "rad": {"rad": 1}}
TYPES = {"rad/s": "AngularVelocity", "rad": "Angle", "N m": "Torque", "Pa": "Pressure", "Pa/s": "PressureRate",
         "kg m^2": "Inertia", "N m s/rad": "Damping", "N m/rad": "Stiffness", "s/rad": "Slowness", "m^2": "Area",
         "m": "Length", "s": "Time", "": "Number"}
"""Declared types by unit; a unit without a row makes a name of its own."""
ACTUATOR = "pressure.time_constant", "pressure.rate_limit"
"""Keys of the actuator that are parameters."""
UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML does not allow: control characters, and bytes of a file's name that are not UTF-8."""
SOURCES = {2: "fmi2.c", 3: "fmi3.c"}
"""File to compile, by version of FMI; it includes the others."""
TEXT = ("The clutch driveline {name} of tcc_sim in its real-time ticks of {step:g} s: {description}. The friction law "
        "is {law}; inputs are held through every step, whose length is a whole number of ticks. No Python is needed.")
OUTPUTS = (
    ("slip_speed", "rad/s", "slip speed v, flywheel speed minus plate speed"),
    ("friction_torque", "N m", "friction torque on the clutch plate"),
    ("flywheel_angle", "rad", "flywheel angle theta1"), ("flywheel_speed", "rad/s", "flywheel speed"),
    ("plate_angle", "rad", "clutch plate angle theta2"), ("plate_speed", "rad/s", "clutch plate speed"),
    ("applied_engine_torque", "N m", "engine torque that acts at the end of the step"),
    ("applied_pressure", "Pa", "actuation pressure that acts at the end of the step"),
    ("shaft_torque", "N m", "torque of spring and damper, C23 (theta2' - theta3') + K23 (theta2 - theta3), where "
     "theta3 is the angle of the shaft's far end, 0 at the start"))


@dataclass(frozen=True)
class Variable:
    """Variable of an FMU; its index in the list is its value reference.

    causality : independent, input, output or parameter
    variability : continuous, discrete, fixed or tunable
    start : None for a calculated variable
    low, high : allowed range, with `above` without its lower end; infinite: not checked
    kind : real or integer
    """

    name: str
    causality: str
    variability: str
    unit: str
    description: str
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    kind: str = "real"

    @property
    def word(self) -> str:
        """Name in C; the elements of a list share one name."""
        return "at_" + re.sub(r"\W", "_", re.sub(r"\[1\]$", "", self.name)).rstrip("_")


def variables(scene: Scene) -> list[Variable]:
    """Return the variables of a scene's FMU: time, inputs for commanded inputs, outputs, and parameters.

    Value reference 0 is time, which FMI 3 requires. The description for FMI 2 omits it, since an importer (FMI Library)
    expects a start value.
    """
    rows = [Variable("time", "independent", "continuous", "s", "time; that of the scene's excitation begins with 0 "
                     "at the start")]
    for name in INPUTS:
        row = topic(name)
        if row.wanted(scene.value):
            meant, start = QUANTITIES[row.key], scene.value(row.key)
            assert isinstance(start, float)
            rows.append(Variable(name, "input", "continuous", meant.unit, f"{name.replace('_', ' ')}, held through "
                                 "each step", start, meant.low, meant.high))
    rows += [Variable(name, "output", "continuous", unit, text) for name, unit, text in OUTPUTS]
    rows.append(Variable("stick_slip_state", "output", "discrete", "", "-1 negative slip, 0 stick, 1 positive slip",
                         kind="integer"))
    meant = QUANTITIES[topic(FAR_END).key]
    rows.append(Variable(FAR_END, "input", "continuous", meant.unit, "speed of the shaft's far end, held through each "
                         "step; 0 holds it still, as the paper does", 0.0, meant.low, meant.high))
    return [*rows, *_parameters(scene)]


def _parameters(scene: Scene) -> Iterator[Variable]:
    """Iterate over the numbers of the scene, with one variable for each element of a list."""
    for key, value in values_of(scene.system):
        meant = QUANTITIES[key]
        if isinstance(value, str) or key in TABLE or key == "engine.order" or _replaced(scene.system, key):
            continue
        many = isinstance(value, tuple)
        for place, number in enumerate(value if isinstance(value, tuple) else (value,), 1):
            yield Variable(f"{key}[{place}]" if many else key, "parameter", "tunable" if meant.live else "fixed",
                           meant.unit, meant.description, number, meant.low, meant.high, meant.above)


def _replaced(system: System, key: str) -> bool:
    """Return whether a number is no parameter: replaced by a profile or table, fixed (dead time), or of an actuator
    without commanded pressure.
    """
    commanded = not system.pressure.harmonic and not system.pressure.mean_times
    return (f"{key}_times" in system.varying or (key in TABULATED and system.friction.curve is not None)
            or key == "pressure.delay" or (key in ACTUATOR and not commanded))


def variables_header(scene: Scene, rows: list[Variable], identifier: str, step: float) -> str:
    """Return the text of tcc_variables.h: settings of the scene, and the table of variables."""
    system = scene.system
    roles = {"input": "TCC_INPUT", "fixed": "TCC_FIXED", "tunable": "TCC_TUNABLE"}
    lines = []
    for row in rows:
        role = "TCC_CALCULATED" if row.start is None else roles[
            "input" if row.causality == "input" else row.variability]
        low, high = ("0.0" if math.isinf(bound) else repr(bound) for bound in (row.low, row.high))
        lines.append(f'    {{"{row.name}", {role}, TCC_{row.kind.upper()}, {float(row.start or 0.0)!r}, {low}, {high}, '
                     f'{int(row.above)}}}')
    places = [f"{row.word} = {place}" for place, row in enumerate(rows)
              if not re.search(r"\[(?!1\])\d+\]$", row.name)]
    # An empty list and a replaced number need a reference, which the kernel does not read.
    places += [f"at_{key.replace('.', '_')} = 0" for key, value in values_of(system)
               if value == () or _replaced(system, key)]
    places += [f"at_{name} = 0" for name in INPUTS if not topic(name).wanted(scene.value)]
    settings: dict[str, float] = {
        "SUBSTEP_LIMIT": SUBSTEP_LIMIT, "LARGEST_RATIO": LARGEST_RATIO, "TABLE": system.friction.curve is not None,
        "ENGINE_TOPIC": system.engine.source == "topic", "PRESSURE_TOPIC": system.pressure.source == "topic",
        "DELAY_TICKS": delay_ticks(system.pressure, step), "PROFILES": len(system.varying)}
    times = ", ".join(f"{{at_{key.replace('.', '_')}, {len(system.value(key))}}}" for key in system.varying)
    defined = "\n".join(f"#define TCC_{name} {value + 0}" for name, value in settings.items())
    body = ",\n    ".join(places)
    return f"""\
/* {identifier}: the scene's variables and settings, written by tcc_sim. */
#define TCC_TOKEN "{TOKEN}"
#define TCC_STEP {step!r}
{defined}
#define TCC_VARIABLES {len(rows)}
typedef enum {{ TCC_CALCULATED, TCC_INPUT, TCC_FIXED, TCC_TUNABLE }} tcc_role;
typedef enum {{ TCC_REAL, TCC_INTEGER }} tcc_type;
typedef struct {{ const char *name; tcc_role role; tcc_type type; double start, low, high; int above; }} tcc_variable;
enum {{
    {body}
}};
static const tcc_variable tcc_variables[TCC_VARIABLES] = {{
{(',' + chr(10)).join(lines)}
}};
/* Reference of the first time of every profile, and their number. */
static const int tcc_times[][2] = {{{times or "{0, 0}"}}};
"""


def _declared(unit: str) -> str:
    return TYPES.get(unit) or "".join(re.findall(r"\w+", unit.replace("/", " per ")))


def base_units(unit: str) -> dict[str, int]:
    """Return the exponents of SI's base units, and of rad, in a unit such as `N m s/rad`."""
    exponents: dict[str, int] = {}
    for part, sign in zip(unit.split("/"), (1, -1)):
        for word in part.split():
            name, _, power = word.partition("^")
            for base, exponent in BASE_UNITS[name].items():
                exponents[base] = exponents.get(base, 0) + sign * exponent * int(power or 1)
    return {base: exponent for base, exponent in exponents.items() if exponent}


def model_description(version: int, scene: Scene, rows: list[Variable], identifier: str, step: float) -> str:
    """Return the text of modelDescription.xml, with the rows in the order of their value references."""
    text = UNPRINTABLE.sub("\ufffd", TEXT.format(name=scene.name, step=step, law=scene.system.friction.law,
                                                 description=scene.description or scene.name))
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": identifier, "guid" if version == 2 else "instantiationToken": TOKEN,
        "description": text, "generationTool": f"tcc_sim {code_version()}", "license": "Apache-2.0",
        "variableNamingConvention": "structured"})
    can = {"modelIdentifier": identifier, "canHandleVariableCommunicationStepSize": "true"}
    if version == 2:
        engine = ET.SubElement(root, "CoSimulation", {
            **can, "canInterpolateInputs": "false", "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
            "canNotUseMemoryManagementFunctions": "true"})
        ET.SubElement(ET.SubElement(engine, "SourceFiles"), "File", {"name": SOURCES[2]})
    else:
        ET.SubElement(root, "CoSimulation", {**can, "fixedInternalStepSize": repr(step), "canGetAndSetFMUState": "true",
                                             "canSerializeFMUState": "true"})
    _units_and_types(version, root, rows)
    categories = ET.SubElement(root, "LogCategories")
    for name, meaning in (("logStatusDiscard", "a value or a step was refused; nothing has changed"),
                          ("logStatusError", "a call that is not allowed in this state; nothing has changed")):
        ET.SubElement(categories, "Category", {"name": name, "description": meaning})
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stopTime": "10.0", "stepSize": repr(step)})
    listed = ET.SubElement(root, "ModelVariables")
    for reference, row in enumerate(rows):
        if version == 3 or row.causality != "independent":
            _variable(version, listed, reference, row)
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [str(place) for place, row in enumerate(rows) if row.causality == "output"]
    if version == 2:
        for title in ("Outputs", "InitialUnknowns"):
            section = ET.SubElement(structure, title)
            for place in outputs:  # Indices count the variables from 1, references from 0 with time.
                ET.SubElement(section, "Unknown", {"index": place})
    else:
        for title in ("Output", "InitialUnknown"):
            for place in outputs:
                ET.SubElement(structure, title, {"valueReference": place})
    return _written(root)


def _units_and_types(version: int, root: ET.Element, rows: list[Variable]) -> None:
    units = list(dict.fromkeys(row.unit for row in rows if row.kind == "real"))
    definitions = ET.SubElement(root, "UnitDefinitions")
    types = ET.SubElement(root, "TypeDefinitions")
    for unit in units:
        quantity = {"quantity": _declared(unit)}
        if unit:
            quantity["unit"] = unit.replace(" ", ".")  # Importers write products with dots: kg.m^2.
            one = ET.SubElement(definitions, "Unit", {"name": quantity["unit"]})
            ET.SubElement(one, "BaseUnit", {base: str(power) for base, power in base_units(unit).items()})
        if version == 2:
            ET.SubElement(ET.SubElement(types, "SimpleType", {"name": _declared(unit)}), "Real", quantity)
        else:
            ET.SubElement(types, "Float64Type", {"name": _declared(unit), **quantity})


def _variable(version: int, listed: ET.Element, reference: int, row: Variable) -> None:
    head = {"name": row.name, "valueReference": str(reference), "causality": row.causality,
            "variability": row.variability, "description": row.description}
    if row.causality == "parameter":
        head["initial"] = "exact"
    elif row.causality == "output":
        head["initial"] = "calculated"
    real = row.kind == "real"
    values = {"declaredType": _declared(row.unit)} if real else {}
    values |= {name: repr(bound) for name, bound in (("min", row.low), ("max", row.high)) if math.isfinite(bound)}
    if not real:
        values |= {"min": "-1", "max": "1"}
    if row.start is not None:
        values["start"] = repr(float(row.start))
    if version == 2:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", head), "Real" if real else "Integer", values)
    else:
        ET.SubElement(listed, "Float64" if real else "Int32", {**head, **values})


def build_description(identifier: str) -> str:
    """Return the text of buildDescription.xml, by which importers of FMI 3.0 compile the sources."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    ET.SubElement(files, "SourceFile", {"name": SOURCES[3]})
    ET.SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return _written(root)


def _written(root: ET.Element) -> str:
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
