"""The paper's claims, each judged by a criterion in code at several mean pressures and two tolerances; the pages of the
claims and of the errata.
"""

from __future__ import annotations

import json
import math
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, fields
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from tcc_sim.errors import counted
from tcc_sim.output.tables import escape, markdown_table, text
from tcc_sim.result import Described, json_of, reported, result_class
from tcc_sim.study.paper import measures
from tcc_sim.study.paper.evidence import THRESHOLDS, Evidence, Motion, T
from tcc_sim.study.paper.measures import Measured

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
SOME = "; depends where some are so and others are not"
MOST = f"{1.0 - T.missing:g} or more of"
Limit = Callable[[str], float]
"""Function that returns a threshold by its name."""
TOLERANCE = 1e-9
TIGHTER = 1e-11
"""Relative tolerances of the smoothed engine; a verdict is `depends` if they differ at the first pressure."""
PRESSURES = (225e3, 230e3, 240e3)
"""Mean pressures of Figs. 4 to 18, Pa. The paper does not print the pressure; of 200 to 260 kPa, these agree with all
numbers of the text that depend on it. Values are shown at the first one.
"""
VERDICTS = {NOT_CONFIRMED: ("no", "not confirmed"), DEPENDS: ("depends", "depend"), CONFIRMED: ("yes", "confirmed")}
"""Words of each verdict in a cell of the table and in a count, in the order of the page."""


@result_class
class Criterion:
    """Criterion in words, and the function of `Measured.judged` that gives the verdict."""

    words: str = reported("how it is judged, with every threshold", name="criterion")
    verdict: Callable[[Sequence[Any], Limit], str] = field(compare=False)


def holds(statement: str, weaker: str = "") -> Criterion:
    """Judge whether a statement holds, and for "depends" a weaker one if there is one; judged: whether each holds."""
    return Criterion(statement + (f"; depends where {weaker}" if weaker else ""), lambda judged, limit:
                     CONFIRMED if judged[0] else DEPENDS if weaker and judged[1] else NOT_CONFIRMED)


def shares(of: str, partly: float = 0.75) -> Criterion:
    """Judge parts of the cases `of`: all but `missing`, or at least `partly`; judged: the parts, 0 to 1."""
    def verdict(judged: Sequence[Any], limit: Limit) -> str:
        least = 1.0 - limit("missing")
        return CONFIRMED if min(judged) >= least else \
            DEPENDS if min(judged) >= partly or max(judged) >= least else NOT_CONFIRMED
    return Criterion(f"{of} at {MOST} them; depends where at {partly:g} or more, or in one of several parts alone",
                     verdict)


def near(of: str, within: float) -> Criterion:
    """Judge the distance of computed numbers `of` some kind from printed ones; judged: pairs, None for no number."""
    return Criterion(f"{of} within {within:g}{SOME}", lambda judged, limit: some([
        value is not None and math.isfinite(value) and abs(value - text) <= within * limit("factor")
        for value, text in judged]))


def equal(of: str) -> Criterion:
    """Judge whether results are the expected ones; judged: pairs of both."""
    return Criterion(of + SOME, lambda judged, limit: some([value == expected for value, expected in judged]))


def some(hits: Sequence[bool]) -> str:
    """Return the verdict on several hits: confirmed if all are true, depends if some are."""
    return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


RULES: dict[str, tuple[Any, ...]] = {"holds": (holds, "weaker"), "shares": (shares, "partly"),
                                     "near": (near, "within"), "equal": (equal,)}
"""Rules of criteria and their options in claims.yaml."""


@result_class
class Finding:
    """A claim judged once: its verdict, values, reason and motions as JSON, and the names of the thresholds used."""

    values: Mapping[str, Any] = reported("numbers that the verdict rests on")
    verdict: str
    why: str = ""
    motions: Sequence[Mapping[str, Any]] = reported(
        "stable motions found where motions coexist", of=(Motion,), default=())
    thresholds: Sequence[str] = ()


