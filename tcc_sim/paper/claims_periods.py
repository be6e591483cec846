"""Claims on periods: (35), the orbit diagrams, and motions without a period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.continuation.loss_of_stability import StableSegment
from tcc_sim.paper.catalogue import OMEGA_N, PRESSURE, SECTION_CYCLES, STATIC
from tcc_sim.paper.claims_jumps import HIGHER_JUMPS, jump_places
from tcc_sim.paper.criteria import Claim, Measured, claim, equal, holds, shares
from tcc_sim.paper.evidence import CYCLES, FREQUENCY, KINETIC, Evidence, T, Values, share_where, sticks, with_kinetic
from tcc_sim.paper.rules import (
    AXIS,
    FINER,
    MOST,
    denominator,
    more_than_anywhere,
    off_period,
    only_period,
    rows,
    slipping_periods,
)
from tcc_sim.paper.stable_motions import WAYS, StableMotions
from tcc_sim.trajectory import Floats

ROWS = tuple(Claim(figure, where, sentence, equal(
    "every curve has only the period N of (35) at its slipping ratios from 0.05 to 0.5"),
    partial(only_period, numbers=numbers, why=why), name) for figure, where, sentence, numbers, why, name in (
    ("8", "6.1, Fig. 8(b)", "no bifurcations for mu_k = mu_s and any phase", (8,), "", "phase_bifurcations"),
    ("10, 11", "6.1, after (29)", "no bifurcations for mu_k = mu_s and any omega_f", (10, 11), "",
     "actuation_bifurcations"),
    ("13", "6.1, Fig. 13", "no bifurcations for mu_k = mu_s and any Tsp", (13,), "", "amplitude_bifurcations"),
    ("(35)", "6.1, (35); 6.2", "(35) has no condition on mu_k: it holds for mu_k < mu_s too", (16, 17),
     "a falling friction law brings doublings and aperiodic motions of its own", "period_for_any")))
"""Claims by the rule `only_period`."""
MISMATCHED = {"1/2": 0.5, "2/1": 2.0, "2/3": 2.0 / 3.0, "4/3": 4.0 / 3.0}
"""M/N = omega_f/omega of Figs. 10 to 12, except 1."""
COPRIME = [(m, n) for n in range(1, 6) for m in range(1, 6) if math.gcd(m, n) == 1]
"""Pairs M, N in lowest terms."""


def actuated(ratio: float) -> dict[str, float]:
    """Return a row with Tsp/Tsm = 0.25 at omega_f = ratio omega, mu_k = mu_s, 150 rad/s."""
    return {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio, FREQUENCY: 150.0}


@claim("10, 11, 12", "6.1, after (29)", "omega_f/omega = 1/2, 2, 2/3, 4/3 give period 2, 1, 3, 3", equal(
    "these periods from (13) at 150 rad/s, and no others at the slipping ratios from 0.05 to 0.5 of Figs. 10 and 11"))
def actuation_periods(evidence: Evidence) -> Measured:
    single = {f"{r:.3f}": evidence.motion(actuated(r)).period for r in MISMATCHED.values()}
    along = slipping_periods(evidence, (10, 11))
    return Measured([*((p, denominator(actuated(r))) for p, r in zip(single.values(), MISMATCHED.values())),
                     *((found, [n]) for n, found in along.values())],
                    {"at 150 rad/s": single, "at the slipping ratios": {name: found for name, (_, found)
                                                                        in along.items()}})


@claim("(35)", "6.1", "omega_f = (M/N) omega, mu_k = mu_s: the response has period N, whether M and N are "
       "commensurable (1/2, 2/1: one a multiple of the other) or not (2/3, 4/3)",
       equal("period N from (13) for every M/N in lowest terms up to 5/5, at 150 rad/s and Tsp/Tsm = 0.25"), cheap=True)
def period_is_denominator(evidence: Evidence) -> Measured:
    found = {f"{m}/{n}": evidence.motion(actuated(m / n)).period for m, n in COPRIME}
    return Measured([(found[f"{m}/{n}"], n) for m, n in COPRIME], {"periods": found})


@claim("(35)", "6.1, after (35)", "the response has the frequency that it would have under an excitation by 1 and M/N",
       equal("for every M/N of Figs. 10 to 12 constant load and a second engine torque of frequency M/N omega and "
             "amplitude Tsp give the period of the varying load"), cheap=True)
def as_dual_excitation(evidence: Evidence) -> Measured:
    pairs, values = [], {}
    for name, ratio in MISMATCHED.items():
        varying, n = evidence.motion(actuated(ratio)).period, denominator(actuated(ratio))
        # omega is the N-th harmonic of omega/N, and omega_f the M-th.
        amplitudes = np.zeros(max(round(ratio * n), n))
        amplitudes[n - 1] += 250.0
        amplitudes[round(ratio * n) - 1] += 0.25 * evidence.system({}).saturation_mean
        dual = evidence.motion({FREQUENCY: 150.0 / n, "engine.torque_amplitude": float(amplitudes[0]),
                                "engine.harmonic_amplitudes": tuple(amplitudes[1:].tolist()),
                                "engine.harmonic_phases": (0.0,) * (len(amplitudes) - 1)}).period
        # The torque repeats after at least N cycles of omega, whatever the response repeats after.
        values[f"{name}: varying load, two torques"] = [varying, dual * n]
        pairs.append((dual * n, varying))
    return Measured(pairs, values)


@claim("(35)", "6.1, after (35)", "the cases of the proof of (35), v = N/K and v not commensurable with N, leave only "
       "v = N; v = KN may be disregarded",
       holds("no period that is a multiple KN, K > 1, of N in Figs. 16 and 17 (0.05 to 0.5, 0.75 mu_s)",
             "none in Figs. 10 and 11 (mu_k = mu_s)"))
def proof_is_whole(evidence: Evidence) -> Measured:
    falling, same = ({name: [p for p in periods if p > n and p % n == 0]
                      for name, (n, periods) in slipping_periods(evidence, numbers).items()}
                     for numbers in ((16, 17), (10, 11)))
    return Measured((not any(falling.values()), not any(same.values())),
                    {"multiples of N met at 0.75 mu_s": falling, "at mu_k = mu_s": same},
                    "a minimal period is a multiple of N where the motion doubles; (34) then has its harmonics, and "
                    "the first two cases do not show v = N for it")


@claim("8 to 18", "6.2; 7; Abstract", "the negative slope of the friction law is the major cause of bifurcations and "
       "of quasi-periodic or chaotic motions",
       holds("at the slipping ratios of Figs. 8, 10, 11, 13 (mu_k = mu_s) every period is that of (35), and on every "
             "curve of Figs. 14 to 18 (mu_k < mu_s) at 0.1 or more of them it is another one or there is none",
             "that part is larger on every curve of these than on any of those"))
def slope_is_the_cause(evidence: Evidence) -> Measured:
    parts = {str(number): off_period(evidence, number) for number in (8, 10, 11, 13, 14, 15, 16, 17, 18)}
    same, falling = ([x for n, row in parts.items() for x in row if (rows(int(n))[0][KINETIC] == STATIC) is constant]
                     for constant in (True, False))
    return Measured((max(same) == 0.0 and min(falling) >= 0.1, max(same) < min(falling)),
                    {"part off the period of (35), by figure and curve": parts})


def _long_runs(evidence: Evidence) -> dict[float, Any]:
    """Return the last 64 of 650 cycles from (13) for 0.75 mu_s, by frequency ratio in steps of 0.009."""
    return {float(x): evidence.run(evidence.system(with_kinetic(0.75, {FREQUENCY: float(x) * OMEGA_N})),
                                   650).solved_cycles for x in FINER[::3]}


def repeats(series: Floats) -> int:
    """Return the period of a series that repeats to 1e-5 of its spread or size; 0 for none up to 16."""
    size = 1e-5 * max(float(np.ptp(series)), 1e-3 * float(np.abs(series).max()))
    return next((p for p in range(1, 17) if float(np.abs(series[p:] - series[:-p]).max()) <= size), 0)


@claim("4", "5, after Fig. 4", "a bifurcation in delta_2 shows in delta_1' too", shares(
    "ratios 0.05 to 0.5 in steps of 0.009, for 0.75 mu_s, at which the section in delta_2 and the maxima of delta_1' "
    "per cycle repeat to 1e-5 after one and the same number of cycles, or neither does after up to 16,"))
def shows_in_both(evidence: Evidence) -> Measured:
    periods = {x: [repeats(series[-64:]) for series in (cycles.section[:, 1], cycles.highest)]
               for x, cycles in _long_runs(evidence).items()}
    apart = [[x, *pair] for x, pair in periods.items() if pair[0] != pair[1]]
    share = 1.0 - len(apart) / len(periods)
    return Measured([share], {"part": share, "not at (ratio, periods)": apart})


@claim("4", "5, before Fig. 4", "at the fixed phase point delta_2 varies less than delta_1'", shares(
    "ratios 0.05 to 0.5 in steps of 0.009, for 0.75 mu_s, whose section does not repeat after one cycle, at which the "
    "standard deviation over the mean magnitude of the section is smaller for delta_2 than for delta_1'"))
def section_varies_less(evidence: Evidence) -> Measured:
    sections = [cycles.section[-64:] for cycles in _long_runs(evidence).values()]
    variation = np.array([s.std(axis=0) / np.abs(s).mean(axis=0) for s in sections if repeats(s[:, 1]) != 1])
    share = float((variation[:, 1] < variation[:, 0]).mean()) if len(variation) else 1.0
    return Measured([share], {"ratios": len(variation), "part of them": share, "median variation of delta_1', delta_2":
                              np.median(variation[:, :2], axis=0).tolist() if len(variation) else []},
                    "" if share == 1.0 else "the section mostly lies in stick, where delta_1' is nearly 0 and delta_2 "
                    "varies")


LONG = 20000
"""Number of cycles of an exponent that fewer cycles do not distinguish from 0."""
FALLS = np.round(np.arange(0.56, 0.8301, 0.01), 6)


@claim("4", "5, after Fig. 4", "near 0.20 period two becomes quasi-periodic or chaotic as mu_k falls further",
       holds("0.002 above the jump period 2 at 0.83 mu_s, and at a smaller mu_k no period up to 16 and the whole "
             "confidence interval of the largest Lyapunov exponent above 0, or a motion on a torus",
             "at a smaller mu_k there is no period up to 16"))
def doubling_to_chaos(evidence: Evidence) -> Measured:
    places = [x for x in jump_places(evidence, 0.83) if abs(x - 0.20) <= evidence.limit("near")]
    place = (places[0] if places else 0.20) + 2e-3
    row = {FREQUENCY: place * OMEGA_N}
    found = evidence.periods(evidence.curves([row], FALLS, over=KINETIC)[0])
    none = FALLS[found == 0]
    diagnoses = {f"{r:g}": _diagnosis(evidence, with_kinetic(float(r), row)) for r in none[::-1][:6]}
    wild = any(name in ("chaotic", "quasi-periodic") for name, *_ in diagnoses.values())
    return Measured((int(found[-1]) == 2 and wild, len(none) > 0),
                    {"omega/omega_n": place, "period at 0.83": int(found[-1]),
                     "mu_k/mu_s without a period": none.tolist(),
                     "diagnosis, exponent's interval (1/s)": diagnoses})


def _diagnosis(evidence: Evidence, row: Values) -> list[Any]:
    """Return the diagnosis of a motion and the interval of its exponent, 1/s; of LONG cycles if fewer are undecided."""
    found = evidence.motion(row, lyapunov=True).lyapunov
    if found is not None and found.diagnosis == "unresolved":
        found = evidence.exponent(row, 650, LONG)
    return ["not solved"] if found is None else [found.diagnosis, found.low, found.high]


RATIOS = np.round(np.arange(0.55, 1.0001, 0.005), 6)
AT_036 = {FREQUENCY: 0.36 * OMEGA_N}


def _periods_of_6(evidence: Evidence, way: str) -> np.ndarray:
    """Return (n,) periods of a sweep of Fig. 6 over RATIOS."""
    return evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC, direction=way)[0])


def _highest(evidence: Evidence, period: int, below: float) -> dict[str, float | None]:
    """Return the highest mu_k/mu_s up to `below` with a period in Fig. 6, by direction of the sweep."""
    return {way: max((float(x) for x in RATIOS[(_periods_of_6(evidence, way) == period) & (below >= RATIOS)]),
                     default=None) for way in WAYS}


@claim("6", "5, after (23)", "only period-one motions near mu_k = mu_s",
       holds("period 1 from (13) at every mu_k/mu_s from 0.94 to 1"))
def period_one_near_unity(evidence: Evidence) -> Measured:
    near = _periods_of_6(evidence, "cold")[RATIOS >= 0.94]
    return Measured((bool((near == 1).all()),), {"periods": sorted({int(p) for p in near})})


@claim("6", "5, after (23)", "a sudden bifurcation yields period two as mu_k/mu_s falls to about 0.92", holds(
    f"as mu_k falls, swept downward, period two begins within {T.near:g} of 0.92", f"a stable motion of period two "
    f"ends in a jump within {T.near:g} of 0.92, found from (13) or in a sweep either way"), fitted=True)
def period_two_from(evidence: StableMotions) -> Measured:
    ends = _highest(evidence, 2, 1.0)
    born = [s.high.value for s in evidence.stretches([AT_036], RATIOS, over=KINETIC)[0]
            if s.period == 2 and s.high.jumps]
    limit = evidence.limit("near")
    near = any(abs(x - 0.92) <= limit for x in born)
    falling = ends["down"]
    return Measured((falling is not None and abs(falling - 0.92) <= limit, near),
                    {"stable period two ends in a jump at mu_k/mu_s": born,
                     "highest mu_k/mu_s with period 2 from (13), upward, downward": list(ends.values())},
                    "beside it period one goes on, and a falling mu_k leads to period two only further down; 0.92 is "
                    "the end of a branch followed upward" if near else "",
                    evidence.motions("", AT_036, RATIOS, over=KINETIC))


@claim("6", "5, after (23)", "quasi-periodic or chaotic from about mu_k/mu_s = 0.7 down", holds(
    "as mu_k/mu_s falls from 1 there is a stable motion of period one or two down to a place within 0.05 of 0.7, and "
    "motions without a period up to 16 within 0.05 below it",
    "from (13) or in a sweep the highest ratio below 0.78 without a period is within 0.05 of 0.7"), fitted=True)
def aperiodic_from(evidence: StableMotions) -> Measured:
    highest = _highest(evidence, 0, 0.78).values()
    none = {float(x) for way in WAYS for x in RATIOS[_periods_of_6(evidence, way) == 0]}
    end = covered_down_to(evidence.stretches([AT_036], RATIOS, over=KINETIC)[0], 1.0)
    below = any(end - 0.05 <= x <= end for x in none)
    return Measured((abs(end - 0.7) <= 0.05 and below, any(x is not None and abs(x - 0.7) <= 0.05 for x in highest)),
                    {"period one or two down to": end,
                     "highest mu_k/mu_s without a period from (13), upward, downward": list(highest)},
                    "aperiodic motions begin higher up too, beside the stable one of period two, where that of period "
                    "one ends")


def covered_down_to(stretches: Sequence[StableSegment], start: float) -> float:
    """Return the value down to which stable motions of period one or two exist without a gap, from `start` on."""
    at, gap = start, 1e-6
    while True:
        reach = min((s.low.value for s in stretches if s.period <= 2 and s.low.value < at - gap <= s.high.value),
                    default=at)
        if reach == at:
            return at
        at = reach


@claim("7", "5, Fig. 7", "period one at 0.94, period two at 0.74, aperiodic at 0.64", holds(
    "these periods from (13), and at 0.64 the whole confidence interval of the largest Lyapunov exponent above 0",
    "these periods"), fitted=True)
def three_motions(evidence: Evidence) -> Measured:
    periods = {f"{r:g}": evidence.motion(with_kinetic(r, AT_036)).period for r in (0.94, 0.74, 0.64)}
    found = evidence.exponent(with_kinetic(0.64, AT_036), CYCLES, SECTION_CYCLES)  # As Fig. 7 shows it.
    same = list(periods.values()) == [1, 2, 0]
    return Measured((same and found.diagnosis == "chaotic", same),
                    {"periods": periods, "exponent at 0.64, as in Fig. 7 (1/s)":
                     f"{found.exponent:.1f} +- {0.5 * (found.high - found.low):.1f}", "diagnosis": found.diagnosis})


@claim("14, 15", "6.2, before Fig. 16", "more bifurcations and aperiodic motions at 0.67 mu_s than at 0.75", holds(
    "the part of the slipping ratios without a period up to 16 is larger over the three phases together, and so is "
    "the number of changes of period along them", "the first is so"))
def more_with_steeper_law(evidence: Evidence) -> Measured:
    sweeps = {str(n): [(evidence.periods(s), ~sticks(s)) for s in evidence.curves(rows(n), AXIS)] for n in (14, 15)}
    parts = {n: [share_where(periods == 0, slips) for periods, slips in row] for n, row in sweeps.items()}
    changes = {n: [int((np.diff(periods) != 0).sum()) for periods, _ in row] for n, row in sweeps.items()}
    more = sum(parts["15"]) > sum(parts["14"])
    return Measured((more and sum(changes["15"]) > sum(changes["14"]), more),
                    {"aperiodic part for psi = 0, pi/2, pi": parts, "changes of period": changes})


@claim("16", "6.2, Fig. 16(b)", "omega_f = 0.5 omega: quasi-periodic or chaotic over the entire range", holds(
    f"from 0.05 to 0.5 no period up to 16 at {MOST} the slipping ratios, from (13), swept up or swept down",
    "at 0.5 or more of them"))
def half_frequency_aperiodic(evidence: StableMotions) -> Measured:
    row = rows(16)[0]
    sweeps = [evidence.curves([row], AXIS, direction=way)[0] for way in WAYS]
    slipping = ~sticks(sweeps[0])
    none = [evidence.periods(s) == 0 for s in sweeps]
    parts = [share_where(n, slipping) for n in none]
    return Measured((max(parts) >= evidence.most, max(parts) >= 0.5),
                    {"aperiodic part from (13), upward, downward": parts,
                     "some motion aperiodic": share_where(np.any(none, axis=0), slipping),
                     "a stable periodic motion exists": share_where(evidence.periodic_at(row, AXIS), slipping)},
                    "" if max(parts) >= evidence.most else "elsewhere the motion is periodic from every start tried")


@claim("18", "6.2, Fig. 18(b)", "larger Tsp: periodic motions turn quasi-periodic or chaotic around 0.25 and 0.35",
       equal(f"at Tsp/Tsm = 0.25 or 0.5 the part of the ratios within {T.near:g} of each without a period up to 16, "
             "from (13), is larger than that within as far of the ratios from 0.14 to 0.36 on average"))
def amplitude_aperiodic(evidence: Evidence) -> Measured:
    none: Floats = np.any([evidence.periods(s) == 0 for s in evidence.curves(rows(18)[2:], AXIS)], axis=0)
    return more_than_anywhere(lambda x: float(none[np.abs(AXIS - x) <= evidence.limit("near") + 1e-9].mean()),
                              HIGHER_JUMPS, "part without a period near", {},
                              lambda fewer: "such motions are as frequent at other ratios")
