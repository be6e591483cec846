"""Stiff and extreme scenes: the command's rows by its criteria, criteria against closed forms, tables by hand."""

import json
import math

import numpy as np
import pytest
from documents import same_pictures, valid
from independent import smoothed_states
from pictures import labelled, shows

from tcc_sim.cli import main
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks import stability
from tcc_sim.trajectory import Trajectory


def test_the_undamped_grazing_motions_stick_up_to_the_breakaway_torque():
    """(10) by hand: the largest torque of stick, Tm + Tp (K23 - I2 w^2)/(K23 - (I1 + I2) w^2), is mu_s N R."""
    largest = 300.0 + 100.0 * (3000.0 - 0.02 * 3600.0) / (3000.0 - 0.22 * 3600.0)
    for keys in stability.grazing():
        system = replace(System(), {**stability.case_of(keys), "friction.law": "set_valued"})
        run = solve(system, cycles=2)
        breaks = 0.3 * 0.008 * system.pressure.mean < largest
        assert (float(run.solved_cycles.largest.max()) > 0.0) == breaks


@pytest.mark.parametrize(("keys", "status"), [
    ({"friction.kinetic_coefficient": 0.075, "friction.smoothing": 1e9}, "DONE"),
    ({"share": 1.5, "pressure.phase": math.pi, "tick": 5e-3}, "DONE"),
    ({"driveline.plate_inertia": 1e-6, "friction.kinetic_coefficient": 0.15}, "REFUSED")])
def test_a_fixed_step_keeps_the_criteria_or_is_refused_with_a_reason(keys, status):
    keys = stability.case_of(keys)
    row = stability.examine(keys, "fixed_step", stability.truth_of(keys, "smoothed"))
    assert (row["status"], bool(row["why"]), stability.failed(row)) == (status, status == "REFUSED", False)
    if status == "DONE":
        assert row["error"] < 0.02


def test_an_error_is_that_of_the_final_state_beside_an_independent_solution():
    """Two cycles of the base case by LSODA at 2000 samples each; the error is relative to each signal's largest."""
    keys = stability.case_of({})
    system, step = replace(System(), stability.scene_keys(keys)), System().cycle / math.ceil(System().cycle / 1e-3)
    i = system.initial
    states = smoothed_states(system, [i.slip_speed, i.plate_angle, i.plate_speed, 0.0], 2, 2000)[:, :3]
    end = solve(system, cycles=2, solver="fixed_step", step=step).solved_cycles.section[-1]
    expected = (np.abs(end - states[-1]) / np.abs(states).max(axis=0)).max()
    row = stability.examine(keys, "fixed_step", stability.truth_of(keys, "smoothed"))
    assert row["error"] == pytest.approx(expected, rel=1e-2)


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
    return system, Trajectory(t, scale * v, states[:, 1], scale * states[:, 2], torque, load, work * friction,
                              np.zeros(len(t), dtype=int), solver="by SciPy", system=system, cycle=system.cycle)


def test_power_and_energy_of_an_independent_solution_and_of_wrong_ones():
    system, right = run_by_hand()
    assert stability.power_residual(system, right) < 1e-5
    assert stability.energy_excess(system, right) < 1e-9
    for wrong in ({"work": 1.01}, {"scale": 1.02}):
        assert stability.power_residual(*run_by_hand(**wrong)) > 1e-3
    assert stability.energy_excess(*run_by_hand(scale=np.append(1.0, np.full(4000, 40.0)))) > stability.SLACK
    d = system.driveline
    stored = 0.5 * (d.flywheel_inertia * (right.slip_speed + right.plate_speed)**2
                    + d.plate_inertia * right.plate_speed**2 + d.stiffness * right.plate_angle**2)
    np.testing.assert_allclose(stability.energy(system, right), stored)