@result_class
class Claim:
    """A claim with its criterion; called with evidence it returns the finding.

    measure : computes the quantities to judge from evidence
    name : name of the claim in claims.yaml, tests and files
    cheap : whether it takes less than about a second, so that every test run compares the page with it
    alone : whether it does not depend on the mean pressure of Figs. 4 to 18
    why, labels : a reason, for measures that find one, and words of the page for the names of values
    """

    figure: str = reported("figure or equation of the paper")
    where: str = reported("sections of the paper")
    sentence: str = reported("statement of the paper, in our words", name="claim")
    criterion: Criterion = reported("criterion", spread=True)
    measure: Callable[[Evidence], Measured] = field(compare=False)
    name: str
    cheap: bool = False
    fitted: bool = reported("whether its number chose the mean pressures", default=False)
    alone: bool = False
    why: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, evidence: Evidence) -> Finding:
        """Compute and judge the claim."""
        evidence.used.clear()
        measured = self.measure(evidence)
        verdict = self.criterion.verdict(measured.judged, evidence.limit)
        why = measured.why if isinstance(measured.why, str) else self.why * measured.why
        values = {self.labels.get(name, name): value for name, value in measured.values.items()}
        return Finding(values, verdict, why, json_of(measured.motions), sorted(evidence.used))


def claims_in(rows: Mapping[str, Mapping[str, Any]], phrases: Mapping[str, str]) -> list[Claim]:
    """Return the claims of a file; names in braces are phrases or constants of `measures`."""
    claims, every = [], vars(measures)
    named = {"most": MOST, **{name: text.format_map(every) for name, text in phrases.items()}}
    for name, row in rows.items():
        measure, given = row.get("measure", name), row.get("given", {})
        known = ChainMap(given, named, every)
        words = {key: text.format_map(known) if isinstance(text, str) else text for key, text in row.items()}
        criterion, = (rule(words[key], *(words[option] for option in options if option in row))
                      for key, (rule, *options) in RULES.items() if key in row)
        labels = {key: text.format_map(known) for key, text in row.get("values", {}).items()}
        figure, where, *kind = row["at"]
        claims.append(Claim(figure, where, row["claim"], criterion, partial(every[measure], **given), name,
                            why=row.get("why", ""), labels=labels, **dict.fromkeys(kind, True)))
    return claims


INTRODUCTION, _phrases, _rows = yaml.safe_load_all(Path(__file__).with_name("claims.yaml").read_text(encoding="utf-8"))
CLAIMS: tuple[Claim, ...] = tuple(claims_in(_rows, _phrases))
"""Every claim in the order of the paper, and the introduction of their page."""


@result_class
class Verdict:
    """A claim judged at several mean pressures and at two tolerances, with the finding at the tighter one."""

    row: Claim = reported("claim", spread=True)
    finding: Finding = reported("finding", spread=True)
    varied: Mapping[str, Sequence[str]] = reported(
        "with --thresholds: by threshold the verdicts at half and at twice of it", name="thresholds")
    verdicts: Mapping[str, str] = reported("verdict at each tolerance, at the first mean pressure")
    pressures: Mapping[str, str] = reported("verdict at each mean pressure, by its value in kPa")
    verdict: str = reported("confirmed, not confirmed or depends")
    depends_on: str | None = reported("pressure, tolerance or part (of the claim); null for another verdict")
    why: str = reported("of the verdict")


def verdict_on(row: Claim, finding: Finding, judged: Mapping[float, Sequence[str]],
               varied: Mapping[str, Sequence[str]] = MappingProxyType({})) -> Verdict:
    """Return the verdict on a claim from those by mean pressure, Pa: at TOLERANCE, and at the first pressure also at
    TIGHTER; where they differ, it depends.
    """
    pressures = {f"{p / 1e3:g}": v[0] if len(set(v)) == 1 else DEPENDS for p, v in judged.items()}
    by_tolerance, by_pressure = any(len(set(v)) > 1 for v in judged.values()), len(set(pressures.values())) > 1
    verdict = DEPENDS if by_pressure else next(iter(pressures.values()))
    on = "pressure" if by_pressure else "tolerance" if by_tolerance else "part"
    changes = ["the verdict changes with the tolerance"] * by_tolerance
    changes += ["the verdict changes with the mean pressure: " + ", ".join(
        f"{v} at {p} kPa" for p, v in pressures.items())] * by_pressure
    return Verdict(row, finding, varied, dict(zip((f"{TOLERANCE:g}", f"{TIGHTER:g}"), next(iter(judged.values())))),
                   pressures, verdict, on if verdict == DEPENDS else None,
                   "; ".join(filter(None, [*changes, finding.why])))


