"""The verbs continue and basins: their files and lines, and wrong input in one line."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main

STICK = ["continue", "stick", "--set", "friction.law=set_valued", "--over", "engine.mean_torque=295:305"]
ORBIT_KEYS = {"value", "slip_speed", "plate_angle", "plate_speed", "max_slip_speed", "stick_fraction", "stable",
              "multipliers", "events"}


def test_the_json_has_every_key_and_lists_of_one_length(tmp_path: Path) -> None:
    file, picture = tmp_path / "branches.json", tmp_path / "branches.svg"
    assert main([*STICK, "--at", "301.5", "--json", str(file), "--plot", str(picture)]) == 0
    document = json.loads(file.read_text())
    assert {"format", "version", "scene", "command", "over", "law", "branches", "at", "bifurcations"} <= set(document)
    assert (document["over"], document["law"], document["bifurcations"]) == ("engine.mean_torque", "set_valued", [])
    assert document["scene"]["friction.law"] == "set_valued"
    (branch,) = document["branches"]
    assert {"period", "origin", "ended", "reasons", "closed", "residual", *ORBIT_KEYS} == set(branch)
    assert (branch["period"], branch["origin"], branch["closed"]) == (1, "start", False)
    assert len({len(branch[k]) for k in ORBIT_KEYS}) == 1
    assert sorted([branch["value"][0], branch["value"][-1]]) == [295.0, 305.0]
    assert branch["reasons"] == ["range", "range"]
    assert sorted(value for value in ("295", "305") if any(value in end for end in branch["ended"])) == ["295", "305"]
    assert all(len(m) == 3 and all(len(pair) == 2 for pair in m) for m in branch["multipliers"])
    (at,) = document["at"]
    assert set(at) >= {*ORBIT_KEYS, "period", "origin"}
    assert (at["value"], at["events"], at["stable"]) == (301.5, "S", True)
    assert picture.read_text().startswith("<?xml")


@pytest.mark.parametrize(("words", "named"), [
    (["--over", "engine.mean_torque=295"], ("--over", "engine.mean_torque=295")),
    (["--over", "engine.mean_torque=1:nan"], ("--over", "engine.mean_torque=1:nan")),
    (["--over", "engine.mean_torqe=1:2"], ("engine.mean_torqe", "engine.mean_torque")),
    (["--over", "engine.mean_torque=295:305", "--at", "310"], ("--at", "310", "295 to 305")),
    (["--over", "engine.mean_torque=295:305", "--plot", "a.gif"], ("a.gif", ".png"))])
def test_wrong_input_is_one_line_and_status_2(words: list[str], named: tuple[str, ...],
                                              refused: Callable[..., str]) -> None:
    """Plans that cannot be carried out are in test_driveline_map."""
    line = refused("continue", "stick", *words, "--json", "out.json")
    assert all(word in line for word in named), line


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
