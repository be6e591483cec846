"""The claims about Figs. 14 to 18, varying load and a falling law, that no rule of `claims_families` judges."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, STATIC, plain
from tcc_sim.paper.claims_families import (
    AXIS,
    BESIDE,
    HIGH,
    JUMPING,
    LOW,
    PARTED,
    best,
    by_law,
    denominator,
    exceptions,
    maxima,
    means,
    rows,
    stick_interval,
)
from tcc_sim.paper.claims_figure4 import about, prominent_maxima, rate_anywhere
from tcc_sim.paper.criteria import Equal, Holds, Measured, claim
from tcc_sim.paper.evidence import FREQUENCY, KINETIC, Evidence, T, share_where, sticks
from tcc_sim.paper.stable_motions import Motion, StableMotions, ordered_shares
from tcc_sim.trajectory import Floats

HIGHER = AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
"""Ratios over which branches are followed where a claim is about the higher ones."""
NAMED = (0.25, 0.35)
"""Ratios about which the text of Fig. 18 has jumps and aperiodic motions."""
MOST = f"{1.0 - T.missing:g} or more of"


def aperiodic(evidence: Evidence, number: int) -> list[float]:
    """The part of the slipping ratios without a period up to 16, for every curve of a figure."""
    return [share_where(evidence.periods(s) == 0, ~sticks(s)) for s in evidence.curves(rows(number), AXIS)]


def off_period(evidence: Evidence, number: int) -> list[float]:
    """The part of the slipping ratios at which the period is not that of (35), for every curve of a figure."""
    return [share_where(evidence.periods(sweep) != denominator(row), ~sticks(sweep))
            for row, sweep in zip(rows(number), evidence.curves(rows(number), AXIS))]


@claim("14, 15", "6.2, Figs. 14(a), 15(a)", "mu_k < mu_s: psi = pi attenuates worst at low frequency", Holds(
    "in both figures the mean over the ratios to 0.29 of its maxima from (13) is the highest", "in one of them"))
def phase_pi_is_worst(evidence: Evidence) -> Measured:
    found = {str(n): means(maxima(evidence, n), LOW) for n in (14, 15)}
    worst = [row[2] == max(row) for row in found.values()]
    return Measured((all(worst), any(worst)), {"mean maxima for psi = 0, pi/2, pi (rad/s)": found})


@claim("8, 14", "6.2, Fig. 14(a)", "the negative slope introduces super-harmonic peaks that Fig. 8(a) does not have",
       Holds("for every phase the curve of 0.75 mu_s has more peaks below 0.30 than that of mu_k = mu_s",
             "for some phase"))
def new_peaks(evidence: Evidence) -> Measured:
    counts = [[len(prominent_maxima(evidence, AXIS[LOW], row[LOW])) for row in maxima(evidence, n)] for n in (8, 14)]
    fewer = [name for name, a, b in zip(("0", "pi/2", "pi"), *counts) if b <= a]
    return Measured((not fewer, len(fewer) < 3),
                    {"peaks below 0.30 at mu_k = mu_s and 0.75 mu_s, psi = 0, pi/2, pi": counts},
                    f"psi = {', '.join(fewer)} has no more of them" if fewer else "")


@claim("8, 14", "6.2, Fig. 14(a); Abstract", "the negative slope exaggerates stick-slip under varying load too", Holds(
    "for every phase the mean of the maxima below 0.30 is larger at 0.75 mu_s than at mu_k = mu_s"))
def slope_exaggerates_varying(evidence: Evidence) -> Measured:
    found = [means(maxima(evidence, n), LOW) for n in (8, 14)]
    return Measured((all(b > a for a, b in zip(*found)),),
                    {"mean maxima at mu_k = mu_s and 0.75 mu_s, psi = 0, pi/2, pi (rad/s)": found})


@claim("14, 15", "6.2, after Fig. 14", "at higher frequency psi = 0 acts in the opposite way: worst", Holds(
    f"at {MOST} the ratios 0.31 to 0.45 {BESIDE} its maximum is the highest (within {T.shows:g} rad/s), whichever "
    "stable motion there is on every curve", "at 0.5 or more for some choice of motions"))
def phase_reversed(evidence: StableMotions) -> Measured:
    shares, motions = {}, list[Motion]()
    for n in (14, 15):
        evidence.stretches(rows(n), HIGHER)
        shares[str(n)] = ordered_shares([evidence.amplitudes(row, HIGHER) for row in rows(n)], 0,
                                        (HIGHER >= 0.31) & (HIGHER <= 0.45),
                                        (evidence.limit("shows"), evidence.limit("slipping")), worst=True)
        for series in FIGURES[n].series:
            motions += evidence.motions(f"Fig. {n}, {plain(series.label)}", series.values, HIGHER)
    always = min(every for every, _ in shares.values()) >= evidence.most
    return Measured((always, max(some for _, some in shares.values()) >= 0.5),
                    {"worst for every choice of motions, for some": {n: list(s) for n, s in shares.items()},
                     "from (13)": {str(n): best(evidence, maxima(evidence, n), 0, HIGH, -1.0) for n in (14, 15)}},
                    "" if always else "where motions coexist, another phase is the highest for some choices of them",
                    tuple(motions))


@claim("14", "6.2, after Fig. 14", "it begins to slip at a lower ratio than in Fig. 8, due to the negative damping",
       Equal("the lowest ratio that slips from (13) at 0.75 mu_s is below that at mu_k = mu_s, with either law"))
def earlier_onset(evidence: Evidence) -> Measured:
    found = {law: [stick_interval(evidence, by_law(n)[law])[0] for n in (8, 14)] for law in by_law(8)}
    return Measured([(falling < equal, True) for equal, falling in found.values()],
                    {f"lowest slip at mu_k = mu_s and 0.75 mu_s, {law}": x for law, x in found.items()},
                    "the end of stick by (10) is the same for both: a motion that slips goes on below it where "
                    "friction falls")


@claim("14", "6.2, after Fig. 14", "psi = 0: at a jump near 0.35 the periodic motion becomes chaotic", Holds(
    f"a stable motion ends in a jump within {T.near:g} of 0.35, periodic 0.005 below it, and within 0.02 above it a "
    "Lyapunov exponent whose confidence interval is above 0", f"at such a place, or where neighbours 0.005 apart "
    f"differ by more than {T.jump:g} of the curve's maximum, the period is lost"))
def jump_to_chaos(evidence: StableMotions) -> Measured:
    row, near = rows(14)[0], about(0.35)
    ends = [end.value for end in evidence.ends(row, near) if abs(end.value - 0.35) <= evidence.limit("near")]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1]))
             for k in evidence.steep(evidence.curves([row], AXIS)[0].column("max_slip_speed"))]
    values: dict[str, Any] = {"stable motions end in a jump at": ends, "steep rises": rises}
    whole, part = False, False
    for x in ends or [x for x in rises if abs(x - 0.35) <= evidence.limit("near")]:
        below = evidence.motion({**row, FREQUENCY: (x - 5e-3) * OMEGA_N}).period
        above = [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}, lyapunov=True) for d in (5e-3, 1e-2, 2e-2)]
        values[f"period below {x:.4f}"] = below
        values[f"above {x:.4f}: period, exponent's interval (1/s), diagnosis"] = [
            [m.period] + ([] if (e := m.lyapunov) is None else [e.low, e.high, e.diagnosis]) for m in above]
        chaotic = any(m.lyapunov is not None and m.lyapunov.diagnosis == "chaotic" for m in above)
        whole |= bool(ends) and below > 0 and chaotic
        part |= below > 0 and any(m.period == 0 for m in above)
    return Measured((whole, part), values,
                    "" if ends else "the steep rise there is no jump: no stable motion ends in it",
                    tuple(evidence.motions("psi = 0", row, near)))


LINKED = 0.5
"""Rank correlation of some fifteen jumps that chance exceeds once in twenty times, about."""
APERIODIC = 17.0
"""Rank of a motion without a period up to 16."""


@claim("14", "6.2, after Fig. 14", "bifurcations are as severe as jumps are abrupt, not as slip is large", Holds(
    "over the jumps of the three curves from (13) Spearman's rank correlation of the longer of the periods 0.001 "
    f"below and above (17 for none up to 16) with the size of the jump is above {LINKED:g} and larger than that with "
    f"the larger maximum; {JUMPING}", f"the first is above {0.5 * LINKED:g}"))
def severity_follows_abruptness(evidence: Evidence) -> Measured:
    severity, abruptness, amplitude = [], [], []
    for row in rows(14):
        for x, size in evidence.jumps(row, AXIS):
            beside = [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}) for d in (-PARTED, PARTED)]
            severity.append(max(APERIODIC if m.period == 0 else float(m.period) for m in beside))
            abruptness.append(abs(size))
            amplitude.append(max(m.largest for m in beside))
    abrupt, large = (rank_correlation(severity, x) for x in (abruptness, amplitude))
    return Measured((abrupt > LINKED and abrupt > large, abrupt > 0.5 * LINKED),
                    {"jumps": len(severity), "with the size of the jump": abrupt, "with the maximum": large},
                    "" if abrupt > LINKED else "the periods beside the jumps hardly follow their size")


def rank_correlation(x: list[float], y: list[float]) -> float:
    """Spearman's coefficient, 0 where either does not vary."""
    return float(spearmanr(x, y).statistic) if len(set(x)) > 1 and len(set(y)) > 1 else 0.0


