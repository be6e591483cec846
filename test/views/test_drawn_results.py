"""Pictures of made-up results: curves, marks and maps on their numbers, in a column, over a page and into an axis."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pictures import check, covered, curves, entries, labelled, panels
from results_by_hand import (
    BAND,
    BRANCHES,
    CELLS,
    CURVES,
    FAR,
    FITTED,
    GRID,
    ORDERS,
    OVER,
    PLANE,
    QUIET,
    RESPONSE,
    SCATTER,
    SPECTRUM,
    SWEEP,
)

import tcc_sim
from tcc_sim.analysis.measured.orders import OrderComparison
from tcc_sim.errors import InputError
from tcc_sim.replay.given_inputs import Twin

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

NAN = float("nan")


def near(curve: Any, *points: tuple[float, float]) -> None:
    """Check the points of a curve."""
    np.testing.assert_allclose(np.transpose(curve), points, rtol=1e-9, atol=1e-12)


def mesh(axis: Any, number: int = 0) -> Any:
    """Return the cells of a map, NaN where none is drawn."""
    shown = [each for each in axis.collections if hasattr(each, "get_coordinates")][number]
    cells = shown.get_coordinates()
    return np.ma.filled(np.ma.asarray(shown.get_array(), float), NAN).reshape(len(cells) - 1, -1)


def sweep(drawn: Any) -> None:
    """A runaway is a triangle at the upper edge and sets no scale; a failure is a cross; a transient is open."""
    maxima = curves(panels(drawn)["Maxima"])
    near(maxima["stick"], (1.0, 0.0))
    near(maxima["slip"], (2.0, 20.0))
    near(maxima["not settled (1)"], (2.0, 20.0))
    assert maxima["runaway"][0] == 3.0
    assert maxima["runaway"][1] < panels(drawn)["Maxima"].get_ylim()[1] < 40.0
    assert maxima["failed"][0] == 4.0
    orbit = curves(panels(drawn)["Orbit diagram"])
    near(orbit["periodic"], (1.0, 0.1))
    near(orbit["not settled"], (2.0, 0.2))
    stick, = curves(panels(drawn)["Time in stick"]).values()
    known = np.isfinite(stick).all(axis=0)
    near((stick[0][known], stick[1][known]), (1.0, 100.0), (2.0, 0.0), (3.0, 0.0))


def exponents(drawn: Any) -> None:
    """Exponents with their intervals."""
    axis = panels(drawn)["Largest Lyapunov exponent"]
    x, y = curves(axis)["1"]
    assert dict(zip(x, y))[1.0] == 1.0
    ends = {tuple(path.vertices[:, 1]) for path in axis.collections[0].get_paths()}
    assert {(0.5, 1.5), (-2.0, -0.5)} <= ends


def grid(drawn: Any) -> None:
    """Cells of maxima and of periods."""
    shown = panels(drawn)
    np.testing.assert_array_equal(mesh(shown["Maxima"]), [[0.0, 20.0, NAN, NAN]])
    assert np.isfinite(mesh(shown["Maxima"], 1)).tolist() == [[False, False, True, False]]
    assert len(set(mesh(shown["Period"])[0, :3])) == 3
    assert [name for name in ("runaway", "failed") if name in entries(drawn)] == ["runaway", "failed"]
    assert "hatched: 1 of 4 have not settled" in entries(drawn)


def scatter(drawn: Any) -> None:
    """Samples over the scattered key."""
    near(curves(drawn.axes[0])["slip"], (2.0, 20.0))
    near(curves(drawn.axes[1])["stick"], (1.0, 100.0))


def band(drawn: Any) -> None:
    """A band between the outer quantiles, and the median."""
    x, median = curves(drawn.axes[0])["median"]
    assert (x.tolist(), median[0]) == ([1.0, 2.0], 2.0)
    path, = drawn.axes[0].collections[0].get_paths()[:1]
    assert {1.0, 3.0} <= set(path.vertices[:, 1])


def bode(drawn: Any) -> None:
    """Decibels and degrees over rad/s."""
    gain, phase = drawn.axes
    near(next(iter(curves(gain).values())), (1.0, -60.0), (10.0, -80.0))
    near(next(iter(curves(phase).values())), (1.0, 0.0), (10.0, np.degrees(3.0)))


def fit(drawn: Any) -> None:
    """Parameters relative to their starts, the curve with its band, and the likelihood."""
    parameters, curve, likelihood = drawn.axes
    assert any(len(x) == 1 and x[0] == pytest.approx(1.0) for x, _ in curves(parameters).values())
    near(curves(curve)["scene"], (0.0, 0.25), (1.0, 0.25), (2.0, 0.25))
    near(curves(likelihood)["0"], (1.0, 0.0), (2.0, 9.0))


def orders(drawn: Any) -> None:
    """Maps over the engine frequency; cuts in dB; heat in kJ."""
    shown = panels(drawn)
    np.testing.assert_allclose(mesh(shown["Slip speed"]), 0.0, atol=1e-9)
    x, heat = next(iter(curves(shown["Cumulative heat"]).values()))
    near((x, heat), *zip(80.0 + 100.0 * np.linspace(0.0, 1.0, 6), 1e-3 * np.linspace(0.0, 1.0, 6)))
    assert shown["Cumulative heat"].get_xlabel() == "engine frequency (rad/s)"
    near(curves(shown["Judder"])["peak"], *((80.0 + 20.0 * k, 1.0) for k in range(6)))


def comparison(drawn: Any) -> None:
    """Simulated less measured, dB."""
    slip, torque = (mesh(axis) for title, axis in panels(drawn).items() if "difference" in title)
    np.testing.assert_allclose(slip, 0.0, atol=1e-9)
    assert np.nanmax(np.abs(torque)) == pytest.approx(180.0)


def spectrum(drawn: Any) -> None:
    """Lines over the order, down to five decades below the largest, and the frequency above."""
    axis = panels(drawn)["Spectrum of the slip speed"]
    x, y = curves(axis)["amplitude"]
    near((x, y), *((k, 10.0**-k) for k in range(1, 7)))
    above, = axis.child_axes
    assert "rad/s" in above.get_xlabel()
    drawn.draw_without_rendering()
    assert np.array(above.get_xlim()) / axis.get_xlim()[1] == pytest.approx([0.0, 100.0])


def law(drawn: Any) -> None:
    """mu_k and mu_s of the paper's scene at fast slip and at 0."""
    _, mu = curves(panels(drawn)["Friction law"])["sliding, (6)"]
    assert (mu[0], mu[-1]) == pytest.approx((0.3, 0.24), rel=2e-3)
    slope = panels(drawn)["Slope of the torque"]
    assert "N m s/rad" in slope.get_ylabel()


