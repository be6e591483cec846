"""Stiff and extreme scenes: criteria against closed forms, limits by theory, tables by hand, the command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from documents import same_pictures, valid
from pictures import check, shows

from tcc_sim.cli import main
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.explicit import rk4_limit
from tcc_sim.study.benchmarks import peers, precision, stability
from tcc_sim.study.benchmarks.references import smoothed_states
from tcc_sim.trajectory import Trajectory


def test_the_grid_is_large_different_and_has_every_value_alone():
    result = stability.extreme_cases(420)
    assert len({repr(sorted(keys.items())) for keys in result}) == 420
    alone = [{}, *({key: value} for key, values in stability.RANGES.items() for value in values)]
    for keys in map(stability.case_of, [*alone, *stability.grazing(), *stability.command_steps()]):
        system = replace(System(), stability.scene_keys(keys))
        assert keys in result or system.natural_frequency * system.cycle > stability.LONGEST
    assert max(keys.get("cycles", 0) for keys in result) == stability.MANY


CASES = [{}, {"friction.kinetic_coefficient": 0.075, "friction.smoothing": 1e9},
         {"share": 1.5, "pressure.phase": math.pi}, {"pressure.mean": 0.0},
         {"engine.frequency": 5000.0, "initial.slip_speed": 1e4}, stability.grazing()[2], {"tick": 5e-3}]


@pytest.mark.parametrize("keys", CASES, ids=lambda keys: ",".join(keys) or "base")
def test_extreme_cases_keep_the_criteria(keys):
    keys = stability.case_of(keys)
    for engine, (law, _) in stability.ENGINES.items():
        result = stability.examine(keys, engine, stability.Truth(keys, law))
        assert (result.status, result.finite, result.bounded) == ("DONE", True, True), result
        assert result.iterations_max <= result.iterations_bound
        assert result.power_residual < 5e-3
        assert result.error < {"smoothed": 1e-5, "event_driven": 1e-6, "fixed_step": 0.02}[engine]
        assert not stability.ended_badly(result)


def test_the_undamped_grazing_motions_stick_up_to_the_breakaway_torque():
    """(10) by hand: the largest torque of stick, Tm + Tp (K23 - I2 w^2)/(K23 - (I1 + I2) w^2), is mu_s N R."""
    largest = 300.0 + 100.0 * (3000.0 - 0.02 * 3600.0) / (3000.0 - 0.22 * 3600.0)
    for keys in stability.grazing():
        system = replace(System(), {**stability.case_of(keys), "friction.law": "set_valued"})
        run = solve(system, cycles=2)
        breaks = 0.3 * 0.008 * system.pressure.mean < largest
        assert (float(run.solved_cycles.largest.max()) > 0.0) == breaks


def test_a_scene_beyond_an_engine_is_refused_with_a_reason():
    keys = stability.case_of({"driveline.plate_inertia": 1e-6, "friction.kinetic_coefficient": 0.15})
    result = stability.examine(keys, "fixed_step", stability.Truth(keys, "smoothed"))
    assert result.status == "REFUSED"
    assert result.why
    assert not stability.ended_badly(result)


def run_by_hand(scale=1.0, work=1.0):
    """Two cycles of SciPy's solution at 2000 samples each; `scale` of the speeds, `work` of the friction torque."""
    system = replace(System(), {"friction.smoothing": 20.0})
    states = smoothed_states(system, [5.0, 0.1, 0.0, 0.1], 2, 2000)
    t = np.arange(4001) * system.cycle / 2000
    f, e, p = system.friction, system.engine, system.pressure
    v, torque = states[:, 0], e.mean_torque + e.torque_amplitude * np.sin(e.frequency * t)
    load = system.torque_per_pressure * (p.mean + p.amplitude * np.sin(p.frequency_ratio * e.frequency * t + p.phase))
    friction = load * np.tanh(f.smoothing * v) * (1.0 + (f.static_coefficient / f.kinetic_coefficient - 1.0) * np.exp(
        -f.decay * np.abs(v)))
    zero = np.zeros_like(t)
    return Trajectory(t, scale * v, states[:, 1], scale * states[:, 2], torque, load, work * friction, zero.astype(int),
                      solver="by SciPy", system=system, cycle=system.cycle)


