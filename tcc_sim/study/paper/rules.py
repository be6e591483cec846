"""A claim of the paper with its criterion, and rules and curves that the measures of several claims share.

The words of a criterion, with every threshold, are printed beside the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.result import json_of, reported
from tcc_sim.study.paper.branches_behind import Motion, StableMotions
from tcc_sim.study.paper.catalogue import FIGURES, plain
from tcc_sim.study.paper.evidence import T, Values, share_where, sticks
from tcc_sim.sweeps.sweep import Sweep
from tcc_sim.trajectory import Floats

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
SOME = "; depends where some are so and others are not"
Limit = Callable[[str], float]
"""Function that returns a threshold by its name."""
AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
FINER = np.round(np.arange(0.05, 0.5001, 0.003), 6)
"""Frequency ratios of Figs. 8 to 18, and of Fig. 4."""
BANDS = {"to 0.29": AXIS <= 0.29, "from 0.31 to 0.45": (AXIS >= 0.31) & (AXIS <= 0.45)}
LOW, HIGH = BANDS.values()
"""Below and above the ratio 0.30 that the paper names."""
SPREAD = np.round(np.arange(0.14, 0.3601, 1e-3), 6)
"""Frequency ratios around those of the text; their average is the base rate for nearness to a named ratio."""
PARTED = 1e-3
"""Distance from a jump for comparing the motions on both sides."""
WIDE = 2.0 * T.near
FRICTION_RATIOS = (1.0, 0.83, 0.75, 0.667)
"""mu_k/mu_s of Fig. 4."""
JUMPING = f"a jump is a change of more than {T.jump:g} of the curve's maximum on a 1e-5 wide interval"
WHERE_SLIPPING = f"where a curve slips (above {T.slipping:g} rad/s)"
MOST = f"{1.0 - T.missing:g} or more of"
NINE = "of the nine curves of 0.83, 0.75 and 0.667 mu_s, each from (13), swept up and swept down, more have "
ANYWHERE = " than of the ratios from 0.14 to 0.36 on average"
"""Phrases of the criteria."""


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
        value is not None and math.isfinite(value) and abs(value - text) <= within * limit("factor")
        for value, text in judged]))


def equal(of: str) -> Criterion:
    """Judge whether results are the expected ones; judged: pairs of both."""
    return Criterion(of + SOME, lambda judged, limit: some([value == expected for value, expected in judged]))


def some(hits: Sequence[bool]) -> str:
    """Return the verdict on several hits: confirmed if all are true, depends if some are."""
    return CONFIRMED if all(hits) else DEPENDS if any(hits) else NOT_CONFIRMED


@dataclass(frozen=True)
class Measured:
    """Quantities that the criterion judges, values for the reader, a reason, and the stable motions that coexist.

    why : the reason, or whether that of claims.yaml applies
    """

    judged: Sequence[Any]
    values: Mapping[str, Any]
    why: str | bool = False
    motions: Sequence[Motion] = ()


@dataclass(frozen=True)
class Finding:
    """A claim judged once: its verdict, values, reason and motions as JSON, and the names of the thresholds used."""

    values: Mapping[str, Any] = field(metadata=reported("numbers that the verdict rests on"))
    verdict: str
    why: str = ""
    motions: Sequence[Mapping[str, Any]] = field(default=(), metadata=reported(
        "stable motions found where motions coexist", of=(Motion,)))
    thresholds: Sequence[str] = ()


@dataclass(frozen=True)
class Claim:
    """A claim with its criterion; called with evidence it returns the finding.

    measure : computes the quantities to judge from evidence
    name : name of the claim in claims.yaml, tests and files
    cheap : whether it takes less than about a second, so that every test run compares the page with it
    alone : whether it does not depend on the mean pressure of Figs. 4 to 18
    why, labels : a reason, for measures that find one, and words of the page for the names of values
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
    why: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, evidence: StableMotions) -> Finding:
        """Compute and judge the claim."""
        evidence.used.clear()
        measured = self.measure(evidence)
        verdict = self.criterion.verdict(measured.judged, evidence.limit)
        why = measured.why if isinstance(measured.why, str) else self.why * measured.why
        values = {self.labels.get(name, name): value for name, value in measured.values.items()}
        return Finding(values, verdict, why, json_of(measured.motions), sorted(evidence.used))


