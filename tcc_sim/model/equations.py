"""Equations of motion (1), (2) with the slip speed as a state, and the excitation.

States: slip speed v (rad/s), plate angle theta2 (rad), plate speed omega2 (rad/s). The slip speed is a state because in
stick it is a small difference of large numbers. theta1 is cyclic; it is integrated separately, only on request.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Linear = tuple[float, float, float, float]
"""I1, I2 (kg m^2), C23 (N m s/rad), K23 (N m/rad)."""


def engine_torque(t: Any, mean: float, torque: tuple[float, float] | None,
                  harmonics: NDArray[np.float64] | None) -> Any:
    """Te(t), N m: mean + Tp sin(omega t) + sum_n Tpn sin(n omega t + phi_n), Section 2.2 of the paper.

    Parameters
    ----------
    t : float or (n,) array, s
    mean : Tm, N m
    torque : (Tp in N m, omega in rad/s), or None for Tp = 0
    harmonics : (m, 3) array of angular frequency (rad/s), amplitude (N m), phase (rad), or None
    """
    out = mean + 0.0 * t
    if torque is not None:
        out = out + torque[0] * np.sin(torque[1] * t)
    if harmonics is not None:
        for k in range(harmonics.shape[0]):
            out = out + harmonics[k, 1] * np.sin(harmonics[k, 0] * t + harmonics[k, 2])
    return out


def saturation_torque(t: Any, mean: float, pulsation: tuple[float, float, float] | None) -> Any:
    """Ts(t) of (5b), N m, clamped at 0: no separation, no negative normal load.

    `pulsation` is (Tsp in N m, omega_f in rad/s, psi in rad), or None for a constant load.
    """
    if pulsation is None:
        return mean + 0.0 * t
    else:
        return np.maximum(mean + pulsation[0] * np.sin(pulsation[1] * t + pulsation[2]), 0.0)


def accelerations(plate_angle: Any, plate_speed: Any, engine: Any, friction: Any, linear: Linear) -> Any:
    """(v', omega2') of (2a) divided by I1, and (2b), rad/s^2, for given engine and friction torque in N m."""
    plate = (friction - linear[2] * plate_speed - linear[3] * plate_angle) / linear[1]
    return (engine - friction) / linear[0] - plate, plate


def interface_torque(plate_angle: Any, plate_speed: Any, engine: Any, linear: Linear) -> Any:
    """The friction torque lambda that stick needs (v' = 0), N m: (I2 Te + I1 (C23 theta2' + K23 theta2))/(I1 + I2)."""
    spring = linear[2] * plate_speed + linear[3] * plate_angle
    return (linear[1] * engine + linear[0] * spring) / (linear[0] + linear[1])