def test_power_and_energy_of_an_independent_solution_and_of_wrong_ones():
    right = run_by_hand()
    assert stability.power_residual(right) < 1e-5
    assert stability.energy_excess(right) < 1e-9
    assert stability.power_residual(run_by_hand(work=1.01)) > 1e-3
    assert stability.power_residual(run_by_hand(scale=1.02)) > 1e-3
    fast = run_by_hand(scale=np.append(1.0, np.full(4000, 40.0)))
    assert stability.energy_excess(fast) > stability.SLACK
    d = right.system.driveline
    stored = 0.5 * (d.flywheel_inertia * (right.slip_speed + right.plate_speed)**2
                    + d.plate_inertia * right.plate_speed**2 + d.stiffness * right.plate_angle**2)
    np.testing.assert_allclose(stability.energy(right), stored)


def test_the_limits_are_the_theoretical_ones():
    system = replace(System(), {"pressure.amplitude": 0.0})
    load, beta = 500.0, 55.0
    assert rk4_limit(system) == pytest.approx(2.785 / (beta * load * 1.25 * 50.0))
    sharp = replace(system, {"friction.smoothing": 1e9})
    assert stability.uniqueness_limit(sharp) == pytest.approx(1.0 / (beta * load * 2.0 * 0.25), rel=1e-3)
    assert stability.uniqueness_limit(replace(system, {"friction.kinetic_coefficient": 0.3})) is None


def test_one_step_a_tick_is_of_third_order_where_slip_lasts():
    system = replace(System(), {"friction.kinetic_coefficient": 0.3, "pressure.mean": 100e3,
                                "pressure.amplitude": 0.0, "initial.slip_speed": 50.0})
    truth = smoothed_states(system, [50.0, 0.0, 0.0, 0.0], 2, 1)[:, :3]
    off = [np.abs(stability.one_step(system, h) - truth)[:, 1].max() for h in (2e-4, 1e-4)]
    assert 6.0 < off[0] / off[1] < 10.0


def examined(engine="smoothed", **more):
    given = {"status": "DONE", "finite": True, "bounded": True, "error": 1e-6, "iterations_max": 3,
             "iterations_bound": 20, "power_residual": 1e-7, "seconds": 2.0, **more}
    keys = {"friction.smoothing": 1e6, "engine.frequency": 150.0, "cycles": stability.CYCLES}
    return stability.Examined(keys, engine, 1e-3 if engine == "fixed_step" else None, **given)


@pytest.mark.parametrize(("more", "bad"), [
    ({}, False), ({"status": "STEP_LIMIT"}, True), ({"status": "REFUSED", "finite": None}, False),
    ({"finite": False}, True), ({"bounded": False}, True), ({"iterations_max": 20}, False),
    ({"iterations_max": 21}, True), ({"iterations_max": 21, "iterations_bound": None}, False)])
def test_a_run_that_ended_badly(more, bad):
    assert stability.ended_badly(examined(**more)) is bad


