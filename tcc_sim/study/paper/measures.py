"""Measures of the paper's claims: functions of the evidence, named by claims.yaml with figure, curves and range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from tcc_sim.analysis.steady.damping import slope_of_friction
from tcc_sim.analysis.steady.summary import periodicity
from tcc_sim.errors import NumericalFailure, counted
from tcc_sim.model import closed_forms, friction
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.comparison import rk4_limit
from tcc_sim.study.continuation.branch import StableSegment
from tcc_sim.study.paper import harmonic_balance
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, PRESSURE, SECTION_CYCLES, STATIC, paper_system, plain
from tcc_sim.study.paper.evidence import (
    CYCLES,
    DISCARD,
    FREQUENCY,
    KINETIC,
    SMOOTHING,
    Evidence,
    Motion,
    T,
    Values,
    first_half,
    rms_apart,
    steep,
    two_digits,
    with_kinetic,
)
from tcc_sim.sweeps.simulation import DIRECTIONS
from tcc_sim.sweeps.sweep import Sweep
from tcc_sim.trajectory import Floats


def rows(number: int) -> list[Values]:
    """Return the scene keys of a figure's curves."""
    return [series.values for series in FIGURES[number].series]


AXIS = np.round(np.arange(0.05, 0.5001, 0.005), 6)
FINER = np.round(np.arange(0.05, 0.5001, 0.003), 6)
"""Frequency ratios of Figs. 8 to 18, and of Fig. 4."""
BANDS = {"to 0.29": AXIS <= 0.29, "from 0.31 to 0.45": (AXIS >= 0.31) & (AXIS <= 0.45)}
LOW, HIGH = BANDS.values()
"""Below and above the ratio 0.30 that the paper names."""
SPREAD = np.round(np.arange(0.14, 0.3601, 1e-3), 6)
"""Frequency ratios around those of the text; their average is the base rate for nearness to a named ratio."""
PARTED = 1e-3
"""Distance from a jump for comparing the motions on both sides."""
WIDE = 2.0 * T.near
LAWS = ("smoothed", "set_valued")
STICKY = {"constant load": {}, **{f"Tsp/Tsm = 0.25, {plain(s.label)}": s.values for s in FIGURES[8].series}}
"""Loads for the comparison of stick with (10)."""
SLIPS = 1e-3
"""Largest slip speed, rad/s, of a motion that starts in stick and counts as stick."""
INERTIAS: dict[str, Values] = {
    "Table 1": {}, "I1 = 0.1": {"driveline.flywheel_inertia": 0.1}, "I1 = 0.4": {"driveline.flywheel_inertia": 0.4},
    "I2 = 0.04": {"driveline.plate_inertia": 0.04}}
MAPS = dict(zip(("1", "0.83", "0.75", "0.667"), rows(4)))
FALLING = {ratio: row for ratio, row in MAPS.items() if ratio != "1"}
"""Rows of Fig. 4, and those of mu_k < mu_s, by mu_k/mu_s."""
ACTUATED = {f"{row['pressure.frequency_ratio']:.3f}": row for n in (10, 11) for row in rows(n)}
"""Rows of Figs. 10 and 11, by omega_f/omega."""
NAMED = {f"{m:.3f}": m for m in FIGURES[4].marks}
"""omega/omega_n of the super-harmonic peaks that the paper names (0.167, 0.20, 0.25, 0.33)."""
HIGHER_JUMPS = {"0.25": 0.25, "0.35": 0.35}
"""Frequency ratios near which the text of Fig. 18 states jumps and aperiodic motions."""
MISMATCHED = {"1/2": 0.5, "2/1": 2.0, "2/3": 2.0 / 3.0, "4/3": 4.0 / 3.0}
"""M/N = omega_f/omega of Figs. 10 to 12, except 1."""
COPRIME = [(m, n) for n in range(1, 6) for m in range(1, 6) if math.gcd(m, n) == 1]
"""Pairs M, N in lowest terms."""
RATIOS = np.round(np.arange(0.55, 1.0001, 0.005), 6)
"""mu_k/mu_s of Fig. 6."""
AT_036 = {FREQUENCY: 0.36 * OMEGA_N}
HARMONICS = 40
"""Harmonics of omega in the series."""
FIG02: Values = FIGURES[2].series[0].values
OF_FIG_2: dict[str, dict[str, Any]] = {
    "smoothed, sigma = 50": {}, "smoothed, sigma = 1000": {SMOOTHING: 1000.0},
    "set-valued (6)": {"friction.law": "set_valued"}}
DAMPED = np.round(np.arange(0.08, 0.3001, 0.002), 6)
READ_AT = (0.12, 0.20, 0.25)
"""Frequency ratios of (21), and those at which readings of it are listed."""


@dataclass(frozen=True)
class Measured:
    """Quantities that the criterion judges, values for the reader, a reason, and the stable motions that coexist.

    why : the reason, or whether that of claims.yaml applies
    """

    judged: Sequence[Any]
    values: Mapping[str, Any]
    why: str | bool = False
    motions: Sequence[Motion] = ()


@dataclass(frozen=True)
class Curves:
    """Curves of a figure over omega/omega_n.

    rows : scene keys by label
    sweeps : sweep of every curve
    maxima, slips : (curves, ratios) largest slip speeds, rad/s, and whether the motion is not pure stick
    """

    evidence: Evidence
    rows: Mapping[str, Values]
    axis: Floats
    sweeps: Sequence[Sweep]
    maxima: Floats
    slips: Any

    @cached_property
    def periods(self) -> Any:
        """(curves, ratios) periods of the settled motions, 0 for none."""
        return np.array([self.evidence.periods(sweep) for sweep in self.sweeps])

    def parts(self, condition: Any) -> list[float]:
        """Return for every curve the part of its slipping ratios at which a condition holds."""
        return [share_where(held, slips) for held, slips in zip(condition, self.slips)]

    def off_period(self) -> list[float]:
        """Return for every curve the part of its slipping ratios at which the period is not that of (35)."""
        return self.parts([periods != denominator(row) for periods, row in zip(self.periods, self.rows.values())])

    def means(self, where: Any) -> list[float]:
        """Return the mean of every curve's maxima over some ratios, rad/s."""
        return [float(x) for x in self.maxima[:, where].mean(axis=1)]

    def best(self, curve: int, where: Any, sign: float = 1.0) -> float:
        """Return the part of the ratios at which a curve is the lowest (sign -1: the highest), if any slips."""
        rest = np.delete(sign * self.maxima, curve, axis=0).min(axis=0)
        return share_where(sign * self.maxima[curve] <= rest + self.evidence.limit("shows"), where & self.any_slips())

    def any_slips(self) -> Any:
        """Return (ratios,) whether the maximum of some curve counts as slip."""
        return self.maxima.max(axis=0) > self.evidence.limit("slipping")

    def exceptions(self, curve: int, where: Any) -> list[float]:
        """Return the ratios at which a curve is not the lowest."""
        rest = np.delete(self.maxima, curve, axis=0).min(axis=0) + self.evidence.limit("shows")
        return [float(x) for x in self.axis[where & (self.maxima[curve] > rest)]]

    def jumps(self) -> list[tuple[str, Values, float, float]]:
        """Return label, row, ratio and size of every true jump from (13)."""
        return [(name, row, *jump) for name, row in self.rows.items() for jump in self.evidence.jumps(row, self.axis)]


