"""Evidence written down by hand for the verdicts on the paper's claims."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.multipliers import Lyapunov
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.model.parameters import System
from tcc_sim.study.continuation.loss_of_stability import SegmentEnd, StableSegment
from tcc_sim.study.paper.branches_behind import StableMotions
from tcc_sim.study.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.study.paper.claims import CLAIMS
from tcc_sim.study.paper.evidence import KINETIC, ColdStartMotion
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep
from tcc_sim.trajectory import Cycles, State, Statistics, Trajectory

rows = {claim.name: claim for claim in CLAIMS}
curve_along = cache(Curve)


@cache
def record(slip: float = 10.0, period: int = 1, regime: str = "stick-slip", *, settled: bool = True,
           equivalent_damping: float = 0.0, negative_slope_mean: float = 0.0) -> Point:
    """A point of a sweep."""
    result = Summary(slip, 0.0, period, [], 0.5, regime, 150, 50, settled, 0.0, "made up", 0.0)
    return Point(0.0, result, np.empty((0, 2)), settled, "done", np.empty(0),
                 Damping(equivalent_damping, negative_slope_mean, -0.6), None, Start(State(0.0, 0.0, 0.0), 150))


class Given(StableMotions):
    """Evidence by hand: a record per row, ratio and direction, and jumps and stable stretches per row."""

    def __init__(self, at: Callable[..., Point] = lambda row, x, direction: record(),
                 jumps: Callable[..., list[float]] = lambda row: [], lyapunov: str = "chaotic",
                 stretches: Callable[..., list[StableSegment]] = lambda row: [],
                 reached: Callable[[Any], set[int]] = lambda row: set(),
                 attractors: Callable[[Any], list[tuple[int, float]]] = lambda row: [],
                 periodic: Callable[[float], bool] = lambda x: True,
                 runs: Callable[[System], Any] | None = None, longer: str = "") -> None:
        super().__init__(1e-9, 1)
        self.runs, self.longer = runs, longer
        self.pieces, self.on, self.rest_in, self.closed = stretches, reached, attractors, periodic
        self.at, self.leaps, self.diagnosis = at, jumps, lyapunov

    def curves(self, rows, axis, *, over="engine.frequency", direction="cold", **how):  # type: ignore
        unit = OMEGA_N if over == "engine.frequency" else STATIC
        keys = tuple(min(float(x) * unit, STATIC) if unit == STATIC else float(x) * unit for x in axis)
        return [Sweep(curve_along(paper_system(row), over, keys), Plan(direction=direction),
                      [self.at(row, float(x), direction) for x in axis], 0.0) for row in rows]

    def run(self, system, cycles, **how):  # type: ignore
        return super().run(system, cycles, **how) if self.runs is None else self.runs(system)

    def motion(self, row, *, lyapunov=False):  # type: ignore
        summary = self.at(row, float(row.get("engine.frequency", OMEGA_N)) / OMEGA_N, "cold").summary
        return ColdStartMotion(summary.period, summary.max_slip_speed,
                               Lyapunov(0.5, 0.0, 1.0, 0.95, 100, self.diagnosis))

    def exponent(self, row, begin, cycles):  # type: ignore
        return Lyapunov(0.5, 0.0, 1.0, 0.95, cycles, self.longer)

    def jumps(self, row, axis):  # type: ignore
        return [(x, 10.0 + k) for k, x in enumerate(self.leaps(row))]

    def stretches(self, rows, axis, *, over="engine.frequency"):  # type: ignore
        return [self.pieces(row) for row in rows]

    def reached(self, row, axis, *, over="engine.frequency"):  # type: ignore
        on = sorted(self.on(row))
        return [on[k % len(on)] if on else None for k in range(len(axis))]

    def periodic_at(self, row, axis):  # type: ignore
        return np.array([self.closed(float(x)) for x in axis])

    def attractors(self, row):  # type: ignore
        return self.rest_in(row)


def stretch(low: float, high: float, period: int = 1, height: float = 10.0, begins: str = "",
            ends: str = "") -> StableSegment:
    """A stable motion from `low` to `high` with the bifurcations at its ends; a kind with "jump " is a jump."""
    def end(value: float, kind: str) -> SegmentEnd:
        return SegmentEnd(value, kind.removeprefix("jump ") or None, 1e-12 if kind else None, kind.startswith("jump"))

    return StableSegment(period, end(low, begins), end(high, ends), (low, high), (height, height))


def run_with(section: Any = ((0.0, 0.0, 0.0),), largest: Any = 0.0, stick: float = 0.0, seconds: float = 0.0,
             **samples: Any) -> Trajectory:
    """A run with the cycles, samples and computing time that a claim reads."""
    n = len(section) - 1
    cycles = Cycles(np.array(section, float), np.full(n, largest), np.zeros(n), np.full(n, stick))
    none = np.zeros(len(samples.get("t", ())))
    columns = dict.fromkeys(("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque",
                             "friction_torque", "state"), none)
    return Trajectory(**{"cycle": 1.0, **columns, **samples}, solver="by hand", cycles=cycles,
                      statistics=Statistics(seconds=seconds))


def leaves(value: Any) -> list[Any]:
    """The numbers and words of nested results, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    return [x for part in value for x in leaves(part)] if isinstance(value, (list, tuple)) else [value]


