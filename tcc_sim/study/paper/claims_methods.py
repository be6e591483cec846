"""Claims on methods: solvers of Fig. 2, smoothed law of Fig. 3, equivalent damping, harmonic balance, cycles."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import slope_of_friction
from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.errors import NumericalFailure
from tcc_sim.model import friction
from tcc_sim.solvers import solve
from tcc_sim.solvers.comparison.runge_kutta import rk4_limit
from tcc_sim.solvers.terms import terms_of
from tcc_sim.study.paper import harmonic_balance
from tcc_sim.study.paper.branches_behind import SMOOTHING
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.study.paper.claims_periods import MISMATCHED, PeriodClaims, actuated
from tcc_sim.study.paper.evidence import CYCLES, DISCARD, FREQUENCY, Values, rms_apart, two_digits, with_kinetic
from tcc_sim.study.paper.rules import AXIS, Measured, denominator, grow, rows
from tcc_sim.sweeps.sweep import Sweep

APART = 0.02
"""Root mean square difference, relative to the largest slip speed, of two different curves."""
SLOW = 10.0
"""Ratio of run times above which the time of the discontinuous solution is called enormous."""
HARMONICS = 40
"""Harmonics of omega in the series."""
FIG02: Values = FIGURES[2].series[0].values
SHARPER = np.round(np.geomspace(50.0, 1000.0, 12), 3)
"""Smoothing factors, s/rad, over which the motions of Fig. 2 are followed."""
WATCHED = (50, 150, 250, 390, 450)
"""Cycles of Fig. 2 with maxima that are compared with the next cycle's, to detect a doubled period."""
LAWS: dict[str, dict[str, Any]] = {
    "smoothed, sigma = 50": {}, "smoothed, sigma = 1000": {SMOOTHING: 1000.0},
    "set-valued (6)": {"friction.law": "set_valued"}}
DAMPED = np.round(np.arange(0.08, 0.3001, 0.002), 6)
READ_AT = (0.12, 0.20, 0.25)
"""Frequency ratios of (21), and those at which readings of it are listed."""


@lru_cache(maxsize=4)
def cycle_differences(chosen: tuple[tuple[str, str, float | None], ...]) -> dict[str, float]:
    """Return root mean square differences from the smoothed engine over one cycle of Fig. 2, relative to the maximum.

    chosen : solver with optional words after a comma, friction law, and step, s
    """
    system = paper_system(FIG02)
    start = solve(system, cycles=1000).raise_for_status().final
    reference = solve(system, cycles=1, samples_per_cycle=400, start_cycle=1000, state=start)
    out = {}
    for name, law, step in chosen:
        run = solve(paper_system({**FIG02, "friction.law": law}), cycles=1, samples_per_cycle=400, start_cycle=1000,
                    state=start, solver=name.split(",")[0], step=step)
        out[name] = rms_apart(np.interp(reference.t, run.raise_for_status().t, run.slip_speed), reference.slip_speed)
    return out


def attractors_differ(first: list[tuple[int, float]], *others: list[tuple[int, float]], limit: float) -> bool:
    """Return whether attractors (period, largest slip speed), in order, differ from those of the first law."""
    return any(a[0] != b[0] or abs(b[1] / a[1] - 1.0) > limit for m in others for a, b in zip(first, m))


def _laws_of_fig_3() -> dict[float, tuple[Any, ...]]:
    """Return the smoothing and the exponentials of the law for every mu_s/mu_k of Fig. 3."""
    return {system.friction_ratio: (system.friction.smoothing, terms_of(system).stribeck)
            for system in map(paper_system, rows(3))}


