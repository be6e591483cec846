"""The figures of a run cover every solved second that was not dropped, against SciPy's Radau method."""

from __future__ import annotations

import dataclasses
import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.analysis.steady.summary import summarise
from tcc_sim.cli import main
from tcc_sim.replay.given_inputs import driven_by
from tcc_sim.scene import Scene, load_scene
from tcc_sim.sweeps.simulation import simulate

FIGURES = "max_slip_speed", "min_slip_speed", "clutch_energy", "peak_power", "max_shaft_torque", "min_shaft_torque"


def by_scipy(scene: Scene, torque: Any, pressure: Any, breaks: list[float]) -> dict[str, float]:
    """The figures of a run whose torque and pressure are given per piece k: torque(k, t), pressure(k, t)."""
    system, points = scene.system, 40_000
    d, f, start, area = system.driveline, system.friction, system.initial, system.clutch.area * system.clutch.radius

    def friction_torque(k: int, t: Any, v: Any) -> Any:
        law = f.kinetic_coefficient + (f.static_coefficient - f.kinetic_coefficient) * np.exp(-f.decay * np.abs(v))
        return law * area * pressure(k, t) * np.tanh(f.smoothing * v)

    def rates(t: float, y: Any, k: int) -> list[float]:
        tf = friction_torque(k, t, y[0])
        plate = (tf - d.damping * y[2] - d.stiffness * y[1]) / d.plate_inertia
        return [(torque(k, t) - tf) / d.flywheel_inertia - plate, y[2], plate, tf * y[0]]

    y, seen = np.array([start.slip_speed, start.plate_angle, start.plate_speed, 0.0]), []
    for k, (begin, end) in enumerate(pairwise(breaks)):
        solution = solve_ivp(rates, (begin, end), y, "LSODA", dense_output=True, args=(k,), rtol=1e-9,
                             atol=[1e-9, 1e-11, 1e-8, 1e-5])
        t = np.linspace(begin, end, points)
        rows = solution.sol(t)
        power, shaft = friction_torque(k, t, rows[0]) * rows[0], d.damping * rows[2] + d.stiffness * rows[1]
        seen.append([np.abs(rows[0]).max(), rows[0].min(), power.max(), shaft.max(), shaft.min()])
        y = solution.y[:, -1]
    v, low, power, high, least = np.array(seen).T
    return dict(zip(FIGURES, (v.max(), low.min(), float(y[3]), power.max(), high.max(), least.min())))


def agree(result: Any, expected: dict[str, float], within: float) -> None:
    for name, value in expected.items():
        assert getattr(result, name) == pytest.approx(value, rel=within, abs=within * 10.0), name


@pytest.fixture(scope="module")
def slow() -> tuple[Scene, dict[str, float]]:
    """Half a second of a first cycle that lasts 6.3 s."""
    scene = load_scene("fig02").with_values({"engine.frequency": 1.0})
    e, p = scene.system.engine, scene.system.pressure
    return scene, by_scipy(scene, lambda _, t: e.mean_torque + e.torque_amplitude * np.sin(t),
                           lambda _, t: p.mean + p.amplitude * np.sin(p.frequency_ratio * t + p.phase), [0.0, 0.5])


@pytest.mark.parametrize("solver", ["auto", "rk45", "fixed_step"])
def test_a_run_shorter_than_a_cycle(slow: Any, solver: str) -> None:
    summary = simulate(slow[0], duration=0.5, solver=solver).summary
    agree(summary, slow[1], 1e-6)
    assert (summary.cycles, summary.covers, summary.section) == (0, (0.0, 0.5), [])
    assert summary.mean_power == summary.clutch_energy / 0.5


def test_samples_of_a_run_shorter_than_a_cycle(slow: Any) -> None:
    run = simulate(slow[0], duration=0.5, samples_per_cycle=20_000).trajectory
    agree(summarise(dataclasses.replace(run, cycles=None, rest=None)), slow[1], 1e-4)


