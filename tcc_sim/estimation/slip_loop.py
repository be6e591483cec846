"""Closed loop of the package's slip controller about a settled motion: its multipliers and margins.

The controller (`plant.slip_control`) answers every tick: a PI law on the mean slip speed over an engine cycle, whose
pressure is held through the next tick. With whole ticks in an engine cycle, the nearest number to the controller's, the
loop is a linear map of the plant's state, the slip speeds of the last cycle and the integral part, periodic with the
motion. The product of its maps over the motion's period determines stability exactly. Gain margin and largest delay
follow from it, by raising the gains and by delaying commands. The phase margin is that of the open loop's frequency
response, with the harmonic transfer function as the plant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from tcc_sim.analysis.steady.exponents import largest_first
from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation.operating_point import Constant, Periodic, closed, matrices_of, operating_point, refined
from tcc_sim.model.parameters import System
from tcc_sim.result import Described, reported
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.trajectory import Floats

Complex = NDArray[np.complex128]
MOST_LATE = 512
"""Longest tested delay of commands, ticks."""
HIGHEST = 1000.0
"""Largest tested factor of the gains."""
LOWEST, SLOWER, WITHIN = 0.1, 0.93, 1e-3
"""Least tested slip speed, relative to the motion's; factor from one to the next; relative error of the result."""


@dataclass(frozen=True, repr=False)
class SlipLoop(Described):
    """Stability and margins of a closed loop with the slip controller."""

    proportional: float = field(metadata=reported("proportional gain", "N m s/rad"))
    integral: float = field(metadata=reported("integral gain", "N m/rad"))
    step: float = field(metadata=reported("time between two commands: a whole part of the period of excitation", "s"))
    stable: bool = field(metadata=reported("whether every multiplier is inside the unit circle"))
    multipliers: Complex = field(metadata=reported(
        "those of the closed loop above 1e-6, [re, im], largest first"))
    gain_margin: float | None = field(metadata=reported(
        "factor on both gains that makes the loop unstable; null if unstable already, or stable up to 1000"))
    phase_margin: float | None = field(metadata=reported(
        "least distance of the open loop's phase from -180 degrees at gain 1; null without one",
        "rad"))
    largest_delay: float | None = field(metadata=reported(
        "delay of commands from which on the loop is unstable; null if unstable already, or stable up to "
        "512 ticks", "s"))
    smallest_stable_slip: float | None = field(metadata=reported(
        "mean slip speed below which the loop becomes unstable; null if unstable already, 0 if stable down "
        "to a tenth of it", "rad/s"))


def slip_loop(motion: Constant | Periodic, gains: tuple[float, float], rate: float,
              response: Callable[[Floats], Complex], progress: bool = False) -> SlipLoop:
    """Judge the closed loop of a slip controller with these gains about a motion in slip.

    gains : proportional, N m per rad/s of the mean slip speed, and integral, N m per rad of its integral
    rate : ticks per second of the controller, Hz
    response : slip speed over actuation pressure at frequencies, rad/s
    progress : show the tried slip speeds on a terminal or in a notebook, elsewhere a line a minute

    Raises
    ------
    InputError
        Gains that are not numbers above 0, a motion in stick or with a slip speed below 0, or an engine cycle of less
        than 4 ticks or more than 2000.
    """
    for name, gain in zip(("proportional", "integral"), gains):
        if not 0.0 < gain < math.inf:
            raise InputError(f"the {name} gain of the controller is {gain:g}; it must be a number above 0")
    system = motion.system
    ticks = round(system.cycle * rate)
    if not 4 <= ticks <= 2000:
        raise InputError(f"a period of excitation holds {system.cycle * rate:.4g} ticks at {rate:g} Hz; a controller "
                         "needs 4 "
                         "to 2000")
    if isinstance(motion, Constant) and math.isinf(motion.slope):
        raise InputError("the scene sticks, and no controller changes its slip speed; give --slip")
    if motion.mean_slip <= 0.0:
        raise InputError(f"the mean slip speed is {motion.mean_slip:g} rad/s; the slip controller holds one above 0")
    loop = _Loop.about(motion, ticks, gains)
    multipliers = largest_first(loop.multipliers())
    stable = bool(abs(multipliers[0]) < 1.0)
    return SlipLoop(*gains, loop.step, stable, multipliers[np.abs(multipliers) > 1e-6],
                    loop.gain_margin() if stable else None, loop.phase_margin(response),
                    loop.largest_delay() if stable else None,
                    _smallest_slip(motion, ticks, gains, progress) if stable else None)