def table(drawn: Any) -> None:
    """A table with its fit."""
    near(curves(panels(drawn)["Friction law"])["table"], (0.0, 0.14), (1.0, 0.12), (2.0, 0.11), (4.0, 0.105))


def branches(drawn: Any) -> None:
    """A stable part ends at the bifurcation that changes it."""
    lines = curves(drawn.axes[0])
    near([side[[1, -1]] for side in lines["period 1, stable"]], (0.2, 30.0), (0.27, 15.0))
    near([side[[1, -1]] for side in lines["period 1, unstable"]], (0.27, 15.0), (0.3, 10.0))
    near(lines["fold"], (0.27, 15.0))


def curves_of_bifurcations(drawn: Any) -> None:
    """Folds in the plane of both keys."""
    near(curves(drawn.axes[1])["curve of fold"], (0.2, 130.0), (0.25, 140.0))


def plane(drawn: Any) -> None:
    """Section points within the plane; a note for an attractor outside."""
    axis, = drawn.axes
    points = [line for line in curves(axis).values() if len(line[0])]
    near(points[0], (5.0, 9.0))
    assert any(entry.startswith("period 1") and "75 %" in entry for entry in entries(drawn))


def cells(drawn: Any) -> None:
    """A cell for every start; the undecided one is white."""
    shown = mesh(drawn.axes[0])
    assert len({shown[0, 0], shown[0, 1], shown[1, 0]}) == 1
    assert shown[1, 1] != shown[0, 0]


