"""Numbers of staged functions that carry their derivatives."""

from __future__ import annotations

from typing import Any

from tcc_sim.compiling.unrolled import is_constant


class Causes(dict[int, Any]):
    """Derivatives by cause, 0 by a cause that is not in it; the number 0 may be added."""

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
    """A number and the row of its derivatives, a lane for each cause; None for a constant.

    A staged function is differentiated by running it on such numbers, with the rules of sums, products and quotients
    (forward mode; A. Griewank and A. Walther, Evaluating Derivatives, SIAM 2008, Section 3.1).
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
    """Return the sum of two rows."""
    if one is None or other is None:
        return other if one is None else one
    return one + other
