"""Measured sliding friction: a table mu(v) fitted by a constant and at most three decaying exponentials.

The sum mu(v) = m + sum over j of c_j exp(-a_j |v|) is analytic and bounded. With one exponential it is the law of (6)
and (7).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tcc_sim.errors import InputError
from tcc_sim.model.friction import decayed, exponentials_at, portable_exp, sliding_slope
from tcc_sim.model.quantity import MOST_POINTS, check_rising

Floats = npt.NDArray[np.float64]
MOST_TERMS = 3
GOOD_ENOUGH = 1e-3
"""Error relative to the largest coefficient below which no further exponential is tried, and the noise that the prior
points have.
"""
PRIOR = 4
"""Number of prior points in the information criterion."""
SEARCHED = 1.5
"""Factor of the criterion's penalty, because the best of many rates fits noise better than a given one."""
DOUBTFUL, REFUSED = 0.02, 0.05
"""Errors relative to the largest coefficient above which results have a warning, and a table is refused."""
LARGEST_RATIO = 20.0
"""Bound of m against the largest coefficient and of mu(0) against m, either way."""
BEYOND = 0.2
"""Most that the curve changes beyond the last slip speed, relative to the range of the coefficients."""
TURNS = 1e-3
"""Most that it turns back on the way there, likewise."""
SLOWEST, FASTEST, FASTEST_RATE = 0.3, 5.0, 1e3
"""Bounds of a rate: SLOWEST over the last slip speed, FASTEST over the first one above 0, and FASTEST_RATE s/rad."""
STEEPER = 5.0
"""Largest slope of the curve relative to those of the straight lines through the points nearby."""
FAST = 1e9
"""Slip speed up to which a law that hardly decays is described, rad/s."""
APART = math.log(1.6)
"""Least logarithm of the ratio of two rates: closer ones give large amplitudes of opposite signs."""
STARTS, BENT, BOUNDS = 6, 3, 250
"""Number of fits of one number of exponentials, number of those that are repeated with bounds on the slope, and largest
number of these bounds.
"""
WEIGHTS = 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e3, 1e5
"""Weights of the distances beyond the bounds, one fit after the other."""
TINY = 1e-15
"""Rounding of a slope, s/rad."""
FINE = 8
"""Parts of an interval between two points in which the curve is compared with them."""


@dataclass(frozen=True)
class FrictionCurve:
    """Sliding friction coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|).

    constant : m, limit of the coefficient for fast slip
    amplitudes, rates : c_j (dimensionless) and a_j (s/rad), rates in descending order
    error, worst : largest difference from the points of the table, relative to its largest coefficient, and the slip
        speed of that difference, rad/s
    error_between, worst_between : the same from a monotone interpolation of the points
    fastest : last slip speed of the table, rad/s; infinite without a table
    """

    constant: float
    amplitudes: tuple[float, ...]
    rates: tuple[float, ...]
    error: float = 0.0
    worst: float = 0.0
    error_between: float = 0.0
    worst_between: float = 0.0
    fastest: float = math.inf

    @property
    def stribeck(self) -> tuple[float, ...] | None:
        """The exponentials of mu(v)/m, see `model.friction`; None where the coefficient is constant."""
        pairs = zip(self.amplitudes, self.rates)
        return tuple(number for c, a in pairs for number in (c / self.constant, a)) or None

    def at(self, slip_speed: Any) -> Any:
        """Return mu at slip speeds, rad/s, a float or an array of any shape."""
        return self.constant + (exponentials_at(np.abs(slip_speed), self.pairs)[1] if self.rates else 0)

    def slope(self, slip_speed: Any) -> Any:
        """Return d mu / d|v|, s/rad, at slip speeds, rad/s, a float or an array of any shape."""
        return sliding_slope(slip_speed, self.pairs or None)

    @property
    def pairs(self) -> tuple[float, ...]:
        """(c_1, a_1, c_2, a_2, ...)"""
        return tuple(itertools.chain(*zip(self.amplitudes, self.rates)))

    @property
    def speeds(self) -> Floats:
        """Slip speeds of the table's range, or as far as the exponentials last, rad/s: (n,) from 0."""
        slowest = min((a for a in self.rates if a > 0.0), default=1.0)
        last = self.fastest if math.isfinite(self.fastest) else min(20.0 / slowest, FAST)
        return np.append(0.0, np.geomspace(1e-4 * last, last, 2000))


