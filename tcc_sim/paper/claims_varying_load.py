"""The claims about Figs. 8 to 13: harmonically varying normal load with mu_k = mu_s."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from tcc_sim.model import pure_stick
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, plain
from tcc_sim.paper.claims_figure4 import JUMPING, NEAR
from tcc_sim.paper.criteria import Equal, Holds, Measured, Shares, claim
from tcc_sim.paper.evidence import FREQUENCY, Evidence, Values, first_half, share_where, sticks
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.trajectory import Floats

AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
LOW, HIGH = AXIS <= 0.29, (AXIS >= 0.31) & (AXIS <= 0.45)
SHOWS = 0.05
"""Difference of two largest slip speeds, rad/s, below which neither curve counts as the lower."""


def rows(number: int) -> list[Values]:
    """The scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


def maxima(evidence: Evidence, number: int) -> Floats:
    """(curves, frequencies) largest slip speeds."""
    return np.array([s.column("max_slip_speed") for s in evidence.curves(rows(number), AXIS)])


def best(found: Floats, curve: int, where: np.ndarray, *, worst: bool = False) -> float:
    """The part of the frequencies at which one curve is the lowest of all (the highest), where any slips."""
    others = np.delete(found, curve, axis=0)
    ordered = found[curve] >= others.max(axis=0) - SHOWS if worst else found[curve] <= others.min(axis=0) + SHOWS
    return share_where(ordered, where & (found.max(axis=0) > SLIPPING))


def exceptions(found: Floats, curve: int, where: np.ndarray) -> list[float]:
    """The frequency ratios at which one curve is not the lowest of all."""
    others = np.delete(found, curve, axis=0)
    return [float(x) for x in AXIS[where & (found[curve] > others.min(axis=0) + SHOWS)]]


SLIPPING = 0.1
"""Largest slip speed, rad/s, above which a curve slips."""
LOWEST = (f"ratios {{}} where a curve slips (above {SLIPPING:g} rad/s) at which its maximum from (13) is the lowest "
          f"(within {SHOWS:g} rad/s)")
HIGHEST = f"the highest at those {{}} (within {SHOWS:g} rad/s)"


@claim("8", "6.1, Fig. 8", "psi = 0 attenuates slip best below about 0.30 and worst above",
       Shares(LOWEST.format("to 0.29") + ", and " + HIGHEST.format("from 0.31 to 0.45")))
def phase_attenuates(evidence: Evidence) -> Measured:
    found = maxima(evidence, 8)
    below, above = best(found, 0, LOW), best(found, 0, HIGH, worst=True)
    return Measured((below, above), {"best below": below, "worst above": above})


def without_bifurcations(evidence: Evidence, number: int) -> Measured:
    """The periods met along every curve, and whether they are one everywhere."""
    found = {plain(s.label): sorted({int(p) for p in evidence.periods(sweep)})
             for s, sweep in zip(FIGURES[number].series, evidence.curves(rows(number), AXIS))}
    return Measured((all(p == [1] for p in found.values()),), {"periods": found})


@claim("8", "6.1, Fig. 8(b)", "no bifurcations for mu_k = mu_s and any phase",
       Holds("period 1 at every frequency from 0.05 to 0.5 and for every curve"))
def phase_bifurcations(evidence: Evidence) -> Measured:
    return without_bifurcations(evidence, 8)


@claim("8", "6.1, Fig. 8(a)", "the curves are smooth for mu_k = mu_s and any phase: no jumps",
       Holds(f"no jump of any curve; {JUMPING}"))
def phase_jumps(evidence: Evidence) -> Measured:
    found = {plain(s.label): [round(x, 4) for x, _ in evidence.jumps(s.values, AXIS)] for s in FIGURES[8].series}
    return Measured((not any(found.values()),), {"jumps": found})


WITHIN_STICK = (f"from the lowest ratio that slips from (13) to the highest of 0.05 to 0.25 that sticks, widened by "
                f"{NEAR:g} either way, with the smoothed law and with the set-valued one")
"""What a printed end of pure stick is held against: between the two ratios motions of both kinds are met."""
STICKING = np.round(np.arange(0.05, 0.2501, 0.001), 6)
"""Ratios among which pure stick ends for psi = 0."""


def stick_interval(evidence: Evidence, row: Values, axis: Floats = STICKING) -> list[float]:
    """The lowest ratio at which the clutch slips for good from (13), and the highest that sticks."""
    slips = evidence.slips(evidence.curves([row], axis)[0])
    return [float(axis[slips].min(initial=math.inf)), float(axis[~slips].max(initial=-math.inf))]


