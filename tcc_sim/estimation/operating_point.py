"""The settled motion about which a driveline is linearised: constant, or periodic with the engine.

For both friction laws. A periodic motion is cut into segments, each with its exact derivatives by its start and by an
input (`solvers.*.stroboscopic`); the product of its segments is the effect of a small change on the whole motion.
"""

from __future__ import annotations

import dataclasses
import math
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

SEGMENTS = 512
"""Fewest segments of a period of excitation; even, for Simpson's rule."""
STILL_SLIP = 1e-9
"""Slip speed of a section of the set-valued law that counts as stick, rad/s."""
PRESSURE_FACTORS = (0.95, 2.0, 16)
"""Lowest and highest factor of the pressure that are tried, and their number."""
ENGINE_RTOL = 1e-10
"""Relative tolerance of the engine."""
CLOSED = 1e-8
"""Largest residual of a periodic motion, natural sizes."""
MOST_ITERATIONS = 40
"""Most iterations of Newton's method."""
LONGEST_RUN = 400
"""Longest run from the initial state, periods of excitation."""
PRESSURE, TORQUE = "pressure.mean", "engine.mean_torque"
"""Scene keys whose change is that of the actuation pressure and of the engine torque."""
BALANCED = 1e-9
"""Difference of torques, relative to the mean torque, that is rounding."""


class MotionSegment(NamedTuple):
    """A segment of a periodic motion.

    state : (3,) slip speed, plate angle, plate speed at its start
    by_state : (3, 3) derivative of the state at its end by that at its start
    by_input : (3, 2) derivative by the mean pressure (Pa) and the mean engine torque (N m), constant over the segment
    """

    state: Floats
    by_state: Floats
    by_input: Floats


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
    """A motion that repeats with the engine.

    period : engine cycles
    segments : in order, over the whole period
    mean_slip : rad/s
    """

    system: System
    period: int
    segments: list[MotionSegment]
    mean_slip: float

    @cached_property
    def carried(self) -> Carried:
        """Derivatives of the states between the segments."""
        return _carried(self.segments)

    @property
    def seconds(self) -> float:
        """Period, s."""
        return self.period * self.system.cycle


def operating_point(system: System, slip: float | None) -> Constant | Periodic:
    """Return the motion in which the scene settles, or the one with the mean slip speed `slip`, rad/s.

    For `slip` Newton's method finds the mean pressure; None keeps the scene's pressure. Raise InputError if the
    excitation does not repeat, the slip runs away, or no pressure gives this slip speed, and NumericalFailure if the
    method fails.
    """
    if common_cycles(system) == 0:
        raise InputError(f"pressure.frequency_ratio is {system.pressure.frequency_ratio:g}; a motion that settles "
                         "needs a ratio of whole numbers up to 1000")
    if slip is not None and (not math.isfinite(slip) or slip == 0.0):
        raise InputError(f"the mean slip speed is {slip:g} rad/s; it must be a number that is not 0")
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
        try:
            load = replace(system, {PRESSURE: min(float(factor) * pressure, 1e7)})
            motions.append(closed(load, *_settled(load), None))
        except (OutOfRange, NumericalFailure):
            continue
    for near in sorted(motions, key=lambda motion: abs(motion.mean_slip - slip)):
        try:
            return closed(near.system, near.period, near.segments[0].state, slip)
        except NumericalFailure:
            continue
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
        system = replace(system, {PRESSURE: carried / (coefficient * system.torque_per_pressure)})
        terms = terms_of(system)
        return _at(system, terms, slip)
    def runaway(coefficient: float) -> OutOfRange:
        """Return the error for slip at which friction carries too little."""
        return OutOfRange(f"slip runs away: the mean torque of {torque:g} N m exceeds what the clutch carries, "
                          f"{abs(coefficient) * terms.mean_load:g} N m; give --slip or another pressure")

    if by_slip == 0.0 and abs(torque) > system.largest_friction_ratio * terms.mean_load:
        raise runaway(system.largest_friction_ratio)
    run = solve(system, cycles=LONGEST_RUN, rtol=ENGINE_RTOL, samples_per_cycle=0).raise_for_status()
    v = run.final.slip_speed
    coefficient, slope = _law(terms, v)
    if by_slip == 0.0 and abs(v) > stick_speed_of(terms) and slope <= 0.0:   # Friction that does not rise with slip.
        left = abs(torque) - abs(coefficient) * terms.mean_load
        if abs(left) <= BALANCED * abs(torque):
            return _at(system, terms, v)
        if left > 0.0:
            raise runaway(coefficient)
        v = 0.0   # The slip still decays, to stick.
    if terms.smoothing is None and v == 0.0:
        return Constant(system, 0.0, math.inf, 0.0)
    for _ in range(60):   # In the layer, or where the coupling carries the rest, the torque rises with slip speed.
        coefficient, slope = _law(terms, v)
        step = (torque - coefficient * terms.mean_load - by_slip * v) / (slope * terms.mean_load + by_slip)
        v += step
        if abs(step) <= 1e-15 * max(abs(v), 1e-12):
            break
    return _at(system, terms, v)


