"""Evidence written down by hand for the verdicts on the paper's claims."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.exponents import Lyapunov
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.model.parameters import System
from tcc_sim.study.continuation.branch import SegmentEnd, StableSegment
from tcc_sim.study.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.study.paper.claims import CLAIMS
from tcc_sim.study.paper.evidence import ColdStartMotion, Evidence
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.simulation import Start
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


class Given(Evidence):
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
