"""The settled motion about which a driveline is linearised: constant, or periodic with the engine.

For both friction laws. A periodic motion is cut into segments, each with its exact derivatives by its start and by an
input (`solvers.*.stroboscopic`); the product of its segments is the effect of a small change on the whole motion.
"""

from __future__ import annotations

import dataclasses
import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.repetition import LONGEST
from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.model import friction
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.equations import linear_of, matrix_of
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.engine import SCALES
from tcc_sim.solvers.stroboscopic import Prepared
from tcc_sim.solvers.terms import Terms, excitation_frequency, stick_speed_of, terms_of
from tcc_sim.sweeps.simulation import settled_from_start
from tcc_sim.trajectory import Floats

SEGMENTS = 512  # Fewest segments of a period of excitation; even, for Simpson's rule.
STILL_SLIP = 1e-9  # Slip speed of a section of the set-valued law that counts as stick, rad/s.
PRESSURE_FACTORS = (0.95, 2.0, 16)  # Lowest and highest factor of the pressure that are tried, and their number.
ENGINE_RTOL = 1e-10  # Relative tolerance of the engine.
CLOSED = 1e-8  # Largest residual of a periodic motion, natural sizes.
MOST_ITERATIONS = 40  # Most iterations of Newton's method.
LONGEST_RUN = 400  # Longest run from the initial state, periods of excitation.
PRESSURE, TORQUE = "pressure.mean", "engine.mean_torque"
"""Scene keys whose change is that of the actuation pressure and of the engine torque."""
STATES: tuple[str, ...] = ("slip_speed", "plate_angle", "plate_speed")
BALANCED = 1e-9  # Difference of torques, relative to the mean torque, that is rounding.


class Carried(NamedTuple):
    """Derivatives of the states between segments by the motion's start and the inputs, (n + 1, 3, 3), (n + 1, 3, 2)."""

    by_state: Floats
    by_input: Floats


@dataclass(frozen=True)
class Constant:
    """A constant motion: constant slip, or stick.

    mean_slip : rad/s
    slope : dTf/dv there, N m s/rad; infinite for stick of the set-valued law
    by_pressure : dTf/dP at constant slip speed, N m/Pa
    """

    system: System
    mean_slip: float
    slope: float
    by_pressure: float


@dataclass(frozen=True)
class Periodic:
    """A motion that repeats with the engine, in n segments, over each of which an input is constant.

    period : engine cycles
    states : (n + 1, 3) slip speed, plate angle, plate speed at the ends of the segments
    by_state : (n, 3, 3) derivative of the state at the end of a segment by that at its start
    by_input : (n, 3, 2) derivative of the same by the mean pressure (Pa) and the mean engine torque (N m)
    """

    system: System
    period: int
    states: Floats
    by_state: Floats
    by_input: Floats

    @cached_property
    def carried(self) -> Carried:
        """Derivatives of the states between the segments."""
        by_state, by_input = [np.eye(3)], [np.zeros((3, 2))]
        for state, inputs in zip(self.by_state, self.by_input):
            by_state.append(state @ by_state[-1])
            by_input.append(state @ by_input[-1] + inputs)
        return Carried(np.array(by_state), np.array(by_input))

    @property
    def seconds(self) -> float:
        """Period, s."""
        return self.period * self.system.cycle

    @property
    def mean_slip(self) -> float:
        """Mean slip speed, rad/s."""
        return float(simpson(len(self.by_state)) @ np.array(self.states[:, 0]))


