"""Kernels of many parts: what calls what, how often, and from where makes no difference to the numbers."""

from __future__ import annotations

import numpy as np
import pytest

from tcc_sim.solvers.compiling.compiled import fast, loaded
from tcc_sim.solvers.compiling.linked import PartLibrary, written

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


def test_a_part_is_compiled_for_python_only_where_python_calls_it():
    @fast
    def part(x):
        return 3.0 * x

    @fast
    def kernel(x):
        return part(x) + 1.0

    assert kernel(2.0) == 7.0
    assert not part.entries  # No machine code of its own: half the time of a first run would go there.
    assert part(2.0) == 6.0
    assert len(part.entries) == 1


def test_what_is_wrong_in_a_part_is_said():
    @fast
    def part(x):
        return x.nothing

    @fast
    def kernel(x):
        return part(x)

    with pytest.raises(Exception, match="nothing"):
        kernel(1.0)


def test_nothing_has_an_address_but_the_kernel_with_all_its_parts(monkeypatch):
    made = []
    finalize = PartLibrary.finalize
    monkeypatch.setattr(PartLibrary, "finalize", lambda self: (made.append(self), finalize(self)))

    @fast
    def part(x):
        return x - 1.0

    @fast
    def kernel(x):
        return part(x) * part(x)

    assert loaded(written(kernel.part, (4.0,)), [4.0])([4.0]) == 9.0
    assert len(made) == 2
    for library in made:
        names = [function.name for function in library.get_defined_functions()]
        assert names
        assert not any(library._codegen._engine.is_symbol_defined(name) for name in names)
