"""The driveline from many starts at once: the windows of multiple shooting, with derivatives by starts and parameters.

The real-time solver's method with several sub-steps a sample. Derivatives are differences of the discrete solution,
whose scalar equations are solved to rounding, so that they are those of what is fitted. All of them take the same count
of sub-steps: where a parameter's change brought one more, its error was taken for a derivative, and the intervals of a
prototype covered 0.90 of the truth in place of 0.95.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.measurement import INPUTS, Measurement
from tcc_sim.model.parameters import DEFAULTS, System, replace, unknown_key
from tcc_sim.solvers.fixed_step import advance, advance_ticks, substeps
from tcc_sim.solvers.terms import Terms, holding, terms_of
from tcc_sim.trajectory import Floats

OFFSETS = {f"{name}.offset": name for name in INPUTS}
"""Free parameters beside scene keys: what a sensor of an input shows too much, N m or Pa."""
FREE = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay", "friction.smoothing",
        "driveline.damping", "driveline.stiffness", "driveline.flywheel_inertia", "driveline.plate_inertia", *OFFSETS)
"""What can be identified."""
NEAR_ONE = 1.0005
"""Least ratio mu_s/mu_k while both are free: at 1 the law has no decay that could be told."""
STATE_STEPS = (1e-6, 1e-8, 1e-6)
"""Differences by the states of a start, rad/s, rad, rad/s."""
RELATIVE_STEP = 1e-6
ROOM = 1.25
"""Sub-steps over those that the values need."""


def check_key(key: str) -> None:
    """Raise InputError unless a key can be identified."""
    if key not in FREE:
        if key in DEFAULTS:
            raise InputError(f"{key} cannot be identified; what can: {', '.join(FREE)}")
        raise unknown_key(key, dict.fromkeys(FREE))


@dataclass(frozen=True)
class Model:
    """A driveline whose `keys` are free, driven as the measurement says."""

    system: System
    keys: tuple[str, ...]
    measured: Measurement

    def substeps(self, values: Floats) -> int:
        """Sub-steps of a sample, with room for values somewhat different: a count that changed between a motion and its
        neighbour would be taken for a derivative.

        Raises
        ------
        NumericalFailure
            Values out of their ranges, or that need too many sub-steps.
        """
        most = max(self.at(values), key=lambda row: row.mean_load)
        try:
            return math.ceil(ROOM * substeps(most, self.measured.step))
        except InputError as error:
            raise NumericalFailure(str(error)) from None

    def at(self, values: Floats) -> list[Terms]:
        """Terms of every sample; one for all where no input was measured.

        Raises
        ------
        NumericalFailure
            Values out of their ranges.
        """
        named = {k: float(v) for k, v in zip(self.keys, values) if k not in OFFSETS}
        offsets = {OFFSETS[k]: float(v) for k, v in zip(self.keys, values) if k in OFFSETS}
        try:
            system = replace(self.system, named)
            terms = self._offset(terms_of(system), system, offsets)
            inputs = self.measured.inputs
            rows = [terms]
            if inputs:
                n = len(self.measured.t)
                torque, pressure = (inputs[name] - offsets.get(name, 0.0) if name in inputs else [None] * n
                                    for name in INPUTS)
                rows = [holding(terms, None if t is None else float(t),
                                None if p is None else max(0.0, system.torque_per_pressure * float(p)))
                        for t, p in zip(torque, pressure)]
            return rows
        except InputError as error:
            raise NumericalFailure(str(error)) from None

    def _offset(self, terms: Terms, system: System, offsets: dict[str, float]) -> Terms:
        """Terms whose own means are without the offsets of sensors that were not measured beside."""
        inputs = self.measured.inputs
        if "engine_torque" in offsets and "engine_torque" not in inputs:
            terms = terms._replace(mean_torque=terms.mean_torque - offsets["engine_torque"])
        if "actuation_pressure" in offsets and "actuation_pressure" not in inputs:
            load = terms.mean_load - system.torque_per_pressure * offsets["actuation_pressure"]
            terms = terms._replace(mean_load=max(0.0, load))
        return terms


class Swept(NamedTuple):
    """All windows: states (m, W + 1, 3), derivatives by the start (m, W + 1, 3, 3) and the keys (m, W + 1, 3, P)."""

    states: Floats
    by_start: Floats
    by_key: Floats


def states_of(model: Model, starts: Floats, width: int, values: Floats, n: int) -> Floats:
    """The states of every window of `width` samples, (m, width + 1, 3), from its start, (m, 3), in n sub-steps each."""
    rows = model.at(values)
    step, first = model.measured.step, float(model.measured.t[0])
    out = np.empty((len(starts), width + 1, 3))
    room = np.empty((width * n, 3))
    for j, start in enumerate(starts):
        out[j, 0] = start
        state, begun = start.copy(), j * width
        if len(rows) == 1:
            advance_ticks(state, first, step, begun, width, n, rows[0], None, room)
            out[j, 1:] = room[n - 1::n]
            continue
        for k in range(width):
            advance(state, first + (begun + k) * step, step / n, n, rows[begun + k], None, None)
            out[j, k + 1] = state
    if not np.isfinite(out).all():
        raise NumericalFailure("the state is not finite")
    return out


def sweep(model: Model, starts: Floats, width: int, values: Floats, n: int) -> Swept:
    """The states of every window with their derivatives, by forward differences."""
    states = states_of(model, starts, width, values, n)
    by_start, by_key = np.empty((*states.shape, 3)), np.empty((*states.shape, len(values)))
    for i, size in enumerate(STATE_STEPS):
        moved = starts.copy()
        moved[:, i] += size
        by_start[..., i] = (states_of(model, moved, width, values, n) - states) / size
    for i, size in enumerate(key_steps(model.keys, values)):
        moved = values.copy()
        moved[i] += size
        by_key[..., i] = (states_of(model, starts, width, moved, n) - states) / size
    return Swept(states, by_start, by_key)


def key_steps(keys: Sequence[str], values: Floats) -> Floats:
    """Differences by the keys; mu_k goes down and mu_s up, so that mu_k stays at most mu_s."""
    sizes = RELATIVE_STEP * np.array([max(abs(v), 1.0) if k in OFFSETS else abs(v) for k, v in zip(keys, values)])
    return np.where([k == "friction.kinetic_coefficient" for k in keys], -sizes, sizes)
