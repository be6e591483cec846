"""Claims on the ranges of stick and of slip: (10), (14) to (18), and ends of stick in the figures."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.model import pure_slip, pure_stick
from tcc_sim.model.parameters import System, replace
from tcc_sim.paper.catalogue import OMEGA_N, PRESSURE, paper_system
from tcc_sim.paper.criteria import Claim, Measured, claim, equal, holds, near
from tcc_sim.paper.evidence import FREQUENCY, Evidence, T, Values, share_where, sticks, two_digits
from tcc_sim.paper.rules import AXIS, FRICTION_RATIOS, FRICTION_ROWS, place_of_change, rows
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.solvers import solve

LAWS = ("smoothed", "set_valued")
STICKING = np.round(np.arange(0.05, 0.2501, 0.001), 6)
"""Frequency ratios in the search for the end of pure stick, psi = 0."""


def stick_interval(evidence: Evidence, number: int, law: str) -> list[float]:
    """Return the lowest ratio with lasting slip from (13) for psi = 0, and the highest ratio with pure stick."""
    slips = evidence.slips(evidence.curves([{**rows(number)[0], "friction.law": law}], STICKING)[0])
    return [float(STICKING[slips].min(initial=math.inf)), float(STICKING[~slips].max(initial=-math.inf))]


def stick_below(evidence: Evidence, number: int, place: float) -> Measured:
    """Judge the end of stick for psi = 0 against the ratio in the text."""
    found = {law: stick_interval(evidence, number, law) for law in LAWS}
    lower = pure_stick.stick_limits(evidence.system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
    near = evidence.limit("near")
    return Measured([(low - near <= place <= high + near, True) for low, high in found.values()],
                    {**{f"lowest slip and highest stick, {law}": x for law, x in found.items()},
                     "end of stick by (10), whatever mu_k": None if lower is None else lower / OMEGA_N},
                    "between the lowest slip and the end of pure stick by (10) motions of both kinds exist")


ROWS = tuple(Claim(str(number), where, f"psi = 0: pure stick below {place:g}", equal(
    f"{place:g} lies from the lowest ratio that slips from (13) to the highest of 0.05 to 0.25 that sticks, widened "
    f"by {T.near:g} either way, with the smoothed law and with the set-valued one"),
    partial(stick_below, number=number, place=place), name, fitted=True) for number, where, place, name in (
    (8, "6.1; 6.2", 0.18, "stick_below_018"), (14, "6.2, after Fig. 14", 0.15, "stick_below_015")))
"""Claims by the rule `stick_below`. Between the two ratios motions of both kinds exist."""


@claim("14", "6.2, after Fig. 14", "it begins to slip at a lower ratio than in Fig. 8, due to the negative damping",
       equal("the lowest ratio that slips from (13) at 0.75 mu_s is below that at mu_k = mu_s, with either law"))
def earlier_onset(evidence: Evidence) -> Measured:
    found = {law: [stick_interval(evidence, n, law)[0] for n in (8, 14)] for law in LAWS}
    return Measured([(falling < equal, True) for equal, falling in found.values()],
                    {f"lowest slip at mu_k = mu_s and 0.75 mu_s, {law}": x for law, x in found.items()},
                    "the end of stick by (10) is the same for both: a motion that slips goes on below it where "
                    "friction falls")


@claim("18", "6.2, Fig. 18", "larger Tsp: quasi-periodic or chaotic motions at low frequency become pure stick", holds(
    "to 0.12 the part in pure stick never falls with Tsp and ends at 1, and at Tsp = 0 or 0.125 Tsm some ratio there "
    "has no period up to 16", "the part in pure stick grows from Tsp = 0 to 0.5 Tsm"))
def amplitude_makes_stick(evidence: Evidence) -> Measured:
    sweeps, low = evidence.curves(rows(18), AXIS), AXIS <= 0.12
    stuck = [share_where(sticks(s), low) for s in sweeps]
    wild = [share_where(evidence.periods(s) == 0, low) for s in sweeps]
    grows = stuck == sorted(stuck) and stuck[-1] == 1.0
    return Measured((grows and max(wild[:2]) > 0.0, stuck[-1] > stuck[0]),
                    {"pure stick for Tsp/Tsm = 0, 0.125, 0.25, 0.5": stuck, "no period up to 16": wild})


def last_slips(evidence: Evidence, law: str) -> dict[str, float]:
    """Return the highest slipping ratio from (13) for every mu_k/mu_s."""
    upper = np.round(np.concatenate([np.arange(0.38, 0.48, 0.002), np.arange(0.48, 0.7, 0.005)]), 6)
    sweeps = evidence.curves([{**row, "friction.law": law} for row in FRICTION_ROWS], upper)
    return {f"{r:g}": float((s.values[~sticks(s)] / OMEGA_N).max(initial=0.0)) for r, s in zip(FRICTION_RATIOS, sweeps)}


@claim("4", "5, after Fig. 4", "the transition between stick and stick-slip lies near 0.4 and moves with mu_k", holds(
    f"the highest slipping ratio from (13) lies within {T.near:g} of 0.4 for mu_k = mu_s, and elsewhere for every "
    "mu_k"),
       fitted=True)
def stick_transition(evidence: Evidence) -> Measured:
    found = last_slips(evidence, "smoothed")
    return Measured((abs(found["1"] - 0.4) <= evidence.limit("near") and len(set(found.values())) == len(found),),
                    {"last slip from (13) for mu_k/mu_s": found})


@claim("4", "4, after (11); 5", "the transition moves with mu_k because the law is smoothed", holds(
    "from mu_k = mu_s to 0.667 mu_s it moves by less than half as far with the set-valued law"))
def transition_by_smoothing(evidence: Evidence) -> Measured:
    values = {law: last_slips(evidence, law) for law in LAWS}
    smoothed, exact = (abs(row["0.667"] - row["1"]) for row in values.values())
    limit = pure_stick.constant_load_limits(evidence.system({}))[-1] / OMEGA_N
    return Measured((exact < 0.5 * smoothed,),
                    {"last slip from (13)": values, "end of pure stick by (10), any mu_k": limit},
                    "" if exact < 0.5 * smoothed else
                    "the set-valued law moves it as far. Stick ends at one ratio for every mu_k, by (10); above it "
                    "stick and stick-slip coexist, and (13) leads to stick-slip the farther the smaller mu_k")


STICKY: dict[str, Values] = {
    "constant load": {}, **{f"Tsp/Tsm = 0.25, psi = {name}": {"pressure.amplitude": 0.25 * PRESSURE,
                                                              "pressure.phase": psi}
                            for name, psi in (("0", 0.0), ("pi/2", 0.5 * math.pi), ("pi", math.pi))}}
"""Loads for the comparison of stick with (10)."""
SLIPS = 1e-3
"""Largest slip speed, rad/s, of a motion that starts in stick and counts as stick."""


def _slip_from_stick(evidence: Evidence, row: Values, ratio: float, law: str) -> float:
    """Return the largest slip speed of 20 cycles from the state (8a) of stick at t = 0, rad/s."""
    system = evidence.system({**row, FREQUENCY: ratio * OMEGA_N, "friction.law": "set_valued"})
    angle = pure_stick.plate_angle(system)
    step = 1e-7 / system.engine.frequency
    early, start, late = (float(angle(np.array([t]))[0]) for t in (-step, 0.0, step))
    stuck: System = replace(system, {"initial.slip_speed": 0.0, "initial.plate_angle": start,
                                     "initial.plate_speed": (late - early) / (2.0 * step), "friction.law": law})
    return float(solve(stuck, cycles=20).solved_cycles.largest.max())


def end_of_stick(evidence: Evidence, row: Values, low: float, high: float) -> float | None:
    """Return omega/omega_n at which a motion from stick slips within 20 cycles; None if both ends are alike."""
    def slips(ratio: float) -> bool:
        return _slip_from_stick(evidence, row, ratio, "set_valued") > SLIPS

    return place_of_change(slips, low, high, 14) if slips(low) != slips(high) else None


def stick_ends(evidence: Evidence, constant: bool) -> Measured:
    """Compare limits of stick by (10) with those of motions that start in stick, with the set-valued law."""
    values, pairs = {}, []
    for name, row in STICKY.items():
        if (name == "constant load") is not constant:
            continue
        limits = pure_stick.stick_limits(evidence.system(row), 0.05 * OMEGA_N, 0.6 * OMEGA_N, 60)
        for end, omega in (("lower", limits.lower), ("upper", limits.higher)):
            if omega is not None:
                limit = omega / OMEGA_N
                found = end_of_stick(evidence, row, limit - 0.02, limit + 0.02)
                values[f"{name}, {end} limit: (10), simulation"] = [limit, found]
                pairs.append((found, limit))
    return Measured(pairs, values, "the criterion is that of the errata: both signs, four-quadrant phase")


LIMITS = tuple(Claim(figure, where, sentence, near(
    "frequency ratio at which a motion that starts in stick slips within 20 cycles, set-valued law, and (10) "
    f"(corrected): both limits{loads}", 1e-3), partial(stick_ends, constant=constant), name, cheap=True)
    for figure, where, sentence, loads, constant, name in (
        ("4", "4, (8) to (11)", "pure stick ends where (10), (25) say", "", True, "limits_of_stick"),
        ("(10)", "4, before (8)", "the criterion of pure stick holds under varying load too",
         ", for psi = 0, pi/2, pi and Tsp/Tsm = 0.25", False, "stick_limits_varying")))
"""Claims by the rule `stick_ends`."""


@claim("(7)", "4, after (11)", "under the smoothed law pure stick may not hold", holds(
    f"0.02 above the upper limit of stick by (10) the motion from the state (8a) slips more than {SLIPS:g} rad/s with "
    "the smoothed law, and less with the set-valued one"), cheap=True)
def smoothed_stick_creeps(evidence: Evidence) -> Measured:
    ratio = pure_stick.constant_load_limits(evidence.system({}))[-1] / OMEGA_N + 0.02
    found = {law: _slip_from_stick(evidence, {}, ratio, law) for law in LAWS}
    return Measured((found["smoothed"] > SLIPS > found["set_valued"],), {
        "omega/omega_n": ratio, "largest slip speed (rad/s)": {name: two_digits(x) for name, x in found.items()}})


PURE_SLIP: Values = {"pressure.mean": 125e3, FREQUENCY: 150.0}
"""Table 1 with Tsm = Tm, for (17) and (18)."""
GROWING: Values = {"pressure.mean": 123.75e3, FREQUENCY: 0.36 * OMEGA_N}
"""mu_k = mu_s with Tsm = 297 N m, 3 N m below Tm."""


@claim("(14)", "4, after (14)", "mu_k = mu_s: a1 > 0, that is Tm > Tsm, gives pure slip",
       holds("with Tsm = 297 N m, 3 N m below Tm, at omega/omega_n = 0.36 no motion sticks after 2000 cycles: neither "
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
       holds("the closed form with its transient, corrected, within 1e-6 of the simulation, and above 0 for ever "
             "whatever the engine speed Omega_e > 0", "so from Omega_e = 150 rad/s"), cheap=True, alone=True)
def pure_slip_guaranteed(evidence: StableMotions) -> Measured:
    system = paper_system(PURE_SLIP)
    found = pure_slip.pure_slip(system)
    run = evidence.run(system, 60, samples=200)
    off = float(np.abs(run.slip_speed - found.slip_speed(run.t)).max()) / float(np.abs(run.slip_speed).max())
    # v is Omega_e plus terms that do not depend on it, so the slowest engine that keeps slipping is the difference.
    slowest = system.initial.slip_speed - found.least_slip_speed
    # The difference is rounding: its digits are those of a machine, so the page has its bound only.
    held = found.least_slip_speed > 0.0 and off < 1e-6
    return Measured((held and slowest <= 0.0, held),
                    {"difference below 1e-6": off < 1e-6, "margin of (16) (rad/s)": found.margin,
                     "least slip speed with the transient (rad/s)": found.least_slip_speed,
                     "least Omega_e that slips for ever (rad/s)": slowest},
                    f"(16), (18) leave out the transient: below Omega_e = {slowest:.3g} rad/s it ends the slip")
