"""`tcc-sim identify`: parameters of the driveline and of its friction law from a measurement, with their uncertainty.

Multiple shooting (`multiple_shooting`), repeated from a Sobol set of starts where the first fit fails, and with every
possible hold of the inputs for the best fit; the covariance of the parameters for the noise of the channels; and a
verdict for each parameter. A fit whose residuals exceed the noise is refused, and its parameters are no result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from tcc_sim.errors import InputError, NumericalFailure, OutOfRange
from tcc_sim.estimation.curve import CURVE, SHARES, IdentifiedCurve, curve_of, curve_starts, keys_of, refuse_parts
from tcc_sim.estimation.measurement import EXACT, MOST_SAMPLES, Measurement, measurement_in, noise_of, read_recording
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.residuals import Whiteness, judge_residuals
from tcc_sim.estimation.settings import FitSettings, Gates
from tcc_sim.estimation.verdicts import Parameter, check_sampling, judged, why_no_noise, why_not
from tcc_sim.estimation.windows import KINETIC, OFFSETS, STATIC, Model, check_key, on_its_side
from tcc_sim.model.parameters import QUANTITIES, values_of
from tcc_sim.model.parameters import replace as changed
from tcc_sim.model.supported_terms import check_supported
from tcc_sim.result import Result, reported
from tcc_sim.scene import Scene, SceneLike, as_scene
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.tables.chosen_columns import CHANNELS, is_table
from tcc_sim.tables.measured_table import HOLDS, looks_smooth, table_in
from tcc_sim.trajectory import Floats

FAILED = NumericalFailure, RuntimeError
"""Errors of a fit that leads nowhere; SciPy raises RuntimeError for a singular matrix."""


@dataclass(frozen=True)
class Likelihood:
    """Profile likelihood of one parameter: the excess of the least chi-square while it is held."""

    key: str = field(metadata=reported("scene key"))
    values: Floats = field(metadata=reported("values at which it was held", "{key}"))
    excess: Floats = field(metadata=reported("least chi-square there over that of the fit"))


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """Estimates of free parameters from a measurement.

    scene : with the estimates, if the fit is accepted
    measurement : the fitted data, with the hold of the best fit
    residuals : fitted minus measured values by channel
    """

    parameters: tuple[Parameter, ...] = field(metadata=reported(
        "free parameters, in order"))
    correlations: Floats = field(metadata=reported("of the parameters, (P, P)"))
    chi2_per_dof: float = field(metadata=reported(
        "chi-square per degree of freedom, for the noise given or estimated"))
    accepted: bool = field(metadata=reported("whether the fit is acceptable; if not, the parameters are no "
                                             "result"))
    why: str = field(metadata=reported("why not; empty if accepted"))
    noise: dict[str, float] = field(metadata=reported("standard deviation by channel", "{*}"))
    windows: int = field(metadata=reported("windows of the last stage"))
    starts: int = field(metadata=reported("starts that were tried"))
    seconds: float = field(metadata=reported("computing time", "s"))
    scene: Scene
    measurement: Measurement
    residuals: dict[str, Floats]
    whiteness: Whiteness = field(metadata=reported("tests of whether the residuals are noise"))
    hold: str | None = field(metadata=reported(
        "course of measured inputs between two samples: previous, linear, smooth or next", optional=True))
    likelihood: Likelihood | None = field(default=None, metadata=reported(
        "profile likelihood of one key", optional=True))
    curve: IdentifiedCurve | None = field(default=None, metadata=reported(
        "sliding friction over slip speed, if friction.curve was free", optional=True))
    warnings: tuple[str, ...] = field(default=(), metadata=reported(
        "sentences on what was converted, mended or left out"))

    def _text(self) -> str:
        estimates = ", ".join(f"{p.key} {p.value:.5g} +- {p.standard_error:.2g} ({p.verdict})" for p in self.parameters)
        return f"Identification: {'' if self.accepted else 'no fit, '}chi2/dof {self.chi2_per_dof:.3f}; {estimates}"

    def columns(self) -> dict[str, list[Any]]:
        """Return a row for each parameter."""
        return {name: [getattr(p, name) for p in self.parameters] for name in Parameter.__dataclass_fields__}


def identify(measured: Measurement | str | Path, free: Mapping[str, float | None] | Sequence[str], *,
             scene: SceneLike | None = None, noise: Mapping[str, float] | None = None,
             hold: Literal["previous", "linear", "smooth", "next"] | None = None,
             likelihood: str | None = None, settings: FitSettings | None = None, gates: Gates | None = None,
             joints: Mapping[str, str] | None = None, topic: str | None = None, driveline: int | None = None,
             columns: str | Mapping[str, str] | None = None, from_: float | None = None, to: float | None = None,
             progress: bool = False) -> Identification:
    """Estimate parameters of a scene from a measurement.

    Parameters
    ----------
    measured : a recording, a Measurement, or a table with those of the columns t, slip_speed, plate_speed, plate_angle,
        engine_torque, actuation_pressure that were measured (.csv or other text, .parquet, .mat, .mf4, .tdms)
    free : keys to estimate, each with its start (default: the scene's value; 0 for an offset); engine_torque.offset and
        actuation_pressure.offset are offsets of the sensors; friction.curve[=N] is the friction coefficient over slip
        speed as a constant and N exponentials (default 2)
    scene : scene, system, name or file with the keys that are not free and the inputs that were not measured (default:
        the recording's scene)
    noise : standard deviations of the channels, rad/s or rad, such as slip_speed=0.1,plate_speed=0.1 (default:
        estimated from the signal)
    hold : measured input between two samples: value of the previous one, linear, smooth (lines that keep the amplitudes
        of sines), or value of the next one (default: as the measurement says, else the one that fits best)
    likelihood : add the profile likelihood of a free key
    joints : names of the two joints in a recording of another program
    topic : topic of the joint states to read, if several were recorded
    driveline : number of the driveline to read, counted from 0 as in --json (default: one with a scene, on the shortest
        topic, and there the latest to start)
    columns : columns of a table by the name of the signal, with their units if the table does not give them
    from_ : part of a table from this time on, s
    to : part of a table up to this time, s
    progress : show iterations on a terminal or in a notebook, elsewhere a line a minute

    Raises
    ------
    InputError
        A key that cannot be identified, a start out of its range, noise that is not a number above 0, a measurement
        that cannot be used, or the set-valued law.

    Examples
    --------
    >>> import numpy as np, tcc_sim
    >>> from tcc_sim.estimation.measurement import Measurement
    >>> run = tcc_sim.closed_loop("minimal", lambda reading: None, seconds=0.4)
    >>> noise = 0.05 * np.random.default_rng(1).standard_normal((2, len(run.t)))
    >>> speeds = {"slip_speed": run.slip_speed + noise[0], "plate_speed": run.plate_speed + noise[1]}
    >>> measured = Measurement(run.t, speeds)
    >>> result = tcc_sim.identify(measured, {"driveline.stiffness": 3200.0}, scene="minimal")
    >>> result.accepted, round(result.parameters[0].value, -1)
    (True, 3000.0)
    """
    began = time.perf_counter()
    settings, gates = settings or FitSettings(), gates or Gates()
    measured, scene = given(measured, None if scene is None else as_scene(scene), columns, from_, to, joints=joints,
                            topic=topic, driveline=driveline)
    check_sampling(measured, scene.system)
    starts = _starts(scene, free, measured, likelihood)
    levels, begin = _noise(measured, noise), np.array(list(starts.values()))
    models = [Model(scene.system, tuple(starts), replace(measured, hold=each)) for each in _holds(measured, hold)]
    with progress_bar("iteration", shown=progress) as bar:
        search = _Search(begin, levels, not set(noise or ()) >= set(levels), len(measured.t) * len(levels), settings,
                        gates, bar.update)
        best, model, tried = search.best(models)
        chi2, limit, exact = best.chi2, search.limit(best), False
        fits = chi2 < limit and search.joins(best)
        if fits and search.guessed:   # Residuals tell the noise better than the signal.
            levels, exact = _noise_of_residuals(measured, best)
            best = search.again(model, best, levels)
    white, covariance = judge_residuals(model, levels, best, settings, exact)
    why = why_no_noise(white, gates) if fits else why_not(best, model, begin, levels, limit, gates, settings)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = np.isfinite(errors)
    best = replace(best, values=np.where(known, best.values, begin))
    correlations, block = np.eye(len(errors)), np.ix_(known, known)
    correlations[block] = covariance[block] / np.outer(errors[known], errors[known])
    shown = [i for i, key in enumerate(model.keys) if not key.startswith(CURVE)]
    curve = profile = None
    if len(shown) < len(model.keys):
        slip = best.residuals["slip_speed"]
        slip = model.measured.channels["slip_speed"][:len(slip)] + slip
        curve = curve_of(model.keys, best.values, covariance, slip, model.system.friction)
    if likelihood is not None and not why:
        profile = _profile_likelihood(model, levels, settings, best, likelihood, errors)
    return Identification(
        tuple(judged(model, i, float(begin[i]), best, errors, correlations, not why, gates,
                     white.hidden.get(model.keys[i])) for i in shown),
        correlations[np.ix_(shown, shown)], chi2, not why, why, levels, len(best.starts), tried,
        time.perf_counter() - began, scene if why else _with_estimates(scene, model, best, curve), model.measured,
        best.residuals, white, model.measured.hold, profile, curve, measured.notes)


@dataclass(frozen=True)
class _Search:
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
                values[at] = on_its_side(values[at], values[other], begin[at] >= begin[other], 1.02)
            yield values


def _profile_likelihood(model: Model, noise: dict[str, float], settings: FitSettings, best: Fit, key: str,
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


def _noise_of_residuals(measured: Measurement, best: Fit) -> tuple[dict[str, float], bool]:
    """Return the rms of the residuals by channel, not below the solver's precision, and whether all are at it."""
    least = {name: EXACT * float(np.abs(column).max()) for name, column in measured.channels.items()}
    left = {name: float(np.sqrt(np.mean(column**2))) for name, column in best.residuals.items()}
    return {name: max(left[name], least[name]) for name in left}, all(left[name] <= least[name] for name in left)


def _with_estimates(scene: Scene, model: Model, best: Fit, curve: IdentifiedCurve | None) -> Scene:
    estimates = {key: value for key, value in zip(model.keys, best.values.tolist())
                 if key not in OFFSETS and not key.startswith(CURVE)}
    return scene.with_values({**estimates, **({} if curve is None else curve.table())})


def given(measured: Measurement | str | Path, scene: Scene | None = None,
          columns: str | Mapping[str, str] | None = None, start: float | None = None, end: float | None = None,
          **driveline: Any) -> tuple[Measurement, Scene]:
    """Return the measurement in a table's file or a recording, and its scene (default: the recording's), or raise
    InputError. `driveline` selects a driveline of the recording.

    columns, start, end : of a table, see `tables.measured_table.table_in`, and the part that is used, s
    """
    if not isinstance(measured, Measurement):
        path = Path(measured)
        if is_table(path):
            measured = measurement_in(table_in(path, ("slip_speed",), MOST_SAMPLES, columns).part(start, end))
        elif columns is not None or start is not None or end is not None:
            raise InputError(f"--columns, --from and --to are for tables, and {path} is a recording")
        else:
            measured, recorded_scene = read_recording(path, scene, **driveline)
            scene = scene or recorded_scene
    if scene is None:
        raise InputError("no scene is given for the table; give one (--scene)")
    return measured, scene


def _starts(scene: Scene, free: Mapping[str, float | None] | Sequence[str], measured: Measurement,
            likelihood: str | None) -> dict[str, float]:
    """Return the start of every free key; raise InputError for wrong keys and starts, and for the set-valued law."""
    requested = dict(free) if isinstance(free, Mapping) else dict.fromkeys([free] if isinstance(free, str) else free)
    if not requested:
        raise InputError("no key is free; name at least one")
    values, out = dict(values_of(scene.system)), {}
    refuse_parts(requested, scene.system.friction)
    if CURVE in requested:
        out = curve_starts(scene.system, measured, keys_of(requested.pop(CURVE)))
    for key, start in requested.items():
        check_key(key)
        if start is None:
            start = 0.0 if key in OFFSETS else values[key]
        out[key] = float(start)  # type: ignore[arg-type]
        if key in OFFSETS:
            continue
        QUANTITIES[key].check(key, out[key])
        if out[key] <= 0.0:
            raise InputError(f"{key} begins at {out[key]:g} {QUANTITIES[key].unit}; the start must be above 0")
    kinetic = out.get(KINETIC, values[KINETIC])
    if STATIC in out:
        out[STATIC] = on_its_side(out[STATIC], float(kinetic))  # type: ignore[arg-type]
    scene.with_values({k: out[k] for k in requested if k not in OFFSETS})
    if likelihood is not None and likelihood not in out:
        raise InputError(f"likelihood is {likelihood}; it must be one of the free keys")
    if scene.system.friction.law != "smoothed":
        raise InputError(f"friction.law is {scene.system.friction.law}; parameters are identified with smoothed, whose "
                         "limit for a large friction.smoothing it is")
    check_supported("tick derivatives", scene.system, "identification")
    return out


def _noise(measured: Measurement, given: Mapping[str, float] | None) -> dict[str, float]:
    for name, value in (given or {}).items():
        if name not in CHANNELS:
            raise InputError(f"noise of {name!r} was given; channels are {', '.join(CHANNELS)}")
        if not 0.0 < value < math.inf:
            raise InputError(f"the noise of {name} is {value:g} {CHANNELS[name]}; it must be a number above 0")
    return {name: float((given or {}).get(name, 0.0)) or noise_of(column) for name, column in measured.channels.items()}


def _holds(measured: Measurement, hold: str | None) -> tuple[str | None, ...]:
    """Return the possible holds of the measured inputs: the one given or stated, or else all."""
    if hold is not None and hold not in HOLDS:
        raise InputError(f"hold is {hold!r}; it must be {', '.join(HOLDS[:-1])} or {HOLDS[-1]}")
    if not measured.inputs:
        return (None,)
    known = hold or measured.hold
    if known is not None:
        return (known,)
    # The first one is fitted from several starts.
    first = "smooth" if all(map(looks_smooth, measured.inputs.values())) else HOLDS[0]
    return tuple(sorted(HOLDS, key=lambda each: each != first))