@claim("14", "6.2, after Fig. 14", "psi = pi: peaks are smooth and there are no bifurcations", Holds(
    f"period 1 at every frequency from (13) and no jump; {JUMPING}",
    "no motion that (13) leads to ends in a bifurcation, and more than 0.5 of the ratios have period 1"))
def phase_pi_is_smooth(evidence: StableMotions) -> Measured:
    row = rows(14)[2]
    found = evidence.periods(evidence.curves([row], AXIS)[0])
    jumps = [x for x, _ in evidence.jumps(row, AXIS)]
    motions = [m for place in jumps for m in evidence.motions("psi = pi", row, about(place, 0.01))]
    met = [end for m in motions if m.from_start for end in (m.stretch.low, m.stretch.high) if end.kind]
    share = float((found == 1).mean())
    smooth = share == 1.0 and not jumps
    return Measured((smooth, not met and share > 0.5),
                    {"part with period 1": share, "periods": sorted({int(p) for p in found}),
                     "jumps from (13)": [round(x, 4) for x in jumps],
                     "bifurcations of the motions that (13) leads to": [[end.kind, end.value] for end in met]},
                    "" if smooth else "period two and others appear at the super-harmonic peaks", tuple(motions))


@claim("14, 15", "6.2, before Fig. 16", "more bifurcations and aperiodic motions at 0.67 mu_s than at 0.75", Holds(
    "the part of the slipping ratios without a period up to 16 is larger over the three phases together, and so is "
    "the number of changes of period along them", "the first is so"))
