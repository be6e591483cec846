"""`tcc-sim identify`: parameters of the driveline and of its friction law from a measurement, with their uncertainty.

Multiple shooting (`multiple_shooting`), repeated from a Sobol set of starts where the first fit fails, and with every
possible hold of the inputs for the best fit; the covariance of the parameters for the noise of the channels; and a
verdict for each parameter. A fit whose residuals exceed the noise is refused, and its parameters are no result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from tcc_sim.errors import InputError
from tcc_sim.estimation.curve import CURVE, SHARES, IdentifiedCurve, curve_of, curve_starts, keys_of, refuse_parts
from tcc_sim.estimation.measurement import EXACT, MOST_SAMPLES, Measurement, measurement_in, noise_of, read_recording
from tcc_sim.estimation.multiple_shooting import (
    FAILED,
    FREE,
    KINETIC,
    OFFSETS,
    STATIC,
    Fit,
    FitSettings,
    Gates,
    Model,
    check_key,
    fit,
    least_ratio,
    on_its_side,
)
from tcc_sim.estimation.residuals import HIDDEN, Whiteness, autoregression, judge_residuals, probability_of
from tcc_sim.model.equations import check_supported
from tcc_sim.model.parameters import QUANTITIES, System, values_of
from tcc_sim.model.parameters import replace as changed
from tcc_sim.result import Result, reported, result_class
from tcc_sim.scene import Scene, SceneLike, as_scene
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.tables.chosen_columns import CHANNELS, is_table
from tcc_sim.tables.measured_table import HOLDS, looks_smooth, table_in
from tcc_sim.trajectory import Floats


@result_class
class Likelihood:
    """Profile likelihood of one parameter: the excess of the least chi-square while it is held."""

    key: str = reported("scene key")
    values: Floats = reported("values at which it was held", "{key}")
    excess: Floats = reported("least chi-square there over that of the fit")


@result_class(repr=False)
class Identification(Result):
    """Estimates of free parameters from a measurement.

    scene : with the estimates, if the fit is accepted
    measurement : the fitted data, with the hold of the best fit
    residuals : fitted minus measured values by channel
    """

    parameters: tuple[Parameter, ...] = reported("free parameters, in order")
    correlations: Floats = reported("of the parameters, (P, P)")
    chi2_per_dof: float = reported("chi-square per degree of freedom, for the noise given or estimated")
    accepted: bool = reported("whether the fit is acceptable; if not, the parameters are no result")
    why: str = reported("why not; empty if accepted")
    noise: dict[str, float] = reported("standard deviation by channel", "{*}")
    windows: int = reported("windows of the last stage")
    starts: int = reported("starts that were tried")
    seconds: float = reported("computing time", "s")
    scene: Scene
    measurement: Measurement
    residuals: dict[str, Floats]
    whiteness: Whiteness = reported("tests of whether the residuals are noise")
    hold: str | None = reported(
        "course of measured inputs between two samples: previous, linear, smooth or next", optional=True)
    likelihood: Likelihood | None = reported("profile likelihood of one key", optional=True, default=None)
    curve: IdentifiedCurve | None = reported(
        "sliding friction over slip speed, if friction.curve was free", optional=True, default=None)
    warnings: tuple[str, ...] = reported("sentences on what was converted, mended or left out", default=())

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
        topic, and there the latest run or, without names of runs, the most states)
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
    if not why:
        estimates = {key: value for key, value in zip(model.keys, best.values.tolist())
                     if key not in OFFSETS and not key.startswith(CURVE)}
        scene = scene.with_values({**estimates, **({} if curve is None else curve.table())})
    return Identification(
        tuple(judged(model, i, float(begin[i]), best, errors, correlations, not why, gates,
                     white.hidden.get(model.keys[i])) for i in shown),
        correlations[np.ix_(shown, shown)], chi2, not why, why, levels, len(best.starts), tried,
        time.perf_counter() - began, scene, model.measured,
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
            with suppress(*FAILED):
                fit = self.again(model, first) if self.joins(first) else self._fit(model, self.begin)
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
    samples, inputs = sum(len(r) for r in best.residuals.values()), model.measured.inputs
    least = best.chi2 * max(samples - len(model.keys) - 3, 1)
    for i, value in enumerate(values):
        with suppress(*FAILED):
            other = replace(model, keys=tuple(held))
            if key not in OFFSETS:
                other = replace(other, system=changed(model.system, {key: float(value)}))
            elif (name := OFFSETS[key]) in inputs:
                other = replace(other, measured=replace(
                    model.measured, inputs={**inputs, name: inputs[name] - value}))
            else:
                continue
            again = fit(other, noise, np.delete(best.values, at), settings, settings.stages[-1:], best.starts)
            excess[i] = again.chi2 * max(samples - len(held) - 3, 1) - least
    return Likelihood(key, values, excess)


def _noise_of_residuals(measured: Measurement, best: Fit) -> tuple[dict[str, float], bool]:
    """Return the rms of the residuals by channel, not below the solver's precision, and whether all are at it."""
    least = {name: EXACT * float(np.abs(column).max()) for name, column in measured.channels.items()}
    left = {name: float(np.sqrt(np.mean(column**2))) for name, column in best.residuals.items()}
    return {name: max(left[name], least[name]) for name in left}, all(left[name] <= least[name] for name in left)


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
        out[STATIC] = on_its_side(out[STATIC], float(kinetic), ratio=least_ratio(out))  # type: ignore[arg-type]
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


