"""Lines, marks and words of pictures, read from the Matplotlib figure: in print too, where labels lie within it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from results_by_hand import BRANCHES, ORDERS, PLANE, RESPONSE, SPECTRUM

from tcc_sim.analysis.control import Event
from tcc_sim.analysis.orders import Judder, OrderComparison, Orders
from tcc_sim.cli import main
from tcc_sim.trajectory import Cycles

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.study.views import basin_map, branch_diagram
from tcc_sim.study.views.branch_diagram import stable_and_unstable
from tcc_sim.views import estimation, order_maps, overview, style, sweeps, whole_runs

SWEEP = {"over": "engine.frequency", "values": [1.0, 2.0], "max_slip_speed": [1.0, 2.0], "regime": ["stick", "slip"],
         "period": [1, 0], "section": [[[0.1, 0.0]], [[0.1, 0.0]]], "stick_fraction": [0.5, 0.5],
         "transient": [False, True], "runaway": [False, False],
         "lyapunov": [{"exponent": -1.0, "low": -2.0, "high": 0.5, "diagnosis": "periodic"}] * 2}
LEAST = {sweeps.draw_sweep: 0.5, order_maps.plot_orders: 0.4}
"""Least height of panels that show little, inches."""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("draw", "values", "width"), [
    (branch_diagram.branch_diagram, BRANCHES, style.COLUMN), (estimation.bode, RESPONSE, style.COLUMN),
    (basin_map.draw_basins, PLANE, style.COLUMN), (order_maps.plot_spectrum, SPECTRUM, style.COLUMN),
    (sweeps.draw_sweep, SWEEP, style.COLUMN), (sweeps.draw_sweep, SWEEP, style.PAGE),
    (order_maps.plot_orders, ORDERS, style.COLUMN), (order_maps.plot_orders, ORDERS, style.PAGE),
    (order_maps.plot_comparison, OrderComparison(ORDERS, ORDERS), style.COLUMN),
    (order_maps.plot_comparison, OrderComparison(ORDERS, ORDERS), style.PAGE)])
def test_labels_lie_within_the_picture_and_axes_are_no_strips(draw, values, width, laid_out, tmp_path):
    """The columns of `continue --switch`, `linearise` and `simulate --inputs --orders` had such faults."""
    draw(tmp_path / "a.png", values, 3 * "a long title of a scene ", width)
    drawn, = laid_out
    assert drawn.get_figwidth() == width
    whole, inside = drawn.bbox, drawn.get_tightbbox()
    assert inside.x0 >= -0.01
    assert inside.y0 >= -0.01
    assert inside.x1 <= whole.width / drawn.dpi + 0.01
    assert inside.y1 <= whole.height / drawn.dpi + 0.01
    panels = [axis for axis in drawn.axes if axis.get_label() != "<colorbar>"]
    for axis in panels:
        box = axis.get_window_extent()
        assert min(box.width, box.height) / drawn.dpi > LEAST.get(draw, 1.1)
        legend = axis.get_legend()
        if legend is not None:
            assert not axis._left_title.get_window_extent().overlaps(legend.get_window_extent().padded(-1.0))
    for one, other in combinations([axis.get_tightbbox().padded(-2.0) for axis in panels], 2):
        assert not one.overlaps(other)


def test_an_orbit_that_stays_the_same_is_not_drawn_as_rounding(figures: list[Any], tmp_path: Path) -> None:
    values = {"over": "engine.frequency", "values": [1.0, 2.0], "max_slip_speed": [1.0, 1.0], "regime": ["slip"] * 2,
              "period": [1, 1], "section": [[[0.1, 0.0]], [[0.1 + 1e-13, 0.0]]], "stick_fraction": [0.0, 0.0],
              "transient": [False] * 2, "runaway": [False] * 2}
    sweeps.draw_sweep(tmp_path / "a.png", values)
    low, high = figures[0].axes[1].get_ylim()
    assert high - low > 1e-3


def test_marks_of_attractors_say_along_which_state_they_are_projected(figures: list[Any], tmp_path: Path) -> None:
    basin_map.draw_basins(tmp_path / "a.png", {**PLANE, "labels": np.array([[0, 0], [0, -1]])})
    axis = figures[0].axes[0]
    assert axis.lines[0].get_xydata().tolist() == [[5.0, 9.0]]  # Slip speed and plate speed, not the angle.
    assert r"their sections, projected along the plate angle $\delta_2$" in axis.get_legend_handles_labels()[1]
    assert len(axis.collections) == 1
    basin_map.draw_basins(tmp_path / "b.png", PLANE)
    assert len(figures[1].axes[0].collections) == 0
    assert figures[1].axes[0].get_xlim() == axis.get_xlim() == (-5.0, 15.0)


def test_cells_that_have_not_settled_are_hatched(figures: list[Any], tmp_path: Path) -> None:
    """The hatching had an opacity of 0."""
    grid = {"over": "engine.frequency", "second_over": "pressure.mean", "values": [1.0, 2.0], "second_values": [3.0],
            "max_slip_speed": [[1.0, 2.0]], "period": [[1, 1]], "regime": [["slip", "slip"]],
            "runaway": [[False, False]], "transient": [[False, True]]}
    sweeps.draw_grid(tmp_path / "a.png", grid)
    for axis in figures[0].axes[:2]:
        cells, = (c for c in axis.collections if c.get_hatch())
        path, = cells.get_paths()
        assert path.get_extents().bounds == pytest.approx((1.5, 1.5, 1.0, 3.0))
        assert cells.get_edgecolor()[0, 3] == 1.0
    assert [text.get_text() for text in figures[0].legends[0].get_texts()] == ["hatched: 1 of 2 have not settled"]


def test_a_title_is_over_the_picture_and_a_legend_beside_no_panel_title(laid_out: list[Any], tmp_path: Path) -> None:
    words = ["simulate", "minimal", "--cycles", "60", "--width", "column", "--title", "Mine $x_{$", "--plot"]
    assert main([*words, str(tmp_path / "a.svg")]) == 0
    assert laid_out[0]._suptitle.get_text() == "Mine $x_{$"  # No formula.


def test_texts_of_events_stand_beside_their_lines_and_are_short() -> None:
    """To the right of a line in the first half and to the left in the second, three heights in turn."""
    events = [Event(2.0, 60 * "a"), Event(4.0, "second"), Event(8.0, "third"), Event(9.0, "fourth")]
    with style.figure(style.PAGE, 3.0) as drawn:
        axis = drawn.subplots()
        axis.set_xlim(0.0, 20.0)
        overview.mark_events(axis, events, 10.0, 0.5)
        drawn.draw_without_rendering()
        assert [line.get_xdata()[0] for line in axis.lines] == [4.0, 8.0, 16.0, 18.0]
        boxes = [text.get_window_extent() for text in axis.texts]
        for event, box, inside in zip(events, boxes, ("x0", "x0", "x1", "x1")):
            apart = getattr(box, inside) - axis.transData.transform((event.t / 0.5, 0.0))[0]
            assert 0.0 < apart * (1.0 if inside == "x0" else -1.0) < 10.0
        assert boxes[0].y0 > boxes[1].y1
        assert boxes[1].y0 > boxes[2].y1
        assert boxes[3].y1 == pytest.approx(boxes[0].y1)
        assert axis.bbox.y1 > boxes[0].y1
        assert axis.texts[0].get_text() == 39 * "a" + "..."
        assert min(text.get_fontsize() for text in axis.texts) >= 6.0  # Smaller print is not read.
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.mark_events(axis, events + events[:3], 10.0)
        assert not axis.texts
        assert [line.get_label() == "event" for line in axis.lines] == [True] + 6 * [False]


def test_a_runaway_stands_above_the_others_and_within_the_axis() -> None:
    values = {"over": "engine.frequency", "values": [1.0, 2.0, 3.0, 4.0], "max_slip_speed": [10.0, 20.0, 900.0, None],
              "regime": ["stick", "slip", "slip", None], "runaway": [False, False, True, None]}
    with style.figure() as drawn:
        axis = drawn.subplots()
        sweeps.draw_maxima(axis, values)
        shown = {line.get_label(): line.get_xydata().tolist() for line in axis.lines[1:]}
        low, high = axis.get_ylim()
    ((place, height),) = shown["runaway"]
    assert shown == {"stick": [[1.0, 10.0]], "slip": [[2.0, 20.0]], "runaway": [[3.0, height]], "failed": [[4.0, 0.0]]}
    assert place == 3.0
    assert -0.1 * 20.0 < low < 0.0 < 20.0 < height < high < 1.2 * 20.0


def test_cells_meet_half_way_between_their_centres() -> None:
    for centres, edges in (([1.0, 2.0, 4.0], [0.5, 1.5, 3.0, 5.0]), ([4.0], [2.0, 6.0]), ([0.0], [-0.5, 0.5])):
        assert sweeps.edges(np.array(centres)).tolist() == edges
    np.testing.assert_array_equal(sweeps.numbers([1, None, 2.5]), [1.0, np.nan, 2.5])


def test_a_twin_shows_its_start_its_end_and_all_of_the_difference(figures: list[Any], tmp_path: Path) -> None:
    t = np.arange(-10.0, 31.0)
    run = SimpleNamespace(t=t, slip_speed=2.0 * t, cycle=1.0)
    result = SimpleNamespace(trajectory=run, t=t, slip_speed=3.0 * t, difference=-t)
    whole_runs.draw_twin(tmp_path / "a.png", result)
    start, end, difference = ([line.get_xydata().tolist() for line in axis.lines] for axis in figures[0].axes)
    for lines, part in ((start, t[:9]), (end, t[-9:])):
        assert lines == [[[x, 3.0 * x] for x in part], [[x, 2.0 * x] for x in part]]
    assert difference == [[[x, -x] for x in t]]
    assert figures[0].axes[2].get_xlim() == (-10.0, 30.0)
    with style.figure() as drawn:
        axis = drawn.subplots()
        whole_runs.draw_slip_speeds(axis, result)
        assert all(len(line.get_xdata()) == len(t) for line in axis.lines)


def test_the_maxima_of_cycles_keep_the_scale_of_those_that_count() -> None:
    """A first cycle far above the others is dropped, counted and off the axis; the summary's maximum is a line."""
    cycles = Cycles(np.zeros((5, 3)), np.array([90.0, 5.0, 9.0, 10.0]), np.array([0.0, -8.0, 0.0, 0.0]), np.zeros(4))
    summary = SimpleNamespace(discarded=2, cycles=2, max_slip_speed=10.0)
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.draw_cycle_maxima(axis, cycles, 7, summary)
        dropped, kept, line = axis.lines
        assert dropped.get_label() == "dropped (1 off scale)"
        assert dropped.get_xydata().tolist() == [[7.0, 90.0], [8.0, 8.0]]
        assert (kept.get_label(), kept.get_xydata().tolist()) == ("kept", [[9.0, 9.0], [10.0, 10.0]])
        assert set(line.get_ydata()) == {10.0}
        assert axis.get_ylim() == (0.0, 16.0)
        assert axis.get_xlabel() == "period of excitation"
    uneven = replace(cycles, starts=np.array([0.0, 1.0, 2.0, 3.0, 5.0]))
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.draw_cycle_maxima(axis, uneven, 7, summary)
        assert axis.lines[1].get_xdata().tolist() == [2.0, 3.0]
        assert axis.get_xlabel() == "time (s)"


