"""Results of sweeps, grids and scattered keys: JSON, columns, quantiles, lines for a terminal, and little memory."""

from __future__ import annotations

import json
import math
from dataclasses import replace as with_fields

import numpy as np
import pytest
from documents import valid
from scipy.stats import qmc

from tcc_sim.analysis.steady.summary import summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.results import Grid, Point, varied
from tcc_sim.sweeps.scatter import Tolerances, scatter, scattering
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.sweep import Curve, Plan, curves_of, sweep, sweep_curves

SYSTEM = load_scene("fig02").system
KINETIC = "friction.kinetic_coefficient"


def test_the_command_gives_a_grid_row_by_row(tmp_path, capsys) -> None:
    words = ["sweep", "fig02", "--over", f"{KINETIC}=0.24:0.28:3", "--over", "pressure.mean=2e5:3e5:2", "--cycles",
             "20", "--rtol", "1e-8"]
    assert main([*words, "--json", str(tmp_path / "grid.json"), "--out", str(tmp_path / "grid.jsonl")]) == 0
    assert "6 of 6" in capsys.readouterr().out
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
    rows = [line.split() for line in lines if line.split()[:1] in (["200000"], ["300000"])]
    assert [row[:2] for row in rows] == [[p, k] for p in ("200000", "300000") for k in ("0.24", "0.26", "0.28")]
    assert [float(row[2]) for row in rows] == pytest.approx(np.ravel(document["max_slip_speed"]), rel=1e-5)


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


def test_a_motion_without_period_reads_none_and_one_that_settles_is_marked(capsys) -> None:
    assert main(["sweep", "chaos", "--over", f"{KINETIC}=0.192,0.2", "--cycles", "100"]) == 0
    assert "none" in capsys.readouterr().out
    spiral = ["sweep", "slip", "--set", "driveline.damping=0.1233", "--over", "engine.frequency=1161.858217,1161.9"]
    assert main(spiral) == 0
    row, note = capsys.readouterr().out.splitlines()[-2:]
    assert "1*" in row.split()
    assert "of 2" in note
    assert "--cycles" in note


def test_points_with_too_large_a_step_are_doubtful(capsys) -> None:
    assert main(["sweep", "fig02", "--over", "friction.smoothing=1,50", "--cycles", "4", "--solver", "rk4", "--step",
                 "1e-5"]) == 0
    assert "1 of 2" in capsys.readouterr().out.splitlines()[-1]


def test_a_value_that_the_solver_refuses_is_missing_and_says_why() -> None:
    swept = sweep(SYSTEM, "pressure.mean", [2e5, 1e7], Plan(cycles=20, solver="fixed_step", step=0.1))
    table = swept.columns()
    assert (table["period"][1], table["regime"][1], bool(table["settled"][1])) == (-1, "", False)
    assert "not started" in table["status"][1]
    values = json.loads(json.dumps(swept.as_json(), allow_nan=False))
    assert (values["max_slip_speed"][1], values["status"][0], values["complete"]) == (None, "reached the end", True)
    summary = summarise(solve(SYSTEM, cycles=20))
    assert summary.columns()["max_slip_speed"] == [summary.max_slip_speed]
    assert "section" not in summary.columns()


EXTRAS = Plan(cycles=150, damping=True, lyapunov=True, lyapunov_cycles=40, section_points=40, orders=())
PLANS = {"plain": Plan(cycles=20), "extras": EXTRAS, "refused": Plan(cycles=20, solver="fixed_step", step=0.1)}


@pytest.mark.parametrize("name", PLANS)
def test_a_point_comes_back_from_its_line(name: str) -> None:
    (result,) = sweep_curves([Curve(load_scene("chaos").system, KINETIC, (0.2,))], PLANS[name])
    record = json.loads(json.dumps(result.records[0], allow_nan=False))
    again = Point.from_record(record, result.curve.at(0))
    assert repr(again) == repr(result.points[0])
    assert again.as_record() == result.records[0]
    for key in ("value", "final", "final_cycle", "section", "confirmed", "status"):
        with pytest.raises(KeyError):
            Point.from_record({name: value for name, value in record.items() if name != key}, SYSTEM)
    for key in ("max_slip_speed", "min_slip_speed", "period", "stick_fraction"):
        if again.summary is not None:
            with pytest.raises(TypeError):
                Point.from_record({**record, key: "1"}, SYSTEM)


