"""Results of sweeps, grids and scattered keys: JSON, columns, quantiles, lines for a terminal, and little memory."""

from __future__ import annotations

import json
import math
import re
import sys
from dataclasses import fields
from dataclasses import replace as with_fields

import numpy as np
import pytest
from dataclasses_of import changeable
from documents import valid
from scipy.stats import qmc

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.manoeuvre import JudderFigures, OrdersAtSpeeds
from tcc_sim.analysis.multipliers import Lyapunov
from tcc_sim.analysis.summary import Summary, summarise
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import replace
from tcc_sim.output.tables import doubtful_lines, sweep_lines, unsettled_lines
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.results import Grid, Point, Sweep, varied
from tcc_sim.sweeps.scatter import NUMBERS, Scattered, Tolerances, scatter, scattered_curves
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Plan, curves_of, sweep, sweep_curves, sweep_grid
from tcc_sim.trajectory import State

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


GIVEN = Summary(62.0, -0.5, 2, [], 0.25, "stick-slip", 20, 5, True, 1e-9, "smoothed", 0.5, None, False, False, (1.0,
    3.0),
                1.5, 0.25, 1, 6, 10.0, 5.0, 40.0, 300.0, -20.0, 7, 0.125)
"""A summary with a number of its own in every field."""
END = Start(State(1.0, 2.0, 3.0), 20)
ORDERS = OrdersAtSpeeds(np.array([100.0, 150.5]), np.array([1.0, 2.5]), np.array([[1.0, 2.0], [3.0, np.nan]]),
                        np.array([[10.0, 20.0], [30.0, 40.0]]))
FULL = Point(0.24, GIVEN, np.array([[0.1, 0.5], [0.2, 0.6]]), True, "reached the end", np.array([0.1, 0.2]),
             Damping(-0.5, -1.5, -0.6), Lyapunov(1.5, 1.0, 2.0, 0.95, 9, "chaotic"), END, JudderFigures(4.0, 8.0),
                 ORDERS)
FAILED = Point(0.26, None, np.empty((0, 2)), False, "stopped", None, None, None, END)
MADE = Sweep(Curve(SYSTEM, KINETIC, (0.24, 0.25, 0.26)), Plan(discard=5), [FULL, None, FAILED], 7.5)
FIGURES = {"max_slip_speed": 62.0, "min_slip_speed": -0.5, "period": 2, "stick_fraction": 0.25, "regime": "stick-slip",
           "cycles": 20, "discarded": 5, "settled": True, "section_change": 1e-9, "solver": "smoothed",
           "elapsed_s": 0.5,
           "runaway": False, "transient": False, "seconds": 1.5, "lost_seconds": 0.25, "broken": 1, "longest_period": 6,
           "clutch_energy": 10.0, "mean_power": 5.0, "peak_power": 40.0, "max_shaft_torque": 300.0,
           "min_shaft_torque": -20.0, "breakaways": 7, "coupling_energy": 0.125, "confirmed": True,
           "equivalent_damping": -0.5, "negative_slope_mean": -1.5, "lyapunov_exponent": 1.5, "lyapunov_low": 1.0,
           "lyapunov_high": 2.0, "lyapunov_confidence": 0.95, "lyapunov_cycles": 9, "lyapunov_diagnosis": "chaotic",
           "judder_rms": 4.0, "judder_peak": 8.0, "status": "reached the end"}


def same(left: object, right: object) -> bool:
    """Whether two cells are equal, NaN to NaN."""
    return left == right or (left != left and right != right)