def test_stick_is_shaded_from_its_first_sample_to_its_last() -> None:
    with style.figure() as drawn:
        axis = drawn.subplots()
        t = np.arange(7.0)
        assert overview.shade_stick(axis, t, np.array([0, 0, 1, 0, 0, 0, -1]))
        ends = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axis.patches]
        assert ends == [(0.0, 1.0), (3.0, 5.0)]
        assert [patch.get_label() == "stick" for patch in axis.patches] == [True, False]
        assert not overview.shade_stick(axis, t, np.ones(7))


def document_of(stable: list[bool], **bifurcation: object) -> dict[str, object]:
    values = [float(k) for k in range(len(stable))]
    return {"branches": [{"value": values, "max_slip_speed": [10.0 * v for v in values], "stable": stable}],
            "bifurcations": [{"branch": 0, **bifurcation}] if bifurcation else []}


def test_fast_stick_is_shaded_by_its_share_of_each_column() -> None:
    from matplotlib.collections import QuadMesh

    with style.figure() as drawn:
        axis = drawn.subplots()
        k = np.arange(10_000)
        state = np.where((k % 10 < 4) == (k < 5000), 0, 1).astype(np.int8)  # 40 %, then 60 % of each ten samples.
        assert overview.shade_stick(axis, 1e-3 * k, state)
        mesh, = (each for each in axis.collections if isinstance(each, QuadMesh))
        share = np.asarray(mesh.get_array()).ravel()
        assert len(share) == overview.COLUMNS
        assert abs(share[:235].mean() - 0.4) < 0.01
        assert abs(share[245:].mean() - 0.6) < 0.01
        assert np.ptp(share[:235]) < 0.2
        assert axis.get_legend_handles_labels()[1] == ["stick (shade: share)"]
        assert not np.isfinite(axis.dataLim.y0)  # The shade does not set the scale.


