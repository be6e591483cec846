"""Pure slip in closed form for mu_k = mu_s: (12) to (18), (29) of the paper, for pulsating load and harmonics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.equations import linear_of, matrix_of
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import (
    Floats,
    Response,
    Sines,
    common_cycles,
    dynamic_stiffness,
    engine_series,
    load_series,
    smallest,
)
from tcc_sim.model.supported_terms import check_supported


@dataclass(frozen=True)
class PureSlip:
    """Solution (14) of (12): v = a0 + a1 t + sines + transient, and the motion of the plate.

    direction : sign of the slip, +1 or -1
    a0 : rad/s; a1 = (Tm - Tsm)/I1 : rad/s^2 (with the opposite sign of Tsm for negative slip)
    slip : the sines a21, a22 of (14), with their phases; their mean is a0. They are v(t) of (15), rad/s, without the
        transient (and without a1 t, which has no steady state)
    plate : steady plate angle, rad
    decay, stiffness : zeta omega_n (1/s) and omega_n^2 (1/s^2) of the plate on its spring, (17c-e)
    angle_offset, speed_offset : differences of plate angle (rad) and speed (rad/s) from the steady ones at t = 0
    period : common period of the sines, s; 0 if omega_f/omega is not a ratio of small whole numbers
    modes : with a torque by slip speed beside friction, rates (3,) of the transient, 1/s, and its shares (3, 3) in slip
        speed, plate angle and plate speed; the transient is the real part of their products with exp(rate t)
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
    modes: tuple[NDArray[np.complex128], NDArray[np.complex128]] | None = None

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
    def steady(self) -> bool:
        """Whether a steady state exists: a1 = 0 (Tm = Tsm)."""
        return self.a1 == 0.0

    @property
    def margin(self) -> float:
        """direction a0 - |a21| - |a22| of (16), rad/s; if it is positive, the steady slip never reaches 0.

        The print has |a0|, which admits an a0 of the wrong sign, where friction would drive the slip. Sines of equal
        frequency (omega_f = omega) are added as phasors first, which makes the criterion exact for them.
        """
        return self.direction * self.a0 - self.slip.swing()

    @property
    def least_slip_speed(self) -> float:
        """Smallest direction v(t) over all t >= 0, rad/s; if it is positive, the motion is pure slip.

        (16) omits the transient, which can stop the slip whatever the steady margin is. The minimum is found by branch
        and bound on the second derivative. It is only a lower bound if the damping is too light to follow the transient
        to its end, or if omega and omega_f have no common period; -inf if a1 finally stops the slip.
        """
        if self.direction * self.a1 < 0.0:
            return -math.inf
        largest, curved, slowest, natural = self._bounds()
        bend = self.slip.bend() + curved
        fastest = max([natural, *self.slip.frequency.tolist()])
        fading = (FADED / slowest if slowest > 0.0 else math.inf) if largest > 0.0 else 0.0
        if fading * fastest > LONGEST_PHASE:
            return self.margin - largest
        end = fading + (self.period or 0.0)
        size = abs(self.a0) + self.slip.swing() + largest
        least, _ = smallest(lambda t: self.direction * self.slip_speed(t), lambda t, width: bend * width**2 / 8.0, end,
                            0.1 / fastest, 1e-13 * size)
        return least if self.period else min(least, self.margin)

    def _bounds(self) -> tuple[float, float, float, float]:
        """Return bounds of the transient of the slip speed and of its second derivative, its slowest decay, 1/s, and
        its fastest rate, 1/s.
        """
        if self.modes is not None:
            rates, shares = self.modes
            sizes = np.abs(shares[0])
            return (float(sizes.sum()), float(sizes @ np.abs(rates) ** 2), float(-rates.real.max()),
                    float(np.abs(rates).max()))
        # The energy of z'' + 2 decay z' + stiffness z = 0 never grows, which bounds z, z' and thus z''.
        rate = -2.0 * self.decay * self.speed_offset - self.stiffness * self.angle_offset
        energy = math.hypot(rate, math.sqrt(self.stiffness) * self.speed_offset)
        root = math.sqrt(self.stiffness)
        square = self.decay * self.decay - self.stiffness
        slowest = self.decay if square <= 0.0 else self.stiffness / (self.decay + math.sqrt(square))
        return energy / root, (2.0 * self.decay + root) * energy, slowest, root

    def _transient(self, t: Any) -> tuple[Floats, Floats, Floats]:
        """Return the decaying parts of slip speed, plate angle and plate speed, for light, critical and heavy damping.
        """
        at = np.asarray(t, dtype=np.float64)
        if self.modes is not None:
            rates, shares = self.modes
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

    Raises
    ------
    InputError
        mu_k differs from mu_s (the law is then nonlinear in slip), the pressure falls below 0, or the pressure excites
        exactly the resonance of an undamped driveline.
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
    rates, vectors = np.linalg.eig(a.astype(np.complex128))
    return PureSlip(direction=int(sign), a0=slip.mean, a1=0.0, slip=slip, plate=plate,
                    decay=linear.damping / (2.0 * linear.plate), stiffness=linear.stiffness / linear.plate,
                    angle_offset=float(off[1]), speed_offset=float(off[2]),
                    period=common_cycles(system) * system.cycle,
                    modes=(rates, vectors * np.linalg.solve(vectors, off.astype(np.complex128))))


def equivalent_torque(system: System) -> Sines:
    """Return Teq(t) of (29b) in its corrected form for positive slip, N m: Te - (1 + I1/I2) Ts.

    The print omits Tsm after the bracket. Teq alone does not drive the slip: the other side of (29a) has the spring and
    damper of the plate, which depend on Ts by (12b); `slip_torque` eliminates them.
    """
    d = system.driveline
    return engine_series(system).plus(load_series(system), -(1.0 + d.flywheel_inertia / d.plate_inertia))


def slip_torque(system: System) -> Sines:
    """Return the torque that drives the steady positive slip, N m.

    I1 v' = Te - Ts [K23 - (I1 + I2) w^2 + i C23 w]/[K23 - I2 w^2 + i C23 w] at each frequency w: (29a) with the plate's
    motion eliminated by (12b). At low frequency the factor of Ts is 1 and the amplitude |Tp - Tsp exp(i psi)|; it turns
    its sign near omega_sn, so a load in phase with the torque damps the slip below omega_sn and drives it above: the
    reversal of Figs. 8, 10, 11 and 13.

    Raises
    ------
    InputError
        The pressure excites exactly the plate resonance of an undamped driveline.
    """
    d = system.driveline

    def share(omega: float) -> complex:
        stuck = complex(d.stiffness - (d.flywheel_inertia + d.plate_inertia) * omega**2, d.damping * omega)
        return stuck / dynamic_stiffness(d, d.plate_inertia, omega, PLATE)

    return engine_series(system).plus(load_series(system).through(share), -1.0)
