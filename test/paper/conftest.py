"""What the command on the paper's claims judges."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tcc_sim.paper import claims, mean_pressure
from tcc_sim.paper.criteria import Claim


@pytest.fixture
def judge_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Has the command judge some claims only, and the mean pressure by the first two of the text's numbers."""
    def choose(*chosen: Claim) -> None:
        monkeypatch.setattr(claims, "CLAIMS", chosen)

    monkeypatch.setattr(mean_pressure, "NUMBERS", mean_pressure.NUMBERS[:2])
    return choose
