"""Residuals that are noise, white or coloured, and others, from measurements made by SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fig02_measured import FIG02, KEYS, ONCE, measured, moved
from scipy.signal import lfilter

from tcc_sim.estimation.identify import identify, why_no_noise
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import FitSettings, Gates, Model, fit
from tcc_sim.estimation.residuals import autoregression, judge_residuals, probability_of


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_intervals_cover_the_truth(colour: float) -> None:
    """The last stage from the truth on, for 4 draws of the noise: squared errors are their variances.

    Twenty numbers, of which five go together: where the counts of sub-steps were not held this was above 50; for noise
    whose values go together it was 3.3 as long as intervals were those of white noise.
    """
    _, states, _ = moved(0.3)
    truth, settings, squares = np.array(list(KEYS.values())), FitSettings(), []
    for seed in range(4):
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


@pytest.mark.parametrize(("what", "given"), [(name, "scale" in name) for name in MISFITS])
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
