"""The figures of the paper: their curves, numbers beside closed forms and SciPy, pictures of these numbers, files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import same_pictures, valid
from independent import smoothed_states
from pictures import check, labelled, shows

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.closed_forms import stick_margin
from tcc_sim.model.parameters import System
from tcc_sim.output.provenance import document
from tcc_sim.result import json_of
from tcc_sim.study.paper import measures
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, STATIC, FigureOptions, paper_system
from tcc_sim.study.paper.figures import coexisting, figure_data
from tcc_sim.sweeps.sweep import Curve, Plan, sweep_curves

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
    assert row.span == {5: (0.08, 0.30), 6: (0.55, 1.0)}.get(number, (0.05, 0.5))
    ratio = {6: 0.36, 7: 0.36, 12: 150.0 / OMEGA_N}.get(number)
    assert ratio is None or by_name["omega"] == pytest.approx([ratio] * len(systems))
    if number > 3:  # mu_s N R stays where mu_k changes.
        assert {round(STATIC * 0.08 * 0.1 * s.pressure.mean, 9) for s in systems} == {540.0}


def test_constants_are_those_of_the_paper() -> None:
    assert list(FIGURES) == list(range(2, 19))
    assert isinstance(paper_system(), System)
    assert paper_system(FIGURES[2].series[0].values).saturation_mean == pytest.approx(500.0)
    assert paper_system().natural_frequency == pytest.approx(OMEGA_N)
    assert FIGURES[8].marks == (pytest.approx(math.sqrt(3000.0 / 0.22) / OMEGA_N),)
    for axis, low, high, step in ((measures.FINER, 0.05, 0.5, 0.003), (measures.SPREAD, 0.14, 0.36, 0.001),
                                  (measures.AXIS, 0.05, 0.5, 0.005)):
        assert (axis[0], axis[-1]) == (low, high)
        np.testing.assert_allclose(np.diff(axis), step, atol=1.1e-6)


def written(number: int, folder: Path, *words: str) -> dict[str, Any]:
    """The numbers that the command writes for a figure."""
    assert main(["figure", str(number), "--quick", "--jobs", "1", *words, "--out", str(folder)]) == 0
    return valid("figure", json.loads((folder / f"fig{number:02d}.json").read_text()))


def test_the_law_of_fig_3_by_hand(tmp_path: Path, pictures: list[Any]) -> None:
    """mubar = tanh(sigma v) (1 + (r - 1) exp(-alpha |v|)), its slope by differences, and the slip branch of (6)."""
    data = written(3, tmp_path, "--width", "column", "--title", "Friction")
    v, near = np.array(data["slip_speed"]), np.array(data["near_slip_speed"])
    assert (v[0], v[-1], near[0], near[-1]) == (-2.0, 2.0, 0.0, 0.2)
    for curve, ratio in zip(data["curves"], (1.0, 1.0 / 0.8, 1.0 / 0.75, 1.0 / 0.677)):
        def law(x: Any, ratio: float = ratio) -> Any:
            return np.tanh(50.0 * x) * (1.0 + (ratio - 1.0) * np.exp(-2.0 * np.abs(x)))

        np.testing.assert_allclose(curve["coefficient"], law(v), atol=1e-12)
        np.testing.assert_allclose(curve["near_coefficient"], law(near), atol=1e-12)
        np.testing.assert_allclose(curve["near_set_valued"], 1.0 + (ratio - 1.0) * np.exp(-2.0 * near), atol=1e-12)
        slope = (law(near + 1e-6) - law(near - 1e-6))[1:] / 2e-6
        np.testing.assert_allclose(curve["near_slope"][1:], slope, rtol=1e-5, atol=1e-5)
        top = np.linspace(0.0, 0.5, 500_001)
        assert ratio == 1.0 or curve["peak"] == pytest.approx(law(top).max(), rel=1e-9)
        assert (curve["peak_slip_speed"] is None) == (ratio == 1.0)
        assert shows(pictures[0], v, curve["coefficient"])
        assert shows(pictures[0], near, curve["near_slope"])
    labelled(pictures[0])
    again = ["plot", str(tmp_path / "fig03.json"), "--plot", str(tmp_path / "a.png"), "--width", "column"]
    assert main(again) == 0
    same_pictures([pictures[0], pictures[-1]], pictures[0].get_figwidth())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "fig03.json", "fig03.png", "fig03.svg"]
    (tmp_path / "fig03.png").write_text("mine")
    assert main(["figure", "3", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "fig03.png").read_text() == "mine"
    assert main(["figure", "3", "--out", str(tmp_path), "--force"]) == 0


def test_the_curves_of_a_map_are_those_of_a_solve_by_scipy(tmp_path: Path, pictures: list[Any]) -> None:
    """Fig. 13 at a frequency, beside cycles 50 to 65 from (13)."""
    data = written(13, tmp_path)
    assert (data["axis"], data["x"][0], data["x"][-1]) == ("omega/omega_n", 0.05, 0.5)
    assert [c["label"] for c in data["curves"]] == [s.label for s in FIGURES[13].series]
    assert (data["cycles"], data["discarded"]) == (100, 50)
    curve, k = data["curves"][3], 30
    values = {**FIGURES[13].series[3].values, "engine.frequency": data["x"][k] * OMEGA_N}
    states = smoothed_states(paper_system(values), [150.0, 0.0, 0.0, 0.0], 65, 200, rtol=1e-6)
    assert curve["max_slip_speed"][k] == pytest.approx(np.abs(states[50 * 200:, 0]).max(), rel=2e-3)
    assert curve["min_slip_speed"][k] == pytest.approx(states[50 * 200:, 0].min(), abs=0.05)
    section = states[-1, 1]
    assert min(abs(section - x) for x in curve["theta2"][k]) < 1e-4
    for curve in data["curves"]:
        settled = [m if s else None for m, s in zip(curve["max_slip_speed"], curve["settled"])]
        assert shows(pictures[0], data["x"], np.array(settled, float))
    labelled(pictures[0])


@pytest.mark.parametrize(("number", "span", "count", "options"), [
    (5, (0.08, 0.30), 7, FigureOptions(jobs=1)), (6, (0.55, 1.0), 12, FigureOptions(
        quick=True, direction="down", law="set_valued", jobs=1)),
    (14, (0.3, 0.4), 9, FigureOptions(law="set_valued", jobs=1, branches=True))])
def test_every_kind_of_sweep_is_computed_and_drawn(number: int, span: tuple[float, float], count: int,
                                                   options: FigureOptions, tmp_path: Path, laid_out: list[Any]) -> None:
    """With fewer values than the paper's; a sweep of Fig. 14 has jumps and several branches behind it."""
    row = replace(FIGURES[number], span=span, count=4 * count - 3 if options.quick else count,
                  series=FIGURES[number].series[:1])
    data = json_of(document("figure", figure_data(row, options), paper_system(), ["figure"]))
    valid("figure", json.loads(json.dumps(data, allow_nan=False)))
    tcc_sim.plot(data, tmp_path / "a.png", "column", units="rpm")
    for axis in (axis for axis in laid_out[0].axes if "rad/s" in axis.get_ylabel()):  # In every unit.
        ticks = [axis.yaxis.get_major_formatter()(at).replace("\N{MINUS SIGN}", "-") for at in axis.get_yticks()]
        np.testing.assert_allclose(np.array(ticks, float), axis.get_yticks(), atol=1e-9)
    assert (data["figure"], data["kind"], data["law"]) == (number, row.kind, options.law)
    np.testing.assert_allclose(data["x"], np.linspace(*span, count))
    assert data["axis"] == ("mu_k/mu_s" if number == 6 else "omega/omega_n")
    curve, = data["curves"]
    assert curve["direction"] == ("down" if number == 6 else "cold")
    settled = [m if s and not r else None for m, s, r in zip(curve["max_slip_speed"], curve["settled"],
                                                             curve["runaway"])]
    if number == 6:
        points = [(x, angle) for x, values, s in zip(data["x"], curve["theta2"], curve["settled"])
                  for angle in (values or ())[:20] if s]
        assert shows(laid_out[0], *zip(*points))
    else:
        assert shows(laid_out[0], data["x"], np.array(settled, float))
    if number == 5:
        assert data["threshold"] == -0.6
        assert shows(laid_out[0], data["x"], np.array(curve["negative_slope_mean"], float))
    else:
        assert all(values is None or len(values) >= 30 for values in curve["theta2"])
    assert options.branches == bool(curve.get("branches"))
    for branch in curve.get("branches", ()):
        stable = [m if s else math.nan for m, s in zip(branch["max_slip_speed"], branch["stable"])]
        assert not any(branch["stable"]) or shows(laid_out[0], [x / OMEGA_N for x in branch["value"]],
                                                  np.array(stable, float), rtol=1e-6)
    assert {jump["cause"] for jump in curve.get("jumps", ())} == ({"period_doubling", "aperiodic"} if number == 14
                                                                  else set())
    check(laid_out[0])


