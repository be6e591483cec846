"""Speed of the crankshaft as a scene key: another name of engine.frequency, over engine.order.

`engine.speed` is no key of a system; where it is given, engine.frequency = engine.order engine.speed, with the order
that is given beside it, or else that of the system.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcc_sim.errors import InputError
from tcc_sim.model.quantity import Quantity, number_in
from tcc_sim.result import KEY_UNITS

SPEED, FREQUENCY, ORDER = "engine.speed", "engine.frequency", "engine.order"
DERIVED = {
    SPEED: Quantity("speed of the crankshaft: engine.frequency over engine.order", "rad/s",
                    label=r"crankshaft speed $\omega/n$"),
    f"{SPEED}_times": Quantity("times at which engine.speed_values hold, the first 0", "s"),
    f"{SPEED}_values": Quantity("speed of the crankshaft at these times, linear between them", "rad/s")}
"""The key and those of its profile, with their meanings."""
KEY_UNITS[SPEED] = "rad/s"


def with_frequency(values: Mapping[str, object], order: float) -> Mapping[str, object]:
    """Return scene values with engine.speed, or its profile, replaced by engine.frequency.

    Raises
    ------
    InputError
        engine.frequency is given too, or a value is no speed.
    """
    given = [key for key in DERIVED if key in values]
    if not given:
        return values
    both = [name for key in DERIVED if (name := key.replace(SPEED, FREQUENCY)) in values]
    if both:
        raise InputError(f"{given[0]} and {both[0]} are both given, and engine.frequency is engine.order times "
                         "engine.speed; remove one of them")
    try:
        order = number_in(values.get(ORDER, order), "")
    except TypeError:
        return values  # The order itself is refused later.
    changes: dict[str, object] = {}
    for key, value in values.items():
        name = key.replace(SPEED, FREQUENCY) if key in given else key
        changes[name] = value if key not in given or key.endswith("_times") else _times(order, key, value)
    return changes


def _times(order: float, key: str, value: Any) -> object:
    """Return a speed, or each of several, times the order."""
    try:
        if isinstance(value, (list, tuple)):
            return [order * number_in(each, "rad/s") for each in value]
        return order * number_in(value, "rad/s")
    except TypeError:
        raise InputError(f"{key} is {value!r}; it must be a number in rad/s, or one with rpm or hz behind it") from None


def refuse_rpm(key: str, value: object) -> None:
    """Raise InputError for the frequency of the excitation in rpm: an engine in rpm is the crankshaft's speed."""
    texts = [each for each in (value if isinstance(value, (list, tuple)) else [value]) if isinstance(each, str)]
    if key in (FREQUENCY, f"{FREQUENCY}_values") and any("rpm" in text.lower() for text in texts):
        raise InputError(f"{key} is {texts[0]}; it is the frequency of the excitation, in rad/s or hz: give the "
                         f"crankshaft's speed in rpm as {SPEED}={texts[0]}")