@dataclass(frozen=True)
class _Loop:
    """The closed loop, tick by tick.

    maps : for every tick of the motion's period, the plant's (3, 3) derivative by its state and (3,) by the pressure,
        Pa
    ticks : number in an engine cycle
    """

    system: System
    maps: list[tuple[Floats, Floats]]
    ticks: int
    gains: tuple[float, float]

    @staticmethod
    def about(motion: Constant | Periodic, ticks: int, gains: tuple[float, float]) -> _Loop:
        """Return the loop about a motion."""
        if isinstance(motion, Periodic):
            maps = [(segment.by_state, segment.by_input[:, 0]) for segment in refined(motion, ticks).segments]
        else:
            a, b, *_ = matrices_of(motion, True)
            held = expm(np.block([[a, b], [np.zeros((1, 4))]]) * motion.system.cycle / ticks)
            maps = [(held[:3, :3], held[:3, 3])] * ticks
        return _Loop(motion.system, maps, ticks, gains)

    @property
    def step(self) -> float:
        """Length of a tick, s."""
        return self.system.cycle / self.ticks

    def multipliers(self, factor: float = 1.0, late: int = 0) -> Complex:
        """Return the eigenvalues of the loop's map over the motion's period, with raised gains and late commands.

        State: the plant's, the integral part, the slip speeds of the cycle but the newest, the commands on their way
        and, for an actuator with a lag, the pressure at the plates, whose mean over a tick acts in it.
        """
        past, lag = self.ticks - 1, self.system.pressure.time_constant
        late += round(self.system.pressure.delay / self.step)
        whole = np.eye(4 + past + late + (lag > 0.0))
        x, integral, slips, waiting = whole[:3], whole[3], whole[4:4 + past], whole[4 + past:4 + past + late]
        plates = whole[4 + past + late:]
        left = math.exp(-self.step / lag) if lag else 0.0
        share = lag / self.step * (1.0 - left)
        proportional, rate = factor * self.gains[0], factor * self.gains[1] * self.step
        for by_state, by_pressure in self.maps:
            mean = (x[0] + slips.sum(0)) / self.ticks
            waiting = np.vstack([waiting, (proportional * mean + integral) / self.system.torque_per_pressure])
            integral, slips = integral + rate * mean, np.vstack([slips[1:], x[0]])
            command, waiting = waiting[0], waiting[1:]
            acting = command + share * (plates[0] - command) if lag else command
            plates = command + left * (plates - command)
            x = by_state @ x + np.outer(by_pressure, acting)
        return np.asarray(np.linalg.eigvals(np.vstack([x, integral, slips, waiting, plates])), np.complex128)

    def stable(self, factor: float = 1.0, late: int = 0) -> bool:
        """Return whether every multiplier is inside the unit circle."""
        return self.growth(factor, late) < 0.0

    def growth(self, factor: float = 1.0, late: int = 0) -> float:
        """Return the logarithm of the largest multiplier's modulus."""
        return math.log(max(float(np.abs(self.multipliers(factor, late)).max()), 1e-300))

    def gain_margin(self) -> float | None:
        """Return the least factor of both gains that makes a stable loop unstable."""
        low = 1.0
        for high in np.geomspace(1.0, HIGHEST, 61)[1:].tolist():
            if not self.stable(high):
                while high - low > 1e-4 * low:
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if self.stable(middle) else (low, middle)
                return float(high)
            low = high
        return None

    def largest_delay(self) -> float | None:
        """Return the least delay in whole ticks that makes a stable loop unstable, s."""
        low, high = 0, 1
        while self.stable(late=high):
            low, high = high, 2 * high
            if high > MOST_LATE:
                return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.stable(late=middle) else (low, middle)
        return high * self.step

    def phase_margin(self, response: Callable[[Floats], Complex]) -> float | None:
        """Return the least distance of the open loop's phase from -180 degrees at gain 1, rad."""
        top = min(3.0 * self.system.natural_frequency, 0.9 * math.pi / self.step)
        omegas = np.unique(np.concatenate([np.geomspace(0.2, top, 400), np.linspace(0.2, top, 800)]))
        s = 1j * omegas
        late = np.exp(-s * self.step)
        mean = (1.0 - late**self.ticks) / (1.0 - late) / self.ticks
        held = (1.0 - late) / (s * self.step)
        law = self.gains[0] + self.gains[1] * self.step * late / (1.0 - late)
        loop = -response(omegas) * mean * held * law / self.system.torque_per_pressure
        with np.errstate(divide="ignore"):  # The mean over a cycle has zeros.
            gain, phase = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
        crossed = np.flatnonzero(gain[:-1] * gain[1:] <= 0.0)
        part = gain[crossed] / (gain[crossed] - gain[crossed + 1])
        at = phase[crossed] + part * (phase[crossed + 1] - phase[crossed])
        margins = np.mod(at + 2.0 * math.pi, 2.0 * math.pi) - math.pi
        return float(margins[np.abs(margins).argmin()]) if len(margins) else None


def _smallest_slip(motion: Constant | Periodic, ticks: int, gains: tuple[float, float], progress: bool) -> float:
    """Return the mean slip speed down to which a loop remains stable, rad/s; 0 if it does down to LOWEST.

    It is the root of the logarithm of the largest multiplier, between the first two tried slip speeds of which one is
    unstable. They are powers of SLOWER, so that the result does not depend on the motion that the search begins with.
    """
    near, known = motion, {motion.mean_slip: _Loop.about(motion, ticks, gains).growth()}

    with progress_bar("slip speed", shown=progress, leave=False) as bar:
        def growth(slip: float) -> float:
            nonlocal near
            if slip not in known:
                bar.update()
                try:
                    point = _with_slip(near, slip)
                    known[slip] = _Loop.about(point, ticks, gains).growth()
                    near = point if known[slip] < 0.0 else near
                except (OutOfRange, NumericalFailure):   # No motion of this slip speed repeats.
                    known[slip] = 1.0
            return known[slip]

        high = motion.mean_slip
        power = math.floor(math.log(high) / math.log(SLOWER)) + 1
        while (low := SLOWER**power) >= LOWEST * motion.mean_slip:
            if growth(low) >= 0.0:
                return float(brentq(growth, low, high, xtol=0.5 * WITHIN * low, rtol=0.5 * WITHIN))
            high, power = low, power + 1
        return 0.0


def _with_slip(motion: Constant | Periodic, slip: float) -> Constant | Periodic:
    """Return the motion of another mean slip speed, near this one if there is one."""
    if isinstance(motion, Periodic):
        try:
            return closed(motion.system, motion.period, motion.segments[0].state, slip)
        except NumericalFailure:
            pass
    return operating_point(motion.system, slip)
