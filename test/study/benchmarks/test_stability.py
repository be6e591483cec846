"""The stability report: its criteria against closed forms, a handful of extreme cases, the limits, files as promised.
"""

import dataclasses
import json
import math
from types import SimpleNamespace

import pytest
from documents import same_pictures, valid
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from tcc_sim.cli import main
from tcc_sim.model.parameters import System, replace
from tcc_sim.result import json_of
from tcc_sim.solvers.comparison.runge_kutta import rk4_limit
from tcc_sim.study.benchmarks import extremes, references, stability, worst_cases
from tcc_sim.views import style


def test_the_grid_is_large_different_and_has_every_value_alone():
    result = extremes.extreme_cases(420)
    assert len({repr(sorted(keys.items())) for keys in result}) == 420
    alone = [{}, *({key: value} for key, values in extremes.RANGES.items() for value in values)]
    for keys in map(extremes.case_of, [*alone, *extremes.grazing(), *extremes.command_steps()]):
        system = replace(System(), extremes.scene_keys(keys))
        assert keys in result or system.natural_frequency * system.cycle > extremes.LONGEST == 3000.0
    assert max(keys.get("cycles", 0) for keys in result) == extremes.MANY
    assert max(keys.get("tick", 0.0) for keys in result) == 1.0


CASES = [{}, {"friction.kinetic_coefficient": 0.075, "friction.smoothing": 1e9},
         {"share": 1.5, "pressure.phase": math.pi}, {"pressure.mean": 0.0},
         {"engine.frequency": 5000.0, "initial.slip_speed": 1e4}, extremes.grazing()[2], {"tick": 5e-3}]


@pytest.mark.parametrize("keys", CASES, ids=lambda keys: ",".join(keys) or "base")
def test_extreme_cases_keep_the_criteria(keys):
    keys = extremes.case_of(keys)
    for engine, (law, _) in extremes.ENGINES.items():
        result = extremes.examine(keys, engine, extremes.Truth(keys, law))
        assert result.status == "DONE", result
        assert result.finite is True
        assert result.bounded is True
        assert result.iterations_max <= result.iterations_bound
        if engine == "fixed_step":
            assert (result.iterations_max > 0) is (keys.get("pressure.mean") != 0.0)
        assert result.power_residual < 5e-3
        assert result.error < {"smoothed": 1e-5, "event_driven": 1e-6, "fixed_step": 0.02}[engine]


def test_what_an_engine_cannot_do_is_refused_with_a_reason():
    keys = extremes.case_of({"driveline.plate_inertia": 1e-6, "friction.kinetic_coefficient": 0.15})
    result = extremes.examine(keys, "fixed_step", extremes.Truth(keys, "smoothed"))
    assert result.status == "REFUSED"
    assert "sub-steps" in result.why


def test_a_run_that_stops_within_its_first_cycle_can_be_written(monkeypatch):
    """Without a step there is no cycle for a power balance."""
    monkeypatch.setattr("tcc_sim.solvers.event_driven.solve.STEP_MAXIMUM", 4)
    result = extremes.examine(extremes.case_of({}), "event_driven", SimpleNamespace(why="not asked for"))
    assert (result.status, result.finite, result.power_residual) == ("STEP_LIMIT", True, None)
    json.dumps(json_of(result), allow_nan=False)


def test_the_limits_are_the_theoretical_ones():
    system = replace(System(), {"pressure.amplitude": 0.0})
    load, beta = 500.0, 55.0
    assert rk4_limit(system) == pytest.approx(2.785 / (beta * load * 1.25 * 50.0))
    sharp = replace(system, {"friction.smoothing": 1e9})
    assert stability.uniqueness_limit(sharp) == pytest.approx(1.0 / (beta * load * 2.0 * 0.25), rel=1e-3)
    assert stability.uniqueness_limit(replace(system, {"friction.kinetic_coefficient": 0.3})) is None