def by_law(number: int) -> dict[str, Values]:
    """The keys of a figure's curve for psi = 0 with the smoothed law and with the set-valued one."""
    return {law: {**rows(number)[0], "friction.law": law} for law in ("smoothed", "set_valued")}


def within(interval: Sequence[float], place: float) -> bool:
    """Whether a printed end of pure stick lies in an interval of `stick_interval`, widened by NEAR."""
    low, high = interval
    return low - NEAR <= place <= high + NEAR


def pure_stick_below(evidence: Evidence, number: int, place: float) -> Measured:
    """Between which ratios stick ends for psi = 0, and whether the text's is one of them."""
    found = {law: stick_interval(evidence, row) for law, row in by_law(number).items()}
    lower = pure_stick.stick_limits(evidence.system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
    return Measured([(within(interval, place), True) for interval in found.values()],
                    {**{f"lowest slip and highest stick, {law}": x for law, x in found.items()},
                     "end of stick by (10), whatever mu_k": None if lower is None else lower / OMEGA_N},
                    "between the lowest slip and the end of pure stick by (10) motions of both kinds exist")


@claim("8", "6.1; 6.2", "psi = 0: pure stick below 0.18", Equal(f"0.18 lies in the interval {WITHIN_STICK}"),
       fitted=True)
def stick_below_018(evidence: Evidence) -> Measured:
    return pure_stick_below(evidence, 8, 0.18)


@claim("9", "6.1, Fig. 9", "positive slip falls into the first half cycle at 0.15 and 0.18, into the second at 0.37 "
       "and 0.40", Holds("more than 0.8 of the way slipped in the first half cycle at the first two ratios, less than "
                         "0.2 at the others"), cheap=True, fitted=True)
def delay(evidence: Evidence) -> Measured:
    shares = {f"{float(s.values[FREQUENCY]) / OMEGA_N:.2f}":  # type: ignore[arg-type]
              first_half(evidence.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
    parts = list(shares.values())
    return Measured((min(parts[:2]) > 0.8 and max(parts[2:]) < 0.2,), {"part in the first half": shares})


def actuated(ratio: float) -> dict[str, float]:
    """Tsp/Tsm = 0.25 at omega_f = ratio omega, mu_k = mu_s, 150 rad/s."""
    return {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio, FREQUENCY: 150.0}


MISMATCHED = (0.5, 2.0, 2.0 / 3.0, 4.0 / 3.0)
"""omega_f/omega of Figs. 10 and 11 but 1."""


def denominator(row: Values) -> int:
    """N of omega_f = (M/N) omega in lowest terms, the period by (35)."""
    return Fraction(float(row["pressure.frequency_ratio"])).limit_denominator(12).denominator  # type: ignore[arg-type]


@claim("10, 11, 12", "6.1, after (29)", "omega_f/omega = 1/2, 2, 2/3, 4/3 give period 2, 1, 3, 3", Equal(
    "these periods from (13) at 150 rad/s, and no others at the slipping ratios from 0.05 to 0.5 of Figs. 10 and 11"))
def actuation_periods(evidence: Evidence) -> Measured:
    single = {f"{r:.3f}": evidence.motion(actuated(r)).period for r in MISMATCHED}
    along = slipping_periods(evidence)
    pairs = [(single[f"{r:.3f}"], denominator(actuated(r))) for r in MISMATCHED]
    return Measured([*pairs, *((along[f"{r:.3f}"][1], [n]) for (_, n), r in zip(pairs, MISMATCHED))],
                    {"at 150 rad/s": single, "at the slipping ratios": {name: found for name, (_, found)
                                                                        in along.items()}})


@claim("10, 11", "6.1, after (29)", "no bifurcations for mu_k = mu_s and any omega_f",
       Holds("one period along every curve from 0.05 to 0.5, wherever the clutch slips"))
def actuation_bifurcations(evidence: Evidence) -> Measured:
    found = {name: periods for name, (_, periods) in slipping_periods(evidence).items()}
    return Measured((all(len(p) <= 1 for p in found.values()),), {"periods": found})


def slipping_periods(evidence: Evidence, numbers: Sequence[int] = (10, 11)) -> dict[str, tuple[int, list[int]]]:
    """By omega_f/omega N of (35), and the periods met where the clutch slips along the curves of figures."""
    return {f"{row['pressure.frequency_ratio']:.3f}":
            (denominator(row), sorted({int(p) for p in evidence.periods(sweep)[~sticks(sweep)]}))
            for number in numbers for row, sweep in zip(rows(number), evidence.curves(rows(number), AXIS))}


def off_period(evidence: Evidence, number: int) -> list[float]:
    """The part of the slipping ratios at which the period is not that of (35), for every curve of a figure."""
    return [share_where(evidence.periods(sweep) != denominator(row), ~sticks(sweep))
            for row, sweep in zip(rows(number), evidence.curves(rows(number), AXIS))]


@claim("10, 11", "6.1, after (29)", "omega_f = omega attenuates best at low frequency", Shares(
    LOWEST.format("to 0.29") + f" of its figure, and more than {SHOWS:g} rad/s below that of Tsp = 0"))
def actuation_attenuates(evidence: Evidence) -> Measured:
    shares = {str(n): best(maxima(evidence, n), 1, LOW) for n in (10, 11)}
    below = _beside_constant(evidence, LOW, 1.0)
    return Measured([*shares.values(), below["1.000"]],
                    {"lowest of its figure": shares, "lower than Tsp = 0, for omega_f/omega": below})


def _beside_constant(evidence: Evidence, where: np.ndarray, sign: float) -> dict[str, float]:
    """For every omega_f/omega of Figs. 10 and 11 the part of the slipping ratios at which its curve is below that of
    Tsp = 0 with mu_k = mu_s (sign 1), or above it (-1).
    """
    still = evidence.curves([{}], AXIS)[0].column("max_slip_speed")
    return {f"{row['pressure.frequency_ratio']:.3f}": share_where(
        sign * (still - found) > SHOWS, where & (np.maximum(found, still) > SLIPPING))
        for n in (10, 11) for row, found in zip(rows(n), maxima(evidence, n))}


@claim("10, 11", "6.1, after (29)", "at higher frequency this is reversed", Shares(
    f"ratios from 0.31 to 0.45 where a curve slips (above {SLIPPING:g} rad/s) at which the maximum of omega_f = omega "
    f"is more than {SHOWS:g} rad/s above that of Tsp = 0, and {HIGHEST.format('of either figure')}"))
def actuation_reversed(evidence: StableMotions) -> Measured:
    shares, above, motions = {}, {}, []
    for n in (10, 11):
        found = maxima(evidence, n)
        shares[str(n)] = best(found, 1, HIGH, worst=True)
        for k, row in ((0, rows(n)[0]), (2, rows(n)[2])):
            above[f"{row['pressure.frequency_ratio']:.3f}"] = share_where(
                found[1] > found[k] + SHOWS, HIGH & (found[[1, k]].max(axis=0) > SLIPPING))
        evidence.stretches(rows(n), AXIS[HIGH])
        for row in [r for r in rows(n) if n == 10 or r["pressure.frequency_ratio"] != 1.0]:
            motions += evidence.motions(f"omega_f = {row['pressure.frequency_ratio']:.3f} omega", row, AXIS[HIGH])
    over = _beside_constant(evidence, HIGH, -1.0)
    alone = "" if any(end.jumps for m in motions for end in (m.stretch.low, m.stretch.high)) else \
        "no stable motion ends in a jump, so no start matters; "
    return Measured([over["1.000"], *shares.values()],
                    {"above Tsp = 0, for omega_f/omega": over, "worst of its figure": shares,
                     "omega_f = omega slips more than at omega_f/omega": above},
                    alone + "beside constant load it attenuates no more; beside the other curves it is not the worst",
                    tuple(motions))


@claim("13", "6.1, Fig. 13", "larger Tsp attenuates more at low and less at high frequency", Shares(
    f"ratios to 0.29 where a curve slips (above {SLIPPING:g} rad/s) at which the maxima fall with every Tsp, and from "
    f"0.31 to 0.45 at which they rise (within {SHOWS:g} rad/s)"))
def amplitude_attenuates(evidence: Evidence) -> Measured:
    found = maxima(evidence, 13)
    moving = found.max(axis=0) > SLIPPING
    falling = (np.diff(found, axis=0) <= SHOWS).all(axis=0)
    rising = (np.diff(found, axis=0) >= -SHOWS).all(axis=0)
    low, high = share_where(falling, moving & LOW), share_where(rising, moving & HIGH)
    return Measured((low, high), {"falling at low": low, "rising at high": high})


@claim("13", "6.1, Fig. 13", "no bifurcations for mu_k = mu_s and any Tsp",
       Holds("period 1 at every frequency from 0.05 to 0.5 and for every curve"))
def amplitude_bifurcations(evidence: Evidence) -> Measured:
    return without_bifurcations(evidence, 13)