@result_class
class ClaimsReport(Described):
    """Verdicts on the claims."""

    claims: Sequence[Verdict] = reported("every claim")
    complete: bool = reported("whether every claim was judged")


def _judged(row: Claim, evidence: Evidence, stored: dict[str, Finding], path: Path | None) -> Finding:
    """Return the stored finding on a claim, or judge and store it; a changed criterion is judged again."""
    apart = [f"{name} {factor * THRESHOLDS[name][0]:g}, " for name, factor in evidence.factors.items()]
    name = f"{row.name} at {evidence.pressure:g} Pa, {''.join(apart)}rtol {evidence.rtol:g}: {row.criterion.words}"
    if name not in stored:
        stored[name] = row(evidence)
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"name": name, "finding": json_of(vars(stored[name]))}) + "\n")
    return stored[name]


def judge(claims: Sequence[Claim] = (), *, pressures: Sequence[float] = PRESSURES, kept: Path | None = None,
          thresholds: bool = False, jobs: int | None = None, progress: bool = False,
          each: Callable[[Verdict], None] = lambda verdict: None) -> list[Verdict]:
    """Judge claims at every mean pressure, and at the first of them at both tolerances.

    claims : claims to judge; empty for all
    pressures : mean pressures, Pa; a claim that does not depend on the pressure is judged once
    kept : file of finished findings; each new finding is added to it
    thresholds : whether to judge also with every threshold halved and doubled
    jobs : number of threads; all available cores by default
    progress : whether to show a bar for every sweep on a terminal
    each : function called with each finished verdict

    Raise NumericalFailure if a motion that a verdict needs could not be solved.
    """
    first, out, known = pressures[0], list[Verdict](), {item.name for item in fields(Finding)}
    lines = kept.read_text(encoding="utf-8").splitlines() if kept is not None and kept.exists() else []
    stored = {line["name"]: Finding(**{k: v for k, v in line["finding"].items() if k in known})
              for line in map(json.loads, lines)}
    every = {p: [Evidence(TOLERANCE, jobs, progress, p)] for p in pressures}
    every[first].append(Evidence(TIGHTER, jobs, progress, first, known=every[first][0].known))
    for row in claims or CLAIMS:
        findings = {p: [_judged(row, evidence, stored, kept) for evidence in every[p]]
                    for p in (pressures[:1] if row.alone else pressures)}
        varied = {name: [_judged(row, every[first][0].varied(name, factor), stored, kept).verdict
                         for factor in (0.5, 2.0)]
                  for name in findings[first][0].thresholds} if thresholds else {}
        judged = {p: [f.verdict for f in at] for p, at in findings.items()}
        out.append(verdict_on(row, findings[first][1], judged, varied))
        each(out[-1])
    return out


def claims_page(verdicts: Sequence[Verdict], *, complete: bool = True) -> str:
    """Return a summary and the claims by verdict, with the reasons of those that are not confirmed."""
    places = list(dict.fromkeys(p for v in verdicts for p in v.pressures))
    lines = ["# The paper's claims", "", f"{counts_of(verdicts)}.", "", INTRODUCTION.format(
        fitting=", ".join(f"{p / 1e3:g}" for p in PRESSURES), first=places[0], tighter=TIGHTER, tolerance=TOLERANCE,
        judged=", ".join(places))]
    lines += ["**Interrupted: not every claim was judged.**", ""] * (not complete)
    for name in VERDICTS:
        if named := [v for v in verdicts if v.verdict == name]:
            lines += [f"## {name.capitalize()}", "", *map(claim_line, named), ""]
    if any(v.varied for v in verdicts):
        rows = [threshold_row(verdicts, name) for name in THRESHOLDS]
        alike = [f"`{name}` ({row[2]})" for name, row in zip(THRESHOLDS, rows) if {*row[3:]} == {"none"}]
        lines += [f"## Thresholds halved and doubled, at {places[0]} kPa", "",
                  *markdown_table(["threshold", "meaning", "value", "halved", "doubled"],
                                  [row for row in rows if {*row[3:]} != {"none"}]),
                  *(["", f"No verdict changes with {', '.join(alike)}."] if alike else []), ""]
    return "\n".join(lines)


