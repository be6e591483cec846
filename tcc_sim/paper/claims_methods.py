"""Claims on methods: solvers of Fig. 2, smoothed law of Fig. 3, equivalent damping, harmonic balance, cycles."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import slope_of_friction
from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.errors import NumericalFailure
from tcc_sim.model import friction, harmonic_balance
from tcc_sim.model.parameters import System
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.paper.claims_periods import MISMATCHED, actuated
from tcc_sim.paper.criteria import Measured, claim, holds, shares
from tcc_sim.paper.evidence import CYCLES, DISCARD, FREQUENCY, Evidence, T, Values, two_digits, with_kinetic
from tcc_sim.paper.rules import AXIS, FRICTION_ROWS, denominator, grow, rows
from tcc_sim.paper.stable_motions import SMOOTHING, StableMotions
from tcc_sim.solvers import solve
from tcc_sim.solvers.comparison.runge_kutta import rk4_limit
from tcc_sim.solvers.terms import terms_of
from tcc_sim.sweeps.sweep import Sweep

APART = 0.02
"""Root mean square difference, relative to the largest slip speed, of two different curves."""
FIG02: Values = FIGURES[2].series[0].values
SHARPER = np.round(np.geomspace(50.0, 1000.0, 12), 3)
"""Smoothing factors, s/rad, over which the motions of Fig. 2 are followed."""
WATCHED = (50, 150, 250, 390, 450)
"""Cycles of Fig. 2 with maxima that are compared with the next cycle's, to detect a doubled period."""
LAWS: dict[str, dict[str, Any]] = {
    "smoothed, sigma = 50": {}, "smoothed, sigma = 1000": {SMOOTHING: 1000.0},
    "set-valued (6)": {"friction.law": "set_valued"}}


@lru_cache(maxsize=4)
def cycle_differences(chosen: tuple[tuple[str, str, float | None], ...]) -> dict[str, float]:
    """Return root mean square differences from the smoothed engine over one cycle of Fig. 2, relative to the maximum.

    Parameters
    ----------
    chosen : solver with optional words after a comma, friction law, and step, s
    """
    system = paper_system(FIG02)
    start = solve(system, cycles=1000).raise_for_status().final
    reference = solve(system, cycles=1, samples_per_cycle=400, start_cycle=1000, state=start)
    out = {}
    for name, law, step in chosen:
        row = paper_system({**FIG02, "friction.law": law})
        run = solve(row, cycles=1, samples_per_cycle=400, start_cycle=1000, state=start, solver=name.split(",")[0],
                    step=step)
        found = np.interp(reference.t, run.raise_for_status().t, run.slip_speed) - reference.slip_speed
        out[name] = float(np.sqrt(np.mean(found**2)) / np.abs(reference.slip_speed).max())
    return out


@claim("2", "3, after (7)", "RK45, a stiff (Gear) method and the discontinuous solution agree", holds(
    f"from one state the slip speeds over a cycle differ by less than {T.alike:g} of their maximum (rms), the mean of "
    f"the maxima of cycles {DISCARD} to {CYCLES} from (13) by less than {T.alike:g}, and the attractors of either law "
    f"have the same periods and largest slip speeds within {T.alike:g}", "the first two hold"), alone=True)
def solvers_agree(evidence: StableMotions) -> Measured:
    differences = cycle_differences((("rk45", "smoothed", None), ("bdf", "smoothed", None),
                                     ("event_driven", "set_valued", None)))
    paper, doubled = {}, {}
    for name in ("smoothed, sigma = 50", "set-valued (6)"):
        highest = evidence.run(evidence.system({**FIG02, **LAWS[name]}), 1000).solved_cycles.largest
        kept = highest[DISCARD:CYCLES]
        paper[name] = [float(kept.min()), float(kept.mean()), float(kept.max())]
        doubled[name] = [float(abs(highest[n] - highest[n + 1])) for n in WATCHED]
    motions = {name: evidence.attractors({**FIG02, **row}) for name, row in LAWS.items()}
    limit = evidence.limit("alike")
    alike = len(set(map(len, motions.values()))) == 1 and not attractors_differ(*motions.values(), limit=limit)
    means = [mean for _, mean, _ in paper.values()]
    close = max(differences.values()) < limit and max(means) - min(means) < limit * max(means)
    return Measured(
        (close and alike, close),
        {"over a cycle from law (7)'s state, rms": differences,
         f"largest slip speed of cycles {DISCARD} to {CYCLES} from (13), least, mean, most (rad/s)": paper,
         f"by how much the maxima of cycles {', '.join(map(str, WATCHED))} differ from the next (rad/s)": doubled,
         "attractors: period, largest slip speed (rad/s)": {n: [list(a) for a in m] for n, m in motions.items()}},
        "over the paper's cycles they agree; the discontinuous solution doubles its period later, and " +
        ("the laws have the same motions" if alike else "at sigma = 50 s/rad a motion of period one is stable that is "
         "unstable at larger sigma"), evidence.motions("", FIG02, SHARPER, over=SMOOTHING))


