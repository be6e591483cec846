"""A claim of the paper as a row: sentence, place, criterion with its thresholds, and how its values are worked out.

A criterion is one of four kinds. What it says is printed with the verdict, so that no threshold is hidden.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tcc_sim.paper.stable_motions import Motion, StableMotions

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"


@dataclass(frozen=True)
class Holds:
    """A statement holds, or in place of it a weaker one.

    statement : judged first
    weaker : judged second, for "depends"; empty where there is none
    """

    statement: str
    weaker: str = ""

    @property
    def words(self) -> str:
        """Both statements."""
        return self.statement + (f"; depends where {self.weaker}" if self.weaker else "")

    def verdict(self, judged: Sequence[Any]) -> str:
        """Judged: whether the statement holds, and whether the weaker one does."""
        return CONFIRMED if judged[0] else DEPENDS if self.weaker and judged[1] else NOT_CONFIRMED


@dataclass(frozen=True)
class Shares:
    """Parts of the cases in which something holds, all of them at least `least`.

    of : what the parts are of
    partly : where every part is at least this the verdict depends
    """

    of: str
    least: float = 0.95
    partly: float = 0.75

    @property
    def words(self) -> str:
        """What holds, at how many of the cases."""
        return (f"{self.of} at {self.least:g} or more of them; depends where at {self.partly:g} or more, or in one of "
                "several parts alone")

    def verdict(self, judged: Sequence[Any]) -> str:
        """Judged: the parts, 0 to 1."""
        if min(judged) >= self.least:
            return CONFIRMED
        return DEPENDS if min(judged) >= self.partly or max(judged) >= self.least else NOT_CONFIRMED


@dataclass(frozen=True)
class Near:
    """Computed numbers lie within `within` of those of the text; the verdict depends where some of several do.

    of : what the numbers are
    """

    of: str
    within: float

    @property
    def words(self) -> str:
        """What is compared, and how near it must be."""
        return f"{self.of} within {self.within:g}; depends where some are and others are not"

    def verdict(self, judged: Sequence[Any]) -> str:
        """Judged: pairs of computed (None for none) and printed numbers."""
        hits = [found is not None and math.isfinite(found) and abs(found - text) <= self.within
                for found, text in judged]
        return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


@dataclass(frozen=True)
class Equal:
    """Whole numbers are those of the text; the verdict depends where some are.

    of : what the numbers are
    """

    of: str

    @property
    def words(self) -> str:
        """What must be equal."""
        return f"{self.of}; depends where some are so and others are not"

    def verdict(self, judged: Sequence[Any]) -> str:
        """Judged: pairs of found and expected."""
        hits = [found == expected for found, expected in judged]
        return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


Criterion = Holds | Shares | Near | Equal
"""How the verdict follows from what was worked out: `verdict` takes what a claim's `Measured.judged` holds; `words` say
it with every threshold, also of the verdict "depends".
"""


@dataclass(frozen=True)
class Measured:
    """What was worked out for a claim.

    judged : what its criterion looks at
    values : by name, what the reader sees
    why : what explains the verdict, where something must
    motions : where motions coexist, the stable ones
    """

    judged: Sequence[Any]
    values: Mapping[str, Any]
    why: str = ""
    motions: tuple[Motion, ...] = ()


@dataclass(frozen=True)
class Finding:
    """A claim with its verdict.

    figure, where, claim, criterion : of the row
    values, why : of `Measured`
    motions : of `Measured`, as JSON values
    """

    figure: str
    where: str
    claim: str
    criterion: str
    values: Mapping[str, Any]
    verdict: str
    why: str = ""
    motions: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class Claim:
    """A row of the table of claims; called with evidence it gives the finding.

    figure : figure or equation
    where : section and place of the paper
    sentence : what it says, in our words
    criterion : how it is judged
    measure : works out what is judged, from evidence and, where they are not its own, from what computes its numbers
    cheap : whether it takes less than about a second, so that the page is compared with it in every test run
    fitted : whether its number chose the mean pressures that are judged
    alone : whether it does not depend on the mean pressure of Figs. 4 to 18
    """

    figure: str
    where: str
    sentence: str
    criterion: Criterion
    measure: Callable[..., Measured] = field(compare=False)
    cheap: bool = False
    fitted: bool = False
    alone: bool = False

    @property
    def name(self) -> str:
        """The name of its measure."""
        return self.measure.__name__

    def __call__(self, evidence: StableMotions, **computed: Callable[..., Any]) -> Finding:
        """Work the claim out and judge it; `computed` takes the place of what the measure computes its numbers with."""
        found = self.measure(evidence, **computed)
        return Finding(self.figure, self.where, self.sentence, self.criterion.words, found.values,
                       self.criterion.verdict(found.judged), found.why, [m.as_json() for m in found.motions])


def claim(figure: str, where: str, sentence: str, criterion: Criterion, *, cheap: bool = False, fitted: bool = False,
          alone: bool = False) -> Callable[[Callable[[Any], Measured]], Claim]:
    """Make a claim of the function that works its values out."""
    return lambda measure: Claim(figure, where, sentence, criterion, measure, cheap, fitted, alone)
