"""Rows of the reports from solvers made up here: scene, solver, setting and horizon of each, and its result."""

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from described import expected

from tcc_sim.compiling import numba_registration
from tcc_sim.errors import NumericalFailure, OutOfRange
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import Status
from tcc_sim.study.benchmarks import extremes, peers, stability, work_precision, worst_cases
from tcc_sim.study.benchmarks.precision_report import TARGETS, Omitted, References, SteadyState, StudiedScene
from tcc_sim.study.benchmarks.references import Reference, Unfinished
from tcc_sim.study.benchmarks.work_precision import Case, Effort

GRIDS = {work_precision: "FULL QUICK LONG_RUN LONG_RUN_SCENES SETTLING TIGHTEST STEADY_SOLVERS SECONDS_PER_STEP "
                         "LONGEST_STEADY REPEATS",
         extremes: "ENGINES BASE RANGES PAIRS", stability: "COUNT QUICK_COUNT CYCLES SCENE OVER METHODS",
         worst_cases: "STEPS"}
CASE = Case("fig02", "", System(), 5)
EFFORT = Effort(5, 0.5, 10.0, {}, {}, {"CVODE": (1e-8,), "XPPAUT gear": (1e-6,), "numbalsoda": (1e-7,),
                                       "solve_ivp LSODA": (1e-5,)}, 2000, 100)


def studied(expected_slip=4.0):
    return StudiedScene("fig02", "", "smoothed", 5, References([], 1e-8), SteadyState(400, 1, expected_slip, 1e-6, []))


def test_scenes_tolerances_and_steps_are_those_of_their_page():
    """The table of what the reports measure; arrays with four digits."""
    lines = [f"{name} = " + json.dumps(getattr(module, name), default=lambda x: (
        vars(x) if dataclasses.is_dataclass(x) else [float(f"{v:.4g}") for v in x]))
        for module, names in GRIDS.items() for name in names.split()]
    assert [*lines, f"TARGETS = {json.dumps(TARGETS)}"] == expected(Path(__file__).with_name("pages.txt"), "grids")


def test_scenes_of_the_study(monkeypatch):
    monkeypatch.setattr(Case, "settled", lambda case: dataclasses.replace(case, scene=System()))
    found = work_precision.cases(EFFORT)
    assert [(case.name, case.cycles, case.scene is not None, case.system.friction.law) for case in found] == [
        *((name, 5, True, "smoothed") for name in ("fig02", "minimal", "steep", "stiff")),
        *((f"{name}, set-valued", 5, True, "set_valued") for name in ("fig02", "minimal", "steep")),
        ("fig02 from its initial state", 5, False, "smoothed")]
    base, _, steep, stiff = (case.system for case in found[:4])
    assert base == found[-1].system == load_scene("fig02").system
    assert found[1].system == load_scene("minimal").system
    assert steep == replace(base, {"friction.kinetic_coefficient": 0.15, "engine.mean_torque": 100.0,
                                   "engine.torque_amplitude": 400.0})
    assert stiff == replace(base, {"friction.smoothing": 1e4})
    few = work_precision.cases(dataclasses.replace(EFFORT, scenes=("minimal", "steep, set-valued")))
    assert [case.name for case in few] == ["minimal", "steep, set-valued"]


