"""`tcc-sim identify`: parameters of the driveline and of its friction law from a measurement, with what they are worth.

A fit by multiple shooting (`multiple_shooting`), restarted from a Sobol set where it is none; the covariance of the
parameters for the noise of the channels; and for every parameter a verdict. A fit whose residuals are larger than the
noise is refused as one: its parameters are then no result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.curve import CURVE, SHARES, IdentifiedCurve, curve_of, curve_starts, keys_of, refuse_parts
from tcc_sim.estimation.likelihood import Likelihood, profile_likelihood
from tcc_sim.estimation.measurement import Measurement, noise_of, read_recording, read_table
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.residuals import Whiteness, judge_residuals
from tcc_sim.estimation.settings import DEFAULTS, FitSettings, Gates
from tcc_sim.estimation.units import check_units
from tcc_sim.estimation.verdicts import Parameter, judged, why_no_noise, why_not
from tcc_sim.estimation.windows import KINETIC, OFFSETS, STATIC, Model, check_key, on_its_side
from tcc_sim.model.parameters import QUANTITIES, values_of
from tcc_sim.recording.table import CHANNELS, HOLDS
from tcc_sim.result import Result, reported
from tcc_sim.scene import Scene, SceneLike, as_scene
from tcc_sim.trajectory import Floats


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """What a measurement says of the free parameters.

    scene : with the values found, where the fit is accepted
    measurement, residuals : what was fitted, and by how much it differs, by channel
    """

    parameters: tuple[Parameter, ...] = field(metadata=reported(
        "free parameters in the order that they were asked for"))
    correlations: Floats = field(metadata=reported("correlations of the parameters, (P, P)"))
    chi2_per_dof: float = field(metadata=reported(
        "chi-square per degree of freedom of the residuals over the noise, as it was given or as the signals show it"))
    accepted: bool = field(metadata=reported("whether it is a fit; where it is none the parameters are no result"))
    why: str = field(metadata=reported("what speaks against the fit; empty where it is one"))
    noise: dict[str, float] = field(metadata=reported("standard deviation by channel", "{*}"))
    windows: int = field(metadata=reported("number of windows of the last stage"))
    starts: int = field(metadata=reported("number of fits that were tried"))
    seconds: float = field(metadata=reported("computing time", "s"))
    scene: Scene
    measurement: Measurement
    residuals: dict[str, Floats]
    whiteness: Whiteness = field(metadata=reported("whether the residuals are noise"))
    hold: str | None = field(metadata=reported(
        "measured inputs between two samples: previous, linear or next", asked_for=True))
    likelihood: Likelihood | None = field(default=None, metadata=reported(
        "profile likelihood of one key", asked_for=True))
    curve: IdentifiedCurve | None = field(default=None, metadata=reported(
        "sliding friction over slip speed, where friction.curve was free", asked_for=True))

    def _text(self) -> str:
        found = ", ".join(f"{p.key} {p.value:.5g} +- {p.standard_error:.2g} ({p.verdict})" for p in self.parameters)
        return f"Identification: {'' if self.accepted else 'no fit, '}chi2/dof {self.chi2_per_dof:.3f}; {found}"

    def columns(self) -> dict[str, list[Any]]:
        """A row for every parameter, as ``pandas.DataFrame`` and ``polars.DataFrame`` take it."""
        return {name: [getattr(p, name) for p in self.parameters] for name in Parameter.__dataclass_fields__}


def identify(measured: Measurement | str | Path, free: Mapping[str, float | None] | Sequence[str], *,
             scene: SceneLike | None = None, noise: Mapping[str, float] | None = None, hold: str | None = None,
             likelihood: str | None = None, settings: FitSettings | None = None, gates: Gates | None = None,
             tick: Callable[[], None] | None = None) -> Identification:
    """Free parameters of a scene from a measurement.

    Parameters
    ----------
    measured : a Measurement, a table's file (.csv, `measurement.read_table`), or a recording
    free : keys of `windows.FREE`, each with its start (None: the scene's value; 0 for an offset); friction.curve, with
        the number of its exponentials (None: 2)
    scene : scene, system, name or file: what is not free, and what inputs were not measured; a recording has its own
    noise : standard deviation by channel, rad/s or rad; what is absent is estimated from the signal
    hold : one of `recording.table.HOLDS`, how a measured input goes on between two samples; None takes what the
        measurement says of itself, or the one that fits best
    likelihood : key whose profile likelihood is wanted
    tick : called after every iteration

    Raises
    ------
    InputError
        A key that cannot be identified, a start out of its range, noise that is no number above 0, a measurement that
        cannot be used, or the set-valued law.

    Examples
    --------
    >>> import numpy as np, tcc_sim
    >>> from tcc_sim.estimation.measurement import Measurement
    >>> run = tcc_sim.closed_loop("minimal", lambda reading: None, seconds=0.4)
    >>> noise = 0.05 * np.random.default_rng(1).standard_normal((2, len(run.t)))
    >>> speeds = {"slip_speed": run.slip_speed + noise[0], "plate_speed": run.plate_speed + noise[1]}
    >>> measured = Measurement(run.t, speeds)
    >>> found = tcc_sim.identify(measured, {"driveline.stiffness": 3200.0}, scene="minimal")
    >>> found.accepted, round(found.parameters[0].value, -1)
    (True, 3000.0)
    """
    began = time.perf_counter()
    settings, gates = settings or FitSettings(), gates or Gates()
    measured, scene = given(measured, None if scene is None else as_scene(scene))
    starts = _starts(scene, free, measured)
    keys = tuple(starts)
    _check(scene, keys, likelihood)
    levels = _noise(measured, noise)
    begin = np.array(list(starts.values()))
    limits = _limits(measured, levels, noise, gates)
    holds = _holds(measured, hold)
    check_units(Model(scene.system, keys, replace(measured, hold=holds[0])), begin, settings)
    best, model, tried = _best_held([Model(scene.system, keys, replace(measured, hold=each)) for each in holds], levels,
                                    begin, limits, settings, gates, tick)
    measured = model.measured
    chi2, joined, exact = best.chi2, best.gap <= gates.gap, False
    limit = limits(best)
    if chi2 < limit and joined and not _all_given(levels, noise):   # Residuals tell the noise better than the signal.
        levels, exact = _noise_of_residuals(measured, best)
        best = fit(model, levels, best.values, settings, settings.stages[-1:], best.starts, tick)
    white, covariance = judge_residuals(model, levels, best, settings, exact)
    why = why_not(best, model, begin, levels, chi2, limit, gates) if chi2 >= limit or not joined \
        else why_no_noise(white, gates)
    accepted, shown = not why, [i for i, k in enumerate(keys) if not k.startswith(CURVE)]
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    correlations = covariance / np.outer(errors, errors)
    named: dict[str, object] = {keys[i]: float(best.values[i]) for i in shown if keys[i] not in OFFSETS}
    curve = None
    if len(shown) < len(keys):
        slip = measured.channels["slip_speed"][:len(best.residuals["slip_speed"])] + best.residuals["slip_speed"]
        curve = curve_of(keys, best.values, covariance, slip, scene.system.friction)
        named |= curve.table() if accepted else {}
    profile = None
    if likelihood is not None and accepted:
        profile = profile_likelihood(model, levels, settings, best, likelihood, errors)
    return Identification(
        tuple(judged(model, i, float(begin[i]), best, errors, correlations, accepted, gates,
                     white.hidden.get(keys[i])) for i in shown),
        correlations[np.ix_(shown, shown)], chi2, accepted, why, levels, len(best.starts), tried,
        time.perf_counter() - began,
        scene.with_values(named) if accepted else scene, measured, best.residuals, white, measured.hold,
        profile, curve)


def _check(scene: Scene, keys: tuple[str, ...], likelihood: str | None) -> None:
    """InputError for a likelihood of what is not free, and for a law whose parameters are not identified."""
    if likelihood is not None and likelihood not in keys:
        raise InputError(f"the likelihood of {likelihood} was asked for; it must be one of the free keys")
    if scene.system.friction.law != "smoothed":
        raise InputError(f"friction.law is {scene.system.friction.law}; parameters are identified with smoothed, whose "
                         "limit for a large friction.smoothing it is")


def _all_given(levels: Mapping[str, float], noise: Mapping[str, float] | None) -> bool:
    """Whether the noise of every channel was given."""
    return set(noise or ()) >= set(levels)


def _limits(measured: Measurement, levels: Mapping[str, float], noise: Mapping[str, float] | None,
            gates: Gates) -> Callable[[Fit], float]:
    """The largest chi-square a degree of freedom of a fit: its distribution's, and that of an estimate of the noise."""
    samples = len(measured.t) * len(levels)
    guessed = 0.0 if _all_given(levels, noise) else gates.guessed**2 / samples
    return lambda found: 1.0 + gates.beyond * math.sqrt(2.0 / found.freedom + guessed)


def _noise_of_residuals(measured: Measurement, best: Fit) -> tuple[dict[str, float], bool]:
    """Standard deviation of what a fit leaves, by channel: at least what counts as exact; and whether all are."""
    least = {name: DEFAULTS.exact * float(np.abs(column).max()) for name, column in measured.channels.items()}
    left = {name: float(np.sqrt(np.mean(column**2))) for name, column in best.residuals.items()}
    return {name: max(left[name], least[name]) for name in left}, all(left[name] <= least[name] for name in left)


def given(measured: Measurement | str | Path, scene: Scene | None = None) -> tuple[Measurement, Scene]:
    """The measurement in a table's file or in a recording, and the scene that it is of: the recording's own by default.

    Raises
    ------
    InputError
        A measurement that cannot be used, or a table without a scene.
    """
    if not isinstance(measured, Measurement):
        path = Path(measured)
        if path.suffix == ".csv":
            measured = read_table(path)
        else:
            measured, own = read_recording(path)
            scene = scene or own
    if scene is None:
        raise InputError("a table says nothing of its scene; give one (--scene)")
    return measured, scene


def _starts(scene: Scene, free: Mapping[str, float | None] | Sequence[str], measured: Measurement) -> dict[str, float]:
    """The start of every free key, checked."""
    asked = dict(free) if isinstance(free, Mapping) else dict.fromkeys([free] if isinstance(free, str) else free)
    if not asked:
        raise InputError("no key is free; name at least one")
    values, out = dict(values_of(scene.system)), {}
    refuse_parts(asked, scene.system.friction)
    if CURVE in asked:
        out = curve_starts(scene.system, measured, keys_of(asked.pop(CURVE)))
    for key, start in asked.items():
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
        out[STATIC] = on_its_side(out[STATIC], float(kinetic), DEFAULTS.least_ratio)  # type: ignore[arg-type]
    scene.with_values({k: out[k] for k in asked if k not in OFFSETS})
    return out


def _noise(measured: Measurement, given: Mapping[str, float] | None) -> dict[str, float]:
    """Standard deviation of every measured channel."""
    for name, value in (given or {}).items():
        if name not in CHANNELS:
            raise InputError(f"noise of {name!r} was given; channels are {', '.join(CHANNELS)}")
        if not 0.0 < value < math.inf:
            raise InputError(f"the noise of {name} is {value:g} {CHANNELS[name]}; it must be a number above 0")
    return {name: float((given or {}).get(name, 0.0)) or noise_of(column) for name, column in measured.channels.items()}


def _holds(measured: Measurement, hold: str | None) -> tuple[str | None, ...]:
    """What a measured input may be between two samples, as told; all that it could be where nothing is."""
    if hold is not None and hold not in HOLDS:
        raise InputError(f"hold is {hold!r}; it must be {', '.join(HOLDS[:-1])} or {HOLDS[-1]}")
    if not measured.inputs:
        return (None,)
    known = hold or measured.hold
    return HOLDS if known is None else (known,)


def _best_held(models: list[Model], levels: dict[str, float], begin: Floats, limits: Callable[[Fit], float],
               settings: FitSettings, gates: Gates, tick: Callable[[], None] | None) -> tuple[Fit, Model, int]:
    """The best fit of the first model, and of the others from there; its model, and how many starts were tried."""
    best, tried = _best(models[0], levels, begin, limits, settings, gates, tick)
    out = best, models[0], tried
    for model in models[1:]:
        try:
            if best.gap <= gates.gap:
                found = fit(model, levels, best.values, settings, settings.stages[-1:], best.starts, tick)
            else:
                found = fit(model, levels, begin, settings, tick=tick)
        except (NumericalFailure, RuntimeError):
            continue
        if (found.gap > gates.gap, found.chi2) < (out[0].gap > gates.gap, out[0].chi2):
            out = found, model, tried
    return out


def _best(model: Model, levels: dict[str, float], begin: Floats, limits: Callable[[Fit], float], settings: FitSettings,
          gates: Gates, tick: Callable[[], None] | None) -> tuple[Fit, int]:
    """The best of the fits from starts around `begin`, up to the first one below the limit, and how many were tried."""
    best: Fit | None = None
    tried, work = 0, 0.0
    for values in _around(model.keys, begin, gates):
        tried += 1
        try:
            found = fit(model, levels, values, settings, tick=tick)
        except (NumericalFailure, RuntimeError):   # RuntimeError: SciPy met a singular matrix.
            continue
        if best is None or (found.gap > gates.gap, found.chi2) < (best.gap > gates.gap, best.chi2):
            best = found
        work += found.work
        if (found.chi2 < limits(found) and found.gap <= gates.gap) or work > gates.work:
            break
    if best is None:
        raise InputError("the scene cannot be solved from what was measured; is it the right scene?")
    return best, tried


def _around(keys: tuple[str, ...], begin: Floats, gates: Gates) -> list[Floats]:
    """The starts of the fits: the one given, then a Sobol set around it."""
    points = qmc.Sobol(len(keys), seed=1).random(8)[1:gates.starts]
    out = [begin]
    for point in points:
        factors = np.where([k in OFFSETS for k in keys], 1.0, 1.0 + gates.spread * (2.0 * point - 1.0))
        values = begin * np.where([k in SHARES for k in keys], point, factors)
        if STATIC in keys and KINETIC in keys:
            at = keys.index(STATIC)
            other = keys.index(KINETIC)
            values[at] = on_its_side(values[at], values[other], 1.02, falls=begin[at] >= begin[other])
        out.append(values)
    return out
