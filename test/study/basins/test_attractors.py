"""The search for attractors on maps of a line: orbits of forced maps, numbers, and equal attractors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_basins import Iterated
from textbook_maps import TextbookMap

from tcc_sim.study.basins.attractors import Attractor, Settings, find_attractors, numbered
from tcc_sim.study.continuation.orbits import Image


def cloud(points: Any, number: int = 0, phases: Any = None) -> Attractor:
    section = np.array(points, dtype=np.float64).reshape(-1, 1)
    return Attractor(0, section, np.zeros(len(section), int) if phases is None else np.array(phases), None, 1.0,
                     number=number)


class Forced(TextbookMap):
    """x' = x/2 + 1 in even cycles and x^2/10 + 1 in odd ones: from `AT` to AT/2 + 1 = 10 - sqrt 70 and back."""

    forcing_period = 2

    def evaluate(self, x, values, first, cycles):
        slope = 1.0
        for k in range(cycles):
            odd = (first + k) % 2
            x, slope = (0.1 * x**2 if odd else 0.5 * x) + 1.0, (0.2 * float(x[0]) if odd else 0.5) * slope
        return Image(x, np.array([[slope]]))


AT = 2.0 * (9.0 - 70.0**0.5)


class Motion:
    """A map as a motion."""

    def __init__(self, of: Any, size: float = 1.0) -> None:
        self.map = of
        of.scales = np.array([size])

    def sections(self, starts, first, cycles, orbits=None):
        out = np.empty((len(starts), cycles + 1, 1))
        for row, x in zip(out, starts):
            row[0] = x
            for k in range(cycles):
                row[k + 1] = self.map.evaluate(row[k], (), first + k, 1).value
        return out

    def runs_away(self, points):
        return np.abs(points[:, 0]) > 1e3

    def largest(self, x, first, cycles):
        return float(x[0]) + 100.0 * cycles + 1e4 * first


@pytest.mark.parametrize("settling", [40, 41])
@pytest.mark.parametrize("size", [1.0, 30.0])
def test_the_orbit_of_a_forced_map_begins_at_phase_0(settling: int, size: float) -> None:
    of: Any = Motion(Forced(lambda x, p: (x, x, x), 1), size)
    (orbit,) = find_attractors(of, [np.array([0.0]), np.array([3.0]), np.array([AT])],
                               settings=Settings(settling=settling))
    assert orbit.section.tolist() == pytest.approx(np.array([[AT], [10.0 - 70.0**0.5]]))
    assert (orbit.period, orbit.phases.tolist(), orbit.validated, orbit.radius) == (2, [0, 1], True, 0.2)
    assert orbit.multipliers == pytest.approx([0.1 * (10.0 - 70.0**0.5)])
    assert orbit.largest == pytest.approx(AT + 200.0)


class Seldom(Forced):
    """The logistic map of period four in every fourth cycle, and rest in between: a motion of period 16."""

    forcing_period = 4

    def evaluate(self, x, values, first, cycles):
        slope = 1.0
        for k in range(cycles):
            if (first + k) % 4 == 3:
                x, slope = 3.5 * x * (1.0 - x), 3.5 * (1.0 - 2.0 * float(x[0])) * slope
        return Image(x, np.array([[slope]]))


def test_an_orbit_of_the_longest_period_is_found_from_any_phase() -> None:
    of: Any = Motion(Seldom(lambda x, p: (x, x, x), 1), 0.1)
    (orbit,) = find_attractors(of, [np.array([0.3])], settings=Settings(settling=83, longest=82, cloud=64))
    assert (orbit.period, orbit.phases.tolist()) == (16, [0, 1, 2, 3] * 4)
    of_four = [0.874997263602464, 0.382819683017324, 0.826940706591439, 0.500884210307218]
    assert sorted(set(orbit.section[:, 0].round(12))) == pytest.approx(sorted(of_four), abs=1e-11)


