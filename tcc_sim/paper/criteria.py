"""A claim of the paper as a row: sentence, place, criterion, and the function that computes its values.

The words of a criterion, with every threshold, are printed beside the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.paper.evidence import T
from tcc_sim.paper.stable_motions import Motion, StableMotions
from tcc_sim.result import json_of, reported

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
SOME = "; depends where some are so and others are not"
Limit = Callable[[str], float]
"""Function that returns a threshold by its name."""


@dataclass(frozen=True)
class Criterion:
    """Criterion in words, and the function of `Measured.judged` that gives the verdict."""

    words: str = field(metadata=reported("how it is judged, with every threshold", name="criterion"))
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
    return Criterion(f"{of} at {1.0 - T.missing:g} or more of them; depends where at {partly:g} or more, or in one of "
                     "several parts alone", verdict)


def near(of: str, within: float) -> Criterion:
    """Judge the distance of computed numbers `of` some kind from printed ones; judged: pairs, None for no number."""
    return Criterion(f"{of} within {within:g}{SOME}", lambda judged, limit: some([
        found is not None and math.isfinite(found) and abs(found - text) <= within * limit("factor")
        for found, text in judged]))


def equal(of: str) -> Criterion:
    """Judge whether results are the expected ones; judged: pairs of both."""
    return Criterion(of + SOME, lambda judged, limit: some([found == expected for found, expected in judged]))


def some(hits: Sequence[bool]) -> str:
    """Return the verdict on several hits: confirmed if all are true, depends if some are."""
    return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


@dataclass(frozen=True)
class Measured:
    """Quantities that the criterion judges, values for the reader, a reason, and the stable motions that coexist."""

    judged: Sequence[Any]
    values: Mapping[str, Any]
    why: str = ""
    motions: Sequence[Motion] = ()


@dataclass(frozen=True)
class Finding:
    """A claim judged once: its verdict, values, reason and motions as JSON, and the names of the thresholds used."""

    values: Mapping[str, Any] = field(metadata=reported("numbers that the verdict rests on"))
    verdict: str
    why: str = ""
    motions: Sequence[Mapping[str, Any]] = field(default=(), metadata=reported(
        "where motions coexist: the stable ones that were found", of=(Motion,)))
    thresholds: Sequence[str] = ()


@dataclass(frozen=True)
class Claim:
    """A row of the table of claims; called with evidence it returns the finding.

    measure : computes the quantities to judge from evidence
    name : name of the claim in tests and files
    cheap : whether it takes less than about a second, so that every test run compares the page with it
    alone : whether it does not depend on the mean pressure of Figs. 4 to 18
    """

    figure: str = field(metadata=reported("figure or equation of the paper"))
    where: str = field(metadata=reported("sections of the paper"))
    sentence: str = field(metadata=reported("statement of the paper, in our words", name="claim"))
    criterion: Criterion = field(metadata=reported("criterion", spread=True))
    measure: Callable[[StableMotions], Measured] = field(compare=False)
    name: str
    cheap: bool = False
    fitted: bool = field(default=False, metadata=reported("whether its number chose the mean pressures"))
    alone: bool = False

    def __call__(self, evidence: StableMotions) -> Finding:
        """Compute and judge the claim."""
        evidence.used.clear()
        found = self.measure(evidence)
        verdict = self.criterion.verdict(found.judged, evidence.limit)
        return Finding(found.values, verdict, found.why, json_of(found.motions), sorted(evidence.used))


def claim(figure: str, where: str, sentence: str, criterion: Criterion,
          **kind: bool) -> Callable[[Callable[..., Measured]], Claim]:
    """Return a decorator that makes a claim of the function that computes its quantities."""
    return lambda measure: Claim(figure, where, sentence, criterion, measure, measure.__name__, **kind)
