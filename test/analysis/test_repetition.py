"""The kernels that judge sections, as plain Python: each beside NumPy, or at both sides of its bounds."""

import math

import numpy as np
import pytest
from plain import plain as plain_of

from tcc_sim.analysis import repetition
from tcc_sim.analysis.periodicity import longest_tried, periodicity
from tcc_sim.trajectory import Cycles

plain = plain_of(repetition)
RANDOM = np.random.default_rng(6).normal(size=(40, 3))


def rooms(count=300, period=16):
    """Work arrays of a fit, and the limit."""
    return np.empty((4, 3 * count)), np.empty((3, 4)), np.empty(3), np.empty((period, 3))


@pytest.mark.parametrize(("low", "high", "lag", "multiple"), [
    (0, 40, 1, 1), (3, 40, 2, 2), (5, 33, 3, 3), (0, 30, 4, 2), (7, 20, 1, 5), (10, 14, 1, 1), (10, 13, 1, 1),
    (10, 11, 1, 1), (0, 19, 1, 6), (0, 18, 1, 6), (5, 8, 4, 1)])
def test_thirds_are_the_largest_differences_in_whole_multiples(low, high, lag, multiple):
    sizes = np.abs(RANDOM[low + lag:high] - RANDOM[low:high - lag]).max(axis=1)
    width = max(high - low - lag, 0) // 3 // multiple * multiple
    expected = sizes[len(sizes) - 3 * width:].reshape(3, width).max(axis=1).tolist() if width else [-1.0] * 3
    assert list(plain.thirds(RANDOM, low, high, lag, multiple)) == expected


def test_the_largest_difference_is_that_of_any_coordinate():
    assert plain.largest_apart(RANDOM, 3, 5, 11) == np.abs(RANDOM[8:14] - RANDOM[5:11]).max()
    assert plain.largest_apart(RANDOM, 3, 5, 5) == 0.0
    for coordinate in range(3):
        for sign in (1.0, -1.0):
            points = np.array([[1.0, 2.0, 3.0]] * 2)
            points[1, coordinate] += 0.25 * sign
            assert plain.difference_of(points, 1, 0) == plain.difference_of(points, 0, 1) == 0.25
    for count, period in ((30, 1), (30, 4), (7, 3), (5, 3), (2, 1)):
        first = max(count - 2 * period, 0)
        assert plain.last_change(RANDOM, count, period) == (
            np.abs(RANDOM[first + period:count] - RANDOM[first:count - period]).max() if count > period else 0.0)


