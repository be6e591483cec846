"""Pure slip in closed form for mu_k = mu_s: (12) to (18) of the paper, with a load that varies and several harmonics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import Floats, Sines, engine_series, load_series


@dataclass(frozen=True)
class PureSlip:
    """The solution (14) of (12): v = a0 + a1 t + sines + transient, and the plate's motion.

    a0 : rad/s; a1 = (Tm - Tsm)/I1 : rad/s^2 (the friction torque's sign turned where the slip is negative)
    slip : the sines a21, a22 of (14), with their phases; their mean is a0
    plate : steady plate angle, rad
    decay, stiffness : zeta omega_n (1/s) and omega_n^2 (1/s^2) of the plate on its spring, (17c-e)
    angle_offset, speed_offset : plate angle and speed at t = 0 less the steady ones, rad and rad/s: what decays
    """

    a0: float
    a1: float
    slip: Sines
    plate: Sines
    decay: float
    stiffness: float
    angle_offset: float
    speed_offset: float

    def slip_speed(self, t: Any) -> Floats:
        """v(t) of (14), rad/s, at the times t (n,)."""
        out: Floats = self.steady_slip_speed(t) + self.a1 * np.asarray(t) - self._transient(t)[1]
        return out

    def steady_slip_speed(self, t: Any) -> Floats:
        """v(t) of (15), rad/s, without the transient (and without a1 t, which has no steady state)."""
        return self.slip(t)

    def plate_angle(self, t: Any) -> Floats:
        """theta2(t), rad."""
        out: Floats = self.plate(t) + self._transient(t)[0]
        return out

    def plate_speed(self, t: Any) -> Floats:
        """theta2'(t), rad/s."""
        out: Floats = self.plate.rate()(t) + self._transient(t)[1]
        return out

    @property
    def steady(self) -> bool:
        """A steady state exists: a1 = 0 (Tm = Tsm)."""
        return self.a1 == 0.0

    @property
    def margin(self) -> float:
        """|a0| - |a21| - |a22| of (16), rad/s; above 0 the steady slip speed never reaches 0.

        Sines of one frequency (omega_f = omega) are added as phasors first: sharper than the print, and exact then.
        """
        return abs(self.a0) - self.slip.swing()

    def _transient(self, t: Any) -> tuple[Floats, Floats]:
        """The decaying plate angle and plate speed, for light, critical and heavy damping."""
        at = np.asarray(t, dtype=np.float64)
        cosine, sine = damped_pair(at, self.decay, self.stiffness)
        x, w = self.angle_offset, self.speed_offset
        angle: Floats = x * (cosine + self.decay * sine) + w * sine
        speed: Floats = w * (cosine - self.decay * sine) - self.stiffness * x * sine
        return angle, speed


def damped_pair(t: Floats, decay: float, stiffness: float) -> tuple[Floats, Floats]:
    """exp(-decay t) times cos(wd t) and sin(wd t)/wd, wd^2 = stiffness - decay^2 of either sign; t >= 0."""
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
        mu_k < mu_s (the law is then nonlinear in slip), a pressure that reaches below 0, or an undamped driveline whose
        resonance the pressure excites exactly.
    """
    if system.friction_ratio != 1.0:
        raise InputError(f"friction.kinetic_coefficient is {system.friction.kinetic_coefficient:g}; pure slip in closed form "
                         f"needs it equal to friction.static_coefficient, {system.friction.static_coefficient:g}")
    torque, load = engine_series(system), load_series(system)
    if load.swing() > load.mean:
        raise InputError("pressure.amplitude is above pressure.mean; pure slip in closed form needs a pressure above 0")
    d, start, sign = system.driveline, system.initial, float(np.sign(direction))

    def compliance(omega: float) -> complex:
        plate = complex(d.stiffness - d.plate_inertia * omega**2, d.damping * omega)
        if plate == 0.0:
            raise InputError(f"pressure.frequency_ratio excites the undamped plate resonance, {omega:g} rad/s: no steady state")
        return sign / plate

    plate = load.through(compliance)
    net = torque.plus(load, -sign)
    flywheel = [(float(w), float(a) / (d.flywheel_inertia * float(w)), float(p) - 0.5 * math.pi)
                for w, a, p in zip(net.frequency, net.amplitude, net.phase)]
    swing = Sines.of(0.0, flywheel)
    a0 = start.slip_speed + start.plate_speed - float(swing(0.0))
    slip = Sines.of(a0, flywheel).plus(plate.rate(), -1.0)
    drive = net.mean if abs(net.mean) > 1e-14 * (abs(torque.mean) + load.mean) else 0.0
    return PureSlip(a0=a0, a1=drive / d.flywheel_inertia, slip=slip, plate=plate,
                    decay=d.damping / (2.0 * d.plate_inertia), stiffness=d.stiffness / d.plate_inertia,
                    angle_offset=start.plate_angle - float(plate(0.0)),
                    speed_offset=start.plate_speed - float(plate.rate()(0.0)))
