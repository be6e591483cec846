"""`tcc-sim continue`: its JSON, its picture, Ctrl-C, and wrong input in one line."""

import json
from collections.abc import Callable
from pathlib import Path

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
