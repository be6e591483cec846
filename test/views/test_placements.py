"""Where a picture puts things: values along a run, cells, jumps, sizes of markers, and names of modes, by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from described import kept
from results_by_hand import ORDERS

from tcc_sim.analysis.orders import Judder

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.model.parameters import System
from tcc_sim.trajectory import State, Trajectory
from tcc_sim.views import order_maps, overview, rerun_layout, style, sweeps, whole_runs

NAN = float("nan")
W = np.arange(5.0)


@pytest.mark.parametrize(("frequency", "over"), [
    ([100.0, 101.0, 102.0, 103.0, 104.0], "frequency"), ([104.0, 103.0, 102.0, 101.0, 100.0], "frequency"),
    ([100.0, 100.0, 102.0, 103.0, 104.0], "time"), ([100.0] * 5, "time"), ([100.0, 101.0, 102.0, 101.0, 102.0], "time"),
    ([100.0, 100.03, 100.06, 100.09, 100.12], "frequency"), ([100.0, 100.02, 100.04, 100.06, 100.08], "time")])
def test_a_run_is_drawn_over_the_frequency_where_that_always_rises_or_falls(frequency: list[float], over: str) -> None:
    """It changes by more than a thousandth of its mean over the number of steps from window to window."""
    orders = replace(ORDERS, time=W, frequency=np.array(frequency))
    values, name = order_maps._along(orders)
    along, label = (orders.time, "time (s)") if over == "time" else (orders.frequency, "engine frequency (rad/s)")
    assert (values is along, name) == (True, label)
    assert order_maps._along(replace(ORDERS, time=W[:1], frequency=np.ones(1)))[1] == "time (s)"


def test_the_scale_of_a_map_ends_at_a_multiple_of_5_db_above_its_largest_level() -> None:
    amplitude = np.ones((6, 101))
    amplitude[:, 0] = 1e9  # The mean is not shown, nor anything up to a quarter of the excitation.
    amplitude[:, 2] = 1e9
    assert order_maps._top(amplitude, ORDERS) == 0.0
    amplitude[3, 3] = 10.0
    assert order_maps._top(amplitude, ORDERS) == 20.0
    amplitude[3, 3] = 10.1
    assert order_maps._top(amplitude, ORDERS) == 25.0
    assert order_maps._shown(ORDERS).tolist() == (ORDERS.order > 0.25).tolist()
    assert order_maps._shown(replace(ORDERS, per_revolution=2.0)).tolist() == (ORDERS.order > 0.5).tolist()


def test_windows_are_off_scale_where_few_of_them_are_far_above_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fiftieth of them, one at least, where the largest is more than twice as high as 1.1 times the rest."""
    figures = kept(monkeypatch)
    for peaks, top, title in (([1.0] * 5 + [2.3], 1.1, "1 of 6 windows off scale"), ([1.0] * 5 + [2.1], None, ""),
                              ([1.0] * 4 + [9.0] * 2, None, ""), ([0.0] * 6, None, "")):
        judder = Judder(np.array(peaks), np.array(peaks), np.zeros(6))
        order_maps.plot_orders(Path("none.png"), replace(ORDERS, judder=judder))
        axis = figures[-1].axes[4]
        assert axis.get_legend().get_title().get_text() == title
        assert axis.get_ylim()[0] == 0.0
        assert (axis.get_ylim()[1] == pytest.approx(1.1)) == (top is not None)


def test_a_line_has_a_gap_at_a_jump_of_a_twentieth_that_stands_out_fourfold() -> None:
    x = np.arange(8.0)
    for y, gaps in (([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], []), ([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], [4]),
                    ([0.0, 1.0, 2.0, 3.0, 8.0, 9.0, 10.0, 11.0], [4]), ([0.0, 1.0, 2.0, 3.0, 7.0, 8.0, 9.0, 10.0], []),
                    ([0.0, 0.0, 0.0, 0.05, 0.05, 1.0, 1.0, 1.0], [5]), ([0.0, NAN, NAN, NAN, NAN, NAN, NAN, 9.0], []),
                    ([NAN] * 8, []), ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0], [7])):
        at, values = sweeps.parted(x, np.array(y))
        inserted = [k for k in range(len(at)) if np.isnan(at[k])]
        assert inserted == gaps, y
        assert np.isnan(values[inserted]).all()
        assert len(values) == 8 + len(gaps)


