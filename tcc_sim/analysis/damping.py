"""Equivalent viscous damping of the friction torque, (21), and its relatives, for the instability criterion (23)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np

from tcc_sim.analysis.cycles import default_discard, first_cycle_of
from tcc_sim.errors import InputError
from tcc_sim.model import friction
from tcc_sim.solvers.terms import terms_of
from tcc_sim.solvers.trajectory import Floats, Trajectory


@dataclass(frozen=True)
class Damping:
    """Averages of dT/dv = Ts(t) d(mubar)/dv over whole engine cycles, N m s/rad.

    weighted : Cf of (21) as printed, weighted with v^2; NaN where v is 0 throughout
    negative_mean : time average of the negative part, min(dT/dv, 0): the reading of Fig. 5 that has the printed order
    threshold : -C23; (23) says that the motion is unstable where Cf is below it
    """

    weighted: float
    negative_mean: float
    threshold: float


def equivalent_damping(trajectory: Trajectory, discard: int | None = None) -> Damping:
    """The averages over the whole cycles after the first `discard`, by the trapezoidal rule on the samples.

    Parameters
    ----------
    trajectory : densely sampled: the layer of the smoothed law, some 5/sigma wide in slip speed, must be resolved for the
        weighted average to be meaningful to more than its order
    discard : cycles dropped; None drops 50, or half of them where there are fewer than 100

    Raises
    ------
    InputError
        A trajectory without its system or with fewer than four samples in the cycles kept.
    """
    if trajectory.system is None:
        raise InputError("the equivalent damping needs the system of the trajectory")
    first = first_cycle_of(trajectory)
    last = math.floor(float(trajectory.t[-1]) / trajectory.cycle + 1e-9)
    dropped = default_discard(last - first) if discard is None else discard
    slack = 1e-9 * trajectory.cycle
    inside = (trajectory.t >= (first + dropped) * trajectory.cycle - slack) & (trajectory.t <= last * trajectory.cycle + slack)
    if dropped < 0 or int(inside.sum()) < 4:
        raise InputError(f"--discard {dropped} leaves fewer than 4 of the {len(trajectory.t)} samples")
    t, v = trajectory.t[inside], trajectory.slip_speed[inside]
    slope = slope_of_friction(trajectory)[inside]
    energy = _trapezoid(v * v, t)
    weighted = _trapezoid(slope * v * v, t) / energy if energy > 0.0 else math.nan
    negative = _trapezoid(np.minimum(slope, 0.0), t) / float(t[-1] - t[0])
    return Damping(weighted, negative, -trajectory.system.driveline.damping)


def slope_of_friction(trajectory: Trajectory) -> Floats:
    """dT/dv = Ts(t) d(mubar)/dv at the samples of (20a), (20b), N m s/rad.

    The set-valued law has its sliding slope for v != 0; where v = 0 it has none, and 0 stands there.
    """
    if trajectory.system is None:
        raise InputError("the slope of the friction torque needs the system of the trajectory")
    terms = terms_of(trajectory.system)
    v = trajectory.slip_speed
    if terms.smoothing is not None:
        slope = friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1]
    elif terms.stribeck is not None:
        slope = np.where(v == 0.0, 0.0, -terms.stribeck[1] * terms.stribeck[0] * np.exp(-terms.stribeck[1] * np.abs(v)))
    else:
        slope = np.zeros_like(v)
    return cast(Floats, trajectory.saturation_torque * slope)


def _trapezoid(y: Floats, t: Floats) -> float:
    """The trapezoidal rule; NumPy renamed its own between the versions that this package takes."""
    return float(0.5 * np.sum((y[1:] + y[:-1]) * np.diff(t)))
