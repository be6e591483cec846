"""Error against run time: programs against closed forms, rows by independent errors, tables by hand, the command."""

import json
import re
from dataclasses import replace as with_fields

import numpy as np
import pytest
from documents import same_pictures, valid
from independent import equations, smoothed_states
from pictures import check, labelled, shows

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError, MissingPackage, TccError
from tcc_sim.model.parameters import System, replace
from tcc_sim.output.provenance import document
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks import peers, precision
from tcc_sim.study.benchmarks.precision import ERRORS, FIELDS, largest_error
from tcc_sim.study.benchmarks.references import Reference, errors, reference

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
    assert max(errors(second, first)) < 1e-7
    off = Reference("", first.section * 1.0, first.largest * 1.0, first.size)
    off.section[3, 0] += 1e-3 * first.size[0]
    off.section[5, 1] += 1e-4 * first.size[1]
    off.largest[1] -= 1e-2 * first.size[0]
    assert first.size[0] == pytest.approx(first.largest[2:].max(), rel=1e-3)
    assert errors(off, first) == pytest.approx((1e-4, 1e-3, 1e-2))


@pytest.mark.parametrize(("program", "accuracy"), [
    (lambda *task: peers.xppaut(task[0], "cvode", 1e-9, 3, 1), 1e-6), (peers.cvode, 1e-9), (peers.bare_lsoda, 1e-9),
    (peers.numbalsoda, 1e-9)], ids=["xppaut", "cvode", "solve_ivp", "numbalsoda"])
def test_a_program_is_the_closed_form_of_pure_slip(program, accuracy):
    system = replace(System(), SLIP)
    try:
        run = program(system, 3, 1e-12, 1)
    except TccError as missing:
        pytest.skip(str(missing))
    np.testing.assert_allclose(run.section[:, 0], pure_slip(system, np.arange(4) * system.cycle), rtol=accuracy)
    for n in range(3):
        dense = pure_slip(system, system.cycle * (n + np.linspace(0.0, 1.0, 20001)))
        assert run.largest[n] == pytest.approx(dense.max(), rel=max(10.0 * accuracy, 1e-7))
    assert 0.0 <= run.seconds <= run.slowest


@pytest.mark.parametrize("keys", [{}, {"friction.kinetic_coefficient": 0.33}])
def test_the_equations_for_other_programs_are_the_independent_ones(keys):
    """The test calls the rates for numbalsoda and evaluates the lines for XPPAUT as Python; friction falls or rises."""
    system = replace(load_scene("fig02").system, {"pressure.phase": -0.4, "pressure.frequency_ratio": 0.5, **keys})
    lines = dict(re.findall(r"^(\w+'?)=(.+)$", peers.xppaut_file(system, "cvode", 1e-8, 3, 4), re.MULTILINE))
    assert not any("+-" in line for line in lines.values())  # XPPAUT refuses two signs.
    for t, (v, q, w) in ((0.0, (3.0, 0.1, 2.0)), (0.01, (-0.01, 0.12, -5.0)), (0.02, (0.0, 0.0, 1.0))):
        expected, result = equations(system)[0](t, [v, q, w, 0.0])[:3], np.empty(3)
        peers.rates_for_c(system)(t, (v, q, w), result, None)
        np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-9)
        names = {"t": t, "v": v, "q": q, "w": w, **{name: getattr(np, name) for name in ("sin", "tanh", "exp", "abs")}}
        for name in ("ts", "tf", "s", "v'", "q'", "w'"):
            names[name] = eval(lines[name], {}, names)  # noqa: S307
        assert [names[name] for name in ("v'", "q'", "w'")] == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_without_a_compiler_cvode_has_a_reason(monkeypatch):
    peers.cvode_program.cache_clear()
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingPackage):
        peers.cvode(System(), 1, 1e-6, 1)


