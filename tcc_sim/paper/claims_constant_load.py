"""The claims about Figs. 4 to 7: the falling friction law under constant normal load."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import slope_of_friction
from tcc_sim.continuation.stable_segments import StableSegment
from tcc_sim.model import closed_form
from tcc_sim.paper.catalogue import OMEGA_N, SUPER_HARMONICS, paper_system
from tcc_sim.paper.evidence import (
    KINETIC,
    NOT_CONFIRMED,
    Evidence,
    Finding,
    Floats,
    judged,
    slips_at,
    with_kinetic,
)
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.solvers import solve

FRICTION_RATIOS = (1.0, 0.83, 0.75, 0.667)
NEAR = 0.02
"""How far from a printed frequency ratio or friction ratio something may be and count as there."""


AXIS = np.round(np.arange(0.05, 0.5001, 0.003), 6)


def about(place: float, width: float = NEAR) -> Floats:
    """Frequency ratios about one that the text names, over which branches are followed."""
    return np.round(np.linspace(place - width, place + width, 15), 6)


def smooth_when_equal(evidence: Evidence) -> Finding:
    """Fig. 4: mu_k = mu_s."""
    jumps = evidence.jumps(with_kinetic(1.0), AXIS)
    return Finding("4", "the map is a smooth curve for mu_k = mu_s",
                   "no jump of more than 8 % of the maximum on a 1e-5 wide interval",
                   {"jumps (omega/omega_n, rad/s)": jumps}, judged(not jumps))


def super_harmonic_jumps(evidence: StableMotions) -> Finding:
    """Fig. 4: jumps at the super-harmonic peaks."""
    rows = {f"{r:g}": with_kinetic(r) for r in FRICTION_RATIOS[1:]}
    nearest: dict[str, float | None] = {}
    motions: list[dict[str, Any]] = []
    for mark in SUPER_HARMONICS:
        axis = about(mark)
        evidence.stretches(list(rows.values()), axis)
        ends = [end.value for row in rows.values() for end in evidence.ends(row, axis) if abs(end.value - mark) <= NEAR]
        nearest[f"{mark:.3f}"] = min(((abs(x - mark), x) for x in ends), default=(0.0, None))[1]
        for name, row in rows.items():
            motions += [m for m in evidence.motions(f"mu_k = {name} mu_s", row, axis)
                        if m["low"]["jumps"] or m["high"]["jumps"]]
    near = [x is not None for x in nearest.values()]
    return Finding("4", "super-harmonic peaks with jumps near 0.167, 0.20, 0.25, 0.33 appear as mu_k falls",
                   f"a stable motion ends in a jump within {NEAR:g} of each for mu_k = 0.83, 0.75 or 0.667 mu_s, "
                   "whatever was started from",
                   {"nearest end of a stable motion": nearest,
                    "jumps from (13)": {name: _jumps(evidence, r) for name, r in zip(rows, FRICTION_RATIOS[1:])}},
                   judged(all(near), any(near)), "" if all(near) else "no stable motion of the three ends near "
                   + ", ".join(m for m, hit in zip(nearest, near) if not hit), tuple(motions))


def _jumps(evidence: Evidence, ratio: float) -> list[float]:
    """Where the map of one mu_k/mu_s jumps, omega/omega_n."""
    return [round(x, 4) for x, _ in evidence.jumps(with_kinetic(ratio), AXIS)]


PROMINENT = 0.02
"""How far a maximum of a curve stands above what surrounds it, as a part of the curve's largest value."""


def peaks_move(evidence: Evidence) -> Finding:
    """Fig. 4: which way the super-harmonic peaks go as mu_k falls."""
    curves = evidence.curves([with_kinetic(r) for r in FRICTION_RATIOS[1:]], AXIS)
    found = {"peaks": [prominent_maxima(AXIS, c.column("max_slip_speed")) for c in curves],
             "jumps": [_jumps(evidence, r) for r in FRICTION_RATIOS[1:]]}
    values: dict[str, Any] = {}
    rising = []
    for what, places in found.items():
        for mark in SUPER_HARMONICS:
            near = [min((x for x in row if abs(x - mark) <= NEAR), key=lambda x: abs(x - mark), default=None)
                    for row in places]
            if None not in near:
                values[f"{what} near {mark:.3f} for mu_k/mu_s = 0.83, 0.75, 0.667"] = near
                rising.append(all(b > a for a, b in pairwise(near)))  # type: ignore[operator]
    return Finding("4", "the super-harmonic peaks shift up in frequency as mu_k falls",
                   f"the peak and the jump nearest each named ratio (within {NEAR:g}, where all three mu_k have one) "
                   f"rise with "
                   "every fall of mu_k", values,
                   judged(bool(rising) and all(rising), any(rising)),
                   "" if rising and all(rising) else "they do not: the jumps that end the peaks move down or to and "
                                                     "fro")


