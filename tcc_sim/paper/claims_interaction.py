"""The claims about Figs. 14 to 18: harmonically varying normal load and a falling friction law."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import spearmanr

from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, STATIC, plain
from tcc_sim.paper.claims_figure4 import JUMPING, NEAR, WAYS, about, prominent_maxima
from tcc_sim.paper.claims_varying_load import (
    AXIS,
    HIGH,
    LOW,
    LOWEST,
    SHOWS,
    SLIPPING,
    WITHIN_STICK,
    best,
    by_law,
    exceptions,
    maxima,
    off_period,
    pure_stick_below,
    rows,
    stick_interval,
)
from tcc_sim.paper.criteria import Equal, Holds, Measured, Shares, claim
from tcc_sim.paper.evidence import FREQUENCY, JUMP, KINETIC, Evidence, share_where, steep, sticks
from tcc_sim.paper.stable_motions import Motion, StableMotions, ordered_shares
from tcc_sim.sweeps.sweep import Sweep

HIGHER = AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
"""Ratios to which branches are followed where a claim is about the higher ones."""


LOWEST_AT_LOW = Holds(
    f"at 0.95 or more of the ratios to 0.29 where a curve slips (above {SLIPPING:g} rad/s) its maximum from (13) is "
    f"the lowest (within {SHOWS:g} rad/s)", "the mean of its maxima over these ratios is the lowest")
"""Of psi = 0, below the ratio 0.30 that the paper names."""


def _best_at_low(evidence: Evidence, number: int) -> Measured:
    """How often psi = 0 is the lowest below 0.30, where it is not, and the mean maxima."""
    found = maxima(evidence, number)
    share = best(found, 0, LOW)
    means = [float(x) for x in found[:, LOW].mean(axis=1)]
    return Measured((share >= 0.95, means[0] == min(means)), {
        "best": share, "mean maxima for psi = 0, pi/2, pi (rad/s)": means, "not at": exceptions(found, 0, LOW)},
        "" if share >= 0.95 else "psi = 0 is the lowest in the mean, but not at the ratios listed"
        if means[0] == min(means) else "another phase is lower in the mean")


@claim("14", "6.2, Fig. 14(a)", "mu_k = 0.75 mu_s: psi = 0 attenuates best at low frequency", LOWEST_AT_LOW)
def phase_with_falling_law(evidence: Evidence) -> Measured:
    return _best_at_low(evidence, 14)


@claim("15", "6.2, Fig. 15(a)", "mu_k = 0.67 mu_s: psi = 0 attenuates best at low frequency", LOWEST_AT_LOW)
def phase_with_steeper_law(evidence: Evidence) -> Measured:
    return _best_at_low(evidence, 15)


@claim("14, 15", "6.2, Figs. 14(a), 15(a)", "mu_k < mu_s: psi = pi attenuates worst at low frequency", Holds(
    "in both figures the mean over the ratios to 0.29 of its maxima from (13) is the highest", "in one of them"))
def phase_pi_is_worst(evidence: Evidence) -> Measured:
    means = {str(n): [float(x) for x in maxima(evidence, n)[:, LOW].mean(axis=1)] for n in (14, 15)}
    worst = [row[2] == max(row) for row in means.values()]
    return Measured((all(worst), any(worst)), {"mean maxima for psi = 0, pi/2, pi (rad/s)": means})


@claim("8, 14", "6.2, Fig. 14(a)", "the negative slope exaggerates stick-slip: it adds super-harmonic peaks and slip",
       Holds("for every phase the curve of 0.75 mu_s has more peaks below 0.30 than that of mu_k = mu_s, and a larger "
             "mean maximum there", "the mean maximum is larger for every phase"))
def slope_exaggerates(evidence: Evidence) -> Measured:
    equal, falling = (maxima(evidence, n) for n in (8, 14))
    counts = [[len(prominent_maxima(AXIS[LOW], row[LOW])) for row in found] for found in (equal, falling)]
    means = [[float(x) for x in found[:, LOW].mean(axis=1)] for found in (equal, falling)]
    more = all(b > a for a, b in zip(*means))
    return Measured((more and all(b > a for a, b in zip(*counts)), more), {
        "peaks below 0.30 at mu_k = mu_s and 0.75 mu_s, psi = 0, pi/2, pi": counts,
        "mean maxima there (rad/s)": means},
        "slip grows for every phase, peaks are not added for every phase" if more else "")


@claim("4 to 18", "3; captions", "fifty dropped cycles suffice: what is kept is the steady state", Shares(
    "points of every curve of Figs. 4, 8, 10, 11 and 13 to 18 from (13) whose section has settled after 150 cycles"))
def fifty_suffice(evidence: Evidence) -> Measured:
    found = {str(n): [_settled(s) for s in evidence.curves(rows(n), AXIS)] for n in (4, 8, 10, 11, *range(13, 19))}
    parts = [x for row in found.values() for x in row]
    return Measured(parts, {"settled part, by figure and curve": found}, f"{100.0 * (1.0 - max(parts)):.0f} to "
                    f"{100.0 * (1.0 - min(parts)):.0f} % of the points of a curve have not settled by then")


def _settled(sweep: Sweep) -> float:
    """The part of the points of a sweep whose section has settled by the paper's rule."""
    return float(np.mean([p is not None and p.summary is not None and p.summary.settled for p in sweep.points]))