def test_a_run_up_has_cuts_of_both_quantities_and_a_campbell_diagram(figures: list[Any], tmp_path: Path) -> None:
    """One window with fifty times the judder leaves the scale to the others; an order below the range says so."""
    level = np.ones((60, 101))
    level[:, 20] = 1e-5
    peak = np.ones(60)
    peak[7] = 50.0
    windows = np.linspace(0.0, 1.0, 60)
    result = Orders(windows, 80.0 + 100.0 * windows, np.arange(0.0, 10.1, 0.1), level, level, np.ones(1),
                    np.ones((60, 1)), Judder(peak, peak, peak), windows, (116.8, 387.3))
    order_maps.plot_orders(tmp_path / "orders.png", result)
    titles = {axis: axis.get_title(loc="left") for axis in figures[0].axes}
    axes = {title.partition(" ")[2]: axis for axis, title in titles.items() if title}
    for name in ("Orders of the shaft torque", "Orders of the slip speed"):
        assert len(axes[name].lines) == len(result.cuts)
        assert any(text.get_text() == "order 2, below -60 dB" for text in axes[name].get_legend().get_texts())
    assert axes["Judder"].get_ylim()[1] == pytest.approx(1.1)
    assert axes["Judder"].get_legend().get_title().get_text() == "1 of 60 windows off scale"
    campbell = axes["Campbell diagram of the shaft torque"]
    assert (campbell.get_xlabel(), campbell.get_ylabel()) == ("engine speed (rpm)", "frequency (Hz)")
    assert campbell.get_xlim() == pytest.approx((80.0 * 30.0 / math.pi, 180.0 * 30.0 / math.pi))
    stuck, slipping, *lines = campbell.lines
    modes = np.array([116.8, 387.3]) / (2.0 * math.pi)
    assert [line.get_ydata()[0] for line in (stuck, slipping)] == pytest.approx(modes)
    assert [line.get_ydata()[1] / line.get_xdata()[1] * 60.0 for line in lines] == pytest.approx(list(result.cuts))
    heights = {text.get_text(): text.xy for text in campbell.texts}
    for name, omega in (("stuck, 18.59 Hz", 116.8), ("slipping, 61.64 Hz", 387.3)):
        assert heights[name] == pytest.approx((80.0 * 30.0 / math.pi, omega / 2 / math.pi))
    for name in ("Shaft torque", "Slip speed"):
        assert {"stuck, 116.8 rad/s", "slipping, 387.3 rad/s"} == {text.get_text() for text in axes[name].texts}