def prominent_maxima(axis: Floats, values: Floats, reach: int = 5) -> list[float]:
    """Places of the local maxima that stand out by PROMINENT on either side within `reach` values."""
    least = PROMINENT * float(np.nanmax(values))
    return [float(axis[k]) for k in range(1, len(values) - 1)
            if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
            and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
            and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]


def stick_transition(evidence: Evidence) -> Finding:
    """Fig. 4: from stick-slip to stick."""
    found = list(last_slips(evidence, "smoothed").values())
    return Finding("4", "the transition between stick and stick-slip lies near 0.4 and moves with mu_k",
                   f"highest slipping ratio within {NEAR:g} of 0.4 for mu_k = mu_s, and another for every mu_k",
                   {"last slip from (13)": last_slips(evidence, "smoothed")},
                   judged(abs(found[0] - 0.4) <= NEAR and len(set(found)) == len(found)))


def transition_by_smoothing(evidence: Evidence) -> Finding:
    """Fig. 4: why the transition moves with mu_k."""
    values = {law: last_slips(evidence, law) for law in ("smoothed", "set_valued")}
    smoothed, exact = (list(v.values()) for v in values.values())
    moved = [abs(row[-1] - row[0]) for row in (smoothed, exact)]
    limit = closed_form.constant_load_limits(paper_system())[-1] / OMEGA_N
    return Finding("4", "the transition moves with mu_k because the law is smoothed",
                   "with the set-valued law it moves by less than half as far, from mu_k = mu_s to 0.667 mu_s",
                   {"last slip from (13)": values, "end of pure stick by (10), any mu_k": limit},
                   judged(moved[1] < 0.5 * moved[0]),
                   "" if moved[1] < 0.5 * moved[0] else "the set-valued law moves it as far. Stick ends at one ratio "
                                                        "for every "
                   "mu_k, by (10); above it stick and stick-slip coexist, and (13) leads to stick-slip the farther "
                   "the smaller mu_k")


def last_slips(evidence: Evidence, law: str) -> dict[str, float]:
    """Highest slipping ratio from (13) for every mu_k/mu_s."""
    rows = [{**with_kinetic(r), "friction.law": law} for r in FRICTION_RATIOS]
    upper = np.round(np.concatenate([np.arange(0.38, 0.48, 0.002), np.arange(0.48, 0.7, 0.005)]), 6)
    return {f"{r:g}": float(slips_at(s).max(initial=0.0))
            for r, s in zip(FRICTION_RATIOS, evidence.curves(rows, upper))}


def stick_limits(evidence: Evidence) -> Finding:
    """(10), (25): where pure stick ends, against the simulation."""
    system = paper_system()
    limits = closed_form.stick_limits(system, 0.05 * OMEGA_N, 0.6 * OMEGA_N)
    upper = None if limits.higher is None else limits.higher / OMEGA_N
    if upper is None:
        return Finding("4", "pure stick ends where (10), (25) say", "an upper limit exists", {}, NOT_CONFIRMED)
    found: dict[str, Any] = {"(10), (25)": upper}
    for law in ("set_valued", "smoothed"):
        axis = np.linspace(upper - 0.02, upper + 0.02, 81)
        slipping = slips_at(evidence.curves([{"friction.law": law}], axis, direction="down")[0])
        found[law] = float(slipping.max()) if len(slipping) else None
    exact = found["set_valued"]
    return Finding("4", "pure stick ends where (10), (25) say (corrected: both signs, four-quadrant phase)",
                   "highest slipping ratio of a downward sweep with the set-valued law within 0.001 of the closed form",
                   found,
                   judged(exact is not None and abs(exact - upper) <= 1e-3),
                   "with the smoothed law stick is creep below its peak, so its limit differs a little")


def jump_doubles_period(evidence: Evidence) -> Finding:
    """Fig. 4: mu_k = 0.83 mu_s near 0.20."""
    row = with_kinetic(0.83)
    places = [x for x, _ in evidence.jumps(row, AXIS) if abs(x - 0.20) <= NEAR]
    around = {f"{x:.4f}": [evidence.motion({**row, "engine.frequency": (x + d) * OMEGA_N})["period"]
                           for d in (-2e-3, 2e-3)]
              for x in places}
    return Finding("4", "a jump near 0.20 at mu_k = 0.83 mu_s turns period one into two",
                   f"a jump within {NEAR:g} of 0.20 with period 1 just below it and 2 just above",
                   {"periods around": around},
                   judged([1, 2] in around.values()))


