"""Tests of whether the residuals of a fit are noise, and the parameters' covariance for this noise.

Noise may be coloured: an autoregression of each channel's residuals (G. E. P. Box, G. M. Jenkins and G. C. Reinsel,
Time Series Analysis, 2008, Chapter 7) gives their correlations, and these the covariance of least squares for noise
that is not white (H. White, Econometrica 48, 1980). The residuals of the autoregression must be white: without
correlation up to some lags (G. M. Ljung and G. E. P. Box, Biometrika 65, 1978) and without lines at multiples of the
engine's frequency. A score test (C. R. Rao, 1948) for each held quantity, such as a fixed key or a sensor's scale, must
not explain the residuals.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter
from scipy.stats import chi2

from tcc_sim.estimation.curve import CONSTANT, CURVE
from tcc_sim.estimation.multiple_shooting import (
    FREE,
    LINEAR,
    OFFSETS,
    Fit,
    FitSettings,
    Model,
    MultipleShooting,
    largest_errors,
)
from tcc_sim.model.groups import TABULATED
from tcc_sim.model.parameters import QUANTITIES, values_of
from tcc_sim.result import reported, result_class
from tcc_sim.tables.chosen_columns import CHANNELS
from tcc_sim.trajectory import Floats

LONGEST_AUTOREGRESSION = 4  # Longest autoregression of residuals, samples.
LONGEST_MEMORY = 200  # Longest correlation of the noise, samples.
LAGS = 20  # Correlations of the residuals of the autoregression in one test, samples.
ENGINE_LINES = 12  # Multiples of the engine's frequency that are tested in them.
SHORTEST_SHOWN = 4.0  # Shortest measurement for this test, periods of excitation.
UNSEEN = 4.0  # Standard errors up to which residuals do not show an error of a fixed key.
MOVED = 2.0  # Standard errors by which such a key must move a free one to be named.
UNITS = {"engine_torque.offset": "N m", "actuation_pressure.offset": "Pa"}
EMPTY, PART = 1e-12, 1e-3
"""Information about a direction of the free keys, relative to that about single ones, that is rounding; and the least
component of a key in such a direction.
"""
HIDDEN = 0.2  # Relative error of a fixed key that residuals should show.


@result_class
class Explanation:
    """Change of a held quantity that would explain residuals."""

    what: str = reported("key, or offset, scale or delay of a channel")
    amount: float = reported("its size")
    unit: str = reported("its unit; % is relative")
    errors: float = reported("the change over its standard error")
    alike: tuple[str, ...] = reported("others that would explain them as well, within 1 of chi-square", default=())


@result_class
class Whiteness:
    """Tests of whether residuals are noise."""

    correlation: dict[str, float] = reported("by channel, correlation of residuals one sample apart")
    p_value: dict[str, float] = reported(
        "by channel, least probability of the residuals after their autoregression, if they were noise")
    explanation: Explanation | None = reported("change of a held quantity that explains most")
    hidden: dict[str, tuple[str, float]] = reported(
        "by free key the fixed key that it depends on most, and by how many standard errors 20 % of the latter move it")
    exact: bool = reported("whether the residuals are below the precision of the real-time solver")


def judge_residuals(model: Model, levels: dict[str, float], fit: Fit, settings: FitSettings,
                    exact: bool) -> tuple[Whiteness, Floats]:
    """Test whether the residuals of a fit are noise, and compute the covariance of the parameters for this noise.

    levels : standard deviation of the noise by channel in the fit
    exact : whether the only noise is the error of the real-time solver. Such errors do not average out: the covariance
        is then that of perfectly correlated errors.

    The variance of a key about which the measurement holds nothing, by itself or together with others, is infinite; the
    others are judged without it.
    """
    curve = CONSTANT in model.keys or model.system.friction.curve is not None
    others = [key for key in FREE if key not in model.keys and not (curve and key in TABULATED)]
    fixed = dict(values_of(model.system)) | dict.fromkeys(OFFSETS, 0.0)
    values = np.append(fit.values, [float(fixed[key]) for key in others])   # type: ignore[arg-type]
    last = settings.stages[-1]
    problem = MultipleShooting(replace(model, keys=(*model.keys, *others)), levels, settings, last.window)
    residuals, derivatives, squares, slope = problem.explained(values, fit.starts, last.weight)
    # A value near 0 is known by its own error, not by that of its logarithm.
    largest = np.maximum(largest_errors(model.keys), [model.effect(key) / max(abs(value), 1e-300)
                                                      for key, value in zip(model.keys, fit.values)])
    known = np.sqrt(np.maximum(np.diag(squares)[:len(model.keys)], 0.0)) * largest >= 1.0
    kept = np.flatnonzero(np.append(known, np.ones(len(squares) - len(known), dtype=bool)))
    derivatives, squares, slope = derivatives[..., kept], squares[np.ix_(kept, kept)], slope[kept]
    values, keys = values[kept[kept < len(values)]], tuple(key for key, is_known in zip(model.keys, known) if is_known)
    size, count = len(keys), len(residuals)
    names = [*((key, UNITS.get(key) or QUANTITIES[key].unit) for key in others),
             *((f"the {kind} of {name}", unit or CHANNELS[name]) for name in problem.channels
               for kind, unit in (("offset", ""), ("scale", "%"), ("delay", "s"))),
             *((f"the {kind} of {name}", unit) for name in model.measured.inputs
               for kind, unit in (("scale", "%"), ("delay", "s")))]
    noise = [autoregression(residuals[:, i]) for i in range(len(problem.channels))]
    spread = sum((_spread(derivatives[:, i], each) for i, each in enumerate(noise)), np.zeros_like(squares))
    scale = np.where([key in LINEAR for key in keys], 1.0, values[:size])
    inverse, empty = _inverse_and_empty(squares[:size, :size], keys)

    def covariance(of: Floats) -> Floats:
        """Return the covariance of all free keys, from that of those with an effect."""
        out = np.diag(np.where(known, 0.0, math.inf))
        of = of * np.outer(scale, scale)
        of[empty], of[:, empty] = 0.0, 0.0
        out[np.ix_(known, known)] = of + np.diag(np.where(empty, math.inf, 0.0))
        return out

    if exact:
        return (Whiteness(dict.fromkeys(problem.channels, 0.0), dict.fromkeys(problem.channels, 1.0), None, {}, True),
                covariance(count * inverse))
    explanation = _explanation(squares, slope, spread, size, names, values)
    series = dict(zip(problem.channels, residuals.T))
    white = Whiteness({name: float(_correlations(each, 1)[1]) for name, each in series.items()},
                      {name: probability_of(each, by, model) for (name, each), by in zip(series.items(), noise)},
                      explanation, _hidden(squares, spread, keys, others), False)
    return white, covariance(inverse @ spread[:size, :size] @ inverse)


def _inverse_and_empty(squares: Floats, keys: tuple[str, ...]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the inverse of the keys' normal equations, and the keys in directions without an effect.

    Exponentials of a curve with nearly equal rates are interchangeable: that changes the numbers, but not the curve.
    """
    curve = np.array([key.startswith(CURVE) for key in keys], dtype=bool)
    if curve.any():
        return np.asarray(np.linalg.pinv(squares, rcond=1e-11, hermitian=True)), np.zeros(len(keys), dtype=bool)
    root = np.sqrt(np.diag(squares))
    sizes, vectors = np.linalg.eigh(squares / np.outer(root, root))
    kept = sizes > EMPTY
    empty = np.asarray((np.abs(vectors[:, ~kept]) > PART).any(axis=1))
    inverse: Floats = vectors[:, kept] / sizes[kept] @ vectors[:, kept].T / np.outer(root, root)
    return inverse, empty


