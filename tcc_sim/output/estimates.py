"""Estimates of a scene before anything is solved: natural frequencies, torques over a cycle, and the critical slope of
friction and the critical frequency of the paper.
"""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.closed_forms import common_cycles, pure_slip, stick_margin
from tcc_sim.model.equations import linear_of, matrix_of
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import TIME, time_at
from tcc_sim.result import reported, result_class
from tcc_sim.shown_units import SPEED, engine_speed, frequency, shown_unit, speed
from tcc_sim.solvers.terms import terms_of, torques_at
from tcc_sim.trajectory import Floats

SAMPLES = 2000
"""Samples of the torques per engine cycle."""
CYCLES = 200
"""Largest number of sampled cycles, for long profiles and for a load that never repeats with the engine."""


@result_class
class Mode:
    """A linear mode of the driveline: natural frequency (rad/s), and damping ratio of C23."""

    frequency: float = reported("natural frequency", "rad/s")
    damping_ratio: float = reported("damping ratio of C23")


@result_class
class Torque:
    """Smallest, mean and largest value of a torque over the excitation's period, or over the profiles, N m.

    The mean is an integral over the phase of whole engine cycles.
    """

    low: float = reported("smallest over a cycle, or over the profiles", "N m")
    mean: float = reported("mean value", "N m")
    high: float = reported("largest value", "N m")


@result_class
class ActuatorEffect:
    """The actuator between a commanded pressure and the plates, for small sines at the slipping mode."""

    time_constant: float = reported("first-order lag", "s")
    delay: float = reported("dead time", "s")
    rate_limit: float = reported("rate limit; 0 for none", "Pa/s")
    phase: float = reported(
        "phase of the applied over the commanded pressure at the slipping mode, without jumps of 2 pi", "rad")
    gain: float = reported("ratio of their amplitudes there")
    largest_amplitude: float | None = reported(
        "amplitude of the applied pressure at which the rate limit acts; null without one", "Pa")


@result_class
class Estimates:
    """Estimates of a scene from its parameters alone."""

    slipping: Mode = reported("mode sqrt(K23/I2) (17c) of the slipping clutch")
    stuck: Mode = reported("mode sqrt(K23/(I1 + I2)) (27) of the stuck clutch")
    engine: Torque = reported("engine torque")
    static: Torque = reported("mu_s N R")
    kinetic: Torque = reported("mu_k N R; with a friction table mu N R at its last slip speed")
    stick_margin: float | None = reported("smallest mu_s N R - |interface torque| of pure stick (10)", "N m")
    expected: str = reported(
        "stick, slip, stick-slip or runaway, from these torques; two where the initial state decides")
    why: str = reported("reason")
    critical_slope: float | None = reported(
        "slope of friction torque over slip speed below which constant slip is unstable; null without one", "N m s/rad")
    steepest_slope: float = reported("steepest fall of this scene's friction torque at its mean pressure", "N m s/rad")
    critical_frequency: float = reported(
        "sqrt(K23/(I1 + I2)) of (28): below it positive slip falls into the first half of a cycle", "rad/s")
    engine_frequency: tuple[float, float] = reported("lowest and highest", "rad/s")
    profiles: bool = reported("whether the torques are over profiles in time", default=False)
    fastest: float | None = reported("last slip speed of the friction table", "rad/s", default=None)
    actuator: ActuatorEffect | None = reported("actuator of the commanded pressure", optional=True, default=None)


def estimates_of(system: System) -> Estimates:
    """Estimate how a scene behaves; a torque from a topic is replaced by its fallback value."""
    d = system.driveline
    both = d.flywheel_inertia + d.plate_inertia
    slipping, stuck = (Mode(math.sqrt(d.stiffness / inertia), 0.5 * d.damping / math.sqrt(d.stiffness * inertia))
                       for inertia in (d.plate_inertia, both))
    engine, fast = _torques(system)
    sliding = system.friction.sliding
    last = float(sliding.at(sliding.fastest)) / sliding.constant if system.friction.curve is not None else 1.0
    static, kinetic = (Torque(ratio * fast.low, ratio * fast.mean, ratio * fast.high)
                       for ratio in (system.friction_ratio, last))
    try:
        margin = stick_margin(system).torque
    except InputError:
        margin = None
    frequencies = system.engine.frequency_values or (system.engine.frequency,)
    steepest = min(float(sliding.slope(sliding.speeds).min()), 0.0) / sliding.constant * fast.mean
    return Estimates(slipping, stuck, engine, static, kinetic, margin,
                     *_expected(system, engine, static, kinetic, fast, margin), critical_slope(system), steepest,
                     stuck.frequency,
                     (min(frequencies), max(frequencies)),
                     system.profile is not None, None if system.friction.curve is None else sliding.fastest,
                     _actuator(system, slipping.frequency))


