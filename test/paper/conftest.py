"""Selection of claims for the command `claims`."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tcc_sim.paper import claims


@pytest.fixture
def judge_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Function that limits the command to some claims."""
    return lambda *chosen: monkeypatch.setattr(claims, "CLAIMS", chosen)
