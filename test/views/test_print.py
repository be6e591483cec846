"""Pictures for print: fonts, widths, titles, legends, and marks with their places."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.views import basin_map, branch_diagram, estimation, style, sweeps

ORBIT = {"number": 0, "period": 1, "max_slip_speed": 20.0, "section": [[0.1, 5.0]], "section_states": [[0.1, 5.0, 9.0]],
         "multipliers": None, "fraction": 0.75, "radius": 0.1, "state": [5.0, 0.1, 9.0]}
PLANE = {"plane": [{"key": "initial.slip_speed", "values": [0.0, 10.0]},
                   {"key": "initial.plate_speed", "values": [0.0, 10.0]}],
         "attractors": [ORBIT], "undecided": 0.25, "runaway": 0.0, "seconds": 1.0}
BRANCH = {"period": 1, "value": [0.2, 0.24, 0.3], "max_slip_speed": [30.0, 20.0, 10.0], "stable": [True, True, False]}
FOLD = {"kind": "fold", "value": 0.27, "max_slip_speed": 15.0, "branch": 0, "after": 1, "changes_stability": True,
        "limit": 0.28, "limit_error": 0.002}
BRANCHES = {"over": "friction.kinetic_coefficient", "branches": [BRANCH], "bifurcations": [
    FOLD, *({**FOLD, "kind": kind, "limit": None, "after": 0} for kind in branch_diagram.MARKS)]}
RESPONSE = {"input": "actuation_pressure", "output": "friction_torque", "kind": "periodic", "checked": [],
            "operating_point": {"mean_slip": 20.0}, "frequencies": [1.0, 10.0], "gain": [1e-3, 1e-4],
            "phase": [0.0, 3.0]}


@pytest.fixture(autouse=True)
def _matplotlib() -> None:
    pytest.importorskip("matplotlib")


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every figure that is saved."""
    found: list[Any] = []
    plain = style.save
    monkeypatch.setattr(style, "save", lambda drawn, path: found.append(drawn) or plain(drawn, path))
    return found


@pytest.mark.parametrize("width", [style.COLUMN, style.PAGE])
@pytest.mark.parametrize(("draw", "values"), [
    (branch_diagram.branch_diagram, BRANCHES), (estimation.bode, RESPONSE), (basin_map.draw_basins, PLANE)])
def test_labels_lie_within_the_picture_and_axes_are_no_strips(draw, values, width, saved, tmp_path):
    """The column of `continue --switch` with every kind of bifurcation, and of `linearise`, had both faults."""
    draw(tmp_path / "a.png", values, 3 * "a long title of a scene ", width)
    drawn, = saved
    assert drawn.get_figwidth() == width
    whole, inside = drawn.bbox, drawn.get_tightbbox()
    assert inside.x0 >= -0.01
    assert inside.y0 >= -0.01
    assert inside.x1 <= whole.width / drawn.dpi + 0.01
    assert inside.y1 <= whole.height / drawn.dpi + 0.01
    for axis in drawn.axes:
        box = axis.get_window_extent()
        assert min(box.width, box.height) / drawn.dpi > 1.2


def test_fonts_of_a_pdf_are_truetype(tmp_path: Path) -> None:
    estimation.bode(tmp_path / "a.pdf", RESPONSE)
    data = (tmp_path / "a.pdf").read_bytes()
    assert b"/Type3" not in data
    assert b"/CIDFontType2" in data


def test_limits_of_bifurcations_are_drawn_beside_them(saved: list[Any], tmp_path: Path) -> None:
    branch_diagram.branch_diagram(tmp_path / "a.svg", BRANCHES)
    axis = saved[0].axes[0]
    assert [0.27, 0.28] in [list(line.get_xdata()) for line in axis.lines]
    assert r"limit as $\sigma \to \infty$" in axis.get_legend_handles_labels()[1]
    (low, high), = (segment[:, 0] for c in axis.containers for segment in c.lines[2][0].get_segments())
    assert (low, high) == pytest.approx((0.278, 0.282))


def test_marks_of_attractors_say_along_which_state_they_are_projected(saved: list[Any], tmp_path: Path) -> None:
    basin_map.draw_basins(tmp_path / "a.png", {**PLANE, "labels": np.array([[0, 0], [0, -1]])})
    axis = saved[0].axes[0]
    assert axis.lines[0].get_xydata().tolist() == [[5.0, 9.0]]  # Slip speed and plate speed, not the angle.
    assert r"their sections, projected along the plate angle $\delta_2$" in axis.get_legend_handles_labels()[1]
    assert len(axis.collections) == 1
    basin_map.draw_basins(tmp_path / "b.png", PLANE)
    assert len(saved[1].axes[0].collections) == 0
    assert saved[1].axes[0].get_xlim() == axis.get_xlim() == (-5.0, 15.0)


def test_cells_that_have_not_settled_are_hatched(saved: list[Any], tmp_path: Path) -> None:
    """The hatching had an opacity of 0."""
    grid = {"over": "engine.frequency", "second_over": "pressure.mean", "values": [1.0, 2.0], "second_values": [3.0],
            "max_slip_speed": [[1.0, 2.0]], "period": [[1, 1]], "regime": [["slip", "slip"]],
            "runaway": [[False, False]], "transient": [[False, True]]}
    sweeps.draw_grid(tmp_path / "a.png", grid)
    for axis in saved[0].axes[:2]:
        cells, = (c for c in axis.collections if c.get_hatch())
        path, = cells.get_paths()
        assert path.get_extents().bounds == pytest.approx((1.5, 1.5, 1.0, 3.0))
        assert cells.get_edgecolor()[0, 3] == 1.0
    assert "1 of 2 have not settled" in saved[0]._supxlabel.get_text()


def test_a_title_is_over_the_picture_and_a_legend_beside_no_panel_title(saved: list[Any], tmp_path: Path) -> None:
    words = ["simulate", "minimal", "--cycles", "60", "--width", "column", "--title", "Mine", "--plot"]
    assert main([*words, str(tmp_path / "a.svg")]) == 0
    assert saved[0]._suptitle.get_text() == "Mine"
    sweep = json.loads(json.dumps({
        "over": "engine.frequency", "values": [1.0, 2.0], "max_slip_speed": [1.0, 2.0], "regime": ["stick", "slip"],
        "period": [1, 0], "section": [[[0.1, 0.0]], [[0.1, 0.0]]], "stick_fraction": [0.5, 0.5],
        "transient": [False, True], "runaway": [False, False]}))
    for width in (style.COLUMN, style.PAGE):
        sweeps.draw_sweep(tmp_path / f"{width}.png", sweep, width=width)
        drawn = saved[-1]
        for axis in drawn.axes:
            if axis.get_legend() is not None:
                title, legend = axis._left_title.get_window_extent(), axis.get_legend().get_window_extent()
                assert not title.overlaps(legend)