def test_summaries_and_tables_of_rows_by_hand():
    rows = [*(examined(error=10.0**-k, power_residual=None) for k in range(1, 101)), examined(finite=False, error=None),
            examined("fixed_step", status="REFUSED", why="too many sub-steps", error=None),
            examined("event_driven", bounded=False, iterations_max=30)]
    total = stability.engine_summaries(rows)
    one = total["smoothed"]
    assert (one.cases, one.statuses, one.not_finite, one.without_reference) == (101, {"DONE": 101}, 1, 1)
    values = 10.0 ** -np.arange(1.0, 101.0)
    assert [*vars(one.error).values()] == pytest.approx(np.quantile(values, [0.5, 0.9, 0.99, 1.0]))
    assert one.power_residual.max == pytest.approx(1e-7)
    assert (total["event_driven"].not_bounded, total["event_driven"].past_iteration_bound) == (1, 1)
    text = stability.stability_tables(stability.StabilityReport(rows, total, [], True, False))
    assert "Interrupted" in text
    assert "too many sub-steps" in text
    assert text.count("| DONE | friction.smoothing 1000000.0 |") == 2  # Not finite, and past two bounds.
    assert text.count("| `smoothed` | 1.0e-0") == 5  # The five largest errors.


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The quick report."""
    folder = tmp_path_factory.mktemp("report") / "out"
    assert main(["stability", "--quick", "--out", str(folder)]) == 0
    return folder


def test_the_command_writes_what_it_promises(folder, tmp_path, pictures):
    document = valid("stability", json.loads((folder / "stability.json").read_text()))
    assert {path.name for path in folder.iterdir()} == {f"stability.{end}" for end in ("json", "md", "png", "svg")}
    assert set(document["summary"]) == set(stability.ENGINES)
    assert len(document["cases"]) == 3 * stability.QUICK_COUNT
    assert all(total["not_finite"] == total["not_bounded"] == 0 for total in document["summary"].values())
    rows = [r["error"] for r in document["cases"] if r["solver"] == "smoothed" and r["error"] is not None]
    one = document["summary"]["smoothed"]["error"]
    assert (one["median"], one["max"]) == (pytest.approx(np.median(rows)), max(rows))
    for chart in document["charts"]:
        assert np.shape(chart["errors"]) == (len(chart["values"]), len(chart["steps"]))
    for _ in range(2):
        words = ["plot", str(folder / "stability.json"), "--plot", str(tmp_path / "again.png")]
        assert main([*words, "--force"]) == 0
    assert len(same_pictures(pictures, pictures[0].get_figwidth())) > 4
    shares = 100.0 * (np.arange(len(rows)) + 0.5) / len(rows)
    assert shows(pictures[0], shares, np.maximum(np.sort(rows), 1e-17))
    check(pictures[0])


def test_errors_of_the_charts_are_those_of_an_independent_solution(folder):
    """One cell for a method: the section error of the first value at the first step."""
    document = json.loads((folder / "stability.json").read_text())
    cells = {(c["method"], c["over"]): c for c in document["charts"]}
    for method, setting in (("smoothed", "rtol"), ("fixed_step", "step")):
        chart = cells[method, "friction.smoothing"]
        k, h = 0, chart["steps"][-1]
        system = replace(System(), {**stability.SCENE, "friction.smoothing": chart["values"][k]})
        truth = smoothed_states(system, [5.0, 0.0, 0.0, 0.0], 2, 500)[:, :3]
        section = solve(system, cycles=2, solver=method, **{setting: h}).solved_cycles.section
        off = np.abs(section - truth[::500]) / np.abs(truth[500:]).max(axis=0)
        assert chart["errors"][k][-1] == pytest.approx(off.max(), rel=0.02)


def test_an_existing_directory_is_refused(tmp_path, refused):
    assert str(tmp_path) in refused("stability", "--quick", "--out", tmp_path)


def test_the_prose_of_both_pages_has_the_numbers_of_the_code():
    pages = Path(__file__).resolve().parents[3] / ".github" / "internals"
    text = {name: " ".join((pages / f"{name}.md").read_text().split()) for name in ("precision", "stability")}
    assert f"solve {stability.COUNT} scenes each" in text["stability"]
    assert f"{stability.MANY} cycles" in text["stability"]
    assert f"sigma = {stability.SHARPEST:.0e}".replace("+0", "") in text["stability"]
    assert f"{precision.FULL.cycles} periods of excitation from a settled state" in text["precision"]
    assert f"that of {peers.TIMED} cycles less that of one" in text["precision"]
