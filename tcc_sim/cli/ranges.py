"""Values and ranges of scene keys in words of a command line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tcc_sim.errors import InputError


def values_of_range(text: str, option: str = "--over", even: bool = False) -> tuple[str, list[float]]:
    """Return the key and the values of KEY=START:STOP:COUNT[:log] or KEY=VALUE,VALUE,...

    A range includes both ends; `:log` spaces its values evenly in logarithm. `even` allows KEY=START:STOP:COUNT only.

    Examples
    --------
    >>> values_of_range("engine.frequency=1:100:3:log")
    ('engine.frequency', [1.0, 10.0, 100.0])
    >>> values_of_range("engine.frequency=80,90.5,140")
    ('engine.frequency', [80.0, 90.5, 140.0])
    >>> round(values_of_range("engine.speed=1500rpm,3000rpm")[1][1], 3)
    314.159
    """
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY=START:STOP:COUNT"
                       + ("" if even else ", KEY=START:STOP:COUNT:log or KEY=VALUE,VALUE,..."))
    if not equals:
        raise wrong
    if not even and "," in numbers and ":" not in numbers:
        return key, _numbers(numbers.split(","), wrong, key)
    plain = numbers if even else numbers.removesuffix(":log")
    return key, spaced(plain, option, plain != numbers, wrong, key)


def spaced(text: str, option: str, logarithmic: bool = True, wrong: InputError | None = None,
           key: str = "") -> list[float]:
    """Return the values of START:STOP:COUNT, both ends included, spaced evenly or evenly in logarithm.

    For a text of another form, the error is `wrong`, if given.
    """
    wrong = wrong or InputError(f"{option} is {text!r}; it must be START:STOP:COUNT, two numbers and a whole number")
    parts = text.split(":")
    if len(parts) != 3:
        raise wrong
    start, stop = _numbers(parts[:2], wrong, key)
    try:
        count = int(parts[2])
    except ValueError:
        raise wrong from None
    from tcc_sim.model.quantity import MOST_VALUES

    if not 1 <= count <= MOST_VALUES:
        raise InputError(f"{option} has a count of {count}; it must be 1 to {MOST_VALUES}")
    if logarithmic and not start * stop > 0.0:
        raise InputError(f"{option} goes from {start:g} to {stop:g}; values spaced evenly in logarithm must all "
                         "be above 0, or all below 0")
    import numpy as np

    return [float(x) for x in (np.geomspace if logarithmic else np.linspace)(start, stop, count)]


def bounds_of_range(text: str, option: str, names: str = "START:STOP") -> tuple[str, float, float]:
    """Return the key and the two numbers of KEY=LOW:HIGH, the smaller one first."""
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY={names}")
    parts = numbers.split(":")
    if not equals or len(parts) != 2:
        raise wrong
    low, high = sorted(_numbers(parts, wrong, key))
    if low == high:
        raise InputError(f"{option} is {text!r}; the two values must differ")
    return key, low, high


def _numbers(words: Sequence[str], wrong: InputError, key: str) -> list[float]:
    """Return the words as finite numbers, those of speeds with a unit too; raise `wrong` if one of them is none.

    key : scene key that they are for; empty for frequencies, rad/s
    """
    from tcc_sim.model.parameters import DERIVED, QUANTITIES, refuse_rpm
    from tcc_sim.model.quantity import SPEED_UNIT, number_in

    refuse_rpm(key, list(words))
    meant = {**QUANTITIES, **DERIVED}.get(key)
    unit = meant.unit if meant is not None else "" if key else SPEED_UNIT
    try:
        numbers = [number_in(word, unit) for word in words]
    except TypeError:
        raise wrong from None
    if not all(map(math.isfinite, numbers)):
        raise wrong
    return numbers