def check_table(slip_speeds: tuple[float, ...], coefficients: tuple[float, ...]) -> None:
    """Raise InputError unless the lists form a table: at least three points, speeds rising from 0.

    The ranges of single values are checked with the scene keys.
    """
    speeds, values = "friction.slip_speeds", "friction.coefficients"
    if len(slip_speeds) != len(coefficients):
        raise InputError(f"{values} has {len(coefficients)} values; it must have as many as {speeds}, "
                         f"{len(slip_speeds)}")
    if not 3 <= len(slip_speeds) <= MOST_POINTS:
        raise InputError(f"{speeds} has {len(slip_speeds)} values; a friction table needs 3 to {MOST_POINTS}")
    check_rising(speeds, slip_speeds, "slip speed", "rad/s")


def fit_curve(slip_speeds: tuple[float, ...], coefficients: tuple[float, ...]) -> FrictionCurve:
    """Fit a friction table by a constant and the fewest exponentials, at most three, that the points justify.

    Nonlinear least squares from several starts give the rates; for each set of rates, linear least squares give the
    constant and the amplitudes (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). If that curve
    has a slope that the points do not have (`_slopes`), it is fitted again with bounds on the slope. The number of
    exponentials has the least Bayesian criterion for few points (A. D. R. McQuarrie, Statistics & Probability Letters
    44, 1999, the SICc), in which PRIOR points with a noise of 0.1 % are added to those of the table, and the penalty is
    SEARCHED times larger.

    Between its points the curve turns only where they turn. Beyond the last point it goes one way to the constant,
    which is within 20 % of the range of the coefficients from the last one.

    slip_speeds : (n,) rad/s, rising from 0, n >= 3
    coefficients : (n,) dimensionless, above 0

    Raises InputError: the lists form no table, or the error of every such curve exceeds 5 % of the largest coefficient.
    """
    check_table(slip_speeds, coefficients)
    size = max(coefficients)
    # Tables that differ by a factor have one fit, so that a sweep over the factor does not fit each of them.
    fit = _fit_of(slip_speeds, tuple(float(f"{x / size:.12g}") for x in coefficients))
    return replace(fit, constant=size * fit.constant, amplitudes=tuple(size * c for c in fit.amplitudes))


@lru_cache(maxsize=64)
def _fit_of(slip_speeds: tuple[float, ...], coefficients: tuple[float, ...]) -> FrictionCurve:
    """Return the fit of a table whose largest coefficient is 1, as in all functions below."""
    v, mu = np.array(slip_speeds), np.array(coefficients)
    best: FrictionCurve | None = None
    least, most = math.inf, min(MOST_TERMS, len(v) - 2)
    for count in range(most + 1):
        curve = _fitted(v, mu, count, math.inf if best is None or best.error > REFUSED else least)
        if curve is None:
            continue
        criterion = _criterion(curve, v, mu)
        # A curve that would be refused gives way to any other.
        if best is None or (curve.error > REFUSED, criterion) < (best.error > REFUSED, least):
            best, least = curve, criterion
        if best.error <= GOOD_ENOUGH:
            break
    if best is None or best.error > REFUSED:
        why = "" if best is None else f" ({best.error:.1%} off at {best.worst:g} rad/s)"
        raise InputError(f"friction.coefficients: no constant with {most} decaying exponential{'s' * (most > 1)}, "
                         f"which is what {len(v)} points allow, is within {REFUSED:.0%} of the largest coefficient at "
                         f"every point{why}; smooth the table, or give more points where it bends")
    return _compared(best, v, mu)


