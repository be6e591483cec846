"""Limits, doubts and bounds of the judgement on sections, each at both sides, with decays whose limit is known."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.periodicity import longest_tried, periodicity
from tcc_sim.analysis.repetition import repetitions
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


@pytest.mark.parametrize(("rate", "noise", "has"), [
    # Over 41 of 61 points less 1, in thirds of 13: rate^26 must be below 0.95, and 41 cycles must decay by exp(-0.05).
    (0.9979, 0.0, 1), (0.99805, 0.0, 0), (1.01, 0.0, 0), (0.95, 1e-7, 1), (0.95, 1e-2, 0)])
def test_a_limit_needs_a_decay_above_its_misfit(rate, noise, has):
    assert judged(settling((rate,), 1, 61, noise=noise), 1, 1e-9)[0] == has


@pytest.mark.parametrize(("left", "change", "found"), [(0.099, 0.01, 1), (0.101, 0.01, 0), (0.097, 0.24, 1),
                                                       (0.097, 0.26, 0)])
def test_a_limit_must_be_near_and_the_last_change_small(left, change, found):
    """Of a geometric decay with this rest, which falls by `change` in the last cycle."""
    rate = left / (left + change) if change > 0.1 else 0.97
    points = 1.0 + (left * rate ** (np.arange(61) - 60.0))[:, None] * WAY
    assert judged(points)[0] == found


def test_a_decay_that_slows_down_has_no_limit():
    """From one half of the last two thirds to the other its rate falls to less than half of it, as onto a torus."""
    n = np.arange(91)
    for begin, found in ((0.0, 1), (22.0, 0)):   # 1/(n - n0): from 1/45 to 1/75, and from 1/23 to 1/53.
        with np.errstate(divide="ignore"):
            sizes = np.where(n > 22, 1.0 / np.abs(n - begin), 1.0)
        assert judged(1.0 + 0.1 * sizes[:, None] * WAY, 1)[0] == found


@pytest.mark.parametrize(("apart", "found"), [(4e-4, {1}), (0.041, {2})])
def test_points_of_a_limit_that_are_apart_are_two(apart, found):
    """Half a period apart, beside a remaining distance of 0.01."""
    n = np.arange(122)
    x = 0.5 * apart * (-1.0) ** n + 0.01 * 0.97 ** ((n - 120) // 2)
    assert judged(np.stack([x, 0.5 * x, 0.0 * x], axis=1), 2, 1e-9)[0] in found


def test_a_decay_just_behind_a_doubling_has_twice_the_period():
    """0.06 and a slow mode between the points of the one period and of the other."""
    n = np.arange(151)
    for left, found in ((0.06, 4), (0.0, 2)):
        x = 0.75 * (-1.0) ** n + (left + 0.04 * np.exp(-0.012 * n)) * np.cos(0.5 * math.pi * n + 0.3)
        assert judged(np.stack([0.4 + 0.3 * x, 0.1 + 0.05 * x, 0.1 - 0.2 * x], axis=1))[:2] == (found, False)


@pytest.mark.parametrize(("period", "count", "compared"), [(4, 48, 12), (4, 47, 12), (2, 40, 10), (1, 52, 13)])
def test_the_last_quarter_is_compared_and_at_least_three_periods(period, count, compared):
    orbit = np.tile(np.random.default_rng(6).normal(size=(period, 3)), (60, 1))[:count]
    for index in (count - compared, count - 1):
        for change, same in ((0.0999, True), (0.1001, False)):
            points = orbit.copy()
            points[index] += change
            assert (judged(points, period, 0.1)[:2] == (period, True)) == same
    points = orbit.copy()
    points[:count - compared - period] += 1.0
    assert judged(points, period, 0.0)[:2] == (period, True)


def test_many_sections_are_judged_as_each_alone():
    random = np.random.default_rng(6).normal(size=(40, 3))
    points = np.stack([settling((0.95, -0.9), 2, 91), np.tile(random[:3], (31, 1))[:91], random[np.arange(91) % 40]])
    assert repetitions(points, 16, 1e-4) == [judged(each, 16) for each in points]
    assert periodicity(Cycles(points[0], np.ones(90), np.zeros(90), np.zeros(90))).longest == 16
    assert [longest_tried(count) for count in (2, 3, 8, 47, 48, 51, 200)] == [0, 1, 2, 15, 16, 16, 16]
    assert longest_tried(30, 7) == 7
