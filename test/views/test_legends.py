"""Every function that makes a picture, and every result drawn into an axis: legends name only what is in view."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from legends import covered, legends_in, unmarked
from results_by_hand import (
    BAND,
    BRANCHES,
    CELLS,
    CHECKED,
    FAR,
    FITTED,
    GRID,
    ORDERS,
    OVER,
    PLANE,
    PRESSURE,
    QUIET,
    RESPONSE,
    SCATTER,
    SPECTRUM,
    SWEEP,
)

import tcc_sim
from tcc_sim.analysis.control import Control, Event, Steps
from tcc_sim.analysis.orders import OrderComparison
from tcc_sim.analysis.summary import summarise
from tcc_sim.errors import InputError

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.figure import Figure

from tcc_sim.study.benchmarks import report_drawings
from tcc_sim.study.benchmarks.precision import PrecisionResult, References, SteadyState, StudiedScene
from tcc_sim.study.benchmarks.stability import ErrorChart, Examined
from tcc_sim.study.views import basin_map, branch_diagram
from tcc_sim.views import estimation, friction_law, order_maps, overview, plots, style, sweeps, whole_runs

PACKAGE = Path(tcc_sim.__file__).parent
T = np.linspace(0.0, 3.0, 31)


@cache
def run() -> Any:
    """A solved run with samples."""
    return tcc_sim.simulate("fig02", cycles=16, samples_per_cycle=100).trajectory


class Twin(SimpleNamespace):
    """A run beside a recording."""

    def __str__(self) -> str:
        return "rms difference 1 rad/s"


def twin() -> Any:
    """A run beside a recording that is shorter."""
    return Twin(trajectory=SimpleNamespace(t=T, slip_speed=T, cycle=0.1), t=T, slip_speed=T + 1.0,
                difference=np.ones(31))


def control() -> Control:
    """Signals with a target after the end of the pictured cycles, and many events."""
    held = Steps(np.array([0.0, 1.0]), np.array([20.0, 30.0]))
    return Control(np.array([0.5, 1.0]), np.array([20.0, 21.0]), held, held, held,
                   tuple(Event(0.1 * k, "event") for k in range(8)))


def precision(path: Path, width: float) -> None:
    """Errors of a solver that failed everywhere, and of one."""
    scene = StudiedScene("fig02", "", "smoothed", 5, References([], 1e-8), SteadyState(400, 0, None, None, []))
    scene.results += [PrecisionResult(name, 1e-6, e, e, e, None, e, e, None)
                      for name, e in (("rk4", 1.0), ("rk45", 1e-4))]
    report_drawings.draw_section(path, [scene], width=width)


def stability(path: Path, width: float) -> None:
    """Errors of one engine and power balances of another; one limit lies outside its chart."""
    charts = [ErrorChart(PRESSURE, [1e5, 2e5], method, [1e-5, 1e-4], [[1e-3, None]] * 2,
                         {"rk4": [1.0, 1.0], "uniqueness": [3e-5, 3e-5]}) for method in ("rk4", "fixed_step")]
    cases = [Examined({}, "smoothed", None, error=1e-6), Examined({}, "fixed_step", 1e-3, power_residual=1e-3)]
    report_drawings.draw_stability(path, charts, cases, width=width)


Draw = Callable[[Path, float], Any]
TITLE = 3 * "a long title of a scene "


def of(draw: Callable[..., Any], *results: Any) -> list[Draw]:
    """Drawings of results."""
    return [lambda path, width, one=one: draw(path, one, TITLE, width) for one in results]


PICTURES: dict[str, list[Draw]] = {
    "sweeps.draw_sweep": of(sweeps.draw_sweep, SWEEP, {**SWEEP, "lyapunov": [{"exponent": 1.0, "low": 0.5, "high": 1.5},
                                                                             None, None, None]}),
    "sweeps.draw_grid": of(sweeps.draw_grid, GRID), "sweeps.draw_scatter": of(sweeps.draw_scatter, SCATTER, BAND),
    "estimation.bode": of(estimation.bode, RESPONSE, CHECKED),
    "estimation.identification": of(estimation.identification, FITTED),
    "order_maps.plot_orders": of(order_maps.plot_orders, QUIET),
    "order_maps.plot_comparison": of(order_maps.plot_comparison, OrderComparison(QUIET, ORDERS)),
    "order_maps.plot_spectrum": of(order_maps.plot_spectrum, SPECTRUM, replace(SPECTRUM, subharmonics=np.array([9.0]))),
    "friction_law.draw_friction": of(friction_law.draw_friction, "fig02", "stick"),
    "whole_runs.draw_twin": of(whole_runs.draw_twin, twin()),
    "whole_runs.manoeuvre": [lambda path, width: whole_runs.manoeuvre(path, run(), width, control=control())],
    "overview.overview": [
        lambda path, width, more=more: overview.overview(  # type: ignore[misc]
            path, (it := run()), it.cycles, 0, summarise(it), control=more,
            width="page" if style.wide(width) else "column")
        for more in (None, control())],
    "branch_diagram.branch_diagram": of(branch_diagram.branch_diagram, BRANCHES, {**BRANCHES, "bifurcations": []}),
    "basin_map.draw_basins": of(basin_map.draw_basins, PLANE, CELLS, OVER, {**PLANE, "attractors": [FAR]}),
    "report_drawings._draw": [precision], "report_drawings.draw_stability": [stability]}
"""Made-up results with what may be named and not be in view: runaways, failures, points outside, empty curves."""


def test_every_function_that_makes_a_picture_has_a_row() -> None:
    texts = {path: text for path in PACKAGE.rglob("*.py") if "style.figure(" in (text := path.read_text())}
    values = {f"{path.stem}.{part.name}" for path, text in texts.items() for part in ast.walk(ast.parse(text))
              if isinstance(part, ast.FunctionDef) and "style.figure(" in ast.unparse(part)}
    assert values == {*PICTURES, "drawings.draw"}  # The latter is in test_drawings.


LEAST = {"sweeps.draw_sweep": 0.5, "order_maps.plot_orders": 0.4, **dict.fromkeys((
    "branch_diagram.branch_diagram", "estimation.bode", "basin_map.draw_basins", "order_maps.plot_spectrum",
    "order_maps.plot_comparison"), 1.1)}
"""Least height of the panels of pictures with tight layouts, inches."""


def check_places(drawn: Any, width: float, least: float) -> None:
    """Fail where labels leave the picture or cover each other, and for a panel that is lower or narrower than this."""
    assert drawn.get_figwidth() == width
    whole, inside = drawn.bbox, drawn.get_tightbbox()
    assert min(inside.x0, inside.y0) >= -0.01
    assert inside.x1 <= whole.width / drawn.dpi + 0.01
    assert inside.y1 <= whole.height / drawn.dpi + 0.01
    panels = [axis for axis in drawn.axes if axis.get_label() != "<colorbar>"]
    for axis in panels:
        box = axis.get_window_extent()
        assert min(box.width, box.height) / drawn.dpi > least
        legend = axis.get_legend()
        if legend is not None:
            assert not axis._left_title.get_window_extent().overlaps(legend.get_window_extent().padded(-1.0))
    for one, other in combinations([axis.get_tightbbox().padded(-2.0) for axis in panels], 2):
        assert not one.overlaps(other)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("width", [style.COLUMN, style.PAGE])
@pytest.mark.parametrize("name", PICTURES)
def test_entries_of_legends_are_in_view_and_cover_nothing(name: str, width: float, laid_out: list[Any], tmp_path: Path
                                                          ) -> None:
    """That every entry has a mark is checked by the fixture; a legend in the axes lies on no curve. Labels of pictures
    with tight layouts lie within the picture, titles beside legends, and panels are no strips.
    """
    for draw in PICTURES[name]:
        draw(tmp_path / "a.png", width)
        if name in LEAST:
            check_places(laid_out[-1], width, LEAST[name])
        assert [names for legend, axes in legends_in(laid_out[-1]) if len(axes) == 1 and legend.axes is axes[0]
                for names in covered(legend)] == []


INTO: dict[str, list[Any]] = {
    "Sweep": [{"format": "tcc_sim sweep 1", **SWEEP}], "Grid": [{"format": "tcc_sim sweep 1", **GRID}],
    "Scattered": [{"format": "tcc_sim sweep 1", **one} for one in (SCATTER, BAND)],
    "Linearisation": [{"format": "tcc_sim linearise 1", **one} for one in (RESPONSE, CHECKED)], "Orders": [ORDERS],
    "OrderComparison": [OrderComparison(QUIET, ORDERS)], "Spectrum": [SPECTRUM], "Scene": [tcc_sim.load_scene("fig02")],
    "System": [tcc_sim.load_scene("fig02").system], "Motions": [{"format": "tcc_sim continue 1", **BRANCHES}],
    "Basins": [{"format": "tcc_sim basins 1", **one} for one in (PLANE, CELLS, OVER)]}
"""Results for an axis, by their rows. Identification and Twin are in test_public_results and below."""


@pytest.mark.parametrize("name", [*plots.LOOKS, *plots.STUDIED, "Trajectory"])
def test_a_result_is_drawn_into_an_axis_with_its_legend(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is drawn into the axis that is given, in whose figure nothing else appears but colour bars."""
    if name in ("Identification", "Twin"):
        kept, results = plots.look_of, [twin()]
        whole = estimation if name == "Identification" else whole_runs
        monkeypatch.setattr(plots, "look_of", lambda result: (None, getattr(whole, plots.LOOKS[name][2])))
        if name == "Identification":
            results = [SimpleNamespace(residuals={"slip_speed": 0.1 * T}, measurement=SimpleNamespace(
                t=T, channels={"slip_speed": T}))]
        assert kept
    else:
        results = [run()] if name == "Trajectory" else INTO[name]
    for result in results:
        drawn = Figure()
        axis, second = drawn.subplots(1, 2)
        with monkeypatch.context() as patch:
            patch.setattr(style, "figure", None)
            assert tcc_sim.plot(result, ax=axis) is axis
        assert axis.has_data()
        assert not second.has_data()
        assert {other.get_label() for other in drawn.axes} <= {"", "<colorbar>"}
        named = style.entries(axis)[1]
        legend = axis.get_legend()
        assert unmarked(drawn) == []
        if len(named) > 1:
            assert [text.get_text() for text in legend.get_texts()] == named
        assert legend is None or covered(legend) == []


def test_a_check_of_legends_fails_where_it_should() -> None:
    """An entry of an empty curve, of one outside the limits, in another colour or dash; a legend on a curve."""
    with style.figure() as drawn:
        axis = drawn.subplots()
        axis.plot([0.0, 1.0], [0.5, 0.5], label="in view", color=style.BLUE)
        axis.plot([], [], label="empty", color=style.RED)
        axis.plot([0.0, 1.0], [5.0, 5.0], label="outside", color=style.GREEN)
        axis.plot([], [], label="other dashes", color=style.BLUE, linestyle=":")
        axis.plot([], [], label="mark", linestyle="none", marker="o", color=style.BLUE)
        axis.plot([-9.0, 9.0], [0.51, 0.51], label="crossing", color=style.ORANGE)
        axis.fill([], [], label="area", color=style.ORANGE)
        axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        legend = axis.legend(loc="center")
        assert unmarked(drawn) == ["empty", "outside", "other dashes", "mark", "area"]
        assert covered(legend) == ["in view", "crossing"]
        with pytest.raises(InputError, match="either a file or an axis"):
            tcc_sim.plot(run(), "a.png", ax=axis)