TINY = precision.Effort(4, 0.01, 8.0, {
    "smoothed": (("LSODA", 1e-10), ("LSODA", 1e-12)), "set_valued": (("DOP853", 1e-12), ("LSODA", 1e-12))}, {
    "smoothed": (1e-4, 1e-9), "event_driven": (1e-10,), "lsoda": (1e-3,), "dop853": (1e-6,),
    "solve_ivp LSODA": (1e-8,)}, 20, 2, ("fig02", "minimal, set-valued"))


@pytest.fixture(scope="module")
def studied():
    """Records of fig02 and of minimal with the set-valued law."""
    return list(precision.precision_study(TINY, lambda *at: None))


def test_rows_have_the_errors_of_an_independent_solution(studied):
    """Ladders go on for two settings beyond their end until the target; steps that would take too long are left out."""
    fig02, exact = studied
    assert [(r["scene"], r["law"], r["cycles"]) for r in studied] == [("fig02", "smoothed", 4),
                                                                     ("minimal, set-valued", "set_valued", 4)]
    assert 0.0 < fig02["reference"]["floor"] < 1e-7
    case, = precision.cases(with_fields(TINY, scenes=("fig02",)))
    base = load_scene("fig02").system
    start = solve(base, cycles=precision.SETTLING, solver="smoothed", rtol=1e-11).solved_cycles.section[-1]
    assert [*vars(case.system.initial).values()][:3] == pytest.approx([*start], abs=1e-9)
    truth = smoothed_states(case.system, [*start, 0.0], 4, 400)[:, :3]
    size = np.abs(truth[800:]).max(axis=0)
    rows = {(r["solver"], r["setting"]): r for r in fig02["results"]}
    for solver, setting in (("smoothed", 1e-4), ("lsoda", 1e-3)):
        run = solve(case.system, cycles=4, solver=solver, rtol=setting).solved_cycles
        off = np.abs(run.section - truth[::400]) / size
        row = rows[solver, setting]
        assert row["error_final"] == pytest.approx(off[-1].max(), rel=0.02, abs=1e-8)
        assert row["error_section"] == pytest.approx(off.max(), rel=0.02, abs=1e-8)
        assert row["error_max_slip"] < 10.0 * row["error_section"]
    assert largest_error(rows["smoothed", 1e-9]) < 1e-8 < largest_error(rows["smoothed", 1e-4])
    assert max(map(largest_error, exact["results"])) < 1e-9
    lsoda = [row for row in fig02["results"] if row["solver"] == "lsoda"]
    assert [row["setting"] for row in lsoda] == pytest.approx([1e-3, 1e-4, 1e-5][:len(lsoda)])
    assert len(lsoda) > 1
    assert all(largest_error(row) > precision.TARGET for row in lsoda[:-1])
    assert {row["solver"] for row in fig02["omitted"]} == {"dop853"}
    assert all(row["why"] for row in fig02["omitted"])
    assert {(row["solver"], row["cycles"]) for row in fig02["long_run"]} <= {("smoothed", 20), ("solve_ivp LSODA", 1)}
    assert {"smoothed", "lsoda"} <= set(fig02["warm_up"])


@pytest.mark.parametrize(("off", "kept"), [(0.99, True), (1.01, False), (np.nan, False)])
def test_a_result_without_a_right_digit_is_left_out(off, kept):
    """Beside a reference whose last plate angle is off by nearly, and by more than, its largest."""
    case, = precision.cases(with_fields(TINY, scenes=("fig02",)))
    truth = reference(case.system, 4, "LSODA", 1e-9)
    truth.section[4, 1] += off * truth.size[1]
    row = precision.measured_row(case, "smoothed", 1e-9, truth, TINY)
    assert ("why" not in row) is kept


def row(solver, setting, error, seconds):
    return {"solver": solver, "setting": setting, **dict(zip(ERRORS, (error, 0.5 * error, 0.25 * error))),
            "seconds": seconds, "slowest": 2.0 * seconds, "steps": 7}


