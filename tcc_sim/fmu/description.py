"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of 3.0."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from tcc_sim import __version__
from tcc_sim.fmu.variables import Variable
from tcc_sim.scene import Scene

BASE_UNITS = {"N": {"kg": 1, "m": 1, "s": -2}, "Pa": {"kg": 1, "m": -1, "s": -2}, "m": {"m": 1}, "s": {"s": 1},
              "kg": {"kg": 1}, "rad": {"rad": 1}}
TYPES = {"rad/s": "AngularVelocity", "rad": "Angle", "N m": "Torque", "Pa": "Pressure", "kg m^2": "Inertia",
         "N m s/rad": "Damping", "N m/rad": "Stiffness", "s/rad": "Slowness", "m^2": "Area", "m": "Length",
         "s": "Time", "": "Number"}
"""Declared types by unit."""
SOURCES = {2: "fmi2.c", 3: "fmi3.c"}
"""The one file that is compiled; it includes the others."""
TEXT = ("The clutch driveline {name} of tcc_sim in its real-time ticks of {step:g} s: {description}. The friction law "
        "is {law}; inputs are held through every step, whose length is a whole number of ticks. No Python is needed.")


def unit_name(unit: str) -> str:
    """A unit as importers write it, with dots for products: kg.m^2."""
    return unit.replace(" ", ".")


def base_units(unit: str) -> dict[str, int]:
    """The exponents of SI's base units, and of rad, in a unit such as `N m s/rad`."""
    found: dict[str, int] = {}
    for part, sign in zip(unit.split("/"), (1, -1)):
        for word in part.split():
            name, _, power = word.partition("^")
            for base, exponent in BASE_UNITS[name].items():
                found[base] = found.get(base, 0) + sign * exponent * int(power or 1)
    return {base: exponent for base, exponent in found.items() if exponent}


def model_description(version: int, scene: Scene, rows: list[Variable], identifier: str, token: str,
                      step: float) -> str:
    """The text of modelDescription.xml.

    Parameters
    ----------
    version : of FMI, 2 or 3
    rows : the variables, in the order of their references
    identifier, token : of the model, and what an importer instantiates it with
    step : a tick, s
    """
    text = TEXT.format(name=scene.name, step=step, description=scene.description or scene.name,
                       law=scene.system.friction.law)
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": identifier, "guid" if version == 2 else "instantiationToken": token,
        "description": text, "generationTool": f"tcc_sim {__version__}", "license": "Apache-2.0",
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
                          ("logStatusError", "a call that has no place there; nothing has changed")):
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
    """The units of the variables, and a declared type for each."""
    units = list(dict.fromkeys(row.unit for row in rows if row.kind == "real"))
    definitions = ET.SubElement(root, "UnitDefinitions")
    types = ET.SubElement(root, "TypeDefinitions")
    for unit in units:
        quantity = {"quantity": TYPES[unit]}
        if unit:
            one = ET.SubElement(definitions, "Unit", {"name": unit_name(unit)})
            ET.SubElement(one, "BaseUnit", {base: str(power) for base, power in base_units(unit).items()})
            quantity["unit"] = unit_name(unit)
        if version == 2:
            ET.SubElement(ET.SubElement(types, "SimpleType", {"name": TYPES[unit]}), "Real", quantity)
        else:
            ET.SubElement(types, "Float64Type", {"name": TYPES[unit], **quantity})


def _variable(version: int, listed: ET.Element, reference: int, row: Variable) -> None:
    """One variable."""
    head = {"name": row.name, "valueReference": str(reference), "causality": row.causality,
            "variability": row.variability, "description": row.description}
    if row.causality == "parameter":
        head["initial"] = "exact"
    elif row.causality == "output":
        head["initial"] = "calculated"
    real = row.kind == "real"
    values = {"declaredType": TYPES[row.unit]} if real else {}
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
    """The text of buildDescription.xml: how importers of FMI 3.0 compile the sources."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    ET.SubElement(files, "SourceFile", {"name": SOURCES[3]})
    ET.SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return _written(root)


def _written(root: ET.Element) -> str:
    """XML as text."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
