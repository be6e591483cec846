"""Measured sliding friction: a table mu(v) fitted by a constant and at most three decaying exponentials.

The sum mu(v) = m + sum over j of c_j exp(-a_j |v|) is analytic and bounded. With one exponential it is the law of (6)
and (7).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tcc_sim.errors import InputError

Floats = npt.NDArray[np.float64]
MOST_TERMS = 3
MOST_POINTS = 1000
"""Largest number of points in a table."""
GOOD_ENOUGH = 1e-3
"""Error relative to the largest coefficient below which no further exponential is tried."""
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
APART = math.log(1.6)
"""Least logarithm of the ratio of two rates: closer ones give large amplitudes of opposite signs."""


@dataclass(frozen=True)
class FrictionCurve:
    """Sliding friction coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|).

    Attributes
    ----------
    constant : float
        m, limit of the coefficient for fast slip.
    amplitudes, rates : tuple of float
        c_j (dimensionless) and a_j (s/rad), rates in descending order.
    error : float
        Largest difference from the table, relative to its largest coefficient.
    worst : float
        Slip speed of that difference, rad/s.
    """

    constant: float
    amplitudes: tuple[float, ...]
    rates: tuple[float, ...]
    error: float = 0.0
    worst: float = 0.0

    def at(self, slip_speed: Any) -> Any:
        """Return mu at slip speeds, rad/s, a float or an array of any shape."""
        speed = np.abs(slip_speed)
        return self.constant + sum(c * np.exp(-a * speed) for c, a in zip(self.amplitudes, self.rates))

    def slope(self, slip_speed: Any) -> Any:
        """Return d mu / d|v|, s/rad, at slip speeds, rad/s, a float or an array of any shape."""
        speed = np.abs(slip_speed)
        return sum((-a * c * np.exp(-a * speed) for c, a in zip(self.amplitudes, self.rates)), 0.0 * speed)


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
    if slip_speeds[0] != 0.0:
        raise InputError(f"{speeds} begins at {slip_speeds[0]:g} rad/s; the first slip speed must be 0")
    for before, after in itertools.pairwise(slip_speeds):
        if not after > before:
            raise InputError(f"{speeds} has {after:g} rad/s after {before:g} rad/s; the slip speeds must rise")


@lru_cache(maxsize=64)
def fit_curve(slip_speeds: tuple[float, ...], coefficients: tuple[float, ...]) -> FrictionCurve:
    """Fit a friction table by a constant and the fewest exponentials, at most three, with an error below 0.1 %.

    Nonlinear least squares from several starts give the rates; for each set of rates, linear least squares give the
    constant and the amplitudes (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). Between its
    points the curve leaves the range of the table by at most 5 % of the largest coefficient.

    Beyond the last point the curve goes one way to the constant, which is within 20 % of the range of the coefficients
    from the last one.

    Parameters
    ----------
    slip_speeds : (n,) rad/s, rising from 0, n >= 3
    coefficients : (n,) dimensionless, above 0

    Raises
    ------
    InputError
        The lists form no table, or the error of every such curve exceeds 5 % of the largest coefficient.
    """
    check_table(slip_speeds, coefficients)
    v, mu = np.array(slip_speeds), np.array(coefficients)
    best: FrictionCurve | None = None
    most = min(MOST_TERMS, len(v) - 2)
    for count in range(most + 1):
        for curve in _candidates(v, mu, count):
            if best is None or curve.error < best.error:
                best = curve
        if best is not None and best.error <= GOOD_ENOUGH:
            return best
    if best is None or best.error > REFUSED:
        why = "" if best is None else f" ({best.error:.1%} off at {best.worst:g} rad/s)"
        raise InputError(f"friction.coefficients: no constant with {most} decaying exponential{'s' * (most > 1)}, "
                         f"which is what {len(v)} points allow, is within {REFUSED:.0%} of the largest coefficient at "
                         f"every point{why}; smooth the table, or give more points where it bends")
    return best


def _candidates(v: Floats, mu: Floats, count: int) -> list[FrictionCurve]:
    """Fit curves with `count` exponentials from several starts; return those that stay in range."""
    if count == 0:
        return [_curve(v, mu, np.empty(0))]
    from scipy.optimize import least_squares

    low, high = math.log(SLOWEST / v[-1]), math.log(min(FASTEST / v[1], FASTEST_RATE))
    high = max(high, low + count * APART)
    lower, upper = np.full(count, APART), np.full(count, high - low)
    lower[0], upper[0] = low, high
    found = []
    for start in itertools.combinations(np.linspace(low, high, 8)[1:-1], count):
        gaps = np.clip(np.diff(start, prepend=0.0), lower + 1e-6, upper - 1e-6)
        fit = least_squares(lambda x: _projected(v, mu, np.minimum(np.cumsum(x), high))[1], gaps, bounds=(lower, upper),
                            xtol=1e-12, ftol=1e-14, gtol=1e-14, max_nfev=60)
        curve = _curve(v, mu, np.minimum(np.cumsum(fit.x), high))
        between = curve.at(np.concatenate([np.linspace(a, b, 9) for a, b in itertools.pairwise(v)]))
        margin = REFUSED * mu.max()
        if between.min() > max(mu.min() - margin, 0.0) and between.max() < mu.max() + margin and \
                1.0 / LARGEST_RATIO <= curve.at(0.0) / curve.constant <= LARGEST_RATIO and _goes_one_way(curve, v, mu):
            found.append(curve)
    return found


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
    columns = np.exp(-np.exp(rates)[None, :] * v[:, None])
    factors = np.linalg.lstsq(np.column_stack([np.ones_like(v), columns]), mu, rcond=None)[0]
    reach = BEYOND * np.ptp(mu)
    constant = min(max(factors[0], mu[-1] - reach, 1.01 * mu.max() / LARGEST_RATIO), mu[-1] + reach)
    if constant != factors[0]:
        factors = np.concatenate([[constant], np.linalg.lstsq(columns, mu - constant, rcond=None)[0]])
    return factors, factors[0] + columns @ factors[1:] - mu


def _curve(v: Floats, mu: Floats, rates: Floats) -> FrictionCurve:
    """Return the curve for given logarithms of rates (k,), with its largest error."""
    factors, residuals = _projected(v, mu, rates)
    order = np.argsort(-rates)
    worst = int(np.abs(residuals).argmax())
    return FrictionCurve(float(factors[0]), tuple(map(float, factors[1:][order])),
                         tuple(map(float, np.exp(rates[order]))), float(abs(residuals[worst]) / mu.max()),
                         float(v[worst]))