def grow(numbers: Sequence[float]) -> bool:
    """Return whether every number is larger than the one before."""
    return all(b > a for a, b in pairwise(numbers))


def denominator(row: Values) -> int:
    """Return N of omega_f = (M/N) omega in lowest terms, the period by (35)."""
    return common_cycles(paper_system(row))


def more_than_anywhere(count: Callable[[float], float], marks: Mapping[str, float], name: str,
                       values: Mapping[str, Any], why: str, motions: Sequence[Motion] = ()) -> Measured:
    """Judge whether a count is larger near each named ratio than on average near the ratios of SPREAD; else `why`."""
    anywhere = float(np.mean([count(float(x)) for x in SPREAD]))
    near = {key: count(mark) for key, mark in marks.items()}
    fewer = [key for key, value in near.items() if value <= anywhere]
    return Measured([(value > anywhere, True) for value in near.values()],
                    {name: near, "near any ratio, on average": anywhere, **values},
                    why.format(", ".join(fewer)) if fewer else "", motions)


def place_of_change(holds: Callable[[float], bool], low: float, high: float, halvings: int) -> float | None:
    """Return the middle of the interval in which a condition changes, after some halvings; None if both ends are alike.
    """
    first = holds(low)
    if holds(high) == first:
        return None
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) == first else (low, middle)
    return 0.5 * (low + high)


def figure_curves(e: Evidence, number: int, chosen: Sequence[int] = (), way: str = "cold") -> Curves:
    """Return the curves of a figure, or only the `chosen` ones; each value starts from (13), or as `way` says."""
    series, axis = FIGURES[number].series, FINER if number == 4 else AXIS
    rows = {plain(series[k].label): series[k].values for k in chosen or range(len(series))}
    sweeps = e.curves(list(rows.values()), axis, direction=way)
    return Curves(e, rows, axis, sweeps, np.array([sweep.column("max_slip_speed") for sweep in sweeps]),
                  ~np.array([sticks(sweep) for sweep in sweeps]))


def lowest(e: Evidence, number: int, band: str, word: str = "lowest", chosen: Sequence[int] = ()) -> Measured:
    """Judge whether the first curve is the lowest or `highest` at most ratios, or is so in the mean."""
    curves, where, sign = figure_curves(e, number, chosen), BANDS[band], 1.0 if word == "lowest" else -1.0
    share, mean = curves.best(0, where, sign), curves.means(where)
    most, on_average = share >= e.most, sign * mean[0] == min(sign * x for x in mean)
    return Measured((most, on_average), {
        "share": share, "mean": mean, **({"beaten": curves.exceptions(0, where)} if word == "lowest" else {})},
        "" if most else f"it is the {word} in the mean, but not at every ratio" if on_average else
        f"another curve is the {word} in the mean")


def ordered(e: Evidence, number: int, band: str, word: str) -> Measured:
    """Judge at which part of a range the maxima `fall` or `rise` from every curve to the next."""
    curves, where, sign = figure_curves(e, number), BANDS[band], 1.0 if word == "fall" else -1.0
    share = share_where((sign * np.diff(curves.maxima, axis=0) <= e.limit("shows")).all(axis=0),
                        where & curves.any_slips())
    return Measured([share], {"part in order": share, "mean": curves.means(where)})


def no_jumps(e: Evidence, number: int, chosen: Sequence[int] = ()) -> Measured:
    """Judge whether curves from (13) have no jump."""
    curves = figure_curves(e, number, chosen)
    jumps = {name: [round(x, 4) for x, _ in e.jumps(row, curves.axis)] for name, row in curves.rows.items()}
    return Measured((not any(jumps.values()),), {"jumps": jumps})


def jumps_change_period(e: Evidence, number: int, chosen: Sequence[int] = ()) -> Measured:
    """Judge at which part of the jumps from (13) the period changes."""
    periods = {f"{name} at {x:.4f}": [m.period for m in e.motions_near(row, x, -PARTED, PARTED)]
               for name, row, x, _ in figure_curves(e, number, chosen).jumps()}
    share = float(np.mean([below != above for below, above in periods.values()])) if periods else 1.0
    return Measured([share], {"jumps": len(periods), "share": share, "periods": periods}, share != 1.0)


def slipping_periods(e: Evidence, numbers: Sequence[int]) -> dict[str, tuple[int, list[int]]]:
    """Return N of (35) and the periods at the slipping ratios, 0 for none, by curve."""
    return {f"Fig. {n}, {name}": (denominator(row), np.unique(periods[slips]).tolist())
            for n, curves in zip(numbers, (figure_curves(e, n) for n in numbers))
            for (name, row), periods, slips in zip(curves.rows.items(), curves.periods, curves.slips)}


def only_period(e: Evidence, numbers: Sequence[int]) -> Measured:
    """Judge whether the curves of figures have no other period than N of (35) where they slip."""
    slipping = slipping_periods(e, numbers)
    return Measured([(periods, [n] if periods else []) for n, periods in slipping.values()],
                    {"periods": {name: periods for name, (_, periods) in slipping.items()}},
                    any(periods not in ([n], []) for n, periods in slipping.values()))


def share_where(condition: Any, among: Any) -> float:
    """Return the part of the cases `among` in which `condition` holds; 1 if there are none."""
    return float(condition[among].mean()) if among.any() else 1.0


def sticks(sweep: Sweep) -> NDArray[np.bool_]:
    """Return (n,) whether the motion is pure stick."""
    return np.array([p is not None and p.summary is not None and p.summary.regime == "stick" for p in sweep.points])


def about(place: float, width: float = T.near, count: int = 15) -> Floats:
    """Return frequency ratios of branches around a ratio that the text names."""
    return np.round(np.linspace(place - width, place + width, count), 6)


def nearest(places: Sequence[float], mark: float) -> float | None:
    """Return the place nearest to a mark."""
    return min(places, key=lambda x: abs(x - mark), default=None)


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
    return {system.friction_ratio: (system.friction.smoothing, system.friction.stribeck)
            for system in map(paper_system, rows(3))}


