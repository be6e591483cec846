"""Means over whole engine cycles, of samples in batches."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.control import CycleMeans
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.analysis.tracking import LoopReader

CYCLE = 0.05


@pytest.mark.parametrize("size", [1, 7, 10**6])
def test_the_mean_of_a_sine_over_its_cycle_is_its_offset(size):
    t, cycle = np.arange(3000) * 1e-3, CYCLE * math.sqrt(2.0) / 1.3
    reader = LoopReader(Uniform(cycle))
    v = 5.0 + 3.0 * np.sin(2.0 * math.pi * t / cycle)
    for start in range(0, len(t), size):
        reader.feed(t[start:start + size], v[start:start + size])
    course = reader.course()
    assert len(course.mean) == int(2.999 / cycle)
    assert course.mean == pytest.approx(5.0, abs=2e-3)
    assert course.square - course.mean**2 == pytest.approx(4.5, rel=2e-3)
    assert course.starts == pytest.approx(cycle * np.arange(len(course.mean)), abs=1e-9)


def test_a_gap_leaves_out_the_cycles_that_it_touches():
    reader = LoopReader(Uniform(0.1))
    reader.feed(np.arange(0, 255) * 1e-3, np.full(255, 2.0))
    reader.interrupt()
    reader.feed(np.arange(430, 701) * 1e-3, np.full(271, 4.0))
    course = reader.course()
    assert course.mean == pytest.approx([2.0, 2.0, 4.0, 4.0])
    assert course.starts == pytest.approx([0.0, 0.1, 0.5, 0.6])


def test_a_leap_of_time_costs_no_memory_and_gives_no_mean():
    means = CycleMeans(Uniform(0.1))
    assert means.feed(np.array([0.0, 0.05, 1e6]), np.full(3, 2.0)) == []
    ((_, ends, result),) = means.feed(1e6 + np.arange(1, 400) * 1e-3, np.full(399, 2.0))
    assert result == pytest.approx(2.0)
    assert len(ends) in (2, 3)


def test_slices_of_time_have_no_means():
    reader = LoopReader(Uniform(0.1, identified=False))
    reader.feed(np.arange(1000) * 1e-3, np.full(1000, 2.0))
    assert len(reader.course().mean) == 0
