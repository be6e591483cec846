"""Titles, units, ticks and places of the figures' drawings, read from the Matplotlib figure."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import curve_of, curves_of, figure_of

from tcc_sim.paper import drawings, histories
from tcc_sim.paper.figure_results import Labelled
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.views import style


@pytest.fixture(autouse=True)
def _matplotlib() -> None:
    pytest.importorskip("matplotlib")


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


def texts(axes: Any, name: str) -> list[str]:
    return [getattr(axis, f"get_{name}")() for axis in axes]


def test_time_histories_name_their_lowest_axes_and_mark_every_cycle() -> None:
    t, slip, torque = np.array([0.0, 1.5, 3.0]), np.array([0.0, 30.0, 0.0]), np.array([3.0, 4.0, 5.0])
    panel = Labelled(label="a", period=2, section=[(0.1, 5.0), (0.2, 6.0)], t=t, slip_speed=slip,
                     plate_angle=np.array([0.1, 0.2, 0.1]))
    none = replace(panel, period=0, lyapunov=Lyapunov(2.0, 1.5, 2.5, 0.95, 100, "chaotic"))
    late = Labelled(label="a", first_half=0.25, t=t, slip_speed=slip, engine_torque=torque, state=np.array([0, 1, 0]))
    load = Labelled(label="a", period=2, t=t, slip_speed=slip, saturation_torque=torque + 3.0, engine_torque=torque)
    with style.figure() as drawn:
        histories.paint_histories(drawn, figure_of("histories", {"panels": [panel, panel, none]}))
        assert texts(drawn.axes, "xlabel") == 6 * [""] + 2 * [histories.CYCLES] + [r"$\delta_2$ (rad)"]
        assert [axis.get_title(loc="right") for axis in drawn.axes[2::3]] == [
            "period 2", "period 2", r"chaotic, $\lambda_1 = 2.0 \pm 0.5$ s$^{-1}$"]
        points, wild = drawn.axes[2].lines[0], drawn.axes[8].lines[0]
        assert points.get_xydata().tolist() == [[0.1, 5.0], [0.2, 6.0]]
        assert points.get_markersize() > wild.get_markersize()
        assert {axis.get_xlim() for axis in drawn.axes[:2]} == {(0.0, 3.0)}
    with style.figure() as drawn:
        histories.paint_delay(drawn, figure_of("delay", {
            "panels": [late, late, late, replace(late, first_half=math.nan)]}))
        assert texts(drawn.axes[:4], "xlabel") == ["", "", histories.CYCLES, histories.CYCLES]
        assert [axis.get_title(loc="right") for axis in drawn.axes[2:4]] == ["25 % in first half cycle",
                                                                            "no positive slip"]
    with style.figure() as drawn:
        histories.paint_actuation(drawn, figure_of("actuation", {"panels": [load] * 2}))
        assert [axis.get_xticks().tolist() for axis in drawn.axes[:2]] == [[0, 1, 2, 3]] * 2
        assert texts(drawn.axes[:2], "xlabel") == ["", histories.CYCLES]


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
    t, slip = np.array([0.0, 1.5, 3.0]), np.array([0.0, 30.0, 0.0])
    panel = Labelled(label="$\\omega/\\omega_n = 0.36$", t=t, slip_speed=slip, plate_angle=t, section=[(0.1, 5.0)],
                     engine_torque=t, saturation_torque=t, state=np.array([0, 1, 0]), first_half=0.25, period=0,
                     lyapunov=Lyapunov(2.0, 1.5, 2.5, 0.95, 100, "chaotic"))
    return {"panels": [panel] * (4 if kind == "delay" else 3)}


@pytest.mark.parametrize("kind", ["map", "orbit", "damping", "histories", "delay", "actuation"])
def test_a_picture_in_a_column_has_no_strips_and_nothing_cut(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Any] = []
    monkeypatch.setattr(style, "save_both", lambda drawn, stem: found.append(drawn))
    caption = r"constant load, $\mu_s N_m R = 540$ N m; dotted: $\omega/\omega_n = 1/6, 1/5, 1/4, 1/3$"
    with style.figure():  # Measure with the fonts of pictures.
        data = figure_of(kind, column_numbers(kind), caption=caption)
        drawings.draw(data, Path("none"), "a title that is far too long for one line of a narrow column", style.COLUMN)
        drawn, = found
        drawn.draw_without_rendering()
        assert drawn.get_figwidth() == style.COLUMN
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