def test_the_study_solves_references_steady_state_settings_and_long_run(monkeypatch):
    sets = {"smoothed": (("Radau", 1e-9), ("LSODA", 1e-13)), "set_valued": (("DOP853", 1e-13), ("LSODA", 1e-12))}
    effort = dataclasses.replace(EFFORT, references=sets, ladders={"bdf": (1e-3, 1e-4), "event_driven": (1e-6,)},
                                 peers={}, further=2)
    falling = dataclasses.replace(CASE.set_valued(), scene=System())
    done, asked = [], []
    size = np.ones(3)
    monkeypatch.setattr(work_precision, "cases", lambda effort: [CASE, falling])
    monkeypatch.setattr(work_precision, "reference", lambda system, cycles, method, rtol: Reference(
        f"{method} {rtol:g} {cycles}", np.full((2, 3), 1e6 * rtol), np.zeros(1), size))
    monkeypatch.setattr(work_precision, "steady_reference", lambda *task: task)
    monkeypatch.setattr(work_precision, "record_run", lambda record, case, solver, setting, truth, effort: (
        asked.append((case.name, solver, setting, truth.name)), record.results.append(peers_result(solver, setting))))
    monkeypatch.setattr(work_precision, "long_run", lambda record, *task: record.warm_up.update({"long": len(asked)}))

    def peers_result(solver, setting):
        return SimpleNamespace(solver=solver, setting=setting, largest_error=setting)

    first, second = work_precision.precision_study(effort, lambda *now: done.append(now))
    assert (first.scene, first.law, first.cycles, first.warm_up) == ("fig02", "smoothed", 5, {"long": 4})
    assert second.law == "set_valued"
    assert first.reference == References(["Radau 1e-09 5", "LSODA 1e-13 5"], pytest.approx(1e-3, rel=1e-3))
    assert first.steady == (CASE.system, 100, "Radau", 1e-9)
    assert second.steady == (System(), 100, "DOP853", 1e-13)
    assert asked == [*(("fig02", "bdf", h, "Radau 1e-09 5") for h in (1e-3, 1e-4, 1e-5, 1e-6)),
                     ("fig02, set-valued", "event_driven", 1e-6, "DOP853 1e-13 5")]
    assert [(n, total, text.partition(": ")[2]) for n, total, text in done] == [
        (0, 9, "reference Radau"), (1, 9, "reference LSODA"), (2, 9, "steady state"), (3, 9, "bdf 0.001"),
        (4, 9, "bdf 0.0001"), (5, 9, "bdf 1e-05, beyond its ladder"), (5, 9, "bdf 1e-06, beyond its ladder"),
        (5, 9, "reference DOP853"), (6, 9, "reference LSODA"), (7, 9, "steady state"), (8, 9, "event_driven 1e-06"),
        (9, 9, "")]


class Solves:
    """Stands in for `solve`: notes what is asked for, and returns cycles with slip up to 5 rad/s and 7 steps."""

    def __init__(self, *ends):
        self.asked, self.ends = [], list(ends)

    def __call__(self, system, **how):
        self.asked.append(how)
        if self.ends and (end := self.ends.pop(0)) is not None:
            raise end
        count = how.get("cycles", 1)
        run = SimpleNamespace(section=np.zeros((count + 1, 3)), largest=np.full(count, 5.0))
        result = SimpleNamespace(solved_cycles=run, statistics=SimpleNamespace(steps=7))
        result.raise_for_status = lambda: result
        return result


def test_a_registered_solver_is_warmed_up_once_and_repeated(monkeypatch):
    """rk4 holds its step; dop853 is held to 6/(beta Ts r sigma) = 6/(55 * 600 * 1.25 * 50) s."""
    solves, repeats = Solves(), []
    monkeypatch.setattr(work_precision, "solve", solves)
    monkeypatch.setattr(work_precision, "repeated", lambda run, *limits: (
        repeats.append(limits), ([3.0, 2.0, 5.0][:limits[0]], run()))[1])
    record = studied()
    for _ in range(2):
        run = work_precision._registered(record, CASE, "bdf", 1e-5, EFFORT)
    assert (run.seconds, run.slowest, run.steps, len(run.section), run.largest[0]) == (2.0, 5.0, 7, 6, 5.0)
    assert record.warm_up == {"bdf": 3.0}
    assert solves.asked == [{"duration": 1e-3 * System().cycle, "solver": "bdf"},
                            *[{"cycles": 5, "solver": "bdf", "rtol": 1e-5}] * 2]
    assert repeats == [(1,), (9, 0.5), (9, 0.5)]
    longest = 5 * System().cycle / (6.0 / (55.0 * 600.0 * 1.25 * 50.0)) * 1.6e-4
    for limit, refused in ((1.01 * longest, False), (0.99 * longest, True)):
        work_precision.record_run(record, CASE, "dop853", 1e-6, Reference("", np.zeros((6, 3)), np.full(5, 5.0),
                                                                          np.ones(3)),
                                  dataclasses.replace(EFFORT, longest=limit))
        assert [row.why for row in record.omitted] == ([
            "explicit: stability holds its step below 2.9e-06 s, 7.2e+04 steps in stick, which takes about 12 s"]
            if refused else [])
    work_precision.record_run(record, CASE, "rk4", 1e-8, None, dataclasses.replace(EFFORT, longest=6.0))
    assert record.omitted[-1].why == ("explicit: stability holds its step below 1e-08 s, 2.1e+07 steps in stick, which "
                                      "takes about 6.3 s")


