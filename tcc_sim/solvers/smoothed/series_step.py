"""A step of Taylor series: slip, the layer while friction's own rate does not limit the step, and free motion.

It ends where its last two terms reach the tolerance (A. Jorba and M. Zou, Experimental Mathematics 14, 2005, Sec. 3.2).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tcc_sim.compiling.compiled import exponentials_at, fast, lost_torque, step_and_rest, with_slope
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.excitation import expand_excitation
from tcc_sim.solvers.series import ANGLE, ENDLESS, INVERSE, SLIP, SPEED, expand, fastest_at, logarithm, power_of_two
from tcc_sim.solvers.smoothed.setup import ACCEPTED, FAILED, Limits, Step
from tcc_sim.solvers.stages import FALLING, LAYER, SLIDING, Place
from tcc_sim.solvers.terms import Terms

TAIL_OF_TANH = 3.0
"""sigma |v| above which tanh(sigma |v|) is 1 - 2 exp(-2 sigma |v|) and its series converges like the exponential's."""
SAFETY_SERIES = 0.905


class LocalFriction(NamedTuple):
    """Friction at the state: mubar, its slope (s/rad); value c exp(-a |v|) of the first exponential, tanh(sigma v),
    1 - tanh^2; v' (rad/s^2).
    """

    law: float
    slope: float
    excess: float
    tanh: float
    sech: float
    acceleration: float


@fast
def law_here(v: float, sign: float, region: int, sigma: float,
             stribeck: Stribeck) -> tuple[float, float, float, float, float]:
    """Return the first five fields of LocalFriction by the law in the region; sign is 0 without load."""
    tanh, sech = sign, 0.0
    if region == LAYER:
        tanh, sech = step_and_rest(sigma * v)
    if stribeck is None:
        return tanh, sigma * sech, 0.0, tanh, sech
    else:
        first, total, fall = 0.0, 0.0, 0.0
        if region != SLIDING:
            first, total, fall = exponentials_at(sign * v, stribeck)
        law, slope = with_slope(total, fall, sign, sigma, tanh, sech)
        return law, slope, first, tanh, sech


@fast
def friction_here(place: Place, state: Any, limits: Limits, terms: Terms, drive: Any) -> LocalFriction:
    """Return friction and slip acceleration at the state."""
    law, slope, excess, tanh, sech = law_here(state.slip_speed, place.sign, place.region, limits.sigma,
                                                terms.stribeck)
    linear, v, plate_speed = terms.linear, state.slip_speed, state.plate_speed
    torque = law * drive.load
    pull = (torque - (linear.damping * plate_speed + linear.stiffness * state.plate_angle)
            - lost_torque(v, plate_speed, linear.plate_by_slip, None))
    push = drive.torque - torque - lost_torque(v, plate_speed, linear.flywheel_by_slip, linear.flywheel_by_speed)
    return LocalFriction(law, slope, excess, tanh, sech, push / linear.flywheel - pull / linear.plate)


@fast
def expand_region(order: int, rows: Any, unit: float, terms: Terms, sigma: float, place: Place, friction: LocalFriction,
                  pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Expand the motion with the parts of the law that vary in the region: the exponential, and in the layer tanh."""
    sign = place.sign
    if place.region == LAYER:
        if stribeck is None:
            expand(order, rows, unit, terms.linear, sign, pulsation, None, None, sigma, friction.tanh, friction.sech)
        else:
            expand(order, rows, unit, terms.linear, sign, pulsation, stribeck, friction.excess, sigma,
                   friction.tanh, friction.sech)
    elif place.region == SLIDING:
        expand(order, rows, unit, terms.linear, sign, pulsation, None, None, None, None, None)
    elif stribeck is not None:
        expand(order, rows, unit, terms.linear, sign, pulsation, stribeck, friction.excess, None, None, None)


@fast
def rate_of_law(region: int, sigma: float, stribeck: Stribeck) -> float:
    """Return the rate of mubar by v in a region, s/rad: the exponential's, and that of tanh."""
    rate = sigma if region == LAYER else 0.0
    if stribeck is not None and region != SLIDING:
        rate += fastest_at(stribeck, 0.0)
    return rate


@fast
def series_length(rows: Any, order: int, slip_tolerance: float, speed_tolerance: float) -> float:
    """Return the length, in units of time of the series, at which its last two terms reach the tolerance."""
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
    """Return a length of at most x over which the series of excess * exp(-decay |v|) is accurate too.

    While |v| falls the coefficients of that series rise up to order z = decay |change of v|. If z exceeds half the
    order, the last two terms do not bound the error; Lagrange's remainder z^(p + 1)/(p + 1)!, times the larger of the
    two end values of the exponential, does.
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
def exponential_length(rows: Any, order: int, x: float, place: Place, v: float, strength: float, sigma: float,
                       stribeck: Stribeck) -> float:
    """Return `converging_length` for the exponentials that vary in the region."""
    if place.region == FALLING and stribeck is not None:
        for j in range(0, len(stribeck), 2):
            x = converging_length(rows, order, x, place.sign, abs(stribeck[j]), stribeck[j + 1], strength,
                                  place.slip_tolerance)
        return x
    if place.region == LAYER and sigma * abs(v) > TAIL_OF_TANH:
        return float(converging_length(rows, order, x, place.sign, 2.0, 2.0 * sigma, strength, place.slip_tolerance))
    return x


@fast
def series_step(place: Place, friction: LocalFriction, remaining: float, loaded: bool, state: Any, limits: Limits,
                terms: Terms, waves: Any, drive: Any, work: Any) -> Step:
    """Expand the motion; return the step up to which the series hold, at most `remaining` s.

    Time is scaled by the sum of all rates, friction's own rho among them, so that no coefficient overflows.
    """
    rate = limits.base_rate
    order = limits.linear_order
    if place.region != SLIDING:
        order = limits.order
        rate += (rate_of_law(place.region, limits.sigma, terms.stribeck) * abs(friction.acceleration)
                 + limits.beta * drive.load * abs(friction.slope))
    unit = 1.0 / rate
    rows = work.rows
    rows[SLIP, 0] = state.slip_speed
    rows[ANGLE, 0] = state.plate_angle
    rows[SPEED, 0] = state.plate_speed
    expand_excitation(rows, order, unit, state.tau, loaded, terms.mean_torque, waves, terms.mean_load, terms.pulsation,
                      terms.profile, drive)
    expand_region(order, rows, unit, terms, limits.sigma, place, friction, terms.pulsation, terms.stribeck)
    x = series_length(rows, order, place.slip_tolerance, place.speed_tolerance)
    x = min(x, min(remaining, 0.5 * limits.period) / unit)
    if not x > 0.0:
        return Step(FAILED, unit, x, order, 0.0)
    if place.region != SLIDING:
        x = exponential_length(rows, order, x, place, state.slip_speed, limits.strength * unit, limits.sigma,
                               terms.stribeck)
    return Step(ACCEPTED, unit, x, order, 0.0)
