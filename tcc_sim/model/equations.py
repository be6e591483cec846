"""Equations of motion (1), (2) with the slip speed as a state, the excitation, and the table of who supports each term.

States: slip speed v (rad/s), plate angle theta2 (rad), plate speed omega2 (rad/s). The slip speed is a state because in
stick it is a small difference of large numbers. theta1 is cyclic; it is integrated separately, only on request.

The table is the gate of everything that solves, differentiates, exports or maps: a term that a row of SUPPORTED does
not name is refused there. So a term that is added to the model is refused by everybody until its name is added to the
rows of those that support it; nothing leaves it out in silence.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System


class Linear(NamedTuple):
    """Linear part of the equations of motion, as torques that flywheel and plate lose:

        I1 theta1'' = Te - Tf - f_v v,
        I2 theta2'' = Tf - C23 (omega2 - omega3) - K23 (theta2 - theta3) - p_v v.

    Coefficients that are None are compiled out. `matrix_of` gives the matrix A of x' = A x + ..., x = (v, theta2,
    omega2).

    flywheel, plate : I1, I2, kg m^2
    damping, stiffness : C23, N m s/rad, and K23, N m/rad, between the plate and the shaft's far end
    flywheel_by_slip, plate_by_slip : f_v and p_v, N m s/rad
    """

    flywheel: float
    plate: float
    damping: float
    stiffness: float
    flywheel_by_slip: float | None = None
    plate_by_slip: float | None = None


COEFFICIENTS: dict[str, dict[str, float]] = {
    "driveline.flywheel_inertia": {"flywheel": 1.0},
    "driveline.plate_inertia": {"plate": 1.0},
    "driveline.damping": {"damping": 1.0},
    "driveline.stiffness": {"stiffness": 1.0},
    "converter.coupling": {"flywheel_by_slip": 1.0, "plate_by_slip": -1.0},
}
"""The linear part by scene keys: each coefficient is the sum of these keys times these shares.

This is the only place that knows which keys make the linear part. Its derivatives by them, all methods, the exported C
and the linear models follow.
"""
_BROUGHT = {name for shares in COEFFICIENTS.values() for name in shares}


OPTIONAL = tuple(Linear._field_defaults)
"""Coefficients that may be absent."""


def linear_of(system: System) -> Linear:
    """Return the linear part of a system; coefficients that are 0 are absent."""
    coefficients = dict.fromkeys(_BROUGHT, 0.0)
    for key, shares in COEFFICIENTS.items():
        value = system.value(key)
        for name, share in shares.items():
            coefficients[name] += share * value
    return Linear(**{name: value for name, value in coefficients.items() if value != 0.0 or name not in OPTIONAL})


def completed(linear: Linear) -> Linear:
    """Return the linear part with 0 for every absent coefficient that a key may bring, so that one kernel has all."""
    return linear._replace(**{name: 0.0 for name in _BROUGHT if getattr(linear, name) is None})


def coefficients_of(linear: Linear) -> tuple[float, float, float, float, float, float]:
    """Return the coefficients in the order of Linear, absent ones as 0."""
    i1, i2, damping, stiffness, by_slip, plate_by_slip = linear
    return i1, i2, damping, stiffness, by_slip or 0.0, plate_by_slip or 0.0


def matrix_of(linear: Linear) -> NDArray[np.float64]:
    """Return A of x' = A x + ..., (3, 3), for x = (v, theta2, omega2)."""
    i1, i2, damping, stiffness, by_slip, plate_by_slip = coefficients_of(linear)
    plate = np.array([-plate_by_slip, -stiffness, -damping]) / i2
    return np.array([np.array([-by_slip, 0.0, 0.0]) / i1 - plate, [0.0, 0.0, 1.0], plate])


def decay_of_slip(linear: Linear) -> float:
    """Return the rate, 1/s, at which the linear part alone lets the slip speed decay, -A_vv."""
    return (linear.flywheel_by_slip or 0.0) / linear.flywheel - (linear.plate_by_slip or 0.0) / linear.plate


def lost_torque(slip_speed: Any, by_slip: float | None) -> Any:
    """Return by_slip v, N m; 0 where the coefficient is None."""
    if by_slip is None:
        return 0.0
    else:
        return by_slip * slip_speed


def engine_torque(t: Any, mean: float, torque: tuple[float, float] | None,
                  harmonics: NDArray[np.float64] | None) -> Any:
    """Te(t), N m: mean + Tp sin(omega t) + sum_n Tpn sin(n omega t + phi_n), Section 2.2 of the paper.

    t : float or (n,) array, s
    mean : Tm, N m
    torque : (Tp in N m, omega in rad/s), or None for Tp = 0
    harmonics : (m, 3) array of angular frequency (rad/s), amplitude (N m), phase (rad), or None
    """
    out = mean + 0.0 * t
    if torque is not None:
        out = out + torque[0] * np.sin(torque[1] * t)
    if harmonics is not None:
        for k in range(harmonics.shape[0]):
            out = out + harmonics[k, 1] * np.sin(harmonics[k, 0] * t + harmonics[k, 2])
    return out


def saturation_torque(t: Any, mean: float, pulsation: tuple[float, float, float] | None) -> Any:
    """Ts(t) of (5b), N m, clamped at 0: no separation, no negative normal load.

    `pulsation` is (Tsp in N m, omega_f in rad/s, psi in rad), or None for a constant load.
    """
    if pulsation is None:
        return mean + 0.0 * t
    else:
        return np.maximum(mean + pulsation[0] * np.sin(pulsation[1] * t + pulsation[2]), 0.0)


