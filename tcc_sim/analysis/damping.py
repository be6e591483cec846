"""Equivalent viscous damping of the friction torque, (21), and its relatives, for the instability criterion (23)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.cycles import default_discard, first_cycle_of
from tcc_sim.errors import InputError
from tcc_sim.model import friction
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import Cycles, Floats, State, Status, Trajectory

CYCLES = 16
"""Engine cycles that the averages are taken over."""
SAMPLES = 8192
"""Samples per cycle: the layer of the smoothed law is crossed in some 10 us."""


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
    trajectory : densely sampled: the layer of the smoothed law, some 5/sigma wide in slip speed, must be resolved for
        the
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
    inside = (trajectory.t >= (first + dropped) * trajectory.cycle - slack) & (trajectory.t <= last * trajectory.cycle
                                                                               + slack)
    if dropped < 0 or int(inside.sum()) < 4:
        raise InputError(f"--discard {dropped} leaves fewer than 4 of the {len(trajectory.t)} samples")
    return _averages(_integrals(trajectory, inside), trajectory.system)


def damping_of_cycles(system: System, cycles: Cycles, first: int, period: int, *, solver: str = "auto",
                      rtol: float | None = None, step: float | None = None) -> Damping:
    """The averages over the last engine cycles, each solved from its state on the section with dense samples.

    So they are as good for a recording, whose ticks pass over the layer of the smoothed law, as for a solution.

    Parameters
    ----------
    cycles, first : the cycles, NaN where one is missing, and the number of the first of them, which gives its phase
    period : of the motion in engine cycles, 0 where there is none; whole periods are taken
    solver, rtol, step : as `solvers.solve` takes them

    Returns
    -------
    Damping, NaN where no cycle can be solved
    """
    count = math.ceil(CYCLES / max(period, 1)) * max(period, 1)
    total = np.zeros(4)
    for n in range(max(len(cycles) - count, 0), len(cycles)):
        if not math.isfinite(cycles.highest[n]):
            continue
        run = solve(system, cycles=1, solver=solver, rtol=rtol, step=step, samples_per_cycle=SAMPLES,
                    start_cycle=first + n,
                    state=State(*cycles.section[n].tolist()))
        if run.status is not Status.DONE:
            return Damping(math.nan, math.nan, -system.driveline.damping)
        total += _integrals(run, slice(None))
    return _averages(total, system)


def damping_as_json(found: Damping) -> dict[str, float | None]:
    """The two averages under their names in JSON; null where there is none."""
    averages = {"equivalent_damping": found.weighted, "negative_slope_mean": found.negative_mean}
    return {name: value if math.isfinite(value) else None for name, value in averages.items()}


def _integrals(trajectory: Trajectory, inside: slice | NDArray[np.bool_]) -> Floats:
    """Over time, (4,): dT/dv v^2, v^2, the negative part of dT/dv, and 1."""
    t, v = trajectory.t[inside], trajectory.slip_speed[inside]
    slope = slope_of_friction(trajectory)[inside]
    return np.array([_trapezoid(slope * v * v, t), _trapezoid(v * v, t), _trapezoid(np.minimum(slope, 0.0), t),
                     t[-1] - t[0]])


def _averages(integrals: Floats, system: System) -> Damping:
    """What the integrals come to."""
    weighted, energy, negative, time = integrals.tolist()
    return Damping(weighted / energy if energy > 0.0 else math.nan, negative / time if time > 0.0 else math.nan,
                   -system.driveline.damping)


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