WITHIN = 1.959963984540054  # Standard errors on either side of a 95 % interval.
COARSEST = 10.0 * math.pi  # Longest step between samples, in radians of the slipping driveline's oscillation.


def check_sampling(measured: Measurement, system: System) -> None:
    """Raise InputError if samples are many periods of the driveline's oscillation apart."""
    if measured.step * system.natural_frequency > COARSEST:
        times = measured.step * system.natural_frequency / (2.0 * math.pi)
        raise InputError(f"{measured.source} has a sample every {measured.step:.4g} s, in which the driveline "
                         f"oscillates {times:.0f} times; if its times are in ms, say so with --columns t=COLUMN:ms")


@result_class
class Parameter:
    """One free parameter."""

    key: str = reported("scene key, or the offset of the sensor of an input")
    start: float = reported("first value of the fit", "{key}")
    value: float = reported("result", "{key}")
    standard_error: float = reported("standard error", "{key}")
    low: float = reported("lower end of the 95 % interval", "{key}")
    high: float = reported("upper end", "{key}")
    verdict: str = reported("identified, not identifiable, or at its bound")
    why: str = reported("reason in a sentence")


def judged(model: Model, i: int, start: float, fit: Fit, errors: Floats, correlations: Floats, accepted: bool,
           gates: Gates, hidden: tuple[str, float] | None = None) -> Parameter:
    """Judge one parameter; `hidden` is a fixed key on which it depends, see `residuals.Whiteness`."""
    keys = model.keys
    key, value, error = keys[i], float(fit.values[i]), float(errors[i])
    low, high = value - WITHIN * error, value + WITHIN * error
    others = np.abs(correlations[i]).copy()
    others[i] = 0.0
    most = int(np.argmax(others)) if len(keys) > 1 else i
    least = gates.negligible * model.effect(key)
    none = abs(value) + WITHIN * error <= least
    relative = error / max(abs(value), 1e-300)
    verdict, why = "identified", f"the 95 % interval reaches {100.0 * WITHIN * relative:.3g} % to either side"
    if none:
        why = f"the 95 % interval reaches to {abs(value) + WITHIN * error:.2g}; up to {least:.2g} it has no effect here"
    if key in OFFSETS:
        relative, why = error / _size(model, OFFSETS[key]), "an offset, with its 95 % interval"
    if not accepted:
        verdict, why = "not identifiable", "the fit is refused"
    elif not math.isfinite(error):
        verdict = "not identifiable"
        why = f"the measurement holds nothing about it, so it keeps its start; {_determined_by(model, key)}"
    elif _at_bound(model, i, fit.values, errors) and error <= gates.relative * max(abs(value), _scale_of(model, key)):
        verdict, why = "at its bound", "the fit ends at the largest or smallest allowed value"
        if key in (STATIC, KINETIC):
            why += "; if mu_s and mu_k meet, a start with a smaller value of the larger one leads to the other side"
    elif not none and (relative > gates.relative or others[most] > gates.correlated):
        verdict = "not identifiable"
        why = f"its standard error is {100.0 * relative:.3g} %"
        if others[most] > 0.9:
            why += f", and it depends on {keys[most]} (correlation {correlations[i, most]:.3f})"
        why += f"; {_determined_by(model, key)}"
    elif hidden is not None:
        why += (f", if {hidden[0]} is right: residuals would not show an error of {100.0 * HIDDEN:g} % in it, which "
                f"moves this by {hidden[1]:.2g} standard errors")
    return Parameter(key, start, value, error, low, high, verdict, why)


