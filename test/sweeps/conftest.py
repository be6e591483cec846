"""Callback while the file of a sweep grows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tcc_sim.sweeps.file import SweepFile


@pytest.fixture
def on_point(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[int], None] | None], None]:
    """Function that sets a callback after each stored point, with the number of points since; None ends it."""
    then: Callable[[int], None] | None = None
    count, append = 0, SweepFile.append

    def counted(self: SweepFile, *point: Any) -> None:
        nonlocal count
        append(self, *point)
        count += 1
        if then is not None:
            then(count)

    def call(function: Callable[[int], None] | None) -> None:
        nonlocal count, then
        count, then = 0, function

    monkeypatch.setattr(SweepFile, "append", counted)
    return call