def examined(engine="smoothed", **more):
    given = {"status": "DONE", "finite": True, "bounded": True, "error": 1e-6, "iterations_max": 3,
             "iterations_bound": 20, "power_residual": 1e-7, "seconds": 2.0, **more}
    keys = {"friction.smoothing": 1e6, "engine.frequency": 150.0, "cycles": stability.CYCLES, "solver": engine}
    return {**keys, "step": 1e-3 if engine == "fixed_step" else None, "why": "", **given}


def test_summaries_and_tables_of_rows_by_hand():
    rows = [*(examined(error=10.0**-k, power_residual=None) for k in range(1, 101)), examined(finite=False, error=None),
            examined("fixed_step", status="REFUSED", why="too many sub-steps", error=None, finite=None),
            examined("event_driven", status="STEP_LIMIT", bounded=False, iterations_max=30)]
    assert [stability.failed(row) for row in rows] == [False] * 100 + [True, False, True]
    for more, failed in (({"iterations_max": 20}, False), ({"iterations_max": 21}, True), ({"bounded": False}, True),
                         ({"iterations_max": 21, "iterations_bound": None}, False), ({"status": "STEP_LIMIT"}, True)):
        assert stability.failed(examined(**more)) is failed
    report = stability.report_of(rows, True, False)
    one = report["summary"]["smoothed"]
    names = "cases", "statuses", "not_finite", "without_reference"
    assert [one[name] for name in names] == [101, {"DONE": 101}, 1, 1]
    assert one["error"] == pytest.approx(np.quantile(10.0 ** -np.arange(1.0, 101.0), [0.5, 0.9, 0.99, 1.0]))
    assert one["power_residual"][-1] == pytest.approx(1e-7)
    assert report["summary"]["event_driven"]["not_bounded"] == 1
    lines = [line for line in stability.stability_tables(report).splitlines() if "friction.smoothing" in line]
    cells = [[cell.strip(" `") for cell in line[2:-2].split(" | ")] for line in lines]
    assert [row[:2] for row in cells] == [["smoothed", "DONE"], ["event_driven", "STEP_LIMIT"], ["smoothed", "DONE"], [
        "fixed_step", "REFUSED too many sub-steps"], *(["smoothed", f"1.0e-0{k}"] for k in range(1, 6)), [
        "event_driven", "1.0e-06"]]


def test_the_command_writes_rows_that_keep_the_criteria(tmp_path, pictures, refused):
    folder = tmp_path / "out"
    assert main(["stability", "--quick", "--out", str(folder)]) == 0
    document = valid("stability", json.loads((folder / "stability.json").read_text()), stability.FIELDS)
    assert {path.name for path in folder.iterdir()} == {f"stability.{end}" for end in ("json", "md", "png", "svg")}
    assert set(document["summary"]) == set(stability.ENGINES)
    assert len(document["cases"]) == 3 * stability.QUICK_COUNT
    most = {"smoothed": 1e-5, "event_driven": 1e-6, "fixed_step": 0.02}
    for row in document["cases"]:
        assert {name for name in row if "." not in name} <= {*stability.FIELDS, "cycles"}
        assert (row["status"], row["finite"], row["bounded"]) == ("DONE", True, True), row
        assert row["iterations_max"] <= row["iterations_bound"]
        assert row["power_residual"] < 5e-3
        assert row["error"] < most[row["solver"]]
    errors = [row["error"] for row in document["cases"] if row["solver"] == "smoothed"]
    quantiles = document["summary"]["smoothed"]["error"]
    assert (quantiles[0], quantiles[3]) == (pytest.approx(np.median(errors)), max(errors))
    words = ["plot", str(folder / "stability.json"), "--plot", str(tmp_path / "again.png")]
    assert main(words) == 0
    assert len(same_pictures(pictures, pictures[0].get_figwidth())) > 4
    shares = 100.0 * (np.arange(len(errors)) + 0.5) / len(errors)
    assert shows(pictures[0], shares, np.maximum(np.sort(errors), 1e-17))
    labelled(pictures[0])
    assert str(folder) in refused("stability", "--quick", "--out", folder)