def test_a_failure_is_listed_with_its_reason(monkeypatch):
    monkeypatch.setattr(work_precision, "solve", Solves(None, NumericalFailure("stopped at t = 1 s")))
    record = studied()
    work_precision.record_run(record, CASE, "bdf", 1e-5, None, EFFORT)
    assert (record.results, record.omitted) == ([], [Omitted("bdf", 1e-5, "stopped at t = 1 s")])


def test_the_steady_error_is_measured_where_it_does_not_take_too_long(monkeypatch):
    """Of 100 cycles from the own initial state, at most 0.05 * 10 s; another program's time is not repeated."""
    solves, asked = Solves(), []
    run = peers.PeerRun(np.zeros((101, 3)), np.full(100, 6.0), 1.0, 1.0)
    monkeypatch.setattr(work_precision, "solve", solves)
    monkeypatch.setattr(work_precision, "_peer", lambda case, *task, **how: asked.append((case, task, how)) or run)
    case = dataclasses.replace(CASE, scene=replace(System(), {"friction.decay": 1.0}))

    def error(solver, seconds, slip=4.0):
        return work_precision._steady(studied(slip), case, solver, 1e-8, seconds, EFFORT)

    assert [error("smoothed", 0.5 / 20.0 * x) for x in (1.0, 1.001)] == [pytest.approx(0.25), None]
    assert solves.asked == [{"cycles": 100, "solver": "smoothed", "rtol": 1e-8}]
    assert error("CVODE", 0.0) == pytest.approx(0.5)
    assert [(c.system, c.cycles, task, how) for c, task, how in asked] == [
        (case.scene, 100, ("CVODE", 1e-8), {"repeats": 0})]
    assert error("bdf", 0.0) is None
    assert error("smoothed", 0.0, None) is None


def test_programs_are_called_by_their_names(monkeypatch):
    for name in ("xppaut", "cvode", "numbalsoda", "bare_lsoda"):
        monkeypatch.setattr(peers, name, lambda *task, name=name: (name, *task[1:]))
    assert [work_precision._peer(CASE, name, 1e-8) for name in EFFORT.peers] == [
        ("cvode", 5, 1e-8, 5), ("xppaut", "gear", 1e-8, 5, 5), ("numbalsoda", 5, 1e-8, 5), ("bare_lsoda", 5, 1e-8, 5)]
    assert work_precision._peer(CASE, "CVODE", 1e-8, repeats=0) == ("cvode", 5, 1e-8, 0)


@pytest.mark.parametrize(("quick", "count"), [(True, 36), (False, 420)])
def test_every_case_meets_every_engine(quick, count, monkeypatch):
    counts, done = [], []
    monkeypatch.setattr(stability, "extreme_cases", lambda count: counts.append(count) or ["one", "two"])
    monkeypatch.setattr(stability, "Truth", lambda keys, law: f"{keys} {law}")
    monkeypatch.setattr(stability, "examine", lambda *task: task)
    assert list(stability.grid(quick, lambda *now: done.append(now))) == [
        (keys, engine, f"{keys} {law}") for keys in ("one", "two") for engine, law in (
            ("smoothed", "smoothed"), ("event_driven", "set_valued"), ("fixed_step", "smoothed"))]
    assert counts == [count]
    assert done == [(0, 2, "extreme scenes"), (1, 2, "extreme scenes")]


