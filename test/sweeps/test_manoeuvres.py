"""Sweeps and scatter of manoeuvres against closed forms and single runs, quantiles, and scaled tables."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from documents import valid

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.scatter import scatter
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.sweep import sweep

KINETIC = "friction.kinetic_coefficient"
SLIPS = load_scene("slip").with_values({
    "engine.frequency_times": [0.0, 1.0, 6.0], "engine.frequency_values": [100.0, 100.0, 250.0],
    "initial.slip_speed": 400.0, "initial.plate_angle": load_scene("slip").system.saturation_mean / 3000.0})
"""A run-up that slips throughout under constant friction, with the plate at rest: v' = (Te - Tsm)/I1."""


def test_orders_and_judder_of_a_run_up_in_pure_slip_are_those_of_the_flywheel_alone() -> None:
    system, speeds = SLIPS.system, (130.0, 180.0, 240.0)
    point, = sweep(system, "driveline.stiffness", [system.driveline.stiffness], orders=(*speeds, 300.0)).points
    result, amplitude = point.orders, system.engine.torque_amplitude / system.driveline.flywheel_inertia
    assert result.order.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert result.slip_speed[:3, 0] == pytest.approx([amplitude / x for x in speeds], rel=0.01)
    assert np.isnan(result.slip_speed[3]).all()   # The run does not reach 300 rad/s.
    assert point.judder.peak == pytest.approx(amplitude / 100.0, rel=0.02)
    steady = sweep(system, "engine.frequency_values[3]", [100.0], orders=()).points[0]
    assert steady.orders.speeds == pytest.approx([100.0])
    assert steady.orders.slip_speed[0, 0] == pytest.approx(amplitude / 100.0, rel=1e-3)
    assert steady.judder.rms == pytest.approx(amplitude / 100.0 / math.sqrt(2.0), rel=0.01)


def test_speeds_of_orders_take_the_units_of_other_options(tmp_path) -> None:
    """In rpm the crankshaft turns once in `engine.order` periods of the excitation."""
    words = ["sweep", "slip", "--set", "engine.order=2", "--over", "engine.frequency=200,210", "--cycles", "40",
             "--orders", "200,6000RPM,100hz,200 rad/s", "--json", str(tmp_path / "a.json")]
    assert main(words) == 0
    found = json.loads((tmp_path / "a.json").read_text())["orders"][0]
    assert found["speeds"] == pytest.approx([200.0, 400.0 * math.pi, 200.0 * math.pi, 200.0])


def test_quantiles_of_a_tip_in_are_those_of_single_runs(tmp_path, capsys) -> None:
    probabilities, path = (0.1, 0.5, 0.9), tmp_path / "tip_in.json"
    words = ["sweep", "tip_in", "--scatter", f"{KINETIC}=0.22:0.26", "--samples", "4", "--quantiles", "0.1,0.5,0.9",
             "--orders", "--json", str(path), "--out", str(tmp_path / "points.jsonl")]
    assert main(words) == 0
    document = valid("sweep", json.loads(path.read_text()))
    assert document["probabilities"] == list(probabilities)
    assert document["left_out"] == {"runaway": 0, "not_settled": 0}
    runs = [simulate(load_scene("tip_in").with_values({KINETIC: x}), rtol=1e-6).summary
            for x in document["sampled"][KINETIC]]
    for name in ("max_slip_speed", "max_shaft_torque", "clutch_energy", "breakaways", "stick_fraction"):
        assert document["quantiles"][name] == pytest.approx(np.quantile([getattr(x, name) for x in runs],
                                                                        probabilities), rel=1e-9)
    for name in ("judder_rms", "judder_peak"):
        assert document["quantiles"][name] == pytest.approx(np.quantile(document[name], probabilities))
    torque = np.array([each["shaft_torque"] for each in document["orders"]])
    assert np.array(document["order_quantiles"]["shaft_torque"]) == pytest.approx(
        np.moveaxis(np.quantile(torque, probabilities, axis=0), 0, -1))
    before = (tmp_path / "points.jsonl").read_text()
    assert main([*words, "--force", "--plot", str(tmp_path / "tip_in.png")]) == 0   # Nothing is solved again.
    assert (tmp_path / "points.jsonl").read_text() == before
    assert (tmp_path / "tip_in.png").stat().st_size > 10000
    again = json.loads(path.read_text())
    assert (again["judder_rms"], again["orders"]) == (document["judder_rms"], document["orders"])
    capsys.readouterr()
    assert main(["sweep", "tip_in", "--scatter", f"{KINETIC}=0.22:0.26", "--samples", "2", "--orders"]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("judder_rms", "5 %", "50 %", "95 %", "shaft_torque", "150 rad/s"))
    assert "nan" not in out


