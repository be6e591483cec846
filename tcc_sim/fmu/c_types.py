"""The types of a kernel's values in C, from the annotations and the arithmetic of its Python source."""

from __future__ import annotations

import types
import typing
from dataclasses import dataclass, field
from typing import Any

import numpy as np


class Refused(Exception):
    """Something in a kernel's source that has no printed form in C."""


@dataclass(frozen=True)
class Static:
    """A value that is known when the C is printed: None, True or False."""

    value: object


@dataclass(frozen=True)
class Scalar:
    """double or int."""

    name: str


@dataclass(frozen=True)
class Tuple:
    """Several numbers in a structure, ``_0``, ``_1`` and so on; `optional`: with a flag ``has``."""

    parts: tuple[Scalar, ...]
    optional: bool = False

    @property
    def name(self) -> str:
        """Name of the structure."""
        return f"{'optional' if self.optional else 'tuple'}_{''.join(part.name[0] for part in self.parts)}"

    def declaration(self) -> str:
        """The structure."""
        flag = "int has; " if self.optional else ""
        fields = " ".join(f"{part.name} _{place};" for place, part in enumerate(self.parts))
        return f"typedef struct {{ {flag}{fields} }} {self.name};"


@dataclass(frozen=True)
class Table:
    """An (n, columns) array of doubles behind a pointer, with room for as many rows as the macro `most` says.

    Its flag `has` says whether it is there.
    """

    field: str
    columns: int | str
    most: str

    @property
    def name(self) -> str:
        """The type of a pointer to it."""
        return f"const table_{self.field} *"

    def declaration(self) -> str:
        """The structure."""
        return f"typedef struct {{ int has; int rows; double at[{self.most}][{self.columns}]; }} table_{self.field};"


@dataclass(frozen=True)
class Row:
    """A one-dimensional array of doubles; its length, where it is known, as a number or a macro."""

    writable: bool = False
    length: int | str = ""

    @property
    def name(self) -> str:
        """The type of a pointer to it."""
        return "double *" if self.writable else "const double *"


@dataclass(frozen=True)
class Struct:
    """A NamedTuple behind a pointer, with the types of its fields."""

    title: str
    fields: tuple[tuple[str, Kind], ...] = field(hash=False)

    @property
    def name(self) -> str:
        """The type of a pointer to it."""
        return f"const {self.title} *"

    def declaration(self) -> str:
        """The structure."""
        lines = "\n".join(f"    {f'table_{kind.field}' if isinstance(kind, Table) else kind_name(kind)} {name};"
                          for name, kind in self.fields)
        return f"typedef struct {{\n{lines}\n}} {self.title};"


Kind = Static | Scalar | Tuple | Table | Row | Struct
DOUBLE, INT = Scalar("double"), Scalar("int")


def kind_name(kind: Kind) -> str:
    """The type in C."""
    if isinstance(kind, Static):
        raise Refused(f"{kind.value} has no type in C")
    return kind.name


def struct_of(source: type[Any], tables: dict[str, tuple[int | str, str]], lengths: dict[str, int]) -> Struct:
    """The structure of a NamedTuple.

    Parameters
    ----------
    source : with annotated fields: numbers, tuples of numbers and arrays, each of them possibly None
    tables : columns of its arrays (a number or a macro), and the macro that has the largest number of rows, by field
    lengths : of its tuples of any length, by field
    """
    hints = typing.get_type_hints(source)
    return Struct(source.__name__, tuple((name, _kind(name, hints[name], tables, lengths)) for name in hints))


def _kind(name: str, hint: Any, tables: dict[str, tuple[int | str, str]], lengths: dict[str, int]) -> Kind:
    """The type of a field from its annotation; a number that may be None is there, since the real-time solver needs
    it.
    """
    choices = typing.get_args(hint) if isinstance(hint, types.UnionType) or typing.get_origin(
        hint) is typing.Union else (hint,)
    optional = type(None) in choices
    inner, = (choice for choice in choices if choice is not type(None))
    if inner is float or inner is int:
        return DOUBLE if inner is float else INT
    origin = typing.get_origin(inner)
    if origin is tuple:
        parts = typing.get_args(inner)
        return Tuple((DOUBLE,) * (lengths[name] if ... in parts else len(parts)), optional)
    if origin is np.ndarray and name in tables:
        return Table(name, *tables[name])
    raise Refused(f"{name}: {hint}")
