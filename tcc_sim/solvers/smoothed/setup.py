"""Constants of the smoothed kernel: tolerances, edges of regions, rates, orders; and the records that it changes."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.model import friction
from tcc_sim.model.equations import coefficients_of, decay_of_slip
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
"""Tolerance of one step per relative tolerance of a solve: leaving stick amplifies the errors of steps before."""
CREEP_ERROR = 2.0
"""Error of sigma v, and so of mubar, in one step in stick, per relative tolerance of a solve."""
TANH_LEFT_OUT = 0.3
"""1 - tanh(sigma |v|) at the edge of the layer, outside which tanh counts as 1, per relative tolerance of a solve."""
EXPONENTIAL_LEFT_OUT = 0.03
"""Stribeck exponential at the slip speed from which on it counts as 0, per relative tolerance of a solve."""
FALLING_ERROR = 1e-2
"""Largest error of alpha v in one step where the exponential varies: however large v is elsewhere in the motion, a step
from the edge of the layer must not return to it by its error."""
RESOLVED = 1e3
"""Tolerance factor for perturbations that decay within one series step; later decay makes the error smaller."""
FAST = 10.0
"""Decay of the slip speed by the linear part, per rate of everything else but friction, from which on it is fast."""
FINER = 8.0
"""Longest series step there per shortest one of collocation, times that elsewhere: the series must not fill the gap."""
FLAT_PEAK = 1e-6
"""Relative distance below its limit at which mubar counts as at its peak where mu_k = mu_s or alpha = 0."""


class Limits(NamedTuple):
    """Constants of a solve; speeds in rad/s, times in s, rates in 1/s.

    period : one engine cycle
    sigma : smoothing factor, s/rad
    rtol : tolerance of a series step relative to the motion
    slip_floor, speed_floor : sizes below which v and theta2' count as this large
    layer_tolerance, falling_tolerance : largest error of v of a step in the layer, and where the exponential varies
    creep_tolerance : largest error of v of a step in stick
    layer, far : |v| up to which tanh(sigma v) and the Stribeck exponential vary
    nearly_zero : distance beyond v = 0 at which a step ends, so that v has a certain sign
    stick_speed : |v| at the peak of mubar; stick lies below
    peak, creep_speed : the largest mubar of collocation in stick, and |v| there
    base_rate : sum of the rates in every region
    fastest : base_rate and friction's largest rate, that in stick
    strength : beta times the largest Ts, the deceleration by full friction, rad/s^2
    beta, kappa : 1/I1 + 1/I2, 1/(kg m^2), and I1/(I1 + I2)
    slip_decay : rate at which the linear part lets the slip speed decay
    fast_slip : whether that is far faster than everything else but friction
    rest : plate speed that counts as 0; smaller numbers become denormal and make a series twenty times slower
    order, linear_order : of the series with and without varying friction
    resolved : largest rate of decay times length of a series step that resolves the decay of a perturbation
    forgotten : sum of these after which a perturbation off the slow manifold has decayed
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
    slip_decay: float
    fast_slip: bool
    rest: float
    order: int
    linear_order: int
    resolved: float
    forgotten: float
    steps: int


