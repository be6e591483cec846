"""Pieces of a step of the exact engine: its length from the last terms, and when the slip speed goes one way only."""

import numpy as np

from tcc_sim.solvers.event_driven.step import SHAPE, monotone
from tcc_sim.solvers.polynomial import variation
from tcc_sim.solvers.series import SLIP, logarithm, power_of_two


def test_the_quick_root_is_never_too_large_and_hardly_too_small():
    for base in 10.0 ** np.random.default_rng(1).uniform(-30.0, 30.0, 300):
        for n in (17, 20, 22, 28):
            assert 0.985 * base ** (1.0 / n) <= power_of_two(logarithm(base) / n) <= base ** (1.0 / n)


def test_what_is_called_monotone_is():
    random, found = np.random.default_rng(2), 0
    for _ in range(300):
        rows = np.zeros(SHAPE)
        rows[SLIP, :9] = random.normal(size=9) * 0.5 ** np.arange(9)
        x = float(random.uniform(0.05, 1.5))
        if monotone(rows, 8, x, variation(rows, SLIP, 8, x)):
            found += 1
            rise = np.diff(np.polynomial.Polynomial(rows[SLIP, :9])(np.linspace(0.0, x, 500)))
            assert (rise > 0.0).all() or (rise < 0.0).all()
    assert 30 < found < 270
