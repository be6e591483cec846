"""The driveline from many starts at once: the windows of multiple shooting, with derivatives by starts and parameters.

The real-time solver's method with several sub-steps per sample, and the exact derivatives of its result
(`solvers.fixed_step_sensitivity`). The number of sub-steps is constant during a stage of a fit: a change of it would
make the cost jump.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation.curve import CONSTANT, CURVE, LARGEST_SHARE, RATES, SHARES, pairs_of, rates_allowed
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.model.groups import TABLE
from tcc_sim.model.parameters import DEFAULTS as SCENE_KEYS
from tcc_sim.model.parameters import QUANTITIES, System, replace, unknown_key
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.key_derivatives import (
    DECAYS,
    EXCESSES,
    LOAD_AMPLITUDE,
    LOG_LOAD,
    MEAN_LOAD,
    MEAN_TORQUE,
    NUMBERS,
    key_derivatives,
)
from tcc_sim.solvers.terms import Terms, holding, least_mean_load, substeps, terms_of
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

LEAST_RATIO, EQUAL = 1.0005, 1.0 + 1e-9
"""Least ratio of mu_s and mu_k while one is free, with the decay, which has no effect at 1, and without it."""
SPARE = 1.25
"""Sub-steps relative to those that the values need."""
OFFSETS = {f"{name}.offset": name for name in INPUTS}
"""Free parameters besides scene keys: the offset of an input's sensor, N m or Pa."""
FREE = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "driveline.damping", "driveline.stiffness", "driveline.flywheel_inertia", "driveline.plate_inertia",
        "converter.coupling", *OFFSETS)
"""Keys that can be identified, besides friction.curve."""
LINEAR = {*OFFSETS, *SHARES}
"""Free parameters of either sign, whose logarithms a fit does not use."""
CURVE_ROWS = dict(zip((*SHARES, *RATES), (*EXCESSES, *DECAYS)))
"""Rows of the derivatives for the numbers of a curve."""
UNKNOWN = 100.0
"""Standard error of a parameter's logarithm above which a measurement holds nothing about it."""
STATIC, KINETIC = "friction.static_coefficient", "friction.kinetic_coefficient"


def on_its_side(value: float, other: float, falls: bool | None = None, ratio: float = LEAST_RATIO) -> float:
    """Return a coefficient at least `ratio` above another one, or as much below it if friction does not fall."""
    above = value >= other if falls is None else falls
    return max(value, other * ratio) if above else min(value, other / ratio)


def least_ratio(keys: Collection[str]) -> float:
    """Return the least ratio of mu_s and mu_k with these free keys."""
    return LEAST_RATIO if "friction.decay" in keys else EQUAL


def largest_errors(keys: tuple[str, ...]) -> Floats:
    """Return the standard errors, (P,), of logarithms or of offsets, above which a measurement holds nothing about a
    key; infinite for the numbers of a curve, which mean nothing individually.
    """
    return np.array([math.inf if key.startswith(CURVE) else
                     QUANTITIES[topic(OFFSETS[key]).key].high if key in OFFSETS else UNKNOWN for key in keys])


def check_key(key: str) -> None:
    """Raise InputError unless a key can be identified."""
    if key not in FREE:
        if key in SCENE_KEYS:
            raise InputError(f"{key} cannot be identified; what can: {', '.join((CURVE, *FREE))}")
        raise unknown_key(key, dict.fromkeys((CURVE, *FREE)))


