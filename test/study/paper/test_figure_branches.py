"""Figures with branches: refusals, pictures of made-up numbers, and branches at known places."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from documents import same_pictures
from given import curve_of, curves_of, figure_of

from tcc_sim.output.provenance import document
from tcc_sim.study.paper import branches_behind
from tcc_sim.study.paper import figures as figure_numbers
from tcc_sim.study.paper.branch_panels import spread, top_of
from tcc_sim.study.paper.branches_behind import creeps, motions_behind, motions_behind_each
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, FigureOptions, paper_system, plain
from tcc_sim.study.paper.drawings import draw
from tcc_sim.study.paper.figure_results import Figure, JumpBehind, Labelled, MotionsBehind
from tcc_sim.sweeps.sweep import Curve, Plan, sweep_curves
from tcc_sim.views import style
from tcc_sim.views.plots import plot


def test_pure_stick_under_the_set_valued_law_lies_on_one_branch_without_a_jump() -> None:
    """Above the end of stick by (10) the motion from rest is stuck: period one, no slip, multipliers exp(lambda T),
    0.
    """
    system = paper_system({"friction.law": "set_valued", "initial.slip_speed": 0.0, "initial.plate_angle": 0.1})
    values = tuple(np.linspace(0.45, 0.47, 3) * OMEGA_N)
    result, = motions_behind(sweep_curves([Curve(system, "engine.frequency", values)], Plan(cycles=150, discard=50)))
    branch, = result.branches
    assert (branch["period"], result.bifurcations, result.jumps) == (1, [], [])
    assert set(branch["events"]) == {"S"}
    for value, multipliers in zip(branch["value"], branch["multipliers"]):
        size = math.exp(-0.6 / (2.0 * 0.22) * 2.0 * math.pi / value)
        assert [math.hypot(*m) for m in multipliers] == pytest.approx([size, size, 0.0], abs=1e-7)


def copied(value: Any) -> Any:
    """Return a value as another process receives it."""
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_curves_followed_in_processes_are_those_followed_one_by_one(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(branches_behind, "each_in_a_process", lambda work, parts, *how: [
        copied(copied(work)(copied(part))) for part in parts])
    curves = [Curve(paper_system({"friction.kinetic_coefficient": ratio * 0.3, "initial.slip_speed": 0.0}),
                    "engine.frequency", (0.47 * OMEGA_N, 0.49 * OMEGA_N)) for ratio in (0.9, 0.95)]
    sweeps = sweep_curves(curves, Plan(cycles=100, discard=50))
    assert motions_behind_each(sweeps, jobs=2) == motions_behind_each(sweeps, jobs=1)


def test_the_end_of_stick_is_told_by_its_creep() -> None:
    def at(slip: float, kind: str = "fold") -> Any:
        return SimpleNamespace(kind=kind,
                               point=SimpleNamespace(orbit=SimpleNamespace(seen=SimpleNamespace(largest=slip))))

    system = paper_system({"friction.kinetic_coefficient": 0.25})
    assert creeps(at(0.08), system)
    assert not creeps(at(5.0), system)
    assert not creeps(at(0.08, "grazing_sliding"), system)
    assert not creeps(at(0.08), paper_system({"friction.law": "set_valued"}))


@pytest.mark.parametrize(("places", "least", "moved"), [
    ([0.1, 0.1, 0.11, 0.5, 0.999], 0.05, [0.16 / 3.0, 0.16 / 3.0 + 0.05, 0.16 / 3.0 + 0.1, 0.5, 0.999]), ([], 0.05, []),
    ([0.2, 0.8], 0.05, [0.2, 0.8]), ([0.0, 0.0], 0.1, [0.0, 0.1]), ([1.0, 1.0], 0.1, [0.9, 1.0]), ([2.0], 0.1, [1.0]),
    ([0.9, 0.9], 0.5, [0.5, 1.0]), ([0.9, 0.9], 0.51, [0.645, 1.155])])
def test_labels_are_moved_apart_about_their_mean(places: list[float], least: float, moved: list[float]) -> None:
    """Within 0 to 1 where they have room."""
    assert spread(places, least, 0.0, 1.0) == pytest.approx(moved)


def given_curve(jumps: list[JumpBehind] | None = None, **more: Any) -> Labelled:
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


def given_figure(number: int, kind: str, curves: list[Labelled]) -> Figure:
    return figure_of(kind, curves_of(curves), number)


@pytest.mark.parametrize("data", [given_figure(4, "map", [given_curve(), given_curve(jumps=[])]),
                                  given_figure(6, "orbit", [given_curve(), given_curve(direction="up")])],
                         ids=["map", "orbit"])
def test_given_branches_are_drawn(data: Figure, figures: list[Any], tmp_path: Path) -> None:
    draw(data, tmp_path / "drawn")
    assert {p.suffix for p in tmp_path.iterdir()} == {".png", ".svg"}
    # Their JSON gives the same picture.
    stored = json.loads(json.dumps(document("figure", data, paper_system(), [])))
    plot(stored, tmp_path / "again.png")
    assert same_pictures(figures, style.PAGE)


def test_points_far_above_the_branches_are_counted_and_not_shown() -> None:
    curve = given_curve(largest=[10.0, 500.0, None, 10.0, 10.0], settled=[True, False, False, True, True])
    assert top_of([curve]) == (pytest.approx(1.12 * 40.0), 1)


def test_labels_are_said_without_their_typesetting() -> None:
    assert plain(r"$\omega_f = \frac{2}{3}\omega$") == "omega_f = 2/3 omega"


def test_all_figures_leave_branches_out_where_there_are_none(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    for kind in figure_numbers.KINDS:
        monkeypatch.setitem(figure_numbers.KINDS, kind, lambda row, options: curves_of([]))
    for number in FIGURES:
        assert figure_numbers.figure_data(number, FigureOptions(quick=True, branches=True)).figure == number
