"""A recording as data: every sample, in windows, as a Trajectory, as files and as a table."""

from __future__ import annotations

import json
import math
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from driveline_bags import TICK, bag, by_hand, ticked

import tcc_sim
from tcc_sim import cli
from tcc_sim.analysis.steady.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError, MissingPackage
from tcc_sim.replay.given_inputs import twin_of
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene, parse_scene
from tcc_sim.solvers import solve
from tcc_sim.views.plots import plot

FIG02 = load_scene("fig02")


@pytest.fixture(scope="module")
def rows():
    """1.2 s of Fig. 2, a change at 0.7 s, a reset, and 1.8 s more."""
    said = []
    result = ticked(FIG02, 3000, changes=[(700, {"engine.mean_torque": 250.0}, False)], resets=(1199,), said=said)
    return result, said


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, rows):
    return bag(tmp_path_factory.mktemp("recorded") / "run", rows[0], FIG02, said=rows[1])


@pytest.mark.parametrize("absent", [(5,), (6,), (5, 6)], ids=["engine torque", "friction torque", "both"])
def test_torques_without_numbers_are_those_that_the_recorded_speeds_need(tmp_path, absent):
    # Any smooth motion: (2a) and (2b) with the converter's fluid give the torques that it needs.
    scene = load_scene("slip").with_values({"converter.coupling": 0.4})
    d, t = scene.system.driveline, np.arange(300) * 1e-3
    plate, fast = 0.1 + 0.01 * np.sin(60.0 * t), 150.0 + 20.0 * np.cos(40.0 * t)
    speed, rise, fall = 0.6 * np.cos(60.0 * t), -36.0 * np.sin(60.0 * t), -800.0 * np.sin(40.0 * t)
    fluid = 0.4 * (fast - speed)
    friction = d.plate_inertia * rise + d.damping * speed + d.stiffness * plate - fluid
    engine = d.flywheel_inertia * fall + friction + fluid
    table = np.column_stack([plate, plate, fast, speed, engine, friction, np.full(len(t), np.nan)])
    table[:, np.array(absent) - 1] = np.nan
    rows = [(k * TICK, *row) for k, row in enumerate(table.tolist())]
    result = tcc_sim.read(bag(tmp_path / "run", rows, scene)).trajectory()
    # A central difference is off by h^2/6 of the third derivative of the speed.
    inner, off, steep = slice(1, -1), 1e-6 / 6.0, 36.0 * 3600.0
    assert result.friction_torque[inner] == pytest.approx(friction[inner], abs=off * steep * d.plate_inertia)
    assert result.engine_torque[inner] == pytest.approx(engine[inner], abs=off * (800.0 * 1600.0 + steep) *
                                                        d.flywheel_inertia)


def test_a_recording_has_runs_segments_and_every_sample(recorded, rows):
    result = tcc_sim.read(recorded)
    assert [(run.number, run.start, run.end, run.samples, run.began_by) for run in result.runs] == [
        (0, 0.0, 1.199, 1200, "start"), (1, 0.0, 1.8, 1801, "reset")]
    assert [segment.began_by for segment in result.segments] == ["start", "parameters", "reset"]
    assert "2 runs, complete" in repr(result)
    first, second = result.trajectory(), result.trajectory(1)
    for run, part in ((first, rows[0][:1200]), (second, rows[0][1200:])):
        table = np.array(part)
        assert np.array_equal(run.t, table[:, 0] * 1e-9)
        assert np.array_equal(run.slip_speed, table[:, 3] - table[:, 4])
        for name, column in (("flywheel_angle", 1), ("plate_angle", 2), ("plate_speed", 4), ("engine_torque", 5),
                             ("friction_torque", 6)):
            assert np.array_equal(getattr(run, name), table[:, column])
        p = FIG02.system.pressure
        pressure = p.mean + p.amplitude * np.sin(150.0 * p.frequency_ratio * run.t + p.phase)
        assert run.saturation_torque == pytest.approx(0.24 * 0.08 * 0.1 * pressure, rel=1e-9)
    assert second.system.engine.mean_torque == 250.0


