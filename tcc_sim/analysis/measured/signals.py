"""Signals of a run, solved or recorded: slip speed, torques and the phase of the excitation.

Orders and spectra resample these signals in equal steps of the phase. `measured_phase` makes them of a table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import SWELL, SWELLS, phase_at
from tcc_sim.solvers.per_cycle import hermite
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import Floats, Trajectory, integral

DRIVEN = 0.05
"""Least amplitude of an order of the torque, relative to its largest: sidelobes of Hann's window reach 0.027."""
BRIDGED_TICKS = 2.5  # Longest distance of states that is bridged, as by one lost state, in ticks.
HIGHEST_ORDER = 10  # Highest order that is given.
LEAST_SAMPLES = 8
"""Samples that a cycle must have on average; orders up to a quarter of them, and HIGHEST_ORDER at most, are given."""

Phase = tuple[Floats, Callable[[Floats], Floats]]
"""Periods of the excitation passed at samples, (n,), and the function from such numbers to times, s."""


@dataclass(frozen=True)
class Signals:
    """Input of orders and spectra; n samples.

    turns : (n,) periods of the excitation passed at the samples
    when : function from such numbers to times, s
    at : function from times, s, to slip speed (rad/s), shaft torque and engine torque (N m); NaN for unknown ones
    driven : orders of the excitation in the torque; None to find them in the torque
    breakaways : times of changes from stick to slip, s; None if they are unknown
    t, heat : (n,) s, and work of the friction torque from the start on, J
    holes : (k, 2) begin and end of stretches without samples of the slip speed, or without a known phase, s
    notes : sentences on what was mended in measurements, and on what was not
    splined : whether `at` is a cubic spline through the samples alone, without their rates
    """

    system: System
    turns: Floats
    when: Callable[[Floats], Floats]
    at: Callable[[Floats], tuple[Floats, Floats, Floats]]
    driven: Floats | None
    breakaways: Floats | None
    t: Floats
    heat: Floats
    holes: Floats = field(default_factory=lambda: np.empty((0, 2)))
    notes: tuple[str, ...] = ()
    splined: bool = False


def turns_at(system: System, t: Floats) -> Floats:
    """Return the periods of the excitation passed at the times t, (n,)."""
    return t / system.cycle if system.profile is None else np.asarray(phase_at(system.profile, t)) / (2.0 * math.pi)


def run_signals(run: Trajectory, phase: Phase | None = None) -> Signals:
    """Return the signals of a solved or recorded run.

    run : with its system
    phase : of the excitation; None for that of the scene or the recording

    Raises InputError: no system, or a commanded torque with unknown periods.
    """
    system = run.system
    if system is None:
        raise InputError("the trajectory has no system, which says what the engine's phase is")
    turns, when = phase or (phase_of_cycles(run) if system.engine.source == "topic" else (
        turns_at(system, run.t), system.cycle_start))
    if phase is not None:
        turns = np.interp(run.t, when(turns), turns)
    d = system.driveline
    twist, twisting = run.shaft_twist
    slip, plate = equations.accelerations(run.slip_speed, run.plate_angle, run.plate_speed, run.engine_torque,
                                          run.friction_torque, terms_of(system).linear, run.far_end.angle,
                                          run.far_end.speed)
    shaft = d.damping * twisting + d.stiffness * twist

    def at(times: Floats) -> tuple[Floats, Floats, Floats]:
        """Cubics with the rates of the equations."""
        return (hermite(times, run.t, run.slip_speed, slip),
                hermite(times, run.t, shaft, d.damping * plate + d.stiffness * twisting),
                hermite(times, run.t, run.engine_torque, np.gradient(run.engine_torque, run.t)))

    holes, cycles = gaps_between(turns, when(turns)), run.cycles
    if system.engine.source == "topic" and cycles is not None and cycles.starts is not None:
        unknown = np.isnan(cycles.highest)
        holes = np.concatenate([holes, np.stack([cycles.starts[:-1], cycles.starts[1:]], axis=1)[unknown]])
    changes, modes = run.transitions, run.state
    broke = changes.time[changes.before == 0] if len(changes.time) else run.t[1:][(modes[:-1] == 0) & (modes[1:] != 0)]
    given = system.engine.source == "topic" or (system.inputs is not None and system.inputs.torque is not None)
    return Signals(system, turns, when, at, None if given else driven_orders(system), broke, run.t,
                   integral(run.friction_torque * run.slip_speed, run.t), holes)


def gaps_between(turns: Floats, t: Floats) -> Floats:
    """Return the gaps between samples, which passed `turns` periods of the excitation at the times t, (k, 2), s.

    In a run-up of equal steps of time those of the phase grow, and the other way round: a gap is wide in both. A single
    lost sample makes none.
    """
    wide = [np.diff(x) > BRIDGED_TICKS * np.median(np.diff(x)) for x in (turns, t)]
    gaps = np.flatnonzero(wide[0] & wide[1])
    return np.stack([t[gaps], t[gaps + 1]], axis=1)


def phase_of_cycles(run: Trajectory) -> Phase:
    """Return the phase of the excitation found in a run's torque, with a constant frequency in each period.

    Raises InputError: no periods were found.
    """
    starts = run.cycles.starts if run.cycles is not None else None
    if starts is None or len(starts) < 2 or not np.isfinite(starts).all():
        raise InputError("the torque was commanded, and its periods of excitation are not known: there are no orders "
                         "and no spectrum")
    numbers = np.arange(len(starts), dtype=np.float64)
    within = run.t[(run.t >= starts[0]) & (run.t <= starts[-1])]
    return np.interp(within, starts, numbers), lambda turns: np.interp(turns, numbers, starts)


def driven_orders(system: System) -> Floats:
    """Return the orders of the excitation in a scene's own torque."""
    terms = terms_of(system)
    rate = 1.0 if terms.profile is not None else system.engine.frequency
    driven = [] if terms.torque is None else [1.0]
    driven += [] if terms.harmonics is None else np.round(terms.harmonics[:, 0] / rate).tolist()
    driven += [] if terms.profile is None else [n for n in terms.profile[0, SWELLS::SWELL].tolist() if n > 0.0]
    return np.array(sorted(driven), dtype=np.float64)