@claim("14, 15", "6.2, after Fig. 14", "at higher frequency psi = 0 acts in the opposite way: worst", Holds(
    f"at 0.95 or more of the ratios 0.31 to 0.45 where a curve slips (above {SLIPPING:g} rad/s) its maximum is the "
    f"highest (within {SHOWS:g} rad/s), whichever stable motion there is on every curve",
    "at 0.5 or more for some choice of motions"))
def phase_reversed(evidence: StableMotions) -> Measured:
    shares, motions = {}, list[Motion]()
    for n in (14, 15):
        evidence.stretches(rows(n), HIGHER)
        shares[str(n)] = ordered_shares([evidence.amplitudes(row, HIGHER) for row in rows(n)], 0,
                                        (HIGHER >= 0.31) & (HIGHER <= 0.45), (SHOWS, SLIPPING), worst=True)
        for series in FIGURES[n].series:
            motions += evidence.motions(f"Fig. {n}, {plain(series.label)}", series.values, HIGHER)
    return Measured((min(every for every, _ in shares.values()) >= 0.95,
                     max(some for _, some in shares.values()) >= 0.5),
                    {"worst for every choice of motions, for some": {n: list(s) for n, s in shares.items()},
                     "from (13)": {str(n): best(maxima(evidence, n), 0, HIGH, worst=True) for n in (14, 15)}},
                    "" if min(every for every, _ in shares.values()) >= 0.95 else
                    "where motions coexist, another phase is the highest for some choices of them", tuple(motions))


@claim("14", "6.2, after Fig. 14", "psi = 0: pure stick below 0.15", Equal(f"0.15 lies in the interval {WITHIN_STICK}"),
       fitted=True)
def stick_below_015(evidence: Evidence) -> Measured:
    return pure_stick_below(evidence, 14, 0.15)


@claim("14", "6.2, after Fig. 14", "it begins to slip at a lower ratio than in Fig. 8, due to the negative damping",
       Equal("the lowest ratio that slips from (13) at 0.75 mu_s is below that at mu_k = mu_s, with either law"))
def earlier_onset(evidence: Evidence) -> Measured:
    """Fig. 14 against Fig. 8: nothing but mu_k differs, and (10) does not hold it."""
    found = {law: [stick_interval(evidence, by_law(n)[law])[0] for n in (8, 14)] for law in by_law(8)}
    return Measured([(falling < equal, True) for equal, falling in found.values()],
                    {f"lowest slip at mu_k = mu_s and 0.75 mu_s, {law}": x for law, x in found.items()},
                    "the end of stick by (10) is the same for both: a motion that slips goes on below it where "
                    "friction falls")


