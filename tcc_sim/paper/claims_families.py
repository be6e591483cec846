"""The claims that one rule judges for several figures: a row names figure, curve, range and rule.

A row is a claim whose measure is a rule of this module with its figure, curve and range filled in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.model import pure_stick
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, plain
from tcc_sim.paper.criteria import Claim, Equal, Holds, Measured, Shares
from tcc_sim.paper.evidence import FREQUENCY, Evidence, T, Values, share_where, sticks
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.trajectory import Floats

AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
FINER = np.round(np.arange(0.05, 0.5001, 0.003), 6)
"""Ratios of Figs. 8 to 18, and of Fig. 4."""
LOW, HIGH = AXIS <= 0.29, (AXIS >= 0.31) & (AXIS <= 0.45)
"""Below and above the ratio 0.30 that the paper names."""
STICKING = np.round(np.arange(0.05, 0.2501, 0.001), 6)
"""Ratios among which pure stick ends for psi = 0."""
PARTED = 1e-3
"""Distance from a jump at which the motions on both sides are compared."""
JUMPING = f"a jump is a change of more than {T.jump:g} of the curve's maximum on a 1e-5 wide interval"
BESIDE = f"where a curve slips (above {T.slipping:g} rad/s)"
WITHIN_STICK = (f"lies from the lowest ratio that slips from (13) to the highest of 0.05 to 0.25 that sticks, widened "
                f"by {T.near:g} either way, with the smoothed law and with the set-valued one")
"""Between the two ratios motions of both kinds are met."""


def rows(number: int) -> list[Values]:
    """The scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


def maxima(evidence: Evidence, number: int) -> Floats:
    """(curves, frequencies) largest slip speeds."""
    return np.array([s.column("max_slip_speed") for s in evidence.curves(rows(number), AXIS)])


def means(found: Floats, where: np.ndarray) -> list[float]:
    """Each curve's mean over some frequencies, rad/s."""
    return [float(x) for x in found[:, where].mean(axis=1)]


def best(evidence: Evidence, found: Floats, curve: int, where: np.ndarray, sign: float = 1.0) -> float:
    """The part of the frequencies at which a curve is the lowest of all (sign -1: the highest), where any slips."""
    lowest = sign * found[curve] <= np.delete(sign * found, curve, axis=0).min(axis=0) + evidence.limit("shows")
    return share_where(lowest, where & (found.max(axis=0) > evidence.limit("slipping")))


def exceptions(evidence: Evidence, found: Floats, curve: int, where: np.ndarray) -> list[float]:
    """The frequency ratios at which a curve is not the lowest of all."""
    return [float(x) for x in AXIS[where & (found[curve] > np.delete(found, curve, axis=0).min(axis=0)
                                            + evidence.limit("shows"))]]


def denominator(row: Values) -> int:
    """N of omega_f = (M/N) omega in lowest terms, the period by (35)."""
    return Fraction(float(row.get("pressure.frequency_ratio", 1.0))).limit_denominator(12).denominator  # type: ignore[arg-type]


def slipping_periods(evidence: Evidence, numbers: Sequence[int]) -> dict[str, tuple[int, list[int]]]:
    """By curve N of (35), and the periods at its slipping ratios, 0 for none."""
    return {f"Fig. {n}, {plain(series.label)}": (denominator(row), sorted({int(p) for p in
                                                                           evidence.periods(sweep)[~sticks(sweep)]}))
            for n in numbers for series, row, sweep in zip(FIGURES[n].series, rows(n), evidence.curves(rows(n), AXIS))}


def only_period(evidence: Evidence, numbers: Sequence[int], why: str = "") -> Measured:
    """Judge whether the curves of figures have no other period than N of (35) where they slip."""
    found = slipping_periods(evidence, numbers)
    return Measured([(periods, [n] if periods else []) for n, periods in found.values()],
                    {"periods": {name: periods for name, (_, periods) in found.items()}},
                    why if any(periods not in ([n], []) for n, periods in found.values()) else "")


def no_jumps(evidence: Evidence, number: int, curves: slice, axis: Floats) -> Measured:
    """Judge whether curves from (13) have no jump."""
    found = {plain(s.label): [round(x, 4) for x, _ in evidence.jumps(s.values, axis)]
             for s in FIGURES[number].series[curves]}
    return Measured((not any(found.values()),), {"jumps (omega/omega_n)": found})