def operating_point(system: System, slip: float | None, near: Constant | Periodic | None = None) -> Constant | Periodic:
    """Return the motion in which the scene settles, or the one with the mean slip speed `slip`, rad/s, near another one
    if there is one.

    For `slip` Newton's method finds the mean pressure; None keeps the scene's pressure. Raise InputError if the
    excitation does not repeat, the slip runs away, or no pressure gives this slip speed, and NumericalFailure if the
    method fails.
    """
    if common_cycles(system) == 0:
        raise InputError(f"pressure.frequency_ratio is {system.pressure.frequency_ratio:g}; a motion that settles "
                         "needs a ratio of whole numbers up to 1000")
    if slip is not None and (not math.isfinite(slip) or slip == 0.0):
        raise InputError(f"the mean slip speed is {slip:g} rad/s; it must be a number that is not 0")
    if isinstance(near, Periodic):
        with suppress(NumericalFailure):
            return closed(system, near.period, near.states[0], slip)
    if excitation_frequency(terms_of(system)) == 0.0:
        return _constant(system, slip)
    if slip is None:
        return closed(system, *_settled(system), None)
    pressure = abs(system.engine.mean_torque) / system.torque_per_pressure
    if pressure == 0.0:
        raise InputError("engine.mean_torque is 0 N m; no pressure then holds a mean slip speed")
    begun = replace(system, {PRESSURE: min(pressure, 1e7)})
    start = np.array([slip, system.engine.mean_torque / system.driveline.stiffness, 0.0])
    try:
        return closed(begun, common_cycles(system), start, slip)
    except NumericalFailure as error:
        return _from_settled(system, pressure, slip, error)


def _from_settled(system: System, pressure: float, slip: float, failed: NumericalFailure) -> Periodic:
    """Return the motion with the mean slip speed `slip`, from settled motions at pressures around `pressure`.

    Newton's method cannot cross a change in the sequence of stick and slip; one of many pressures has the right one.
    """
    motions = []
    for factor in np.geomspace(*PRESSURE_FACTORS):
        with suppress(OutOfRange, NumericalFailure):
            load = replace(system, {PRESSURE: min(float(factor) * pressure, 1e7)})
            motions.append(closed(load, *_settled(load), None))
    for near in sorted(motions, key=lambda motion: abs(motion.mean_slip - slip)):
        with suppress(NumericalFailure):
            return closed(near.system, near.period, near.states[0], slip)
    raise failed


def _constant(system: System, slip: float | None) -> Constant:
    """Without excitation: return slip at which friction balances the mean torque, or stick."""
    terms, torque = terms_of(system), system.engine.mean_torque
    by_slip = terms.linear.flywheel_by_slip or 0.0
    if slip is not None:
        coefficient, _ = _law(terms, slip)
        carried = torque - by_slip * slip
        if coefficient * carried <= 0.0:
            others = f", of which {by_slip * slip:g} N m pass beside friction" if by_slip else ""
            raise OutOfRange(f"a slip speed of {slip:g} rad/s needs an engine torque in its direction; "
                             f"engine.mean_torque is {torque:g} N m{others}")
        return _at(replace(system, {PRESSURE: carried / (coefficient * system.torque_per_pressure)}), slip)

    if by_slip == 0.0 and abs(torque) > system.largest_friction_ratio * terms.mean_load:
        raise _runaway(torque, system.largest_friction_ratio * terms.mean_load)
    run = solve(system, cycles=LONGEST_RUN, rtol=ENGINE_RTOL, samples_per_cycle=0).raise_for_status()
    v = run.final.slip_speed
    coefficient, slope = _law(terms, v)
    if by_slip == 0.0 and abs(v) > stick_speed_of(terms) and slope <= 0.0:   # Friction that does not rise with slip.
        carried = abs(coefficient) * terms.mean_load
        left = abs(torque) - carried
        if abs(left) <= BALANCED * abs(torque):
            return _at(system, v)
        if left > 0.0:
            raise _runaway(torque, carried)
        v = 0.0   # The slip still decays, to stick.
    if terms.smoothing is None and v == 0.0:
        return Constant(system, 0.0, math.inf, 0.0)
    for _ in range(60):   # In the layer, or where the coupling carries the rest, the torque rises with slip speed.
        coefficient, slope = _law(terms, v)
        step = (torque - coefficient * terms.mean_load - by_slip * v) / (slope * terms.mean_load + by_slip)
        v += step
        if abs(step) <= 1e-15 * max(abs(v), 1e-12):
            break
    return _at(system, v)


def _runaway(torque: float, carried: float, when: str = "") -> OutOfRange:
    """Return the error for slip at which friction carries less than the mean torque, N m."""
    return OutOfRange(f"slip runs away: the mean torque of {torque:g} N m exceeds what the clutch carries{when}, "
                      f"{carried:g} N m; give --slip or another pressure")


def _at(system: System, v: float) -> Constant:
    terms = terms_of(system)
    coefficient, slope = _law(terms, v)
    return Constant(system, v, slope * terms.mean_load, coefficient * system.torque_per_pressure)