def _actuator(system: System, omega: float) -> ActuatorEffect | None:
    """The effect of the actuator at omega, rad/s, by exp(-i omega delay)/(1 + i omega T); None without one."""
    p = system.pressure
    if not p.actuated:
        return None
    return ActuatorEffect(p.time_constant, p.delay, p.rate_limit,
                          -omega * p.delay - math.atan(omega * p.time_constant),
                          1.0 / math.hypot(1.0, omega * p.time_constant),
                          p.rate_limit / omega if p.rate_limit > 0.0 else None)


def _torques(system: System) -> tuple[Torque, Torque]:
    """Return engine torque and mu_k N R over the excitation's period, or over the profiles."""
    if system.profile is None:
        cycles = min(common_cycles(system), CYCLES) or CYCLES
    else:
        cycles = max(math.ceil(system.cycles_until(system.span) * (1.0 - 1e-9)), 1)
    count = SAMPLES * min(cycles, CYCLES)
    phase = np.linspace(0.0, 2.0 * math.pi * cycles, count + 1)
    times = phase / system.engine.frequency if system.profile is None else time_at(system.profile, phase)
    within = len(times) if system.profile is None else int(np.searchsorted(times, system.span, side="right"))
    corners = np.empty(0) if system.profile is None else system.profile[:, TIME]
    torques = torques_at(terms_of(system), np.concatenate([times, corners[corners <= system.span]]))
    engine, load = (Torque(float(seen.min()), float(x[:count].mean()), float(seen.max()))
                    for x in torques for seen in (np.append(x[:within], x[count + 1:]),))
    return engine, load


