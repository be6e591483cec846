"""Compiled judgement of section points: with which period they repeat, now or in the limit of a decay.

`periodicity` states the rules. A kernel judges any number of runs of one length in a call, which other threads do not
wait for. `points` are those of one run, (n, 3), in units of the motion's size; a range of them is `low` to `high`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import compiled
from tcc_sim.trajectory import Floats

LONGEST = 16  # Longest period looked for, periods of excitation.
MODES = 3  # Most modes of a decay: the section has three coordinates.
NEAR = 0.25  # Largest change over a period at the end of a run that still settles, relative to the size of the motion.
DISTANCE = 0.1  # Largest distance of such a run from its limit, relative to the size of the motion.
SAME = 0.05  # Largest distance of two points of the limit that count as one, relative to the remaining distance.
MISFIT = 0.02  # Largest misfit of a decay, relative to its own size.
EXACT = 1e-3  # Misfit at which fewer modes are enough.
LEAST_SHRINKING = 0.95  # Largest part of a difference that a decay leaves over a third of the run.
LEAST_DECAY = 0.05  # Least natural logarithm of a decay over the run that distinguishes it from a lasting motion.
DOUBTFUL = 0.5
"""A difference may vanish in the limit if its decay leaves less than this part of it; a decay whose rate falls below
this part within the run may end before.
"""
SHRINKING = 0.02  # Least shrinking over the run, relative to the remaining difference.
ENDED = 0.01
"""A fall of a difference has ended if it varies by less than this part of its last third's fall while the period
repeats.
"""
GROWTH = 2.0  # Growth of a difference from a third of the run to the next, twice, that shows a departing motion.
ROUNDING = 2.3e-16
"""Part of a column, per row, below which what others leave of it is rounding."""
BISECTIONS = 1100
"""Most halvings of an interval between two numbers."""
NONE, DOUBT = -1, 0
"""No limit; a limit without a certain period."""


@compiled
def difference_of(points: Any, i: int, j: int) -> float:
    """Return the largest difference of a coordinate of two points."""
    return float(max(abs(points[i, 0] - points[j, 0]), abs(points[i, 1] - points[j, 1]),
                     abs(points[i, 2] - points[j, 2])))


@compiled
def largest_apart(points: Any, lag: int, low: int, high: int) -> float:
    """Return the largest difference of points i + lag and i for i from `low` to `high`; 0 for none."""
    out = 0.0
    for i in range(low, high):
        out = max(out, difference_of(points, i + lag, i))
    return out


@compiled
def thirds(points: Any, low: int, high: int, lag: int, multiple: int) -> tuple[float, float, float]:
    """Return the largest difference of points `lag` apart in each third of a range, of whole multiples of `multiple`;
    -1 for too few points.
    """
    count = high - low - lag
    width = count // 3 // multiple * multiple if count > 0 else 0
    if width == 0:
        return -1.0, -1.0, -1.0
    first = low + count - 3 * width
    return (largest_apart(points, lag, first, first + width),
            largest_apart(points, lag, first + width, first + 2 * width),
            largest_apart(points, lag, first + 2 * width, first + 3 * width))


@compiled
def periods_compared(count: int, period: int) -> int:
    """Return the number of periods in the last quarter of a run of so many points, at least three."""
    return max(3, count // 4 // period)


@compiled
def repeats_lately(points: Any, count: int, period: int, tolerance: float) -> bool:
    """Return whether points a period apart stay together over the last quarter of the run, and at least three periods.
    """
    first = count - periods_compared(count, period) * period
    for i in range(first, first + period):
        for c in range(3):
            high, low = points[i, c], points[i, c]
            for k in range(i + period, count, period):
                high, low = max(high, points[k, c]), min(low, points[k, c])
            if high - low > tolerance:
                return False
    return True


@compiled
def first_compared(count: int, lag: int, period: int) -> int:
    """Return the first index from which `repeats_lately` compares differences of points `lag` apart."""
    return max(0, count - lag - periods_compared(count, period) * period)


@compiled
def last_change(points: Any, count: int, period: int) -> float:
    """Return the largest difference between the last two periods."""
    return largest_apart(points, period, max(count - 2 * period, 0), count - period)


@compiled
def vanishes(a: float, b: float, c: float) -> bool:
    """Return whether three successive sizes may decay to zero, by A. C. Aitken's delta-squared process."""
    if not (c < b and b < a and a - c > SHRINKING * c):
        return False
    if b - c >= a - b:
        return True
    return c - (b - c) * (b - c) / ((a - b) - (b - c)) < DOUBTFUL * c


