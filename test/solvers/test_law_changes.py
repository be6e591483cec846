"""Friction and its derivatives along a motion and at one speed, by plain numbers against the law itself."""

from typing import Any

import numpy as np
import pytest

from tcc_sim.model.friction import smoothed_and_slope
from tcc_sim.solvers.law_changes import FRICTION, OF_SLIP, WIDE, law_along, numbers_of
from tcc_sim.solvers.series import COLUMNS, LOAD, ROWS, SLIP, fastest_at
from tcc_sim.solvers.smoothed.series_step import law_here
from tcc_sim.solvers.stages import LAYER

SPEED, RATE, LOADS, SIGMA = 1.5, -0.8, (500.0, 40.0), 0.6
PAIRS = (0.3, 1.5), (-0.2, 0.4), (0.1, 2.5)


class Columns(np.ndarray):
    """Array with the method that staged functions call."""

    def set_row(self, row: Any, k: int) -> None:
        self[k, :len(row)] = row


def friction(v: Any, pairs: Any, sigma: float) -> Any:
    """mubar of (7) at v > 0."""
    return np.tanh(sigma * v) * (1.0 + sum(share * np.exp(-rate * v) for share, rate in pairs))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_friction_along_a_motion_and_its_derivatives_have_every_exponential(count: int) -> None:
    pairs, x = PAIRS[:count], np.linspace(0.0, 0.2, 5)
    rows = np.zeros((ROWS, COLUMNS))
    rows[SLIP, :2], rows[LOAD, :2] = (SPEED, RATE), LOADS
    law = np.zeros((COLUMNS, WIDE)).view(Columns)
    stribeck = tuple(np.ravel(pairs).tolist())
    for _ in law_along(rows, np.zeros(COLUMNS), law, True, 1.0, (1.0, 1.0, 0.0), stribeck, SIGMA):
        pass
    v, load = SPEED + RATE * x, LOADS[0] + LOADS[1] * x
    result = np.polynomial.polynomial.polyval(x, np.asarray(law))
    np.testing.assert_allclose(result[FRICTION], load * friction(v, pairs, SIGMA), rtol=1e-11)

    def difference(of: Any, step: float = 1e-3) -> Any:
        """Central difference of sixth order of load times mubar."""
        weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
        return load * sum(w * (of(n * step) - of(-n * step)) for n, w in weights.items()) / step

    def changed(number: int, change: float) -> Any:
        """The pairs with one of their numbers changed."""
        numbers = np.ravel(pairs).copy()
        numbers[number] += change
        return numbers.reshape(-1, 2)

    np.testing.assert_allclose(result[OF_SLIP], difference(lambda d: friction(v + d, pairs, SIGMA)), rtol=1e-9)
    of_sigma, *of_pairs = numbers_of(stribeck)
    np.testing.assert_allclose(result[of_sigma], difference(lambda d: friction(v, pairs, SIGMA + d)), rtol=1e-9)
    for number, cause in enumerate(of_pairs):
        expected = difference(lambda d, number=number: friction(v, changed(number, d), SIGMA))
        np.testing.assert_allclose(result[cause], expected, rtol=1e-9)


def test_law_and_slope_at_a_speed_and_the_fastest_rate_have_every_exponential() -> None:
    stribeck = tuple(np.ravel(PAIRS).tolist())
    assert law_here.py_func(SPEED, 1.0, LAYER, SIGMA, stribeck)[:2] == pytest.approx(
        smoothed_and_slope(SPEED, SIGMA, stribeck), rel=1e-14)
    assert fastest_at.py_func(stribeck, 0.0) == 2.5
    assert fastest_at.py_func(stribeck, 60.0) == 0.4  # The others have decayed.
