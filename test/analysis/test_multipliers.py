"""Floquet multipliers of segments, beside those of their product in exact numbers."""

import numpy as np
import pytest

from tcc_sim.analysis.steady.exponents import largest_first, multipliers_of, product_of

BLOCKS = np.random.default_rng(2).normal(size=(4, 3, 3))


def test_multipliers_are_ordered_by_size_and_by_their_imaginary_part():
    given = np.array([0.5, -2.0, 1.0 - 1.0j, 1.0 + 1.0j, -0.1])
    assert largest_first(given).tolist() == [-2.0, 1.0 + 1.0j, 1.0 - 1.0j, 0.5, -0.1]
    pair = [1.0 + 1.0j, (1.0 + 1e-15) * (1.0 - 1.0j)]
    for order in (pair, pair[::-1]):
        assert largest_first(np.array([*order, 3.0])).tolist() == [3.0, *pair]


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_multipliers_of_segments_are_those_of_their_product(count):
    blocks = BLOCKS[:count]
    product = np.linalg.multi_dot([*blocks[::-1], np.eye(3)])
    np.testing.assert_allclose(product_of(blocks), product, rtol=1e-12)
    np.testing.assert_allclose(multipliers_of(*blocks), largest_first(np.linalg.eigvals(product)), rtol=1e-9)


def test_multipliers_of_segments_that_grow_and_shrink_keep_their_digits():
    first, second = np.diag([1e9, 3.0, 1e-6]), np.diag([2e-9, 0.5, 7e5])
    first[0, 1] = first[1, 2] = second[0, 1] = 0.3
    assert multipliers_of(first, second).real == pytest.approx([2.0, 1.5, 0.7], rel=1e-6)


def test_multipliers_that_the_pencil_loses_are_those_of_the_product():
    """Beyond 1e8 the reciprocal of a multiplier is rounding."""
    for large in (0.9e8, 1e9, 1e12):
        blocks = [np.diag([1.0, 1.0, large]), np.diag([0.5, 0.25, 3.0])]
        assert multipliers_of(*blocks).real == pytest.approx([3.0 * large, 0.5, 0.25], rel=1e-6)
    blocks = [np.diag([1e5, 1e5, 1e9]), np.diag([1e5, 0.25, 3.0])]
    assert multipliers_of(*blocks).real == pytest.approx([1e10, 3e9, 2.5e4], rel=1e-6)
