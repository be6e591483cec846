"""Limits and doubts of the judgement on sections, with decays whose limit is known."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.repetition import repetitions
from tcc_sim.analysis.steady.summary import longest_tried, periodicity
from tcc_sim.trajectory import Cycles

WAY = np.array([1.0, 0.4, -0.6])


def judged(points, most=None, tolerance=1e-4):
    """Period, whether it has settled, and change of points, (n, 3)."""
    ((period, settled, change),) = repetitions(points[None], most or longest_tried(len(points)), tolerance)
    return period, settled, change


def settling(rates, period, count, sizes=(0.05, 0.04, 0.03), noise=0.0):
    """An orbit of this period about which modes decay by these rates a period."""
    n, random = np.arange(count), np.random.default_rng(8)
    points = random.uniform(0.2, 1.0, (period, 3))[n % period] + noise * random.normal(size=(count, 3))
    for rate, size, way in zip(rates, sizes, random.normal(size=(3, 3))):
        points = points + (size * np.sign(rate) ** (n // period) * np.abs(rate) ** (n / period))[:, None] * way
    return points


@pytest.mark.parametrize("period", [1, 2, 3])
@pytest.mark.parametrize("rates", [(0.95,), (-0.95,), (0.96, -0.9), (0.96, 0.9, -0.92)])
def test_a_decay_is_followed_to_its_limit(rates, period):
    """It has not settled, and its change is the largest in the last period."""
    points = settling(rates, period, 60 * period + 1)
    found, settled, change = judged(points, tolerance=1e-9)
    assert (found, settled) == (period, False)
    assert change == np.abs(points[-period:] - points[-2 * period:-period]).max()


@pytest.mark.parametrize("period", [1, 2, 3, 6, 16])
def test_the_period_is_the_smallest_that_repeats(period):
    points = np.tile(np.random.default_rng(period).uniform(0.2, 1.0, (period, 3)), (40, 1))[:101]
    points[:40] += 0.01
    assert judged(points) == (period, True, 0.0)
    assert judged(points, period)[0] == period
    if period > 1:
        assert judged(points, period - 1) == (0, False, np.abs(points[-1] - points[-2]).max())


def test_a_decay_that_slows_down_has_no_limit():
    """From one half of the last two thirds to the other its rate falls to less than half of it, as onto a torus."""
    n = np.arange(91)
    for begin, found in ((0.0, 1), (22.0, 0)):   # 1/(n - n0): from 1/45 to 1/75, and from 1/23 to 1/53.
        with np.errstate(divide="ignore"):
            sizes = np.where(n > 22, 1.0 / np.abs(n - begin), 1.0)
        assert judged(1.0 + 0.1 * sizes[:, None] * WAY, 1)[0] == found


def test_a_decay_just_behind_a_doubling_has_twice_the_period():
    """0.06 and a slow mode between the points of the one period and of the other."""
    n = np.arange(151)
    for left, found in ((0.06, 4), (0.0, 2)):
        x = 0.75 * (-1.0) ** n + (left + 0.04 * np.exp(-0.012 * n)) * np.cos(0.5 * math.pi * n + 0.3)
        assert judged(np.stack([0.4 + 0.3 * x, 0.1 + 0.05 * x, 0.1 - 0.2 * x], axis=1))[:2] == (found, False)


def test_many_sections_are_judged_as_each_alone():
    random = np.random.default_rng(6).normal(size=(40, 3))
    points = np.stack([settling((0.95, -0.9), 2, 91), np.tile(random[:3], (31, 1))[:91], random[np.arange(91) % 40]])
    assert repetitions(points, 16, 1e-4) == [judged(each, 16) for each in points]
    assert periodicity(Cycles(points[0], np.ones(90), np.zeros(90), np.zeros(90))).longest == 16
    assert [longest_tried(count) for count in (2, 3, 8, 47, 48, 51, 200)] == [0, 1, 2, 15, 16, 16, 16]
    assert longest_tried(30, 7) == 7
