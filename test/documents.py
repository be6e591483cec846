"""Check that a JSON holds exactly the fields on the page of fields."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from fields_page import KINDS, fields_by_kind
from numpy.typing import NDArray

from tcc_sim.code_version import code_version
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.output.provenance import HEAD, format_of
from tcc_sim.result import names_in, reported_of


def valid(kind: str, result: dict[str, Any], table: Mapping[str, tuple[str, str]] | None = None) -> dict[str, Any]:
    """Return `found` after checks of its head, and that its fields and units are documented, or are those of a table of
    meanings and units.
    """
    assert list(result)[:2] == ["format", "version"]
    assert (result["format"], result["version"]) == (format_of(kind), code_version())
    assert set(QUANTITIES) <= result["scene"].keys()
    assert result["command"]
    assert set(HEAD) - set(result) <= {"warnings"}
    if table is not None:
        assert result.keys() - set(HEAD) <= table.keys()
        assert result["units"] == {name: unit for name, (_, unit) in table.items() if unit}
        return result
    documented = fields_by_kind(kind)
    names = set(documented)
    present = paths_in({key: value for key, value in result.items() if key not in HEAD}, names)
    assert present <= names, f"not documented: {present - names}"
    missing = {name for name, entry in documented.items() if not entry.optional and "." not in name} - set(result)
    assert not missing or kind in ("sweep", "figure"), f"not there: {missing}"
    for path, unit in result["units"].items():
        name = re.sub(r"\[\d+\]", "", path)
        declared = next(documented[part].unit for start in beginnings(name)
                        for part in (start, f"{start.rpartition('.')[0]}.*") if part in documented)
        assert declared == unit or "{" in declared, f"{path}: {unit}"
    lacking = {name for name in present & set(result) if documented[name].unit and "{" not in documented[name].unit
               and result[name] is not None} - set(result["units"])
    assert not lacking, f"no unit of {lacking}"
    values = {key: value for key, value in result.items() if key not in HEAD}
    wrong = [mistyped(values, of) for of in KINDS[kind][1]]
    assert not wrong or [] in wrong, wrong
    return result


hints_of = cache(get_type_hints)


def mistyped(result: dict[str, Any], kind: type, missing: bool = False) -> list[str]:
    """The fields of a result with other types than declared; `missing` allows null for each."""
    wrong: list[str] = []
    for name, entry in reported_of(kind).items():
        hints = hints_of(kind)
        hint = hints[name] if name in hints else hints_of(getattr(kind, name).fget)["return"]
        below = entry.of or tuple(part for part in (hint, *get_args(hint)) if is_dataclass(part) and reported_of(part))
        label, optional = entry.name or name, missing or type(None) in get_args(hint)
        if entry.listed:
            wrong += [part for values in rows_of(result, names_in(entry.of[0])) for part in mistyped(
                values, entry.of[0], missing=True)]
        elif hint is Any and "values" in result:
            continue  # Basins at several values of a key are lists.
        elif entry.spread and below:
            wrong += mistyped(result, below[0], optional)
        elif label in result and not (result[label] is None and optional) and not of_type(result[label], hint):
            wrong.append(f"{kind.__name__}.{name}: {result[label]!r:.60} is no {hint}")
    return wrong


def rows_of(result: dict[str, Any], names: list[str]) -> Iterator[dict[str, Any]]:
    """Objects of the lists, or lists of lists, of values by name."""
    columns = {name: result[name] for name in names if isinstance(result.get(name), list)}
    for row in zip(*columns.values()):
        one = dict(zip(columns, row))
        yield from rows_of(one, names) if isinstance(one.get("status"), list) else [one]


def of_type(value: Any, hint: Any) -> bool:
    """Whether a JSON value has a type; non-finite numbers are null, arrays are lists, complex numbers are pairs."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, TypeVar):
        return True
    if origin in (Union, UnionType):
        return any(of_type(value, part) for part in arguments)
    if origin in (np.ndarray, NDArray) or hint is np.ndarray:
        return isinstance(value, list)
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, dict) and all(of_type(part, arguments[1]) for part in value.values())
    if origin is tuple and arguments[-1] is not Ellipsis:
        return isinstance(value, list) and len(value) == len(arguments) and all(map(of_type, value, arguments))
    if origin is not None and issubclass(origin, Iterable):
        return isinstance(value, list) and all(of_type(part, arguments[0]) for part in value)
    if is_dataclass(hint):
        return isinstance(value, dict) and not mistyped(value, hint)  # type: ignore[arg-type]
    if hint is float:
        return value is None or type(value) in (int, float)
    return isinstance(value, NoneType if hint is None else hint) and (hint is bool or not isinstance(value, bool))


def beginnings(path: str) -> list[str]:
    """A path and its beginnings, the longest first."""
    parts = path.split(".")
    return [".".join(parts[:k]) for k in range(len(parts), 0, -1)]


def paths_in(value: Any, names: set[str], path: str = "") -> set[str]:
    """Documented and other names below a value; keys of a mapping are no names."""
    if not any(name.startswith(path) for name in names):
        return set()  # Nothing within it is documented.
    if isinstance(value, list):
        return {name for each in value for name in paths_in(each, names, path)}
    result = set()
    for key, each in value.items() if isinstance(value, dict) else ():
        if path and f"{path}{key}" not in names and isinstance(each, (dict, list)):
            result |= paths_in(each, names, path)  # The key of a mapping.
        elif f"{path}{key}" not in names and f"{path}*" in names and (key in QUANTITIES or key == "cycles"):
            result.add(f"{path}*")
        else:
            result |= {f"{path}{key}", *paths_in(each, names, f"{path}{key}.")}
    return result


def same_pictures(pictures: list[Any], width: float) -> list[Any]:
    """The lines of the first picture, after checks that the last one has the same and that all have one width."""
    first, *_, last = ([line.get_xydata() for axis in drawn.axes for line in axis.lines] for drawn in pictures)
    np.testing.assert_equal(last, first)
    assert {float(drawn.get_size_inches()[0]) for drawn in pictures} == {width}
    return first
