"""Scenes with one or two keys at an end of their range, or next to 0: no product vanishes or overflows."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES, System, replace
from tcc_sim.output.estimates import estimate_lines, estimates_of
from tcc_sim.output.explanation import closed_forms, friction_lines, friction_of
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of

KEYS = [key for key, value in DEFAULTS.items() if isinstance(value, float)]
PAIRS = 80


def ends(key: str) -> list[float]:
    """The ends of a key's range, and the smallest numbers in it."""
    meant = QUANTITIES[key]
    values = [meant.low, meant.high, 5e-324, -5e-324, 1e-300, math.nextafter(meant.low, math.inf)]
    return [x for x in dict.fromkeys(values) if math.isfinite(x) and (meant.low <= x <= meant.high or (
        meant.zero and x == 0.0))]


def allowed(changes: dict[str, float]) -> System | None:
    """Scene fig02 with these values; None if they are refused together."""
    try:
        return replace(System(), changes)
    except InputError:
        return None


def check(system: System) -> None:
    """Explain and solve a scene without a warning of NumPy and without an error but those of the package."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = "\n".join([*estimate_lines(estimates_of(system)), *friction_lines(friction_of(system))])
        closed_forms(replace(system, {"friction.law": "set_valued"}))   # Without the comparison with ticks.
        if [x is None for x in terms_of(system)] == [x is None for x in terms_of(System())]:   # Another kernel else.
            solve(system, cycles=1)
    assert "nan" not in text


@pytest.mark.parametrize("key", KEYS)
def test_a_scene_computes_at_the_ends_of_every_range(key: str) -> None:
    for value in ends(key):
        system = allowed({key: value})
        if system is not None:
            check(system)


def test_a_scene_computes_with_two_values_at_the_ends_of_their_ranges() -> None:
    draw, seen = np.random.default_rng(51), 0
    while seen < PAIRS:
        pair = draw.choice(KEYS, 2, replace=False)
        system = allowed({str(key): float(draw.choice(ends(str(key)))) for key in pair})
        if system is not None:
            check(system)
            seen += 1


@pytest.mark.parametrize("key", ["driveline.stiffness", "friction.static_coefficient", "clutch.area", "clutch.radius",
                                 "pressure.frequency_ratio"])
def test_what_would_vanish_in_a_product_is_refused(key: str) -> None:
    with pytest.raises(InputError, match=f"{key} is 4.94066e-324"):
        replace(System(), {key: 5e-324})