def solvers_agree(e: Evidence, watched: Sequence[int]) -> Measured:
    differences = cycle_differences((("rk45", "smoothed", None), ("bdf", "smoothed", None),
                                     ("event_driven", "set_valued", None)))
    paper, doubled = {}, {}
    for name in ("smoothed, sigma = 50", "set-valued (6)"):
        highest = e.run(e.system({**FIG02, **OF_FIG_2[name]}), 1000).solved_cycles.largest
        kept = highest[DISCARD:CYCLES]
        paper[name] = [float(kept.min()), float(kept.mean()), float(kept.max())]
        doubled[name] = [float(abs(highest[n] - highest[n + 1])) for n in watched]
    motions = {name: e.attractors({**FIG02, **row}) for name, row in OF_FIG_2.items()}
    limit = e.limit("alike")
    alike = len(set(map(len, motions.values()))) == 1 and not attractors_differ(*motions.values(), limit=limit)
    means = [mean for _, mean, _ in paper.values()]
    followed = e.motions({"": FIG02}, np.round(np.geomspace(50.0, 1000.0, 12), 3), over=SMOOTHING)
    close = max(differences.values()) < limit and max(means) - min(means) < limit * max(means)
    return Measured(
        (close and alike, close), {"differences": differences, "paper": paper, "doubled": doubled, "attractors": {
            n: [list(a) for a in m] for n, m in motions.items()}},
        "over the paper's cycles they agree; the discontinuous solution doubles its period later, and " +
        ("the laws have the same motions" if alike else "at sigma = 50 s/rad a motion of period one is stable that "
         "is unstable at larger sigma"), followed)


def smoothing_is_uncertain(e: Evidence) -> Measured:
    errors = {}
    for name, row in {**{f"sigma = {s:g}": {SMOOTHING: s} for s in (50.0, 100.0, 1000.0)},
                      "law (6)": OF_FIG_2["set-valued (6)"]}.items():
        cycles = e.run(e.system({**FIG02, **row}), 2000).solved_cycles[-96:]
        errors[name] = (periodicity(cycles).period, float(cycles.largest.max()))
    *smoothed, exact = ([motion] for motion in errors.values())
    apart = [attractors_differ(exact, m, limit=e.limit("alike")) for m in smoothed]
    return Measured((any(apart) and not apart[-1],), {"found": {name: list(m) for name, m in errors.items()}})


def discontinuous_is_slow(e: Evidence, times: float) -> Measured:
    exact, smoothed = (min(e.run(e.system({**FIG02, "friction.law": law}), CYCLES).statistics.seconds
                           for _ in range(5)) for law in ("set_valued", "smoothed"))
    slow = exact > times * smoothed
    return Measured((slow,), {"slow": slow}, not slow)


def classical_differs(e: Evidence, least: float) -> Measured:
    differences = cycle_differences(tuple((f"rk4, step {h:g} s", "smoothed", h) for h in (1e-6, 2e-5, 5e-5, 1e-4)))
    apart = [d > least for d in differences.values()]
    return Measured((all(apart), any(apart)), {name: float(f"{d:.0e}") for name, d in differences.items()},
                    f"the step is not printed: within the stability limit, "
                    f"{rk4_limit(paper_system(FIG02)) * 1e6:.2g} us, RK4 agrees, beyond it stick rings")


def maximum_falls(e: Evidence) -> Measured:
    parts = {f"{1.0 / r:g}": friction.peak(*law)[1] / r for r, law in _laws_of_fig_3().items()}
    del parts["1"]
    changes = list(parts.values())
    return Measured((max(changes) < 1.0 and changes == sorted(changes, reverse=True),), {"parts": parts})


def slope_turns_negative(e: Evidence) -> Measured:
    v = np.linspace(1e-4, 1.0, 20001)
    lowest = {f"{1.0 / r:g}": float(friction.smoothed_and_slope(v, *law)[1].min())
              for r, law in _laws_of_fig_3().items()}
    slopes = list(lowest.values())
    return Measured((slopes[0] >= 0.0 and slopes[1] < 0.0 and slopes == sorted(slopes, reverse=True),),
                    {"lowest": lowest})


def damping_crosses(e: Evidence) -> Measured:
    sweep = e.curves([with_kinetic(0.667)], DAMPED, damping=True)[0]
    printed, negative = sweep.column("equivalent_damping"), sweep.column("negative_slope_mean")
    changes, limit = np.flatnonzero(np.diff(e.periods(sweep)) != 0), -paper_system().driveline.damping
    middles = 0.5 * (DAMPED[1:] + DAMPED[:-1])
    at = {name: [round(float(x), 4) for x in middles[np.diff(values < limit)]]
          for name, values in (("printed", printed), ("negative", negative))}
    hit = {name: sum(bool(len(changes)) and float(np.abs(DAMPED[changes] - x).min()) <= 0.005 for x in damping)
           for name, damping in at.items()}
    values = {"cf": [float(np.nanmin(printed)), float(np.nanmax(printed))],
              "read": [two_digits(np.interp(x, DAMPED, negative)) for x in READ_AT], **at,
              "hit": hit["negative"], "changes": len(changes), "below": float((negative < limit).mean()),
              "other": other_readings(e)}
    return Measured((bool(at["printed"]) and hit["printed"] == len(at["printed"]),), values, True)


def other_readings(e: Evidence) -> dict[str, list[float]]:
    """Return dT/dv averaged with other weights: none, |v|, and the square of the fluctuation; N m s/rad."""
    out: dict[str, list[float]] = {"no weight": [], "|v|": [], "(v - mean v)^2": [], "v^2 outside stick": []}
    for ratio in READ_AT:
        system = e.system(with_kinetic(0.667, {FREQUENCY: ratio * OMEGA_N}))
        before = solve(system, cycles=100).raise_for_status()
        run = solve(system, cycles=16, samples_per_cycle=8192, start_cycle=100, state=before.final)
        slope, v = slope_of_friction(run), run.slip_speed
        weights = (np.ones_like(v), np.abs(v), (v - v.mean()) ** 2, np.where(run.state != 0, v * v, 0.0))
        for name, weight in zip(out, weights):
            out[name].append(two_digits((slope * weight).sum() / weight.sum()))
    return out


def damping_falls(e: Evidence) -> Measured:
    sweeps, printed = e.curves(rows(4), DAMPED, damping=True), "(21) as printed"
    readings = {name: np.array([s.column(column) for s in sweeps]) for name, column in (
        (printed, "equivalent_damping"), ("time mean of the negative slope", "negative_slope_mean"))}
    falls = {name: float((np.diff(damping, axis=0) < 0.0).all(axis=0).mean()) for name, damping in readings.items()}
    medians = {name: [float(np.nanmedian(row)) for row in damping] for name, damping in readings.items()}
    return Measured((falls[printed] >= e.most, grow(medians[printed][::-1])),
                    {"falls": falls, "medians": medians}, True)