@pytest.mark.parametrize(("quick", "each"), [(True, 3), (False, 1)])
def test_charts_have_a_row_per_value_and_a_column_per_step(quick, each, monkeypatch):
    """Every third one of a quick report; the pressure swings by a fifth; the law (6) has no sigma."""
    done = []
    monkeypatch.setattr(stability, "OVER", {"friction.smoothing": np.array([50.0, 60.0, 70.0, 80.0]),
                                            "pressure.mean": np.array([1e4, 2e4, 3e4, 4e4])})
    monkeypatch.setattr(stability, "METHODS", dict.fromkeys(("rk4", "event_driven", "smoothed"),
                                                            np.array([1e-3, 2e-3, 3e-3, 4e-3])))
    monkeypatch.setattr(stability, "_truth", lambda system: system)
    monkeypatch.setattr(stability, "_error", lambda system, method, step, truth: (
        system.friction.smoothing, system.pressure.mean, system.pressure.amplitude, system.friction.law,
        truth.friction.law, method, step))
    monkeypatch.setattr(stability, "rk4_limit", lambda system: system.friction.smoothing)
    monkeypatch.setattr(stability, "uniqueness_limit", lambda system: system.pressure.mean)
    charts = stability.error_charts(quick, done.append)
    assert [(chart.over, chart.method) for chart in charts] == [
        ("friction.smoothing", "rk4"), ("friction.smoothing", "smoothed"), ("pressure.mean", "rk4"),
        ("pressure.mean", "event_driven"), ("pressure.mean", "smoothed")]
    default, steps = System(), [1e-3, 2e-3, 3e-3, 4e-3][::each]
    for chart in charts:
        sigma = chart.over == "friction.smoothing"
        values = ([50.0, 60.0, 70.0, 80.0] if sigma else [1e4, 2e4, 3e4, 4e4])[::each]
        law = "set_valued" if chart.method == "event_driven" else "smoothed"
        assert (chart.values, chart.steps) == (values, steps)
        assert chart.errors == [[(
            x if sigma else 50.0, default.pressure.mean if sigma else x,
            pytest.approx(default.pressure.amplitude if sigma else 0.2 * x), law, law, chart.method, h) for h in steps]
            for x in values]
        assert chart.limits == {"rk4": values if sigma else [50.0] * len(values),
                                "uniqueness": [default.pressure.mean] * len(values) if sigma else values}
    count = len(steps)
    assert done == [text for key in ("friction.smoothing", "pressure.mean") for text in (
        *(f"reference at {key} {n + 1}/{count}" for n in range(count)),
        *(f"{method} over {key}" for method in ("rk4", "event_driven", "smoothed")))]


def test_the_truth_of_a_chart_is_that_of_its_law(monkeypatch):
    monkeypatch.setattr(stability, "reference", lambda system, *how: (system.friction.law, *how))
    assert [stability._truth(replace(System(), keys)) for keys in (
        {"friction.smoothing": 1e5}, {"friction.smoothing": 1.001e5}, {"friction.law": "set_valued"})] == [
        ("smoothed", 2, "LSODA", 1e-10), *[("set_valued", 2, "DOP853", 1e-11)] * 2]

    def fails(*task):
        raise Unfinished

    monkeypatch.setattr(stability, "reference", fails)
    assert stability._truth(System()) is None