DETERMINED_BY = {
    "friction.decay": "samples at 10 kHz would determine it: they show slip just after breakaway",
    "friction.static_coefficient": "samples at 10 kHz, or a fixed friction.decay, would determine it",
    "friction.smoothing": "samples within the layer |v| < 2/sigma, at a higher rate or in a slower passage, would "
                          "determine it",
    "driveline.flywheel_inertia": "the flywheel's speed, or a known change of the mean torque, would determine it"}
"""Measurement that would determine a parameter."""
DETERMINED_BY_FAST = DETERMINED_BY | {
    "friction.decay": "more breakaways, or a fixed friction.static_coefficient, would determine it",
    "friction.static_coefficient": "more breakaways, or a fixed friction.decay, would determine it"}
"""The same for samples at 10 kHz."""
OF_SLIP = (*(key for key in FREE if key.startswith(("friction.", "converter."))), "actuation_pressure.offset")
"""Keys without effect in stick."""
FALLING, FALLEN = (STATIC, "friction.decay"), 1e3
"""Keys whose effect decays with slip speed, and the factor after which it counts as gone."""
OF_NOISE = 5.0  # Standard deviations of noise that do not show slip.
BREAKAWAY = 1.5e-4  # Longest time between samples that resolve the fall of friction just after breakaway, s.


AT_BOUND = 1e-9
"""Largest distance from an end of a range at which a value counts as at it, relative to the end or to the scene's own
value: the end may be 0.
"""


def _size(model: Model, name: str) -> float:
    """Return the largest value of an input, N m or Pa."""
    system = model.system
    means_and_amplitudes = {"engine_torque": (system.engine.mean_torque, system.engine.torque_amplitude),
                            "actuation_pressure": (system.pressure.mean, system.pressure.amplitude)}[name]
    return float(np.abs(model.measured.inputs.get(name, np.array(means_and_amplitudes))).max()) or 1.0


def _determined_by(model: Model, key: str) -> str:
    """Return the measurement that would determine a key, after what slip and what step between samples this one has."""
    measured, friction = model.measured, model.system.friction
    equal = friction.static_coefficient == friction.kinetic and not {STATIC, KINETIC} & {*model.keys}
    if equal and key == "friction.decay":
        return "it has no effect, since friction.static_coefficient and friction.kinetic_coefficient are equal"
    slip = measured.channels["slip_speed"]
    slowest = 0.0 if slip.min() < 0.0 < slip.max() else float(np.abs(slip).min())
    reach = {"friction.smoothing": 2.0 / friction.smoothing,
             **dict.fromkeys(FALLING, math.log(FALLEN) / max(friction.decay, 1e-300))}.get(key, math.inf)
    if slowest > reach:
        return f"slip below {reach:.3g} rad/s would determine it; the slowest here is {slowest:.3g} rad/s"
    fastest = float(np.abs(slip).max()) - OF_NOISE * noise_of(slip)
    if key in OF_SLIP and fastest < 2.0 / friction.smoothing:
        return "slip would determine it; here the clutch sticks throughout"
    sentences = DETERMINED_BY if measured.step > BREAKAWAY else DETERMINED_BY_FAST
    return sentences.get(key, "a longer measurement would determine it, or one with larger motion")


def _at_bound(model: Model, i: int, values: Floats, errors: Floats) -> bool:
    """Return whether a value is at an end of its range; mu_s and mu_k, free or not, bound each other unless one of them
    is unknown.
    """
    key, value = model.keys[i], float(values[i])
    if key in OFFSETS:
        return False
    named = dict(zip(model.keys, values))
    friction = model.system.friction
    ratio = named.get(STATIC, friction.static_coefficient) / named.get(KINETIC, friction.kinetic_coefficient)
    both = all(math.isfinite(error) for other, error in zip(model.keys, errors) if other in (STATIC, KINETIC))
    if both and key in (STATIC, KINETIC) and max(ratio, 1.0 / ratio) <= least_ratio(model.keys) * (1.0 + 1e-9):
        return True
    quantity = QUANTITIES[key]
    return (value <= quantity.low + AT_BOUND * max(abs(quantity.low), _scale_of(model, key))
            or value >= quantity.high - AT_BOUND * abs(quantity.high))


def _scale_of(model: Model, key: str) -> float:
    """Return the size of the scene's own value of a key, which tells what is large where an end of its range is 0."""
    return abs(float(attrgetter(key)(model.system)))


