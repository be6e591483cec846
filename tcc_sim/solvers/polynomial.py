"""What a step's polynomial of the slip speed says: its values, the first crossing of a level, its extrema.

Nothing is decided from values at the ends of a step: a bound on the second derivative over the whole step gives steps
of the search that cannot pass a root, so a dip into the layer and out again within one step is found. A polynomial is a
row of an array of coefficients: a view of the row would cost two atomic reference counts at every call.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.solvers.compiled import compiled_without_allocation

SEARCH_MAXIMUM = 200


@compiled_without_allocation
def value(c: Any, row: int, degree: int, x: float) -> float:
    """The polynomial sum of c[row, k] x^k, k = 0 to degree."""
    out = c[row, degree]
    for k in range(degree - 1, -1, -1):
        out = out * x + c[row, k]
    return float(out)


@compiled_without_allocation
def value_and_slope(c: Any, row: int, degree: int, x: float) -> tuple[float, float]:
    """The polynomial and its first derivative."""
    out = c[row, degree]
    slope = 0.0
    for k in range(degree - 1, -1, -1):
        slope = slope * x + out
        out = out * x + c[row, k]
    return out, slope


@compiled_without_allocation
def slope_and_curvature(c: Any, row: int, degree: int, x: float) -> tuple[float, float]:
    """First and second derivative of the polynomial."""
    slope = 0.0
    curvature = 0.0
    for k in range(degree, 0, -1):
        curvature = curvature * x + slope
        slope = slope * x + k * c[row, k]
    return slope, curvature


@compiled_without_allocation
def variation(c: Any, row: int, degree: int, x: float) -> float:
    """A bound on how far the polynomial moves from its first value over [0, x]."""
    out = 0.0
    for k in range(degree, 0, -1):
        out = (out + abs(c[row, k])) * x
    return out


@compiled_without_allocation
def curvature_bound(c: Any, row: int, degree: int, x: float, derivative: int) -> float:
    """A bound over [0, x] on the second derivative of the polynomial (derivative 0) or of its slope (derivative 1)."""
    out = 0.0
    for k in range(degree, 1 + derivative, -1):
        factor = k * (k - 1.0) * (k - 2.0 if derivative == 1 else 1.0)
        out = out * x + factor * abs(c[row, k])
    return out


@compiled_without_allocation
def safe_advance(q: float, slope: float, bound: float) -> float:
    """How far a function of value q >= 0 and this slope surely stays positive, its second derivative being bounded."""
    if bound <= 0.0:
        return math.inf if slope >= 0.0 else -q / slope
    root = math.sqrt(slope * slope + 2.0 * bound * q)
    if slope >= 0.0:
        return (slope + root) / bound
    return 2.0 * q / (root - slope)


@compiled_without_allocation
def first_crossing(c: Any, row: int, degree: int, x_end: float, sign: float, level: float, accuracy: float) -> float:
    """First x in [0, x_end] at which sign * polynomial falls to `level`; inf if it does not."""
    if sign * c[row, 0] - variation(c, row, degree, x_end) > level:
        return math.inf
    bound = curvature_bound(c, row, degree, x_end, 0)
    x = 0.0
    for _ in range(SEARCH_MAXIMUM):
        v, slope = value_and_slope(c, row, degree, x)
        q = sign * v - level
        if q <= accuracy and slope * sign < 0.0:
            return x
        x += max(safe_advance(max(q, 0.0), sign * slope, bound), 1e-15 * x_end)
        if x >= x_end:
            return math.inf
    return x


@compiled_without_allocation
def stick_crossing(c: Any, row: int, degree: int, x_start: float, x_end: float, mode: int, level: float) -> float:
    """First x in (x_start, x_end] at which the slip speed leaves `mode` (-1, 0, 1: slip, stick at |v| <= level, slip).
    """
    bound = curvature_bound(c, row, degree, x_end, 0)
    x = x_start
    for _ in range(SEARCH_MAXIMUM):
        v, slope = value_and_slope(c, row, degree, x)
        if mode == 0:
            q, way = (level - v, -slope) if (v > 0.0) else (level + v, slope)
            other, back = (level + v, slope) if (v > 0.0) else (level - v, -slope)
            advance = min(safe_advance(max(q, 0.0), way, bound), safe_advance(max(other, 0.0), back, bound))
        else:
            q, way = mode * v - level, mode * slope
            advance = safe_advance(max(q, 0.0), way, bound)
        if q <= 1e-11 * level and way < 0.0:
            return x
        x += max(advance, 1e-15 * x_end)
        if x >= x_end:
            return math.inf
    return math.inf


@compiled_without_allocation
def extremes(c: Any, row: int, degree: int, x_end: float, highest: float, lowest: float) -> tuple[float, float]:
    """`highest` and `lowest` widened by what the polynomial reaches over [0, x_end]."""
    end = value(c, row, degree, x_end)
    highest = max(highest, end)
    lowest = min(lowest, end)
    reach = variation(c, row, degree, x_end)
    if c[row, 0] + reach <= highest and c[row, 0] - reach >= lowest:
        return highest, lowest
    turning = 0.0
    for k in range(degree, 1, -1):
        turning = (turning + k * abs(c[row, k])) * x_end
    if turning < abs(c[row, 1]):
        return highest, lowest
    bound = curvature_bound(c, row, degree, x_end, 1)
    resolution = 1e-9 * (turning + abs(c[row, 1]))
    x = 0.0
    slope, curvature = slope_and_curvature(c, row, degree, x)
    rising = slope > 0.0 or (slope == 0.0 and curvature > 0.0)
    for _ in range(SEARCH_MAXIMUM):
        q, way = (slope, curvature) if rising else (-slope, -curvature)
        if q <= resolution and way <= 0.0:
            v = value(c, row, degree, x)
            highest = max(highest, v)
            lowest = min(lowest, v)
            rising = not rising
            q, way = -q, -way
        x += max(safe_advance(max(q, 0.0), way, bound), 1e-4 * x_end if q <= resolution else 1e-9 * x_end)
        if x >= x_end:
            break
        slope, curvature = slope_and_curvature(c, row, degree, x)
    return highest, lowest
