"""What every result is to those who look at it: a line of text, columns, a table in a notebook, and JSON.

Fields of result classes are declared with `reported`: their meaning and unit. JSON, headers of tables, axes
of pictures and the page of fields read them there; no other list of them exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import Field, dataclass, fields, is_dataclass, replace
from html import escape
from types import MappingProxyType
from typing import Any, TypeVar, get_args, get_type_hints

from tcc_sim.topics import TOPICS

ROWS_SHOWN = 20
PLAIN = {str, int, bool, type(None)}
"""Types of values that are in JSON as they are; most of a result is, and numbers."""
KEY_UNITS: dict[str, str] = {}
"""Units of scene keys, which `model.parameters` declares."""
_KNOWN: dict[type, dict[str, Reported]] = {}
Getter = TypeVar("Getter", bound=Callable[..., Any])


@dataclass(frozen=True)
class Reported:
    """How a field or property of a result is reported.

    meaning, unit : in words; the unit is empty for what has none. In a unit, {over} is the unit of the scene key that
        the nearest field `over` names, and {*} that of each key of a mapping
    name : in JSON, where it differs from the attribute's
    asked_for : JSON omits it where it is None
    spread : JSON has its fields in its place
    listed : likewise, but of a sequence: each of its fields becomes a list of the values
    of : classes of what it holds, where the annotation does not name them
    """

    meaning: str
    unit: str = ""
    name: str = ""
    asked_for: bool = False
    spread: bool = False
    listed: bool = False
    of: tuple[type, ...] = ()


def reported(meaning: str, unit: str = "", **how: Any) -> dict[str, Reported]:
    """Return the metadata of a dataclass field that is reported; arguments as those of `Reported`."""
    return {"reported": Reported(meaning, unit, **how)}


def as_in(kind: type, name: str, **how: Any) -> dict[str, Reported]:
    """Return the metadata of a field that is reported as one of another class; `how` says what differs."""
    return {"reported": replace(reported_of(kind)[name], **how)}


def reporting(meaning: str, unit: str = "", **how: Any) -> Callable[[Getter], Getter]:
    """Return a decorator for the getter of a property that is reported; arguments as those of `Reported`."""
    def marked(getter: Getter) -> Getter:
        getter.reported = Reported(meaning, unit, **how)  # type: ignore[attr-defined]
        return getter
    return marked


def reported_of(kind: type) -> dict[str, Reported]:
    """The reported fields of a class, then its properties, by the name of the attribute."""
    if kind in _KNOWN:
        return _KNOWN[kind]
    found = {item.name: item.metadata["reported"] for item in fields(kind) if "reported" in item.metadata}
    for base in reversed(kind.__mro__):
        for name, value in vars(base).items():
            if isinstance(value, property) and (entry := getattr(value.fget, "reported", None)) is not None:
                found[name] = entry
    _KNOWN[kind] = found
    return found


def units_of(kind: type) -> dict[str, str]:
    """The units of the reported fields of a class, by name."""
    return {name: entry.unit for name, entry in reported_of(kind).items()}


def fields_of(kind: type) -> Iterator[tuple[str, Reported]]:
    """All fields that JSON may have of a class, with the names of those within others joined by dots."""
    hints = get_type_hints(kind)
    for name, entry in reported_of(kind).items():
        hint = hints[name] if name in hints else get_type_hints(getattr(kind, name).fget).get("return")
        below = entry.of or tuple(_classes_in(hint))
        if not (entry.spread or entry.listed):
            yield entry.name or name, entry
        elif not below:
            yield "*", entry  # The keys of a mapping.
        for part in below:
            for field, each in fields_of(part):
                if entry.spread or entry.listed:
                    yield field, replace(each, asked_for=each.asked_for or entry.asked_for)
                else:
                    yield f"{entry.name or name}.{field}", each


def _classes_in(hint: Any) -> Iterator[type]:
    """The classes with reported fields in an annotation."""
    if isinstance(hint, type) and is_dataclass(hint) and reported_of(hint):
        yield hint
    for part in get_args(hint):
        yield from _classes_in(part)


def units_of_columns(kind: type, names: Iterable[str]) -> dict[str, str]:
    """The units of columns of a result's table by name: those of scene keys, of topics, and of the fields of the class
    and, less near, of the classes within it. A column whose unit depends on the result is left out.
    """
    found = {row.name: row.unit for row in TOPICS} | KEY_UNITS
    for name, entry in sorted(fields_of(kind), key=lambda item: -item[0].count(".")):
        found |= dict.fromkeys((name.rpartition(".")[2], name.replace(".", "_")), entry.unit)
    return {name: unit for name in names if (unit := found.get(name, "")) and "{" not in unit}


class Described:
    """A dataclass whose text is one line: its numbers and words, and of what is long how much there is."""

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
        """The reported fields as JSON values; null for a number that is not finite."""
        return dict(json_of(self))

    def __repr__(self) -> str:
        found = ((item.name.replace("_", " "), getattr(self, item.name)) for item in fields(self))  # type: ignore[arg-type]
        said = [text for name, value in found if (text := _said(name, value))]
        return f"<{type(self).__name__}: {', '.join(said)}>"


class Result(Described):
    """What a public function gives. `columns` are what ``pandas.DataFrame`` and ``polars.DataFrame`` take."""

    __slots__ = ()

    def columns(self) -> Mapping[str, Any]:
        """Arrays or lists of one length, by name."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        """A notebook's view: the line of text, and the first rows with the units of the columns."""
        columns = self.columns()
        return f"<p>{escape(repr(self))}</p>{html_of(columns, units_of_columns(type(self), columns))}"


