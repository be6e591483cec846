"""The figures of the paper: contents, numbers beside closed forms, and files that are not overwritten."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import same_pictures, valid
from legends import title_of
from scipy.integrate import solve_ivp

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.pure_stick import stick_margin
from tcc_sim.output.files import write_json
from tcc_sim.output.provenance import document
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks.references import Law
from tcc_sim.study.paper import drawings, figures
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, STATIC, FigureOptions, paper_system
from tcc_sim.study.paper.evidence import first_half
from tcc_sim.study.paper.figure_results import Figure
from tcc_sim.study.paper.figures import coexisting, figure_data, figure_system, stands_out
from tcc_sim.sweeps.sweep import Curve, Plan, sweep_curves
from tcc_sim.views import style


def test_every_figure_from_2_to_18_has_a_row() -> None:
    assert list(FIGURES) == list(range(2, 19))
    for row in FIGURES.values():
        for series in row.series:
            assert isinstance(paper_system(series.values), System)
        if row.kind in ("map", "damping", "orbit"):
            assert row.count >= 200


FALLING, THIRDS, HALVES, PHASES = (1.0, 0.83, 0.75, 0.667), (2 / 3, 1.0, 4 / 3), (0.5, 1.0, 2.0), (0.0, 0.5, 1.0)


@pytest.mark.parametrize(("number", "of", "expected", "kinetic", "amplitude"), [
    (2, "omega", [150.0 / OMEGA_N], 0.8, 0.2), (3, "mu_k", [1.0, 0.8, 0.75, 0.677], None, 0.0),
    (4, "mu_k", FALLING, None, 0.0), (5, "mu_k", [0.667], None, 0.0), (6, "omega", [0.36], 1.0, 0.0),
    (7, "mu_k", [0.94, 0.74, 0.64], None, 0.0), (8, "psi", PHASES, 1.0, 0.25),
    (9, "omega", [0.15, 0.18, 0.37, 0.40], 1.0, 0.0), (10, "omega_f", HALVES, 1.0, 0.25),
    (11, "omega_f", THIRDS, 1.0, 0.25), (12, "omega_f", [0.5, 2 / 3, 4 / 3], 1.0, 0.25),
    (13, "Tsp", [0.0, 0.125, 0.25, 0.5], 1.0, None), (14, "psi", PHASES, 0.75, 0.25), (15, "psi", PHASES, 0.67, 0.25),
    (16, "omega_f", HALVES, 0.75, 0.25), (17, "omega_f", THIRDS, 0.75, 0.25),
    (18, "Tsp", [0.0, 0.125, 0.25, 0.5], 0.75, None)])
def test_the_curves_of_a_figure_are_the_paper_s(number: int, of: str, expected: list[float], kinetic: float | None,
                                                amplitude: float | None) -> None:
    """Captions and legends of the paper: values that differ between curves, and values of all curves."""
    row = FIGURES[number]
    systems = [paper_system(series.values) for series in row.series]
    by_name = {"mu_k": [1.0 / s.friction_ratio for s in systems], "psi": [s.pressure.phase / math.pi for s in systems],
               "omega": [s.engine.frequency / OMEGA_N for s in systems], "Tsp": [
                 s.pressure.amplitude / s.pressure.mean for s in systems],
               "omega_f": [s.pressure.frequency_ratio for s in systems]}
    assert by_name[of] == pytest.approx(list(expected))
    assert kinetic is None or by_name["mu_k"] == pytest.approx([kinetic] * len(systems))
    assert amplitude is None or by_name["Tsp"] == pytest.approx([amplitude] * len(systems))
    spans = {5: (0.08, 0.30), 6: (0.55, 1.0)}
    assert row.span == spans.get(number, (0.05, 0.5))
    ratio = {6: 0.36, 7: 0.36, 12: 150.0 / OMEGA_N}.get(number)
    assert ratio is None or by_name["omega"] == pytest.approx([ratio] * len(systems))


def test_the_axes_of_the_claims_are_those_that_they_name() -> None:
    """First and last value and step of each axis, as in the criteria and on the page."""
    from tcc_sim.study.paper import claims_jumps, claims_methods, claims_periods, claims_stick, rules

    for axis, low, high, step in (
            (rules.FINER, 0.05, 0.5, 0.003), (rules.SPREAD, 0.14, 0.36, 0.001), (rules.AXIS, 0.05, 0.5, 0.005),
            (claims_jumps.about(0.2, rules.WIDE, 21), 0.16, 0.24, 0.004),
            (claims_jumps.about(0.35), 0.33, 0.37, 0.04 / 14), (claims_jumps.about(0.2, 0.01), 0.19, 0.21, 0.02 / 14),
            (claims_periods.FALLS, 0.56, 0.83, 0.01),
            (claims_methods.DAMPED, 0.08, 0.30, 0.002), (claims_periods.RATIOS, 0.55, 1.0, 0.005),
            (claims_stick.STICKING, 0.05, 0.25, 0.001), (claims_stick.HIGHER, 0.305, 0.455, 0.005)):
        assert (axis[0], axis[-1]) == (low, high)
        np.testing.assert_allclose(np.diff(axis), step, atol=1.1e-6)


def test_sections_five_and_six_keep_the_normal_load() -> None:
    for number in (4, 14, 15, 16, 17, 18):
        for series in FIGURES[number].series:
            system = paper_system(series.values)
            assert STATIC * 0.08 * 0.1 * system.pressure.mean == pytest.approx(540.0)
    assert paper_system(FIGURES[2].series[0].values).saturation_mean == pytest.approx(500.0)
    assert paper_system().natural_frequency == pytest.approx(OMEGA_N)
    assert FIGURES[8].marks == (pytest.approx(math.sqrt(3000.0 / 0.22) / OMEGA_N),)


def test_a_map_has_a_curve_per_series_and_enough_section_points(figures: list[Any], tmp_path: Path) -> None:
    words = ["figure", "13", "--quick", "--law", "set_valued", "--out", str(tmp_path)]
    assert main(words) == 0
    data = valid("figure", json.loads((tmp_path / "fig13.json").read_text()))
    assert data["axis"] == "omega/omega_n"
    assert (data["x"][0], data["x"][-1]) == (0.05, 0.5)
    assert [c["label"] for c in data["curves"]] == [s.label for s in FIGURES[13].series]
    for curve in data["curves"]:
        assert len(curve["max_slip_speed"]) == len(data["x"])
        assert min(map(len, curve["theta2"])) >= 30
        # The highest frequency is pure stick for the smaller amplitudes: (8) gives the plate angle at t = 0.
        if curve["regime"][-1] == "stick":
            assert curve["max_slip_speed"][-1] == pytest.approx(0.0, abs=1e-9)
            omega = 0.5 * OMEGA_N
            angle = 0.1 + 250.0 * (1.0 / (3000.0 - 0.22 * omega**2 + 0.6j * omega)).imag
            assert curve["theta2"][-1][-1] == pytest.approx(angle, abs=2e-4)
    assert sum(c["regime"][-1] == "stick" for c in data["curves"]) >= 1
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".json", ".png", ".svg"]


@pytest.mark.parametrize(("number", "periods"), [(9, None), (12, [2, 3, 3])])
def test_figures_without_a_sweep_are_drawn(number: int, periods: list[int] | None, figures: list[Any],
                                           tmp_path: Path) -> None:
    """The periods of Fig. 12 are those of (35)."""
    assert main(["figure", str(number), "--out", str(tmp_path)]) == 0
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".json", ".png", ".svg"]
    result = valid("figure", json.loads((tmp_path / f"fig{number:02d}.json").read_text()))
    assert result["figure"] == number
    assert periods is None or [panel["period"] for panel in result["panels"]] == periods


def test_a_figure_in_a_column_has_its_title_and_is_redrawn_so(figures: list[Any], tmp_path: Path,
                                                              capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--width", "column", "--title", "Friction"]
    assert main(["figure", "3", *words, "--out", str(tmp_path)]) == 0
    assert valid("figure", json.loads((tmp_path / "fig03.json").read_text()))["figure"] == 3
    assert main(["plot", str(tmp_path / "fig03.json"), "--plot", str(tmp_path / "a.png"), "--width", "column"]) == 0
    same_pictures(figures, style.COLUMN)
    assert {title_of(drawn) for drawn in figures} == {"Friction"}
    (tmp_path / "fig03.png").write_text("mine")
    assert main(["figure", "3", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "fig03.png").read_text() == "mine"
    assert main(["figure", "3", "--out", str(tmp_path), "--force"]) == 0
    capsys.readouterr()
    assert main(["figure", "all", *words, "--out", str(tmp_path / "all")]) == 2
    assert "--title is for one figure" in capsys.readouterr().err


def as_written(number: int, data: Figure, folder: Path) -> dict[str, Any]:
    """Return the numbers in a figure's file after a check against the schema."""
    file = folder / f"fig{number:02d}.json"
    write_json(file, document("figure", data, figure_system(number, FigureOptions(quick=True)),
                              ["figure", str(number)]))
    return valid("figure", json.loads(file.read_text()))


