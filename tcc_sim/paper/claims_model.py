"""The claims about the model itself: Figs. 2 and 3, pure stick (10), pure slip (14) to (18), and (28)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.model import friction, pure_slip, pure_stick
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, STATIC, paper_system
from tcc_sim.paper.criteria import Holds, Measured, Near, claim
from tcc_sim.paper.evidence import CYCLES, DISCARD, FREQUENCY, KINETIC, Evidence, T, Values, two_digits, with_kinetic
from tcc_sim.paper.stable_motions import SMOOTHING, StableMotions
from tcc_sim.solvers import solve
from tcc_sim.solvers.comparison.runge_kutta import rk4_limit
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import Floats

APART = 0.02
"""Root mean square difference, relative to the largest slip speed, above which two curves are told apart."""
FIG02: Values = FIGURES[2].series[0].values
SHARPER = np.round(np.geomspace(50.0, 1000.0, 12), 3)
"""Smoothing factors, s/rad, over which the motions of Fig. 2 are followed."""
WATCHED = (50, 150, 250, 390, 450)
"""Cycles of Fig. 2 whose maximum is set beside the next one's: a period that doubles shows in their difference."""
LAWS: dict[str, dict[str, Any]] = {
    "smoothed, sigma = 50": {}, "smoothed, sigma = 1000": {"friction.smoothing": 1000.0},
    "set-valued (6)": {"friction.law": "set_valued"}}
Differing = Callable[[tuple[tuple[str, str, float | None], ...]], dict[str, float]]


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


@claim("2", "3, after (7)", "RK45, a stiff (Gear) method and the discontinuous solution agree", Holds(
    f"from one state the slip speeds over a cycle differ by less than {T.alike:g} of their maximum (rms), the mean of "
    f"the maxima of cycles {DISCARD} to {CYCLES} from (13) by less than {T.alike:g}, and the attractors of either law "
    f"have the same periods and largest slip speeds within {T.alike:g}", "the first two hold"), alone=True)
def solvers_agree(evidence: StableMotions, differing: Differing = cycle_differences) -> Measured:
    differences = differing((("rk45", "smoothed", None), ("bdf", "smoothed", None),
                             ("event_driven", "set_valued", None)))
    paper, doubled = {}, {}
    for name in ("smoothed, sigma = 50", "set-valued (6)"):
        highest = evidence.largest_by_cycle({**FIG02, **LAWS[name]}, 1000)
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
        ("the laws have the same motions" if alike else "with the paper's smoothing factor a motion of period one "
         "stays that the sharper laws have not"),
        tuple(evidence.motions("", FIG02, SHARPER, over=SMOOTHING)))


def attractors_differ(first: list[tuple[int, float]], *others: list[tuple[int, float]], limit: float) -> bool:
    """Whether attractors (period, largest slip speed) are not those of the first law, one by one in their order."""
    return any(a[0] != b[0] or abs(b[1] / a[1] - 1.0) > limit for m in others for a, b in zip(first, m))


@claim("2", "3", "the smoothing factor brings an artificial uncertainty", Holds(
    f"the motion of Fig. 2 that (13) leads to, sigma = 50, 100, 1000 s/rad, differs from that of law (6) in period, or "
    f"by more than {T.alike:g} in its largest slip speed, for one of these, and not for the largest"), alone=True)
def smoothing_is_uncertain(evidence: Evidence) -> Measured:
    rows: dict[str, Values] = {f"sigma = {s:g}": {"friction.smoothing": s} for s in (50.0, 100.0, 1000.0)}
    found = {}
    for name, row in {**rows, "law (6)": LAWS["set-valued (6)"]}.items():
        cycles = evidence.run(evidence.system({**FIG02, **row}), 2000).solved_cycles[-96:]
        found[name] = (periodicity(cycles).period, float(cycles.largest.max()))
    *smoothed, exact = ([motion] for motion in found.values())
    apart = [attractors_differ(exact, m, limit=evidence.limit("alike")) for m in smoothed]
    return Measured((any(apart) and not apart[-1],), {"period, largest slip speed (rad/s)":
                                                      {name: list(m) for name, m in found.items()}})


SLOW = 10.0
"""How many times the time of the smoothed law's solution is enormous."""


@claim("2", "3", "the discontinuous method takes enormous time", Holds(
    f"150 cycles of Fig. 2 take the discontinuous solution more than {SLOW:g} times the processor time of the smoothed "
    "law's (least of five runs)"), alone=True)