def test_a_branch_is_solid_to_its_bifurcation_and_dashed_behind_it() -> None:
    both = document_of([True, True, False, False], after=1, value=1.7, max_slip_speed=14.0, changes_stability=True)
    (x, y), (other_x, other_y) = stable_and_unstable(both, 0)
    assert x[np.isfinite(x)].tolist() == [0.0, 1.0, 1.7]
    assert y[np.isfinite(y)].tolist() == [0.0, 10.0, 14.0]
    assert other_x[np.isfinite(other_x)].tolist() == [1.7, 2.0, 3.0]
    assert other_y[np.isfinite(other_y)].tolist() == [14.0, 20.0, 30.0]


def test_a_fold_between_points_of_one_kind_is_a_corner_of_the_line() -> None:
    (x, _), (other, _) = stable_and_unstable(document_of([False, False], after=0, value=1.2, max_slip_speed=5.0,
                                                         changes_stability=False), 0)
    assert len(x) == 0
    assert other[1:].tolist() == [0.0, 1.2, 1.0]


def test_a_piece_that_no_bifurcation_parts_is_dashed_where_either_end_is_unstable() -> None:
    (x, _), (other, _) = stable_and_unstable(document_of([True, False, True, True]), 0)
    assert x[1:].tolist() == [2.0, 3.0]
    assert other[1:].tolist() == [0.0, 1.0, 2.0]
    (x, _), _ = stable_and_unstable(document_of([True, True, False, True, True]), 0)
    np.testing.assert_array_equal(x, [math.nan, 0.0, 1.0, math.nan, 3.0, 4.0])


