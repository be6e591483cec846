"""Presentation of results: a line of text, columns, a table in a notebook, and JSON.

Fields of result classes are declared with `reported`: their meaning and unit. JSON, headers of tables, axes
of pictures and the page of fields read them there; no other list of them exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from html import escape
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from tcc_sim.errors import counted
from tcc_sim.topics import TOPICS

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform  # Of `typing` from Python 3.11 on.
else:
    def dataclass_transform(**_: Any) -> Any:
        """Return a decorator that changes nothing."""
        return lambda function: function

ROWS_SHOWN = 20
PLAIN = {str, int, bool, type(None)}
"""Types of values that JSON takes unchanged."""
KEY_UNITS: dict[str, str] = {}
"""Units of scene keys, which `model.parameters` declares."""
_KNOWN: dict[type, dict[str, Reported]] = {}
Value = TypeVar("Value")


@dataclass(frozen=True)
class Reported:
    """Report of a field or property of a result.

    meaning, unit : in words; the unit is empty for a dimensionless value. In a unit, {over} is the unit of the scene
        key that the nearest field `over` names, and {*} that of each key of a mapping
    name : name in JSON, if it differs from that of the attribute
    optional : JSON omits the field if it is None
    spread : JSON has the fields of the value instead of the field
    listed : the same for a sequence: each field of its members becomes a list of their values
    of : classes of the value or its members, if the annotation does not name them
    scatters : `scatter` gives quantiles of the field
    """

    meaning: str
    unit: str = ""
    name: str = ""
    optional: bool = False
    spread: bool = False
    listed: bool = False
    of: tuple[type, ...] = ()
    scatters: bool = False


def reported(meaning: str, unit: str = "", **how: Any) -> Any:
    """Return a reported field of a result class; arguments as for `Reported`, and `default`, `default_factory` and
    `repr` as for `dataclasses.field`.
    """
    plain = {name: how.pop(name) for name in ("default", "default_factory", "repr") if name in how}
    return field(**plain, metadata={"reported": Reported(meaning, unit, **how)})


def as_in(kind: type, name: str, default: Any = MISSING, **how: Any) -> Any:
    """Return a field reported like one of another class, except for `how`."""
    return field(default=default, metadata={"reported": replace(reported_of(kind)[name], **how)})


def reporting(meaning: str, unit: str = "", **how: Any) -> Callable[[Callable[[Any], Value]], Value]:
    """Return the decorator that makes a reported property of a getter; arguments as for `Reported`.

    The meaning is the docstring of a getter that has none.
    """
    def made(getter: Callable[[Any], Value]) -> Any:
        known = f", {unit}" if unit and "{" not in unit else ""
        getter.__doc__ = getter.__doc__ or f"{meaning[0].upper()}{meaning[1:]}{known}."
        getter.reported = Reported(meaning, unit, **how)  # type: ignore[attr-defined]
        return property(getter)
    return made


@dataclass_transform(frozen_default=True, field_specifiers=(field, reported, as_in))
def result_class(kind: Any = None, /, *, frozen: bool = True, **how: Any) -> Any:
    """Make a class with reported fields a dataclass; arguments as for `dataclasses.dataclass`."""
    return dataclass(kind, frozen=frozen, **how)


def reported_of(kind: type) -> dict[str, Reported]:
    """Return the reported fields of a class, then its reported properties, by attribute."""
    if kind in _KNOWN:
        return _KNOWN[kind]
    rows = {item.name: item.metadata["reported"] for item in fields(kind) if "reported" in item.metadata}
    for base in reversed(kind.__mro__):
        for name, value in vars(base).items():
            if isinstance(value, property) and (entry := getattr(value.fget, "reported", None)) is not None:
                rows[name] = entry
    _KNOWN[kind] = rows
    return rows


def units_of(kind: type) -> dict[str, str]:
    """Return the units of the reported fields of a class, by name."""
    return {name: entry.unit for name, entry in reported_of(kind).items()}


def fields_of(kind: type) -> Iterator[tuple[str, Reported]]:
    """Yield every field that a class may have in JSON, with the names of nested fields joined by dots."""
    for name, entry, below in reported_parts(kind):
        if not (entry.spread or entry.listed):
            yield entry.name or name, entry
        elif not below:
            yield "*", entry  # The keys of a mapping.
        for part in below:
            for nested, each in fields_of(part):
                if entry.spread or entry.listed:
                    yield nested, replace(each, optional=each.optional or entry.optional)
                else:
                    yield f"{entry.name or name}.{nested}", each


def reported_parts(kind: type) -> Iterator[tuple[str, Reported, tuple[type, ...]]]:
    """Yield attribute, report and the classes of the value or its members, of each reported field of a class."""
    hints = get_type_hints(kind)
    for name, entry in reported_of(kind).items():
        hint = hints[name] if name in hints else get_type_hints(getattr(kind, name).fget).get("return")
        yield name, entry, entry.of or tuple(_classes_in(hint))


def _classes_in(hint: Any) -> Iterator[type]:
    """Yield the classes with reported fields in an annotation."""
    if isinstance(hint, type) and is_dataclass(hint) and reported_of(hint):
        yield hint
    for part in get_args(hint):
        yield from _classes_in(part)


def units_of_columns(kind: type, names: Iterable[str]) -> dict[str, str]:
    """Return the units of the columns of a result's table, by name.

    They are those of scene keys, topics and fields of the class; an outer field precedes a nested one of the same name.
    Columns whose unit depends on the result are left out.
    """
    units = {row.name: row.unit for row in TOPICS} | KEY_UNITS
    for name, entry in sorted(fields_of(kind), key=lambda item: -item[0].count(".")):
        units |= dict.fromkeys((name.rpartition(".")[2], name.replace(".", "_")), entry.unit)
    return {name: unit for name in names if (unit := units.get(name, "")) and "{" not in unit}


class Described:
    """Dataclass with a text: its numbers and words, the lengths of its sequences, and the warnings on its scene."""

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        """Add the reported fields to the docstring."""
        super().__init_subclass__(**options)
        entries = {name: item.metadata["reported"] for name, item in vars(cls).items()
                   if isinstance(item, Field) and "reported" in item.metadata}
        if entries and cls.__doc__:
            lines = [f"{name} : {entry.meaning}{entry.unit and f', {entry.unit}'}" for name, entry in entries.items()]
            cls.__doc__ = "\n    ".join([cls.__doc__.rstrip(), "", *lines, ""])

    def as_json(self) -> dict[str, Any]:
        """Return the reported fields as JSON values; null for a number that is not finite."""
        return dict(json_of(self))

    def _text(self) -> str:
        """Return the text without the warnings on the scene."""
        values = ((item.name.replace("_", " "), getattr(self, item.name)) for item in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}: {', '.join(text for name, value in values if (text := _short(name, value)))}"

    def __repr__(self) -> str:
        system = system_behind(self)
        return f"<{'; '.join([self._text(), *(system.friction.doubts if system is not None else ())])}>"


def system_behind(result: Any) -> Any:
    """Return the system that a result is of; None if the result does not hold one."""
    if hasattr(getattr(result, "friction", None), "doubts"):
        return result
    held = (getattr(result, name, None) for name in ("system", "scene", "curve", "trajectory", "sweeps"))
    holder = next((each[0] if isinstance(each, list) else each for each in held if each is not None), None)
    return None if holder is None else system_behind(holder)


class Result(Described):
    """Result of a public function. ``pandas.DataFrame`` and ``polars.DataFrame`` take its `columns`."""

    __slots__ = ()

    def columns(self) -> Mapping[str, Any]:
        """Return arrays or lists of the same length, by name."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        """Return the view in a notebook: the line of text, and the first rows with the units of the columns."""
        columns = self.columns()
        return f"<p>{escape(repr(self))}</p>{html_of(columns, units_of_columns(type(self), columns))}"


def json_of(value: Any) -> Any:
    """Return a value as JSON has it.

    A dataclass becomes its reported fields by name (all fields, if none is reported), a complex number a pair, an array
    a list, and a number that is not finite None.
    """
    if type(value) is float:
        return value if math.isfinite(value) else None
    if type(value) in PLAIN:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        value = dict(_items(value))
    if isinstance(value, Mapping):
        return {str(key): json_of(each) for key, each in value.items()}
    if type(value) is complex:
        return [json_of(value.real), json_of(value.imag)]
    if hasattr(value, "tolist"):
        return json_of(value.tolist())
    if isinstance(value, (list, tuple)):
        return [json_of(each) for each in value]
    return value


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the reported fields of a dataclass, or the items of a mapping."""
    if isinstance(value, Mapping):
        yield from value.items()
        return
    for name, entry in (reported_of(type(value)) or {item.name: Reported("") for item in fields(value)}).items():
        part = getattr(value, name)
        if part is None and entry.optional:
            continue
        if entry.spread:
            yield from _items(part) if part is not None else dict.fromkeys(names_in(entry.of[0])).items()
        elif entry.listed:
            yield from as_lists(part, entry.of[0]).items()
        else:
            yield entry.name or name, part


