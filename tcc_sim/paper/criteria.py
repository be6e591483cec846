"""A claim of the paper as a row: sentence, place, criterion, and the function that computes its values.

A criterion is one of four kinds. Its words, with every threshold, are printed beside the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.paper.evidence import T
from tcc_sim.paper.stable_motions import Motion, StableMotions

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
SOME = "; depends where some are so and others are not"
Limit = Callable[[str], float]
"""A threshold by its name."""


def printed(name: str) -> float:
    """Return the threshold that the criteria print."""
    return float(getattr(T, name))


@dataclass(frozen=True)
class Holds:
    """A statement, and a weaker one for "depends" where there is one; judged: whether each holds."""

    statement: str
    weaker: str = ""

    @property
    def words(self) -> str:
        """Both statements."""
        return self.statement + (f"; depends where {self.weaker}" if self.weaker else "")

    def verdict(self, judged: Sequence[Any], limit: Limit = printed) -> str:
        """Judge whether the statement holds, and whether the weaker one does."""
        return CONFIRMED if judged[0] else DEPENDS if self.weaker and judged[1] else NOT_CONFIRMED


@dataclass(frozen=True)
class Shares:
    """Parts of the cases `of` which something holds: all but `missing`, or at least `partly`; judged: the parts."""

    of: str
    partly: float = 0.75

    @property
    def words(self) -> str:
        """The cases, and the least parts of them."""
        return (f"{self.of} at {1.0 - T.missing:g} or more of them; depends where at {self.partly:g} or more, or in "
                "one of several parts alone")

    def verdict(self, judged: Sequence[Any], limit: Limit = printed) -> str:
        """Judge the parts, 0 to 1."""
        least = 1.0 - limit("missing")
        if min(judged) >= least:
            return CONFIRMED
        return DEPENDS if min(judged) >= self.partly or max(judged) >= least else NOT_CONFIRMED


@dataclass(frozen=True)
class Near:
    """Computed numbers `of` some kind lie within a distance of the printed ones; judged: pairs, None for no number."""

    of: str
    within: float

    @property
    def words(self) -> str:
        """The numbers and the distance."""
        return f"{self.of} within {self.within:g}{SOME}"

    def verdict(self, judged: Sequence[Any], limit: Limit = printed) -> str:
        """Judge pairs of computed and printed numbers."""
        within = self.within * limit("factor")
        return some([found is not None and math.isfinite(found) and abs(found - text) <= within
                     for found, text in judged])


@dataclass(frozen=True)
class Equal:
    """What was found is what was expected; judged: pairs of both."""

    of: str

    @property
    def words(self) -> str:
        """The comparison."""
        return self.of + SOME

    def verdict(self, judged: Sequence[Any], limit: Limit = printed) -> str:
        """Judge pairs of found and expected."""
        return some([found == expected for found, expected in judged])


def some(hits: Sequence[bool]) -> str:
    """Return the verdict on several hits: confirmed where all are, depends where some are."""
    return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


@dataclass(frozen=True)
class Measured:
    """What a claim's criterion judges, its values for the reader, a reason, and the stable motions that coexist."""

    judged: Sequence[Any]
    values: Mapping[str, Any]
    why: str = ""
    motions: tuple[Motion, ...] = ()


@dataclass(frozen=True)
class Finding:
    """A claim with its verdict: the words of its row, and values, reason and motions of its `Measured` as JSON,
    and the names of the thresholds that it used.
    """

    figure: str
    where: str
    claim: str
    criterion: str
    values: Mapping[str, Any]
    verdict: str
    why: str = ""
    motions: Sequence[Mapping[str, Any]] = ()
    thresholds: Sequence[str] = ()


@dataclass(frozen=True)
class Claim:
    """A row of the table of claims; called with evidence it gives the finding.

    figure : figure or equation
    where : section and place of the paper
    sentence : the claim in our words
    criterion : how it is judged
    measure : works out what is judged from evidence, and from `computed` where that takes the place of its own numbers
    name : of the claim in tests and files
    cheap : whether it takes less than about a second, so that every test run compares the page with it
    fitted : whether its number chose the mean pressures that are judged
    alone : whether it does not depend on the mean pressure of Figs. 4 to 18
    """

    figure: str
    where: str
    sentence: str
    criterion: Holds | Shares | Near | Equal
    measure: Callable[..., Measured] = field(compare=False)
    name: str
    cheap: bool = False
    fitted: bool = False
    alone: bool = False

    def __call__(self, evidence: StableMotions, **computed: Callable[..., Any]) -> Finding:
        """Work the claim out and judge it."""
        found = self.measure(evidence, **computed)
        return Finding(self.figure, self.where, self.sentence, self.criterion.words, found.values,
                       self.criterion.verdict(found.judged, evidence.limit), found.why,
                       [m.as_json() for m in found.motions])


def claim(figure: str, where: str, sentence: str, criterion: Holds | Shares | Near | Equal,
          **kind: bool) -> Callable[[Callable[..., Measured]], Claim]:
    """Make a claim of the function that works its values out."""
    return lambda measure: Claim(figure, where, sentence, criterion, measure, measure.__name__, **kind)