def test_the_picture_has_its_title_and_its_axes_named(figures: list[Any], tmp_path: Path) -> None:
    values = {**document_of([True, True, False]), "over": "engine.frequency"}
    values["branches"][0]["period"] = 1
    values["bifurcations"] = []
    branch_diagram.branch_diagram(tmp_path / "branches.svg", values, title="a scene")
    values["curves"] = [{"kind": "fold", "value": [1.0, 2.0], "second": [3.0, 4.0]}]
    values["second_over"] = "pressure.mean"
    branch_diagram.branch_diagram(tmp_path / "curves.svg", values)
    assert figures[0].get_suptitle() == "a scene"
    axis, *_ = figures[0].axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == (r"engine frequency $\omega$ (rad/s)", "max |slip speed| (rad/s)")
    assert "mean pressure $P_m$ (Pa)" in [axis.get_ylabel() for axis in figures[1].axes]


def test_a_legend_names_only_what_is_drawn(figures: list[Any], tmp_path: Path) -> None:
    """Motions without a value, a plane without cells and an empty plane had entries without marks."""
    scattered = {"scatter": {"engine.frequency": [1.0, 2.0]}, "sampled": {"engine.frequency": [1.0, 2.0]},
                 "regime": ["stick", "slip"], "runaway": [False, False], "transient": [False, False],
                 "probabilities": [0.5], "quantiles": {name: [None] for name, *_ in sweeps.RESULTS},
                 **{name: [None, 2.0] for name, *_ in sweeps.RESULTS}}
    sweeps.draw_scatter(tmp_path / "a.png", scattered)
    assert [text.get_text() for text in figures[0].legends[0].get_texts()] == ["slip"]
    for plane, areas in ((PLANE, 0), ({**PLANE, "labels": np.array([[0, 0], [0, -1]])}, 2)):
        basin_map.draw_basins(tmp_path / "b.png", plane)
        handles = style.entries(figures[-1].axes[0])[0]
        assert sum(hasattr(h, "get_facecolor") and h.get_facecolor()[3] > 0.0 for h in handles) == areas
    with style.figure() as drawn:
        axis = drawn.subplots()
        axis.plot([1.0, 2.0], [math.nan, 1.0], label="line")
        axis.plot([1.0], [math.nan], label="no line")
        axis.fill_between([1.0, 2.0], [math.nan] * 2, [1.0] * 2, label="no band")
        axis.axhline(math.nan, label="no level")
        axis.axvspan(1.0, 2.0, label="span")
        assert style.entries(axis)[1] == ["line", "span"]
        assert len(style.legend(axis).get_texts()) == 2