def critical_slope(system: System) -> float | None:
    """Return the slope s, N m s/rad, below which the oscillation at constant slip grows; None where it never does.

    There the characteristic polynomial x^3 + p x^2 + q x + r of (22), of the linear part with s, has a pair of
    imaginary roots: p q = r with q > 0. p, q and r are linear in s. With C23 and K23 alone s is the root next to 0 of
    [I1 C + (I1 + I2) s] [I1 K + C s] = I1 I2 K s, which a strongly damped driveline does not have.
    """
    linear = linear_of(system)
    a, by_friction = matrix_of(linear), np.array([-1.0 / linear.flywheel - 1.0 / linear.plate, 0.0, 1.0 / linear.plate])

    def coefficients(slope: float) -> Floats:
        """Return p, q and r."""
        m = a + slope * np.outer(by_friction, [1.0, 0.0, 0.0])
        minors = sum(m[i, i] * m[j, j] - m[i, j] * m[j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
        with np.errstate(over="ignore", invalid="ignore"):  # Old NumPy warns; the result is None either way.
            return np.array([-np.trace(m), minors, -np.linalg.det(m)])

    still = coefficients(0.0)
    (p0, q0, r0), (p1, q1, r1) = still, coefficients(1.0) - still
    square, slope, constant = p1 * q1, p0 * q1 + p1 * q0 - r1, p0 * q0 - r0
    inside = slope * slope - 4.0 * square * constant
    if inside < 0.0:
        return None
    root = -2.0 * constant / (slope + math.sqrt(inside))  # Form of the root without cancellation.
    return float(root) if q0 + root * q1 > 0.0 else None  # Otherwise the two roots are real, of opposite signs.


def _expected(system: System, engine: Torque, static: Torque, kinetic: Torque, fast: Torque,
              margin: float | None) -> tuple[str, str]:
    """Return the motion that these torques and the closed form of pure slip let expect, two where it depends on the
    initial state, and the reason.

    fast : mu_k N R, of slip beyond the range of a friction table
    """
    mean, sticks = abs(engine.mean), margin is not None and margin >= 0.0
    carried = "the clutch carries every peak of the torque, so pure stick is possible"
    if mean > kinetic.mean:
        slips, why = "runaway", ("the mean engine torque exceeds the torque of the sliding clutch, so fast slip grows "
                                 "without end")
        if linear_of(system).flywheel_by_slip is not None:
            slips, why = "slip", "a torque that rises with slip speed carries what the sliding clutch does not"
        elif system.friction.curve is not None and mean <= fast.mean:
            slips, why = "slip", (f"the mean engine torque exceeds the torque of the clutch at every slip speed of the "
                                  f"friction table, so slip grows beyond its {speed(system.friction.curve.fastest)}")
        return (f"stick or {slips}", f"{carried}; in slip, {why}") if sticks else (slips, why)
    try:
        lasting = pure_slip(system, -1 if system.initial.slip_speed < 0.0 else 1).least_slip_speed > 0.0
    except InputError:
        lasting = False
    if lasting:
        return "slip", "slip never ends from this initial state"
    if sticks:
        return "stick", carried
    if mean > static.mean:
        return "slip", ("the clutch carries the mean torque only while it slips, because friction rises with slip "
                        "speed")
    return "stick-slip", "the clutch carries the mean torque but not its peaks"


def estimate_lines(estimates: Estimates) -> list[str]:
    """Return the lines of the estimates."""
    def mode(name: str, formula: str, one: Mode) -> str:
        hertz = f" ({one.frequency / (2.0 * math.pi):.4g} Hz)" if shown_unit()[0] == SPEED else ""
        return f"  {name:<9} {frequency(one.frequency)}{hertz}, damping ratio {one.damping_ratio:.4g}   {formula}"

    def torque(name: str, one: Torque) -> str:
        span = f"{one.low:.6g} to {one.high:.6g} N m, mean {one.mean:.6g} N m"
        return f"  {name:<17} {span if one.low < one.high else f'{one.mean:.6g} N m'}"

    margin = "" if estimates.stick_margin is None else f"; margin of pure stick (10): {estimates.stick_margin:.6g} N m"
    least = estimates.critical_slope
    critical = "none, because the oscillation of steady slip is damped at every slope" if least is None else (
        f"{least:.4g} N m s/rad, friction torque over slip speed; the steepest slope of this law is "
        f"{estimates.steepest_slope:.4g} N m s/rad, so " + ("steady slip at such speeds judders"
                                                            if estimates.steepest_slope < least else
                                                            "the oscillation of steady slip is damped"))
    fast = "clutch, mu_k N R" if estimates.fastest is None else f"clutch at {speed(estimates.fastest)}"
    low, high = estimates.engine_frequency
    critical_frequency = engine_speed(estimates.critical_frequency)
    if low < estimates.critical_frequency < high:
        side = f"the {engine_speed(low, 6, high)} passes it"
    else:
        half, word = ("first", "below") if high < estimates.critical_frequency else ("second", "above")
        side = (f"{engine_speed(low, 6, high if low < high else None)} is {word} it, so positive slip falls into the "
                f"{half} half of a period of excitation")
    return ["natural frequencies",
            mode("slipping", "sqrt(K23/I2)", estimates.slipping), mode("stuck", "sqrt(K23/(I1 + I2))", estimates.stuck),
            f"torques over {'the profiles' if estimates.profiles else 'a period of excitation'}",
            torque("engine", estimates.engine),
            torque("clutch, mu_s N R", estimates.static), torque(fast, estimates.kinetic),
            f"  expected: {estimates.expected}; {estimates.why}{margin}",
            f"critical slope (22): {critical}",
            f"critical frequency (28): {critical_frequency}; {side}",
            *([] if estimates.actuator is None else [_actuator_line(estimates.actuator, estimates.slipping.frequency)])]


def _actuator_line(effect: ActuatorEffect, omega: float) -> str:
    parts = [f"{name} {value:g} {unit}" for name, value, unit in (
        ("lag", effect.time_constant, "s"), ("dead time", effect.delay, "s"),
        ("rate limit", effect.rate_limit, "Pa/s")) if value]
    limit = "" if effect.largest_amplitude is None else (
        f"; the rate limit allows an amplitude of {effect.largest_amplitude:.4g} Pa there")
    return (f"actuator: {', '.join(parts)}; at the slipping mode, {frequency(omega)}, it costs "
            f"{-math.degrees(effect.phase):.4g} degrees of phase and leaves {effect.gain:.1%} of the amplitude{limit}")
