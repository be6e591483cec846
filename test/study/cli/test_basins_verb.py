"""The verb `basins`: its files and lines, the rest after an interrupt, and its refusals."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main

PLANE = ["--plane", "initial.slip_speed=0:120:5", "--plane", "initial.plate_angle=-0.1:0.3:4"]
SCENE = ["fig02", "--set", "pressure.mean=225000", "--set", "pressure.amplitude=0", "--set", "engine.frequency=139.4",
         "--set", "friction.kinetic_coefficient=0.255"]


def test_the_verb_writes_labels_fractions_and_a_picture(tmp_path: Path, capsys):
    pytest.importorskip("matplotlib")
    files = [tmp_path / name for name in ("b.json", "b.npz", "b.png")]
    words = ["basins", *SCENE, *PLANE, "--boundary", "--json", str(files[0]), "--out", str(files[1]), "--plot",
             str(files[2])]
    assert main(words) == 0
    printed = capsys.readouterr().out
    document = json.loads(files[0].read_text())
    stored = np.load(files[1])
    assert stored["labels"].shape == stored["cycles"].shape == (4, 5)
    assert document["plane"] == [{"key": "initial.slip_speed", "values": [0.0, 30.0, 60.0, 90.0, 120.0]},
                                 {"key": "initial.plate_angle", "values": np.linspace(-0.1, 0.3, 4).tolist()}]
    for k, attractor in enumerate(document["attractors"]):
        assert attractor["fraction"] == np.mean(stored["labels"] == k)
        assert len(attractor["section"]) == attractor["period"]
        assert f"{100.0 * attractor['fraction']:.2f} %  period {attractor['period']}" in printed
    assert sorted(a["period"] for a in document["attractors"]) == [1, 2]
    assert document["undecided"] == document["runaway"] == 0.0
    assert f"{stored['cycles'].mean():.1f} periods of excitation per cell" in printed
    assert "boundary" not in document
    assert json.loads(str(stored["document"])) == document
    assert files[2].stat().st_size > 10_000
    assert not list(tmp_path.glob("*.part"))
    assert main(words) == 2


@pytest.mark.parametrize(("words", "named"), [
    (PLANE[:2], "2"), ([*PLANE, "--jobs", "0"], "jobs"), ([*PLANE, "--over", "engine.frequency=80,90"], "80,90"),
    ([*PLANE[:2], "--plane", "initial.plate_angle=0:x:3"], "0:x:3"),
    ([*PLANE[:2], "--plane", "initial.plate_angle=0:1:3:log"], "0:1:3:log"),
    ([*PLANE, "--set", "initial.slip_speed=3"], "initial.slip_speed"),
    ([*PLANE, "--over", "friction.law=1:2:3"], "friction.law"),
    ([*PLANE, "--set", "engine.frequency=3", "--over", "engine.frequency=1:2:3"], "engine.frequency"),
    ([*PLANE, "--out", "x.txt"], "x.txt")])
def test_wrong_input_is_one_line(words: list[str], named: str, refused: Callable[..., str]):
    """Planes that cannot be computed are in test_compute."""
    assert named in refused("basins", "fig02", *words)
