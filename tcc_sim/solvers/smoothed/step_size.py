"""How long the next step is.

A series step ends where its last two terms reach the tolerance (A. Jorba and M. Zou, Experimental Mathematics 14, 2005,
Sec. 3.2). A collocation step takes a rung of a ladder: the longest whose error is expected to pass, the error of a
polynomial of degree s going as h^s (K. Gustafsson's elementary controller; Hairer and Wanner, Sec. IV.8).
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.series import ENDLESS, INVERSE, SLIP, SPEED, logarithm, power_of_two
from tcc_sim.solvers.smoothed.collocation_tables import NODES

SAFETY_SERIES = 0.905
SAFETY = 0.85
SHRINK_MOST = 0.25
SMALLEST_ERROR = 1e-9
"""Errors below are rounding, and say nothing of the length."""


@fast
def series_length(rows: Any, order: int, slip_tolerance: float, speed_tolerance: float) -> float:
    """The step, in units of the series' own time, at which its last two terms reach the tolerance."""
    longest = ENDLESS
    for k in range(order - 1, order + 1):
        size = max(abs(rows[SLIP, k]) / slip_tolerance, abs(rows[SPEED, k]) / speed_tolerance)
        if not size < math.inf:
            return math.nan
        if size > 0.0:
            longest = min(longest, logarithm(1.0 / size) * INVERSE[k])
    return float(SAFETY_SERIES * power_of_two(longest))


@fast
def converging_length(rows: Any, order: int, x: float, sign: float, excess: float, decay: float, strength: float,
                      slip_tolerance: float) -> float:
    """A step of at most x over which the series of excess * exp(-decay |v|) is accurate too.

    While slip dies down the coefficients of that series rise up to order z = decay |change of v|, far beyond the last
    ones kept where z is large, which the last two terms do not show. (Below z = order/2 they do: each is at most half
    of the one before.) Lagrange's remainder z^(p + 1)/(p + 1)! does, times the larger of the two end values of the
    exponential.
    """
    change = decay * sign * (rows[SLIP, 1] * x + rows[SLIP, 2] * x * x)
    if abs(change) <= 0.5 * order:
        return x
    goal = math.log(slip_tolerance) + math.lgamma(order + 2.0)
    while abs(change) > 0.5 * order:
        remainder = math.log(strength * excess * x) - decay * abs(rows[SLIP, 0]) + max(-change, 0.0)
        if not remainder + (order + 1.0) * math.log(abs(change)) > goal:
            break
        x *= 0.85
        change = decay * sign * (rows[SLIP, 1] * x + rows[SLIP, 2] * x * x)
    return x


@fast
def rung_below(rungs: Any, level: int, length: float) -> int:
    """The longest rung from `level` on that is at most `length`; their number where there is none."""
    while level < rungs.shape[0] and rungs[level].length > length:
        level += 1
    return level


@fast
def growth(error: float) -> float:
    """Factor to the length at which the error, relative to what is allowed, is expected to be a little below 1."""
    return max(SAFETY * math.exp(-math.log(max(error, SMALLEST_ERROR)) / NODES), SHRINK_MOST)
