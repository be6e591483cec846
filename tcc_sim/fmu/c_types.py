"""C types of a kernel's values, from the annotations and the arithmetic of its Python source."""

from __future__ import annotations

import types
import typing
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Refused(Exception):
    """A kernel's source has a construct without a form in C."""


@dataclass(frozen=True)
class Static:
    """Value known when the C is printed: None, True or False."""

    value: object


@dataclass(frozen=True)
class Scalar:
    """double or int."""

    name: str


@dataclass(frozen=True)
class Tuple:
    """Structure of numbers ``_0``, ``_1`` and so on; `optional`: with a flag ``has``."""

    parts: tuple[Scalar, ...]
    optional: bool = False

    @property
    def name(self) -> str:
        """Name of the structure."""
        return f"{'optional' if self.optional else 'tuple'}_{''.join(part.name[0] for part in self.parts)}"

    def declaration(self) -> str:
        """Return the declaration of the structure."""
        flag = "int has; " if self.optional else ""
        fields = " ".join(f"{part.name} _{place};" for place, part in enumerate(self.parts))
        return f"typedef struct {{ {flag}{fields} }} {self.name};"


@dataclass(frozen=True)
class Table:
    """Pointer to an (n, columns) array of doubles of at most `most` rows (a macro), and a flag `has`."""

    field: str
    columns: int | str
    most: str

    @property
    def name(self) -> str:
        """Pointer type."""
        return f"const table_{self.field} *"

    def declaration(self) -> str:
        """Return the declaration of the structure."""
        return f"typedef struct {{ int has; int rows; double at[{self.most}][{self.columns}]; }} table_{self.field};"


@dataclass(frozen=True)
class Row:
    """Pointer to a one-dimensional array of doubles; `length` is a number, a macro, or empty if unknown."""

    writable: bool = False
    length: int | str = ""

    @property
    def name(self) -> str:
        """Pointer type."""
        return "double *" if self.writable else "const double *"


@dataclass(frozen=True)
class Struct:
    """Pointer to the structure of a NamedTuple, with the types of its fields."""

    title: str
    fields: tuple[tuple[str, Kind], ...] = field(hash=False)

    @property
    def name(self) -> str:
        """Pointer type."""
        return f"const {self.title} *"

    def declaration(self) -> str:
        """Return the declaration of the structure."""
        lines = "\n".join(f"    {_embedded(kind)} {name};" for name, kind in self.fields)
        return f"typedef struct {{\n{lines}\n}} {self.title};"


def _embedded(kind: Kind) -> str:
    """Return the type of a field, which holds structures and tables themselves."""
    if isinstance(kind, Table):
        return f"table_{kind.field}"
    return kind.title if isinstance(kind, Struct) else kind_name(kind)


Kind = Static | Scalar | Tuple | Table | Row | Struct
DOUBLE, INT = Scalar("double"), Scalar("int")


def kind_name(kind: Kind) -> str:
    """Return the type in C."""
    if isinstance(kind, Static):
        raise Refused(f"{kind.value} has no type in C")
    return kind.name


def struct_of(source: type[Any], tables: dict[str, tuple[int | str, str]], lengths: dict[str, int]) -> Struct:
    """Return the structure of a NamedTuple.

    Parameters
    ----------
    source : NamedTuple whose annotations are numbers, tuples of numbers and arrays, or these or None
    tables : number of columns (a number or a macro) and macro of the largest number of rows, by array field
    lengths : lengths of tuples of variable length, by field
    """
    hints = typing.get_type_hints(source)
    return Struct(source.__name__, tuple((name, _kind(name, hints[name], tables, lengths)) for name in hints))


def _kind(name: str, hint: Any, tables: dict[str, tuple[int | str, str]], lengths: dict[str, int]) -> Kind:
    """Return the type of a field from its annotation; a number that may be None exists in the real-time solver."""
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
    if origin in (np.ndarray, NDArray) and name in tables:
        return Table(name, *tables[name])
    if isinstance(inner, type) and hasattr(inner, "_fields"):
        return struct_of(inner, tables, lengths)
    raise Refused(f"{name}: {hint}")