def test_a_stretch_of_it_is_analysed_and_drawn_as_a_solution_is(recorded, tmp_path, pictures):
    run = tcc_sim.read(recorded).trajectory(1, 0.5, 1.5)
    assert (run.t[0], run.t[-1], len(run.t)) == (0.5, 1.5, 1001)
    assert summarise(run, 3).cycles == len(run.cycles) == int(1.5 * 150 / (2 * math.pi)) - math.ceil(75 / (2 * math.pi))
    starts = run.cycles.starts
    assert starts[:2] == pytest.approx(np.array([12, 13]) * 2.0 * math.pi / 150.0, rel=1e-12)
    plot(run, tmp_path / "run.png")
    assert len(pictures) == 1


@pytest.mark.parametrize(("window", "words"), [
    ({"run": 2}, "no run 2: the recording holds 2 runs, counted from 0"), ({"run": -1}, "runs are counted from 0"),
    ({"start": 5.0}, "no state in the window"), ({"start": 1.0, "end": 0.5}, "end")])
def test_what_is_not_there_is_refused(recorded, window, words):
    with pytest.raises(InputError, match=words):
        tcc_sim.read(recorded).trajectory(**window)


def test_commands_are_columns(tmp_path):
    steady = by_hand(1.0, lambda t: 150.0 + 0.0 * t, lambda t: 0.1 + 0.0 * t, lambda t: 0.0 * t,
                     lambda t: 300.0 + 0.0 * t, lambda t: 300.0 + 0.0 * t)
    path = bag(tmp_path / "run", [*steady, *steady], "slip", targets=[(0, 20.0), (500, 30.0), (1501, 40.0)])
    result = tcc_sim.read(path).commands["target_slip_speed"]
    assert (result.run.tolist(), result.value.tolist()) == ([0, 0, 1], [20.0, 30.0, 40.0])
    assert result.t == pytest.approx([0.0, 0.5, 0.5], abs=1.5e-3)


def test_cycles_of_a_commanded_torque_are_its_own_in_every_window(tmp_path):
    scene = load_scene("commands").with_values({"engine.frequency": 99.0})
    path = bag(tmp_path / "run", ticked(scene, 1600, torque=lambda k: 300.0 + 250.0 * math.sin(0.15 * k),
                                        pressure=lambda k: 260e3), scene)
    run = tcc_sim.read(path).trajectory(0, 0.5, 1.5)
    assert np.diff(run.cycles.starts) == pytest.approx(2.0 * math.pi / 150.0, rel=1e-5)
    constant = bag(tmp_path / "constant", ticked(scene, 400, torque=lambda k: 300.0, pressure=lambda k: 260e3), scene)
    assert len(tcc_sim.read(constant).trajectory().cycles) == 0


def test_a_window_of_a_run_is_analysed_alone(recorded, tmp_path):
    assert main(["analyse", str(recorded), "--run", "1", "--from", "0.6", "--to", "1.4", "--discard", "2", "--json",
                 str(tmp_path / "a.json"), "--out", str(tmp_path / "a.csv")]) == 0
    document = json.loads((tmp_path / "a.json").read_text())
    (segment,) = document["segments"]
    assert (segment["start"], segment["end"]) == (pytest.approx(0.6), pytest.approx(1.4))
    assert segment["began_by"] == "reset"
    assert "only run 1, from 0.6 s on, up to 1.4 s is analysed" in document["warnings"]
    assert document["cycles"] == int(1.4 * 150 / (2 * math.pi)) - math.ceil(0.6 * 150 / (2 * math.pi))
    run = tcc_sim.read(recorded).trajectory(1, 0.6, 1.4)
    inside = run.t >= run.cycles.starts[2]
    assert document["max_slip_speed"] == pytest.approx(np.abs(run.slip_speed[inside]).max(), rel=0.02)
    lines = (tmp_path / "a.csv").read_text().splitlines()
    head = [line.removeprefix("# ") for line in lines if line.startswith("#")]
    assert parse_scene("\n".join(head) + "\n", "fig02").system == FIG02.system
    columns, units, *values = lines[len(head):]
    assert columns == "t,slip_speed,plate_angle,plate_speed,engine_torque,saturation_torque,friction_torque,state"
    assert units == "s,rad/s,rad,rad/s,N m,N m,N m,"
    table = np.array([[float(x) for x in line.split(",")] for line in values])
    assert np.array_equal(table[:, 0], run.t)
    assert np.array_equal(table[:, 1], run.slip_speed)