@claim("14", "6.2, after Fig. 14", "psi = 0: at a jump near 0.35 the periodic motion becomes chaotic", Holds(
    f"a stable motion ends in a jump within {NEAR:g} of 0.35, periodic 0.005 below it, and within 0.02 above it a "
    "Lyapunov exponent whose confidence interval is above 0", f"at such a place, or where neighbours 0.005 apart "
    f"differ by more than {JUMP:g} of the curve's maximum, the period is lost"))
def jump_to_chaos(evidence: StableMotions) -> Measured:
    row, near = rows(14)[0], about(0.35)
    ends = [end.value for end in evidence.ends(row, near) if abs(end.value - 0.35) <= NEAR]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1]))
             for k in steep(evidence.curves([row], AXIS)[0].column("max_slip_speed"))]
    values: dict[str, Any] = {"stable motions end in a jump at": ends, "steep rises": rises}
    whole, part = False, False
    for x in ends or [x for x in rises if abs(x - 0.35) <= NEAR]:
        below = evidence.motion({**row, FREQUENCY: (x - 5e-3) * OMEGA_N}).period
        above = [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}, lyapunov=True) for d in (5e-3, 1e-2, 2e-2)]
        values[f"period below {x:.4f}"] = below
        values[f"above {x:.4f}: period, exponent's interval (1/s), diagnosis"] = [
            [m.period] + ([] if (e := m.lyapunov) is None else [e.low, e.high, e.diagnosis]) for m in above]
        chaotic = any(m.lyapunov is not None and m.lyapunov.diagnosis == "chaotic" for m in above)
        whole |= bool(ends) and below > 0 and chaotic
        part |= below > 0 and any(m.period == 0 for m in above)
    return Measured((whole, part), values,
                    "" if ends else "the steep rise there, a jump to the eye, is none: no stable motion ends in it",
                    tuple(evidence.motions("psi = 0", row, near)))


LINKED = 0.5
"""Rank correlation of some fifteen jumps that chance exceeds once in twenty times, about."""


@claim("14", "6.2, after Fig. 14", "bifurcations are as severe as jumps are abrupt, not as slip is large", Holds(
    "over the jumps of the three curves from (13) Spearman's rank correlation of the longer of the periods 0.001 "
    f"below and above (17 for none up to 16) with the size of the jump is above {LINKED:g} and larger than that with "
    f"the larger maximum; {JUMPING}", f"the first is above {0.5 * LINKED:g}"))
def severity_follows_abruptness(evidence: Evidence) -> Measured:
    severity, abruptness, amplitude = [], [], []
    for row in rows(14):
        for x, size in evidence.jumps(row, AXIS):
            beside = [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}) for d in (-1e-3, 1e-3)]
            severity.append(max(APERIODIC if m.period == 0 else float(m.period) for m in beside))
            abruptness.append(abs(size))
            amplitude.append(max(m.largest for m in beside))
    abrupt, large = (rank_correlation(severity, x) for x in (abruptness, amplitude))
    return Measured((abrupt > LINKED and abrupt > large, abrupt > 0.5 * LINKED),
                    {"jumps": len(severity), "with the size of the jump": abrupt, "with the maximum": large},
                    "" if abrupt > LINKED else "the periods beside the jumps hardly follow their size")


APERIODIC = 17.0
"""Rank of a motion without a period up to 16."""


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


def _aperiodic(evidence: Evidence, number: int) -> list[float]:
    """The part of the slipping ratios without a period up to 16, for every curve of a figure."""
    return [share_where(evidence.periods(s) == 0, ~sticks(s)) for s in evidence.curves(rows(number), AXIS)]


@claim("14, 15", "6.2, before Fig. 16", "more bifurcations and aperiodic motions at 0.67 mu_s than at 0.75", Holds(
    "the part of the slipping ratios without a period up to 16 is larger over the three phases together, and so is "
    "the number of changes of period along them", "the first is so"))
