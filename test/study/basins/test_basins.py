"""Attractors and basins: on maps with known basins, and on the driveline against brute force."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from textbook_maps import TextbookMap

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.study.basins.attractors import (
    DEFAULTS,
    RUNAWAY,
    UNDECIDED,
    ProximityMapper,
    Settings,
    find_attractors,
    labelled,
    numbered,
    section_points,
)
from tcc_sim.study.basins.compute import CELL_CYCLES, CELL_RTOL, DrivelineMotion, basins, halton, mean_load
from tcc_sim.study.basins.results import Axis, Basins
from tcc_sim.trajectory import State

COEXISTENCE = replace(System(), {"pressure.mean": 225e3, "pressure.amplitude": 0.0,
                                 "friction.kinetic_coefficient": 0.255,
                                 "engine.frequency": 0.36 * System().natural_frequency})
"""Period one and a large period two at omega/omega_n = 0.36, mu_k/mu_s = 0.85."""
NOTHING = np.zeros((2, 0))
RUNNING_AWAY = replace(System(), {"pressure.mean": 150e3, "friction.kinetic_coefficient": 0.15,
                                  "pressure.amplitude": 0.0})
"""Tsm = 180 N m holds less than Tm = 300 N m: fast slip never ends."""


GRID = Axis("initial.slip_speed", (0.0, 60.0, 120.0)), Axis("initial.plate_angle", (0.0, 0.1, 0.2))


@pytest.fixture(scope="module")
def whole() -> Basins:
    (result,) = basins(COEXISTENCE, GRID)
    return result


class Iterated:
    """A textbook map as a motion."""

    def __init__(self, step, dimension, bound=1e6, value=None):
        self.map, self.bound = TextbookMap(step, dimension), bound
        self.value = value or (lambda x: step(np.array(x), ())[0].tolist())

    def sections(self, starts, first, cycles, orbits=None):
        out = np.full((len(starts), cycles + 1, np.shape(starts)[1]), np.nan)
        for row, x in zip(out, starts):
            row[0], point = x, list(map(float, x))
            for k in range(1, cycles + 1):
                if max(map(abs, point)) > self.bound:
                    break
                row[k] = point = self.value(point)
        return out

    def runs_away(self, points):
        return np.abs(points).max(axis=1) > 1e3

    def largest(self, x, first, cycles):
        return float(np.abs(section_points(self, x, first, cycles)).max())


def newton_for_cube_roots(x, p):
    """Newton's method for z^3 = 1 as a map of the plane: three fixed points, fractal basins."""
    slope = (2.0 / 3.0) * (1.0 - complex(*x) ** -3)
    return (np.array(newtons_value(x)), np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]),
            np.zeros((2, 0)))


def newtons_value(x):
    """The value of `newton_for_cube_roots`."""
    z = complex(*x)
    value = (2.0 * z + z**-2) / 3.0
    return value.real, value.imag


def cubic(x, p):
    """x' = 1.5 x - 0.5 x^3: attractors -1 and 1 with the basins x < 0 and x > 0 within |x| < sqrt 5."""
    return 1.5 * x - 0.5 * x**3, np.array([[1.5 - 1.5 * x[0] ** 2]]), np.zeros((1, 0))


def henon_value(x):
    """The value of Henon's map at a = 1.4, b = 0.3: one strange attractor."""
    return 1.0 - 1.4 * x[0] * x[0] + x[1], 0.3 * x[0]


def henon_chaos(x, p):
    return np.array(henon_value(x)), np.array([[-2.8 * x[0], 1.0], [0.3, 0.0]]), NOTHING


def test_newtons_method_for_cube_roots_has_three_attractors_and_the_labels_of_iteration():
    of = Iterated(newton_for_cube_roots, 2, value=newtons_value)
    result = find_attractors(of, 4.0 * halton(12, 2) - 2.0)
    roots = np.array([1.0, np.exp(2j * np.pi / 3), np.exp(-2j * np.pi / 3)])
    ours = np.array([complex(*a.section[0]) for a in result])
    assert sorted(np.abs(roots[:, None] - ours[None]).argmin(axis=0)) == [0, 1, 2]
    assert all(a.period == 1 and abs(a.multipliers[0]) < 1e-8 for a in result)
    mapper = ProximityMapper(result, of.map.scales, 1)
    cells = 4.0 * halton(60, 2) - 2.0
    for cell, k in zip(cells, labelled(of, mapper, cells, CELL_CYCLES)[0]):
        assert abs(complex(*section_points(of, cell, 0, 100)[-1]) - ours[k]) < 1e-9


