"""Figures with branches and charts: what is refused, what is drawn from given numbers, and borders of known places."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import numpy as np
import pytest
from documents import valid
from given import curve_of, curves_of, figure_of

from tcc_sim.basins.compute import Axis, Basins
from tcc_sim.basins.proximity import Attractor
from tcc_sim.benchmarks import motions
from tcc_sim.cli import main
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.model.pure_stick import constant_load_limits
from tcc_sim.paper import branches_behind, figures
from tcc_sim.paper.branch_panels import spread, top_of
from tcc_sim.paper.branches_behind import creeps, motions_behind, motions_behind_each
from tcc_sim.paper.catalogue import CHARTS, FIGURES, OMEGA_N, FigureOptions, PaperFigure, paper_system, plain
from tcc_sim.paper.drawings import draw
from tcc_sim.paper.figure_results import (
    Actuation,
    ActuationOnBranch,
    Chart,
    ChartCurve,
    Curves,
    Figure,
    JumpBehind,
    MapCurve,
    MotionsBehind,
)
from tcc_sim.paper.histories import orbit_words
from tcc_sim.sweeps.sweep import Curve, Plan, sweep_curves


@pytest.mark.parametrize("words", [["2", "--branches"], ["3", "--branches"], ["5", "--branches"], ["7", "--branches"],
                                   ["9", "--branches"], ["19", "--branches"], ["21"], ["19", "--direction", "up"]])
def test_what_makes_no_sense_is_refused_in_one_line(words: list[str], tmp_path: Path, capsys) -> None:  # type: ignore
    assert main(["figure", *words, "--out", str(tmp_path / "new")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_charts_are_numbered_on_from_the_paper_s_figures() -> None:
    assert list(CHARTS) == [max(FIGURES) + 1, max(FIGURES) + 2]
    assert {row.second for row in CHARTS.values()} == {"friction.kinetic_coefficient", "pressure.phase"}


def test_pure_stick_under_the_set_valued_law_lies_on_one_branch_without_a_jump() -> None:
    """Above the end of stick by (10) the motion from rest is stuck: period one, no slip, multipliers exp(lambda T),
    0.
    """
    system = paper_system({"friction.law": "set_valued", "initial.slip_speed": 0.0, "initial.plate_angle": 0.1})
    values = tuple(np.linspace(0.45, 0.47, 3) * OMEGA_N)
    found, = motions_behind(sweep_curves([Curve(system, "engine.frequency", values)], Plan(cycles=150, discard=50)))
    branch, = found.branches
    assert (branch["period"], found.bifurcations, found.jumps) == (1, [], [])
    assert set(branch["events"]) == {"S"}
    for value, multipliers in zip(branch["value"], branch["multipliers"]):
        size = math.exp(-0.6 / (2.0 * 0.22) * 2.0 * math.pi / value)
        assert [math.hypot(*m) for m in multipliers] == pytest.approx([size, size, 0.0], abs=1e-7)


def test_curves_followed_in_processes_are_those_followed_one_by_one() -> None:
    curves = [Curve(paper_system({"friction.kinetic_coefficient": ratio * 0.3, "initial.slip_speed": 0.0}),
                    "engine.frequency", (0.47 * OMEGA_N, 0.49 * OMEGA_N)) for ratio in (0.9, 0.95)]
    sweeps = sweep_curves(curves, Plan(cycles=100, discard=50))
    assert motions_behind_each(sweeps, jobs=2) == motions_behind_each(sweeps, jobs=1)


def test_a_chart_leaves_out_what_no_stable_motion_ends_in() -> None:
    orbit = SimpleNamespace(period=1, multipliers=np.array([1.4, 1.0, 0.0]))
    found: Any = SimpleNamespace(kind="fold", value=1.0, point=SimpleNamespace(orbit=orbit))
    of: Any = SimpleNamespace(forcing_period=1)
    ranges = ParameterRange(0.0, 2.0), ParameterRange(0.0, 2.0)
    assert branches_behind.followed(found, of, ranges, 1.0, []) is None


def test_the_end_of_stick_is_told_by_its_creep() -> None:
    def at(slip: float, kind: str = "fold") -> Any:
        return SimpleNamespace(kind=kind,
                               point=SimpleNamespace(orbit=SimpleNamespace(seen=SimpleNamespace(largest=slip))))

    system = paper_system({"friction.kinetic_coefficient": 0.25})
    assert creeps(at(0.08), system)
    assert not creeps(at(5.0), system)
    assert not creeps(at(0.08, "grazing_sliding"), system)
    assert not creeps(at(0.08), paper_system({"friction.law": "set_valued"}))


def test_stick_borders_are_those_of_the_closed_form_whatever_mu_k() -> None:
    limit = constant_load_limits(paper_system())[-1]
    ranges = ParameterRange(0.3 * OMEGA_N, 0.5 * OMEGA_N), ParameterRange(0.165, 0.29)
    keys = ("engine.frequency", "friction.kinetic_coefficient")
    border, = branches_behind.stick_borders(paper_system(), keys, ranges, 40)
    assert list(border.value) == pytest.approx([limit] * len(border.value), rel=1e-6)
    assert (min(border.second), max(border.second)) == (pytest.approx(0.165), pytest.approx(0.29))


def test_the_distance_from_a_line() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    assert branches_behind.distance(np.array([0.5, 0.3]), line) == pytest.approx(0.3)
    assert branches_behind.distance(np.array([2.0, 1.0]), line) == pytest.approx(1.0)
    assert branches_behind.distance(np.array([-3.0, -4.0]), line) == pytest.approx(5.0)
    assert branches_behind.distance(np.array([3.0, 4.0]), line[:1]) == pytest.approx(5.0)


def test_a_panel_says_what_its_orbit_is() -> None:
    t = np.zeros(2)
    assert orbit_words(Actuation("a", {}, 2, t, t, t, t)) == ""
    orbit = {"stable": True, "multipliers": [[0.3, 0.4], [0.3, -0.4], [0.0, 0.0]]}
    assert orbit_words(ActuationOnBranch("a", {}, 2, t, t, t, t, orbit)) == ", stable: largest Floquet multiplier 0.5"


def test_labels_are_moved_apart_in_order() -> None:
    placed = spread([0.1, 0.1, 0.11, 0.5, 0.999], 0.05, 0.0, 1.0)
    assert placed == sorted(placed)
    assert np.diff(placed).min() >= 0.05 * (1.0 - 1e-6)
    assert placed[0] >= 0.0
    assert placed[-1] <= 1.0 + 1e-9
    assert spread([0.2, 0.8], 0.05, 0.0, 1.0) == [0.2, 0.8]
    assert spread([], 0.05, 0.0, 1.0) == []


def given_curve(jumps: list[JumpBehind] | None = None, **more: Any) -> MapCurve:
    """A curve with one branch that folds, and a jump there."""
    branch = {"period": 1, "origin": "start", "value": [20.0, 120.0, 150.0, 120.0], "slip_speed": [0.0] * 4,
              "plate_angle": [0.1] * 4, "plate_speed": [0.0] * 4, "max_slip_speed": [10.0, 20.0, 30.0, 40.0],
              "stick_fraction": [0.5] * 4, "stable": [True, True, False, False], "events": ["S+S"] * 4,
              "multipliers": [[[0.5, 0.0]] * 3] * 4, "ended": ["reached the end", "stopped"],
              "reasons": ["range", "canard"], "closed": False,
              "residual": [1e-12] * 4}
    fold = {"kind": "fold", "value": 150.0, "slip_speed": 0.0, "plate_angle": 0.1, "plate_speed": 0.0,
            "max_slip_speed": 30.0, "multipliers": [[1.0, 0.0]] * 3, "residual": 1e-11, "branch": 0, "period": 1}
    jump = JumpBehind(150.0, (145.0, 155.0), (29.0, 50.0), "fold", 0)
    behind = MotionsBehind([branch], [fold], [jump] if jumps is None else jumps, [])
    return curve_of(**{"largest": [10.0] * 11, "settled": [True] * 10 + [False], "behind": behind, **more})


def given_figure(number: int, kind: str, curves: list[MapCurve]) -> Figure[Curves]:
    return figure_of(kind, curves_of(curves), number)


def given_chart() -> Figure[Chart]:
    curves = [ChartCurve("fold, period 2", "fold", 2, True, [60.0, 70.0], [0.2, 0.25], ["one end", "other end"],
                         ["range", "step"], ()),
              ChartCurve("pure stick ends, by (10)", "stick_border", 1, False, [150.0, 150.0], [0.17, 0.29],
                         ["one end", "one end"], ["closed", "special"], ())]
    return figure_of("chart", Chart(
        "omega/omega_n", np.linspace(0.05, 0.5, 11).tolist(), OMEGA_N, "engine.frequency", "mu_k/mu_s", [0.6, 0.8, 1.0],
        0.3, "friction.kinetic_coefficient", 100, 50, curves, [[1, 2, 0, None, 3, 1, 1, 1, 1, 1, 1]] * 3,
        [["stick", *["slip"] * 10]] * 3), 19)


@pytest.mark.parametrize("data", [given_figure(4, "map", [given_curve(), given_curve(jumps=[])]),
                                  given_figure(6, "orbit", [given_curve(), given_curve(direction="up")]),
                                  given_chart()],
                         ids=["map", "orbit", "chart"])
def test_given_branches_are_drawn(data: Figure[Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    draw(data, tmp_path / "drawn")
    assert {p.suffix for p in tmp_path.iterdir()} == {".png", ".svg"}


def test_points_far_above_the_branches_are_counted_and_not_shown() -> None:
    curve = given_curve(largest=[10.0, 500.0, None, 10.0, 10.0], settled=[True, False, False, True, True])
    assert top_of([curve]) == (pytest.approx(1.12 * 40.0), 1)


def given_basins() -> Basins:
    orbit = Attractor(2, np.zeros((2, 3)), np.zeros(2, np.int64), np.array([0.25 + 0.0j]), 49.2, 0.1)
    plane = Axis("initial.slip_speed", (0.0, 60.0)), Axis("initial.plate_angle", (0.0, 0.1))
    return Basins(plane, (orbit,), np.array([[0, 0], [0, -1]], np.int16), np.full((2, 2), 16, np.int32), 1.0)


def test_the_generator_writes_page_pictures_and_numbers(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(figures.KINDS, "orbit", lambda row, options: curves_of([given_curve()]))
    monkeypatch.setitem(figures.KINDS, "chart", lambda row, options: given_chart().numbers)
    monkeypatch.setattr(motions, "basins", lambda *task, **how: [given_basins()])
    folder = tmp_path / "motions"
    assert motions.main(["--quick", "--jobs", "1", "--out", str(folder)]) == 0
    page = (folder / "motions.md").read_text()
    pictures = re.findall(r"\((pictures/[a-z_]+\.png)\)", page)
    assert len(pictures) == 4
    for picture in pictures:
        assert (folder / picture).read_bytes().startswith(b"\x89PNG")
    for name in ("motions_branches", "motions_chart_mu_k", "motions_chart_psi"):
        assert valid("figure", json.loads((folder / f"{name}.json").read_text()))["curves"]
    assert valid("basins", json.loads((folder / "motions_basins.json").read_text()))["attractors"]
    assert motions.main(["--quick", "--out", str(folder)]) == 2
    assert motions.main(["--jobs", "0", "--out", str(tmp_path / "other")]) == 2


def test_an_interrupted_page_leaves_nothing(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    def interrupted(row: PaperFigure, options: FigureOptions) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setitem(figures.KINDS, "chart", interrupted)
    assert motions.main(["--jobs", "1", "--out", str(tmp_path / "motions")]) == 130
    assert not list(tmp_path.iterdir())


def test_the_page_says_what_was_found() -> None:
    found = given_basins()
    branches = given_figure(6, "orbit", [given_curve(), given_curve(direction="up")])
    page = motions.motions_page(branches, {19: given_chart(), 20: given_chart()}, found)
    assert page.startswith("# Periodic motions\n")
    low, middle, share = (x / OMEGA_N for x in (20.0, 120.0, 150.0))
    for words in (f"| 1 | {low:.4f} to {share:.4f} | 2 of 4 | at the end of a range, {low:.6f}; in a canard, "
                  f"{middle:.6f} | fold {share:.6f} |", "is within 1e-11 of where it has it",
                  f"- fold: {share:.6f} (from (13), upward)", "Of 2 jumps in three sweeps 2 are bifurcations",
                  "| 2 | 49.2000 | 0.250000 | 0.1 | 75.000 % |", "Undecided: 25 %",
                  "- Chart 20 has 2 curves; 1 of 4 ends",
                  "| fold, period 2 (smoothed end of stick) | 1 | 0.1549 to 0.1807 | 0.6667 to 0.8333 |",
                  "Ends: 1 at the end of a range, 1 without a further point, 1 closed, 1 in a point of codimension",
                  "lead: 75.0 % to period 2 of 49.2 rad/s."):
        assert words in page, words
    assert len(page.split()) < 1500


def test_the_page_joins_jumps_that_nothing_is_known_of() -> None:
    unknown = [JumpBehind(x, (x, x), (size, size - 10.0), "aperiodic", None)
               for x, size in ((0.1, 90.0), (0.15, 80.0), (0.2, 70.0))]
    figure = given_figure(6, "orbit", [given_curve(jumps=unknown)])
    page = motions.motions_page(figure, {}, given_basins())
    lines = [line for line in page.splitlines() if line.startswith("- a motion")]
    unit = figure.numbers.unit
    assert lines == [f"- a motion without a period beside it: 3 places from {0.1 / unit:.6f} to {0.2 / unit:.6f}"]


def test_labels_are_said_without_their_typesetting() -> None:
    assert plain(r"$\omega_f = \frac{2}{3}\omega$") == "omega_f = 2/3 omega"


def test_all_figures_leave_branches_out_where_there_are_none(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    for kind in figures.KINDS:
        monkeypatch.setitem(figures.KINDS, kind, lambda row, options: curves_of([]))
    for number in FIGURES:
        assert figures.figure_data(number, FigureOptions(quick=True, branches=True)).figure == number