def names_in(kind: type) -> list[str]:
    """Return the names in JSON of the reported fields that are never omitted."""
    return [part for name, entry in reported_of(kind).items() if not entry.optional
            for part in (names_in(entry.of[0]) if entry.spread else [entry.name or name])]


def as_lists(parts: Iterable[Any], kind: type) -> dict[str, list[Any]]:
    """Return a list of values for each reported field of a class, with None for a missing part."""
    rows = [dict.fromkeys(names_in(kind)) if part is None else dict(_items(part)) for part in parts]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def html_of(columns: Mapping[str, Any], units: Mapping[str, str] = MappingProxyType({}), most: int = ROWS_SHOWN) -> str:
    """Return an HTML table of the first `most` rows of the columns, with their units beside the names."""
    length = len(next(iter(columns.values()), ()))
    cells = "".join(f"<tr>{''.join(f'<td>{escape(_cell(column[k]))}</td>' for column in columns.values())}</tr>"
                    for k in range(min(length, most)))
    heads = (f"{name} ({units[name]})" if name in units else name for name in columns)
    left = f"<p>{counted(length - most, 'more line')}</p>" if length > most else ""
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{cells}</tbody></table>{left}"


def _cell(value: Any) -> str:
    """Return the text of a value in a table."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _short(name: str, value: Any) -> str:
    """Return a field in a line of text; empty for a value without a short text."""
    if isinstance(value, bool):
        return name if value else ""
    if isinstance(value, float):
        return f"{name} {value:.6g}" if math.isfinite(value) else ""
    if isinstance(value, (int, str)):
        return f"{name} {value}" if value != "" else ""
    if isinstance(value, (list, tuple, Mapping)) or hasattr(value, "shape"):
        return f"{len(value)} {name}" if len(value) else ""
    return ""