def law_of(row: Any) -> str:
    return str(row.get("friction.law", "smoothed"))


def ratio_of(row: Any) -> float:
    """mu_k/mu_s of a row."""
    return round(float(row.get(KINETIC, STATIC)) / STATIC, 4)


def phase_is(row: Any, value: float) -> bool:
    return bool(abs(row["pressure.phase"] - value) < 1e-9)


def lowest(key: str, wanted: float, low: float = 1.0, high: float = 1.0, place: float = 0.3) -> Callable[..., Any]:
    """A curve that is lowest below `place` and highest above where `key` has the wanted value."""
    def at(row: Any, x: float, direction: str) -> Any:
        if abs(row[key] - wanted) < 1e-9:
            return record(10.0 - low if x < place else 10.0 + high)
        return record(10.0)
    return at


def slips_to(end: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x <= end(row) else "stick")


def slips_from(start: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x >= start(row) else "stick")


def by_amplitude(order: tuple[float, float]) -> Callable[..., Any]:
    """Fig. 13: change of the maxima with Tsp below and above 0.3."""
    return lambda row, x, direction: record(10.0 + order[x > 0.3] * row["pressure.amplitude"] / 225e3)


def orbit(cold: float, up: float, down: float, start: float = 0.7) -> Callable[..., Any]:
    """Fig. 6: period two below a separate end in each direction, none below `start`."""
    def at(row: Any, x: float, direction: str) -> Any:
        end = {"cold": cold, "up": up, "down": down}[direction]
        return record(period=0 if x <= start else 2 if x <= end + 1e-9 else 1)
    return at


def period_at(periods: Callable[[Any, float], int]) -> Callable[..., Any]:
    return lambda row, x, direction: record(period=periods(row, x))


def coprime(row: Any) -> int:
    from fractions import Fraction
    return Fraction(row["pressure.frequency_ratio"]).limit_denominator(12).denominator


def denominators(row: Any, x: float) -> int:
    return coprime(row)


NAMED = [0.167, 0.20, 0.25, 0.333]
SMALL = {1.0: -0.006, 0.83: 0.0, 0.75: 0.006, 0.667: 0.012}


def sharp(shift: float, equal: float | None = None) -> Callable[..., Any]:
    """Fig. 4: one peak near 0.2 for every mu_k, each shifted from the last; at `equal` for mu_k = mu_s."""
    def at(row: Any, x: float, direction: str) -> Any:
        place = 0.2 + shift * SMALL[ratio_of(row)] if equal is None or ratio_of(row) < 1.0 else equal
        return record(10.0 + 20.0 * math.exp(-((x - place) / 0.004) ** 2))
    return at


def cliffs(*places: float) -> Callable[..., Any]:
    """Fig. 4: a rise to a jump at each of these places."""
    return lambda row, x, direction: record(10.0 + 30.0 * max(max(0.0, 1.0 - (p - x) / 0.012) * (x <= p)
                                                              for p in places))


def hills(*places: float) -> Callable[..., Any]:
    """Fig. 4: a peak at each of these places."""
    return lambda row, x, direction: record(10.0 + 20.0 * max(math.exp(-((x - p) / 0.004) ** 2) for p in places))


def next_to(at: Callable[..., Any], still: float = 10.0) -> Callable[..., Any]:
    """The curve of `at`, and `still` for Tsp = 0."""
    return lambda row, x, direction: at(row, x, direction) if "pressure.amplitude" in row else record(still)


def dual(times: int) -> Callable[..., Any]:
    """Period N under a varying load, and `times` base cycles under two torques."""
    return lambda row, x, direction: record(period=coprime(row) if "pressure.frequency_ratio" in row else times)


def severe_jumps(row: Any) -> list[float]:
    """Three jumps of growing size on each curve of Fig. 14."""
    return [0.2, 0.3, 0.4]


def severe(with_size: bool) -> Callable[..., Any]:
    """Fig. 14: periods beside the jumps grow or fall with their size; the larger slip is at the smaller jumps."""
    def at(row: Any, x: float, direction: str) -> Any:
        number = min(range(3), key=lambda k: abs(x - (0.2, 0.3, 0.4)[k]))
        return record(30.0 - number, period=number + 1 if with_size else 3 - number)
    return at


def ending(*places: float, kind: str = "jump fold") -> Callable[..., Any]:
    """Stable motions that end at these places, and one over the whole range."""
    return lambda row: [*(stretch(x - 0.03, x, ends=kind) for x in places), stretch(0.05, 0.5)]


def fig6(one: float, two: float, end: float, kind: str = "jump fold") -> Callable[..., Any]:
    """Fig. 6: period one down to `one`, period two between its ends."""
    return lambda row: [stretch(one, 1.0, begins="jump period_doubling"), stretch(end, two, 2, 48.0, "jump fold", kind)]


def other_phase(height: float) -> Callable[..., Any]:
    """A second stable motion for every phase but 0."""
    return lambda row: [] if phase_is(row, 0.0) else [stretch(0.3, 0.5, height=height)]


def growing(row: Any) -> list[float]:
    """Fig. 18: jumps near 0.25, one more with every Tsp; the k-th is 10 + k rad/s."""
    return [0.25] * (1 + sum(row["pressure.amplitude"] > x for x in (0.0, 5e4, 1e5)))