def test_an_error_of_a_chart_is_that_of_the_section(monkeypatch):
    """None after a failure, without a reference, and where it is not a number."""
    truth = Reference("", np.zeros((3, 3)), np.zeros(2), np.array([4.0, 1.0, 1.0]))
    section = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 0.25]])
    runs, asked = [], []
    monkeypatch.setattr(stability, "one_step", lambda system, step: step * section)
    monkeypatch.setattr(stability, "solve", lambda system, **how: asked.append(how) or runs.pop(0)())

    def run(status=Status.DONE, cycles=True, factor=1.0):
        return SimpleNamespace(status=status, cycles=SimpleNamespace(section=factor * section) if cycles else None)

    def refused():
        raise OutOfRange("too many sub-steps")

    runs += [run, refused, lambda: run(Status.NOT_FINITE), lambda: run(cycles=False), lambda: run(factor=math.nan)]
    assert [stability._error(System(), "rk4", 1e-3, truth) for _ in range(5)] == [0.5, None, None, None, None]
    assert asked == [{"cycles": 2, "solver": "rk4", "step": 1e-3}] * 5
    assert stability._error(System(), "SDIRK3, one step", 0.5, truth) == 0.25
    assert stability._error(System(), "SDIRK3, one step", 0.5, None) is None


def test_one_step_has_equal_steps_within_each_cycle(monkeypatch):
    asked, cycle = [], System().cycle
    monkeypatch.setattr(stability, "advance", lambda state, *task: asked.append(task[:3]) or state.__iadd__(1.0))
    section = stability.one_step(System(), 0.4 * cycle)
    assert section.tolist() == [[150.0 + n, n, n] for n in range(3)]
    assert asked == [(n * cycle, cycle / 3.0, 3) for n in range(2)]
    for step, count in ((cycle, 1), (cycle / 4.0, 4), (2.0 * cycle, 1)):
        stability.one_step(System(), step)
        assert asked[-1] == (cycle, cycle / count, count)


@pytest.mark.parametrize(("keys", "engine", "cycles", "step", "samples", "solved"), [
    # 2 cycles or 30 rad of the natural frequency; a sample every 0.008 rad, 20 before slip stops at 1/(55 r Ts) s.
    ({"initial.slip_speed": 0.1}, "smoothed", 2, None, 2027, [2, None]),
    ({"initial.slip_speed": 0.1, "cycles": 300}, "event_driven", 300, None, 2027, [300, None]),
    ({"initial.slip_speed": 0.1, "driveline.stiffness": 3.0}, "smoothed", 59, None, 64, [59, None]),
    ({"initial.slip_speed": -0.11}, "smoothed", 2, None, 200000, [2, None]),
    ({"initial.slip_speed": 0.1}, "fixed_step", 2, 1 / 42, 2027, [2, None, 2]),
    ({"initial.slip_speed": 0.1, "tick": 0.03, "cycles": 5}, "fixed_step", 5, 1 / 2, 2027, [5, None, 2])])
def test_a_case_is_solved_over_its_horizon(keys, engine, cycles, step, samples, solved, monkeypatch):
    asked, scale = [], np.array([1.0, 2.0, 4.0])
    if samples == 200000:  # Slip stops after 0.11/(55 * 1.25 * 600) s: too soon for memory.
        assert 20.0 * System().cycle / (0.11 / (55.0 * 1.25 * 600.0)) > 2e5

    def solve(system, **how):
        asked.append((system.friction.law, how))
        x = np.full(3, float(len(asked)))
        return SimpleNamespace(status=Status.DONE, detail="", slip_speed=x, plate_angle=3.0 * x, plate_speed=5.0 * x,
                               statistics=SimpleNamespace(iterations_max=3, iterations_bound=9, seconds=0.5))

    monkeypatch.setattr(extremes, "solve", solve)
    monkeypatch.setattr(extremes, "finite", lambda run: True)
    monkeypatch.setattr(extremes, "energy_excess", lambda run: 1e-3 if run.slip_speed[0] == len(solved) or
                        engine != "fixed_step" else 1.0)
    monkeypatch.setattr(extremes, "power_residual", lambda run: run.slip_speed[0])
    truth = SimpleNamespace(why="", duration=0.25, state=np.array([2.0, 4.0, 6.0]), scale=scale)
    result = extremes.examine(keys, engine, truth)
    law = "set_valued" if engine == "event_driven" else "smoothed"
    length = None if step is None else pytest.approx(step * System().cycle)
    assert {how[0] for how in asked} == {law}
    assert [how.get("cycles") for _, how in asked] == solved
    assert asked[0][1] == {"cycles": cycles, "solver": engine, "step": length, "samples_per_cycle": samples}
    assert asked[1][1] == {"duration": 0.25, "solver": engine, "step": length}
    if step:
        count = round(1.0 / step) * extremes.substeps(extremes.terms_of(System()), step * System().cycle)
        assert asked[2][1] == {"cycles": 2, "solver": engine, "step": length, "samples_per_cycle": count}
    scene = {k: v for k, v in keys.items() if k not in ("cycles", "tick")}
    assert result == extremes.Examined({**scene, "cycles": cycles, "friction.law": law}, engine, length, "DONE", "",
                                       True, True, 1.0, 3, 9, 1.0, 0.5)


