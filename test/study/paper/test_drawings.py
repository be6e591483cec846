"""Drawings of the paper's figures for made-up numbers: marks, lines, titles, units, ticks and places."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import curve_of, curves_of, figure_of
from legends import covered, legends_in

from tcc_sim.analysis.multipliers import Lyapunov
from tcc_sim.study.paper import branch_panels, drawings
from tcc_sim.study.paper.catalogue import FIGURES
from tcc_sim.study.paper.figure_results import Coexisting, Labelled, MotionsBehind, Reached
from tcc_sim.study.paper.histories import CYCLES
from tcc_sim.study.views import basin_map
from tcc_sim.views import style
from tcc_sim.views.sweeps import draw_cells

pytest.importorskip("matplotlib")
PANEL = Labelled(label=r"$\omega/\omega_n = 0.36$", period=2, section=[(0.1, 5.0), (0.2, 6.0)],
                 t=np.array([0.0, 1.5, 3.0]), slip_speed=np.array([0.0, 30.0, 0.0]),
                 plate_angle=np.array([0.1, 0.2, 0.1]), engine_torque=np.array([3.0, 4.0, 5.0]),
                 saturation_torque=np.array([6.0, 7.0, 8.0]), state=np.array([0, 1, 0]), first_half=0.25)
CHAOTIC = replace(PANEL, period=0, lyapunov=Lyapunov(2.0, 1.5, 2.5, 0.95, 100, "chaotic"))


def test_every_kind_of_point_has_a_mark_of_its_own() -> None:
    """Motions without a period are hollow; unsettled motions and runaways have other marks."""
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


    with style.figure() as drawn:
        axis = drawn.subplots()
        mesh = draw_cells(axis, np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0]),
                          np.array([[0.0, 1.0, 2.0], [2.0, np.nan, 0.0]]), [style.BLUE, style.RUNAWAY, style.GREEN])
        drawn.draw_without_rendering()
        shown = [to_hex(c).upper() for c in mesh.get_facecolors().reshape(-1, 4)]
        assert [shown[k] for k in (0, 1, 2, 3, 5)] == [style.BLUE, style.RUNAWAY, style.GREEN, style.GREEN, style.BLUE]
        assert mesh.get_facecolors().reshape(-1, 4)[4, 3] == 0.0
    assert basin_map.EXTRAS[basin_map.RUNAWAY][0] == style.RUNAWAY


@contextmanager
def painted(kind: str, *panels: Labelled) -> Iterator[Any]:
    """A picture of time histories."""
    with style.figure() as drawn:
        drawings.KINDS[kind][-1](drawn, figure_of(kind, {"panels": panels}))
        yield drawn


def drawn_numbers(drawn: Any, name: str, part: slice = slice(None), **how: Any) -> list[Any]:
    return [getattr(axis, f"get_{name}")(**how) for axis in drawn.axes[part]]


def test_the_panels_of_figure_7_share_ranges_and_show_the_plate_in_the_section() -> None:
    """Of two motions of different size, both sections have room for the larger."""
    large = replace(CHAOTIC, section=[(0.4, 20.0)], slip_speed=4.0 * PANEL.slip_speed)
    with painted("histories", PANEL, PANEL, large) as drawn:
        assert drawn_numbers(drawn, "xlabel") == 6 * [""] + 2 * [CYCLES] + [r"$\delta_2$ (rad)"]
        assert drawn_numbers(drawn, "ylabel")[2] == r"$\dot\delta_2$ (rad/s)"
        assert drawn_numbers(drawn, "title", slice(2, None, 3), loc="right") == [
            "period 2", "period 2", r"chaotic, $\lambda_1 = 2.0 \pm 0.5$ s$^{-1}$"]
        points, wild = drawn.axes[2].lines[0], drawn.axes[8].lines[0]
        assert points.get_xydata().tolist() == [[0.1, 5.0], [0.2, 6.0]]
        assert points.get_markersize() > wild.get_markersize()
        assert drawn_numbers(drawn, "xlim")[:2] == [(0.0, 3.0)] * 2
        ranges = list(zip(drawn_numbers(drawn, "xlim"), drawn_numbers(drawn, "ylim")))
        assert ranges == ranges[:3] * 3
        assert drawn.axes[2].get_ylim()[1] > 20.0


def lines_in(drawn: Any) -> list[Any]:
    return [line.get_ydata().tolist() for axis in drawn.axes for line in axis.lines]


def test_figure_9_has_the_torque_above_the_shading_and_the_share_of_slip() -> None:
    with painted("delay", PANEL, PANEL, PANEL, replace(PANEL, first_half=math.nan)) as drawn:
        assert drawn_numbers(drawn, "xlabel")[:4] == ["", "", CYCLES, CYCLES]
        assert drawn_numbers(drawn, "title", loc="right")[2:4] == ["25 % in first half cycle", "no positive slip"]
        torques = [axis for axis in drawn.axes for line in axis.lines if line.get_ydata().tolist() == [3.0, 4.0, 5.0]]
        shaded = [axis for axis in drawn.axes if axis.collections]
        # Matplotlib draws axes of one order as they were made: first the shading, then the torque.
        for below, above in zip(shaded, torques):
            assert (below.get_zorder(), drawn.axes.index(below)) < (above.get_zorder(), drawn.axes.index(above))
            assert not above.patch.get_visible()


def test_figure_12_has_both_torques_and_a_tick_for_every_cycle() -> None:
    followed = replace(PANEL, orbit={"stable": True, "multipliers": [[0.3, 0.4], [0.3, -0.4], [0.0, 0.0]]})
    with painted("actuation", PANEL, followed) as drawn:
        assert drawn_numbers(drawn, "title", loc="right")[:2] == [
            "period 2", "period 2, stable: largest Floquet multiplier 0.5"]
        assert [ticks.tolist() for ticks in drawn_numbers(drawn, "xticks")[:2]] == [[0, 1, 2, 3]] * 2
        assert drawn_numbers(drawn, "xlabel")[:2] == ["", CYCLES]
        assert lines_in(drawn).count([3.0, 4.0, 5.0]) == lines_in(drawn).count([6.0, 7.0, 8.0]) == 2


@pytest.mark.parametrize(("kind", "law", "directions", "title"), [
    ("map", "smoothed", ["cold"], "Fig. 4. A"), ("map", "set_valued", ["cold"], "Fig. 4. A (set-valued law)"),
    ("map", "smoothed", ["up", "down"], "Fig. 4. A (continued downward, continued upward)"),
    ("damping", "set_valued", ["up"], "Fig. 4. A (set-valued law, continued upward)"),
    ("orbit", "smoothed", ["cold", "up"], "Fig. 4. A"), ("solvers", "set_valued", [], "Fig. 4. A"),
    ("law", "set_valued", [], "Fig. 4. A")])
def test_a_title_says_what_the_paper_s_figure_has_not(kind: str, law: str, directions: list[str], title: str,
                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(style, "save_both", lambda drawn, stem: said.append(drawn.get_suptitle()))
    monkeypatch.setitem(drawings.KINDS, kind, ((2.0, 0.0), (2.0, 0.0), lambda drawn, data: None))
    numbers = curves_of([curve_of([1.0], direction=name) for name in directions or ["cold"]])
    drawings.draw(figure_of(kind, numbers, law=law, title="A"), Path("none"))
    assert said == [title]


def test_slip_away_is_shaded_up_to_where_the_clutch_holds_the_mean_torque() -> None:
    """Tm = mu_k N R: 300 N m are 0.5556 of 540."""
    for x, ends in (([0.5, 1.0], [(0.5, 300.0 / 540.0)]), ([0.6, 1.0], []), ([0.1, 0.5], [])):
        with style.figure() as drawn:
            axis = drawn.subplots()
            drawings.shade_slipping_away(axis, x, figure_of("orbit", {}))
            assert [(p.get_x(), p.get_x() + p.get_width()) for p in axis.patches] == [pytest.approx(e) for e in ends]
            assert axis.get_legend_handles_labels()[1] == ["$T_{sm} < T_m$"] * len(ends)
            assert not axis.texts


@pytest.mark.parametrize("count", [1, 3])
def test_every_curve_of_a_map_has_a_row_with_the_others_pale_behind_it(count: int) -> None:
    """All rows share one range, above every curve."""
    curves = [curve_of([10.0 + k] * 11, label=f"curve {k}") for k in range(count)]
    with style.figure(style.PAGE, 6.0) as drawn:
        drawings.KINDS["map"][-1](drawn, figure_of("map", curves_of(curves)))
        left = drawn.axes[:count]
        assert [axis.get_title(loc="right") for axis in left] == [f"curve {k}" for k in range(count)]
        assert [axis.get_ylim()[1] for axis in left] == pytest.approx([1.06 * (9.0 + count)] * count)
        for axis in left:
            pale = [line for line in axis.lines if line.get_alpha() == 0.45]
            assert sorted(float(line.get_ydata()[0]) for line in pale) == [10.0 + k for k in range(count)]


def column_numbers(kind: str) -> Any:
    """Numbers of a figure of one kind with every mark and the paper's number of curves."""
    if kind in ("map", "orbit", "damping"):
        more: dict[str, Any] = {"settled": [True, False] + [True] * 9, "period": [1] * 8 + [0] * 3,
                                "runaway": [True] + [False] * 10, "label": r"$\mu_k = 0.667\mu_s$",
                                "equivalent_damping": [-0.1] * 11, "negative_slope_mean": [-0.2] * 11}
        directions = {"map": ["cold"] * 4, "orbit": ["cold", "up", "down"], "damping": ["cold"]}[kind]
        return {**curves_of([curve_of([900.0, *range(10)], direction=name, **more) for name in directions]),
                "threshold": -0.6}
    return {"panels": [CHAOTIC] * (4 if kind == "delay" else 3)}


