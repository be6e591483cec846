"""The verb `basins`: its files and lines, the rest after an interrupt, and its refusals."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.model.parameters import System
from tcc_sim.study.basins import compute
from tcc_sim.study.basins.proximity import Attractor
from tcc_sim.study.basins.results import Axis, Basins, boundary_of
from tcc_sim.study.cli.basins import _lines

PLANE = ["--plane", "initial.slip_speed=0:120:5", "--plane", "initial.plate_angle=-0.1:0.3:4"]
SMALL = ["--plane", "initial.slip_speed=0:60:2", "--plane", "initial.plate_angle=0:0.1:2"]
SCENE = ["fig02", "--set", "pressure.mean=225000", "--set", "pressure.amplitude=0", "--set", "engine.frequency=139.4",
         "--set", "friction.kinetic_coefficient=0.255"]


def test_the_verb_writes_labels_fractions_and_a_picture(tmp_path: Path, capsys):
    pytest.importorskip("matplotlib")
    files = [tmp_path / name for name in ("b.json", "b.npz", "b.png")]
    words = ["basins", *SCENE, *PLANE, "--boundary", "--json", str(files[0]), "--out", str(files[1]), "--plot",
             str(files[2])]
    assert main(words) == 0
    head, *shares, bound, last = capsys.readouterr().out.splitlines()
    document = json.loads(files[0].read_text())
    stored = np.load(files[1])
    assert stored["labels"].shape == stored["cycles"].shape == (4, 5)
    assert document["plane"] == [{"key": "initial.slip_speed", "values": [0.0, 30.0, 60.0, 90.0, 120.0]},
                                 {"key": "initial.plate_angle", "values": np.linspace(-0.1, 0.3, 4).tolist()}]
    for k, attractor in enumerate(document["attractors"]):
        assert attractor["fraction"] == np.mean(stored["labels"] == k)
        assert len(attractor["section"]) == attractor["period"]
        assert shares[k].startswith(f"  {100.0 * attractor['fraction']:6.2f} %  period {attractor['period']}, ")
    assert sorted(a["period"] for a in document["attractors"]) == [1, 2]
    assert document["undecided"] == document["runaway"] == 0.0
    assert head == "Basins in initial.slip_speed (5) and initial.plate_angle (4)"
    assert shares[2:] == ["    0.00 %  runaway slip", "    0.00 %  undecided"]
    assert bound == "  boundary: no uncertainty exponent, too few neighbouring cells have different labels"
    mean = f"{stored['cycles'].mean():.1f} periods of excitation per cell"
    assert re.fullmatch(rf"  20 cells in [\d.e+-]+ s, {mean}", last)
    assert "boundary" not in document
    assert json.loads(str(stored["document"])) == document
    assert files[2].stat().st_size > 10_000
    assert not list(tmp_path.glob("*.part"))
    assert main(words) == 2


def test_the_lines_of_planes_along_a_key() -> None:
    """The boundary of a half plane is a line: every distance has its share of pairs, of exponent about 1."""
    axes = Axis("initial.slip_speed", range(8)), Axis("initial.plate_angle", range(8))
    orbit = Attractor(1, np.zeros((1, 3)), np.zeros(1, int), None, 25.0, 0.1)
    labels = np.tile([0, 0, 0, 0, -2, -2, -2, -2], (8, 1))
    one = Basins(axes, (orbit,), labels, np.arange(64).reshape(8, 8), 1.2345, System(), ("engine.frequency", 80.0))
    over = Axis("engine.frequency", (80.0, 90.0))
    bound = boundary_of(labels)
    assert bound is not None
    shares = ["Basins in initial.slip_speed (8) and initial.plate_angle (8)",
              "   50.00 %  attractor 0: period 1, largest slip speed 25 rad/s", "   50.00 %  runaway slip",
              "    0.00 %  undecided"]
    last = "  64 cells in 1.23 s, 31.5 periods of excitation per cell"
    told = (f"  boundary: uncertainty exponent {bound.exponent:.3f} (standard error {bound.error:.3f}), "
            f"dimension {2.0 - bound.exponent:.3f}")
    assert list(_lines([one, one], over, True)) == ["engine.frequency 80 rad/s", *shares, told, last,
                                                    "engine.frequency 90 rad/s", *shares, told, last]
    assert list(_lines([one], None, False)) == [*shares, last]


def test_basins_interrupted_while_they_are_drawn_go_on(tmp_path: Path, monkeypatch, capsys, figures):
    from tcc_sim.study.views import basin_map

    files = [tmp_path / name for name in ("b.npz", "b.json", "b.png")]
    words = ["basins", *SCENE, *SMALL, "--out", str(files[0]), "--json", str(files[1]), "--plot", str(files[2])]

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(basin_map, "draw_basins", interrupted)
        assert main(words) == 130
    assert capsys.readouterr().err.endswith(f"tcc-sim: interrupted; the same command resumes from {files[0]}.part\n")
    assert [path.name for path in tmp_path.iterdir()] == ["b.npz.part"]
    assert main(words) == 0
    assert sorted(tmp_path.iterdir()) == sorted(files)
    assert len(figures) == 1


def test_basins_interrupted_without_a_file_promise_no_resumption(monkeypatch, capsys) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(compute, "basins", interrupted)
    assert main(["basins", *SCENE, *SMALL]) == 130
    assert capsys.readouterr().err == "tcc-sim: interrupted\n"


FORM = "it must be KEY=START:STOP:COUNT"


@pytest.mark.parametrize(("words", "line"), [
    (PLANE[:2], "a plane has 2 axes; 1 are given"),
    ([*PLANE[:2], *PLANE[:2]], "initial.slip_speed is given twice; a plane is made of two keys"),
    ([*PLANE, "--cycles", "3"], "cycles is 3; it must be 16 to 1000000"),
    ([*PLANE, "--jobs", "0"], "jobs is 0; it must be 1 to 1024"),
    ([*PLANE, "--over", "initial.plate_angle=0:1:3"],
     "over is initial.plate_angle, an axis of the plane; it must be another key"),
    ([*PLANE, "--over", "engine.frequency=80,90"], f"--over is 'engine.frequency=80,90'; {FORM}"),
    ([*PLANE[:2], "--plane", "initial.plate_angle=0:x:3"], f"--plane is 'initial.plate_angle=0:x:3'; {FORM}"),
    ([*PLANE[:2], "--plane", "initial.plate_angle=0:1:3:log"], f"--plane is 'initial.plate_angle=0:1:3:log'; {FORM}"),
    (["--plane", "initial.slip_speed=0:1:3000", "--plane", "initial.plate_angle=0:1:3000"],
     "the plane has 9000000 cells; it must have 1 to 4000000"),
    ([*PLANE, "--set", "initial.slip_speed=3"], "initial.slip_speed"), ([*PLANE, "--over", "friction.law=1:2:3"], ""),
    ([*PLANE, "--set", "engine.frequency=3", "--over", "engine.frequency=1:2:3"], "engine.frequency"),
    ([*PLANE, "--out", "x.txt"], ""),
    ([*PLANE, "--set", "pressure.frequency_ratio=0.7312345", "--set", "pressure.amplitude=10000"], "")])
def test_wrong_input_is_one_line(words: list[str], line: str, refused: Callable[..., str]):
    said = refused("basins", "fig02", *words)
    assert said == f"tcc-sim: {line}\n" if " " in line else line in said
