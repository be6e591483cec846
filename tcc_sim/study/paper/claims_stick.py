"""Claims on stick and slip: their ranges by (10) and (14) to (18), the order of the curves, its reversal and causes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcc_sim.model import pure_slip, pure_stick
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.study.paper.branches_behind import Motion, highest_shares
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system, plain
from tcc_sim.study.paper.evidence import FREQUENCY, Values, first_half, share_where, sticks, two_digits
from tcc_sim.study.paper.rules import AXIS, FRICTION_RATIOS, HIGH, LOW, Measured, Rules, grow, place_of_change, rows

LAWS = ("smoothed", "set_valued")
STICKING = np.round(np.arange(0.05, 0.2501, 0.001), 6)
"""Frequency ratios in the search for the end of pure stick, psi = 0."""
STICKY = {"constant load": {}, **{f"Tsp/Tsm = 0.25, {plain(s.label)}": s.values for s in FIGURES[8].series}}
"""Loads for the comparison of stick with (10)."""
SLIPS = 1e-3
"""Largest slip speed, rad/s, of a motion that starts in stick and counts as stick."""
PURE_SLIP: Values = {"pressure.mean": 125e3, FREQUENCY: 150.0}
"""Table 1 with Tsm = Tm, for (17) and (18)."""
GROWING: Values = {"pressure.mean": 123.75e3, FREQUENCY: 0.36 * OMEGA_N}
"""mu_k = mu_s with Tsm = 297 N m, 3 N m below Tm."""
HIGHER = AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
"""Frequency ratios of the branches for claims on higher frequencies."""
INERTIAS: dict[str, Values] = {
    "Table 1": {}, "I1 = 0.1": {"driveline.flywheel_inertia": 0.1}, "I1 = 0.4": {"driveline.flywheel_inertia": 0.4},
    "I2 = 0.04": {"driveline.plate_inertia": 0.04}}


class SlipClaims(Rules):
    """Measures of the claims on stick and slip."""

    def stick_interval(self, number: int, law: str) -> list[float]:
        """Return the lowest ratio with lasting slip from (13) for psi = 0, and the highest ratio with pure stick."""
        slips = self.slips(self.curves([{**rows(number)[0], "friction.law": law}], STICKING)[0])
        return [float(STICKING[slips].min(initial=math.inf)), float(STICKING[~slips].max(initial=-math.inf))]

    def stick_below(self, number: int, place: float) -> Measured:
        """Judge the end of stick for psi = 0 against the ratio in the text; between two ratios are both motions."""
        intervals = {law: self.stick_interval(number, law) for law in LAWS}
        lower = pure_stick.stick_limits(self.system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
        near = self.limit("near")
        return Measured([(low - near <= place <= high + near, True) for low, high in intervals.values()],
                        {**intervals, "lower": None if lower is None else lower / OMEGA_N}, True)

    def earlier_onset(self) -> Measured:
        onsets = {law: [self.stick_interval(n, law)[0] for n in (8, 14)] for law in LAWS}
        return Measured([(falling < equal, True) for equal, falling in onsets.values()], onsets, True)

    def amplitude_makes_stick(self) -> Measured:
        curves, low = self.figure(18), AXIS <= 0.12
        stuck = [share_where(~slips, low) for slips in curves.slips]
        wild = [share_where(periods == 0, low) for periods in curves.periods]
        grows = stuck == sorted(stuck) and stuck[-1] == 1.0
        return Measured((grows and max(wild[:2]) > 0.0, stuck[-1] > stuck[0]), {"stuck": stuck, "wild": wild})

    def last_slips(self, law: str) -> dict[str, float]:
        """Return the highest slipping ratio from (13) for every mu_k/mu_s."""
        upper = np.round(np.concatenate([np.arange(0.38, 0.48, 0.002), np.arange(0.48, 0.7, 0.005)]), 6)
        sweeps = self.curves([{**row, "friction.law": law} for row in rows(4)], upper)
        return {f"{r:g}": float((s.values[~sticks(s)] / OMEGA_N).max(initial=0.0))
                for r, s in zip(FRICTION_RATIOS, sweeps)}

    def stick_transition(self) -> Measured:
        slips = self.last_slips("smoothed")
        return Measured((abs(slips["1"] - 0.4) <= self.limit("near") and len(set(slips.values())) == len(slips),),
                        {"last": slips})

    def transition_by_smoothing(self) -> Measured:
        values = {law: self.last_slips(law) for law in LAWS}
        smoothed, exact = (abs(row["0.667"] - row["1"]) for row in values.values())
        limit = pure_stick.constant_load_limits(self.system({}))[-1] / OMEGA_N
        return Measured((exact < 0.5 * smoothed,), {"last": values, "limit": limit}, exact >= 0.5 * smoothed)

    def _slip_from_stick(self, row: Values, ratio: float, law: str) -> float:
        """Return the largest slip speed of 20 cycles from the state (8a) of stick at t = 0, rad/s."""
        system = self.system({**row, FREQUENCY: ratio * OMEGA_N, "friction.law": "set_valued"})
        angle = pure_stick.plate_angle(system)
        step = 1e-7 / system.engine.frequency
        early, start, late = (float(angle(np.array([t]))[0]) for t in (-step, 0.0, step))
        stuck: System = replace(system, {"initial.slip_speed": 0.0, "initial.plate_angle": start,
                                         "initial.plate_speed": (late - early) / (2.0 * step), "friction.law": law})
        return float(solve(stuck, cycles=20).solved_cycles.largest.max())

    def end_of_stick(self, row: Values, low: float, high: float) -> float | None:
        """Return omega/omega_n at which a motion from stick slips within 20 cycles; None if both ends are alike."""
        def slips(ratio: float) -> bool:
            return self._slip_from_stick(row, ratio, "set_valued") > SLIPS

        return place_of_change(slips, low, high, 14) if slips(low) != slips(high) else None

    def stick_ends(self, loads: str) -> Measured:
        """Compare limits of stick by (10) with those of motions that start in stick; `loads`: under varying load."""
        pairs = {}
        for name, row in STICKY.items():
            if bool(row) is bool(loads):
                limits = pure_stick.stick_limits(self.system(row), 0.05 * OMEGA_N, 0.6 * OMEGA_N, 60)
                for end, omega in (("lower", limits.lower), ("upper", limits.higher)):
                    if omega is not None:
                        limit = omega / OMEGA_N
                        end_of_stick = self.end_of_stick(row, limit - 0.02, limit + 0.02)
                        pairs[f"{name}, {end} limit: (10), simulation"] = end_of_stick, limit
        return Measured(list(pairs.values()),
                        {name: [limit, end_of_stick] for name, (end_of_stick, limit) in pairs.items()}, True)

    def smoothed_stick_creeps(self) -> Measured:
        ratio = pure_stick.constant_load_limits(self.system({}))[-1] / OMEGA_N + 0.02
        slips = {law: self._slip_from_stick({}, ratio, law) for law in LAWS}
        return Measured((slips["smoothed"] > SLIPS > slips["set_valued"],),
                        {"omega/omega_n": ratio, "largest": {law: two_digits(x) for law, x in slips.items()}})

    def positive_trend_slips(self) -> Measured:
        values, slipping = dict[str, Any](), []
        for name, speed in (("from (13)", 150.0), ("from rest", 0.0)):
            last = self.run(self.system({**GROWING, "initial.slip_speed": speed}), 2000).solved_cycles[-50:]
            slipping.append(float(last.stick_time.sum()) == 0.0)
            values[name] = [float(last.lowest.min()), float(last.highest.max())]
        return Measured((all(slipping),), values, True)

    def pure_slip_guaranteed(self) -> Measured:
        system = paper_system(PURE_SLIP)
        motion = pure_slip.pure_slip(system)
        run = self.run(system, 60, samples=200)
        off = float(np.abs(run.slip_speed - motion.slip_speed(run.t)).max()) / float(np.abs(run.slip_speed).max())
        # v is Omega_e plus terms that do not depend on it, so the slowest engine that keeps slipping is the difference.
        slowest = system.initial.slip_speed - motion.least_slip_speed
        # The difference is rounding: its digits are those of a machine, so the page has its bound only.
        held = motion.least_slip_speed > 0.0 and off < 1e-6
        return Measured((held and slowest <= 0.0, held),
                        {"same": off < 1e-6, "margin": motion.margin, "least": motion.least_slip_speed,
                         "slowest": slowest},
                        f"(16), (18) leave out the transient: below Omega_e = {slowest:.3g} rad/s it ends the slip")

    def slope_exaggerates(self) -> Measured:
        curves = self.figure(4)
        mean = curves.means(curves.maxima[0] > self.limit("slipping"))
        return Measured((grow(mean),), {"mean": mean, "largest": curves.maxima.max(axis=1).tolist()})

    def slope_exaggerates_varying(self) -> Measured:
        means = [self.figure(n).means(LOW) for n in (8, 14)]
        return Measured((all(map(grow, zip(*means))),), {"mean": means})

    def phase_pi_is_worst(self) -> Measured:
        means = {str(n): self.figure(n).means(LOW) for n in (14, 15)}
        worst = [row[2] == max(row) for row in means.values()]
        return Measured((all(worst), any(worst)), {"mean": means})

    def amplitude_enlarges_slip(self) -> Measured:
        means = self.figure(18).means(HIGH)
        return Measured((grow(means), means[-1] > means[0]), {"mean": means})

    def phase_reversed(self) -> Measured:
        parts, motions = dict[str, Sequence[float]](), list[Motion]()
        figures = {str(n): self.figure(n) for n in (14, 15)}
        for n, curves in figures.items():
            self.stretches(list(curves.rows.values()), HIGHER)
            parts[n] = highest_shares([self.amplitudes(row, HIGHER) for row in curves.rows.values()],
                                      (HIGHER >= 0.31) & (HIGHER <= 0.45), self.limit("shows"), self.limit("slipping"))
            for name, row in curves.rows.items():
                motions += self.motions(f"Fig. {n}, {name}", row, HIGHER)
        always = min(every for every, _ in parts.values()) >= self.most
        cold = {n: curves.best(0, HIGH, -1.0) for n, curves in figures.items()}
        return Measured((always, max(some for _, some in parts.values()) >= 0.5), {"worst": parts, "from (13)": cold},
                        not always, motions)

    def delay(self) -> Measured:
        delays = {plain(s.label): first_half(self.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
        parts = list(delays.values())
        return Measured((min(parts[:2]) > 0.8 and max(parts[2:]) < 0.2,), {"part in the first half": delays})

    def _against_constant(self, where: Any, sign: float) -> tuple[dict[str, float], dict[str, float]]:
        """Return the parts of the slipping ratios at which curves of Figs. 10, 11 are below that of Tsp = 0, by
        frequency, and at which omega_f = omega is the lowest of its figure; sign -1: above, and the highest.
        """
        still = self.maxima([{}], AXIS)[0]
        shows, slipping = self.limit("shows"), self.limit("slipping")
        figures = [self.figure(n) for n in (10, 11)]
        return {f"{row['pressure.frequency_ratio']:.3f}": share_where(
            sign * (still - maxima) > shows, where & (np.maximum(maxima, still) > slipping))
            for curves in figures for row, maxima in zip(curves.rows.values(), curves.maxima)}, {
                str(n): curves.best(1, where, sign) for n, curves in zip((10, 11), figures)}

    def actuation_attenuates(self) -> Measured:
        below, parts = self._against_constant(LOW, 1.0)
        return Measured([*parts.values(), below["1.000"]], {"lowest": parts, "below": below})

    def actuation_reversed(self) -> Measured:
        over, parts = self._against_constant(HIGH, -1.0)
        different = {f"{row['pressure.frequency_ratio']:.3f}": row for n in (10, 11) for row in rows(n)}
        self.stretches(list(different.values()), AXIS[HIGH])
        motions = [m for ratio, row in different.items()
                   for m in self.motions(f"omega_f = {ratio} omega", row, AXIS[HIGH])]
        alone = any(end.jumps for m in motions for end in (m.stretch.low, m.stretch.high))
        return Measured([over["1.000"], *parts.values()], {"over": over, "highest": parts},
                        ("" if alone else "no stable motion ends in a jump, so the start does not matter; ")
                        + "it attenuates no more than constant load, but is not the highest beside the other curves",
                        motions)

    def mismatch_with_falling_law(self) -> Measured:
        same, falling = (self.figure(n) for n in (11, 17))
        parts = {"11": same.off_period(), "17": falling.off_period()}
        lowest, beaten = falling.best(1, LOW), falling.exceptions(1, LOW)
        more = all(map(grow, zip(*parts.values())))
        return Measured((more and lowest >= self.most, more or lowest >= self.most),
                        {"off": parts, "lowest": lowest, "not at": beaten}, bool(beaten))

    def critical_frequency(self) -> Measured:
        pairs = {}
        for name, inertia in INERTIAS.items():
            system = paper_system(inertia)
            by_inertia = math.sqrt(system.driveline.plate_inertia
                                   / (system.driveline.plate_inertia + system.driveline.flywheel_inertia))
            pairs[f"{name}: crossing, (28)"] = self.crossing(inertia, system.natural_frequency, by_inertia), by_inertia
        return Measured(list(pairs.values()), {name: list(pair) for name, pair in pairs.items()})

    def crossing(self, inertia: Values, omega_n: float, place: float) -> float | None:
        """Return where the maxima of psi = 0 and pi cross within 0.03 of a ratio, to 1e-5; None if they do not."""
        def apart(ratio: float) -> float:
            first, last = (self.motion({**row, **inertia, FREQUENCY: ratio * omega_n}).largest
                           for row in rows(8)[::2])
            return first - last

        axis = np.linspace(place - 0.03, place + 0.03, 13)
        signs = np.sign([apart(float(x)) for x in axis])
        turns = np.flatnonzero(signs[1:] * signs[:-1] < 0)
        if not len(turns):
            return None
        return place_of_change(lambda x: apart(x) > 0.0, float(axis[turns[0]]), float(axis[turns[0] + 1]), 9)