def limits_of(terms: Terms, scene_terms: Terms, period: float, rtol: float, excess: float = 0.0) -> Limits:
    """Return the limits of a solve.

    Parameters
    ----------
    terms, scene_terms : terms of the kernel, and of the scene, which define stick
    period : one engine cycle, s
    rtol : relative tolerance of the solve
    excess : least mu_s/mu_k - 1 by which `far` is chosen
    """
    sigma, stribeck = terms.smoothing, terms.stribeck
    assert sigma is not None
    i1, i2, damping, stiffness, _, by_speed, _ = coefficients_of(terms.linear)
    local = max(LOCAL * rtol, 1e-14)
    stick_speed = stick_speed_of(scene_terms)
    creep_speed, peak = friction.peak(sigma, scene_terms.stribeck)
    if not math.isfinite(creep_speed):
        creep_speed = math.atanh(1.0 - FLAT_PEAK) / sigma
        peak = float(friction.smoothed_coefficient(creep_speed, sigma, scene_terms.stribeck))
    layer = max(min(0.5 * math.log(2.0 / (TANH_LEFT_OUT * rtol)), 19.0) / sigma, 1.01 * stick_speed)
    pairs = friction.exponentials(stribeck)
    far = max([layer, *(far_of(max(abs(share), excess), rate, rtol, layer) for share, rate in pairs)])
    steepest = max([rate for _, rate in pairs], default=0.0)
    torques = largest_mean_torque(terms) + torque_swing(terms) + peak_load(terms)
    speed = torques / math.sqrt(stiffness * i2)
    beta = 1.0 / i1 + 1.0 / i2
    strength = beta * peak_load(terms)
    slip_decay = decay_of_slip(terms.linear)
    excitation = 2.0 * math.pi / period + excitation_frequency(terms) + load_frequency(terms)
    fast_slip = slip_decay > FAST * (math.sqrt(stiffness / i2) + excitation)
    base_rate = (math.sqrt(stiffness / i2) + damping / i2 + 2.0 * math.pi / period + excitation_frequency(terms)
                 + load_frequency(terms) + slip_decay + by_speed / i1)
    fastest = base_rate + strength * sigma * peak
    return Limits(
        period=period, sigma=sigma, rtol=local, slip_floor=0.01 / sigma, speed_floor=1e-6 * speed + 1e-12,
        layer_tolerance=min(1e-3, 300.0 * local) / sigma,
        falling_tolerance=FALLING_ERROR / steepest if steepest > 0.0 else math.inf,
        creep_tolerance=min(CREEP_ERROR * max(rtol, 1e-13), 1e-2) / sigma,
        layer=layer, far=far, nearly_zero=1e-7 / sigma, stick_speed=stick_speed, peak=peak,
        creep_speed=creep_speed, base_rate=base_rate, fastest=FINER * fastest if fast_slip else fastest,
        strength=strength, beta=beta, kappa=i1 / (i1 + i2), slip_decay=slip_decay, fast_slip=fast_slip,
        rest=1e-26 * speed, steps=steps_allowed(terms, period), **of_tolerance(local))


@lru_cache(maxsize=16)
def of_tolerance(local: float) -> dict[str, Any]:
    """Return the limits that follow from the tolerance of one step alone, by name."""
    order = order_of(4.6 - 0.58 * math.log(local), FRICTION_ORDER_MAXIMUM)
    return {"order": order, "linear_order": order_of(10.7 - 0.58 * math.log(local), ORDER_MAXIMUM),
            "resolved": math.exp((math.log(RESOLVED * local) + math.lgamma(order + 2.0)) / (order + 1.0)),
            "forgotten": -math.log(local)}


def far_of(excess: float, decay: float, rtol: float, layer: float) -> float:
    """Return the slip speed, rad/s, beyond which excess * exp(-decay |v|) is below the tolerance; `layer` at least."""
    if excess == 0.0:
        return layer
    return max(layer, math.log(excess / (EXPONENTIAL_LEFT_OUT * rtol)) / decay) if decay > 0.0 else math.inf


def order_of(wished: float, most: int) -> int:
    """Return the even order, 8 at least, nearest to the one at which the series' cost per length is least."""
    return min(max(2 * round(0.5 * wished), 8), most)


ACCEPTED, REFUSED, FAILED = range(3)
"""Results of a step: taken; to be tried again with the method and length in `control`; no step is possible."""

SERIES, CREEP, STIFF = range(3)
"""Methods: Taylor series; collocation in stick, on the slow manifold; collocation where the linear part is stiff."""

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("tau", np.float64), ("shift", np.float64)])
"""The motion, SI units; time into the engine cycle, and the load's phase at its start."""

CONTROL = np.dtype([("method", np.int64), ("level", np.int64), ("rate", np.float64), ("released", np.float64),
                    ("waited", np.int64), ("calm", np.int64),
                    ("last", np.float64), ("streak", np.int64), ("patience", np.int64), ("slip_before", np.float64),
                    ("slip_now", np.float64), ("speed_before", np.float64), ("speed_now", np.float64),
                    ("unsettled", np.float64)])
"""Data by which steps are chosen.

method, level : the present method, and the rung of the next collocation step
rate : rho = beta Ts mubar' at the end of the last collocation step, 1/s
released : that rate when the series took over in stick; 0 if they did not
waited, calm : series steps in the layer since then, and their number after which collocation is tried again
last, streak, patience : length of the last series step, number of such steps in a row, and the most of them
slip_before, slip_now, speed_before, speed_now : largest |v| and |theta2'| in the cycle before and in this one
unsettled : with derivatives, decay of perturbations, in powers of e, that must come before collocation in stick
"""


class Step(NamedTuple):
    """A step: result, unit of time (s), length in that unit, degree of its polynomials, error per tolerance."""

    status: int
    unit: float
    x: float
    degree: int
    error: float