def test_a_table_has_every_figure_and_what_stands_for_a_missing_one() -> None:
    table = MADE.columns()
    orders = {"slip_speed_order_1_at_100": 1.0, "slip_speed_order_2.5_at_100": 2.0, "slip_speed_order_1_at_150.5": 3.0,
              "slip_speed_order_2.5_at_150.5": math.nan, "shaft_torque_order_1_at_100": 10.0,
              "shaft_torque_order_2.5_at_100": 20.0, "shaft_torque_order_1_at_150.5": 30.0,
              "shaft_torque_order_2.5_at_150.5": 40.0}
    assert list(table) == [KINETIC, *FIGURES, *orders]
    assert table.pop(KINETIC).tolist() == [0.24, 0.25, 0.26]
    for name, column in table.items():
        full, missing, failed = column.tolist()
        assert same(full, {**FIGURES, **orders}[name]), name
        if name == "status":
            assert (missing, failed) == ("not solved: the sweep was interrupted", "stopped")
            continue
        none = {bool: False, int: -1, float: math.nan, str: ""}[type(full)]
        assert same(missing, none), name
        assert same(failed, none), name
    for name in set(FIGURES) - {"regime", "solver", "status", "lyapunov_diagnosis"}:
        full, missing, failed = MADE.column(name).tolist()
        assert full == float(FIGURES[name]), name
        assert math.isnan(missing), name
        assert math.isnan(failed) or (name, failed) == ("confirmed", 0.0), name
    infinite = with_fields(FULL, summary=with_fields(GIVEN, clutch_energy=math.inf))
    assert math.isnan(infinite.number("clutch_energy"))
    assert [each and each["final"] for each in MADE.records] == [[1.0, 2.0, 3.0], None, [1.0, 2.0, 3.0]]
    document = MADE.as_json()
    course = {"over": KINETIC, "values": [0.24, 0.25, 0.26], "direction": "cold", "discard": 5, "duration": None,
              "varying": [], "complete": False, "not_settled": 0, "wall_s": 7.5}
    assert {name: document[name] for name in course} == course
    assert document["section"] == [[[0.1, 0.5], [0.2, 0.6]], None, []]
    assert document["theta2"] == [[0.1, 0.2], None, None]
    assert repr(MADE) == f"<Sweep over {KINETIC}: 3 values from 0.24 to 0.26; 1 solved>"
    assert repr(with_fields(MADE, curve=Curve(SYSTEM, KINETIC, (0.24,)), points=[FULL])) == (
        f"<Sweep over {KINETIC}: 1 value from 0.24 to 0.24; 1 solved>")
    assert sweep(SYSTEM, KINETIC, [0.24], Plan(cycles=3)).columns().keys() == {
        KINETIC, *(name for name in FIGURES if not name.startswith(("lyap", "judder", "equi", "nega")))}


def test_a_grid_puts_its_rows_below_each_other_and_counts_together() -> None:
    """A row that has fewer results is filled."""
    drift = with_fields(FULL, summary=with_fields(GIVEN, transient=True), lyapunov=None, orders=None, judder=None)
    second = with_fields(MADE, points=[drift, drift, drift], plan=Plan())
    grid = Grid("pressure.mean", (2e5, 3e5), [MADE, second])
    table, alone = grid.columns(), MADE.columns()
    assert list(table) == ["pressure.mean", *alone]
    assert table["pressure.mean"].tolist() == [2e5] * 3 + [3e5] * 3
    assert {len(column) for column in table.values()} == {6}
    assert table["transient"].tolist() == [False] * 3 + [True] * 3
    assert table["lyapunov_cycles"].tolist() == [9, -1, -1, -1, -1, -1]
    assert table["lyapunov_diagnosis"].tolist() == ["chaotic", *[""] * 5]
    assert np.isnan(table["slip_speed_order_1_at_100"][1:]).all()
    assert (second.not_settled, second.complete, grid.course.not_settled, grid.course.complete) == (3, True, 3, False)
    assert (second.course.discard, Plan(discard="auto").discard, grid.course.seconds) == ("default", "auto", 7.5)
    assert grid.lists["max_slip_speed"] == [[62.0, None, None], [62.0] * 3]
    assert grid.lists["lyapunov"][1] == [None] * 3
    assert grid.lists["judder_rms"] == [[4.0, None, None], [None] * 3]
    assert repr(grid) == (f"<Grid over {KINETIC}: 3 values from 0.24 to 0.26, and pressure.mean: 2 values from 200000 "
                          "to 300000; 4 solved>")


@pytest.mark.parametrize("change", [
    {}, {"damping": None, "lyapunov": None, "judder": None, "orders": None, "theta2": None},
    {"summary": with_fields(GIVEN, clutch_energy=math.nan, section_change=math.nan, breakaways=None)},
    {"damping": Damping(math.nan, -1.0, -0.6), "judder": JudderFigures(math.nan, math.nan)},
    {"lyapunov": Lyapunov(math.nan, math.nan, math.nan, 0.95, 9, "runaway")}, {"summary": None, "confirmed": False}])
