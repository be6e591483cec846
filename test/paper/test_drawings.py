"""Marks and lines in the drawings of the paper's figures, for made-up numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from given import curve_of, curves_of, figure_of

from tcc_sim.paper.catalogue import FIGURES
from tcc_sim.paper.figure_results import Coexisting, Labelled, Reached

pytest.importorskip("matplotlib")


def test_every_kind_of_point_has_a_mark_of_its_own() -> None:
    """Motions without a period are hollow; unsettled motions and runaways have other marks."""
    from tcc_sim.paper import branch_panels, drawings
    from tcc_sim.views import style

    curve = curve_of([1.0, 2.0, 3.0, 900.0], settled=[True, False, False, False], period=[1, 2, 0, 0],
                     runaway=[False, False, False, True], theta2=[[0.1], [0.2, 0.3], [0.4, 0.5, 0.6], [0.7]],
                     coexisting=[Coexisting(1, 2.0, 2.0, 2, Reached(9.0, 1), True)])
    x = [1.0, 2.0, 3.0, 4.0]
    with style.figure() as drawn:
        axis, orbit = drawn.subplots(1, 2)
        drawings.draw_curve_maxima(axis, x, curve, style.BLUE)
        marks = {(str(line.get_marker()), line.get_markerfacecolor()): line.get_xydata().tolist()
                 for line in axis.lines[1:]}
        assert marks["D", "none"] == [[2.0, 9.0]]
        assert marks["v", "none"] == [[2.0, 2.0]]
        assert marks["o", style.BLUE] == [[1.0, 1.0]]
        assert marks["x", "white"] == [[2.0, 2.0]]
        assert marks["o", "white"] == [[3.0, 3.0]]
        # A runaway has a separate colour and is drawn at the edge for any scale.
        assert marks["^", style.RUNAWAY] == [[4.0, 0.97]]
        assert np.isnan(axis.lines[0].get_ydata()[3])
        drawings.draw_orbit(orbit, x, curve, style.BLUE)
        assert [(line.get_color(), line.get_xdata().tolist()) for line in orbit.lines] == [
            (style.RUNAWAY, [4.0]), (style.BLUE, [1.0]), (style.GREY, [2.0, 2.0]), (style.BLUE, [3.0, 3.0, 3.0])]
        known = len(axis.lines)
        drawings.legend_of_marks(axis, [curve])
        assert [line.get_label() for line in axis.lines[known:]] == [
            *(m.name for m in branch_panels.marks_met([curve])), branch_panels.OTHER.name, branch_panels.SPIKE.name]
    assert len(branch_panels.marks_met([curve])) == 4
    assert branch_panels.marks_met([curve_of([1.0, 2.0], period=[1, 2])]) == [branch_panels.SETTLED]


def test_a_caption_keeps_to_the_width_of_the_picture(tmp_path: Path) -> None:
    from tcc_sim.paper import drawings
    from tcc_sim.views import style

    numbers = curves_of([curve_of([1.0], theta2=[[0.1] * 40], settled=[False])])
    caption = drawings.caption_of(figure_of("map", numbers, caption=FIGURES[4].caption))
    assert caption.endswith("grey: still settling to a period")
    with style.figure(style.PAGE, 2.0) as drawn:
        text = drawn.supxlabel(caption, x=0.01, ha="left", fontsize=7.0)
        drawn.draw_without_rendering()
        assert text.get_window_extent().x1 < drawn.bbox.x1


def test_cells_of_a_map_have_the_colour_of_their_class() -> None:
    """One function draws the maps of sweeps and basins; a runaway is dark red in all of them."""
    from matplotlib.colors import to_hex

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
    assert basin_map.EXTRAS[basin_map.RUNAWAY][0] == style.RUNAWAY


def test_the_panels_of_figure_7_share_ranges_and_show_the_plate_in_the_section() -> None:
    """Of two motions of different size, both sections have room for the larger."""
    from tcc_sim.paper import histories
    from tcc_sim.views import style

    small, large = (Labelled(label="a", period=1, section=[(0.1 * size, 5.0 * size)], t=np.array([0.0, 1.0]),
                             slip_speed=np.array([0.0, size]), plate_angle=np.array([0.0, size]))
                    for size in (1.0, 4.0))
    with style.figure() as drawn:
        histories.paint_histories(drawn, figure_of("histories", {"panels": [small, large]}))
        for column in range(3):
            one, other = drawn.axes[column::3]
            assert (one.get_xlim(), one.get_ylim()) == (other.get_xlim(), other.get_ylim())
        assert drawn.axes[2].get_ylim()[1] > 20.0
        assert drawn.axes[2].get_ylabel() == r"$\dot\delta_2$ (rad/s)"


def test_the_torques_of_figures_9_and_12_are_in_the_picture() -> None:
    from tcc_sim.paper import histories
    from tcc_sim.views import style

    t, slip, torque = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0]), np.array([3.0, 4.0, 5.0])
    panel = Labelled(label="a", period=1, t=t, slip_speed=slip, saturation_torque=np.array([6.0, 7.0, 8.0]),
                     engine_torque=torque)
    late = Labelled(label="a", first_half=0.5, t=t, slip_speed=slip, engine_torque=torque, state=np.array([0, 1, 0]))
    with style.figure() as drawn:
        histories.paint_actuation(drawn, figure_of("actuation", {"panels": [panel] * 2}))
        lines = [line.get_ydata().tolist() for axis in drawn.axes for line in axis.lines]
        assert lines.count([3.0, 4.0, 5.0]) == lines.count([6.0, 7.0, 8.0]) == 2
    with style.figure() as drawn:
        histories.paint_delay(drawn, figure_of("delay", {"panels": [late] * 4}))
        torques = [axis for axis in drawn.axes for line in axis.lines if line.get_ydata().tolist() == [3.0, 4.0, 5.0]]
        shaded = [axis for axis in drawn.axes if axis.collections]
        # Matplotlib draws axes of one order as they were made: first the shading, then the torque.
        for below, above in zip(shaded, torques):
            assert (below.get_zorder(), drawn.axes.index(below)) < (above.get_zorder(), drawn.axes.index(above))
            assert not above.patch.get_visible()
