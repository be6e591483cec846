"""The scalar equation v + a mubar(v) = w, a >= 0, to which every implicit stage reduces.

Where F(v) = v + a mubar(v) increases (always for mu_k = mu_s; for mu_k < mu_s while a |min d(mubar)/dv| < 1), the root
is unique, has the sign of w, and lies between lower = max(|w|/(1 + a r sigma), |w| - a r) and |w|: mubar is at most r
min(1, sigma v). Newton's method runs inside that bracket, which every evaluation shrinks; once NEWTON_LIMIT steps have
passed the bracket is halved instead, so the count is at most ITERATION_BOUND whatever the input.

After a small Newton step v is much nearer to the root than the step is long; a small halving proves only that the
bracket is short. So after a halving the equation itself is checked, and halving goes on until it holds.
"""

from __future__ import annotations

from typing import Any

from tcc_sim.compiling.compiled import (
    compiled,
    largest_ratio,
    smoothed_and_slope,
    step_after,
    step_at,
)
from tcc_sim.model.friction import Stribeck

NEWTON_LIMIT = 20
SATURATED = 19.1
"""tanh(x) is 1 to the last bit beyond this."""
ITERATION_BOUND = NEWTON_LIMIT + 60
"""After NEWTON_LIMIT steps, 60 halvings shrink any bracket [0, |w|] below 1e-18 |w|."""

ROUNDING = 1e-15
"""Rounding of v + a mubar(v) - w over |w|: four or five operations, tanh and the exponential among them."""


@compiled
def scalar_root(w: float, a: float, guess: float, sigma: Any, stribeck: Stribeck) -> tuple[float, int]:
    """The root v of v + a mubar(v) = w and the iterations that it took, at most ITERATION_BOUND.

    Parameters
    ----------
    w : right-hand side, rad/s
    a : step times inertia times saturation torque, rad/s, at least 0
    guess : where to start if it lies in the bracket (the root of the stage before), rad/s
    sigma, stribeck : the smoothed law (7), see `model.friction`

    Returns
    -------
    (v in rad/s to within 2e-15 |w| + 1e-13 |v| where F' is at least 1/2, which sub-steps see to; iterations)
    """
    if w == 0.0 or a == 0.0:
        return w, 0
    sign = 1.0 if w > 0.0 else -1.0
    target = abs(w)
    ratio = largest_ratio(stribeck)
    if stribeck is None:  # noqa: SIM102 (Numba leaves out what None rules out only where it is a test of its own)
        if (target - a) * sigma > SATURATED:
            # Slip with mu_k = mu_s: tanh is 1 to the last bit, and nothing is left to solve.
            return sign * (target - a), 0
    low, high = max(target / (1.0 + a * ratio * sigma), target - a * ratio), target
    v = guess * sign
    if not low <= v <= high:
        v = low
    step = step_at(v, sigma)
    count, near = 0, False
    while count < ITERATION_BOUND:
        count += 1
        value, slope = smoothed_and_slope(v, sigma, stribeck, step)
        excess = v + a * value - target
        if excess > 0.0:
            high = v
        else:
            low = v
        derivative = 1.0 + a * slope
        if near and abs(excess) <= derivative * (ROUNDING * target + 1e-13 * v):
            break
        halving = count > NEWTON_LIMIT or derivative <= 0.0
        following = 0.5 * (low + high) if halving else min(max(v - excess / derivative, low), high)
        change = abs(following - v)
        step = step_after(step, sigma, v, following)
        v = following
        # F''/(2 F') is at most about sigma, so the error that is left is at most sigma change^2; 4 is for safety.
        near = 4.0 * sigma * change * change <= 1e-13 * v
        if (near and not halving) or high - low <= 4e-16 * target:
            break
    return sign * v, count
