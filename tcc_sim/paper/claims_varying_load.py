"""The claims about Figs. 8 to 18 and (35): harmonically varying normal load."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, paper_system, plain
from tcc_sim.paper.claims_constant_load import NEAR
from tcc_sim.paper.evidence import (
    Evidence,
    Finding,
    Floats,
    Values,
    judged,
    periods,
    share_where,
    slips_at,
    steep,
    sticks,
)
from tcc_sim.paper.figures import first_half
from tcc_sim.solvers import solve

AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
LOW, HIGH = AXIS <= 0.29, (AXIS >= 0.31) & (AXIS <= 0.45)
NEARLY_ALL = 0.95
"""The part of the frequencies at which an order must hold."""


def _rows(number: int) -> list[Values]:
    """The scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


def _maxima(evidence: Evidence, number: int) -> Floats:
    """(curves, frequencies) largest slip speeds."""
    return np.array([s.column("max_slip_speed") for s in evidence.curves(_rows(number), AXIS)])


def _best(maxima: Floats, curve: int, where: np.ndarray, *, worst: bool = False) -> float:
    """The part of the frequencies at which one curve is the lowest of all (the highest), where any slips."""
    others = np.delete(maxima, curve, axis=0)
    ordered = maxima[curve] >= others.max(axis=0) - 0.05 if worst else maxima[curve] <= others.min(axis=0) + 0.05
    return share_where(ordered, where & (maxima.max(axis=0) > 0.1))


def _every_period(evidence: Evidence, number: int) -> dict[str, list[int]]:
    """The periods met along every curve."""
    return {plain(s.label): sorted({int(p) for p in periods(sweep)})
            for s, sweep in zip(FIGURES[number].series, evidence.curves(_rows(number), AXIS))}


def phase_attenuates(evidence: Evidence) -> Finding:
    """Fig. 8: psi = 0."""
    maxima = _maxima(evidence, 8)
    below, above = _best(maxima, 0, LOW), _best(maxima, 0, HIGH, worst=True)
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


def amplitude_bifurcations(evidence: Evidence) -> Finding:
    """Fig. 13: no bifurcations."""
    return _without_bifurcations(evidence, 13, "no bifurcations for mu_k = mu_s and any Tsp")


def _first_slip(evidence: Evidence, number: int, curve: int, law: str) -> float | None:
    """Lowest ratio at which the clutch slips, to 0.001, with either law."""
    axis = np.round(np.arange(0.05, 0.2501, 0.001), 6)
    found = slips_at(evidence.curves([{**_rows(number)[curve], "friction.law": law}], axis)[0])
    return float(found.min()) if len(found) else None


def _pure_stick_below(evidence: Evidence, number: int, place: float) -> Finding:
    """Pure stick for psi = 0 at low frequency."""
    ends = {law: _first_slip(evidence, number, 0, law) for law in ("smoothed", "set_valued")}
    near = [x is not None and abs(x - place) <= NEAR for x in ends.values()]
    return Finding(str(number), f"psi = 0: pure stick below {place:g}",
                   f"lowest slipping ratio within {NEAR:g} of {place:g}",
                   ends, judged(all(near), any(near)),
                   "" if all(near)
                   else "where stick and stick-slip coexist, single frequencies keep slipping from (13)")


def stick_below_018(evidence: Evidence) -> Finding:
    """Fig. 8: pure stick."""
    return _pure_stick_below(evidence, 8, 0.18)


def stick_below_015(evidence: Evidence) -> Finding:
    """Fig. 14: pure stick."""
    return _pure_stick_below(evidence, 14, 0.15)


def delay(evidence: Evidence) -> Finding:
    """Fig. 9: when the slip takes place."""
    shares = {}
    for series in FIGURES[9].series:
        system = paper_system(series.values)
        before = solve(system, cycles=150, rtol=evidence.rtol).raise_for_status()
        run = solve(system, cycles=2, samples_per_cycle=2000, start_cycle=150, state=before.final, rtol=evidence.rtol)
        shares[f"{system.engine.frequency / OMEGA_N:.2f}"] = first_half(run)
    first, second = [shares["0.15"], shares["0.18"]], [shares["0.37"], shares["0.40"]]
    return Finding("9",
                   "positive slip falls into the first half cycle at 0.15 and 0.18, into the second at 0.37 and 0.40",
                   "more than 0.8 of the way slipped in the first half cycle, less than 0.2",
                   {"part in the first half": shares},
                   judged(min(first) > 0.8 and max(second) < 0.2))