def _at(system: System, terms: Terms, v: float) -> Constant:
    coefficient, slope = _law(terms, v)
    return Constant(system, v, slope * terms.mean_load, coefficient * system.torque_per_pressure)


def _law(terms: Terms, v: float) -> tuple[float, float]:
    """Return friction over mu_k N R at a slip speed, and its slope, s/rad."""
    if terms.smoothing is not None:
        coefficient, slope = friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)
        return float(coefficient), float(slope)
    sign = math.copysign(1.0, v)
    return float(friction.sliding(v, sign, terms.stribeck)), float(friction.sliding_slope(v, terms.stribeck))


def matrices_of(motion: Constant, pressure: bool) -> tuple[Floats, Floats, dict[str, tuple[list[float], float]],
                                                           tuple[str, ...]]:
    """Return a (n, n), b (n, 1) of x' = a x + b u for the actuation pressure (Pa), or else for the engine torque (N m).

    They are (2a), (2b) with the slope (20b) of the friction law. Also the (n,) row of C and the direct feed of each
    output, and the names of the states. Friction is Tf0 + slope dv + by_pressure dP; the set-valued law in stick has
    one oscillator.
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


def _settled(system: System) -> tuple[int, Floats]:
    """Return the period in engine cycles and the section point of the motion from the scene's initial state."""
    cycles, period = settled_from_start(system, LONGEST_RUN, rtol=1e-9)
    if period == 0:
        if not cycles.stick_time[len(cycles) // 2:].any() and abs(system.engine.mean_torque) > system.saturation_mean:
            raise OutOfRange(f"slip runs away: the mean torque of {system.engine.mean_torque:g} N m exceeds what the "
                             f"clutch carries while it slips, {system.saturation_mean:g} N m; give --slip or another "
                             "pressure")
        raise OutOfRange(f"the scene settles in no motion of a period up to {LONGEST} periods of "
                         "excitation "
                         f"within {LONGEST_RUN}; there is nothing to linearise about")
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
            segments, end = _segments(replace(system, {PRESSURE: load}), period, trial)
            carried, weights = _carried(segments), simpson(len(segments))
            mean = float(weights @ [*(each.state[0] for each in segments), end[0]])
            residual = np.append((end - trial) / SCALES, 0.0 if slip is None else (mean - slip) / SCALES[0])
            norm = float(np.abs(residual).max())
        except NumericalFailure:
            norm = math.inf
        if norm < CLOSED:
            segments[0] = _landed(system, segments[0])
            return Periodic(replace(system, {PRESSURE: load}), period, segments, mean)
        if norm >= least:
            damping *= 0.5
            if damping < 1e-4:
                break
            continue
        state, pressure, least, damping = trial, load, norm, 1.0
        jacobian = np.zeros((4, 4))
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


def _carried(segments: list[MotionSegment]) -> Carried:
    """Return derivatives of every segment's start, and of the end, by the start of the motion and by the inputs."""
    by_state, by_input = [np.eye(3)], [np.zeros((3, 2))]
    for segment in segments:
        by_state.append(segment.by_state @ by_state[-1])
        by_input.append(segment.by_state @ by_input[-1] + segment.by_input)
    return Carried(np.array(by_state), np.array(by_input))


def _landed(system: System, segment: MotionSegment) -> MotionSegment:
    """Return a segment that begins in stick of the set-valued law, with its derivative by a slip speed just before it.

    Slip ends at once and preserves I1 v + (I1 + I2) theta2', so that v acts like a plate speed of I1/(I1 + I2) v.
    """
    if segment.by_state[:, 0].any():
        return segment
    d = system.driveline
    by_state = segment.by_state.copy()
    by_state[:, 0] = d.flywheel_inertia / (d.flywheel_inertia + d.plate_inertia) * by_state[:, 2]
    return segment._replace(by_state=by_state)


def refined(motion: Periodic, count: int) -> Periodic:
    """Return the same motion in `count` segments a cycle."""
    segments, _ = _segments(motion.system, motion.period, motion.segments[0].state, count)
    return dataclasses.replace(motion, segments=segments)


def halved(motion: Periodic) -> Periodic:
    """Return the same motion in half as many segments."""
    first, second = motion.segments[::2], motion.segments[1::2]
    segments = [MotionSegment(a.state, b.by_state @ a.by_state, b.by_state @ a.by_input + b.by_input)
                for a, b in zip(first, second)]
    return dataclasses.replace(motion, segments=segments)


def _segments(system: System, period: int, state: Floats,
              count: int = SEGMENTS) -> tuple[list[MotionSegment], Floats]:
    """Return the segments from `state` on, `count` a cycle, and the state at their end."""
    of = Prepared(system, (PRESSURE, TORQUE), ENGINE_RTOL)
    segments = []
    for cycle in range(period):
        states, by = of.along(state, (cycle + np.arange(count + 1) / count).tolist())
        if not np.isfinite(states).all():
            raise NumericalFailure("the state is not finite")
        segments += [MotionSegment(at, each[:, :3], each[:, 3:]) for at, each in zip(states, by)]
        state = states[-1]
    return segments, state


def simpson(segments: int) -> Floats:
    """Return the weights of Simpson's rule for a mean over an even number of segments, (segments + 1,)."""
    weights = np.where(np.arange(segments + 1) % 2 == 1, 4.0, 2.0)
    weights[[0, -1]] = 1.0
    return weights / (3.0 * segments)


def stuck_segments(motion: Periodic) -> NDArray[np.bool_]:
    """Return whether each segment starts and ends in stick, (n,)."""
    speeds = np.abs([*(segment.state[0] for segment in motion.segments), motion.segments[0].state[0]])
    stuck = speeds <= stick_speed_of(terms_of(motion.system))
    return np.asarray(stuck[:-1] & stuck[1:])


def mean_rows(motion: Periodic) -> tuple[Floats, Floats]:
    """Return derivatives of the means over the period by the start's state, (3, 3), and by the inputs, (3, 2).

    Rows: slip speed, plate angle, plate speed. Samples give no mean of a quantity that jumps where slip ends. The mean
    of the plate speed is the change of its angle, and I1 v + (I1 + I2) theta2' does not jump.
    """
    d, h, slips = motion.system.driveline, motion.seconds / len(motion.segments), ~stuck_segments(motion)
    rows = []
    for carried in (motion.carried.by_state, motion.carried.by_input):
        mean, turn = 0.5 * (carried[:-1] + carried[1:]), np.diff(carried[:, 1], axis=0) / h
        jump = (mean[:, 2] - turn)[slips].sum(0) / len(mean)
        slip, angle, _ = mean.mean(0)
        rows.append(np.array([slip + (1.0 + d.plate_inertia / d.flywheel_inertia) * jump, angle, turn.mean(0)]))
    return rows[0], rows[1]
