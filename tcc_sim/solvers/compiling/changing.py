"""Numbers of staged functions that carry what they change by."""

from __future__ import annotations

from typing import Any

from tcc_sim.solvers.compiling.unrolled import is_constant


class Causes(dict[int, Any]):
    """A number for each of the causes that count: a row of changes whose other lanes are empty; 0 may be added."""

    def __add__(self, other: Any) -> Causes:
        if not isinstance(other, Causes):
            return self
        return Causes({**self, **other, **{cause: self[cause] + other[cause] for cause in self.keys() & other.keys()}})

    def __mul__(self, number: Any) -> Causes:
        return Causes({cause: number * share for cause, share in self.items()})

    def __neg__(self) -> Causes:
        return Causes({cause: -share for cause, share in self.items()})

    __radd__ = __add__


class Changing:
    """A number and a row of what it changes by, one lane for each cause; no row where it does not change.

    A staged function run on such numbers is differentiated by running it: the rules are those of sums, products and
    quotients (forward mode; A. Griewank and A. Walther, Evaluating Derivatives, SIAM 2008, Section 3.1).
    """

    def __init__(self, value: Any, change: Any = None) -> None:
        self.value, self.change = value, change

    def __add__(self, other: Any) -> Any:
        if not isinstance(other, Changing):
            return self if is_constant(other, 0.0) else Changing(self.value + other, self.change)
        return Changing(self.value + other.value, _both(self.change, other.change))

    def __mul__(self, other: Any) -> Any:
        if is_constant(other, 0.0):
            return 0.0
        if not isinstance(other, Changing):
            other = Changing(other)
        return Changing(self.value * other.value,
                        _both(None if self.change is None else self.change * other.value,
                              None if other.change is None else other.change * self.value))

    def __neg__(self) -> Changing:
        return Changing(-self.value, None if self.change is None else -self.change)

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __rtruediv__(self, other: Any) -> Any:
        inverse = 1.0 / self.value
        return Changing(inverse, None if self.change is None else self.change * -(inverse * inverse)) * other

    def __truediv__(self, other: Any) -> Any:
        return self * (1.0 / other)

    __radd__ = __add__
    __rmul__ = __mul__


def _both(one: Any, other: Any) -> Any:
    """The sum of two changes."""
    if one is None or other is None:
        return other if one is None else one
    return one + other
