"""The claims about Figs. 5 to 7: equivalent damping, and the orbit diagram over mu_k/mu_s, constant normal load."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tcc_sim.analysis.damping import slope_of_friction
from tcc_sim.continuation.loss_of_stability import StableSegment
from tcc_sim.paper.catalogue import OMEGA_N, SECTION_CYCLES, paper_system
from tcc_sim.paper.claims_figure4 import FRICTION_RATIOS, WAYS
from tcc_sim.paper.criteria import Holds, Measured, claim
from tcc_sim.paper.evidence import CYCLES, FREQUENCY, KINETIC, Evidence, T, two_digits, with_kinetic
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.solvers import solve

DAMPED = np.round(np.arange(0.08, 0.3001, 0.002), 6)


@claim("5", "5, after (23)", "where the equivalent damping (21) crosses -C23 = -0.6 a bifurcation is seen",
       Holds("(21) crosses -0.6 somewhere in 0.08 to 0.30, and the period changes within 0.005 of every crossing"))
def damping_crosses(evidence: Evidence) -> Measured:
    sweep = evidence.curves([with_kinetic(0.667)], DAMPED, damping=True)[0]
    printed, negative = sweep.column("equivalent_damping"), sweep.column("negative_slope_mean")
    changes = np.flatnonzero(np.diff(evidence.periods(sweep)) != 0)
    at = {name: _crossings(values) for name, values in (("printed", printed), ("negative", negative))}
    hit = {name: sum(bool(len(changes)) and float(np.abs(DAMPED[changes] - x).min()) <= 0.005 for x in found)
           for name, found in at.items()}
    values = {"Cf as printed, least and largest": [float(np.nanmin(printed)), float(np.nanmax(printed))],
              "mean of the negative slope at 0.12, 0.20, 0.25": [two_digits(np.interp(x, DAMPED, negative))
                                                                 for x in (0.12, 0.20, 0.25)],
              "crossings as printed": at["printed"], "crossings of the mean negative slope": at["negative"],
              "of these with a change of period within 0.005": hit["negative"], "changes of period": len(changes),
              "part of the range with the mean negative slope below -0.6":
              float((negative < -paper_system().driveline.damping).mean()),
              "other weights at 0.12, 0.20, 0.25": other_readings(evidence)}
    return Measured((bool(at["printed"]) and hit["printed"] == len(at["printed"]),), values,
                    "as printed, weighted with v^2, (21) stays near 0; the time mean of the negative slope is of the "
                    "printed order, but below -0.6 over most of the range")


@claim("5", "5, after (23)", "the equivalent damping falls as mu_k falls", Holds(
    f"(21) falls with every fall of mu_k over 1, 0.83, 0.75, 0.667 mu_s at {1.0 - T.missing:g} or more of the ratios "
    "0.08 to 0.30",
    "its median over these ratios does"))
def damping_falls(evidence: Evidence) -> Measured:
    sweeps = evidence.curves([with_kinetic(r) for r in FRICTION_RATIOS], DAMPED, damping=True)
    readings = {"(21) as printed": np.array([s.column("equivalent_damping") for s in sweeps]),
                "time mean of the negative slope": np.array([s.column("negative_slope_mean") for s in sweeps])}
    falls = {name: float((np.diff(found, axis=0) < 0.0).all(axis=0).mean()) for name, found in readings.items()}
    medians = {name: [float(np.nanmedian(row)) for row in found] for name, found in readings.items()}
    name = "(21) as printed"
    return Measured((falls[name] >= evidence.most, all(b < a for a, b in pairwise(medians[name]))),
                    {"part where it falls": falls, "median for mu_k/mu_s = 1, 0.83, 0.75, 0.667": medians},
                    "what falls with mu_k is the negative part of the slope; (21) weights it with v^2, which is small "
                    "there")


def _crossings(values: np.ndarray) -> list[float]:
    """Where the values pass -C23."""
    below = values < -paper_system().driveline.damping
    return [round(float(0.5 * (DAMPED[k] + DAMPED[k + 1])), 4) for k in np.flatnonzero(below[1:] != below[:-1])]


def other_readings(evidence: Evidence) -> dict[str, list[float]]:
    """dT/dv averaged with other weights: none, |v|, and the square of the fluctuation; N m s/rad."""
    out: dict[str, list[float]] = {"no weight": [], "|v|": [], "(v - mean v)^2": [], "v^2 outside stick": []}
    for ratio in (0.12, 0.20, 0.25):
        system = evidence.system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
        before = solve(system, cycles=100).raise_for_status()
        run = solve(system, cycles=16, samples_per_cycle=8192, start_cycle=100, state=before.final)
        slope, v = slope_of_friction(run), run.slip_speed
        weights = (np.ones_like(v), np.abs(v), (v - v.mean()) ** 2, np.where(run.state != 0, v * v, 0.0))
        for name, weight in zip(out, weights):
            out[name].append(two_digits((slope * weight).sum() / weight.sum()))
    return out


RATIOS = np.round(np.arange(0.55, 1.0001, 0.005), 6)
AT_036 = {FREQUENCY: 0.36 * OMEGA_N}


@claim("6", "5, after (23)", "only period-one motions near mu_k = mu_s",
       Holds("period 1 from (13) at every mu_k/mu_s from 0.94 to 1"))
def period_one_near_unity(evidence: Evidence) -> Measured:
    near = evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC)[0])[RATIOS >= 0.94]
    return Measured((bool((near == 1).all()),), {"periods": sorted({int(p) for p in near})})


@claim("6", "5, after (23)", "a sudden bifurcation yields period two as mu_k/mu_s falls to about 0.92", Holds(
    f"as mu_k falls, swept downward, period two begins within {T.near:g} of 0.92", f"a stable motion of period two "
    f"ends in a jump within {T.near:g} of 0.92, found from (13) or in a sweep either way"), fitted=True)
def period_two_from(evidence: StableMotions) -> Measured:
    ends = {way: _highest(evidence, way, 2, 1.0) for way in WAYS}
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
                    tuple(evidence.motions("", AT_036, RATIOS, over=KINETIC)))


def _highest(evidence: Evidence, way: str, period: int, below: float) -> float | None:
    """The highest mu_k/mu_s up to `below` at which a sweep of Fig. 6 has a period."""
    found = evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC, direction=way)[0])
    return max((float(x) for x in RATIOS[(found == period) & (below >= RATIOS)]), default=None)


@claim("6", "5, after (23)", "quasi-periodic or chaotic from about mu_k/mu_s = 0.7 down", Holds(
    "as mu_k/mu_s falls from 1 there is a stable motion of period one or two down to a place within 0.05 of 0.7, and "
    "motions without a period up to 16 within 0.05 below it",
    "from (13) or in a sweep the highest ratio below 0.78 without a period is within 0.05 of 0.7"), fitted=True)
def aperiodic_from(evidence: StableMotions) -> Measured:
    highest = {way: _highest(evidence, way, 0, 0.78) for way in WAYS}
    none = {float(x) for way in WAYS
            for x in RATIOS[evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC, direction=way)[0]) == 0]}
    end = covered_down_to(evidence.stretches([AT_036], RATIOS, over=KINETIC)[0], 1.0)
    below = any(end - 0.05 <= x <= end for x in none)
    return Measured((abs(end - 0.7) <= 0.05 and below, any(x is not None and abs(x - 0.7) <= 0.05
                                                           for x in highest.values())),
                    {"period one or two down to": end,
                     "highest mu_k/mu_s without a period from (13), upward, downward": list(highest.values())},
                    "aperiodic motions begin higher up too, beside the stable one of period two, where that of period "
                    "one ends")


def covered_down_to(stretches: Sequence[StableSegment], start: float) -> float:
    """The value down to which stable motions of period one or two exist without a gap, from `start` on."""
    at, gap = start, 1e-6
    while True:
        reach = min((s.low.value for s in stretches if s.period <= 2 and s.low.value < at - gap <= s.high.value),
                    default=at)
        if reach == at:
            return at
        at = reach


@claim("7", "5, Fig. 7", "period one at 0.94, period two at 0.74, aperiodic at 0.64", Holds(
    "these periods from (13), and at 0.64 the whole confidence interval of the largest Lyapunov exponent above 0",
    "these periods"), fitted=True)
def three_motions(evidence: Evidence) -> Measured:
    periods = {f"{r:g}": evidence.motion(with_kinetic(r, AT_036)).period for r in (0.94, 0.74, 0.64)}
    found = evidence.exponent(with_kinetic(0.64, AT_036), CYCLES, SECTION_CYCLES)  # As Fig. 7 shows it.
    same = list(periods.values()) == [1, 2, 0]
    return Measured((same and found.diagnosis == "chaotic", same),
                    {"periods": periods, "exponent at 0.64, as in Fig. 7 (1/s)":
                     f"{found.exponent:.1f} +- {0.5 * (found.high - found.low):.1f}", "diagnosis": found.diagnosis})
