"""Friction laws (6) and (7) of the paper, normalised by mu_k, their slope (20b), and where they peak.

The functions take plain floats or arrays and are compiled for the solvers from this same text. `stribeck` is
(mu_s/mu_k - 1, alpha), or None where mu_k = mu_s: then there is no exponential.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

Stribeck = tuple[float, float] | None


def smoothed(v: Any, sigma: float, stribeck: Stribeck) -> Any:
    """Smoothed coefficient mubar of (7): [1 + (r - 1) exp(-alpha |v|)] tanh(sigma v), r = mu_s/mu_k.

    Parameters
    ----------
    v : float or (n,) array, slip speed, rad/s
    sigma : smoothing factor, s/rad
    stribeck : (r - 1, alpha in s/rad), or None where mu_k = mu_s

    Returns
    -------
    float or (n,) array, dimensionless
    """
    if stribeck is None:
        return np.tanh(sigma * v)
    else:
        return (1.0 + stribeck[0] * np.exp(-stribeck[1] * np.abs(v))) * np.tanh(sigma * v)


def smoothed_and_slope(v: Any, sigma: float, stribeck: Stribeck, tanh: Any = None) -> Any:
    """mubar of (7) and its slope d(mubar)/dv of (20b), s/rad; `tanh` is tanh(sigma v) where it is known already."""
    if tanh is None:
        step = np.tanh(sigma * v)
    else:
        step = tanh
    if stribeck is None:
        return step, sigma * (1.0 - step * step)
    else:
        falling = stribeck[0] * np.exp(-stribeck[1] * np.abs(v))
        slope = sigma * (1.0 + falling) * (1.0 - step * step) - stribeck[1] * falling * np.sign(v) * step
        return (1.0 + falling) * step, slope


def sliding(v: Any, sign: float, stribeck: Stribeck) -> Any:
    """Set-valued coefficient of (6) while slipping in direction `sign` (+1 or -1); at v = 0 it is sign * mu_s/mu_k."""
    if stribeck is None:
        return sign
    else:
        return sign * (1.0 + stribeck[0] * np.exp(-stribeck[1] * sign * v))


@lru_cache(maxsize=256)
def peak(sigma: float, stribeck: Stribeck) -> tuple[float, float]:
    """Slip speed (rad/s) and value of the maximum of the smoothed mubar (7), the root of the slope (20b).

    Where mu_k = mu_s the law has no maximum: (inf, 1). The peak lies below mu_s/mu_k and falls with it (Fig. 3).
    """
    if stribeck is None:
        return math.inf, 1.0
    if stribeck[1] == 0.0:
        return math.inf, 1.0 + stribeck[0]
    excess, decay = stribeck

    def slope(v: float) -> float:
        """Slope (20b) over (r - 1) exp(-alpha v): it falls from above 0 to below it, once."""
        step = math.tanh(sigma * v)
        return sigma * (math.exp(min(decay * v, 700.0)) / excess + 1.0) * (1.0 - step * step) - decay * step

    low, high = 0.0, 20.0 / sigma + (math.log(sigma + decay) - math.log(decay)) / sigma
    if excess == 0.0 or smoothed_and_slope(high, sigma, stribeck)[1] > 0.0:
        return math.inf, 1.0
    at, below, above = 0.5 * math.log(sigma / decay + 1.0) / sigma, slope(low), slope(high)
    while low < at < high:  # Illinois: a secant in the bracket, of which an end that stays counts half.
        value = slope(at)
        if value > 0.0:
            low, below, above = at, value, 0.5 * above
        else:
            high, above, below = at, value, 0.5 * below
        at = high - above * (high - low) / (above - below)
        if high - low < 1e-12 * high:
            at = 0.5 * (low + high)
    return high, float(smoothed(high, sigma, stribeck))


def stick_speed(sigma: float, stribeck: Stribeck) -> float:
    """Slip speed, rad/s, at or below which the smoothed law counts as stick.

    It is where mubar peaks; where there is no peak (mu_k = mu_s), where tanh(sigma |v|) = 0.99.
    """
    v, _ = peak(sigma, stribeck)
    return v if math.isfinite(v) else math.atanh(0.99) / sigma
