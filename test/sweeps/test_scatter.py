"""Scattered keys: samples that fill their bounds, quantiles that are numpy's, and a command that says the same."""

from __future__ import annotations

import json

import numpy as np
import pytest
from documents import valid
from scipy.stats import qmc

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.scatter import Tolerances, scatter
from tcc_sim.sweeps.simulation import Plan, simulate

BASE = replace(load_scene("slip").system, {"friction.law": "set_valued"})
AMPLITUDE, PRESSURE = "engine.torque_amplitude", "pressure.mean"
WORDS = ["sweep", "slip", "--set", "friction.law=set_valued", "--cycles", "20", "--scatter", f"{AMPLITUDE}=10:40",
         "--samples", "8"]


def test_samples_fill_their_bounds_and_are_those_of_their_seed() -> None:
    told = Tolerances(((AMPLITUDE, 10.0, 40.0), (PRESSURE, 2e5, 3e5)), 64, 3)
    values = told.sampled
    unit = np.stack([(values[AMPLITUDE] - 10.0) / 30.0, (values[PRESSURE] - 2e5) / 1e5], axis=1)
    assert unit.min() >= 0.0
    assert unit.max() < 1.0
    assert qmc.discrepancy(unit) < 0.2 * qmc.discrepancy(np.random.default_rng(1).random((64, 2)))
    for column in unit.T:
        assert np.bincount((64 * column).astype(int), minlength=64).tolist() == [1] * 64
    assert np.array_equal(told.sampled[AMPLITUDE], values[AMPLITUDE])
    assert not np.array_equal(Tolerances(told.bounds, 64, 4).sampled[AMPLITUDE], values[AMPLITUDE])


@pytest.mark.parametrize("bounds", [(2.0, 1.0), (1.0, 1.0)])
def test_bounds_go_up(bounds: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=rf"scatter of {AMPLITUDE} is {bounds[0]:g} to 1; the first must be below"):
        scatter(BASE, {AMPLITUDE: bounds}, 4)


def test_each_sample_is_a_simulation_and_quantiles_are_numpys() -> None:
    found = scatter(BASE, {AMPLITUDE: (10.0, 40.0)}, 8, plan=Plan(cycles=20))
    values = found.tolerances.sampled[AMPLITUDE]
    alone = [simulate(replace(BASE, {AMPLITUDE: x}), cycles=20).summary.max_slip_speed for x in values]
    assert found.result("max_slip_speed")[:, 0].tolist() == alone
    assert found.quantiles("max_slip_speed")[0].tolist() == np.quantile(alone, [0.05, 0.5, 0.95]).tolist()
    assert found.columns()[AMPLITUDE].tolist() == values.tolist()


def test_the_command_gives_quantiles_per_value(tmp_path, capsys) -> None:
    over = ["--over", "engine.frequency=100,120,150.5"]
    assert main([*WORDS, *over, "--seed", "5", "--json", str(tmp_path / "a.json"), "--out",
                 str(tmp_path / "a.jsonl")]) == 0
    found = json.loads((tmp_path / "a.json").read_text())
    valid("sweep", found)
    assert (found["scatter"], found["samples"], found["seed"]) == ({AMPLITUDE: [10.0, 40.0]}, 8, 5)
    assert found["values"] == [100.0, 120.0, 150.5]
    assert np.shape(found["max_slip_speed"]) == (8, 3)
    assert found["quantiles"]["max_slip_speed"] == np.quantile(
        found["max_slip_speed"], [0.05, 0.5, 0.95], axis=0).T.tolist()
    assert main([*WORDS, "--json", str(tmp_path / "b.json")]) == 0
    alone = json.loads((tmp_path / "b.json").read_text())
    valid("sweep", alone)
    assert len(alone["max_slip_speed"]) == len(alone["sampled"][AMPLITUDE]) == 8
    assert len(alone["quantiles"]["max_slip_speed"]) == 3
    capsys.readouterr()
    assert main(WORDS) == 0
    assert "max_slip_speed (rad/s)  5 %  50 %  95 %" in capsys.readouterr().out


@pytest.mark.parametrize("over", [[], ["--over", "engine.frequency=100:150:3"]])
def test_the_picture_shows_samples_or_bands(over: list[str], tmp_path, figures) -> None:
    assert main([*WORDS, *over, "--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.svg")]) == 0
    assert any(axis.lines or axis.collections for axis in figures[0].axes)
