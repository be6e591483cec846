"""The least squares and roots by which a decay is judged, beside NumPy's."""

import numpy as np
import pytest

from tcc_sim.analysis import repetition
from tcc_sim.compiling.compiled import rebound

plain_decay = rebound(repetition.decay.py_func, difference_of=repetition.difference_of.py_func)
plain_rate = rebound(repetition.rate_of.py_func, larger_root=repetition.larger_root.py_func)


def by_numpy(points, period, modes):
    """Misfit and coefficients of d_(n+mp) = sum_i c_i d_(n+ip), every equation over its largest number."""
    difference = points[period:] - points[:-period]
    count = len(difference) - modes * period
    columns = np.stack([difference[i * period:i * period + count] for i in range(modes + 1)])
    columns = (columns / np.abs(columns).max(axis=(0, 2))[None, :, None]).reshape(modes + 1, -1)
    result, *_ = np.linalg.lstsq(columns[:-1].T, columns[-1], rcond=None)
    return float(np.sqrt(np.mean((columns[-1] - result @ columns[:-1])**2))), result


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize("period", [1, 2, 5])
def test_a_decay_is_the_least_squares_solution(period, modes):
    random = np.random.default_rng(3)
    n = np.arange(20, 100)[:, None]
    falling = sum(x * r**n for x, r in zip(random.normal(size=(3, 3)), (0.97, -0.9, 0.85)))
    points = 1.0 + falling + 1e-4 * random.normal(size=(80, 3))
    shares = np.empty(3)
    misfit = plain_decay(np.concatenate([np.ones((20, 3)), points]), 20, 100, period, modes, np.empty((4, 300)),
                         np.empty((3, 4)), shares)
    expected, coefficients = by_numpy(points, period, modes)
    assert misfit == pytest.approx(expected, rel=1e-9)
    assert shares[:modes] == pytest.approx(coefficients, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("modes", [2, 3])
def test_a_column_that_depends_on_the_others_has_no_share(modes):
    """A decay of one mode, exact in binary numbers: the misfit is 0 with any number of modes, and so is it by NumPy."""
    points = 0.5 ** np.arange(30)[:, None] * np.array([1.0, -2.0, 4.0])
    shares = np.empty(3)
    assert plain_decay(points, 0, 30, 1, modes, np.empty((4, 90)), np.empty((3, 4)), shares) < 1e-12
    assert by_numpy(points, 1, modes)[0] < 1e-12
    assert shares[1:modes].tolist() == [0.0] * (modes - 1)


def test_equal_points_and_too_few_have_no_decay():
    room = np.empty((4, 300)), np.empty((3, 4)), np.empty(3)
    assert plain_decay(np.ones((30, 3)), 0, 30, 1, 1, *room) == -1.0
    assert plain_decay(np.arange(21.0).reshape(7, 3), 0, 7, 2, 2, *room) == -1.0


def test_the_rate_is_that_of_the_largest_root():
    random = np.random.default_rng(4)
    rows = [*random.normal(size=(300, 3)), *(10.0 ** random.uniform(-6, 3, (100, 3))), np.zeros(3), [0.0, 0.0, 0.5],
            [1.0, -3.0, 3.0]]
    for row in rows:
        for modes in (1, 2, 3):
            shares = np.array(row[:modes])
            largest = np.abs(np.roots([1.0, *-shares[::-1]])).max(initial=1e-300)
            assert np.exp(-plain_rate(shares, modes)) == pytest.approx(largest, rel=1e-5 if row[0] == 1.0 else 1e-7)
