"""Stable and unstable parts of a branch, each to the bifurcation at which it ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tcc_sim.study.views import stable_and_unstable

BRANCH = {"period": 2, "value": [0.2, 0.24, 0.3, 0.26], "max_slip_speed": [30.0, 20.0, 10.0, 5.0],
          "stable": [True, True, False, False]}


def bifurcation(value: float, largest: float, after: int, changes: bool = True, **how: Any) -> dict[str, Any]:
    return {"kind": "fold", "value": value, "max_slip_speed": largest, "branch": 0, "after": after,
            "changes_stability": changes, **how}


NAN = float("nan")


@pytest.mark.parametrize(("found", "stable", "unstable"), [
    ([], [(0.2, 30.0), (0.24, 20.0)], [(0.24, 20.0), (0.3, 10.0), (0.26, 5.0)]),
    ([bifurcation(0.28, 15.0, 1)], [(0.2, 30.0), (0.24, 20.0), (0.28, 15.0)],
     [(0.28, 15.0), (0.3, 10.0), (0.26, 5.0)]),
    ([bifurcation(0.25, 18.0, 1, False), bifurcation(0.28, 15.0, 1)],
     [(0.2, 30.0), (0.24, 20.0), (0.25, 18.0), (0.28, 15.0)], [(0.28, 15.0), (0.3, 10.0), (0.26, 5.0)]),
    ([bifurcation(0.25, 18.0, 1), bifurcation(0.28, 15.0, 1, False)], [(0.2, 30.0), (0.24, 20.0), (0.25, 18.0)],
     [(0.25, 18.0), (0.28, 15.0), (0.3, 10.0), (0.26, 5.0)]),
    ([bifurcation(0.28, 15.0, 1, branch=1)], [(0.2, 30.0), (0.24, 20.0)], [(0.24, 20.0), (0.3, 10.0), (0.26, 5.0)])])
def test_a_part_of_a_branch_ends_at_the_bifurcation_that_changes_its_stability(found: Any, stable: Any,
                                                                              unstable: Any) -> None:
    parts = stable_and_unstable({"branches": [BRANCH], "bifurcations": found}, 0)
    for (x, y), corners in zip(parts, (stable, unstable)):
        np.testing.assert_array_equal(np.column_stack([x, y]), [(NAN, NAN), *corners])


def test_parts_of_one_kind_are_apart() -> None:
    branch = {"value": [0.0, 1.0, 2.0, 3.0], "max_slip_speed": [0.0] * 4, "stable": [True, True, False, True]}
    marks = [bifurcation(1.5, 0.0, 1), bifurcation(2.5, 0.0, 2)]
    (x, _), (u, _) = stable_and_unstable({"branches": [branch], "bifurcations": marks}, 0)
    np.testing.assert_array_equal(x, [NAN, 0.0, 1.0, 1.5, NAN, 2.5, 3.0])
    np.testing.assert_array_equal(u, [NAN, 1.5, 2.0, 2.5])