def test_markers_shrink_with_their_number_and_classes_follow_the_regimes() -> None:
    assert [sweeps._size(count) for count in (80, 81, 300, 301)] == [3.0, 2.0, 2.0, 1.2]
    assert sweeps.transients(["slip", None], None).tolist() == [False, False]
    assert sweeps.transients(["slip", None], [True, None]).tolist() == [True, False]
    assert list(sweeps.classes(["slip", "stick"], [])) == ["stick", "slip"]
    assert sweeps.runaways({"period": [[1, 0]]}).tolist() == [[False, False]]
    assert sweeps.runaways({"runaway": [[True, None]]}).tolist() == [[True, False]]


def run_of(t: np.ndarray, cycle: float = 1.0) -> Trajectory:
    zero = np.zeros(len(t))
    return Trajectory(t, t, zero, zero, zero, zero, zero, np.zeros(len(t), np.int8), cycle, "by_hand")


@pytest.mark.parametrize(("t", "cycles", "first", "last"), [
    (np.arange(0.0, 5.01, 0.25), 2, 3.0, 5.0), (np.arange(0.0, 5.3, 0.25), 2, 3.0, 5.0),
    (np.arange(0.0, 5.01, 0.25), 9, 0.0, 5.0), (np.arange(0.5, 0.91, 0.1), 2, 0.5, 0.9),
    (np.arange(0.1, 5.0, 0.3), 2, 1.9, 4.0), (np.arange(2.5, 4.3, 0.25), 9, 2.5, 4.0)])
def test_the_last_cycles_are_whole_ones(t: np.ndarray, cycles: int, first: float, last: float) -> None:
    part = overview._last(run_of(t), cycles)
    assert t[part][[0, -1]] == pytest.approx([first, last])


def test_a_portrait_shows_the_plate_speed_where_most_points_stick() -> None:
    run = replace(run_of(np.arange(0.0, 5.01, 0.25)), plate_speed=np.full(21, 7.0))
    for slips, period, label, word, column in (
            ([0.0, 0.1, 5.0], 3, "section, period 3", "plate", 2), ([0.0, 3.0, 5.0], 3, "section, period 3", "slip", 1),
            ([0.0, 0.1], 2, "section, period 2", "slip", 1), ([0.0, 0.1, 0.2, 0.21], 4, "section, period 4", "slip", 1),
            ([0.0, 0.1, 0.19, 0.21], 0, "section, no period found", "plate", 2)):
        states = [[0.1, slip, 9.0] for slip in slips]
        summary: Any = SimpleNamespace(section_states=states, period=period, max_slip_speed=10.0)
        with style.figure() as drawn:
            axis = drawn.subplots()
            overview._phase_portrait(axis, run, summary)
            motion, points = axis.lines
            assert (axis.get_xlabel(), axis.get_ylabel()) == ("plate angle (rad)", f"{word} speed (rad/s)")
            assert points.get_label() == label
            assert points.get_ydata().tolist() == [state[column] for state in states]
            assert len(motion.get_xdata()) == (4 * period if period else 20) + 1
            assert motion.get_linewidth() == (0.9 if period else 0.5)


@pytest.mark.parametrize(("order", "place"), [
    ([5.5, 5.6, 9.8], (1.0, 5.6)), ([9.8, 9.7, 9.6], (2.0, 9.6)), ([10.0, 20.0, 20.0], (0.0, 10.0)),
    ([0.0, -1.0, -1.0], (0.0, 0.0)), ([11.0, 12.0, -1.0], None), ([5.5, 0.3, 5.5], (0.0, 5.5)),
    ([5.5, 9.0, 5.5], (0.0, 5.5)), ([5.0, 8.9, 5.4], (1.0, 8.9))])
