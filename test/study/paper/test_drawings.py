"""Drawings of the paper's figures for made-up numbers: marks, lines, titles, units, ticks and places."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import curve_of, curves_of, figure_of
from legends import covered, legends_in, spans_in, title_of

from tcc_sim.analysis.multipliers import Lyapunov
from tcc_sim.study.paper import drawings
from tcc_sim.study.paper.catalogue import FIGURES
from tcc_sim.study.paper.figure_results import Labelled, MotionsBehind
from tcc_sim.study.views import basin_map
from tcc_sim.views import style
from tcc_sim.views.sweeps import draw_cells

pytest.importorskip("matplotlib")
PANEL = Labelled(label=r"$\omega/\omega_n = 0.36$", period=2, section=[(0.1, 5.0), (0.2, 6.0)],
                 t=np.array([0.0, 1.5, 3.0]), slip_speed=np.array([0.0, 30.0, 0.0]),
                 plate_angle=np.array([0.1, 0.2, 0.1]), engine_torque=np.array([3.0, 4.0, 5.0]),
                 saturation_torque=np.array([6.0, 7.0, 8.0]), state=np.array([0, 1, 0]), first_half=0.25)
CHAOTIC = replace(PANEL, period=0, lyapunov=Lyapunov(2.0, 1.5, 2.5, 0.95, 100, "chaotic"))


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


@pytest.mark.parametrize(("kind", "law", "directions", "title"), [
    ("map", "smoothed", ["cold"], "Fig. 4. A"), ("map", "set_valued", ["cold"], "Fig. 4. A (set-valued law)"),
    ("map", "smoothed", ["up", "down"], "Fig. 4. A (continued downward, continued upward)"),
    ("damping", "set_valued", ["up"], "Fig. 4. A (set-valued law, continued upward)"),
    ("orbit", "smoothed", ["cold", "up"], "Fig. 4. A"), ("solvers", "set_valued", [], "Fig. 4. A"),
    ("law", "set_valued", [], "Fig. 4. A")])
def test_a_title_says_what_the_paper_s_figure_has_not(kind: str, law: str, directions: list[str], title: str,
                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(style, "save_both", lambda drawn, stem: said.append(title_of(drawn)))
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
            assert spans_in(axis) == [pytest.approx(e) for e in ends]
            assert axis.get_legend_handles_labels()[1] == ["$T_{sm} < T_m$"] * len(ends)
            assert not axis.texts


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
        assert title_of(drawn).replace("\n", " ") == (
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
@pytest.mark.parametrize("kind", ["map", "branched map", "damping", "orbit", "law", "solvers"])
def test_entries_of_legends_are_in_view(kind: str, width: float, laid_out: list[Any], tmp_path: Path) -> None:
    """All motions still settle or run away, a law has no maximum and no branch is stable; the fixture checks marks."""
    settling = {"settled": [False] * 11, "runaway": [True] + [False] * 10, "equivalent_damping": [math.nan] * 11,
                "negative_slope_mean": [-0.2] * 11}
    branch = {"period": 1, "value": [10.0, 20.0], "max_slip_speed": [1.0, 2.0], "stable": [False, False]}
    if kind == "branched map":
        settling["behind"] = MotionsBehind([branch], [], [], [])  # type: ignore[assignment]
    curves = curves_of([curve_of([900.0, *range(10)], direction=name, **settling) for name in ("cold", "up")])
    numbers: Any = {**curves, "threshold": -0.6}
    if kind == "solvers":
        numbers = {"curves": [SOLVED, replace(SOLVED, solver="rk4")], "steady": [SOLVED], "cycle": 0.1,
                   "steady_cycles": 10}
    elif kind == "law":
        numbers = {"curves": [LAW], "slip_speed": T, "near_slip_speed": T}
    drawings.draw(figure_of(kind.removeprefix("branched "), numbers), tmp_path / "a.png", width=width)
    assert [name for legend, axes in legends_in(laid_out[0]) if len(axes) == 1 for name in covered(legend)] == []
