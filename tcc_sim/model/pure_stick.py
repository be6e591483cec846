"""Pure stick in closed form: (8) to (11), (24) to (28) of the paper, for any number of engine harmonics.

Stuck, the inertias move as one oscillator I1 + I2 that the engine torque drives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.friction import onset
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.sines import Floats, Sines, common_cycles, dynamic_stiffness, engine_series, load_series, smallest
from tcc_sim.model.supported_terms import check_supported

STUCK = "engine.frequency excites the undamped stuck"


def stick_phase(system: System, omega: float) -> float:
    """Return phi of (8b), rad: the phase of the plate angle relative to the engine torque.

    The print takes the arctangent of the quotient, which is off by pi above omega_sn; this is the four-quadrant one.
    """
    d = system.driveline
    return -math.atan2(d.damping * omega, d.stiffness - (d.flywheel_inertia + d.plate_inertia) * omega**2)


def plate_angle(system: System) -> Sines:
    """Return delta2(t) of (8) in pure stick, rad: the steady motion, from each harmonic of the engine torque.

    Raises
    ------
    InputError
        The engine excites an undamped driveline at exactly omega_sn.
    """
    torque = engine_series(system)
    check_supported("pure stick", system, "pure stick in closed form")
    d = system.driveline
    both = d.flywheel_inertia + d.plate_inertia
    return torque.through(lambda omega: 1.0 / dynamic_stiffness(d, both, omega, STUCK))


def interface_response(system: System, omega: float) -> complex:
    """Return the response of the interface torque to the engine torque in pure stick, from (25a).

    Its phase is phi of (8b) plus vartheta of (25b), the lead on the plate angle. (26) neglects vartheta, which holds
    for C23 omega << K23 - I2 omega^2.
    """
    d = system.driveline
    plate = complex(d.stiffness - d.plate_inertia * omega**2, d.damping * omega)
    return plate / dynamic_stiffness(d, d.flywheel_inertia + d.plate_inertia, omega, STUCK)


def stuck_interface_torque(system: System) -> Sines:
    """Return Tfi(t) of (25a) in pure stick, N m: the friction torque that stick needs.

    (9) is the same with the amplitude I1 omega^2 Tp/sqrt((K23 - (I1 + I2) omega^2)^2 + (C23 omega)^2) in its last term,
    where the print omits the inertia and the damping.
    """
    torque = engine_series(system)
    check_supported("pure stick", system, "pure stick in closed form")
    return torque.through(partial(interface_response, system))


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
    occurs. Branch and bound on the second derivative misses no dip between grid points.
    """
    torque, load = stuck_interface_torque(system), load_series(system)
    ratio = system.friction_ratio
    cycles = common_cycles(system)
    if len(torque.frequency) == 0 or cycles == 0:
        least = max(load.mean - load.swing(), 0.0)
        if len(torque.frequency) == 0:
            return StickMargin(ratio * least - abs(torque.mean), math.nan if len(load.frequency) else 0.0)
        return StickMargin(_smallest(torque, Sines.of(least, []), ratio, system.cycle).torque, math.nan)
    return _smallest(torque, load, ratio, cycles * system.cycle)


def _smallest(torque: Sines, load: Sines, ratio: float, period: float) -> StickMargin:
    """Minimise ratio max(Ts, 0) - |Tfi| over one period."""
    fastest = float(np.concatenate([torque.frequency, load.frequency]).max())
    bend = torque.bend() + ratio * load.bend()
    size = abs(torque.mean) + torque.swing() + ratio * (abs(load.mean) + load.swing())
    steepest = float(load.amplitude @ load.frequency) if load.mean < load.swing() else 0.0

    def slack(t: Floats, width: float) -> Floats:
        # Apart from the clamp, the margin is a smooth function with |f''| <= bend, or the smaller one of two such.
        # max(Ts, 0) is not below Ts, and where it leaves it, it is 0 on one side: a chord bounded by the slope.
        near = np.abs(load(t + 0.5 * width)) <= 0.5 * steepest * width
        return np.where(near, 0.5 * ratio * steepest * width, 0.0) + bend * width**2 / 8.0

    best, when = smallest(lambda t: ratio * np.maximum(load(t), 0.0) - np.abs(torque(t)), slack, period,
                          2.0 * math.pi / fastest / 32.0, 1e-13 * size)
    return StickMargin(best, when % period)


class StickLimits(NamedTuple):
    """Ends of pure stick in an upward and a downward sweep, rad/s; None without a limit or without stick to begin with.
    """

    lower: float | None
    higher: float | None


def stick_limits(system: System, low: float, high: float, count: int = 400) -> StickLimits:
    """Return the frequency limits of pure stick between `low` and `high` (rad/s).

    omega_f keeps its ratio to omega. `count` frequencies, evenly spaced in log omega, bracket the limits; omega_sn is
    among them, so no limit near the stuck resonance is missed.
    """
    if not 0.0 < low < high:
        raise InputError(f"the frequency range is {low:g} to {high:g} rad/s; it must be above 0 and increasing")

    def margin(omega: float) -> float:
        try:
            return stick_margin(replace(system, {"engine.frequency": omega})).torque
        except OutOfRange:
            return -math.inf

    orders = [1.0, *range(2, len(system.engine.harmonic_amplitudes) + 2)]
    special = [system.stuck_natural_frequency / n for n in orders]
    grid = np.unique(np.concatenate([np.geomspace(low, high, count), [w for w in special if low < w < high]]))
    sticks = [margin(float(w)) >= 0.0 for w in grid]
    edges = [onset(float(grid[i + 1]), lambda w, i=i: (margin(w) >= 0.0) != sticks[i], float(grid[i]))
             for i in range(len(grid) - 1) if sticks[i] != sticks[i + 1]]
    return StickLimits(edges[0] if sticks[0] and edges else None, edges[-1] if sticks[-1] and edges else None)


def constant_load_limits(system: System) -> tuple[float, ...]:
    """Return the frequencies, rad/s, at which max |Tfi| = mu_s N R for a constant load and one harmonic, from (25a).

    They solve |Tm| + Tp G(omega) = mu_s N R with the gain G of (25a), a quadratic in omega^2. With two of them the
    lower one is the limit of the upward sweep, the higher one of the downward sweep; with one there is no stick at low
    frequency.

    Raises
    ------
    InputError
        The pressure varies, or the engine torque has not exactly one harmonic.
    """
    d, torque = system.driveline, engine_series(system)
    if len(load_series(system).frequency) or len(torque.frequency) != 1:
        raise InputError("the closed-form stick limits need pressure.amplitude 0 and exactly one engine harmonic")
    gain = (system.friction_ratio * system.saturation_mean - abs(torque.mean)) / float(torque.amplitude[0])
    if gain <= 0.0:
        return ()
    both, c, k, g = d.flywheel_inertia + d.plate_inertia, d.damping**2, d.stiffness, gain**2
    linear = c * (1.0 - g) - 2.0 * k * (d.plate_inertia - g * both)
    squares = np.roots([d.plate_inertia**2 - g * both**2, linear, k * k * (1.0 - g)])
    return tuple(sorted(math.sqrt(x.real) for x in squares if abs(x.imag) <= 1e-12 * abs(x) and x.real > 0.0))
