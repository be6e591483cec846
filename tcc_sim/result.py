"""What every result is to those who look at it: a line of text, columns, a table in a notebook, and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from html import escape
from typing import Any

ROWS_SHOWN = 20
ASKED_FOR, SPREAD = {"asked_for": True}, {"spread": True}
"""Metadata of dataclass fields: JSON has not what is None because nobody asked for it; and it has the fields of a
dataclass, or the items of a mapping, in the place of the field that holds it.
"""
PLAIN = {str, int, bool, type(None)}
"""Types of values that are in JSON as they are; most of a result is, and numbers."""


class Described:
    """A dataclass whose text is one line: its numbers and words, and of what is long how much there is."""

    __slots__ = ()

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
        """A notebook's view: the line of text, and the first rows."""
        return f"<p>{escape(repr(self))}</p>{html_of(self.columns())}"


def json_of(value: Any) -> Any:
    """A value as JSON has it: a dataclass as its fields by name, NumPy's arrays and numbers as Python's, and null for a
    number that is not finite.
    """
    if type(value) is float:
        return value if math.isfinite(value) else None
    if type(value) in PLAIN:
        return value
    if is_dataclass(value):
        value = dict(_items(value))
    if isinstance(value, Mapping):
        return {str(key): json_of(each) for key, each in value.items()}
    if hasattr(value, "tolist"):
        return json_of(value.tolist())
    if isinstance(value, (list, tuple)):
        return [json_of(each) for each in value]
    return value


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """The fields of a dataclass that JSON has, or the items of a mapping."""
    if isinstance(value, Mapping):
        yield from value.items()
        return
    for item in fields(value):
        part = getattr(value, item.name)
        if part is None and item.metadata.get("asked_for"):
            continue
        yield from _items(part) if item.metadata.get("spread") else ((item.name, part),)


def html_of(columns: Mapping[str, Any]) -> str:
    """A table in HTML of the first ROWS_SHOWN lines of some columns."""
    length = len(next(iter(columns.values()), ()))
    cells = "".join(f"<tr>{''.join(f'<td>{escape(_cell(column[k]))}</td>' for column in columns.values())}</tr>"
                    for k in range(min(length, ROWS_SHOWN)))
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    left = f"<p>{length - ROWS_SHOWN} more lines</p>" if length > ROWS_SHOWN else ""
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