def discontinuous_is_slow(evidence: Evidence) -> Measured:
    seconds = [min(evidence.run(evidence.system({**FIG02, "friction.law": law}), CYCLES).statistics.seconds
                   for _ in range(5)) for law in ("set_valued", "smoothed")]
    slow = seconds[0] > SLOW * seconds[1]
    return Measured((slow,), {f"more than {SLOW:g} times": slow}, "" if slow else
                    "between two events the motion has a closed form, so a cycle takes a few root searches")


@claim("2", "3, after (7)", "classical fixed-step RK4 differs from them", Holds(
    f"over a cycle from one state the slip speed differs by more than {APART:g} of its maximum (rms) for every step "
    "from 1 us to 0.1 ms", "for some of these steps"), alone=True)
def classical_differs(evidence: Evidence, differing: Differing = cycle_differences) -> Measured:
    differences = differing(tuple((f"rk4, step {h:g} s", "smoothed", h) for h in (1e-6, 2e-5, 5e-5, 1e-4)))
    apart = [d > APART for d in differences.values()]
    return Measured((all(apart), any(apart)), {name: float(f"{d:.0e}") for name, d in differences.items()},
                    f"the step is not printed: within the stability limit, "
                    f"{rk4_limit(paper_system(FIG02)) * 1e6:.2g} us, RK4 agrees, beyond it stick rings")


def of_law(worth: Any) -> dict[str, float]:
    """A number of the smoothed law for every mu_k/mu_s of Fig. 3."""
    ratios = [float(s.values[KINETIC]) / STATIC for s in FIGURES[3].series]  # type: ignore[arg-type]
    return {f"{r:g}": worth(paper_system(with_kinetic(r))) for r in ratios}


def peak_of(system: System) -> float:
    """The maximum of mubar (7) over mu_s/mu_k."""
    terms = terms_of(system)
    assert terms.smoothing is not None
    return friction.peak(terms.smoothing, terms.stribeck)[1] / system.friction_ratio


def least_slope(system: System) -> float:
    """The least slope (20b), s/rad."""
    terms = terms_of(system)
    assert terms.smoothing is not None
    v = np.linspace(1e-4, 1.0, 20001)
    return float(friction.smoothed_and_slope(v, terms.smoothing, terms.stribeck)[1].min())


@claim("3", "4, after (11)", "the smoothed maximum of mubar falls below mu_s/mu_k",
       Holds("the maximum of (7) over mu_s/mu_k is below 1 for mu_k < mu_s, and the lower the smaller mu_k"),
       cheap=True, alone=True)
def maximum_falls(evidence: Evidence, peak: Callable[[System], float] = peak_of) -> Measured:
    found = {name: x for name, x in of_law(peak).items() if name != "1"}
    parts = list(found.values())
    return Measured((max(parts) < 1.0 and parts == sorted(parts, reverse=True),), {"maximum / (mu_s/mu_k)": found})


@claim("3", "5, after (20)", "the slope d(mubar)/dv turns negative, more so for smaller mu_k",
       Holds("the least slope (20b) is below 0 for mu_k < mu_s and falls with mu_k"), cheap=True, alone=True)
def slope_turns_negative(evidence: Evidence, slope: Callable[[System], float] = least_slope) -> Measured:
    lowest = of_law(slope)
    found = list(lowest.values())
    return Measured((found[0] >= 0.0 and found[1] < 0.0 and found == sorted(found, reverse=True),),
                    {"least slope (s/rad)": lowest})


STICKY: dict[str, Values] = {
    "constant load": {}, **{f"Tsp/Tsm = 0.25, psi = {name}": {"pressure.amplitude": 0.25 * PRESSURE,
                                                              "pressure.phase": psi}
                            for name, psi in (("0", 0.0), ("pi/2", 0.5 * math.pi), ("pi", math.pi))}}
"""Loads under which stick is held against (10)."""
SLIPS = 1e-3
"""Largest slip speed, rad/s, of a motion that starts in stick and counts as stick."""
STICK_END = 1e-3
"""Difference of a limit of stick from the closed form, omega/omega_n."""
Ends = Callable[[Evidence, Values, float, float], float | None]
"""As `end_of_stick`."""


