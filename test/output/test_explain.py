"""`explain` shows the terms that a scene builds and omits; the paper's closed forms against numbers by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import valid

from tcc_sim import explain, simulate
from tcc_sim.cli import main
from tcc_sim.output.estimates import estimates_of
from tcc_sim.scene import load_scene


def test_a_scene_leaves_out_what_it_does_not_have() -> None:
    """The set-valued law has no smoothing and no real-time step."""
    result, exact = explain(load_scene("minimal")), explain(load_scene("minimal").with_values({
        "friction.law": "set_valued"}))
    assert {"engine torque sine", "smoothing tanh"} <= set(result["terms"]["held"])
    assert {"pressure sine", "Stribeck exponential", "pressure clamp"} <= set(result["terms"]["left_out"])
    assert {"rclpy", "mcap", "matplotlib", "rerun"} <= set(result["modules"]["left_out"])
    assert {"engine_torque", "actuation_pressure", "/clock"} <= set(result["topics"]["left_out"])
    assert not set(result["terms"]["held"]) & set(result["terms"]["left_out"])
    assert result["step"]["own_calls"]["sines"] >= 3.0  # One in each of three stages.
    assert "smoothing tanh" in exact["terms"]["left_out"]
    assert (exact["solver"], exact["step"]) == ("event_driven", None)


def test_the_command_writes_and_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (file := tmp_path / "explained.json").touch()
    assert main(["explain", "fig02", "--cost", "--json", "-"]) == 0
    document = valid("explain", json.loads(capsys.readouterr().out))
    assert document["name"] == "fig02"
    assert 0.0 < document["step"]["own_s"] <= document["step"]["general_s"] / document["step"]["ratio"] * (1.0 + 1e-9)
    assert (main(["explain", "fig02", "--json", str(file)]), main(["explain", "fig20"])) == (2, 2)


def closed_forms(name: str, **keys: object) -> dict[str, Any]:
    """Closed forms of a scene with other values, of which `a__b` is the key a.b."""
    scene = load_scene(name).with_values({key.replace("__", "."): value for key, value in keys.items()})
    return explain(scene)["closed_forms"]


def test_closed_forms_by_hand() -> None:
    """Pure slip of 250 N m on 0.2 kg m^2, also where it ends; pure stick; and reasons where there is neither."""
    swing, transient = 250.0 / (0.2 * 150.0), 300.0 / (0.02 * math.sqrt(150e3 - 225.0))
    slip = closed_forms("slip")["slip"]
    assert (slip["mean"], slip["amplitude"], slip["margin"]) == pytest.approx((150.0 + swing, swing, 150.0))
    assert 150.0 - transient < slip["least"] < 150.0
    assert 0.0 < slip["tick_difference"] < 1.0
    slow, exact = closed_forms("slip", initial__slip_speed=30.0), closed_forms("slip", friction__law="set_valued")
    assert slow["slip"]["margin"] > 0.0 > slow["slip"]["least"]
    assert closed_forms("slip", pressure__mean=130e3)["slip"]["least"] is None
    for each, lasts, ticks in ((slip, True, True), (slow["slip"], False, False), (exact["slip"], True, False)):
        assert (each["growth"], each["pure_slip"], each["tick_difference"] is not None) == (0.0, lasts, ticks)
    stuck, falling = closed_forms("stick")["stick"], closed_forms("fig02")
    assert (stuck["sticks"], falling["stick"]["sticks"], falling["slip"]) == (True, False, None)
    assert stuck["mean"] == pytest.approx(0.1)
    assert "friction.static_coefficient" in falling["slip_why"]
    assert closed_forms("commands") is None
    for name, key in (("runup", "engine.frequency_times"), ("tip_in", "engine.mean_torque_times"),
                      ("apply", "pressure.mean_times")):
        forms = closed_forms(name)
        assert (forms["slip"], forms["stick"]) == (None, None)
        assert key in forms["stick_why"]


def test_estimates_by_hand() -> None:
    """Natural frequencies, torques over a cycle and the steepest slope of Fig. 2 from its numbers."""
    estimates = estimates_of(load_scene("fig02").system)
    frequencies = estimates.slipping.frequency, estimates.stuck.frequency
    assert frequencies == pytest.approx((math.sqrt(150e3), math.sqrt(3000 / 0.22)))
    assert (estimates.slipping.damping_ratio, estimates.stuck.damping_ratio) == pytest.approx(
        (0.3 / math.sqrt(60.0), 0.3 / math.sqrt(660.0)))
    assert (estimates.engine.low, estimates.engine.mean, estimates.engine.high) == pytest.approx((50.0, 300.0, 550.0),
                                                                                                 rel=1e-5)
    assert (estimates.kinetic.low, estimates.kinetic.mean, estimates.kinetic.high) == pytest.approx((400.0, 500.0,
                                                                                                     600.0), rel=1e-5)
    assert (estimates.static.low, estimates.static.high) == pytest.approx((500.0, 750.0), rel=1e-5)
    assert estimates.steepest_slope == pytest.approx(-2.0 * 0.25 * 500.0)
    assert estimates.critical_frequency == estimates.stuck.frequency
    assert estimates.engine_frequency == (150.0, 150.0)


@pytest.mark.parametrize("changes", [{}, {"driveline.damping": 10.0}, {"driveline.plate_inertia": 0.3}])
def test_the_oscillation_is_damped_above_the_critical_slope_only(changes: dict[str, object]) -> None:
    """Roots of (22) as a polynomial: the pair crosses the imaginary axis at the critical slope."""
    scene = load_scene("fig02").with_values(changes)
    d, slope = scene.system.driveline, estimates_of(scene.system).critical_slope
    i1, i2, c, k = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
    for factor, damped in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        s = factor * slope
        roots = np.roots([i1 * i2, i1 * (c + s) + i2 * s, i1 * k + s * c, s * k])
        assert (roots[roots.imag > 0.0].real < 0.0) == damped
    for damping in (20.0, 40.0):
        strongly = load_scene("fig02").with_values({"driveline.damping": damping})
        assert estimates_of(strongly.system).critical_slope is None


@pytest.mark.parametrize(("name", "changes", "expected"), [
    ("stick", {}, "stick"), ("slip", {}, "slip"), ("fig02", {}, "stick-slip"), ("runup", {}, "stick-slip"),
    ("chaos", {"friction.kinetic_coefficient": 0.15}, "runaway")])
def test_a_scene_sticks_slips_or_runs_away(name: str, changes: dict[str, object], expected: str) -> None:
    assert estimates_of(load_scene(name).with_values(changes).system).expected == expected


@pytest.mark.parametrize(("coupling", "words"), [(0.0, ["runaway", "stick"]), (2.0, ["slip", "stick"])])
def test_what_the_initial_state_decides_is_said(coupling: float, words: list[str]) -> None:
    """200 N m between mu_k N R = 120 N m and mu_s N R = 240 N m: a clutch that starts at 150 rad/s slips on."""
    scene = load_scene("fig02").with_values({
        "engine.mean_torque": 200.0, "engine.torque_amplitude": 0.0, "pressure.mean": 1e5, "pressure.amplitude": 0.0,
        "friction.kinetic_coefficient": 0.15, "converter.coupling": coupling})
    rest = scene.with_values({"initial.slip_speed": 0.0, "initial.plate_angle": 200.0 / 3000.0})
    motions = [simulate(each, cycles=200).summary for each in (scene, rest)]
    assert sorted("runaway" if each.runaway else each.regime for each in motions) == words
    assert sorted(estimates_of(scene.system).expected.split(" or ")) == words


def test_the_friction_law_is_drawn(tmp_path: Path, pictures: list[Any]) -> None:
    """The law, the end of stick, and the slope -alpha (mu_s - mu_k) A R Pm exp(-alpha v)."""
    assert main(["explain", "fig02", "--plot", str(tmp_path / "a.svg")]) == 0
    law, near, slope = pictures[0].axes
    v, values = slope.lines[0].get_data()
    assert values == pytest.approx(-250.0 * np.exp(-2.0 * v))
    assert law.lines[0].get_ydata() == pytest.approx(0.24 + 0.06 * np.exp(-2.0 * v))
    v, smooth = near.lines[1].get_data()
    assert v[np.argmax(smooth)] == pytest.approx(near.lines[2].get_xdata()[0], rel=0.01)


def test_an_actuator_costs_phase_at_the_slipping_mode() -> None:
    keys = {"pressure.time_constant": 0.03, "pressure.delay": 0.005, "pressure.rate_limit": 2e6}
    scene = load_scene("controlled").with_values(keys)
    omega = math.sqrt(3000.0 / 0.02)
    passed = np.exp(-0.005j * omega) / (1.0 + 0.03j * omega)
    estimates = estimates_of(scene.system).actuator
    assert np.exp(1j * estimates.phase) * estimates.gain == pytest.approx(passed, rel=1e-12)
    assert (estimates.phase < -math.pi, estimates.largest_amplitude) == (True, pytest.approx(2e6 / omega))
    assert "actuator" not in explain(load_scene("controlled"))["estimates"]


def test_a_table_is_judged_within_its_own_range() -> None:
    """Its fit tends to 0.1264 in fast slip; the clutch carries the mean torque at the last slip speed, 0.13."""
    scene = load_scene("minimal").with_values({
        "friction.slip_speeds": [0.0, 5.0, 10.0, 20.0, 30.0, 60.0],
        "friction.coefficients": [0.12, 0.137, 0.14, 0.138, 0.135, 0.13], "engine.mean_torque": 0.128 * 3e5 * 0.008,
        "engine.torque_amplitude": 200.0, "pressure.mean": 3e5, "pressure.amplitude": 0.0})
    estimates = estimates_of(scene.system)
    assert scene.system.friction.curve.constant < 0.1275
    assert estimates.kinetic.mean == pytest.approx(0.13 * 3e5 * 0.008, rel=5e-3)
    assert estimates.expected == "slip"
    beyond = estimates_of(scene.with_values({"engine.mean_torque": 0.15 * 3e5 * 0.008}).system)
    assert beyond.expected == "runaway"
    friction = explain(scene)["friction"]
    assert friction["slip_speeds"] == [0.0, 60.0]
    assert friction["coefficients"] == pytest.approx([0.12, 0.13], rel=5e-3)
    assert friction["slopes"][0] < 0.0 < friction["slopes"][1]


def test_a_rising_table_within_noise_does_not_judder_and_settles_beyond_its_last_point() -> None:
    v = np.array([0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0])
    mu = 0.1 + 0.03 * (1.0 - np.exp(-v / 60.0)) + 5e-4 * np.random.default_rng(2).normal(size=len(v))
    scene = load_scene("minimal").with_values({
        "friction.slip_speeds": v.tolist(), "friction.coefficients": mu.tolist(), "pressure.mean": 3e5,
        "engine.mean_torque": 0.1287 * 3e5 * 0.008, "engine.torque_amplitude": 10.0})
    estimates = estimates_of(scene.system)
    assert estimates.steepest_slope == 0.0
    assert estimates.expected == "slip"
    assert "slip grows beyond its 160 rad/s" in estimates.why


def test_means_of_a_run_up_are_integrals_over_phase() -> None:
    """The sine of the torque has no mean over whole cycles, however long the first ones last."""
    scene = load_scene("runup").with_values({"engine.frequency_times": [0.0, 0.4], "engine.frequency_values": [
        10.0, 100.0]})
    estimates = estimates_of(scene.system)
    assert estimates.engine.mean == pytest.approx(300.0, abs=1e-9)
    assert (estimates.engine.low, estimates.engine.high) == pytest.approx((50.0, 550.0), rel=1e-5)
    assert (estimates.engine_frequency, estimates.profiles) == ((10.0, 100.0), True)
