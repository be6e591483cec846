"""Staged functions: the code that they write gives what they give with plain numbers, and that is what NumPy gives."""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import (
    exp,
    folded,
    greater,
    largest_size,
    lesser,
    limited,
    magnitude,
    row_of,
    unrolled,
    where,
    with_sign,
)

X = np.array([-3.0, -0.25, 0.0, 0.5, 1.0, 2.5, 7.0, np.nan])
Y = np.array([2.0, -0.25, -1.0, 0.75, -1.0, 8.0, np.nan, 1.0])
CONSTANT = np.array([4.0, -2.0, 0.5, 1.0, 3.0, -7.0, 0.0, 2.0])
PLAIN = np.array([-3.0, -0.25, 0.125, 0.5, 1.0, 2.5, 7.0, -9.0])
OF_ROWS: tuple[tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]], ...] = (
    (lambda x, y: x + y, np.add), (lambda x, y: x - y, np.subtract), (lambda x, y: x * y, np.multiply),
    (lambda x, y: x / y, np.divide), (lambda x, y: -x, lambda x, y: -x),
    (lambda x, y: x + 0.0, lambda x, y: x), (lambda x, y: x - 0.0, lambda x, y: x),
    (lambda x, y: x * 1.0, lambda x, y: x), (lambda x, y: x * 0.0 + y, lambda x, y: y),
    (lambda x, y: 0.0 - x, lambda x, y: -x), (lambda x, y: 1.0 - x, lambda x, y: 1.0 - x),
    (lambda x, y: 2.0 / x, lambda x, y: 2.0 / x), (lambda x, y: x + 1.0, lambda x, y: x + 1.0),
    (lambda x, y: x * 3.0 - 1.0, lambda x, y: x * 3.0 - 1.0),
    (lambda x, y: x * CONSTANT, lambda x, y: x * CONSTANT), (lambda x, y: x[4] * CONSTANT, lambda x, y: CONSTANT),
    (lambda x, y: x[5] * y, lambda x, y: 2.5 * y), (lambda x, y: y * x[5] + x[0], lambda x, y: 2.5 * y - 3.0),
    (lambda x, y: magnitude(x), lambda x, y: np.abs(x)), (lambda x, y: with_sign(x, y), np.copysign),
    (lambda x, y: limited(x, -0.3, 2.0), lambda x, y: np.where(np.isnan(x), 2.0, np.clip(x, -0.3, 2.0))),
    (lambda x, y: where(x, ">", y, 5.0, x), lambda x, y: np.where(x > y, 5.0, x)),
    (lambda x, y: where(x, "<", 0.5, CONSTANT, y), lambda x, y: np.where(x < 0.5, CONSTANT, y)),
    (lambda x, y: greater(x, y), lambda x, y: np.where(x > y, x, y)),
    (lambda x, y: lesser(x, y), lambda x, y: np.where(x < y, x, y)),
    (lambda x, y: row_of([x[1], 2.0, *(y[k] for k in range(6))]), lambda x, y: np.array([-0.25, 2.0, *y[:6]])),
)
"""A staged function and NumPy write the same lanes; a lane that is nan shows which of two a comparison takes."""
OF_A_ROW: tuple[tuple[Callable[[Any], Any], float], ...] = (
    (lambda x: folded(operator.add, x), float(PLAIN.sum())), (lambda x: folded(lesser, x), -9.0),
    (lambda x: folded(greater, x), 7.0), (largest_size, 9.0), (lambda x: magnitude(x[0]), 3.0),
    (lambda x: x[3] - x[2] / x[5], 0.45), (lambda x: -x[1] + 0.0, 0.25), (lambda x: 0.0 - x[1], 0.25),
    (lambda x: where(x[1], "<", 0.0, 3.0, x[0]), 3.0), (lambda x: limited(x[6], -1.0, 1.5), 1.5))


def staged(x: Any, y: Any, plain: Any, out: Any, single: Any) -> None:
    """Write the results of OF_ROWS and OF_A_ROW."""
    one, two, three = x.row(0, count=8), y.row(0, count=8), plain.row(0, count=8)
    for k, (written, _) in enumerate(OF_ROWS):
        out.set_row(written(one, two), k, 0)
    for k, (of_one, _) in enumerate(OF_A_ROW):
        single[k,] = of_one(three)


write = unrolled(staged)


@fast
def everything(x: Any, y: Any, plain: Any, out: Any, single: Any) -> None:
    write(0, x, y, plain, out, single)


def test_rows_and_single_numbers_are_what_numpy_gives() -> None:
    out, single = np.empty((len(OF_ROWS), 8)), np.empty(len(OF_A_ROW))
    everything(X, Y, PLAIN, out, single)
    for k, (of_lanes, by_numpy) in enumerate(OF_ROWS):
        np.testing.assert_array_equal(out[k], by_numpy(X, Y), err_msg=str(k))
        if k not in (8, 20, 25):  # NumPy keeps nan in a product with 0 and in a limited number; a row of parts.
            np.testing.assert_array_equal(of_lanes(X, Y), by_numpy(X, Y), err_msg=str(k))
    assert single.tolist() == pytest.approx([result for _, result in OF_A_ROW], rel=1e-15)
    assert [float(of(PLAIN)) for of, _ in OF_A_ROW] == pytest.approx([result for _, result in OF_A_ROW], rel=1e-15)


def exponentials(x: Any, out: Any) -> None:
    out.set_row(exp(x.row(0, count=8)), 0)
    out[8,] = exp(x[0,])


expand = unrolled(exponentials)


@fast
def fill(x: Any, out: Any) -> None:
    expand(0, x, out)


def test_the_exponential_is_good_to_a_unit_in_the_last_place() -> None:
    rng, out = np.random.default_rng(1), np.empty(9)
    for x in [*rng.uniform(-700.0, 700.0, (400, 8)), *rng.uniform(-1.0, 1.0, (100, 8)), np.zeros(8),
              np.array([-1e9, 1e9, 700.0, -700.0, 701.0, -701.0, 0.35, -0.35])]:
        fill(x, out)
        expected = np.exp(np.clip(x, -700.0, 700.0))
        assert (np.abs(out[:8] - expected) <= np.spacing(expected)).all()
        assert out[8] == out[0]
        np.testing.assert_array_equal(exp(x), expected)


def parts(x: Any, out: Any) -> Any:
    """Write entries until the order is reached, by keys with one and two numbers, and what was written again."""
    for k in range(4):
        out[1, k] = x[0, k] * x[1, k]
        out[0, k] = out[1, k] + 1.0
        yield 2 * k + 1


in_turn = unrolled(parts)


@fast
def until(order: int, x: Any, out: Any) -> None:
    in_turn(order, x, out)


def test_the_code_ends_at_the_first_order_at_or_above_the_one_that_is_asked_for() -> None:
    """Arrays whose columns are next to each other, and apart."""
    for columns, (order, count) in itertools.product(
            (slice(None), slice(None, None, 2)), ((0, 1), (1, 1), (2, 2), (3, 2), (4, 3), (7, 4), (99, 4))):
        x, out = np.arange(16.0).reshape(2, 8)[:, columns], np.full((2, 8), -1.0)
        until(order, x, out[:, columns])
        expected = np.full((2, x.shape[1]), -1.0)
        expected[1, :count] = (x[0] * x[1])[:count]
        expected[0, :count] = expected[1, :count] + 1.0
        np.testing.assert_array_equal(out[:, columns], expected)
