"""Turning points and swings of corners set by hand, and whole sentences of verdicts on errors of known form."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.loop_verdict import (
    Errors,
    LoopVerdict,
    Swings,
    _without_forced,
    loop_verdict,
    swings_of,
    turning_points,
)

CYCLE = 0.04


@pytest.mark.parametrize(("values", "reversal", "places"), [
    ([], 0.5, []), ([3.0], 0.5, []), ([0, 1, 2, 1, 0, 1, 3, 1], 0.5, [0, 2, 4, 6]), ([3, 1, 2], 0.5, [0, 1]),
    ([0, 1, 0], 1.0, []), ([0, 1, 0], 0.99, [0, 1]), ([0, 2, 2, 0], 1.0, [0, 1]), ([2, 0, 0, 2], 1.0, [0, 1]),
    ([0, 3, 2.2, 4, 0, 0.7, -1, 5], 1.0, [0, 3, 6]), ([1, 1, 1], 0.5, []), ([0, 0.4, -0.3, 0.3, 2], 0.5, [1, 2]),
    ([5, 5.2, 4.9, 3, 4.5, 2, 6], 1.2, [1, 3, 4, 5])])
def test_turning_points_are_the_extremes_that_a_reversal_confirms(values, reversal, places):
    assert turning_points(np.array(values, dtype=float), reversal).tolist() == places
    assert turning_points(-np.array(values, dtype=float), reversal).tolist() == places


@pytest.mark.parametrize(("durations", "period"), [
    ([1.5], 3.0), ([1.0, 2.0], 3.0), ([1.0, 2.0, 3.0], 5.0), ([1.0, 2.0, 3.0, 5.0], 5.0),
    ([9.0, 9.0, 1.0, 2.0, 1.0, 3.0, 1.0, 2.0], 3.0)])
def test_the_period_is_the_upper_median_of_the_last_pairs(durations, period):
    swings = Swings(np.ones(len(durations)), np.array(durations), 2.0 * period - 1e-9)
    assert (swings.period, swings.alive) == (period, True)
    assert not swings._replace(quiet=2.0 * period).alive
    assert not swings._replace(flat=True).alive


def test_without_swings_none_may_follow():
    assert not Swings(np.empty(0), np.empty(0), 0.0).alive


def corners(*points):
    """Samples every 10 ms of straight lines between corners (t, value)."""
    t, values = np.array(points, dtype=float).T
    times = np.arange(round(100.0 * t[-1]) + 1) / 100.0
    return times, np.interp(times, t, values)


ZIGZAG = (0.0, 0.3), (0.5, 2.0), (1.1, -1.0), (1.6, 1.5), (2.3, -1.2), (2.9, 1.4), (3.4, -0.9)
SIZES, DURATIONS = np.array([3.0, 2.5, 2.7, 2.6, 2.3]), np.array([0.6, 0.5, 0.7, 0.6, 0.5])


@pytest.mark.parametrize(("start", "end", "from_start", "head", "tail"), [
    (0.3, -0.5, False, None, None), (0.3, -0.5, True, None, None), (-0.6, -0.5, True, (2.6, 0.5), None),
    (-0.6, -0.5, False, None, None), (0.3, 1.3, False, None, (2.2, 0.4)), (-0.6, 1.1, True, (2.6, 0.5), None)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_swings_are_those_between_corners(start, end, from_start, head, tail, sign):
    """An end counts from 0.8 of the median size of the swings between, 2.6, on: 2.08."""
    t, signal = corners((0.0, start), *ZIGZAG[1:-1], (3.4, -0.9), (3.8, end))
    swings = swings_of(t, sign * signal, 0.1, from_start)
    ends = [x for x in (head, tail) if x]
    sizes = np.concatenate([[x[0] for x in ends if x is head], SIZES, [x[0] for x in ends if x is tail]])
    durations = np.concatenate([[x[1] for x in ends if x is head], DURATIONS, [x[1] for x in ends if x is tail]])
    assert swings.sizes == pytest.approx(sizes)
    assert swings.durations == pytest.approx(durations)
    assert swings.quiet == pytest.approx(0.0 if tail else 0.4)
    assert (swings.cut, swings.flat) == (tail is not None, False)


def test_no_swing_leads_to_a_first_extreme_beside_the_start():
    """It begins 0.3 below its first maximum, less than a reversal of an eighth of 2.5."""
    t, signal = corners((0.0, 1.7), *ZIGZAG[1:], (3.8, -0.5))
    assert swings_of(t, signal, 0.1).durations == pytest.approx(DURATIONS[1:])
    assert swings_of(t, signal, 0.29).durations == pytest.approx(DURATIONS[1:])
    assert swings_of(t, signal, 3.5).sizes.size == 0
    assert swings_of(t[:0], signal[:0], 0.1).quiet == math.inf


def test_a_few_events_with_rest_between_them_are_flat():
    rest = [(0.0, 0.0), (1.0, 0.0), (1.1, 2.0), (1.2, 0.0), (3.0, 0.0), (3.1, 2.0), (3.2, 0.0), (4.0, 0.0)]
    assert swings_of(*corners(*rest), 0.1).flat
    more = [(t + shift, v) for shift in (0.0, 4.0) for t, v in rest]
    assert not swings_of(*corners(*more), 0.1).flat  # Six swings.
    assert not swings_of(*corners((0.0, 0.0), *((0.5 * k, 2.0 * (k % 2)) for k in range(1, 6))), 0.1).flat


def errors_of(signal, seconds, step=0.0, band=0.12345, floor=0.1, reference=lambda t: 20.0 + 0.0 * t):
    """Errors of whole cycles of 40 ms."""
    starts = np.arange(round(seconds / CYCLE)) * CYCLE
    t = starts + 0.5 * CYCLE
    return Errors(t, signal(t), reference(t), starts, starts + CYCLE, step, band, floor)


def wave(size, period, rate=0.0, lead=0.3):
    return lambda t: size * np.exp(rate * t) * np.sin(2.0 * math.pi * t / period + lead)


SETTLED, HUNTING, GROWING, SHORT, OFF = (LoopVerdict(x) for x in (
    "settled", "hunting", "growing", "too short", "off target"))
VERDICTS = {
    "in the band": (errors_of(lambda t: 0.05 + 0.0 * t, 10.24), SETTLED, "within 0.123 rad/s for the last 10.2 s", 0),
    "five cycles": (errors_of(lambda t: 0.05 + 0.0 * t, 0.2), SETTLED, "within 0.123 rad/s for the last 0.2 s", 0),
    "four cycles": (errors_of(lambda t: 0.05 + 0.0 * t, 0.16), SHORT,
                    "4 whole periods of excitation; a verdict needs 5", -1),
    "an approach": (errors_of(lambda t: -30.0 * np.exp(-t / 0.2), 3.0, 30.0, 0.6), SETTLED,
                    "within 0.6 rad/s for the last 2.2 s", 20),
    "a decay": (errors_of(wave(2.0, 1.6, -0.6), 8.0), SETTLED, "within 0.123 rad/s for the last 3.56 s", 111),
    "a swing of 1.6 s": (errors_of(wave(2.0, 1.6), 8.0), HUNTING,
                         "the mean oscillates by +-2 rad/s with a period of 1.6 s", -1),
    "a wave that grows": (errors_of(wave(0.5, 0.8, 0.4, 0.0), 6.0), GROWING,
                          "an oscillation with a period of 0.8 s grows by a factor of 1.49 per second, to +-4.69 rad/s",
                          -1),
    # exp(0.3 t) between the centres of the last block of 0.12 s and of that 1.32 s before.
    "away": (errors_of(lambda t: 3.0 * np.exp(0.3 * t), 4.0), GROWING,
             "the error grows to the end, last by 2.42 rad/s per second", -1),
    "away below": (errors_of(lambda t: -3.0 * np.exp(0.3 * t), 4.0), GROWING,
                   "the error grows to the end, last by 2.42 rad/s per second", -1),
    # The mean of the last third and a cycle, from 3.96 s on.
    "beside it": (errors_of(lambda t: 3.0 - 0.05 * t, 6.0), OFF, "the mean stays 2.75 rad/s above the target", -1),
    "below it": (errors_of(lambda t: 0.05 * t - 3.0, 6.0), OFF, "the mean stays 2.75 rad/s below the target", -1),
    "on its way": (errors_of(lambda t: 3.0 * np.exp(-t / 2.5), 4.0), SHORT,
                   "still moving at the end, 0.611 rad/s above the target", -1),
    "on its way from below": (errors_of(lambda t: -3.0 * np.exp(-t / 2.5), 4.0), SHORT,
                              "still moving at the end, 0.611 rad/s below the target", -1),
    "through the band": (errors_of(lambda t: 0.09 - 0.02 * t, 6.0), SHORT,
                         "within 0.123 rad/s for the last 6 s, but still moving through this band", -1),
    "a last swing": (errors_of(wave(3.0, 3.0, -0.8, 0.5 * math.pi), 4.0), SHORT,
                     "within 0.123 rad/s for the last 0.56 s, less than 1 period of an oscillation of 2.8 s", -1),
    "a swing that decays slowly": (errors_of(wave(3.0, 0.8, -0.15), 6.0), SHORT,
                                   "an oscillation with a period of 0.8 s has not decayed", -1),
    "a slow swing in the band": (errors_of(wave(0.08, 1.0), 8.0, floor=0.05), HUNTING,
                                 "the mean oscillates by +-0.08 rad/s with a period of 1 s", -1),
    # An approach to 0.11, and one to 0.16, of which 0.115 is reached.
    "to a value in the band": (errors_of(lambda t: 0.11 - 0.1 * np.exp(-t / 3.0), 6.0), SETTLED,
                               "within 0.123 rad/s for the last 6 s", 0),
    "to a value beyond the band": (errors_of(lambda t: 0.16 - 0.15 * np.exp(-t / 5.0), 6.0), SHORT,
                                   "within 0.123 rad/s for the last 6 s, but still moving through this band", -1),
    "turned in the band": (errors_of(lambda t: np.interp(t, [0.0, 0.4, 6.0], [0.02, -0.03, 0.1]), 6.0, band=0.11),
                           SETTLED, "within 0.11 rad/s for the last 6 s", 0),
    "at rest, then away": (errors_of(lambda t: 0.4 + 1.3 * np.maximum(t - 3.2, 0.0), 6.4), GROWING,
                           "the error grows to the end, last by 1.3 rad/s per second", -1),
    # 2.5/sinc(0.05): a mean over a twentieth of the period is so much smaller than its amplitude.
    "two sizes": (errors_of(lambda t: wave(1.0, 0.8, 0.0, math.pi / 20.0)(t) * np.where(t < 3.2, 1.0, 2.5), 6.4),
                  HUNTING, "the mean oscillates by +-2.51 rad/s with a period of 0.8 s", -1),
    "a lag": (errors_of(wave(-0.6, 2.0, 0.0, 0.5 * math.pi), 6.0,
                        reference=lambda t: 20.0 + 5.0 * np.sin(math.pi * t)), OFF,
              "the error follows the moving target, by up to 0.599 rad/s", -1)}


@pytest.mark.parametrize("name", VERDICTS)
def test_a_verdict_says_why_in_a_whole_sentence(name):
    errors, verdict, why, since = VERDICTS[name]
    judged = loop_verdict(errors, float(errors.ends[-1]))
    assert (judged.verdict, judged.why, judged.since) == (verdict, why, since)
    if verdict is HUNTING or why.startswith("an oscillation with a period of 0.8 s grows"):
        assert math.isfinite(judged.amplitude)
        assert f"+-{judged.amplitude:.3g} rad/s" in why
        assert f"period of {judged.period:.3g} s" in why
    else:
        assert math.isnan(judged.amplitude)
        assert math.isnan(judged.period)


@pytest.mark.parametrize(("step", "error", "arrived", "inside"), [
    (0.0, [5.0, 0.0, 0.05], 0, 1), (4.0, [-5.0, -0.2, 0.3, -0.05], 2, 3), (-4.0, [5.0, 0.1, -0.3], 1, 3),
    (4.0, [-5.0, -3.0, -2.0], 3, 3), (0.2, [-5.0, -3.0, -2.0], 0, 3), (0.3, [-5.0, 0.0, 0.0], 1, 1)])
def test_a_mean_has_arrived_where_it_is_in_the_band_or_beyond_the_target(step, error, arrived, inside):
    x = np.array(error)
    errors = Errors(x, x, x, x, x, step, 0.1, 0.2)
    assert (errors.arrived, errors.inside_from) == (arrived, inside)


@pytest.mark.parametrize("first", [0, 1, 4])
def test_a_moving_target_and_its_rate_explain_an_error_but_for_a_fifth_of_its_variance(first):
    """From the second cycle on; what they do not explain is left in every cycle."""
    t = CYCLE * np.arange(40.0)
    reference, since = 20.0 + 5.0 * np.sin(3.0 * t), max(first, 1)
    columns = np.stack([np.ones(40), reference, np.gradient(reference, t)], axis=1)
    rest = np.sin(29.0 * t) + 0.3 * t
    rest -= columns @ np.linalg.lstsq(columns[since:], rest[since:], rcond=None)[0]
    forced = columns @ [0.4, -0.3, 0.05]
    variances = [float(np.sum((x[since:] - x[since:].mean()) ** 2)) for x in (forced, rest)]
    for share, explained in ((0.19, True), (0.21, False)):
        size = math.sqrt(share / (1.0 - share) * variances[0] / variances[1])
        error = forced + size * rest
        errors = Errors(t, error, reference, t, t + CYCLE, 0.0, 0.1, 0.1)
        left, follows = _without_forced(errors, first)
        assert follows == explained
        assert left == pytest.approx(size * rest if explained else error, abs=1e-9)
    for count, floor, follows in ((since + 9, 0.1, False), (since + 10, 0.1, True), (40, 11.0, False)):
        some = Errors(*(x[:count] for x in (t, forced, reference, t, t + CYCLE)), 0.0, 0.1, floor)
        assert _without_forced(some, first)[1] == follows
