"""The claims about Figs. 14 to 18: harmonically varying normal load and a falling friction law."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, plain
from tcc_sim.paper.claims_constant_load import NEAR, about
from tcc_sim.paper.claims_varying_load import AXIS, HIGH, NEARLY_ALL, best, exceptions, maxima, pure_stick_below, rows
from tcc_sim.paper.evidence import Evidence, Finding, Floats, judged, share_where, steep, sticks
from tcc_sim.paper.stable_motions import StableMotions, ordered_shares

LOWER = AXIS <= 0.25
HIGHER = AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
"""Ratios to which branches are followed where a claim is about the higher ones."""


def phase_with_falling_law(evidence: Evidence) -> Finding:
    """Figs. 14 and 15: psi = 0 at low frequency."""
    shares = {str(n): best(maxima(evidence, n), 0, LOWER) for n in (14, 15)}
    beaten = {str(n): exceptions(maxima(evidence, n), 0, LOWER) for n in (14, 15)}
    return Finding("14, 15", "mu_k = 0.75 and 0.67 mu_s: psi = 0 attenuates best at low frequency",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25", {"best": shares, "not at": beaten},
                   judged(min(shares.values()) >= NEARLY_ALL, min(shares.values()) >= 0.75))


def phase_reversed(evidence: StableMotions) -> Finding:
    """Figs. 14 and 15: psi = 0 at high frequency."""
    shares, motions = {}, []
    for n in (14, 15):
        evidence.stretches(rows(n), HIGHER)
        shares[str(n)] = ordered_shares([evidence.amplitudes(row, HIGHER) for row in rows(n)], 0,
                                        (HIGHER >= 0.31) & (HIGHER <= 0.45), worst=True)
        for series in FIGURES[n].series:
            motions += evidence.motions(f"Fig. {n}, {plain(series.label)}", series.values, HIGHER)
    return Finding("14, 15", "at higher frequency psi = 0 acts in the opposite way: it attenuates worst",
                   f"highest maximum at {NEARLY_ALL:g} of the ratios from 0.31 to 0.45, whichever stable motion there "
                   "is on every curve",
                   {"worst for every choice of motions, for some": {n: list(s) for n, s in shares.items()},
                    "from (13)": {str(n): best(maxima(evidence, n), 0, HIGH, worst=True) for n in (14, 15)}},
                   judged(min(every for every, _ in shares.values()) >= NEARLY_ALL,
                          max(some for _, some in shares.values()) >= 0.5), "", tuple(motions))


def jump_to_chaos(evidence: StableMotions) -> Finding:
    """Fig. 14: the jump near 0.35."""
    row, near = rows(14)[0], about(0.35)
    ends = [end for end in evidence.ends(row, near) if abs(end.value - 0.35) <= NEAR]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1]))
             for k in steep(evidence.curves([row], AXIS)[0].column("max_slip_speed"))]
    places = [end.value for end in ends] or [x for x in rises if abs(x - 0.35) <= NEAR]
    values: dict[str, Any] = {"stable motions end in a jump at": [end.value for end in ends], "steep rises": rises}
    verdicts = []
    for x in places:
        below = evidence.motion({**row, "engine.frequency": (x - 5e-3) * OMEGA_N})
        above = [evidence.motion({**row, "engine.frequency": (x + d) * OMEGA_N}, lyapunov=True)
                 for d in (5e-3, 1e-2, 2e-2)]
        values[f"period below {x:.4f}"] = below["period"]
        values[f"above {x:.4f}"] = [[a["period"], a["lyapunov"]["low"], a["lyapunov"]["high"],
                                     a["lyapunov"]["diagnosis"]]
                                    for a in above]
        verdicts.append(((below["period"] or 0) > 0, any(a["lyapunov"]["diagnosis"] == "chaotic" for a in above),
                         any(a["period"] == 0 for a in above)))
    return Finding("14", "psi = 0: at a jump near 0.35 the periodic motion becomes chaotic",
                   f"a stable motion ends in a jump within {NEAR:g} of 0.35, periodic 0.005 below it, and within 0.02 "
                   "above it a Lyapunov exponent whose confidence interval is above 0", values,
                   judged(bool(ends) and any(a and b for a, b, _ in verdicts), any(a and c for a, _, c in verdicts)),
                   "" if ends else "the steep rise there, a jump to the eye, is none: no stable motion ends in it",
                   tuple(evidence.motions("psi = 0", row, near)))


def more_with_steeper_law(evidence: Evidence) -> Finding:
    """Fig. 15 against Fig. 14."""
    shares = {str(n): [share_where(evidence.periods(s) == 0, ~sticks(s)) for s in evidence.curves(rows(n), AXIS)]
              for n in (14, 15)}
    return Finding("14, 15", "more bifurcations and aperiodic motions at mu_k = 0.67 mu_s than at 0.75",
                   "larger part of the slipping ratios without a period up to 16 over the three phases together",
                   {"aperiodic part for psi = 0, pi/2, pi": shares}, judged(sum(shares["15"]) > sum(shares["14"])))


def phase_pi_is_smooth(evidence: StableMotions) -> Finding:
    """Fig. 14: psi = pi."""
    row = rows(14)[2]
    found = evidence.periods(evidence.curves([row], AXIS)[0])
    jumps = [x for x, _ in evidence.jumps(row, AXIS)]
    motions, met = [], []
    for place in jumps:
        followed = evidence.motions("psi = pi", row, about(place, 0.01))
        motions += followed
        met += [m[end] for m in followed if m["from_start"] for end in ("low", "high") if m[end]["kind"]]
    share = float((found == 1).mean())
    smooth = share == 1.0 and not jumps
    return Finding("14", "psi = pi: peaks are smooth and there are no bifurcations",
                   "period 1 at every frequency from (13) and no jump; not so where a motion that (13) leads to ends "
                   "in a bifurcation",
                   {"part with period 1": share, "periods": sorted({int(p) for p in found}),
                    "jumps from (13)": [round(x, 4) for x in jumps],
                    "bifurcations of the motions that (13) leads to": [[m["kind"], m["value"]] for m in met]},
                   judged(smooth, not met and share > 0.5),
                   "" if smooth else "period two and others appear at the super-harmonic peaks", tuple(motions))


def severity_follows_abruptness(evidence: Evidence) -> Finding:
    """Fig. 14: how bad a bifurcation is, against the abruptness of the curve and the size of the slip."""
    severity, abruptness, amplitude = [], [], []
    for sweep in evidence.curves(rows(14), AXIS):
        largest = sweep.column("max_slip_speed")
        change = np.abs(np.diff(largest))
        change = np.maximum(np.append(change, 0.0), np.insert(change, 0, 0.0))
        found = evidence.periods(sweep).astype(np.float64)
        found[found == 0] = APERIODIC
        slipping = ~sticks(sweep) & (found > 0.0) & np.isfinite(largest)
        severity.append(found[slipping])
        abruptness.append(change[slipping])
        amplitude.append(largest[slipping])
    ranks = [ranked(np.concatenate(x)) for x in (severity, abruptness, amplitude)]
    abrupt, large = correlation(ranks[0], ranks[1]), correlation(ranks[0], ranks[2])
    return Finding("14", "the severity of bifurcations follows the abruptness of jumps more than the amplitude of slip",
                   "Spearman's rank correlation of the period (aperiodic: highest) with the change of the maximum to "
                   "the next "
                   "ratio above 0 and larger than that with the maximum itself, over the slipping ratios of the "
                   "three curves",
                   {"with the change": abrupt, "with the maximum": large}, judged(abrupt > 0.0 and abrupt > large))


APERIODIC = 17.0
"""Rank of a motion without a period up to 16."""


def ranked(values: Floats) -> Floats:
    """Ranks from 0 on, the mean rank where values are equal."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    above = np.cumsum(count)
    out: Floats = (above - 0.5 * (count + 1))[place]
    return out


