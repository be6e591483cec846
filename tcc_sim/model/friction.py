"""Friction laws (6) and (7) of the paper, normalised by mu_k, their slope (20b), and their maximum.

This is the only text of the law at given slip speeds. The functions take plain floats or arrays, and are compiled for
the solvers (`compiling.compiled`). Code that is written on rows of nodes, and numbers that carry their derivatives, run
the same text with functions of their own for `exp`, `tanh` and `magnitude` (`solvers.law`).

`stribeck` is (c_1, a_1, c_2, a_2, ...): the ratio of the sliding coefficient to that of fast slip is 1 + sum over j of
c_j exp(-a_j |v|). The law of the paper has one exponential, (mu_s/mu_k - 1, alpha); None means no exponential, for
mu_k = mu_s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

Stribeck = tuple[float, ...] | None
GRID = 20000
"""Slip speeds among which the first maximum of a law with several exponentials is looked for."""

def portable_exp(x: Any) -> Any:
    """Return e^x with the same bits on every processor; `np.exp` has other last bits where there is AVX-512."""
    return math.exp(x) if isinstance(x, float) else np.exp(np.asarray(x, np.longdouble)).astype(np.float64)


exp, tanh, magnitude, with_sign = portable_exp, np.tanh, np.abs, np.copysign


def decayed(rate: Any, size: Any) -> Any:
    """Return exp(-a |v|) for a rate a, s/rad, and a size |v| of the slip speed, rad/s."""
    return exp(-rate * size)


def exponentials_at(size: Any, stribeck: Any) -> Any:
    """Return c_1 exp(-a_1 |v|), the sum E of all exponentials, and the fall of E with |v|, s/rad, at a size |v|."""
    first = stribeck[0] * decayed(stribeck[1], size)
    total, fall = first, stribeck[1] * first
    for j in range(2, len(stribeck), 2):
        share = stribeck[j] * decayed(stribeck[j + 1], size)
        total = total + share
        fall = fall + stribeck[j + 1] * share
    return first, total, fall


def steepness(size: float, stribeck: tuple[float, ...]) -> float:
    """Return the sum of the sizes of the slopes of all exponentials at a size |v|, s/rad."""
    total = stribeck[1] * abs(stribeck[0]) * decayed(stribeck[1], size)
    for j in range(2, len(stribeck), 2):
        total = total + stribeck[j + 1] * abs(stribeck[j]) * decayed(stribeck[j + 1], size)
    return total  # type: ignore[no-any-return]


def step_and_rest(x: Any) -> Any:
    """Return T = tanh x and 1 - T^2 by one exponential; neither loses digits where T is nearly 1."""
    left = exp(-2.0 * magnitude(x))
    share = 1.0 / (1.0 + left)
    return with_sign((1.0 - left) * share, x), 4.0 * (left * share * share)


def with_slope(total: Any, fall: Any, side: Any, sigma: Any, step: Any, rest: Any) -> Any:
    """Return mubar = (1 + E) T and its slope (20b), s/rad, for E = `total` and its `fall`.

    T = tanh(sigma v) is `step`, and `rest` is 1 - T^2; in slip by (6) T is `side`, the sign of v, and `rest` is 0.
    """
    return (1.0 + total) * step, sigma * (1.0 + total) * rest - fall * side * step


def smoothed_coefficient(v: Any, sigma: Any, stribeck: Any) -> Any:
    """Return mubar of (7), dimensionless: [1 + (r - 1) exp(-alpha |v|)] tanh(sigma v), r = mu_s/mu_k.

    v : float or (n,) array, slip speed, rad/s
    sigma : smoothing factor, s/rad
    """
    if stribeck is None:
        return tanh(sigma * v)
    else:
        _, total, _ = exponentials_at(magnitude(v), stribeck)
        return (1.0 + total) * tanh(sigma * v)


def smoothed_and_slope(v: Any, sigma: float, stribeck: Stribeck, step: Any = None) -> Any:
    """Return mubar of (7) and its slope d(mubar)/dv of (20b), s/rad; `step` is tanh(sigma v), if already computed."""
    if step is None:
        t = tanh(sigma * v)
    else:
        t = step
    if stribeck is None:
        return t, sigma * (1.0 - t * t)
    else:
        _, total, fall = exponentials_at(magnitude(v), stribeck)
        return with_slope(total, fall, np.sign(v), sigma, t, 1.0 - t * t)


def step_at(v: float, sigma: float) -> float:
    """Return tanh(sigma v)."""
    return tanh(sigma * v)  # type: ignore[no-any-return]


def step_after(step: float, sigma: float, v: float, following: float) -> float:
    """Return tanh(sigma `following`) from `step`, tanh(sigma v)."""
    angle = sigma * (following - v)
    if abs(angle) < 1e-2:
        # tanh(a + b) from tanh(a) and the series of tanh(b), which is exact to the last bit here.
        square = angle * angle
        change = angle * (1.0 - square * (1.0 / 3.0 - square * (2.0 / 15.0 - square * (17.0 / 315.0))))
        return (step + change) / (1.0 + step * change)
    else:
        return step_at(following, sigma)


def sliding(v: Any, sign: Any, stribeck: Any) -> Any:
    """Return the coefficient of (6) while slipping in direction `sign` (+1 or -1); at v = 0 it is sign * mu_s/mu_k."""
    if stribeck is None:
        return sign
    else:
        _, total, _ = exponentials_at(sign * v, stribeck)
        return (1.0 + total) * sign


def sliding_slope(v: Any, stribeck: Stribeck) -> Any:
    """Return the slope of the coefficient of (6) over |v|, s/rad, at v, a float or an array."""
    return 0.0 * v if stribeck is None else -exponentials_at(np.abs(v), stribeck)[2]


def steepest_fall(stribeck: Stribeck) -> float:
    """Return a bound of the falling slope of the sliding coefficient, relative to that of fast slip, s/rad."""
    steepest = 0.0
    if stribeck is not None:
        for j in range(0, len(stribeck), 2):
            steepest = steepest + max(stribeck[j], 0.0) * stribeck[j + 1]
    return steepest


def largest_ratio(stribeck: Stribeck) -> float:
    """Return an upper bound of the sliding coefficient, relative to that of fast slip."""
    ratio = 1.0
    if stribeck is not None:
        for j in range(0, len(stribeck), 2):
            ratio = ratio + max(stribeck[j], 0.0)
    return ratio


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
    high = 20.0 / sigma + (math.log(sigma + decay) - math.log(decay)) / sigma
    if not _falls(high, sigma, stribeck):
        if decay <= 2.0 * sigma or excess <= 1.0:
            return math.inf, 1.0
        # mubar finally rises to 1; it falls before that only if it falls at the closest approach of both shares.
        high = onset(math.log(excess) / (decay - 2.0 * sigma), _past_closest, 0.0, sigma, stribeck)
        if not _falls(high, sigma, stribeck):
            return math.inf, 1.0
    v = onset(high, _falls, 0.0, sigma, stribeck)
    return v, float(smoothed_coefficient(v, sigma, stribeck))


def _falls(v: float, sigma: float, stribeck: tuple[float, ...]) -> bool:
    """Return whether (7) with one exponential falls at v > 0, by logarithms of the falling and the rising share."""
    push = stribeck[1] * v - math.log(stribeck[0])
    rising = math.log(4.0 * sigma / stribeck[1]) + max(push, 0.0) + math.log1p(math.exp(-abs(push)))
    return 2.0 * sigma * v + math.log(-math.expm1(-4.0 * sigma * v)) - rising > 0.0


def _past_closest(v: float, sigma: float, stribeck: tuple[float, ...]) -> bool:
    """Return whether v > 0 is beyond the closest approach of both shares, cosh(2 sigma v) = exp(alpha v)/(r - 1)."""
    growing = 2.0 * sigma * v
    return stribeck[1] * v - math.log(stribeck[0]) >= growing + math.log1p(math.exp(-2.0 * growing)) - math.log(2.0)


def _peak_of_several(sigma: float, stribeck: tuple[float, ...]) -> tuple[float, float]:
    """Return the maximum of a law with several exponentials at the first sign change of the slope, else (inf, 1).

    A maximum to which the sliding coefficient rises from v = 0 does not count: it is a part of slip.
    """
    slowest = stribeck[1]
    for j in range(2, len(stribeck), 2):
        slowest = min(slowest, stribeck[j + 1])
    first = 1e-4 / sigma
    step = math.log((40.0 / sigma + 40.0 / slowest) / first) / (GRID - 1.0)
    v = first * exp(step * np.arange(GRID))
    falls = fall_of_several(v, sigma, stribeck) > 0.0
    k = int(np.argmax(falls))
    if not falls[k]:
        return math.inf, 1.0
    low = float(v[k - 1]) if k > 0 else 0.0
    at = onset(float(v[k]), _several_fall, low, sigma, stribeck)
    if sliding(at, 1.0, stribeck) >= sliding(0.0, 1.0, stribeck):
        return math.inf, 1.0
    return at, float(smoothed_coefficient(at, sigma, stribeck))


def fall_of_several(v: Any, sigma: float, stribeck: tuple[float, ...]) -> Any:
    """Return -mubar'/(sigma (1 - T^2)) of (7) at v > 0, positive where mubar falls; it keeps its digits where tanh is
    nearly 1.
    """
    _, total, steep = exponentials_at(v, stribeck)
    grown = exp(np.minimum(2.0 * sigma * v, 600.0))
    return steep * 0.25 * (grown - 1.0 / grown) / sigma - (1.0 + total)


def _several_fall(v: float, sigma: float, stribeck: tuple[float, ...]) -> bool:
    """Return whether (7) with several exponentials falls at v > 0."""
    return bool(fall_of_several(v, sigma, stribeck) > 0.0)


def onset(high: float, holds: Callable[..., bool], low: float = 0.0, *further: Any) -> float:
    """Bisect to the last bit for the onset of a condition holds(x, *further) that holds at `high`, but not at `low`."""
    while low < (middle := 0.5 * (low + high)) < high:
        if holds(middle, *further):
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
