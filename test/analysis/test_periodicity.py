"""Sections made by hand, of known period, and motions that have none."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.periodicity import periodicity, repeats_finely, stays
from tcc_sim.trajectory import Cycles


def cycles_through(points):
    section = np.asarray(points, dtype=float)
    n = len(section) - 1
    return Cycles(section, np.full(n, 120.0), np.full(n, -3.0), np.zeros(n))


def embedded(values):
    """A scalar sequence as section points of a motion whose slip reaches 120 rad/s."""
    x = np.asarray(values, dtype=float)
    return cycles_through(np.stack([40.0 + 30.0 * x, 0.1 + 0.05 * x, 10.0 - 20.0 * x], axis=1))


@pytest.mark.parametrize("period", [1, 2, 3, 5, 11, 16])
def test_finds_the_period_of_a_repeating_section(period):
    pattern = np.random.default_rng(period).uniform(-1.0, 1.0, period)
    found = periodicity(embedded(np.tile(pattern, 40)[:101]))
    assert (found.period, found.settled) == (period, True)


def test_period_17_is_beyond_what_is_looked_for():
    pattern = np.random.default_rng(17).uniform(-1.0, 1.0, 17)
    assert periodicity(embedded(np.tile(pattern, 20))).period == 0


@pytest.mark.parametrize("multiplier", [0.97, -0.97, 0.985, 0.8])
def test_slow_geometric_settling_is_period_one_and_says_so(multiplier):
    n = np.arange(101)
    found = periodicity(embedded(0.3 * multiplier ** n))
    assert found.period == 1
    assert found.settled == (abs(multiplier) < 0.9)


@pytest.mark.parametrize("angle", [0.1, 0.7, 2.0, 2.0 * math.pi * 0.618])
def test_a_converging_spiral_is_period_one(angle):
    n = np.arange(101)
    w = 0.2 * 0.97 ** n * np.exp(1j * angle * n)
    section = np.stack([40.0 + 100.0 * w.real, 0.1 + 0.05 * w.imag, 30.0 * w.imag], axis=1)
    assert periodicity(cycles_through(section)).period == 1


def test_settling_towards_period_two_is_period_two():
    n = np.arange(121)
    assert periodicity(embedded(0.2 * (-1.0) ** n + 0.3 * 0.97 ** n)).period == 2


def test_a_small_splitting_is_not_lost():
    n = np.arange(101)
    assert periodicity(embedded(0.01 * (-1.0) ** n)).period == 2


@pytest.mark.parametrize("start", np.linspace(0.05, 0.95, 15))
@pytest.mark.parametrize("rate", [3.7, 3.9, 4.0])
def test_the_logistic_map_in_its_chaos_has_no_period(rate, start):
    x = [start + 1e-3]
    for _ in range(150):
        x.append(rate * x[-1] * (1.0 - x[-1]))
    assert periodicity(embedded(x[50:])).period == 0


@pytest.mark.parametrize("width", [1.0, 0.01, 0.001])
def test_narrow_banded_chaos_has_no_period(width):
    x = [0.3]
    for _ in range(150):
        x.append(3.9 * x[-1] * (1.0 - x[-1]))
    assert periodicity(embedded(width * np.array(x[50:]) + 0.5 * (-1.0) ** np.arange(101))).period == 0


def test_the_logistic_map_cascade_has_the_periods_of_the_textbook():
    """Periods 1, 2, 4, 8 at r = 2.9, 3.2, 3.5, 3.55, and 3 in the window at 3.83 (Strogatz, Section 10.2)."""
    for rate, period in [(2.9, 1), (3.2, 2), (3.5, 4), (3.55, 8), (3.83, 3)]:
        x = [0.4]
        for _ in range(1000):
            x.append(rate * x[-1] * (1.0 - x[-1]))
        assert periodicity(embedded(x[-101:])).period == period


@pytest.mark.parametrize("rotation",
                         [(math.sqrt(5.0) - 1.0) / 2.0, math.sqrt(2.0) - 1.0, 1.0 / 3.0 + 1e-3, math.pi - 3.0])
@pytest.mark.parametrize("size", [1.0, 0.05])
def test_a_rotation_on_a_torus_has_no_period(rotation, size):
    phase = 2.0 * math.pi * rotation * np.arange(101)
    section = np.stack([40.0 + size * 30.0 * np.cos(phase), 0.1 + size * 0.03 * np.sin(phase), size * np.cos(phase)],
                       axis=1)
    assert periodicity(cycles_through(section)).period == 0


def test_a_steady_drift_has_no_period():
    assert periodicity(embedded(1e-4 * np.arange(101))).period == 0


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
    found = periodicity(embedded(points), 1e-3)
    assert (found.period, found.settled) != (2, True)


@pytest.mark.parametrize(("tolerance", "count"), [(1e-4, 30), (1e-4, 50), (2e-3, 30)])
def test_what_falls_below_the_tolerance_while_it_is_looked_at_is_no_longer_period(tolerance, count):
    """Decaying swings of three modes about one point: the differences one cycle apart end last."""
    k = np.arange(count + 1)
    for decay in np.linspace(0.3, 0.95, 14):
        for angle in np.linspace(0.05, 3.1, 16):
            for second in (-0.9, -0.7, -0.5, -0.12, 0.3):
                swing, other = decay**k * np.exp(1j * angle * k), second**k
                found = periodicity(cycles_through(
                    np.stack([1.0 + swing.real + other, 1.0 + 0.5 * swing.imag, 1.0 - other], axis=1)), tolerance)
                assert found.period == 1 or not found.settled


def test_too_few_cycles_give_no_period():
    found = periodicity(embedded([0.5, 0.5]))
    assert found.period == 0
    assert periodicity(embedded([0.5])).period == 0
    assert math.isnan(periodicity(embedded([0.5])).change)


@pytest.mark.parametrize(("alternation", "period", "settled"), [
    (lambda n: 0.02 * 0.995**n, 1, False), (lambda n: 0.02 + 0.0 * n, 2, True),
    (lambda n: 0.02 + 0.002 * 0.9**n, 2, True)])
def test_an_alternation_that_dies_out_slowly_is_no_period_two(alternation, period, settled):
    n = np.arange(60)
    section = np.stack([0.0 * n, 1.0 + (-1.0) ** n * alternation(n), 0.0 * n], axis=1)
    found = periodicity(Cycles(section, np.ones(59), np.zeros(59), np.zeros(59)), tolerance=1e-2)
    assert (found.period, found.settled) == (period, settled)


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


def test_a_motion_on_its_way_elsewhere_has_no_period_yet():
    """Together within the tolerance, and parting: a start beside an unstable motion."""
    n = np.arange(101)
    found = periodicity(embedded(1e-9 * 1.12 ** n))
    assert (found.period, found.settled) == (0, False)


def test_a_motion_that_left_another_and_has_arrived_has_its_period():
    """It leaves period two at a growing rate until, in the last third of the run, it comes to a larger one."""
    n = np.arange(190)
    apart = np.where(n < 136, 1e-3 * 1.04**n, 0.5)
    found = periodicity(embedded(0.5 + 0.5 * apart * (-1.0) ** n))
    assert (found.period, found.settled) == (2, True)


@pytest.mark.parametrize("end", [300, 320, 340, 400])
def test_a_transient_of_larger_differences_does_not_hide_the_period_behind_it(end):
    """Of chaos in two bands, then of period two: the fall from one to the other has ended."""
    logistic = [0.3]
    for _ in range(550):
        logistic.append(3.95 * logistic[-1] * (1.0 - logistic[-1]))
    n = np.arange(551)
    found = periodicity(embedded(np.where(n < end, 0.5 * (-1.0) ** n + 0.02 * np.array(logistic), 0.48 * (-1.0) ** n)))
    assert (found.period, found.settled) == (2, True)


@pytest.mark.parametrize("left", [0.06, 0.09, 0.1])
@pytest.mark.parametrize("rate", [0.006, 0.012])
@pytest.mark.parametrize("count", [101, 151, 201, 251])
def test_a_decay_that_leaves_period_four_is_not_taken_for_one_to_period_two(left, rate, count):
    """Just behind a period doubling: the differences two cycles apart alternate and fall slowly, but not to nothing."""
    n = np.arange(count)
    found = periodicity(embedded(
        0.75 * (-1.0) ** n + (left + 0.04 * np.exp(-rate * n)) * np.cos(0.5 * math.pi * n + 0.3)))
    assert found.period == 4


@pytest.mark.parametrize("drift", [7.2e-6, 7.7e-6, 8.2e-6])
def test_a_drift_just_above_the_tolerance_gives_no_multiple_of_the_period(drift):
    """Over the last whole multiples of a longer period it is a little less than over those of a shorter one."""
    n = np.arange(251)
    found = periodicity(embedded(0.5 * (-1.0) ** n * (0.25 + drift * n)))
    assert (found.period, found.settled) == (0, False)


def test_a_torus_about_as_large_as_the_tolerance_has_no_period_by_chance():
    """Period two with a load at sqrt(2) times the frequency: after 12 cycles 16.97 of the load's have passed."""
    n = np.arange(301)
    for size in np.geomspace(2e-5, 2e-3, 60):
        for phase in (0.0, 1.0, 2.0):
            found = periodicity(embedded(0.5 * (-1.0) ** n + size * np.cos(2.0 * math.sqrt(2.0) * math.pi * n + phase)))
            assert found.period in (0, 2)


