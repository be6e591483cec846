"""Claims on the size of slip: order of the curves, its reversal, and its causes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from tcc_sim.paper.catalogue import FIGURES, paper_system, plain
from tcc_sim.paper.criteria import Claim, Measured, claim, holds, near, shares
from tcc_sim.paper.evidence import FREQUENCY, Evidence, T, Values, first_half, share_where
from tcc_sim.paper.rules import (
    AXIS,
    BESIDE,
    FINER,
    FRICTION_ROWS,
    HIGH,
    LOW,
    MOST,
    best,
    exceptions,
    grow,
    lowest,
    maxima,
    means,
    named,
    off_period,
    ordered,
    place_of_change,
    rows,
)
from tcc_sim.paper.stable_motions import Motion, StableMotions, ordered_shares
from tcc_sim.trajectory import Floats


def _extreme(number: int, where: str, sentence: str, name: str, high: bool = False, first: int = 0) -> Claim:
    """Return a claim that one curve is the lowest at low frequency, or the highest at high frequency."""
    word, range_ = ("highest", "from 0.31 to 0.45") if high else ("lowest", "to 0.29")
    criterion = holds(f"at {MOST} the ratios {range_} {BESIDE} its maximum from (13) is the {word} (within "
                      f"{T.shows:g} rad/s)", f"the mean of its maxima over these ratios is the {word}")
    return Claim(str(number), where, sentence, criterion, partial(
        lowest, number=number, where=HIGH if high else LOW, sign=-1.0 if high else 1.0, first=first), name)


def _ordered(sentence: str, name: str, range_: str, word: str, where: np.ndarray, sign: float) -> Claim:
    """Return a claim that the curves of Fig. 13 lie in the order of Tsp."""
    return Claim("13", "6.1, Fig. 13", sentence, shares(
        f"ratios {range_} {BESIDE} at which the maxima {word} with every Tsp (within {T.shows:g} rad/s)"),
        partial(ordered, number=13, where=where, sign=sign), name)


ROWS = (
    _extreme(8, "6.1, Fig. 8", "psi = 0 attenuates slip best below about 0.30", "phase_attenuates"),
    _extreme(8, "6.1, Fig. 8", "above about 0.30 psi = 0 attenuates slip least", "phase_attenuates_least", high=True),
    _ordered("a larger Tsp attenuates more at low frequency", "amplitude_attenuates", "to 0.29", "fall", LOW, 1.0),
    _ordered("a larger Tsp attenuates less at high frequency", "amplitude_reversed", "from 0.31 to 0.45", "rise", HIGH,
             -1.0),
    _extreme(14, "6.2, Fig. 14(a)", "mu_k = 0.75 mu_s: psi = 0 attenuates best at low frequency",
             "phase_with_falling_law"),
    _extreme(15, "6.2, Fig. 15(a)", "mu_k = 0.67 mu_s: psi = 0 attenuates best at low frequency",
             "phase_with_steeper_law"),
    _extreme(16, "6.2, Fig. 16(a)", "at lower frequency omega_f = omega suppresses slip better than omega_f = 2 omega",
             "same_frequency_suppresses", first=1),
)
"""Claims by the rules `lowest` and `ordered`."""
HIGHER = AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
"""Frequency ratios of the branches for claims on higher frequencies."""


@claim("4", "Abstract; 5; 7", "the negative slope exaggerates stick-slip", holds(
    "the mean of the maxima from (13) over the ratios to 0.5 at which mu_k = mu_s slips grows with every fall of mu_k"))
def slope_exaggerates(evidence: Evidence) -> Measured:
    found = evidence.maxima(FRICTION_ROWS, FINER)
    mean = means(found, found[0] > evidence.limit("slipping"))
    return Measured((grow(mean),), {"mean maxima for mu_k/mu_s = 1, 0.83, 0.75, 0.667 (rad/s)": mean,
                                    "largest of all (rad/s)": [float(x) for x in found.max(axis=1)]})


@claim("8, 14", "6.2, Fig. 14(a); Abstract", "the negative slope exaggerates stick-slip under varying load too", holds(
    "for every phase the mean of the maxima below 0.30 is larger at 0.75 mu_s than at mu_k = mu_s"))
def slope_exaggerates_varying(evidence: Evidence) -> Measured:
    found = [means(maxima(evidence, n), LOW) for n in (8, 14)]
    return Measured((all(map(grow, zip(*found))),),
                    {"mean maxima at mu_k = mu_s and 0.75 mu_s, psi = 0, pi/2, pi (rad/s)": found})


@claim("14, 15", "6.2, Figs. 14(a), 15(a)", "mu_k < mu_s: psi = pi attenuates worst at low frequency", holds(
    "in both figures the mean over the ratios to 0.29 of its maxima from (13) is the highest", "in one of them"))
def phase_pi_is_worst(evidence: Evidence) -> Measured:
    found = {str(n): means(maxima(evidence, n), LOW) for n in (14, 15)}
    worst = [row[2] == max(row) for row in found.values()]
    return Measured((all(worst), any(worst)), {"mean maxima for psi = 0, pi/2, pi (rad/s)": found})


@claim("18", "6.2, Fig. 18", "a larger Tsp enlarges slip at higher frequency", holds(
    "the mean of the maxima from 0.31 to 0.45 grows with every Tsp", "it is larger at 0.5 Tsm than at Tsp = 0"))
def amplitude_enlarges_slip(evidence: Evidence) -> Measured:
    found = means(maxima(evidence, 18), HIGH)
    return Measured((grow(found), found[-1] > found[0]),
                    {"mean maxima from 0.31 to 0.45 for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (rad/s)": found})


@claim("14, 15", "6.2, after Fig. 14", "at higher frequency psi = 0 acts in the opposite way: worst", holds(
    f"at {MOST} the ratios 0.31 to 0.45 {BESIDE} its maximum is the highest (within {T.shows:g} rad/s), whichever "
    "stable motion there is on every curve", "at 0.5 or more for some choice of motions"))
def phase_reversed(evidence: StableMotions) -> Measured:
    parts, motions = dict[str, Sequence[float]](), list[Motion]()
    for n in (14, 15):
        evidence.stretches(rows(n), HIGHER)
        parts[str(n)] = ordered_shares([evidence.amplitudes(row, HIGHER) for row in rows(n)], 0,
                                       (HIGHER >= 0.31) & (HIGHER <= 0.45),
                                       (evidence.limit("shows"), evidence.limit("slipping")), worst=True)
        for name, row in named(n).items():
            motions += evidence.motions(f"Fig. {n}, {name}", row, HIGHER)
    always = min(every for every, _ in parts.values()) >= evidence.most
    return Measured((always, max(some for _, some in parts.values()) >= 0.5),
                    {"worst for every choice of motions, for some": parts,
                     "from (13)": {str(n): best(evidence, maxima(evidence, n), 0, HIGH, -1.0) for n in (14, 15)}},
                    "" if always else "where motions coexist, another phase is the highest for some choices of them",
                    motions)


@claim("9", "6.1, Fig. 9", "positive slip falls into the first half cycle at 0.15 and 0.18, into the second at 0.37 "
       "and 0.40", holds("more than 0.8 of the way slipped in the first half cycle at the first two ratios, less than "
                         "0.2 at the others"), cheap=True, fitted=True)
def delay(evidence: Evidence) -> Measured:
    found = {plain(s.label): first_half(evidence.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
    parts = list(found.values())
    return Measured((min(parts[:2]) > 0.8 and max(parts[2:]) < 0.2,), {"part in the first half": found})


def _beside_constant(evidence: Evidence, where: np.ndarray, sign: float) -> dict[str, float]:
    """Return the parts of the slipping ratios at which curves of Figs. 10, 11 are below that of Tsp = 0 (-1: above)."""
    still = evidence.maxima([{}], AXIS)[0]
    shows, slipping = evidence.limit("shows"), evidence.limit("slipping")
    return {f"{row['pressure.frequency_ratio']:.3f}": share_where(
        sign * (still - found) > shows, where & (np.maximum(found, still) > slipping))
        for n in (10, 11) for row, found in zip(rows(n), maxima(evidence, n))}


@claim("10, 11", "6.1, after (29)", "omega_f = omega attenuates best at low frequency", shares(
    f"ratios to 0.29 {BESIDE} at which its maximum from (13) is the lowest of its figure (within {T.shows:g} rad/s), "
    f"and more than {T.shows:g} rad/s below that of Tsp = 0"))
def actuation_attenuates(evidence: Evidence) -> Measured:
    parts = {str(n): best(evidence, maxima(evidence, n), 1, LOW) for n in (10, 11)}
    below = _beside_constant(evidence, LOW, 1.0)
    return Measured([*parts.values(), below["1.000"]],
                    {"lowest of its figure": parts, "lower than Tsp = 0, for omega_f/omega": below})


@claim("10, 11", "6.1, after (29)", "at higher frequency this is reversed", shares(
    f"ratios from 0.31 to 0.45 {BESIDE} at which the maximum of omega_f = omega is more than {T.shows:g} rad/s above "
    f"that of Tsp = 0, and the highest of either figure (within {T.shows:g} rad/s)"))
def actuation_reversed(evidence: StableMotions) -> Measured:
    parts, motions = {}, list[Motion]()
    for n in (10, 11):
        parts[str(n)] = best(evidence, maxima(evidence, n), 1, HIGH, -1.0)
        evidence.stretches(rows(n), AXIS[HIGH])
        for row in [r for r in rows(n) if n == 10 or r["pressure.frequency_ratio"] != 1.0]:
            motions += evidence.motions(f"omega_f = {row['pressure.frequency_ratio']:.3f} omega", row, AXIS[HIGH])
    over = _beside_constant(evidence, HIGH, -1.0)
    alone = any(end.jumps for m in motions for end in (m.low, m.high))
    return Measured([over["1.000"], *parts.values()],
                    {"above Tsp = 0, for omega_f/omega": over, "highest of its figure": parts},
                    ("" if alone else "no stable motion ends in a jump, so the start does not matter; ")
                    + "it attenuates no more than constant load, but is not the highest beside the other curves",
                    motions)


@claim("17", "6.2, Fig. 17", "the effects of negative damping and of mismatched frequencies are evident together",
       holds("every curve leaves the period of (35) at more of its slipping ratios (0.05 to 0.5) than in Fig. 11, "
             f"and omega_f = omega has the lowest maximum from (13) at {MOST} the ratios to 0.29",
             "one of the two is so"))
def mismatch_with_falling_law(evidence: StableMotions) -> Measured:
    parts = {str(n): off_period(evidence, n) for n in (11, 17)}
    found = maxima(evidence, 17)
    lowest, beaten = best(evidence, found, 1, LOW), exceptions(evidence, found, 1, LOW)
    more = all(map(grow, zip(parts["11"], parts["17"])))
    return Measured((more and lowest >= evidence.most, more or lowest >= evidence.most),
                    {"part off the period of (35), omega_f = 2/3, 1, 4/3 omega": parts,
                     "omega_f = omega best at low frequency": lowest, "not at": beaten},
                    "both effects are there, but at some ratios another curve is lower" if beaten else "")


INERTIAS: dict[str, Values] = {
    "Table 1": {}, "I1 = 0.1": {"driveline.flywheel_inertia": 0.1}, "I1 = 0.4": {"driveline.flywheel_inertia": 0.4},
    "I2 = 0.04": {"driveline.plate_inertia": 0.04}}


@claim("8", "6.1, (28)", "the critical frequency of Fig. 8 is set by I1 and I2: omega_sn/omega_n",
       near("ratio omega/omega_n at which the maxima of psi = 0 and pi cross, for four pairs of inertias, and (28)",
            0.002))
def critical_frequency(evidence: Evidence) -> Measured:
    values, pairs = {}, []
    for name, inertia in INERTIAS.items():
        system = paper_system(inertia)
        by_inertia = math.sqrt(system.driveline.plate_inertia
                               / (system.driveline.plate_inertia + system.driveline.flywheel_inertia))
        found = crossing(evidence, inertia, system.natural_frequency, by_inertia)
        values[f"{name}: crossing, (28)"] = [found, by_inertia]
        pairs.append((found, by_inertia))
    return Measured(pairs, values)


def crossing(evidence: Evidence, inertia: Values, omega_n: float, place: float) -> float | None:
    """Return where the maxima of psi = 0 and pi cross within 0.03 of a ratio, to 1e-5; None if they do not."""
    def apart(ratio: float) -> float:
        first, last = (evidence.motion({**row, **inertia, FREQUENCY: ratio * omega_n}).largest
                       for row in rows(8)[::2])
        return first - last

    axis: Floats = np.linspace(place - 0.03, place + 0.03, 13)
    signs = np.sign([apart(float(x)) for x in axis])
    turns = np.flatnonzero(signs[1:] * signs[:-1] < 0)
    if not len(turns):
        return None
    return place_of_change(lambda x: apart(x) > 0.0, float(axis[turns[0]]), float(axis[turns[0] + 1]), 9)