def _correlations(series: Floats, lags: int) -> Floats:
    """Return the autocorrelation of a series, (lags + 1,)."""
    series = series - series.mean()
    out = np.array([series[:len(series) - k] @ series[k:] for k in range(lags + 1)])
    return np.asarray(out / max(out[0], 1e-300))


def autoregression(series: Floats) -> Floats:
    """Return the coefficients of a series by its previous values, as many as Bayes' criterion selects."""
    n, correlations = len(series), _correlations(series, LONGEST_AUTOREGRESSION)
    best, least = np.empty(0), 0.0
    for order in range(1, LONGEST_AUTOREGRESSION + 1):
        factors = solve_toeplitz(correlations[:order], correlations[1:order + 1])
        left = 1.0 - float(factors @ correlations[1:order + 1])
        if left > 0.0 and n * math.log(left) + order * math.log(n) < least:
            best, least = factors, n * math.log(left) + order * math.log(n)
    return best


def _spread(derivatives: Floats, noise: Floats) -> Floats:
    """Return the variance (Q, Q) of the slope of a sum of squares with (n, Q) derivatives, for an autoregression."""
    answer = lfilter([1.0], np.append(1.0, -noise), np.eye(1, LONGEST_MEMORY)[0])
    covariances = np.correlate(answer, answer, "full")[len(answer) - 1:]
    covariances /= covariances[0]
    out = derivatives.T @ derivatives
    for lag in range(1, min(len(derivatives), LONGEST_MEMORY)):
        if abs(covariances[lag:]).max() < 1e-4:
            break
        shifted = covariances[lag] * derivatives[lag:].T @ derivatives[:-lag]
        out = out + shifted + shifted.T
    return np.asarray(out)