def _criterion(curve: FrictionCurve, v: Floats, mu: Floats) -> float:
    """Return the criterion of a curve: less is better."""
    n, terms = len(v) + PRIOR, 1 + 2 * len(curve.rates)
    if n - terms <= 2:
        return math.inf
    squares = _squares(curve, v, mu) + PRIOR * GOOD_ENOUGH**2
    return n * (math.log(squares / n) + SEARCHED * math.log(n) * terms / (n - terms - 2))


def _fitted(v: Floats, mu: Floats, count: int, beaten: float) -> FrictionCurve | None:
    """Return the least-squares curve with `count` exponentials in range; None if none has a criterion below `beaten`.
    """
    if count == 0:
        return _curve(v, mu, np.empty(0))
    from scipy.optimize import leastsq

    low, high = _bounds(v, count)
    slack, apart = high - low - (count - 1) * APART, APART * np.arange(count)

    def logarithms(x: Floats) -> Floats:
        """Return rising logarithms of rates, at least APART from each other, for numbers from 0 to 1."""
        return low + apart + slack * (1.0 - np.cumprod(1.0 - x))

    def left(angles: Floats) -> Floats:
        """Return the residuals for angles whose sines stand for these numbers."""
        return _projected(v, mu, logarithms(0.5 + 0.5 * np.sin(angles)))[1]

    curves: list[tuple[float, FrictionCurve]] = []
    starts = (np.array(each) for each in itertools.combinations(np.linspace(0.05, 0.95, 8), count))
    angles = (np.array([math.asin(1.0 - 2.0 * x) for x in ((1.0 - each) / np.append(1.0, 1.0 - each[:-1])).tolist()])
              for each in starts)
    for start in sorted(angles, key=lambda x: float(np.sum(left(x) ** 2)))[:STARTS]:
        best = leastsq(left, start, xtol=1e-12, ftol=1e-14, gtol=1e-14, maxfev=60 * (count + 1), full_output=True)[0]
        curve = _curve(v, mu, logarithms(0.5 + 0.5 * np.sin(best)))
        curves.append((_squares(curve, v, mu), curve))
    curves.sort(key=lambda each: each[0])
    free = next((curve for _, curve in curves if _in_range(curve, v, mu)), None)
    if free is curves[0][1] or _criterion(curves[0][1], v, mu) >= beaten:
        return free
    bound = [curve for _, start in curves[:BENT] if _in_range(curve := _bent(start, v, mu), v, mu)]
    return min([*bound, *([] if free is None else [free])], key=lambda each: _squares(each, v, mu), default=None)


def _bounds(v: Floats, count: int) -> tuple[float, float]:
    """Return the bounds of the logarithms of `count` rates."""
    low, high = math.log(SLOWEST / v[-1]), math.log(min(FASTEST / v[1], FASTEST_RATE))
    return low, max(high, low + count * APART)


def _squares(curve: FrictionCurve, v: Floats, mu: Floats) -> float:
    return float(np.sum((curve.at(v) - mu) ** 2))


def _slopes(v: Floats, mu: Floats, noise: float) -> tuple[Floats, Floats, Floats]:
    """Return slip speeds between and beyond the points, and the least and largest slope of the curve there, s/rad.

    They are STEEPER times the least and the largest slope of the straight lines through the points of an interval and
    of its neighbours, or 0, with room for the noise of the points. The curve of a table that only rises does not fall,
    and that of one that only falls does not rise.
    """
    rises, widths = np.diff(mu), np.diff(v)
    near, wide = (np.stack([np.append(x[:1], x[:-1]), x, np.append(x[1:], x[-1:])]) for x in (rises / widths, widths))
    room = noise / wide.sum(axis=0)
    low = STEEPER * near.min(axis=0).clip(None, 0.0) - room if (rises < 0.0).any() else np.zeros(len(rises))
    high = STEEPER * near.max(axis=0).clip(0.0, None) + room if (rises > 0.0).any() else np.zeros(len(rises))
    between = (v[:-1, None] + widths[:, None] * np.arange(FINE) / FINE).ravel()
    beyond = v[-1] * portable_exp(np.linspace(0.0, math.log(30.0), 3 * FINE))
    return (np.append(between, beyond), np.append(np.repeat(low, FINE), np.full(len(beyond), low[-1])),
            np.append(np.repeat(high, FINE), np.full(len(beyond), high[-1])))


