"""The verb `basins`: its files, the rest after an interrupt, and its refusals."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from test_basins import COEXISTENCE

from tcc_sim.cli import main
from tcc_sim.study.basins import compute
from tcc_sim.study.basins.compute import basins
from tcc_sim.study.basins.results import Axis

PLANE = ["--plane", "initial.slip_speed=0:120:5", "--plane", "initial.plate_angle=-0.1:0.3:4"]
SCENE = ["fig02", "--set", "pressure.mean=225000", "--set", "pressure.amplitude=0", "--set", "engine.frequency=139.4",
         "--set", "friction.kinetic_coefficient=0.255"]


def test_the_verb_writes_labels_fractions_and_a_picture(tmp_path: Path, capsys):
    pytest.importorskip("matplotlib")
    files = [tmp_path / name for name in ("b.json", "b.npz", "b.png")]
    words = ["basins", *SCENE, *PLANE, "--boundary", "--json", str(files[0]), "--out", str(files[1]), "--plot",
             str(files[2])]
    assert main(words) == 0
    assert "period 2" in capsys.readouterr().out
    document = json.loads(files[0].read_text())
    stored = np.load(files[1])
    assert stored["labels"].shape == stored["cycles"].shape == (4, 5)
    assert [axis["key"] for axis in document["plane"]] == ["initial.slip_speed", "initial.plate_angle"]
    for k, attractor in enumerate(document["attractors"]):
        assert attractor["fraction"] == np.mean(stored["labels"] == k)
        assert len(attractor["section"]) == attractor["period"]
    assert document["undecided"] == document["runaway"] == 0.0
    assert files[2].stat().st_size > 10_000
    assert not list(tmp_path.glob("*.part"))
    assert main(words) == 2


def test_interrupted_basins_go_on_where_they_were(tmp_path: Path, monkeypatch):
    plane = (Axis("initial.slip_speed", (0.0, 60.0, 120.0)), Axis("initial.plate_angle", (0.0, 0.1, 0.2)))
    whole, = basins(COEXISTENCE, plane)
    part = tmp_path / "b.part"
    rows, solve_rows = itertools.count(), compute.solve_rows

    def broken(*task):
        if next(rows) == 2:
            while part.read_bytes().count(b"\n") < 2:  # Until a row is kept, however busy the machine is.
                pass
            raise KeyboardInterrupt
        return solve_rows(*task)

    monkeypatch.setattr(compute, "solve_rows", broken)
    with pytest.raises(KeyboardInterrupt):
        basins(COEXISTENCE, plane, jobs=1, part=part)
    monkeypatch.undo()
    kept = part.read_bytes()
    assert 1 < kept.count(b"\n") < 4
    part.write_bytes(kept + b"00000000 {\"ind")
    again, = basins(COEXISTENCE, plane, part=part)
    assert (part.read_bytes().startswith(kept), part.read_bytes().count(b"\n")) == (True, 4)  # None is solved again.
    np.testing.assert_array_equal(again.labels, whole.labels)
    part.write_bytes(kept.replace(b"cycles", b"cyclos", 1))
    assert main(["basins", "fig02", *PLANE, "--out", str(tmp_path / "b.npz"), "--jobs", "0"]) == 2


def test_rows_solved_together_are_those_solved_alone():
    plane = (Axis("initial.slip_speed", (0.0, 60.0, 120.0)), Axis("initial.plate_angle", (0.0, 0.1, 0.2)))
    attractors = basins(COEXISTENCE, plane)[0].attractors
    alone = [compute.solve_rows(COEXISTENCE, plane, [row], attractors, 600)[0] for row in range(3)]
    assert compute.solve_rows(COEXISTENCE, plane, [0, 1, 2], attractors, 600) == alone


@pytest.mark.parametrize(("cells", "rows", "threads", "size"), [
    (100, 300, 2, 1), (12, 300, 2, 10), (12, 30, 2, 5), (3, 3, 1, 1), (200, 1, 2, 1), (12, 300, 0, 10)])
def test_short_rows_share_a_task(cells, rows, threads, size):
    assert compute.rows_together(cells, rows, threads) == size


def test_basins_interrupted_while_they_are_drawn_go_on_by_the_same_command(tmp_path: Path, monkeypatch, capsys):
    from tcc_sim.study.views import basin_map

    files = [tmp_path / name for name in ("b.npz", "b.json", "b.png")]
    words = ["basins", *SCENE, "--plane", "initial.slip_speed=0:60:2", "--plane", "initial.plate_angle=0:0.1:2",
             "--out", str(files[0]), "--json", str(files[1]), "--plot", str(files[2])]

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(basin_map, "draw_basins", interrupted)
        assert main(words) == 130
    assert capsys.readouterr().err.endswith(f"tcc-sim: interrupted; the same command resumes from {files[0]}.part\n")
    assert [path.name for path in tmp_path.iterdir()] == ["b.npz.part"]
    assert main(words) == 0
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_basins_interrupted_without_a_file_promise_no_resumption(monkeypatch, capsys) -> None:
    from tcc_sim.study.basins import compute

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(compute, "basins", interrupted)
    plane = ["--plane", "initial.slip_speed=0:60:2", "--plane", "initial.plate_angle=0:0.1:2"]
    assert main(["basins", *SCENE, *plane]) == 130
    assert capsys.readouterr().err == "tcc-sim: interrupted\n"


@pytest.mark.parametrize("words", [
    ["--plane", "initial.slip_speed=0:1:3"], ["--plane", "initial.slip_speed=0:1:3", "--plane",
                                              "initial.slip_speed=0:1:3"],
    ["--plane", "initial.slip_speed=0:1:3", "--plane", "engine.frequency=1:2:3"], [*PLANE, "--cycles", "3"],
    [*PLANE, "--out", "x.txt"], [*PLANE, "--over", "friction.law=1:2:3"],
    [*PLANE, "--over", "initial.plate_angle=0:1:3"], ["--plane", "initial.slip_speed=0:x:3", *PLANE[:2]],
    [*PLANE, "--jobs", "0"],
    ["--plane", "initial.slip_speed=0:1:3000", "--plane", "initial.plate_angle=0:1:3000"],
    [*PLANE, "--set", "pressure.frequency_ratio=0.7312345", "--set", "pressure.amplitude=10000"]])
def test_wrong_input_is_one_line(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["basins", "fig02", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_wrong_axis_is_told_by_its_own_option(capsys):
    for wrong in ("initial.slip_speed=0:x:3", "initial.slip_speed=0:1:0"):
        assert main(["basins", "fig02", "--plane", wrong, *PLANE[2:]]) == 2
        assert capsys.readouterr().err.startswith("tcc-sim: --plane ")
    assert main(["basins", "fig02", *PLANE, "--over", "initial.slip_speed=0:1:3"]) == 2
    assert "an axis of the plane" in capsys.readouterr().err
