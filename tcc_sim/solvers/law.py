"""The friction law on rows of nodes, and its derivatives by the slip speed and by its own numbers.

The law's own text (`model.friction`) runs on such rows, on numbers that carry their derivatives (`Changing`),
and on series of such numbers, so that neither a derivative nor a series of the law is written out here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from types import SimpleNamespace
from typing import Any

from tcc_sim.compiling.compiled import rebound
from tcc_sim.compiling.unrolled import exp, is_constant, limited, magnitude, row_of, with_sign
from tcc_sim.model import friction
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.key_derivatives import DECAY, EXCESS_RATIO, LATER, SMOOTHING
from tcc_sim.solvers.series import FRICTION_ORDER_MAXIMUM, LOAD, SLIP, driven, product, square


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
    if one is None or other is None:
        return other if one is None else one
    return one + other


def law_on(decaying: Callable[[Any], Any], size: Callable[[Any], Any] = magnitude,
           tanh: Callable[[Any], Any] | None = None) -> Any:
    """Return the functions of `model.friction`, by name, with others for the exponential of -a |v|, for |v| and for
    tanh.
    """
    exponentials_at = rebound(friction.exponentials_at, decayed=rebound(friction.decayed, exp=decaying))
    return SimpleNamespace(
        exponentials_at=exponentials_at, sliding=rebound(friction.sliding, exponentials_at=exponentials_at),
        smoothed_coefficient=rebound(friction.smoothed_coefficient, exponentials_at=exponentials_at, magnitude=size,
                                     tanh=tanh))


def continued(x: Any) -> Any:
    """Return e^x of a staged function for x = -a |v|, which a |v| continued through v = 0 may take above 0, up to 1."""
    return exp(limited(x, -700.0, 1.0))


exponentials_at = law_on(continued).exponentials_at
step_and_rest = rebound(friction.step_and_rest, exp=exp, magnitude=magnitude, with_sign=with_sign)
"""The law on names of staged functions (`compiling.unrolled`), single or in rows, or on plain numbers."""
FRICTION, OF_SLIP, OF_EXCESS, OF_DECAY, OF_SMOOTHING, OF_LATER = range(6)
"""Columns of `law`: Ts mubar, and its derivatives by v, c_1, a_1, sigma; the first of those by c_2, a_2, c_3, a_3."""
NUMBERS_OF_ALL = {OF_EXCESS: EXCESS_RATIO, OF_DECAY: DECAY, OF_SMOOTHING: SMOOTHING,
                  **{OF_LATER + j: number for j, number in enumerate(LATER)}}
COLUMNS_OF_PAIRS = (OF_EXCESS, OF_DECAY), (OF_LATER, OF_LATER + 1), (OF_LATER + 2, OF_LATER + 3)
"""Columns of amplitude and rate of each exponential."""
NARROW, WIDE = 8, 16
"""Columns of `law` without those of the later exponentials, and with them."""


def numbers_of(stribeck: Stribeck, width: int = WIDE) -> dict[int, int]:
    """Return the numbers of the law by their columns in a `law` of this width."""
    pairs = COLUMNS_OF_PAIRS[:min(len(stribeck or ()) // 2, 3 if width > NARROW else 1)]
    return {cause: NUMBERS_OF_ALL[cause] for cause in (OF_SMOOTHING, *chain(*pairs))}


def numbers_with(stribeck: Stribeck, of_first: bool, of_later: bool, wrapped: Callable[[Any, Any], Any]) -> Any:
    """Return amplitudes and rates in turn, each with itself as a cause of change, if there are derivatives by it."""
    causes = chain(*COLUMNS_OF_PAIRS)
    counted = (True, of_first, *[of_later] * (2 * len(COLUMNS_OF_PAIRS) - 2))
    return None if stribeck is None else tuple(
        wrapped(number, Causes({cause: 1.0}) if counts else None)
        for number, cause, counts in zip(stribeck, causes, counted))


def mubar_at(v: Any, side: Any, sigma: Any, stribeck: Any) -> Changing:
    """Return mubar of (7) at a slip speed v, or at a row of them, on one side of v = 0, with its derivatives by v and
    by the numbers of the law, in the columns of `law`.
    """
    law = law_on(_exp_of, lambda number: number * side, _tanh_of)
    coefficient: Changing = law.smoothed_coefficient(
        Changing(v, Causes({OF_SLIP: 1.0})), Changing(sigma, Causes({OF_SMOOTHING: 1.0})),
        numbers_with(stribeck, True, True, Changing))
    return coefficient


def sliding_at(v: Any, stribeck: tuple[float, ...]) -> tuple[Any, list[Any]]:
    """Return the coefficient of (6) at slip speeds v above 0, and its derivatives by amplitudes and rates in turn."""
    coefficient = law_on(_exp_of).sliding(Changing(v, Causes()), 1.0, numbers_with(stribeck, True, True, Changing))
    return coefficient.value, [coefficient.change[cause] for cause, _ in zip(chain(*COLUMNS_OF_PAIRS), stribeck)]


def _exp_of(x: Changing) -> Changing:
    """Return e^x with its derivatives, dF = F dx."""
    value = continued(x.value)
    return Changing(value, x.change * value)


def _tanh_of(x: Changing) -> Changing:
    """Return tanh x with its derivatives, dT = (1 - T^2) dx."""
    value, rest = step_and_rest(x.value)
    return Changing(value, x.change * rest)


class Along:
    """A number along a motion: its series with its derivatives, each coefficient computed once, when it is needed.

    The rules are those of sums, products and functions of series. `following(k)` returns coefficient k, Changing; a
    constant has no other one than coefficient 0.
    """

    def __init__(self, following: Callable[[int], Any], constant: bool = False) -> None:
        self.following, self.constant, self.known = following, constant, list[Any]()

    def __getitem__(self, k: int) -> Any:
        while len(self.known) <= k:
            self.known.append(self.following(len(self.known)))
        return self.known[k]

    def __add__(self, other: Any) -> Along:
        if isinstance(other, Along):
            return Along(lambda k: self[k] + other[k])
        return Along(lambda k: self[k] + other if k == 0 else self[k])

    def __mul__(self, other: Any) -> Along:
        if not isinstance(other, Along):
            return Along(lambda k: self[k] * other, self.constant)
        if self.constant or other.constant:
            one, many = (self, other) if self.constant else (other, self)
            return Along(lambda k: one[0] * many[k], one.constant and many.constant)
        return Along(lambda k: product([self[j] for j in range(k + 1)], [other[j] for j in range(k + 1)], k))

    def __neg__(self) -> Along:
        return Along(lambda k: -self[k], self.constant)

    __radd__ = __add__
    __rmul__ = __mul__


def constant(number: Any, change: Any = None) -> Along:
    """Return a number that is constant along the motion, with its derivatives."""
    return Along(lambda k: Changing(number, change) if k == 0 else 0.0, constant=True)


def _exp_along(x: Along) -> Along:
    """Return the series of e^x, F' = x' F, with its derivatives, dF = F dx."""
    weighted, values = [0.0], list[Any]()

    def following(k: int) -> Changing:
        if k == 0:
            values.append(exp(x[0].value))
        else:
            weighted.append(float(k) * x[k].value)
            values.append(driven(1.0, weighted, values, k))
        return Changing(values[k], product([x[j].change for j in range(k + 1)], values, k))

    return Along(following)


def _tanh_along(x: Along) -> Along:
    """Return the series of T = tanh x, T' = x' (1 - T^2), with its derivatives, dT = (1 - T^2) dx."""
    weighted, values, rests = [0.0], list[Any](), list[Any]()

    def following(k: int) -> Changing:
        if k == 0:
            for series, start in zip((values, rests), step_and_rest(x[0].value)):
                series.append(start)
        else:
            weighted.append(float(k) * x[k].value)
            values.append(driven(1.0, weighted, rests, k))
            rests.append(-square(values, k))
        return Changing(values[k], product([x[j].change for j in range(k + 1)], rests, k))

    return Along(following)


def law_along(rows: Any, coefficients: Any, law: Any, shaped: Any, sign: Any, pulsation: Any, stribeck: Any,
              sigma: Any) -> Iterator[int]:
    """Fill the coefficients of mubar, and of Ts mubar with its derivatives, along a motion; staged function.

    rows, coefficients : the motion's coefficients, and those of mubar
    law : (COLUMNS, 8 or 16) columns FRICTION to OF_SMOOTHING, and with 16 from OF_LATER on; only the first four are
        filled where `shaped` is None, with 0 by a_1 and sigma
    sign : of the slip speed
    stribeck, sigma : amplitudes and rates in turn, and the smoothing factor; None where the exponentials, or tanh, do
        not vary
    """
    if stribeck is None and sigma is None:
        return
    slip = Along(lambda k: Changing(rows[SLIP, k], Causes({OF_SLIP: 1.0} if k == 0 else {})))
    pairs = numbers_with(stribeck, shaped is not None, shaped is not None and law.shape[-1] > NARROW, constant)
    text = law_on(_exp_along, lambda number: number * sign, _tanh_along)
    if sigma is None:
        mubar = text.sliding(slip, constant(sign), pairs)
    else:
        sharpness = constant(sigma, None if shaped is None else Causes({OF_SMOOTHING: 1.0}))
        mubar = text.smoothed_coefficient(slip, sharpness, pairs)
    load, causes = list[Any](), range(OF_SLIP, OF_DECAY + 1 if shaped is None else law.shape[-1])
    side_by_side: list[Any] = []
    for k in range(FRICTION_ORDER_MAXIMUM):
        load.append(rows[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        coefficients[k,] = mubar[k].value
        side_by_side.append(row_of([mubar[k].value, *(mubar[k].change.get(cause, 0.0) for cause in causes)]))
        law.set_row(product(side_by_side, load, k), k)
        if shaped is None:
            law[k, OF_SMOOTHING] = 0.0
        if k % 2 == 1 and k >= 7:
            yield k + 1