def probability_of(residuals: Floats, noise: Floats, model: Model) -> float:
    """Return the least probability that noise has so much correlation, and so much of the engine's frequencies."""
    left = lfilter(np.append(1.0, -noise), [1.0], residuals)[len(noise):]
    n, lags = len(left), min(LAGS, len(left) // 4)
    correlations = _correlations(left, lags)[1:]
    portmanteau = n * (n + 2.0) * float(np.sum(correlations**2 / (n - np.arange(1.0, lags + 1.0))))
    least = float(chi2.sf(portmanteau, max(lags - len(noise), 1)))
    base, step = model.system.engine.frequency, model.measured.step
    orders = np.arange(1.0, min(0.5 * math.pi / step / base, ENGINE_LINES) + 0.5)
    if len(orders) and n * step > SHORTEST_SHOWN * model.system.cycle:
        waves = np.exp(-1j * np.outer(orders * base, step * np.arange(n)))
        power = np.abs(waves @ left) ** 2 / (0.5 * n * float(np.mean(left**2)))
        least = min(least, float(chi2.sf(power.sum(), 2 * len(orders))))
    return least


def _explanation(squares: Floats, slope: Floats, spread: Floats, size: int, names: list[tuple[str, str]],
                 values: Floats) -> Explanation | None:
    """Return the change of a held quantity with the largest ratio to its standard error, by one Gauss-Newton step."""
    explanations: list[Explanation] = []
    for place, (name, unit) in enumerate(names, size):
        of = np.ix_(which := [*range(size), place], which)
        sizes = np.diag(squares)[which]
        if not (sizes > 0.0).all():
            continue
        root = np.sqrt(sizes)
        inverse, rank = _inverse(squares[of] / np.outer(root, root))
        if rank <= size:   # Free keys already have the same effect.
            continue
        change = -inverse @ (slope[which] / root)
        variance = float((inverse @ (spread[of] / np.outer(root, root)) @ inverse)[-1, -1])
        if variance <= 0.0:   # The same up to rounding.
            continue
        error = math.sqrt(variance)
        amount = float(change[-1] / root[-1])
        if place < len(values) and name not in OFFSETS:
            amount *= float(values[place])
        explanations.append(Explanation(name, amount, unit, float(change[-1] / error)))
    if not explanations:
        return None
    best = max(explanations, key=lambda each: abs(each.errors))
    return replace(best, alike=tuple(each.what for each in explanations if each is not best and
                                     each.errors**2 > best.errors**2 - 1.0))


def _hidden(squares: Floats, spread: Floats, keys: tuple[str, ...], others: list[str]) -> dict[str, tuple[str, float]]:
    """Return `Whiteness.hidden`: fixed keys whose change by HIDDEN stays within UNSEEN standard errors."""
    size, out = len(keys), dict.fromkeys(keys, ("", MOVED))
    root = np.sqrt(np.diag(squares)[:size])
    if not (root > 0.0).all() or not keys:
        return {}
    inverse = _inverse(squares[:size, :size] / np.outer(root, root))[0] / np.outer(root, root)
    errors = np.sqrt(np.diag(inverse @ spread[:size, :size] @ inverse))
    for place, name in enumerate(others, size):
        if name in OFFSETS:
            continue
        follow = -inverse @ squares[:size, place]
        alone = np.append(follow, 1.0)   # Effect of the key after the free ones have followed it.
        which = np.ix_(near := [*range(size), place], near)
        left = float(alone @ squares[which] @ alone)
        if HIDDEN * left > UNSEEN * math.sqrt(max(float(alone @ spread[which] @ alone), 0.0)):
            continue
        for key, shift, error in zip(keys, follow, errors):
            if HIDDEN * abs(shift) > out[key][1] * error:
                out[key] = (name, float(HIDDEN * abs(shift) / error))
    return {key: hidden for key, hidden in out.items() if hidden[0]}


def _inverse(matrix: Floats) -> tuple[Floats, int]:
    """Return the inverse of a scaled symmetric matrix, and its rank."""
    sizes, vectors = np.linalg.eigh(matrix)
    kept = sizes > 1e-9 * sizes[-1]
    return vectors[:, kept] / sizes[kept] @ vectors[:, kept].T, int(kept.sum())
