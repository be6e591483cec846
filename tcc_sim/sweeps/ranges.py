"""Ranges of scene keys as a command line writes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.sweeps.settings import DEFAULTS


def values_of_range(text: str, option: str = "--over", even: bool = False) -> tuple[str, list[float]]:
    """KEY and its values: evenly spaced, or evenly in logarithm with `:log`, both ends included; or those of a list.
    `even` takes evenly spaced ones only.

    Raises
    ------
    InputError
        Anything else.

    Examples
    --------
    >>> values_of_range("engine.frequency=1:100:3:log")
    ('engine.frequency', [1.0, 10.0, 100.0])
    >>> values_of_range("engine.frequency=80,90.5,140")
    ('engine.frequency', [80.0, 90.5, 140.0])
    """
    key, equals, numbers = text.partition("=")
    others = "" if even else ", KEY=START:STOP:COUNT:log or KEY=VALUE,VALUE,..."
    wrong = InputError(f"{option} is {text!r}; it must be KEY=START:STOP:COUNT{others}")
    if not equals:
        raise wrong
    if not even and "," in numbers and ":" not in numbers:
        return key, _numbers(numbers.split(","), wrong)
    logarithmic = not even and numbers.endswith(":log")
    return key, spaced(numbers.removesuffix(":log") if logarithmic else numbers, option, logarithmic, wrong)


def spaced(text: str, option: str, logarithmic: bool = True, wrong: InputError | None = None) -> list[float]:
    """The values of START:STOP:COUNT, both ends included, evenly in logarithm or evenly.

    Raises
    ------
    InputError
        Anything else: `wrong` where it is given.
    """
    wrong = wrong or InputError(f"{option} is {text!r}; it must be START:STOP:COUNT, two numbers and a whole number")
    parts = text.split(":")
    if len(parts) != 3:
        raise wrong
    start, stop = _numbers(parts[:2], wrong)
    try:
        count = int(parts[2])
    except ValueError:
        raise wrong from None
    if not 1 <= count <= DEFAULTS.most_values:
        raise InputError(f"{option} has a count of {count}; it must be 1 to {DEFAULTS.most_values}")
    if logarithmic and not start * stop > 0.0:
        raise InputError(f"{option} goes from {start:g} to {stop:g}; values that are even in logarithm must be above "
                         "0, or all below it")
    return [float(x) for x in (np.geomspace if logarithmic else np.linspace)(start, stop, count)]


def bounds_of_range(text: str, option: str, names: str = "START:STOP") -> tuple[str, float, float]:
    """KEY, the smaller and the larger number of KEY=LOW:HIGH, which must differ.

    Raises
    ------
    InputError
        Anything else.
    """
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY={names}")
    parts = numbers.split(":")
    if not equals or len(parts) != 2:
        raise wrong
    low, high = sorted(_numbers(parts, wrong))
    if low == high:
        raise InputError(f"{option} is {text!r}; the two values must differ")
    return key, low, high


def _numbers(words: Sequence[str], wrong: InputError) -> list[float]:
    """Finite numbers; `wrong` is raised for anything else."""
    try:
        found = [float(word) for word in words]
    except ValueError:
        raise wrong from None
    if not all(map(math.isfinite, found)):
        raise wrong
    return found