def correlation(x: Floats, y: Floats) -> float:
    """Pearson's coefficient, 0 where either does not vary."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else 0.0


def same_frequency_suppresses(evidence: Evidence) -> Finding:
    """Fig. 16: omega_f = omega against 2 omega."""
    found = maxima(evidence, 16)
    share = best(found[1:], 0, LOWER)
    return Finding("16", "at lower frequency omega_f = omega suppresses slip better than omega_f = 2 omega",
                   f"lower maximum of the two at {NEARLY_ALL:g} of the ratios to 0.25",
                   {"lower": share, "not at": exceptions(found[1:], 0, LOWER)},
                   judged(share >= NEARLY_ALL, share >= 0.75))


def half_frequency_jumps(evidence: Evidence) -> Finding:
    """Fig. 16: jumps of omega_f = 0.5 omega."""
    found = [len(steep(s.column("max_slip_speed"))) for s in evidence.curves(rows(16), AXIS)]
    return Finding("16", "numerous jumps take place for omega_f = 0.5 omega",
                   "more changes of over 8 % of the maximum between neighbours than for omega_f = omega and 2 omega",
                   {"changes for omega_f = 0.5 omega, omega, 2 omega": found},
                   judged(found[0] > max(found[1:]), found[0] > min(found[1:])))


def half_frequency_aperiodic(evidence: StableMotions) -> Finding:
    """Fig. 16: aperiodic motions of omega_f = 0.5 omega."""
    row = rows(16)[0]
    sweeps = [evidence.curves([row], AXIS, direction=d)[0] for d in ("cold", "up", "down")]
    slipping = ~sticks(sweeps[0])
    none = [evidence.periods(s) == 0 for s in sweeps]
    periodic = evidence.periodic_at(row, AXIS)
    some, every = np.any(none, axis=0), np.all(none, axis=0) & ~periodic
    share = share_where(every, slipping)
    return Finding("16", "omega_f = 0.5 omega: quasi-periodic or chaotic over the entire range",
                   "at more than half of the slipping ratios from 0.05 to 0.5 every motion known is without a period "
                   "up to 16: from (13), swept up and down, and no stable orbit that Newton's method closes",
                   {"aperiodic part, every motion known": share,
                    "from (13), upward, downward": [share_where(n, slipping) for n in none],
                    "some motion aperiodic": share_where(some, slipping),
                    "a stable periodic motion exists": share_where(periodic, slipping)},
                   judged(share > 0.5, share > 0.25),
                   "" if share > 0.5 else "not over the entire range, whatever was started from: elsewhere there is a "
                                          "stable periodic motion")


def mismatch_with_falling_law(evidence: StableMotions) -> Finding:
    """Fig. 17: both effects together, against Fig. 11, which has only the mismatch."""
    shares: dict[str, list[float]] = {}
    for number in (11, 17):
        sweeps = evidence.curves(rows(number), AXIS)
        shares[str(number)] = [share_where(evidence.periods(s) != n, ~sticks(s)) for s, n in zip(sweeps, (3, 1, 3))]
    from_start = best(maxima(evidence, 17), 1, LOWER)
    beaten = exceptions(maxima(evidence, 17), 1, LOWER)
    kept, motions = 0, []
    for place in beaten:
        axis = about(place, 7e-3)
        evidence.stretches(rows(17), axis)
        middle = [[evidence.amplitudes(row, axis)[len(axis) // 2]] for row in rows(17)]
        kept += ordered_shares(middle, 1, np.array([True]))[1] == 1.0
        for row in rows(17):
            motions += evidence.motions(f"omega_f = {row['pressure.frequency_ratio']:.3f} omega", row, axis)
    # A ratio at which another choice of motions would put omega_f = omega lowest counts for some choice only.
    for_some = from_start + kept / max(int(LOWER.sum()), 1)
    more = [b > a for a, b in zip(shares["11"], shares["17"])]
    return Finding("17", "the effects of negative damping and of mismatched frequencies are clearly evident together",
                   "every curve leaves the period of (35) at more of its slipping ratios than that of Fig. 11, and "
                   f"omega_f = omega has the lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25",
                   {"part off the period of (35), omega_f = 2/3, 1, 4/3 omega": shares,
                    "best at low frequency from (13), and for some choice of stable motions": [from_start, for_some]},
                   judged(all(more) and from_start >= NEARLY_ALL, all(more) or for_some >= NEARLY_ALL),
                   f"another curve is lower at {beaten}" if beaten else "", tuple(motions))


def amplitude_makes_stick(evidence: Evidence) -> Finding:
    """Fig. 18: low frequency."""
    sweeps = evidence.curves(rows(18), AXIS)
    low = AXIS <= 0.12
    stuck = [share_where(sticks(s), low) for s in sweeps]
    wild = [share_where(evidence.periods(s) != 1, low) for s in sweeps]
    return Finding("18", "larger Tsp: aperiodic motions at low frequency become pure stick",
                   "to 0.12 the part in pure stick never falls with Tsp and ends at 1, from motions other than "
                   "period 1",
                   {"pure stick for Tsp/Tsm = 0, 0.125, 0.25, 0.5": stuck, "not period 1": wild},
                   judged(stuck == sorted(stuck) and stuck[-1] == 1.0 and wild[0] > 0.0, stuck[-1] > stuck[0]))


def amplitude_jumps(evidence: StableMotions) -> Finding:
    """Fig. 18: jumps at higher frequency."""
    curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
    found: dict[str, list[float]] = {}
    motions: list[dict[str, Any]] = []
    for mark in (0.25, 0.35):
        axis = about(mark)
        evidence.stretches(list(curves.values()), axis)
        found[f"{mark:g}"] = [end.value for row in curves.values() for end in evidence.ends(row, axis)
                              if abs(end.value - mark) <= NEAR]
        for name, row in curves.items():
            motions += evidence.motions(name, row, axis)
    near = [bool(places) for places in found.values()]
    return Finding("18", "larger Tsp: jumps near 0.25 and 0.35",
                   f"a stable motion ends in a jump within {NEAR:g} of each at Tsp/Tsm = 0.25 or 0.5, whatever was "
                   "started from", {"stable motions end in a jump near": found}, judged(all(near), any(near)), "",
                   tuple(motions))


def stick_below_015(evidence: Evidence) -> Finding:
    """Fig. 14: pure stick."""
    return pure_stick_below(evidence, 14, 0.15)


def amplitude_aperiodic(evidence: Evidence) -> Finding:
    """Fig. 18: aperiodic motions at higher frequency."""
    found = {f"{x:g}": [float(r) for r in AXIS[evidence.periods(sweep) == 0]]
             for x, sweep in zip((0.25, 0.5), evidence.curves(rows(18)[2:], AXIS))}
    near = [any(abs(p - m) <= NEAR for places in found.values() for p in places) for m in (0.25, 0.35)]
    return Finding("18", "larger Tsp: periodic motions turn quasi-periodic or chaotic again around 0.25 and 0.35",
                   f"a ratio without a period up to 16 within {NEAR:g} of each at Tsp/Tsm = 0.25 or 0.5",
                   {"without a period": found}, judged(all(near), any(near)))


CLAIMS = (phase_with_falling_law, phase_reversed, stick_below_015, jump_to_chaos, severity_follows_abruptness,
          phase_pi_is_smooth, more_with_steeper_law, same_frequency_suppresses, half_frequency_jumps,
          half_frequency_aperiodic, mismatch_with_falling_law, amplitude_makes_stick, amplitude_jumps,
          amplitude_aperiodic)
