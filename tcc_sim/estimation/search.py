"""Repeated fits of a measurement: from several starts and with every possible hold of its inputs for the best one, and
with one parameter held for its profile likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation.curve import SHARES
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.settings import FitSettings, Gates
from tcc_sim.estimation.windows import KINETIC, OFFSETS, STATIC, Model, on_its_side
from tcc_sim.model.parameters import replace as changed
from tcc_sim.result import reported
from tcc_sim.trajectory import Floats

FAILED = NumericalFailure, RuntimeError
"""Errors of a fit that leads nowhere; SciPy raises RuntimeError for a singular matrix."""


@dataclass(frozen=True)
class Search:
    """Fits of a measurement from starts around a given one.

    begin : (P,) start of each free key
    levels : standard deviation of the noise by channel
    guessed : whether the noise of a channel was estimated from its signal
    samples : number of samples of all channels
    tick : function called after every iteration
    """

    begin: Floats
    levels: dict[str, float]
    guessed: bool
    samples: int
    settings: FitSettings
    gates: Gates
    tick: Callable[[], Any]

    def limit(self, fit: Fit) -> float:
        """Return the largest acceptable chi-square per degree of freedom, wider if the noise was estimated."""
        estimate = self.gates.guessed**2 / self.samples if self.guessed else 0.0
        return 1.0 + self.gates.beyond * math.sqrt(2.0 / fit.freedom + estimate)

    def joins(self, fit: Fit) -> bool:
        """Return whether the windows of a fit join to one motion."""
        return fit.gap <= self.gates.gap

    def again(self, model: Model, previous: Fit, levels: dict[str, float] | None = None) -> Fit:
        """Repeat the last stage from a fit, with another model or other noise levels."""
        return fit(model, levels or self.levels, previous.values, self.settings, self.settings.stages[-1:],
                   previous.starts, self.tick)

    def best(self, models: Sequence[Model]) -> tuple[Fit, Model, int]:
        """Return the best fit, its model, and the number of starts of the first model; raise InputError if none can be
        solved.
        """
        first, tried = self._from_starts(models[0])
        best, of = first, models[0]
        for model in models[1:]:
            try:
                fit = self.again(model, first) if self.joins(first) else self._fit(model, self.begin)
            except FAILED:
                continue
            if self._rank(fit) < self._rank(best):
                best, of = fit, model
        return best, of, tried

    def _from_starts(self, model: Model) -> tuple[Fit, int]:
        """Return the best fit up to the first acceptable one, and the number of starts tried."""
        best: Fit | None = None
        tried, work = 0, 0.0
        for values in self._around(model.keys):
            tried += 1
            try:
                fit = self._fit(model, values)
            except FAILED:
                continue
            if best is None or self._rank(fit) < self._rank(best):
                best = fit
            work += fit.work
            if (fit.chi2 < self.limit(fit) and self.joins(fit)) or work > self.gates.work:
                break
        if best is None:
            raise InputError("the scene cannot be solved from the measurement; is it the right scene?")
        return best, tried

    def _fit(self, model: Model, values: Floats) -> Fit:
        """Fit from values of the keys, in all stages."""
        return fit(model, self.levels, values, self.settings, tick=self.tick)

    def _rank(self, fit: Fit) -> tuple[bool, float]:
        """Return the order of a fit: one motion first, then by chi-square."""
        return not self.joins(fit), fit.chi2

    def _around(self, keys: tuple[str, ...]) -> Iterator[Floats]:
        """Yield the given start, then a Sobol set around it."""
        begin, gates = self.begin, self.gates
        yield begin
        for point in qmc.Sobol(len(keys), seed=1).random(8)[1:gates.starts]:
            factors = np.where([k in OFFSETS for k in keys], 1.0, 1.0 + gates.spread * (2.0 * point - 1.0))
            values = begin * np.where([k in SHARES for k in keys], point, factors)
            if STATIC in keys and KINETIC in keys:
                at, other = keys.index(STATIC), keys.index(KINETIC)
                values[at] = on_its_side(values[at], values[other], 1.02, falls=begin[at] >= begin[other])
            yield values


@dataclass(frozen=True)
class Likelihood:
    """Profile likelihood of one parameter: the excess of the least chi-square while it is held."""

    key: str = field(metadata=reported("scene key"))
    values: Floats = field(metadata=reported("values at which it was held", "{key}"))
    excess: Floats = field(metadata=reported("least chi-square there over that of the fit"))


def profile_likelihood(model: Model, noise: dict[str, float], settings: FitSettings, best: Fit, key: str,
                       errors: Floats) -> Likelihood:
    """Return the least chi-square while `key` is held at values around its estimate and the others are fitted again."""
    at = model.keys.index(key)
    held = [k for k in model.keys if k != key]
    values = best.values[at] + errors[at] * np.linspace(-3.0, 3.0, 13)
    excess: NDArray[np.float64] = np.full(len(values), np.nan)
    samples = sum(len(r) for r in best.residuals.values())
    least = best.chi2 * max(samples - len(model.keys) - 3, 1)
    for i, value in enumerate(values):
        try:
            if key in OFFSETS:
                name = OFFSETS[key]
                inputs = {**model.measured.inputs}
                if name not in inputs:
                    continue
                inputs[name] = inputs[name] - value
                other = Model(model.system, tuple(held), replace(model.measured, inputs=inputs))
            else:
                other = Model(changed(model.system, {key: float(value)}), tuple(held), model.measured)
            again = fit(other, noise, np.delete(best.values, at), settings, settings.stages[-1:], best.starts)
        except (*FAILED, OutOfRange):
            continue
        excess[i] = again.chi2 * max(samples - len(held) - 3, 1) - least
    return Likelihood(key, values, excess)
