"""Maps of an own control law over its gains, as a function and as `sweep --law`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError, TccError

LAW = """
from collections import deque

class PI:
    def __init__(self, kp=1.4e3, ki=5.2e3):
        self.kp, self.ki, self.integral, self.cycle = kp, ki, 90e3, deque(maxlen=42)

    def __call__(self, reading):
        self.cycle.append(reading.slip_speed)
        error = sum(self.cycle) / len(self.cycle) - 20.0
        self.integral += 1e-3 * self.ki * error
        return self.integral + self.kp * error

def failing(kp):
    return lambda reading: 1.0 / (kp - 2.0)

def ending(kp):
    raise SystemExit("too much")

broken, built_in = 3, min
"""
GRID = {"kp": [900.0, 2500.0], "engine.mean_torque": [200.0, 600.0]}


@pytest.fixture
def law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> type:
    """The class in law.py of the working directory."""
    monkeypatch.chdir(tmp_path)
    Path("law.py").write_text(LAW)
    names: dict[str, Any] = {}
    exec(LAW, names)
    return names["PI"]  # type: ignore[no-any-return]


def test_each_point_is_the_judged_closed_loop_of_its_values_in_one_process_and_in_two(law: type) -> None:
    maps = [tcc_sim.gain_map("controlled", "law.py:PI", GRID, {0.0: 20.0, 0.4: 25.0}, 0.7, limits=(0.0, 6e5), jobs=jobs)
            for jobs in (1, 2)]
    columns = [each.columns() for each in maps]
    for name, column in columns[0].items():
        for other in columns[1:]:
            np.testing.assert_array_equal(column, other[name])
    for k, (torque, kp) in enumerate((torque, kp) for torque in GRID["engine.mean_torque"] for kp in GRID["kp"]):
        run = tcc_sim.closed_loop(tcc_sim.load_scene("controlled").with_values({"engine.mean_torque": torque}),
                                  law(kp), 0.7)
        tracking = run.tracking_of({0.0: 20.0, 0.4: 25.0}, limits=(0.0, 6e5))
        assert (columns[0]["kp"][k], columns[0]["engine.mean_torque"][k]) == (kp, torque)
        for name in ("settling_time", "overshoot", "peak_deviation", "iae", "verdict"):
            np.testing.assert_equal(columns[0][name][k], getattr(tracking, name))
    assert len(set(columns[0]["overshoot"])) > 2


def test_the_command_writes_rows_of_the_second_key_which_can_be_drawn(law: type, capsys: Any) -> None:
    words = ["sweep", "controlled", "--law", "law.py:PI", "--target", "20", "--duration", "0.4", "--jobs", "1"]
    grid = ["--over", "kp=900,2500", "--over", "engine.mean_torque=200:260:3"]
    assert main([*words, *grid, "--json", "map.json", "--out", "map.csv"]) == 0
    values = json.loads(Path("map.json").read_text())
    expected = tcc_sim.gain_map("controlled", law, {"kp": [900.0, 2500.0],
                                                    "engine.mean_torque": [200.0, 230.0, 260.0]}, 20.0, 0.4)
    assert (values["over"], values["second_over"], values["law"]) == ("kp", "engine.mean_torque", "law.py:PI")
    assert np.array(values["overshoot"]).shape == (3, 2)
    np.testing.assert_array_equal(np.ravel(values["overshoot"]), expected.columns()["overshoot"])
    assert len(Path("map.csv").read_text().splitlines()) == 8  # Names, units, and six loops.
    assert main(["plot", "map.json", "--plot", "map.png"]) == 0
    capsys.readouterr()
    assert main([*words, "--over", "kp=900:2500:3"]) == 0
    assert capsys.readouterr().out.count("kp ") >= 3


@pytest.mark.parametrize(("words", "parts"), [
    ("--law law.py:PI --over kq=1,2", "kq kp"), ("--law law.py --over kp=1,2", "FILE.py:NAME"),
    ("--law none.py:PI --over kp=1,2", "none.py"), ("--law law.py:P --over kp=1,2", "law.py P"),
    ("--law law.py:broken --over kp=1,2", "law.py broken"), ("--law law.py:PI", "0 one two"),
    ("--law law.py:PI --over pressure.men=1,2", "pressure.men"),
    ("--law law.py:PI --over kp=1,2 --cycles 9", "--cycles"), ("--over pressure.mean=1e5,2e5", "--law"),
    ("--law law.py:PI --over kp=1,2 --over kp=1,2", "kp twice"),
    ("--law law.py:PI --over kp=1,2 --duration -1", "-1")])
def test_what_makes_no_map_is_one_line_and_no_file(law: type, words: str, parts: str,
                                                   refused: Callable[..., str]) -> None:
    said = refused("sweep", "controlled", "--target", "20", "--jobs", "1", *words.split())
    assert [part for part in parts.split() if part not in said] == []


@pytest.mark.parametrize(("name", "parts"), [
    ("failing", "kp 2: ZeroDivisionError"), ("ending", "kp 1: SystemExit"), ("built_in", "kp 1: TypeError")])
def test_a_law_that_fails_is_one_line_with_its_values(law: type, name: str, parts: str, capsys: Any) -> None:
    words = f"--law law.py:{name} --over kp=1,2 --target 20 --duration 0.1 --json a.json --jobs 1"
    assert main(["sweep", "controlled", *words.split()]) == 1
    assert parts in capsys.readouterr().err.splitlines()[-1]
    assert not Path("a.json").exists()


def test_a_law_of_a_program_is_refused_with_the_reason() -> None:
    columns = tcc_sim.gain_map("controlled", lambda gain: lambda state: gain, {"gain": [1e5, 2e5]}, 20.0, 0.1).columns()
    assert (columns["gain"].tolist(), np.isnan(columns["tracking_gain"]).all()) == ([1e5, 2e5], True)
    with pytest.raises(InputError, match="jobs=1"):
        tcc_sim.gain_map("controlled", lambda kp: lambda reading: 1e5, {"kp": [1.0, 2.0]}, 20.0, jobs=2)
    with pytest.raises(TccError, match="kp 1"):
        tcc_sim.gain_map("controlled", lambda kp: lambda reading: "much", {"kp": [1.0]}, 20.0)
