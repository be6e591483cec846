"""Kernels of many parts: what calls what, how often, and from where makes no difference to the numbers."""

from __future__ import annotations

import numpy as np
import pytest

from tcc_sim.solvers.compiling.compiled import compiled, fast
from tcc_sim.solvers.compiling.linked import PartLibrary

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


@compiled
def summed(count):
    """A kernel that makes an array, for the ordinary passes."""
    values = np.arange(count) + 1.0
    return first_and_last(values) + middle(values, None)


def test_parts_reached_along_several_ways_give_what_python_gives():
    values = np.array([2.0, 4.0, 8.0])
    assert everything(values, None) == 2.0 * 0.5 - 4.0 * 0.25 + 8.0 * 3.0
    assert everything(values, 2.0) == 2.0 * 0.5 - 2.0 * 4.0 * 0.25 + 8.0 * 3.0
    assert summed(3) == 0.5 - 0.5 + 9.0


def test_a_kernel_that_is_not_linked_gives_what_python_gives():
    """As kernels are compiled under a Numba that is newer than what has been tested."""
    def part(x):
        return 3.0 * x

    own = compiled(part, linked=False)

    def kernel(x):
        return own(x) + 1.0

    found = compiled(kernel, linked=False)
    assert found(2.0) == 7.0
    assert own.overloads  # Compiled by itself, as Numba does.


def test_a_part_is_compiled_for_python_only_where_python_calls_it():
    @fast
    def part(x):
        return 3.0 * x

    @fast
    def kernel(x):
        return part(x) + 1.0

    assert kernel(2.0) == 7.0
    assert not part.overloads  # No machine code of its own: half the time of a first run would go there.
    assert part(2.0) == 6.0
    assert len(part.overloads) == 1


def test_what_is_wrong_in_a_part_is_said():
    @fast
    def part(x):
        return x.nothing

    @fast
    def kernel(x):
        return part(x)

    with pytest.raises(Exception, match="nothing"):
        kernel(1.0)


def test_a_part_has_no_address(monkeypatch):
    made = []
    finalize = PartLibrary.finalize
    monkeypatch.setattr(PartLibrary, "finalize", lambda self: (made.append(self), finalize(self)))

    @fast
    def part(x):
        return x - 1.0

    @fast
    def kernel(x):
        return part(x) * part(x)

    assert kernel(4.0) == 9.0
    assert len(made) == 1
    assert not made[0]._codegen._engine.is_symbol_defined(next(f.name for f in made[0].get_defined_functions()))
