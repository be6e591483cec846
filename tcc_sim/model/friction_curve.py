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
from tcc_sim.model.quantity import MOST_POINTS, check_rising

Floats = npt.NDArray[np.float64]
MOST_TERMS = 3
GOOD_ENOUGH = 1e-3
"""Error relative to the largest coefficient below which no further exponential is tried."""
DOUBTFUL, REFUSED = 0.02, 0.05
"""Errors relative to the largest coefficient above which results have a warning, and a table is refused."""
LEAST_REGION = 1e-3
"""Step of the logarithms of rates at which the largest error counts as least."""
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
    check_rising(speeds, slip_speeds, "slip speed", "rad/s")


@lru_cache(maxsize=64)
def fit_curve(slip_speeds: tuple[float, ...], coefficients: tuple[float, ...]) -> FrictionCurve:
    """Fit a friction table by a constant and the fewest exponentials, at most three, with an error below 0.1 %.

    Nonlinear least squares from several starts give the rates; for each set of rates, linear least squares give the
    constant and the amplitudes (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). If no such fit
    has an error below 0.1 %, the best one is improved until its largest error is least.

    Between its points the curve leaves the range of the table by at most 5 % of the largest coefficient. Beyond the
    last point it goes one way to the constant, which is within 20 % of the range of the coefficients from the last one.

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
    best = best and _levelled(best, v, mu)
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

    low, high = _bounds(v, count)
    lower, upper = np.full(count, APART), np.full(count, high - low)
    lower[0], upper[0] = low, high
    found = []
    for start in itertools.combinations(np.linspace(low, high, 8)[1:-1], count):
        gaps = np.clip(np.diff(start, prepend=0.0), lower + 1e-6, upper - 1e-6)
        fit = least_squares(lambda x: _projected(v, mu, np.minimum(np.cumsum(x), high))[1], gaps, bounds=(lower, upper),
                            xtol=1e-12, ftol=1e-14, gtol=1e-14, max_nfev=60)
        curve = _curve(v, mu, np.minimum(np.cumsum(fit.x), high))
        if _in_range(curve, v, mu):
            found.append(curve)
    return found


def _bounds(v: Floats, count: int) -> tuple[float, float]:
    """Return the bounds of the logarithms of `count` rates."""
    low, high = math.log(SLOWEST / v[-1]), math.log(min(FASTEST / v[1], FASTEST_RATE))
    return low, max(high, low + count * APART)


def _levelled(curve: FrictionCurve, v: Floats, mu: Floats) -> FrictionCurve:
    """Minimise the largest error by linear programs in a trust region (K. Madsen, J. Inst. Math. Appl. 16, 1975)."""
    from scipy.optimize import linprog

    count, region = len(curve.rates), 0.3
    (low, high), (least, most) = _bounds(v, count), _constants(mu)
    order = -np.diff(np.eye(count), axis=0)
    apart = np.hstack([np.zeros((len(order), count + 1)), -order, np.zeros((len(order), 1))])
    while region > LEAST_REGION:
        rates, amplitudes = np.array(curve.rates), np.array(curve.amplitudes)
        fade, logarithms, error = np.exp(-np.outer(v, rates)), np.log(rates), curve.at(v) - mu
        columns = np.column_stack([np.ones_like(v), fade, -amplitudes * rates * v[:, None] * fade])
        bounds = [(least - curve.constant, most - curve.constant), *[(None, None)] * count,
                  *((max(low - x, -region), min(high - x, region)) for x in logarithms), (0.0, None)]
        step = linprog(np.eye(1, 2 * count + 2, 2 * count + 1)[0], bounds=bounds, A_ub=np.vstack([
            np.column_stack([columns, -np.ones_like(v)]), np.column_stack([-columns, -np.ones_like(v)]), apart]),
            b_ub=np.concatenate([-error, error, order @ logarithms - APART])).x
        tried = curve if step is None else _with_error(
            v, mu, np.append(curve.constant, amplitudes) + step[:count + 1], logarithms + step[count + 1:-1])
        better = tried.error < curve.error and _in_range(tried, v, mu)
        region *= 2.0 if better else 0.25
        curve = tried if better else curve
    return curve


def _in_range(curve: FrictionCurve, v: Floats, mu: Floats) -> bool:
    """Return whether the curve stays near the range of the table, and goes one way beyond it."""
    between = curve.at(np.concatenate([np.linspace(a, b, 9) for a, b in itertools.pairwise(v)]))
    margin = REFUSED * mu.max()
    return bool(between.min() > max(mu.min() - margin, 0.0) and between.max() < mu.max() + margin and
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
    columns = np.exp(-np.exp(rates)[None, :] * v[:, None])
    factors = np.linalg.lstsq(np.column_stack([np.ones_like(v), columns]), mu, rcond=None)[0]
    least, most = _constants(mu)
    constant = min(max(factors[0], least), most)
    if constant != factors[0]:
        factors = np.concatenate([[constant], np.linalg.lstsq(columns, mu - constant, rcond=None)[0]])
    return factors, factors[0] + columns @ factors[1:] - mu


def _constants(mu: Floats) -> tuple[float, float]:
    """Return the bounds of the constant."""
    reach = BEYOND * np.ptp(mu)
    return max(mu[-1] - reach, 1.01 * mu.max() / LARGEST_RATIO), mu[-1] + reach


def _curve(v: Floats, mu: Floats, rates: Floats) -> FrictionCurve:
    """Return the least-squares curve for given logarithms of rates (k,)."""
    return _with_error(v, mu, _projected(v, mu, rates)[0], rates)


def _with_error(v: Floats, mu: Floats, factors: Floats, rates: Floats) -> FrictionCurve:
    """Return the curve of constant and amplitudes (k + 1,) and logarithms of rates (k,), with its largest error."""
    order = np.argsort(-rates)
    residuals = factors[0] + np.exp(-np.exp(rates)[None, :] * v[:, None]) @ factors[1:] - mu
    worst = int(np.abs(residuals).argmax())
    return FrictionCurve(float(factors[0]), tuple(map(float, factors[1:][order])),
                         tuple(map(float, np.exp(rates[order]))), float(abs(residuals[worst]) / mu.max()),
                         float(v[worst]))
