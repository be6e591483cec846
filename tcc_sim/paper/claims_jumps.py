"""Claims on super-harmonic peaks and on jumps of the maxima."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from tcc_sim.errors import counted
from tcc_sim.paper.catalogue import SUPER_HARMONICS
from tcc_sim.paper.criteria import Claim, Measured, claim, equal, holds, shares
from tcc_sim.paper.evidence import Evidence, T, with_kinetic
from tcc_sim.paper.rules import (
    AXIS,
    FINER,
    FRICTION_RATIOS,
    FRICTION_ROWS,
    JUMPING,
    LOW,
    PARTED,
    grow,
    jumps_change_period,
    maxima,
    more_than_anywhere,
    named,
    no_jumps,
    rows,
)
from tcc_sim.paper.stable_motions import WAYS, Motion, StableMotions
from tcc_sim.trajectory import Floats

SMOOTH = holds(f"no jump; {JUMPING}")
CHANGES = shares(f"jumps from (13) ({JUMPING}) with different periods 0.001 below and above", 0.5)
ROWS = (
    Claim("4", "5, Fig. 4(a)", "the map is a smooth curve for mu_k = mu_s", SMOOTH,
          partial(no_jumps, curves=dict(list(named(4).items())[:1]), axis=FINER), "smooth_when_equal"),
    Claim("4", "5, Fig. 4(b)", "a jump in the maximum yields a bifurcation point: a change in the orbit diagram",
          CHANGES, partial(jumps_change_period, curves=dict(list(named(4).items())[1:]), axis=FINER),
          "jump_is_bifurcation"),
    Claim("8", "6.1, Fig. 8(a)", "the curves are smooth for mu_k = mu_s and any phase: no jumps", SMOOTH,
          partial(no_jumps, curves=named(8), axis=AXIS), "phase_jumps"),
    Claim("14", "6.2, after Fig. 14", "jumps indicate a loss of stability, and bifurcations are found in Fig. 14(b)",
          CHANGES, partial(jumps_change_period, curves=named(14), axis=AXIS), "jumps_lose_stability"),
)
"""Claims by the rules `no_jumps` and `jumps_change_period`."""
FALLING = dict(zip(FRICTION_RATIOS[1:], FRICTION_ROWS[1:]))
"""Rows of mu_k < mu_s in Fig. 4, by mu_k/mu_s."""
NAMED = {f"{m:.3f}": m for m in SUPER_HARMONICS}
HIGHER_JUMPS = {"0.25": 0.25, "0.35": 0.35}
"""Frequency ratios near which the text of Fig. 18 states jumps and aperiodic motions."""
NINE = "of the nine curves of 0.83, 0.75 and 0.667 mu_s, each from (13), swept up and swept down, more have "
ANYWHERE = " than of the ratios from 0.14 to 0.36 on average"


def about(place: float, width: float = T.near) -> Floats:
    """Return frequency ratios of branches around a ratio that the text names."""
    return np.round(np.linspace(place - width, place + width, 15), 6)


def around(mark: float) -> Floats:
    """Return frequency ratios around a super-harmonic, wide enough for sweeps to reach the motions that end there."""
    return np.round(np.linspace(mark - 2.0 * T.near, mark + 2.0 * T.near, 21), 6)


def nearest(places: Sequence[float], mark: float) -> float | None:
    """Return the place nearest to a mark."""
    return min(places, key=lambda x: abs(x - mark), default=None)


def curves_near_named(evidence: Evidence, places: Sequence[np.ndarray], values: dict[str, Any],
                      motions: Sequence[Motion] = ()) -> Measured:
    """Judge whether more curves have one of their places near each super-harmonic than near any ratio."""
    def count(x: float) -> int:
        return sum(bool((np.abs(row - x) <= evidence.limit("near")).any()) for row in places)

    return more_than_anywhere(count, NAMED, "curves of nine near", values, lambda fewer:
                              f"near {', '.join(fewer)} there are no more of them than near any ratio", motions)


def jump_places(evidence: Evidence, ratio: float) -> list[float]:
    """Return the ratios omega/omega_n of the jumps of the map of one mu_k/mu_s from (13)."""
    return [round(x, 4) for x, _ in evidence.jumps(with_kinetic(ratio), FINER)]


def prominent_maxima(evidence: Evidence, axis: Floats, values: Floats) -> list[float]:
    """Return the places of the local maxima that stand out on either side within five values."""
    least, reach = evidence.limit("prominent") * float(np.nanmax(values)), 5
    return [float(axis[k]) for k in range(1, len(values) - 1)
            if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
            and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
            and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]


def peaks_of(evidence: Evidence, way: str = "cold") -> dict[str, list[float]]:
    """Return the prominent maxima of Fig. 4 for every mu_k/mu_s, omega/omega_n."""
    return {f"{r:g}": prominent_maxima(evidence, FINER, values)
            for r, values in zip(FRICTION_RATIOS, evidence.maxima(FRICTION_ROWS, FINER, direction=way))}


@claim("4", "5, Fig. 4(a)", "super-harmonic peaks near 0.167, 0.20, 0.25, 0.33 appear as mu_k falls", equal(
    f"{NINE}a peak within {T.near:g} of a named ratio{ANYWHERE} (a peak stands {T.prominent:g} of the curve's "
    "largest value above its surroundings)"))
def super_harmonic_peaks(evidence: Evidence) -> Measured:
    peaks = {way: peaks_of(evidence, way) for way in WAYS}
    return curves_near_named(evidence, [np.array(peaks[way][f"{r:g}"]) for way in WAYS for r in FALLING],
                             {"peaks from (13), upward, downward, for mu_k/mu_s": list(peaks.values())})


@claim("4", "5, Fig. 4(a)", "these peaks appear along with jumps", equal(
    f"{NINE}within {T.near:g} of a named ratio a peak with a jump within {T.close:g} of it{ANYWHERE}; the jump changes "
    f"the maximum by more than {T.jump:g} of the curve's between ratios 0.003 apart, and a stable motion ends in it "
    f"within {T.ends:g}"), fitted=True)
def super_harmonic_jumps(evidence: StableMotions) -> Measured:
    both, left, motions = list[np.ndarray](), list[float](), list[Motion]()
    for r, row in FALLING.items():
        ends = [end for mark in SUPER_HARMONICS for end in evidence.jump_ends(row, around(mark))]
        for way in WAYS:
            values = evidence.maxima([row], FINER, direction=way)[0]
            steps = [0.5 * (FINER[k] + FINER[k + 1]) for k in evidence.steep(values)]
            met = [x for x in ends if any(abs(x - step) <= evidence.limit("ends") for step in steps)]
            both.append(np.array([x for x in prominent_maxima(evidence, FINER, values)
                                  if any(abs(x - end) <= evidence.limit("close") for end in met)]))
            left += met
        motions += [m for mark in SUPER_HARMONICS for m in evidence.motions(f"mu_k = {r:g} mu_s", row, around(mark))
                    if any(end.jumps and end.value in left for end in (m.low, m.high))]
    return curves_near_named(evidence, both, {
        "nearest end in a jump": {name: nearest(left, m) for name, m in NAMED.items()},
        "jumps from (13)": {f"{r:g}": jump_places(evidence, r) for r in FALLING}}, motions)


@claim("4", "5, after Fig. 4", "the super-harmonic peaks shift up as mu_k falls, from mu_k = mu_s on", holds(
    f"every peak of mu_k = mu_s above 0.15, followed to the nearest one within {T.near:g} for 0.83, 0.75 and 0.667 "
    "mu_s, never moves down and ends higher (from (13), ratios 0.003 apart)", "some peak does so"))
def peaks_move(evidence: Evidence) -> Measured:
    peaks = peaks_of(evidence)
    chains = [[x] for x in peaks["1"] if x > 0.15]
    for r in FALLING:
        for chain in chains:
            x = nearest(peaks[f"{r:g}"], chain[-1])
            chain += [x] if x is not None and abs(x - chain[-1]) <= evidence.limit("near") else []
    rising = [len(c) > len(FALLING) and c == sorted(c) and c[-1] > c[0] for c in chains]
    return Measured((bool(rising) and all(rising), any(rising)),
                    {"peaks followed from mu_k/mu_s = 1 to 0.83, 0.75, 0.667": chains,
                     "all peaks for mu_k/mu_s": peaks},
                    "" if all(rising) else f"{sum(rising)} of {counted(len(chains), 'peak')} shift up")


@claim("4", "5, after Fig. 4; 7", "stability is lost around the super-harmonic peaks", holds(
    f"0.75 or more of the jumps of the maps from (13) for 0.83, 0.75 and 0.667 mu_s lie within {T.close:g} of a peak "
    f"of their curve; {JUMPING}, a peak stands {T.prominent:g} of its curve's largest value above its surroundings",
    "more of the jumps than of all ratios from 0.12 on, for every mu_k, are so near"))
def lost_at_peaks(evidence: Evidence) -> Measured:
    peaks, close = peaks_of(evidence), evidence.limit("close")
    near, covered = [], []
    for r in FALLING:
        row = np.array(peaks[f"{r:g}"])
        near += [bool((np.abs(row - x) <= close).any()) for x in jump_places(evidence, r)]
        covered.append(float((np.abs(FINER[FINER > 0.12, None] - row) <= close).any(axis=1).mean()))
    share = float(np.mean(near)) if near else 0.0
    return Measured((share >= 0.75, share > max(covered)), {"jumps": len(near), "part of them at a peak": share,
                    "part of the ratios from 0.12 on that are as near, for mu_k/mu_s = 0.83, 0.75, 0.667": covered},
                    "more of the jumps lie there than by chance, but not most of them"
                    if 0.75 > share > max(covered) else "")


@claim("4", "5, after Fig. 4", "a jump near 0.20 at mu_k = 0.83 mu_s turns period one into two", holds(
    f"from (13) a jump within {T.near:g} of 0.20 with period 1 at 0.002 below it and 2 at 0.002 above; {JUMPING}"))
def jump_doubles_period(evidence: Evidence) -> Measured:
    beside = {f"{x:.4f}": [m.period for m in evidence.beside(with_kinetic(0.83), x, -2e-3, 2e-3)]
              for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= evidence.limit("near")}
    return Measured(([1, 2] in beside.values(),), {"periods around": beside})


@claim("8, 14", "6.2, Fig. 14(a)", "the negative slope introduces super-harmonic peaks that Fig. 8(a) does not have",
       holds("for every phase the curve of 0.75 mu_s has more peaks below 0.30 than that of mu_k = mu_s",
             "for some phase"))
def new_peaks(evidence: Evidence) -> Measured:
    counts = [[len(prominent_maxima(evidence, AXIS[LOW], row[LOW])) for row in maxima(evidence, n)] for n in (8, 14)]
    fewer = [name for name, a, b in zip(("0", "pi/2", "pi"), *counts) if b <= a]
    return Measured((not fewer, len(fewer) < 3),
                    {"peaks below 0.30 at mu_k = mu_s and 0.75 mu_s, psi = 0, pi/2, pi": counts},
                    f"psi = {', '.join(fewer)} has no more peaks" if fewer else "")


@claim("14", "6.2, after Fig. 14", "psi = 0: at a jump near 0.35 the periodic motion becomes chaotic", holds(
    f"a stable motion ends in a jump within {T.near:g} of 0.35, periodic 0.005 below it, and within 0.02 above it a "
    "Lyapunov exponent whose confidence interval is above 0", f"at such a place, or where neighbours 0.005 apart "
    f"differ by more than {T.jump:g} of the curve's maximum, the period is lost"))
def jump_to_chaos(evidence: StableMotions) -> Measured:
    row, near = rows(14)[0], about(0.35)
    ends = [x for x in evidence.jump_ends(row, near) if abs(x - 0.35) <= evidence.limit("near")]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1])) for k in evidence.steep(evidence.maxima([row], AXIS)[0])]
    values: dict[str, Any] = {"stable motions end in a jump at": ends, "steep rises": rises}
    whole, part = False, False
    for x in ends or [x for x in rises if abs(x - 0.35) <= evidence.limit("near")]:
        below = evidence.beside(row, x, -5e-3)[0].period
        above = evidence.beside(row, x, 5e-3, 1e-2, 2e-2, lyapunov=True)
        values[f"period below {x:.4f}"] = below
        values[f"above {x:.4f}: period, exponent's interval (1/s), diagnosis"] = [
            [m.period] + ([] if (e := m.lyapunov) is None else [e.low, e.high, e.diagnosis]) for m in above]
        chaotic = any(m.lyapunov is not None and m.lyapunov.diagnosis == "chaotic" for m in above)
        whole |= bool(ends) and below > 0 and chaotic
        part |= below > 0 and any(m.period == 0 for m in above)
    return Measured((whole, part), values,
                    "" if ends else "the steep rise there is no jump: no stable motion ends in it",
                    evidence.motions("psi = 0", row, near))


LINKED = 0.5
"""Rank correlation that chance exceeds in about 5 % of samples of fifteen jumps."""
APERIODIC = 17.0
"""Rank of a motion without a period up to 16."""


@claim("14", "6.2, after Fig. 14", "bifurcations are as severe as jumps are abrupt, not as slip is large", holds(
    "over the jumps of the three curves from (13) Spearman's rank correlation of the longer of the periods 0.001 "
    f"below and above (17 for none up to 16) with the size of the jump is above {LINKED:g} and larger than that with "
    f"the larger maximum; {JUMPING}", f"the first is above {0.5 * LINKED:g}"))
def severity_follows_abruptness(evidence: Evidence) -> Measured:
    severity, abruptness, amplitude = [], [], []
    for row in rows(14):
        for x, size in evidence.jumps(row, AXIS):
            beside = evidence.beside(row, x, -PARTED, PARTED)
            severity.append(max(APERIODIC if m.period == 0 else float(m.period) for m in beside))
            abruptness.append(abs(size))
            amplitude.append(max(m.largest for m in beside))
    abrupt, large = (float(spearmanr(severity, x).statistic) if len(set(severity)) > 1 and len(set(x)) > 1 else 0.0
                     for x in (abruptness, amplitude))
    return Measured((abrupt > LINKED and abrupt > large, abrupt > 0.5 * LINKED),
                    {"jumps": len(severity), "with the size of the jump": abrupt, "with the maximum": large},
                    "" if abrupt > LINKED else "the periods beside the jumps hardly follow their size")


@claim("14", "6.2, after Fig. 14", "psi = pi: peaks are smooth and there are no bifurcations", holds(
    f"period 1 at every frequency from (13) and no jump; {JUMPING}",
    "no motion that (13) leads to ends in a bifurcation, and more than 0.5 of the ratios have period 1"))
def phase_pi_is_smooth(evidence: StableMotions) -> Measured:
    row = rows(14)[2]
    found = evidence.periods(evidence.curves([row], AXIS)[0])
    jumps = [x for x, _ in evidence.jumps(row, AXIS)]
    motions = [m for place in jumps for m in evidence.motions("psi = pi", row, about(place, 0.01))]
    met = [end for m in motions if m.from_start for end in (m.low, m.high) if end.kind]
    share = float((found == 1).mean())
    smooth = share == 1.0 and not jumps
    return Measured((smooth, not met and share > 0.5),
                    {"part with period 1": share, "periods": sorted({int(p) for p in found}),
                     "jumps from (13)": [round(x, 4) for x in jumps],
                     "bifurcations of the motions that (13) leads to": [[end.kind, end.value] for end in met]},
                    "" if smooth else "period two and others appear at the super-harmonic peaks", motions)


@claim("16", "6.2, Fig. 16(a)", "numerous jumps take place for omega_f = 0.5 omega", holds(
    f"more changes of over {T.jump:g} of the maximum between ratios 0.005 apart than for omega_f = omega and 2 omega",
    "more than for one of them"))
def half_frequency_jumps(evidence: Evidence) -> Measured:
    found = [len(evidence.steep(values)) for values in maxima(evidence, 16)]
    return Measured((found[0] > max(found[1:]), found[0] > min(found[1:])),
                    {"changes for omega_f = 0.5 omega, omega, 2 omega": found})


@claim("18", "6.2, Fig. 18", "a larger Tsp enlarges the jumps around 0.25 and 0.35", holds(
    f"the largest jump within {2.0 * T.near:g} of the two ratios grows with every Tsp ({JUMPING})",
    "it is larger at 0.5 Tsm than at Tsp = 0"))
def amplitude_enlarges_jumps(evidence: Evidence) -> Measured:
    jumps = [max((abs(size) for x, size in evidence.jumps(row, AXIS)
                  if any(abs(x - mark) <= 2.0 * evidence.limit("near") for mark in HIGHER_JUMPS.values())), default=0.0)
             for row in rows(18)]
    return Measured((grow(jumps), jumps[-1] > jumps[0]),
                    {"largest jump there for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (rad/s)": jumps},
                    "the jumps shrink as Tsp grows" if jumps[-1] < jumps[0] else "")


@claim("18", "6.2, Fig. 18(a)", "larger Tsp: jumps near 0.25 and 0.35", equal(
    f"a stable motion ends in a jump within {T.near:g} of each at Tsp/Tsm = 0.25 or 0.5, found from (13) or in a sweep "
    "either way"))
def amplitude_jumps(evidence: StableMotions) -> Measured:
    curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
    found, motions = dict[str, list[float]](), list[Motion]()
    for name, mark in HIGHER_JUMPS.items():
        axis = about(mark)
        evidence.stretches(list(curves.values()), axis)
        found[name] = [x for row in curves.values() for x in evidence.jump_ends(row, axis)
                       if abs(x - mark) <= evidence.limit("near")]
        for curve, row in curves.items():
            motions += evidence.motions(curve, row, axis)
    return Measured([(bool(places), True) for places in found.values()],
                    {"stable motions end in a jump near": found}, "", motions)
