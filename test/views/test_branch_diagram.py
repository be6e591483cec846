"""Pictures of branches: solid to the very bifurcation at which motions become unstable."""

import math
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.views.branch_diagram import branch_diagram, stable_and_unstable


def found(stable: list[bool], **bifurcation: object) -> dict[str, object]:
    values = [float(k) for k in range(len(stable))]
    return {"branches": [{"value": values, "max_slip_speed": [10.0 * v for v in values], "stable": stable}],
            "bifurcations": [{"branch": 0, **bifurcation}] if bifurcation else []}


def test_a_branch_is_solid_to_its_bifurcation_and_dashed_behind_it() -> None:
    both = found([True, True, False, False], after=1, value=1.7, max_slip_speed=14.0, changes_stability=True)
    (x, y), (other_x, other_y) = stable_and_unstable(both, 0)
    assert x[np.isfinite(x)].tolist() == [0.0, 1.0, 1.7]
    assert y[np.isfinite(y)].tolist() == [0.0, 10.0, 14.0]
    assert other_x[np.isfinite(other_x)].tolist() == [1.7, 2.0, 3.0]
    assert other_y[np.isfinite(other_y)].tolist() == [14.0, 20.0, 30.0]


def test_a_fold_between_points_of_one_kind_is_a_corner_of_the_line() -> None:
    (x, _), (other, _) = stable_and_unstable(found([False, False], after=0, value=1.2, max_slip_speed=5.0,
                                                   changes_stability=False), 0)
    assert len(x) == 0
    assert other[1:].tolist() == [0.0, 1.2, 1.0]


def test_a_piece_that_no_bifurcation_parts_is_dashed_where_either_end_is_unstable() -> None:
    (x, _), (other, _) = stable_and_unstable(found([True, False, True, True]), 0)
    assert x[1:].tolist() == [2.0, 3.0]
    assert other[1:].tolist() == [0.0, 1.0, 2.0]
    (x, _), _ = stable_and_unstable(found([True, True, False, True, True]), 0)
    np.testing.assert_array_equal(x, [math.nan, 0.0, 1.0, math.nan, 3.0, 4.0])


def test_the_picture_has_its_title_and_its_axes_named(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    values = {**found([True, True, False]), "over": "engine.frequency"}
    values["branches"][0]["period"] = 1
    values["bifurcations"] = []
    drawn = branch_diagram(tmp_path / "branches.svg", values, title="a scene").read_text()
    # Matplotlib writes each text as outlines, behind a comment that says it.
    for words in ("a scene", r"engine frequency $\omega$ (rad/s)", "max |slip speed| (rad/s)"):
        assert f"<!-- {words} -->" in drawn
    values["curves"] = [{"kind": "fold", "value": [1.0, 2.0], "second": [3.0, 4.0]}]
    drawn = branch_diagram(tmp_path / "curves.svg", {**values, "second_over": "pressure.mean"}).read_text()
    assert "<!-- mean pressure $P_m$ (Pa) -->" in drawn