def balance_unsuitable(e: Evidence) -> Measured:
    off = {name: x if isinstance(x, str) else x["rms difference of the corrected series"]
           for name, x in series_balance(e).values.items()}
    failed = any(isinstance(x, str) or x > e.limit("alike") for x in off.values())
    return Measured((failed,), {"rms difference": off}, not failed)


def series_balance(e: Evidence) -> Measured:
    values: dict[str, Any] = {}
    close, short = [], []
    for name, ratio in MISMATCHED.items():
        row = actuated(ratio)
        system, period = e.system(row), denominator(row)
        try:
            balance = harmonic_balance.harmonic_balance(system, period, HARMONICS * period)
        except NumericalFailure as failure:
            values[name] = str(failure)
            close.append(False)
            continue
        run = e.last_cycles(row, period, 400)
        off = rms_apart(balance.slip_speed(run.t), run.slip_speed)
        printed, corrected = (harmonic_balance.mean_friction_torque(system, balance.coefficient, period, printed=p)
                              for p in (True, False))
        values[name] = {"rms difference of the corrected series": off, "a0 (rad/s)": float(balance.slip[0]),
                        "mean friction torque, corrected": corrected, "as printed (N m)": printed}
        close.append(off < e.limit("alike"))
        short.append(abs(printed - 300.0) > 1.0)
    return Measured((all(close) and not any(short),), values,
                    "as printed the friction torque's mean is at most (2/pi) Tp = 159 N m; with mean terms the "
                    "series agrees" if all(close) else
                    "Newton's method did not end, or the series is another motion")


def fifty_suffice(e: Evidence) -> Measured:
    settled_by = {str(n): [float((sweep.column("settled") == 1.0).mean()) for sweep in e.curves(rows(n), AXIS)]
                  for n in (4, 8, 10, 11, *range(13, 19))}
    parts = [x for row in settled_by.values() for x in row]
    return Measured(parts, {"settled part, by figure and curve": settled_by},
                    f"{100.0 * (1.0 - max(parts)):.0f} to "
                    f"{100.0 * (1.0 - min(parts)):.0f} % of the points of a curve have not settled by then")


def curves_near_named(e: Evidence, places: Sequence[Any], values: dict[str, Any],
                      motions: Sequence[Motion] = ()) -> Measured:
    """Judge whether more curves have one of their places near each super-harmonic than near any ratio."""
    def count(x: float) -> int:
        return sum(bool((np.abs(np.array(row) - x) <= e.limit("near")).any()) for row in places)

    return more_than_anywhere(count, NAMED, "curves of nine near", values,
                              "near {} there are no more of them than near any ratio", motions)


def jump_places(e: Evidence, ratio: str) -> list[float]:
    """Return the ratios omega/omega_n of the jumps of the map of one mu_k/mu_s from (13)."""
    return [round(x, 4) for x, _ in e.jumps(MAPS[ratio], FINER)]


def prominent_maxima(e: Evidence, axis: Floats, values: Floats) -> list[float]:
    """Return the places of the local maxima that stand out on either side within five values."""
    least, reach = e.limit("prominent") * float(np.nanmax(values)), 5
    return [float(axis[k]) for k in range(1, len(values) - 1)
            if values[k] == np.nanmax(values[max(k - reach, 0):k + reach + 1])
            and values[k] - np.nanmin(values[max(k - reach, 0):k]) > least
            and values[k] - np.nanmin(values[k + 1:k + reach + 1]) > least]


def peaks_of(e: Evidence, way: str = "cold") -> dict[str, list[float]]:
    """Return the prominent maxima of Fig. 4 for every mu_k/mu_s, omega/omega_n."""
    return {r: prominent_maxima(e, FINER, values) for r, values in zip(MAPS, figure_curves(e, 4, way=way).maxima)}


def super_harmonic_peaks(e: Evidence) -> Measured:
    peaks = [peaks_of(e, way) for way in DIRECTIONS]
    return curves_near_named(e, [peak[r] for peak in peaks for r in FALLING], {"peaks": peaks})


def super_harmonic_jumps(e: Evidence) -> Measured:
    both, left, motions = list[list[float]](), list[float](), list[Motion]()
    # Sweeps over so wide a range reach the motions that end there.
    axes = [about(mark, WIDE, 21) for mark in NAMED.values()]
    for r, row in FALLING.items():
        ends = [end for axis in axes for end in e.jump_ends(row, axis)]
        for way in DIRECTIONS:
            values = e.maxima([row], FINER, direction=way)[0]
            steps = [0.5 * (FINER[k] + FINER[k + 1]) for k in steep(values, e.limit("jump"))]
            met = [x for x in ends if any(abs(x - step) <= e.limit("ends") for step in steps)]
            both.append([x for x in prominent_maxima(e, FINER, values)
                         if any(abs(x - end) <= e.limit("close") for end in met)])
            left += met
        motions += [m for axis in axes for m in e.motions({f"mu_k = {r} mu_s": row}, axis)
                    if any(end.jumps and end.value in left for end in (m.stretch.low, m.stretch.high))]
    return curves_near_named(e, both, {
        "nearest end in a jump": {name: nearest(left, m) for name, m in NAMED.items()},
        "jumps from (13)": {r: jump_places(e, r) for r in FALLING}}, motions)


def peaks_move(e: Evidence) -> Measured:
    peaks = peaks_of(e)
    chains = [[x] for x in peaks["1"] if x > 0.15]
    for r in FALLING:
        for chain in chains:
            x = nearest(peaks[r], chain[-1])
            chain += [x] if x is not None and abs(x - chain[-1]) <= e.limit("near") else []
    rising = [len(c) > len(FALLING) and c == sorted(c) and c[-1] > c[0] for c in chains]
    return Measured((bool(rising) and all(rising), any(rising)), {"followed": chains, "peaks": peaks},
                    "" if all(rising) else f"{sum(rising)} of {counted(len(chains), 'peak')} shift up")


def lost_at_peaks(e: Evidence, least: float) -> Measured:
    peaks, close = peaks_of(e), e.limit("close")
    near, covered = list[bool](), list[float]()
    for r in FALLING:
        row = np.array(peaks[r])
        near += [bool((np.abs(row - x) <= close).any()) for x in jump_places(e, r)]
        covered.append(float((np.abs(FINER[FINER > 0.12, None] - row) <= close).any(axis=1).mean()))
    share = float(np.mean(near)) if near else 0.0
    return Measured((share >= least, share > max(covered)), {"jumps": len(near), "share": share, "covered": covered},
                    least > share > max(covered))


def jump_doubles_period(e: Evidence) -> Measured:
    periods = {f"{x:.4f}": [m.period for m in e.motions_near(MAPS["0.83"], x, -2e-3, 2e-3)]
               for x in jump_places(e, "0.83") if abs(x - 0.20) <= e.limit("near")}
    return Measured(([1, 2] in periods.values(),), {"periods around": periods})