def stick_interval(evidence: Evidence, row: Values, axis: Floats = STICKING) -> list[float]:
    """The lowest ratio at which the clutch slips for good from (13), and the highest that sticks."""
    slips = evidence.slips(evidence.curves([row], axis)[0])
    return [float(axis[slips].min(initial=math.inf)), float(axis[~slips].max(initial=-math.inf))]


def by_law(number: int) -> dict[str, Values]:
    """The keys of a figure's curve for psi = 0 with the smoothed law and with the set-valued one."""
    return {law: {**rows(number)[0], "friction.law": law} for law in ("smoothed", "set_valued")}


def stick_below(evidence: Evidence, number: int, place: float) -> Measured:
    """Judge where stick ends for psi = 0, against the ratio in the text."""
    found = {law: stick_interval(evidence, row) for law, row in by_law(number).items()}
    lower = pure_stick.stick_limits(evidence.system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
    near = evidence.limit("near")
    return Measured([(low - near <= place <= high + near, True) for low, high in found.values()],
                    {**{f"lowest slip and highest stick, {law}": x for law, x in found.items()},
                     "end of stick by (10), whatever mu_k": None if lower is None else lower / OMEGA_N},
                    "between the lowest slip and the end of pure stick by (10) motions of both kinds exist")


def lowest(evidence: Evidence, number: int, of: slice, where: np.ndarray, sign: float = 1.0) -> Measured:
    """Judge whether the first of some curves is the lowest (sign -1: the highest) in a range, or is so in the mean."""
    found = maxima(evidence, number)[of]
    share, mean = best(evidence, found, 0, where, sign), [sign * x for x in means(found, where)]
    word = "lowest" if sign > 0.0 else "highest"
    return Measured((share >= evidence.most, mean[0] == min(mean)), {
        f"part at which it is the {word}": share,
        "mean maxima, in the order of the curves (rad/s)": means(found, where),
        **({"another curve is lower at": exceptions(evidence, found, 0, where)} if sign > 0.0 else {})},
        "" if share >= evidence.most else f"it is the {word} in the mean, but not at every ratio"
        if mean[0] == min(mean) else f"another curve is the {word} in the mean")


def ordered(evidence: Evidence, number: int, where: np.ndarray, sign: float) -> Measured:
    """Judge at which part of a range every curve is below the last one (sign -1: above it)."""
    found = maxima(evidence, number)
    share = share_where((sign * np.diff(found, axis=0) <= evidence.limit("shows")).all(axis=0),
                        where & (found.max(axis=0) > evidence.limit("slipping")))
    return Measured([share], {"part in order": share, "mean maxima, in the order of the curves (rad/s)":
                              means(found, where)})


def jumps_change_period(evidence: Evidence, curves: Mapping[str, Values], axis: Floats) -> Measured:
    """Judge at which part of the jumps from (13) the period changes."""
    found = {f"{name} at {x:.4f}": [evidence.motion({**row, FREQUENCY: (x + d) * OMEGA_N}).period
                                    for d in (-PARTED, PARTED)]
             for name, row in curves.items() for x, _ in evidence.jumps(row, axis)}
    share = float(np.mean([below != above for below, above in found.values()])) if found else 1.0
    return Measured([share], {"jumps": len(found), "part of them": share, "periods below and above": found},
                    "" if share == 1.0 else "elsewhere the period stays: the basin of (13) ends and both motions go "
                    "on, or the motion changes its size alone")


def _row(name: str, figure: str, where: str, sentence: str, criterion: Any, rule: Callable[..., Measured],
         *how: Any, fitted: bool = False) -> Claim:
    """A claim that a rule judges."""
    return Claim(figure, where, sentence, criterion, partial(_ruled, rule, how), name, fitted=fitted)


def _ruled(rule: Callable[..., Measured], how: tuple[Any, ...], evidence: StableMotions) -> Measured:
    """Judge by a rule."""
    return rule(evidence, *how)


def _lowest(range_: str, word: str = "lowest") -> Holds:
    """The criterion of `lowest`."""
    return Holds(f"at {1.0 - T.missing:g} or more of the ratios {range_} {BESIDE} its maximum from (13) is the {word} "
                 f"(within {T.shows:g} rad/s)", f"the mean of its maxima over these ratios is the {word}")


def _ordered(range_: str, word: str) -> Shares:
    """The criterion of `ordered`."""
    return Shares(f"ratios {range_} {BESIDE} at which the maxima {word} with every Tsp (within {T.shows:g} rad/s)")


ONLY = Equal("every curve has only the period N of (35) at its slipping ratios from 0.05 to 0.5")
SMOOTH = Holds(f"no jump; {JUMPING}")
CHANGES = Shares(f"jumps from (13) ({JUMPING}) with different periods 0.001 below and above", 0.5)
ALL, TO_LOW, TO_HIGH = slice(None), "to 0.29", "from 0.31 to 0.45"
ROWS: tuple[Claim, ...] = (
    _row("smooth_when_equal", "4", "5, Fig. 4(a)", "the map is a smooth curve for mu_k = mu_s", SMOOTH, no_jumps, 4,
         slice(1), FINER),
    _row("jump_is_bifurcation", "4", "5, Fig. 4(b)", "a jump in the maximum yields a bifurcation point: a change in "
         "the orbit diagram", CHANGES, jumps_change_period,
         {plain(s.label): s.values for s in FIGURES[4].series[1:]}, FINER),
    _row("phase_attenuates", "8", "6.1, Fig. 8", "psi = 0 attenuates slip best below about 0.30", _lowest(TO_LOW),
         lowest, 8, ALL, LOW),
    _row("phase_attenuates_least", "8", "6.1, Fig. 8", "above about 0.30 psi = 0 attenuates slip least",
         _lowest(TO_HIGH, "highest"), lowest, 8, ALL, HIGH, -1.0),
    _row("phase_bifurcations", "8", "6.1, Fig. 8(b)", "no bifurcations for mu_k = mu_s and any phase", ONLY,
         only_period, (8,)),
    _row("phase_jumps", "8", "6.1, Fig. 8(a)", "the curves are smooth for mu_k = mu_s and any phase: no jumps", SMOOTH,
         no_jumps, 8, ALL, AXIS),
    _row("stick_below_018", "8", "6.1; 6.2", "psi = 0: pure stick below 0.18", Equal("0.18 " + WITHIN_STICK),
         stick_below, 8, 0.18, fitted=True),
    _row("actuation_bifurcations", "10, 11", "6.1, after (29)", "no bifurcations for mu_k = mu_s and any omega_f", ONLY,
         only_period, (10, 11)),
    _row("amplitude_attenuates", "13", "6.1, Fig. 13", "a larger Tsp attenuates more at low frequency",
         _ordered(TO_LOW, "fall"), ordered, 13, LOW, 1.0),
    _row("amplitude_reversed", "13", "6.1, Fig. 13", "a larger Tsp attenuates less at high frequency",
         _ordered(TO_HIGH, "rise"), ordered, 13, HIGH, -1.0),
    _row("amplitude_bifurcations", "13", "6.1, Fig. 13", "no bifurcations for mu_k = mu_s and any Tsp", ONLY,
         only_period, (13,)),
    _row("phase_with_falling_law", "14", "6.2, Fig. 14(a)", "mu_k = 0.75 mu_s: psi = 0 attenuates best at low "
         "frequency", _lowest(TO_LOW), lowest, 14, ALL, LOW),
    _row("stick_below_015", "14", "6.2, after Fig. 14", "psi = 0: pure stick below 0.15",
         Equal("0.15 " + WITHIN_STICK), stick_below, 14, 0.15, fitted=True),
    _row("jumps_lose_stability", "14", "6.2, after Fig. 14", "jumps indicate a loss of stability, and bifurcations are "
         "found in Fig. 14(b)", CHANGES, jumps_change_period,
         {plain(s.label): s.values for s in FIGURES[14].series}, AXIS),
    _row("phase_with_steeper_law", "15", "6.2, Fig. 15(a)", "mu_k = 0.67 mu_s: psi = 0 attenuates best at low "
         "frequency", _lowest(TO_LOW), lowest, 15, ALL, LOW),
    _row("same_frequency_suppresses", "16", "6.2, Fig. 16(a)", "at lower frequency omega_f = omega suppresses slip "
         "better than omega_f = 2 omega", _lowest(TO_LOW), lowest, 16, slice(1, None), LOW),
    _row("period_for_any", "(35)", "6.1, (35); 6.2", "(35) has no condition on mu_k: it holds for mu_k < mu_s too",
         ONLY, only_period, (16, 17), "a falling friction law brings doublings and aperiodic motions of its own"),
)
"""Every claim that a rule judges."""
