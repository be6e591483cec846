"""Matrices of the linear model about a constant motion: (2a), (2b) with the slope (20b) of the friction law."""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.estimation.operating_point import Constant
from tcc_sim.model.equations import linear_of, matrix_of
from tcc_sim.trajectory import Floats


def matrices_of(motion: Constant, pressure: bool) -> tuple[Floats, Floats, dict[str, tuple[list[float], float]],
                                                           tuple[str, ...]]:
    """Return a (n, n), b (n, 1) of x' = a x + b u for the actuation pressure (Pa), or else for the engine torque (N m).

    Also the (n,) row of C and the direct feed of each output, and the names of the states. Friction is Tf0 + slope dv +
    by_pressure dP; the set-valued law in stick has one oscillator.
    """
    linear = linear_of(motion.system)
    free, i1, i2, c23, k23 = (matrix_of(linear), linear.flywheel, linear.plate, linear.damping, linear.stiffness)
    by_friction, by_engine = np.array([-1.0 / i1 - 1.0 / i2, 0.0, 1.0 / i2]), np.array([1.0 / i1, 0.0, 0.0])
    if math.isinf(motion.slope):
        # lambda of v' = 0 in place of the friction torque.
        held, fed = -free[0] / by_friction[0], -by_engine[0] / by_friction[0]
        a = (free + np.outer(by_friction, held))[1:, 1:]
        b = np.array([[0.0], [0.0 if pressure else by_friction[2] * fed]])
        return (a, b, {
            "slip_speed": ([0.0, 0.0], 0.0), "shaft_torque": ([k23, c23], 0.0),
            "friction_torque": (held[1:].tolist(), 0.0 if pressure else fed)}, ("plate_angle", "plate_speed"))
    slope, torque = motion.slope, motion.by_pressure if pressure else 0.0
    a = free + np.outer(by_friction, [slope, 0.0, 0.0])
    b = (by_friction * torque + (0.0 if pressure else by_engine))[:, None]
    return (a, b, {"slip_speed": ([1.0, 0.0, 0.0], 0.0), "shaft_torque": ([0.0, k23, c23], 0.0),
                   "friction_torque": ([slope, 0.0, 0.0], torque)},
            ("slip_speed", "plate_angle", "plate_speed"))