@dataclass(frozen=True)
class Model:
    """A driveline with free `keys`, driven by a measurement."""

    system: System
    keys: tuple[str, ...]
    measured: Measurement

    def drive(self, values: Floats) -> tuple[Terms, Floats | None, Floats]:
        """Return its input for values of the keys; raise NumericalFailure if one is out of its range.

        These are the terms of the scene, where measured inputs are 0; engine torque and saturation torque, N m, at the
        start and end of each sample's step, (n, 2, 2), that are added to them, or None; and derivatives of the numbers
        of the equations by the keys, (len(NUMBERS), P).
        """
        named = {k: float(v) for k, v in zip(self.keys, values) if k in SCENE_KEYS}
        curve = {k: float(v) for k, v in zip(self.keys, values) if k.startswith(CURVE)}
        offsets = {OFFSETS[k]: float(v) for k, v in zip(self.keys, values) if k in OFFSETS}
        try:
            # Friction of a curve is its constant times a shape, which `terms` have.
            alone = {STATIC: curve[CONSTANT], KINETIC: curve[CONSTANT], **dict.fromkeys(TABLE, ())} if curve else {}
            system = replace(self.system, named | alone)
        except OutOfRange as error:
            raise NumericalFailure(str(error)) from None
        inputs, by = self.measured.inputs, np.zeros((len(NUMBERS), len(self.keys)))
        per_pressure, terms = system.torque_per_pressure, terms_of(system)
        if curve:
            terms = terms._replace(stribeck=tuple(pairs_of(curve)))
        for i, key in enumerate(self.keys):
            if key in OFFSETS:
                row, change = (MEAN_TORQUE, -1.0) if OFFSETS[key] == "engine_torque" else (MEAN_LOAD, -per_pressure)
                by[row, i] = change
                continue
            if key in CURVE_ROWS:
                by[CURVE_ROWS[key], i] = 1.0
                continue
            if key == CONSTANT:
                by[LOG_LOAD, i] = 1.0 / curve[CONSTANT]
                continue
            by[:, i] = key_derivatives(system, (key,))[:, 0]
            if key == KINETIC:   # It scales the load, also a measured one.
                by[MEAN_LOAD:LOAD_AMPLITUDE + 1, i], by[LOG_LOAD, i] = 0.0, 1.0 / system.friction.kinetic_coefficient
        if not inputs and not offsets:
            return terms, None, by
        terms = holding(terms, *(0.0 if name in inputs else None for name in INPUTS))
        torque, pressure = (self.measured.ends_of(name) - offsets.get(name, 0.0) for name in INPUTS)
        load = np.maximum(per_pressure * pressure, -least_mean_load(terms))
        return terms, np.stack([torque, load], axis=2), by

    def within(self, values: Floats) -> Floats:
        """Return values with the numbers of a curve limited to their ranges."""
        low, high = rates_allowed(float(np.abs(self.measured.channels["slip_speed"]).max()))
        bounds = dict.fromkeys(SHARES, (-LARGEST_SHARE, LARGEST_SHARE)) | dict.fromkeys(RATES, (low, high))
        least, most = np.array([bounds.get(key, (-math.inf, math.inf)) for key in self.keys]).reshape(-1, 2).T
        return np.asarray(np.clip(values, least, most))

    def effect(self, key: str) -> float:
        """Return the value of a key that may be 0 at which it acts as strongly as the other torques; 0 for other keys.

        Critical damping of the plate on its shaft; a fluid torque as large as the engine's mean torque, or a fall of
        friction by 1 - 1/e, at the largest slip speed.
        """
        driveline, engine = self.system.driveline, self.system.engine
        fastest = float(np.abs(self.measured.channels["slip_speed"]).max()) or math.inf
        return {"driveline.damping": 2.0 * math.sqrt(driveline.stiffness * driveline.plate_inertia),
                "converter.coupling": abs(engine.mean_torque) / fastest, "friction.decay": 1.0 / fastest}.get(key, 0.0)

    def substeps(self, values: Floats) -> int:
        """Return the sub-steps per sample, with a reserve for slightly different values; raise NumericalFailure for too
        many.
        """
        terms, held, _ = self.drive(values)
        most = 0.0 if held is None else float(held[..., 1].max())
        try:
            return math.ceil(SPARE * substeps(terms, self.measured.step, most))
        except OutOfRange as error:
            raise NumericalFailure(str(error)) from None


def states_of(model: Model, starts: Floats, width: int, values: Floats, n: int) -> Floats:
    """Return the states of windows of `width` samples, (m, width + 1, 3), from their starts, (m, 3), in n sub-steps."""
    return sensitivities(model, starts, width, values, n, by_keys=False)[0]


def sensitivities(model: Model, starts: Floats, width: int, values: Floats, n: int,
                  by_keys: bool = True) -> tuple[Floats, Floats]:
    """Return the states of every window, and their derivatives by its start and the keys, (m, width + 1, 3, 3 + P).

    Raise NumericalFailure if a state is not finite.
    """
    measured, (terms, held, by) = model.measured, model.drive(values)
    advanced = advance_windows(starts, float(measured.t[0]), measured.step, width, n, terms, held,
                               by if by_keys else np.empty((len(NUMBERS), 0)))
    if not np.isfinite(advanced[0]).all():
        raise NumericalFailure("the state is not finite")
    return advanced
