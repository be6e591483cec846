"""The work-precision report: references against closed forms, failures listed, files as promised."""

import dataclasses
import json
import sys
from importlib.util import find_spec
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from documents import same_pictures, valid
from scipy.integrate import solve_ivp

from tcc_sim.cli import main
from tcc_sim.compiling import numba_registration
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.problem import rates_along
from tcc_sim.solvers.terms import terms_of
from tcc_sim.study.benchmarks import peers, report_drawings
from tcc_sim.study.benchmarks import work_precision as precision
from tcc_sim.study.benchmarks.precision_report import (
    Omitted,
    PrecisionResult,
    References,
    SteadyState,
    StudiedScene,
    comparison,
)
from tcc_sim.study.benchmarks.references import Reference, disagreement, errors, reference
from tcc_sim.study.paper.catalogue import FIGURES, paper_system
from tcc_sim.views import style

ERRORS = ("error_final", "error_section", "error_max_slip")
SLIP = {"friction.kinetic_coefficient": 0.3, "pressure.mean": 100e3, "pressure.amplitude": 0.0,
        "engine.mean_torque": 300.0}


def pure_slip(system, t):
    """Slip speed of pure slip under constant load from rest of the plate: two quadratures and a damped oscillator."""
    d, e = system.driveline, system.engine
    load, omega = system.saturation_mean, e.frequency
    natural = np.sqrt(d.stiffness / d.plate_inertia)
    zeta = d.damping / (2.0 * np.sqrt(d.stiffness * d.plate_inertia))
    damped = natural * np.sqrt(1.0 - zeta**2)
    flywheel = (system.initial.slip_speed + (e.mean_torque - load) * t / d.flywheel_inertia
                + e.torque_amplitude / (d.flywheel_inertia * omega) * (1.0 - np.cos(omega * t)))
    plate = load / (d.plate_inertia * damped) * np.exp(-zeta * natural * t) * np.sin(damped * t)
    return flywheel - plate


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_the_reference_is_the_closed_form_of_pure_slip(law):
    system = replace(System(), {**SLIP, "friction.law": law})
    result = reference(system, 2, "DOP853", 1e-12)
    t = np.arange(3) * system.cycle
    np.testing.assert_allclose(result.section[:, 0], pure_slip(system, t), rtol=1e-10)
    dense = pure_slip(system, np.linspace(0.0, t[1], 200001))
    assert result.largest[0] == pytest.approx(dense.max(), rel=1e-9)


def test_two_references_agree_and_errors_are_relative_to_the_signals():
    system = replace(System(), {"friction.law": "set_valued"})
    first, second = reference(system, 5, "DOP853", 1e-12), reference(system, 5, "LSODA", 1e-11)
    assert disagreement(first, second) < 1e-7
    off = Reference("", first.section * 1.0, first.largest * 1.0, first.size)
    off.section[3, 0] += 1e-3 * first.size[0]
    assert first.size[0] == pytest.approx(first.largest[2:].max(), rel=1e-3)
    result = errors(off.section, off.largest, first)
    assert result == pytest.approx((0.0, 1e-3, 0.0))


@pytest.fixture
def tiny(monkeypatch):
    """Makes the quick study one of two scenes with few runs."""
    monkeypatch.setattr(precision, "QUICK", precision.Effort(
        5, 0.01, 1.0,
        {"smoothed": (("LSODA", 1e-10), ("LSODA", 1e-12)), "set_valued": (("DOP853", 1e-12), ("LSODA", 1e-12))},
        {"smoothed": (1e-9,), "event_driven": (1e-10,), "rk45": (1e-5,)},
        {"solve_ivp LSODA": (1e-8,), "CVODE": (1e-9,), "XPPAUT cvode": (1e-8,)}, 20, 400, 0,
        ("fig02", "minimal, set-valued")))


def settled(law, cycles):
    """The largest slip speed, rad/s, that an engine finds after some cycles of Fig. 2."""
    return solve(load_scene("fig02").with_values({"friction.law": law}), cycles=cycles).solved_cycles.largest[-2:].max()


def scene_record(scene, law, steady):
    """A record of a scene on which nothing was run yet."""
    return StudiedScene(scene, "", law, 5, References([], 1e-8), steady)


def test_no_two_series_look_alike():
    names = [*report_drawings.LOOKS, "one", "another"]
    looks = list(report_drawings.looks_of(names).values())
    assert len({look[0] for look in looks[:-2]}) == len(looks) - 2  # colours
    assert len({(look[1], str(look[2])) for look in looks}) == len(looks)  # marker with line
    assert set(report_drawings.LOOKS) >= set(SOLVERS)


