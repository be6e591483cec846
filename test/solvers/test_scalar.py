from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from tcc_sim.model import friction
from tcc_sim.solvers.scalar import ITERATION_BOUND, scalar_root

logs = st.floats(0.0, 1.0)


@settings(max_examples=400, deadline=None)
@given(w=st.floats(-1e5, 1e5), size=logs, smoothing=logs, guess=st.floats(-1e5, 1e5), excess=logs,
       decay=st.one_of(st.just(0.0), st.floats(1e-3, 10.0)))
def test_the_root_is_the_one_brentq_finds(w: float, size: float, smoothing: float, guess: float, excess: float,
                                          decay: float) -> None:
    a, sigma = 10.0 ** (-6 + 9 * size), 10.0 ** (1 + 8 * smoothing)
    # The Stribeck slope is at least -alpha (r - 1): sub-steps keep a times it below 1/2, so that F increases.
    stribeck = None if decay == 0.0 else (min(3.0 * excess, 0.5 / (a * decay)), decay)
    v, count = scalar_root(w, a, guess, sigma, stribeck)
    assert 0 <= count <= ITERATION_BOUND

    def residual(x: float) -> float:
        return float(x + a * friction.smoothed(x, sigma, stribeck) - abs(w))

    expected = brentq(residual, 0.0, abs(w), xtol=1e-300, rtol=1e-15, maxiter=2000) if w else 0.0
    assert abs(v) == pytest.approx(expected, rel=1e-11, abs=max(4e-16 * abs(w), 1e-150))
    assert v == 0.0 or (v > 0.0) == (w > 0.0)


def test_few_iterations_are_needed_over_the_whole_range() -> None:
    worst = 0
    rng = np.random.default_rng(5)
    for _ in range(4000):
        w, a, sigma = 10.0 ** rng.uniform(-9, 5), 10.0 ** rng.uniform(-5, 4), 10.0 ** rng.uniform(1, 9)
        _, count = scalar_root(w, a, float("inf"), sigma, None)
        worst = max(worst, count)
    assert worst <= 15


@pytest.mark.parametrize("w", [float("nan"), float("inf"), -float("inf")])
def test_the_bound_holds_for_what_is_no_number(w: float) -> None:
    _, count = scalar_root(w, 1.0, 0.0, 50.0, (0.25, 2.0))
    assert count <= ITERATION_BOUND


def test_no_friction_leaves_the_speed_as_it_is() -> None:
    assert scalar_root(3.0, 0.0, 0.0, 50.0, None) == (3.0, 0)
    assert scalar_root(0.0, 1.0, 5.0, 50.0, (0.25, 2.0)) == (0.0, 0)
