"""The claims about Figs. 14 to 18: harmonically varying normal load and a falling friction law."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.paper.catalogue import OMEGA_N
from tcc_sim.paper.claims_constant_load import NEAR
from tcc_sim.paper.claims_varying_load import AXIS, HIGH, NEARLY_ALL, best, exceptions, maxima, pure_stick_below, rows
from tcc_sim.paper.evidence import Evidence, Finding, Floats, judged, share_where, steep, sticks

LOWER = AXIS <= 0.25


def phase_with_falling_law(evidence: Evidence) -> Finding:
    """Figs. 14 and 15: psi = 0 at low frequency."""
    shares = {str(n): best(maxima(evidence, n), 0, LOWER) for n in (14, 15)}
    beaten = {str(n): exceptions(maxima(evidence, n), 0, LOWER) for n in (14, 15)}
    return Finding("14, 15", "mu_k = 0.75 and 0.67 mu_s: psi = 0 attenuates best at low frequency",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25", {"best": shares, "not at": beaten},
                   judged(min(shares.values()) >= NEARLY_ALL, min(shares.values()) >= 0.75))


def phase_reversed(evidence: Evidence) -> Finding:
    """Figs. 14 and 15: psi = 0 at high frequency."""
    shares = {str(n): best(maxima(evidence, n), 0, HIGH, worst=True) for n in (14, 15)}
    return Finding("14, 15", "at higher frequency psi = 0 acts in the opposite way: it attenuates worst",
                   f"highest maximum at {NEARLY_ALL:g} of the ratios from 0.31 to 0.45", {"worst": shares},
                   judged(min(shares.values()) >= NEARLY_ALL, max(shares.values()) >= 0.5))


def jump_to_chaos(evidence: Evidence) -> Finding:
    """Fig. 14: the jump near 0.35."""
    row = rows(14)[0]
    jumps = [x for x, _ in evidence.jumps(row, AXIS) if abs(x - 0.35) <= NEAR]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1]))
             for k in steep(evidence.curves([row], AXIS)[0].column("max_slip_speed"))]
    places = jumps or [x for x in rises if abs(x - 0.35) <= NEAR]
    values: dict[str, Any] = {"jumps": jumps, "steep rises": rises}
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
                   f"a jump within {NEAR:g} of 0.35, periodic 0.005 below it, and within 0.02 above it a Lyapunov "
                   f"exponent whose "
                   "confidence interval is above 0", values,
                   judged(bool(jumps) and any(a and b for a, b, _ in verdicts), any(a and c for a, _, c in verdicts)),
                   "" if jumps else "the steep rise there, a jump to the eye, is none: halved to a 1e-5 wide "
                                    "interval it loses "
                   "most of its change")


def more_with_steeper_law(evidence: Evidence) -> Finding:
    """Fig. 15 against Fig. 14."""
    shares = {str(n): [share_where(evidence.periods(s) == 0, ~sticks(s)) for s in evidence.curves(rows(n), AXIS)]
              for n in (14, 15)}
    return Finding("14, 15", "more bifurcations and aperiodic motions at mu_k = 0.67 mu_s than at 0.75",
                   "larger part of the slipping ratios without a period up to 16 over the three phases together",
                   {"aperiodic part for psi = 0, pi/2, pi": shares}, judged(sum(shares["15"]) > sum(shares["14"])))


def phase_pi_is_smooth(evidence: Evidence) -> Finding:
    """Fig. 14: psi = pi."""
    found = evidence.periods(evidence.curves([rows(14)[2]], AXIS)[0])
    jumps = [round(x, 4) for x, _ in evidence.jumps(rows(14)[2], AXIS)]
    share = float((found == 1).mean())
    smooth = share == 1.0 and not jumps
    return Finding("14", "psi = pi: peaks are smooth and there are no bifurcations", "period 1 at every frequency, "
                                                                                     "no jump",
                   {"part with period 1": share, "periods": sorted({int(p) for p in found}), "jumps": jumps},
                   judged(smooth, share > 0.5),
                   "" if smooth else "period two and others appear at the super-harmonic peaks")


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


def half_frequency_aperiodic(evidence: Evidence) -> Finding:
    """Fig. 16: aperiodic motions of omega_f = 0.5 omega."""
    sweep = evidence.curves([rows(16)[0]], AXIS)[0]
    share = share_where(evidence.periods(sweep) == 0, ~sticks(sweep))
    return Finding("16", "omega_f = 0.5 omega: quasi-periodic or chaotic over the entire range",
                   "no period up to 16 at more than half of the slipping ratios from 0.05 to 0.5",
                   {"aperiodic part": share},
                   judged(share > 0.5, share > 0.25))


def mismatch_with_falling_law(evidence: Evidence) -> Finding:
    """Fig. 17: both effects together, against Fig. 11, which has only the mismatch."""
    shares: dict[str, list[float]] = {}
    for number in (11, 17):
        sweeps = evidence.curves(rows(number), AXIS)
        shares[str(number)] = [share_where(evidence.periods(s) != n, ~sticks(s)) for s, n in zip(sweeps, (3, 1, 3))]
    low = best(maxima(evidence, 17), 1, LOWER)
    more = [b > a for a, b in zip(shares["11"], shares["17"])]
    return Finding("17", "the effects of negative damping and of mismatched frequencies are clearly evident together",
                   "every curve leaves the period of (35) at more of its slipping ratios than that of Fig. 11, and "
                   "omega_f = omega "
                   f"has the lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25",
                   {"part off the period of (35), omega_f = 2/3, 1, 4/3 omega": shares, "best at low frequency": low},
                   judged(all(more) and low >= NEARLY_ALL, all(more) or low >= NEARLY_ALL),
                   "" if low >= NEARLY_ALL else f"another curve is lower at "
                                                f"{exceptions(maxima(evidence, 17), 1, LOWER)}")


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


def amplitude_jumps(evidence: Evidence) -> Finding:
    """Fig. 18: jumps at higher frequency."""
    places = {f"{x:g}": [round(p, 4) for p, _ in evidence.jumps(row, AXIS)] for x,
              row in zip((0.25, 0.5), rows(18)[2:])}
    near = [any(abs(p - m) <= NEAR for found in places.values() for p in found) for m in (0.25, 0.35)]
    return Finding("18", "larger Tsp: jumps near 0.25 and 0.35",
                   f"a jump within {NEAR:g} of each at Tsp/Tsm = 0.25 or 0.5",
                   {"jumps": places}, judged(all(near), any(near)))


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
