"""Variables of an FMU, and their files: tcc_variables.h, modelDescription.xml and buildDescription.xml."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from tcc_sim.code_version import code_version
from tcc_sim.model.actuator import delay_ticks
from tcc_sim.model.groups import LARGEST_RATIO, TABLE, TABULATED
from tcc_sim.model.parameters import QUANTITIES, System, values_of
from tcc_sim.scene import Scene
from tcc_sim.solvers.terms import SUBSTEP_LIMIT
from tcc_sim.topics import FAR_END, INPUTS, topic

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


def variables_header(scene: Scene, rows: list[Variable], identifier: str, token: str, step: float) -> str:
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
#define TCC_TOKEN "{token}"
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


def unit_name(unit: str) -> str:
    """Return a unit as importers write it, with dots for products: kg.m^2."""
    return unit.replace(" ", ".")


def _declared(unit: str) -> str:
    """Return the name of a unit's declared type."""
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


def model_description(version: int, scene: Scene, rows: list[Variable], identifier: str, token: str,
                      step: float) -> str:
    """Return the text of modelDescription.xml.

    Parameters
    ----------
    version : version of FMI, 2 or 3
    rows : variables in the order of their value references
    identifier, token : model identifier, and token for instantiation
    step : length of a tick, s
    """
    text = UNPRINTABLE.sub("\ufffd", TEXT.format(name=scene.name, step=step, law=scene.system.friction.law,
                                                 description=scene.description or scene.name))
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": identifier, "guid" if version == 2 else "instantiationToken": token,
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
    """Add the units of the variables, and a declared type for each."""
    units = list(dict.fromkeys(row.unit for row in rows if row.kind == "real"))
    definitions = ET.SubElement(root, "UnitDefinitions")
    types = ET.SubElement(root, "TypeDefinitions")
    for unit in units:
        quantity = {"quantity": _declared(unit)}
        if unit:
            one = ET.SubElement(definitions, "Unit", {"name": unit_name(unit)})
            ET.SubElement(one, "BaseUnit", {base: str(power) for base, power in base_units(unit).items()})
            quantity["unit"] = unit_name(unit)
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
