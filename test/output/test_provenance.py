"""Every JSON says its format, version, scene, command and units, and holds the fields of the page."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from documents import valid
from fields_page import KINDS, PAGE, fields_by_kind, page

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.output import provenance
from tcc_sim.output.samples import document_in
from tcc_sim.scene import load_scene
from tcc_sim.study.basins import compute
from tcc_sim.sweeps import file as sweep_file


def test_the_page_of_fields_is_up_to_date() -> None:
    pytest.importorskip("rclpy", reason="the fields of realtime are those of a node's benchmark")
    assert PAGE.read_text(encoding="utf-8") == page(), "run python .ci/instruments/fields_page.py"
    assert {*KINDS, "sweep_points", "basin_rows"} - {"table"} == set(provenance.FORMATS)


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_has_a_meaning_and_a_unit_that_is_one(kind: str) -> None:
    if kind == "realtime":
        pytest.importorskip("rclpy", reason="its fields are those of a node's benchmark")
    factors = {"s", "rad", "N", "m", "Pa", "J", "W", "Hz", "periods", "of", "excitation", "bytes", "kg"}
    for name, entry in fields_by_kind(kind).items():
        assert entry.meaning, name
        for part in entry.unit.split(", "):
            words = re.sub(r"[/()1]|\^2", " ", part).split()
            assert "{" in part or set(words) <= factors, f"{name}: {entry.unit}"


def test_the_scene_comes_back_from_its_values() -> None:
    scene = load_scene("chaos").with_values({"engine.harmonic_amplitudes": [3.0, 1.0],
                                             "engine.harmonic_phases": [0.0, 0.5],
                                             "rate": 500.0, "publish_clock": True})
    values = json.loads(json.dumps(provenance.scene_values(scene)))
    again = load_scene("fig02").with_values(values)
    assert (again.system, again.operation) == (scene.system, scene.operation)
    assert "rate" not in provenance.scene_values(System())


def test_the_document_of_a_file_of_arrays_is_taken_out_of_them_or_refused(tmp_path: Path) -> None:
    arrays = {"document": np.array('{"format": "a"}'), "x": np.ones(1)}
    assert (document_in(tmp_path, arrays), list(arrays)) == ({"format": "a"}, ["x"])
    for wrong, says in ((None, "does not say"), (np.array(["{}"]), "does not say"), (np.array(3.0), "does not say"),
                        (np.array("{"), "damaged"), (np.array("[]"), "damaged")):
        with pytest.raises(InputError, match=says):
            document_in(tmp_path, {} if wrong is None else {"document": wrong})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("documents")


def written(folder: Path, name: str, *words: object, status: int = 0) -> tuple[dict[str, object], list[str]]:
    command = [str(w) for w in words]
    assert cli.main(command) == status
    return json.loads((folder / name).read_text()), command


def test_simulate_and_analyse(folder: Path) -> None:
    result, command = written(folder, "simulate.json", "simulate", "fig02", "--set", "pressure.phase=1", "--cycles", 48,
                              "--damping", "--lyapunov", "--json", folder / "simulate.json", "--out",
                              folder / "run.mcap")
    assert valid("simulate", result)["command"] == command
    assert result["scene"]["pressure.phase"] == 1.0
    result, _ = written(folder, "analyse.json", "analyse", folder / "run.mcap", "--json", folder / "analyse.json",
                        "--damping", "--verify", status=1)
    assert valid("analyse", result)["scene"]["pressure.phase"] == 1.0


def test_a_run_shorter_than_a_cycle(folder: Path) -> None:
    result, _ = written(folder, "short.json", "simulate", "fig02", "--duration", 0.01, "--json", folder / "short.json")
    assert valid("simulate", result)["section"] == []


def test_sweep_and_the_file_of_its_points(folder: Path) -> None:
    words = ("sweep", "minimal", "--over", "engine.frequency=100:120:3", "--cycles", 30, "--damping", "--out",
             folder / "s.jsonl", "--json", folder / "s.json")
    result, command = written(folder, "s.json", *words)
    valid("sweep", result)
    first, *points = map(json.loads, (folder / "s.jsonl").read_text().splitlines())
    assert (first["format"], first["command"]) == (provenance.format_of("sweep_points"), command)
    assert len(points) == 3
    alone = set(fields_by_kind("sweep")) - {"status"}
    for point in points:
        assert set(point) == {"curve", "index", "record", "crc32"}
        assert set(point["record"]) - {"value", "final", "final_cycle", "status"} <= alone
    assert provenance.format_of("sweep_points") == sweep_file.FORMAT
    again, other = written(folder, "t.json", *words[:-1], folder / "t.json")  # another command, the same sweep
    assert again["max_slip_speed"] == result["max_slip_speed"]
    assert other != command
    assert json.loads((folder / "s.jsonl").read_text().splitlines()[0]) == first


def test_a_grid(folder: Path) -> None:
    words = ("sweep", "minimal", "--over", "engine.frequency=100:120:2", "--over", "engine.torque_amplitude=50:60:1",
             "--cycles", 8, "--lyapunov", "--json", folder / "grid.json")
    assert valid("sweep", written(folder, "grid.json", *words)[0])["second_over"] == "engine.torque_amplitude"


def test_continue(folder: Path) -> None:
    words = ("continue", "stick", "--set", "friction.law=set_valued", "--over", "engine.mean_torque=295:305", "--at",
             301.5, "--second", "pressure.mean=2.9e5:3.1e5", "--json", folder / "branches.json")
    result, command = written(folder, "branches.json", *words)
    assert valid("continue", result)["command"] == command
    assert (result["range"], result["complete"]) == ([295.0, 305.0], True)


@pytest.mark.parametrize("more", [(), ("--over", "engine.mean_torque=295:300:2")])
def test_basins_and_the_file_of_their_rows(more: tuple[str, ...], folder: Path) -> None:
    """The command takes its file of rows away when it is done; a second name of it stays."""
    part = folder / f"rows{len(more)}"
    part.touch()
    os.link(part, folder / f"{len(more)}.npz.part")
    words = ("basins", "stick", "--set", "friction.kinetic_coefficient=0.28", "--plane", "initial.slip_speed=0:50:3",
             "--plane", "initial.plate_angle=0:0.1:2", "--boundary", *more,
             "--json", folder / f"basins{len(more)}.json", "--out", folder / f"{len(more)}.npz")
    result, command = written(folder, f"basins{len(more)}.json", *words)
    assert valid("basins", result)["command"] == command
    first, *rows = map(json.loads, part.read_text().splitlines())
    assert (first["format"], first["command"]) == (provenance.format_of("basin_rows"), command)
    assert len(rows) == 2 * (2 if more else 1)
    for row in rows:
        assert (set(row), set(row["record"])) == ({"curve", "index", "record", "crc32"},
                                                  {"attractors", "labels", "cycles"})
    assert provenance.format_of("basin_rows") == compute.FORMAT


def test_explain(folder: Path) -> None:
    valid("explain", written(folder, "explain.json", "explain", "minimal", "--json", folder / "explain.json")[0])