@pytest.mark.parametrize("fast", [4e-4, 6e-4, 8e-4, 1e-3])
@pytest.mark.parametrize("slow", [8e-4, 1e-3, 1.2e-3])
def test_an_alternation_that_falls_fast_and_then_slowly_is_no_doubled_period(fast, slow):
    n = np.arange(101)
    splitting = 0.5 * (-1.0) ** (n // 4) * (slow * 0.9967**n + fast * 0.9**n)
    found = periodicity(embedded(np.array([0.9, -0.4, 0.5, -0.7])[n % 4] + splitting))
    assert (found.period, found.settled) == (4, False)


def test_speeds_that_are_roundings_at_rest_are_no_motion():
    speed = 1e-15 * np.random.default_rng(0).choice([-1.0, 0.3, 2.0], 101)
    section = np.stack([0.0 * speed, 0.0063 + speed / 10.0, speed], axis=1)
    rest = np.zeros(100)
    found = periodicity(Cycles(section, rest, rest, rest))
    assert (found.period, found.settled) == (1, True)
    assert found.change < 1e-6


@pytest.mark.parametrize("angle", [2.0 * math.pi / 3.0 + 0.002, 2.0 * math.pi / 5.0 - 0.001])
@pytest.mark.parametrize("rate", [0.98, 0.99])
def test_a_spiral_near_a_resonance_has_no_multiple_of_its_period(angle, rate):
    n = np.arange(101)
    for size in (1e-4, 1e-3, 1e-2, 0.05):
        w = size * rate**n * np.exp(1j * angle * n)
        section = np.stack([40.0 + 100.0 * w.real, 0.1 + 0.05 * w.imag, 30.0 * w.imag], axis=1)
        found = periodicity(cycles_through(section))
        assert found.period in (0, 1)
        assert not found.settled or size == 1e-4


def test_a_spiral_onto_a_torus_has_no_period():
    n = np.arange(101)
    w = (0.05 + 0.05 * 0.97**n) * np.exp(0.9j * n)
    section = np.stack([40.0 + 100.0 * w.real, 0.1 + 0.05 * w.imag, 30.0 * w.imag], axis=1)
    assert periodicity(cycles_through(section)).period == 0
