"""Matrices of the linear model about a constant motion: (2a), (2b) with the slope (20b) of the friction law."""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.estimation.operating_point import Constant
from tcc_sim.trajectory import Floats


def matrices_of(motion: Constant, pressure: bool) -> tuple[Floats, Floats, dict[str, tuple[list[float], float]],
                                                           tuple[str, ...]]:
    """Return a (n, n), b (n, 1) of x' = a x + b u for the actuation pressure (Pa), or else for the engine torque (N m).

    Also the (n,) row of C and the direct feed of each output, and the names of the states. Friction is Tf0 + slope dv +
    by_pressure dP; the set-valued law in stick has one oscillator.
    """
    d = motion.system.driveline
    i1, i2, c23, k23 = d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness
    if math.isinf(motion.slope):
        whole_inertia = i1 + i2
        a = np.array([[0.0, 1.0], [-k23 / whole_inertia, -c23 / whole_inertia]])
        b = np.array([[0.0], [0.0 if pressure else 1.0 / whole_inertia]])
        return (a, b, {
            "slip_speed": ([0.0, 0.0], 0.0), "shaft_torque": ([k23, c23], 0.0),
            "friction_torque": ([i1 * k23 / whole_inertia, i1 * c23 / whole_inertia],
                                0.0 if pressure else i2 / whole_inertia)}, ("plate_angle", "plate_speed"))
    beta, slope = 1.0 / i1 + 1.0 / i2, motion.slope
    torque = motion.by_pressure if pressure else 0.0
    a = np.array([[-beta * slope, k23 / i2, c23 / i2], [0.0, 0.0, 1.0], [slope / i2, -k23 / i2, -c23 / i2]])
    b = np.array([[-beta * torque + (0.0 if pressure else 1.0 / i1)], [0.0], [torque / i2]])
    return (a, b, {"slip_speed": ([1.0, 0.0, 0.0], 0.0), "shaft_torque": ([0.0, k23, c23], 0.0),
                   "friction_torque": ([slope, 0.0, 0.0], torque)},
            ("slip_speed", "plate_angle", "plate_speed"))
