"""Period of a motion in engine cycles, from its stroboscopic section.

A period is stated if the section repeats with it and with no divisor of it, now or, while it still settles, in the
limit of its decay. Otherwise there is none yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.trajectory import Cycles, Floats


@dataclass(frozen=True)
class Periodicity:
    """Repetition of a section.

    period : in engine cycles, 0 if none up to 16 can be stated yet
    settled : whether the section repeats within the tolerance; False for a period of the limit of a decay
    change : largest difference between the last two periods (of one cycle without a period), relative to the size of
        the motion; NaN for too few cycles
    longest : longest period that was looked for; 0 for too few cycles
    """

    period: int
    settled: bool
    change: float
    longest: int = 0


def longest_tried(points: int, maximum: int = DEFAULTS.maximum_period) -> int:
    """Return the longest period that so many section points can show, periods of excitation."""
    return min(maximum, points // 3)


def periodicity(cycles: Cycles, tolerance: float = DEFAULTS.tolerance,
                maximum: int = DEFAULTS.maximum_period) -> Periodicity:
    """Return the smallest number of engine cycles after which the section repeats.

    Settled: over the last quarter of the cycles, and at least three periods, points p cycles apart stay within
    `tolerance` of one another. All of them are compared, not only neighbours, so that a slow drift does not pass.
    Settling: the differences of points p cycles apart decay like a linear map of up to three modes, and its limit is
    near and repeats after p cycles. In both cases there is no period yet if the differences of points a divisor of p
    apart may be decaying to zero, or if those p apart still grow. The size of speeds is the largest speed of the
    motion, that of angles the largest angle on the section.

    Parameters
    ----------
    cycles : consecutive engine cycles without the transient; NaN marks cycles that were not observed. Only those after
        the last gap are used, if there are at least `Settings.after_a_gap`
    tolerance : relative to the size of the motion
    maximum : longest period, engine cycles
    """
    first = _after_gap(cycles)
    points = _scaled(cycles, first)
    return of_points(points, longest_tried(len(points), maximum) if not first or enough_after_a_gap(cycles) else 0,
                     tolerance)


def of_points(points: Floats, most: int, tolerance: float) -> Periodicity:
    """Return the repetition of section points, (n, 3), in units of the motion's size, with a period of at most `most`.
    """
    if len(points) < 2 or most < 1:
        return Periodicity(0, False, _largest(points[-1] - points[-2]) if len(points) > 1 else math.nan)
    return replace(_repetition(points, most, tolerance), longest=most)


def _repetition(points: Floats, most: int, tolerance: float) -> Periodicity:
    """Return the repetition of section points in units of the motion's size, with a period of at most `most`."""
    changes = np.abs(points[-1] - points[-1 - most:-1][::-1]).max(axis=1)
    candidates = (np.flatnonzero(changes <= max(DEFAULTS.near, tolerance)) + 1).tolist()
    for period in candidates:
        if changes[period - 1] <= tolerance and _repeats(points, period, tolerance):
            if _grows(points, period, tolerance):
                return Periodicity(0, False, float(changes[0]))
            if not any(may_vanish(points, q, period, tolerance) for q in divisors(period)):
                return Periodicity(period, True, _change(points, period))
            break
    for period in candidates:
        found, left = _period_in_the_limit(points, period, tolerance)
        if found is None:
            continue
        # Just behind a doubling a decay resembles a slower one to zero; over twice the period less changes.
        twice = 2 * period
        if found == period and twice in candidates and changes[twice - 1] < DEFAULTS.doubtful * changes[period - 1]:
            further, nearer = _period_in_the_limit(points, twice, tolerance)
            found = twice if further == twice and nearer < DEFAULTS.doubtful * left else found
        return Periodicity(found, False, _change(points, found or 1))
    return Periodicity(0, False, float(changes[0]))


def cycles_drift(cycles: Cycles) -> bool:
    """Return whether the largest slip speeds of cycles without a period still grow or decay.

    The means over their quarters change in one direction, in all by more than `DEFAULTS.drift` standard errors, which
    is rare for a torus or chaos, and by more than the tolerance. Too few cycles for quarters count as a drift.
    """
    largest = cycles.largest[np.isfinite(cycles.largest)]
    width = len(largest) // 4
    if width < 2:
        return True
    quarters = largest[len(largest) - 4 * width:].reshape(4, width)
    means, error = quarters.mean(axis=1), math.sqrt(float(quarters.var(axis=1).mean()) * 2.0 / width)
    change = np.diff(means)
    return bool(abs(change.sum()) > max(DEFAULTS.drift * error, DEFAULTS.tolerance * largest.max())
                and (np.all(change > 0.0) or np.all(change < 0.0)))


def enough_after_a_gap(cycles: Cycles) -> bool:
    """Return whether enough cycles follow the last gap; fewer may repeat by chance."""
    first = _after_gap(cycles)
    return first == 0 or len(cycles) - first >= DEFAULTS.after_a_gap