def more_with_steeper_law(evidence: Evidence) -> Measured:
    shares = {str(n): _aperiodic(evidence, n) for n in (14, 15)}
    changes = {str(n): [int((np.diff(evidence.periods(s)) != 0).sum()) for s in evidence.curves(rows(n), AXIS)]
               for n in (14, 15)}
    more = sum(shares["15"]) > sum(shares["14"])
    return Measured((more and sum(changes["15"]) > sum(changes["14"]), more),
                    {"aperiodic part for psi = 0, pi/2, pi": shares, "changes of period": changes})


@claim("16", "6.2, Fig. 16(a)", "at lower frequency omega_f = omega suppresses slip better than omega_f = 2 omega",
       Shares(LOWEST.format("to 0.29") + " of the two"))
def same_frequency_suppresses(evidence: Evidence) -> Measured:
    found = maxima(evidence, 16)[1:]
    share = best(found, 0, LOW)
    return Measured([share], {"lower": share, "not at": exceptions(found, 0, LOW)},
                    "" if share >= 0.95 else "at the ratios listed omega_f = 2 omega is lower")


@claim("16", "6.2, Fig. 16(a)", "numerous jumps take place for omega_f = 0.5 omega", Holds(
    f"more changes of over {JUMP:g} of the maximum between ratios 0.005 apart than for omega_f = omega and 2 omega",
    "more than for one of them"))
def half_frequency_jumps(evidence: Evidence) -> Measured:
    found = [len(steep(s.column("max_slip_speed"))) for s in evidence.curves(rows(16), AXIS)]
    return Measured((found[0] > max(found[1:]), found[0] > min(found[1:])),
                    {"changes for omega_f = 0.5 omega, omega, 2 omega": found})


@claim("16", "6.2, Fig. 16(b)", "omega_f = 0.5 omega: quasi-periodic or chaotic over the entire range", Holds(
    "from 0.05 to 0.5 no period up to 16 at 0.95 or more of the slipping ratios, from (13), swept up or swept down",
    "at 0.5 or more of them"))
def half_frequency_aperiodic(evidence: StableMotions) -> Measured:
    row = rows(16)[0]
    sweeps = [evidence.curves([row], AXIS, direction=way)[0] for way in WAYS]
    slipping = ~sticks(sweeps[0])
    none = [evidence.periods(s) == 0 for s in sweeps]
    periodic = evidence.periodic_at(row, AXIS)
    shares = [share_where(n, slipping) for n in none]
    return Measured((max(shares) >= 0.95, max(shares) >= 0.5),
                    {"aperiodic part from (13), upward, downward": shares,
                     "some motion aperiodic": share_where(np.any(none, axis=0), slipping),
                     "a stable periodic motion exists": share_where(periodic, slipping)},
                    "" if max(shares) >= 0.95 else "elsewhere the motion is periodic, whatever was started from")


@claim("17", "6.2, Fig. 17", "the effects of negative damping and of mismatched frequencies are evident together",
       Holds("every curve leaves the period of (35) at more of its slipping ratios (0.05 to 0.5) than in Fig. 11, "
             "and omega_f = omega has the lowest maximum from (13) at 0.95 or more of the ratios to 0.29",
             "one of the two is so"))
def mismatch_with_falling_law(evidence: StableMotions) -> Measured:
    """Fig. 17: both effects together, against Fig. 11, which has only the mismatch."""
    shares = {str(n): off_period(evidence, n) for n in (11, 17)}
    lowest = best(maxima(evidence, 17), 1, LOW)
    beaten = exceptions(maxima(evidence, 17), 1, LOW)
    more = all(b > a for a, b in zip(shares["11"], shares["17"]))
    return Measured((more and lowest >= 0.95, more or lowest >= 0.95),
                    {"part off the period of (35), omega_f = 2/3, 1, 4/3 omega": shares,
                     "omega_f = omega best at low frequency": lowest, "not at": beaten},
                    f"another curve is lower at {beaten}" if beaten else "")


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
