"""Where the smoothed law peaks, against its derivative in 80 bits and its own values on a wide grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.friction import peak, stick_speed
from tcc_sim.model.parameters import System, replace


def law(v: np.ndarray, sigma: float, excess: float, decay: float) -> np.ndarray:
    """(7) in 80 bits."""
    v = np.asarray(v, dtype=np.longdouble)
    return (1.0 + excess * np.exp(-decay * v)) * np.tanh(sigma * v)


def slope(v: float, sigma: float, excess: float, decay: float) -> np.longdouble:
    """(20b) in 80 bits for v > 0, over sech^2(sigma v): tanh cosh^2 = sinh(2 sigma v)/2, so nothing cancels."""
    x = np.longdouble(v)
    falling = excess * np.exp(-decay * x)
    return sigma * (1.0 + falling) - decay * falling * np.sinh(2.0 * sigma * x) / 2.0


@pytest.mark.parametrize("seed", range(4))
def test_the_slope_changes_its_sign_at_the_peak_and_nothing_is_higher(seed: int) -> None:
    draw = np.random.default_rng(seed)
    for _ in range(100):
        sigma, excess, decay = 10.0 ** draw.uniform(0, 12), 10.0 ** draw.uniform(-3, 1.28), 10.0 ** draw.uniform(-2, 3)
        v, top = peak(sigma, (excess, decay))
        grid = law(np.geomspace(1e-6 / sigma, 50.0 / sigma + 10.0 / decay, 4001), sigma, excess, decay)
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
    with pytest.raises(InputError, match=r"friction.kinetic_coefficient is .*; it must be .*, one twentieth to twenty"):
        replace(System(), dict(zip(keys, (further, kinetic))))


def test_the_mean_saturation_torque_of_figure_2_is_500() -> None:
    assert System().saturation_mean == pytest.approx(500.0, rel=1e-12)
