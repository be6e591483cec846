"""A scene identified from a recording, and driven by the inputs of that recording."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from driveline_bags import bag, ticked

from tcc_sim import cli
from tcc_sim.replay.given_inputs import twin_of
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve

FOUND = {"friction.kinetic_coefficient": 0.25, "driveline.stiffness": 3150.0}


def test_a_recording_becomes_a_scene_that_follows_it(tmp_path: Path, capsys) -> None:
    """A driveline that differs from its scene, under commands of torque and pressure."""
    pytest.importorskip("matplotlib")
    scene = load_scene("commands")
    rows = ticked(scene.with_values(FOUND), 401, torque=lambda k: 250.0 + 200.0 * math.sin(0.14 * k),
                  pressure=lambda k: 2.2e5 + 3e4 * math.sin(0.01 * k))
    run, mine, drawn = str(bag(tmp_path / "run", rows, scene)), tmp_path / "mine.yaml", tmp_path / "twin.png"
    words = [word for key in FOUND for word in ("--free", key)]
    assert cli.main(["identify", run, *words, "--out", str(mine)]) == 0
    system = load_scene(str(mine)).system
    assert system.driveline.stiffness == pytest.approx(3150.0, rel=1e-4)
    assert system.friction.kinetic_coefficient == pytest.approx(0.25, rel=1e-4)
    assert cli.main(["simulate", str(mine), "--inputs", run, "--plot", str(drawn)]) == 0
    assert "slip speed beside run: " in capsys.readouterr().out
    assert drawn.stat().st_size > 10_000


def test_the_difference_is_that_of_the_two_speeds(tmp_path: Path) -> None:
    run = solve(load_scene("minimal"), cycles=4, samples_per_cycle=400)
    table = tmp_path / "seen.csv"
    np.savetxt(table, np.column_stack([run.t, run.slip_speed - 0.5, 0.0 * run.t]), delimiter=",", comments="",
               header="t,slip_speed,engine_torque")
    found = twin_of(table, run)
    assert found is not None
    assert found.difference == pytest.approx(0.5, abs=1e-6)
    assert found.t.tolist() == run.t.tolist()
    assert "0.5 rad/s apart" in str(found)
    table.write_text("t,engine_torque\n0,1\n1,2\n")
    assert twin_of(table, run) is None
