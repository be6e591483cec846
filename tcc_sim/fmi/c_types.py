"""C types of a kernel's values, from the annotations and the arithmetic of its Python source."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Wanted = TypeVar("Wanted")


class Refused(Exception):
    """A kernel's source has a construct without a form in C."""


def check(true: bool) -> None:
    """Raise Refused unless a condition of a rule holds."""
    if not true:
        raise Refused


def only(value: object, kind: type[Wanted]) -> Wanted:
    """Return a value of a class; raise Refused for any other."""
    check(isinstance(value, kind))
    return value  # type: ignore[return-value]


@dataclass(frozen=True)
class Static:
    """Value known when the C is printed: None, True, False, a text, a function, or data that Python has fitted."""

    value: Any


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


class Pointed:
    """Structure that functions take by a pointer."""

    title: str

    @property
    def name(self) -> str:
        """Pointer type."""
        return f"const {self.title} *"


@dataclass(frozen=True)
class Table(Pointed):
    """Pointer to an (n, columns) array of doubles of at most `most` rows, and a flag `has`."""

    columns: int
    most: int

    @property
    def title(self) -> str:  # type: ignore[override]
        """Name of the structure."""
        return f"table_{self.most}x{self.columns}"

    def declaration(self) -> str:
        """Return the declaration of the structure."""
        return f"typedef struct {{ int has; int rows; double at[{self.most}][{self.columns}]; }} {self.title};"


@dataclass(frozen=True)
class Row:
    """Pointer to a one-dimensional array of doubles; a length of -1 is not known."""

    writable: bool = False
    length: int = -1

    @property
    def name(self) -> str:
        """Pointer type."""
        return "double *" if self.writable else "const double *"


@dataclass(frozen=True, eq=False)
class Column:
    """Numbers of a column, or ones that are not stored: `at` prints the one at an index, and `length` is printed."""

    length: str
    at: Callable[[str], str]


@dataclass(frozen=True, eq=False)
class Items:
    """Tuple or list whose parts are known when the C is printed, each with its text."""

    parts: tuple[tuple[str, Kind], ...]


@dataclass(frozen=True)
class Keys:
    """Pointer to the values of all variables, for a system or a group of scene keys.

    value : the system or group, whose texts, lengths of lists and data are those of the FMU
    group : name of the group; empty for the system
    place : prints the place of a key's value; None for a key that is no variable
    """

    value: Any = field(compare=False)
    group: str
    place: Callable[[str], str | None] = field(compare=False)

    @property
    def name(self) -> str:
        """Pointer type."""
        return "const double *"


@dataclass(frozen=True)
class Struct(Pointed):
    """Pointer to the structure of a NamedTuple, with the types of its fields; one that is known is none in C."""

    title: str
    fields: tuple[tuple[str, Kind], ...] = field(hash=False)

    def declaration(self) -> str:
        """Return the declaration of the structure."""
        lines = "\n".join(f"    {stored_name(kind)} {name};" for name, kind in self.fields
                          if not isinstance(kind, Static))
        return f"typedef struct {{\n{lines}\n}} {self.title};"


def stored_name(kind: Kind) -> str:
    """Return the type of a variable or field, which holds structures and tables themselves."""
    return kind.title if isinstance(kind, Pointed) else kind_name(kind)


Kind = Static | Scalar | Tuple | Table | Row | Column | Items | Keys | Struct
DOUBLE, INT = Scalar("double"), Scalar("int")


def kind_name(kind: Kind) -> str:
    """Return the type in C."""
    if isinstance(kind, (Static, Column, Items)):
        raise Refused(f"{kind} has no type in C")
    return kind.name


def size_of(kind: Kind) -> int:
    """Return about how many bytes a variable has."""
    if isinstance(kind, Struct):
        return sum(size_of(part) for _, part in kind.fields if not isinstance(part, Static))
    return 8 * (kind.most * kind.columns if isinstance(kind, Table) else kind.length if isinstance(kind, Row) else 1)


def struct_of(source: type[Any], tables: dict[str, Table], lengths: dict[str, int],
              absent: frozenset[str] = frozenset()) -> Struct:
    """Return the structure of a NamedTuple.

    source : NamedTuple whose annotations are numbers, tuples of numbers and arrays, or these or None
    tables : types of arrays, by field
    lengths : lengths of tuples of variable length, by field
    absent : fields that are always None
    """
    hints = typing.get_type_hints(source)
    return Struct(source.__name__, tuple((name, Static(None) if name in absent else
                                          _kind_of(name, hints[name], tables, lengths)) for name in hints))


def _kind_of(name: str, hint: Any, tables: dict[str, Table], lengths: dict[str, int]) -> Kind:
    """Return the type of a field from its annotation; a number that may be None exists in the real-time solver."""
    choices = typing.get_args(hint) if typing.get_origin(hint) in (types.UnionType, typing.Union) else (hint,)
    optional = type(None) in choices
    inner, = (choice for choice in choices if choice is not type(None))
    if inner is float or inner is int:
        return DOUBLE if inner is float else INT
    origin = typing.get_origin(inner)
    if origin is tuple:
        parts = typing.get_args(inner)
        return Tuple((DOUBLE,) * (lengths[name] if ... in parts else len(parts)), optional)
    if origin in (np.ndarray, NDArray) and name in tables:
        return tables[name]
    if isinstance(inner, type) and hasattr(inner, "_fields"):
        return struct_of(inner, tables, lengths)
    raise Refused(f"{name}: {hint}")


def common_kind(one: Kind, other: Kind) -> Kind:
    """Return the type that holds values of both: a tuple or table that may be absent has a flag."""
    if one == other:
        return one
    for absent, kind in ((one, other), (other, one)):
        if absent == Static(None) and isinstance(kind, (Tuple, Table)):
            return Tuple(kind.parts, True) if isinstance(kind, Tuple) else kind
    raise Refused