@pytest.mark.parametrize(("number", "words"), [(9, ("--width", "column")), (12, ())])
def test_time_histories_are_those_of_scipy(number: int, words: tuple[str, ...], tmp_path: Path, pictures: list[Any]
                                           ) -> None:
    """By the largest slip speed; the periods of Fig. 12 are those of (35), the halves of Fig. 9 by the paper's text."""
    data = written(number, tmp_path, *words)
    assert all(shows(pictures[0], panel["t"], panel["slip_speed"]) for panel in data["panels"])
    assert {panel["t"][0] for panel in data["panels"]} == {0.0}
    if number == 12:
        states = smoothed_states(paper_system(FIGURES[12].series[0].values), [150.0, 0.0, 0.0, 0.0], 60, 100, rtol=1e-4)
        assert np.abs(data["panels"][0]["slip_speed"]).max() == pytest.approx(np.abs(states[-400:, 0]).max(), rel=0.01)
        assert [panel["period"] for panel in data["panels"]] == [2, 3, 3]
    if number == 9:
        parts = [panel["first_half"] for panel in data["panels"]]
        assert min(parts[:2]) > 0.8 > 0.2 > max(parts[2:])
    labelled(pictures[0])


@pytest.mark.usefixtures("pictures")
def test_the_command_takes_law_direction_and_branches(tmp_path: Path) -> None:
    data = written(6, tmp_path, "--law", "set_valued", "--direction", "down")
    assert (data["law"], *(curve["direction"] for curve in data["curves"])) == ("set_valued", "down")
    assert main(["figure", "12", "--quick", "--branches", "--out", str(tmp_path)]) == 0
    panels = json.loads((tmp_path / "fig12.json").read_text())["panels"]
    assert [panel["orbit"]["period"] for panel in panels] == [2, 3, 3]