def _law(terms: Terms, v: float) -> tuple[float, float]:
    """Return friction over mu_k N R at a slip speed, and its slope, s/rad."""
    if terms.smoothing is not None:
        coefficient, slope = friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)
        return float(coefficient), float(slope)
    sign = math.copysign(1.0, v)
    return float(friction.sliding(v, sign, terms.stribeck)), float(friction.sliding_slope(v, terms.stribeck))


def matrices_of(motion: Constant, pressure: bool,
                output: str = "slip_speed") -> tuple[Floats, Floats, Floats, Floats, tuple[str, ...]]:
    """Return a (n, n), b (n, 1), c (1, n), d (1, 1) of x' = a x + b u, y = c x + d u, and the names of the states, for
    the actuation pressure (Pa), or else for the engine torque (N m).

    They are (2a), (2b) with the slope (20b) of the friction law. Friction is Tf0 + slope dv + by_pressure dP; the
    set-valued law in stick has one oscillator.
    """
    linear = linear_of(motion.system)
    free, i1, i2 = matrix_of(linear), linear.flywheel, linear.plate
    by_friction, by_engine = np.array([-1.0 / i1 - 1.0 / i2, 0.0, 1.0 / i2]), np.array([1.0 / i1, 0.0, 0.0])
    if math.isinf(motion.slope):
        # lambda of v' = 0 in place of the friction torque.
        by_slip, by_state = 0.0, -free[0] / by_friction[0]
        fed = 0.0 if pressure else -by_engine[0] / by_friction[0]
        b = np.array([0.0, 0.0, by_friction[2] * fed])
    else:
        by_slip, by_state = 1.0, np.array([motion.slope, 0.0, 0.0])
        fed = motion.by_pressure if pressure else 0.0
        b = by_friction * fed + (0.0 if pressure else by_engine)
    rows = {"slip_speed": np.array([by_slip, 0.0, 0.0]), "friction_torque": by_state,
            "shaft_torque": np.array([0.0, linear.stiffness, linear.damping])}
    x = slice(0 if by_slip else 1, None)
    return ((free + np.outer(by_friction, by_state))[x, x], b[x, None], rows[output][None, x],
            np.array([[fed if output == "friction_torque" else 0.0]]), STATES[x])


