"""Figures of `explain` on a grid and by hand, and of scenes with keys at the ends of their ranges."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES, System, replace
from tcc_sim.output.estimates import estimate_lines, estimates_of
from tcc_sim.output.explanation import closed_forms, friction_lines, friction_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of

TABLE = {"friction.slip_speeds": [0.0, 1.0, 2.0, 4.0], "friction.coefficients": [0.14, 0.12, 0.11, 0.105]}


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("table", [{}, TABLE])
def test_the_figures_of_a_friction_law(law: str, table: dict[str, Any]) -> None:
    """Of mu(v) = c + a exp(-r v) and of mu(v) tanh(50 v) on a grid; stick ends where the latter is largest."""
    found = friction_of(load_scene("fig02").with_values({**table, "friction.law": law}).system)
    if not table:
        assert (found["constant"], found["amplitudes"], found["rates"]) == (0.24, [pytest.approx(0.06)], [2.0])
    c, (a,), (r,), end = found["constant"], found["amplitudes"], found["rates"], 4.0 if table else 10.0
    v = np.linspace(0.0, end, 1_000_001)
    curve = c + a * np.exp(-r * v)
    smooth = curve * np.tanh(50.0 * v)
    assert found["slip_speeds"] == [0.0, end]
    assert found["coefficients"] == pytest.approx([curve[0], curve[-1] if table else c], rel=1e-12)
    assert found["slopes"] == pytest.approx([-a * r, -a * r * math.exp(-r * end)], rel=1e-9)
    assert found["stick_speed"] == pytest.approx(v[np.argmax(smooth)] if law == "smoothed" else 0.0, rel=1e-3)
    assert found["largest_coefficient"] == pytest.approx(smooth.max() if law == "smoothed" else curve[0], rel=1e-6)
    errors = np.abs(np.interp([0.0, 1.0, 2.0, 4.0], v, curve) - [0.14, 0.12, 0.11, 0.105]) / 0.14
    assert (found["fit_error"], found["fit_error_at"]) == (
        (pytest.approx(errors.max()), [0.0, 1.0, 2.0, 4.0][int(errors.argmax())]) if table else (None, None))
    assert (found["fit_error_between"] is None) == (not table)


@pytest.mark.parametrize(("torques", "ends"), [([100.0, 500.0, 50.0], (50.0, 500.0)),
                                               ([300.0, 50.0, 500.0], (50.0, 500.0))])
def test_torques_over_profiles_are_largest_at_their_corners(torques: list[float], ends: tuple[float, float]) -> None:
    """Also at the last one; the mean is that over whole engine cycles."""
    times = [0.0, 0.1003, 0.3]
    scene = load_scene("fig02").with_values({
        "engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0, "engine.mean_torque_times": times,
        "engine.mean_torque_values": torques})
    engine = estimates_of(scene.system).engine
    assert (engine.low, engine.high) == pytest.approx(ends, rel=1e-12)
    cycle = 2.0 * math.pi / 150.0
    t = np.linspace(0.0, math.ceil(0.3 / cycle) * cycle, 100_001)[:-1]
    assert engine.mean == pytest.approx(np.interp(t, times, torques).mean(), rel=1e-3)


def test_a_pressure_that_repeats_after_two_cycles_has_its_extremes_in_both() -> None:
    scene = load_scene("fig02")
    half = scene.with_values({"pressure.frequency_ratio": 0.5, "pressure.amplitude": 0.2 * scene.system.pressure.mean})
    kinetic = estimates_of(half.system).kinetic
    assert (kinetic.low / kinetic.mean, kinetic.high / kinetic.mean) == pytest.approx((0.8, 1.2), rel=1e-5)


KEYS = [key for key, value in DEFAULTS.items() if isinstance(value, float)]
PAIRS = 30


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
