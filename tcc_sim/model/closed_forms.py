"""Motions in closed form, each a constant plus sines, for pulsating load and any number of engine harmonics.

Pure slip for mu_k = mu_s is (12) to (18), (29) of the paper; pure stick is (8) to (11), (24) to (28): stuck, both
inertias move as one oscillator I1 + I2 that the engine torque drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.equations import check_supported, linear_of, matrix_of
from tcc_sim.model.friction import onset
from tcc_sim.model.groups import Driveline
from tcc_sim.model.parameters import System, replace

Floats = NDArray[np.float64]
Response = Callable[[float], complex]


@dataclass(frozen=True)
class Sines:
    """mean + sum_k amplitude_k sin(frequency_k t + phase_k); the three arrays are (m,), frequencies in rad/s."""

    mean: float
    frequency: Floats
    amplitude: Floats
    phase: Floats

    @staticmethod
    def of(mean: float, rows: list[tuple[float, float, float]]) -> Sines:
        """Return the sum of a mean and rows of frequency, amplitude and phase; rows of equal frequency are added."""
        merged: dict[float, complex] = {}
        for frequency, amplitude, phase in rows:
            merged[frequency] = merged.get(frequency, 0j) + amplitude * np.exp(1j * phase)
        phasors = np.array(list(merged.values()), dtype=np.complex128)
        return Sines(mean, np.array(list(merged), dtype=np.float64), np.abs(phasors), np.angle(phasors))

    def __call__(self, t: Any) -> Floats:
        """Return the value at the times t, (n,) array or float."""
        angle = np.multiply.outer(np.asarray(t, dtype=np.float64), self.frequency) + self.phase
        return self.mean + np.sin(angle) @ self.amplitude

    def through(self, response: Response) -> Sines:
        """Return the steady output of a linear system with the frequency response `response`(w)."""
        factors = np.array([response(float(w)) for w in self.frequency], dtype=np.complex128)
        return Sines(self.mean * float(response(0.0).real), self.frequency, self.amplitude * np.abs(factors),
                     self.phase + np.angle(factors))

    def plus(self, other: Sines, factor: float = 1.0) -> Sines:
        """Return the sum of this and `factor` times `other`."""
        rows = [(float(w), float(a) * s, float(p)) for part, s in ((self, 1.0), (other, factor))
                for w, a, p in zip(part.frequency, part.amplitude, part.phase)]
        return Sines.of(self.mean + factor * other.mean, rows)

    def rate(self) -> Sines:
        """Return the derivative with respect to time."""
        return Sines(0.0, self.frequency, self.amplitude * self.frequency, self.phase + 0.5 * np.pi)

    def swing(self) -> float:
        """Return the sum of the amplitudes, a bound of the distance from the mean."""
        return float(self.amplitude.sum())

    def bend(self) -> float:
        """Return the sum of the amplitudes times squares of frequencies, a bound of the second derivative."""
        return float(self.amplitude @ self.frequency**2)


def smallest(value: Callable[[Floats], Floats], slack: Callable[[Floats, float], Any], end: float, width: float,
             close: float) -> tuple[float, float]:
    """Return the smallest value of a function over [0, end] and its time, by branch and bound on cells of time.

    slack : largest distance of the function below both ends of cells with given starts (n,) and width
    close : tolerance of the smallest value
    """
    t, best, when = np.arange(0.0, max(end, width), width), math.inf, 0.0
    for _ in range(60):
        ends = np.stack([value(t), value(t + width)])
        least = ends.min(axis=0)
        k = int(least.argmin())
        if least[k] < best:
            best, when = float(least[k]), float(t[k] if ends[0, k] <= ends[1, k] else t[k] + width)
        keep = least - slack(t, width) < best - close
        if not keep.any():
            break
        width *= 0.5
        t = np.concatenate([t[keep], t[keep] + width])
    return best, when


def dynamic_stiffness(d: Driveline, inertia: float, omega: float, resonance: str) -> complex:
    """K23 - J w^2 + i C23 w of an inertia J on the spring, N m/rad; OutOfRange with `resonance` if it is 0."""
    stiffness = complex(d.stiffness - inertia * omega**2, d.damping * omega)
    if stiffness == 0.0:
        raise OutOfRange(f"{resonance} resonance, {omega:g} rad/s: no steady state")
    return stiffness


def engine_series(system: System) -> Sines:
    """Return Te(t), N m: the mean and the harmonics of omega, Section 2.2 of the paper.

    Raises InputError: the excitation has a profile in time.
    """
    system.check_repeats("a closed form")
    e = system.engine
    harmonics = zip((e.torque_amplitude, *e.harmonic_amplitudes), (0.0, *e.harmonic_phases))
    return Sines.of(e.mean_torque, [(n * e.frequency, a, p) for n, (a, p) in enumerate(harmonics, 1)
                                    if e.harmonic and a > 0.0])


def load_series(system: System) -> Sines:
    """Return Ts(t) of (5b), N m, before the clamp at 0; InputError for a profile in time."""
    system.check_repeats("a closed form")
    frequency = system.pressure.frequency_ratio * system.engine.frequency
    amplitude = system.saturation_amplitude
    return Sines.of(system.saturation_mean, [(frequency, amplitude, system.pressure.phase)] if amplitude > 0.0 else [])


def common_cycles(system: System, most: int = 1000) -> int:
    """Return the period of the excitation in engine cycles: N of omega_f = (M/N) omega in lowest terms.

    It is 1 for a constant pressure, and 0 if N exceeds `most`.
    """
    if len(load_series(system).frequency) == 0:
        return 1
    ratio = system.pressure.frequency_ratio
    nearest = Fraction(ratio).limit_denominator(most)
    return nearest.denominator if abs(float(nearest) - ratio) <= 1e-12 * ratio else 0


class LeastSlip(NamedTuple):
    """Smallest slip speed of a motion.

    value : rad/s, in the direction of the slip; -inf where slip ends because friction outweighs the torque
    exact : whether the motion comes as near to the value as one likes; if not, it is a lower bound
    lasts : whether the slip never ends; None where the bound does not decide
    """

    value: float
    exact: bool
    lasts: bool | None


class Modes(NamedTuple):
    """Modes of x' = A x, x = (v, theta2, theta2'): x is the real part of shares @ exp(rates t).

    rates, shares : (3,) 1/s, and (3, 3)
    matrix : A, (3, 3)
    plate_share : I2/I1
    """

    rates: NDArray[np.complex128]
    shares: NDArray[np.complex128]
    matrix: Floats
    plate_share: float


@dataclass(frozen=True)
class PureSlip:
    """Solution (14) of (12): v = a0 + a1 t + sines + transient, and the motion of the plate.

    direction : sign of the slip, +1 or -1
    a0 : rad/s; a1 = (Tm - Tsm)/I1 : rad/s^2 (with the opposite sign of Tsm for negative slip); 0 in a steady state
    slip : the sines a21, a22 of (14), with their phases; their mean is a0. They are v(t) of (15), rad/s, without the
        transient (and without a1 t, which has no steady state)
    plate : steady plate angle, rad
    decay, stiffness : zeta omega_n (1/s) and omega_n^2 (1/s^2) of the plate on its spring, (17c-e)
    angle_offset, speed_offset : differences of plate angle (rad) and speed (rad/s) from the steady ones at t = 0
    period : common period of the sines, s; 0 if omega_f/omega is not a ratio of small whole numbers
    modes : of the transient, with a torque by slip speed beside friction
    """

    direction: int
    a0: float
    a1: float
    slip: Sines
    plate: Sines
    decay: float
    stiffness: float
    angle_offset: float
    speed_offset: float
    period: float
    modes: Modes | None = None

    @property
    def least_slip_speed(self) -> float:
        """Value of `least_slip`, rad/s: if it is positive, the motion is pure slip."""
        return self.least_slip.value

    def slip_speed(self, t: Any) -> Floats:
        """Return v(t) of (14), rad/s, at the times t (n,)."""
        return self.slip(t) + self.a1 * np.asarray(t) + self._transient(t)[0]

    def plate_angle(self, t: Any) -> Floats:
        """Return theta2(t), rad."""
        return self.plate(t) + self._transient(t)[1]

    def plate_speed(self, t: Any) -> Floats:
        """Return theta2'(t), rad/s."""
        return self.plate.rate()(t) + self._transient(t)[2]

    @property
    def margin(self) -> float:
        """direction a0 - |a21| - |a22| of (16), rad/s; if it is positive, the steady slip never reaches 0.

        The print has |a0|, which admits an a0 of the wrong sign, where friction would drive the slip. Sines of equal
        frequency (omega_f = omega) are added as phasors first, which makes the criterion exact for them.
        """
        return self.direction * self.a0 - self.slip.swing()

    @cached_property
    def least_slip(self) -> LeastSlip:
        """The smallest direction v(t) over all t >= 0.

        (16) omits the transient, which can stop the slip whatever the steady margin is. Branch and bound on the second
        derivative finds the minimum until the oscillation of the transient has faded, and over one period of the sines
        more. From then on v is at least the steady minimum plus the slow part less what is left of the oscillation,
        whose energy never grows. With a common period of the sines that decides, unless the damping is too light to
        follow the oscillation to its end.
        """
        if self.direction * self.a1 < 0.0:
            return LeastSlip(-math.inf, True, False)
        slow, slow_rate, slowest = self._slow_part()
        root = math.sqrt(self.stiffness)
        rates = [root, *self.slip.frequency.tolist(), *(abs(self.modes[0]).tolist() if self.modes is not None else [])]
        fastest, (rest, bend) = max(rates), self._bounds(0.0)
        size = abs(self.a0) + self.slip.swing() + rest + abs(slow)
        close, followed = 1e-13 * size, 0.0
        if rest > close:
            followed = min(FADED / slowest if slowest > 0.0 else math.inf, LONGEST_PHASE / fastest)

        def least_of(value: Callable[[Floats], Floats], end: float, bend: float) -> float:
            return smallest(lambda t: self.direction * value(t), lambda t, width: bend * width**2 / 8.0, end,
                            0.1 / fastest, close)[0]

        lowest = least_of(self.slip_speed, followed + self.period, self.slip.bend() + bend + abs(slow) * slow_rate**2)
        steady = least_of(self.slip, self.period, self.slip.bend()) if self.period else self.margin
        rest, rising = self._bounds(followed)[0], self.direction * slow < 0.0 or self.a1 != 0.0
        attained = lowest
        if self.a1 == 0.0 and (slowest > 0.0 or rest <= close):
            # The steady motion is approached; without a common period its harmonics need not meet at their lowest.
            attained = min(lowest, steady if self.period or len(self.slip.frequency) < 3 else self.direction * self.a0)
        later = steady - rest + self.direction * self.a1 * followed + min(
            self.direction * slow * math.exp(-slow_rate * followed), 0.0)
        if later >= attained - 10.0 * close or (rising and rest <= close and self.period):
            return LeastSlip(attained, True, attained > 0.0)
        return LeastSlip(later, False, True if later > 0.0 else False if attained <= 0.0 else None)

    def _slow_part(self) -> tuple[float, float, float]:
        """Return share, rad/s, and decay, 1/s, of the real exponential that is split off, and the slowest decay of the
        rest of the transient, 1/s.
        """
        if self.modes is None:
            square = self.decay * self.decay - self.stiffness
            return 0.0, 0.0, self.decay if square <= 0.0 else self.stiffness / (self.decay + math.sqrt(square))
        k = self._slow_mode()
        decays = -self.modes[0].real
        if k is None:
            return 0.0, 0.0, float(decays.min())
        return float(self.modes[1][0, k].real), float(decays[k]), float(np.delete(decays, k).min())

    def _slow_mode(self) -> int | None:
        """Return the number of the one real mode, or of the slowest of three that is by far the slowest."""
        rates = self.modes[0]  # type: ignore[index]
        real = [k for k in np.argsort(np.abs(rates)).tolist() if rates[k].imag == 0.0]
        if len(real) == 1 or (len(real) == 3 and abs(rates[real[0]]) < 0.5 * abs(rates[real[1]])):
            return int(real[0])
        return None

    def _bounds(self, t: float) -> tuple[float, float]:
        """Return bounds of the transient of the slip speed, without the slow part, and of its second derivative, from
        the time t on.

        The energy I1 (v + w)^2 + I2 w^2 + K23 x^2 of a free motion never grows, nor does it with v = -w.
        """
        if self.modes is None:
            _, x, w = self._transient(t)
            energy = math.hypot(float(w), math.sqrt(self.stiffness) * float(x))
            return energy, energy * math.hypot(4.0 * self.decay**2 - self.stiffness,
                                               2.0 * self.decay * math.sqrt(self.stiffness))
        rates, shares, matrix, plate_share = self.modes
        k, fade = self._slow_mode(), np.exp(rates * t)
        if k is not None:
            fade[k] = 0.0
        v, x, w = (shares @ fade).real
        energy = math.sqrt((v + w) ** 2 / plate_share + w * w + self.stiffness * x * x)
        by_energy = np.linalg.inv(np.array([[plate_share**-0.5, 0.0, plate_share**-0.5],
                                            [0.0, math.sqrt(self.stiffness), 0.0], [0.0, 0.0, 1.0]]))
        return (energy * float(np.linalg.norm(by_energy[0])),
                energy * float(np.linalg.norm((matrix @ matrix @ by_energy)[0])))

    def _transient(self, t: Any) -> tuple[Floats, Floats, Floats]:
        """Return the decaying parts of slip speed, plate angle and plate speed, for light, critical and heavy damping.
        """
        at = np.asarray(t, dtype=np.float64)
        if self.modes is not None:
            rates, shares = self.modes[:2]
            v, x, w = (np.exp(np.multiply.outer(at, rates)) @ row for row in shares)
            return v.real, x.real, w.real
        cosine, sine = damped_pair(at, self.decay, self.stiffness)
        x, w = self.angle_offset, self.speed_offset
        angle: Floats = x * (cosine + self.decay * sine) + w * sine
        speed: Floats = w * (cosine - self.decay * sine) - self.stiffness * x * sine
        return -speed, angle, speed


