"""Units of speeds and frequencies in printed lines and on axes of pictures; files stay in SI.

All lines and labels are made in rad/s. `in_words` and `shown_axis` convert them to revolutions per minute or hertz. In
rpm, the frequency of the excitation becomes the engine speed, in revolutions of the crankshaft: one revolution has
`engine.order` periods of the excitation.
"""

from __future__ import annotations

import math
import re
from contextvars import ContextVar

UNITS = {"rad": ("rad/s", 1.0), "rpm": ("rpm", 30.0 / math.pi), "hz": ("Hz", 0.5 / math.pi)}
"""Unit, and factor from rad/s, by the name of --units."""
_SHOWN: ContextVar[tuple[str, float]] = ContextVar("shown", default=("rad", 1.0))
_NUMBER = r"-?\d[\d.]*(?:e[-+]?\d+)?"
_SPEEDS = re.compile(rf"(engine frequency )?(?<!re )({_NUMBER})( to {_NUMBER})? rad/s(?![\^/)])")
_LABEL = re.compile(r"(.*)\(rad/s\)$", re.DOTALL)
_ENGINE = ("engine frequency", "angular frequency omega of the first harmonic", "engine.frequency")


def show_in(units: str, order: float = 1.0) -> None:
    """Select one of UNITS, and the number of periods of the excitation per crank revolution."""
    _SHOWN.set((units, order))


def show_order(order: float) -> None:
    """Set the number of periods of the excitation per crank revolution, for engine speeds."""
    _SHOWN.set((_SHOWN.get()[0], order))


def in_words(text: str) -> str:
    """Return a printed text with its speeds in the selected units, with the same number of digits."""
    units, order = _SHOWN.get()
    if units == "rad":
        return text
    unit, factor = UNITS[units]

    def converted(found: re.Match[str]) -> str:
        """Convert one number or a range."""
        engine, own = found[1] or "", factor
        if engine and units == "rpm":
            engine, own = "engine speed ", factor / order
        first = _scaled(found[2], own)
        last = "" if found[3] is None else f" to {_scaled(found[3][4:], own)}"
        return f"{engine}{first}{last} {unit}"

    return _SPEEDS.sub(converted, text)


def shown_axis(label: str) -> tuple[str, float] | None:
    """Return label and factor of an axis in the selected units; None if the axis stays unchanged."""
    units, order = _SHOWN.get()
    found = _LABEL.fullmatch(label)
    if units == "rad" or found is None:
        return None
    unit, factor = UNITS[units]
    if not found[1].strip().startswith(_ENGINE):
        return f"{found[1]}({unit})", factor
    if units == "rpm":
        return f"engine speed ({unit})", factor / order
    return rf"excitation frequency $\omega/2\pi$ ({unit})", factor


def _scaled(number: str, factor: float) -> str:
    """Return a number times a factor, with the same number of digits."""
    digits = len(re.sub(r"^0+", "", number.partition("e")[0].lstrip("-").replace(".", "")))
    return f"{float(number) * factor:.{max(digits, 5)}g}"