def _after_gap(cycles: Cycles) -> int:
    """Return the number of the first cycle after the last gap; 0 without a gap."""
    observed = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest)
    return 0 if observed.all() else int(np.flatnonzero(~observed)[-1]) + 1


def stays(cycles: Cycles, further: Cycles, period: int, tolerance: float = DEFAULTS.tolerance) -> bool:
    """Return whether the section of further cycles stays within `tolerance` of the last period before."""
    last = cycles.section[len(cycles.section) - period:]
    apart = further.section - last[(np.arange(len(further.section)) - 1) % period]
    apart /= sizes_of(cycles.section, cycles.highest, cycles.lowest)
    return bool(np.abs(apart).max() <= tolerance)


def repeats_finely(cycles: Cycles, period: int, count: int) -> bool:
    """Return whether the last `count` cycles repeat so closely that 0.4 `count` further ones stay within the tolerance.

    A difference that grew from rounding to `fine` in so many cycles needs more cycles to leave.
    """
    points = cycles.section[-count - period:]
    if len(points) < count + period:
        return False
    apart: Floats = np.abs(points[period:] - points[:-period]).max(axis=0)
    return bool((apart <= DEFAULTS.fine * np.abs(points).max(axis=0)).all())


def _repeats(points: Floats, period: int, tolerance: float) -> bool:
    """Return whether points a period apart stay together over the last quarter of the run, and at least three periods.
    """
    tail = points[len(points) - repeats_of(len(points), period) * period:].reshape(-1, period, points.shape[1])
    return _largest(tail.max(axis=0) - tail.min(axis=0)) <= tolerance


