"""The claims about the model itself: Figs. 2 and 3, pure slip (14) to (18), and the series (30) to (34)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model import closed_form, friction
from tcc_sim.model.harmonic_balance import harmonic_balance, mean_friction_torque
from tcc_sim.model.parameters import System
from tcc_sim.paper.catalogue import FIGURES, PRESSURE, STATIC, paper_system
from tcc_sim.paper.evidence import DEPENDS, KINETIC, Evidence, Finding, Values, judged
from tcc_sim.paper.stable_motions import SMOOTHING, StableMotions
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of

ALIKE = 0.05
"""Root mean square difference, relative to the largest slip speed, that shows on a printed curve."""
FIG02: Values = FIGURES[2].series[0].values
SHARPER = np.round(np.geomspace(50.0, 1000.0, 12), 3)
"""Smoothing factors, s/rad, over which the motions of Fig. 2 are followed."""
LAWS: dict[str, dict[str, Any]] = {
    "smoothed, sigma = 50": {}, "smoothed, sigma = 1000": {"friction.smoothing": 1000.0},
    "set-valued (6)": {"friction.law": "set_valued"}}


def solvers_agree(evidence: StableMotions) -> Finding:
    """Fig. 2: RK45, Gear and the discontinuous solution, over one cycle and in their attractors."""
    differences = cycle_differences((("rk45", "smoothed", None), ("bdf", "smoothed", None),
                                     ("event_driven", "set_valued", None)))
    steady = {name: evidence.steady({**FIG02, **row}) for name, row in LAWS.items()}
    motions = {name: evidence.attractors({**FIG02, **row}) for name, row in LAWS.items()}
    first, *others = motions.values()
    alike = all(len(m) == len(first) and all(a[0] == b[0] and abs(b[1] / a[1] - 1.0) <= ALIKE for a, b in zip(first, m))
                for m in others)
    close = max(differences.values()) < ALIKE
    return Finding("2", "RK45, a stiff (Gear) method and the discontinuous solution agree",
                   f"rms difference of the slip speed over a cycle from one state below {ALIKE:g} of its maximum, and "
                   f"the same attractors, of one period and with largest slip speeds within {ALIKE:g}",
                   {"over a cycle from law (7)'s state": differences,
                    "attractors: period, largest slip speed (rad/s)":
                    {name: [list(a) for a in m] for name, m in motions.items()},
                    "of these from (13)": {name: [s["period"], s["max_slip_speed"]] for name, s in steady.items()}},
                   judged(close and alike, close),
                   "over a cycle from the same state they do; the laws have "
                   + ("the same motions, and the smoothing factor decides to which of them (13) leads" if alike else
                      "different motions: the paper's smoothing factor decides which there are"),
                   tuple(evidence.motions("", FIG02, SHARPER, over=SMOOTHING)))


def classical_differs(evidence: Evidence) -> Finding:
    """Fig. 2: classical Runge-Kutta at a fixed step."""
    steps = (1e-6, 2e-5, 5e-5, 1e-4)
    differences = cycle_differences(tuple((f"rk4, step {h:g} s", "smoothed", h) for h in steps))
    differing = [d > ALIKE for d in differences.values()]
    return Finding("2", "classical fixed-step RK4 differs from them", f"rms difference above {ALIKE:g} of the maximum",
                   differences, DEPENDS if any(differing) and not all(differing) else judged(all(differing)),
                   f"the step is not printed: within the stability limit, "
                   f"{stability_limit(paper_system(FIG02)) * 1e6:.2g} "
                   "us, RK4 agrees, beyond it stick rings")


def stability_limit(system: System) -> float:
    """The longest step of RK4 in stick, s: 2.785 (Hairer and Wanner, IV.2) over the rate beta Ts r sigma."""
    rate = system.inverse_inertia * (system.saturation_mean + system.saturation_amplitude)
    return 2.785 / (rate * system.friction_ratio * system.friction.smoothing)


@lru_cache(maxsize=4)
def cycle_differences(chosen: tuple[tuple[str, str, float | None], ...]) -> dict[str, float]:
    """Root mean square difference from the smoothed engine over one cycle of Fig. 2, relative to the maximum."""
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


def kinetic_ratios(number: int) -> list[float]:
    """mu_k/mu_s of every curve of a figure."""
    return [float(series.values[KINETIC]) / STATIC for series in FIGURES[number].series]  # type: ignore[arg-type]


def peak_of(system: System) -> float:
    """The maximum of mubar (7)."""
    terms = terms_of(system)
    assert terms.smoothing is not None
    return friction.peak(terms.smoothing, terms.stribeck)[1]


def least_slope(system: System) -> float:
    """The least slope (20b), s/rad."""
    terms = terms_of(system)
    assert terms.smoothing is not None
    v = np.linspace(1e-4, 1.0, 20001)
    return float(friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1].min())


def maximum_falls(evidence: Evidence) -> Finding:
    """Fig. 3: the smoothed maximum, for the mu_k of the figure."""
    peaks = {f"{r:g}": peak_of(paper_system({KINETIC: r * STATIC})) * r for r in kinetic_ratios(3) if r < 1.0}
    parts = list(peaks.values())
    return Finding("3", "the smoothed maximum of mubar falls below mu_s/mu_k",
                   "maximum of (7) over mu_s/mu_k below 1, and the lower the smaller mu_k",
                   {"maximum / (mu_s/mu_k)": peaks},
                   judged(max(parts) < 1.0 and parts == sorted(parts, reverse=True)))


def slope_turns_negative(evidence: Evidence) -> Finding:
    """Fig. 3: the slope, for the mu_k of the figure."""
    lowest = {f"{r:g}": least_slope(paper_system({KINETIC: r * STATIC})) for r in kinetic_ratios(3)}
    found = list(lowest.values())
    return Finding("3", "the slope d(mubar)/dv turns negative, more so for smaller mu_k",
                   "least slope of (20b) below 0 for mu_k < mu_s and falling with mu_k",
                   {"least slope (s/rad)": lowest},
                   judged(found[0] >= 0.0 and found[1] < 0.0 and found == sorted(found, reverse=True)))


PURE_SLIP: Values = {"pressure.mean": 125e3, "engine.frequency": 150.0}
"""Table 1 with Tsm = Tm, for (17) and (18)."""


def pure_slip_guaranteed(evidence: Evidence) -> Finding:
    """(14) to (18): pure positive slip for Tm = Tsm, against the simulation."""
    system = paper_system(PURE_SLIP)
    found = closed_form.pure_slip(system)
    run = evidence.first_cycles(PURE_SLIP, 60, 200)
    off = float(np.abs(run.slip_speed - found.slip_speed(run.t)).max()) / float(np.abs(run.slip_speed).max())
    # v is Omega_e plus what does not depend on it, so the slowest engine that keeps slipping is the difference.
    slowest = system.initial.slip_speed - found.least_slip_speed
    return Finding("(14) to (18)", "Table 1 with Tm = Tsm, mu_k = mu_s: pure positive slip is guaranteed",
                   "the closed form with its transient, corrected, within 1e-6 of the simulation, and above 0 for ever",
                   {"largest difference, relative": off, "margin of (16) (rad/s)": found.margin,
                    "least slip speed with the transient (rad/s)": found.least_slip_speed,
                    "least Omega_e that slips for ever (rad/s)": slowest},
                   judged(found.least_slip_speed > 0.0 and off < 1e-6),
                   f"(16), (18) leave out the transient: below Omega_e = {slowest:.3g} rad/s it ends the slip")


SERIES: dict[str, tuple[float, int]] = {"1/2": (0.5, 2), "2/1": (2.0, 1), "2/3": (2.0 / 3.0, 3), "4/3": (4.0 / 3.0, 3)}
"""M/N of Figs. 10 to 12: omega_f/omega and N."""
HARMONICS = 40
"""Harmonics of omega in the series."""


def series_balance(evidence: Evidence) -> Finding:
    """(30) to (34): with their mean terms the series are the motion; as printed they cannot carry Tm."""
    values: dict[str, Any] = {}
    close, short = [], []
    for name, (ratio, period) in SERIES.items():
        row: Values = {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio,
                       "engine.frequency": 150.0}
        try:
            found = harmonic_balance(paper_system(row), period, HARMONICS * period)
        except NumericalFailure as failure:
            values[name] = str(failure)
            close.append(False)
            continue
        run = evidence.last_cycles(row, period, 400)
        size = float(np.abs(run.slip_speed).max())
        off = float(np.sqrt(np.mean((found.slip_speed(run.t) - run.slip_speed) ** 2))) / size
        printed = mean_friction_torque(paper_system(row), found.coefficient, period, printed=True)
        corrected = mean_friction_torque(paper_system(row), found.coefficient, period)
        values[name] = {"rms difference of the corrected series": off, "a0 (rad/s)": float(found.slip[0]),
                        "mean friction torque, corrected": corrected, "as printed (N m)": printed}
        close.append(off < ALIKE)
        short.append(abs(printed - 300.0) > 1.0)
    return Finding("(30) to (34)", "the series of harmonic balance satisfy (1) for omega_f = (M/N) omega",
                   f"the mean of (31) as printed is Tm = 300 N m; with c0 and a0 added the series of {HARMONICS} "
                   f"harmonics of omega "
                   f"within {ALIKE:g} of the simulation (rms)", values,
                   judged(all(close) and not any(short), False),
                   "without mean terms the friction torque's mean is at most (2/pi) Tsp = 86 N m; with them the "
                   "series agrees"
                   if all(close) else "Newton's method did not end, or the series is another motion")


CLAIMS = (solvers_agree, classical_differs, maximum_falls, slope_turns_negative, pure_slip_guaranteed)
"""In the order of the paper; `series_balance` stands with (35)."""