def attractors_differ(first: list[tuple[int, float]], *others: list[tuple[int, float]], limit: float) -> bool:
    """Return whether attractors (period, largest slip speed), in order, differ from those of the first law."""
    return any(a[0] != b[0] or abs(b[1] / a[1] - 1.0) > limit for m in others for a, b in zip(first, m))


@claim("2", "3", "the smoothing factor brings an artificial uncertainty", holds(
    f"the motion of Fig. 2 that (13) leads to, sigma = 50, 100, 1000 s/rad, differs from that of law (6) in period, or "
    f"by more than {T.alike:g} in its largest slip speed, for one of these, and not for the largest"), alone=True)
def smoothing_is_uncertain(evidence: Evidence) -> Measured:
    found = {}
    for name, row in {**{f"sigma = {s:g}": {SMOOTHING: s} for s in (50.0, 100.0, 1000.0)},
                      "law (6)": LAWS["set-valued (6)"]}.items():
        cycles = evidence.run(evidence.system({**FIG02, **row}), 2000).solved_cycles[-96:]
        found[name] = (periodicity(cycles).period, float(cycles.largest.max()))
    *smoothed, exact = ([motion] for motion in found.values())
    apart = [attractors_differ(exact, m, limit=evidence.limit("alike")) for m in smoothed]
    return Measured((any(apart) and not apart[-1],), {"period, largest slip speed (rad/s)":
                                                      {name: list(m) for name, m in found.items()}})


SLOW = 10.0
"""Ratio of run times above which the time of the discontinuous solution is called enormous."""


@claim("2", "3", "the discontinuous method takes enormous time", holds(
    f"150 cycles of Fig. 2 take the discontinuous solution more than {SLOW:g} times the processor time of the smoothed "
    "law's (least of five runs)"), alone=True)
def discontinuous_is_slow(evidence: Evidence) -> Measured:
    exact, smoothed = (min(evidence.run(evidence.system({**FIG02, "friction.law": law}), CYCLES).statistics.seconds
                           for _ in range(5)) for law in ("set_valued", "smoothed"))
    slow = exact > SLOW * smoothed
    return Measured((slow,), {f"more than {SLOW:g} times": slow}, "" if slow else
                    "between two events the motion has a closed form, so a cycle takes a few root searches")


@claim("2", "3, after (7)", "classical fixed-step RK4 differs from them", holds(
    f"over a cycle from one state the slip speed differs by more than {APART:g} of its maximum (rms) for every step "
    "from 1 us to 0.1 ms", "for some of these steps"), alone=True)
def classical_differs(evidence: Evidence) -> Measured:
    differences = cycle_differences(tuple((f"rk4, step {h:g} s", "smoothed", h) for h in (1e-6, 2e-5, 5e-5, 1e-4)))
    apart = [d > APART for d in differences.values()]
    return Measured((all(apart), any(apart)), {name: float(f"{d:.0e}") for name, d in differences.items()},
                    f"the step is not printed: within the stability limit, "
                    f"{rk4_limit(paper_system(FIG02)) * 1e6:.2g} us, RK4 agrees, beyond it stick rings")


def by_ratio_of_fig_3(number: Callable[[float, tuple[float, ...] | None, System], float]) -> dict[str, float]:
    """Return a number of the smoothed law for every mu_k/mu_s of Fig. 3, from its terms and the system."""
    out = {}
    for row in rows(3):
        system = paper_system(row)
        terms = terms_of(system)
        assert terms.smoothing is not None
        out[f"{1.0 / system.friction_ratio:g}"] = number(terms.smoothing, terms.stribeck, system)
    return out


@claim("3", "4, after (11)", "the smoothed maximum of mubar falls below mu_s/mu_k",
       holds("the maximum of (7) over mu_s/mu_k is below 1 for mu_k < mu_s, and the lower the smaller mu_k"),
       cheap=True, alone=True)
