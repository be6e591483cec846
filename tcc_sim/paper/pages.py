"""What is found of the paper as Markdown: the page of its claims and that of its errata."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tcc_sim.output.tables import escape, markdown_table, text
from tcc_sim.paper.claims import TIGHTER, TOLERANCE, Verdict
from tcc_sim.paper.criteria import CONFIRMED, DEPENDS, NOT_CONFIRMED
from tcc_sim.paper.errata import ERRATA, OPEN, RIGHT, engine_speeds
from tcc_sim.paper.evidence import LATER
from tcc_sim.paper.mean_pressure import PressureTable
from tcc_sim.result import json_of


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
             *markdown_table(["Fig.", "Section", "claim", "verdict"], map(row_of, verdicts))]
    if not complete:
        lines += ["", "**Interrupted: not every claim was judged.**"]
    if pressures is not None:
        lines += ["", *pressure_lines(pressures)]
    for v in verdicts:
        lines += ["", *section_of(v)]
    return "\n".join(lines) + "\n"


def row_of(v: Verdict) -> list[str]:
    """The cells of the table on one claim."""
    return [v.finding.figure, v.finding.where, escape(v.finding.claim), v.verdict]


def section_of(v: Verdict) -> list[str]:
    """The part of the page on one claim."""
    found = v.finding
    lines = [f"## {found.figure}: {escape(found.claim)}", "",
             f"**{v.verdict.capitalize()}**. Criterion: {escape(found.criterion)}."]
    if v.why:
        lines += ["", f"{escape(v.why[0].upper() + v.why[1:])}."]
    lines += numbers_of(json_of(found.values))
    if found.motions:
        lines += ["", "Stable motions:", "", *(f"- {escape(str(motion))}" for motion in found.motions)]
    return lines


def pressure_lines(found: PressureTable) -> list[str]:
    """Which mean pressure agrees with how many of the text's numbers."""
    head = [f"Fig. {n.figure}: {escape(n.text)}" for n in found.numbers]
    rows = [[f"{row.pressure / 1e3:g}", *(f"**{text(x)}**" if fits else text(x) for x, fits in row.found),
             f"{row.count} of {len(row.found)}"] for row in found.rows]
    return ["## The mean pressure of Figs. 4 to 18", "",
            "What each mean pressure makes of numbers in the text; bold where it agrees with them.", "",
            *markdown_table(["kPa", *head, "agree"], rows, "---:"), "", f"{pressure_sentence(found)}."]


def pressure_sentence(found: PressureTable) -> str:
    """Which pressures agree with most."""
    names = [f"{row.pressure / 1e3:g}" for row in found.best()]
    agree = "agrees" if len(names) == 1 else "agree"
    return f"{', '.join(names)} kPa {agree} with {found.best()[0].count} of the {len(found.numbers)} numbers, the most"


def errata_page() -> str:
    """Every erratum with the numbers that show it, what is right as printed, and what the paper leaves open."""
    lines = ["# The paper's errata", "",
             f"{len(ERRATA)} places of the paper where another form is right, and {len(OPEN)} that it leaves open. "
             "This page is generated:",
             "`tcc-sim claims --errata FILE` writes it. Each place was derived again; the numbers are computed for "
             "Table 1 with",
             "mu_s N R = 540 N m where nothing else is said. Ratios are omega/omega_n.", "",
             *markdown_table(["where", "printed", "right", "in the code"], [
                 [escape(e.where), escape(e.printed), escape(e.right), f"`{e.code}`" if e.code else ""]
                 for e in ERRATA])]
    for e in ERRATA:
        lines += ["", f"## {escape(e.where)}: {escape(e.printed)}", "", f"{escape(e.why[0].upper() + e.why[1:])}."]
        lines += numbers_of(e.numbers())
    return "\n".join([*lines, "", "## Derived again and found as printed", "", f"{escape(RIGHT)}.", "",
                      "## Left open by the paper", "",
                      *markdown_table(["what", "here"], [[escape(what), escape(taken)] for what, taken in OPEN]),
                      *numbers_of(engine_speeds())]) + "\n"


def numbers_of(values: Mapping[str, Any]) -> list[str]:
    """Numbers as a list, with an empty line before it where there are any."""
    return [""] * bool(values) + [f"- {escape(name)}: {escape(text(value))}" for name, value in values.items()]


def counts_of(verdicts: list[Verdict]) -> str:
    """How many claims there are of each verdict."""
    found = [v.verdict for v in verdicts]
    words = {CONFIRMED: "confirmed", DEPENDS: "depend", NOT_CONFIRMED: "not confirmed"}
    counts = ", ".join(f"{found.count(name)} {word}" for name, word in words.items())
    return f"Of {len(found)} claims: {counts}"