def test_a_point_comes_back_from_its_line(change: dict[str, object]) -> None:
    point = with_fields(FULL, **change)
    again = Point.from_record(json.loads(json.dumps(point.as_record(), allow_nan=False)), SYSTEM)
    assert repr(again) == repr(point)
    record = point.as_record()
    for name in ("value", "final", "final_cycle", "section", "confirmed", "status"):
        with pytest.raises(KeyError):
            Point.from_record({key: value for key, value in record.items() if key != name}, SYSTEM)
    for name in ("max_slip_speed", "min_slip_speed", "period", "stick_fraction"):
        if point.summary is not None:
            with pytest.raises(TypeError):
                Point.from_record({**record, name: "1"}, SYSTEM)


RANGE, RISE = (("a", 1.0, 2.0),), "they must be probabilities from 0 to 1 that increase"


@pytest.mark.parametrize(("work", "why"), [
    *((lambda count=count: Curve(SYSTEM, KINETIC, (0.24,) * count),
       f"a sweep has {count} values; it must have 1 to 1000000") for count in (0, 1_000_001)),
    *((lambda n=n, m=m: curves_of(SYSTEM, KINETIC, [0.24] * n, "pressure.mean", [1e5] * m),
       f"a grid has {n} by {m} values; it must have 1 to 1000000") for n, m in ((1, 0), (1001, 1000))),
    (lambda: curves_of(SYSTEM, KINETIC, [0.24], KINETIC, [0.25]), f"{KINETIC} is swept twice; a grid has two keys"),
    *((lambda x=x: varied(load_scene("fresh_fluid").system, "friction.coefficients", x),
       f"the factor of friction.coefficients is {x:g}; it must be above 0") for x in (0.0, math.inf)),
    (lambda: MADE.column("max_slip"), "max_slip is not a result in numbers; did you mean max_slip_speed?"),
    (lambda: MADE.column("regime"), "regime is not a result in numbers"),
    (lambda: Tolerances((), 4), "scatter has the keys none; it must have one or more, each once"),
    (lambda: Tolerances(RANGE * 2, 4), "scatter has the keys a, a; it must have one or more, each once"),
    (lambda: Tolerances((("a", 2.0, 2.0),), 4), "scatter of a is 2 to 2; the first must be below the second"),
    *((lambda n=n: Tolerances(RANGE, n), f"samples is {n}; it must be 2 to 1000000") for n in (1, 1_000_001)),
    *((lambda n=n: Tolerances(RANGE, 4, n), f"seed is {n}; it must be 0 to 4294967295") for n in (-1, 1 << 32)),
    (lambda: Tolerances(RANGE, 4, 0, ()), f"quantiles are none; {RISE}"),
    *((lambda p=p: Tolerances(RANGE, 4, 0, p), f"quantiles are {p[0]:g}, {p[1]:g}; {RISE}") for p in (
        (0.5, 0.5), (0.5, 0.1), (-0.1, 0.5), (0.5, 1.1), (0.5, math.nan))),
    (lambda: scattered_curves(SYSTEM, Tolerances(((KINETIC, 0.2, 0.3),), 4), KINETIC, [0.2]),
     f"{KINETIC} is swept and scattered; it must be one of the two"),
    (lambda: scattered_curves(SYSTEM, Tolerances(((KINETIC, 0.2, 0.3),), 1001), "pressure.mean", [1e5] * 1000),
     "there are 1001 samples of 1000 values; there may be 1000000")])
