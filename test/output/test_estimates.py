"""Figures of `explain` about friction and torques, on a grid and by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tcc_sim.output.estimates import estimates_of
from tcc_sim.output.explanation import friction_of
from tcc_sim.scene import load_scene

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