def repeats_of(points: int, period: int) -> int:
    """Return the number of periods in the last quarter of a run of so many points, at least three."""
    return max(3, points // 4 // period)


def _change(points: Floats, period: int) -> float:
    """Return the largest difference between the last two periods."""
    pairs = points[max(len(points) - 2 * period, 0):]
    return _largest(pairs[period:] - pairs[:-period])


def divisors(period: int) -> list[int]:
    """Return the divisors of a number below it."""
    return [q for q in range(1, period) if period % q == 0]


def _differences(points: Floats, lag: int) -> Floats:
    """Return the largest differences of points `lag` apart, (n - lag,)."""
    out: Floats = np.abs(points[lag:] - points[:-lag]).max(axis=1)
    return out


def _lately(points: Floats, lag: int, period: int) -> Floats:
    """Return them over the part of the run that `_repeats` compares."""
    return _differences(points, lag)[-repeats_of(len(points), period) * period:]


def _thirds(points: Floats, lag: int, multiple: int) -> tuple[float, float, float] | None:
    """Return the largest difference of points `lag` apart in each third of the run, of whole multiples of `multiple`.
    """
    size = _differences(points, lag)
    width = len(size) // 3 // multiple * multiple
    if width == 0:
        return None
    a, b, c = size[len(size) - 3 * width:].reshape(3, width).max(axis=1).tolist()
    return a, b, c


def may_vanish(points: Floats, shorter: int, period: int, tolerance: float) -> bool:
    """Return whether the difference that distinguishes a period from a divisor is zero or may decay to zero."""
    # A slow alternation repeats after two cycles within any tolerance wider than its decay. A run too short for three
    # sizes leaves this open, and so does a difference that halves while the period repeats: it is hardly above the
    # tolerance. A constant difference fell in the transient before, and its fall has ended. A divisor may drift by a
    # little more than the tolerance, and its multiple, over fewer cycles, by a little less; so may a small torus.
    thirds = _thirds(points, shorter, period)
    if thirds is None:
        return True
    size, whole = _lately(points, shorter, period), _lately(points, period, period)
    if _largest(size) <= max(tolerance, 10.0 * _largest(whole)):
        return True
    if _largest(size[-period:]) < DEFAULTS.doubtful * _largest(size[:period]):
        return True
    if float(np.ptp(size.reshape(-1, period).max(axis=1))) < DEFAULTS.ended * (thirds[1] - thirds[2]):
        return False
    later = _thirds(points[len(points) // 2:], shorter, period)  # A fast decay before a slow one hides the latter.
    return _vanish(*thirds) or (later is not None and _vanish(*later))


def _vanish(a: float, b: float, c: float) -> bool:
    """Return whether three successive sizes may decay to zero, by A. C. Aitken's delta-squared process."""
    if not (c < b < a and a - c > DEFAULTS.shrinking * c):
        return False
    return (b - c) >= (a - b) or c - (b - c) ** 2 / ((a - b) - (b - c)) < DEFAULTS.doubtful * c


def _grows(points: Floats, period: int, tolerance: float) -> bool:
    """Return whether points that are still together separate at a growing rate up to the end of the run."""
    thirds = _thirds(points, period, period)
    if thirds is None:
        return False
    a, b, c = thirds
    if not (c > 0.01 * tolerance and c > DEFAULTS.growth * b and b > DEFAULTS.growth * a):
        return False
    return DEFAULTS.growth * _largest(_lately(points, period, period)) > c


def _limit(points: Floats, period: int) -> Floats | None:
    """Return the limit of a settling run over one period, (period, 3), in the phases of its last points; None for none.
    """
    # Reduced rank extrapolation, R. P. Eddy (1979) and M. Mesina (1977). A spiral onto a torus decays too, but at a
    # falling rate.
    points = points[len(points) // 3:]
    thirds = _thirds(points, period, period)
    if thirds is None or thirds[2] > DEFAULTS.least_shrinking * thirds[0]:
        return None
    every = (_decay(points, period, m) for m in range(DEFAULTS.modes, 0, -1))
    general = next((x for x in every if x is not None), None)
    if general is None or general[0] > DEFAULTS.misfit:
        return None
    fewer = (_decay(points, period, m) for m in range(1, len(general[1])))
    enough = max(DEFAULTS.exact, 2.0 * general[0])
    misfit, coefficients = next((x for x in fewer if x is not None and x[0] <= enough), general)
    rate = _rate(coefficients)
    if rate * len(points) / period < DEFAULTS.least_decay + 10.0 * misfit:
        return None
    modes = len(coefficients)
    first, second = (_decay(part, period, modes) for part in np.array_split(points, 2))
    if first is None or second is None or _rate(second[1]) < DEFAULTS.doubtful * _rate(first[1]):
        return None
    ends = [points[len(points) - (modes + 1 - i) * period:][:period] for i in range(modes + 1)]
    limit: Floats = (ends[-1] - np.tensordot(coefficients, ends[:-1], 1)) / (1.0 - float(coefficients.sum()))
    return limit


def _period_in_the_limit(points: Floats, period: int, tolerance: float) -> tuple[int | None, float]:
    """Return the period of a near limit, 0 in doubt, None for none, and the remaining distance to the limit."""
    limit = _limit(points, period)
    left = math.inf if limit is None else _largest(limit - points[-period:])
    if limit is None or not left <= DEFAULTS.distance:
        return None, math.inf
    return _period_of(limit, left, tolerance), left


def _decay(points: Floats, period: int, modes: int) -> tuple[float, Floats] | None:
    """Return misfit and coefficients of the linear recurrence of the differences of points; None for too few of them.

    The differences d_n = x_(n+p) - x_n of a linear map with m modes satisfy d_(n+mp) = sum_i c_i d_(n+ip). Every
    equation is scaled by its size.
    """
    difference = points[period:] - points[:-period]
    count = len(difference) - modes * period
    if count < 2 * modes:
        return None
    columns = np.stack([difference[i * period:i * period + count] for i in range(modes + 1)])
    size = np.abs(columns).max(axis=(0, 2))
    if not size.min() > 0.0:
        return None
    columns = (columns / size[None, :, None]).reshape(modes + 1, -1)
    coefficients = np.linalg.lstsq(columns[:-1].T, columns[-1], rcond=None)[0]
    misfit = columns[-1] - coefficients @ columns[:-1]
    return math.sqrt(float(misfit @ misfit) / len(misfit)), coefficients


def _rate(coefficients: Floats) -> float:
    """Return the decay rate of a recurrence per period, by the roots of z^m - sum_i c_i z^i."""
    roots = coefficients if len(coefficients) == 1 else np.roots([1.0, *-coefficients[::-1]])
    return -math.log(max(float(np.abs(roots).max()), 1e-300))


def _period_of(limit: Floats, left: float, tolerance: float) -> int:
    """Return the smallest divisor after which an orbit repeats; 0 if the remaining distance leaves it in doubt."""
    for shorter in divisors(len(limit)):
        apart = _largest(np.roll(limit, -shorter, axis=0) - limit)
        if apart <= 4.0 * max(left, tolerance):
            return shorter if apart <= max(DEFAULTS.same * left, tolerance) else 0
    return len(limit)


def _scaled(cycles: Cycles, first: int) -> Floats:
    """Return the section points from cycle `first` on, (n, 3), in units of the motion's size."""
    points = cycles.section[first:]
    finite = np.isfinite(points)
    if not finite.all():
        points = points[int(np.flatnonzero(~finite.all(axis=1))[-1]) + 1:]
    if not len(points):
        return points
    return points / sizes_of(points, cycles.highest[first:], cycles.lowest[first:])


def sizes_of(points: Floats, *speeds: Floats) -> Floats:
    """Return the size of a motion: of slip and plate speed the largest speed, of angles the largest on the section.

    Neither is below 1e-6, in s or 1/s, of the other: at rest the speeds are rounding errors.
    """
    v, angle, w = np.abs(points).max(axis=0).tolist() if len(points) else (0.0, 0.0, 0.0)
    speed = max(v, w, *map(_largest, speeds))
    fast, far = max(speed, 1e-6 * angle) or 1.0, max(angle, 1e-6 * speed) or 1.0
    return np.array([fast, far, fast])


def _largest(x: Floats) -> float:
    """Return the largest magnitude, 0 for an empty array."""
    return float(np.abs(x).max()) if x.size else 0.0
