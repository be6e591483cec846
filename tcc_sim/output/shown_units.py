"""Units in which speeds and frequencies are shown: printed lines and axes of pictures; files stay in SI.

What a command shows is written in rad/s everywhere. `in_words` and `shown_axis` turn that into revolutions a minute or
hertz. The frequency of the excitation becomes the engine speed, in revolutions of the crankshaft, where rpm is asked
for: a revolution has `engine.order` periods of the excitation.
"""

from __future__ import annotations

import math
import re
from contextvars import ContextVar

UNITS = {"rad": ("rad/s", 1.0), "rpm": ("rpm", 30.0 / math.pi), "hz": ("Hz", 0.5 / math.pi)}
"""By its name a unit, and how many of it are 1 rad/s."""
_SHOWN: ContextVar[tuple[str, float]] = ContextVar("shown", default=("rad", 1.0))
_NUMBER = r"-?\d[\d.]*(?:e[-+]?\d+)?"
_SPEEDS = re.compile(rf"(engine frequency )?(?<!re )({_NUMBER})( to {_NUMBER})? rad/s(?![\^/)])")
_LABEL = re.compile(r"(.*)\(rad/s\)$", re.DOTALL)
_ENGINE = ("engine frequency", "angular frequency omega of the first harmonic", "engine.frequency")


def show_in(units: str, order: float = 1.0) -> None:
    """Show speeds in one of UNITS from now on, with so many periods of the excitation in a crank revolution."""
    _SHOWN.set((units, order))


def show_order(order: float) -> None:
    """Show engine speeds with so many periods of the excitation in a crank revolution from now on."""
    _SHOWN.set((_SHOWN.get()[0], order))


def in_words(text: str) -> str:
    """Printed text with its speeds in the units that are shown, in as many digits as before."""
    units, order = _SHOWN.get()
    if units == "rad":
        return text
    unit, factor = UNITS[units]

    def converted(found: re.Match[str]) -> str:
        """One number or a range."""
        engine, own = found[1] or "", factor
        if engine and units == "rpm":
            engine, own = "engine speed ", factor / order
        first = _scaled(found[2], own)
        last = "" if found[3] is None else f" to {_scaled(found[3][4:], own)}"
        return f"{engine}{first}{last} {unit}"

    return _SPEEDS.sub(converted, text)


def shown_axis(label: str) -> tuple[str, float] | None:
    """Label of an axis and factor of its numbers in the units that are shown; None where they stay as they are."""
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
    """A number in as many digits, times a factor."""
    digits = len(re.sub(r"^0+", "", number.partition("e")[0].lstrip("-").replace(".", "")))
    return f"{float(number) * factor:.{max(digits, 5)}g}"
