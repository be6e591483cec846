"""Both reports line by line, and the rules behind them, for records written down here."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid

from tcc_sim.model.parameters import System, replace
from tcc_sim.study.benchmarks import extremes, precision_report, references, stability
from tcc_sim.study.benchmarks.extremes import Examined
from tcc_sim.study.benchmarks.precision_report import (
    LongRun,
    Omitted,
    PrecisionReport,
    PrecisionResult,
    References,
    SteadyState,
    StudiedScene,
)
from tcc_sim.trajectory import Cycles, Trajectory

PAGES = Path(__file__).with_name("pages.txt")


def page(name):
    """A page of the file of pages."""
    return dict(part.split("\n", 1) for part in PAGES.read_text().split("== ")[1:])[name]


def result(solver, setting, error, seconds, slowest=1.0, steady=None):
    return PrecisionResult(solver, setting, error, 0.5 * error, 0.25 * error, steady, seconds, slowest * seconds, 7)


FIG02 = StudiedScene("fig02", "stick-slip", "smoothed", 4, References(["one", "two"], 1.25e-9),
                     SteadyState(400, 1, 36.30123, 1.2e-6, ["smoothed"]),
                     [result("smoothed", 1e-9, 1e-6, 2e-3, 1.256), result("smoothed", 1e-8, 1.01e-6, 1e-3),
                      result("smoothed", 1e-10, 1e-9, 5e-3), result("rk45", 1e-7, 1e-6, 24e-3),
                      result("rk4", 1e-5, 1e-3, 1e-3), result("CVODE", 1e-8, 1e-7, 1e-3)],
                     [Omitted("XPPAUT cvode", 1e-8, "not installed"), Omitted("dop853", 1.23456e-4, "too slow")],
                     {"smoothed": 1.5}, [LongRun("smoothed", 1e-9, 2000, 0.04567), LongRun("CVODE", 1e-8, 400, 0.03)])
EXACT = StudiedScene("fig02, set-valued", "stick-slip; law (6)", "set_valued", 4, References(["a", "b"], 1e-12),
                     SteadyState(400, 2, 63.74, 1e-8, []), [result("event_driven", 1e-10, 1e-10, 0.5e-3)])
MINIMAL = StudiedScene("minimal", "constant pressure", "smoothed", 4, References(["a", "b"], 1e-9),
                       SteadyState(400, 0, None, None, []), [result("smoothed", 1e-9, 1e-7, 4e-3),
                                                             result("rk45", 1e-7, 1e-3, 1.0)])
SCENES = [FIG02, EXACT, MINIMAL]


def test_the_precision_page_is_written_line_by_line():
    report = PrecisionReport(SCENES, precision_report.took_part(SCENES), True, False,
                             {"step": 1.234e-4, "rates": 1.26e-5}, "a processor")
    assert precision_report.precision_page(report, "precision.png") == page("precision")
    whole = dataclasses.replace(report, quick=False, complete=True, python_loop={}, scenes=[MINIMAL])
    text = precision_report.precision_page(whole, "precision.png")
    assert text.splitlines()[2] == "This page is generated: `tcc-sim precision` writes it."
    assert "Interrupted" not in text
    assert "dop853` takes" not in text
    assert "event_driven` " not in text.split("![")[0]


def test_lines_of_a_scene_for_a_terminal():
    assert [line for scene in SCENES[:2] for line in precision_report.scene_lines(scene)] == [
        "fig02: floor 1.3e-09; 4 cycles with errors up to 1e-06: CVODE 1 ms, smoothed 2 ms, rk45 24 ms",
        "    smoothed at 1e-09: 45.67 ms per 100 cycles", "    CVODE at 1e-08: 30 ms per 100 cycles",
        "fig02, set-valued: floor 1.0e-12; 4 cycles with errors up to 1e-06: event_driven 0.5 ms"]
    assert precision_report.scene_lines(dataclasses.replace(MINIMAL, results=[]))[0].endswith("up to 1e-06: none")


@pytest.mark.parametrize(("change", "end"), [
    ({}, "With law (6) it is period 2 with 63.74 rad/s: the smoothing decides which motion is reached."),
    ({"period": 1, "max_slip_speed": 36.30123 * 1.0499}, "With law (6) it is period 1 with 38.113 rad/s."),
    ({"period": 1, "max_slip_speed": 36.30123 * 1.0501}, "it is period 1 with 38.12 rad/s: the smoothing decides which "
     "motion is reached."), ({"max_slip_speed": None}, "(400 cycles; SciPy closes it to 1.2e-06).")])
def test_the_other_law_is_compared(change, end):
    other = dataclasses.replace(EXACT, steady=dataclasses.replace(EXACT.steady, **change))
    assert precision_report.comparison(FIG02, [MINIMAL, FIG02, other]).endswith(end)


def examined(solver, status="DONE", step=None, seconds=0.5, **more):
    keys = {"friction.law": "smoothed", "cycles": 2, **more.pop("keys", {})}
    given = {"finite": True, "bounded": True, "iterations_max": 5, "iterations_bound": 50, "error": 1e-6,
             "power_residual": 1e-4, **more} if status != "REFUSED" else more
    return Examined(keys, solver, step, status, seconds=seconds, **given)


CASES = [examined("smoothed", error=e) for e in (2e-6, 1e-5, 3e-6, None, 5e-6, 4e-6, 6e-6)] + [
    examined("smoothed", "STEP_LIMIT", why="too many", keys={"friction.decay": 0.1 + 0.2}, seconds=1.2345),
    examined("event_driven", finite=False, keys={"cycles": 300}, power_residual=None, iterations_max=None,
             iterations_bound=None),
    examined("event_driven", bounded=None, iterations_max=0, iterations_bound=0),
    examined("fixed_step", step=1e-3, iterations_max=51, keys={"pressure.mean": 1e4}),
    examined("fixed_step", step=4.65e-3, iterations_max=50, bounded=False),
    *(examined("fixed_step", "REFUSED", why=why) for why in ("sub-steps", "others"))]


def test_the_stability_page_is_written_line_by_line():
    report = stability.StabilityReport(CASES, stability.engine_summaries(CASES), [], True, False, ["a reason"])
    assert stability.stability_page(report, "stability.png") == page("stability")
    good = [examined(engine) for engine in extremes.ENGINES]
    text = stability.stability_page(stability.StabilityReport(good, stability.engine_summaries(good), [], False, True),
                                    "stability.png")
    assert "`tcc-sim stability` writes it" in text
    assert text.count("\nNone.\n") == 2
    assert "of 1 case none failed and none were refused" in text
    assert "Why" not in text
    assert "Interrupted" not in text


def test_the_summary_of_an_engine_counts_what_ran():
    smoothed, exact, fixed = stability.engine_summaries(CASES).values()
    assert list(vars(smoothed).values())[:8] == [8, {"DONE": 7, "STEP_LIMIT": 1}, 0, 0, 5, 50, 0, 1]
    assert list(vars(exact).values())[:8] == [2, {"DONE": 2}, 1, 0, 0, 0, 0, 0]
    assert list(vars(fixed).values())[:8] == [4, {"DONE": 2, "REFUSED": 2}, 0, 1, 51, 50, 1, 0]
    values = np.array([1e-6, 2e-6, 3e-6, 4e-6, 5e-6, 6e-6, 1e-5])
    assert dataclasses.astuple(smoothed.error) == pytest.approx(tuple(np.quantile(values, (0.5, 0.9, 0.99, 1.0))))
    assert (smoothed.longest_seconds, fixed.longest_seconds) == (1.2345, 0.5)
    empty = stability.engine_summaries([])["smoothed"]
    assert dataclasses.astuple(empty) == (0, {}, 0, 0, 0, 0, 0, 0, (None,) * 4, (None,) * 4, 0.0)


@pytest.mark.parametrize(("keys", "expected"), [
    ({}, {"initial.slip_speed": 5.0, "pressure.amplitude": 0.2 * 225e3}),
    ({"share": 1.5, "pressure.mean": 1e4},
     {"initial.slip_speed": 5.0, "pressure.mean": 1e4, "pressure.amplitude": 1.5e4}),
    ({"share": 1.5, "pressure.mean": 1e7, "initial.slip_speed": 0.0},
     {"initial.slip_speed": 0.0, "pressure.mean": 1e7, "pressure.amplitude": 1e7})])
def test_a_case_has_an_amplitude_in_place_of_its_share(keys, expected):
    expected = {**expected, "pressure.amplitude": pytest.approx(expected["pressure.amplitude"])}
    if "pressure.mean" not in keys:
        expected["pressure.amplitude"] = pytest.approx(0.2 * System().pressure.mean)
    assert extremes.case_of(keys) == expected


def test_the_cases_by_hand():
    assert extremes.scene_keys({"cycles": 3, "tick": 1e-3, "pressure.mean": 1.0}) == {"pressure.mean": 1.0}
    steps = extremes.command_steps()
    assert len(steps) == 12
    assert steps[0] == {"initial.slip_speed": 0.0, "initial.plate_angle": 0.1, "pressure.mean": 0.0}
    assert steps[-1] == {"initial.slip_speed": 80.0, "initial.plate_angle": pytest.approx(1 / 6),
                         "engine.mean_torque": 0.0, "engine.torque_amplitude": 0.0}
    many = extremes.long_and_coarse()
    assert [case.get("cycles") for case in many] == [300] * 6 + [None] * 6
    assert [case.get("tick") for case in many] == [None] * 6 + [5e-3, 1e-2, 1e-2, 5e-2, 0.1, 1.0]
    # The torque in stick reaches Tm + Tp (K - I2 w^2)/(K - (I1 + I2) w^2), and breakaway is 0.3 N A R.
    reach = 300.0 + 100.0 * (3000.0 - 72.0) / (3000.0 - 792.0)
    for case, share in zip(extremes.grazing(), [-1e-3, -1e-6, 1e-9, 1e-6, 1e-3, 1e-2] * 2):
        assert 0.3 * case["pressure.mean"] * 0.008 == pytest.approx(reach * (1.0 - share), rel=1e-12)
        assert (case["initial.plate_angle"], case["initial.slip_speed"]) == (0.1, 0.0)
        assert case["initial.plate_speed"] == pytest.approx(60.0 * 100.0 / (3000.0 - 792.0))
    falling = [case["friction.kinetic_coefficient"] for case in extremes.grazing()]
    assert falling == pytest.approx([0.3] * 6 + [0.24] * 6)


def test_draws_are_those_of_their_seed_and_short_enough():
    first, again, other = (extremes.extreme_cases(200, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert len({repr(sorted(case.items())) for case in first}) == 200
    for case in first:
        system = replace(System(), extremes.scene_keys(case))
        assert system.natural_frequency * system.cycle <= extremes.LONGEST


def run_of(t, slip, angle, speed, friction=0.0, engine=0.0):
    """A made-up run of the default system."""
    full = [np.asarray(x, float) + 0.0 * np.asarray(t) for x in (slip, angle, speed, friction, engine)]
    blank = {item.name: None for item in dataclasses.fields(Trajectory)}
    names = ("slip_speed", "plate_angle", "plate_speed", "friction_torque", "engine_torque")
    run = object.__new__(Trajectory)
    vars(run).update({**blank, **dict(zip(names, full)), "t": np.asarray(t, float), "system": System(), "cycles": None})
    return run


def test_energy_and_its_bound_by_hand():
    """I1 = 0.2, I2 = 0.02 kg m^2, K23 = 3000 N m/rad, max |Te| = 550 N m."""
    t = np.array([1.0, 1.1, 1.2])
    run = run_of(t, [1.0, 2.0, 3.0], [0.1, 0.0, 0.1], [10.0, 20.0, 30.0])
    energy = 0.1 * np.array([11.0, 22.0, 33.0]) ** 2 + 0.01 * np.array([10.0, 20.0, 30.0]) ** 2 + 1500.0 * np.array(
        [0.01, 0.0, 0.01])
    np.testing.assert_allclose(extremes.energy(run), energy)
    bound = math.sqrt(energy[0]) + 550.0 * (t - 1.0) / math.sqrt(0.4)
    assert extremes.energy_excess(run) == pytest.approx((np.sqrt(energy) / bound).max() - 1.0)


def test_a_run_is_finite_if_all_of_its_arrays_are():
    run, arrays = run_of(np.arange(3.0), 1.0, 0.1, 2.0), ("slip_speed", "plate_angle", "plate_speed", "friction_torque")
    whole = Cycles(np.zeros((3, 3)), *np.zeros((3, 2)))
    assert extremes.finite(run)
    for owner, names in ((run, arrays), (whole, ("section", "highest", "lowest", "stick_time"))):
        for name in names:
            vars(run)["cycles"], kept = whole, getattr(owner, name)
            assert extremes.finite(run)
            vars(owner)[name] = np.where(np.arange(kept.size).reshape(kept.shape) == 1, np.inf, kept)
            assert not extremes.finite(run)
            vars(owner)[name] = kept


def test_the_power_balance_by_hand():
    """Constant powers over three cycles of two samples: what the engine gives is not stored in the last of them."""
    half = 0.5 * System().cycle
    t = half * np.arange(7)
    stored = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0])
    plate = np.zeros(7)
    flywheel = np.sqrt(stored / 0.1)
    engine = np.where(flywheel > 0.0, (1.0 / half + 3.0 * flywheel) / np.maximum(flywheel, 1e-9), 0.0)
    run = run_of(t, flywheel, 0.0, plate, friction=3.0, engine=engine)
    supply, losses = engine * flywheel, 3.0 * flywheel
    work = [trapezoid((supply - losses)[k:k + 3], dx=half) for k in (0, 2, 4)]
    size = max(5.0, *(trapezoid(supply[k:k + 3], dx=half) for k in (0, 2, 4)))
    worst = max(abs(w - (stored[k + 2] - stored[k])) for w, k in zip(work, (0, 2, 4)))
    assert extremes.power_residual(run) == pytest.approx(worst / size)
    assert extremes.power_residual(run_of(t[:2], 1.0, 0.0, 0.0)) is None


def test_errors_are_relative_to_the_size_of_each_signal():
    truth = references.Reference("", np.zeros((4, 3)), np.array([4.0, 4.0, 4.0]), np.array([4.0, 0.1, 10.0]))
    section = np.zeros((4, 3))
    section[1], section[3] = (0.4, 0.03, -2.0), (-0.04, 0.001, 0.5)
    assert references.errors(section, np.array([4.0, 3.0, 4.2]), truth) == pytest.approx((0.05, 0.3, 0.25))
