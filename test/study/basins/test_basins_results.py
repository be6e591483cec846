"""Results of basins made by hand: every figure, line, column and file, and the exponent of the boundary."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import linregress

from tcc_sim.model.parameters import System
from tcc_sim.output.samples import write_result
from tcc_sim.study.basins.attractors import Attractor
from tcc_sim.study.basins.results import Axis, Basins, Boundary, Planes, boundary_of

PLANE = Axis("initial.slip_speed", np.array([0, 10, 20])), Axis("initial.plate_angle", [-0.1, 0.1])
ORBIT = Attractor(2, np.array([[1.0, 0.1, 5.0], [2.0, 0.2, 6.0]]), np.array([0, 0]),
                  np.array([0.5 + 0.2j, 0.5 - 0.2j, 0]), 25.0, 0.125, True, 4)
CLOUD = Attractor(0, np.array([[3.0, 0.3, 7.0]]), np.array([0]), None, 45.5, 0.01, False, 1)
LABELS = np.array([[0, 0, 1], [-1, -2, 0]], np.int16)
CYCLES = np.array([[4, 8, 12], [600, 3, 1]], np.int32)


def basins(over: tuple[str, float] | None = None, more: int = 0) -> Basins:
    return Basins(PLANE, (ORBIT, CLOUD, *[CLOUD] * more), LABELS, CYCLES, 1.5, System(), over)


def test_every_figure_of_a_plane() -> None:
    one = basins()
    shared = {"multipliers": [[0.5, 0.2], [0.5, -0.2], [0.0, 0.0]]}
    assert one.as_json() == {
        "plane": [{"key": "initial.slip_speed", "values": [0.0, 10.0, 20.0]},
                  {"key": "initial.plate_angle", "values": [-0.1, 0.1]}],
        "seconds": 1.5, "undecided": 1 / 6, "runaway": 1 / 6,
        "attractors": [
            {"number": 4, "period": 2, "max_slip_speed": 25.0, "section": [[0.1, 1.0], [0.2, 2.0]],
             "section_states": [[0.1, 1.0, 5.0], [0.2, 2.0, 6.0]], **shared, "fraction": 0.5, "radius": 0.125,
             "validated": True, "state": [1.0, 0.1, 5.0]},
            {"number": 1, "period": 0, "max_slip_speed": 45.5, "section": [[0.3, 3.0]],
             "section_states": [[0.3, 3.0, 7.0]], "multipliers": None, "fraction": 1 / 6, "radius": 0.01,
             "validated": False, "state": None}]}
    assert {name: column.tolist() for name, column in one.columns().items()} == {
        "initial.slip_speed": [0.0, 10.0, 20.0] * 2, "initial.plate_angle": [-0.1] * 3 + [0.1] * 3,
        "label": [0, 0, 1, -1, -2, 0], "cycles": [4, 8, 12, 600, 3, 1]}


def test_the_lines_of_a_plane_have_its_figures() -> None:
    text = "\n".join(basins().lines())
    for figure in ("period 2", "50.00 %", "16.67 %", "25 rad/s", "45.5 rad/s", "3", "2", "validated"):
        assert figure in text
    assert "attractor 4" in basins(("engine.frequency", 80.0)).lines()[1]
    assert len(basins().lines(1)) == len(basins().lines())
    assert len(repr(basins(None, 40)).splitlines()) < 20
    assert "&lt;" in basins()._repr_html_()


def test_planes_along_a_key_are_lists_of_their_figures() -> None:
    planes = [basins(("engine.frequency", 80.0)), basins(("engine.frequency", 90.0))]
    one = planes[0].as_json()
    assert Planes(planes).as_json() == {
        "over": "engine.frequency", "values": [80.0, 90.0], "plane": one.pop("plane"),
        **{name: [value, value] for name, value in one.items()}}
    assert Planes([basins()]).as_json() == basins().as_json()
    # A plane of two rows has too few distances for an exponent; one of eight equal rows has those of its columns.
    assert Planes([basins()], bounded=True).as_json() == basins().as_json()
    wide = Basins((Axis("initial.slip_speed", range(8)), Axis("initial.plate_angle", range(8))), (ORBIT,),
                  np.tile([0, 0, 0, 0, 0, -2, -2, -2], (8, 1)), np.ones((8, 8), int), 0.0, System())
    bound = boundary_of(wide.labels)
    assert bound is not None
    assert wide.boundary() == bound
    shown = Planes([wide], bounded=True).as_json()
    assert shown["boundary"] == {"uncertainty_exponent": bound.exponent, "standard_error": bound.error,
                                 "dimension": 2.0 - bound.exponent}
    several = Planes([replace(wide, over=one.over) for one in planes], True)
    assert several.as_json()["boundary"] == [shown["boundary"]] * 2


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_the_files_of_planes(suffix: str, tmp_path: Path) -> None:
    single, several = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    write_result(single, Planes([basins()]), {"format": "a"})
    write_result(several, Planes([basins(("engine.frequency", value)) for value in (80.0, 90.0)]), {"format": "b"})
    if suffix == ".csv":
        head, units, *rows = single.read_text().splitlines()
        assert (head, units) == ("initial.slip_speed,initial.plate_angle,label,cycles", "rad/s,rad,,")
        assert rows == ["0.0,-0.1,0,4", "10.0,-0.1,0,8", "20.0,-0.1,1,12", "0.0,0.1,-1,600", "10.0,0.1,-2,3",
                        "20.0,0.1,0,1"]
        assert several.read_text().splitlines() == [f"engine.frequency,{head}", f"rad/s,{units}", *(
            f"{value},{row}" for value in (80.0, 90.0) for row in rows)]
        return
    for path, along, stack in ((single, False, lambda x: x), (several, True, lambda x: np.array([x, x]))):
        with np.load(path) as stored:
            arrays = {name: stored[name].tolist() for name in stored if name != "document"}
            assert json.loads(str(stored["document"])) == {"format": "b" if along else "a"}
        assert arrays == {"labels": stack(LABELS).tolist(), "cycles": stack(CYCLES).tolist(),
                          "first_values": [0.0, 10.0, 20.0], "second_values": [-0.1, 0.1],
                          **({"over_values": [80.0, 90.0]} if along else {})}


def exponent_by_pairs(labels: np.ndarray) -> tuple[float, float] | None:
    """Exponent and standard error from every pair of decided cells at a distance along an axis."""
    sizes, shares = [], []
    for k in (k for k in (1, 2, 4, 8, 16) if k < min(labels.shape)):
        pairs = [(labels[j, i], labels[j + dj, i + di]) for dj, di in ((0, k), (k, 0))
                 for j, i in itertools.product(range(labels.shape[0] - dj), range(labels.shape[1] - di))]
        decided = [(a, b) for a, b in pairs if -1 not in (a, b)]
        unlike = sum(a != b for a, b in decided)
        if unlike:
            sizes.append(math.log(k))
            shares.append(math.log(unlike / len(decided)))
    if len(sizes) < 3:
        return None
    line = linregress(sizes, shares)
    return line.slope, line.stderr


@pytest.mark.parametrize(("shape", "found"), [((20, 30), True), ((30, 16), True), ((5, 9), True), ((4, 40), False),
                                              ((40, 3), False)])
def test_the_exponent_is_the_slope_of_the_share_of_unlike_pairs(shape: tuple[int, int], found: bool) -> None:
    """-2 is a final state, -1 is none; distances reach up to the shorter side, and three are needed."""
    labels = np.random.default_rng(sum(shape)).integers(-2, 3, shape).cumsum(axis=0) % 4 - 2
    result, expected = boundary_of(labels), exponent_by_pairs(labels)
    assert (result is not None, expected is not None) == (found, found)
    if result is not None and expected is not None:
        assert (result.exponent, result.error) == pytest.approx(expected, rel=1e-9)


def test_a_boundary_without_three_distances_has_no_exponent() -> None:
    checked = np.indices((9, 9)).sum(axis=0) % 2  # Cells at even distances are alike.
    assert boundary_of(checked) is None
    assert boundary_of(np.full((9, 9), -1)) is None
    assert Boundary(0.25, 0.1).dimension == 1.75