def json_of(value: Any) -> Any:
    """A value as JSON has it: a dataclass as its reported fields (all where none is) by name, a complex number as a
    pair, NumPy's arrays and numbers as Python's, and null for a number that is not finite.
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
    """The reported fields of a dataclass, or the items of a mapping."""
    if isinstance(value, Mapping):
        yield from value.items()
        return
    for name, entry in (reported_of(type(value)) or {item.name: Reported("") for item in fields(value)}).items():
        part = getattr(value, name)
        if part is None and entry.asked_for:
            continue
        if entry.spread:
            yield from _items(part) if part is not None else dict.fromkeys(names_in(entry.of[0])).items()
        elif entry.listed:
            yield from as_lists(part, entry.of[0]).items()
        else:
            yield entry.name or name, part


def names_in(kind: type) -> list[str]:
    """The names in JSON of the reported fields that are always there."""
    return [part for name, entry in reported_of(kind).items() if not entry.asked_for
            for part in (names_in(entry.of[0]) if entry.spread else [entry.name or name])]


def as_lists(parts: Iterable[Any], kind: type) -> dict[str, list[Any]]:
    """For each reported field of a class the values in a list, None where there is none."""
    rows = [dict.fromkeys(names_in(kind)) if part is None else dict(_items(part)) for part in parts]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def html_of(columns: Mapping[str, Any], units: Mapping[str, str] = MappingProxyType({}), most: int = ROWS_SHOWN) -> str:
    """A table in HTML of the first `most` lines of some columns, whose units stand beside the names."""
    length = len(next(iter(columns.values()), ()))
    cells = "".join(f"<tr>{''.join(f'<td>{escape(_cell(column[k]))}</td>' for column in columns.values())}</tr>"
                    for k in range(min(length, most)))
    heads = (f"{name} ({units[name]})" if name in units else name for name in columns)
    left = f"<p>{length - most} more lines</p>" if length > most else ""
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{cells}</tbody></table>{left}"


def _cell(value: Any) -> str:
    """A value in a table."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _said(name: str, value: Any) -> str:
    """A field in a line; empty for what has no short text."""
    if isinstance(value, bool):
        return name if value else ""
    if isinstance(value, float):
        return f"{name} {value:.6g}" if math.isfinite(value) else ""
    if isinstance(value, (int, str)):
        return f"{name} {value}" if value != "" else ""
    if isinstance(value, (list, tuple, Mapping)) or hasattr(value, "shape"):
        return f"{len(value)} {name}" if len(value) else ""
    return ""