def test_two_fixed_points_and_what_runs_away():
    of = Iterated(cubic, 1)
    result = find_attractors(of, [np.array([x]) for x in (0.3, -0.3, 4.0)])
    assert sorted(float(a.section[0, 0]) for a in result) == pytest.approx([-1.0, 1.0])
    mapper = ProximityMapper(result, of.map.scales, 1)
    cells = np.array([-2.0, -0.7, -1e-3, 1e-3, 0.6, 2.1, 2.4, 0.0])[:, None]
    *labels, fast, middle = labelled(of, mapper, cells, CELL_CYCLES)[0]
    for x, k in zip(cells[:, 0], labels):
        assert result[k].section[0, 0] == pytest.approx(section_points(of, [x], 0, 300)[-1, 0])
    assert (fast, middle) == (RUNAWAY, UNDECIDED)


def test_a_strange_attractor_is_one_cloud():
    of = Iterated(henon_chaos, 2, bound=1e9, value=henon_value)
    result = find_attractors(of, [np.array(x) for x in ((0.1, 0.1), (-0.3, 0.2))])
    assert [(a.period, a.multipliers) for a in result] == [(0, None)]
    wide = Iterated(henon_chaos, 2, bound=1e9, value=henon_value)
    wide.map.scales = 7.0 * of.map.scales  # Points of the cloud lie as near to each other in any unit.
    assert len(result[0].section) == len(find_attractors(wide, [np.array([0.1, 0.1])])[0].section) < 2 * DEFAULTS.cloud
    mapper = ProximityMapper(result, of.map.scales, 1)
    assert labelled(of, mapper, np.array([[0.2, 0.1], [3.0, 0.0]]), CELL_CYCLES)[0].tolist() == [0, RUNAWAY]


C, S = (f(2.0 * np.pi * (1.0 / 7.0 + 4e-5)) for f in (math.cos, math.sin))
TURN = np.array([[C, -S], [S, C]])


def beside_a_resonance(x, p):
    """Turn by a little more than a seventh towards the unit circle: 512 turns lie on seven short arcs of it."""
    a, b = x.tolist()
    square = a * a + b * b
    slope = TURN @ (np.eye(2) - 0.5 / square * np.array([[a * a, a * b], [a * b, b * b]])) / square**0.25
    return np.array(turned((a, b))), slope, NOTHING


def turned(x):
    """The value of `beside_a_resonance`."""
    a, b = x
    root = (a * a + b * b) ** 0.25
    return (C * a - S * b) / root, (S * a + C * b) / root


def test_a_quasi_periodic_attractor_is_listed_once_from_wherever_it_is_begun():
    of = Iterated(beside_a_resonance, 2, value=turned)
    result = find_attractors(of, [1.1 * np.array([np.cos(a), np.sin(a)]) for a in (0.0, 0.15)],
                             settings=Settings(cloud=512, longest=1024))
    assert [a.period for a in result] == [0]
    angles = np.sort(np.arctan2(*result[0].section.T))
    assert np.diff(angles).max() < 0.05


def leaking(x, p):
    """The logistic map at r a little above 4: chaos on 0 to 1 with a hole that is met about every 5000 steps, behind
    which the fixed point 3 attracts.
    """
    if 0.0 <= x[0] <= 1.0:
        return 4.0000004 * x * (1.0 - x), np.array([[4.0000004 * (1.0 - 2.0 * x[0])]]), np.zeros((1, 0))
    return 3.0 + 0.5 * (x - 3.0), np.array([[0.5]]), np.zeros((1, 0))


