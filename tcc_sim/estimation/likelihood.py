"""Profile likelihood of one parameter: the others are fitted again while it is held."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.settings import FitSettings
from tcc_sim.estimation.windows import OFFSETS, Model
from tcc_sim.model.parameters import replace as changed
from tcc_sim.result import reported
from tcc_sim.trajectory import Floats


@dataclass(frozen=True)
class Likelihood:
    """Profile likelihood of one parameter: the excess of the least chi-square while it is held."""

    key: str = field(metadata=reported("scene key"))
    values: Floats = field(metadata=reported("values at which it was held", "{key}"))
    excess: Floats = field(metadata=reported("least chi-square there over that of the fit"))


def profile_likelihood(model: Model, noise: dict[str, float], settings: FitSettings, found: Fit, key: str,
                       errors: Floats) -> Likelihood:
    """Return the least chi-square while `key` is held at values around its estimate and the others are fitted again."""
    at = model.keys.index(key)
    held = [k for k in model.keys if k != key]
    values = found.values[at] + errors[at] * np.linspace(-3.0, 3.0, 13)
    excess: NDArray[np.float64] = np.full(len(values), np.nan)
    samples = sum(len(r) for r in found.residuals.values())
    least = found.chi2 * max(samples - len(model.keys) - 3, 1)
    for i, value in enumerate(values):
        try:
            fixed = {key: float(value)}
            if key in OFFSETS:
                name = OFFSETS[key]
                inputs = {**model.measured.inputs}
                if name not in inputs:
                    continue
                inputs[name] = inputs[name] - value
                other = Model(model.system, tuple(held), replace(model.measured, inputs=inputs))
            else:
                other = Model(changed(model.system, fixed), tuple(held), model.measured)
            again = fit(other, noise, np.delete(found.values, at), settings, settings.stages[-1:], found.starts)
        except (NumericalFailure, InputError, RuntimeError):
            continue
        excess[i] = again.chi2 * max(samples - len(held) - 3, 1) - least
    return Likelihood(key, values, excess)
