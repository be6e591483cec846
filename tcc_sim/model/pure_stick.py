"""Pure stick in closed form: (8) to (11), (24) to (28) of the paper, for any number of engine harmonics.

Stuck, the inertias move as one oscillator I1 + I2 that the engine torque drives.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.sines import Floats, Sines, common_cycles, dynamic_stiffness, engine_series, load_series

STUCK = "engine.frequency excites the undamped stuck"


def stick_phase(system: System, omega: float) -> float:
    """Return phi of (8b), rad: the phase of the plate angle relative to the engine torque.

    The print takes the arctangent of the quotient, which is off by pi above omega_sn; this is the four-quadrant one.
    """
    d = system.driveline
    return -math.atan2(d.damping * omega, d.stiffness - (d.flywheel_inertia + d.plate_inertia) * omega**2)


def interface_phase(system: System, omega: float) -> float:
    """Return vartheta of (25b), rad: the lead of the interface torque on the plate angle, a four-quadrant arctangent.

    (26) neglects it, which holds for C23 omega << K23 - I2 omega^2.
    """
    d = system.driveline
    return math.atan2(d.damping * omega, d.stiffness - d.plate_inertia * omega**2)


def interface_gain(system: System, omega: float) -> float:
    """Return the ratio of the amplitudes of interface and engine torque, from (25a)."""
    d = system.driveline
    plate = complex(d.stiffness - d.plate_inertia * omega**2, d.damping * omega)
    return abs(plate) / abs(dynamic_stiffness(d, d.flywheel_inertia + d.plate_inertia, omega, STUCK))


def plate_angle(system: System) -> Sines:
    """Return delta2(t) of (8) in pure stick, rad: the steady motion, from each harmonic of the engine torque.

    Raises
    ------
    InputError
        The engine excites an undamped driveline at exactly omega_sn.
    """
    d = system.driveline
    both = d.flywheel_inertia + d.plate_inertia
    return engine_series(system).through(lambda omega: 1.0 / dynamic_stiffness(d, both, omega, STUCK))


def stuck_interface_torque(system: System) -> Sines:
    """Return Tfi(t) of (25a) in pure stick, N m: the friction torque that stick needs.

    (9) is the same with the amplitude I1 omega^2 Tp/sqrt((K23 - (I1 + I2) omega^2)^2 + (C23 omega)^2) in its last term,
    where the print omits the inertia and the damping.
    """
    return engine_series(system).through(lambda omega: cmath.rect(
        interface_gain(system, omega), stick_phase(system, omega) + interface_phase(system, omega)))


@dataclass(frozen=True)
class StickMargin:
    """Smallest mu_s N R - |Tfi|, N m, and its time in the common period, s (nan without a common period)."""

    torque: float
    time: float

    @property
    def sticks(self) -> bool:
        """Whether pure stick is possible by (10)."""
        return self.torque >= 0.0


def stick_margin(system: System) -> StickMargin:
    """Return the criterion (10), (11) of pure stick: the smallest mu_s N(t) R - |Tfi(t)|.

    (10) is printed without the modulus; the friction torque is bounded on both sides. With omega_f = (M/N) omega the
    common period is N engine cycles, not the 2 pi/omega of (11b). For an incommensurable omega_f every pair of phases
    occurs.

    The minimum is found by branch and bound on the second derivative, so no dip between grid points is missed.
    """
    torque, load = stuck_interface_torque(system), load_series(system)
    ratio = system.friction_ratio
    cycles = common_cycles(system)
    frequencies = np.concatenate([torque.frequency, load.frequency])
    if len(frequencies) == 0:
        return StickMargin(ratio * max(load.mean, 0.0) - abs(torque.mean), 0.0)
    if len(torque.frequency) == 0 or cycles == 0:
        least = max(load.mean - load.swing(), 0.0)
        still = Sines.of(least, [])
        worst = _smallest(torque, still, ratio, system.cycle)
        return StickMargin(worst.torque, math.nan if len(load.frequency) else worst.time)
    return _smallest(torque, load, ratio, cycles * system.cycle)


def _smallest(torque: Sines, load: Sines, ratio: float, period: float) -> StickMargin:
    """Minimise ratio max(Ts, 0) - |Tfi| over one period by branch and bound."""
    frequencies = np.concatenate([torque.frequency, load.frequency])
    fastest = float(frequencies.max()) if len(frequencies) else 2.0 * math.pi / period
    bend = float(torque.amplitude @ torque.frequency**2) + ratio * float(load.amplitude @ load.frequency**2)
    size = abs(torque.mean) + torque.swing() + ratio * (abs(load.mean) + load.swing())

    def margin(t: Floats) -> Floats:
        return ratio * np.maximum(load(t), 0.0) - np.abs(torque(t))

    width = 2.0 * math.pi / fastest / 32.0
    t = np.arange(0.0, period, width)
    best, when = math.inf, 0.0
    # A cell's value is a smooth function with |f''| <= bend, or a maximum or minus a maximum of two such.
    while len(t):
        ends = np.stack([margin(t), margin(t + width)])
        least = ends.min(axis=0)
        k = int(least.argmin())
        if least[k] < best:
            best, when = float(least[k]), float(t[k] if ends[0, k] <= ends[1, k] else t[k] + width)
        slack = _kink_slack(load, ratio, t, width) + bend * width**2 / 8.0
        keep = least - slack < best - 1e-13 * size
        width *= 0.5
        t = np.concatenate([t[keep], t[keep] + width])
        if width < 1e-12 * period / max(period * fastest, 1.0):
            break
    return StickMargin(best, when % period)


def _kink_slack(load: Sines, ratio: float, t: Floats, width: float) -> Floats:
    """Return how far the margin can lie below both ends of a cell because of the clamp; |Tfi| causes no such kink."""
    # max(Ts, 0) never lies below the smooth Ts, and where it leaves it, it is 0 on one side: a chord bound by its
    # slope.
    if len(load.frequency) == 0 or load.mean - load.swing() >= 0.0:
        return np.zeros_like(t)
    steepest = ratio * float(load.amplitude @ load.frequency)
    near = np.abs(load(t + 0.5 * width)) <= 0.5 * steepest / ratio * width
    return np.where(near, 0.5 * steepest * width, 0.0)


@dataclass(frozen=True)
class StickLimits:
    """Transition frequencies between pure stick and stick-slip, rad/s.

    lower : end of pure stick in an upward sweep; None without stick at the low end, or without a limit
    higher : end of pure stick in a downward sweep; None without stick at the high end, or without a limit
    """

    lower: float | None
    higher: float | None


def stick_limits(system: System, low: float, high: float, count: int = 400) -> StickLimits:
    """Return the frequency limits of pure stick between `low` and `high` (rad/s), for upward and downward sweeps.

    omega_f keeps its ratio to omega. `count` frequencies, evenly spaced in log omega, bracket the limits; omega_sn is
    among them, so no limit near the stuck resonance is missed.
    """
    if not 0.0 < low < high:
        raise InputError(f"the frequency range is {low:g} to {high:g} rad/s; it must be above 0 and increasing")

    def margin(omega: float) -> float:
        try:
            return stick_margin(replace(system, {"engine.frequency": omega})).torque
        except InputError:
            return -math.inf

    orders = [1.0, *range(2, len(system.engine.harmonic_amplitudes) + 2)]
    special = [system.stuck_natural_frequency / n for n in orders]
    grid = np.unique(np.concatenate([np.geomspace(low, high, count), [w for w in special if low < w < high]]))
    sticks = [margin(float(w)) >= 0.0 for w in grid]
    edges = [_bisect(margin, float(grid[i]), float(grid[i + 1])) for i in range(len(grid) - 1)
             if sticks[i] != sticks[i + 1]]
    return StickLimits(edges[0] if sticks[0] and edges else None, edges[-1] if sticks[-1] and edges else None)


def _bisect(margin: Callable[[float], float], a: float, b: float) -> float:
    """Return the frequency in [a, b] where the margin changes sign."""
    first = margin(a) >= 0.0
    for _ in range(60):
        middle = 0.5 * (a + b)
        if (margin(middle) >= 0.0) == first:
            a = middle
        else:
            b = middle
    return 0.5 * (a + b)


def constant_load_limits(system: System) -> tuple[float, ...]:
    """The frequencies, rad/s, at which max |Tfi| = mu_s N R for a constant load and one engine harmonic, in closed
    form.

    They solve |Tm| + Tp G(omega) = mu_s N R with the gain G of (25a), a quadratic in omega^2. With two of them the
    lower one is the limit of the upward sweep, the higher one of the downward sweep; with one there is no stick at low
    frequency.

    Raises
    ------
    InputError
        A pressure that varies, no first harmonic, or harmonics above the first.
    """
    d, torque = system.driveline, engine_series(system)
    if len(load_series(system).frequency) or len(torque.frequency) != 1:
        raise InputError("the closed-form stick limits need pressure.amplitude 0 and exactly one engine harmonic")
    gain = (system.friction_ratio * system.saturation_mean - abs(torque.mean)) / float(torque.amplitude[0])
    if gain <= 0.0:
        return ()
    both, c, k, g = d.flywheel_inertia + d.plate_inertia, d.damping**2, d.stiffness, gain**2
    linear = c * (1.0 - g) - 2.0 * k * (d.plate_inertia - g * both)
    found = np.roots([d.plate_inertia**2 - g * both**2, linear, k * k * (1.0 - g)])
    return tuple(sorted(math.sqrt(x.real) for x in found if abs(x.imag) <= 1e-12 * abs(x) and x.real > 0.0))