def test_the_last_quarter_is_compared_and_at_least_three_periods():
    assert [plain.periods_compared(*given) for given in ((48, 4), (47, 4), (40, 2), (52, 1), (12, 4))] == [
        3, 3, 5, 13, 3]
    assert [plain.first_compared(*given) for given in ((48, 2, 4), (40, 3, 2), (52, 1, 1), (12, 2, 4), (13, 1, 4))] == [
        34, 27, 38, 0, 0]
    for count, period in ((48, 4), (40, 2), (52, 1), (13, 4)):
        compared = plain.periods_compared(count, period) * period
        for index, coordinate in ((count - compared, 0), (count - 1, 1), (count - compared // 2, 2)):
            points = np.tile(RANDOM[:period], (60, 1))[:count]
            points[index, coordinate] += 0.125
            assert plain.repeats_lately(points, count, period, 0.1251)
            assert not plain.repeats_lately(points, count, period, 0.1249)
        points = np.tile(RANDOM[:period], (60, 1))[:count]
        points[:count - compared] += 1.0
        assert plain.repeats_lately(points, count, period, 0.0)


@pytest.mark.parametrize(("sizes", "vanish"), [
    ((1.0, 1.0, 0.5), False), ((1.0, 0.5, 0.5), False), ((1.0, 0.7, 0.4), True), ((1.0, 0.8, 0.4), True),
    ((1.0, 0.61, 0.4), True), ((1.0, 0.59, 0.4), False), ((1.021, 1.0106, 1.0), True), ((1.019, 1.0096, 1.0), False),
    # A geometric decay 1 + r + r^2 to a limit: of 2 - 2 r - 2 r^2 left, half of the last is left at the bound.
    ((3.0 + 1.0, 3.0 + 0.5, 3.0 + 0.25), False), ((0.24 + 1.0, 0.24 + 0.5, 0.24 + 0.25), True),
    ((0.26 + 1.0, 0.26 + 0.5, 0.26 + 0.25), False)])
def test_three_sizes_may_vanish_as_aitken_extrapolates(sizes, vanish):
    assert plain.vanishes(*sizes) is vanish
    assert plain.vanishes(*(7.0 * size for size in sizes)) is vanish


def alternating(sizes):
    """Points whose differences one apart are these sizes, with alternating sign, in one coordinate each in turn."""
    x = np.concatenate([[0.0], np.cumsum(np.asarray(sizes) * (-1.0) ** np.arange(len(sizes)))])
    return np.stack([0.5 * x, x, 0.25 * x], axis=1)


N = np.arange(63)


@pytest.mark.parametrize(("sizes", "tolerance", "may"), [
    (np.full(3, 0.5), 0.0, True),                                   # Too few for thirds of whole periods.
    (np.full(63, 0.5), 0.01, False), (np.full(63, 0.5), 0.49, False), (np.full(63, 0.5), 0.51, True),
    # Up to ten times what changes over a period, 0.004, it counts as zero.
    (np.where(N < 46, 0.5, 0.034 + 0.004 * (N % 2)), 0.0, True),
    (np.where(N < 46, 0.5, 0.038 + 0.004 * (N % 2)), 0.0, False),
    # In the last 16 it falls to 0.48 of itself, or to 0.51.
    (0.5 - 0.0185 * np.maximum(N - 47, 0), 0.0, True), (0.5 - 0.0175 * np.maximum(N - 47, 0), 0.0, False),
    # Towards 0.49 and 0.54 of the largest in the last third; a fall that has ended; a fast fall before a slow one.
    (0.2 + 0.4 * 0.985**N, 0.0, True), (0.25 + 0.4 * 0.985**N, 0.0, False), (0.5 + 0.5 * 0.9**N, 0.0, False),
    (0.8**N + 0.1 * 0.985**N, 0.0, True), (np.where(N < 20, 0.9, 0.5), 0.0, False)])
def test_a_difference_from_a_divisor_may_vanish(sizes, tolerance, may):
    points = alternating(sizes)
    assert plain.may_vanish(points, len(points), 1, 2, tolerance) is may


@pytest.mark.parametrize(("factor", "size", "late", "grow"), [
    (2.2, 1.0, 1.0, True), (1.9, 1.0, 1.0, False), (2.2, 0.0011, 1.0, True), (2.2, 0.0009, 1.0, False),
    (2.2, 1.0, 0.51, True), (2.2, 1.0, 0.49, False)])
def test_points_that_part_grow_by_more_than_twice_from_third_to_third(factor, size, late, grow):
    """Differences of 12 points of size 0.1 in the last third, at its first one, and later `late` of it."""
    tolerance, third = 1.0, np.array([factor**-2.0, factor**-1.0, 1.0])
    steps = 10.0 * tolerance * size * np.repeat(third, 12)
    steps[25:] *= late
    x = np.concatenate([[0.0], np.cumsum(steps)])
    assert plain.grows(np.stack([x, 0.0 * x, 0.0 * x], axis=1), 37, 1, tolerance) is grow


def by_numpy(points, period, modes):
    """Misfit and coefficients of d_(n+mp) = sum_i c_i d_(n+ip), every equation over its largest number."""
    difference = points[period:] - points[:-period]
    count = len(difference) - modes * period
    columns = np.stack([difference[i * period:i * period + count] for i in range(modes + 1)])
    columns = (columns / np.abs(columns).max(axis=(0, 2))[None, :, None]).reshape(modes + 1, -1)
    result, *_ = np.linalg.lstsq(columns[:-1].T, columns[-1], rcond=None)
    return float(np.sqrt(np.mean((columns[-1] - result @ columns[:-1])**2))), result


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize("period", [1, 2, 5])
def test_a_decay_is_the_least_squares_solution(period, modes):
    random = np.random.default_rng(3)
    n = np.arange(20, 100)[:, None]
    falling = sum(x * r**n for x, r in zip(random.normal(size=(3, 3)), (0.97, -0.9, 0.85)))
    points = 1.0 + falling + 1e-4 * random.normal(size=(80, 3))
    shares = np.empty(3)
    misfit = plain.decay(np.concatenate([np.ones((20, 3)), points]), 20, 100, period, modes, np.empty((4, 300)),
                         np.empty((3, 4)), shares)
    expected, coefficients = by_numpy(points, period, modes)
    assert misfit == pytest.approx(expected, rel=1e-9)
    assert shares[:modes] == pytest.approx(coefficients, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("modes", [2, 3])
def test_a_column_that_depends_on_the_others_has_no_share(modes):
    """A decay of one mode, exact in binary numbers: the misfit is 0 with any number of modes, and so is it by NumPy."""
    points = 0.5 ** np.arange(30)[:, None] * np.array([1.0, -2.0, 4.0])
    shares = np.empty(3)
    assert plain.decay(points, 0, 30, 1, modes, np.empty((4, 90)), np.empty((3, 4)), shares) < 1e-12
    assert by_numpy(points, 1, modes)[0] < 1e-12
    assert shares[1:modes].tolist() == [0.0] * (modes - 1)


def test_equal_points_and_too_few_have_no_decay():
    room = rooms()[:3]
    assert plain.decay(np.ones((30, 3)), 0, 30, 1, 1, *room) == -1.0
    for period, modes in ((1, 1), (2, 2), (3, 3), (5, 2)):
        few = (modes + 1) * period + 2 * modes - 1  # 2 m - 1 equations of differences.
        assert plain.decay(RANDOM, 3, 3 + few, period, modes, *room) == -1.0
        assert plain.decay(RANDOM, 3, 4 + few, period, modes, *room) >= 0.0


def test_the_rate_is_that_of_the_largest_root():
    random = np.random.default_rng(4)
    rows = [*random.normal(size=(300, 3)), *(10.0 ** random.uniform(-6, 3, (100, 3))), np.zeros(3), [0.0, 0.0, 0.5],
            [1.0, -3.0, 3.0]]
    for row in rows:
        for modes in (1, 2, 3):
            shares = np.array(row[:modes])
            largest = np.abs(np.roots([1.0, *-shares[::-1]])).max(initial=1e-300)
            assert np.exp(-plain.rate_of(shares, modes)) == pytest.approx(largest, rel=1e-5 if row[0] == 1.0 else 1e-7)


def settling(rates, period, count, sizes=(0.05, 0.04, 0.03), noise=0.0):
    """An orbit of this period about which modes decay by these rates a period, and the orbit in its last phases."""
    n, random = np.arange(count), np.random.default_rng(8)
    orbit = random.uniform(0.2, 1.0, (period, 3))
    limit = orbit[n % period]
    points = limit + noise * random.normal(size=(count, 3))
    for rate, size, way in zip(rates, sizes, random.normal(size=(3, 3))):
        points += (size * np.sign(rate) ** (n // period) * np.abs(rate) ** (n / period))[:, None] * way
    return points, limit[count - period:]


@pytest.mark.parametrize("period", [1, 2, 3])
@pytest.mark.parametrize("rates", [(0.9,), (-0.9,), (0.93, -0.85), (0.94, 0.88, -0.9)])
def test_the_limit_of_a_decay_is_where_it_goes(rates, period):
    points, expected = settling(rates, period, 40 * period + 1)
    *room, limit = rooms()
    assert plain.limit_of(points, len(points), period, *room, limit)
    assert limit[:period] == pytest.approx(expected, abs=2e-7)
    found, left = plain.period_in_the_limit(points, len(points), period, 1e-9, *room, limit)
    assert (found, left) == (period, pytest.approx(np.abs(points[-period:] - expected).max(), rel=1e-5))


@pytest.mark.parametrize(("rate", "noise", "has"), [
    # Over 41 of 61 points less 1, in thirds of 13: rate^26 must be below 0.95, and 41 cycles must decay by exp(-0.05).
    (0.9979, 0.0, True), (0.99805, 0.0, False), (1.01, 0.0, False), (0.95, 1e-7, True), (0.95, 1e-4, False)])
def test_a_limit_needs_a_decay_above_its_misfit(rate, noise, has):
    points, _ = settling((rate,), 1, 61, noise=noise)
    assert plain.limit_of(points, 61, 1, *rooms()) is has


def test_a_decay_that_slows_down_has_no_limit():
    """From one half of the last two thirds to the other its rate falls to less than half of it, as onto a torus."""
    n, way = np.arange(91), np.array([1.0, 0.4, -0.6])
    for begin, has in ((0.0, True), (22.0, False)):   # 1/(n - n0): from 1/45 to 1/75, and from 1/23 to 1/53.
        with np.errstate(divide="ignore"):
            sizes = np.where(n > 22, 1.0 / np.abs(n - begin), 1.0)
        assert plain.limit_of(1.0 + sizes[:, None] * way, 91, 1, *rooms()) is has


def test_the_limit_must_be_near_and_tells_its_own_period():
    for left, found in ((0.099, 1), (0.101, plain.NONE)):
        points = 1.0 + (left / 0.97**60 * 0.97 ** np.arange(61))[:, None] * np.array([1.0, 0.3, -0.5])
        result = plain.period_in_the_limit(points, 61, 1, 1e-9, *rooms())
        assert result == (found, pytest.approx(left) if found == 1 else math.inf)
    # Points of the limit half a period apart: `apart`, beside a remaining distance of 0.01.
    n = np.arange(122)
    for apart, found in ((4e-4, 1), (6e-4, plain.DOUBT), (0.039, plain.DOUBT), (0.041, 2)):
        x = 0.5 * apart * (-1.0) ** n + 0.01 * 0.97 ** ((n - 120) // 2)
        points = np.stack([x, 0.5 * x, 0.0 * x], axis=1)
        assert plain.period_in_the_limit(points, 122, 2, 1e-9, *rooms()) == (found, pytest.approx(0.01, rel=1e-6))
    assert plain.period_in_the_limit(points, 122, 2, 0.0411, *rooms())[0] == 1


def judged(points, most=None, tolerance=1e-4):
    return plain.repetition(points, len(points), most or longest_tried(len(points)), tolerance, *rooms())


@pytest.mark.parametrize("period", [1, 2, 3, 6, 16])
def test_the_period_is_the_smallest_that_repeats(period):
    points = np.tile(np.random.default_rng(period).uniform(0.2, 1.0, (period, 3)), (40, 1))[:101]
    points[:40] += 0.01
    assert judged(points) == (period, True, 0.0)
    assert judged(points, period)[0] == period
    if period > 1:
        found, settled, change = judged(points, period - 1)
        assert (found, settled, change) == (0, False, np.abs(points[-1] - points[-2]).max())


def test_the_change_is_that_over_the_period():
    points, _ = settling((0.5,), 2, 91)
    points[-1, 1] += 3e-5
    assert judged(points)[:2] == (2, True)
    assert judged(points)[2] == pytest.approx(3e-5, rel=1e-3)
    slow, _ = settling((0.95,), 2, 121)
    assert judged(slow, 2)[0] == 2
    assert judged(slow, 1)[0] == 0
    found, settled, change = judged(slow)
    assert (found, settled) == (2, False)
    assert change == np.abs(slow[-2:] - slow[-4:-2]).max()


def test_a_change_over_a_period_of_a_quarter_is_no_settling():
    way, n = np.array([1.0, 0.4, -0.6]), np.arange(61)
    for change, found in ((0.24, 1), (0.26, 0)):   # Of which 0.097 remain.
        rate = 0.097 / (0.097 + change)
        points = 1.0 + (0.097 * rate ** (n - 60.0))[:, None] * way
        assert judged(points)[0] == found


def test_a_decay_just_behind_a_doubling_has_twice_the_period():
    """0.06 and a slow mode between the points of the one period and of the other."""
    n = np.arange(151)
    for left, found in ((0.06, 4), (0.0, 2)):
        x = 0.75 * (-1.0) ** n + (left + 0.04 * np.exp(-0.012 * n)) * np.cos(0.5 * math.pi * n + 0.3)
        points = np.stack([0.4 + 0.3 * x, 0.1 + 0.05 * x, 0.1 - 0.2 * x], axis=1)
        assert judged(points)[:2] == (found, False)


def test_kernels_give_what_their_python_gives():
    points = np.stack([settling((0.95, -0.9), 2, 91)[0], np.tile(RANDOM[:3], (31, 1))[:91], RANDOM[np.arange(91) % 40]])
    most = 16
    assert repetition.repetitions(points, most, 1e-4) == [
        (period, settled, pytest.approx(change, rel=1e-9)) for period, settled, change in map(judged, points)]
    cycles = Cycles(points[0], np.ones(90), np.zeros(90), np.zeros(90))
    assert periodicity(cycles).longest == longest_tried(91) == most
    assert [longest_tried(count) for count in (2, 3, 8, 47, 48, 51, 200)] == [0, 1, 2, 15, 16, 16, 16]
    assert longest_tried(30, 7) == 7
