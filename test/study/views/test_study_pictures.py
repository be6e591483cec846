"""Pictures of made-up branches and basins, artist by artist, as `pictures.txt` describes them; see the picture before
changing it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from described import described, expected, kept

from tcc_sim.study.views.basin_map import draw_basins, into
from tcc_sim.study.views.branch_diagram import branch_diagram
from tcc_sim.views import style

pytest.importorskip("matplotlib")
PAGE = Path(__file__).with_name("pictures.txt")
ORBIT = {"period": 1, "max_slip_speed": 20.0, "section_states": [[0.1, 5.0, 9.0], [0.1, 5.0, 90.0]], "fraction": 0.5}
AWAY = {"period": 0, "max_slip_speed": 30.0, "section_states": [[0.3, -5.0, 3.0], [0.1, 6.0, 7.0]], "fraction": 0.125}
UNSEEN = {**ORBIT, "period": 2, "section_states": [[0.1, 50.0, 9.0]], "fraction": 0.125}
AXES = [{"key": "initial.slip_speed", "values": [0.0, 10.0]},
        {"key": "initial.plate_speed", "values": [0.0, 10.0, 20.0]}]
PLANE = {"plane": AXES, "attractors": [ORBIT, AWAY, UNSEEN], "undecided": 0.125, "runaway": 0.125, "seconds": 1.0}
LABELS = np.array([[0, 1], [0, -1], [0, -2]])
OVER = {"over": "engine.frequency", "values": [100.0, 150.0], "plane": AXES, "undecided": [0.0, 0.125],
        "runaway": [0.0, 0.0], "attractors": [[{**ORBIT, "fraction": 1.0}],
                                              [ORBIT, {**ORBIT, "fraction": 0.25}, AWAY, {**UNSEEN, "fraction": 0.0}]]}
FOLD = {"kind": "fold", "value": 0.27, "max_slip_speed": 15.0, "branch": 0, "after": 1, "changes_stability": True}
DOUBLING = {**FOLD, "kind": "period_doubling", "value": 0.22, "after": 0, "changes_stability": False}
BRANCHES = {"over": "friction.kinetic_coefficient", "branches": [
    {"period": 2, "value": [0.2, 0.24, 0.3], "max_slip_speed": [30.0, 20.0, 10.0], "stable": [True, True, False]},
    {"period": 1, "value": [0.2, 0.3], "max_slip_speed": [3.0, 2.0], "stable": [False, True]},
    {"period": 1, "value": [0.21, 0.29], "max_slip_speed": [4.0, 5.0], "stable": [True, True]}],
    "bifurcations": [FOLD, DOUBLING, {**FOLD, "branch": 5}]}
POINT = {"kind": "fold_flip", "value": 0.25, "second": 140.0}
CURVES = {**BRANCHES, "second_over": "engine.frequency", "curves": [
    {"kind": "fold", "value": [0.2, 0.25], "second": [130.0, 140.0], "special": [POINT]},
    {"kind": "stick_border", "value": [0.3, 0.31], "second": [130.0, 135.0]},
    {"kind": "fold", "value": [0.1, 0.12], "second": [120.0, 125.0]}]}
CASES: dict[str, tuple[Callable[..., object], dict[str, Any]]] = {
    "branches": (branch_diagram, BRANCHES), "curves of bifurcations": (branch_diagram, CURVES),
    "basins": (draw_basins, {**PLANE, "labels": LABELS}), "basins without cells": (draw_basins, PLANE),
    "fractions of the plane": (draw_basins, OVER)}


@pytest.mark.parametrize("name", CASES)
def test_a_picture_is_as_it_is_described(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = kept(monkeypatch)
    draw, document = CASES[name]
    draw(Path("a.png"), document, "a title", style.COLUMN)
    assert described(figures[0]) == expected(PAGE, name)


def test_a_map_in_given_axes_has_its_legend_above_them() -> None:
    with style.figure() as drawn:
        for document in (PLANE, OVER):
            into(drawn.add_subplot(), document)
        result = [line for line in described(drawn) if line.startswith("  legend")]
        assert result == expected(PAGE, "legends in given axes")
