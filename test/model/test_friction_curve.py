"""Friction tables against the curves that they were taken from, and where the smoothed law peaks."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tcc_sim.errors import InputError
from tcc_sim.model.friction import peak, smoothed_coefficient, stick_speed
from tcc_sim.model.friction_curve import FrictionCurve, fit_curve
from tcc_sim.model.groups import Friction
from tcc_sim.model.parameters import System, replace

V = np.linspace(0.0, 60.0, 61)
SHAPES = {  # coefficients, and the largest error that a fit may have
    "constant": (0.0 * V + 0.12, 1e-12),
    "falling": (0.24 * (1.0 + 0.25 * np.exp(-2.0 * V)), 1e-6),
    "rising": (0.14 - 0.02 * np.exp(-0.3 * V), 1e-6),
    "falling as a logarithm": (0.15 - 0.008 * np.log1p(V / 0.5), 8e-4),
    "dip": (0.14 * (1.0 - 0.12 * np.exp(-0.05 * V)) + 0.02 * np.exp(-1.5 * V), 1e-6),
    "hump": (0.13 + 0.02 * np.exp(-(((V - 8.0) / 6.0) ** 2)), 0.03),
    "lines": (np.interp(V, [0.0, 2.0, 5.0, 20.0, 60.0], [0.16, 0.135, 0.13, 0.14, 0.142]), 0.015),
}


@cache
def fit(shape):
    """The fit of one of the SHAPES."""
    return fit_curve(tuple(V), tuple(SHAPES[shape][0]))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_fit_is_as_near_as_it_says(shape):
    (mu, allowed), curve = SHAPES[shape], fit(shape)
    error = np.abs(curve.at(V) - mu) / mu.max()
    assert error.max() <= allowed
    assert curve.error == pytest.approx(error.max(), abs=1e-12)
    assert error[curve.worst == V] == pytest.approx(error.max(), abs=1e-12)
    assert np.abs(curve.amplitudes).sum() < 10.0 * mu.max()
    differences = (curve.at(V[1:] + 1e-5) - curve.at(V[1:] - 1e-5)) / 2e-5
    np.testing.assert_allclose(curve.slope(V[1:]), differences, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_beyond_the_table_friction_stays_near_the_last_coefficient(shape):
    """Within 20 % of the range of the coefficients, and one way."""
    mu, curve = SHAPES[shape][0], fit(shape)
    near = 0.2 * np.ptp(mu) + curve.error * mu.max() + 1e-12
    for times in (1.0, 1.5, 3.0, 100.0):
        assert abs(curve.at(times * 60.0) - mu[-1]) <= near
    beyond = np.diff(curve.at(60.0 * np.geomspace(1.0, 100.0, 500)) + np.zeros(500))
    assert min(beyond.clip(0.0).sum(), -beyond.clip(None, 0.0).sum()) <= 1e-3 * np.ptp(mu)


MEASURED = np.array([0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0])


@pytest.mark.parametrize(("law", "count", "seed", "noise"), [
    (0.1 + 0.03 * (1.0 - np.exp(-MEASURED / 20.0)), 1, 2, 2e-3),
    (0.13 + 0.03 * np.exp(-MEASURED / 5.0), 1, 1, 5e-4), (0.0 * MEASURED + 0.12, 0, 2, 2e-3),
    (0.14 * (1.0 - 0.3 * np.exp(-0.02 * MEASURED)) + 0.04 * np.exp(-0.8 * MEASURED), 2, 1, 5e-4)])
def test_the_fit_follows_the_law_and_not_the_noise(law, count, noise, seed):
    """Noise of 0.4 and 1.5 %; the slope has the law's sign wherever the law is steeper than the noise."""
    mu = law + noise * np.random.default_rng(seed).normal(size=len(law))
    curve = fit_curve(tuple(MEASURED), tuple(mu))
    assert len(curve.rates) == count
    assert np.abs(curve.at(MEASURED) - law).max() < 3.0 * noise
    v = np.geomspace(1e-3, 3e3, 2000)
    slope = curve.slope(v)
    if count == 1:
        assert (slope * np.sign(law[-1] - law[0]) >= 0.0).all()
    assert np.count_nonzero(np.diff(np.sign(slope))) == max(count - 1, 0)


@pytest.mark.parametrize(("law", "sign", "seed"), [
    (lambda v: 0.1 + 0.03 * (1.0 - np.exp(-v / 20.0)), 1.0, 1), (lambda v: 0.1 + 0.006 * np.log1p(v), -1.0, 2),
    (lambda v: 0.02 / (1.0 + np.exp(-(v - 20.0) / 5.0)) + 0.11, 1.0, 1)])
