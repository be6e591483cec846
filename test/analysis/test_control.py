"""Means over whole engine cycles, of samples in batches, and signals that keep their value."""


import numpy as np
import pytest

from tcc_sim.analysis.loop.control import CycleMeans, joined_means
from tcc_sim.analysis.loop.tracking import loop_cycles
from tcc_sim.analysis.measured.engine_clock import Scheduled, Tracked

CYCLE = 0.05


@pytest.mark.parametrize("size", [1, 7, 10**6])
def test_the_mean_of_straight_lines_between_samples_is_exact(size):
    """A line 3 + 2 t that bends to 13 - 2 t at 2.5 s, over cycles that are no multiples of the samples' 10 ms."""
    t = np.arange(101, 500) * 1e-2
    v, means, found = np.where(t < 2.5, 3.0 + 2.0 * t, 13.0 - 2.0 * t), CycleMeans(Scheduled(0.237)), []
    for start in range(0, len(t), size):
        found += means.feed(t[start:start + size], v[start:start + size])
    ends, values = joined_means(found)
    edges = 0.237 * np.arange(5, 22)

    assert ends.tolist() == np.rint(1e9 * edges[1:]).tolist()
    assert found[0][0] == 5
    expected = np.diff(np.where(edges < 2.5, 3.0 * edges + edges**2,
                                3.0 * 2.5 + 6.25 + 13.0 * (edges - 2.5) - (edges**2 - 6.25))) / 0.237
    assert values == pytest.approx(expected)


def test_a_gap_leaves_out_the_cycles_that_it_touches():
    for interrupted in (True, False):   # By the reader, or since it is longer than 2.5 ticks.
        course, _ = loop_cycles(Scheduled(0.1), [(False, np.arange(0, 255) * 1e-3, np.full(255, 2.0)),
                                                 (interrupted, np.arange(430, 701) * 1e-3, np.full(271, 4.0))])
        assert course.mean == pytest.approx([2.0, 2.0, 4.0, 4.0])
        assert course.starts == pytest.approx([0.0, 0.1, 0.5, 0.6])


@pytest.mark.parametrize(("later", "whole"), [(2.4, 3), (2.6, 2)])
def test_a_distance_of_two_ticks_and_a_half_is_bridged(later, whole):
    means = CycleMeans(Scheduled(0.1))
    begin = 0.25 + later * 1e-3
    found = means.feed(np.arange(0, 251) * 1e-3, np.full(251, 2.0))
    found += means.feed(begin + np.arange(0, 52) * 1e-3, np.full(52, 2.0))
    assert joined_means(found)[1] == pytest.approx([2.0] * whole)


def test_cycles_of_a_clock_that_knows_only_some_have_means():
    means = CycleMeans(Tracked(0.1, {3: (np.array([4, 5, 6, 9, 10]), np.array([0.1, 0.2, 0.31, 0.6, 0.7]))}))
    t = np.arange(0, 1000) * 1e-3
    found = means.feed(t, 5.0 + t, 3)
    assert [(first, ends.tolist()) for first, ends, _ in found] == [(4, [0.2, 0.31]), (9, [0.7])]
    assert joined_means(found)[1] == pytest.approx([5.15, 5.255, 5.65])
    assert means.feed(t + 1.0, t, 3) == []
    assert CycleMeans(Scheduled(0.1)).feed(t[:50], t[:50]) == []
    assert [len(x) for x in joined_means([])] == [0, 0]


def test_a_leap_of_time_costs_no_memory_and_gives_no_mean():
    means = CycleMeans(Scheduled(0.1))
    assert means.feed(np.array([0.0, 0.05, 1e6]), np.full(3, 2.0)) == []
    ((_, ends, result),) = means.feed(1e6 + np.arange(1, 400) * 1e-3, np.full(399, 2.0))
    assert result == pytest.approx(2.0)
    assert len(ends) in (2, 3)


def test_slices_of_time_have_no_means():
    part = False, np.arange(1000) * 1e-3, np.full(1000, 2.0)
    assert len(loop_cycles(Scheduled(0.1, identified=False), [part])[0].mean) == 0
