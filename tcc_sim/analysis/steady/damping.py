"""Equivalent viscous damping of the friction torque, (21), and related averages, for the instability criterion (23).

The averages are integrals along the motion between the instants at which dT/dv changes its sign or jumps; no sum over
samples has a jump between two of them.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model import equations, friction
from tcc_sim.model.parameters import System
from tcc_sim.result import Described, reported, result_class
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import Terms, peak_load, terms_of
from tcc_sim.trajectory import FREE, STICK, Cycles, Floats, State, Trajectory

AVERAGED = 16  # Length that the averages are taken over, periods of excitation.
RTOL = 1e-9  # Relative tolerance of the motion and its integrals with the smoothed law.
GROWTH_BETWEEN = 0.07
"""Growth of slip on the falling law between two samples, in natural logarithm; the error is about its fourth power."""
FEWEST_SAMPLES = 1024
"""Samples per cycle with the set-valued law, at least: between them the motion is interpolated from its equations."""
MOST_SAMPLES = 131072  # The same at most.

GAUSS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(4))
"""Half the abscissae and weights of the four-point rule."""


@result_class
class Damping(Described):
    """Averages of dT/dv = Ts(t) d(mubar)/dv over whole engine cycles.

    threshold : -C23 - b, N m s/rad; by (23) the motion is unstable if Cf, of friction alone, is below it
    """

    weighted: float = reported(
        "Cf of (21), dT/dv weighted with v^2; null without slip", "N m s/rad", name="equivalent_damping", scatters=True)
    negative_mean: float = reported(
        "time mean of the negative part of dT/dv", "N m s/rad", name="negative_slope_mean", scatters=True)
    threshold: float


def threshold_of(system: System) -> float:
    """Return -C23 - b, the threshold of (23) for the slope of friction, N m s/rad: the coupling adds b to dT/dv."""
    return -system.driveline.damping - system.converter.coupling


def damping_of_cycles(system: System, cycles: Cycles, first: int, period: int) -> Damping:
    """Return the averages over the last engine cycles, each solved from its state on the section.

    They are therefore as accurate for a recording, whose ticks pass over the layer of the smoothed law, as for a
    solution.

    cycles, first : cycles, NaN where one is missing, and the number of the first, which sets its phase
    period : of the motion, engine cycles, 0 for none; whole periods are averaged
    returns : Damping, NaN if no cycle can be solved
    """
    count = math.ceil(AVERAGED / max(period, 1)) * max(period, 1)
    integrals, time = np.zeros(3), 0.0
    for n in range(max(len(cycles) - count, 0), len(cycles)):
        if not math.isfinite(cycles.highest[n]):
            continue
        try:
            integrals += _integrals(system, cycles.section[n], first + n)
        except NumericalFailure:
            return Damping(math.nan, math.nan, threshold_of(system))
        time += system.cycle
    weighted, energy, negative = integrals.tolist()
    return Damping(weighted / energy if energy > 0.0 else math.nan, negative / time if time > 0.0 else math.nan,
                   threshold_of(system))


def _integrals(system: System, section: Floats, number: int) -> Floats:
    """Return the integrals of dT/dv v^2, v^2 and min(dT/dv, 0) over one cycle, (3,), or raise NumericalFailure."""
    if system.friction.law == "smoothed":
        from tcc_sim.solvers.stroboscopic import slope_integrals

        return slope_integrals(system, section, number, RTOL)
    terms = terms_of(system)
    falling = friction.steepest_fall(terms.stribeck)
    samples = math.ceil(system.cycle * system.inverse_inertia * peak_load(terms) * falling / GROWTH_BETWEEN)
    samples = min(max(samples, FEWEST_SAMPLES), MOST_SAMPLES)
    run = solve(system, cycles=1, samples_per_cycle=samples, start_cycle=number, state=State.of(section))
    return integrals_of_arcs(run.raise_for_status())


def integrals_of_arcs(run: Trajectory) -> Floats:
    """Return the integrals over time of dT/dv v^2, v^2 and min(dT/dv, 0), (3,), of a sampled set-valued motion.

    Between samples and transitions the slip speed is the cubic through its values and its accelerations, by (2a), (2b)
    with the torque of the arc's mode; it is 0 at changes of mode, unless the clutch is free there.
    """
    assert run.system is not None
    terms, changes = terms_of(run.system), run.transitions
    left, right, mode = _pieces(run)
    h = right - left
    ends = [_end_of_pieces(run, terms, at, np.where(mode == FREE, 1, mode), after)
            for at, after in ((left, True), (right, False))]
    held = changes.time[(changes.before != FREE) & (changes.after != FREE)]
    (p, dp), (q, dq) = ((np.where(np.isin(at, held), 0.0, v), h * a) for (v, a), at in zip(ends, (left, right)))
    total = np.zeros(3)
    for x, weight in zip(0.5 + GAUSS, WEIGHTS):
        y = 1.0 - x
        v = y * y * (p * (1.0 + 2.0 * x) + x * dp) + x * x * (q * (1.0 + 2.0 * y) - y * dq)
        v = np.where(mode == STICK, 0.0, v)
        load = equations.saturation_torque(left + x * h, terms.mean_load, terms.pulsation)
        slope = np.where(mode == STICK, 0.0, load * friction.sliding_slope(v, terms.stribeck))
        part = weight * h
        total += [float(np.sum(part * slope * v * v)), float(np.sum(part * v * v)), float(np.sum(part * slope))]
    return total


def _pieces(run: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Return start, end and mode of the pieces into which samples and transitions cut a run, (n,) each."""
    changes = run.transitions
    times = np.unique(np.concatenate([run.t, changes.time]))
    left, right = times[:-1], times[1:]
    if not len(changes.time):
        inside = np.sign(run.slip_speed[:-1] + run.slip_speed[1:])
        return left, right, np.where((run.state[:-1] == 0) & (run.state[1:] == 0), 0.0, inside)
    place = np.searchsorted(changes.time, 0.5 * (left + right))
    modes = np.concatenate([changes.before[:1], changes.after]).astype(np.float64)
    return left, right, modes[place]


