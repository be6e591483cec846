"""The claims about Figs. 8 to 13 and (35): harmonically varying normal load with mu_k = mu_s."""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.model import closed_form
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, paper_system, plain
from tcc_sim.paper.claims_constant_load import NEAR
from tcc_sim.paper.evidence import (
    Evidence,
    Finding,
    Floats,
    Values,
    judged,
    share_where,
    sticks,
    with_kinetic,
)
from tcc_sim.paper.settled_histories import first_half
from tcc_sim.paper.stable_motions import StableMotions

AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
LOW, HIGH = AXIS <= 0.29, (AXIS >= 0.31) & (AXIS <= 0.45)
NEARLY_ALL = 0.95
"""The part of the frequencies at which an order must hold."""


def rows(number: int) -> list[Values]:
    """The scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


def maxima(evidence: Evidence, number: int) -> Floats:
    """(curves, frequencies) largest slip speeds."""
    return np.array([s.column("max_slip_speed") for s in evidence.curves(rows(number), AXIS)])


def best(found: Floats, curve: int, where: np.ndarray, *, worst: bool = False) -> float:
    """The part of the frequencies at which one curve is the lowest of all (the highest), where any slips."""
    others = np.delete(found, curve, axis=0)
    ordered = found[curve] >= others.max(axis=0) - 0.05 if worst else found[curve] <= others.min(axis=0) + 0.05
    return share_where(ordered, where & (found.max(axis=0) > 0.1))


def exceptions(found: Floats, curve: int, where: np.ndarray) -> list[float]:
    """The frequency ratios at which one curve is not the lowest of all."""
    others = np.delete(found, curve, axis=0)
    return [float(x) for x in AXIS[where & (found[curve] > others.min(axis=0) + 0.05)]]


def _every_period(evidence: Evidence, number: int) -> dict[str, list[int]]:
    """The periods met along every curve."""
    return {plain(s.label): sorted({int(p) for p in evidence.periods(sweep)})
            for s, sweep in zip(FIGURES[number].series, evidence.curves(rows(number), AXIS))}


def phase_attenuates(evidence: Evidence) -> Finding:
    """Fig. 8: psi = 0."""
    found = maxima(evidence, 8)
    below, above = best(found, 0, LOW), best(found, 0, HIGH, worst=True)
    return Finding("8", "psi = 0 attenuates slip best below about 0.30 and worst above",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.29, highest at as many from 0.31 to 0.45",
                   {"best below": below, "worst above": above}, judged(below >= NEARLY_ALL and above >= NEARLY_ALL,
                                                                       below >= NEARLY_ALL or above >= NEARLY_ALL))


def _without_bifurcations(evidence: Evidence, number: int, claim: str) -> Finding:
    """Period one everywhere."""
    found = _every_period(evidence, number)
    return Finding(str(number), claim, "period 1 at every frequency and for every curve", {"periods": found},
                   judged(all(p == [1] for p in found.values())))


def phase_bifurcations(evidence: Evidence) -> Finding:
    """Fig. 8: no bifurcations."""
    return _without_bifurcations(evidence, 8, "no bifurcations for mu_k = mu_s and any phase")


def phase_jumps(evidence: Evidence) -> Finding:
    """Fig. 8: no jumps."""
    found = {plain(s.label): [round(x, 4) for x, _ in evidence.jumps(s.values, AXIS)] for s in FIGURES[8].series}
    return Finding("8", "the curves are smooth for mu_k = mu_s and any phase: no jumps",
                   "no jump of more than 8 % of the maximum on a 1e-5 wide interval", {"jumps": found},
                   judged(not any(found.values())))


def amplitude_bifurcations(evidence: Evidence) -> Finding:
    """Fig. 13: no bifurcations."""
    return _without_bifurcations(evidence, 13, "no bifurcations for mu_k = mu_s and any Tsp")


def _first_slip(evidence: Evidence, number: int, curve: int, law: str) -> float | None:
    """Lowest ratio at which the clutch slips once it has settled, to 0.001, with either law."""
    axis = np.round(np.arange(0.05, 0.2501, 0.001), 6)
    found = axis[evidence.slips(evidence.curves([{**rows(number)[curve], "friction.law": law}], axis)[0])]
    return float(found.min()) if len(found) else None


def pure_stick_below(evidence: Evidence, number: int, place: float) -> Finding:
    """Pure stick for psi = 0 at low frequency."""
    ends = {law: _first_slip(evidence, number, 0, law) for law in ("smoothed", "set_valued")}
    near = [x is not None and abs(x - place) <= NEAR for x in ends.values()]
    lower = closed_form.stick_limits(paper_system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
    limit = None if lower is None else lower / OMEGA_N
    return Finding(str(number), f"psi = 0: pure stick below {place:g}",
                   f"lowest ratio at which the motion from (13) slips for good within {NEAR:g} of {place:g} with "
                   "either law",
                   {**ends, "(10), whatever mu_k": limit}, judged(all(near), any(near)),
                   "between the lowest slip and the end of pure stick by (10) motions of both kinds exist")


def stick_below_018(evidence: Evidence) -> Finding:
    """Fig. 8: pure stick."""
    return pure_stick_below(evidence, 8, 0.18)


def delay(evidence: Evidence) -> Finding:
    """Fig. 9: when the slip takes place."""
    shares = {f"{float(s.values['engine.frequency']) / OMEGA_N:.2f}":  # type: ignore[arg-type]
              first_half(evidence.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
    first, second = [shares["0.15"], shares["0.18"]], [shares["0.37"], shares["0.40"]]
    return Finding("9",
                   "positive slip falls into the first half cycle at 0.15 and 0.18, into the second at 0.37 and 0.40",
                   "more than 0.8 of the way slipped in the first half cycle, less than 0.2",
                   {"part in the first half": shares},
                   judged(min(first) > 0.8 and max(second) < 0.2))


EXPECTED = {0.5: 2, 2.0: 1, 2.0 / 3.0: 3, 4.0 / 3.0: 3, 1.0: 1}
"""Period by (35) for every omega_f/omega of Figs. 10 and 11."""


def actuation_periods(evidence: Evidence) -> Finding:
    """Figs. 10 to 12: periods."""
    single = {f"{r:.3f}": evidence.motion(_actuated(r, 150.0 / OMEGA_N))["period"] for r in EXPECTED if r != 1.0}
    exact = [single[f"{r:.3f}"] == p for r, p in EXPECTED.items() if r != 1.0]
    along = {name: float((found == EXPECTED[ratio]).mean()) if len(found) else 1.0
             for name, (ratio, found) in _slipping_periods(evidence).items() if ratio != 1.0}
    return Finding("10, 11, 12", "omega_f/omega = 1/2, 2, 2/3, 4/3 give period 2, 1, 3, 3",
                   f"these periods at 150 rad/s, and at {NEARLY_ALL:g} of the slipping ratios of Figs. 10 and 11",
                   {"at 150 rad/s": single, "part of the slipping ratios": along},
                   judged(all(exact) and min(along.values()) >= NEARLY_ALL, all(exact)))


def actuation_bifurcations(evidence: Evidence) -> Finding:
    """Figs. 10 and 11: no bifurcations."""
    found = {name: sorted({int(p) for p in periods}) for name, (_, periods) in _slipping_periods(evidence).items()}
    return Finding("10, 11", "no bifurcations for mu_k = mu_s and any omega_f",
                   "one period along every curve, wherever the clutch slips", {"periods": found},
                   judged(all(len(p) <= 1 for p in found.values())))


def _slipping_periods(evidence: Evidence) -> dict[str, tuple[float, np.ndarray]]:
    """omega_f/omega and the periods where the clutch slips, for every curve of Figs. 10 and 11."""
    out: dict[str, tuple[float, np.ndarray]] = {}
    for number in (10, 11):
        for row, sweep in zip(rows(number), evidence.curves(rows(number), AXIS)):
            ratio = float(row["pressure.frequency_ratio"])  # type: ignore[arg-type]
            out[f"{ratio:.3f}"] = ratio, evidence.periods(sweep)[~sticks(sweep)]
    return out


def actuation_attenuates(evidence: Evidence) -> Finding:
    """Figs. 10 and 11: omega_f = omega."""
    low = AXIS <= 0.25
    shares = {str(n): best(maxima(evidence, n), 1, low) for n in (10, 11)}
    return Finding("10, 11", "omega_f = omega attenuates best at low frequency",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25", {"best": shares},
                   judged(min(shares.values()) >= NEARLY_ALL, max(shares.values()) >= NEARLY_ALL))


def actuation_reversed(evidence: StableMotions) -> Finding:
    """Figs. 10 and 11: omega_f = omega at high frequency."""
    shares, above, motions = {}, {}, []
    for n in (10, 11):
        found = maxima(evidence, n)
        shares[str(n)] = best(found, 1, HIGH, worst=True)
        for k, row in ((0, rows(n)[0]), (2, rows(n)[2])):
            slipping = HIGH & (found[[1, k]].max(axis=0) > 0.1)
            above[f"{row['pressure.frequency_ratio']:.3f}"] = share_where(found[1] > found[k] + 0.05, slipping)
        evidence.stretches(rows(n), AXIS[HIGH])
        for row in [r for r in rows(n) if n == 10 or r["pressure.frequency_ratio"] != 1.0]:
            motions += evidence.motions(f"omega_f = {row['pressure.frequency_ratio']:.3f} omega", row, AXIS[HIGH])
    alone = "" if any(m[end]["jumps"] for m in motions for end in ("low", "high")) else \
        "no stable motion ends in a jump, so no start matters; "
    return Finding("10, 11", "at higher frequency this is reversed: omega_f = omega attenuates worst",
                   f"highest maximum at {NEARLY_ALL:g} of the ratios from 0.31 to 0.45",
                   {"worst": shares, "slips more than at omega_f/omega": above},
                   judged(min(shares.values()) >= NEARLY_ALL, max(above.values()) >= 0.5),
                   "" if min(shares.values()) >= NEARLY_ALL else alone + "it depends on what it is compared with",
                   tuple(motions))


def amplitude_attenuates(evidence: Evidence) -> Finding:
    """Fig. 13: Tsp."""
    found = maxima(evidence, 13)
    moving = found.max(axis=0) > 0.1
    falling = (np.diff(found, axis=0) <= 0.05).all(axis=0)
    rising = (np.diff(found, axis=0) >= -0.05).all(axis=0)
    low, high = share_where(falling, moving & (AXIS <= 0.27)), share_where(rising, moving & HIGH)
    return Finding("13", "larger Tsp attenuates more at low and less at high frequency",
                   f"maxima fall with every Tsp at {NEARLY_ALL:g} of the ratios to 0.27, and rise at as many from "
                   f"0.31 to 0.45",
                   {"falling at low": low, "rising at high": high},
                   judged(low >= NEARLY_ALL and high >= NEARLY_ALL, low >= 0.8 and high >= 0.8))


def _actuated(ratio: float, frequency: float) -> dict[str, float]:
    """Tsp/Tsm = 0.25 at omega_f = ratio omega, mu_k = mu_s."""
    return {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio,
            "engine.frequency": frequency * OMEGA_N}


def period_is_denominator(evidence: Evidence) -> Finding:
    """(35): omega_f = (M/N) omega gives period N."""
    frequency = 150.0 / OMEGA_N
    pairs = [(m, n) for n in range(1, 6) for m in range(1, 6) if math.gcd(m, n) == 1]
    found = {f"{m}/{n}": evidence.motion(_actuated(m / n, frequency))["period"] for m, n in pairs}
    wrong = {pair: p for pair, p in found.items() if p != int(pair.split("/")[1])}
    return Finding("(35)", "omega_f = (M/N) omega, M and N coprime, mu_k = mu_s: the response has period N",
                   "period N for every coprime M/N up to 5/5 at 150 rad/s and Tsp/Tsm = 0.25", {"periods": found},
                   judged(not wrong, len(wrong) < len(found)), f"not so for {wrong}" if wrong else "")


def period_for_any(evidence: Evidence) -> Finding:
    """(35) as printed: for M and N that are not coprime, and for mu_k < mu_s, for which Section 6.2 uses it."""
    frequency = 150.0 / OMEGA_N
    common = {f"{m}/{n}": evidence.motion(_actuated(m / n, frequency))["period"] for m, n in ((2, 4), (2, 2), (4, 6))}
    falling = with_kinetic(0.75, {**_actuated(1.0, frequency)})
    found = evidence.curves([falling], AXIS)[0]
    periods = sorted({int(p) for p in evidence.periods(found)[~sticks(found)]})
    wrong = [pair for pair, p in common.items() if p != int(pair.split("/")[1])]
    return Finding("(35)", "the period is N whether or not M and N have a common factor, and whatever mu_k",
                   "period N for 2/4, 2/2 and 4/6 at 150 rad/s, and period 1 at every slipping ratio for 1/1 and "
                   "0.75 mu_s",
                   {"with a common factor": common, "periods for 1/1, mu_k = 0.75 mu_s": periods},
                   judged(not wrong and periods == [1]),
                   "in lowest terms N is 2, 1 and 3; a falling friction law brings doublings and aperiodic motions "
                   "of its own")


CLAIMS = (phase_attenuates, phase_bifurcations, phase_jumps, stick_below_018, delay, actuation_periods,
          actuation_attenuates, actuation_reversed, actuation_bifurcations, amplitude_attenuates,
          amplitude_bifurcations)
SERIES_CLAIMS = (period_is_denominator, period_for_any)
"""Those about (35), which stand last."""