FALLING = np.round(np.arange(0.5, 0.8301, 0.01), 6)


def doubling_to_chaos(evidence: Evidence) -> Finding:
    """Fig. 4: the period-two motions behind the jump near 0.20, as mu_k falls further."""
    places = [x for x in _jumps(evidence, 0.83) if abs(x - 0.20) <= NEAR]
    place = (places[0] if places else 0.20) + 2e-3
    row = {"engine.frequency": place * OMEGA_N}
    found = evidence.periods(evidence.curves([row], FALLING, over=KINETIC)[0])
    none = FALLING[found == 0]
    diagnoses = {f"{r:g}": evidence.motion(with_kinetic(float(r), row), lyapunov=True)["lyapunov"]["diagnosis"]
                 for r in none[::-1][:6]}
    values = {"omega/omega_n": place, "period at 0.83": int(found[-1]), "mu_k/mu_s without a period": none.tolist(),
              "diagnosis": diagnoses}
    chaotic = "chaotic" in diagnoses.values()
    return Finding("4", "near 0.20 the period-two motions become quasi-periodic or chaotic as mu_k falls further",
                   "0.002 above the jump period 2 at 0.83 mu_s, and at a smaller mu_k no period and a Lyapunov "
                   "exponent whose "
                   "confidence interval is above 0, or a narrow one around 0", values,
                   judged(int(found[-1]) == 2 and (chaotic or "quasi-periodic" in diagnoses.values()), len(none) > 0))


def damping_crosses(evidence: Evidence) -> Finding:
    """Fig. 5: (21) against -C23."""
    axis = np.round(np.arange(0.08, 0.3001, 0.002), 6)
    sweep = evidence.curves([with_kinetic(0.667)], axis, damping=True)[0]
    printed, negative = sweep.column("equivalent_damping"), sweep.column("negative_slope_mean")
    changes = np.flatnonzero(np.diff(evidence.periods(sweep)) != 0)
    at = {name: _crossings(values, axis) for name, values in (("printed", printed), ("negative", negative))}
    hit = {name: sum(bool(len(changes)) and float(np.abs(axis[changes] - x).min()) <= 0.005 for x in found)
           for name, found in at.items()}
    values = {"Cf as printed, least and largest": [float(np.nanmin(printed)), float(np.nanmax(printed))],
              "mean of the negative slope at 0.12, 0.20, 0.25": [float(np.interp(x, axis, negative))
                                                                 for x in (0.12, 0.20, 0.25)],
              "crossings as printed": at["printed"], "crossings of the mean negative slope": at["negative"],
              "of these with a change of period within 0.005": hit["negative"], "changes of period": len(changes),
              "part of the range with the mean negative slope below -0.6":
              float((negative < -paper_system().driveline.damping).mean()),
              "other weights at 0.12, 0.20, 0.25": _other_readings()}
    return Finding("5", "where the equivalent damping (21) crosses -C23 = -0.6 a bifurcation is seen",
                   "(21) crosses -0.6 somewhere in 0.08 to 0.30, and the period changes within 0.005 of every crossing",
                   values,
                   judged(bool(at["printed"]) and hit["printed"] == len(at["printed"])),
                   "as printed, weighted with v^2, (21) stays near 0; the time mean of the negative slope is of the "
                   "printed "
                   "order, but below -0.6 over most of the range")


def _crossings(values: np.ndarray, axis: np.ndarray) -> list[float]:
    """Where the values pass -C23."""
    below = values < -paper_system().driveline.damping
    return [round(float(0.5 * (axis[k] + axis[k + 1])), 4) for k in np.flatnonzero(below[1:] != below[:-1])]


def _other_readings() -> dict[str, list[float]]:
    """dT/dv averaged with other weights: none, |v|, and the square of the fluctuation; N m s/rad."""
    out: dict[str, list[float]] = {"no weight": [], "|v|": [], "(v - mean v)^2": [], "v^2 outside stick": []}
    for ratio in (0.12, 0.20, 0.25):
        system = paper_system(with_kinetic(0.667, {"engine.frequency": ratio * OMEGA_N}))
        before = solve(system, cycles=100).raise_for_status()
        run = solve(system, cycles=16, samples_per_cycle=8192, start_cycle=100, state=before.final)
        slope, v = slope_of_friction(run), run.slip_speed
        slipping = run.state != 0
        for name, weight in (("no weight", np.ones_like(v)), ("|v|", np.abs(v)),
                             ("(v - mean v)^2", (v - v.mean()) ** 2),
                             ("v^2 outside stick", np.where(slipping, v * v, 0.0))):
            out[name].append(float((slope * weight).sum() / weight.sum()))
    return out