def more_with_steeper_law(evidence: Evidence) -> Measured:
    shares = {str(n): aperiodic(evidence, n) for n in (14, 15)}
    changes = {str(n): [int((np.diff(evidence.periods(s)) != 0).sum()) for s in evidence.curves(rows(n), AXIS)]
               for n in (14, 15)}
    more = sum(shares["15"]) > sum(shares["14"])
    return Measured((more and sum(changes["15"]) > sum(changes["14"]), more),
                    {"aperiodic part for psi = 0, pi/2, pi": shares, "changes of period": changes})


@claim("16", "6.2, Fig. 16(a)", "numerous jumps take place for omega_f = 0.5 omega", Holds(
    f"more changes of over {T.jump:g} of the maximum between ratios 0.005 apart than for omega_f = omega and 2 omega",
    "more than for one of them"))
def half_frequency_jumps(evidence: Evidence) -> Measured:
    found = [len(evidence.steep(s.column("max_slip_speed"))) for s in evidence.curves(rows(16), AXIS)]
    return Measured((found[0] > max(found[1:]), found[0] > min(found[1:])),
                    {"changes for omega_f = 0.5 omega, omega, 2 omega": found})


@claim("16", "6.2, Fig. 16(b)", "omega_f = 0.5 omega: quasi-periodic or chaotic over the entire range", Holds(
    f"from 0.05 to 0.5 no period up to 16 at {MOST} the slipping ratios, from (13), swept up or swept down",
    "at 0.5 or more of them"))
