"""Numbers of staged functions that carry their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tcc_sim.compiling.changing import Causes, Changing


def test_numbers_that_change_are_differentiated_by_rule() -> None:
    """Against differences with complex steps, by two causes; those that are left out of `Causes` change nothing."""
    def quotient(x: Any, y: Any) -> Any:
        return 3.0 * x / (y - 2.0 * x) - x * x + 1.0 / y - (-x) + (1.0 - y)

    x, y, step = 0.7, 5.0, 1e-30
    dx, dy = quotient(x + step * 1j, y).imag / step, quotient(x, y + step * 1j).imag / step
    both = quotient(Changing(x, np.array([1.0, 0.0])), Changing(y, np.array([0.0, 1.0])))
    assert both.value == quotient(x, y)
    assert both.change == pytest.approx([dx, dy], rel=1e-14)
    by_causes = quotient(Changing(x, Causes({4: 1.0})), Changing(y))
    assert by_causes.change == {4: pytest.approx(dx, rel=1e-14)}
