"""What the smoothed kernel is given: tolerances, where the parts of the friction law matter, rates, orders; and what it
changes as it goes, named fields of one-element arrays, each one pointer in compiled code.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.model import friction
from tcc_sim.solvers.series import FRICTION_ORDER_MAXIMUM, ORDER_MAXIMUM
from tcc_sim.solvers.terms import (
    Terms,
    excitation_frequency,
    largest_mean_torque,
    load_frequency,
    peak_load,
    steps_allowed,
    stick_speed_of,
    torque_swing,
)

LOCAL = 0.1
"""Tolerance of one step per relative tolerance asked for: leaving stick amplifies what a step leaves behind."""
CREEP_ERROR = 2.0
"""Error of sigma v, and so of mubar, in one step in stick, per relative tolerance asked for."""
TANH_LEFT_OUT = 0.3
"""What of tanh is left out outside the layer, 1 - tanh(sigma |v|), per relative tolerance asked for."""
EXPONENTIAL_LEFT_OUT = 0.03
"""What of the Stribeck exponential is left out far from v = 0, per relative tolerance asked for."""
FALLING_ERROR = 1e-2
"""Largest error of alpha v in one step where the exponential varies: however large v is elsewhere in the motion, a step
from the edge of the layer must not come back to it by its error."""
RESOLVED = 1e3
"""Error of a change that decays within one series step, relative to it, per tolerance of the step: it is made again
smaller by what decays afterwards."""
FLAT_PEAK = 1e-6
"""Where mu_k = mu_s, or where alpha = 0, mubar only tends to its limit: stick asks for less than that by this share."""


class Limits(NamedTuple):
    """Speeds in rad/s, times in s, rates in 1/s.

    period : one engine cycle
    sigma : smoothing factor, s/rad
    rtol : tolerance of a series step relative to the motion
    slip_floor, speed_floor : sizes below which v and theta2' count as this large
    layer_tolerance, falling_tolerance : largest error of v of a step in the layer, and where the exponential varies
    creep_tolerance : largest error of v of a step in stick
    layer : |v| up to which tanh(sigma v) is kept
    far : |v| up to which the Stribeck exponential is kept
    nearly_zero : how far beyond v = 0 a step goes, so that the sign of v is not in doubt
    stick_speed : |v| where mubar peaks; stick lies below
    peak, creep_speed : the largest mubar with which stick is stepped over, and |v| there
    base_rate : the rates that are there in every region, added up
    fastest : those and friction's own in stick, where it is largest
    strength : beta times the largest Ts, the deceleration by full friction, rad/s^2
    beta, kappa : 1/I1 + 1/I2, 1/(kg m^2), and I1/(I1 + I2)
    rest : a plate speed that is none; below it numbers become denormal and a series costs twenty times as much
    order, linear_order : of the series with and without varying friction
    resolved : rate of decay times length of a series step up to which it shows how a small change decays, too
    forgotten : the sum of those after which nothing is left of a change off the slow manifold
    steps : most steps of an engine cycle
    """

    period: float
    sigma: float
    rtol: float
    slip_floor: float
    speed_floor: float
    layer_tolerance: float
    falling_tolerance: float
    creep_tolerance: float
    layer: float
    far: float
    nearly_zero: float
    stick_speed: float
    peak: float
    creep_speed: float
    base_rate: float
    fastest: float
    strength: float
    beta: float
    kappa: float
    rest: float
    order: int
    linear_order: int
    resolved: float
    forgotten: float
    steps: int


def limits_of(terms: Terms, own: Terms, period: float, rtol: float, excess: float = 0.0) -> Limits:
    """The limits of a solve.

    Parameters
    ----------
    terms : what the kernel is given
    own : the scene's terms, which say what counts as stick
    period : one engine cycle, s
    rtol : relative tolerance asked for
    excess : least mu_s/mu_k - 1 with which the Stribeck exponential is kept
    """
    sigma, stribeck = terms.smoothing, terms.stribeck
    assert sigma is not None
    i1, i2, damping, stiffness = terms.linear
    local = max(LOCAL * rtol, 1e-14)
    stick_speed = stick_speed_of(own)
    creep_speed, peak = friction.peak(sigma, own.stribeck)
    if not math.isfinite(creep_speed):
        creep_speed = math.atanh(1.0 - FLAT_PEAK) / sigma
        peak = float(friction.smoothed_coefficient(creep_speed, sigma, own.stribeck))
    layer = max(min(0.5 * math.log(2.0 / (TANH_LEFT_OUT * rtol)), 19.0) / sigma, 1.01 * stick_speed)
    pairs = friction.exponentials(stribeck)
    far = max([layer, *(far_of(max(abs(share), excess), rate, rtol, layer) for share, rate in pairs)])
    steepest = max([rate for _, rate in pairs], default=0.0)
    torques = largest_mean_torque(terms) + torque_swing(terms) + peak_load(terms)
    speed = torques / math.sqrt(stiffness * i2)
    beta = 1.0 / i1 + 1.0 / i2
    strength = beta * peak_load(terms)
    base_rate = (math.sqrt(stiffness / i2) + damping / i2 + 2.0 * math.pi / period + excitation_frequency(terms)
                 + load_frequency(terms))
    return Limits(
        period=period, sigma=sigma, rtol=local, slip_floor=0.01 / sigma, speed_floor=1e-6 * speed + 1e-12,
        layer_tolerance=min(1e-3, 300.0 * local) / sigma,
        falling_tolerance=FALLING_ERROR / steepest if steepest > 0.0 else math.inf,
        creep_tolerance=min(CREEP_ERROR * max(rtol, 1e-13), 1e-2) / sigma,
        layer=layer, far=far, nearly_zero=1e-7 / sigma, stick_speed=stick_speed, peak=peak,
        creep_speed=creep_speed, base_rate=base_rate, fastest=base_rate + strength * sigma * peak,
        strength=strength, beta=beta, kappa=i1 / (i1 + i2), rest=1e-26 * speed,
        steps=steps_allowed(terms, period), **of_tolerance(local))


@lru_cache(maxsize=16)
def of_tolerance(local: float) -> dict[str, Any]:
    """The limits that follow from the tolerance of one step alone, by name."""
    order = order_of(4.6 - 0.58 * math.log(local), FRICTION_ORDER_MAXIMUM)
    return {"order": order, "linear_order": order_of(10.7 - 0.58 * math.log(local), ORDER_MAXIMUM),
            "resolved": math.exp((math.log(RESOLVED * local) + math.lgamma(order + 2.0)) / (order + 1.0)),
            "forgotten": -math.log(local)}


def far_of(excess: float, decay: float, rtol: float, layer: float) -> float:
    """The slip speed, rad/s, beyond which excess * exp(-decay |v|) is nothing to the tolerance; `layer` at least."""
    if excess == 0.0:
        return layer
    return max(layer, math.log(excess / (EXPONENTIAL_LEFT_OUT * rtol)) / decay) if decay > 0.0 else math.inf


def order_of(wished: float, most: int) -> int:
    """An even order near the one wished for, 8 at least: that at which the series' cost over their step is least."""
    return min(max(2 * round(0.5 * wished), 8), most)