def test_a_chaotic_transient_is_no_attractor():
    of = Iterated(leaking, 1, value=lambda x: [
        4.0000004 * x[0] * (1.0 - x[0]) if 0.0 <= x[0] <= 1.0 else 3.0 + 0.5 * (x[0] - 3.0)])
    seeds = [np.array([x]) for x in (0.11, 0.23, 0.37, 0.41)]
    (result,) = find_attractors(of, seeds)
    assert (result.period, result.section[0, 0]) == (1, pytest.approx(3.0))
    # One of the seeds stays for longer than it takes a motion without a period to count as such.
    assert 0 in {a.period for a in find_attractors(of, seeds, settings=Settings(witnesses=0))}


def test_cells_of_the_driveline_are_labelled_as_brute_force_does():
    plane = (Axis("initial.slip_speed", tuple(np.linspace(0.0, 120.0, 9))),
             Axis("initial.plate_angle", tuple(np.linspace(-0.1, 0.3, 5))))
    result, = basins(COEXISTENCE, plane, jobs=2)
    assert sorted(a.period for a in result.attractors) == [1, 2]
    for attractor in result.attractors:
        assert abs(attractor.multipliers[0]) < 1.0
    assert sum(result.fraction(k) for k in range(2)) == 1.0
    assert min(result.fraction(k) for k in range(2)) > 0.05
    random = np.random.default_rng(5)
    for j, i in zip(random.integers(5, size=6), random.integers(9, size=6)):
        start = State(plane[0].values[i], plane[1].values[j], 0.0)
        end = solve(COEXISTENCE, cycles=600, state=start).cycles.section[-2:]
        distances = [min(np.abs(end - np.roll(np.resize(a.section, (2, 3)), r, axis=0)).max() for r in (0, 1))
                     for a in result.attractors]
        assert int(np.argmin(distances)) == result.labels[j, i]
        assert min(distances) < 1e-3


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_basins_end_where_they_do_for_motions_solved_finely(law):
    """To 1e-4 of a cell: a tolerance a hundred times as large moves an edge by ten times that."""
    system = replace(COEXISTENCE, {"friction.law": law})
    coarse, fine = DrivelineMotion(system, CELL_RTOL), DrivelineMotion(system, 1e-10)
    mapper = ProximityMapper(find_attractors(fine, [[0.0, 0.0, 0.0], [60.0, 0.1, 0.0]]), fine.map.scales, 1)
    v, angle = np.meshgrid(np.linspace(0.0, 120.0, 7), np.linspace(-0.1, 0.3, 3))
    cells = np.stack([v, angle, np.zeros_like(v)], axis=-1)
    labels = labelled(fine, mapper, cells.reshape(-1, 3), 100)[0].reshape(v.shape)
    rows, columns = np.nonzero(labels[:, 1:] != labels[:, :-1])
    low, high = cells[rows, columns], cells[rows, columns + 1]
    assert len(rows) > 2
    width, before = high - low, labels[rows, columns]
    for _ in range(14):
        middle = 0.5 * (low + high)
        same = (labelled(fine, mapper, middle, 100)[0] == before)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    for start in (low - 1e-4 * width, high + 1e-4 * width):
        assert labelled(coarse, mapper, start, 100)[0].tolist() == labelled(fine, mapper, start, 100)[0].tolist()


def test_slip_that_runs_away_has_a_label_of_its_own():
    plane = (Axis("initial.slip_speed", (-200.0, 0.0, 30.0, 300.0, 3000.0)), Axis("initial.plate_speed", (0.0,)))
    result, = basins(RUNNING_AWAY, plane)
    assert result.labels[0, -1] == RUNAWAY
    late = solve(RUNNING_AWAY, cycles=50, state=State(3000.0, 0.0, 0.0)).cycles.section[:, 0]
    assert np.diff(late)[-1] == pytest.approx((300.0 - 180.0) / 0.2 * RUNNING_AWAY.cycle, rel=1e-3)
    assert not DrivelineMotion(COEXISTENCE).runs_away(np.array([[3000.0, 0.0, 0.0]]))[0]