@pytest.mark.parametrize(("number", "kind"), [(5, "damping"), (6, "orbit"), (7, "histories")])
def test_the_numbers_of_every_kind_are_what_the_schema_says(number: int, kind: str, figures: list[Any], tmp_path: Path,
                                                            monkeypatch: pytest.MonkeyPatch) -> None:
    """With few values, since the schema does not count them; other tests draw and check the other kinds."""
    monkeypatch.setitem(FIGURES, number, replace(FIGURES[number], count=16))
    result = as_written(number, figure_data(number, FigureOptions(quick=True)), tmp_path)
    assert (result["figure"], result["kind"]) == (number, kind)
    assert main(["plot", str(tmp_path / f"fig{number:02d}.json"), "--plot", str(tmp_path / "again.png")]) == 0
    if kind == "orbit":
        assert result["axis"] == "mu_k/mu_s"
        assert all(len(curve["theta2"]) == len(result["x"]) for curve in result["curves"])
        assert [curve["direction"] for curve in result["curves"]] == ["cold", "up", "down"]


def test_figure_2_shows_where_each_law_settles(figures: list[Any], tmp_path: Path) -> None:
    """From (13): the paper's smoothing in period one, a sharper one and the set-valued law in period two."""
    data = figure_data(2, FigureOptions(quick=True))
    assert as_written(2, data, tmp_path)["kind"] == "solvers"
    assert main(["plot", str(tmp_path / "fig02.json"), "--plot", str(tmp_path / "fig02.png")]) == 0
    assert [(s.period, s.settled) for s in data.steady] == [(1, True), (2, True), (2, True)]
    # The first by SciPy over a cycle; the others are the motion of Fig. 2 nearly and exactly without smoothing.
    system = paper_system(FIGURES[2].series[0].values)
    law = Law(system)
    run = solve_ivp(lambda t, y: law.rates(t, y, 3)[:3], (0.0, system.cycle), data.steady[0].final, method="Radau",
                    rtol=1e-9, atol=1e-10, max_step=system.cycle / 400)
    assert data.steady[0].max_slip_speed == pytest.approx(float(np.abs(run.y[0]).max()), rel=1e-4)
    sharper, exact = (s.max_slip_speed for s in data.steady[1:])
    assert sharper == pytest.approx(exact, rel=2e-3)
    # The solvers start on this motion: the first curve closes after its cycle.
    v = data.curves[0].slip_speed
    assert v[0] == pytest.approx(v[-1], abs=1e-4)
    for symbol in ("T_m", "T_p", r"\psi", r"\Omega_e"):
        assert symbol in data.caption


