"""The paper's claims, each judged by a criterion in code, and again at a tighter tolerance; and the page of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tcc_sim.output.tables import escape, markdown_table, text
from tcc_sim.paper import (
    claims_figure4,
    claims_figures5to7,
    claims_interaction,
    claims_model,
    claims_series,
    claims_varying_load,
)
from tcc_sim.paper.criteria import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding
from tcc_sim.paper.evidence import LATER
from tcc_sim.paper.mean_pressure import PressureTable, pressure_lines
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


def claims_page(verdicts: list[Verdict], pressures: PressureTable | None, *, complete: bool = True) -> str:
    """A summary, the tables of claims and of mean pressures where there is one, and every claim with its numbers."""
    lines = ["# The paper's claims", "", f"- {counts_of(verdicts)}.", "",
             "This page is generated: `tcc-sim claims --markdown FILE` writes it. Each claim of Duan and Singh is "
             "judged by the",
             f"criterion printed with it, at the relative tolerances {TOLERANCE:g} and {TIGHTER:g}. \"Depends\": the "
             "criterion says for what, such as",
             "some of several numbers, or a weaker statement that holds; or the verdicts at the two tolerances differ. "
             "The paper does not",
             "print the mean pressure of Figs. 4 to 18; it is 225 kPa here. Frequencies are ratios omega/omega_n. A "
             "motion that the paper's",
             f"150 cycles leave before its section repeats goes on for {LATER} more before it counts as aperiodic; "
             "slip that grows without end",
             "is neither. Where motions coexist the stable ones found are listed: where each begins and ends, and to "
             "which of them the",
             "initial state (13) leads.", "",
             *markdown_table(["Fig.", "Section", "claim", "verdict"], map(claim_row, verdicts))]
    if not complete:
        lines += ["", "**Interrupted: not every claim was judged.**"]
    if pressures is not None:
        lines += ["", *pressure_lines(pressures)]
    for v in verdicts:
        lines += ["", *claim_section(v)]
    return "\n".join(lines) + "\n"


def claim_row(v: Verdict) -> list[str]:
    """The cells of the table on one claim."""
    return [v.finding.figure, v.finding.where, escape(v.finding.claim), v.verdict]


def claim_section(v: Verdict) -> list[str]:
    """The part of the page on one claim."""
    found = v.finding
    lines = [f"## {found.figure}: {escape(found.claim)}", "",
             f"**{v.verdict.capitalize()}**. Criterion: {escape(found.criterion)}."]
    if v.why:
        lines += ["", f"{escape(v.why[0].upper() + v.why[1:])}."]
    lines += listed_numbers(json_of(found.values))
    if found.motions:
        lines += ["", "Stable motions:", "", *(f"- {escape(str(motion))}" for motion in found.motions)]
    return lines


def listed_numbers(values: Mapping[str, Any]) -> list[str]:
    """Numbers as a list, with an empty line before it where there are any."""
    return [""] * bool(values) + [f"- {escape(name)}: {escape(text(value))}" for name, value in values.items()]


def counts_of(verdicts: list[Verdict]) -> str:
    """How many claims there are of each verdict."""
    found = [v.verdict for v in verdicts]
    words = {CONFIRMED: "confirmed", DEPENDS: "depend", NOT_CONFIRMED: "not confirmed"}
    counts = ", ".join(f"{found.count(name)} {word}" for name, word in words.items())
    return f"Of {len(found)} claims: {counts}"
