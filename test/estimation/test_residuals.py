"""Residuals that are noise, white or coloured, and others, from measurements made by SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fig02_measured import FIG02, KEYS, ONCE, measured, moved
from scipy.signal import lfilter
from scipy.stats import chi2

from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import fit
from tcc_sim.estimation.residuals import (
    _correlations,
    _explanation,
    _hidden,
    _inverse_and_empty,
    _spread,
    autoregression,
    judge_residuals,
    probability_of,
)
from tcc_sim.estimation.settings import FitSettings, Gates
from tcc_sim.estimation.verdicts import why_no_noise
from tcc_sim.estimation.windows import Model


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_intervals_cover_the_truth(colour: float) -> None:
    """The last stage from the truth on, for 6 draws of the noise: squared errors are their variances.

    Thirty numbers, of which five go together: where the counts of sub-steps were not held this was above 50; for noise
    whose values go together it was 3.3 as long as intervals were those of white noise.
    """
    _, states, _ = moved(0.3)
    truth, settings, squares = np.array(list(KEYS.values())), FitSettings(), []
    for seed in range(6):
        data, noise = measured(100 + seed, 0.3, colour)
        model = Model(FIG02.system, tuple(KEYS), data)
        result = fit(model, noise, truth, settings, settings.stages[-1:], states[::100].copy())
        white, covariance = judge_residuals(model, noise, result, settings, False)
        squares.append((result.values - truth) ** 2 / np.diag(covariance))
        assert not why_no_noise(white, Gates())
        for name in ("slip_speed", "plate_speed"):
            assert white.correlation[name] == pytest.approx(colour, abs=0.2)
    assert 0.4 < np.mean(squares) < 2.0
    assert np.mean(np.array(squares) < 1.96**2) >= 0.84


def test_noise_and_what_is_none_are_told_apart() -> None:
    """Series whose autoregression is known; a line at twice the engine's frequency and a faint echo are no noise."""
    t, rng = moved(2.0)[0], np.random.default_rng(6)
    data = Measurement(t, {"slip_speed": np.sin(t)})
    model, white = Model(FIG02.system, (), data), rng.standard_normal(len(t))
    assert len(autoregression(white)) == 0
    coloured = lfilter([1.0], [1.0, -0.9, 0.5], white)
    assert autoregression(coloured) == pytest.approx([0.9, -0.5], abs=0.06)
    line = white + 0.15 * np.sin(2.0 * FIG02.system.engine.frequency * t)
    echo = white + 0.3 * np.roll(white, 15)
    for series, clean in ((white, True), (coloured, True), (line, False), (echo, False)):
        probability = probability_of(series, autoregression(series), model)
        assert (probability > 1e-2) == clean, probability
        assert (probability < 1e-4) != clean


MISFITS = {"the scale of slip_speed": ({"scale": 1.01}, {}, 0.01, 0.002),
           "the offset of slip_speed": ({"offset": 0.15}, {}, 0.15, 0.02),
           "the delay of plate_speed": ({"late": 3e-4}, {}, 3e-4, 5e-5),
           "driveline.flywheel_inertia": ({}, {"driveline.flywheel_inertia": 0.206}, -0.006, 0.001)}


@pytest.mark.parametrize(("what", "given"), [*((name, False) for name in MISFITS), ("the scale of slip_speed", True)])
def test_misfits_are_refused_with_what_would_explain_them(what: str, given: bool) -> None:
    """Parameters were up to 11 standard errors off, with a chi-square of 1.00: noise was what the fit had left."""
    changes, scene, amount, within = MISFITS[what]
    data, noise = measured(4)
    channels = dict(data.channels)
    channels["slip_speed"] = channels["slip_speed"] * changes.get("scale", 1.0) + changes.get("offset", 0.0)
    if "late" in changes:
        channels["plate_speed"] = np.interp(data.t - changes["late"], data.t, channels["plate_speed"])
    result = identify(Measurement(data.t, channels), KEYS, scene=FIG02.with_values(scene),
                      noise=noise if given else None, gates=replace(ONCE, beyond=1e3))
    assert not result.accepted
    assert result.whiteness.explanation.what == what
    assert result.whiteness.explanation.amount == pytest.approx(amount, abs=within)
    assert f"a change of {what}" in result.why
    assert result.scene.text() == FIG02.with_values(scene).text()


