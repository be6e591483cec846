"""Units of speeds and frequencies in printed lines and on axes of pictures; results and files stay in SI.

In rpm, the frequency of the excitation becomes the engine speed, in revolutions of the crankshaft: one revolution has
`engine.order` periods of the excitation. Other frequencies, of a spectrum or a natural one, are then in Hz.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from tcc_sim.result import KEY_UNITS

SPEED = "rad/s"
"""SI unit of the values that are converted."""
UNITS = {"rad": (SPEED, 1.0), "rpm": ("rpm", 30.0 / math.pi), "hz": ("Hz", 0.5 / math.pi)}
"""Unit, and factor from rad/s, by the name of --units."""
_SHOWN: ContextVar[tuple[str, float]] = ContextVar("shown", default=("rad", 1.0))
_ENGINE = ("engine frequency", "engine.frequency")


def show_in(units: str | None = None, order: float | None = None) -> None:
    """Select one of UNITS, and the number of periods of the excitation per crank revolution; None changes nothing."""
    before = _SHOWN.get()
    _SHOWN.set((units or before[0], order or before[1]))


def selected_units() -> str:
    """Return the selected one of UNITS."""
    return _SHOWN.get()[0]


@contextmanager
def shown_in(units: str | None, order: float | None) -> Iterator[None]:
    """Select as `show_in` does, within a `with` block."""
    before = _SHOWN.get()
    show_in(units, order)
    try:
        yield
    finally:
        _SHOWN.set(before)


def shown_unit(unit: str = SPEED, engine: bool = False) -> tuple[str, float]:
    """Return the unit in which values in an SI unit are shown, and the factor to it.

    engine : whether the values are frequencies of the excitation
    """
    units, order = _SHOWN.get()
    if unit != SPEED:
        return unit, 1.0
    shown, factor = UNITS[units]
    return shown, factor / order if engine and units == "rpm" else factor


def speed(value: float, digits: int = 6, last: float | None = None, *, engine: bool = False) -> str:
    """Return a speed, rad/s, or the range from it to `last`, in the selected unit."""
    unit, factor = shown_unit(engine=engine)
    return f"{_range(value, last, factor, digits)} {unit}"


def frequency(value: float, digits: int = 6, last: float | None = None) -> str:
    """Return a frequency that is not that of the excitation, rad/s, or a range of it: in Hz where speeds are in rpm."""
    unit, factor = UNITS["hz"] if _SHOWN.get()[0] == "rpm" else shown_unit()
    return f"{_range(value, last, factor, digits)} {unit}"


def engine_speed(value: float, digits: int = 6, last: float | None = None) -> str:
    """Return the frequency of the excitation, rad/s, or a range of it, with its name: engine speed in rpm."""
    name = "engine speed" if _SHOWN.get()[0] == "rpm" else "engine frequency"
    return f"{name} {speed(value, digits, last, engine=True)}"


def key_unit(key: str) -> tuple[str, float]:
    """Return the unit in which values of a scene key are shown, and the factor to it."""
    return shown_unit(KEY_UNITS.get(key, ""), key in _ENGINE)


def key_value(key: str, value: float, digits: int = 9, last: float | None = None) -> str:
    """Return a scene key with a value, or the range from it to `last`, and the unit."""
    unit, factor = key_unit(key)
    return f"{key} {_range(value, last, factor, digits)} {unit}".rstrip()


def _range(value: float, last: float | None, factor: float, digits: int) -> str:
    """Return one number or two, times a factor."""
    return " to ".join(f"{x * factor:.{digits}g}" for x in ((value,) if last is None else (value, last)))


def shown_axis(name: str, unit: str = "", frequency: str = "") -> tuple[str, float]:
    """Return the label of an axis in the selected unit, and the factor to it from the SI unit of its data.

    frequency : "engine" for the frequency of the excitation, "other" for another angular frequency
    """
    units, _ = _SHOWN.get()
    if unit != SPEED or units == "rad":
        return f"{name} ({unit})" if unit else name, 1.0
    shown, factor = UNITS["hz"] if units == "rpm" and frequency == "other" else shown_unit(engine=frequency == "engine")
    if frequency == "engine":
        name = "engine speed" if units == "rpm" else r"excitation frequency $\omega/2\pi$"
    return f"{name.removeprefix('angular ')} ({shown})", factor