def rows(number: int) -> list[Values]:
    """Return the scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


@dataclass(frozen=True)
class Curves:
    """Curves of a figure over omega/omega_n.

    rows : scene keys by label
    sweeps : sweep of every curve
    maxima, slips : (curves, ratios) largest slip speeds, rad/s, and whether the motion is not pure stick
    """

    evidence: StableMotions
    rows: Mapping[str, Values]
    axis: Floats
    sweeps: Sequence[Sweep]
    maxima: Floats
    slips: Any

    @cached_property
    def periods(self) -> Any:
        """(curves, ratios) periods of the settled motions, 0 for none."""
        return np.array([self.evidence.periods(sweep) for sweep in self.sweeps])

    def parts(self, condition: Any) -> list[float]:
        """Return for every curve the part of its slipping ratios at which a condition holds."""
        return [share_where(held, slips) for held, slips in zip(condition, self.slips)]

    def off_period(self) -> list[float]:
        """Return for every curve the part of its slipping ratios at which the period is not that of (35)."""
        return self.parts([periods != denominator(row) for periods, row in zip(self.periods, self.rows.values())])

    def means(self, where: Any) -> list[float]:
        """Return the mean of every curve's maxima over some ratios, rad/s."""
        return [float(x) for x in self.maxima[:, where].mean(axis=1)]

    def best(self, curve: int, where: Any, sign: float = 1.0) -> float:
        """Return the part of the ratios at which a curve is the lowest (sign -1: the highest), if any slips."""
        rest = np.delete(sign * self.maxima, curve, axis=0).min(axis=0)
        return share_where(sign * self.maxima[curve] <= rest + self.evidence.limit("shows"), where & self.any_slips())

    def any_slips(self) -> Any:
        """Return (ratios,) whether the maximum of some curve counts as slip."""
        return self.maxima.max(axis=0) > self.evidence.limit("slipping")

    def exceptions(self, curve: int, where: Any) -> list[float]:
        """Return the ratios at which a curve is not the lowest."""
        rest = np.delete(self.maxima, curve, axis=0).min(axis=0) + self.evidence.limit("shows")
        return [float(x) for x in self.axis[where & (self.maxima[curve] > rest)]]

    def jumps(self) -> list[tuple[str, Values, float, float]]:
        """Return label, row, ratio and size of every true jump from (13)."""
        return [(name, row, *jump) for name, row in self.rows.items() for jump in self.evidence.jumps(row, self.axis)]


def grow(numbers: Sequence[float]) -> bool:
    """Return whether every number is larger than the one before."""
    return all(b > a for a, b in pairwise(numbers))


def denominator(row: Values) -> int:
    """Return N of omega_f = (M/N) omega in lowest terms, the period by (35)."""
    return Fraction(float(row.get("pressure.frequency_ratio", 1.0))).limit_denominator(12).denominator  # type: ignore[arg-type]


def more_than_anywhere(count: Callable[[float], float], marks: Mapping[str, float], name: str,
                       values: Mapping[str, Any], why: str, motions: Sequence[Motion] = ()) -> Measured:
    """Judge whether a count is larger near each named ratio than on average near the ratios of SPREAD; else `why`."""
    anywhere = float(np.mean([count(float(x)) for x in SPREAD]))
    near = {key: count(mark) for key, mark in marks.items()}
    fewer = [key for key, value in near.items() if value <= anywhere]
    return Measured([(value > anywhere, True) for value in near.values()],
                    {name: near, "near any ratio, on average": anywhere, **values},
                    why.format(", ".join(fewer)) if fewer else "", motions)


