"""The scalar equation v + a mubar(v) = w, a >= 0, to which every implicit stage reduces.

Where F(v) = v + a mubar(v) increases (always for mu_k = mu_s; for mu_k < mu_s while a |min d(mubar)/dv| < 1), the root is
unique, has the sign of w, and lies between lower = max(|w|/(1 + a r sigma), |w| - a r) and |w|: mubar is at most
r min(1, sigma v). Newton's method runs inside that bracket, which every evaluation shrinks; once NEWTON_LIMIT steps have
passed the bracket is halved instead, so the count is at most ITERATION_BOUND whatever the input.
"""

from __future__ import annotations

from typing import Any

from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.compiled import compiled, smoothed_and_slope

NEWTON_LIMIT = 20
ITERATION_BOUND = NEWTON_LIMIT + 60
"""After NEWTON_LIMIT steps, 60 halvings shrink any bracket [0, |w|] below 1e-18 |w|."""


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
    (v in rad/s to within 4e-16 |w| + 1e-13 |v|, iterations)
    """
    if w == 0.0 or a == 0.0:
        return w, 0
    sign = 1.0 if w > 0.0 else -1.0
    target = abs(w)
    ratio = 1.0
    if stribeck is not None:
        ratio = 1.0 + stribeck[0]
    low, high = max(target / (1.0 + a * ratio * sigma), target - a * ratio), target
    v = guess * sign
    if not low <= v <= high:
        v = low
    count = 0
    while count < ITERATION_BOUND:
        count += 1
        value, slope = smoothed_and_slope(v, sigma, stribeck)
        excess = v + a * value - target
        if excess > 0.0:
            high = v
        else:
            low = v
        derivative = 1.0 + a * slope
        if count > NEWTON_LIMIT or derivative <= 0.0:
            following = 0.5 * (low + high)
        else:
            following = min(max(v - excess / derivative, low), high)
        change = abs(following - v)
        v = following
        if change <= 1e-13 * v or high - low <= 4e-16 * target:
            break
    return sign * v, count