def _stuck(evidence: Evidence, row: Values, ratio: float) -> System:
    """A system with the set-valued law that starts in stick, in the state (8a) of t = 0."""
    system = evidence.system({**row, FREQUENCY: ratio * OMEGA_N, "friction.law": "set_valued"})
    angle = pure_stick.plate_angle(system)
    step = 1e-7 / system.engine.frequency
    early, start, late = (float(angle(np.array([t]))[0]) for t in (-step, 0.0, step))
    return changed(system, {"initial.slip_speed": 0.0, "initial.plate_angle": start,
                            "initial.plate_speed": (late - early) / (2.0 * step)})


def end_of_stick(evidence: Evidence, row: Values, low: float, high: float) -> float | None:
    """Where a motion that starts in stick begins to slip within 20 cycles, omega/omega_n; None where at neither end."""
    def slips(ratio: float) -> bool:
        return float(solve(_stuck(evidence, row, ratio), cycles=20).solved_cycles.largest.max()) > SLIPS

    first = slips(low)
    if slips(high) == first:
        return None
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slips(middle) == first else (low, middle)
    return 0.5 * (low + high)


def held_stick(evidence: Evidence, names: Sequence[str], ends: Ends) -> Measured:
    """Limits of stick by (10) beside those of motions that start in stick, with the set-valued law."""
    values, pairs = {}, []
    for name in names:
        limits = pure_stick.stick_limits(evidence.system(STICKY[name]), 0.05 * OMEGA_N, 0.6 * OMEGA_N, 60)
        for end, omega in (("lower", limits.lower), ("upper", limits.higher)):
            if omega is not None:
                limit = omega / OMEGA_N
                found = ends(evidence, STICKY[name], limit - 0.02, limit + 0.02)
                values[f"{name}, {end} limit: (10), simulation"] = [limit, found]
                pairs.append((found, limit))
    return Measured(pairs, values, "the criterion is that of the errata: both signs, four-quadrant phase")


@claim("4", "4, (8) to (11)", "pure stick ends where (10), (25) say",
       Near("frequency ratio at which a motion that starts in stick slips within 20 cycles, set-valued law, and (10) "
            "(corrected): both limits", STICK_END), cheap=True)
def limits_of_stick(evidence: Evidence, ends: Ends = end_of_stick) -> Measured:
    return held_stick(evidence, ("constant load",), ends)


@claim("(10)", "4, before (8)", "the criterion of pure stick holds under varying load too",
       Near("frequency ratio at which a motion that starts in stick slips within 20 cycles, set-valued law, and (10) "
            "(corrected): both limits, for psi = 0, pi/2, pi and Tsp/Tsm = 0.25", STICK_END), cheap=True)
def stick_limits_varying(evidence: Evidence, ends: Ends = end_of_stick) -> Measured:
    return held_stick(evidence, [name for name in STICKY if name != "constant load"], ends)


@claim("(7)", "4, after (11)", "under the smoothed law pure stick may not hold", Holds(
    f"0.02 above the upper limit of stick by (10) the motion from the state (8a) slips more than {SLIPS:g} rad/s with "
    "the smoothed law, and less with the set-valued one"), cheap=True)
def smoothed_stick_creeps(evidence: Evidence) -> Measured:
    limit = pure_stick.constant_load_limits(evidence.system({}))[-1] / OMEGA_N
    found = {law: float(solve(changed(_stuck(evidence, {}, limit + 0.02), {"friction.law": law}),
                              cycles=20).solved_cycles.largest.max()) for law in ("smoothed", "set_valued")}
    return Measured((found["smoothed"] > SLIPS > found["set_valued"],), {
        "omega/omega_n": limit + 0.02,
        "largest slip speed (rad/s)": {name: two_digits(x) for name, x in found.items()}})


PURE_SLIP: Values = {"pressure.mean": 125e3, "engine.frequency": 150.0}
"""Table 1 with Tsm = Tm, for (17) and (18)."""


GROWING: Values = {"pressure.mean": 123.75e3, FREQUENCY: 0.36 * OMEGA_N}
"""mu_k = mu_s with Tsm = 297 N m, 3 N m below Tm."""


@claim("(14)", "4, after (14)", "mu_k = mu_s: a1 > 0, that is Tm > Tsm, gives pure slip",
       Holds("with Tsm = 297 N m, 3 N m below Tm, at omega/omega_n = 0.36 no motion sticks after 2000 cycles: neither "
             "from (13) nor from rest"), cheap=True, alone=True)