@pytest.mark.parametrize(("run", "short", "why", "expected"), [
    ({"status": Status.REFUSED, "detail": "too many"}, {}, "", ("REFUSED", "too many", None, None, None, None)),
    ({}, {"status": Status.STEP_LIMIT}, "", ("DONE", "", True, True, None, 0.1)),
    ({}, {}, "no reference: it fails", ("DONE", "no reference: it fails", True, True, None, 0.1)),
    ({"status": Status.STEP_LIMIT, "detail": "many"}, {}, "no", ("STEP_LIMIT", "many", True, True, None, 0.1)),
    ({"finite": False}, {}, "", ("DONE", "", False, None, 0.0, None)),
    ({"excess": 1.001e-3}, {}, "", ("DONE", "", True, False, 0.0, 0.1))])
def test_what_is_not_known_of_a_case_is_left_open(run, short, why, expected, monkeypatch):
    state = dict.fromkeys(("slip_speed", "plate_angle", "plate_speed"), np.zeros(1))
    given = {"status": Status.DONE, "detail": "", "finite": True, "excess": 1e-3, "statistics": SimpleNamespace(
        iterations_max=3, iterations_bound=9, seconds=0.5), **state}
    runs = [SimpleNamespace(**{**given, **run}), SimpleNamespace(**{**given, **short})]
    monkeypatch.setattr(extremes, "solve", lambda system, **how: runs.pop(0))
    monkeypatch.setattr(extremes, "finite", lambda run: run.finite)
    monkeypatch.setattr(extremes, "energy_excess", lambda run: run.excess)
    monkeypatch.setattr(extremes, "power_residual", lambda run: 0.1)
    truth = SimpleNamespace(why=why, duration=1.0, state=np.zeros(3), scale=np.ones(3))
    result = extremes.examine({}, "smoothed", truth)
    assert (result.status, result.why, result.finite, result.bounded, result.error, result.power_residual) == expected


@pytest.mark.parametrize(("keys", "law", "asked"), [
    ({}, "smoothed", ("smoothed", 60.0, "LSODA", 1e-11)), ({"friction.smoothing": 1e5}, "smoothed", (
        "smoothed", 60.0, "LSODA", 1e-11)), ({}, "set_valued", ("set_valued", 60.0, "DOP853", 1e-12)),
    ({"friction.smoothing": 1.001e5, "driveline.stiffness": 3e5}, "smoothed", ("set_valued", 60.0, "DOP853", 1e-12))])