def fractions(drawn: Any) -> None:
    """Fractions are stacked up to 1."""
    tops = [path.vertices[:, 1].max() for area in drawn.axes[0].collections for path in area.get_paths()]
    assert max(tops) == pytest.approx(1.0)
    assert {"period 1", "undecided"} <= set(entries(drawn))


def beside(drawn: Any) -> None:
    """Both slip speeds, and the difference."""
    near(curves(panels(drawn)["Simulated less recorded"])["0"], *((k, -1.0) for k in range(6)))


RUN = tcc_sim.solve("fig02", cycles=2, samples_per_cycle=10)
T = np.arange(6.0)
SHORT = {name: values[:6] for name, values in RUN.columns().items()}
TWIN = Twin(replace(RUN, **{**SHORT, "t": T, "slip_speed": T}, cycle=0.5), T, T + 1.0, "run1")
TABLE = tcc_sim.load_scene("fig02").with_values({"friction.slip_speeds": [0.0, 1.0, 2.0, 4.0],
                                                 "friction.coefficients": [0.14, 0.12, 0.11, 0.105]})
LYAPUNOV = [{"exponent": 1.0, "low": 0.5, "high": 1.5}, None, None, {"exponent": -1.0, "low": -2.0, "high": -0.5}]
UNMEASURED = replace(ORDERS, frequency=np.full(6, 100.0), heat=np.full(6, NAN), shaft_torque=np.full((6, 101), NAN))
DENSITY = replace(SPECTRUM, slip_speed=None, shaft_torque=None, slip_speed_density=0.25**SPECTRUM.order,
                  shaft_torque_density=0.5**SPECTRUM.order)