class MethodClaims(PeriodClaims):
    """Measures of the claims on methods."""

    def solvers_agree(self) -> Measured:
        differences = cycle_differences((("rk45", "smoothed", None), ("bdf", "smoothed", None),
                                         ("event_driven", "set_valued", None)))
        paper, doubled = {}, {}
        for name in ("smoothed, sigma = 50", "set-valued (6)"):
            highest = self.run(self.system({**FIG02, **LAWS[name]}), 1000).solved_cycles.largest
            kept = highest[DISCARD:CYCLES]
            paper[name] = [float(kept.min()), float(kept.mean()), float(kept.max())]
            doubled[name] = [float(abs(highest[n] - highest[n + 1])) for n in WATCHED]
        motions = {name: self.attractors({**FIG02, **row}) for name, row in LAWS.items()}
        limit = self.limit("alike")
        alike = len(set(map(len, motions.values()))) == 1 and not attractors_differ(*motions.values(), limit=limit)
        means = [mean for _, mean, _ in paper.values()]
        close = max(differences.values()) < limit and max(means) - min(means) < limit * max(means)
        return Measured(
            (close and alike, close), {"differences": differences, "paper": paper, "doubled": doubled, "attractors": {
                n: [list(a) for a in m] for n, m in motions.items()}},
            "over the paper's cycles they agree; the discontinuous solution doubles its period later, and " +
            ("the laws have the same motions" if alike else "at sigma = 50 s/rad a motion of period one is stable that "
             "is unstable at larger sigma"), self.motions("", FIG02, SHARPER, over=SMOOTHING))

    def smoothing_is_uncertain(self) -> Measured:
        errors = {}
        for name, row in {**{f"sigma = {s:g}": {SMOOTHING: s} for s in (50.0, 100.0, 1000.0)},
                          "law (6)": LAWS["set-valued (6)"]}.items():
            cycles = self.run(self.system({**FIG02, **row}), 2000).solved_cycles[-96:]
            errors[name] = (periodicity(cycles).period, float(cycles.largest.max()))
        *smoothed, exact = ([motion] for motion in errors.values())
        apart = [attractors_differ(exact, m, limit=self.limit("alike")) for m in smoothed]
        return Measured((any(apart) and not apart[-1],), {"found": {name: list(m) for name, m in errors.items()}})

    def discontinuous_is_slow(self) -> Measured:
        exact, smoothed = (min(self.run(self.system({**FIG02, "friction.law": law}), CYCLES).statistics.seconds
                               for _ in range(5)) for law in ("set_valued", "smoothed"))
        slow = exact > SLOW * smoothed
        return Measured((slow,), {"slow": slow}, not slow)

    def classical_differs(self) -> Measured:
        differences = cycle_differences(tuple((f"rk4, step {h:g} s", "smoothed", h) for h in (1e-6, 2e-5, 5e-5, 1e-4)))
        apart = [d > APART for d in differences.values()]
        return Measured((all(apart), any(apart)), {name: float(f"{d:.0e}") for name, d in differences.items()},
                        f"the step is not printed: within the stability limit, "
                        f"{rk4_limit(paper_system(FIG02)) * 1e6:.2g} us, RK4 agrees, beyond it stick rings")

    def maximum_falls(self) -> Measured:
        parts = {f"{1.0 / r:g}": friction.peak(*law)[1] / r
                 for r, law in _laws_of_fig_3().items()}
        del parts["1"]
        changes = list(parts.values())
        return Measured((max(changes) < 1.0 and changes == sorted(changes, reverse=True),), {"parts": parts})

    def slope_turns_negative(self) -> Measured:
        v = np.linspace(1e-4, 1.0, 20001)
        lowest = {f"{1.0 / r:g}": float(friction.smoothed_and_slope(v, *law)[1].min())
                  for r, law in _laws_of_fig_3().items()}
        slopes = list(lowest.values())
        return Measured((slopes[0] >= 0.0 and slopes[1] < 0.0 and slopes == sorted(slopes, reverse=True),),
                        {"lowest": lowest})

    def damping_crosses(self) -> Measured:
        sweep = self.curves([with_kinetic(0.667)], DAMPED, damping=True)[0]
        printed, negative = sweep.column("equivalent_damping"), sweep.column("negative_slope_mean")
        changes, limit = np.flatnonzero(np.diff(self.periods(sweep)) != 0), -paper_system().driveline.damping
        middles = 0.5 * (DAMPED[1:] + DAMPED[:-1])
        at = {name: [round(float(x), 4) for x in middles[np.diff(values < limit)]]
              for name, values in (("printed", printed), ("negative", negative))}
        hit = {name: sum(bool(len(changes)) and float(np.abs(DAMPED[changes] - x).min()) <= 0.005 for x in damping)
               for name, damping in at.items()}
        values = {"cf": [float(np.nanmin(printed)), float(np.nanmax(printed))],
                  "read": [two_digits(np.interp(x, DAMPED, negative)) for x in READ_AT], **at,
                  "hit": hit["negative"], "changes": len(changes), "below": float((negative < limit).mean()),
                  "other": self.other_readings()}
        return Measured((bool(at["printed"]) and hit["printed"] == len(at["printed"]),), values, True)

    def other_readings(self) -> dict[str, list[float]]:
        """Return dT/dv averaged with other weights: none, |v|, and the square of the fluctuation; N m s/rad."""
        out: dict[str, list[float]] = {"no weight": [], "|v|": [], "(v - mean v)^2": [], "v^2 outside stick": []}
        for ratio in READ_AT:
            system = self.system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
            before = solve(system, cycles=100).raise_for_status()
            run = solve(system, cycles=16, samples_per_cycle=8192, start_cycle=100, state=before.final)
            slope, v = slope_of_friction(run), run.slip_speed
            weights = (np.ones_like(v), np.abs(v), (v - v.mean()) ** 2, np.where(run.state != 0, v * v, 0.0))
            for name, weight in zip(out, weights):
                out[name].append(two_digits((slope * weight).sum() / weight.sum()))
        return out

    def damping_falls(self) -> Measured:
        sweeps, printed = self.curves(rows(4), DAMPED, damping=True), "(21) as printed"
        readings = {name: np.array([s.column(column) for s in sweeps]) for name, column in (
            (printed, "equivalent_damping"), ("time mean of the negative slope", "negative_slope_mean"))}
        falls = {name: float((np.diff(damping, axis=0) < 0.0).all(axis=0).mean()) for name, damping in readings.items()}
        medians = {name: [float(np.nanmedian(row)) for row in damping] for name, damping in readings.items()}
        return Measured((falls[printed] >= self.most, grow(medians[printed][::-1])),
                        {"falls": falls, "medians": medians}, True)

    def balance_unsuitable(self) -> Measured:
        off = {name: x if isinstance(x, str) else x["rms difference of the corrected series"]
               for name, x in self.series_balance().values.items()}
        failed = any(isinstance(x, str) or x > self.limit("alike") for x in off.values())
        return Measured((failed,), {"rms difference": off}, not failed)

    def series_balance(self) -> Measured:
        values: dict[str, Any] = {}
        close, short = [], []
        for name, ratio in MISMATCHED.items():
            row = actuated(ratio)
            system, period = self.system(row), denominator(row)
            try:
                balance = harmonic_balance.harmonic_balance(system, period, HARMONICS * period)
            except NumericalFailure as failure:
                values[name] = str(failure)
                close.append(False)
                continue
            run = self.last_cycles(row, period, 400)
            off = rms_apart(balance.slip_speed(run.t), run.slip_speed)
            printed, corrected = (harmonic_balance.mean_friction_torque(system, balance.coefficient, period, printed=p)
                                  for p in (True, False))
            values[name] = {"rms difference of the corrected series": off, "a0 (rad/s)": float(balance.slip[0]),
                            "mean friction torque, corrected": corrected, "as printed (N m)": printed}
            close.append(off < self.limit("alike"))
            short.append(abs(printed - 300.0) > 1.0)
        return Measured((all(close) and not any(short),), values,
                        "as printed the friction torque's mean is at most (2/pi) Tp = 159 N m; with mean terms the "
                        "series agrees" if all(close) else
                        "Newton's method did not end, or the series is another motion")

    def fifty_suffice(self) -> Measured:
        def settled(sweep: Sweep) -> float:
            return float(np.mean([p is not None and p.summary is not None and p.summary.settled for p in sweep.points]))

        settled_by = {str(n): list(map(settled, self.curves(rows(n), AXIS))) for n in (4, 8, 10, 11, *range(13, 19))}
        parts = [x for row in settled_by.values() for x in row]
        return Measured(parts, {"settled part, by figure and curve": settled_by},
                        f"{100.0 * (1.0 - max(parts)):.0f} to "
                        f"{100.0 * (1.0 - min(parts)):.0f} % of the points of a curve have not settled by then")