def claim_line(v: Verdict) -> str:
    """Return one claim as an entry of a list: what its verdict depends on, reason."""
    by = {"pressure": ", ".join(VERDICTS[x][0] for x in v.pressures.values()), "tolerance": "by tolerance"}
    notes = [by.get(v.depends_on or "", ""), "fitted" * v.row.fitted, "any pressure" * v.row.alone]
    said = f" [{'; '.join(filter(None, notes))}]" if any(notes) else ""
    reasons = [f"Criterion: {v.row.criterion.words}" * (v.verdict == NOT_CONFIRMED),
               v.finding.why * (v.verdict != CONFIRMED)]
    because = "".join(f" {escape(text[0].upper() + text[1:])}." for text in reasons if text)
    return f"- **{v.row.figure}** ({v.row.where}): {escape(v.row.sentence)}{said}.{because}"


def threshold_row(verdicts: Sequence[Verdict], name: str) -> list[str]:
    """Return the cells on one threshold: the claims with another verdict at half and at twice its value."""
    judged = [(v, next(iter(v.verdicts.values())), v.varied[name]) for v in verdicts if name in v.varied]
    changes = ["; ".join(f"{v.row.figure}: {escape(v.row.sentence)} ({varied[k]} instead of {usual})"
                         for v, usual, varied in judged if varied[k] != usual) or "none" for k in range(2)]
    value, unit, meaning = THRESHOLDS[name]
    return [f"`{name}`, in {counted(len(judged), 'claim')}", escape(meaning), f"{value:g} {unit}".rstrip(), *changes]


def counts_of(verdicts: Sequence[Verdict]) -> str:
    """Return the number of claims with each verdict, as text."""
    words = [v.verdict for v in verdicts]
    return f"Of {len(words)} claims: " + ", ".join(f"{words.count(name)} {VERDICTS[name][1]}"
                                                   for name in (CONFIRMED, DEPENDS, NOT_CONFIRMED))


ERRATA: Mapping[str, Any] = yaml.safe_load(Path(__file__).with_name("errata.yaml").read_text(encoding="utf-8"))
"""Errata in the order of the paper, values that it leaves open, with those taken here, and texts of the page."""


def errata_page() -> str:
    """Return the page of the errata with their numbers, of the right equations, and of the values left open."""
    return "\n".join([
        "# The paper's errata", "", ERRATA["page"].format(errata=len(ERRATA["errata"]), open=len(ERRATA["open"])),
        *map(erratum_line, ERRATA["errata"]), "", f"Derived again and found as printed: {escape(ERRATA['right'])}.", "",
        "## Left open by the paper", "",
        *(f"- {escape(what)}: {escape(here)}" for what, here in ERRATA["open"].items()),
        "", f"Figs. 4 to 18: {escape(_listed(ERRATA['speeds']))}"]) + "\n"


def erratum_line(erratum: Mapping[str, Any]) -> str:
    """Return one erratum as an entry of a list: both forms, the reason, and its numbers."""
    parts = {name.capitalize(): erratum[name] for name in ("printed", "right", "why")}
    parts["Numbers"] = _listed(erratum.get("numbers", {}))
    return " ".join([f"- **{escape(erratum['where'])}**", *(f"{name}: {escape(x)}." for name, x in parts.items() if x)])


def _listed(numbers: Mapping[str, Any]) -> str:
    return "; ".join(f"{name}: {text(value)}" for name, value in numbers.items())
