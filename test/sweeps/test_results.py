"""Results of sweeps, grids and scattered keys: JSON, columns, quantiles, lines for a terminal, and little memory."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import fields
from dataclasses import replace as with_fields

import numpy as np
import pytest
from documents import valid
from scipy.stats import qmc

from tcc_sim.analysis.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import replace
from tcc_sim.output.tables import doubtful_lines, sweep_lines, unsettled_lines
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.scatter import Tolerances, scatter
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.sweep import Curve, Plan, curves_of, sweep, sweep_curves, sweep_grid

SYSTEM = load_scene("fig02").system
KINETIC = "friction.kinetic_coefficient"


def test_the_command_gives_a_grid_row_by_row(tmp_path, capsys) -> None:
    words = ["sweep", "fig02", "--over", f"{KINETIC}=0.24:0.28:3", "--over", "pressure.mean=2e5:3e5:2", "--cycles",
             "20", "--rtol", "1e-8"]
    assert main([*words, "--json", str(tmp_path / "grid.json"), "--out", str(tmp_path / "grid.jsonl")]) == 0
    assert "6 of 6 values" in capsys.readouterr().out
    document = json.loads((tmp_path / "grid.json").read_text())
    assert (document["over"], document["second_over"]) == (KINETIC, "pressure.mean")
    assert document["values"] == pytest.approx([0.24, 0.26, 0.28])
    assert document["second_values"] == [2e5, 3e5]
    assert document["complete"]
    for r, pressure in enumerate(document["second_values"]):
        for c, kinetic in enumerate(document["values"]):
            alone = summarise(solve(replace(SYSTEM, {KINETIC: kinetic, "pressure.mean": pressure}), cycles=20))
            assert document["max_slip_speed"][r][c] == alone.max_slip_speed
            assert document["section"][r][c] == [list(p) for p in alone.section]
            assert document["period"][r][c] == alone.period
    for name in ("regime", "settled", "confirmed", "status", "stick_fraction", "cycles"):
        assert [len(row) for row in document[name]] == [3, 3]
    assert main([*words, "--out", str(tmp_path / "grid.jsonl")]) == 0
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-8].split()[:4] == ["mean", "kinetic_coefficient", "max_slip_speed", "period"]
    assert lines[-7].split() == ["Pa", "rad/s", "periods"]
    assert [line.split()[:2] for line in lines[-6:]] == [[p, k] for p in ("200000", "300000")
                                                   for k in ("0.24", "0.26", "0.28")]


def test_every_extra_asked_for_has_its_columns(capsys) -> None:
    words = ["sweep", "fig02", "--over", f"{KINETIC}=0.24:0.28:2", "--cycles", "30"]
    assert main(words) == 0
    plain = capsys.readouterr().out
    assert main([*words, "--damping", "--lyapunov"]) == 0
    full = capsys.readouterr().out
    for heading in ("equivalent_damping", "negative_slope_mean", "lyapunov_exponent", "lyapunov_diagnosis"):
        assert heading in full
        assert heading not in plain
    assert max(map(len, plain.splitlines())) <= 80
    swept = sweep(SYSTEM, KINETIC, [0.24], Plan(cycles=30, damping=True, lyapunov=True)).records[0]
    row = full.splitlines()[2].split()
    assert f"{swept['equivalent_damping']:.4g}" in row
    assert f"{swept['negative_slope_mean']:.4g}" in row
    assert f"{swept['lyapunov']['exponent']:.4g}" in row
    assert swept["lyapunov"]["diagnosis"] in row


def test_a_motion_without_period_reads_none_and_one_that_settles_has_a_star() -> None:
    chaos = load_scene("chaos").system
    lines = sweep_lines(sweep(chaos, KINETIC, [chaos.friction.kinetic_coefficient], Plan(cycles=100)))
    assert lines[2].split()[2] == "none"
    spiral = replace(load_scene("slip").system, {"driveline.damping": 0.1233})
    swept = sweep(spiral, "engine.frequency", [1161.858217])
    lines = sweep_lines(swept)
    assert (lines[2].split()[2], lines[-1]) == ("1*", *unsettled_lines([swept], "* "))
    varied = with_fields(swept, curve=with_fields(
        swept.curve, key="engine.mean_torque", system=load_scene("runup").system))
    for one, remedy in ((swept, "raise --cycles"), (with_fields(swept, plan=Plan(duration=1.0)), "raise --duration"),
                        (varied, "their inputs vary in time")):
        assert unsettled_lines([one], "* ") == [f"* 1 of 1 point has not settled; {remedy}"]


def test_points_with_too_large_a_step_are_doubtful() -> None:
    swept = sweep(load_scene("fig02").system, "friction.smoothing", [1.0, 50.0],
                  Plan(cycles=4, solver="rk4", step=1e-5))
    assert doubtful_lines([swept]) == ["1 of 2 points is doubtful, the first one because the step of 1e-05 s is above "
                                       "1.35e-06 s, the largest one that is stable in stick"]


def test_columns_have_a_line_per_value_and_say_what_is_missing() -> None:
    plan = Plan(cycles=20, lyapunov=True, solver="fixed_step", step=0.1)
    swept = sweep(SYSTEM, "pressure.mean", [2e5, 1e7], plan)
    table = swept.columns()
    assert next(iter(table)) == "pressure.mean"
    assert {len(column) for column in table.values()} == {2}
    assert table["max_slip_speed"].dtype == np.float64
    assert (table["period"][1], table["regime"][1], bool(table["settled"][1])) == (-1, "", False)
    assert math.isnan(table["max_slip_speed"][1])
    assert table["lyapunov_diagnosis"][0] != ""
    assert "not started" in table["status"][1]
    values = json.loads(json.dumps(swept.as_json(), allow_nan=False))
    assert (values["max_slip_speed"][1], values["status"][0], values["complete"]) == (None, "reached the end", True)
    assert repr(swept) == "<Sweep over pressure.mean: 2 values from 200000 to 1e+07; 1 solved>"
    grid = sweep_grid(SYSTEM, "pressure.mean", [2e5, 1e7], KINETIC, [0.24, 0.27], plan)
    both = grid.columns()
    assert both[KINETIC].tolist() == [0.24, 0.24, 0.27, 0.27]
    assert both["pressure.mean"].tolist() == [2e5, 1e7, 2e5, 1e7]
    assert {len(column) for column in both.values()} == {4}
    assert "<Grid over pressure.mean: 2 values" in repr(grid)
    summary = summarise(solve(SYSTEM, cycles=20))
    assert summary.columns()["max_slip_speed"] == [summary.max_slip_speed]
    assert "section" not in summary.columns()


def test_a_frame_takes_the_columns() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(sweep(SYSTEM, KINETIC, [0.24, 0.28], Plan(cycles=20)).columns())
    assert frame.shape[0] == 2


def test_a_point_comes_back_from_its_record_and_is_small() -> None:
    plan = Plan(cycles=150, damping=True, lyapunov=True, lyapunov_cycles=40, section_points=40)
    (result,) = sweep_curves([Curve(load_scene("chaos").system, KINETIC, (0.2,))], plan)
    point, record = result.points[0], result.records[0]
    again = Point.from_record(json.loads(json.dumps(record)), result.curve.at(0))
    assert again.as_record() == record
    (plain,) = sweep_curves([Curve(load_scene("chaos").system, KINETIC, (0.2,))], Plan(cycles=150))
    point = plain.points[0]
    held = [point, point.section, point.end, point.end.state, vars(point.end.state), *vars(point.end.state).values(),
            point.summary, *(getattr(point.summary, item.name) for item in fields(point.summary))]
    assert len(point.section) == 100
    assert sum(map(sys.getsizeof, held)) < 3000


def test_a_grid_goes_on_from_its_file_only_as_the_same_grid(tmp_path) -> None:
    out, plan = tmp_path / "grid.jsonl", Plan(cycles=5)
    curves = curves_of(SYSTEM, KINETIC, [0.24, 0.3], "pressure.mean", [2e5, 3e5])
    sweep_curves(curves, plan, out=out)
    before = out.read_bytes()
    sweep_curves(curves, plan, out=out)
    assert out.read_bytes() == before
    with pytest.raises(InputError, match="curves differ"):
        sweep_curves(curves_of(SYSTEM, KINETIC, [0.24, 0.3], "pressure.mean", [2e5, 4e5]), plan, out=out)


def test_a_table_that_is_too_wide_for_the_terminal_goes_on_below() -> None:
    swept = sweep_grid(SYSTEM, KINETIC, [0.23, 0.24], "engine.frequency", [150.0],
                       Plan(cycles=30, damping=True, lyapunov=True))
    whole, parts = sweep_lines(swept), sweep_lines(swept, width=80)
    assert max(map(len, whole)) > 80 >= max(map(len, parts))
    heads = [k for k, line in enumerate(parts) if "kinetic_coefficient" in line]
    assert heads == [0, 4, 8, 12]
    keys = len("frequency  kinetic_coefficient")
    for k in range(4):
        assert {parts[head + k][:keys] for head in heads} == {whole[k][:keys]}
        assert " ".join(parts[head + k][keys:] for head in heads).split() == whole[k][keys:].split()


BASE = replace(load_scene("slip").system, {"friction.law": "set_valued"})
AMPLITUDE, PRESSURE = "engine.torque_amplitude", "pressure.mean"
WORDS = ["sweep", "slip", "--set", "friction.law=set_valued", "--cycles", "20", "--scatter", f"{AMPLITUDE}=10:40",
         "--samples", "8"]


def test_samples_fill_their_bounds_and_are_those_of_their_seed() -> None:
    tolerances = Tolerances(((AMPLITUDE, 10.0, 40.0), (PRESSURE, 2e5, 3e5)), 64, 3)
    values = tolerances.sampled
    unit = np.stack([(values[AMPLITUDE] - 10.0) / 30.0, (values[PRESSURE] - 2e5) / 1e5], axis=1)
    assert unit.min() >= 0.0
    assert unit.max() < 1.0
    assert qmc.discrepancy(unit) < 0.2 * qmc.discrepancy(np.random.default_rng(1).random((64, 2)))
    for column in unit.T:
        assert np.bincount((64 * column).astype(int), minlength=64).tolist() == [1] * 64
    assert np.array_equal(tolerances.sampled[AMPLITUDE], values[AMPLITUDE])
    assert not np.array_equal(Tolerances(tolerances.bounds, 64, 4).sampled[AMPLITUDE], values[AMPLITUDE])


@pytest.mark.parametrize("bounds", [(2.0, 1.0), (1.0, 1.0)])
def test_bounds_go_up(bounds: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=rf"scatter of {AMPLITUDE} is {bounds[0]:g} to 1; the first must be below"):
        scatter(BASE, {AMPLITUDE: bounds}, 4)


def test_each_sample_is_a_simulation_and_quantiles_are_numpys() -> None:
    swept = scatter(BASE, {AMPLITUDE: (10.0, 40.0)}, 8, plan=Plan(cycles=20))
    values = swept.tolerances.sampled[AMPLITUDE]
    alone = [simulate(replace(BASE, {AMPLITUDE: x}), cycles=20).summary.max_slip_speed for x in values]
    assert swept.result("max_slip_speed")[:, 0].tolist() == alone
    assert swept.quantiles("max_slip_speed")[0].tolist() == np.quantile(alone, [0.05, 0.5, 0.95]).tolist()
    assert swept.columns()[AMPLITUDE].tolist() == values.tolist()


def test_the_command_gives_quantiles_per_value(tmp_path, capsys) -> None:
    over = ["--over", "engine.frequency=100,120,150.5"]
    assert main([*WORDS, *over, "--seed", "5", "--json", str(tmp_path / "a.json"), "--out",
                 str(tmp_path / "a.jsonl")]) == 0
    document = json.loads((tmp_path / "a.json").read_text())
    valid("sweep", document)
    assert (document["scatter"], document["samples"], document["seed"]) == ({AMPLITUDE: [10.0, 40.0]}, 8, 5)
    assert document["values"] == [100.0, 120.0, 150.5]
    assert np.shape(document["max_slip_speed"]) == (8, 3)
    assert document["quantiles"]["max_slip_speed"] == np.quantile(
        document["max_slip_speed"], [0.05, 0.5, 0.95], axis=0).T.tolist()
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