def half_frequency_aperiodic(evidence: StableMotions) -> Measured:
    row = rows(16)[0]
    sweeps = [evidence.curves([row], AXIS, direction=way)[0] for way in ("cold", "up", "down")]
    slipping = ~sticks(sweeps[0])
    none = [evidence.periods(s) == 0 for s in sweeps]
    shares = [share_where(n, slipping) for n in none]
    return Measured((max(shares) >= evidence.most, max(shares) >= 0.5),
                    {"aperiodic part from (13), upward, downward": shares,
                     "some motion aperiodic": share_where(np.any(none, axis=0), slipping),
                     "a stable periodic motion exists": share_where(evidence.periodic_at(row, AXIS), slipping)},
                    "" if max(shares) >= evidence.most else "elsewhere the motion is periodic from every start tried")


@claim("17", "6.2, Fig. 17", "the effects of negative damping and of mismatched frequencies are evident together",
       Holds("every curve leaves the period of (35) at more of its slipping ratios (0.05 to 0.5) than in Fig. 11, "
             f"and omega_f = omega has the lowest maximum from (13) at {MOST} the ratios to 0.29",
             "one of the two is so"))
def mismatch_with_falling_law(evidence: StableMotions) -> Measured:
    shares = {str(n): off_period(evidence, n) for n in (11, 17)}
    found = maxima(evidence, 17)
    lowest, beaten = best(evidence, found, 1, LOW), exceptions(evidence, found, 1, LOW)
    more = all(b > a for a, b in zip(shares["11"], shares["17"]))
    return Measured((more and lowest >= evidence.most, more or lowest >= evidence.most),
                    {"part off the period of (35), omega_f = 2/3, 1, 4/3 omega": shares,
                     "omega_f = omega best at low frequency": lowest, "not at": beaten},
                    "both effects are there, but at some ratios another curve is lower" if beaten else "")


@claim("8 to 18", "6.2; 7; Abstract", "the negative slope of the friction law is the major cause of bifurcations and "
       "of quasi-periodic or chaotic motions",
       Holds("at the slipping ratios of Figs. 8, 10, 11, 13 (mu_k = mu_s) every period is that of (35), and on every "
             "curve of Figs. 14 to 18 (mu_k < mu_s) at 0.1 or more of them it is another one or there is none",
             "that part is larger on every curve of these than on any of those"))
def slope_is_the_cause(evidence: Evidence) -> Measured:
    parts = {str(number): off_period(evidence, number) for number in (8, 10, 11, 13, 14, 15, 16, 17, 18)}
    equal = [x for n, row in parts.items() for x in row if float(rows(int(n))[0][KINETIC]) == STATIC]  # type: ignore
    falling = [x for n, row in parts.items() for x in row if float(rows(int(n))[0][KINETIC]) < STATIC]  # type: ignore
    return Measured((max(equal) == 0.0 and min(falling) >= 0.1, max(equal) < min(falling)),
                    {"part off the period of (35), by figure and curve": parts})


@claim("18", "6.2, Fig. 18", "larger Tsp: quasi-periodic or chaotic motions at low frequency become pure stick", Holds(
    "to 0.12 the part in pure stick never falls with Tsp and ends at 1, and at Tsp = 0 or 0.125 Tsm some ratio there "
    "has no period up to 16", "the part in pure stick grows from Tsp = 0 to 0.5 Tsm"))
