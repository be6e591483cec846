"""Pictures of made-up numbers, artist by artist, as `pictures.txt` describes them; look at one before changing it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from described import described, expected, kept, new_lines
from given import curve_of, curves_of, figure_of

from tcc_sim.analysis.multipliers import Lyapunov
from tcc_sim.study.paper import drawings
from tcc_sim.study.paper.catalogue import OMEGA_N
from tcc_sim.study.paper.figure_results import Coexisting, Figure, JumpBehind, Labelled, MotionsBehind, Reached
from tcc_sim.views import style

PAGE = Path(__file__).with_name("pictures.txt")

X = [0.1, 0.2, 0.3, 0.5]
MARKS: dict[str, Any] = {
    "settled": [True, False, False, None], "period": [1, 2, 0, 0], "runaway": [False, False, False, True],
    "theta2": [[0.1], [0.2, 0.3], [0.4, 0.5, 0.6], [0.7]],
    "coexisting": [Coexisting(1, 2.0, 2.0, 2, Reached(9.0, 1), True),
                   Coexisting(0, 1.0, 1.0, 2, Reached(6.0, 1), False)]}
"""A curve with a mark of every kind; the last motion runs away."""
STEADY = {"settled": [True] * 4, "period": [1] * 4, "runaway": [False] * 4, "theta2": [[0.2]] * 3 + [None]}


def behind(unit: float) -> MotionsBehind:
    """Two branches, of which one folds, and jumps of every cause."""
    one = {"period": 1, "value": [0.1 * unit, 0.3 * unit, 0.2 * unit], "max_slip_speed": [10.0, 20.0, 30.0],
           "stable": [True, True, False]}
    fold = {"kind": "fold", "value": 0.31 * unit, "max_slip_speed": 21.0, "branch": 0, "after": 1,
            "changes_stability": True}
    other = {**one, "period": 4, "max_slip_speed": [8.0, 8.0, 8.0], "stable": [False] * 3}
    causes = {"fold": 0.31, "basin_boundary": 0.312, "grazing_sliding": 0.2, "steep": 0.4, "aperiodic": 0.45}
    return MotionsBehind([one, other], [fold, {**fold, "kind": "stick_border", "branch": 1}], [
        JumpBehind(x * unit, (0.0, 1.0), (2.0, 3.0), cause, None) for cause, x in causes.items()], [])


def figure(kind: str, *curves: Labelled, **numbers: Any) -> Figure:
    given = curves_of(curves) | {"x": X} | numbers if kind in ("map", "orbit", "damping") else numbers
    return figure_of(kind, given)


PANEL = Labelled(label=r"$\omega/\omega_n = 0.36$", period=2, section=[(0.1, 5.0), (0.2, 6.0)],
                 t=np.array([0.0, 1.5, 3.0]), slip_speed=np.array([0.0, 30.0, -2.0]),
                 plate_angle=np.array([0.1, 0.2, 0.1]), engine_torque=np.array([3.0, 4.0, 5.0]),
                 saturation_torque=np.array([6.0, 7.0, 8.0]), state=np.array([0, 1, -1]), first_half=0.25)
CHAOTIC = replace(PANEL, period=0, section=[(0.4, 20.0)], slip_speed=4.0 * PANEL.slip_speed,
                  lyapunov=Lyapunov(2.0, 1.5, 2.5, 0.95, 100, "chaotic"))
NAMELESS = replace(PANEL, period=0, lyapunov=Lyapunov(math.nan, 1.5, 2.5, 0.95, 100, "unresolved"), first_half=math.nan,
                   orbit={"stable": False, "multipliers": [[0.3, 0.4], [-3.0, 4.0]]})
FOLLOWED = replace(PANEL, orbit={"stable": True, "multipliers": [[0.3, 0.4], [0.3, -0.4], [0.0, 0.0]]})
T = np.linspace(0.0, 3.0, 31)
SOLVED = replace(PANEL, t=T, slip_speed=np.where(T > 1.05, 30.0, 0.0), max_slip_speed=31.0)
SOLVERS = [replace(SOLVED, label=name, solver=name, rms_difference=size) for name, size in (
    ("smoothed", 0.5), ("rk45", 1e-3), ("bdf", 2e-3), ("event_driven", 3e-3), ("rk4", math.nan))]
LAW = Labelled(label="1.25", peak=1.2, peak_slip_speed=0.05, coefficient=T, slope=T, near_coefficient=2.0 * T,
               near_slope=3.0 * T, near_set_valued=4.0 * T)
ONE = curve_of([1.0, 2.0, 3.0, 900.0], label="one", **MARKS)
TWO = curve_of([12.0, 4.0, 2.0, None], label="two", **STEADY)
LONG = "a title that is far too long for one line of a narrow column"
CASES: dict[str, tuple[Figure, str]] = {
    "map": (figure("map", ONE, TWO), ""),
    "map with branches": (figure("map", *(replace(c, behind=behind(OMEGA_N)) for c in (ONE, TWO))), ""),
    "damping": (figure("damping", curve_of([1.0, 2.0, 3.0, 900.0], **MARKS, equivalent_damping=[-0.1, None, 0.2, 0.3],
                                           negative_slope_mean=[-0.2] * 4), threshold=-0.6), LONG),
    "orbit": (figure("orbit", ONE, replace(TWO, direction="up"), replace(ONE, direction="down")), LONG),
    "orbit with branches": (figure("orbit", replace(ONE, behind=behind(OMEGA_N))), ""),
    "law": (figure("law", curves=[LAW, replace(LAW, peak_slip_speed=math.nan)], slip_speed=T, near_slip_speed=T), ""),
    "histories": (figure("histories", panels=[PANEL, CHAOTIC, NAMELESS]), ""),
    "delay": (figure("delay", panels=[PANEL, PANEL, PANEL, NAMELESS]), ""),
    "actuation": (figure("actuation", panels=[PANEL, FOLLOWED, NAMELESS]), ""),
    "solvers": (figure("solvers", curves=SOLVERS, steady=SOLVERS[:3], cycle=0.1, steady_cycles=10), "")}


@pytest.mark.parametrize("name", CASES)
def test_a_picture_is_as_it_is_described(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a page; and in a column, by the lines that the description of the page lacks."""
    figures = kept(monkeypatch)
    data, title = CASES[name]
    for width in (style.PAGE, style.COLUMN):
        drawings.draw(data, Path("a.png"), title, width)
    page, column = map(described, figures)
    assert page == expected(PAGE, name)
    assert new_lines(column, page) == expected(PAGE, f"{name}, column")