def test_a_spike_of_a_cold_start_is_told_from_what_coexists() -> None:
    """Fig. 14, psi = 0: at 0.1304 the cold start slips; from either neighbour's state it is the pure stick of (10)."""
    series = FIGURES[14].series[0]
    axis = np.linspace(0.05, 0.5, 57)[9:12]
    curve = Curve(paper_system(series.values), "engine.frequency", tuple(float(x) * OMEGA_N for x in axis))
    swept = sweep_curves([curve], Plan(cycles=300, discard=250), jobs=1)[0]  # Chaotic transients last up to 80.
    result = coexisting(swept, 1)
    assert stick_margin(curve.at(1)).sticks
    assert {row.index for row in result} == {1}
    assert all(row.spike and row.max_slip_speed > 20.0 and row.other.max_slip_speed < 0.2 for row in result)
    assert not stands_out(np.array([0.0, 5.0, 9.0]), 1, 1.0)
    assert not stands_out(np.array([9.0, 5.0]), 1, 1.0)
    assert stands_out(np.array([9.0, 5.0, 9.0]), 1, 1.0)


def test_figures_share_the_curves_that_they_have_in_common() -> None:
    """Fig. 11 takes the curve omega_f = omega of Fig. 10 without a new sweep."""
    options = FigureOptions(quick=True, law="set_valued")
    first = figure_data(10, options)
    swept = dict(options.kept)
    second = figure_data(11, options)
    assert (len(swept), len(options.kept)) == (3, 5)
    assert all(options.kept[curve] is each for curve, each in swept.items())
    assert first.curves[1].max_slip_speed == second.curves[1].max_slip_speed


