"""Verbs print and write the figures that they computed."""

import json

import pytest

from tcc_sim.cli import main
from tcc_sim.scene import load_scene


def printed(capsys, *words):
    assert main(list(map(str, words))) == 0
    return capsys.readouterr().out


def test_the_length_of_a_tick_is_that_of_the_rate(capsys):
    tick = 1e3 / load_scene("slip").operation.rate
    assert f" in a tick of {tick:g} ms" in printed(capsys, "explain", "slip")


def test_a_table_is_fitted_to_the_scene_that_is_named(capsys, tmp_path):
    path = tmp_path / "run.csv"
    assert main(["simulate", "slip", "--set", "friction.kinetic_coefficient=0.31", "--cycles", "5", "--discard", "0",
                 "--samples", "40", "--out", str(path)]) == 0
    capsys.readouterr()
    status = main(["identify", str(path), "--scene", "slip", "--free", "friction.kinetic_coefficient", "--json", "-"])
    out = capsys.readouterr()
    assert status == 0, out.err
    assert json.loads(out.out)["parameters"][0]["value"] == pytest.approx(0.31, rel=1e-3)
