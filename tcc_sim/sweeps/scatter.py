"""Scatter within tolerances: scrambled Sobol samples of scene keys, and quantiles of every result."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.orders import JudderFigures, OrdersAtSpeeds
from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, refuse_related, replace
from tcc_sim.model.quantity import MOST_VALUES, sequence_of_numbers
from tcc_sim.result import Result, reported, reported_of, reporting, result_class
from tcc_sim.scene import Scene, system_of
from tcc_sim.sweeps.results import SCALED, Course, Point, Sweep, check_effect, lists_of, stacked, varied
from tcc_sim.sweeps.simulation import Plan, with_plan_fields
from tcc_sim.sweeps.sweep import Curve, sweep_curves

PROBABILITIES = (0.05, 0.5, 0.95)
"""Default probabilities of quantiles."""
COUNTED = ("runaway", "not_settled")
"""Reasons for leaving a sample out of quantiles."""
NUMBERS = tuple(entry.name or name for kind in (Summary, Damping, JudderFigures)
                for name, entry in reported_of(kind).items() if entry.scatters)
"""Results that have quantiles; a truth value counts as 0 or 1."""


@result_class
class Tolerances:
    """Independent, uniform samples of scene keys within bounds.

    bounds : key, lowest and highest value
    samples : a power of 2 fills the bounds most evenly
    probabilities : of the quantiles, rising

    Raises InputError: a repeated key, bounds in the wrong order, or a number of samples out of its range.
    """

    bounds: tuple[tuple[str, float, float], ...]
    samples: int = reported("samples")
    seed: int = reported("seed of the samples", default=0)
    probabilities: tuple[float, ...] = reported("probabilities of the quantiles", default=PROBABILITIES)

    def __post_init__(self) -> None:
        keys = [key for key, _, _ in self.bounds]
        if not keys or len(set(keys)) < len(keys):
            raise InputError(f"scatter has the keys {', '.join(keys) or 'none'}; it must have one or more, each once")
        for key, low, high in self.bounds:
            if not low < high:
                raise InputError(f"scatter of {key} is {low:g} to {high:g}; the first must be below the second")
        if not 2 <= self.samples <= MOST_VALUES:
            raise InputError(f"samples is {self.samples}; it must be 2 to {MOST_VALUES}")
        if not 0 <= self.seed < 1 << 32:
            raise InputError(f"seed is {self.seed}; it must be 0 to {(1 << 32) - 1}")
        probabilities = self.probabilities
        if not probabilities or not all(0.0 <= p <= 1.0
                                        for p in probabilities) or list(probabilities) != sorted(set(probabilities)):
            raise InputError(f"quantiles are {', '.join(f'{p:g}' for p in probabilities) or 'none'}; they must be "
                             "probabilities from 0 to 1 that increase")

    @reporting("scattered keys with their lowest and highest value", "{*}")
    def scatter(self) -> dict[str, tuple[float, float]]:
        return {key: (low, high) for key, low, high in self.bounds}

    @reporting("values of the scattered keys in the order of samples", "{*}")
    def sampled(self) -> dict[str, NDArray[np.float64]]:
        """(samples,) values by key: a scrambled Sobol sequence (A. B. Owen (1998), ACM TOMACS 8, 71 to 102)."""
        from scipy.stats import qmc

        sequence = qmc.Sobol(len(self.bounds), scramble=True, seed=self.seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # It warns where the number is no power of 2.
            unit = sequence.random(self.samples)
        return {key: low + (high - low) * unit[:, k] for k, (key, low, high) in enumerate(self.bounds)}


@result_class(repr=False)
class Scattered(Result):
    """Results for scattered keys: one Sweep for each sample, over another key or at one value.

    over : key over which every sample is swept; empty for none
    sweeps : one for each sample, in order
    every : whether quantiles include samples that ran away or have not settled
    """

    tolerances: Tolerances = reported("what is scattered", spread=True)
    over: str
    sweeps: list[Sweep]
    every: bool = False

    def _text(self) -> str:
        keys = ", ".join(key for key, _, _ in self.tolerances.bounds)
        over = f" over {self.over}, {len(self.sweeps[0].points)} values" if self.over else ""
        return f"Scattered {keys}: {self.tolerances.samples} samples{over}"

    def result(self, name: str) -> NDArray[np.float64]:
        """Return one result, (samples, values); NaN for a missing one."""
        return np.array([sweep.column(name) for sweep in self.sweeps])

    def _unsteady(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which results, (samples, values), are those of a runaway and of a transient; a manoeuvre is none."""
        away, transient = self.result("runaway") == 1.0, self.result("transient") == 1.0
        manoeuvre = self.sweeps[0].curve.system.profile is not None
        return away, np.zeros_like(transient) if manoeuvre else transient

    @property
    def orders(self) -> OrdersAtSpeeds | None:
        """Orders of the first sample that has them."""
        return next((p.orders for s in self.sweeps for p in s.points if p is not None and p.orders is not None), None)

    @property
    def sampled(self) -> bool:
        """Whether judder was computed."""
        return any(p is not None and p.judder is not None for s in self.sweeps for p in s.points)

    def quantiles(self, name: str) -> NDArray[np.float64]:
        """Return the quantiles of one result over the samples, (values, probabilities); NaN without a sample.

        Unless `every`, they leave out samples that ran away or have not settled; the quantiles of `runaway` do not. A
        manoeuvre, whose scene has profiles, does not settle, and counts.
        """
        return np.moveaxis(self._quantiles(self.result(name), name), 0, -1)

    def _quantiles(self, values: NDArray[np.float64], name: str) -> NDArray[np.float64]:
        """Return the quantiles of results (samples, values, ...), (probabilities, values, ...)."""
        if not self.every and name != "runaway":
            left_out = np.logical_or(*self._unsteady())
            values = np.where(left_out.reshape(left_out.shape + (1,) * (values.ndim - 2)), np.nan, values)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # It warns where no sample has the result.
            return np.asarray(np.nanquantile(values, self.tolerances.probabilities, axis=0))

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of `Sweep` for all samples below each other, the scattered keys first."""
        length, sampled = len(self.sweeps[0].points), self.tolerances.sampled
        return {**{key: np.repeat(values, length) for key, values in sampled.items()},
                **{name: column for name, column in stacked(self.sweeps).items() if name not in sampled}}

    @reporting("results without part in quantiles: runaway, and not settled")
    def left_out(self) -> dict[str, int]:
        return dict(zip(COUNTED, (0 if self.every else int(mask.sum()) for mask in self._unsteady())))

    @reporting("quantiles of every result by probability; with over, a list per value", "{*}", name="quantiles")
    def all_quantiles(self) -> dict[str, NDArray[np.float64]]:
        lists = self.sweeps[0].lists
        return {name: self.quantiles(name)[slice(None) if self.over else 0] for name in NUMBERS if name in lists}

    @reporting(
        "those of slip_speed (rad/s) and shaft_torque (N m), by speed, order and probability; likewise", optional=True)
    def order_quantiles(self) -> dict[str, NDArray[np.float64]] | None:
        """Quantiles of `OrdersAtSpeeds`; None without orders."""
        orders = [[None if p is None else p.orders for p in sweep.points] for sweep in self.sweeps]
        if self.orders is None:
            return None
        shape = self.orders.slip_speed.shape
        out = {}
        for name in ("slip_speed", "shaft_torque"):
            values = np.array([[np.full(shape, np.nan) if each is None else getattr(each, name) for each in row]
                               for row in orders])
            out[name] = np.moveaxis(self._quantiles(values, name), 0, -1)[slice(None) if self.over else 0]
        return out

    @reporting("value swept over", spread=True, optional=True)
    def curve(self) -> Curve | None:
        """Curve over which every sample is swept; None for a single value."""
        return self.sweeps[0].curve if self.over else None

    @reporting("how it was done", spread=True)
    def course(self) -> Course:
        return self.sweeps[0].course_with(self.sweeps)

    @reporting(
        "the results in a list over the samples; with over, a list of them per value", spread=True, listed=True,
        of=(Point,))
    def lists(self) -> dict[str, list[Any]]:
        return {name: rows if self.over else [row[0] for row in rows] for name, rows in lists_of(self.sweeps).items()}


def scattering(system: System, bounds: Iterable[tuple[str, float, float]], samples: int, over: str = "",
               values: Sequence[float] = (), *, seed: int = 0, every: bool = False,
               quantiles: Sequence[float] = PROBABILITIES) -> tuple[list[Curve], Callable[[list[Sweep]], Scattered]]:
    """Return the curves of `scatter`, one for each sample: over another key, or at the sample's value of the first
    scattered key; and the function that makes its result of the solved ones.

    bounds : key, lowest and highest value
    samples : number of samples; best a power of 2
    over, values : another key over which every sample is swept
    seed : seed of the samples
    every : include samples that ran away or have not settled in the quantiles
    quantiles : probabilities of the quantiles, rising (default 0.05,0.5,0.95)

    Raises InputError: as `Tolerances`; `over` is scattered too, too many values, an unknown key, or a value out of its
    range.
    """
    tolerances = Tolerances(tuple(bounds), samples, seed, sequence_of_numbers("quantiles", quantiles))
    values, sampled, first = sequence_of_numbers(over, values), tolerances.sampled, tolerances.bounds[0][0]
    if over in sampled:
        raise InputError(f"{over} is swept and scattered; it must be one of the two")
    refuse_related([*sampled, over])
    for key in sampled:
        check_effect(system, key)
    if samples * max(len(values), 1) > MOST_VALUES:
        raise InputError(f"there are {samples} samples of {len(values)} values; there may be {MOST_VALUES}")
    curves = []
    for k in range(samples):
        sampled_values = {key: float(column[k]) for key, column in sampled.items() if over or key != first}
        factor = sampled_values.pop(SCALED, None)
        mine = replace(system, sampled_values)
        mine = mine if factor is None else varied(mine, SCALED, factor)
        curves.append(Curve(mine, over, values) if over else Curve(mine, first, (float(sampled[first][k]),)))
    return curves, lambda sweeps: Scattered(tolerances, over, sweeps, every)


@with_plan_fields
def scatter(scene: Scene | System | str, bounds: Mapping[str, tuple[float, float]], samples: int, *, seed: int = 0,
            over: str = "", values: Sequence[float] = (), every: bool = False,
            quantiles: Sequence[float] = PROBABILITIES, plan: Plan | None = None,
            jobs: int | None = None, dask: str | None = None, progress: bool = False, **settings: Any) -> Scattered:
    """Solve a scene with some keys scattered within bounds.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    bounds : scene key and the bounds of its tolerance; samples give quantiles of every result
    samples, seed, over, values, every, quantiles : as for `scattering`
    plan, jobs, dask, progress : as for `sweep`

    Raises
    ------
    InputError
        As `scattering`.

    Examples
    --------
    >>> result = scatter("slip", {"engine.torque_amplitude": (10.0, 20.0)}, 4, cycles=20)
    >>> result
    <Scattered engine.torque_amplitude: 4 samples>
    >>> result.quantiles("max_slip_speed").shape
    (1, 3)
    """
    curves, gathered = scattering(system_of(scene), [(key, float(low), float(high)) for key, (low, high)
                                                     in bounds.items()], samples, over, values, seed=seed, every=every,
                                  quantiles=quantiles)
    return gathered(sweep_curves(curves, Plan.of(plan, settings), jobs=jobs, dask=dask, progress=progress))
