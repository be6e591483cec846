"""Planes of basins: their cells and seeds, the bookkeeping of rows, their file, and when slip runs away."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import BasinsInterrupted, InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.study.basins import compute
from tcc_sim.study.basins.compute import axis_of, basins, check_plane, halton, rows_together, seeds_of, starts
from tcc_sim.study.basins.driveline import DrivelineMotion
from tcc_sim.study.basins.proximity import Attractor
from tcc_sim.study.basins.results import Axis

V, ANGLE, SPEED = "initial.slip_speed", "initial.plate_angle", "initial.plate_speed"
ALL = f"{V}, {ANGLE}, {SPEED}"
RUNNING_AWAY = {"pressure.mean": 150e3, "friction.kinetic_coefficient": 0.15, "pressure.amplitude": 0.0}
"""Tsm = 180 N m holds less than Tm = 300 N m."""


@pytest.mark.parametrize(("plane", "words"), [
    ([(V, (1.0,))], "a plane has 2 axes; 1 are given"),
    ([(V, (1.0,))] * 3, "a plane has 2 axes; 3 are given"),
    ([(V, (1.0,)), ("initial.plate_anle", (1.0,))],
     "initial.plate_anle is not a scene key; did you mean initial.plate_angle?"),
    ([("engine.frequency", (1.0,)), (V, (1.0,))],
     f"engine.frequency is no initial condition; a plane is made of two of {ALL}"),
    ([(V, (1.0,)), (V, (2.0,))], f"{V} is given twice; a plane is made of two keys"),
    ([(V, ()), (ANGLE, (0.0,))], "the plane has 0 cells; it must have 1 to 4000000"),
    ([(V, range(2000)), (ANGLE, range(2001))], "the plane has 4002000 cells; it must have 1 to 4000000"),
    ([3.0, (V, (1.0,))], "an axis is 3.0; it must be a key and its values"),
    ([(V,), (V, (1.0,))], f"an axis is ('{V}',); it must be a key and its values")])
def test_a_plane_that_is_none_is_refused(plane: Any, words: str) -> None:
    with pytest.raises(InputError) as error:
        check_plane(plane)
    assert str(error.value) == words


def test_a_plane_is_given_by_axes_or_by_keys_and_values_of_any_type() -> None:
    axes = Axis(V, (0.0, 50.0)), Axis(ANGLE, (0.0, 0.1))
    assert check_plane(axes) == check_plane([(V, np.array([0, 50])), (ANGLE, [0.0, 0.1])]) == axes
    assert axis_of(axes[0]) is axes[0]
    assert len(check_plane([(V, range(2000)), (SPEED, range(2000))])[1].values) == 2000


@pytest.mark.parametrize(("how", "words"), [
    ({"cycles": 15}, "cycles is 15; it must be 16 to 1000000"),
    ({"cycles": 1_000_001}, "cycles is 1000001; it must be 16 to 1000000"),
    ({"over": (V, (1.0,))}, f"over is {V}, an axis of the plane; it must be another key"),
    ({"over": (ANGLE, (1.0,))}, f"over is {ANGLE}, an axis of the plane; it must be another key"),
    ({"over": "engine.frequency"}, "an axis is 'engine.frequency'; it must be a key and its values"),
    ({"over": ("pressure.frequency_ratio", (1.0, 2.0**0.5))}, "pressure.frequency_ratio is 1.41421; ")])
def test_a_calculation_that_is_none_is_refused_without_a_file(how: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        basins("fig02", [(V, (0.0,)), (ANGLE, (0.0,))], part=tmp_path / "b.part", **how)
    assert str(error.value).startswith(words)
    assert list(tmp_path.iterdir()) == []


def test_the_cells_of_a_row_and_the_seeds_of_a_plane() -> None:
    """The scene's own start, middle and corners, then a Halton set; the third state is the scene's."""
    system = replace(System(), {V: 7.0, ANGLE: 0.3, SPEED: 9.0})
    plane = Axis(SPEED, (30.0, 10.0, 20.0)), Axis(V, (1.0, 5.0))
    assert starts(system, plane, 1).tolist() == [[5.0, 0.3, 30.0], [5.0, 0.3, 10.0], [5.0, 0.3, 20.0]]
    seeds = seeds_of(system, plane)
    assert seeds[:6].tolist() == [[7.0, 0.3, 9.0], [3.0, 0.3, 20.0], [1.0, 0.3, 10.0], [1.0, 0.3, 30.0],
                                  [5.0, 0.3, 10.0], [5.0, 0.3, 30.0]]

    def mirrored(k: int, base: int) -> float:
        """The digits of k behind the point."""
        return 0.0 if k == 0 else (k % base + mirrored(k // base, base)) / base

    unit = [[mirrored(k, 2), mirrored(k, 3)] for k in range(1, 49)]
    assert halton(48, 2) == pytest.approx(np.array(unit))
    assert seeds[6:] == pytest.approx(np.array([[1.0 + 4.0 * b, 0.3, 10.0 + 20.0 * a] for a, b in unit]))


@pytest.mark.parametrize(("cells", "rows", "threads", "size"), [
    (100, 300, 2, 1), (12, 300, 2, 10), (12, 30, 2, 5), (3, 3, 1, 1), (200, 1, 2, 1), (12, 300, 0, 10)])
def test_short_rows_share_a_task(cells: int, rows: int, threads: int, size: int) -> None:
    assert rows_together(cells, rows, threads) == size


class Work:
    """Scripted searches and labels in place of solved ones.

    found : radii of the attractors that each search finds
    labels : of all cells, by the number of attractors
    """

    def __init__(self, found: list[list[float]], labels: dict[int, np.ndarray]) -> None:
        self.found, self.labels = iter(found), labels
        self.seeds: list[tuple[list[list[float]], int]] = []
        self.solved: list[tuple[list[int], int]] = []
        self.most: set[int] = set()
        self.bars: list[Any] = []

    def find_attractors(self, motion: Any, seeds: Any, known: Any = ()) -> list[Attractor]:
        self.seeds.append((np.array(seeds).tolist(), len(known)))
        return [Attractor(0, np.array([[10.0 * k, 0.0, 0.0]]), np.array([0]), None, 1.0, radius)
                for k, radius in enumerate(next(self.found))]

    def solve_rows(self, system: Any, plane: Any, rows: list[int], attractors: Any, most: int) -> Any:
        self.solved.append((list(rows), len(attractors)))
        self.most.add(most)
        return [(self.labels[len(attractors)][row].tolist(), [10 * row + len(attractors)] * len(plane[0].values))
                for row in rows]

    @contextmanager
    def progress_bar(self, unit: str, total: float, shown: bool) -> Iterator[Any]:
        self.bars.append([unit, total, shown, 0])

        def update() -> None:
            self.bars[-1][3] += 1

        yield SimpleNamespace(update=update)

    def rows_with(self, attractors: int) -> list[int]:
        return sorted(row for rows, count in self.solved if count == attractors for row in rows)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Any:
    def scripted(found: list[list[float]], labels: dict[int, np.ndarray]) -> Work:
        made = Work(found, labels)
        for name in ("find_attractors", "solve_rows", "progress_bar"):
            monkeypatch.setattr(compute, name, getattr(made, name))
        clock = iter(np.arange(10.0, 1e3, 2.5).tolist())
        monkeypatch.setattr(compute, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
        return made

    return scripted


ROWS = 30
PLANE = [(V, (0.0, 1.0, 2.0)), (ANGLE, np.arange(float(ROWS)))]
SCENE = replace(System(), {V: 7.0, ANGLE: 0.3, SPEED: 9.0})


def test_undecided_cells_begin_further_searches_and_their_rows_are_labelled_anew(work: Any) -> None:
    labels = {count: np.zeros((ROWS, 3), int) for count in (1, 2, 3, 4)}
    labels[1][1:, 1:] = -1  # 58 undecided cells.
    labels[2][:] = 1
    labels[2][4, 2] = labels[2][9, 0] = -1
    labels[3][:], labels[4][:] = 2, 3
    labels[3][7, 1] = labels[4][7, 1] = -1
    done = work([[0.2], [0.2, 0.2], [0.1, 0.2, 0.2], [0.1, 0.2, 0.2, 0.2]], labels)
    (result,) = basins(SCENE, PLANE, jobs=1, cycles=1_000_000)
    assert len(done.seeds[0][0]) == 54
    undecided = [[float(i), float(j), 9.0] for j in range(1, ROWS) for i in (1, 2)]
    chosen = [undecided[int(k)] for k in np.linspace(0.0, 57.0, 24)]
    assert done.seeds[1:] == [(chosen, 1), ([[2.0, 4.0, 9.0], [0.0, 9.0, 9.0]], 2), ([[1.0, 7.0, 9.0]], 3)]
    assert done.rows_with(1) == list(range(ROWS))
    assert done.rows_with(2) == list(range(1, ROWS))
    assert done.rows_with(3) == list(range(ROWS))  # A radius shrank, so every cell may have another label.
    assert done.rows_with(4) == [7]
    assert {len(rows) for rows, count in done.solved if count == 1} == {10}
    expected = labels[3].copy()
    expected[7] = labels[4][7]
    assert result.labels.tolist() == expected.tolist()
    assert result.cycles[:, 0].tolist() == [10 * row + (4 if row == 7 else 3) for row in range(ROWS)]
    assert [a.radius for a in result.attractors] == [0.1, 0.2, 0.2, 0.2]
    assert [a.number for a in result.attractors] == [0, 1, 2, 3]
    assert (done.most, done.bars, result.seconds) == ({1_000_000}, [["row", ROWS, False, ROWS]], 2.5)


@pytest.mark.parametrize("undecided", [False, True])
def test_the_search_ends_with_the_last_undecided_cell_or_where_it_finds_no_more(undecided: bool, work: Any) -> None:
    done = work([[0.2], [0.2]], {1: np.where(np.arange(ROWS)[:, None] < 2 * undecided, -1, 0) + np.zeros((1, 3), int)})
    (result,) = basins(SCENE, PLANE, jobs=1, cycles=16)
    assert len(done.seeds) == 1 + undecided
    assert done.rows_with(1) == list(range(ROWS))
    assert result.undecided == 2 * undecided / ROWS


def test_finished_rows_in_a_file_are_not_solved_again(work: Any, tmp_path: Path) -> None:
    part, over = tmp_path / "b.part", ("engine.frequency", (80.0, 90.0))
    plane = [PLANE[0], (ANGLE, (0.0, 1.0, 2.0, 3.0))]
    labels = {1: np.array([[0, 0, -1], [0, 0, 0], [0, -2, 0], [-2, 0, 0]]), 2: np.ones((4, 3), int)}

    def computed(**how: Any) -> tuple[Work, Any]:
        done = work([[0.2], [0.2], [0.2], [0.2]], labels)
        return done, basins(SCENE, plane, jobs=1, over=over, part=part, head={"command": "c"}, progress=True, **how)

    first, result = computed()
    assert [one.over for one in result] == [("engine.frequency", 80.0), ("engine.frequency", 90.0)]
    assert [dict(values_of(one.system))["engine.frequency"] for one in result] == [80.0, 90.0]
    assert sorted(row for rows, _ in first.solved for row in rows) == [0, 0, 1, 1, 2, 2, 3, 3]
    header, *lines = [json.loads(line) for line in part.read_text().splitlines()]
    assert {**header, "crc32": "", "version": ""} == {
        "format": "tcc_sim basin_rows 1", "version": "", "cycles": 600, "scene": json.loads(json.dumps(
            dict(values_of(SCENE)))), "command": "c", "crc32": "",
        "plane": [{"key": V, "values": [0.0, 1.0, 2.0]}, {"key": ANGLE, "values": [0.0, 1.0, 2.0, 3.0]}],
        "over": {"key": "engine.frequency", "values": [80.0, 90.0]}}
    assert sorted((line["curve"], line["index"]) for line in lines) == [(i, row) for i in (0, 1) for row in range(4)]
    for line in lines:
        assert line["record"] == {"attractors": 1, "labels": labels[1][line["index"]].tolist(),
                                  "cycles": [10 * line["index"] + 1] * 3}
    again, repeated = computed()
    assert (again.solved, again.bars) == ([], [["row", 8, True, 8]])
    for one, other in zip(result, repeated):
        assert (one.labels.tolist(), one.cycles.tolist()) == (other.labels.tolist(), other.cycles.tolist())
    # Rows of another number of attractors are solved again, and what they were is no row.
    two = work([[0.2, 0.2], [0.2, 0.2]], labels)
    basins(SCENE, plane, jobs=1, over=over, part=part)
    assert (two.rows_with(2), two.bars) == ([0, 0, 1, 1, 2, 2, 3, 3], [["row", 8, False, 8]])


@pytest.mark.parametrize("name", ["labels", "cycles"])
def test_a_row_of_another_length_is_solved_again(name: str, work: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    record: dict[str, Any] = {"attractors": 1, "labels": [0, 0, 0], "cycles": [1, 1, 1]}

    class Stored:
        def __init__(self, path: Any, header: Any, take: Any, **how: Any) -> None:
            take(0, 3, record)
            take(0, 4, {**record, name: [0, 0]})
            take(1, 5, record)  # Of another value of the key.

        def append(self, *of: Any) -> None:
            pass

        close = append

    monkeypatch.setattr(compute, "SweepFile", Stored)
    done = work([[0.2]], {1: np.zeros((ROWS, 3), int)})
    basins(SCENE, PLANE, jobs=1)
    assert done.rows_with(1) == [row for row in range(ROWS) if row != 3]


def test_ctrl_c_while_attractors_are_sought_is_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(compute, "find_attractors", interrupted)
    with pytest.raises(BasinsInterrupted):
        basins(SCENE, PLANE, jobs=1)


SWING = 4.0 * 150000.0**0.5 / 3000.0  # Four times omega_n over K23, a plate speed per torque.
FULL = 2.0 * np.pi / 150.0 / 0.2  # A period of excitation over I1, a slip speed per torque.
EDGES = {
    "constant load": ({}, 20.0 + FULL * 550.0 + SWING * (550.0 + 2.0 * 180.0)),
    "pulsation and harmonics": (
        {"pressure.amplitude": 50e3, "engine.harmonic_amplitudes": (30.0, 20.0), "engine.harmonic_phases": (0.0, 0.0)},
        20.0 + FULL * 600.0 + SWING * (600.0 + 2.0 * (180.0 + 60.0))),
    "friction constant": ({"friction.static_coefficient": 0.15}, FULL * 550.0 + SWING * (550.0 + 180.0)),
    "no decay": ({"friction.decay": 0.0, "friction.static_coefficient": 0.2},
                 FULL * 550.0 + SWING * (550.0 + 240.0)),
    "slow decay": ({"friction.decay": 0.25}, 160.0 + FULL * 550.0 + SWING * (550.0 + 360.0))}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("case", EDGES)
def test_slip_runs_away_beyond_a_speed_at_which_friction_is_constant(case: str, side: float) -> None:
    """40 decay lengths, the swing of slip in a cycle, and four times the plate speed that all torques make."""
    changes, edge = EDGES[case]
    motion = DrivelineMotion(replace(System(), {**RUNNING_AWAY, "engine.mean_torque": side * 300.0, **changes}))
    near = side * edge * np.array([1.0 - 1e-9, 1.0 + 1e-9, -1.0 - 1e-9])
    assert motion.runs_away(np.array([[v, 0.0, 0.0] for v in near])).tolist() == [False, True, False]


@pytest.mark.parametrize(("changes", "away"), [
    ({}, True), ({"engine.mean_torque": 180.0}, False), ({"engine.mean_torque": 180.1}, True),
    ({"friction.decay": 0.0, "friction.static_coefficient": 0.25}, False),  # mu_s Pm A R = 300 N m at any slip speed.
    ({"friction.decay": 0.0, "friction.static_coefficient": 0.2499}, True),
    ({"converter.coupling": 0.05}, False)])
def test_slip_runs_away_where_the_mean_torque_exceeds_what_the_clutch_carries(changes: Any, away: bool) -> None:
    motion = DrivelineMotion(replace(System(), {**RUNNING_AWAY, **changes}))
    assert motion.runs_away(np.array([[1e6, 0.0, 0.0]])).tolist() == [away]


def test_the_largest_slip_of_a_motion_has_either_sign() -> None:
    """From rest slip grows one way; the mirrored engine, half a period later, makes it grow the other way."""
    half = {"engine.harmonic_amplitudes": (), "engine.mean_torque": 0.0, "pressure.mean": 5e4}
    system = replace(System(), {**RUNNING_AWAY, **half})
    speeds = [DrivelineMotion(system).largest(np.array([v, 0.0, 0.0]), first, 1) for v, first in
              ((500.0, 0), (-500.0, 3))]
    assert speeds[0] > speeds[1] == pytest.approx(500.0, abs=1e-6)