def new_peaks(e: Evidence) -> Measured:
    counts = [[len(prominent_maxima(e, AXIS[LOW], row[LOW])) for row in figure_curves(e, n).maxima] for n in (8, 14)]
    fewer = [name for name, a, b in zip(("0", "pi/2", "pi"), *counts) if b <= a]
    return Measured((not fewer, len(fewer) < 3), {"peaks": counts},
                    f"psi = {', '.join(fewer)} has no more peaks" if fewer else "")


def jump_to_chaos(e: Evidence) -> Measured:
    row, near, jump = rows(14)[0], about(0.35), e.limit("jump")
    ends = [x for x in e.jump_ends(row, near) if abs(x - 0.35) <= e.limit("near")]
    rises = [float(0.5 * (AXIS[k] + AXIS[k + 1])) for k in steep(e.maxima([row], AXIS)[0], jump)]
    values: dict[str, Any] = {"stable motions end in a jump at": ends, "steep rises": rises}
    whole, part = False, False
    for x in ends or [x for x in rises if abs(x - 0.35) <= e.limit("near")]:
        below = e.motions_near(row, x, -5e-3)[0].period
        above = e.motions_near(row, x, 5e-3, 1e-2, 2e-2, lyapunov=True)
        values[f"period below {x:.4f}"] = below
        values[f"above {x:.4f}: period, exponent's interval (1/s), diagnosis"] = [
            [m.period] + ([] if (y := m.lyapunov) is None else [y.low, y.high, y.diagnosis]) for m in above]
        chaotic = any(m.lyapunov is not None and m.lyapunov.diagnosis == "chaotic" for m in above)
        whole |= bool(ends) and below > 0 and chaotic
        part |= below > 0 and any(m.period == 0 for m in above)
    return Measured((whole, part), values, not ends, e.motions({"psi = 0": row}, near))


def severity_follows_abruptness(e: Evidence, linked: float, loose: float) -> Measured:
    jumps = [(abs(size), e.motions_near(row, x, -PARTED, PARTED))
             for _, row, x, size in figure_curves(e, 14).jumps()]
    severity = [max(float(m.period) or 17.0 for m in motions) for _, motions in jumps]
    sizes, largest = [size for size, _ in jumps], [max(m.largest for m in motions) for _, motions in jumps]
    abrupt, large = (float(spearmanr(severity, x).statistic) if len(set(severity)) > 1 and len(set(x)) > 1 else 0.0
                     for x in (sizes, largest))
    return Measured((abrupt > linked and abrupt > large, abrupt > loose),
                    {"jumps": len(severity), "abrupt": abrupt, "large": large}, abrupt <= linked)


def phase_pi_is_smooth(e: Evidence) -> Measured:
    curve = figure_curves(e, 14, [2])
    row, = curve.rows.values()
    periods, jumps = curve.periods[0], [x for _, _, x, _ in curve.jumps()]
    motions = [m for place in jumps for m in e.motions({"psi = pi": row}, about(place, 0.01))]
    met = [end for m in motions if m.from_start for end in (m.stretch.low, m.stretch.high) if end.kind]
    share = float((periods == 1).mean())
    smooth = share == 1.0 and not jumps
    return Measured((smooth, not met and share > 0.5),
                    {"share": share, "periods": np.unique(periods).tolist(), "jumps": [round(x, 4) for x in jumps],
                     "met": [[end.kind, end.value] for end in met]}, not smooth, motions)


def half_frequency_jumps(e: Evidence) -> Measured:
    counts = [len(steep(values, e.limit("jump"))) for values in figure_curves(e, 16).maxima]
    return Measured((counts[0] > max(counts[1:]), counts[0] > min(counts[1:])), {"changes": counts})


def amplitude_enlarges_jumps(e: Evidence) -> Measured:
    jumps = [max((abs(size) for x, size in e.jumps(row, AXIS)
                  if any(abs(x - mark) <= 2.0 * e.limit("near") for mark in HIGHER_JUMPS.values())), default=0.0)
             for row in rows(18)]
    return Measured((grow(jumps), jumps[-1] > jumps[0]), {"jumps": jumps}, jumps[-1] < jumps[0])


def amplitude_jumps(e: Evidence) -> Measured:
    curves = {f"Tsp/Tsm = {x:g}": row for x, row in zip((0.25, 0.5), rows(18)[2:])}
    jumps, motions = dict[str, list[float]](), list[Motion]()
    for name, mark in HIGHER_JUMPS.items():
        motions += e.motions(curves, axis := about(mark))
        jumps[name] = [x for row in curves.values() for x in e.jump_ends(row, axis) if abs(x - mark) <= e.limit("near")]
    return Measured([(bool(places), True) for places in jumps.values()], {"ends": jumps}, motions=motions)


def actuation_periods(e: Evidence) -> Measured:
    single = {f"{r:.3f}": e.motion(actuated(r)).period for r in MISMATCHED.values()}
    along = slipping_periods(e, (10, 11))
    return Measured([*((p, denominator(actuated(r))) for p, r in zip(single.values(), MISMATCHED.values())),
                     *((period, [n]) for n, period in along.values())],
                    {"at 150 rad/s": single, "along": {name: period for name, (_, period) in along.items()}})


def period_is_denominator(e: Evidence) -> Measured:
    periods = {f"{m}/{n}": e.motion(actuated(m / n)).period for m, n in COPRIME}
    return Measured([(periods[f"{m}/{n}"], n) for m, n in COPRIME], {"periods": periods})


def as_dual_excitation(e: Evidence) -> Measured:
    pairs = {}
    for name, ratio in MISMATCHED.items():
        varying, n = e.motion(actuated(ratio)).period, denominator(actuated(ratio))
        # omega is the N-th harmonic of omega/N, and omega_f the M-th.
        amplitudes = np.zeros(max(round(ratio * n), n))
        amplitudes[n - 1] += 250.0
        amplitudes[round(ratio * n) - 1] += 0.25 * e.system({}).saturation_mean
        dual = e.motion({FREQUENCY: 150.0 / n, "engine.torque_amplitude": float(amplitudes[0]),
                                "engine.harmonic_amplitudes": tuple(amplitudes[1:].tolist()),
                                "engine.harmonic_phases": (0.0,) * (len(amplitudes) - 1)}).period
        # The torque repeats after at least N cycles of omega, whatever the response repeats after.
        pairs[f"{name}: varying load, two torques"] = [varying, dual * n]
    return Measured(list(pairs.values()), pairs)


def proof_is_whole(e: Evidence) -> Measured:
    falling, same = ({name: [p for p in periods if p > n and p % n == 0]
                      for name, (n, periods) in slipping_periods(e, numbers).items()}
                     for numbers in ((16, 17), (10, 11)))
    return Measured((not any(falling.values()), not any(same.values())), {"falling": falling, "same": same}, True)


