"""The paper's claims, each judged by a criterion in code, and again at a tighter tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from tcc_sim.paper import claims_constant_load, claims_varying_load
from tcc_sim.paper.evidence import CONFIRMED, DEPENDS, NOT_CONFIRMED, Evidence, Finding

Judge = Callable[[Evidence], Finding]
CLAIMS: tuple[Judge, ...] = (*claims_constant_load.CLAIMS, *claims_varying_load.CLAIMS)
"""Every claim in the order of the paper's figures; (35) last."""
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
    loose, tight = Evidence(TOLERANCE, jobs, progress), Evidence(TIGHTER, jobs, progress)
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


def markdown(verdicts: list[Verdict], *, complete: bool = True) -> str:
    """The table of claims as a Markdown page, with the criterion and the numbers of every claim under it."""
    rows = [v.as_json() for v in verdicts]
    lines = ["# The paper's claims", "",
             "Written by `tcc-sim claims --markdown FILE`. Duan and Singh's claims about Figs. 2 to 18, judged by criteria in",
             f"code (`tcc_sim/paper/claims_*.py`) at the relative tolerances {TOLERANCE:g} and {TIGHTER:g}. The paper does not",
             "print the mean pressure of Figs. 4 to 18; it is 225 kPa here. Frequencies are ratios omega/omega_n.", "",
             "| Fig. | claim | verdict |", "|---|---|---|"]
    lines += [f"| {r['figure']} | {_escape(r['claim'])} | {r['verdict']} |" for r in rows]
    lines += ["", f"- {tally(verdicts)}."]
    if not complete:
        lines += ["", "**Interrupted: not every claim was judged.**"]
    for r in rows:
        lines += ["", f"## {r['figure']}: {_escape(r['claim'])}", ""]
        lines += [f"**{r['verdict'].capitalize()}**. Criterion: {_escape(r['criterion'])}."]
        if r["why"]:
            lines += ["", f"{_escape(r['why'][0].upper() + r['why'][1:])}."]
        lines += ["", *(f"- {_escape(name)}: {_escape(text(value))}" for name, value in r["values"].items())]
    return "\n".join(lines) + "\n"


def tally(verdicts: list[Verdict]) -> str:
    """How many claims there are of each verdict."""
    found = [v.as_json()["verdict"] for v in verdicts]
    words = {CONFIRMED: "confirmed", DEPENDS: "depend on a reading", NOT_CONFIRMED: "not confirmed"}
    counts = ", ".join(f"{found.count(name)} {word}" for name, word in words.items())
    return f"Of {len(found)} claims: {counts}"


def _escape(words: str) -> str:
    """Words with the signs that Markdown would take for its own."""
    return words.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")


def text(value: Any) -> str:
    """Numbers for people, with five digits."""
    if isinstance(value, dict):
        return ", ".join(f"{k}: {text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(text(v) for v in value) + "]"
    return f"{value:.5g}" if isinstance(value, float) else "none" if value is None else str(value)


__all__ = ["CLAIMS", "Verdict", "judge", "markdown", "text"]