def test_columns_are_the_figures_of_single_runs_and_missing_ones_are_empty() -> None:
    values = [0.2, 0.22]
    whole, = sweep_curves([Curve(load_scene("chaos").system, KINETIC, tuple(values))], EXTRAS)
    some = with_fields(whole, points=[whole.points[0], None])
    alone = simulate(replace(load_scene("chaos").system, {KINETIC: 0.2}), with_fields(EXTRAS, rtol=1e-6))
    figures = {**alone.summary.columns(), "equivalent_damping": [alone.damping.weighted],
               "negative_slope_mean": [alone.damping.negative_mean], "lyapunov_exponent": [alone.lyapunov.exponent],
               "lyapunov_diagnosis": [alone.lyapunov.diagnosis], "confirmed": [alone.confirmed]}
    orders = alone.orders_at_speeds
    figures |= {f"slip_speed_order_{order:g}_at_{orders.speeds[0]:.6g}": [orders.slip_speed[0, k]]
                for k, order in enumerate(orders.order)}
    table = some.columns()
    assert table.pop(KINETIC).tolist() == values
    for name, (value,) in figures.items():
        if name in table and name != "elapsed_s":
            assert table[name][0] == value or table[name][0] == pytest.approx(value, rel=1e-6, nan_ok=True), name
    assert len(set(figures) & set(table)) > 25
    for name, column in table.items():
        empty = {"b": False, "i": -1, "f": math.nan}.get(column.dtype.kind)
        assert column[1] == empty or math.isnan(column[1]) if empty is not None else name == "status" or not column[1]
        if column.dtype.kind in "bif" and not name.startswith(("slip_speed_order", "shaft_torque_order")):
            assert some.column(name)[0] == pytest.approx(float(column[0]), nan_ok=True)
            assert math.isnan(some.column(name)[1])
    document = some.as_json()
    assert (document["complete"], whole.as_json()["complete"]) == (False, True)
    assert with_fields(whole, points=[None, whole.points[1]]).as_json().keys() == document.keys()
    assert (document["over"], document["values"], document["max_slip_speed"][1]) == (KINETIC, values, None)
    # A row that has fewer results is filled.
    plain = sweep(load_scene("chaos").system, KINETIC, values, cycles=20)
    grid = Grid("pressure.mean", (2e5, 3e5), [some, plain])
    both = grid.columns()
    assert both["pressure.mean"].tolist() == [2e5, 2e5, 3e5, 3e5]
    assert both["lyapunov_cycles"].tolist() == [*table["lyapunov_cycles"], -1, -1]
    assert grid.course.not_settled == some.not_settled + plain.not_settled
    assert grid.lists["max_slip_speed"] == [document["max_slip_speed"], plain.column("max_slip_speed").tolist()]
    assert not grid.course.complete


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
    capsys.readouterr()
    assert main(WORDS) == 0
    printed = [capsys.readouterr().out]
    assert main([*WORDS, "--quantiles", "0.05,0.5,0.95", "--json", str(tmp_path / "b.json")]) == 0
    alone = json.loads((tmp_path / "b.json").read_text())
    valid("sweep", alone)
    assert len(alone["max_slip_speed"]) == len(alone["sampled"][AMPLITUDE]) == 8
    assert len(alone["quantiles"]["max_slip_speed"]) == 3
    for out in (*printed, capsys.readouterr().out):
        lines = out.splitlines()
        at = next(k for k, line in enumerate(lines) if line.startswith("max_slip_speed"))
        assert [float(x) for x in lines[at + 1].split()] == pytest.approx(alone["quantiles"]["max_slip_speed"],
                                                                          rel=1e-4)