def slope_is_the_cause(e: Evidence) -> Measured:
    parts = {str(n): figure_curves(e, n).off_period() for n in (8, 10, 11, 13, 14, 15, 16, 17, 18)}
    same, falling = ([x for n, periods in parts.items() for x in periods
                      if (rows(int(n))[0][KINETIC] == STATIC) is constant] for constant in (True, False))
    return Measured((max(same) == 0.0 and min(falling) >= 0.1, max(same) < min(falling)), {"off": parts})


def _long_runs(e: Evidence) -> dict[float, Any]:
    """Return the last 64 of 650 cycles from (13) for 0.75 mu_s, by frequency ratio in steps of 0.009."""
    return {float(x): e.run(e.system(with_kinetic(0.75, {FREQUENCY: float(x) * OMEGA_N})),
                                   650).solved_cycles for x in FINER[::3]}


def shows_in_both(e: Evidence) -> Measured:
    periods = {x: [repeats(series[-64:]) for series in (cycles.section[:, 1], cycles.highest)]
               for x, cycles in _long_runs(e).items()}
    apart = [[x, *pair] for x, pair in periods.items() if pair[0] != pair[1]]
    share = 1.0 - len(apart) / len(periods)
    return Measured([share], {"part": share, "apart": apart})


def section_varies_less(e: Evidence) -> Measured:
    sections = [cycles.section[-64:] for cycles in _long_runs(e).values()]
    variation = np.array([s.std(axis=0) / np.abs(s).mean(axis=0) for s in sections if repeats(s[:, 1]) != 1])
    share = float((variation[:, 1] < variation[:, 0]).mean()) if len(variation) else 1.0
    median = np.median(variation[:, :2], axis=0).tolist() if len(variation) else []
    return Measured([share], {"ratios": len(variation), "share": share, "median": median}, share != 1.0)


def doubling_to_chaos(e: Evidence) -> Measured:
    places = [x for x in jump_places(e, "0.83") if abs(x - 0.20) <= e.limit("near")]
    place = (places[0] if places else 0.20) + 2e-3
    row, falls = {FREQUENCY: place * OMEGA_N}, np.round(np.arange(0.56, 0.8301, 0.01), 6)
    periods = e.periods(e.curves([row], falls, over=KINETIC)[0])
    none = falls[periods == 0]
    diagnoses = dict[str, list[Any]]()
    for r in none[::-1][:6]:
        at = with_kinetic(float(r), row)
        exponent = e.motion(at, lyapunov=True).lyapunov
        if exponent is not None and exponent.diagnosis == "unresolved":
            exponent = e.exponent(at, 650, 20000)  # Fewer cycles do not distinguish it from 0.
        diagnoses[f"{r:g}"] = ["not solved"] if exponent is None else [exponent.diagnosis, exponent.low, exponent.high]
    wild = any(name in ("chaotic", "quasi-periodic") for name, *_ in diagnoses.values())
    return Measured((int(periods[-1]) == 2 and wild, len(none) > 0),
                    {"omega/omega_n": place, "period": int(periods[-1]), "none": none.tolist(), "found": diagnoses})


def _periods_of_6(e: Evidence, way: str) -> Any:
    """Return (n,) periods of a sweep of Fig. 6 over RATIOS."""
    return e.periods(e.curves([AT_036], RATIOS, over=KINETIC, direction=way)[0])


def _highest(e: Evidence, period: int, below: float) -> list[float | None]:
    """Return the highest mu_k/mu_s up to `below` with a period in Fig. 6, for each of DIRECTIONS."""
    return [max((float(x) for x in RATIOS[(_periods_of_6(e, way) == period) & (below >= RATIOS)]),
                default=None) for way in DIRECTIONS]


def period_one_near_unity(e: Evidence) -> Measured:
    near = _periods_of_6(e, "cold")[RATIOS >= 0.94]
    return Measured((bool((near == 1).all()),), {"periods": np.unique(near).tolist()})


def period_two_from(e: Evidence, place: float) -> Measured:
    ends = _highest(e, 2, 1.0)
    born = [s.high.value for s in e.stretches([AT_036], RATIOS, over=KINETIC)[0] if s.period == 2 and s.high.jumps]
    limit, falling = e.limit("near"), ends[DIRECTIONS.index("down")]
    near = any(abs(x - place) <= limit for x in born)
    return Measured((falling is not None and abs(falling - place) <= limit, near), {"born": born, "ends": ends},
                    near, e.motions({"": AT_036}, RATIOS, over=KINETIC))


def aperiodic_from(e: Evidence, place: float, within: float) -> Measured:
    highest = _highest(e, 0, 0.78)
    none = {float(x) for way in DIRECTIONS for x in RATIOS[_periods_of_6(e, way) == 0]}
    end = covered_down_to(e.stretches([AT_036], RATIOS, over=KINETIC)[0], 1.0)
    below = any(end - within <= x <= end for x in none)
    near = any(x is not None and abs(x - place) <= within for x in highest)
    return Measured((abs(end - place) <= within and below, near), {"end": end, "highest": highest}, True)


def three_motions(e: Evidence) -> Measured:
    periods = {f"{r:g}": e.motion(with_kinetic(r, AT_036)).period for r in (0.94, 0.74, 0.64)}
    exponent = e.exponent(with_kinetic(0.64, AT_036), CYCLES, SECTION_CYCLES)  # As Fig. 7 shows it.
    same = list(periods.values()) == [1, 2, 0]
    words = f"{exponent.exponent:.1f} +- {0.5 * (exponent.high - exponent.low):.1f}"
    return Measured((same and exponent.diagnosis == "chaotic", same),
                    {"periods": periods, "exponent": words, "diagnosis": exponent.diagnosis})


def more_with_steeper_law(e: Evidence) -> Measured:
    figures = {str(n): figure_curves(e, n) for n in (14, 15)}
    parts = {n: curves.parts(curves.periods == 0) for n, curves in figures.items()}
    changes = {n: (np.diff(curves.periods) != 0).sum(axis=1).tolist() for n, curves in figures.items()}
    more = sum(parts["15"]) > sum(parts["14"])
    return Measured((more and sum(changes["15"]) > sum(changes["14"]), more), {"parts": parts, "changes": changes})


def half_frequency_aperiodic(e: Evidence) -> Measured:
    cold, *others = (figure_curves(e, 16, [0], way) for way in DIRECTIONS)
    (row,), (slipping,) = cold.rows.values(), cold.slips
    none = [curve.periods[0] == 0 for curve in (cold, *others)]
    parts = [share_where(n, slipping) for n in none]
    return Measured((max(parts) >= e.most, max(parts) >= 0.5),
                    {"parts": parts, "some": share_where(np.any(none, axis=0), slipping),
                     "periodic": share_where(e.periodic_at(row, AXIS), slipping)}, max(parts) < e.most)