def test_the_first_half_cycle_counts_the_way_slipped() -> None:
    late = paper_system({"friction.law": "set_valued", "engine.frequency": 0.40 * OMEGA_N})
    start = solve(late, cycles=60).final
    assert 0.0 <= first_half(solve(late, cycles=2, samples_per_cycle=400, start_cycle=60, state=start)) < 0.05
    still = paper_system({"friction.law": "set_valued", "engine.torque_amplitude": 0.0, "initial.slip_speed": 0.0,
                          "initial.plate_angle": 0.1})
    assert math.isnan(first_half(solve(still, cycles=2, samples_per_cycle=50)))


def test_an_orbit_over_the_friction_ratio_goes_in_all_directions_unless_told() -> None:
    with pytest.raises(InputError, match="figure 1 has no numbers; the figures are 2 to 18"):
        figure_data(1, FigureOptions())
    quick = figure_data(6, FigureOptions(quick=True, law="set_valued", direction="down"))
    assert [c.direction for c in quick.curves] == ["down"]
    assert np.isfinite([x for x in quick.curves[0].max_slip_speed if x is not None]).all()


def test_the_function_computes_and_draws_a_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(figures, "figure_data", lambda number, options: (number, options))
    monkeypatch.setattr(drawings, "draw", lambda data, path: drawn.append((data, path)))
    data: Any = drawings.paper_figure(8, quick=True, direction="up", law="set_valued", jobs=3, branches=True)
    assert data == (8, FigureOptions(True, "up", "set_valued", 3, branches=True))
    assert drawn == []
    data = drawings.paper_figure(8, out=tmp_path / "of" / "figures")
    assert data == (8, FigureOptions())
    assert drawn == [(data, tmp_path / "of" / "figures" / "fig08")]
    assert (tmp_path / "of" / "figures").is_dir()
    for number, how, words in ((7, {"direction": "up"}, "direction is up; Fig. 7 has no sweep"),
                               (3, {"law": "set_valued"}, "law is set_valued; Fig. 3 shows both laws"),
                               (9, {"branches": True}, "Fig. 9 has no points on branches; --branches is for 4, 6, 8, "
                                "10, 11, 12, 13, 14, 15, 16, 17, 18")):
        with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
            drawings.paper_figure(number, **how)  # type: ignore[arg-type]
