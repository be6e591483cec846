"""Pictures and tables of runs under commands: pressures, target and cycle mean beside the slip speed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driveline_bags import bag, ticked

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.plant.driveline import Reading
from tcc_sim.scene import load_scene
from tcc_sim.views import whole_runs


def law(reading: Reading) -> float:
    """A pressure that follows the slip speed."""
    return min(max(9e4 + 800.0 * (reading.slip_speed - 20.0), 0.0), 4e5)


def test_the_control_of_a_run_has_its_means_and_its_pressures() -> None:
    run = tcc_sim.closed_loop("controlled", law, 0.5)
    control, cycle = run.control, 2.0 * np.pi / 150.0
    assert control.t == pytest.approx(cycle * np.arange(1, 12), abs=1e-9)
    # The mean over a cycle by another rule: of a fine interpolation.
    fine = np.linspace(3.0 * cycle, 4.0 * cycle, 20001)
    assert control.mean_slip[3] == pytest.approx(np.interp(fine, run.t, run.slip_speed)[:-1].mean(), rel=1e-4)
    assert control.command.values.tolist() == run.commands["actuation_pressure"][1:].tolist()
    assert control.applied.t.tolist() == run.t[:-1].tolist()
    assert not len(control.target.t)
    columns = run.columns()
    assert columns["applied_pressure"] is run.applied_pressure
    assert columns["actuation_pressure"] is run.commands["actuation_pressure"]


@pytest.mark.parametrize("profile", [False, True])
def test_the_picture_of_a_run_shows_pressures_and_cycle_means(tmp_path, monkeypatch, profile):
    pytest.importorskip("matplotlib")
    from tcc_sim.views import style

    titles: list[str] = []
    kept = style.panel_titles

    def panel_titles(axes: Any, names: Any) -> None:
        titles.extend(names)
        kept(axes, names)

    for module in ("overview", "whole_runs"):
        monkeypatch.setattr(f"tcc_sim.views.{module}.style.panel_titles", panel_titles)
    scene = load_scene("controlled")
    if profile:
        scene = scene.with_values({"engine.mean_torque_times": [0.0, 0.3], "engine.mean_torque_values": [200.0, 250.0]})
    run = tcc_sim.closed_loop(scene, law, 0.6)
    assert tcc_sim.plot(run, tmp_path / "run.png").is_file()
    assert "Actuation pressure" in titles
    assert any(title.startswith("Cycle mean") for title in titles)


def test_the_picture_of_a_recorded_manoeuvre_shows_pressure_target_and_cycle_means(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = []
    for name in ("mean_slip_panel", "pressure_panel"):
        kept = getattr(whole_runs, name)
        monkeypatch.setattr(whole_runs, name, lambda axis, control, kept=kept: (kept(axis, control),
                                                                               drawn.append((axis, control))))
    scene = load_scene("controlled").with_values({"engine.mean_torque_times": [0.0, 0.3],
                                                  "engine.mean_torque_values": [200.0, 250.0]})
    rows = ticked(scene, 501, pressure=lambda tick: 8e4 + 1e4 * (tick // 100))
    bag(tmp_path / "run", rows, scene, targets=[(0, 20.0), (250, 25.0)])
    assert main(["analyse", str(tmp_path / "run"), "--plot", str(tmp_path / "run.png")]) == 0
    (means, control), (pressures, _) = drawn
    assert [line.get_label() for line in means.lines[:2]] == ["cycle mean", "target"]
    assert control.target.values.tolist() == [20.0, 25.0]
    assert control.target.t.tolist() == [0.0, 0.25]
    assert pressures.lines[0].get_label() == "applied"
    assert set(pressures.lines[0].get_ydata()) >= {80.0, 90.0, 100.0, 110.0, 120.0}
    assert len(control.mean_slip) == int(0.5 // (2.0 * np.pi / 150.0))
