"""Claims on periods: (35), the orbit diagrams, and motions without a period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcc_sim.study.continuation.loss_of_stability import StableSegment
from tcc_sim.study.paper.branches_behind import WAYS
from tcc_sim.study.paper.catalogue import OMEGA_N, PRESSURE, SECTION_CYCLES, STATIC
from tcc_sim.study.paper.claims_jumps import HIGHER_JUMPS, JumpClaims
from tcc_sim.study.paper.evidence import CYCLES, FREQUENCY, KINETIC, share_where, with_kinetic
from tcc_sim.study.paper.rules import AXIS, FINER, Measured, denominator, more_than_anywhere, rows
from tcc_sim.trajectory import Floats

MISMATCHED = {"1/2": 0.5, "2/1": 2.0, "2/3": 2.0 / 3.0, "4/3": 4.0 / 3.0}
"""M/N = omega_f/omega of Figs. 10 to 12, except 1."""
COPRIME = [(m, n) for n in range(1, 6) for m in range(1, 6) if math.gcd(m, n) == 1]
"""Pairs M, N in lowest terms."""
LONG = 20000
"""Number of cycles of an exponent that fewer cycles do not distinguish from 0."""
FALLS = np.round(np.arange(0.56, 0.8301, 0.01), 6)
RATIOS = np.round(np.arange(0.55, 1.0001, 0.005), 6)
"""mu_k/mu_s of the sweeps beside a jump and of Fig. 6."""
AT_036 = {FREQUENCY: 0.36 * OMEGA_N}


def actuated(ratio: float) -> dict[str, float]:
    """Return a row with Tsp/Tsm = 0.25 at omega_f = ratio omega, mu_k = mu_s, 150 rad/s."""
    return {"pressure.amplitude": 0.25 * PRESSURE, "pressure.frequency_ratio": ratio, FREQUENCY: 150.0}


def repeats(series: Floats) -> int:
    """Return the period of a series that repeats to 1e-5 of its spread or size; 0 for none up to 16."""
    size = 1e-5 * max(float(np.ptp(series)), 1e-3 * float(np.abs(series).max()))
    return next((p for p in range(1, 17) if float(np.abs(series[p:] - series[:-p]).max()) <= size), 0)


def covered_down_to(stretches: Sequence[StableSegment], start: float) -> float:
    """Return the value down to which stable motions of period one or two exist without a gap, from `start` on."""
    at, gap = start, 1e-6
    while lower := [s.low.value for s in stretches if s.period <= 2 and s.low.value < at - gap <= s.high.value]:
        at = min(lower)
    return at


class PeriodClaims(JumpClaims):
    """Measures of the claims on periods."""

    def actuation_periods(self) -> Measured:
        single = {f"{r:.3f}": self.motion(actuated(r)).period for r in MISMATCHED.values()}
        along = self.slipping_periods((10, 11))
        return Measured([*((p, denominator(actuated(r))) for p, r in zip(single.values(), MISMATCHED.values())),
                         *((period, [n]) for n, period in along.values())],
                        {"at 150 rad/s": single, "along": {name: period for name, (_, period) in along.items()}})

    def period_is_denominator(self) -> Measured:
        periods = {f"{m}/{n}": self.motion(actuated(m / n)).period for m, n in COPRIME}
        return Measured([(periods[f"{m}/{n}"], n) for m, n in COPRIME], {"periods": periods})

    def as_dual_excitation(self) -> Measured:
        pairs = {}
        for name, ratio in MISMATCHED.items():
            varying, n = self.motion(actuated(ratio)).period, denominator(actuated(ratio))
            # omega is the N-th harmonic of omega/N, and omega_f the M-th.
            amplitudes = np.zeros(max(round(ratio * n), n))
            amplitudes[n - 1] += 250.0
            amplitudes[round(ratio * n) - 1] += 0.25 * self.system({}).saturation_mean
            dual = self.motion({FREQUENCY: 150.0 / n, "engine.torque_amplitude": float(amplitudes[0]),
                                    "engine.harmonic_amplitudes": tuple(amplitudes[1:].tolist()),
                                    "engine.harmonic_phases": (0.0,) * (len(amplitudes) - 1)}).period
            # The torque repeats after at least N cycles of omega, whatever the response repeats after.
            pairs[f"{name}: varying load, two torques"] = [varying, dual * n]
        return Measured(list(pairs.values()), pairs)

    def proof_is_whole(self) -> Measured:
        falling, same = ({name: [p for p in periods if p > n and p % n == 0]
                          for name, (n, periods) in self.slipping_periods(numbers).items()}
                         for numbers in ((16, 17), (10, 11)))
        return Measured((not any(falling.values()), not any(same.values())), {"falling": falling, "same": same}, True)

    def slope_is_the_cause(self) -> Measured:
        parts = {str(n): self.figure(n).off_period() for n in (8, 10, 11, 13, 14, 15, 16, 17, 18)}
        same, falling = ([x for n, periods in parts.items() for x in periods
                          if (rows(int(n))[0][KINETIC] == STATIC) is constant] for constant in (True, False))
        return Measured((max(same) == 0.0 and min(falling) >= 0.1, max(same) < min(falling)), {"off": parts})

    def _long_runs(self) -> dict[float, Any]:
        """Return the last 64 of 650 cycles from (13) for 0.75 mu_s, by frequency ratio in steps of 0.009."""
        return {float(x): self.run(self.system(with_kinetic(0.75, {FREQUENCY: float(x) * OMEGA_N})),
                                       650).solved_cycles for x in FINER[::3]}

    def shows_in_both(self) -> Measured:
        periods = {x: [repeats(series[-64:]) for series in (cycles.section[:, 1], cycles.highest)]
                   for x, cycles in self._long_runs().items()}
        apart = [[x, *pair] for x, pair in periods.items() if pair[0] != pair[1]]
        share = 1.0 - len(apart) / len(periods)
        return Measured([share], {"part": share, "apart": apart})

    def section_varies_less(self) -> Measured:
        sections = [cycles.section[-64:] for cycles in self._long_runs().values()]
        variation = np.array([s.std(axis=0) / np.abs(s).mean(axis=0) for s in sections if repeats(s[:, 1]) != 1])
        share = float((variation[:, 1] < variation[:, 0]).mean()) if len(variation) else 1.0
        median = np.median(variation[:, :2], axis=0).tolist() if len(variation) else []
        return Measured([share], {"ratios": len(variation), "share": share, "median": median}, share != 1.0)

    def doubling_to_chaos(self) -> Measured:
        places = [x for x in self.jump_places(0.83) if abs(x - 0.20) <= self.limit("near")]
        place = (places[0] if places else 0.20) + 2e-3
        row = {FREQUENCY: place * OMEGA_N}
        periods = self.periods(self.curves([row], FALLS, over=KINETIC)[0])
        none = FALLS[periods == 0]
        diagnoses = dict[str, list[Any]]()
        for r in none[::-1][:6]:
            at = with_kinetic(float(r), row)
            exponent = self.motion(at, lyapunov=True).lyapunov
            if exponent is not None and exponent.diagnosis == "unresolved":
                exponent = self.exponent(at, 650, LONG)
            diagnoses[f"{r:g}"] = ["not solved"] if exponent is None else [
                exponent.diagnosis, exponent.low, exponent.high]
        wild = any(name in ("chaotic", "quasi-periodic") for name, *_ in diagnoses.values())
        return Measured((int(periods[-1]) == 2 and wild, len(none) > 0),
                        {"omega/omega_n": place, "period": int(periods[-1]), "none": none.tolist(), "found": diagnoses})

    def _periods_of_6(self, way: str) -> Any:
        """Return (n,) periods of a sweep of Fig. 6 over RATIOS."""
        return self.periods(self.curves([AT_036], RATIOS, over=KINETIC, direction=way)[0])

    def _highest(self, period: int, below: float) -> list[float | None]:
        """Return the highest mu_k/mu_s up to `below` with a period in Fig. 6, for each of WAYS."""
        return [max((float(x) for x in RATIOS[(self._periods_of_6(way) == period) & (below >= RATIOS)]),
                    default=None) for way in WAYS]

    def period_one_near_unity(self) -> Measured:
        near = self._periods_of_6("cold")[RATIOS >= 0.94]
        return Measured((bool((near == 1).all()),), {"periods": np.unique(near).tolist()})

    def period_two_from(self) -> Measured:
        ends = self._highest(2, 1.0)
        born = [s.high.value for s in self.stretches([AT_036], RATIOS, over=KINETIC)[0]
                if s.period == 2 and s.high.jumps]
        limit, falling = self.limit("near"), ends[WAYS.index("down")]
        near = any(abs(x - 0.92) <= limit for x in born)
        return Measured((falling is not None and abs(falling - 0.92) <= limit, near), {"born": born, "ends": ends},
                        near, self.motions("", AT_036, RATIOS, over=KINETIC))

    def aperiodic_from(self) -> Measured:
        highest = self._highest(0, 0.78)
        none = {float(x) for way in WAYS for x in RATIOS[self._periods_of_6(way) == 0]}
        end = covered_down_to(self.stretches([AT_036], RATIOS, over=KINETIC)[0], 1.0)
        below = any(end - 0.05 <= x <= end for x in none)
        near = any(x is not None and abs(x - 0.7) <= 0.05 for x in highest)
        return Measured((abs(end - 0.7) <= 0.05 and below, near), {"end": end, "highest": highest}, True)

    def three_motions(self) -> Measured:
        periods = {f"{r:g}": self.motion(with_kinetic(r, AT_036)).period for r in (0.94, 0.74, 0.64)}
        exponent = self.exponent(with_kinetic(0.64, AT_036), CYCLES, SECTION_CYCLES)  # As Fig. 7 shows it.
        same = list(periods.values()) == [1, 2, 0]
        words = f"{exponent.exponent:.1f} +- {0.5 * (exponent.high - exponent.low):.1f}"
        return Measured((same and exponent.diagnosis == "chaotic", same),
                        {"periods": periods, "exponent": words, "diagnosis": exponent.diagnosis})

    def more_with_steeper_law(self) -> Measured:
        figures = {str(n): self.figure(n) for n in (14, 15)}
        parts = {n: curves.parts(curves.periods == 0) for n, curves in figures.items()}
        changes = {n: (np.diff(curves.periods) != 0).sum(axis=1).tolist() for n, curves in figures.items()}
        more = sum(parts["15"]) > sum(parts["14"])
        return Measured((more and sum(changes["15"]) > sum(changes["14"]), more), {"parts": parts, "changes": changes})

    def half_frequency_aperiodic(self) -> Measured:
        cold, *others = (self.figure(16, [0], way) for way in WAYS)
        (row,), (slipping,) = cold.rows.values(), cold.slips
        none = [curve.periods[0] == 0 for curve in (cold, *others)]
        parts = [share_where(n, slipping) for n in none]
        return Measured((max(parts) >= self.most, max(parts) >= 0.5),
                        {"parts": parts, "some": share_where(np.any(none, axis=0), slipping),
                         "periodic": share_where(self.periodic_at(row, AXIS), slipping)}, max(parts) < self.most)

    def amplitude_aperiodic(self) -> Measured:
        none = (self.figure(18, [2, 3]).periods == 0).any(axis=0)
        return more_than_anywhere(lambda x: float(none[np.abs(AXIS - x) <= self.limit("near") + 1e-9].mean()),
                                  HIGHER_JUMPS, "part without a period near", {},
                                  "such motions are as frequent at other ratios")