def actuation_periods(evidence: Evidence) -> Finding:
    """Figs. 10 to 12: periods."""
    expected = {0.5: 2, 2.0: 1, 2.0 / 3.0: 3, 4.0 / 3.0: 3}
    single = {f"{r:.3f}": evidence.motion(_actuated(r, 150.0 / OMEGA_N))["period"] for r in expected}
    along: dict[str, float] = {}
    for number in (10, 11):
        rows = _rows(number)
        for row, sweep in zip(rows, evidence.curves(rows, AXIS)):
            ratio = float(row["pressure.frequency_ratio"])  # type: ignore[arg-type]
            if ratio != 1.0:
                moving = ~sticks(sweep)
                along[f"{ratio:.3f}"] = share_where(periods(sweep) == expected[ratio], moving)
    exact = [single[f"{r:.3f}"] == p for r, p in expected.items()]
    return Finding("10, 11, 12", "omega_f/omega = 1/2, 2, 2/3, 4/3 give period 2, 1, 3, 3",
                   f"these periods at 150 rad/s, and at {NEARLY_ALL:g} of the slipping ratios of Figs. 10 and 11",
                   {"at 150 rad/s": single, "part of the slipping ratios": along},
                   judged(all(exact) and min(along.values()) >= NEARLY_ALL, all(exact)))


def actuation_attenuates(evidence: Evidence) -> Finding:
    """Figs. 10 and 11: omega_f = omega."""
    low = AXIS <= 0.25
    shares = {str(n): _best(_maxima(evidence, n), 1, low) for n in (10, 11)}
    return Finding("10, 11", "omega_f = omega attenuates best at low frequency",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25", {"best": shares},
                   judged(min(shares.values()) >= NEARLY_ALL, max(shares.values()) >= NEARLY_ALL))


def amplitude_attenuates(evidence: Evidence) -> Finding:
    """Fig. 13: Tsp."""
    maxima = _maxima(evidence, 13)
    moving = maxima.max(axis=0) > 0.1
    falling = (np.diff(maxima, axis=0) <= 0.05).all(axis=0)
    rising = (np.diff(maxima, axis=0) >= -0.05).all(axis=0)
    low, high = share_where(falling, moving & (AXIS <= 0.27)), share_where(rising, moving & HIGH)
    return Finding("13", "larger Tsp attenuates more at low and less at high frequency",
                   f"maxima fall with every Tsp at {NEARLY_ALL:g} of the ratios to 0.27, and rise at as many from 0.31 to 0.45",
                   {"falling at low": low, "rising at high": high},
                   judged(low >= NEARLY_ALL and high >= NEARLY_ALL, low >= 0.8 and high >= 0.8))


def phase_with_falling_law(evidence: Evidence) -> Finding:
    """Figs. 14 and 15: psi = 0 at low frequency."""
    low = AXIS <= 0.25
    shares = {str(n): _best(_maxima(evidence, n), 0, low) for n in (14, 15)}
    return Finding("14, 15", "mu_k = 0.75 and 0.67 mu_s: psi = 0 attenuates best at low frequency",
                   f"lowest maximum at {NEARLY_ALL:g} of the ratios to 0.25", {"best": shares},
                   judged(min(shares.values()) >= NEARLY_ALL, min(shares.values()) >= 0.75),
                   "" if min(shares.values()) >= NEARLY_ALL else "super-harmonic peaks of the curves cross in places")