def test_judder_is_that_of_the_samples_about_their_cycle_means() -> None:
    tip_in = load_scene("tip_in")
    point, = sweep(tip_in, KINETIC, [0.24]).points
    run = simulate(tip_in, rtol=1e-6, samples_per_cycle=64).trajectory
    cycle = tip_in.system.cycle
    whole = int(run.t[-1] / cycle)
    at = np.arange(whole * 512) * cycle / 512
    v = np.interp(at, run.t, run.slip_speed).reshape(whole, 512)
    apart = v - v.mean(axis=1, keepdims=True)
    assert point.judder.rms == pytest.approx(math.sqrt(np.mean(apart**2)), rel=0.02)
    assert point.judder.peak == pytest.approx(np.abs(apart).max(), rel=0.02)


def test_a_whole_table_is_scaled(tmp_path) -> None:
    scene = load_scene("fresh_fluid")
    coefficients = np.array(scene.value("friction.coefficients"))
    swept = sweep(scene, "friction.coefficients", [0.95, 1.1], cycles=60)
    for factor, point in zip((0.95, 1.1), swept.points):
        alone = simulate(scene.with_values({"friction.coefficients": (factor * coefficients).tolist()}), cycles=60,
                         rtol=1e-6)
        assert point.summary.max_slip_speed == pytest.approx(alone.summary.max_slip_speed, rel=1e-6)
    spread = scatter(scene, {"friction.coefficients": (0.9, 1.1), "pressure.mean": (3.0e5, 3.2e5)}, 2, cycles=20)
    assert len(set(spread.result("max_slip_speed").ravel())) == 2
    for name, bounds, words in (("fig02", (0.9, 1.1), "friction.coefficients"),
                                ("fresh_fluid", (-1.0, 1.1), "friction.coefficients is -.* above 0"),
                                ("fresh_fluid", (0.9, 90.0), "friction.coefficients is .* 1e-06 to 2")):
        with pytest.raises(InputError, match=words):
            scatter(name, {"friction.coefficients": bounds}, 8, cycles=20)


@pytest.mark.parametrize(("words", "shown"), [
    (["--scatter", f"{KINETIC}=0.2:0.3", "--samples", "2", "--quantiles", "0.1;0.5"], ("--quantiles", "0.1;0.5")),
    (["--over", f"{KINETIC}=0.2:0.3:2", "--quantiles", "0.1"], ("--quantiles", "--scatter")),
    (["--over", f"{KINETIC}=0.2:0.3:2", "--orders=-3"], ("orders", "-3 rad/s", "above 0")),
    (["--over", f"{KINETIC}=0.2:0.3:2", "--orders", "20Nm"], ("--orders", "20Nm", "rad/s", "hz", "rpm")),
    (["--over", "engine.order=1:2:2", "--orders", "900rpm"], ("--orders", "900rpm", "engine.order")),
    (["--over", f"{KINETIC}=0.2:0.3:2", "--orders", "--duration", "0.2"], ("16",))])
def test_wrong_options_are_refused(refused, words, shown) -> None:
    line = refused("sweep", "tip_in", *words)
    assert all(word in line for word in shown)