@pytest.mark.usefixtures("tiny")
def test_the_command_writes_what_it_promises(tmp_path, capsys, figures):
    folder = tmp_path / "out"
    assert main(["precision", "--quick", "--width", "column", "--out", str(folder)]) == 0
    document = valid("precision", json.loads((folder / "precision.json").read_text()))
    assert len(document["reference"]["solvers"]) == 2
    assert 0.0 < document["reference"]["floor"] < 1e-7
    assert [r["scene"] for r in document["scenes"]] == ["fig02", "minimal, set-valued"]
    rows = {(r["solver"], r["setting"]): r for r in document["results"]}
    assert max(rows["smoothed", 1e-9][k] for k in ERRORS) < 1e-8
    why = {row["solver"]: row["why"] for row in document["omitted"]}
    assert max(rows["rk45", 1e-5][k] for k in ERRORS) < 1e-3
    if ("CVODE", 1e-9) in rows:
        assert max(rows["CVODE", 1e-9][k] for k in ERRORS) < 1e-5
    else:
        assert document["peers"]["CVODE"] == why["CVODE"]
        assert f"CVODE did not join: {why['CVODE']}" in (folder / "precision.md").read_text()
    exact = {row["solver"]: row for row in document["scenes"][1]["results"]}["event_driven"]
    assert max(exact[k] for k in ERRORS) < 1e-9
    steady = document["scenes"][0]["steady"]
    assert (steady["period"], steady["cycles"]) == (1, 400)
    assert steady["max_slip_speed"] == pytest.approx(settled("smoothed", 400), abs=2e-3)
    assert steady["closure"] < 1e-4
    assert rows["smoothed", 1e-9]["error_steady"] < 1e-4
    for name in ("precision.png", "precision.svg", "precision_section.png", "precision_section.svg"):
        assert (folder / name).exists()
    words = ["plot", str(folder / "precision.json"), "--plot", str(tmp_path / "again.png"), "--width", "column"]
    assert main(words) == 0
    assert len(same_pictures(figures, style.COLUMN)) > 4
    assert (folder / "precision.md").read_text().count("\n## ") == 2
    assert "ms per 100 cycles" in capsys.readouterr().out


def test_the_steady_state_tells_the_friction_laws_of_figure_2_apart():
    """From (13) law (6) settles in period two with 63.74 rad/s, the paper's smoothing in period one with 36.30: by
    SciPy, and by the engines.
    """
    records = []
    for law, period in (("smoothed", 1), ("set_valued", 2)):
        system = paper_system({**FIGURES[2].series[0].values, "friction.law": law})
        result = precision.steady_reference(system, 1000, "DOP853" if law == "set_valued" else "LSODA", 1e-10)
        assert (result.period, result.cycles) == (period, 1000)
        assert result.max_slip_speed == pytest.approx(settled(law, 1000), abs=2e-3)
        assert result.closure < 1e-4
        records.append(scene_record("fig02" if law == "smoothed" else "fig02, set-valued", law, result))
    assert "the smoothing decides which motion is reached" in comparison(records[0], records)
    same = [records[0], dataclasses.replace(records[1], steady=records[0].steady)]
    assert "decides" not in comparison(same[0], same)


def test_a_ladder_goes_on_until_a_solver_reaches_the_target_or_fails():
    """Errors made up: a tenth of the tolerance, the tolerance itself times 1e4, and a solver that has failed."""
    record = scene_record("fig02", "smoothed", SteadyState(400, 0, None, None, []))
    case = precision.Case("fig02", "", System(), 5)
    effort = precision.Effort(5, 0.01, 1.0, {}, {"bdf": (1e-3,), "lsoda": (1e-3,), "radau": (1e-3, 1e-4),
                                                 "fixed_step": (1e-3,)}, {}, 20)
    for solver, setting in precision.settings(case, effort):
        record.results.append(PrecisionResult(solver, setting, 1e-4, 1e-4, 1e-4, None, 1.0, 1.0, 1))
    record.omitted.append(Omitted("radau", 1e-5, "stopped"))
    calls = []
    for solver, setting in precision.further(record, case, effort):
        calls.append((solver, setting))
        error = {"bdf": setting, "lsoda": 1.0, "fixed_step": setting}[solver]
        if solver == "lsoda" and setting < 1e-5:
            record.omitted.append(Omitted(solver, setting, "stopped"))
        else:
            record.results.append(PrecisionResult(solver, setting, error, error, error, None, 1.0, 1.0, 1))
    assert [s for name, s in calls if name == "bdf"] == pytest.approx([1e-4, 1e-5, 1e-6])
    assert [s for name, s in calls if name == "lsoda"] == pytest.approx([1e-4, 1e-5, 1e-6])
    assert [s for name, s in calls if name == "fixed_step"] == pytest.approx([1e-3 * 0.5**k for k in range(1, 11)],
                                                                             rel=1e-2)
    assert "radau" not in dict(calls)


def test_every_solver_is_in_a_group_of_panels():
    assert {name for group in report_drawings.GROUPS.values() for name in group} == set(report_drawings.LOOKS)


