"""What a scene key means, and groups of keys that check themselves: unit, allowed range or choices; and profiles of the
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

from tcc_sim.errors import InputError

Value = float | str | tuple[float, ...]
Same = TypeVar("Same", bound="Group")
PROFILES = ("engine.frequency", "engine.mean_torque", "pressure.mean")
"""The keys that may vary in time; each has a list of times and a list of values."""
MOST_POINTS, LATEST = 1000, 1e6
"""Points that a profile may have, and its latest time, s."""


def sequence_of_numbers(key: str, values: Any) -> tuple[float, ...]:
    """The values that a key is to have one after the other: numbers in any sequence or array, or a single one.

    Raises
    ------
    InputError
        Anything else.
    """
    try:
        return tuple(float(x) for x in (values if isinstance(values, Iterable) else (values,)))
    except (TypeError, ValueError):
        raise InputError(f"{key} has the values {values!r:.100}; they must be numbers") from None


@dataclass(frozen=True)
class Quantity:
    """What a key means: its unit, its allowed range or choices, and whether a running node may change it."""

    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    choices: tuple[str, ...] = ()
    live: bool = False

    def interval(self) -> str:
        """The allowed values in words, for error messages and parameter descriptions."""
        if self.choices:
            return " or ".join(self.choices)
        low = f"above {self.low:g}" if self.above else f"{self.low:g}"
        return f"{low} to {self.high:g}" + (f" {self.unit}" if self.unit else "")

    def check(self, key: str, value: object) -> None:
        """Raise InputError unless `value` is of the right kind and within the range."""
        if self.choices:
            if value not in self.choices:
                raise InputError(f"{key} is {value!r}; it must be {self.interval()}")
            return
        for x in value if isinstance(value, tuple) else (value,):
            if isinstance(x, bool) or not isinstance(x, (int, float)):
                raise InputError(f"{key} is {value!r}; it must be a number, {self.interval()}")
            if not (self.low <= x <= self.high) or (self.above and x == self.low):
                raise InputError(f"{key} is {apart(as_float(x), self.low, self.high)}"
                                 f"{' ' + self.unit if self.unit else ''}; it must be {self.interval()}")


def apart(value: float, *others: float) -> str:
    """A number in as few digits, six or more, as tell it from others that it is not equal to."""
    for digits in (6, 9, 12, 15):
        text = f"{value:.{digits}g}"
        if all(text != f"{other:.{digits}g}" or value == other for other in others):
            return text
    return repr(value)


def quantity(default: Value, description: str, unit: str = "", low: float = -math.inf, high: float = math.inf,
             *, above: bool = False, choices: tuple[str, ...] = (), live: bool = False) -> Any:
    """A dataclass field that carries its Quantity."""
    meta = Quantity(description, unit, low, high, above, choices, live)
    return field(default=default, metadata={"quantity": meta})


@dataclass(frozen=True)
class Group:
    """A checked group of parameters; subclasses list the fields."""

    def __post_init__(self) -> None:
        for name, key, meaning in self.quantities():
            value = getattr(self, name)
            meaning.check(key, value)
            if isinstance(value, int) and not isinstance(value, bool):
                object.__setattr__(self, name, float(value))
        self.check_together()

    def check_together(self) -> None:
        """Raise InputError unless values that are allowed by themselves are so together."""

    def check_profile(self, name: str) -> None:
        """Raise InputError unless the times and values of a field make a profile, or are both empty."""
        key = f"{type(self).__name__.lower()}.{name}"
        times, values = getattr(self, f"{name}_times"), getattr(self, f"{name}_values")
        if len(times) != len(values):
            raise InputError(f"{key}_values has {len(values)} values; it must have as many as {key}_times, "
                             f"{len(times)}")
        if len(times) > MOST_POINTS:
            raise InputError(f"{key}_times has {len(times)} values; at most {MOST_POINTS} are allowed")
        if times and times[0] != 0.0:
            raise InputError(f"{key}_times begins at {times[0]:g} s; the first time must be 0")
        for before, after in itertools.pairwise(times):
            if not after > before:
                raise InputError(f"{key}_times has {after:g} s after {before:g} s; the times must increase")

    def changed(self: Same, values: Mapping[str, Value]) -> Same:
        """The group with values that are allowed by themselves in the place of its own, checked together."""
        out = object.__new__(type(self))
        vars(out).update(vars(self), **values)
        out.check_together()
        return out

    @classmethod
    @cache
    def quantities(cls) -> list[tuple[str, str, Quantity]]:
        """Name, key and meaning of every field."""
        return [(item.name, f"{cls.__name__.lower()}.{item.name}", item.metadata["quantity"])
                for item in dataclasses.fields(cls)]


def as_float(value: float) -> float:
    """`value` as a float; whole numbers beyond its range are infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def number_of(value: object) -> float:
    """A finite or infinite number as float; TypeError for anything else (YAML reads 1e3 as text)."""
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
