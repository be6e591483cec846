"""Detection of wrong units in a measurement before the fit, from short windows of the motion."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.measurement import Measurement, noise_of
from tcc_sim.estimation.multiple_shooting import INDEX, MultipleShooting
from tcc_sim.estimation.settings import DEFAULTS, FitSettings
from tcc_sim.estimation.windows import Model, states_of
from tcc_sim.trajectory import Floats

RPM, DEGREES = math.pi / 30.0, math.pi / 180.0
OTHERS = {"slip_speed": {"rpm": RPM, "degrees/s": DEGREES}, "plate_speed": {"rpm": RPM, "degrees/s": DEGREES},
          "plate_angle": {"degrees": DEGREES}, "actuation_pressure": {"bar": 1e5, "kPa": 1e3, "MPa": 1e6}}
"""Units that a column may have by mistake, and their factors to SI."""


def check_units(model: Model, values: Floats, settings: FitSettings) -> None:
    """Raise InputError if conversion of a column makes the scene explain the motion from sample to sample.

    The windows of the fit's first stage begin at the samples; the misfit of each column at their ends is compared with
    its spread. A scene with parameters a few per cent off explains most of it, one in other units does not.
    """
    measured = _beginning(model.measured)
    begun = _misfit(replace(model, measured=measured), values, settings)
    if begun < DEFAULTS.explained:
        return
    found = (math.inf, "", "", measured)
    for unit, names in _suspects(measured):
        changed = measured
        for name in names:
            changed = _converted(changed, name, OTHERS[name][unit])
        misfit = _misfit(replace(model, measured=changed), values, settings)
        found = min(found, (misfit, " and ".join(names), unit, changed), key=lambda each: each[0])
    if found[0] < min(DEFAULTS.explained, 0.2 * begun):
        what, unit = found[1:3]
        raise InputError(f"{measured.source}: {what} {'look' if ' and ' in what else 'looks'} as if in {unit}: times "
                         f"{OTHERS[what.split()[0]][unit]:.6g} the scene explains the motion from sample to sample, "
                         "otherwise it does not; convert to SI")


def _suspects(measured: Measurement) -> list[tuple[str, tuple[str, ...]]]:
    """Return units with the columns that may have them: each alone, and all combinations."""
    there = [name for name in OTHERS if name in measured.channels or name in measured.inputs]
    out = []
    for unit in dict.fromkeys(unit for name in there for unit in OTHERS[name]):
        names = [name for name in there if unit in OTHERS[name]]
        out += [(unit, chosen) for size in range(1, len(names) + 1) for chosen in combinations(names, size)]
    return out


def _beginning(measured: Measurement) -> Measurement:
    """Return the first samples, enough to show units."""
    k = min(len(measured.t), DEFAULTS.looked_at)
    channels = {name: column[:k] for name, column in measured.channels.items() if np.ptp(column[:k]) > 0.0}
    if "slip_speed" not in channels:
        return measured
    return replace(measured, t=measured.t[:k], channels=channels,
                   inputs={name: column[:k] for name, column in measured.inputs.items()})


def _converted(measured: Measurement, name: str, factor: float) -> Measurement:
    """Return the measurement with a column in another unit."""
    if name in measured.channels:
        return replace(measured, channels=measured.channels | {name: measured.channels[name] * factor})
    return replace(measured, inputs=measured.inputs | {name: measured.inputs[name] * factor})


def _misfit(model: Model, values: Floats, settings: FitSettings) -> float:
    """Return the median square of the windows' last residuals over that of the motion; inf if none can be solved."""
    measured = model.measured
    levels = {name: noise_of(column) for name, column in measured.channels.items()}
    try:
        problem = MultipleShooting(model, levels, settings, settings.stages[0].window)
        starts = problem.first_starts(values)
        states = states_of(model, starts, problem.width, values, model.substeps(values))[:, -2]
    except NumericalFailure:
        return math.inf
    ratios = []
    for name, column in measured.channels.items():
        data = column[:problem.count * problem.width].reshape(problem.count, problem.width)
        moved = np.abs(data[:, -1] - data[:, 0])
        most = np.argsort(moved)[2 * len(moved) // 3:]   # Units do not show in stick and in small motions.
        ratios.append(np.median((states[most, INDEX[name]] - data[most, -1]) ** 2) / np.mean(moved[most] ** 2))
    return float(max(ratios))
