"""A construct that the printer does not know is refused by its function; `test_ticks` compares bits of the others."""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tcc_sim.fmi.c_types import DOUBLE, INT, Refused, Row
from tcc_sim.fmi.printer import Library


def refused_sources() -> list[tuple[Callable[..., Any], tuple[Any, ...]]]:
    """Functions with a construct that has no form in C, and the types of their arguments."""
    number, row = (DOUBLE,), (Row(length=5), DOUBLE)

    def power(x: float) -> float:
        return x**3

    def divided(n: int) -> float:
        return n / n

    def inverted(n: int) -> int:
        return ~n

    def not_a_number(x: float) -> float:
        return x + math.nan

    def several_types(x: float) -> Any:
        return (x, x) if x > 0.0 else x

    def filtered(x: float) -> float:
        return max(*[k for k in (x, 1.0) if True])

    def two_bounds(n: int) -> int:
        for k in range(1, n):
            if k == 2:
                break
        return n

    def otherwise(n: int) -> int:
        while n > 0:
            n = n - 1
        else:
            n = 3
        return n

    def unequal(x: float) -> float:
        a, b = x, x, x  # type: ignore[misc] # noqa: F841
        return a

    def whole(x: float) -> int:
        return int(x)

    def lower_side(values: Any, x: float) -> int:
        return np.searchsorted(values, x)  # type: ignore[return-value]

    def stepped(values: Any, x: float) -> float:
        return values[:-1].max()  # type: ignore[no-any-return]

    def turned(values: Any, x: float) -> float:
        return np.moveaxis(values, 0, 1)[0]  # type: ignore[no-any-return]

    return [*((one, number) for one in (power, not_a_number, several_types, filtered, unequal, whole)),
            *((one, (INT,)) for one in (divided, inverted, two_bounds, otherwise)),
            *((one, row) for one in (lower_side, stepped, turned))]


@pytest.mark.parametrize(("source", "kinds"), refused_sources(), ids=lambda one: getattr(one, "__name__", ""))
def test_any_other_construct_is_refused_by_the_name_of_its_function(source: Callable[..., Any],
                                                                    kinds: tuple[Any, ...]) -> None:
    with pytest.raises(Refused) as caught:
        Library().function(source, kinds)
    name, _, piece = str(caught.value).partition(": ")
    text = ast.unparse(ast.parse(textwrap.dedent(inspect.getsource(source))))
    assert name == source.__name__
    assert re.sub(r"[\s()]", "", piece) in re.sub(r"[\s()]", "", text)