def why_no_noise(white: Whiteness, gates: Gates) -> str:
    """Return the reason why the residuals of a fit are not noise, in a sentence; empty if they are."""
    what = white.explanation
    if what is not None and abs(what.errors) > gates.explained:
        by = f"{100.0 * what.amount:.3g} %" if what.unit == "%" else f"{what.amount:.3g} {what.unit}".rstrip()
        do = "mend the measurement" if " of " in what.what else "free it, or give its true value"
        alike = f", and so would one of {' or '.join(what.alike)}" if what.alike else ""
        return (f"the residuals are not noise: a change of {what.what} by {by} would explain them "
                f"({abs(what.errors):.3g} standard errors){alike}; {do}")
    least = min(white.p_value, key=lambda name: white.p_value[name])
    if white.p_value[least] >= gates.white:
        return ""
    return (f"the residuals of {least} are not noise (their probability is {white.p_value[least]:.2g}): the scene does "
            "not explain the measurement")


def why_not(found: Fit, model: Model, start: Floats, noise: dict[str, float], limit: float, gates: Gates,
            settings: FitSettings) -> str:
    """Return sentences against a fit whose chi-square exceeds its limit or whose windows do not join.

    Each reason is tried before it is named: the noise by the residuals, a sign by a fit with the column turned, and the
    engine's speed by the drift of the data's phase against that of the fitted motion.
    """
    if found.chi2 < limit:
        return ("the windows fit, but do not join to one motion: the fit did not converge; try other starts, or a part "
                "of the measurement.")
    out = (f"chi-square per degree of freedom is {found.chi2:.3g}, above {limit:.3g}: the scene does not explain the "
           "measurement.")
    shares = {name: float(np.sqrt(np.mean(r**2))) / noise[name] for name, r in found.residuals.items()}
    most = max(shares, key=lambda name: shares[name])
    if shares[most] <= gates.louder and all(probability_of(r, autoregression(r), model) >= gates.white
                                            for r in found.residuals.values()):
        return (f"{out} The residuals are noise, {shares[most]:.3g} times that of {most}, {noise[most]:.4g} "
                f"{CHANNELS[most]}: give {shares[most] * noise[most]:.4g}, or none to have it estimated.")
    reasons = _turned(found, model, start, noise, gates, settings) or _drift(found, model, gates)
    return f"{out}{reasons} Most of it is in {most}, whose residuals are {shares[most]:.3g} times its noise."


def _turned(found: Fit, model: Model, start: Floats, noise: dict[str, float], gates: Gates,
            settings: FitSettings) -> str:
    """Return a sentence if the scene explains the measurement with the sign of a column turned; else empty."""
    measured, best = model.measured, (gates.turned * found.chi2, "")
    for name in (*measured.channels, *measured.inputs):
        if name == "actuation_pressure":
            continue   # It is never below 0.
        channels, inputs = ({each: -values if each == name else values for each, values in columns.items()}
                            for columns in (measured.channels, measured.inputs))
        turned = replace(model, measured=replace(measured, channels=channels, inputs=inputs))
        with suppress(*FAILED):
            best = min(best, (fit(turned, noise, start, settings).chi2, name))
    return f" With the sign of {best[1]} turned it is {best[0]:.3g}: turn it." if best[1] else ""


def _drift(found: Fit, model: Model, gates: Gates) -> str:
    """Return a sentence if the measured motion's phase drifts against the scene's engine other than the fitted one's.

    A measured torque has the engine's speed in it.
    """
    measured, engine, cycle = model.measured, model.system.engine, model.system.cycle
    if ("engine_torque" in measured.inputs or engine.source == "topic" or engine.torque_amplitude == 0.0
            or measured.t[-1] - measured.t[0] < 8.0 * cycle):
        return ""
    name = "plate_speed" if "plate_speed" in measured.channels else "slip_speed"
    left = found.residuals[name]
    data, t = measured.channels[name][:len(left)], measured.t[:len(left)]
    part = min(round(max(int(len(t) // 4 * measured.step / cycle), 1) * cycle / measured.step), len(t))
    turned = []
    for signal in (data, data + left):
        wave = (signal - signal.mean()) * np.exp(-1j * engine.frequency * t)
        first, last = wave[:part].mean(), wave[-part:].mean()
        if min(abs(first), abs(last)) < 0.2 * float(np.std(signal)):
            return ""
        turned.append(float(np.angle(last / first)))
    more = (turned[0] - turned[1] + math.pi) % (2.0 * math.pi) - math.pi
    span = float(t[-part:].mean() - t[:part].mean())
    if abs(more) <= gates.drift:
        return ""
    return (f" The motion's phase drifts by {more:.3g} rad within {span:.3g} s against that of the fit: the engine ran "
            f"at another speed than engine.frequency, {engine.frequency:.6g} rad/s, or the clocks differ.")
