"""Sections made by hand, with a known period or with none."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import Periodicity, of_points, periodicity, repeats_finely, stays
from tcc_sim.trajectory import Cycles


def cycles_through(points):
    section = np.asarray(points, dtype=float)
    n = len(section) - 1
    return Cycles(section, np.full(n, 120.0), np.full(n, -3.0), np.zeros(n))


def embedded(values):
    """A scalar sequence as section points of a motion whose slip reaches 120 rad/s."""
    x = np.asarray(values, dtype=float)
    return cycles_through(np.stack([40.0 + 30.0 * x, 0.1 + 0.05 * x, 10.0 - 20.0 * x], axis=1))


def logistic(rate, start, count, dropped):
    """Values of the logistic map after the first ones."""
    x = [start]
    for _ in range(count):
        x.append(rate * x[-1] * (1.0 - x[-1]))
    return np.array(x[dropped:])


def spiral(size, angle, count=101):
    """A point that turns by an angle a cycle at a distance, which may fall."""
    w = size * np.exp(1j * angle * np.arange(count))
    return cycles_through(np.stack([40.0 + 100.0 * w.real, 0.1 + 0.05 * w.imag, 30.0 * w.imag], axis=1))


def torus(rotation, size):
    phase = 2.0 * math.pi * rotation * N
    return cycles_through(np.stack([40.0 + size * 30.0 * np.cos(phase), 0.1 + size * 0.03 * np.sin(phase),
                                    size * np.cos(phase)], axis=1))


N, LONG = np.arange(101), np.arange(301)
ALTERNATING = (-1.0) ** np.arange(600)
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
MOTIONS = {
    "period 17, beyond the longest": ([0], None, [embedded(np.tile(np.random.default_rng(17).uniform(-1, 1, 17), 20))]),
    "slow geometric settling": ([1], False, [embedded(0.3 * m**N) for m in (0.97, -0.97, 0.985)]),
    "fast geometric settling": ([1], True, [embedded(0.3 * 0.8**N)]),
    "a converging spiral": ([1], None, [spiral(0.2 * 0.97**N, a) for a in (0.1, 0.7, 2.0, 2.0 * math.pi * 0.618)]),
    "settling towards period two": ([2], None, [embedded(0.2 * ALTERNATING[:121] + 0.3 * 0.97 ** np.arange(121))]),
    "a small splitting": ([2], None, [embedded(0.01 * ALTERNATING[:101])]),
    "the logistic map in its chaos": ([0], None, [embedded(logistic(rate, start + 1e-3, 150, 50)) for rate in (
        3.7, 3.9, 4.0) for start in np.linspace(0.05, 0.95, 15)]),
    "narrow-banded chaos": ([0], None, [embedded(width * logistic(3.9, 0.3, 150, 50) + 0.5 * ALTERNATING[:101])
                                        for width in (1.0, 0.01, 0.001)]),
    "a rotation on a torus": ([0], None, [torus(rotation, size) for size in (1.0, 0.05) for rotation in (
        GOLDEN, math.sqrt(2.0) - 1.0, 1.0 / 3.0 + 1e-3, math.pi - 3.0)]),
    "a spiral onto a torus": ([0], None, [spiral(0.05 + 0.05 * 0.97**N, 0.9)]),
    "a steady drift": ([0], None, [embedded(1e-4 * N)]),
    # Points that are together within the tolerance, and part: a start beside an unstable motion.
    "a motion on its way elsewhere": ([0], False, [embedded(1e-9 * 1.12**N)]),
    # It leaves period two at a growing rate and reaches a larger one in the last third of the run.
    "a motion that left another and has arrived": ([2], True, [embedded(0.5 + 0.5 * np.where(
        LONG[:190] < 136, 1e-3 * 1.04 ** LONG[:190], 0.5) * ALTERNATING[:190])]),
    # Of chaos in two bands, then of period two: the fall from one to the other has ended.
    "a transient of larger differences": ([2], True, [embedded(np.where(
        np.arange(551) < end, 0.5 * ALTERNATING[:551] + 0.02 * logistic(3.95, 0.3, 550, 0), 0.48 * ALTERNATING[:551]))
        for end in (300, 320, 340, 400)]),
    # Just behind a period doubling: differences two cycles apart alternate and fall slowly, but not to nothing.
    "a decay that leaves period four": ([4], None, [embedded(
        0.75 * ALTERNATING[:n] + (left + 0.04 * np.exp(-rate * LONG[:n])) * np.cos(0.5 * math.pi * LONG[:n] + 0.3))
        for left in (0.06, 0.09, 0.1) for rate in (0.006, 0.012) for n in (101, 151, 201, 251)]),
    # Over the last whole multiples of a longer period it is a little less than over those of a shorter one.
    "a drift just above the tolerance": ([0], False, [embedded(0.5 * ALTERNATING[:251] * (0.25 + drift * LONG[:251]))
                                                      for drift in (7.2e-6, 7.7e-6, 8.2e-6)]),
    # Period two with a load at sqrt(2) times the frequency: after 12 cycles 16.97 of the load's have passed.
    "a torus about as large as the tolerance": ([0, 2], None, [embedded(
        0.5 * ALTERNATING[:301] + size * np.cos(2.0 * math.sqrt(2.0) * math.pi * LONG + phase))
        for size in np.geomspace(2e-5, 2e-3, 60) for phase in (0.0, 1.0, 2.0)]),
    "an alternation that falls fast and then slowly": ([4], False, [embedded(
        np.array([0.9, -0.4, 0.5, -0.7])[N % 4] + 0.5 * (-1.0) ** (N // 4) * (slow * 0.9967**N + fast * 0.9**N))
        for fast in (4e-4, 6e-4, 8e-4, 1e-3) for slow in (8e-4, 1e-3, 1.2e-3)]),
    # Strogatz, Section 10.2: the cascade, and the window at 3.83.
    **{f"the logistic map at {rate}": ([period], None, [embedded(logistic(rate, 0.4, 1000, 900))])
       for rate, period in ((2.9, 1), (3.2, 2), (3.5, 4), (3.55, 8), (3.83, 3))}}


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_have_the_period_that_they_have_in_the_limit(name):
    periods, settled, motions = MOTIONS[name]
    for cycles in motions:
        repetition = periodicity(cycles)
        assert repetition.period in periods
        assert settled in (None, repetition.settled)


def test_gaps_only_the_cycles_after_the_last_count():
    rng = np.random.default_rng(3)
    values = np.concatenate([rng.uniform(-1.0, 1.0, 20), [math.nan], np.tile([0.2, -0.4, 0.9], 20)])
    cycles = embedded(values)
    cycles.highest[[19, 20]] = math.nan
    assert periodicity(cycles).period == 3


@pytest.mark.parametrize(("after", "period"), [(5, 0), (15, 0), (16, 1), (30, 1)])
def test_a_period_takes_enough_cycles_after_the_last_gap(after, period):
    """A constant section for so many cycles: fewer may repeat by chance."""
    cycles = embedded(np.concatenate([np.linspace(0.0, 0.5, 30), np.full(after + 1, 0.5)]))
    cycles.highest[29] = math.nan
    assert (periodicity(cycles).period, periodicity(cycles).settled) == (period, bool(period))


@pytest.mark.parametrize("count", range(4, 40))
def test_an_alternation_that_dies_out_is_no_period_two_in_however_few_cycles(count):
    """Within the tolerance two cycles apart, and beyond it one cycle apart."""
    points = 0.5 + 4e-3 * (-0.97) ** np.arange(count)
    repetition = periodicity(embedded(points), 1e-3)
    assert (repetition.period, repetition.settled) != (2, True)


@pytest.mark.parametrize(("tolerance", "count"), [(1e-4, 30), (1e-4, 50), (2e-3, 30)])
def test_what_falls_below_the_tolerance_while_it_is_looked_at_is_no_longer_period(tolerance, count):
    """Decaying swings of three modes about one point: the differences one cycle apart end last."""
    k = np.arange(count + 1)
    for decay in np.linspace(0.3, 0.95, 7):
        for angle in np.linspace(0.05, 3.1, 8):
            for second in (-0.9, -0.7, -0.5, -0.12, 0.3):
                swing, other = decay**k * np.exp(1j * angle * k), second**k
                repetition = periodicity(cycles_through(
                    np.stack([1.0 + swing.real + other, 1.0 + 0.5 * swing.imag, 1.0 - other], axis=1)), tolerance)
                assert repetition.period == 1 or not repetition.settled


def test_further_cycles_stay_on_a_period_in_its_own_phase():
    pattern = np.array([0.3, -0.2, 0.9])
    kept, further = embedded(np.tile(pattern, 30)[:62]), np.tile(pattern, 30)[61:75]
    assert stays(kept, embedded(further), 3)
    assert not stays(kept, embedded(np.roll(further, 1)), 3)
    moved = further.copy()
    moved[9] += 1e-3
    assert not stays(kept, embedded(moved), 3)
    assert stays(kept, embedded(moved), 3, tolerance=1e-2)


@pytest.mark.parametrize(("period", "further"), [(1, 10), (16, 32)])
def test_a_section_that_repeats_finely_would_not_leave_in_the_cycles_that_need_not_be_seen(period, further):
    count = 5 * further // 2
    n = np.arange(count + period + further + 1)
    orbit = np.resize(np.random.default_rng(period).uniform(0.2, 1.0, period), len(n))
    growing = [orbit + 1e-16 * growth ** n for growth in np.geomspace(1.0, 10.0, 400)]
    fine = [values for values in growing if repeats_finely(embedded(values[:-further]), period, count)]
    assert 0 < len(fine) < len(growing)
    assert all(stays(embedded(values[:-further]), embedded(values[-further - 1:]), period) for values in fine)
    assert not repeats_finely(embedded(orbit[:count]), period, count)


def test_speeds_that_are_roundings_at_rest_are_no_motion():
    speed = 1e-15 * np.random.default_rng(0).choice([-1.0, 0.3, 2.0], 101)
    section = np.stack([0.0 * speed, 0.0063 + speed / 10.0, speed], axis=1)
    rest = np.zeros(100)
    repetition = periodicity(Cycles(section, rest, rest, rest))
    assert (repetition.period, repetition.settled) == (1, True)
    assert repetition.change < 1e-6


@pytest.mark.parametrize("angle", [2.0 * math.pi / 3.0 + 0.002, 2.0 * math.pi / 5.0 - 0.001])
@pytest.mark.parametrize("rate", [0.98, 0.99])
def test_a_spiral_near_a_resonance_has_no_multiple_of_its_period(angle, rate):
    n = np.arange(101)
    for size in (1e-4, 1e-3, 1e-2, 0.05):
        w = size * rate**n * np.exp(1j * angle * n)
        section = np.stack([40.0 + 100.0 * w.real, 0.1 + 0.05 * w.imag, 30.0 * w.imag], axis=1)
        repetition = periodicity(cycles_through(section))
        assert repetition.period in (0, 1)
        assert not repetition.settled or size == 1e-4


def test_too_few_points_have_a_change_and_no_period():
    points = np.array([[0.0, 0.0, 0.0], [0.2, -0.5, 0.1]])
    assert of_points(points, 0, 1e-4) == Periodicity(0, False, 0.5, 0)
    assert math.isnan(of_points(points[:1], 1, 1e-4).change)
    assert of_points(np.ones((3, 3)), 1, 1e-4) == Periodicity(1, True, 0.0, 1)