def _noise(curve: FrictionCurve, v: Floats, mu: Floats) -> float:
    """Return the rms difference of a curve from the table, at least 0.1 % of the largest coefficient."""
    return max(math.sqrt(_squares(curve, v, mu) / len(v)), GOOD_ENOUGH)


def _bent(start: FrictionCurve, v: Floats, mu: Floats) -> FrictionCurve:
    """Return the least-squares curve near `start` with slopes of the points.

    Its numbers are m and c_j over the range of the coefficients, and log(a_j). Whatever exceeds a bound counts as a
    residual with a growing weight (penalty method: J. Nocedal and S. J. Wright, Numerical Optimization (2006), 17.1).
    """
    from scipy.optimize import leastsq

    count, size = len(start.rates), float(np.ptp(mu)) or 1.0
    at, low, high = (x[::-(-len(x) // BOUNDS)] for x in _slopes(v, mu, _noise(start, v, mu)))
    (slow, fast), (least, most) = _bounds(v, count), _constants(mu)
    scale = v[-1] / size
    closed = 0.5e-6 * (high - low) + TINY   # Keeps the curve within the bounds in spite of rounding.
    lowest = np.array([least / size, *[-10.0] * count, *[slow] * count])
    highest = np.array([most / size, *[10.0] * count, *[fast] * count])

    def left(x: Floats, weight: float) -> Floats:
        """Return the residuals, and the weighted distances beyond the bounds."""
        rates, amplitudes = portable_exp(x[count + 1:]), x[1:count + 1]
        slope = -_sum_of(amplitudes * rates * size, rates, at)
        beyond = (low + closed - slope) * scale, (slope - high + closed) * scale, lowest - x, x - highest, \
            APART + np.diff(x[count + 1:])
        return np.concatenate([x[0] + _sum_of(amplitudes, rates, v) - mu / size,
                               weight * np.concatenate(beyond).clip(0.0, None)])

    x = np.concatenate([[start.constant / size], np.clip(np.array(start.amplitudes) / size, -10.0, 10.0),
                        [math.log(rate) for rate in start.rates]])
    for weight in WEIGHTS:
        x = leastsq(left, x, (weight,), xtol=1e-10, ftol=1e-12, maxfev=60 * len(x), full_output=True)[0]
    return _with_error(v, mu, x[:count + 1] * size, x[count + 1:])


def _in_range(curve: FrictionCurve, v: Floats, mu: Floats) -> bool:
    """Return whether the curve has slopes of the points, stays near their range, and goes one way beyond them."""
    if not math.isfinite(curve.error):
        return False
    at, low, high = _slopes(v, mu, _noise(curve, v, mu))
    slope, value = curve.slope(at), curve.at(at[at <= v[-1]])
    apart = all(x >= 1.5 * y for x, y in itertools.pairwise(curve.rates))
    # One exponential cannot turn, and the bounds of its rate limit its slope.
    bent = len(curve.rates) > 1 and not ((slope >= low - TINY).all() and (slope <= high + TINY).all())
    return bool(apart and not bent and
                value.min() > max(mu.min() - REFUSED, 0.0) and value.max() < 1.0 + REFUSED and
                1.0 / LARGEST_RATIO <= curve.at(0.0) / curve.constant <= LARGEST_RATIO and _goes_one_way(curve, v, mu))


def _goes_one_way(curve: FrictionCurve, v: Floats, mu: Floats) -> bool:
    """Return whether the curve stays between its value at the last slip speed and its constant beyond that speed."""
    beyond = curve.at(v[-1] * np.geomspace(1.0, 100.0, 200))
    low, high = sorted((beyond[0], curve.constant))
    return bool(max(low - beyond.min(), beyond.max() - high) <= TURNS * np.ptp(mu))


def _projected(v: Floats, mu: Floats, rates: Floats) -> tuple[Floats, Floats]:
    """Return constant and amplitudes (k + 1,) for given logarithms of rates (k,), and the residuals (n,).

    The constant is bounded. If its best value is beyond a bound, the bound is the best one: the sum of squares is
    convex.
    """
    columns = [np.ones_like(v), *(decayed(rate, v) for rate in portable_exp(rates).tolist())]
    factors = _least_squares(columns, mu)
    least, most = _constants(mu)
    constant = min(max(factors[0], least), most)
    if constant != factors[0]:
        factors = np.append(constant, _least_squares(columns[1:], mu - constant))
    return factors, sum((factor * column for factor, column in zip(factors, columns)), -mu)


def _least_squares(columns: list[Floats], values: Floats) -> Floats:
    """Return the factors of the columns whose sum is nearest to the values, by orthogonal columns (Gram and Schmidt,
    twice) and sums without BLAS, whose last bits depend on the processor.
    """
    n, left = len(columns), values
    triangle, factors, basis = np.eye(n), np.zeros(n), list[Floats]()
    for k, column in enumerate(columns):
        for _ in range(2):
            for i, unit in enumerate(basis):
                share = float(np.sum(unit * column))
                triangle[i, k] += share
                column = column - share * unit
        triangle[k, k] = math.sqrt(max(float(np.sum(column * column)), 1e-300))
        basis.append(column / triangle[k, k])
        factors[k] = float(np.sum(basis[k] * left))
        left = left - factors[k] * basis[k]
    for k in range(n - 1, -1, -1):
        factors[k] /= triangle[k, k]
        factors[:k] -= triangle[:k, k] * factors[k]
    return factors


def _sum_of(amplitudes: Floats, rates: Floats, v: Floats) -> Floats:
    """Return the sum of decaying exponentials at slip speeds."""
    return sum((c * decayed(a, v) for c, a in zip(amplitudes.tolist(), rates.tolist())), np.zeros_like(v))


def _constants(mu: Floats) -> tuple[float, float]:
    reach = BEYOND * np.ptp(mu)
    return max(mu[-1] - reach, 1.01 / LARGEST_RATIO), mu[-1] + reach


def _curve(v: Floats, mu: Floats, rates: Floats) -> FrictionCurve:
    """Return the least-squares curve for given logarithms of rates (k,)."""
    return _with_error(v, mu, _projected(v, mu, rates)[0], rates)


def _with_error(v: Floats, mu: Floats, factors: Floats, rates: Floats) -> FrictionCurve:
    """Return the curve of constant and amplitudes (k + 1,) and logarithms of rates (k,), with its largest error."""
    order = np.argsort(-rates)
    fast = portable_exp(rates)
    residuals = factors[0] + _sum_of(factors[1:], fast, v) - mu
    worst = int(np.abs(residuals).argmax())
    return FrictionCurve(float(factors[0]), tuple(map(float, factors[1:][order])), tuple(map(float, fast[order])),
                         float(abs(residuals[worst])), float(v[worst]))


def _compared(curve: FrictionCurve, v: Floats, mu: Floats) -> FrictionCurve:
    """Return the curve with its error between the points, and the last slip speed of the table.

    The measure is the monotone cubic interpolation of F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5, 1984.
    """
    from scipy.interpolate import PchipInterpolator

    at = np.append((v[:-1, None] + np.diff(v)[:, None] * np.arange(FINE) / FINE).ravel(), v[-1])
    apart = np.abs(curve.at(at) - PchipInterpolator(v, mu)(at))
    worst = int(apart.argmax())
    return replace(curve, error_between=float(apart[worst]), worst_between=float(at[worst]), fastest=float(v[-1]))