RATIOS = np.round(np.arange(0.55, 1.0001, 0.005), 6)
AT_036 = {"engine.frequency": 0.36 * OMEGA_N}


def period_one_near_unity(evidence: Evidence) -> Finding:
    """Fig. 6: mu_k near mu_s."""
    found = evidence.curves([AT_036], RATIOS, over=KINETIC)[0]
    near = evidence.periods(found)[RATIOS >= 0.94]
    return Finding("6", "only period-one motions near mu_k = mu_s", "period 1 at every mu_k/mu_s from 0.94 to 1",
                   {"periods": sorted({int(p) for p in near})}, judged(bool((near == 1).all())))


def period_two_from(evidence: StableMotions) -> Finding:
    """Fig. 6: period two from about 0.92."""
    ends: dict[str, float | None] = {}
    for direction in ("cold", "up", "down"):
        two = RATIOS[evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC, direction=direction)[0]) == 2]
        ends[direction] = float(two.max()) if len(two) else None
    born = [s for s in evidence.stretches([AT_036], RATIOS, over=KINETIC)[0]
            if s.period == 2 and s.high.jumps and abs(s.high.value - 0.92) <= NEAR]
    return Finding("6", "a sudden bifurcation yields period two as mu_k/mu_s falls to about 0.92",
                   f"a stable motion of period two begins in a jump within {NEAR:g} of 0.92, whatever was started from",
                   {"highest mu_k/mu_s with period 2 by sweeps": ends}, judged(bool(born)),
                   "beside it period one goes on, and (13) leads to period two only further down" if born else "",
                   tuple(evidence.motions("", AT_036, RATIOS, over=KINETIC)))


def aperiodic_from(evidence: StableMotions) -> Finding:
    """Fig. 6: aperiodic from about 0.7."""
    highest: dict[str, float | None] = {}
    none: set[float] = set()
    for direction in ("cold", "up", "down"):
        found = evidence.periods(evidence.curves([AT_036], RATIOS, over=KINETIC, direction=direction)[0])
        at = RATIOS[(found == 0) & (RATIOS < 0.78)]
        none |= {float(x) for x in at}
        highest[direction] = float(at.max()) if len(at) else None
    end = covered_down_to(evidence.stretches([AT_036], RATIOS, over=KINETIC)[0], 1.0)
    below = any(end - 0.05 <= x <= end for x in none)
    near = [x is not None and abs(x - 0.7) <= 0.05 for x in highest.values()]
    return Finding("6", "quasi-periodic or chaotic from about mu_k/mu_s = 0.7 down",
                   "as mu_k/mu_s falls from 1 there is a stable motion of period one or two down to a place within "
                   "0.05 of 0.7, and aperiodic ones within 0.05 below it",
                   {"period one or two down to": end, "highest mu_k/mu_s without a period by sweeps": highest},
                   judged(abs(end - 0.7) <= 0.05 and below, any(near)),
                   "aperiodic motions begin higher up too, beside the stable one of period two, where that of period "
                   "one ends", tuple(evidence.motions("", AT_036, RATIOS, over=KINETIC)))


def covered_down_to(stretches: Sequence[StableSegment], start: float) -> float:
    """The value down to which stable motions of period one or two exist without a gap, from `start` on."""
    at, gap = start, 1e-6
    while True:
        reach = min((s.low.value for s in stretches if s.period <= 2 and s.low.value < at - gap <= s.high.value),
                    default=at)
        if reach == at:
            return at
        at = reach


def three_motions(evidence: Evidence) -> Finding:
    """Fig. 7."""
    values: dict[str, Any] = {}
    for ratio in (0.94, 0.74, 0.64):
        found = evidence.motion(with_kinetic(ratio, AT_036), lyapunov=True)
        values[f"{ratio:g}"] = {"period": found["period"],
                                "lyapunov (1/s)": [found["lyapunov"][k] for k in ("low", "exponent", "high")],
                                "diagnosis": found["lyapunov"]["diagnosis"]}
    seen = [v["period"] for v in values.values()]
    return Finding("7", "period one at 0.94, period two at 0.74, aperiodic at 0.64",
                   "these periods, and at 0.64 the whole confidence interval of the largest Lyapunov exponent above 0",
                   values,
                   judged(seen == [1, 2, 0] and values["0.64"]["diagnosis"] == "chaotic", seen == [1, 2, 0]))


CLAIMS = (smooth_when_equal, super_harmonic_jumps, peaks_move, stick_transition, transition_by_smoothing, stick_limits,
          jump_doubles_period, doubling_to_chaos, damping_crosses, period_one_near_unity, period_two_from,
          aperiodic_from, three_motions)