def test_the_last_part_of_a_cycle_counts(capsys: Any, tmp_path: Path) -> None:
    """Nearly all of the heat comes after the last whole cycle; the pressure is constant, the engine slows down."""
    times = [0.0, 1.0, 1.2, 2.0, 2.01, 4.0]
    profiles = {"engine.frequency_times": (0.0, 1.0, 1.2), "engine.frequency_values": (150.0, 150.0, 1.0),
                "engine.mean_torque_times": (0.0, 2.0, 2.01, 4.0),
                "engine.mean_torque_values": (100.0, 100.0, 900.0, 900.0), "pressure.amplitude": 0.0}
    scene = load_scene("fig02").with_values(profiles)
    e = scene.system.engine

    def phase(t: float) -> float:
        past = min(max(t - 1.0, 0.0), 0.2)
        return 150.0 * min(t, 1.0) + 150.0 * past - 149.0 / 0.4 * past**2 + max(t - 1.2, 0.0)

    def torque(_: int, t: float) -> float:
        return float(np.interp(t, e.mean_torque_times, e.mean_torque_values)) + e.torque_amplitude * math.sin(phase(t))

    expected = by_scipy(scene, torque, lambda *_: scene.system.pressure.mean, times)
    summary = simulate(scene, duration=4.0).summary
    agree(summary, expected, 1e-5)
    assert (summary.covers, summary.breakaways) == ((0.0, 4.0), 3)
    later = simulate(scene, duration=4.0, discard=5).summary
    assert later.covers == (pytest.approx(10.0 * math.pi / 150.0), 4.0)
    assert later.max_slip_speed == summary.max_slip_speed
    words = ["simulate", "fig02", "--profile", "engine.frequency=0:150,1:150,1.2:1", "--profile",
             "engine.mean_torque=0:100,2:100,2.01:900,4:900", "--set", "pressure.amplitude=0"]
    assert main([*words, "--discard", "5", "--json", str(tmp_path / "a.json")]) == 0
    assert json.loads((tmp_path / "a.json").read_text())["covers"] == list(later.covers)
    assert "figures cover" in capsys.readouterr().out
    assert main(words) == 0
    assert "figures cover" not in capsys.readouterr().out


def test_no_parabola_crosses_a_jump(tmp_path: Path) -> None:
    """Torque and pressure step at times that are no ticks; power is largest just behind a step of the pressure."""
    t = [0.0, 0.0103, 0.0207, 0.0302, 0.0310]
    torque, pressure = [400.0, 300.0, 150.0, 380.0, 300.0], [4e4, 2.4e5, 5e4, 2.2e5, 1e5]
    table = tmp_path / "steps.csv"
    table.write_text("t,engine_torque,actuation_pressure\n" + "".join(f"{a},{b},{c}\n" for a, b, c in zip(
        t, torque, pressure)))
    scene = driven_by(load_scene("fig02").with_values({"engine.frequency": 600.0}), table)
    expected = by_scipy(scene, lambda k, _: torque[k], lambda k, _: pressure[k], t)
    for solver, within in (("auto", 1e-7), ("fixed_step", 1e-5)):
        agree(simulate(scene, duration=t[-1], solver=solver).summary, expected, within)


def test_a_recording_with_steps_has_no_power_beyond_its_samples() -> None:
    """Every sample is the largest power, and a parabola across the steps between them lies above."""
    run = simulate("slip", cycles=2, samples_per_cycle=100).trajectory
    step = np.where(np.arange(len(run.t)) % 20 < 10, 1.0, 0.2)
    stepped = dataclasses.replace(run, cycles=None, rest=None, friction_torque=run.friction_torque * step,
                                  slip_speed=np.full(len(run.t), 100.0))
    power = stepped.friction_torque * stepped.slip_speed
    assert summarise(stepped, 0).peak_power == pytest.approx(power.max(), rel=1e-4)


def test_chaos_is_no_transient() -> None:
    summary = simulate("chaos", cycles=400).summary
    assert (summary.period, summary.settled, summary.transient) == (0, False, False)
