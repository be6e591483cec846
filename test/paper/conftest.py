"""Claims that the command on them judges."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tcc_sim.paper import claims


@pytest.fixture
def judge_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Has the command judge some claims only."""
    return lambda *chosen: monkeypatch.setattr(claims, "CLAIMS", chosen)
