"""Fields of JSON files, read from the classes of results: the units of one result, and all fields of a class."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any, get_args, get_type_hints

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.summary import Summary
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.result import Reported, reported_of
from tcc_sim.trajectory import UNITS

KNOWN = {**{entry.name or name: entry.unit for kind in (Damping, Summary)
            for name, entry in reported_of(kind).items()}, **UNITS}
"""Units by the names of results and signals."""
REFERENCE = re.compile(r"{([\w*]+)}")


def unit_of_key(key: str) -> str:
    """The unit of a scene key, a result or a signal; empty for what has none."""
    return QUANTITIES[key].unit if key in QUANTITIES else KNOWN.get(key, "")


def units_in(result: Any) -> dict[str, str]:
    """The units of a result's fields in JSON by their names, joined by dots; fields without a unit are left out.

    The field of an entry of a list stands for that of every entry; where these have different units, the numbers of the
    entries are in the names.
    """
    return dict(_units(result, "", ()))


def _units(value: Any, path: str, owners: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    """Path and unit of what is below a value, which is within `owners`, the nearest first."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _units(part, f"{path}{key}.", owners)
    elif isinstance(value, (list, tuple)) and any(map(is_dataclass, value[:1])):
        found = [dict(_units(part, path, owners)) for part in value]
        for name in dict.fromkeys(name for units in found for name in units):
            units = {k: one[name] for k, one in enumerate(found) if name in one}
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
            if entry.listed:
                yield from ((path + field, each.unit) for field, each in fields_of(entry.of[0])
                            if each.unit and field.partition(".")[0] in part)
                continue
            below = path if entry.spread else f"{path}{entry.name or name}."
            if entry.unit == "{*}":
                yield from ((below + key, unit) for key in part if (unit := unit_of_key(key)))
            elif unit := _resolved(entry.unit, owners):
                yield below[:-1], unit
            else:
                yield from _units(part, below, owners)


def _resolved(unit: str, owners: tuple[Any, ...]) -> str:
    """A unit whose references are replaced by the units of the keys that the owners name; empty where there is none."""
    for name in REFERENCE.findall(unit):
        keys = (getattr(owner, attribute) for owner in owners
                for attribute, entry in reported_of(type(owner)).items() if name == (entry.name or attribute))
        known = unit_of_key(str(next(keys, "")))
        if not known:
            return ""
        unit = unit.replace(f"{{{name}}}", known)
    return unit


def fields_of(kind: type) -> Iterator[tuple[str, Reported]]:
    """All fields that JSON may have of a class, with the names of those within others joined by dots."""
    hints = get_type_hints(kind)
    for name, entry in reported_of(kind).items():
        hint = hints[name] if name in hints else get_type_hints(getattr(kind, name).fget).get("return")
        below = entry.of or tuple(_classes_in(hint))
        if not entry.spread:
            yield entry.name or name, entry
        for part in below:
            for field, each in fields_of(part):
                yield field if entry.spread else f"{entry.name or name}.{field}", each


def _classes_in(hint: Any) -> Iterator[type]:
    """The classes with reported fields in an annotation."""
    if isinstance(hint, type) and is_dataclass(hint) and reported_of(hint):
        yield hint
    for part in get_args(hint):
        yield from _classes_in(part)
