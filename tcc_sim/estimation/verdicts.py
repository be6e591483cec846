"""Verdicts: whether a fit is acceptable, and a parameter is determined by both."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.measurement import Measurement, noise_of
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.residuals import HIDDEN, Whiteness, autoregression, probability_of
from tcc_sim.estimation.settings import FitSettings, Gates
from tcc_sim.estimation.windows import FREE, KINETIC, LEAST_RATIO, OFFSETS, STATIC, Model
from tcc_sim.model.parameters import QUANTITIES, System
from tcc_sim.result import reported
from tcc_sim.tables.chosen_columns import CHANNELS
from tcc_sim.trajectory import Floats

WITHIN = 1.959963984540054
"""Standard errors on either side of a 95 % interval."""
COARSEST = 10.0 * math.pi
"""Longest step between samples, in radians of the slipping driveline's oscillation."""


def check_sampling(measured: Measurement, system: System) -> None:
    """Raise InputError if samples are many periods of the driveline's oscillation apart."""
    if measured.step * system.natural_frequency > COARSEST:
        times = measured.step * system.natural_frequency / (2.0 * math.pi)
        raise InputError(f"{measured.source} has a sample every {measured.step:.4g} s, in which the driveline "
                         f"oscillates {times:.0f} times; if its times are in ms, say so with --columns t=COLUMN:ms")


@dataclass(frozen=True)
class Parameter:
    """One free parameter."""

    key: str = field(metadata=reported("scene key, or the offset of the sensor of an input"))
    start: float = field(metadata=reported("first value of the fit", "{key}"))
    value: float = field(metadata=reported("result", "{key}"))
    standard_error: float = field(metadata=reported("standard error", "{key}"))
    low: float = field(metadata=reported("lower end of the 95 % interval", "{key}"))
    high: float = field(metadata=reported("upper end", "{key}"))
    verdict: str = field(metadata=reported("identified, not identifiable, or at its bound"))
    why: str = field(metadata=reported("reason in a sentence"))


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
OF_NOISE = 5.0
"""Standard deviations of noise that do not show slip."""
BREAKAWAY = 1.5e-4
"""Longest time between samples that resolve the fall of friction just after breakaway, s."""


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
    if both and key in (STATIC, KINETIC) and max(ratio, 1.0 / ratio) <= LEAST_RATIO * (1.0 + 1e-9):
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
        try:
            best = min(best, (fit(turned, noise, start, settings).chi2, name))
        except (NumericalFailure, RuntimeError):
            continue
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
