"""Numbers of figures by hand: axes, plans, time histories and the law, without a long solve."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import Given, record

from tcc_sim.study.continuation.settings import DEFAULTS
from tcc_sim.study.paper import branches_behind, figures
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, STATIC, FigureOptions, paper_system, plain, series_system
from tcc_sim.study.paper.figures import figure_data, stands_out
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep
from tcc_sim.trajectory import State


@pytest.fixture
def swept(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Plans and curves of the sweeps, whose points are made up."""
    asked: list[Any] = []

    def sweep(curves: Any, plan: Any, kept: Any, jobs: Any, progress: Any) -> list[Sweep]:
        asked.append((plan, jobs, progress))
        return [Sweep(curve, plan, [record()] * len(curve.values), 0.0) for curve in curves]

    monkeypatch.setattr(figures, "swept", sweep)
    return asked


@pytest.mark.parametrize(("number", "quick", "direction", "count", "cycles", "ways"), [
    (4, False, None, 226, 150, ["cold"]), (4, True, "up", 57, 100, ["up"]), (5, True, None, 56, 100, ["cold"]),
    (6, False, None, None, 150, ["cold", "up", "down"]), (6, True, "down", None, 100, ["down"])])
def test_a_sweep_has_the_axis_and_the_plan_of_its_figure(swept: list[Any], number: int, quick: bool, direction: Any,
                                                        count: int | None, cycles: int, ways: list[str]) -> None:
    row = FIGURES[number]
    result = figure_data(number, FigureOptions(quick, direction, jobs=3, progress=True))
    total = count or ((row.count - 1) // 4 + 1 if quick else row.count)
    np.testing.assert_allclose(result.x, np.linspace(*row.span, total))
    assert (result.cycles, result.discarded, result.quick, result.law) == (cycles, 50, quick, "smoothed")
    assert (result.over, result.axis, result.unit) == ((row.over, "mu_k/mu_s", STATIC) if number == 6 else
                                                       (row.over, "omega/omega_n", pytest.approx(OMEGA_N)))
    assert result.threshold == (-0.6 if number == 5 else None)
    assert [(plan.direction, plan.most, plan.discard, plan.section_points, plan.damping, jobs, shown)
            for plan, jobs, shown in swept] == [(way, cycles, 50, 40, number == 5, 3, True) for way in ways]
    assert [curve.direction for curve in result.curves] == [way for way in ways for _ in row.series]
    assert [curve.label for curve in result.curves] == [s.label for s in row.series] * len(ways)
    assert [curve.coexisting for curve in result.curves] == [[] if number == 4 and way == "cold" else None
                                                            for way in ways for _ in row.series]
    assert result.curves[0].max_slip_speed == [10.0] * total
    own = {key for series in row.series for key in series.values} if len(row.series) > 1 else set()
    assert set(result.parameters).isdisjoint({row.over} | own)
    assert result.parameters["pressure.mean"] == 225e3


def test_the_law_of_fig_3_by_hand() -> None:
    """mubar = tanh(sigma v) (1 + (r - 1) exp(-alpha |v|)), its slope by differences, and the slip branch of (6)."""
    result = figure_data(3, FigureOptions())
    v, near = np.asarray(result.slip_speed), np.asarray(result.near_slip_speed)
    assert (v[0], v[-1], len(v), near[0], near[-1], len(near)) == (-2.0, 2.0, 2001, 0.0, 0.2, 801)
    for curve, series in zip(result.curves, FIGURES[3].series):
        f, ratio = paper_system(series.values).friction, paper_system(series.values).friction_ratio

        def law(x: Any, f: Any = f, ratio: float = ratio) -> Any:
            return np.tanh(f.smoothing * x) * (1.0 + (ratio - 1.0) * np.exp(-f.decay * np.abs(x)))

        np.testing.assert_allclose(curve.coefficient, law(v), atol=1e-14)
        np.testing.assert_allclose(curve.near_coefficient, law(near), atol=1e-14)
        np.testing.assert_allclose(curve.near_set_valued, 1.0 + (ratio - 1.0) * np.exp(-f.decay * near), atol=1e-14)
        off = 1e-6
        slope = (law(near + off) - law(near - off))[1:] / (2.0 * off)
        np.testing.assert_allclose(curve.near_slope[1:], slope, rtol=1e-5, atol=1e-5)
        assert curve.static == pytest.approx(ratio)
        if ratio > 1.0:
            top = np.linspace(0.0, 0.5, 500_001)
            assert curve.peak == pytest.approx(law(top).max(), rel=1e-9)
            assert curve.peak_slip_speed == pytest.approx(top[law(top).argmax()], abs=1e-5)
        else:
            assert not math.isfinite(curve.peak_slip_speed)


@pytest.mark.parametrize(("values", "k", "least", "out"), [
    ([0.0, 3.0, 0.0], 1, 2.0, True), ([0.0, 2.0, 0.0], 1, 2.0, False), ([3.0, 0.0, 3.0], 1, 2.0, True),
    ([0.0, 3.0, 6.0], 1, 2.0, False), ([0.0, 3.0, 2.0], 1, 2.0, False), ([0.0, 3.0, 3.0], 1, 2.0, False),
    ([9.0, 0.0, 9.0], 0, 1.0, False), ([0.0, 9.0], 1, 1.0, False)])
def test_a_value_stands_out_from_both_neighbours(values: Any, k: int, least: float, out: bool) -> None:
    assert stands_out(np.array(values), k, least) is out


@pytest.mark.parametrize(("points", "other", "found"), [
    ([(1, 10.0), (1, 20.0), (1, 10.0)], (2, 14.0),
     [(0, 10.0, 14.0, False), (1, 20.0, 14.0, True), (1, 20.0, 14.0, True), (2, 10.0, 14.0, False)]),
    ([(1, 10.0), (1, 20.0)], (0, 14.0), []), ([(0, 10.0), (1, 20.0)], (2, 14.0), []),
    ([(1, 10.0), (1, 11.59)], (2, 30.0), [(0, 10.0, 30.0, False), (1, 11.59, 30.0, False)]),
    ([(1, 10.0), (1, 10.8)], (2, 30.0), []), ([(1, 10.0), None], (2, 30.0), []),
    ([(1, 10.0), (1, 20.0)], (1, 11.6), [(1, 20.0, 11.6, False)])])
def test_motions_of_neighbours_that_differ_are_found(points: Any, other: Any, found: Any,
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of more than 8 % of the largest value, and another motion that differs by as much."""
    plans: list[Any] = []
    monkeypatch.setattr(figures, "solve_point", lambda system, value, plan, start: plans.append(plan) or record(
        other[1], other[0]))
    monkeypatch.setattr(figures, "handed_over", lambda *of: Start(State(0.0, 0.0, 0.0), 0))
    curve = Curve(paper_system(), "engine.frequency", tuple(100.0 + k for k in range(len(points))))
    sweep = Sweep(curve, Plan(section_points=9, damping=True), [p and record(p[1], p[0]) for p in points], 0.0)
    result = figures.coexisting(sweep, 1)
    assert [(r.index, r.max_slip_speed, r.other.max_slip_speed, r.spike) for r in result] == found
    assert all(r.value == 100.0 + r.index and r.period == 1 and r.other.period == other[0] for r in result)
    assert all((plan.section_points, plan.damping) == (0, False) for plan in plans)


def test_a_label_in_words_and_the_system_of_a_curve() -> None:
    assert plain(r"$\frac{2}{3}\omega$ \{x\}") == "2/3 omega x"
    system = series_system(FIGURES[8].series[1], FigureOptions(law="set_valued"))
    assert (system.friction.law, system.pressure.phase) == ("set_valued", pytest.approx(0.5 * math.pi))


@pytest.mark.parametrize(("tops", "higher"), [
    ([10.0 * (1.0 + DEFAULTS.alike - 1e-9)] * 3, 0),
                                              ([10.0 * (1.0 + DEFAULTS.alike + 1e-9)] * 3, 1), ([10.0, 99.0, 10.0], 0)])
def test_points_above_their_motions_are_counted(tops: list[float], higher: int) -> None:
    """Of three points one has a motion of 10 rad/s, one a motion without a period, and one none."""
    sweep = Given(lambda row, x, d: record(tops[round(x * 10.0) - 1])).curves([{}], np.array([0.1, 0.2, 0.3]))[0]
    seen: Any = [SimpleNamespace(value=sweep.curve.values[k], period=p, amplitude=10.0) for k, p in enumerate((1, 0))]
    assert branches_behind.still_higher(sweep, seen) == higher
