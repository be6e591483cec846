"""Kernels of many parts: order, number and place of calls make no difference to the numbers; numbers that change."""

from __future__ import annotations

import gc
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Call, Calls, EntryPoint, compiled, fast
from tcc_sim.errors import TccError

WEIGHTS = np.array([0.5, -0.25, 3.0])


@fast
def weighted(values, place):
    """One product with a constant array."""
    return values[place] * WEIGHTS[place]


@fast
def first_and_last(values):
    return weighted(values, 0) + weighted(values, 2)


@fast
def middle(values, gain):
    return weighted(values, 1) if gain is None else gain * weighted(values, 1)


@fast
def everything(values, gain):
    """Reaches `weighted` along two ways."""
    return first_and_last(values) + middle(values, gain)


def test_parts_reached_along_several_ways_give_what_python_gives():
    values = np.array([2.0, 4.0, 8.0])
    assert everything(values, None) == 2.0 * 0.5 - 4.0 * 0.25 + 8.0 * 3.0
    assert everything(values, 2.0) == 2.0 * 0.5 - 2.0 * 4.0 * 0.25 + 8.0 * 3.0


def test_a_function_keeps_its_own_arithmetic_whoever_compiles_it_first():
    @compiled
    def rounded(x, y, z):
        return x * y - z

    @fast
    def kernel(x, y, z):
        return rounded(x, y, z)

    x, z = 1.0 + 2.0**-30, 1.0 + 2.0**-29  # x x - z is 2^-60 before the product is rounded.
    assert (kernel(x, x, z), rounded(x, x, z)) == (0.0, 0.0)


def test_what_is_wrong_in_a_part_is_said():
    @fast
    def part(x):
        return x.nothing

    @fast
    def kernel(x):
        return part(x)

    with pytest.raises(Exception, match="nothing"):
        kernel(1.0)
    assert gc.isenabled()


class Pair(NamedTuple):
    first: float
    rest: tuple[int, NDArray[np.float64]]


@compiled
def digest_of(matrix, record, pair, flag, nothing):
    """Something of every kind of argument, which no two of them could give alike."""
    if nothing is not None:
        return -1.0, 0, flag
    record.count += 1
    weight = 0.0
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            weight += matrix[i, j] * 10.0**i * 1000.0**j
    return weight + pair.first, pair.rest[0] + int(pair.rest[1][-1]) + record.count, not flag


MATRIX = np.arange(12.0).reshape(3, 4)


@pytest.mark.parametrize(("matrix", "writable"), [
    (MATRIX, True), (MATRIX, False), (np.asfortranarray(MATRIX), False), (MATRIX[:, ::2], True), (MATRIX[::-1], False),
    (MATRIX[1:2], True)], ids=["rows", "read_only", "columns", "steps", "backwards", "one"])
def test_arguments_of_every_kind_arrive_as_they_are(matrix, writable):
    matrix = matrix.view() if writable else matrix.copy(order="K")
    matrix.setflags(write=writable)
    record = np.zeros(2, np.dtype([("other", np.float64), ("count", np.int64)]))[1]
    pair = Pair(0.5, (7, np.arange(5.0)[::2]))
    weights = 10.0**np.arange(matrix.shape[0])[:, None] * 1000.0**np.arange(matrix.shape[1])
    for count in (1, 2):
        assert digest_of(matrix, record, pair, True, None) == ((matrix * weights).sum() + 0.5, 11 + count, False)
    assert record["count"] == 2
    assert digest_of(matrix, record, pair, True, 1.0) == (-1.0, 0, True)


def test_what_no_kernel_takes_is_refused():
    for given in ("text", [1.0], 1j, np.float32(1.0), {}):
        with pytest.raises(TypeError):
            everything(given, None)


def test_code_that_needs_what_is_not_there_is_compiled_anew():
    with pytest.raises(TccError, match="no_such_function is missing"):
        EntryPoint(b"d\nno_such_function\n", [])


def test_a_call_laid_out_once_gives_what_the_kernel_gives():
    @compiled
    def kernel(values, shift, x, n, pair):
        values[0] += 1.0
        return values[0] * x * n + shift if pair is None else values[0] * x * n + shift + pair[0]

    values = np.array([1.0, 5.0])
    call = Call(kernel, 2, "dq")
    call.use(values, 0.0, 0.0, 0, (10.0, 1.0))
    assert (call(3.0, 2), call(np.float64(0.5), 4)) == (2.0 * 3.0 * 2 + 10.0, 3.0 * 0.5 * 4 + 10.0)
    values[0] = 7.0
    assert call(1.0, 1) == 18.0
    call.use(values[::-1].copy(), -4.0, 0.0, 0, None)  # Another kind, and an array that nobody else holds.
    assert (call(1.0, 1), values[0]) == (2.0, 8.0)


def test_calls_one_after_the_other_give_what_the_kernel_gives():
    @compiled
    def kernel(x, n, pair, divisor, values):
        if not divisor:
            raise ArithmeticError("no divisor")
        values[0] += x
        return values[0] if pair is None else values[0] * n + pair[0], 1 // divisor

    slots = [np.array([float(k)]) for k in range(5)]
    calls = Calls(kernel, [(each,) for each in slots])
    numbers = [(0.5 * k, k) for k in range(5)]
    pairs = [((10.0, 1.0), 1), (None, 1), (None, 1), ((20.0, 1.0), 1), ((30.0, 1.0), 1)]
    assert calls(numbers, pairs) == [(10.0, 1), (1.5, 1), (3.0, 1), (4.5 * 3 + 20.0, 1), (6.0 * 4 + 30.0, 1)]
    assert [each[0] for each in slots] == [0.0, 1.5, 3.0, 4.5, 6.0]
    assert calls(numbers[:2], pairs[1:3]) == [(0.0, 1), (2.0, 1)]
    assert calls([], []) == []
    with pytest.raises(ArithmeticError):
        calls(numbers[:3], [((1.0, 1.0), 1), ((1.0, 1.0), 0), ((1.0, 1.0), 1)])
    assert [each[0] for each in slots[:3]] == [0.0, 2.0, 3.0]