def test_the_samples_of_the_run_that_is_shown_become_arrays(recorded, tmp_path, capsys):
    assert main(["analyse", str(recorded), "--out", str(tmp_path / "a.npz")]) == 0
    with np.load(tmp_path / "a.npz") as arrays:
        assert np.array_equal(arrays["t"], np.arange(1801) * TICK * 1e-9)
        assert arrays["units"].tolist() == ["s", "rad/s", "rad", "rad/s", "N m", "N m", "N m", ""]
        assert parse_scene(str(arrays["scene"]), "fig02").system == FIG02.system
    for words in (["--out", "a.mcap"], ["--run", "7"], ["--from", "3", "--to", "2"]):
        assert main(["analyse", str(recorded), *words]) == 2
    capsys.readouterr()
    assert replay(recorded).run == 1


def test_a_table_carries_units_and_scene(recorded, monkeypatch):
    class Frame(dict):
        attrs: dict = {}  # noqa: RUF012

    stub = types.ModuleType("pandas")
    stub.DataFrame, stub.__spec__ = Frame, types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "pandas", stub)
    result = tcc_sim.read(recorded).to_pandas(0, 0.1, 0.2)
    assert result.attrs["units"]["engine_torque"] == "N m"
    assert result.attrs["scene"] == FIG02.text()
    assert list(result)[:2] == ["t", "slip_speed"]
    assert len(result["t"]) == 101
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackage, match="table"):
        tcc_sim.read(recorded).to_pandas()


FOUND = {"friction.kinetic_coefficient": 0.25, "driveline.stiffness": 3150.0}


def test_a_recording_becomes_a_scene_that_follows_it(tmp_path: Path, capsys, pictures) -> None:
    """A driveline that differs from its scene, under commands of torque and pressure."""
    scene = load_scene("commands")
    rows = ticked(scene.with_values(FOUND), 401, torque=lambda k: 250.0 + 200.0 * math.sin(0.14 * k),
                  pressure=lambda k: 2.2e5 + 3e4 * math.sin(0.01 * k))
    run, mine = str(bag(tmp_path / "run", rows, scene)), tmp_path / "mine.yaml"
    words = [word for key in FOUND for word in ("--free", key)]
    assert cli.main(["identify", run, *words, "--out", str(mine)]) == 0
    system = load_scene(str(mine)).system
    assert system.driveline.stiffness == pytest.approx(3150.0, rel=1e-4)
    assert system.friction.kinetic_coefficient == pytest.approx(0.25, rel=1e-4)
    assert cli.main(["simulate", str(mine), "--inputs", run, "--plot", str(tmp_path / "twin.png")]) == 0
    assert "slip speed beside run: " in capsys.readouterr().out
    assert len(pictures) == 1


def test_the_difference_is_that_of_the_two_speeds(tmp_path: Path) -> None:
    run = solve(load_scene("minimal"), cycles=4, samples_per_cycle=400)
    table = tmp_path / "seen.csv"
    np.savetxt(table, np.column_stack([run.t, run.slip_speed - 0.5, 0.0 * run.t]), delimiter=",", comments="",
               header="t,slip_speed,engine_torque")
    result = twin_of(table, run)
    assert result is not None
    assert result.difference == pytest.approx(0.5, abs=1e-6)
    assert result.t.tolist() == run.t.tolist()
    assert "0.5 rad/s apart" in str(result)
    table.write_text("t,engine_torque\n0,1\n1,2\n")
    assert twin_of(table, run) is None
