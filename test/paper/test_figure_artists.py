"""What the figures' drawings say: titles, units, ticks and places, looked up in the figure itself."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import curve_of, curves_of, figure_of

from tcc_sim.paper import drawings, histories
from tcc_sim.paper.figure_results import Labelled, Numbers
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
    monkeypatch.setitem(drawings.KINDS, kind, (lambda data: 2.0, lambda drawn, data: None))
    numbers = curves_of([curve_of([1.0], direction=name) for name in directions]) if directions else None
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
        histories.paint_histories(drawn, Numbers(panels=[panel, panel, none]))
        assert texts(drawn.axes, "xlabel") == 6 * [""] + 2 * [histories.CYCLES] + [r"$\delta_2$ (rad)"]
        assert [axis.get_title(loc="right") for axis in drawn.axes[2::3]] == [
            "period 2", "period 2", r"chaotic, $\lambda_1 = 2.0 \pm 0.5$ s$^{-1}$"]
        points, wild = drawn.axes[2].lines[0], drawn.axes[8].lines[0]
        assert points.get_xydata().tolist() == [[0.1, 5.0], [0.2, 6.0]]
        assert points.get_markersize() > wild.get_markersize()
        assert {axis.get_xlim() for axis in drawn.axes[:2]} == {(0.0, 3.0)}
    with style.figure() as drawn:
        histories.paint_delay(drawn, Numbers(panels=[late, late, late, replace(late, first_half=math.nan)]))
        assert texts(drawn.axes[:4], "xlabel") == ["", "", histories.CYCLES, histories.CYCLES]
        assert [axis.get_title(loc="right") for axis in drawn.axes[2:4]] == ["25 % in first half cycle",
                                                                            "no positive slip"]
    with style.figure() as drawn:
        histories.paint_actuation(drawn, Numbers(panels=[load] * 2))
        assert [axis.get_xticks().tolist() for axis in drawn.axes[:2]] == [[0, 1, 2, 3]] * 2
        assert texts(drawn.axes[:2], "xlabel") == ["", histories.CYCLES]


def test_slip_away_is_shaded_up_to_where_the_clutch_holds_the_mean_torque() -> None:
    """Tm = mu_k N R: 300 N m are 0.5556 of 540."""
    for x, ends in (([0.5, 1.0], [(0.5, 300.0 / 540.0)]), ([0.6, 1.0], []), ([0.1, 0.5], [])):
        with style.figure() as drawn:
            axis = drawn.subplots()
            drawings.shade_slipping_away(axis, x, figure_of("orbit", None))
            assert [(p.get_x(), p.get_x() + p.get_width()) for p in axis.patches] == [pytest.approx(e) for e in ends]
            assert [text.get_position()[0] for text in axis.texts] == [pytest.approx(0.5 * sum(e)) for e in ends]


def test_the_axis_of_maxima_ends_above_every_curve_and_leaves_room_for_a_legend() -> None:
    x = [0.0, 0.25, 0.5, 0.75, 1.0]

    assert drawings.top_of_maxima(x, [curve_of([None] * 5)], legend=True) == pytest.approx(1e-6)
    left, right = [curve_of([10.0, 9.0, 1.0, 1.0, None])], [curve_of([1.0, 1.0, 1.0, 9.0, 10.0])]
    for legend in (True, False):
        assert drawings.top_of_maxima(x, left, legend=legend) == pytest.approx(10.6)
    with style.figure(style.PAGE, 4.0) as drawn:
        axis = drawn.subplots()
        axis.set_ylim(0.0, drawings.top_of_maxima(x, right * 3, legend=True))
        for name in "abc":
            axis.plot([], [], label=name)
        box = axis.legend(loc="upper right").get_window_extent()
        assert axis.transData.transform((1.0, 10.0))[1] < box.y0