PLATE = "pressure.frequency_ratio excites the undamped plate"
LONGEST_PHASE = 2e4
"""Phase of the fastest oscillation, rad, over which a transient is followed."""
FADED = 36.0
"""Natural logarithm of the decay after which a transient is neglected."""


def damped_pair(t: Floats, decay: float, stiffness: float) -> tuple[Floats, Floats]:
    """Return exp(-decay t) times cos(wd t) and sin(wd t)/wd, for wd^2 = stiffness - decay^2 of either sign, t >= 0."""
    square = stiffness - decay * decay
    if abs(square) <= 1e-14 * stiffness:
        fade = np.exp(-decay * t)
        return fade, fade * t
    if square > 0.0:
        wd, fade = math.sqrt(square), np.exp(-decay * t)
        return fade * np.cos(wd * t), fade * np.sin(wd * t) / wd
    root = math.sqrt(-square)
    slow, fast = np.exp(-stiffness / (decay + root) * t), np.exp(-(decay + root) * t)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / root


def pure_slip(system: System, direction: int = 1) -> PureSlip:
    """Solve (12) from the system's initial state, slipping in `direction` (+1, or -1: flywheel slower) for all time.

    With (13) and a constant load Tsm = Tm this is v = Omega_e + Tp/(I1 omega) (1 - cos(omega t)) - Tsm/(I2 omega_d)
    exp(-zeta omega_n t) sin(omega_d t). The print of (17a), (18) has velocity terms Tsm 2 zeta/(K23 omega_n), whose
    dimension is an angle times time; they do not belong there.

    Raises InputError: mu_k differs from mu_s (the law is then nonlinear in slip), the pressure falls below 0, or the
    pressure excites exactly the resonance of an undamped driveline.
    """
    if system.friction.curve is not None and system.friction.stribeck is not None:
        raise InputError("the coefficient of the friction table depends on slip speed; pure slip in closed form needs "
                         "one that does not")
    if system.friction_ratio != 1.0:
        raise InputError(f"friction.kinetic_coefficient is {system.friction.kinetic_coefficient:g}; pure slip in "
                         "closed form needs it equal to friction.static_coefficient, "
                         f"{system.friction.static_coefficient:g}")
    torque, load = engine_series(system), load_series(system)
    if load.swing() > load.mean:
        raise InputError("pressure.amplitude is above pressure.mean; pure slip in closed form needs a pressure above 0")
    check_supported("pure slip", system, "pure slip in closed form")
    d, start, sign = system.driveline, system.initial, float(np.sign(direction))
    if linear_of(system).flywheel_by_slip is not None:
        return _coupled(system, sign, torque, load)

    plate = load.through(lambda omega: sign / dynamic_stiffness(d, d.plate_inertia, omega, PLATE))
    net = torque.plus(load, -sign)
    flywheel = [(float(w), float(a) / (d.flywheel_inertia * float(w)), float(p) - 0.5 * math.pi)
                for w, a, p in zip(net.frequency, net.amplitude, net.phase)]
    swing = Sines.of(0.0, flywheel)
    a0 = start.slip_speed + start.plate_speed - float(swing(0.0))
    slip = Sines.of(a0, flywheel).plus(plate.rate(), -1.0)
    drive = net.mean if abs(net.mean) > 1e-14 * (abs(torque.mean) + load.mean) else 0.0
    return PureSlip(direction=int(sign), a0=a0, a1=drive / d.flywheel_inertia, slip=slip, plate=plate,
                    decay=d.damping / (2.0 * d.plate_inertia), stiffness=d.stiffness / d.plate_inertia,
                    angle_offset=start.plate_angle - float(plate(0.0)),
                    speed_offset=start.plate_speed - float(plate.rate()(0.0)),
                    period=common_cycles(system) * system.cycle)


