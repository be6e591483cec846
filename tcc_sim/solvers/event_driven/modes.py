"""Modes of the set-valued law (6): which one holds after slip has ended, decided from torques and their rates.

Never from the sign of a rounded slip speed: in stick v = 0 exactly, and slip begins at v = 0 exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.trajectory import FREE, NEGATIVE, POSITIVE, STICK

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("mode", np.int64), ("tau", np.float64), ("shift", np.float64),
                  ("load_edge", np.float64), ("at_rest", np.int64), ("first_mode", np.int64),
                  ("length", np.float64)])
"""Where a run is: the state (rad/s, rad, rad/s, rad); its mode; seconds into the engine cycle; the load's phase at the
start of the cycle, rad; when the clamp next sets in or ends, s into the cycle; whether slip has just begun at v = 0;
the mode at the start of the run; the length of the next step of a stiff arc, s.
"""


@fast
def mode_at_rest(plate_angle: float, plate_speed: float, drive: Any, ratio: float, tolerance: float,
                 linear: Linear) -> int:
    """The mode that follows v = 0 under load: stick where |lambda| <= r Ts, else slip in the direction of lambda.

    Within `tolerance` (N m) of breakaway the rate of the margin decides: stick if it grows.
    """
    flywheel, plate, damping, stiffness = linear
    both = flywheel + plate
    spring = damping * plate_speed + stiffness * plate_angle
    torque = (plate * drive.torque + flywheel * spring) / both
    margin = ratio * drive.load - abs(torque)
    if margin > tolerance:
        return STICK
    direction = POSITIVE if torque > 0.0 else NEGATIVE
    if margin < -tolerance:
        return direction
    acceleration = (drive.torque - spring) / both
    torque_rate = (plate * drive.torque_rate + flywheel * (damping * acceleration + stiffness * plate_speed)) / both
    growth = ratio * drive.load_rate - (torque_rate if torque > 0.0 else -torque_rate)
    return STICK if growth >= 0.0 else direction


@fast
def mode_of(slip_speed: float, loaded: bool, plate_angle: float, plate_speed: float, drive: Any, ratio: float,
            tolerance: float, linear: Linear) -> int:
    """The mode of a state where a run starts, or where the load sets in or ends."""
    if not loaded:
        return FREE
    if slip_speed != 0.0:
        return POSITIVE if slip_speed > 0.0 else NEGATIVE
    return int(mode_at_rest(plate_angle, plate_speed, drive, ratio, tolerance, linear))
