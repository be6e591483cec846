"""Head of every JSON document: format, version of the package, scene with every key, command, and units of the fields,
read from the classes of results.

Keys may be added within a format; a key that changes its meaning makes a new one.
"""

from __future__ import annotations

import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from tcc_sim.analysis.measured.orders import Orders
from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.code_version import code_version
from tcc_sim.model.parameters import DERIVED, QUANTITIES, System, values_of
from tcc_sim.result import fields_of, json_of, reported_of
from tcc_sim.scene import Scene
from tcc_sim.shown_units import selected_units
from tcc_sim.topics import TOPICS
from tcc_sim.trajectory import UNITS

FORMATS: dict[str, int] = {
    "simulate": 1, "analyse": 1, "sweep": 1, "sweep_points": 1, "continue": 1, "basins": 1, "basin_rows": 1,
    "explain": 1, "figure": 1, "claims": 1, "precision": 1, "stability": 1, "realtime": 1,
    "linearise": 1, "identify": 1}
"""Format number of each kind of JSON; files of sweep_points and basin_rows have one line per point or row."""
HEAD = {"format": "kind of file and number of its format",
        "version": "release that wrote it, and a digest of its code",
        "scene": "every key of the scene, and node options of a whole one; of identify before the fit",
        "environment": "versions of python, numpy, scipy and numba (null where not installed), and the "
                       "processor",
        "command": "arguments of tcc-sim, the verb first", "units": "unit by field",
        "title": "title of a picture of the result",
        "shown_units": "unit of speeds in printed lines and pictures: rad, rpm or hz",
        "warnings": "sentences on the scene, if any"}
"""Keys that begin every JSON, with their meaning."""
KNOWN = {**{entry.name or name: entry.unit for kind in (Damping, Summary, Orders)
            for name, entry in reported_of(kind).items()}, **UNITS, **{row.name: row.unit for row in TOPICS}}
"""Units by the names of results, signals and topics."""
REFERENCE = re.compile(r"{([\w*]+)}")


def format_of(kind: str) -> str:
    """Return name and number of the format of one kind of JSON."""
    return f"tcc_sim {kind} {FORMATS[kind]}"


def head_of(kind: str, scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """Return the keys that begin every JSON and every file of points: five, and `warnings` if the scene has any.

    kind : a key of FORMATS
    scene : the solved or recorded scene; for several scenes, the one from which they differ
    command : arguments of `tcc-sim`, the verb first
    """
    values = {"format": format_of(kind), "version": code_version(), "environment": environment(),
              "scene": scene_values(scene), "command": list(command)}
    return {**values, "warnings": warnings} if (warnings := warnings_of(scene)) else values


@cache
def environment() -> dict[str, str | None]:
    """Return the versions of the packages that compute, without loading them, and the name of the processor."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for name in ("numpy", "scipy", "numba"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return {**versions, "processor": line.partition(":")[2].strip()}
    return {**versions, "processor": platform.processor() or platform.machine()}


def warnings_of(scene: Scene | System) -> list[str]:
    """Return the warnings about a scene that accompany every result."""
    return (scene if isinstance(scene, Scene) else Scene("system", scene)).warnings()


def document(kind: str, result: Any, scene: Scene | System, command: Sequence[str], title: str = "") -> dict[str, Any]:
    """Return a result as JSON values, with the head (see `head_of`), the units of its fields, and the title and unit of
    its picture.
    """
    head = {**head_of(kind, scene, command), "units": units_in(result), "title": title, "shown_units": selected_units()}
    values = json_of(result)
    if "warnings" in values:  # A recording has its own.
        head["warnings"] = [*head.get("warnings", []), *values["warnings"]]
    return {**head, **{key: value for key, value in values.items() if key not in head}}


def scene_values(scene: Scene | System) -> dict[str, Any]:
    """Return every key of a scene with its value; `Scene.with_values` makes the same scene from them.

    For a System, which has no node options, those are left out.
    """
    values = dict(values_of(scene)) if isinstance(scene, System) else scene.values()
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def unit_of_key(key: str) -> str:
    """Return the unit of a scene key, a result, a signal or its offset; empty for a dimensionless one."""
    meant = {**QUANTITIES, **DERIVED}.get(key)
    return meant.unit if meant is not None else KNOWN.get(key.removesuffix(".offset"), "")


def units_in(result: Any) -> dict[str, str]:
    """Return the units of a result's fields in JSON, by names joined with dots; fields without a unit are left out.

    A field of the entries of a list or a mapping has one name for all entries; if its units differ, the names contain
    the numbers of the entries.
    """
    return {path: unit for path, unit in _units(result, "", ()) if unit}


def _units(value: Any, path: str, owners: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    """Yield path and unit (maybe empty) of the fields below a value; `owners` contain it, the nearest one first."""
    if isinstance(value, Mapping):
        yield from _units(list(value.values()), path, owners)
    elif _is_list(value):
        by_element = [dict(_units(part, path, owners)) for part in value]
        for name in dict.fromkeys(name for units in by_element for name in units):
            units = {k: one[name] for k, one in enumerate(by_element) if name in one}
            if len(set(units.values())) == 1:
                yield name, units[min(units)]
            else:
                yield from ((f"{path[:-1]}[{k}].{name[len(path):]}", unit) for k, unit in units.items())
    elif is_dataclass(value):
        owners = (value, *owners)
        for name, entry in reported_of(type(value)).items():
            part = getattr(value, name)
            if part is None:
                continue
            below = path if entry.spread or entry.listed else f"{path}{entry.name or name}."
            if entry.of and not (is_dataclass(part) or _is_list(part)):
                yield from _units_of_class(entry.of[0], part, below, owners)
                continue
            if entry.unit == "{*}":
                yield from ((below + key, unit_of_key(key)) for key in part)
            elif entry.unit:
                yield below[:-1], _resolved(entry.unit, owners)
            else:
                yield from _units(part, below, owners)


def _is_list(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and any(map(is_dataclass, value[:1]))


def _units_of_class(kind: type, values: Any, path: str, owners: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    """Yield path and unit of the fields of a class in a mapping, or in a list of results or mappings."""
    first = values if isinstance(values, Mapping) else next(iter(values), {})
    for field, entry in fields_of(kind):
        if (is_dataclass(first) or field.partition(".")[0] in first) and (unit := _resolved(entry.unit, owners)):
            yield path + field, unit


def _resolved(unit: str, owners: tuple[Any, ...]) -> str:
    """Return a unit with each reference replaced by the unit of a key that an owner names; empty without one."""
    for name in REFERENCE.findall(unit):
        known = unit_of_key(next((str(key) for owner in owners for key in _named(owner, name)), ""))
        if not known:
            return ""
        unit = unit.replace(f"{{{name}}}", known)
    return unit


def _named(owner: Any, name: str) -> Iterator[Any]:
    """Yield the values that an object has in JSON under a name, at its own level."""
    for attribute, entry in reported_of(type(owner)).items():
        if entry.spread and is_dataclass(part := getattr(owner, attribute)):
            yield from _named(part, name)
        elif name == (entry.name or attribute):
            yield getattr(owner, attribute)