ACCEPTED, REFUSED, FAILED = range(3)
"""How a step ends: taken; to be tried again with the method and the length now in `control`; no step is possible."""

SERIES, CREEP, STIFF = range(3)
"""Methods: Taylor series; collocation in stick, on the slow manifold; collocation where the linear part is stiff."""

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("tau", np.float64)])
"""The motion, SI units; tau is the time into the engine cycle."""

CONTROL = np.dtype([("method", np.int64), ("level", np.int64), ("rate", np.float64), ("released", np.float64),
                    ("waited", np.int64), ("calm", np.int64),
                    ("last", np.float64), ("streak", np.int64), ("patience", np.int64), ("slip_before", np.float64),
                    ("slip_now", np.float64), ("speed_before", np.float64), ("speed_now", np.float64),
                    ("unsettled", np.float64)])
"""What steps are chosen by.

method, level : the method now, and the rung of the next collocation step
rate : rho = beta Ts mubar' at the end of the last collocation step, 1/s
released : that rate when stick was left for the series; 0 where nothing keeps it from coming back
waited, calm : series steps in the layer since then, and after how many it may come back all the same
last, streak, patience : length of the last series step, how many of one length there were, and how many are borne
slip_before, slip_now, speed_before, speed_now : largest |v| and |theta2'| in the cycle before and in this one
unsettled : where changes are carried along, what they have still to decay by before stick is stepped over, in powers
    of e
"""

COUNTERS = np.dtype([("steps", np.int64), ("rejected", np.int64), ("iterations", np.int64),
                     ("iterations_max", np.int64)])


class Step(NamedTuple):
    """A step: how it ended, its unit of time (s), its length in that unit, the degree of its polynomials, its error
    relative to what is allowed.
    """

    status: int
    unit: float
    x: float
    degree: int
    error: float
