"""Signals of a run, solved, recorded or measured: slip speed, torques and the phase of the excitation.

Orders and spectra resample these signals in equal steps of the phase. The phase of a table of measurements comes from
its column engine_speed, else from the pulses in its column tacho, else from its engine torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tcc_sim.analysis.torque_phase import PhaseTracker
from tcc_sim.errors import InputError
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import SWELL, SWELLS, phase_at
from tcc_sim.recording.table import REFERENCES, TIME
from tcc_sim.solvers.per_cycle import hermite
from tcc_sim.solvers.terms import terms_of
from tcc_sim.topics import FAR_END
from tcc_sim.trajectory import Floats, Trajectory, integral

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
    """

    system: System
    turns: Floats
    when: Callable[[Floats], Floats]
    at: Callable[[Floats], tuple[Floats, Floats, Floats]]
    driven: Floats | None
    breakaways: Floats | None
    t: Floats
    heat: Floats


def turns_at(system: System, t: Floats) -> Floats:
    """Return the periods of the excitation passed at the times t, (n,)."""
    return t / system.cycle if system.profile is None else np.asarray(phase_at(system.profile, t)) / (2.0 * math.pi)


def run_signals(run: Trajectory, phase: Phase | None = None) -> Signals:
    """Return the signals of a solved or recorded run.

    Parameters
    ----------
    run : with its system
    phase : of the excitation; None for that of the scene or the recording

    Raises
    ------
    InputError
        No system, or a commanded torque with unknown periods.
    """
    system = run.system
    if system is None:
        raise InputError("the trajectory has no system, which says what the engine's phase is")
    turns, when = phase or _phase_of(run, system)
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

    given = system.engine.source == "topic" or (system.inputs is not None and system.inputs.torque is not None)
    return Signals(system, turns, when, at, None if given else _driven(system), _breakaways(run), run.t,
                   integral(run.friction_torque * run.slip_speed, run.t))


def measured_signals(columns: Mapping[str, Floats], system: System, pulses: int = 1, source: str = "") -> Signals:
    """Return the signals in the columns of a table.

    The shaft torque is that of plate_angle and plate_speed, minus output_angle and output_speed if the far end moved.

    Parameters
    ----------
    columns : (n,) arrays by name, t and slip_speed among them
    system : stiffness and damping of the shaft, and `engine.order`
    pulses : of the tacho in a crank revolution
    source : name of the table, for errors

    Raises
    ------
    InputError
        The phase is unknown.
    """
    from scipy.interpolate import CubicSpline

    t, d = columns[TIME], system.driveline
    turns, when = measured_phase(columns, system.engine.order, pulses, source)
    unknown = np.full(len(t), np.nan)
    shaft = unknown
    if "plate_angle" in columns:
        angle = columns["plate_angle"]
        speed = columns["plate_speed"] if "plate_speed" in columns else CubicSpline(t, angle)(t, 1)
        if FAR_END in columns:
            speed = speed - columns[FAR_END]
            angle = angle - (columns["output_angle"] if "output_angle" in columns else integral(columns[FAR_END], t))
        shaft = d.damping * speed + d.stiffness * angle
    curves = [None if np.isnan(x).any() else CubicSpline(t, x)
              for x in (columns["slip_speed"], shaft, columns.get("engine_torque", unknown))]

    def at(times: Floats) -> tuple[Floats, Floats, Floats]:
        """Cubic splines through the samples."""
        v, torsion, torque = (np.full(len(times), np.nan) if curve is None else curve(times) for curve in curves)
        return v, torsion, torque

    within = np.interp(t, when(turns), turns)
    return Signals(system, within, when, at, None if "engine_torque" in columns else _driven(system), None, t, unknown)


def measured_phase(columns: Mapping[str, Floats], order: float = 1.0, pulses: int = 1, source: str = "") -> Phase:
    """Return the phase of the excitation in a table, from the first of these columns.

    engine_speed : of the crankshaft, rad/s, with `order` periods of the excitation in a revolution
    tacho : signal with `pulses` rising edges in a revolution, at the middle of its range
    engine_torque : its strongest line is the excitation

    Raises
    ------
    InputError
        None of these columns, or one without rotation.
    """
    t = columns[TIME]
    if "engine_speed" in columns:
        speed = columns["engine_speed"]
        if speed.min() <= 0.0:
            raise InputError(f"{source}: engine_speed is {speed.min():g} rad/s; it must be above 0")
        turns, times = integral(speed, t) * order / (2.0 * math.pi), t
    elif "tacho" in columns:
        level = columns["tacho"] - 0.5 * (columns["tacho"].min() + columns["tacho"].max())
        edges = np.flatnonzero((level[:-1] < 0.0) & (level[1:] >= 0.0))
        if len(edges) < 2:
            raise InputError(f"{source}: the column tacho has {len(edges)} rising edges; it must have 2 or more")
        times = t[edges] + (t[edges + 1] - t[edges]) * level[edges] / (level[edges] - level[edges + 1])
        turns = np.arange(len(times)) * order / pulses
    elif "engine_torque" in columns:
        tracker = PhaseTracker()
        tracker.feed(np.rint(t * 1e9).astype(np.int64), columns["engine_torque"])
        found = tracker.runs()[0]
        if len(found.starts) < 2:
            raise InputError(f"{source}: the engine torque shows no excitation of which periods could be counted"
                             + (f" ({found.why})" if found.why else "") + f"; add the column {' or '.join(REFERENCES)}")
        turns, times = found.numbers.astype(np.float64), found.starts
    else:
        raise InputError(f"{source}: orders need one of the columns {', '.join(REFERENCES)}, engine_torque, which tell "
                         "the phase of the excitation")
    return turns, lambda at: np.interp(at, turns, times)


def found_phase(run: Trajectory) -> Phase:
    """Return the phase of the excitation found in a run's torque, with a constant frequency in each period.

    Raises
    ------
    InputError
        No periods were found.
    """
    starts = run.cycles.starts if run.cycles is not None else None
    if starts is None or len(starts) < 2 or not np.isfinite(starts).all():
        raise InputError("the torque was commanded, and its periods of excitation are not known: there are no orders "
                         "and no spectrum")
    numbers = np.arange(len(starts), dtype=np.float64)
    within = run.t[(run.t >= starts[0]) & (run.t <= starts[-1])]
    return np.interp(within, starts, numbers), lambda turns: np.interp(turns, numbers, starts)


def _phase_of(run: Trajectory, system: System) -> Phase:
    """Return the scene's phase or, for a commanded torque, that found in it."""
    return found_phase(run) if system.engine.source == "topic" else (turns_at(system, run.t), system.cycle_start)


def _driven(system: System) -> Floats:
    """Return the orders of the excitation in a scene's own torque."""
    terms = terms_of(system)
    rate = 1.0 if terms.profile is not None else system.engine.frequency
    driven = [] if terms.torque is None else [1.0]
    driven += [] if terms.harmonics is None else np.round(terms.harmonics[:, 0] / rate).tolist()
    driven += [] if terms.profile is None else terms.profile[0, SWELLS::SWELL].tolist()
    return np.array(sorted(driven), dtype=np.float64)


def _breakaways(run: Trajectory) -> Floats:
    """Return the times at which the clutch changes from stick to slip, s, ascending."""
    if len(run.transitions.time):
        moves = run.transitions
        return np.asarray(moves.time[moves.before == 0])
    out: Floats = run.t[1:][(run.state[:-1] == 0) & (run.state[1:] != 0)]
    return out