def test_a_table_that_rises_or_falls_throughout_has_a_fit_that_does(law, sign, seed):
    mu = law(MEASURED) + 5e-4 * np.random.default_rng(seed).normal(size=len(MEASURED))
    mu = np.sort(mu) if sign > 0.0 else 0.3 - np.sort(mu)
    curve = fit_curve(tuple(MEASURED), tuple(mu))
    assert (sign * curve.slope(np.geomspace(1e-3, 3e3, 2000)) >= -1e-12).all()
    rates = np.array(curve.rates)
    assert (rates[:-1] / rates[1:] >= 1.5).all()
    assert np.abs(curve.amplitudes).sum() < 10.0 * mu.max()


def test_between_its_points_a_curve_is_hardly_steeper_than_they_are():
    # Best through these points go two exponentials that are eight times too steep before the third point.
    v = np.array([0.0, 1.695, 10.778, 11.075, 15.282, 23.452, 45.663, 52.434])
    mu = np.array([0.14079, 0.11907, 0.11856, 0.11846, 0.11896, 0.11949, 0.12074, 0.12097])
    curve, widths, lines = fit_curve(tuple(v), tuple(mu)), np.diff(v), np.diff(mu) / np.diff(v)
    noise = max(np.sqrt(np.mean((curve.at(v) - mu) ** 2)), 1e-3 * mu.max())
    for k in range(len(lines)):
        near = slice(max(k - 1, 0), k + 2)
        room = noise / (widths[near].sum() + (widths[k] if k in (0, len(lines) - 1) else 0.0))
        slopes = curve.slope(np.linspace(v[k], v[k + 1], 200))
        assert slopes.max() <= 5.0 * max(lines[near].max(), 0.0) + 1.001 * room
        assert slopes.min() >= 5.0 * min(lines[near].min(), 0.0) - 1.001 * room


def test_the_error_between_the_points_is_that_from_a_monotone_interpolation():
    v, mu = (0.0, 20.0, 40.0, 60.0), (0.3, 0.2, 0.19, 0.189)
    curve = fit_curve(v, mu)
    at = np.linspace(0.0, 60.0, 25)
    apart = np.abs(curve.at(at) - PchipInterpolator(v, mu)(at)) / 0.3
    assert curve.error < 1e-3
    assert curve.error_between == pytest.approx(apart.max(), rel=1e-9)
    assert at[apart.argmax()] == curve.worst_between
    assert curve.fastest == 60.0
    doubt, = Friction(slip_speeds=v, coefficients=mu).doubts
    assert "away from a monotone interpolation at 5 rad/s, between two points, more than 2%" in doubt


@pytest.mark.parametrize(("law", "last", "count"), [(lambda x: np.log1p(20.0 * x) / np.log(21.0), 20.0, 6),
                                                   (lambda x: x, 20.0, 4)])
def test_a_rising_table_sticks_as_one_without_slope_does(law, last, count):
    v = np.linspace(0.0, last, count)
    friction = Friction(slip_speeds=tuple(v), coefficients=tuple(0.1 + 0.048 * law(v / last)))
    assert abs(friction.curve.constant - 0.148) <= 0.2 * 0.048 + 1e-12
    assert stick_speed(50.0, friction.stribeck) == math.atanh(0.99) / 50.0


def test_stick_ends_before_a_hump_and_at_the_peak_of_a_falling_table():
    hump, falling = (Friction(slip_speeds=tuple(V), coefficients=tuple(mu)).stribeck for mu in (
        0.135 - 0.02 * np.exp(-V / 3.0) + 0.015 * np.exp(-V / 15.0), SHAPES["falling as a logarithm"][0]))
    assert stick_speed(50.0, hump) == math.atanh(0.99) / 50.0
    v = np.linspace(1e-4, 1.0, 200001)
    assert stick_speed(50.0, falling) == pytest.approx(v[smoothed_coefficient(v, 50.0, falling).argmax()], abs=1e-5)


@pytest.mark.parametrize(("speeds", "coefficients", "sentence"), [
    ((0.0, 1.0), (0.1, 0.1), "2 values.* 3 to 1000"),
    ((0.0, 1.0, 2.0), (0.1, 0.1), "2 values.*friction.slip_speeds, 3"),
    ((0.1, 1.0, 2.0), (0.1, 0.1, 0.1), "0.1 rad/s.* 0"),
    ((0.0, 2.0, 2.0), (0.1, 0.1, 0.1), "2 rad/s after 2 rad/s"),
    ((0.0, 5.0, 50.0), (0.15, 0.12, 0.14), r"with 1 decaying exponential, .* 3 points allow, .*11.1% off at 5"),
    ((0.0, 1.0, 2.0), (1e-3, 1.0, 2.0), "smooth the table"),
])
def test_what_is_no_table_or_not_met_is_refused(speeds, coefficients, sentence):
    with pytest.raises(InputError, match=sentence):
        fit_curve(speeds, coefficients)


def law(v: np.ndarray, sigma: float, excess: float, decay: float) -> np.ndarray:
    """(7) in 80 bits."""
    v = np.asarray(v, dtype=np.longdouble)
    return (1.0 + excess * np.exp(-decay * v)) * np.tanh(sigma * v)


