"""Speed of the crankshaft as a scene key: engine.frequency = engine.order engine.speed.

A system keeps the speeds that were given (`System.speeds`), so that a change of engine.order keeps them and changes the
frequency. A frequency that was given stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from tcc_sim.errors import InputError
from tcc_sim.model.quantity import Quantity, number_in
from tcc_sim.result import KEY_UNITS

if TYPE_CHECKING:
    from tcc_sim.model.groups import Engine

SPEED, FREQUENCY, ORDER = "engine.speed", "engine.frequency", "engine.order"
DERIVED = {
    SPEED: Quantity("speed of the crankshaft: engine.frequency over engine.order", "rad/s",
                    label=r"crankshaft speed $\omega/n$"),
    f"{SPEED}_times": Quantity("times at which engine.speed_values hold, the first 0", "s"),
    f"{SPEED}_values": Quantity("speed of the crankshaft at these times, linear between them", "rad/s")}
"""The key and those of its profile, with their meanings."""
KEY_UNITS[SPEED] = "rad/s"
Speeds = Mapping[str, float | tuple[float, ...]]
"""Speeds of the crankshaft by key, rad/s: one, or those of its profile."""


def frequency_key(key: str) -> str:
    """Return the key of the frequency that a key of the speed defines; any other key as it is."""
    return key.replace(SPEED, FREQUENCY) if key in DERIVED else key


def with_frequency(values: Mapping[str, object], engine: Engine, kept: Speeds) -> tuple[Mapping[str, object], Speeds]:
    """Return scene values with speeds, given or kept, replaced by frequencies, and the speeds that are now given.

    Raises
    ------
    InputError
        engine.frequency is given beside engine.speed, or a value is no speed.
    """
    given = [key for key in DERIVED if key in values]
    frequencies = [name for key in DERIVED if (name := frequency_key(key)) in values]
    if given and frequencies:
        raise InputError(f"{given[0]} and {frequencies[0]} are both given, and engine.frequency is engine.order times "
                         "engine.speed; remove one of them")
    speeds = {} if frequencies else dict(kept)
    if not given and not (speeds and ORDER in values):
        return values, speeds
    if given:
        speeds.setdefault(SPEED, engine.frequency / engine.order)
        speeds.update((key, _speed(key, values[key])) for key in given if not key.endswith("_times"))
    try:
        order = number_in(values.get(ORDER, engine.order), "")
    except TypeError:
        return values, speeds  # The order itself is refused later.
    changes = {frequency_key(key): value for key, value in values.items()}
    for key, speed in speeds.items():
        changes[frequency_key(key)] = [order * x for x in speed] if isinstance(speed, tuple) else order * speed
    return changes, speeds


def _speed(key: str, value: object) -> float | tuple[float, ...]:
    """Return a speed, or each of several, in rad/s."""
    try:
        if isinstance(value, (list, tuple)):
            return tuple(number_in(each, "rad/s") for each in value)
        return number_in(value, "rad/s")
    except TypeError:
        raise InputError(f"{key} is {value!r}; it must be a number in rad/s, or one with rpm or hz behind it") from None


def refuse_rpm(key: str, value: object) -> None:
    """Raise InputError for the frequency of the excitation in rpm: an engine in rpm is the crankshaft's speed."""
    texts = [each for each in (value if isinstance(value, (list, tuple)) else [value]) if isinstance(each, str)]
    if key in (FREQUENCY, f"{FREQUENCY}_values") and any("rpm" in text.lower() for text in texts):
        raise InputError(f"{key} is {texts[0]}; it is the frequency of the excitation, in rad/s or hz: give the "
                         f"crankshaft's speed in rpm as {SPEED}={texts[0]}")