@pytest.mark.parametrize("width", [style.COLUMN, style.PAGE])
def test_titles_of_panels_do_not_overlap(width, laid_out, tmp_path):
    record = scene_record("fig02", "smoothed", SteadyState(400, 0, None, None, []))
    record.results += [PrecisionResult(name, 1e-6, e, e, e, None, e, e, None)
                       for name in report_drawings.LOOKS for e in (1e-4, 1.0)]
    report_drawings.draw_section(tmp_path / "a", [record], width=width)
    titles = [axis._left_title.get_window_extent() for axis in laid_out[0].axes]
    assert len(titles) == 4
    assert not any(one.overlaps(other) for one, other in combinations(titles, 2))


def test_an_existing_directory_is_refused(tmp_path, capsys):
    assert main(["precision", "--quick", "--out", str(tmp_path)]) == 2
    assert "exists" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def by_scipy(address, y, t, nothing, rtol, atol, most):
    """LSODA of the numbalsoda that the test below makes up: the equations are called as Python, row by row."""
    def rates(t, state):
        address(t, state, out := np.empty(3), None)
        return out

    assert (nothing.tolist(), most, atol) == ([0.0], 1_000_000, pytest.approx(rtol / 50.0))
    return solve_ivp(rates, (0.0, t[-1]), y, "LSODA", t, rtol=rtol, atol=atol).y.T, True


@pytest.mark.parametrize(("program", "accuracy"), [
    (lambda *task: peers.xppaut(task[0], "cvode", 1e-9, 3, 1), 1e-6), (peers.cvode, 1e-9), (peers.bare_lsoda, 1e-9),
    (peers.numbalsoda, 1e-9)], ids=["xppaut", "cvode", "solve_ivp", "numbalsoda"])
def test_a_program_is_the_closed_form_of_pure_slip(program, accuracy, monkeypatch):
    """The numbalsoda is made up where it is not installed."""
    if find_spec("numbalsoda") is None:
        monkeypatch.setitem(sys.modules, "numbalsoda", SimpleNamespace(lsoda=by_scipy, lsoda_sig="signature"))
        monkeypatch.setattr(numba_registration, "address_for_c", lambda rates, form: (rates, form))
    system = replace(System(), SLIP)
    try:
        run = program(system, 3, 1e-12, 1)
    except peers.Failed as missing:
        pytest.skip(str(missing))
    np.testing.assert_allclose(run.section[:, 0], pure_slip(system, np.arange(4) * system.cycle), rtol=accuracy)
    for n in range(3):
        dense = pure_slip(system, system.cycle * (n + np.linspace(0.0, 1.0, 20001)))
        assert run.largest[n] == pytest.approx(dense.max(), rel=max(10.0 * accuracy, 1e-7))
    assert 0.0 <= run.seconds <= run.slowest
    assert run.steps is None or 20 < run.steps < 5000


def test_the_equations_of_numbalsoda_are_those_of_the_package():
    """At states of slip and stick, beside `rates_along`; no numbalsoda is needed."""
    system = load_scene("fig02").system
    states = np.array([[3.0, 0.1, 2.0], [-0.01, 0.12, -5.0], [0.0, 0.0, 1.0]])
    for t, state, expected in zip((0.0, 0.01, 0.02), states, rates_along(np.array([0.0, 0.01, 0.02]), states,
                                                                         terms_of(system))):
        result = np.empty(3)
        peers.rates_for_c(system)(t, state, result, None)
        np.testing.assert_allclose(result, expected, rtol=1e-12)


def test_a_settled_horizon_begins_on_the_motion_and_its_steady_state_in_the_initial_state():
    scene = load_scene("fig02").system
    case = precision.Case("fig02", "", scene, 5).settled()
    assert (case.name, case.cycles, case.unsettled, case.set_valued().unsettled.initial) == (
        "fig02", 5, scene, case.system.initial)
    run = solve(case.system, cycles=1, solver="smoothed", rtol=1e-9).solved_cycles.section
    np.testing.assert_allclose(run[1], run[0], rtol=1e-6)


@pytest.mark.parametrize(("missing", "why"), [
    ({"PATH": ""}, "there is no C compiler"), ({"LIBRARIES": ("no_such_library",)}, "Debian: libsundials-dev")])
def test_without_compiler_or_library_cvode_says_so(missing, why, monkeypatch):
    peers.cvode_program.cache_clear()
    if "PATH" in missing:
        monkeypatch.setenv("PATH", "")
    elif peers.compiler() is None:
        pytest.skip("there is no C compiler")
    else:
        monkeypatch.setattr(peers, "LIBRARIES", missing["LIBRARIES"])
    with pytest.raises(peers.Failed, match=why):
        peers.cvode(System(), 1, 1e-6, 1)
