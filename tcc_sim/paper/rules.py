"""Common rules of several claims, and the curves of the figures that they judge.

A row of a table names figure, curves, range and rule; its measure is the rule with these arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.paper.catalogue import FIGURES, plain
from tcc_sim.paper.criteria import Measured
from tcc_sim.paper.evidence import Evidence, T, Values, share_where, sticks, with_kinetic
from tcc_sim.paper.stable_motions import Motion
from tcc_sim.sweeps.sweep import Sweep
from tcc_sim.trajectory import Floats

AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
FINER = np.round(np.arange(0.05, 0.5001, 0.003), 6)
"""Frequency ratios of Figs. 8 to 18, and of Fig. 4."""
LOW, HIGH = AXIS <= 0.29, (AXIS >= 0.31) & (AXIS <= 0.45)
"""Below and above the ratio 0.30 that the paper names."""
SPREAD = np.round(np.arange(0.14, 0.3601, 1e-3), 6)
"""Frequency ratios around those of the text; their average is the base rate for nearness to a named ratio."""
PARTED = 1e-3
"""Distance from a jump for comparing the motions on both sides."""
FRICTION_RATIOS = (1.0, 0.83, 0.75, 0.667)
"""mu_k/mu_s of Fig. 4."""
JUMPING = f"a jump is a change of more than {T.jump:g} of the curve's maximum on a 1e-5 wide interval"
BESIDE = f"where a curve slips (above {T.slipping:g} rad/s)"
MOST = f"{1.0 - T.missing:g} or more of"


def rows(number: int) -> list[Values]:
    """Return the scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


FRICTION_ROWS: list[Values] = [with_kinetic(r) for r in FRICTION_RATIOS]


def named(number: int) -> dict[str, Values]:
    """Return the scene keys of a figure's curves by label."""
    return {plain(series.label): series.values for series in FIGURES[number].series}


def maxima(evidence: Evidence, number: int) -> Floats:
    """Return (curves, frequencies) largest slip speeds of a figure over AXIS, rad/s."""
    return evidence.maxima(rows(number), AXIS)


def means(found: Floats, where: np.ndarray) -> list[float]:
    """Return each curve's mean over some frequencies, rad/s."""
    return [float(x) for x in found[:, where].mean(axis=1)]


def grow(numbers: Sequence[float]) -> bool:
    """Return whether every number is larger than the one before."""
    return all(b > a for a, b in pairwise(numbers))


def best(evidence: Evidence, found: Floats, curve: int, where: np.ndarray, sign: float = 1.0) -> float:
    """Return the part of the frequencies at which a curve is the lowest of all (sign -1: the highest), if any slips."""
    lowest = sign * found[curve] <= np.delete(sign * found, curve, axis=0).min(axis=0) + evidence.limit("shows")
    return share_where(lowest, where & (found.max(axis=0) > evidence.limit("slipping")))


def exceptions(evidence: Evidence, found: Floats, curve: int, where: np.ndarray) -> list[float]:
    """Return the frequency ratios at which a curve is not the lowest of all."""
    return [float(x) for x in AXIS[where & (found[curve] > np.delete(found, curve, axis=0).min(axis=0)
                                            + evidence.limit("shows"))]]


def lowest(evidence: Evidence, number: int, where: np.ndarray, sign: float = 1.0, first: int = 0) -> Measured:
    """Judge whether a curve is the lowest of itself and those after it (sign -1: the highest), or is so in the mean."""
    found = maxima(evidence, number)[first:]
    share, mean = best(evidence, found, 0, where, sign), [sign * x for x in means(found, where)]
    word = "lowest" if sign > 0.0 else "highest"
    return Measured((share >= evidence.most, mean[0] == min(mean)), {
        f"part at which it is the {word}": share,
        "mean maxima, in the order of the curves (rad/s)": means(found, where),
        **({"another curve is lower at": exceptions(evidence, found, 0, where)} if sign > 0.0 else {})},
        "" if share >= evidence.most else f"it is the {word} in the mean, but not at every ratio"
        if mean[0] == min(mean) else f"another curve is the {word} in the mean")


