"""Per-cycle maxima, section points and stick time of a trajectory, from its solver or from its samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model import equations
from tcc_sim.model.course import TIME
from tcc_sim.model.parameters import System
from tcc_sim.solvers.per_cycle import cycles_from_samples, starts_of
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import Cycles, Floats, Trajectory

DISCARD = 50
"""Engine cycles dropped as transient: the paper's rule."""


def cycles_of(trajectory: Trajectory) -> Cycles:
    """The engine cycles of a trajectory: those its solver worked out, or those between its samples.

    From samples, slip speed and plate angle are interpolated with the accelerations that (2a) and (2b) give for the
    sampled torques.

    Raises
    ------
    InputError
        Samples without the system they belong to, or too few of them for one cycle.
    """
    if trajectory.cycles is not None:
        return trajectory.cycles
    if trajectory.system is None:
        raise InputError("the trajectory has neither per-cycle results nor the system to work them out with")
    if len(trajectory.t) < 2:
        raise InputError("the trajectory has fewer than two samples")
    slip, plate = accelerations_of(trajectory.plate_angle, trajectory.plate_speed, trajectory.engine_torque,
                                   trajectory.friction_torque, trajectory.system)
    starts = starts_of(varying(trajectory), first_cycle_of(trajectory), float(trajectory.t[-1]), trajectory.cycle)
    terms = terms_of(trajectory.system)
    return cycles_from_samples(trajectory.t, trajectory.slip_speed, slip, trajectory.plate_angle,
                               trajectory.plate_speed, plate, starts=starts, stick_speed=stick_speed_of(terms),
                               linear=terms.linear)


def accelerations_of(plate_angle: Floats, plate_speed: Floats, engine_torque: Floats, friction_torque: Floats,
                     system: System) -> tuple[Floats, Floats]:
    """Slip and plate acceleration, (n,) arrays in rad/s^2, from (2a) and (2b) with the torques given."""
    slip, plate = equations.accelerations(plate_angle, plate_speed, engine_torque, friction_torque,
                                          terms_of(system).linear)
    return slip, plate


def first_cycle_of(trajectory: Trajectory) -> int:
    """Number of the first engine cycle that lies within the trajectory."""
    start, system = float(trajectory.t[0]), varying(trajectory)
    return math.ceil((start / trajectory.cycle if system is None else system.cycles_until(start)) - 1e-9)


def varying(trajectory: Trajectory) -> System | None:
    """The system of a trajectory whose engine cycles are not all of one length or do not start at t = n cycle."""
    return trajectory.system if trajectory.system is not None and trajectory.system.course is not None else None


def spans_of(system: System | None, cycle: float, first: int, count: int) -> dict[str, Any]:
    """What `summarise_cycles` is to know of `count` engine cycles from number `first` on: `cycle`, how long they last,
    s, and `varied`, in how many of them the excitation still changes. Without a system all last `cycle`.
    """
    if system is None or system.course is None:
        return {"cycle": cycle if system is None else system.cycle}
    return {"cycle": np.diff(system.cycle_start(first + np.arange(count + 1))),
            "varied": max(math.ceil(system.cycles_until(float(system.course[-1, TIME])) - 1e-9) - first, 0)}


def default_discard(cycles: int) -> int:
    """Cycles to drop where nobody says: 50, or half of them where there are fewer than 100."""
    return min(DISCARD, cycles // 2)


def dropped_of(cycles: int, discard: int | None) -> int:
    """Cycles to drop of so many: `discard`, or by default.

    Raises
    ------
    InputError
        A negative number, or one that leaves no cycle.
    """
    dropped = default_discard(cycles) if discard is None else discard
    if dropped < 0:
        raise InputError(f"--discard is {dropped}; it must be 0 or more cycles")
    if dropped >= cycles:
        whole = f"the {cycles} cycles" if cycles != 1 else "the only cycle"
        raise InputError(f"--discard {dropped} leaves none of {whole}" if cycles else
                         "there is no whole engine cycle to summarise")
    return dropped