def positive_trend_slips(evidence: Evidence) -> Measured:
    values, slipping = dict[str, Any](), []
    for name, speed in (("from (13)", 150.0), ("from rest", 0.0)):
        last = evidence.run(evidence.system({**GROWING, "initial.slip_speed": speed}), 2000).solved_cycles[-50:]
        slipping.append(float(last.stick_time.sum()) == 0.0)
        values[f"{name}: least and largest slip speed of the last 50 cycles (rad/s)"] = [
            float(last.lowest.min()), float(last.highest.max())]
    return Measured((all(slipping),), values, "(14) is derived for mu_k = mu_s; where mu_k < mu_s the erratum has a "
                    "motion that sticks")


@claim("(14) to (18)", "4, after (18)", "Table 1 with Tm = Tsm, mu_k = mu_s: pure positive slip is guaranteed",
       Holds("the closed form with its transient, corrected, within 1e-6 of the simulation, and above 0 for ever "
             "whatever the engine speed Omega_e > 0", "so from Omega_e = 150 rad/s"), cheap=True, alone=True)
def pure_slip_guaranteed(evidence: Evidence) -> Measured:
    system = paper_system(PURE_SLIP)
    found = pure_slip.pure_slip(system)
    run = evidence.run(system, 60, samples=200)
    off = float(np.abs(run.slip_speed - found.slip_speed(run.t)).max()) / float(np.abs(run.slip_speed).max())
    # v is Omega_e plus what does not depend on it, so the slowest engine that keeps slipping is the difference.
    slowest = system.initial.slip_speed - found.least_slip_speed
    # The difference is rounding: its digits are those of a machine, so only its bound is said.
    held = found.least_slip_speed > 0.0 and off < 1e-6
    return Measured((held and slowest <= 0.0, held),
                    {"difference below 1e-6": off < 1e-6, "margin of (16) (rad/s)": found.margin,
                     "least slip speed with the transient (rad/s)": found.least_slip_speed,
                     "least Omega_e that slips for ever (rad/s)": slowest},
                    f"(16), (18) leave out the transient: below Omega_e = {slowest:.3g} rad/s it ends the slip")


INERTIAS: dict[str, Values] = {
    "Table 1": {}, "I1 = 0.1": {"driveline.flywheel_inertia": 0.1}, "I1 = 0.4": {"driveline.flywheel_inertia": 0.4},
    "I2 = 0.04": {"driveline.plate_inertia": 0.04}}
CROSSING = 0.002
"""Difference of the ratio at which curves cross from (28)."""


@claim("8", "6.1, (28)", "the critical frequency of Fig. 8 is set by I1 and I2: omega_sn/omega_n",
       Near("ratio omega/omega_n at which the maxima of psi = 0 and pi cross, for four pairs of inertias, and (28)",
            CROSSING))
def critical_frequency(evidence: Evidence) -> Measured:
    values, pairs = {}, []
    for name, inertia in INERTIAS.items():
        system = paper_system(inertia)
        by_inertia = math.sqrt(system.driveline.plate_inertia
                               / (system.driveline.plate_inertia + system.driveline.flywheel_inertia))
        found = crossing(evidence, inertia, system.natural_frequency, by_inertia)
        values[f"{name}: crossing, (28)"] = [found, by_inertia]
        pairs.append((found, by_inertia))
    return Measured(pairs, values)


def crossing(evidence: Evidence, inertia: Values, omega_n: float, place: float) -> float | None:
    """Where the maxima of psi = 0 and pi cross within 0.03 of a ratio, to 1e-5; None where they do not."""
    def apart(ratio: float) -> float:
        first, last = (evidence.motion({**row, **inertia, FREQUENCY: ratio * omega_n}).largest
                       for row in (FIGURES[8].series[0].values, FIGURES[8].series[2].values))
        return first - last
    axis: Floats = np.linspace(place - 0.03, place + 0.03, 13)
    signs = np.sign([apart(float(x)) for x in axis])
    turns = np.flatnonzero(signs[1:] * signs[:-1] < 0)
    if not len(turns):
        return None
    low, high, below = float(axis[turns[0]]), float(axis[turns[0] + 1]), float(signs[turns[0]])
    for _ in range(9):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(middle) * below > 0.0 else (low, middle)
    return 0.5 * (low + high)
