"""Which attractor motions reach, beside a search point by point, and scripted motions with known labels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tcc_sim.study.basins.attractors import Attractor, ProximityMapper, Settings, labelled, section_points

NAN = float("nan")


def attractor(period: int, points: Any, radius: float, forcing: int = 1, first: int = 0) -> Attractor:
    section = np.array(points, dtype=np.float64)
    return Attractor(period, section, (first + np.arange(len(section))) % forcing, None, 1.0, radius)


def point_by_point(attractors: list[Attractor], scales: np.ndarray, forcing: int, motion: np.ndarray,
                   first: int) -> tuple[int, int]:
    """Number of the attractor and cycles until then; -1 and the number of points for none."""
    def near(a: Attractor, i: int, t: int) -> bool:
        same_phase = (first + t) % forcing == a.phases[i]
        return bool(same_phase and ((motion[t] / scales - a.section[i] / scales) ** 2).sum() <= a.radius**2)

    for t in range(len(motion) - 1):
        for periodic in (True, False):
            for k, a in enumerate(attractors):
                places = range(len(a.section))
                if bool(a.period) is periodic and (
                        any(near(a, i, t) and near(a, (i + 1) % a.period, t + 1) for i in places) if a.period else
                        any(near(a, i, t) for i in places) and any(near(a, i, t + 1) for i in places)):
                    return k, t
    return -1, len(motion)


@pytest.mark.parametrize("forcing", [1, 2])
@pytest.mark.parametrize("first", [0, 3])
def test_motions_are_near_the_attractors_that_a_search_point_by_point_finds(forcing: int, first: int) -> None:
    random, scales = np.random.default_rng(4 * forcing + first), np.array([2.0, 0.5])
    kinds = [(2, 2), (0, 9), (4, 4), (2, 2), (0, 7)]
    attractors = [attractor(period, scales * random.uniform(-1.0, 1.0, (count, 2)), radius, forcing)
                  for (period, count), radius in zip(kinds, (0.25, 0.15, 0.2, 0.4, 0.1))]
    motions = scales * random.uniform(-1.0, 1.0, (300, 6, 2))
    motions[::7, 3:] = NAN
    for k, motion in enumerate(motions[1::3]):  # Pieces of orbits, some shifted by just less or more than their radius.
        a = attractors[k % 5]
        shift = a.radius * (0.999 if k % 2 else 1.001) / 2.0**0.5 * scales
        motion[2:4] = a.section[np.arange(k, k + 2) % len(a.section)] + shift
    mapper = ProximityMapper(attractors, scales, forcing)
    labels, after = mapper.find(motions, first)
    expected = [point_by_point(attractors, scales, forcing, motion, first) for motion in motions]
    assert list(zip(labels.tolist(), after.tolist())) == expected
    assert {k for k, _ in expected} == {-1, 0, 1, 2, 3, 4}


def test_the_capture_sphere_of_an_orbit_holds_its_surface() -> None:
    mapper = ProximityMapper([attractor(1, [[0.0]], 0.25)], np.ones(1), 1)
    labels, after = mapper.find(np.array([[[9.0], [0.25], [0.25]], [[9.0], [0.25], [0.2501]]]), 0)
    assert (labels.tolist(), after.tolist()) == ([0, -1], [1, 3])


class Scripted:
    """Motions with given section points; a motion runs away where it is above 100."""

    def __init__(self, motions: list[list[float]]) -> None:
        self.motions = motions

    def sections(self, starts: np.ndarray, first: int, cycles: int, orbits: Any = None) -> np.ndarray:
        """The points of the motions that have these, scripts going on with their last number."""
        out = np.full((len(starts), cycles + 1, 1), NAN)
        for row, start in zip(out, starts[:, 0].tolist()):
            script = next(m for m in self.motions if m[min(first, len(m) - 1)] == start)
            row[:, 0] = [script[min(first + k, len(script) - 1)] for k in range(cycles + 1)]
        return out

    def runs_away(self, points: np.ndarray) -> np.ndarray:
        return points[:, 0] > 100.0


@pytest.mark.parametrize("chunk", [1, 2, 3, 4, 50])
def test_labels_and_cycles_do_not_depend_on_the_chunks(chunk: int) -> None:
    """An orbit at 0, and one at 1 and 2 in turns; the numbers before tell the motions apart."""
    of: Any = Scripted([[10.0, 9.0, 8.0, 0.0, 0.0], [11.0, 0.0, 12.0, 1.0, 2.0], [13.0, 14.0, 15.0],
                        [16.0, 17.0, 18.0, NAN], [0.05, 0.05]])
    mapper = ProximityMapper([attractor(1, [[0.0]], 0.1), attractor(2, [[1.0], [2.0]], 0.1)], np.ones(1), 1)
    starts = np.array([[m[0]] for m in of.motions])
    labels, cycles = labelled(of, mapper, starts, 20, Settings(chunk=chunk))
    assert (labels.tolist(), cycles.tolist()) == ([0, 1, -1, -1, 0], [3, 3, 20, 2, 0])


def test_a_motion_that_runs_away_is_known_at_the_end_of_a_chunk() -> None:
    """If it reached an attractor before, that counts; a failed solve ends it at its last point."""
    of: Any = Scripted([[10.0, 20.0, 101.0, 102.0, 103.0, 104.0, 105.0], [11.0, 0.0, 0.0, 200.0],
                        [12.0, 300.0, NAN], [13.0, 101.0, 50.0, 50.0]])
    mapper = ProximityMapper([attractor(1, [[0.0]], 0.1)], np.ones(1), 1)
    labels, cycles = labelled(of, mapper, np.array([[10.0], [11.0], [12.0], [13.0]]), 8)
    assert (labels.tolist(), cycles.tolist()) == ([-2, 0, -2, -1], [4, 1, 1, 8])
    assert section_points(of, np.array([12.0]), 0, 5).tolist() == [[12.0], [300.0]]


def test_without_attractors_none_is_reached() -> None:
    mapper = ProximityMapper([], np.ones(2), 1)
    assert [x.tolist() for x in mapper.find(np.zeros((3, 4, 2)), 0)] == [[-1] * 3, [4] * 3]
