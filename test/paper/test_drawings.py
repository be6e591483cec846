"""What the drawings of the paper's figures show of given numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.paper.catalogue import FIGURES

pytest.importorskip("matplotlib")


def test_every_kind_of_point_has_a_mark_of_its_own() -> None:
    """Hollow is what has no period; what settles still, and slip that grows without end, are told apart from it."""
    from tcc_sim.paper import branch_panels, drawings
    from tcc_sim.views import style

    curve = {"label": "a curve", "max_slip_speed": [1.0, 2.0, 3.0, 900.0], "settled": [True, False, False, False],
             "period": [1, 2, 0, 0], "runaway": [False, False, False, True],
             "theta2": [[0.1], [0.2, 0.3], [0.4, 0.5, 0.6], [0.7]], "coexisting": [
                 {"index": 1, "max_slip_speed": 2.0, "spike": True, "other": {"max_slip_speed": 9.0}}]}
    x = [1.0, 2.0, 3.0, 4.0]
    with style.figure() as drawn:
        axis, orbit = drawn.subplots(1, 2)
        drawings.draw_maxima(axis, x, curve, style.BLUE)
        marks = {(str(line.get_marker()), line.get_markerfacecolor()): line.get_xydata().tolist()
                 for line in axis.lines[1:]}
        assert marks["D", "none"] == [[2.0, 9.0]]
        assert marks["v", "none"] == [[2.0, 2.0]]
        assert marks["o", style.BLUE] == [[1.0, 1.0]]
        assert marks["x", "white"] == [[2.0, 2.0]]
        assert marks["o", "white"] == [[3.0, 3.0]]
        # Slip that grows has a colour of its own and stands at the edge, whatever the scale.
        assert marks["^", style.RUNAWAY] == [[4.0, 0.97]]
        assert np.isnan(axis.lines[0].get_ydata()[3])
        drawings.draw_orbit(orbit, x, curve, style.BLUE)
        assert [(line.get_color(), line.get_xdata().tolist()) for line in orbit.lines] == [
            (style.RUNAWAY, [4.0]), (style.BLUE, [1.0]), (style.GREY, [2.0, 2.0]), (style.BLUE, [3.0, 3.0, 3.0])]
        known = len(axis.lines)
        drawings.legend_of_marks(axis, [curve])
        assert [line.get_label() for line in axis.lines[known:]] == [
            *(m.name for m in branch_panels.marks_met([curve])), drawings.OTHER, drawings.SPIKE]
    assert len(branch_panels.marks_met([curve])) == 4
    assert branch_panels.marks_met([{"period": [1, 2]}]) == [branch_panels.SETTLED]
    assert drawings.top_of_maxima(x, [curve], legend=False) == pytest.approx(1.06 * 3.0)  # A runaway sets no scale.


def test_a_caption_keeps_to_the_width_of_the_picture(tmp_path: Path) -> None:
    from tcc_sim.paper import drawings
    from tcc_sim.views import style

    data: dict[str, Any] = {"caption": FIGURES[4].caption, "kind": "map", "cycles": 150, "discarded": 50, "curves": [
        {"theta2": [[0.1] * 40], "period": [1], "settled": [False]}]}
    caption = drawings.caption_of(data)
    assert caption.endswith("grey: still settling to a period")
    with style.figure(style.PAGE, 2.0) as drawn:
        text = drawn.supxlabel(caption, x=0.01, ha="left", fontsize=7.0)
        drawn.draw_without_rendering()
        assert text.get_window_extent().x1 < drawn.bbox.x1


def test_the_end_of_a_curve_of_a_chart_is_drawn_or_at_the_edge() -> None:
    from tcc_sim.continuation.stopping import StopReason
    from tcc_sim.paper.branch_panels import end_of

    shown = {reason.name: end_of(reason.name.lower()) for reason in StopReason}
    assert [name for name, mark in shown.items() if mark is None] == ["RANGE", "CLOSED"]
    assert len({mark for mark in shown.values() if mark is not None}) >= 4


def test_cells_of_a_map_have_the_colour_of_their_class() -> None:
    """One function draws the maps of sweeps, basins and charts; a runaway is dark red in all of them."""
    from matplotlib.colors import to_hex

    from tcc_sim.paper.branch_panels import GRID, TINTS, shade_of
    from tcc_sim.views import basin_map, style
    from tcc_sim.views.sweeps import draw_cells

    with style.figure() as drawn:
        axis = drawn.subplots()
        mesh = draw_cells(axis, np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0]),
                          np.array([[0.0, 1.0, 2.0], [2.0, np.nan, 0.0]]), [style.BLUE, style.RUNAWAY, style.GREEN])
        drawn.draw_without_rendering()
        shown = [to_hex(c).upper() for c in mesh.get_facecolors().reshape(-1, 4)]
        assert [shown[k] for k in (0, 1, 2, 3, 5)] == [style.BLUE, style.RUNAWAY, style.GREEN, style.GREEN, style.BLUE]
        assert mesh.get_facecolors().reshape(-1, 4)[4, 3] == 0.0
    cells = ((1, "stick"), (0, "runaway"), (0, "slip"), (7, "slip"), (None, None))
    assert [GRID[shade_of(*cell)] for cell in cells] == [
        "pure stick", "slip grows without end", "no period up to 16", "period 3 to 16", "not solved"]
    assert TINTS[shade_of(0, "runaway")] == basin_map.EXTRAS[basin_map.RUNAWAY][0] == style.RUNAWAY


def test_a_section_of_one_point_has_no_axis_narrower_than_its_noise() -> None:
    from tcc_sim.paper import histories
    from tcc_sim.views import style

    panel = {"t": [0.0, 1.0], "slip_speed": [0.0, 30.0], "plate_angle": [0.1, 0.2], "period": 1, "label": "a",
             "section": [[0.1, 5.0], [0.1, 5.0 + 1e-13]]}
    with style.figure() as drawn:
        histories.paint_histories(drawn, {"panels": [panel] * 2})
        low, high = drawn.axes[2].get_ylim()
        assert high - low == pytest.approx(histories.NARROWEST * 30.0)


def test_the_torques_of_figures_9_and_12_are_in_the_picture() -> None:
    from tcc_sim.paper import histories
    from tcc_sim.views import style

    panel = {"t": [0.0, 1.0, 2.0], "slip_speed": [0.0, 1.0, 0.0], "state": [0, 1, 0], "engine_torque": [3.0, 4.0, 5.0],
             "saturation_torque": [6.0, 7.0, 8.0], "label": "a", "first_half": 0.5, "period": 1}
    with style.figure() as drawn:
        histories.paint_actuation(drawn, {"panels": [panel] * 2})
        lines = [line.get_ydata().tolist() for axis in drawn.axes for line in axis.lines]
        assert lines.count([3.0, 4.0, 5.0]) == lines.count([6.0, 7.0, 8.0]) == 2
    with style.figure() as drawn:
        histories.paint_delay(drawn, {"panels": [panel] * 4})
        torque = [axis for axis in drawn.axes for line in axis.lines if line.get_ydata().tolist() == [3.0, 4.0, 5.0]]
        shaded = [axis for axis in drawn.axes if axis.collections]
        # Matplotlib draws axes of one order as they were made: what shades comes first, the torque above it.
        for below, above in zip(shaded, torque):
            assert (below.get_zorder(), drawn.axes.index(below)) < (above.get_zorder(), drawn.axes.index(above))
            assert not above.patch.get_visible()
