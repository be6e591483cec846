"""Constants of the exact engine's kernel: rates that scale time, tolerances, region of the constant law; its state."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tcc_sim.model.equations import coefficients_of, decay_of_slip
from tcc_sim.model.friction import exponentials, largest_ratio, sliding
from tcc_sim.solvers.terms import Terms, excitation_frequency, peak_load, steps_allowed, torque_swing

EXACT = 1e-16
"""Truncation where every arc is linear: the arcs are exact to rounding at any tolerance."""
SHARE = 1.0
"""Truncation of one step per tolerance of a solve: sections are then good to that (medians over 50 starts of fig02 and
chaos, rtol 1e-4 to 1e-10), since it is the size of the last two terms, not of the error."""
FAR_SHARE = 1.5e-2
"""Exponential of (5), in tolerances, at the slip speed from which on it counts as 0."""

EVENTS = 1000
"""Events that any engine cycle may have."""
STEPS_ALLOWED = 50
"""Steps of an engine cycle with its sensitivity per those of `steps_allowed`: a heavy damper makes them short."""


class Bounds(NamedTuple):
    """Constants of a run; s, 1/s, rad/s, N m.

    period : one engine cycle
    ratio : r = mu_s/mu_k
    clamped : whether the pressure reaches 0
    slip_rate : sum of the rates of the plate on its spring and of the excitation
    stick_rate : the same for flywheel and plate as one
    slip_decay : sum of the rates of the linear part beside those of the plate on its shaft
    far : slip speed from which on mubar is 1 to the tolerance; 0 where it is 1 everywhere
    truncation : largest share of the last terms of a series
    torque_tolerance, slip_tolerance : torques, and slip speeds, closer than this are equal
    speed_scale : size of the plate speed
    steps : most steps of an engine cycle with derivatives
    events : most events of an engine cycle
    """

    period: float
    ratio: float
    clamped: bool
    slip_rate: float
    stick_rate: float
    slip_decay: float
    far: float
    truncation: float
    torque_tolerance: float
    slip_tolerance: float
    speed_scale: float
    steps: int
    events: int


def bounds_of(terms: Terms, period: float, rtol: float) -> Bounds:
    """Return the constants of a system whose engine cycle is `period`, for a relative tolerance.

    A cycle may have 1000 events, and 40 for each natural or excitation period in it.
    """
    flywheel, plate, damping, stiffness, _, by_speed, _ = coefficients_of(terms.linear)
    slip_decay = decay_of_slip(terms.linear) + by_speed / flywheel
    pairs = exponentials(terms.stribeck)
    ratio = float(sliding(0.0, 1.0, terms.stribeck))
    friction = largest_ratio(terms.stribeck) * peak_load(terms)
    torque = max(abs(terms.mean_torque) + torque_swing(terms) + friction, 1e-300)
    tolerance = 1e-12 * torque
    scale = torque / math.sqrt(stiffness * plate)
    excitation = excitation_frequency(terms)
    truncation, far = EXACT, 0.0
    if terms.stribeck is not None:
        truncation = max(SHARE * rtol, EXACT)
        far = max(max(math.log(abs(share) / (FAR_SHARE * rtol)), 1.0) / rate for share, rate in pairs)

    return Bounds(
        period=period, ratio=ratio, clamped=terms.pulsation is not None and terms.pulsation[0] > terms.mean_load,
        slip_rate=math.sqrt(stiffness / plate) + damping / plate + slip_decay + excitation,
        stick_rate=math.sqrt(stiffness / (flywheel + plate)) + (damping + by_speed) / (flywheel + plate) + excitation,
        far=far, truncation=truncation, torque_tolerance=tolerance, slip_tolerance=1e-14 * scale, speed_scale=scale,
        slip_decay=slip_decay, steps=STEPS_ALLOWED * steps_allowed(terms, period),
        events=EVENTS + int(min(40.0 * max(math.sqrt(stiffness / plate), excitation) * period / (2.0 * math.pi), 1e6)))


STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("mode", np.int64), ("tau", np.float64), ("shift", np.float64),
                  ("load_edge", np.float64), ("at_rest", np.int64), ("first_mode", np.int64)])
"""State of a run (rad/s, rad, rad/s, rad); its mode; time into the engine cycle, s; the load's phase at its start, rad;
when the clamp next switches, s into the cycle; whether slip has just begun at v = 0; the mode at the start of the run.
"""