def _coupled(system: System, sign: float, torque: Sines, load: Sines) -> PureSlip:
    """Solve x' = A x + g_e Te + g_f Ts of `model.equations` with a torque by slip speed beside friction.

    That torque makes A invertible, so that there is a steady mean slip speed, and no growth a1.
    """
    linear, start = linear_of(system), system.initial
    a = matrix_of(linear)
    by_engine = np.array([1.0 / linear.flywheel, 0.0, 0.0])
    by_friction = np.array([-1.0 / linear.flywheel - 1.0 / linear.plate, 0.0, 1.0 / linear.plate])

    def steady(row: int) -> Sines:
        def response(gain: Floats) -> Response:
            return lambda omega: complex(np.linalg.solve(1j * omega * np.eye(3) - a, gain)[row])

        return torque.through(response(by_engine)).plus(load.through(response(by_friction)), sign)

    slip, plate = steady(0), steady(1)
    off = np.array([start.slip_speed - float(slip(0.0)), start.plate_angle - float(plate(0.0)),
                    start.plate_speed - float(plate.rate()(0.0))])
    rates, vectors = (part.astype(np.complex128) for part in np.linalg.eig(a))
    return PureSlip(direction=int(sign), a0=slip.mean, a1=0.0, slip=slip, plate=plate,
                    decay=linear.damping / (2.0 * linear.plate), stiffness=linear.stiffness / linear.plate,
                    angle_offset=float(off[1]), speed_offset=float(off[2]),
                    period=common_cycles(system) * system.cycle,
                    modes=Modes(rates, vectors * np.linalg.solve(vectors, off.astype(np.complex128)), a,
                                linear.plate / linear.flywheel))


STUCK = "engine.frequency excites the undamped stuck"


def plate_angle(system: System) -> Sines:
    """Return delta2(t) of (8) in pure stick, rad: the steady motion, from each harmonic of the engine torque.

    Raises InputError: the engine excites an undamped driveline at exactly omega_sn.
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

    Raises InputError: the pressure varies, or the engine torque has not exactly one harmonic.
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