def ordered(evidence: Evidence, number: int, where: np.ndarray, sign: float) -> Measured:
    """Judge at which part of a range every curve is below the last one (sign -1: above it)."""
    found = maxima(evidence, number)
    share = share_where((sign * np.diff(found, axis=0) <= evidence.limit("shows")).all(axis=0),
                        where & (found.max(axis=0) > evidence.limit("slipping")))
    return Measured([share], {"part in order": share, "mean maxima, in the order of the curves (rad/s)":
                              means(found, where)})


def no_jumps(evidence: Evidence, curves: Mapping[str, Values], axis: Floats) -> Measured:
    """Judge whether curves from (13) have no jump."""
    found = {name: [round(x, 4) for x, _ in evidence.jumps(row, axis)] for name, row in curves.items()}
    return Measured((not any(found.values()),), {"jumps (omega/omega_n)": found})


def jumps_change_period(evidence: Evidence, curves: Mapping[str, Values], axis: Floats) -> Measured:
    """Judge at which part of the jumps from (13) the period changes."""
    found = {f"{name} at {x:.4f}": [m.period for m in evidence.beside(row, x, -PARTED, PARTED)]
             for name, row in curves.items() for x, _ in evidence.jumps(row, axis)}
    share = float(np.mean([below != above for below, above in found.values()])) if found else 1.0
    return Measured([share], {"jumps": len(found), "part of them": share, "periods below and above": found},
                    "" if share == 1.0 else "elsewhere the period stays: the basin of (13) ends and both motions go "
                    "on, or the motion changes its size alone")


def denominator(row: Values) -> int:
    """Return N of omega_f = (M/N) omega in lowest terms, the period by (35)."""
    return Fraction(float(row.get("pressure.frequency_ratio", 1.0))).limit_denominator(12).denominator  # type: ignore[arg-type]


def slipping_periods(evidence: Evidence, numbers: Sequence[int]) -> dict[str, tuple[int, list[int]]]:
    """Return N of (35) and the periods at the slipping ratios, 0 for none, by curve."""
    return {f"Fig. {n}, {name}": (denominator(row), sorted({int(p) for p in evidence.periods(sweep)[~sticks(sweep)]}))
            for n in numbers for (name, row), sweep in zip(named(n).items(), evidence.curves(rows(n), AXIS))}


def only_period(evidence: Evidence, numbers: Sequence[int], why: str = "") -> Measured:
    """Judge whether the curves of figures have no other period than N of (35) where they slip."""
    found = slipping_periods(evidence, numbers)
    return Measured([(periods, [n] if periods else []) for n, periods in found.values()],
                    {"periods": {name: periods for name, (_, periods) in found.items()}},
                    why if any(periods not in ([n], []) for n, periods in found.values()) else "")


def off_period(evidence: Evidence, number: int) -> list[float]:
    """Return the part of the slipping ratios at which the period is not that of (35), for every curve of a figure."""
    def part(row: Values, sweep: Sweep) -> float:
        return share_where(evidence.periods(sweep) != denominator(row), ~sticks(sweep))
    return list(map(part, rows(number), evidence.curves(rows(number), AXIS)))


def more_than_anywhere(count: Callable[[float], float], marks: Mapping[str, float], name: str,
                       values: Mapping[str, Any], why: Callable[[list[str]], str],
                       motions: Sequence[Motion] = ()) -> Measured:
    """Judge whether a count is larger near each named ratio than on average near the ratios of SPREAD."""
    anywhere = float(np.mean([count(float(x)) for x in SPREAD]))
    near = {key: count(mark) for key, mark in marks.items()}
    fewer = [key for key, found in near.items() if found <= anywhere]
    return Measured([(found > anywhere, True) for found in near.values()],
                    {name: near, "near any ratio, on average": anywhere, **values}, why(fewer) if fewer else "",
                    motions)


def place_of_change(holds: Callable[[float], bool], low: float, high: float, halvings: int) -> float:
    """Return the middle of the interval in which a condition changes, after some halvings."""
    first = holds(low)
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) == first else (low, middle)
    return 0.5 * (low + high)
