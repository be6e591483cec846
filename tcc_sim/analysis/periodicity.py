"""The period of a motion in engine cycles, found on its stroboscopic section.

A period is stated where the section repeats with it and with no divisor of it, now or, where it still settles, in the
limit of its decay. Otherwise there is none yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.trajectory import Cycles, Floats


@dataclass(frozen=True)
class Periodicity:
    """The repetition of a section.

    period : in engine cycles, 0 where none up to 16 can be stated yet
    settled : whether the section repeats within the tolerance; a period that only the limit of a decay has is not
        settled
    change : largest difference between the last two periods (of one cycle where there is no period), relative to the
        size of the motion; NaN where there are too few cycles
    """

    period: int
    settled: bool
    change: float


def periodicity(cycles: Cycles, tolerance: float = DEFAULTS.tolerance,
                maximum: int = DEFAULTS.maximum_period) -> Periodicity:
    """The smallest number of engine cycles after which the section repeats.

    Settled: over the last quarter of the cycles, and at least three periods, points that are p cycles apart stay within
    `tolerance` of one another; a slow drift does not pass, since all of them are compared and not only neighbours.
    Settling: the differences of points p cycles apart decay as a linear map of up to three modes does, and its limit,
    which is near, repeats after p cycles. In both cases there is no period yet where the differences of points a
    divisor of p apart may be dying out, or where those p apart still grow. Speeds are measured by the largest speed of
    the motion and angles by the largest angle on the section.

    Parameters
    ----------
    cycles : consecutive engine cycles, the transient dropped; NaN marks cycles that were not observed, and only those
        after the last gap are looked at, where these are `Settings.after_a_gap` or more
    tolerance : relative to the size of the motion
    maximum : longest period looked for, engine cycles
    """
    first = _after_gap(cycles)
    points = _scaled(cycles, first)
    most = min(maximum, len(points) // 3) if not first or enough_after_a_gap(cycles) else 0
    if len(points) < 2 or most < 1:
        return Periodicity(0, False, _largest(points[-1] - points[-2]) if len(points) > 1 else math.nan)
    changes = np.abs(points[-1] - points[-1 - most:-1][::-1]).max(axis=1)
    candidates = (np.flatnonzero(changes <= max(DEFAULTS.near, tolerance)) + 1).tolist()
    for period in candidates:
        if changes[period - 1] <= tolerance and _repeats(points, period, tolerance):
            if _grows(points, period, tolerance):
                return Periodicity(0, False, float(changes[0]))
            if not any(_may_vanish(points, q, period, tolerance) for q in _divisors(period)):
                return Periodicity(period, True, _change(points, period))
            break
    for period in candidates:
        found, left = _period_in_the_limit(points, period, tolerance)
        if found is None:
            continue
        # A decay behind a doubling looks like a slower one to nothing; after twice the period less has changed.
        twice = 2 * period
        if found == period and twice in candidates and changes[twice - 1] < DEFAULTS.doubtful * changes[period - 1]:
            further, nearer = _period_in_the_limit(points, twice, tolerance)
            found = twice if further == twice and nearer < DEFAULTS.doubtful * left else found
        return Periodicity(found, False, _change(points, found or 1))
    return Periodicity(0, False, float(changes[0]))


def cycles_drift(cycles: Cycles) -> bool:
    """Whether the largest slip speeds of the cycles, without a period, still grow or decay.

    The means over their quarters change in one direction, by `DEFAULTS.drift` standard errors in all, which a torus or
    chaos does by chance only; and by more than the tolerance. Too few cycles for quarters leave it open, as a drift.
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
    """Whether the cycles after the last gap are enough for a period; fewer look like one by chance."""
    first = _after_gap(cycles)
    return first == 0 or len(cycles) - first >= DEFAULTS.after_a_gap


def _after_gap(cycles: Cycles) -> int:
    """Number of the first cycle after the last one that was not observed; 0 where there is no gap."""
    observed = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest)
    return 0 if observed.all() else int(np.flatnonzero(~observed)[-1]) + 1


def stays(cycles: Cycles, further: Cycles, period: int, tolerance: float = DEFAULTS.tolerance) -> bool:
    """Whether the section of the cycles that follow stays within `tolerance` of the last period of those before."""
    last = cycles.section[len(cycles.section) - period:]
    apart = further.section - last[(np.arange(len(further.section)) - 1) % period]
    apart /= sizes_of(cycles.section, cycles.highest, cycles.lowest)
    return bool(np.abs(apart).max() <= tolerance)


def repeats_finely(cycles: Cycles, period: int, count: int) -> bool:
    """Whether the last `count` cycles repeat those a period before them so closely that as many as four tenths of that
    which follow stay within the tolerance: what has grown from rounding to `fine` in so many cycles needs more to
    leave.
    """
    points = cycles.section[-count - period:]
    if len(points) < count + period:
        return False
    apart: Floats = np.abs(points[period:] - points[:-period]).max(axis=0)
    return bool((apart <= DEFAULTS.fine * np.abs(points).max(axis=0)).all())


def _repeats(points: Floats, period: int, tolerance: float) -> bool:
    """Whether points a period apart stay together over the last quarter of the run, and at least three periods."""
    tail = points[len(points) - _repeats_of(points, period) * period:].reshape(-1, period, points.shape[1])
    return _largest(tail.max(axis=0) - tail.min(axis=0)) <= tolerance