def test_a_mode_is_named_inside_the_map_between_lines_of_orders(order: list[float], place: Any) -> None:
    """At a height of 0.3 to 9 of 10 and from 2 to 60 % of the width, or else anywhere on the map."""
    with style.figure() as drawn:
        axis = drawn.subplots()
        order_maps._name_mode(axis, np.arange(3.0), np.array(order), "mode", (0.0, 10.0), 1.0)
        assert [text.xy for text in axis.texts] == ([] if place is None else [place])


@pytest.mark.parametrize(("count", "length", "begin", "again"), [
    (40, 2.5, 0.0, False), (39, 2.5, 0.0, True), (40, 2.53, 0.0, True), (41, 2.53, 0.0, False), (3, 2.5, 1.0, False)])
def test_a_manoeuvre_with_fewer_than_16_samples_a_cycle_is_solved_again(count: int, length: float, begin: float,
                                                                       again: bool, monkeypatch: Any) -> None:
    solved: list[Any] = []
    monkeypatch.setattr(whole_runs, "solve", lambda system, **how: solved.append(how) or SimpleNamespace(
        raise_for_status=lambda: "solved"))
    run = run_of(np.linspace(begin, begin + length, count))
    run = replace(run, slip_speed=run.t + 3.0, plate_angle=run.t + 4.0, plate_speed=run.t + 5.0, system=System())
    assert whole_runs._sampled(replace(run, system=None)).system is None
    found = whole_runs._sampled(run)
    assert solved == [{"duration": length, "samples_per_cycle": 100, "state": State(3.0, 4.0, 5.0)}] * again
    assert (found == "solved") if again else (found is run)


def test_axes_of_the_portrait_in_rerun_end_at_round_numbers_and_hold_what_fills_them() -> None:
    for low, high, intervals, step, ends in ((0.0, 1.0, 2, 0.5, (0.0, 1.0)), (0.03, 0.38, 2, 0.2, (0.0, 0.4)),
                                             (-2.9, 5.7, 3, 5.0, (-5.0, 10.0)), (0.0, 40.0, 2, 20.0, (0.0, 40.0)),
                                             (0.0, 41.0, 2, 50.0, (0.0, 50.0)), (1.0, 1.0, 2, 5e-13, None)):
        assert rerun_layout._step(low, high, intervals) == pytest.approx(step)
        if ends is not None:
            assert rerun_layout._round_ends(low, high, intervals) == pytest.approx(ends)
            ticks = rerun_layout._ticks(*ends, intervals)
            assert (ticks[0], ticks[-1]) == pytest.approx(ends)
            assert np.diff(ticks) == pytest.approx(np.full(len(ticks) - 1, rerun_layout._step(*ends, intervals)))
    axes = rerun_layout.PhaseAxes((0.0, 1.0), (0.0, 10.0))
    for low, high, holds in (((0.0, 0.0), (1.0, 10.0), True), ((0.0, 0.0), (0.3, 3.0), True),
                             ((0.0, 0.0), (0.29, 3.0), False),
                             ((0.0, 0.0), (0.3, 2.9), False), ((-0.01, 0.0), (1.0, 10.0), False),
                             ((0.0, 0.0), (1.0, 10.01), False)):
        assert axes.hold(np.array(low), np.array(high)) is holds
    assert axes.transform() == ((0.0, 1.0), (rerun_layout.WIDTH, 0.1))
    point = rerun_layout.PhaseAxes.around(np.array([0.5, -3.0]), np.array([0.5, -3.0]))
    assert point.angle[0] < 0.5 < point.angle[1]
    assert point.speed[0] < -3.0 < point.speed[1]
    assert rerun_layout.rgb("#0A10FF") == [10, 16, 255]