def _end_of_pieces(run: Trajectory, terms: Terms, at: Floats, mode: Floats, after: bool) -> tuple[Floats, Floats]:
    """Return slip speed and acceleration at one end of every piece, by Taylor's series from the sample on its side."""
    # `after`: the end is the start of a piece
    assert run.system is not None
    near = np.searchsorted(run.t, at, side="left" if after else "right") - (0 if after else 1)
    near = np.clip(near, 0, len(run.t) - 1)
    dt = at - run.t[near]
    v, angle, speed = run.slip_speed[near], run.plate_angle[near], run.plate_speed[near]

    def accelerations(t: Floats, v: Floats, angle: Floats, speed: Floats) -> tuple[Floats, Floats]:
        engine = equations.engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics)
        load = equations.saturation_torque(t, terms.mean_load, terms.pulsation)
        sliding: Any = friction.sliding
        torque = load * sliding(np.abs(v) * mode, mode, terms.stribeck)
        slip, plate = equations.accelerations(v, angle, speed, engine, torque, terms.linear)
        return slip, plate

    slip, plate = accelerations(run.t[near], v, angle, speed)
    v, angle, speed = v + slip * dt, angle + dt * (speed + 0.5 * dt * plate), speed + dt * plate
    return v, accelerations(at, np.where(dt == 0.0, v, np.maximum(v * mode, 0.0) * mode), angle, speed)[0]


def slope_of_friction(trajectory: Trajectory) -> Floats:
    """Return dT/dv = Ts(t) d(mubar)/dv at the samples by (20a), (20b), N m s/rad.

    The set-valued law has its sliding slope for v != 0, and 0 for v = 0, where no slope exists.
    """
    if trajectory.system is None:
        raise InputError("the slope of the friction torque needs the system of the trajectory")
    terms = terms_of(trajectory.system)
    v = trajectory.slip_speed
    if terms.smoothing is not None:
        slope = friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1]
    elif terms.stribeck is not None:
        slope = np.where(v == 0.0, 0.0, friction.sliding_slope(v, terms.stribeck))
    else:
        slope = np.zeros_like(v)
    return cast(Floats, trajectory.saturation_torque * slope)