def test_what_is_no_sweep_or_scatter_is_refused(work, why: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
        work()


def test_bounds_of_numbers_are_allowed_themselves() -> None:
    for more in ((2,), (1_000_000,), (4, 0), (4, (1 << 32) - 1), (4, 0, (0.0, 1.0))):
        assert Tolerances((("a", 1.0, 2.0),), *more).scatter == {"a": (1.0, 2.0)}
    assert len(curves_of(SYSTEM, KINETIC, [0.24] * 2, "pressure.mean", [1e5, 2e5])) == 2
    assert varied(load_scene("fresh_fluid").system, "friction.coefficients", 0.5).friction.coefficients == tuple(
        0.5 * x for x in load_scene("fresh_fluid").system.friction.coefficients)


def made(values: list[float], **changes: list[object]) -> list[Sweep]:
    """A sweep of one value for each sample, with its largest slip speed and other figures of its summary."""
    rows = [dict(zip(changes, each)) for each in zip(*changes.values())] if changes else [{}] * len(values)
    return [with_fields(MADE, curve=Curve(SYSTEM, KINETIC, (0.24,)), points=[with_fields(FULL, summary=with_fields(
        GIVEN, max_slip_speed=x, **row))]) for x, row in zip(values, rows)]


def test_quantiles_leave_out_what_ran_away_or_has_not_settled() -> None:
    tolerances = Tolerances(((KINETIC, 0.2, 0.3),), 4, 0, (0.0, 0.5, 1.0))
    sweeps = made([1.0, 2.0, 4.0, 8.0], runaway=[False, False, False, True], transient=[True, False, False, False])
    some, every = Scattered(tolerances, "", sweeps), Scattered(tolerances, "", sweeps, True)
    assert some.quantiles("max_slip_speed").tolist() == [[2.0, 3.0, 4.0]]
    assert every.quantiles("max_slip_speed").tolist() == [[1.0, 3.0, 8.0]]
    assert some.quantiles("runaway").tolist() == every.quantiles("runaway").tolist() == [[0.0, 0.0, 1.0]]
    assert (some.left_out, every.left_out) == ({"runaway": 1, "not_settled": 1}, {"runaway": 0, "not_settled": 0})
    assert some.order_quantiles["slip_speed"][:, 0].tolist() == [[1.0] * 3, [3.0] * 3]
    assert np.isnan(some.order_quantiles["slip_speed"][1, 1]).all()
    assert some.order_quantiles["shaft_torque"][1, 1].tolist() == [40.0] * 3
    assert list(some.all_quantiles) == [name for name in FIGURES if name in NUMBERS]
    assert some.all_quantiles["judder_rms"].tolist() == [4.0] * 3
    assert repr(some) == f"<Scattered {KINETIC}: 4 samples>"
    swept = with_fields(some, over="pressure.mean")
    assert repr(swept) == f"<Scattered {KINETIC}: 4 samples over pressure.mean, 1 values>"
    assert swept.all_quantiles["max_slip_speed"].tolist() == [[2.0, 3.0, 4.0]]
    assert swept.order_quantiles["slip_speed"].shape == (1, 2, 2, 3)
    assert (some.curve, swept.curve) == (None, sweeps[0].curve)
    assert (some.lists["max_slip_speed"], swept.lists["max_slip_speed"]) == ([1.0, 2.0, 4.0, 8.0], [[1.0], [2.0],
        [4.0], [8.0]])
    table = swept.columns()
    assert list(table)[:1] == [KINETIC]
    assert table[KINETIC].tolist() == tolerances.sampled[KINETIC].tolist()
    lost = [with_fields(each, points=[None]) for each in sweeps]
    assert np.isnan(Scattered(tolerances, "", lost).quantiles("max_slip_speed")).all()
    assert Scattered(tolerances, "", lost).order_quantiles is None
    assert (Scattered(tolerances, "", lost).sampled, some.sampled) == (False, True)
    runup = load_scene("runup").system
    away = [with_fields(each, curve=Curve(runup, KINETIC, (0.24,))) for each in sweeps]
    moving = Scattered(tolerances, "", away)
    assert (moving.manoeuvre, some.manoeuvre) == (True, False)
    assert moving.left_out == {"runaway": 1, "not_settled": 0}
    assert moving.quantiles("max_slip_speed").tolist() == [[1.0, 2.0, 4.0]]


def test_samples_have_their_own_values_of_every_scattered_key() -> None:
    tolerances = Tolerances(((KINETIC, 0.2, 0.3), ("pressure.mean", 2e5, 3e5)), 4, 1)
    kinetic, pressure = tolerances.sampled.values()
    alone, over = scattered_curves(SYSTEM, tolerances), scattered_curves(SYSTEM, tolerances, "engine.frequency",
        [1.0, 2.0])
    assert [(c.key, c.values, c.system.pressure.mean) for c in alone] == [
        (KINETIC, (k,), p) for k, p in zip(kinetic, pressure)]
    assert [(c.key, c.values, c.system.pressure.mean, c.system.friction.kinetic) for c in over] == [
        ("engine.frequency", (1.0, 2.0), p, k) for k, p in zip(kinetic, pressure)]


def test_values_of_the_room_do_not_change() -> None:
    assert changeable("sweeps") == []