@pytest.mark.parametrize(("information", "result"), [(600.0, {}), (480.0, {"a": ("b", 0.1 * 480.0**0.5)}), (300.0, {})])
def test_a_fixed_key_hides_where_noise_covers_its_effect_and_it_moves_a_free_one(
        information: float, result: dict[str, tuple[str, float]]) -> None:
    """One of each with correlation 1/2: after a has followed, 20 % of b has an effect of 0.15 n with variance 0.75 n,
    and moves a by 0.1 sqrt(n) standard errors, which must be more than 2.
    """
    squares = information * np.array([[1.0, 0.5], [0.5, 1.0]])
    assert _hidden(squares, squares, ("a",), ["b"]) == {key: (name, pytest.approx(value))
                                                        for key, (name, value) in result.items()}


def test_a_fixed_key_that_hides_is_named() -> None:
    """The decay 20 % off: mu_s goes 20 standard errors off with it, and nothing in the residuals says so."""
    data, noise = measured(2, 0.3)
    result = identify(data, KEYS, scene=FIG02.with_values({"friction.decay": 2.4}), noise=noise)
    static, stiffness = result.parameters[0], result.parameters[3]
    assert abs(static.value - 0.3) > 8.0 * static.standard_error
    assert "if friction.decay is right" in static.why
    assert result.whiteness.hidden[static.key] == ("friction.decay", pytest.approx(
        abs(static.value - 0.3) / static.standard_error, rel=0.5))
    assert "friction.decay" not in stiffness.why
    assert abs(stiffness.value - 3000.0) < 4.0 * stiffness.standard_error


def test_without_noise_the_interval_is_that_of_the_tolerance() -> None:
    """Errors of the solver go together: mu_s was 15 standard errors off."""
    t, states, _ = moved()
    data = Measurement(t, {"slip_speed": states[:, 0], "plate_speed": states[:, 2]})
    result = identify(data, KEYS, scene=FIG02)
    assert result.accepted
    assert result.whiteness.exact
    for p in result.parameters:
        assert abs(p.value - KEYS[p.key]) < p.standard_error, p
        assert 1e-5 < p.standard_error / p.value < 0.05, p


KEPT = ("driveline.damping", "engine_torque.offset")
HELD = ["driveline.stiffness", "actuation_pressure.offset"]


def made(count: int = 400, columns: int = 5, seed: int = 3) -> np.ndarray:
    """Derivatives of residuals by keys and held quantities, (n, Q)."""
    return np.random.default_rng(seed).normal(size=(count, columns))


@pytest.mark.parametrize("colour", [0.0, 0.6, -0.4])
def test_the_variance_of_a_slope_is_that_of_correlated_noise(colour: float) -> None:
    """D^T R D with the correlations of an autoregression of first order, which are powers of its coefficient."""
    derivatives = np.cumsum(made(300, 3), axis=0)
    correlations = colour ** np.abs(np.subtract.outer(np.arange(300),
        np.arange(300))).astype(float) if colour else np.eye(300)
    noise = np.array([colour] if colour else [])
    exact = derivatives.T @ correlations @ derivatives
    assert _spread(derivatives, noise) == pytest.approx(exact, rel=2e-3, abs=2e-3 * np.abs(exact).max())
    assert _spread(derivatives[:3], noise) == pytest.approx(derivatives[:3].T @ correlations[:3, :3] @ derivatives[:3])


def test_correlations_are_those_of_the_deviations_from_the_mean() -> None:
    series = np.array([1.0, 3.0, 2.0, 6.0])   # -2, 0, -1, 3
    assert _correlations(series, 3).tolist() == pytest.approx([1.0, -3.0 / 14.0, 2.0 / 14.0, -6.0 / 14.0])
    assert _correlations(np.full(5, 2.0), 2).tolist() == [0.0, 0.0, 0.0]


