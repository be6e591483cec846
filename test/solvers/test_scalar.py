from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import brentq

from tcc_sim.model import friction
from tcc_sim.solvers.scalar import ITERATION_BOUND, scalar_root

Double = NDArray[np.float64]
Long = NDArray[np.longdouble]
logs = st.floats(0.0, 1.0)


@settings(max_examples=400, deadline=None)
@given(w=st.floats(-1e5, 1e5), size=logs, smoothing=logs, guess=st.floats(-1e5, 1e5), excess=logs,
       decay=st.one_of(st.just(0.0), st.floats(1e-3, 10.0)))
def test_the_root_is_the_one_brentq_finds(w, size, smoothing, guess, excess, decay):
    a, sigma = 10.0 ** (-6 + 9 * size), 10.0 ** (1 + 8 * smoothing)
    # The Stribeck slope is at least -alpha (r - 1): sub-steps keep a times it below 1/2, so that F increases.
    stribeck = None if decay == 0.0 else (min(3.0 * excess, 0.5 / (a * decay)), decay)
    v, count = scalar_root(w, a, guess, sigma, stribeck)
    assert 0 <= count <= ITERATION_BOUND

    def residual(x: float) -> float:
        return float(x + a * friction.smoothed_coefficient(x, sigma, stribeck) - abs(w))

    expected = brentq(residual, 0.0, abs(w), xtol=1e-300, rtol=1e-15, maxiter=2000) if w else 0.0
    assert abs(v) == pytest.approx(expected, rel=1e-11, abs=max(2e-15 * abs(w), 1e-150))
    assert v == 0.0 or (v > 0.0) == (w > 0.0)


def test_few_iterations_are_needed_over_the_whole_range() -> None:
    worst = 0
    rng = np.random.default_rng(5)
    for _ in range(4000):
        w, a, sigma = 10.0 ** rng.uniform(-9, 5), 10.0 ** rng.uniform(-5, 4), 10.0 ** rng.uniform(1, 9)
        _, count = scalar_root(w, a, float("inf"), sigma, None)
        worst = max(worst, count)
    assert worst <= 15


def exact_root(w: Long, a: Long, sigma: Long, excess: Long, decay: Long) -> Long:
    """The roots by bisection in 80 bits, geometric at first since they may be small; all (n,) arrays."""
    low, high = np.minimum(np.maximum(w / (1.0 + a * (1.0 + excess) * sigma), w - a * (1.0 + excess)), w) * 0.999, w
    low = np.maximum(low, np.longdouble(1e-300))
    for k in range(150):
        middle = np.sqrt(low * high) if k < 60 else 0.5 * (low + high)
        above = middle + a * (1.0 + excess * np.exp(-decay * middle)) * np.tanh(sigma * middle) > w
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


def seeded_cases(count: int, seed: int) -> list[Double]:
    """w, a, guess, sigma, r - 1 and alpha within the sub-step rule a alpha (r - 1) <= 1/2; half have their root in the
    knee of the law, where Newton's steps are long.
    """
    rng = np.random.default_rng(seed)

    def powers(low: float, high: float) -> Double:
        return 10.0 ** rng.uniform(low, high, count)

    sigma, excess = powers(0.0, 12.0), rng.uniform(0.0, 3.0, count)
    decay = np.where(rng.random(count) < 0.5, powers(-2.0, 3.0), 2.0)
    most = 0.5 / (decay * excess)
    a = np.where(rng.random(count) < 0.5, np.minimum(powers(-8.0, 4.0), most), most * powers(-6.0, 0.0))
    v = np.where(rng.random(count) < 0.5, powers(-2.0, 1.5) / sigma, powers(-14.0, 4.0))
    w = np.where(rng.random(count) < 0.25, powers(-12.0, 5.0),
                 v + a * (1.0 + excess * np.exp(-decay * v)) * np.tanh(sigma * v))
    guess = np.where(rng.random(count) < 0.5, rng.uniform(0.0, 1.0, count) * w, powers(-12.0, 5.0))
    return [w, a, guess, sigma, excess, decay]


@pytest.mark.parametrize("seed", [2, 3])
def test_the_stated_accuracy_holds_within_the_rule_of_the_sub_steps(seed: int) -> None:
    """Newton's method in 80 bits from the root found says how far it is; what looks far is bisected."""
    w, a, _, sigma, excess, decay = cases = seeded_cases(120_000, seed)
    found, count = np.array([scalar_root(x, b, g, s,
                                         (e, d)) for x, b, g, s, e, d in zip(*(c.tolist() for c in cases))]).T
    assert count.max() <= ITERATION_BOUND
    long = [x.astype(np.longdouble) for x in (w, a, sigma, excess, decay)]
    x, (target, size, steep, more, fall) = found.astype(np.longdouble), long
    for _ in range(4):
        tanh, falling = np.tanh(steep * x), more * np.exp(-fall * x)
        slope = steep * (1.0 + falling) * (1.0 - tanh) * (1.0 + tanh) - fall * falling * tanh
        x = x - (x + size * (1.0 + falling) * tanh - target) / (1.0 + size * slope)
    allowed = 2e-15 * w + 1e-13 * found
    far = np.flatnonzero(~(np.abs(found - x) <= 0.5 * allowed))
    assert len(far) < 2000
    error = np.abs(found[far] - exact_root(*(y[far] for y in long)))
    assert (error <= allowed[far]).all()


@pytest.mark.parametrize("w", [float("nan"), float("inf"), -float("inf")])
def test_the_bound_holds_for_what_is_no_number(w: float) -> None:
    _, count = scalar_root(w, 1.0, 0.0, 50.0, (0.25, 2.0))
    assert count <= ITERATION_BOUND


def test_no_friction_leaves_the_speed_as_it_is() -> None:
    assert scalar_root(3.0, 0.0, 0.0, 50.0, None) == (3.0, 0)
    assert scalar_root(0.0, 1.0, 5.0, 50.0, (0.25, 2.0)) == (0.0, 0)