def test_the_truth_of_a_case_is_short(keys, law, asked, monkeypatch):
    """Two cycles, or 60 rad of the natural frequency if that is less; sizes are not below 1e-6 of the plate speed's."""
    calls, largest = [], np.array([1e-9, 1e-13, 0.1])
    monkeypatch.setattr(extremes, "final_state", lambda system, *how: calls.append((system.friction.law, *how)) or (
        np.ones(3), largest))
    truth = extremes.Truth({**keys, "cycles": 300}, law)
    natural = math.sqrt(keys.get("driveline.stiffness", 3000.0) / 0.02)
    duration = min(2.0 * System().cycle, asked[1] / natural)
    assert calls == [(asked[0], pytest.approx(duration), *asked[2:])]
    assert (truth.why, truth.state.tolist()) == ("", [1.0, 1.0, 1.0])
    np.testing.assert_allclose(truth.scale, [1e-7, 1e-12, 0.1])
    largest[:] = 1e-8, 1e-13, 1e-10
    np.testing.assert_allclose(extremes.Truth(keys, law).scale, [1e-8, 1e-12, 1e-9])

    def fails(*task):
        raise Unfinished("too long")

    monkeypatch.setattr(extremes, "final_state", fails)
    truth = extremes.Truth(keys, law)
    assert (truth.why, truth.duration, truth.scale.tolist()) == ("no reference: too long", calls[0][1], [1.0] * 3)


class Ended(SimpleNamespace):
    """A program that has ended."""

    returncode, stdout, stderr = 0, "", ""


@pytest.mark.parametrize(("program", "ended", "why"), [
    ("cvode", subprocess.TimeoutExpired("a", 1.0), "took more than 60 s"),
    ("cvode", Ended(returncode=3, stderr=" no \n"), "no"),
    ("cvode", Ended(returncode=3, stderr="\n"), "ended with status 3"),
    ("xppaut", subprocess.TimeoutExpired("a", 1.0), "took more than 60 s"), ("xppaut", Ended(), "wrote no results"),
    ("xppaut", "a\n", "wrote no results"), ("xppaut", "0 0 0 0\n" * 512, "stopped after 511 of 512 outputs"),
    ("xppaut", "0 0 0 nan\n" * 513, "stopped after 512 of 512 outputs"), ("nothing", Ended(), "not installed"),
    ("numbalsoda", None, "numbalsoda is not installed (import of numbalsoda halted; None in sys.modules)"),
    ("numbalsoda", (np.zeros((3, 3)), False), "stopped early"),
    ("numbalsoda", (np.full((3, 3), math.nan), True), "stopped early")])
def test_why_a_program_gives_no_result(program, ended, why, monkeypatch):
    monkeypatch.setattr(peers, "cvode_program", lambda: "program")
    monkeypatch.setattr(peers.shutil, "which", lambda name: {"xppaut": "found"}.get(program))

    def run(command, cwd=None, timeout=None, **how):
        assert timeout == 60.0
        if isinstance(ended, Exception):
            raise ended
        if isinstance(ended, str):
            (Path(cwd) / "out.dat").write_text(ended)
        return ended

    monkeypatch.setattr(peers.subprocess, "run", run)
    monkeypatch.setitem(sys.modules, "numbalsoda", SimpleNamespace(lsoda=lambda *task: ended, lsoda_sig=None)
                        if ended else None)
    monkeypatch.setattr(numba_registration, "address_for_c", lambda rates, form: (rates, form))
    task = (2, 1e-6, 1) if program in ("cvode", "numbalsoda") else ("cvode", 1e-6, 2, 0)
    call = getattr(peers, program, peers.xppaut)
    with pytest.raises(peers.Failed) as failed:
        call(System(), *task)
    assert str(failed.value) == why


@pytest.mark.parametrize(("cycles", "repeats", "times"), [(3, 2, (0.75 * 3 / 99, 5.75 * 3 / 99)), (200, 1, (
    0.5 * 200 / 199, 0.5 * 200 / 199)), (3, 0, (math.nan, math.nan))])
