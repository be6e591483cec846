"""What the exact engine's kernel is given: rates that scale time, tolerances, where the law is constant; and what it
changes as it goes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tcc_sim.model.friction import exponentials, largest_ratio
from tcc_sim.solvers.terms import Terms, excitation_frequency, peak_load, steps_allowed, torque_swing

EXACT = 1e-16
"""Truncation where every arc is linear: the arcs are exact to rounding, whatever tolerance was asked for."""
SHARE = 1.0
"""Truncation of one step, of the tolerance asked for: sections are then good to that (medians over
50 starts of fig02 and chaos, rtol 1e-4 to 1e-10), since it is the last two terms that come to it, not the error."""
FAR_SHARE = 1.5e-2
"""What is left of the exponential of (5), in tolerances, where it counts as gone."""

EVENTS = 1000
"""Events that any engine cycle may have."""
STIFF = 10.0
"""Damping over the critical one from which the fast part is left to collocation; a series takes it along below."""
STEPS_ALLOWED = 50
"""Steps of an engine cycle with its sensitivity per those of `steps_allowed`: a heavy damper makes them short."""


class Bounds(NamedTuple):
    """Constants of a run: s, 1/s, rad/s, N m."""

    period: float
    ratio: float
    """r = mu_s/mu_k."""
    clamped: bool
    """The pressure reaches 0."""
    slip_rate: float
    """Sum of the rates of the plate on its spring and of the excitation."""
    stick_rate: float
    """The same for flywheel and plate as one."""
    far: float
    """Slip speed from which on mubar is 1 to the tolerance; 0 where it is 1 everywhere."""
    truncation: float
    """Largest share of the last terms of a series."""
    torque_tolerance: float
    """Torques closer than this are equal."""
    slip_tolerance: float
    """Slip speeds closer than this are equal."""
    speed_scale: float
    """Size of the plate speed."""
    stiff_slip: bool
    """In slip the damper is much faster than everything else."""
    stiff_stick: bool
    """The same in stick."""
    creep: float
    """Size of the plate speed where the damper holds it, rad/s."""
    steps: int
    """Most steps of an engine cycle of which the sensitivity is asked."""
    steepest: float
    """Slip that begins at breakaway may fall this fast, rad/s^2, in rounding."""
    events: int
    """Most events of an engine cycle."""


def bounds_of(terms: Terms, period: float, rtol: float) -> Bounds:
    """The constants of a system whose engine cycle is `period`, for a relative tolerance.

    A cycle may have 1000 events, and 40 for each natural or excitation period in it.
    """
    flywheel, plate, damping, stiffness = terms.linear
    pairs = exponentials(terms.stribeck)
    ratio = 1.0 + sum(share for share, _ in pairs)
    friction = largest_ratio(terms.stribeck) * peak_load(terms)
    torque = max(abs(terms.mean_torque) + torque_swing(terms) + friction, 1e-300)
    tolerance = 1e-12 * torque
    scale = torque / math.sqrt(stiffness * plate)
    excitation = excitation_frequency(terms)
    truncation, far = EXACT, 0.0
    if terms.stribeck is not None:
        truncation = max(SHARE * rtol, EXACT)
        far = max(max(math.log(abs(share) / (FAR_SHARE * rtol)), 1.0) / rate for share, rate in pairs)

    def stiff(inertia: float) -> bool:
        """Whether the fast part dies down long before the slow part and the excitation have changed."""
        fast = damping / inertia
        return fast > STIFF * math.sqrt(stiffness / inertia) and fast > STIFF**2 * (excitation + 2.0 * math.pi / period)

    return Bounds(
        period=period, ratio=ratio, clamped=terms.pulsation is not None and terms.pulsation[0] > terms.mean_load,
        slip_rate=math.sqrt(stiffness / plate) + damping / plate + excitation,
        stick_rate=math.sqrt(stiffness / (flywheel + plate)) + damping / (flywheel + plate) + excitation,
        far=far, truncation=truncation, torque_tolerance=tolerance, slip_tolerance=1e-14 * scale, speed_scale=scale,
        stiff_slip=stiff(plate), stiff_stick=stiff(flywheel + plate),
        steps=STEPS_ALLOWED * steps_allowed(terms, period), creep=min(scale, torque / max(damping, 1e-300)),
        steepest=2.0 * tolerance * (1.0 / flywheel + 1.0 / plate),
        events=EVENTS + int(min(40.0 * max(math.sqrt(stiffness / plate), excitation) * period / (2.0 * math.pi), 1e6)))


COUNTERS = np.dtype([("steps", np.int64), ("cycle", np.int64), ("cycle_steps", np.int64), ("cycle_events", np.int64)])
"""Steps in all; the present engine cycle, and the steps and events in it."""

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("mode", np.int64), ("tau", np.float64), ("shift", np.float64),
                  ("load_edge", np.float64), ("at_rest", np.int64), ("first_mode", np.int64),
                  ("level", np.int64)])
"""Where a run is: the state (rad/s, rad, rad/s, rad); its mode; seconds into the engine cycle; the load's phase at the
start of the cycle, rad; when the clamp next sets in or ends, s into the cycle; whether slip has just begun at v = 0;
the mode at the start of the run; the rung of the next step of a stiff arc, below 0 while series steps are due.
"""
