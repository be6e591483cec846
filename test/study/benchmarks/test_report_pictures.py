"""Pictures of made-up reports, artist by artist, as `pictures.txt` describes them; look at one before changing it."""

import dataclasses
from pathlib import Path

import pytest
from described import described, expected, kept, new_lines

from tcc_sim.study.benchmarks import report_drawings
from tcc_sim.study.benchmarks.extremes import Examined
from tcc_sim.study.benchmarks.precision_report import PrecisionResult, References, SteadyState, StudiedScene
from tcc_sim.study.benchmarks.stability import ErrorChart
from tcc_sim.views import style

PAGE = Path(__file__).with_name("pictures.txt")


def scene(name, law, *solvers):
    """A scene with three errors of each solver: 1e-5, 1e-7 below what XPPAUT writes, and 1e-9 below the floor."""
    results = [PrecisionResult(solver, 1e-6, 2.0 * e, e, 0.5 * e, None if k else e, 10.0**k, 10.0**k, None)
               for solver in solvers for k, e in enumerate((1e-5, 1e-7, 1e-9))]
    return StudiedScene(name, "Tm = 100 N m, sigma and mu_s/mu_k = 2, mu_k = mu_s with Tp", law, 5,
                        References([], 1e-8), SteadyState(400, 0, None, None, []), results)


SCENES = [scene("fig02", "smoothed", "smoothed", "XPPAUT cvode", "a new one"),
          scene("fig02, set-valued", "set_valued", "event_driven"),
          scene("steep from its initial state", "smoothed", "radau")]
SIGMA, RATIO = (ErrorChart(key, values, method, [1e-4, 1e-3], [[1e-10, 1e-3], [None, 10.0], [0.0, 1e-6]], limits)
                for key, values, method, limits in (
                    ("friction.smoothing", [50.0, 500.0, 5000.0], "rk4",
                     {"rk4": [2e-4, 3e-4, None], "uniqueness": [3e-4, 4e-4, None]}),
                    ("friction.kinetic_coefficient", [0.3, 0.15, 0.1], "fixed_step",
                     {"rk4": [2e-4, 3e-4, None], "uniqueness": [None, 5e-2, 6e-2]})))
CHARTS = [SIGMA, RATIO, *(dataclasses.replace(SIGMA, method=name) for name in ("SDIRK3, one step", "smoothed"))]
RUNS = [Examined({}, solver, None, error=error, power_residual=power) for solver, error, power in (
    ("smoothed", 1e-5, 1e-7), ("smoothed", 0.0, None), ("smoothed", 1e-6, 1e-8), ("fixed_step", None, 1e-3))]
CASES = {
    "error against run time": (report_drawings.draw_precision, SCENES, ""),
    "error of the section": (report_drawings.draw_section, SCENES, "a title"),
    "stability": (report_drawings.draw_stability, CHARTS, RUNS, "a title"),
    "an interrupted stability report": (report_drawings.draw_stability, [], RUNS[3:], "")}


@pytest.mark.parametrize("name", CASES)
def test_a_picture_is_as_it_is_described(name, monkeypatch):
    """On a page; and in a column, by the lines that the description of the page lacks."""
    figures = kept(monkeypatch)
    for width in (style.PAGE, style.COLUMN):
        draw, *numbers = CASES[name]
        draw(Path("a.png"), *numbers, width)
    page, column = map(described, figures)
    assert page == expected(PAGE, name)
    assert new_lines(column, page) == expected(PAGE, f"{name}, column")
