"""The paper's claims, each judged by a criterion in code, and again at a tighter tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from tcc_sim.paper import claims_constant_load, claims_interaction, claims_model, claims_varying_load
from tcc_sim.paper.evidence import DEPENDS, Finding
from tcc_sim.paper.stable_motions import StableMotions

Judge = Callable[[StableMotions], Finding]
CLAIMS: tuple[Judge, ...] = (*claims_model.CLAIMS, *claims_constant_load.CLAIMS, *claims_varying_load.CLAIMS,
                             *claims_interaction.CLAIMS, claims_model.series_balance,
                             *claims_varying_load.SERIES_CLAIMS)
"""Every claim in the order of the paper's figures; the series (30) to (35) last."""
TOLERANCE = 1e-9
TIGHTER = 1e-11
"""Relative tolerances of the smoothed engine; a verdict that differs between them depends."""


@dataclass(frozen=True)
class Verdict:
    """A claim judged at two tolerances.

    finding : at the tighter one, with the verdict that holds for both, or depends
    looser : the verdict at the looser one
    """

    finding: Finding
    looser: str

    def as_json(self) -> dict[str, Any]:
        """figure, claim, values, criterion, verdict, why, and the verdict at either tolerance."""
        out: dict[str, Any] = _plain(asdict(self.finding))
        out["verdicts"] = {f"{TOLERANCE:g}": self.looser, f"{TIGHTER:g}": self.finding.verdict}
        if self.finding.verdict != self.looser:
            out["verdict"] = DEPENDS
            out["why"] = f"the verdict changes with the tolerance; {self.finding.why}".rstrip("; ")
        return out


def judge(*, jobs: int | None = None, progress: bool = False, claims: tuple[Judge, ...] = CLAIMS,
          each: Callable[[Verdict], None] = lambda verdict: None) -> list[Verdict]:
    """Judge every claim at both tolerances.

    Parameters
    ----------
    jobs : threads; all available cores by default
    progress : show a bar for every sweep on a terminal
    claims : which
    each : called with every verdict as it is reached

    Raises
    ------
    NumericalFailure
        A motion that a verdict rests on could not be solved.
    """
    loose = StableMotions(TOLERANCE, jobs, progress)
    tight = StableMotions(TIGHTER, jobs, progress, known=loose.known)
    out = []
    for claim in claims:
        verdict = Verdict(claim(tight), claim(loose).verdict)
        out.append(verdict)
        each(verdict)
    return out


def _plain(value: Any) -> Any:
    """Numbers as JSON has them: NumPy's as Python's, and none that is not finite."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
