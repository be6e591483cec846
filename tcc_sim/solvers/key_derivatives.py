"""Exact derivatives of the numbers of equations (1) to (7) by scene keys, the same for every engine.

The right-hand side is a function of the numbers in NUMBERS. The derivative of a motion by a scene key is the sum of its
derivatives by the numbers, weighted with a column of `key_derivatives`. The engine frequency is LOG_FREQUENCY: with the
phase omega t as the variable of the excitation, a change of log omega by d adds -d times the rate of the state to the
right-hand side, and nothing else changes.

The fit of a friction table, mu(v) = m + sum over j of c_j exp(-a_j |v|), has keys of its own: friction.curve.constant
(m, with c_j held), friction.curve.amplitude_j (c_j), and friction.curve.rate_j (a_j, s/rad).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.equations import COEFFICIENTS, Linear
from tcc_sim.model.groups import TABULATED
from tcc_sim.model.parameters import DEFAULTS, System, list_of, unknown_key
from tcc_sim.trajectory import Floats

NUMBERS = (*Linear._fields, "mean_torque", "torque_amplitude", "mean_load", "load_amplitude", "load_phase", "excess",
           "decay", "smoothing", "log_frequency", "breakaway", "second_excess", "second_decay", "third_excess",
           "third_decay", "log_load")
"""Coefficients of the linear part; Tm, Tp; Tsm, Tsp, psi; c_1/m and a_1 (mu_s/mu_k - 1 and alpha of the law with one
exponential), sigma; log omega; mu(0)/m; c_2/m, a_2, c_3/m, a_3; logarithm of the whole saturation torque, where inputs
are measured.
"""
LINEAR = len(Linear._fields)
"""Numbers of the linear part, the first ones."""
FLYWHEEL_INERTIA, PLATE_INERTIA, DAMPING, STIFFNESS, FLYWHEEL_BY_SLIP, PLATE_BY_SLIP = range(LINEAR)
(MEAN_TORQUE, TORQUE_AMPLITUDE, MEAN_LOAD, LOAD_AMPLITUDE, LOAD_PHASE, EXCESS_RATIO, DECAY, SMOOTHING, LOG_FREQUENCY,
 BREAKAWAY, SECOND_EXCESS, SECOND_DECAY, THIRD_EXCESS, THIRD_DECAY, LOG_LOAD) = range(LINEAR, len(NUMBERS))
EXCESSES, DECAYS = [EXCESS_RATIO, SECOND_EXCESS, THIRD_EXCESS], [DECAY, SECOND_DECAY, THIRD_DECAY]
"""Numbers of the exponentials in turn."""
LATER = [SECOND_EXCESS, SECOND_DECAY, THIRD_EXCESS, THIRD_DECAY]
"""Numbers of the exponentials behind the first."""

OF_ITSELF = {"engine.mean_torque": MEAN_TORQUE, "engine.torque_amplitude": TORQUE_AMPLITUDE,
             "pressure.phase": LOAD_PHASE, "friction.decay": DECAY, "friction.smoothing": SMOOTHING}
"""Keys that are one of the numbers themselves."""
CURVE = "friction.curve."
"""Start of the keys of a table's fit."""


def key_derivatives(system: System, keys: Sequence[str]) -> Floats:
    """(len(NUMBERS), len(keys)) derivatives of the numbers of the right-hand side by scene keys.

    A number that a scene has no term for (Tp = 0, mu_k = mu_s) has its derivative all the same.

    Raises InputError: a key that the motion does not depend on continuously, or that is no number.
    """
    out = np.zeros((len(NUMBERS), len(keys)))
    for column, key in enumerate(keys):
        for number, value in _by(system, key).items():
            out[number, column] = value
    return out


def _by(system: System, key: str) -> dict[int, float]:
    """The derivatives by one key that are not 0, by their number."""
    friction, clutch = system.friction, system.clutch
    # Tsm = mu_k Pm A R and Tsp = mu_k Pp A R of (5b).
    mean, amplitude = system.saturation_mean, system.saturation_amplitude
    if friction.curve is not None and key in TABULATED:
        raise InputError(f"{key} is not used where friction.slip_speeds and friction.coefficients are given")
    if key.startswith(CURVE):
        return _by_curve(system, key)
    if key in COEFFICIENTS:
        return {NUMBERS.index(name): share for name, share in COEFFICIENTS[key].items()}
    if key in OF_ITSELF:
        return {OF_ITSELF[key]: 1.0 if key != "engine.torque_amplitude" or system.engine.harmonic else 0.0}
    if key == "engine.frequency":
        return {LOG_FREQUENCY: 1.0 / system.engine.frequency}
    if key == "friction.static_coefficient":
        return dict.fromkeys((EXCESS_RATIO, BREAKAWAY), 1.0 / friction.kinetic_coefficient)
    if key == "friction.kinetic_coefficient":
        kinetic = friction.kinetic_coefficient
        return {MEAN_LOAD: mean / kinetic, LOAD_AMPLITUDE: amplitude / kinetic,
                **dict.fromkeys((EXCESS_RATIO, BREAKAWAY), -friction.static_coefficient / kinetic**2)}
    if key in ("clutch.area", "clutch.radius"):
        factor = clutch.area if key == "clutch.area" else clutch.radius
        return {MEAN_LOAD: mean / factor, LOAD_AMPLITUDE: amplitude / factor}
    if key == "pressure.mean":
        return {MEAN_LOAD: system.torque_per_pressure}
    if key == "pressure.amplitude":
        return {LOAD_AMPLITUDE: system.torque_per_pressure if system.pressure.harmonic else 0.0}
    if list_of(key) not in DEFAULTS:
        raise unknown_key(key, DEFAULTS)
    raise InputError(f"{key} is no number that a motion depends on continuously")


def _by_curve(system: System, key: str) -> dict[int, float]:
    curve = system.friction.curve
    if curve is None:
        raise InputError(f"{key} is a number of the fit of a friction table; the scene has no friction.slip_speeds")
    m, count = curve.constant, len(curve.amplitudes)
    numbers: dict[str, dict[int, float]] = {f"{CURVE}constant": {
        MEAN_LOAD: system.saturation_mean / m, LOAD_AMPLITUDE: system.saturation_amplitude / m,
        BREAKAWAY: -sum(curve.amplitudes) / m**2, **{n: -c / m**2 for n, c in zip(EXCESSES, curve.amplitudes)}}}
    for j in range(count):
        numbers[f"{CURVE}amplitude_{j + 1}"] = {EXCESSES[j]: 1.0 / m, BREAKAWAY: 1.0 / m}
        numbers[f"{CURVE}rate_{j + 1}"] = {DECAYS[j]: 1.0}
    if key not in numbers:
        raise InputError(f"{key} is no number of the fit of this friction table; its numbers are {', '.join(numbers)}")
    return numbers[key]
