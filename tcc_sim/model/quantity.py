"""Meanings of scene keys (unit, allowed range or choices), groups of keys that check themselves, and profiles of the
keys that may vary in time, linear between given points.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

from tcc_sim.errors import InputError, OutOfRange

Value = float | str | tuple[float, ...]
Same = TypeVar("Same", bound="Group")
PROFILES = ("engine.frequency", "engine.mean_torque", "engine.torque_amplitude", "engine.harmonic_amplitudes",
            "pressure.mean")
"""Keys that may vary in time; each has a list of times and a list of values."""
PROFILED = ", ".join(PROFILES).replace("amplitudes", "amplitudes[n]")
"""These keys as printed; single numbers of the list of harmonics have profiles."""
SPEED_UNIT = "rad/s"
SUFFIXES = {"rad/s": 1.0, "rpm": math.pi / 30.0, "hz": 2.0 * math.pi}
"""Units that may follow a speed or a frequency, and their factors to rad/s."""
MOST_POINTS, LATEST = 1000, 1e6
"""Largest number of points in a profile, and its latest time, s."""
MOST_VALUES = 1_000_000
"""Most values of a range, of a grid, and of samples."""


def sequence_of_numbers(key: str, values: Any) -> tuple[float, ...]:
    """Return successive values of a key, given as a sequence or array of numbers or as a single number.

    Raises InputError: the values are not numbers.
    """
    try:
        return tuple(float(x) for x in (values if isinstance(values, Iterable) else (values,)))
    except (TypeError, ValueError):
        raise InputError(f"{key} has the values {values!r:.100}; they must be numbers") from None


@dataclass(frozen=True)
class Quantity:
    """Meaning of a key: description, unit, allowed range or choices, and whether a running node may change it.

    above : the lower bound itself is not allowed
    zero : 0 is allowed in addition to the range
    otherwise : end of the error message for an invalid choice
    label : name with the paper's symbol, in the mathematics of matplotlib, for axes; empty for the key itself
    """

    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    choices: tuple[str, ...] = ()
    live: bool = False
    zero: bool = False
    otherwise: str = ""
    label: str = ""

    @property
    def described(self) -> str:
        """Description and unit."""
        return self.description + (f", {self.unit}" if self.unit else "")

    def interval(self) -> str:
        """Return the allowed values in words, for error messages and parameter descriptions."""
        if self.choices:
            return " or ".join(self.choices)
        if math.isinf(self.low) and math.isinf(self.high):
            return ""
        low = f"above {self.low:g}" if self.above else f"{self.low:g}"
        high = f" to {self.high:g}" if self.high < math.inf else "" if self.above else " or more"
        return f"{'0 or ' if self.zero else ''}{low}{high}{f' {self.unit}' if self.unit else ''}"

    def check(self, key: str, value: object) -> None:
        """Raise InputError unless `value` has the right type and is within the range."""
        if self.choices:
            if value not in self.choices:
                raise InputError(f"{key} is {value!r}; it must be {self.interval()}{self.otherwise}")
            return
        for x in value if isinstance(value, tuple) else (value,):
            if isinstance(x, bool) or not isinstance(x, (int, float)):
                raise InputError(f"{key} is {value!r}; it must be a number, {self.interval()}")
            if self.zero and x == 0:
                continue
            if not (self.low <= x <= self.high) or math.isinf(x) or (self.above and x == self.low):
                raise OutOfRange(f"{key} is {apart(as_float(x), self.low, self.high)}"
                                 f"{' ' + self.unit if self.unit else ''}; it must be {self.interval()}")


def apart(value: float, *others: float) -> str:
    """Return a number with the fewest digits, at least six, that distinguish it from the other numbers."""
    for digits in (6, 9, 12, 15):
        text = f"{value:.{digits}g}"
        if all(text != f"{other:.{digits}g}" or value == other for other in others):
            return text
    return repr(value)


def quantity(default: Value | tuple[str, ...], *meaning: Any, **further: Any) -> Any:
    """Return a dataclass field with a Quantity of the other arguments as metadata."""
    return field(default=default, metadata={"quantity": Quantity(*meaning, **further)})


def times_of(key: str) -> Any:
    """Return the field of the times of a profile."""
    return quantity((), f"times at which {key}_values hold, the first 0", "s", 0.0, LATEST)


def values_over(key: str, name: str, unit: str, low: float, high: float) -> Any:
    """Return the field of the values of a profile."""
    return quantity((), f"{name} at these times, linear between them and constant afterwards; {key} is then not used",
                    unit, low, high)


def check_profile(key: str, times: tuple[float, ...], values: tuple[float, ...], each: int = 1) -> None:
    """Raise InputError unless times and values of a key, `each` values per time, form a profile or are empty."""
    if each * len(times) != len(values) or (times and not each):
        raise InputError(f"{key}_values has {len(values)} values; it must have "
                         + (f"as many as {key}_times, {len(times)}" if each == 1 else
                            f"{each} for each of the {len(times)} {key}_times, one for each harmonic"))
    if len(times) > MOST_POINTS:
        raise InputError(f"{key}_times has {len(times)} values; at most {MOST_POINTS} are allowed")
    check_rising(f"{key}_times", times, "time", "s")


def check_rising(key: str, values: tuple[float, ...], name: str, unit: str) -> None:
    """Raise InputError unless the values of a key increase from 0, or there are none."""
    if values and values[0] != 0.0:
        raise InputError(f"{key} begins at {values[0]:g} {unit}; the first {name} must be 0")
    for before, after in itertools.pairwise(values):
        if not after > before:
            raise InputError(f"{key} has {after:g} {unit} after {before:g} {unit}; the {name}s must increase")


class Quantified:
    """A dataclass whose fields have quantities."""

    @classmethod
    @cache
    def quantities(cls) -> dict[str, Quantity]:
        """Return every field with its meaning."""
        return {item.name: item.metadata["quantity"] for item in dataclasses.fields(cls)}  # type: ignore[arg-type]


@dataclass(frozen=True)
class Group(Quantified):
    """Checked group of parameters; subclasses list the fields."""

    def __post_init__(self) -> None:
        for name, meaning in self.quantities().items():
            value = getattr(self, name)
            meaning.check(f"{type(self).__name__.lower()}.{name}", value)
            if isinstance(value, int) and not isinstance(value, bool):
                object.__setattr__(self, name, float(value))
        self.check_together()

    def check_together(self) -> None:
        """Raise InputError unless the values, each within its range, are compatible."""

    def check_profile(self, name: str, each: int = 1) -> None:
        """Raise InputError unless the times and values of a field, `each` per time, form a profile or are empty."""
        check_profile(f"{type(self).__name__.lower()}.{name}", getattr(self, f"{name}_times"),
                      getattr(self, f"{name}_values"), each)

    def changed(self: Same, values: Mapping[str, Value]) -> Same:
        """Return the group with some values, each within its range, replaced and checked together."""
        out = object.__new__(type(self))
        vars(out).update(vars(self), **values)
        out.check_together()
        return out


@dataclass(frozen=True)
class Options(Quantified):
    """Options of a node, checked by the types and quantities of the fields; subclasses list the fields.

    Raises InputError: a value has another type or is out of range.
    """

    def __post_init__(self) -> None:
        for name, meaning in self.quantities().items():
            kind = str(type(self).__dataclass_fields__[name].type)
            object.__setattr__(self, name, _option(name, getattr(self, name), kind, meaning))


def _option(name: str, value: Any, kind: str, meaning: Quantity) -> Any:
    """Convert an option to its type: bool, int, float, str, or a tuple of one of them; InputError as in `Options`."""
    if kind == "bool":
        if not isinstance(value, bool):
            raise InputError(f"{name} is {value!r}; it must be true or false")
        return value
    if kind.startswith("tuple"):
        element = kind[len("tuple["):-len(", ...]")]
        what = {"int": "whole numbers", "float": "numbers", "str": "words"}[element]
        right = {"int": (int,), "float": (int, float), "str": (str,)}[element]
        if not isinstance(value, (list, tuple)) or any(type(x) not in right or x == "" for x in value):
            raise InputError(f"{name} is {value!r}; it must be a list of {what}")
        value = tuple(map(float, value) if element == "float" else value)
        if element == "str":
            return value
    elif kind == "str" and not meaning.choices:
        return str(value)
    elif kind == "int" and isinstance(value, float):
        if not value.is_integer():
            raise InputError(f"{name} is {value:g}; it must be a whole number")
        value = int(value)
    meaning.check(name, value)
    return float(value) if kind == "float" else value


def as_float(value: float) -> float:
    """Return `value` as a float; integers beyond the range of floats become infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def number_in(value: object, unit: str) -> float:
    """Convert a number, or its text, to a float; a text of a key in rad/s may end with one of SUFFIXES. Raise TypeError
    for anything else.

    Examples
    --------
    >>> round(number_in("1500rpm", "rad/s"), 6), number_in("2", "")
    (157.079633, 2.0)
    """
    if isinstance(value, str) and unit == SPEED_UNIT:
        text = value.strip().lower()
        for suffix, factor in SUFFIXES.items():
            if text.endswith(suffix):
                return factor * number_of(text.removesuffix(suffix).strip())
    return number_of(value)


def number_of(value: object) -> float:
    """Convert a number, or its text (YAML reads 1e3 as text), to a float; raise TypeError for any other value."""
    if isinstance(value, bool):
        raise TypeError
    if isinstance(value, (int, float)):
        return as_float(value)
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            raise TypeError from None
    raise TypeError