def of(kind: str, document: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON of a command."""
    return {"format": f"tcc_sim {kind} 1", **document}


def nothing(drawn: Any) -> None:
    """Only the general checks."""


CASES: dict[str, tuple[Any, Callable[[Any], None]]] = {
    "sweep": (of("sweep", SWEEP), sweep), "exponents": (of("sweep", {**SWEEP, "lyapunov": LYAPUNOV}), exponents),
    "manoeuvres": (of("sweep", {**SWEEP, "varying": True, "transient": [False] * 4}), nothing),
    "grid": (of("sweep", GRID), grid), "scatter": (of("sweep", SCATTER), scatter), "band": (of("sweep", BAND), band),
    "response": (of("linearise", RESPONSE), bode),
    "fit": (of("identify", FITTED), fit), "orders": (ORDERS, orders), "unmeasured": (UNMEASURED, nothing),
    "comparison": (OrderComparison(QUIET, ORDERS), comparison), "spectrum": (SPECTRUM, spectrum),
    "sub-harmonics": (replace(SPECTRUM, subharmonics=np.array([2.0])), nothing), "density": (DENSITY, nothing),
    "scene": (tcc_sim.load_scene("fig02"), law), "system": (tcc_sim.load_scene("stick").system, nothing),
    "table": (TABLE, table), "branches": (of("continue", BRANCHES), branches),
    "curves": (of("continue", CURVES), curves_of_bifurcations), "plane": (of("basins", PLANE), plane),
    "cells": (of("basins", {**CELLS, "arrays": {"labels": CELLS["labels"]}}), cells),
    "outside": (of("basins", {**PLANE, "attractors": [FAR]}), nothing), "fractions": (of("basins", OVER), fractions),
    "twin": (TWIN, beside)}


LAID_OUT = {"sweep": "column", "grid": "page", "scatter": "column", "band": "page", "fit": "column",
            "unmeasured": "column", "spectrum": "column", "scene": "page", "branches": "column", "curves": "column",
            "plane": "column", "cells": "column", "fractions": "column", "twin": "page"}
"""Widths of the pictures whose layout is tested, one for each kind of panel."""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", CASES)
def test_a_result_is_drawn_by_its_numbers(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """With a quantity and its unit along every axis; if it is laid out, legends beside the data, and nothing cut off.
    """
    saved = request.getfixturevalue("laid_out" if name in LAID_OUT else "pictures")
    (result, numbers), width = CASES[name], LAID_OUT.get(name, "page")
    tcc_sim.plot(result, tmp_path / "a.png", width, title="a title of a picture")
    drawn, = saved
    assert drawn.get_figwidth() == {"column": 3.5, "page": 7.2}[width]
    numbers(drawn)
    (check if name in LAID_OUT else labelled)(drawn)


@pytest.mark.parametrize("name", [*CASES, "run"])
def test_a_result_is_drawn_into_an_axis_alone(name: str) -> None:
    """Its figure gets nothing else but a colour bar, and its legend lies on no curve."""
    result = RUN if name == "run" else CASES[name][0]
    drawn = Figure()
    axis, second = drawn.subplots(1, 2)
    assert tcc_sim.plot(result, ax=axis, title="mine") is axis
    assert axis.has_data()
    assert not second.has_data()
    assert {other.get_label() for other in drawn.axes} <= {"", "<colorbar>"}
    if axis.get_legend() is not None:
        axis.get_xlim(), axis.get_ylim()  # They are worked out when they are asked for.
        assert covered(axis.get_legend()) == []
    assert "mine" in (axis.get_title(), axis.get_title(loc="left"))


def test_a_file_is_drawn_into_an_axis_in_its_own_unit(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({**of("sweep", SWEEP), "shown_units": "rpm"}))
    for units, shown in (None, "rpm"), ("hz", "Hz"):
        assert shown in tcc_sim.plot(tmp_path / "a.json", ax=Figure().subplots(), units=units).get_ylabel()


def test_a_period_has_one_colour_in_every_map() -> None:
    """Whatever other attractors a map of basins has, and in fractions and branches."""
    colours = []
    for attractors in ([PLANE["attractors"][0]], [FAR, PLANE["attractors"][0]]):
        axis = Figure().subplots()
        tcc_sim.plot(of("basins", {**PLANE, "attractors": attractors}), ax=axis)
        colours.append({to_hex(line.get_color()) for line in axis.lines
                        if len(line.get_xdata()) and str(line.get_label()).startswith("_")})
    assert colours[0] == colours[1]


@pytest.mark.parametrize(("result", "arguments"), [
    (3.0, {}), (RUN, {"width": "poster"}), (RUN, {"units": "bpm"}), (RUN, {"file": "a.jpg"}), ("none.json", {}),
    (SimpleNamespace(trajectory=3.0), {})])
def test_what_cannot_be_drawn_is_refused_without_a_file(result: Any, arguments: dict[str, Any], tmp_path: Path,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError):
        tcc_sim.plot(result, **{"file": "a.png", **arguments})
    with pytest.raises(InputError):
        tcc_sim.plot(RUN, "a.png", ax=Figure().subplots())
    with pytest.raises(InputError):
        tcc_sim.plot(replace(RUN, **{k: values[:2] for k, values in RUN.columns().items()}), ax=Figure().subplots())
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.png").write_text("mine")
    with pytest.raises(InputError):
        tcc_sim.plot(RUN, "a.png")
    assert (tmp_path / "a.png").read_text() == "mine"


def test_a_picture_without_a_file_is_one_for_a_notebook() -> None:
    picture = tcc_sim.plot(of("basins", PLANE), width="column")
    assert picture._repr_png_().startswith(b"\x89PNG")
