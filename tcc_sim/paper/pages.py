"""What is found of the paper as Markdown: the page of its claims and that of its errata."""

from __future__ import annotations

from typing import Any

from tcc_sim.paper.claims import TIGHTER, TOLERANCE, Verdict
from tcc_sim.paper.errata import ERRATA, OPEN, RIGHT
from tcc_sim.paper.evidence import CONFIRMED, DEPENDS, LATER, NOT_CONFIRMED
from tcc_sim.paper.mean_pressure import best
from tcc_sim.paper.stable_motions import words_of


def claims_page(verdicts: list[Verdict], pressures: dict[str, Any] | None, *, complete: bool = True) -> str:
    """The table of claims, that of mean pressures where there is one, and every claim with criterion and numbers."""
    rows = [v.as_json() for v in verdicts]
    lines = ["# The paper's claims", "",
             "Written by `tcc-sim claims --markdown FILE`. Duan and Singh's claims about Figs. 2 to 18, judged by "
             "criteria in",
             f"code (`tcc_sim/paper/claims_*.py`) at the relative tolerances {TOLERANCE:g} and {TIGHTER:g}. The "
             f"paper does not",
             "print the mean pressure of Figs. 4 to 18; it is 225 kPa here. Frequencies are ratios omega/omega_n. A "
             "motion that",
             f"the paper's 150 cycles leave before its section repeats goes on for {LATER} more before it counts as "
             "aperiodic.",
             "Where motions coexist the verdict rests on their branches: which stable ones there are, where each "
             "begins and",
             "ends (with the residual of the bifurcation there), and to which of them the initial state (13) leads.",
             "",
             "| Fig. | claim | verdict |", "|---|---|---|"]
    lines += [f"| {r['figure']} | {escape(r['claim'])} | {r['verdict']} |" for r in rows]
    lines += ["", f"- {tally(verdicts)}."]
    if not complete:
        lines += ["", "**Interrupted: not every claim was judged.**"]
    if pressures is not None:
        lines += ["", *pressure_table(pressures)]
    for r in rows:
        lines += ["", f"## {r['figure']}: {escape(r['claim'])}", ""]
        lines += [f"**{r['verdict'].capitalize()}**. Criterion: {escape(r['criterion'])}."]
        if r["why"]:
            lines += ["", f"{escape(r['why'][0].upper() + r['why'][1:])}."]
        lines += ["", *(f"- {escape(name)}: {escape(text(value))}" for name, value in r["values"].items())]
        if r["motions"]:
            lines += ["", "Stable motions, whatever was started from:", "",
                      *(f"- {escape(words_of(motion))}" for motion in r["motions"])]
    return "\n".join(lines) + "\n"


def pressure_table(found: dict[str, Any]) -> list[str]:
    """Which mean pressure agrees with how many of the text's numbers."""
    numbers = found["numbers"]
    lines = ["## The mean pressure of Figs. 4 to 18", "",
             "What each mean pressure makes of numbers in the text; bold where it agrees with them.", "",
             "| kPa | " + " | ".join(f"Fig. {n['figure']}: {escape(n['text'])}" for n in numbers) + " | agree |",
             "|" + " ---: |" * (len(numbers) + 2)]
    for row in found["rows"]:
        cells = [f"**{text(value)}**" if fits else text(value) for value, fits in zip(row["values"], row["fits"])]
        lines.append(f"| {row['pressure'] / 1e3:g} | " + " | ".join(cells) + f" | {row['count']} of {len(numbers)} |")
    return [*lines, "", f"{pressure_sentence(found)}."]


def pressure_sentence(found: dict[str, Any]) -> str:
    """Which pressures agree with most."""
    most = max(row["count"] for row in found["rows"])
    names = [f"{p / 1e3:g}" for p in best(found)]
    agree = "agrees" if len(names) == 1 else "agree"
    return f"{', '.join(names)} kPa {agree} with {most} of the {len(found['numbers'])} numbers, the most"


def errata_page() -> str:
    """Every erratum with the numbers that show it, what is right as printed, and what the paper leaves open."""
    lines = ["# The paper's errata", "",
             "Written by `tcc-sim claims --errata FILE` from the list in `tcc_sim/paper/errata.py`. Each was derived "
             "again; the",
             "numbers are computed for Table 1 with mu_s N R = 540 N m where nothing else is said. Ratios are "
             "omega/omega_n.", "",
             "| where | printed | right | in the code |", "|---|---|---|---|"]
    lines += [f"| {escape(e.where)} | {escape(e.printed)} | {escape(e.right)} | {f'`{e.code}`' if e.code else ''} |"
              for e in ERRATA]
    for e in ERRATA:
        lines += ["", f"## {escape(e.where)}: {escape(e.printed)}", "", f"{escape(e.why[0].upper() + e.why[1:])}."]
        values = e.numbers()
        if values:
            lines += ["", *(f"- {escape(name)}: {escape(text(value))}" for name, value in values.items())]
    lines += ["", "## Derived again and found as printed", "", f"{escape(RIGHT)}.", "", "## Left open by the paper", "",
              "| what | here |", "|---|---|", *(f"| {escape(what)} | {escape(taken)} |" for what, taken in OPEN)]
    return "\n".join(lines) + "\n"


def tally(verdicts: list[Verdict]) -> str:
    """How many claims there are of each verdict."""
    found = [v.as_json()["verdict"] for v in verdicts]
    words = {CONFIRMED: "confirmed", DEPENDS: "depend on a reading", NOT_CONFIRMED: "not confirmed"}
    counts = ", ".join(f"{found.count(name)} {word}" for name, word in words.items())
    return f"Of {len(found)} claims: {counts}"


def escape(words: str) -> str:
    """Words with the signs that Markdown would take for its own."""
    return words.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")


def text(value: Any) -> str:
    """Numbers for people, with five digits."""
    if isinstance(value, dict):
        return ", ".join(f"{k}: {text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(text(v) for v in value) + "]"
    return f"{value:.5g}" if isinstance(value, float) else "none" if value is None else str(value)
