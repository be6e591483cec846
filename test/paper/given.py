"""Evidence that a test made up, for the verdicts on the paper's claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tcc_sim.analysis.damping import Damping
from tcc_sim.analysis.summary import Summary
from tcc_sim.continuation.loss_of_stability import SegmentEnd, StableSegment
from tcc_sim.model.parameters import System
from tcc_sim.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.paper.evidence import ColdStartMotion
from tcc_sim.paper.figure_results import Curves, Figure, MapCurve
from tcc_sim.paper.stable_motions import StableMotions
from tcc_sim.sweeps.exponents import Lyapunov
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep
from tcc_sim.trajectory import State


def record(slip: float = 10.0, period: int = 1, regime: str = "stick-slip", *, settled: bool = True,
           equivalent_damping: float = 0.0, negative_slope_mean: float = 0.0) -> Point:
    """A point of a sweep."""
    found = Summary(slip, 0.0, period, [], 0.5, regime, 150, 50, settled, 0.0, "made up", 0.0)
    return Point(0.0, found, np.empty((0, 2)), settled, "done", np.empty(0),
                 Damping(equivalent_damping, negative_slope_mean, -0.6), None, Start(State(0.0, 0.0, 0.0), 150))


class Given(StableMotions):
    """Evidence that was made up: a record per row, ratio and direction, and jumps and stable stretches per row."""

    def __init__(self, at: Callable[..., Point] = lambda row, x, direction: record(),
                 jumps: Callable[..., list[float]] = lambda row: [], lyapunov: str = "chaotic",
                 along: Callable[[Any], float] = lambda row: 10.0,
                 stretches: Callable[..., list[StableSegment]] = lambda row: [],
                 reached: Callable[[Any], set[int]] = lambda row: set(),
                 attractors: Callable[[Any], list[tuple[int, float]]] = lambda row: [],
                 periodic: Callable[[float], bool] = lambda x: True,
                 runs: Callable[[System], Any] | None = None, longer: str = "") -> None:
        super().__init__(1e-9, 1)
        self.runs, self.longer = runs, longer
        self.pieces, self.on, self.rest_in, self.closed = stretches, reached, attractors, periodic
        self.at, self.leaps, self.diagnosis, self.along = at, jumps, lyapunov, along

    def curves(self, rows, axis, *, over="engine.frequency", direction="cold", **how):  # type: ignore
        unit = OMEGA_N if over == "engine.frequency" else STATIC
        keys = tuple(min(float(x) * unit, STATIC) if unit == STATIC else float(x) * unit for x in axis)
        return [Sweep(Curve(paper_system(row), over, keys), Plan(direction=direction),
                      [self.at(row, float(x), direction) for x in axis], 0.0) for row in rows]

    def run(self, system, cycles, **how):  # type: ignore
        return super().run(system, cycles, **how) if self.runs is None else self.runs(system)

    def motion(self, row, *, lyapunov=False):  # type: ignore
        found = self.at(row, float(row.get("engine.frequency", OMEGA_N)) / OMEGA_N, "cold").summary
        return ColdStartMotion(found.period, found.max_slip_speed, Lyapunov(0.5, 0.0, 1.0, 0.95, 100, self.diagnosis))

    def exponent(self, row, begin, cycles):  # type: ignore
        return Lyapunov(0.5, 0.0, 1.0, 0.95, cycles, self.longer)

    def jumps(self, row, axis):  # type: ignore
        return [(x, 10.0 + k) for k, x in enumerate(self.leaps(row))]

    def largest_by_cycle(self, row, cycles):  # type: ignore
        return np.full(cycles, self.along(row))

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
    """A stable motion from `low` to `high` with the bifurcations at its ends; jumps are named so."""
    def end(value: float, kind: str) -> SegmentEnd:
        return SegmentEnd(value, kind.removeprefix("jump "), 1e-12 if kind else 0.0, kind.startswith("jump"))

    return StableSegment(period, end(low, begins), end(high, ends), (low, high), (height, height))


def curve_of(largest: Sequence[float | None], **more: Any) -> MapCurve:
    """A curve of a map whose motions have settled in period one, where nothing else is said."""
    n = len(largest)
    given: dict[str, Any] = {
        "label": "a curve", "values": {}, "direction": "cold", "min_slip_speed": [0.0] * n, "period": [1] * n,
        "confirmed": [True] * n, "settled": [True] * n, "runaway": [False] * n, "stick_fraction": [0.5] * n,
        "regime": ["stick-slip"] * n, "theta2": [[0.1]] * n, "status": ["done"] * n, **more}
    return MapCurve(max_slip_speed=largest, **given)


def figure_of(kind: str, numbers: Any, number: int = 4, law: str = "smoothed", title: str = "a title",
              caption: str = "a caption") -> Figure[Any]:
    keys = {"engine.mean_torque": 300.0, "friction.static_coefficient": 0.3, "pressure.mean": 225e3,
            "clutch.area": 0.08, "clutch.radius": 0.1}
    return Figure(number, kind, title, caption, law, True, keys, [0.3], numbers, 0.0)


def curves_of(curves: Sequence[MapCurve]) -> Curves:
    x = np.linspace(0.05, 0.5, 11).tolist()
    return Curves(axis="omega/omega_n", x=x, unit=OMEGA_N, cycles=100, discarded=50, curves=curves)


def law_of(row: Any) -> str:
    return str(row.get("friction.law", "smoothed"))
