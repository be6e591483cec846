"""Units of the fields of JSON files, read from the classes of results."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any

from tcc_sim.analysis.measured.orders import Orders
from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.model.parameters import DERIVED, QUANTITIES
from tcc_sim.result import fields_of, reported_of
from tcc_sim.topics import TOPICS
from tcc_sim.trajectory import UNITS

KNOWN = {**{entry.name or name: entry.unit for kind in (Damping, Summary, Orders)
            for name, entry in reported_of(kind).items()}, **UNITS, **{row.name: row.unit for row in TOPICS}}
"""Units by the names of results, signals and topics."""
REFERENCE = re.compile(r"{([\w*]+)}")


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
