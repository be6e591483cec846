"""Claims on super-harmonic peaks and on jumps of the maxima."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from tcc_sim.errors import counted
from tcc_sim.study.paper import rules
from tcc_sim.study.paper.branches_behind import WAYS, Motion
from tcc_sim.study.paper.catalogue import FIGURES
from tcc_sim.study.paper.evidence import T, steep, with_kinetic
from tcc_sim.study.paper.rules import AXIS, FINER, LOW, Measured, Rules, grow, rows
from tcc_sim.trajectory import Floats

FALLING = dict(zip(rules.FRICTION_RATIOS[1:], rows(4)[1:]))
"""Rows of mu_k < mu_s in Fig. 4, by mu_k/mu_s."""
NAMED = {f"{m:.3f}": m for m in FIGURES[4].marks}
"""omega/omega_n of the super-harmonic peaks that the paper names (0.167, 0.20, 0.25, 0.33)."""
HIGHER_JUMPS = {"0.25": 0.25, "0.35": 0.35}
"""Frequency ratios near which the text of Fig. 18 states jumps and aperiodic motions."""
LINKED, LOOSE = 0.5, 0.25
"""Rank correlation that chance exceeds in about 5 % of samples of fifteen jumps, and half of it."""
APERIODIC = 17.0
"""Rank of a motion without a period up to 16."""


def about(place: float, width: float = T.near, count: int = 15) -> Floats:
    """Return frequency ratios of branches around a ratio that the text names."""
    return np.round(np.linspace(place - width, place + width, count), 6)


def nearest(places: Sequence[float], mark: float) -> float | None:
    """Return the place nearest to a mark."""
    return min(places, key=lambda x: abs(x - mark), default=None)


class JumpClaims(Rules):
    """Measures of the claims on peaks and jumps."""

    def curves_near_named(self, places: Sequence[Any], values: dict[str, Any],
                          motions: Sequence[Motion] = ()) -> Measured:
        """Judge whether more curves have one of their places near each super-harmonic than near any ratio."""
        def count(x: float) -> int:
            return sum(bool((np.abs(np.array(row) - x) <= self.limit("near")).any()) for row in places)

        return rules.more_than_anywhere(count, NAMED, "curves of nine near", values,
                                  "near {} there are no more of them than near any ratio", motions)

    def jump_places(self, ratio: float) -> list[float]:
        """Return the ratios omega/omega_n of the jumps of the map of one mu_k/mu_s from (13)."""
        return [round(x, 4) for x, _ in self.jumps(with_kinetic(ratio), FINER)]

    def prominent_maxima(self, axis: Floats, values: Floats) -> list[float]:
        """Return the places of the local maxima that stand out on either side within five values."""
        least, reach = self.limit("prominent") * float(np.nanmax(values)), 5
        return [float(axis[k]) for k in range(1, len(values) - 1)
                if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
                and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
                and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]

    def peaks_of(self, way: str = "cold") -> dict[str, list[float]]:
        """Return the prominent maxima of Fig. 4 for every mu_k/mu_s, omega/omega_n."""
        return {f"{r:g}": self.prominent_maxima(FINER, values)
                for r, values in zip(rules.FRICTION_RATIOS, self.figure(4, way=way).maxima)}

    def super_harmonic_peaks(self) -> Measured:
        peaks = [self.peaks_of(way) for way in WAYS]
        return self.curves_near_named([peak[f"{r:g}"] for peak in peaks for r in FALLING], {"peaks": peaks})

    def super_harmonic_jumps(self) -> Measured:
        both, left, motions = list[list[float]](), list[float](), list[Motion]()
        # Sweeps over so wide a range reach the motions that end there.
        axes = [about(mark, rules.WIDE, 21) for mark in NAMED.values()]
        for r, row in FALLING.items():
            ends = [end for axis in axes for end in self.jump_ends(row, axis)]
            for way in WAYS:
                values = self.maxima([row], FINER, direction=way)[0]
                steps = [0.5 * (FINER[k] + FINER[k + 1]) for k in steep(values, self.limit("jump"))]
                met = [x for x in ends if any(abs(x - step) <= self.limit("ends") for step in steps)]
                both.append([x for x in self.prominent_maxima(FINER, values)
                             if any(abs(x - end) <= self.limit("close") for end in met)])
                left += met
            motions += [m for axis in axes for m in self.motions(f"mu_k = {r:g} mu_s", row, axis)
                        if any(end.jumps and end.value in left for end in (m.stretch.low, m.stretch.high))]
        return self.curves_near_named(both, {
            "nearest end in a jump": {name: nearest(left, m) for name, m in NAMED.items()},
            "jumps from (13)": {f"{r:g}": self.jump_places(r) for r in FALLING}}, motions)

    def peaks_move(self) -> Measured:
        peaks = self.peaks_of()
        chains = [[x] for x in peaks["1"] if x > 0.15]
        for r in FALLING:
            for chain in chains:
                x = nearest(peaks[f"{r:g}"], chain[-1])
                chain += [x] if x is not None and abs(x - chain[-1]) <= self.limit("near") else []
        rising = [len(c) > len(FALLING) and c == sorted(c) and c[-1] > c[0] for c in chains]
        return Measured((bool(rising) and all(rising), any(rising)), {"followed": chains, "peaks": peaks},
                        "" if all(rising) else f"{sum(rising)} of {counted(len(chains), 'peak')} shift up")

    def lost_at_peaks(self) -> Measured:
        peaks, close = self.peaks_of(), self.limit("close")
        near, covered = list[bool](), list[float]()
        for r in FALLING:
            row = np.array(peaks[f"{r:g}"])
            near += [bool((np.abs(row - x) <= close).any()) for x in self.jump_places(r)]
            covered.append(float((np.abs(FINER[FINER > 0.12, None] - row) <= close).any(axis=1).mean()))
        share = float(np.mean(near)) if near else 0.0
        return Measured((share >= 0.75, share > max(covered)), {"jumps": len(near), "share": share, "covered": covered},
                        0.75 > share > max(covered))

    def jump_doubles_period(self) -> Measured:
        periods = {f"{x:.4f}": [m.period for m in self.motions_near(with_kinetic(0.83), x, -2e-3, 2e-3)]
                   for x in self.jump_places(0.83) if abs(x - 0.20) <= self.limit("near")}
        return Measured(([1, 2] in periods.values(),), {"periods around": periods})

    def new_peaks(self) -> Measured:
        counts = [[len(self.prominent_maxima(AXIS[LOW], row[LOW])) for row in self.figure(n).maxima]
                  for n in (8, 14)]
        fewer = [name for name, a, b in zip(("0", "pi/2", "pi"), *counts) if b <= a]
        return Measured((not fewer, len(fewer) < 3), {"peaks": counts},
                        f"psi = {', '.join(fewer)} has no more peaks" if fewer else "")

    def jump_to_chaos(self) -> Measured:
        row, near, jump = rows(14)[0], about(0.35), self.limit("jump")
        ends = [x for x in self.jump_ends(row, near) if abs(x - 0.35) <= self.limit("near")]
        rises = [float(0.5 * (AXIS[k] + AXIS[k + 1])) for k in steep(self.maxima([row], AXIS)[0], jump)]
        values: dict[str, Any] = {"stable motions end in a jump at": ends, "steep rises": rises}
        whole, part = False, False
        for x in ends or [x for x in rises if abs(x - 0.35) <= self.limit("near")]:
            below = self.motions_near(row, x, -5e-3)[0].period
            above = self.motions_near(row, x, 5e-3, 1e-2, 2e-2, lyapunov=True)
            values[f"period below {x:.4f}"] = below
            values[f"above {x:.4f}: period, exponent's interval (1/s), diagnosis"] = [
                [m.period] + ([] if (e := m.lyapunov) is None else [e.low, e.high, e.diagnosis]) for m in above]
            chaotic = any(m.lyapunov is not None and m.lyapunov.diagnosis == "chaotic" for m in above)
            whole |= bool(ends) and below > 0 and chaotic
            part |= below > 0 and any(m.period == 0 for m in above)
        return Measured((whole, part), values, not ends, self.motions("psi = 0", row, near))

    def severity_follows_abruptness(self) -> Measured:
        jumps = [(abs(size), self.motions_near(row, x, -rules.PARTED, rules.PARTED))
                 for _, row, x, size in self.figure(14).jumps()]
        severity = [max(APERIODIC if m.period == 0 else float(m.period) for m in motions) for _, motions in jumps]
        sizes, largest = [size for size, _ in jumps], [max(m.largest for m in motions) for _, motions in jumps]
        abrupt, large = (float(spearmanr(severity, x).statistic) if len(set(severity)) > 1 and len(set(x)) > 1 else 0.0
                         for x in (sizes, largest))
        return Measured((abrupt > LINKED and abrupt > large, abrupt > LOOSE),
                        {"jumps": len(severity), "abrupt": abrupt, "large": large}, abrupt <= LINKED)

    def phase_pi_is_smooth(self) -> Measured:
        curve = self.figure(14, [2])
        row, = curve.rows.values()
        periods, jumps = curve.periods[0], [x for _, _, x, _ in curve.jumps()]
        motions = [m for place in jumps for m in self.motions("psi = pi", row, about(place, 0.01))]
        met = [end for m in motions if m.from_start for end in (m.stretch.low, m.stretch.high) if end.kind]
        share = float((periods == 1).mean())
        smooth = share == 1.0 and not jumps
        return Measured((smooth, not met and share > 0.5),
                        {"share": share, "periods": np.unique(periods).tolist(), "jumps": [round(x, 4) for x in jumps],
                         "met": [[end.kind, end.value] for end in met]}, not smooth, motions)

    def half_frequency_jumps(self) -> Measured:
        counts = [len(steep(values, self.limit("jump"))) for values in self.figure(16).maxima]
        return Measured((counts[0] > max(counts[1:]), counts[0] > min(counts[1:])), {"changes": counts})

    def amplitude_enlarges_jumps(self) -> Measured:
        jumps = [max((abs(size) for x, size in self.jumps(row, AXIS)
                      if any(abs(x - mark) <= 2.0 * self.limit("near") for mark in HIGHER_JUMPS.values())), default=0.0)
                 for row in rows(18)]
        return Measured((grow(jumps), jumps[-1] > jumps[0]), {"jumps": jumps}, jumps[-1] < jumps[0])

    def amplitude_jumps(self) -> Measured:
        curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
        jumps, motions = dict[str, list[float]](), list[Motion]()
        for name, mark in HIGHER_JUMPS.items():
            axis = about(mark)
            self.stretches(list(curves.values()), axis)
            jumps[name] = [x for row in curves.values() for x in self.jump_ends(row, axis)
                           if abs(x - mark) <= self.limit("near")]
            motions += [m for curve, row in curves.items() for m in self.motions(curve, row, axis)]
        return Measured([(bool(places), True) for places in jumps.values()], {"ends": jumps}, motions=motions)