@pytest.mark.parametrize(("kind", "height"), [("map", 6.1), ("orbit", 5.0), ("damping", 5.4), ("histories", 7.5),
                                              ("delay", 6.5), ("actuation", 4.8)])
def test_a_picture_in_a_column_has_no_strips_and_nothing_cut(kind: str, height: float,
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    values: list[Any] = []
    monkeypatch.setattr(style, "save_both", lambda drawn, stem: values.append(drawn))
    caption = r"constant load, $\mu_s N_m R = 540$ N m; dotted: $\omega/\omega_n = 1/6, 1/5, 1/4, 1/3$"
    with style.figure():  # Measure with the fonts of pictures.
        data = figure_of(kind, column_numbers(kind), caption=caption)
        drawings.draw(data, Path("none"), "a title that is far too long for one line of a narrow column", style.COLUMN)
        drawn, = values
        style.lay_out(drawn)
        assert drawn.get_figwidth() == style.COLUMN
        caption_lines = drawings.caption_of(data, style.COLUMN).count("\n") + 1
        assert drawn.get_figheight() == pytest.approx(height + 0.15 * caption_lines)
        assert drawn.get_suptitle().replace("\n", " ") == (
            "a title that is far too long for one line of a narrow column")
        page = drawn.bbox
        for axis in drawn.axes:
            box = axis.get_tightbbox()
            assert page.x0 - 1.0 <= box.x0
            assert box.x1 <= page.x1 + 1.0
            assert axis.get_window_extent().width > 0.24 * page.width
        for text in drawn.texts:
            assert text.get_window_extent().x1 < page.x1


T = np.linspace(0.0, 3.0, 31)
SOLVED = replace(PANEL, solver="smoothed", rms_difference=math.nan, t=T, slip_speed=np.where(T > 1.0, 30.0, 0.0),
                 max_slip_speed=30.0)
LAW = Labelled(label="sigma", peak=math.nan, peak_slip_speed=math.nan, coefficient=T, slope=T, near_coefficient=T,
               near_slope=T, near_set_valued=T)


@pytest.mark.parametrize("width", [style.COLUMN, style.PAGE])
@pytest.mark.parametrize("kind", drawings.KINDS)
def test_entries_of_legends_are_in_view(kind: str, width: float, laid_out: list[Any], tmp_path: Path) -> None:
    """All motions still settle or run away, a law has no maximum and no branch is stable; the fixture checks marks."""
    settling = {"settled": [False] * 11, "runaway": [True] + [False] * 10, "equivalent_damping": [math.nan] * 11,
                "negative_slope_mean": [-0.2] * 11}
    branch = {"period": 1, "value": [10.0, 20.0], "max_slip_speed": [1.0, 2.0], "stable": [False, False]}
    if kind == "branched map":
        settling["behind"] = MotionsBehind([branch], [], [], [])  # type: ignore[assignment]
    curves = curves_of([curve_of([900.0, *range(10)], direction=name, **settling) for name in ("cold", "up")])
    numbers = {"solvers": {"curves": [SOLVED, replace(SOLVED, solver="rk4")], "steady": [SOLVED], "cycle": 0.1,
                           "steady_cycles": 10}, "law": {"curves": [LAW], "slip_speed": T, "near_slip_speed": T}}.get(
        kind, {"panels": [PANEL] * 4})
    if kind in ("map", "branched map", "damping", "orbit"):
        numbers = {**curves, "threshold": -0.6}
    drawings.draw(figure_of(kind.removeprefix("branched "), numbers), tmp_path / "a.png", width=width)
    assert [name for legend, axes in legends_in(laid_out[0]) if len(axes) == 1 for name in covered(legend)] == []