def jump_to_chaos(evidence: Evidence) -> Finding:
    """Fig. 14: the jump near 0.35."""
    row = _rows(14)[0]
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
        verdicts.append((below["period"] > 0, any(a["lyapunov"]["diagnosis"] == "chaotic" for a in above),
                         any(a["period"] == 0 for a in above)))
    return Finding("14", "psi = 0: at a jump near 0.35 the periodic motion becomes chaotic",
                   f"a jump within {NEAR:g} of 0.35, periodic 0.005 below it, and within 0.02 above it a Lyapunov exponent whose "
                   "confidence interval is above 0", values,
                   judged(bool(jumps) and any(a and b for a, b, _ in verdicts), any(a and c for a, _, c in verdicts)),
                   "" if jumps else "the steep rise, a jump to the eye, is continuous: a cascade of period doublings")


def more_with_steeper_law(evidence: Evidence) -> Finding:
    """Fig. 15 against Fig. 14."""
    shares = {str(n): [share_where(periods(s) == 0, ~sticks(s)) for s in evidence.curves(_rows(n), AXIS)]
              for n in (14, 15)}
    return Finding("14, 15", "more bifurcations and aperiodic motions at mu_k = 0.67 mu_s than at 0.75",
                   "larger part of the slipping ratios without a period up to 16 over the three phases together",
                   {"aperiodic part for psi = 0, pi/2, pi": shares}, judged(sum(shares["15"]) > sum(shares["14"])))


def phase_pi_is_smooth(evidence: Evidence) -> Finding:
    """Fig. 14: psi = pi."""
    found = periods(evidence.curves([_rows(14)[2]], AXIS)[0])
    share = float((found == 1).mean())
    return Finding("14", "psi = pi: peaks are smooth and there are no bifurcations", "period 1 at every frequency",
                   {"part with period 1": share, "periods": sorted({int(p) for p in found})},
                   judged(share == 1.0, share > 0.5),
                   "" if share == 1.0 else "period two and others appear at the super-harmonic peaks")


def half_frequency_aperiodic(evidence: Evidence) -> Finding:
    """Figs. 16 and 17."""
    sweep = evidence.curves([_rows(16)[0]], AXIS)[0]
    share = share_where(periods(sweep) == 0, ~sticks(sweep))
    return Finding("16, 17", "omega_f = 0.5 omega: aperiodic over much of the range",
                   "no period up to 16 at more than half of the slipping ratios from 0.05 to 0.5",
                   {"aperiodic part": share},
                   judged(share > 0.5, share > 0.25))


def amplitude_makes_stick(evidence: Evidence) -> Finding:
    """Fig. 18: low frequency."""
    sweeps = evidence.curves(_rows(18), AXIS)
    low = AXIS <= 0.12
    stuck = [share_where(sticks(s), low) for s in sweeps]
    wild = [share_where(periods(s) != 1, low) for s in sweeps]
    return Finding("18", "larger Tsp: aperiodic motions at low frequency become pure stick",
                   "to 0.12 the part in pure stick never falls with Tsp and ends at 1, from motions other than period 1",
                   {"pure stick for Tsp/Tsm = 0, 0.125, 0.25, 0.5": stuck, "not period 1": wild},
                   judged(stuck == sorted(stuck) and stuck[-1] == 1.0 and wild[0] > 0.0, stuck[-1] > stuck[0]))


def amplitude_jumps(evidence: Evidence) -> Finding:
    """Fig. 18: jumps at higher frequency."""
    places = {f"{x:g}": [round(p, 4) for p, _ in evidence.jumps(row, AXIS)] for x,
              row in zip((0.25, 0.5), _rows(18)[2:])}
    near = [any(abs(p - m) <= NEAR for found in places.values() for p in found) for m in (0.25, 0.35)]
    return Finding("18", "larger Tsp: jumps near 0.25 and 0.35",
                   f"a jump within {NEAR:g} of each at Tsp/Tsm = 0.25 or 0.5",
                   {"jumps": places}, judged(all(near), any(near)))


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


CLAIMS = (phase_attenuates, phase_bifurcations, stick_below_018, delay, actuation_periods, actuation_attenuates,
          amplitude_attenuates, amplitude_bifurcations, phase_with_falling_law, stick_below_015, jump_to_chaos,
          phase_pi_is_smooth, more_with_steeper_law, half_frequency_aperiodic, amplitude_makes_stick, amplitude_jumps,
          period_is_denominator)