def maximum_falls(evidence: Evidence) -> Measured:
    found = by_ratio_of_fig_3(lambda sigma, stribeck, system: friction.peak(sigma, stribeck)[1] / system.friction_ratio)
    del found["1"]
    parts = list(found.values())
    return Measured((max(parts) < 1.0 and parts == sorted(parts, reverse=True),), {"maximum / (mu_s/mu_k)": found})


@claim("3", "5, after (20)", "the slope d(mubar)/dv turns negative, more so for smaller mu_k",
       holds("the least slope (20b) is below 0 for mu_k < mu_s and falls with mu_k"), cheap=True, alone=True)
def slope_turns_negative(evidence: Evidence) -> Measured:
    v = np.linspace(1e-4, 1.0, 20001)
    lowest = by_ratio_of_fig_3(lambda *law: float(friction.smoothed_and_slope(v, *law[:2])[1].min()))
    found = list(lowest.values())
    return Measured((found[0] >= 0.0 and found[1] < 0.0 and found == sorted(found, reverse=True),),
                    {"least slope (s/rad)": lowest})


DAMPED = np.round(np.arange(0.08, 0.3001, 0.002), 6)
READ_AT = (0.12, 0.20, 0.25)
"""Frequency ratios at which readings of (21) are listed."""


@claim("5", "5, after (23)", "where the equivalent damping (21) crosses -C23 = -0.6 a bifurcation is seen",
       holds("(21) crosses -0.6 somewhere in 0.08 to 0.30, and the period changes within 0.005 of every crossing"))
def damping_crosses(evidence: Evidence) -> Measured:
    sweep = evidence.curves([with_kinetic(0.667)], DAMPED, damping=True)[0]
    printed, negative = sweep.column("equivalent_damping"), sweep.column("negative_slope_mean")
    changes = np.flatnonzero(np.diff(evidence.periods(sweep)) != 0)
    at = {name: _crossings(values) for name, values in (("printed", printed), ("negative", negative))}
    hit = {name: sum(bool(len(changes)) and float(np.abs(DAMPED[changes] - x).min()) <= 0.005 for x in found)
           for name, found in at.items()}
    values = {"Cf as printed, least and largest": [float(np.nanmin(printed)), float(np.nanmax(printed))],
              "mean of the negative slope at 0.12, 0.20, 0.25": [two_digits(np.interp(x, DAMPED, negative))
                                                                 for x in READ_AT],
              "crossings as printed": at["printed"], "crossings of the mean negative slope": at["negative"],
              "of these with a change of period within 0.005": hit["negative"], "changes of period": len(changes),
              "part of the range with the mean negative slope below -0.6":
              float((negative < -paper_system().driveline.damping).mean()),
              "other weights at 0.12, 0.20, 0.25": other_readings(evidence)}
    return Measured((bool(at["printed"]) and hit["printed"] == len(at["printed"]),), values,
                    "as printed, weighted with v^2, (21) stays near 0; the time mean of the negative slope is of the "
                    "printed order, but below -0.6 over most of the range")


def _crossings(values: np.ndarray) -> list[float]:
    """Return the places at which the values cross -C23."""
    below = values < -paper_system().driveline.damping
    return [round(float(0.5 * (DAMPED[k] + DAMPED[k + 1])), 4) for k in np.flatnonzero(below[1:] != below[:-1])]


def other_readings(evidence: Evidence) -> dict[str, list[float]]:
    """Return dT/dv averaged with other weights: none, |v|, and the square of the fluctuation; N m s/rad."""
    out: dict[str, list[float]] = {"no weight": [], "|v|": [], "(v - mean v)^2": [], "v^2 outside stick": []}
    for ratio in READ_AT:
        system = evidence.system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
        before = solve(system, cycles=100).raise_for_status()
        run = solve(system, cycles=16, samples_per_cycle=8192, start_cycle=100, state=before.final)
        slope, v = slope_of_friction(run), run.slip_speed
        weights = (np.ones_like(v), np.abs(v), (v - v.mean()) ** 2, np.where(run.state != 0, v * v, 0.0))
        for name, weight in zip(out, weights):
            out[name].append(two_digits((slope * weight).sum() / weight.sum()))
    return out