@pytest.mark.parametrize(("mean", "amplitude"), [(2e5, 0.0), (2e5, 1e5), (2e5, 3e5), (0.0, 2e5)])
def test_the_mean_of_a_clamped_load(mean, amplitude):
    system = replace(System(), {"pressure.mean": mean, "pressure.amplitude": amplitude})
    whole, _ = quad(lambda phase: max(mean + amplitude * math.sin(phase), 0.0), 0.0, 2.0 * math.pi, limit=200)
    assert mean_load(system) == pytest.approx(0.24 * 0.08 * 0.1 * whole / (2.0 * math.pi), rel=1e-9)


def test_fractions_along_a_key_are_those_of_each_value_alone(whole: Basins):
    """At mu_k near mu_s one motion takes all; at 0.85 mu_s two share the plane."""
    two, one = basins(COEXISTENCE, GRID, over=("friction.kinetic_coefficient", (0.255, 0.299)))
    assert [len(each.attractors) for each in (two, one)] == [2, 1]
    assert one.fraction(0) == 1.0
    np.testing.assert_array_equal(two.labels, whole.labels)
    assert [a.number for a in two.attractors] == [0, 1]
    goes_on = next(a for a in two.attractors if a.period == one.attractors[0].period)
    assert one.attractors[0].number == goes_on.number


def test_an_attractor_keeps_its_number_along_a_key():
    """x' = p + 1.5 x - x^3/2: attractors at +-1 for p = 0; beyond p = 1/27^0.5 = 0.19 there is only the one above 0."""
    def at(p: float) -> Iterated:
        return Iterated(lambda x, _: (p + 1.5 * x - 0.5 * x**3, np.array([[1.5 - 1.5 * x[0] ** 2]]),
                                      np.zeros((1, 0))), 1)

    seeds = [np.array([x]) for x in (0.6, -0.6)]
    known = []
    for p, order in ((0.0, 1), (0.05, -1), (0.3, 1), (0.05, -1)):
        known.append(numbered(at(p), known, find_attractors(at(p), seeds[::order])))
    numbers = [{a.number: float(np.sign(a.section[0, 0])) for a in each} for each in known]
    assert numbers == [{0: 1.0, 1: -1.0}, {0: 1.0, 1: -1.0}, {0: 1.0}, {0: 1.0, 2: -1.0}]


def test_an_attractor_keeps_its_number_where_its_period_doubles():
    def logistic_at(r: float) -> Iterated:
        return Iterated(lambda x, _: (r * x * (1.0 - x), np.array([[r * (1.0 - 2.0 * x[0])]]), np.zeros((1, 0))), 1)

    one, two = (find_attractors(logistic_at(r), [np.array([0.3])]) for r in (2.9, 3.1))
    assert [a.period for a in (*one, *two)] == [1, 2]
    before = [dataclasses.replace(a, number=7) for a in one]
    assert [a.number for a in numbered(logistic_at(3.1), [before], two)] == [7]


def test_basins_go_on_from_the_rows_in_their_file(whole: Basins, tmp_path: Path):
    """Kept rows are not solved again, a damaged last line is, and other work is refused."""
    part = tmp_path / "b.part"
    first, = basins(COEXISTENCE, GRID, part=part)
    head, *rows = part.read_bytes().splitlines(keepends=True)
    assert len(rows) == 3
    part.write_bytes(head + rows[0] + rows[1][:-9])
    again, = basins(COEXISTENCE, GRID, part=part)
    for result in (first, again):
        np.testing.assert_array_equal(result.labels, whole.labels)
        np.testing.assert_array_equal(result.cycles, whole.cycles)
    assert part.read_bytes().startswith(head + rows[0])
    assert sorted(json.loads(line)["index"] for line in part.read_bytes().splitlines()[1:]) == [0, 1, 2]
    with pytest.raises(InputError):
        basins(COEXISTENCE, GRID, cycles=700, part=part)


def test_rows_solved_together_are_those_solved_alone(whole: Basins):
    alone, = basins(COEXISTENCE, (GRID[0], Axis("initial.plate_angle", GRID[1].values[1:2])))
    ours, theirs = ([result.attractors[k].period for k in labels]
                    for result, labels in ((alone, alone.labels[0]), (whole, whole.labels[1])))
    assert ours == theirs