def test_the_largest_errors_have_their_reasons():
    """The smoothed law's distance from the set-valued one falls as 1/sigma; fixed_step leaves stick at some steps. The
    end of slip is SciPy's, the speed of the largest friction is that of a search.
    """
    sharp = extremes.case_of({
        "initial.slip_speed": 1e-9, "friction.kinetic_coefficient": 0.1, "friction.decay": 50.0,
        "friction.smoothing": 1e6, "pressure.mean": 100.0, "driveline.flywheel_inertia": 1000.0,
        "driveline.stiffness": 1e5, "pressure.phase": 0.5 * math.pi})
    stick = extremes.case_of({"friction.kinetic_coefficient": 0.075, "engine.mean_torque": 0.0,
                              "engine.torque_amplitude": 1000.0, "pressure.amplitude": 52083.33333333334})
    stick["pressure.amplitude"] = 52083.33333333334
    records = [extremes.Examined(sharp, "smoothed", None, error=8.7e-4),
               extremes.Examined(stick, "fixed_step", 1e-3, error=0.28)]
    law = references.Law(replace(System(), stick))
    run = solve_ivp(lambda t, y: law.rates(t, y, 3), (0.0, 0.08), [5.0, 0.0, 0.0], "LSODA", rtol=1e-9, atol=1e-9,
                    events=lambda t, y: y[0])
    t, y = run.t_events[0][-1], run.y_events[0][-1]
    peak = minimize_scalar(lambda v: -math.tanh(50.0 * v) * (1.0 + 3.0 * math.exp(-2.0 * v)), bounds=(0.0, 1.0),
                           method="bounded", options={"xatol": 1e-9}).x
    share = abs(law.need(t, y)) / (4.0 * law.load(t))
    assert worst_cases.reasons(records) == [
        "`smoothed`, 9e-04: the distance of two friction laws, not an error of the engine. Above sigma = 100000 the "
        "reference solves the set-valued law. At 10 and 100 times sigma it is 7e-05 and 5e-06; with a tolerance of "
        "1e-11 it is 9e-04.",
        "`fixed_step`, 3e-01: with steps of 0.001, 0.0002, 0.0001, 2e-05, 1e-05 s the error is 3e-01, 8e-06, 3e-01, "
        f"3e-01, 2e-06, so it does not shrink with the step. At t = {t:.4g} s slip stops, and stick needs "
        f"{100.0 * share:.0f} % of the breakaway torque. Past v = 0 a sub-step of the fixed step ends at -0.14 rad/s, "
        f"beyond the {peak:.2g} rad/s at which friction (7) is largest: the clutch slips on instead of sticking. Where "
        "a sub-step ends decides which, at any step."]
    slower = dataclasses.replace(records[0], keys={**sharp, "friction.smoothing": 1e5})
    assert worst_cases.reasons([slower, dataclasses.replace(records[1], error=None)]) == []
    truth = extremes.Truth(stick, "smoothed")
    assert worst_cases.final_error(stick, "smoothed", truth) < 1e-6


@pytest.fixture
def tiny(monkeypatch):
    """A report of three scenes and charts of two cells."""
    monkeypatch.setattr(stability, "QUICK_COUNT", 3)
    for table, kept in ((stability.OVER, slice(1, 3)), (stability.METHODS, slice(-4, None))):
        for name, values in tuple(table.items()):
            monkeypatch.setitem(table, name, values[kept])


def test_the_command_writes_what_it_promises(tiny, tmp_path, capsys, figures):
    folder = tmp_path / "out"
    assert main(["stability", "--quick", "--width", "column", "--out", str(folder)]) == 0
    document = valid("stability", json.loads((folder / "stability.json").read_text()))
    assert len(document["cases"]) == 9
    assert set(document["summary"]) == set(extremes.ENGINES)
    assert all(total["not_finite"] == total["not_bounded"] == 0 for total in document["summary"].values())
    assert len(document["charts"]) == 3 * len(stability.METHODS) - 1
    assert {c["method"] for c in document["charts"]} >= {"smoothed", "event_driven"}
    assert {"stability.png", "stability.svg"} <= {path.name for path in folder.iterdir()}
    words = ["plot", str(folder / "stability.json"), "--plot", str(tmp_path / "again.png"), "--width", "column"]
    assert main(words) == 0
    assert len(same_pictures(figures, style.COLUMN)) > 4
    assert (folder / "stability.md").read_text().count("\n## ") == 4
    assert "not finite" in capsys.readouterr().out