def amplitude_aperiodic(e: Evidence) -> Measured:
    none = (figure_curves(e, 18, [2, 3]).periods == 0).any(axis=0)
    return more_than_anywhere(lambda x: float(none[np.abs(AXIS - x) <= e.limit("near") + 1e-9].mean()),
                              HIGHER_JUMPS, "part without a period near", {},
                              "such motions are as frequent at other ratios")


def stick_interval(e: Evidence, number: int, law: str) -> list[float]:
    """Return the lowest ratio with lasting slip from (13) for psi = 0, and the highest ratio with pure stick."""
    axis = np.round(np.arange(0.05, 0.2501, 0.001), 6)
    slips = e.slips(e.curves([{**rows(number)[0], "friction.law": law}], axis)[0])
    return [float(axis[slips].min(initial=math.inf)), float(axis[~slips].max(initial=-math.inf))]


def stick_below(e: Evidence, number: int, place: float) -> Measured:
    """Judge the end of stick for psi = 0 against the ratio in the text; between two ratios are both motions."""
    intervals = {law: stick_interval(e, number, law) for law in LAWS}
    lower = closed_forms.stick_limits(e.system(rows(number)[0]), 0.02 * OMEGA_N, 0.29 * OMEGA_N, 60).lower
    near = e.limit("near")
    return Measured([(low - near <= place <= high + near, True) for low, high in intervals.values()],
                    {**intervals, "lower": None if lower is None else lower / OMEGA_N}, True)


def earlier_onset(e: Evidence) -> Measured:
    onsets = {law: [stick_interval(e, n, law)[0] for n in (8, 14)] for law in LAWS}
    return Measured([(falling < equal, True) for equal, falling in onsets.values()], onsets, True)


def amplitude_makes_stick(e: Evidence) -> Measured:
    curves, low = figure_curves(e, 18), AXIS <= 0.12
    stuck = [share_where(~slips, low) for slips in curves.slips]
    wild = [share_where(periods == 0, low) for periods in curves.periods]
    grows = stuck == sorted(stuck) and stuck[-1] == 1.0
    return Measured((grows and max(wild[:2]) > 0.0, stuck[-1] > stuck[0]), {"stuck": stuck, "wild": wild})


def last_slips(e: Evidence, law: str) -> dict[str, float]:
    """Return the highest slipping ratio from (13) for every mu_k/mu_s."""
    upper = np.round(np.concatenate([np.arange(0.38, 0.48, 0.002), np.arange(0.48, 0.7, 0.005)]), 6)
    sweeps = e.curves([{**row, "friction.law": law} for row in rows(4)], upper)
    return {r: float((s.values[~sticks(s)] / OMEGA_N).max(initial=0.0)) for r, s in zip(MAPS, sweeps)}


def stick_transition(e: Evidence, place: float) -> Measured:
    slips = last_slips(e, "smoothed")
    return Measured((abs(slips["1"] - place) <= e.limit("near") and len(set(slips.values())) == len(slips),),
                    {"last": slips})


def transition_by_smoothing(e: Evidence) -> Measured:
    values = {law: last_slips(e, law) for law in LAWS}
    smoothed, exact = (abs(row["0.667"] - row["1"]) for row in values.values())
    limit = closed_forms.constant_load_limits(e.system({}))[-1] / OMEGA_N
    return Measured((exact < 0.5 * smoothed,), {"last": values, "limit": limit}, exact >= 0.5 * smoothed)


def _slip_from_stick(e: Evidence, row: Values, ratio: float, law: str) -> float:
    """Return the largest slip speed of 20 cycles from the state (8a) of stick at t = 0, rad/s."""
    system = e.system({**row, FREQUENCY: ratio * OMEGA_N, "friction.law": "set_valued"})
    angle = closed_forms.plate_angle(system)
    stuck: System = replace(system, {"initial.slip_speed": 0.0, "initial.plate_angle": float(angle(0.0)),
                                     "initial.plate_speed": float(angle.rate()(0.0)), "friction.law": law})
    return float(solve(stuck, cycles=20).solved_cycles.largest.max())


def stick_ends(e: Evidence, loads: str) -> Measured:
    """Compare limits of stick by (10) with those of motions that start in stick; `loads`: under varying load."""
    def slips(ratio: float, row: Values) -> bool:
        return _slip_from_stick(e, row, ratio, "set_valued") > SLIPS

    pairs = {}
    for name, row in STICKY.items():
        if bool(row) is bool(loads):
            limits = closed_forms.stick_limits(e.system(row), 0.05 * OMEGA_N, 0.6 * OMEGA_N, 60)
            for end, omega in (("lower", limits.lower), ("upper", limits.higher)):
                if omega is not None:
                    limit = omega / OMEGA_N
                    found = place_of_change(partial(slips, row=row), limit - 0.02, limit + 0.02, 14)
                    pairs[f"{name}, {end} limit: (10), simulation"] = found, limit
    return Measured(list(pairs.values()), {name: [limit, found] for name, (found, limit) in pairs.items()}, True)


def smoothed_stick_creeps(e: Evidence) -> Measured:
    ratio = closed_forms.constant_load_limits(e.system({}))[-1] / OMEGA_N + 0.02
    slips = {law: _slip_from_stick(e, {}, ratio, law) for law in LAWS}
    return Measured((slips["smoothed"] > SLIPS > slips["set_valued"],),
                    {"omega/omega_n": ratio, "largest": {law: two_digits(x) for law, x in slips.items()}})


def positive_trend_slips(e: Evidence) -> Measured:
    values, slipping = dict[str, Any](), []
    for name, speed in (("from (13)", 150.0), ("from rest", 0.0)):
        row = {"pressure.mean": 123.75e3, FREQUENCY: 0.36 * OMEGA_N, "initial.slip_speed": speed}  # Tsm = 297 N m.
        last = e.run(e.system(row), 2000).solved_cycles[-50:]
        slipping.append(float(last.stick_time.sum()) == 0.0)
        values[name] = [float(last.lowest.min()), float(last.highest.max())]
    return Measured((all(slipping),), values, True)


def pure_slip_guaranteed(e: Evidence) -> Measured:
    system = paper_system({"pressure.mean": 125e3, FREQUENCY: 150.0})  # Table 1 with Tsm = Tm.
    motion = closed_forms.pure_slip(system)
    run = e.run(system, 60, samples=200)
    off = float(np.abs(run.slip_speed - motion.slip_speed(run.t)).max()) / float(np.abs(run.slip_speed).max())
    # v is Omega_e plus terms that do not depend on it, so the slowest engine that keeps slipping is the difference.
    slowest = system.initial.slip_speed - motion.least_slip_speed
    # The difference is rounding: its digits are those of a machine, so the page has its bound only.
    held = motion.least_slip_speed > 0.0 and off < 1e-6
    return Measured((held and slowest <= 0.0, held),
                    {"same": off < 1e-6, "margin": motion.margin, "least": motion.least_slip_speed,
                     "slowest": slowest},
                    f"(16), (18) leave out the transient: below Omega_e = {slowest:.3g} rad/s it ends the slip")