def test_chaos_is_one_cloud_that_fills_its_interval() -> None:
    """The logistic map at r = 4 has the density 1/(pi sqrt(x (1 - x))) on 0 to 1."""
    of: Any = Iterated(lambda x, p: (4.0 * x * (1.0 - x), np.array([[4.0 - 8.0 * x[0]]]), np.zeros((1, 0))), 1)
    (result,) = find_attractors(of, [np.array([0.3]), np.array([0.77])],
                                settings=Settings(settling=40, longest=300, cloud=64))
    x = np.sort(result.section[:, 0])
    assert (result.period, result.multipliers) == (0, None)
    assert 0.9 < result.largest <= 1.0
    nearest = np.minimum(np.diff(x, append=np.inf), np.diff(x, prepend=-np.inf))
    assert result.radius <= np.quantile(nearest, 0.95) * (1.0 + 1e-9)  # A motion is captured within the cloud alone.
    assert np.abs(np.arange(len(x)) / len(x) - 2.0 / np.pi * np.arcsin(np.sqrt(x))).max() < 1.6 / len(x)**0.5


class Climbing(TextbookMap):
    """The logistic map at r = 4 on 0 to 1 in every third cycle, with steps to 10 and to 20 between."""

    forcing_period = 3

    def evaluate(self, x, values, first, cycles):
        slope = 1.0
        for k in range(cycles):
            at, phase = float(x[0]), (first + k) % 3
            slope *= 4.0 - 8.0 * at if phase == 0 else 1.0
            x = np.array([(4.0 * at * (1.0 - at) + 10.0, at + 10.0, at - 20.0)[phase]])
        return Image(x, np.array([[slope]]))


def test_chaos_of_a_forced_map_is_followed_in_its_own_phase() -> None:
    of: Any = Motion(Climbing(lambda x, p: (x, x, x), 1))
    (found,) = find_attractors(of, [np.array([0.3])], settings=Settings(settling=40, longest=300, cloud=64))
    assert found.period == 0
    assert (np.abs(found.section[:, 0] - 10.0 * found.phases - 0.5) <= 0.5).all()


def test_a_motion_that_grows_without_end_reaches_no_attractor() -> None:
    away: Any = Iterated(lambda x, p: (2.0 * x, np.array([[2.0]]), np.zeros((1, 0))), 1)
    assert find_attractors(away, [np.array([1.0])]) == []


@pytest.mark.parametrize(("before", "now", "numbers"), [
    ([], [0.0, 5.0, 9.0], [0, 1, 2]), ([[cloud(0.0, 4)]], [1.0], [4]), ([[cloud(0.0, 4)]], [1.01], [5]),
    ([[cloud(0.0, 0), cloud(1.0, 1)]], [0.6, -0.9], [1, 0]), ([[cloud(0.0, 0)]], [0.3, 0.1, 0.2], [1, 0, 2]),
    ([[cloud(0.0, 7)], [cloud(50.0, 3)]], [0.0, 50.0], [8, 3]),
    ([[cloud([0.0, 9.0], 2, [0, 1])]], [cloud([9.3, 0.3], 0, [0, 1])], [3]),
    ([[cloud([0.0, 9.0], 2, [0, 1])]], [cloud([9.3, 0.3], 0, [1, 0])], [2]),
    ([[cloud([0.0, 9.0], 2, [0, 1])]], [cloud([9.3], 0, [1])], [2])])
def test_an_attractor_has_the_number_of_the_nearest_one_at_the_last_value(before: Any, now: Any,
                                                                          numbers: list[int]) -> None:
    """Within half a natural size (of 2), at equal phases, the nearest pairs first; else a number that none had."""
    of: Any = Motion(TextbookMap(lambda x, p: (x, np.eye(1), np.zeros((1, 0))), 1), 2.0)
    found = [x if isinstance(x, Attractor) else cloud(x, 99) for x in now]
    result = numbered(of, before, found)
    assert [a.number for a in result] == numbers
    assert [a.section.tolist() for a in result] == [a.section.tolist() for a in found]
