"""Friction laws (6) and (7) of the paper, normalised by mu_k, their slope (20b), and their maximum.

The functions take plain floats or arrays, and are compiled for the solvers. `stribeck` is (c_1, a_1, c_2, a_2, ...):
the ratio of the sliding coefficient to that of fast slip is 1 + sum over j of c_j exp(-a_j |v|). The law of the paper
has one exponential, (mu_s/mu_k - 1, alpha); None means no exponential, for mu_k = mu_s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

Stribeck = tuple[float, ...] | None


def smoothed_coefficient(v: Any, sigma: float, stribeck: Stribeck) -> Any:
    """Return mubar of (7), dimensionless: [1 + (r - 1) exp(-alpha |v|)] tanh(sigma v), r = mu_s/mu_k.

    Parameters
    ----------
    v : float or (n,) array, slip speed, rad/s
    sigma : smoothing factor, s/rad
    """
    if stribeck is None:
        return np.tanh(sigma * v)
    else:
        ratio = 1.0 + stribeck[0] * np.exp(-stribeck[1] * np.abs(v))
        for j in range(2, len(stribeck), 2):
            ratio = ratio + stribeck[j] * np.exp(-stribeck[j + 1] * np.abs(v))
        return ratio * np.tanh(sigma * v)


def smoothed_and_slope(v: Any, sigma: float, stribeck: Stribeck, tanh: Any = None) -> Any:
    """Return mubar of (7) and its slope d(mubar)/dv of (20b), s/rad; `tanh` is tanh(sigma v), if already computed."""
    if tanh is None:
        step = np.tanh(sigma * v)
    else:
        step = tanh
    if stribeck is None:
        return step, sigma * (1.0 - step * step)
    else:
        falling = stribeck[0] * np.exp(-stribeck[1] * np.abs(v))
        steep = stribeck[1] * falling
        for j in range(2, len(stribeck), 2):
            share = stribeck[j] * np.exp(-stribeck[j + 1] * np.abs(v))
            falling = falling + share
            steep = steep + stribeck[j + 1] * share
        slope = sigma * (1.0 + falling) * (1.0 - step * step) - steep * np.sign(v) * step
        return (1.0 + falling) * step, slope


def sliding(v: Any, sign: Any, stribeck: Stribeck) -> Any:
    """Return the coefficient of (6) while slipping in direction `sign` (+1 or -1); at v = 0 it is sign * mu_s/mu_k."""
    if stribeck is None:
        return sign
    else:
        ratio = 1.0 + stribeck[0] * np.exp(-stribeck[1] * sign * v)
        for j in range(2, len(stribeck), 2):
            ratio = ratio + stribeck[j] * np.exp(-stribeck[j + 1] * sign * v)
        return sign * ratio


def sliding_slope(v: Any, stribeck: Stribeck) -> Any:
    """Return the slope of the coefficient of (6) over |v|, s/rad, at v, a float or an array."""
    return sum((-a * c * np.exp(-a * np.abs(v)) for c, a in exponentials(stribeck)), 0.0 * v)


def steepest_fall(stribeck: Stribeck) -> float:
    """Return a bound of the falling slope of the sliding coefficient, relative to that of fast slip, s/rad."""
    return sum(max(share, 0.0) * rate for share, rate in exponentials(stribeck))


def largest_ratio(stribeck: Stribeck) -> float:
    """Return an upper bound of the sliding coefficient, relative to that of fast slip."""
    return 1.0 + sum(max(share, 0.0) for share, _ in exponentials(stribeck))


def exponentials(stribeck: Stribeck) -> list[tuple[float, float]]:
    """Return pairs of amplitude and rate (s/rad)."""
    return [] if stribeck is None else list(zip(stribeck[::2], stribeck[1::2]))


@lru_cache(maxsize=256)
def peak(sigma: float, stribeck: Stribeck) -> tuple[float, float]:
    """Return slip speed (rad/s) and value of the first maximum of the smoothed mubar (7), the root of the slope (20b).

    The slope is negative if alpha sinh(2 sigma v) > 2 sigma (1 + exp(alpha v)/(r - 1)). Logarithms are compared,
    because 1 - tanh^2 underflows before an exponential that decays faster. For mu_k = mu_s, or if the exponential has
    decayed before tanh reaches 1, the law has no maximum: (inf, 1). The maximum is below mu_s/mu_k and falls with it
    (Fig. 3).
    """
    if stribeck is None:
        return math.inf, 1.0
    if len(stribeck) > 2:
        return _peak_of_several(sigma, stribeck)
    excess, decay = stribeck
    if decay == 0.0:
        return math.inf, 1.0 + excess
    if excess <= 0.0:
        return math.inf, 1.0

    step, rate = math.log(excess), math.log(4.0 * sigma / decay)

    def fall(v: float) -> float:
        """Return the logarithm of the falling over the rising share of the slope at v > 0."""
        push = decay * v - step
        rising = rate + max(push, 0.0) + math.log1p(math.exp(-abs(push)))
        return 2.0 * sigma * v + math.log(-math.expm1(-4.0 * sigma * v)) - rising

    high = 20.0 / sigma + (math.log(sigma + decay) - math.log(decay)) / sigma
    if fall(high) <= 0.0:
        if decay <= 2.0 * sigma or excess <= 1.0:
            return math.inf, 1.0
        # mubar finally rises to 1; it falls before that only if it falls at the closest approach of both shares, where
        # cosh(2 sigma v) = exp(alpha v)/(r - 1).
        high = onset(step / (decay - 2.0 * sigma), lambda v: decay * v - step >= float(
            np.logaddexp(2.0 * sigma * v, -2.0 * sigma * v)) - math.log(2.0))
        if fall(high) <= 0.0:
            return math.inf, 1.0
    low, high = _around(fall, 1e-3 / sigma, high)
    v = onset(high, lambda v: fall(v) > 0.0, low)
    return v, float(smoothed_coefficient(v, sigma, stribeck))


def _peak_of_several(sigma: float, stribeck: tuple[float, ...]) -> tuple[float, float]:
    """Return the maximum of a law with several exponentials at the first sign change of the slope, else (inf, 1).

    A maximum to which the sliding coefficient rises from v = 0 does not count: it is a part of slip. The slope is
    divided by 1 - tanh^2 to keep its digits where tanh is nearly 1.
    """
    def fall(v: Any) -> Any:
        """Return -mubar'/(sigma (1 - T^2)), which is positive where mubar falls."""
        ratio = 1.0 + sum(c * np.exp(-a * v) for c, a in exponentials(stribeck))
        return -sliding_slope(v, stribeck) * 0.5 * np.sinh(np.minimum(2.0 * sigma * v, 600.0)) / sigma - ratio

    v = np.geomspace(1e-4 / sigma, 40.0 / sigma + 40.0 / min(stribeck[1::2]), 20000)
    falls = np.flatnonzero(fall(v) > 0.0)
    if len(falls) == 0:
        return math.inf, 1.0
    at = onset(float(v[falls[0]]), lambda x: bool(fall(x) > 0.0), float(v[falls[0] - 1]) if falls[0] else 0.0)
    if sliding(at, 1.0, stribeck) >= sliding(0.0, 1.0, stribeck):
        return math.inf, 1.0
    return at, float(smoothed_coefficient(at, sigma, stribeck))


def _around(f: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return a narrow bracket of a root of f, positive at `high`, by the Illinois method, else (0, high)."""
    below, above = f(low), f(high)
    if not below < 0.0:
        return 0.0, high
    for _ in range(40):
        at = high - above * (high - low) / (above - below)
        if not low < at < high or high - low < 1e-13 * high:
            break
        value = f(at)
        if value > 0.0:
            high, above, below = at, value, 0.5 * below
        else:
            low, below, above = at, value, 0.5 * above
    return low, high


def onset(high: float, holds: Callable[[float], bool], low: float = 0.0) -> float:
    """Bisect to the last bit for the onset of a condition that holds at `high`, but not at `low`."""
    while low < (middle := 0.5 * (low + high)) < high:
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def stick_speed(sigma: float, stribeck: Stribeck) -> float:
    """Return the slip speed, rad/s, up to which the smoothed law counts as stick.

    This is the slip speed of the maximum of mubar; without a maximum (mu_k = mu_s, or sliding friction that rises), of
    tanh(sigma |v|) = 0.99.
    """
    v, _ = peak(sigma, stribeck)
    return v if math.isfinite(v) else math.atanh(0.99) / sigma