def slope(v: float, sigma: float, excess: float, decay: float) -> np.longdouble:
    """(20b) in 80 bits for v > 0, over sech^2(sigma v): tanh cosh^2 = sinh(2 sigma v)/2, so nothing cancels."""
    x = np.longdouble(v)
    falling = excess * np.exp(-decay * x)
    return sigma * (1.0 + falling) - decay * falling * np.sinh(2.0 * sigma * x) / 2.0


def test_the_slope_changes_its_sign_at_the_peak_and_nothing_is_higher() -> None:
    draw = np.random.default_rng(1)
    for _ in range(200):
        sigma, excess, decay = 10.0 ** draw.uniform(0, 12), 10.0 ** draw.uniform(-3, 1.28), 10.0 ** draw.uniform(-2, 3)
        v, top = peak(sigma, (excess, decay))
        grid = law(np.geomspace(1e-6 / sigma, 50.0 / sigma + 10.0 / decay, 801), sigma, excess, decay)
        if math.isinf(v):
            assert top == 1.0
            assert grid.max() <= 1.0 + 1e-15
            continue
        assert 0.0 < v < 100.0 / sigma + 10.0 / decay
        assert slope(v * (1.0 - 1e-6), sigma, excess, decay) > 0.0 > slope(v * (1.0 + 1e-6), sigma, excess, decay)
        assert grid.max() <= max(top, 1.0) * (1.0 + 1e-15)
        assert top == pytest.approx(float(law(np.array(v), sigma, excess, decay)), rel=1e-15)
        assert stick_speed(sigma, (excess, decay)) == v


def test_a_law_that_never_falls_has_no_peak() -> None:
    assert peak(50.0, None) == (math.inf, 1.0)
    assert peak(50.0, (0.25, 0.0)) == (math.inf, 1.25)
    assert stick_speed(50.0, None) == pytest.approx(math.atanh(0.99) / 50.0)
    assert stick_speed(50.0, (0.25, 0.0)) == pytest.approx(math.atanh(0.99) / 50.0)
    assert peak(50.0, (-0.25, 2.0)) == (math.inf, 1.0)
    assert stick_speed(50.0, (-0.25, 2.0)) == pytest.approx(math.atanh(0.99) / 50.0)


@pytest.mark.parametrize(("static", "kinetic"), [(0.5, 0.025), (0.1, 2.0)])
def test_the_coefficients_are_at_most_a_factor_of_twenty_apart(static: float, kinetic: float) -> None:
    keys = ("friction.static_coefficient", "friction.kinetic_coefficient")
    assert replace(System(), dict(zip(keys, (static, kinetic)))).friction_ratio == static / kinetic
    further = math.nextafter(static, math.inf if static > kinetic else 0.0)
    with pytest.raises(InputError, match=r"friction.kinetic_coefficient .* to "):
        replace(System(), dict(zip(keys, (further, kinetic))))


def test_a_curve_is_its_constant_and_exponentials_as_far_as_they_last():
    curve, v = FrictionCurve(0.2, (0.05, -0.04), (3.0, 0.4)), np.array([-2.0, 0.0, 0.3, 5.0])
    size = np.abs(v)
    assert (curve.stribeck, curve.pairs) == (pytest.approx((0.25, 3.0, -0.2, 0.4)), (0.05, 3.0, -0.04, 0.4))
    np.testing.assert_allclose(curve.at(v), 0.2 + 0.05 * np.exp(-3.0 * size) - 0.04 * np.exp(-0.4 * size))
    np.testing.assert_allclose(curve.slope(v), -0.15 * np.exp(-3.0 * size) + 0.016 * np.exp(-0.4 * size))
    flat = FrictionCurve(0.2, (), ())
    assert (flat.stribeck, flat.pairs, flat.at(3.0), flat.slope(3.0)) == (None, (), 0.2, 0.0)


def test_a_poor_fit_is_doubted_with_its_error_and_place():
    mu = tuple(SHAPES["hump"][0])
    doubt, = Friction(slip_speeds=tuple(V), coefficients=mu).doubts
    curve = fit_curve(tuple(V), mu)
    assert f"{curve.error:.1%}" in doubt
    assert f"{curve.worst:g} rad/s" in doubt
    for shape in ("falling", "rising"):
        assert Friction(slip_speeds=tuple(V), coefficients=tuple(SHAPES[shape][0])).doubts == []
    lone = Friction(slip_speeds=(0.0, 1.0, 2.0), coefficients=(0.2, 0.2, 0.2))
    assert (lone.static, lone.kinetic, lone.stribeck) == (pytest.approx(0.2), pytest.approx(0.2), None)
    for tables in ({"slip_speeds": (0.0, 1.0, 2.0)}, {"coefficients": (0.1, 0.2, 0.2)}):
        with pytest.raises(InputError, match=r"friction\.slip_speeds"):
            Friction(**tables)