@claim("5", "5, after (23)", "the equivalent damping falls as mu_k falls", holds(
    f"(21) falls with every fall of mu_k over 1, 0.83, 0.75, 0.667 mu_s at {1.0 - T.missing:g} or more of the ratios "
    "0.08 to 0.30",
    "its median over these ratios does"))
def damping_falls(evidence: Evidence) -> Measured:
    sweeps, name = evidence.curves(FRICTION_ROWS, DAMPED, damping=True), "(21) as printed"
    readings = {name: np.array([s.column("equivalent_damping") for s in sweeps]),
                "time mean of the negative slope": np.array([s.column("negative_slope_mean") for s in sweeps])}
    falls = {name: float((np.diff(found, axis=0) < 0.0).all(axis=0).mean()) for name, found in readings.items()}
    medians = {name: [float(np.nanmedian(row)) for row in found] for name, found in readings.items()}
    return Measured((falls[name] >= evidence.most, grow(medians[name][::-1])),
                    {"part where it falls": falls, "median for mu_k/mu_s = 1, 0.83, 0.75, 0.667": medians},
                    "the negative part of the slope falls with mu_k; (21) weights it with v^2, which is small there")


HARMONICS = 40
"""Harmonics of omega in the series."""


@claim("(30) to (34)", "3", "multi-term harmonic balance is not suitable for parameters that vary in time", holds(
    f"for some omega_f of Figs. 10 to 12 Newton's method fails, or the series of {HARMONICS} harmonics of omega, mean "
    f"terms included, is more than {T.alike:g} off the simulation (rms)"))
def balance_unsuitable(evidence: StableMotions) -> Measured:
    off = {name: x if isinstance(x, str) else x["rms difference of the corrected series"]
           for name, x in series_balance.measure(evidence).values.items()}
    failed = any(isinstance(x, str) or x > evidence.limit("alike") for x in off.values())
    return Measured((failed,), {"rms difference": off}, "" if failed else
                    "the Fourier coefficients of the friction torque follow from its samples in time, whatever varies")


@claim("(30) to (34)", "6.1", "the series of harmonic balance satisfy (1) for omega_f = (M/N) omega", holds(
    f"the mean of (31) as printed is Tm = 300 N m within 1 N m; and with c0 and a0 added the series of {HARMONICS} "
    f"harmonics of omega within {T.alike:g} of the simulation (rms)"))
def series_balance(evidence: Evidence) -> Measured:
    values: dict[str, Any] = {}
    close, short = [], []
    for name, ratio in MISMATCHED.items():
        row = actuated(ratio)
        system, period = evidence.system(row), denominator(row)
        try:
            found = harmonic_balance.harmonic_balance(system, period, HARMONICS * period)
        except NumericalFailure as failure:
            values[name] = str(failure)
            close.append(False)
            continue
        run = evidence.last_cycles(row, period, 400)
        size = float(np.abs(run.slip_speed).max())
        off = float(np.sqrt(np.mean((found.slip_speed(run.t) - run.slip_speed) ** 2))) / size
        printed, corrected = (harmonic_balance.mean_friction_torque(system, found.coefficient, period, printed=p)
                              for p in (True, False))
        values[name] = {"rms difference of the corrected series": off, "a0 (rad/s)": float(found.slip[0]),
                        "mean friction torque, corrected": corrected, "as printed (N m)": printed}
        close.append(off < evidence.limit("alike"))
        short.append(abs(printed - 300.0) > 1.0)
    return Measured((all(close) and not any(short),), values,
                    "as printed the friction torque's mean is at most (2/pi) Tp = 159 N m; with mean terms the "
                    "series agrees" if all(close) else "Newton's method did not end, or the series is another motion")


@claim("4 to 18", "3; captions", "fifty dropped cycles suffice: the rest is the steady state", shares(
    "points of every curve of Figs. 4, 8, 10, 11 and 13 to 18 from (13) whose section has settled after 150 cycles"))
def fifty_suffice(evidence: Evidence) -> Measured:
    def settled(sweep: Sweep) -> float:
        return float(np.mean([p is not None and p.summary is not None and p.summary.settled for p in sweep.points]))

    found = {str(n): [settled(s) for s in evidence.curves(rows(n), AXIS)] for n in (4, 8, 10, 11, *range(13, 19))}
    parts = [x for row in found.values() for x in row]
    return Measured(parts, {"settled part, by figure and curve": found}, f"{100.0 * (1.0 - max(parts)):.0f} to "
                    f"{100.0 * (1.0 - min(parts)):.0f} % of the points of a curve have not settled by then")