def amplitude_makes_stick(evidence: Evidence) -> Measured:
    sweeps, low = evidence.curves(rows(18), AXIS), AXIS <= 0.12
    stuck = [share_where(sticks(s), low) for s in sweeps]
    wild = [share_where(evidence.periods(s) == 0, low) for s in sweeps]
    grows = stuck == sorted(stuck) and stuck[-1] == 1.0
    return Measured((grows and max(wild[:2]) > 0.0, stuck[-1] > stuck[0]),
                    {"pure stick for Tsp/Tsm = 0, 0.125, 0.25, 0.5": stuck, "no period up to 16": wild})


@claim("18", "6.2, Fig. 18", "a larger Tsp enlarges slip at higher frequency", Holds(
    "the mean of the maxima from 0.31 to 0.45 grows with every Tsp", "it is larger at 0.5 Tsm than at Tsp = 0"))
def amplitude_enlarges_slip(evidence: Evidence) -> Measured:
    found = means(maxima(evidence, 18), HIGH)
    return Measured((all(b > a for a, b in pairwise(found)), found[-1] > found[0]),
                    {"mean maxima from 0.31 to 0.45 for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (rad/s)": found})


@claim("18", "6.2, Fig. 18", "a larger Tsp enlarges the jumps around 0.25 and 0.35", Holds(
    f"the largest jump within {2.0 * T.near:g} of the two ratios grows with every Tsp ({JUMPING})",
    "it is larger at 0.5 Tsm than at Tsp = 0"))
def amplitude_enlarges_jumps(evidence: Evidence) -> Measured:
    jumps = [max((abs(size) for x, size in evidence.jumps(row, AXIS)
                  if any(abs(x - mark) <= 2.0 * evidence.limit("near") for mark in NAMED)), default=0.0)
             for row in rows(18)]
    return Measured((all(b > a for a, b in pairwise(jumps)), jumps[-1] > jumps[0]),
                    {"largest jump there for Tsp/Tsm = 0, 0.125, 0.25, 0.5 (rad/s)": jumps},
                    "the jumps shrink as Tsp grows" if jumps[-1] < jumps[0] else "")


@claim("18", "6.2, Fig. 18(b)", "larger Tsp: periodic motions turn quasi-periodic or chaotic around 0.25 and 0.35",
       Equal(f"at Tsp/Tsm = 0.25 or 0.5 the part of the ratios within {T.near:g} of each without a period up to 16, "
             "from (13), is larger than that within as far of the ratios from 0.14 to 0.36 on average"))
def amplitude_aperiodic(evidence: Evidence) -> Measured:
    none: Floats = np.any([evidence.periods(s) == 0 for s in evidence.curves(rows(18)[2:], AXIS)], axis=0)

    def share(place: float) -> float:
        return float(none[np.abs(AXIS - place) <= evidence.limit("near") + 1e-9].mean())

    anywhere, near = rate_anywhere(share), {f"{m:g}": share(m) for m in NAMED}
    return Measured([(part > anywhere, True) for part in near.values()],
                    {"part without a period near": near, "near any ratio, on average": anywhere},
                    "" if min(near.values()) > anywhere else "elsewhere such motions are as frequent")


@claim("18", "6.2, Fig. 18(a)", "larger Tsp: jumps near 0.25 and 0.35", Equal(
    f"a stable motion ends in a jump within {T.near:g} of each at Tsp/Tsm = 0.25 or 0.5, found from (13) or in a sweep "
    "either way"))
def amplitude_jumps(evidence: StableMotions) -> Measured:
    curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
    found, motions = dict[str, list[float]](), list[Motion]()
    for mark in NAMED:
        axis = about(mark)
        evidence.stretches(list(curves.values()), axis)
        found[f"{mark:g}"] = [end.value for row in curves.values() for end in evidence.ends(row, axis)
                              if abs(end.value - mark) <= evidence.limit("near")]
        for name, row in curves.items():
            motions += evidence.motions(name, row, axis)
    return Measured([(bool(places), True) for places in found.values()],
                    {"stable motions end in a jump near": found}, "", tuple(motions))