def test_a_run_of_xppaut_is_timed_without_its_start(cycles, repeats, times, monkeypatch):
    """The time of at least 100 cycles minus that of one, scaled."""
    asked = []

    def run(command, cwd, **how):
        lines = (Path(cwd) / "model.ode").read_text().splitlines()
        total, step = (float(part.partition("=")[2]) for part in lines[-3][2:].split(",")[:2])
        count = round(total / step)
        asked.append((round(total / System().cycle), count))
        (Path(cwd) / "out.dat").write_text("".join(f"{n} {n % 7} 0 0 9\n" for n in range(count + 1)))

    monkeypatch.setattr(peers.shutil, "which", lambda name: "found")
    monkeypatch.setattr(peers.subprocess, "run", run)
    used = iter([[1.0, 6.0], [0.5, 0.25]])
    monkeypatch.setattr(peers, "repeated", lambda run, repeats, clock: (
        next(used)[:repeats] if clock is peers.of_children else [], run()))
    result = peers.xppaut(System(), "cvode", 1e-6, cycles, repeats)
    assert (result.seconds, result.slowest) == pytest.approx(times, nan_ok=True)
    assert result.section.tolist() == [[n % 7, 0.0, 0.0] for n in range(cycles + 1)]
    assert asked[:2] == [(cycles, 256 * cycles), (cycles, cycles)]
    assert {now[0] for now in asked[2:]} == ({max(cycles, 100), 1} if repeats else set())


def test_a_step_of_a_loop_in_python_and_its_equations(monkeypatch):
    """The best of five: of a run of 7 steps, and of 1200 evaluations, twelve a step."""
    solves, used = Solves(), iter([([0.14, 0.07], 5), ([0.3, 0.2], 5)])

    def repeated(run, repeats):
        times, expected_repeats = next(used)
        assert repeats == expected_repeats
        return times, run()

    monkeypatch.setattr(peers, "solve", solves)
    monkeypatch.setattr(peers, "repeated", repeated)
    assert peers.python_loop(System()) == pytest.approx({"step": 0.01, "rates": 0.002})
    assert solves.asked == [{"duration": 1e-3 * System().cycle, "solver": "dop853"}]


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_the_steady_state_is_the_motion_that_the_engine_reaches_solved_again_by_scipy(law, monkeypatch):
    """Over a period, from its last start within the run; without a period, or where SciPy fails, nothing is known."""
    asked, engine, system = [], {"smoothed": ("smoothed", 1e-11), "set_valued": ("event_driven", 1e-12)}[law], replace(
        System(), {"friction.law": law})
    run = SimpleNamespace(section=np.arange(306.0).reshape(102, 3), largest=np.ones(101))
    monkeypatch.setattr(work_precision, "solve", lambda system, **how: asked.append(how) or SimpleNamespace(
        solved_cycles=run))
    monkeypatch.setattr(work_precision, "steady_of", lambda section, largest: (period, 0.0))
    monkeypatch.setattr(work_precision, "reference", lambda system, *how: asked.append((
        system.initial.slip_speed, *how)) or Reference("", np.array([[1.0, 2.0, -8.0], [1.5, 2.5, -8.0]]),
                                                       np.array([3.0, 4.0]), np.array([4.0, 0.0, 1.0])))
    names = [f"{engine[0]}, rtol {engine[1]:g}", "SciPy LSODA, rtol 1e-10"]
    for period, slip in ((4, 300.0), (1, 303.0)):
        assert work_precision.steady_reference(system, 101, "LSODA", 1e-10) == SteadyState(101, period, 4.0, 0.2, names)
        assert asked[-2:] == [{"cycles": 101, "solver": engine[0], "rtol": engine[1]}, (slip, period, "LSODA", 1e-10)]
    period = 0
    assert work_precision.steady_reference(system, 101, "LSODA", 1e-10) == SteadyState(101, 0, None, None, names)

    def fails(*task):
        raise Unfinished

    period = 2
    monkeypatch.setattr(work_precision, "reference", fails)
    assert work_precision.steady_reference(system, 101, "LSODA", 1e-10) == SteadyState(101, 2, None, None, names)


def test_a_scene_beyond_its_ranges_is_refused():
    result = extremes.examine({"driveline.stiffness": -1.0, "cycles": 7}, "fixed_step", SimpleNamespace(why=""))
    assert result == extremes.Examined({"driveline.stiffness": -1.0, "cycles": 7, "friction.law": "smoothed"},
                                       "fixed_step", 1e-3, why=result.why)
    assert "driveline.stiffness is -1 N m/rad" in result.why
