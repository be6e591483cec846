"""Pictures of made-up results, artist by artist, as `pictures.txt` describes them; see the picture before changing it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from described import described, expected, kept, new_lines
from results_by_hand import BAND, CHECKED, FITTED, GRID, ORDERS, QUIET, SCATTER, SPECTRUM, SWEEP

from tcc_sim.analysis.control import Control, Event, Steps
from tcc_sim.analysis.orders import Judder, OrderComparison
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.trajectory import Cycles, Trajectory

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
import matplotlib

from tcc_sim.views import estimation, friction_law, order_maps, overview, style, sweeps, whole_runs

PAGE = Path(__file__).with_name("pictures.txt")
CYCLE = System().cycle
T = np.linspace(0.0, 20.0 * CYCLE, 401)
SLIP = np.maximum(30.0 * np.sin(2.0 * np.pi * T / CYCLE), 0.0)
RUN = Trajectory(T, SLIP, 0.1 + 0.001 * T, 2.0 * T, 300.0 + 100.0 * T, 500.0 + T, 200.0 + 10.0 * T,
                 np.where(SLIP > 0.1, 1, 0).astype(np.int8), CYCLE, "by_hand", System())
CYCLES = Cycles(np.zeros((5, 3)), np.array([90.0, 5.0, 9.0, 10.0]), np.array([0.0, -8.0, 0.0, 0.0]), np.zeros(4))
UNEVEN = replace(CYCLES, starts=np.array([0.0, 1.0, 2.0, 3.0, 5.0]))
PERIODIC = SimpleNamespace(discarded=2, cycles=2, max_slip_speed=10.0, period=2,
                           section_states=[[0.1, 5.0, 9.0], [0.11, 6.0, 7.0]])
APERIODIC = SimpleNamespace(discarded=2, cycles=2, max_slip_speed=10.0, period=0,
                            section_states=[[0.1, 0.1, 9.0], [0.1, 0.15, 8.0], [0.1, 0.2, 7.0], [0.1, 0.0, 1.0]])
HELD = Steps(np.array([0.2, 0.5]), np.array([2e5, 3e5]))
TARGET = Steps(np.array([0.1, 0.6]), np.array([20.0, 25.0]))
CONTROL = Control(np.array([0.2, 0.7]), np.array([19.0, 24.0]), TARGET, HELD, replace(HELD, t=HELD.t + 0.01), (
    Event(0.3, "an early event with a text that is longer than the picture has room for"), Event(0.8, "a late one")))
MANY = replace(CONTROL, target=Steps.none(), applied=Steps.none(), command=Steps.none(),
               events=tuple(Event(0.1 * k, "event") for k in range(7)))
LOUD = replace(ORDERS, judder=Judder(np.ones(6), np.array([1.0] * 5 + [2.3]), np.zeros(6)),
               slip_speed=np.ones((6, 1)) * np.select([ORDERS.order == 3.0, ORDERS.order > 5.0], [30.0, 1e-4], 1.0),
               modes=(116.8, 3870.0))
UNMEASURED = replace(ORDERS, frequency=np.full(6, 100.0), heat=np.full(6, np.nan), per_revolution=2.0,
                     shaft_torque=np.full((6, 101), np.nan))
DENSITY = replace(SPECTRUM, slip_speed=None, shaft_torque=None, slip_speed_density=0.25**SPECTRUM.order,
                  shaft_torque_density=0.5**SPECTRUM.order)
LINED = replace(SPECTRUM, slip_speed=0.15**SPECTRUM.order, shaft_torque=0.3 * 0.15**SPECTRUM.order)
MEASURED = SimpleNamespace(t=0.001 * np.arange(500.0), channels={"slip_speed": np.arange(500.0)})
PARAMETERS = [SimpleNamespace(key=key, start=start, value=value, high=high) for key, start, value, high in (
    ("driveline.stiffness", 3000.0, 3030.0, 3060.0), ("friction.kinetic_coefficient", 0.0, 0.2, np.inf),
    ("engine_torque.offset", -4.0, -3.0, -2.0))]
FITTED_RUN = SimpleNamespace(curve=None, residuals={"slip_speed": 0.5 * np.ones(450)}, noise={"slip_speed": 0.25},
                             parameters=PARAMETERS, likelihood=None, chi2_per_dof=2.34567, accepted=False,
                             measurement=MEASURED)
LYAPUNOV = [{"exponent": 1.0, "low": 0.5, "high": 1.5}, None, None, {"exponent": -1.0, "low": -2.0, "high": -0.5}]
VARYING = {"varying": True, "judder_rms": [1.0, 2.0, 3.0, None], "max_shaft_torque": [600.0, 650.0, 700.0, None],
           "quantiles": {name: [1.0, None] for name in (*SCATTER["quantiles"], "judder_rms", "max_shaft_torque")}}
LAW = {"friction.slip_speeds": [0.0, 1.0, 2.0, 4.0], "friction.coefficients": [0.14, 0.12, 0.11, 0.105]}
MANOEUVRE = {"pressure.mean_times": [0.0, 0.8], "pressure.mean_values": [1e5, 2e5]}


class Twin(SimpleNamespace):
    """A run beside a recording."""

    def __str__(self) -> str:
        return "rms difference 1 rad/s"


TWIN = Twin(trajectory=SimpleNamespace(t=np.arange(-10.0, 31.0), slip_speed=np.arange(41.0), cycle=1.0),
            t=np.arange(-10.0, 31.0), slip_speed=2.0 * np.arange(41.0), difference=-np.arange(41.0))


def whole(run: Trajectory, cycles: Cycles, summary: Any, **more: Any) -> Callable[..., object]:
    """Return a function that draws an overview."""
    return lambda path, title, width: overview.overview(path, run, cycles, 7, summary, title, width=width, **more)


def of(draw: Callable[..., object], result: Any) -> Callable[..., object]:
    """Return a function that draws a result."""
    return lambda path, title, width: draw(path, result, title, style.width_of(width))


CASES: dict[str, Callable[..., object]] = {
    "sweep": of(sweeps.draw_sweep, {**SWEEP, "lyapunov": LYAPUNOV}),
    "sweep of a manoeuvre": of(sweeps.draw_sweep, {**SWEEP, "varying": True, "transient": [False] * 4}),
    "grid": of(sweeps.draw_grid, {**GRID, "period": [[1, 17, 0, None]]}), "scatter": of(sweeps.draw_scatter, SCATTER),
    "scatter of a manoeuvre": of(sweeps.draw_scatter, {**SCATTER, **VARYING}), "bands": of(sweeps.draw_scatter, BAND),
    "response": of(estimation.bode, CHECKED), "fit": of(estimation.identification, FITTED),
    "fit with samples": of(estimation.identification, FITTED_RUN),
    "run-up": of(order_maps.plot_orders, LOUD), "unmeasured orders": of(order_maps.plot_orders, UNMEASURED),
    "comparison": of(order_maps.plot_comparison, OrderComparison(*(
        replace(run, per_revolution=2.0) for run in (QUIET, LOUD)))),
    "spectrum": of(order_maps.plot_spectrum, replace(LINED, subharmonics=np.array([2.0]))),
    "densities": of(order_maps.plot_spectrum, DENSITY), "friction law": of(friction_law.draw_friction, "fig02"),
    "friction table": of(friction_law.draw_friction, changed(System(), LAW)),
    "set-valued law": of(friction_law.draw_friction, changed(System(), {"friction.law": "set_valued"})),
    "twin": of(whole_runs.draw_twin, TWIN),
    "manoeuvre": lambda path, title, width: whole_runs.manoeuvre(
        path, replace(RUN, system=changed(System(), MANOEUVRE)), style.width_of(width), title, CONTROL),
    "overview": whole(RUN, CYCLES, PERIODIC), "overview of events": whole(RUN, UNEVEN, APERIODIC, control=MANY),
    "overview of a controller": whole(RUN, CYCLES, PERIODIC, control=CONTROL, spectrum=LINED)}


ALIKE = {"sweep of a manoeuvre", "scatter of a manoeuvre", "fit with samples", "densities", "friction table",
         "set-valued law", "overview", "overview of events"}
"""Cases that other cases of the same function cover over a page."""


def lines_of(name: str, patch: pytest.MonkeyPatch) -> list[str]:
    """Return the description of a picture in a column, and the lines that differ over a page."""
    figures = kept(patch)
    patch.setattr(overview, "between", lambda run: run)
    for width in ("column",) if name in ALIKE else ("column", "page"):
        CASES[name](Path("none.png"), "a title", width)
    column, *page = map(described, figures)
    return [*column, *(["over a page", *new_lines(page[0], column)] if page else [])]


@pytest.mark.parametrize(("sharp", "raster"), [(len(RUN.t), False), (len(RUN.t) - 1, True)])
def test_long_lines_of_a_manoeuvre_are_rasterized(sharp: int, raster: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = kept(monkeypatch)
    monkeypatch.setattr(whole_runs, "SHARP", sharp)
    CASES["manoeuvre"](Path("none.png"), "", "page")
    assert {line.get_rasterized() for axis in figures[0].axes[:2] for line in axis.lines} == {raster}


@pytest.mark.parametrize("name", CASES)
def test_a_picture_is_as_it_is_described(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name == "response" and matplotlib.__version_info__ < (3, 11):
        pytest.skip("an older matplotlib finds no place for this legend within the axes")
    assert lines_of(name, monkeypatch) == expected(PAGE, name)