def _settled(system: System) -> tuple[int, Floats]:
    """Return the period in engine cycles and the section point of the motion from the scene's initial state."""
    cycles, period = settled_from_start(system, LONGEST_RUN, rtol=1e-9)
    if period == 0:
        if not cycles.stick_time[len(cycles) // 2:].any() and abs(system.engine.mean_torque) > system.saturation_mean:
            raise _runaway(system.engine.mean_torque, system.saturation_mean, " while it slips")
        raise OutOfRange(f"the scene settles in no motion of a period up to {LONGEST} periods of excitation within "
                         f"{LONGEST_RUN}; there is nothing to linearise about")
    return period, cycles.section[-1]


def closed(system: System, period: int, state: Floats, slip: float | None) -> Periodic:
    """Return the periodic motion near `state` by Newton's method; for `slip` the pressure is unknown too.

    The equations are the return of the section after `period` cycles and, with `slip`, the mean slip speed. In a family
    of motions (slip with mu_k = mu_s and Tm = Tsm) the shortest step is taken.
    """
    pressure, least, damping = system.pressure.mean, math.inf, 1.0
    step = np.zeros(4)
    sizes = np.append(SCALES, max(abs(system.engine.mean_torque) / system.torque_per_pressure, 1e3))
    for _ in range(MOST_ITERATIONS):
        trial, load = state + damping * step[:3], pressure + damping * float(step[3])
        if system.friction.law == "set_valued" and abs(trial[0]) < STILL_SLIP:
            trial[0] = 0.0
        try:
            if not 0.0 < load <= 1e7:
                raise NumericalFailure("the pressure is out of its range")
            motion = cut(replace(system, {PRESSURE: load}), period, trial)
            residual = np.append((motion.states[-1] - trial) / SCALES,
                                 0.0 if slip is None else (motion.mean_slip - slip) / SCALES[0])
            norm = float(np.abs(residual).max())
        except NumericalFailure:
            norm = math.inf
        if norm < CLOSED:
            return _landed(motion)
        if norm >= least:
            damping *= 0.5
            if damping < 1e-4:
                break
            continue
        state, pressure, least, damping = trial, load, norm, 1.0
        jacobian, carried, weights = np.zeros((4, 4)), motion.carried, simpson(len(motion.by_state))
        jacobian[:3, :3] = (carried.by_state[-1] - np.eye(3)) / SCALES[:, None]
        jacobian[:3, 3] = carried.by_input[-1][:, 0] / SCALES
        if slip is not None:
            jacobian[3, :3] = weights @ carried.by_state[:, 0] / SCALES[0]
            jacobian[3, 3] = weights @ carried.by_input[:, 0, 0] / SCALES[0]
        rows = 4 if slip is not None else 3
        step = np.zeros(4)
        step[:rows] = np.linalg.lstsq(-(jacobian * sizes)[:rows, :rows], residual[:rows], rcond=1e-9)[0] * sizes[:rows]
    wanted = "" if slip is None else f" with a mean slip speed of {slip:g} rad/s"
    raise NumericalFailure(f"no motion of period {period}{wanted} was found: the best one misses its start by "
                           f"{least:.1e} in natural sizes")


def _landed(motion: Periodic) -> Periodic:
    """Return a motion that begins in stick of the set-valued law, with its derivative by a slip speed just before it.

    Slip ends at once and preserves I1 v + (I1 + I2) theta2', so that v acts like a plate speed of I1/(I1 + I2) v.
    """
    if motion.by_state[0, :, 0].any():
        return motion
    d, by_state = motion.system.driveline, motion.by_state.copy()
    by_state[0, :, 0] = d.flywheel_inertia / (d.flywheel_inertia + d.plate_inertia) * by_state[0, :, 2]
    return dataclasses.replace(motion, by_state=by_state)


def halved(motion: Periodic) -> Periodic:
    """Return the same motion in half as many segments."""
    first, second = motion.by_state[::2], motion.by_state[1::2]
    return dataclasses.replace(motion, states=motion.states[::2], by_state=second @ first,
                               by_input=second @ motion.by_input[::2] + motion.by_input[1::2])


def cut(system: System, period: int, state: Floats, count: int = SEGMENTS) -> Periodic:
    """Return the motion from `state` on over a period, in `count` segments a cycle."""
    phases = np.append(np.add.outer(np.arange(period), np.arange(count) / count), period)
    states, by = Prepared(system, (PRESSURE, TORQUE), ENGINE_RTOL).along(state, phases.tolist())
    if not np.isfinite(states).all():
        raise NumericalFailure("the state is not finite")
    return Periodic(system, period, states, by[..., :3], by[..., 3:])


def simpson(segments: int) -> Floats:
    """Return the weights of Simpson's rule for a mean over an even number of segments, (segments + 1,)."""
    weights = np.where(np.arange(segments + 1) % 2 == 1, 4.0, 2.0)
    weights[[0, -1]] = 1.0
    return weights / (3.0 * segments)


def stuck_segments(motion: Periodic) -> NDArray[np.bool_]:
    """Return whether each segment starts and ends in stick, (n,)."""
    stuck = np.abs(motion.states[:-1, 0]) <= stick_speed_of(terms_of(motion.system))
    return np.asarray(stuck & np.roll(stuck, -1))


def mean_rows(motion: Periodic) -> tuple[Floats, Floats]:
    """Return derivatives of the means over the period by the start's state, (3, 3), and by the inputs, (3, 2).

    Rows: slip speed, plate angle, plate speed. Samples give no mean of a quantity that jumps where slip ends. The mean
    of the plate speed is the change of its angle, and I1 v + (I1 + I2) theta2' does not jump.
    """
    d, h, slips = motion.system.driveline, motion.seconds / len(motion.by_state), ~stuck_segments(motion)
    rows = []
    for carried in (motion.carried.by_state, motion.carried.by_input):
        mean, turn = 0.5 * (carried[:-1] + carried[1:]), np.diff(carried[:, 1], axis=0) / h
        jump = (mean[:, 2] - turn)[slips].sum(0) / len(mean)
        slip, angle, _ = mean.mean(0)
        rows.append(np.array([slip + (1.0 + d.plate_inertia / d.flywheel_inertia) * jump, angle, turn.mean(0)]))
    return rows[0], rows[1]
