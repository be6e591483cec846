"""The paper's claims, each judged by a criterion in code, and again at a tighter tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tcc_sim.paper import (
    claims_figure4,
    claims_figures5to7,
    claims_interaction,
    claims_model,
    claims_series,
    claims_varying_load,
)
from tcc_sim.paper.criteria import DEPENDS, Claim, Finding
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.result import json_of

MODULES = (claims_model, claims_figure4, claims_figures5to7, claims_varying_load, claims_series, claims_interaction)
CLAIMS: tuple[Claim, ...] = tuple(row for module in MODULES for row in vars(module).values() if isinstance(row, Claim))
"""Every claim in the order of the paper."""
TOLERANCE = 1e-9
TIGHTER = 1e-11
"""Relative tolerances of the smoothed engine; a verdict that differs between them depends."""


@dataclass(frozen=True)
class Verdict:
    """A claim judged at two tolerances.

    finding : at the tighter one
    looser : the verdict at the looser one
    """

    finding: Finding
    looser: str

    @property
    def verdict(self) -> str:
        """The verdict that holds at both, or depends."""
        return self.finding.verdict if self.finding.verdict == self.looser else DEPENDS

    @property
    def why(self) -> str:
        """What explains the verdict."""
        if self.finding.verdict == self.looser:
            return self.finding.why
        return f"the verdict changes with the tolerance; {self.finding.why}".rstrip("; ")

    def as_json(self) -> dict[str, Any]:
        """figure, where, claim, values, criterion, verdict, why, motions, and the verdict at either tolerance."""
        found = self.finding
        return {"figure": found.figure, "where": found.where, "claim": found.claim, "criterion": found.criterion,
                "values": json_of(found.values), "verdict": self.verdict, "why": self.why,
                "motions": json_of([m.as_json() for m in found.motions]),
                "verdicts": {f"{TOLERANCE:g}": self.looser, f"{TIGHTER:g}": found.verdict}}


def judge(claims: Sequence[Claim] = (), *, jobs: int | None = None, progress: bool = False,
          each: Callable[[Verdict], None] = lambda verdict: None) -> list[Verdict]:
    """Judge claims at both tolerances.

    Parameters
    ----------
    claims : which; all where empty
    jobs : threads; all available cores by default
    progress : show a bar for every sweep on a terminal
    each : called with every verdict as it is reached

    Raises
    ------
    NumericalFailure
        A motion that a verdict rests on could not be solved.
    """
    loose = StableMotions(TOLERANCE, jobs, progress)
    tight = StableMotions(TIGHTER, jobs, progress, known=loose.known)
    out = []
    for claim in claims or CLAIMS:
        verdict = Verdict(claim(tight), claim(loose).verdict)
        out.append(verdict)
        each(verdict)
    return out