@compiled
def may_vanish(points: Any, count: int, shorter: int, period: int, tolerance: float) -> bool:
    """Return whether the difference that distinguishes a period from a divisor is zero or may decay to zero."""
    # A slow alternation repeats after two cycles within any tolerance wider than its decay. A run too short for three
    # sizes leaves this open, and so does a difference that halves while the period repeats: it is hardly above the
    # tolerance. A constant difference fell in the transient before, and its fall has ended. A divisor may drift by a
    # little more than the tolerance, and its multiple, over fewer cycles, by a little less; so may a small torus.
    a, b, c = thirds(points, 0, count, shorter, period)
    if a < 0.0:
        return True
    first, end = first_compared(count, shorter, period), count - shorter
    whole = largest_apart(points, period, first_compared(count, period, period), count - period)
    if largest_apart(points, shorter, first, end) <= max(tolerance, 10.0 * whole):
        return True
    if (largest_apart(points, shorter, end - period, end)
            < DOUBTFUL * largest_apart(points, shorter, first, first + period)):
        return True
    most, least = 0.0, math.inf
    for i in range(first, end, period):
        size = largest_apart(points, shorter, i, i + period)
        most, least = max(most, size), min(least, size)
    if most - least < ENDED * (b - c):
        return False
    # A fast decay before a slow one hides the latter.
    d, e, f = thirds(points, count // 2, count, shorter, period)
    return vanishes(a, b, c) or (d >= 0.0 and vanishes(d, e, f))


@compiled
def grows(points: Any, count: int, period: int, tolerance: float) -> bool:
    """Return whether points that are still together separate at a growing rate up to the end of the run."""
    a, b, c = thirds(points, 0, count, period, period)
    if not (c > 0.01 * tolerance and c > GROWTH * b and b > GROWTH * a):
        return False
    return GROWTH * largest_apart(points, period, first_compared(count, period, period), count - period) > c


@compiled
def decay(points: Any, low: int, high: int, period: int, modes: int, columns: Any, triangle: Any, shares: Any) -> float:
    """Fill `shares` with the coefficients of the linear recurrence of the differences of points; return its misfit, -1
    for too few of them.

    The differences d_n = x_(n+p) - x_n of a linear map with m modes satisfy d_(n+mp) = sum_i c_i d_(n+ip). Every
    equation is scaled by its size. Least squares by the modified Gram-Schmidt process with the right side as one more
    column (A. Bjorck, BIT 7, 1967); a column that depends on those before it has no share.
    """
    count = high - low - period - modes * period
    if count < 2 * modes:
        return -1.0
    for n in range(count):
        size = 0.0
        for i in range(modes + 1):
            at = low + n + i * period
            size = max(size, difference_of(points, at + period, at))
        if not size > 0.0:
            return -1.0
        for i in range(modes + 1):
            at = low + n + i * period
            for c in range(3):
                columns[i, 3 * n + c] = (points[at + period, c] - points[at, c]) / size
    rows = 3 * count
    for j in range(modes):
        before = 0.0
        for i in range(j):
            before += triangle[i, j] * triangle[i, j]
        left = 0.0
        for k in range(rows):
            left += columns[j, k] * columns[j, k]
        length = math.sqrt(left)
        whole = math.sqrt(left + before)
        triangle[j, j] = length if length > ROUNDING * rows * whole else 0.0
        for i in range(j + 1, modes + 1):
            triangle[j, i] = 0.0
            if triangle[j, j] > 0.0:
                product = 0.0
                for k in range(rows):
                    product += columns[j, k] * columns[i, k]
                product /= length
                triangle[j, i] = product
                for k in range(rows):
                    columns[i, k] -= product / length * columns[j, k]
    for j in range(modes - 1, -1, -1):
        share = triangle[j, modes]
        for i in range(j + 1, modes):
            share -= triangle[j, i] * shares[i]
        shares[j] = share / triangle[j, j] if triangle[j, j] > 0.0 else 0.0
    square = 0.0
    for k in range(rows):
        square += columns[modes, k] * columns[modes, k]
    return math.sqrt(square / rows)


@compiled
def larger_root(b: float, c: float) -> float:
    """Return the largest modulus of the roots of z^2 + b z + c."""
    square = 0.25 * b * b - c
    return math.sqrt(c) if square < 0.0 else 0.5 * abs(b) + math.sqrt(square)


@compiled
def rate_of(shares: Any, modes: int) -> float:
    """Return the decay rate of a recurrence per period, by the roots of z^m - sum_i c_i z^i."""
    if modes == 1:
        largest = abs(shares[0])
    elif modes == 2:
        largest = larger_root(-shares[1], -shares[0])
    else:
        # A real root within Cauchy's bound, by bisection, and the two of the other factor.
        a, b, c = -shares[2], -shares[1], -shares[0]
        bound = 1.0 + max(abs(a), abs(b), abs(c))
        low, high = -bound, bound
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if ((middle + a) * middle + b) * middle + c < 0.0:
                low = middle
            else:
                high = middle
        root = 0.5 * (low + high)
        largest = max(abs(root), larger_root(a + root, b + root * (a + root)))
    return -math.log(max(largest, 1e-300))


@compiled
def limit_of(points: Any, count: int, period: int, columns: Any, triangle: Any, shares: Any, limit: Any) -> bool:
    """Fill the limit of a settling run over one period, in the phases of its last points; return whether it has one."""
    # Reduced rank extrapolation, R. P. Eddy (1979) and M. Mesina (1977). A spiral onto a torus decays too, but at a
    # falling rate.
    low = count // 3
    long = count - low
    a, _, c = thirds(points, low, count, period, period)
    if a < 0.0 or c > LEAST_SHRINKING * a:
        return False
    modes, misfit = MODES, -1.0
    while modes > 0 and misfit < 0.0:
        misfit = decay(points, low, count, period, modes, columns, triangle, shares)
        if misfit < 0.0:
            modes -= 1
    if misfit < 0.0 or misfit > MISFIT:
        return False
    most, enough = modes, max(EXACT, 2.0 * misfit)
    modes, misfit = 1, -1.0
    while modes < most and not (0.0 <= misfit <= enough):
        misfit = decay(points, low, count, period, modes, columns, triangle, shares)
        if not (0.0 <= misfit <= enough):
            modes += 1
    if modes == most:
        misfit = decay(points, low, count, period, modes, columns, triangle, shares)
    if rate_of(shares, modes) * long / period < LEAST_DECAY + 10.0 * misfit:
        return False
    total = 0.0
    for j in range(modes):
        total += shares[j]
    if total == 1.0:
        return False
    for k in range(period):
        last = count - period + k
        for c in range(3):
            value = points[last, c]
            for j in range(modes):
                value -= shares[j] * points[count - (modes + 1 - j) * period + k, c]
            limit[k, c] = value / (1.0 - total)
    half = low + (long + 1) // 2
    if decay(points, low, half, period, modes, columns, triangle, shares) < 0.0:
        return False
    first = rate_of(shares, modes)
    if decay(points, half, count, period, modes, columns, triangle, shares) < 0.0:
        return False
    return not rate_of(shares, modes) < DOUBTFUL * first


@compiled
def period_in_the_limit(points: Any, count: int, period: int, tolerance: float, columns: Any, triangle: Any,
                        shares: Any, limit: Any) -> tuple[int, float]:
    """Return the period of a near limit, DOUBT or NONE, and the remaining distance to the limit."""
    if not limit_of(points, count, period, columns, triangle, shares, limit):
        return NONE, math.inf
    left = 0.0
    for k in range(period):
        for c in range(3):
            left = max(left, abs(limit[k, c] - points[count - period + k, c]))
    if not left <= DISTANCE:
        return NONE, math.inf
    for shorter in range(1, period):  # The smallest divisor after which the orbit repeats.
        if period % shorter == 0:
            furthest = 0.0
            for k in range(period):
                furthest = max(furthest, difference_of(limit, (k + shorter) % period, k))
            if furthest <= 4.0 * max(left, tolerance):
                return shorter if furthest <= max(SAME * left, tolerance) else DOUBT, left
    return period, left


@compiled
def repetition(points: Any, count: int, most: int, tolerance: float, columns: Any, triangle: Any, shares: Any,
               limit: Any) -> tuple[int, bool, float]:
    """Return period, whether it is settled, and the change over it, of the points of one run."""
    change = difference_of(points, count - 1, count - 2)
    for period in range(1, most + 1):
        if (difference_of(points, count - 1, count - 1 - period) <= tolerance
                and repeats_lately(points, count, period, tolerance)):
            if grows(points, count, period, tolerance):
                return 0, False, change
            open_ = False
            for shorter in range(1, period):
                if period % shorter == 0 and not open_:
                    open_ = may_vanish(points, count, shorter, period, tolerance)
            if not open_:
                return period, True, last_change(points, count, period)
            break
    near = max(NEAR, tolerance)
    for period in range(1, most + 1):
        size = difference_of(points, count - 1, count - 1 - period)
        if size > near:
            continue
        repeat, left = period_in_the_limit(points, count, period, tolerance, columns, triangle, shares, limit)
        if repeat == NONE:
            continue
        # Just behind a doubling a decay resembles a slower one to zero; over twice the period less changes.
        twice = 2 * period
        if repeat == period and twice <= most:
            after = difference_of(points, count - 1, count - 1 - twice)
            if after <= near and after < DOUBTFUL * size:
                further, nearer = period_in_the_limit(points, count, twice, tolerance, columns, triangle, shares, limit)
                if further == twice and nearer < DOUBTFUL * left:
                    repeat = twice
        return repeat, False, last_change(points, count, repeat if repeat > 0 else 1)
    return 0, False, change


@compiled
def judge_runs(runs: Any, most: int, tolerance: float, columns: Any, triangle: Any, shares: Any, limit: Any,
          results: Any) -> None:
    """Fill a row of `results` with period, settled and change of every run."""
    for k in range(runs.shape[0]):
        period, settled, change = repetition(runs[k], runs.shape[1], most, tolerance, columns, triangle, shares, limit)
        results[k, 0], results[k, 1], results[k, 2] = period, 1.0 if settled else 0.0, change


def repetitions(runs: Floats, most: int, tolerance: float) -> list[tuple[int, bool, float]]:
    """Return period, whether it is settled, and the change over it, of every run.

    runs : (m, n, 3) section points of each run in units of its size, finite, n > `most`
    most : longest period looked for, 1 to n // 3
    """
    results = np.empty((len(runs), 3))
    judge_runs(np.ascontiguousarray(runs), most, tolerance, np.empty((MODES + 1, 3 * runs.shape[1])),
               np.empty((MODES, MODES + 1)), np.empty(MODES), np.empty((most, 3)), results)
    return [(int(period), settled > 0.0, change) for period, settled, change in results.tolist()]
