"""The paper's claims, each judged by a criterion in code at several mean pressures and two tolerances; their page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from tcc_sim.errors import counted
from tcc_sim.output.tables import escape, markdown_table, text
from tcc_sim.paper import (
    claims_families,
    claims_figure4,
    claims_figures5to7,
    claims_interaction,
    claims_model,
    claims_series,
    claims_varying_load,
)
from tcc_sim.paper.criteria import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding
from tcc_sim.paper.evidence import LATER, T
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.result import json_of

MODULES = (claims_model, claims_figure4, claims_figures5to7, claims_varying_load, claims_series, claims_interaction)
CLAIMS: tuple[Claim, ...] = (*claims_families.ROWS, *(
    row for module in MODULES for row in vars(module).values() if isinstance(row, Claim)))
"""Every claim in the order of the paper."""
TOLERANCE = 1e-9
TIGHTER = 1e-11
"""Relative tolerances of the smoothed engine; a verdict that differs between them at the first pressure depends."""
PRESSURES = (225e3, 230e3, 240e3)
"""Mean pressures of Figs. 4 to 18, Pa. The paper does not print it; of 200 to 260 kPa these agree with all numbers of
the text that depend on it. Values are shown at the first one.
"""
ORDER = {NOT_CONFIRMED: "Not confirmed", DEPENDS: "Depends", CONFIRMED: "Confirmed"}
"""The verdicts in the order of the page."""


@dataclass(frozen=True)
class Verdict:
    """A claim judged at several mean pressures and at two tolerances.

    row : the claim
    finding : at the first pressure and the tighter tolerance
    judged : by mean pressure, Pa, the verdict at TOLERANCE, and at the first pressure that at TIGHTER
    varied : where asked for, by threshold that the criterion uses the verdicts at half and at twice of it, at the first
        pressure and TOLERANCE
    """

    row: Claim
    finding: Finding
    judged: Mapping[float, tuple[str, ...]]
    varied: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def pressures(self) -> dict[str, str]:
        """The verdict at each mean pressure, kPa: the one at every tolerance, or depends."""
        return {f"{p / 1e3:g}": v[0] if len(set(v)) == 1 else DEPENDS for p, v in self.judged.items()}

    @property
    def verdict(self) -> str:
        """The verdict that holds at every pressure, or depends."""
        return found.pop() if len(found := set(self.pressures.values())) == 1 else DEPENDS

    @property
    def why(self) -> str:
        """What explains the verdict."""
        changes = ["the verdict changes with the tolerance"] * any(len(set(v)) > 1 for v in self.judged.values())
        if len(set(self.pressures.values())) > 1:
            changes.append("the verdict changes with the mean pressure: "
                           + ", ".join(f"{v} at {p} kPa" for p, v in self.pressures.items()))
        return "; ".join([*changes, *([self.finding.why] if self.finding.why else [])])

    def as_json(self) -> dict[str, Any]:
        """figure, where, claim, criterion, values, verdict, why, motions, and the verdict at each pressure."""
        found = self.finding
        at_first = dict(zip((f"{TOLERANCE:g}", f"{TIGHTER:g}"), next(iter(self.judged.values()))))
        return {"figure": found.figure, "where": found.where, "claim": found.claim, "criterion": found.criterion,
                "values": json_of(found.values), "verdict": self.verdict, "why": self.why,
                "motions": list(found.motions), "verdicts": at_first,
                "pressures": self.pressures, "fitted": self.row.fitted,
                "thresholds": {name: list(pair) for name, pair in self.varied.items()}}


class FindingFile:
    """Findings in a file of lines, so that an interrupted run goes on; a changed criterion is judged anew."""

    def __init__(self, path: Path | None) -> None:
        self.path, self.found = path, dict[str, Finding]()
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                row = json.loads(line)
                self.found[row["name"]] = Finding(**row["finding"])

    def judged(self, row: Claim, evidence: StableMotions) -> Finding:
        """Return the finding that is kept, or work it out and keep it."""
        apart = [f"{item.name} {x:g}, " for item in fields(T) if (x := getattr(evidence.thresholds, item.name))
                 != item.default]
        name = f"{row.name} at {evidence.pressure:g} Pa, {''.join(apart)}rtol {evidence.rtol:g}: {row.criterion.words}"
        if name not in self.found:
            evidence.used.clear()
            self.found[name] = replace(row(evidence), thresholds=sorted(evidence.used))
            if self.path is not None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"name": name, "finding": json_of(asdict(self.found[name]))}) + "\n")
        return self.found[name]


def judge(claims: Sequence[Claim] = (), *, pressures: Sequence[float] = PRESSURES, kept: Path | None = None,
          thresholds: bool = False, jobs: int | None = None, progress: bool = False,
          each: Callable[[Verdict], None] = lambda verdict: None) -> list[Verdict]:
    """Judge claims at every mean pressure, and at the first of them at both tolerances.

    Parameters
    ----------
    claims : which; all where empty
    pressures : Pa; a claim that does not depend on it is judged once
    kept : file of what was judged before, to go on from; each finding is added to it
    thresholds : judge with every threshold halved and doubled too
    jobs : threads; all available cores by default
    progress : show a bar for every sweep on a terminal
    each : called with every verdict as it is reached

    Raises
    ------
    NumericalFailure
        A motion that a verdict rests on could not be solved.
    """
    first, before, out = pressures[0], FindingFile(kept), []
    every = {p: [StableMotions(TOLERANCE, jobs, progress, p)] for p in pressures}
    every[first].append(StableMotions(TIGHTER, jobs, progress, first, known=every[first][0].known))
    for row in claims or CLAIMS:
        findings = {p: [before.judged(row, evidence) for evidence in every[p]]
                    for p in (pressures[:1] if row.alone else pressures)}
        varied = {name: (before.judged(row, every[first][0].varied(name, 0.5)).verdict,
                         before.judged(row, every[first][0].varied(name, 2.0)).verdict)
                  for name in findings[first][0].thresholds} if thresholds else {}
        verdict = Verdict(row, findings[first][1], {p: tuple(f.verdict for f in at) for p, at in findings.items()},
                          varied)
        out.append(verdict)
        each(verdict)
    return out


def claims_page(verdicts: list[Verdict], *, complete: bool = True) -> str:
    """A summary, a table of the claims by verdict, and every claim with its numbers."""
    places = list(dict.fromkeys(p for v in verdicts for p in v.pressures))
    kpa = f"{', '.join(places)} kPa"
    lines = ["# The paper's claims", "", f"- {counts_of(verdicts)}.", "",
             "This page is generated: `tcc-sim claims --markdown FILE` writes it. Each claim of Duan and Singh is "
             "judged by the",
             f"criterion printed with it, at a mean pressure of {kpa} with the relative tolerance {TOLERANCE:g}, at "
             f"the first also with {TIGHTER:g}. The paper",
             "does not print the mean pressure of Figs. 4 to 18; of 200 to 260 kPa "
             f"{', '.join(f'{p / 1e3:g}' for p in PRESSURES)} agree with all numbers of the text",
             "that depend on it, and the claims on those numbers are marked as fitted. \"Depends\": the criterion says "
             "for what, such as some of several",
             "numbers, or a weaker statement that holds; or the verdicts differ between pressures or tolerances. "
             f"Values are those at {places[0]} kPa. Frequencies",
             "are ratios omega/omega_n. Each motion has 150 cycles, the first 50 dropped; one whose section does not "
             "repeat by then goes on for",
             f"{LATER} more before it counts as aperiodic; slip that grows without end is neither. Where motions "
             "coexist the stable ones found are",
             "listed: where each begins and ends, and to which of them the initial state (13) leads.", ""]
    found = [v for name in ORDER for v in verdicts if v.verdict == name]
    lines += markdown_table(["Fig.", "Section", "claim", "verdict", f"at {kpa}"], map(claim_row, found))
    if any(v.varied for v in verdicts):
        lines += ["", "## Thresholds halved and doubled", "", f"The verdicts that change, at {places[0]} kPa; a row "
                  "without entries changes none.", "",
                  *markdown_table(["threshold", "value", "halved", "doubled"], map(partial(threshold_row, verdicts),
                                                                                   fields(T)))]
    if not complete:
        lines += ["", "**Interrupted: not every claim was judged.**"]
    for v in found:
        lines += ["", *claim_section(v)]
    return "\n".join(lines) + "\n"


SHORT = {CONFIRMED: "yes", NOT_CONFIRMED: "no", DEPENDS: "depends"}
"""Verdicts in a cell of the table."""


def claim_row(v: Verdict) -> list[str]:
    """The cells of the table on one claim."""
    at = "any" if v.row.alone else ", ".join(SHORT[x] for x in v.pressures.values())
    return [v.finding.figure, v.finding.where, escape(v.finding.claim), v.verdict, at + " (fitted)" * v.row.fitted]


def threshold_row(verdicts: Sequence[Verdict], item: Field[float]) -> list[str]:
    """The cells on one threshold: the claims whose verdict is another one at half and at twice of it."""
    changes = [[f"{v.finding.figure}: {escape(v.finding.claim)} ({v.varied[item.name][k]} instead of "
                f"{next(iter(v.judged.values()))[0]})" for v in verdicts
                if item.name in v.varied and v.varied[item.name][k] != next(iter(v.judged.values()))[0]]
               for k in range(2)]
    used = sum(item.name in v.varied for v in verdicts)
    return [f"`{item.name}`, in {used} claims", f"{item.default:g}", *("; ".join(found) or "none" for found in changes)]


def claim_section(v: Verdict) -> list[str]:
    """The part of the page on one claim."""
    found = v.finding
    lines = [f"## {found.figure}: {escape(found.claim)}", "",
             f"**{v.verdict.capitalize()}**. Criterion: {escape(found.criterion)}."]
    if v.why:
        lines += ["", f"{escape(v.why[0].upper() + v.why[1:])}."]
    lines += listed_numbers(json_of(found.values))
    if found.motions:
        lines += ["", f"<details><summary>{counted(len(found.motions), 'stable motion')}</summary>", "",
                  *(f"- {escape(str(motion['words']))}" for motion in found.motions), "", "</details>"]
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