@pytest.mark.parametrize(("work", "words"), [
    *((lambda count=count: Curve(SYSTEM, KINETIC, (0.24,) * count), (str(count), "1 to 1000000"))
      for count in (0, 1_000_001)),
    *((lambda n=n, m=m: curves_of(SYSTEM, KINETIC, [0.24] * n, PRESSURE, [1e5] * m), (str(n), str(m), "1 to 1000000"))
      for n, m in ((1, 0), (1001, 1000))),
    (lambda: curves_of(SYSTEM, KINETIC, [0.24], KINETIC, [0.25]), (KINETIC,)),
    *((lambda x=x: varied(load_scene("fresh_fluid").system, "friction.coefficients", x),
       ("friction.coefficients", f"{x:g}", "above 0")) for x in (0.0, math.inf)),
    (lambda: sweep("slip", AMPLITUDE, [1.0], cycles=3).column("max_slip"), ("max_slip", "max_slip_speed?")),
    (lambda: sweep("slip", AMPLITUDE, [1.0], cycles=3).column("regime"), ("regime",)),
    (lambda: Tolerances((), 4), ("none",)), (lambda: Tolerances((("a", 1.0, 2.0),) * 2, 4), ("a, a",)),
    (lambda: Tolerances((("a", 2.0, 2.0),), 4), ("a", "2 to 2")),
    *((lambda n=n: Tolerances((("a", 1.0, 2.0),), n), ("samples", str(n), "2 to 1000000")) for n in (1, 1_000_001)),
    *((lambda n=n: Tolerances((("a", 1.0, 2.0),), 4, n), ("seed", str(n), "0 to 4294967295")) for n in (-1, 1 << 32)),
    *((lambda p=p: Tolerances((("a", 1.0, 2.0),), 4, 0, p), ("quantiles", "0 to 1")) for p in (
        (), (0.5, 0.5), (0.5, 0.1), (-0.1, 0.5), (0.5, 1.1), (0.5, math.nan))),
    (lambda: scattering(SYSTEM, [(KINETIC, 0.2, 0.3)], 4, KINETIC, [0.2]), (KINETIC,)),
    (lambda: scattering(SYSTEM, [(KINETIC, 0.2, 0.3)], 1001, PRESSURE, [1e5] * 1000), ("1001", "1000", "1000000"))])
def test_a_sweep_or_scatter_out_of_its_bounds_is_refused(work, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        work()
    assert all(word in str(error.value) for word in words), str(error.value)


def test_quantiles_leave_out_runaways_and_transients_but_not_a_manoeuvre() -> None:
    probabilities = (0.0, 0.5, 1.0)
    mixed = {"engine.mean_torque": (200.0, 900.0)}
    some = scatter(load_scene("minimal"), mixed, 8, cycles=100, quantiles=probabilities)
    every = scatter(load_scene("minimal"), mixed, 8, cycles=100, quantiles=probabilities, every=True)
    sizes = some.result("max_slip_speed")[:, 0]
    away, transient = (some.result(name)[:, 0] == 1.0 for name in ("runaway", "transient"))
    assert 0 < away.sum() < 8 > transient.sum() > 0
    kept = ~(away | transient)
    assert kept.any()
    assert some.left_out == {"runaway": away.sum(), "not_settled": transient.sum()}
    assert every.left_out == {"runaway": 0, "not_settled": 0}
    assert some.quantiles("max_slip_speed")[0] == pytest.approx(np.quantile(sizes[kept], probabilities))
    assert every.quantiles("max_slip_speed")[0] == pytest.approx(np.quantile(sizes, probabilities))
    assert some.quantiles("runaway").tolist() == [[0.0, np.median(away), 1.0]]
    assert some.all_quantiles["max_slip_speed"] == pytest.approx(some.quantiles("max_slip_speed")[0])
    assert some.order_quantiles is None
    over = scatter(load_scene("minimal"), {"engine.mean_torque": (290.0, 310.0)}, 4, over=KINETIC, values=[0.29, 0.3],
                   cycles=150, orders=())
    slip = np.array([[p.orders.slip_speed for p in each.points] for each in over.sweeps])
    left = over.result("transient") == 1.0
    slip[left] = np.nan
    assert over.order_quantiles["slip_speed"] == pytest.approx(
        np.moveaxis(np.nanquantile(slip, (0.05, 0.5, 0.95), axis=0), 0, -1), nan_ok=True)
    moving = scatter(load_scene("tip_in"), {KINETIC: (0.23, 0.25)}, 2, duration=0.3)
    assert moving.left_out == {"runaway": 0, "not_settled": 0}