def accelerations(slip_speed: Any, plate_angle: Any, plate_speed: Any, engine: Any, friction: Any, linear: Linear,
                  far_angle: Any = 0.0, far_speed: Any = 0.0) -> Any:
    """(v', omega2') of (2a) divided by I1, and (2b), rad/s^2, for given engine and friction torque in N m.

    far_angle, far_speed : theta3 (rad) and omega3 (rad/s) of the shaft's far end
    """
    plate = (friction - linear.damping * (plate_speed - far_speed) - linear.stiffness * (plate_angle - far_angle)
             - lost_torque(slip_speed, linear.plate_by_slip)) / linear.plate
    return (engine - friction - lost_torque(slip_speed, linear.flywheel_by_slip)) / linear.flywheel - plate, plate


def interface_torque(plate_angle: Any, plate_speed: Any, engine: Any, linear: Linear) -> Any:
    """The friction torque lambda that stick needs (v' = 0), N m: (I2 Te + I1 (C23 theta2' + K23 theta2))/(I1 + I2)."""
    spring = linear.damping * plate_speed + linear.stiffness * plate_angle
    return (linear.plate * engine + linear.flywheel * spring) / (linear.flywheel + linear.plate)


SMOOTHED, SET_VALUED = "smoothed", "set_valued"
LAWS = SMOOTHED, SET_VALUED
EXCITATION = frozenset({"torque", "harmonics", "pulsation"})
BOTH_ENGINES = EXCITATION | {"stribeck", "curve", "approach"} | set(OPTIONAL)
"""Terms that the equations of both laws have. A held pressure passes an actuator (`approach`) as it is."""
SAMPLED = BOTH_ENGINES | {SMOOTHED, "profile", "inputs"}
AT_REST = frozenset({"flywheel_by_slip", "plate_by_slip"})
"""Coefficients that do nothing where v = 0."""

SUPPORTED: dict[str, frozenset[str]] = {
    "fixed_step": SAMPLED | {"far"}, "smoothed": SAMPLED, "event_driven": BOTH_ENGINES | {SET_VALUED},
    **dict.fromkeys(("rk45", "dop853", "radau", "bdf", "lsoda", "rk4"), SAMPLED),
    "section map": BOTH_ENGINES | {SMOOTHED, SET_VALUED},
    "tick derivatives": SAMPLED,
    "node": SAMPLED | {"far"},
    "FMU": SAMPLED - {"inputs"},
    "pure slip": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "pure stick": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "harmonic balance": EXCITATION | {SMOOTHED, "approach", "stribeck", "curve"},
    "reference": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "peer": frozenset({"torque", "pulsation", SMOOTHED, "approach", "stribeck"}),
}
"""Terms that solvers (by their names) and everything else support. `stribeck` is refused by pure slip itself.

section map : derivatives, basins, exponents, continuation, periodic linear models and the equivalent damping
tick derivatives : identification
reference, peer : independent solutions, and other programs, of the measurements of precision
"""


def terms_in(system: System) -> dict[str, str]:
    """Return the terms that a system has, by the names of the fields of `solvers.terms.Terms` and of Linear, each with
    the scene keys or inputs that bring it.
    """
    e, p, inputs, terms = system.engine, system.pressure, system.inputs, {}
    terms[system.friction.law] = f"friction.law {system.friction.law}"
    if e.harmonic and e.torque_amplitude > 0.0:
        terms["torque"] = "engine.torque_amplitude"
    if e.harmonic and any(e.harmonic_amplitudes):
        terms["harmonics"] = "engine.harmonic_amplitudes"
    if p.harmonic and p.amplitude > 0.0:
        terms["pulsation"] = "pressure.amplitude"
    if system.friction.stribeck is not None:
        terms["stribeck"] = "friction that varies with slip speed"
    if system.friction.curve is not None:
        terms["curve"] = "friction.coefficients"
    if p.actuated:
        terms["approach"] = "an actuator of the pressure"
    if inputs is not None and inputs.output_speed is not None:
        terms["far"] = "inputs with output_speed"
    if system.profile is not None:
        terms["profile"] = ", ".join(key for key in system.varying if key != "inputs") or "inputs"
    if inputs is not None:
        terms["inputs"] = "inputs"
    linear = linear_of(system)
    for name in OPTIONAL:
        if getattr(linear, name) is not None:
            terms[name] = " and ".join(key for key, shares in COEFFICIENTS.items()
                                       if name in shares and system.value(key) != 0.0)
    return terms


def unsupported(who: str, system: System) -> dict[str, str]:
    """Return the terms of a system that a row of SUPPORTED leaves out, as `terms_in`."""
    return {name: text for name, text in terms_in(system).items() if name not in SUPPORTED[who]}


def check_supported(who: str, system: System, verb: str) -> None:
    """Raise InputError if a system has a term that a row of SUPPORTED leaves out; `verb` begins the sentence."""
    absent = unsupported(who, system)
    if absent:
        able = [name for name, terms in SUPPORTED.items() if absent.keys() <= terms]
        raise InputError(f"{verb} does not know {', '.join(dict.fromkeys(absent.values()))}; "
                         f"{'those that do are ' + ', '.join(able) if able else 'nothing does'}")