def test_the_probability_of_noise_is_that_of_ljung_and_box_and_of_lines() -> None:
    """Of 20 lags, or a quarter of the samples, less those of the autoregression; lines only from four cycles on."""
    rng = np.random.default_rng(4)
    for count, noise in ((100, np.empty(0)), (60, np.array([0.5])), (3000, np.array([0.5, -0.2]))):
        series = lfilter([1.0], np.append(1.0, -noise), rng.standard_normal(count))
        left = series[len(noise):].copy()
        for k, factor in enumerate(noise):
            left -= factor * series[len(noise) - 1 - k:len(series) - 1 - k]
        n, lags = len(left), min(20, len(left) // 4)
        apart = left - left.mean()
        rho = np.array([apart[k:] @ apart[:-k] for k in range(1, lags + 1)]) / (apart @ apart)
        q = n * (n + 2.0) * np.sum(rho**2 / (n - np.arange(1, lags + 1)))
        expected = float(chi2.sf(q, lags - len(noise)))
        t = np.arange(count) * 1e-3
        if n * 1e-3 > 4.0 * FIG02.system.cycle:
            orders = [k for k in range(1, 13) if 150.0 * k < 0.5 * np.pi / 1e-3 + 75.0]
            power = sum(abs(np.exp(-150j * k * t[:n]) @ left) ** 2 for k in orders) / (0.5 * n * np.mean(left**2))
            expected = min(expected, float(chi2.sf(power, 2 * len(orders))))
        model = Model(FIG02.system, (), Measurement(np.arange(100) * 1e-3, {"slip_speed": np.sin(np.arange(100.0))}))
        assert probability_of(series, noise, model) == pytest.approx(expected, rel=1e-6)


def test_a_held_quantity_explains_residuals_by_one_step_of_all_free_keys_and_itself() -> None:
    """The one with the largest ratio to its standard error, a key by its value; without those of no effect or of the
    same effect as free keys.
    """
    derivatives = made()
    derivatives = np.column_stack([derivatives, derivatives[:, 0] + 2.0 * derivatives[:, 1], 0.0 * derivatives[:, 0]])
    left = derivatives[:, 3] * 0.4 + np.random.default_rng(5).normal(size=400)
    squares, slope = derivatives.T @ derivatives, derivatives.T @ left
    spread = derivatives.T @ (derivatives * np.linspace(0.5, 2.0, 400)[:, None])
    names = [("driveline.stiffness", "N m/rad"), ("engine_torque.offset", "N m"), ("the scale of slip_speed", "%"),
        ("same", ""),
             ("none", "")]
    values = np.array([0.6, 3.0, 3000.0, 0.0])
    found = []
    for place in (2, 3, 4):
        at = np.ix_(which := [0, 1, place], which)
        inverse = np.linalg.inv(squares[at])
        step = -inverse @ slope[which]
        found.append((step[-1], step[-1] / np.sqrt((inverse @ spread[at] @ inverse)[-1, -1])))
    best = _explanation(squares, slope, spread, 2, names, values)
    amount, errors = found[1]
    assert (best.what, best.unit, best.alike) == ("engine_torque.offset", "N m", ())
    assert (best.amount, best.errors) == (pytest.approx(amount), pytest.approx(errors))
    key = _explanation(squares, slope, spread, 2, names[:1], values)
    assert (key.what, key.amount, key.errors) == ("driveline.stiffness", pytest.approx(3000.0 * found[0][0]),
                                                  pytest.approx(
        found[0][1]))
    scale = _explanation(squares[np.ix_([0, 1, 4], [0, 1, 4])], slope[[0, 1, 4]], spread[np.ix_([0, 1, 4], [0, 1,
                         4])], 2, names[2:3],
                         values[:2])
    assert (scale.amount, scale.errors) == (pytest.approx(found[2][0]), pytest.approx(found[2][1]))
    twice = [0, 1, 3, 3, 2]
    alike = _explanation(squares[np.ix_(twice, twice)], slope[twice], spread[np.ix_(twice, twice)], 2,
                         [("a", ""), ("b", ""), ("c", "")], values[:2])
    assert (alike.what, alike.alike) == ("a", ("b",))
    assert _explanation(squares[5:, 5:], slope[5:], spread[5:, 5:], 1, names[4:], values[:1]) is None


def test_keys_in_directions_without_effect_are_unknown_and_the_others_keep_their_variance() -> None:
    derivatives = made()[:, :3]
    squares = derivatives.T @ derivatives * np.outer([1.0, 1e6, 1e-6], [1.0, 1e6, 1e-6])
    inverse, empty = _inverse_and_empty(squares, ("a", "b", "c"))
    exact = np.linalg.inv(derivatives.T @ derivatives)
    assert inverse * np.outer([1.0, 1e6, 1e-6], [1.0, 1e6, 1e-6]) == pytest.approx(exact)
    assert empty.tolist() == [False] * 3
    both = np.column_stack([derivatives[:, 0], derivatives[:, 1], 3.0 * derivatives[:, 0]])
    inverse, empty = _inverse_and_empty(both.T @ both, ("a", "b", "c"))
    assert empty.tolist() == [True, False, True]
    assert inverse[1, 1] == pytest.approx(np.linalg.inv(derivatives[:, :2].T @ derivatives[:, :2])[1, 1], rel=1e-6)
    curve = ("friction.curve.share_1", "b", "friction.curve.share_2")
    inverse, empty = _inverse_and_empty(both.T @ both, curve)
    assert empty.tolist() == [False] * 3
    assert inverse == pytest.approx(np.linalg.pinv(both.T @ both), abs=1e-9)