def _repeats_of(points: Floats, period: int) -> int:
    """Periods in the last quarter of the run, and at least three."""
    return max(3, len(points) // 4 // period)


def _change(points: Floats, period: int) -> float:
    """Largest difference between the last two periods."""
    pairs = points[max(len(points) - 2 * period, 0):]
    return _largest(pairs[period:] - pairs[:-period])


def _divisors(period: int) -> list[int]:
    """The divisors of a number below it."""
    return [q for q in range(1, period) if period % q == 0]


def _differences(points: Floats, lag: int) -> Floats:
    """Largest differences of points `lag` apart, (n - lag,)."""
    out: Floats = np.abs(points[lag:] - points[:-lag]).max(axis=1)
    return out


def _lately(points: Floats, lag: int, period: int) -> Floats:
    """The same over the part of the run in which `_repeats` looks at a period."""
    return _differences(points, lag)[-_repeats_of(points, period) * period:]


def _thirds(points: Floats, lag: int, multiple: int) -> tuple[float, float, float] | None:
    """Largest difference of points `lag` apart in the thirds of the run, each a whole multiple of `multiple` long."""
    size = _differences(points, lag)
    width = len(size) // 3 // multiple * multiple
    if width == 0:
        return None
    a, b, c = size[len(size) - 3 * width:].reshape(3, width).max(axis=1).tolist()
    return a, b, c


def _may_vanish(points: Floats, shorter: int, period: int, tolerance: float) -> bool:
    """Whether what tells a divisor from a period that repeats is none, or dies out, as far as its size tells."""
    # A slow alternation repeats after two cycles within any tolerance that is wider than its decay. A run that is too
    # short for three sizes leaves it open. So does a difference that falls to half while the period repeats: it is
    # itself hardly above the tolerance. One that is constant meanwhile fell in the transient before, and has ended.
    # A divisor may drift by a little more than the tolerance, and its multiple, over fewer cycles, by a little less; so
    # may points on a torus that is hardly larger than the tolerance be apart.
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
    later = _thirds(points[len(points) // 2:], shorter, period)  # A fast decay before a slow one hides that it goes on.
    return _vanish(*thirds) or (later is not None and _vanish(*later))


def _vanish(a: float, b: float, c: float) -> bool:
    """Whether three sizes, one after the other, may be on their way to none: their limit is that of A. C. Aitken's
    delta-squared process.
    """
    if not (c < b < a and a - c > DEFAULTS.shrinking * c):
        return False
    return (b - c) >= (a - b) or c - (b - c) ** 2 / ((a - b) - (b - c)) < DEFAULTS.doubtful * c


def _grows(points: Floats, period: int, tolerance: float) -> bool:
    """Whether points that are still together part at a growing rate, up to the end of the run."""
    thirds = _thirds(points, period, period)
    if thirds is None:
        return False
    a, b, c = thirds
    if not (c > 0.01 * tolerance and c > DEFAULTS.growth * b and b > DEFAULTS.growth * a):
        return False
    return DEFAULTS.growth * _largest(_lately(points, period, period)) > c


def _limit(points: Floats, period: int) -> Floats | None:
    """The points of one period to which a run settles, (period, 3), in the phases of the last ones; None for none."""
    # It is that of the reduced rank extrapolation of R. P. Eddy (1979) and M. Mesina (1977). A spiral onto a torus
    # decays too, but at a rate that falls.
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
    """The period of the limit to which a run settles in so many cycles, 0 where that is in doubt, and the distance left
    to it; None where it settles to none that is near.
    """
    limit = _limit(points, period)
    left = math.inf if limit is None else _largest(limit - points[-period:])
    if limit is None or not left <= DEFAULTS.distance:
        return None, math.inf
    return _period_of(limit, left, tolerance), left


def _decay(points: Floats, period: int, modes: int) -> tuple[float, Floats] | None:
    """Misfit and coefficients of the linear recurrence that the differences of points follow; None where there are too
    few of them.

    The differences d_n = x_(n+p) - x_n of a linear map with m modes satisfy d_(n+mp) = sum_i c_i d_(n+ip). Every
    equation counts relative to its own size.
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
    """Rate of the decay of such a recurrence, per period: it goes as the powers of the roots of z^m - sum_i c_i z^i."""
    roots = coefficients if len(coefficients) == 1 else np.roots([1.0, *-coefficients[::-1]])
    return -math.log(max(float(np.abs(roots).max()), 1e-300))


def _period_of(limit: Floats, left: float, tolerance: float) -> int:
    """The smallest divisor of the length of an orbit after which it repeats; 0 where the distance left to it, of which
    some is uncertain, leaves that in doubt.
    """
    for shorter in _divisors(len(limit)):
        apart = _largest(np.roll(limit, -shorter, axis=0) - limit)
        if apart <= 4.0 * max(left, tolerance):
            return shorter if apart <= max(DEFAULTS.same * left, tolerance) else 0
    return len(limit)


def _scaled(cycles: Cycles, first: int) -> Floats:
    """The section points from cycle `first` on, (n, 3), in units of the motion's size."""
    points = cycles.section[first:]
    finite = np.isfinite(points)
    if not finite.all():
        points = points[int(np.flatnonzero(~finite.all(axis=1))[-1]) + 1:]
    if not len(points):
        return points
    return points / sizes_of(points, cycles.highest[first:], cycles.lowest[first:])


def sizes_of(points: Floats, *speeds: Floats) -> Floats:
    """The size of a motion: slip and plate speed by the largest speed, angles by the largest on the section.

    Neither is taken for less than 1e-6, in s or 1/s, of the other: at rest the speeds are roundings.
    """
    v, angle, w = np.abs(points).max(axis=0).tolist() if len(points) else (0.0, 0.0, 0.0)
    speed = max(v, w, *map(_largest, speeds))
    fast, far = max(speed, 1e-6 * angle) or 1.0, max(angle, 1e-6 * speed) or 1.0
    return np.array([fast, far, fast])


def _largest(x: Floats) -> float:
    """Largest magnitude, 0 for none."""
    return float(np.abs(x).max()) if x.size else 0.0