def slope_exaggerates(e: Evidence) -> Measured:
    curves = figure_curves(e, 4)
    mean = curves.means(curves.maxima[0] > e.limit("slipping"))
    return Measured((grow(mean),), {"mean": mean, "largest": curves.maxima.max(axis=1).tolist()})


def slope_exaggerates_varying(e: Evidence, numbers: Sequence[int], band: str) -> Measured:
    means = [figure_curves(e, n).means(BANDS[band]) for n in numbers]
    return Measured((all(map(grow, zip(*means))),), {"mean": means})


def phase_pi_is_worst(e: Evidence, numbers: Sequence[int], band: str) -> Measured:
    means = {str(n): figure_curves(e, n).means(BANDS[band]) for n in numbers}
    worst = [row[2] == max(row) for row in means.values()]
    return Measured((all(worst), any(worst)), {"mean": means})


def amplitude_enlarges_slip(e: Evidence, number: int, band: str) -> Measured:
    means = figure_curves(e, number).means(BANDS[band])
    return Measured((grow(means), means[-1] > means[0]), {"mean": means})


def phase_reversed(e: Evidence) -> Measured:
    parts, motions = dict[str, Sequence[float]](), list[Motion]()
    figures, axis = {str(n): figure_curves(e, n) for n in (14, 15)}, AXIS[(AXIS >= 0.305) & (AXIS <= 0.455)]
    for n, curves in figures.items():
        motions += e.motions({f"Fig. {n}, {name}": row for name, row in curves.rows.items()}, axis)
        parts[n] = highest_shares([e.amplitudes(row, axis) for row in curves.rows.values()],
                                  (axis >= 0.31) & (axis <= 0.45), e.limit("shows"), e.limit("slipping"))
    always = min(every for every, _ in parts.values()) >= e.most
    cold = {n: curves.best(0, HIGH, -1.0) for n, curves in figures.items()}
    return Measured((always, max(some for _, some in parts.values()) >= 0.5), {"worst": parts, "from (13)": cold},
                    not always, motions)


def delay(e: Evidence) -> Measured:
    delays = {plain(s.label): first_half(e.last_cycles(s.values, 2, 2000)) for s in FIGURES[9].series}
    parts = list(delays.values())
    return Measured((min(parts[:2]) > 0.8 and max(parts[2:]) < 0.2,), {"part in the first half": delays})


def _against_constant(e: Evidence, where: Any, sign: float) -> tuple[dict[str, float], dict[str, float]]:
    """Return the parts of the slipping ratios at which curves of Figs. 10, 11 are below that of Tsp = 0, by
    frequency, and at which omega_f = omega is the lowest of its figure; sign -1: above, and the highest.
    """
    still, *varying = e.maxima([{}, *ACTUATED.values()], AXIS)
    shows, slipping = e.limit("shows"), e.limit("slipping")
    beside = {ratio: share_where(sign * (still - maxima) > shows, where & (np.maximum(maxima, still) > slipping))
              for ratio, maxima in zip(ACTUATED, varying)}
    return beside, {str(n): figure_curves(e, n).best(1, where, sign) for n in (10, 11)}


def actuation_attenuates(e: Evidence) -> Measured:
    below, parts = _against_constant(e, LOW, 1.0)
    return Measured([*parts.values(), below["1.000"]], {"lowest": parts, "below": below})


def actuation_reversed(e: Evidence) -> Measured:
    over, parts = _against_constant(e, HIGH, -1.0)
    motions = e.motions({f"omega_f = {ratio} omega": row for ratio, row in ACTUATED.items()}, AXIS[HIGH])
    alone = any(end.jumps for m in motions for end in (m.stretch.low, m.stretch.high))
    return Measured([over["1.000"], *parts.values()], {"over": over, "highest": parts},
                    ("" if alone else "no stable motion ends in a jump, so the start does not matter; ")
                    + "it attenuates no more than constant load, but is not the highest beside the other curves",
                    motions)


def mismatch_with_falling_law(e: Evidence) -> Measured:
    same, falling = (figure_curves(e, n) for n in (11, 17))
    parts = {"11": same.off_period(), "17": falling.off_period()}
    lowest, beaten = falling.best(1, LOW), falling.exceptions(1, LOW)
    more = all(map(grow, zip(*parts.values())))
    return Measured((more and lowest >= e.most, more or lowest >= e.most),
                    {"off": parts, "lowest": lowest, "not at": beaten}, bool(beaten))


def critical_frequency(e: Evidence) -> Measured:
    pairs = {}
    for name, inertia in INERTIAS.items():
        system = paper_system(inertia)
        by_inertia = math.sqrt(system.driveline.plate_inertia
                               / (system.driveline.plate_inertia + system.driveline.flywheel_inertia))
        pairs[f"{name}: crossing, (28)"] = crossing(e, inertia, system.natural_frequency, by_inertia), by_inertia
    return Measured(list(pairs.values()), {name: list(pair) for name, pair in pairs.items()})


def crossing(e: Evidence, inertia: Values, omega_n: float, place: float) -> float | None:
    """Return where the maxima of psi = 0 and pi cross within 0.03 of a ratio, to 1e-5; None if they do not."""
    def apart(ratio: float) -> float:
        first, last = (e.motion({**row, **inertia, FREQUENCY: ratio * omega_n}).largest for row in rows(8)[::2])
        return first - last

    axis = np.linspace(place - 0.03, place + 0.03, 13)
    signs = np.sign([apart(float(x)) for x in axis])
    turns = np.flatnonzero(signs[1:] * signs[:-1] < 0)
    if not len(turns):
        return None
    return place_of_change(lambda x: apart(x) > 0.0, float(axis[turns[0]]), float(axis[turns[0] + 1]), 9)


def highest_shares(curves: Sequence[Sequence[Sequence[float]]], where: Any, negligible: float,
                   slipping: float) -> tuple[float, float]:
    """Return the fractions of the slipping places at which the first curve is the highest, for every choice of a motion
    on each curve and for some choice, from the largest slip speeds of all stable motions, per curve and place, rad/s.
    """
    every, some, moving = np.array([
        (min(first) >= max(map(max, others)) - negligible, max(first) >= max(map(min, others)) - negligible,
         max(map(max, (first, *others))) > slipping) for first, *others in zip(*curves)], dtype=bool).T
    return share_where(every, where & moving), share_where(some, where & moving)
