"""Selection of claims for the command `claims`, and what their tests compute once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from tcc_sim.model import pure_stick
from tcc_sim.study.paper import claims

LIMITS = cache(pure_stick.stick_limits)


@pytest.fixture(autouse=True)
def _limits_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Find the limits of stick of a system once."""
    monkeypatch.setattr(pure_stick, "stick_limits", LIMITS)


@pytest.fixture
def judge_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Function that limits the command to some claims."""
    return lambda *chosen: monkeypatch.setattr(claims, "CLAIMS", chosen)