def place_of_change(holds: Callable[[float], bool], low: float, high: float, halvings: int) -> float:
    """Return the middle of the interval in which a condition changes, after some halvings."""
    first = holds(low)
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) == first else (low, middle)
    return 0.5 * (low + high)


def figure_curves(e: StableMotions, number: int, chosen: Sequence[int] = (), way: str = "cold") -> Curves:
    """Return the curves of a figure, or only the `chosen` ones; each value starts from (13), or as `way` says."""
    series, axis = FIGURES[number].series, FINER if number == 4 else AXIS
    rows = {plain(series[k].label): series[k].values for k in chosen or range(len(series))}
    sweeps = e.curves(list(rows.values()), axis, direction=way)
    return Curves(e, rows, axis, sweeps, np.array([sweep.column("max_slip_speed") for sweep in sweeps]),
                  ~np.array([sticks(sweep) for sweep in sweeps]))


def lowest(e: StableMotions, number: int, band: str, word: str = "lowest", chosen: Sequence[int] = ()) -> Measured:
    """Judge whether the first curve is the lowest or `highest` at most ratios, or is so in the mean."""
    curves, where, sign = figure_curves(e, number, chosen), BANDS[band], 1.0 if word == "lowest" else -1.0
    share, mean = curves.best(0, where, sign), curves.means(where)
    most, on_average = share >= e.most, sign * mean[0] == min(sign * x for x in mean)
    return Measured((most, on_average), {
        "share": share, "mean": mean, **({"beaten": curves.exceptions(0, where)} if word == "lowest" else {})},
        "" if most else f"it is the {word} in the mean, but not at every ratio" if on_average else
        f"another curve is the {word} in the mean")


def ordered(e: StableMotions, number: int, band: str, word: str) -> Measured:
    """Judge at which part of a range the maxima `fall` or `rise` from every curve to the next."""
    curves, where, sign = figure_curves(e, number), BANDS[band], 1.0 if word == "fall" else -1.0
    share = share_where((sign * np.diff(curves.maxima, axis=0) <= e.limit("shows")).all(axis=0),
                        where & curves.any_slips())
    return Measured([share], {"part in order": share, "mean": curves.means(where)})


def no_jumps(e: StableMotions, number: int, chosen: Sequence[int] = ()) -> Measured:
    """Judge whether curves from (13) have no jump."""
    curves = figure_curves(e, number, chosen)
    jumps = {name: [round(x, 4) for x, _ in e.jumps(row, curves.axis)] for name, row in curves.rows.items()}
    return Measured((not any(jumps.values()),), {"jumps": jumps})


def jumps_change_period(e: StableMotions, number: int, chosen: Sequence[int] = ()) -> Measured:
    """Judge at which part of the jumps from (13) the period changes."""
    periods = {f"{name} at {x:.4f}": [m.period for m in e.motions_near(row, x, -PARTED, PARTED)]
               for name, row, x, _ in figure_curves(e, number, chosen).jumps()}
    share = float(np.mean([below != above for below, above in periods.values()])) if periods else 1.0
    return Measured([share], {"jumps": len(periods), "share": share, "periods": periods}, share != 1.0)


def slipping_periods(e: StableMotions, numbers: Sequence[int]) -> dict[str, tuple[int, list[int]]]:
    """Return N of (35) and the periods at the slipping ratios, 0 for none, by curve."""
    return {f"Fig. {n}, {name}": (denominator(row), np.unique(periods[slips]).tolist())
            for n, curves in zip(numbers, (figure_curves(e, n) for n in numbers))
            for (name, row), periods, slips in zip(curves.rows.items(), curves.periods, curves.slips)}


def only_period(e: StableMotions, numbers: Sequence[int]) -> Measured:
    """Judge whether the curves of figures have no other period than N of (35) where they slip."""
    slipping = slipping_periods(e, numbers)
    return Measured([(periods, [n] if periods else []) for n, periods in slipping.values()],
                    {"periods": {name: periods for name, (_, periods) in slipping.items()}},
                    any(periods not in ([n], []) for n, periods in slipping.values()))