def test_figure_2_shows_where_each_law_settles(tmp_path: Path, laid_out: list[Any]) -> None:
    """From (13): the paper's smoothing in period one, a sharper one and the set-valued law in period two."""
    data = written(2, tmp_path)
    assert [(s["period"], s["settled"]) for s in data["steady"]] == [(1, True), (2, True), (2, True)]
    assert [s["max_slip_speed"] for s in data["steady"]] == pytest.approx([36.297, 63.657, 63.742], abs=5e-3)
    v = data["curves"][0]["slip_speed"]
    assert v[0] == pytest.approx(v[-1], abs=1e-4)  # The solvers start on this motion: its cycle closes.
    t = np.array(data["curves"][0]["t"]) * data["cycle"]
    for curve in data["curves"]:
        assert shows(laid_out[0], t[:len(curve["t"])], curve["slip_speed"]) or curve["solver"] != "smoothed"
    close = {c["solver"]: c["rms_difference"] for c in data["curves"]}
    assert max(close["rk45"], close["bdf"]) < 1e-3
    check(laid_out[0])
    data["curves"][-1]["rms_difference"] = None  # As of a solver that stopped.
    (tmp_path / "stopped.json").write_text(json.dumps(data))
    assert main(["plot", str(tmp_path / "stopped.json"), "--plot", str(tmp_path / "stopped.png")]) == 0


def test_a_spike_of_a_cold_start_is_apart_from_the_coexisting_motion() -> None:
    """Fig. 14, psi = 0: at 0.1304 the cold start slips; from either neighbour's state it is the pure stick of (10)."""
    series = FIGURES[14].series[0]
    axis = np.linspace(0.05, 0.5, 57)[9:12]
    curve = Curve(paper_system(series.values), "engine.frequency", tuple(float(x) * OMEGA_N for x in axis))
    swept = sweep_curves([curve], Plan(cycles=300, discard=250), jobs=1)[0]  # Chaotic transients last up to 80.
    result = coexisting(swept, 1)
    assert stick_margin(curve.at(1)).sticks
    assert {row.index for row in result} == {1}
    assert all(row.spike and row.max_slip_speed > 20.0 and row.other.max_slip_speed < 0.2 for row in result)
    point = swept.points[1]  # A motion without a period scatters: no other one is sought beside it.
    wild = replace(point, summary=replace(point.summary, period=0))
    for points in ([swept.points[0], wild, swept.points[2]], [None, point, None]):
        assert coexisting(replace(swept, points=points), 1) == []


def test_figures_share_the_curves_that_they_have_in_common() -> None:
    """Fig. 11 takes the curve omega_f = omega of Fig. 10 without a new sweep."""
    options = FigureOptions(quick=True, law="set_valued")
    first = figure_data(FIGURES[10], options)
    swept = dict(options.kept)
    second = figure_data(FIGURES[11], options)
    assert (len(swept), len(options.kept)) == (3, 5)
    assert first.curves[1].max_slip_speed == second.curves[1].max_slip_speed


def test_the_function_computes_and_draws_a_figure(tmp_path: Path, pictures: list[Any]) -> None:
    data = tcc_sim.figure(3, out=tmp_path / "of" / "figures")
    assert (data.figure, data.kind) == (3, "law")
    assert {path.name for path in (tmp_path / "of" / "figures").iterdir()} == {"fig03.png", "fig03.svg"}
    for number, how in ((7, {"direction": "up"}), (3, {"law": "set_valued"}), (9, {"branches": True}), (1, {})):
        with pytest.raises(InputError, match=str(number)):
            tcc_sim.figure(number, **how)


@pytest.mark.parametrize("words", [["1"], ["x"], ["19"], ["7", "--direction", "up"], ["4", "--jobs", "0"],
                                   ["all", "--title", "a title"]])
def test_wrong_words_are_one_line(words: list[str], refused: Callable[..., str]) -> None:
    assert words[-1] in refused("figure", *words) or "title" in words[1]