def by_hand(name, fast):
    """A scene whose best setting at 1e-6 takes `fast`, 24 ms and 300 ms for 4 cycles; one solver never gets there."""
    rows = [row("smoothed", 1e-9, 1e-6, fast), row("smoothed", 1e-8, 1.1e-6, 0.1 * fast),
            row("rk45", 1e-7, 1e-7, 24e-3), row("bdf", 1e-7, 1e-6, 0.3), row("rk4", 1, 1e-4, 1)]
    return {"scene": name, "description": "a | b", "cycles": 4, "reference": {"solvers": ["one", "two"], "floor": 1e-9},
            "results": rows, "omitted": [{"solver": "CVODE", "setting": 1e-4, "why": "not compiled"}],
            "long_run": [{"solver": "smoothed", "cycles": 100, "seconds_per_100_cycles": 5e-3}]}


def test_tables_have_the_numbers_of_the_rows():
    report = precision.report_of([by_hand("fig02", 2e-3), by_hand("other", 4e-3)], True, False)
    blocks = [[[cell.strip() for cell in line[2:-2].split(" | ")] for line in block.splitlines() if line[:1] == "|"]
              for block in precision.precision_tables(report).split("\n\n")]
    tables = {rows[0][0]: {cells[0]: cells[1:] for cells in rows[2:]} for rows in blocks if rows}
    of = {float(head.rpartition(" ")[2]): rows for head, rows in tables.items() if head.startswith("us a cycle, error")}
    assert of[1e-6] == {"smoothed": ["1", "500", "1000"], "rk45": ["6 to 12", "6000", "6000"],
                        "bdf": ["75 to 150", "75000", "75000"]}
    assert of[1e-3]["smoothed"] == ["1", "50", "100"]
    assert of[1e-3]["rk4"][1:] == ["250000", "250000"]
    assert of[1e-9] == {}
    assert next(rows for head, rows in tables.items() if "long run" in head) == {"smoothed": ["1", "50", "50"]}
    assert [rows[-1] for rows in (blocks[-1][2], blocks[-1][3])] == ["not compiled"] * 2


def test_the_command_writes_what_it_promises(tmp_path, pictures):
    folder = tmp_path / "out"
    words = ["precision", "--quick", "--scenes", "minimal, set-valued", "--width", "column", "--out", str(folder)]
    assert main(words) == 0
    written = valid("precision", json.loads((folder / "precision.json").read_text()), FIELDS)
    assert [r["scene"] for r in written["scenes"]] == ["minimal, set-valued"]
    assert {r["solver"] for r in written["results"]} == {"event_driven"}
    assert all(row.keys() <= FIELDS.keys() for row in (*written["scenes"], *written["results"]))
    assert {path.name for path in folder.iterdir()} == {f"precision.{end}" for end in ("json", "md", "png", "svg")}
    rows, keys, whole = written["results"], ("error_final", "error_section", "error_max_slip"), pictures[0]
    assert shows(whole, [r["seconds"] for r in rows], [max(1e-16, *(r[k] for k in keys)) for r in rows])
    labelled(whole)
    again = ["plot", str(folder / "precision.json"), "--plot", str(tmp_path / "again.png"), "--width", "column"]
    assert main(again) == 0
    assert len(same_pictures([whole, pictures[-1]], whole.get_figwidth())) > 1
    assert main(words) == 2


def test_the_picture_of_several_scenes_has_room(tmp_path, laid_out):
    names = [case.name for case in precision.cases(with_fields(TINY, scenes=()))]
    scenes = [by_hand(name, 1e-3 * k) | {"law": "smoothed"} for k, name in enumerate(names[:2], 1)]
    report = precision.report_of(scenes, True, False)
    tcc_sim.plot(document("precision", report, load_scene("fig02"), ["precision"]), tmp_path / "all.png")
    check(laid_out[0])


def test_another_scene_is_refused(refused):
    assert "fig03" in refused("precision", "--scenes", "fig03")
    with pytest.raises(InputError):
        precision.cases(with_fields(TINY, scenes=("fig02", "fig03")))
