"""Sweeps, motions and branches for the verdicts on claims, computed once per tolerance and mean pressure."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.exponents import Lyapunov, largest_lyapunov_exponent
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import counted
from tcc_sim.model.parameters import System
from tcc_sim.model.quantity import Value
from tcc_sim.result import reported, reporting, result_class
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.study.basins.attractors import find_attractors
from tcc_sim.study.basins.compute import DrivelineMotion, halton
from tcc_sim.study.continuation import branch as diagram
from tcc_sim.study.continuation.branch import SWEPT, StableSegment, point_of, segment_of, stable_segments
from tcc_sim.study.continuation.motions import DrivelineMap
from tcc_sim.study.continuation.orbits import ParameterRange
from tcc_sim.study.paper.branches_behind import JUMP, LATER, RUNS, later, seen_in, surveyed
from tcc_sim.study.paper.catalogue import NORMALISED, OMEGA_N, PRESSURE, STATIC, paper_system, values_at
from tcc_sim.sweeps.executors import workers
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.simulation import DIRECTIONS
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, solve_point, sweep_curves
from tcc_sim.trajectory import Floats, State, Trajectory

FREQUENCY, KINETIC, SMOOTHING = "engine.frequency", "friction.kinetic_coefficient", "friction.smoothing"
THRESHOLDS: dict[str, tuple[float, str, str]] = {
    "near": (0.02, "", "largest distance from a printed frequency or friction ratio"),
    "close": (0.01, "", "the same where places are so dense that `near` would cover most of the range"),
    "ends": (4e-3, "", "largest distance of a step of a sweep from the end of a motion that causes it"),
    "jump": (JUMP, "", "least size of a jump, over the curve's largest value"),
    "prominent": (0.02, "", "least height of a peak above its surroundings, over the curve's largest value"),
    "shows": (0.05, "rad/s", "least difference of two largest slip speeds"),
    "slipping": (0.1, "rad/s", "largest slip speed above which a curve slips"),
    "alike": (0.05, "", "largest difference of two equal solutions, over the largest slip speed"),
    "missing": (0.05, "", "part of the cases in which a statement may fail"),
    "factor": (1.0, "", "factor of the tolerances of numbers that are compared")}
"""Value, unit and meaning of each threshold of the criteria; `claims --thresholds` judges with each of them halved and
doubled.
"""
T = SimpleNamespace(**{name: value for name, (value, *_) in THRESHOLDS.items()})
BISECTIONS = 8
"""Number of halvings of the interval of a jump; the change of a continuous curve becomes small in them."""
CYCLES, DISCARD = 150, 50
"""The paper's rule: cycles of every motion, and dropped ones of these."""
FAILED, RUNAWAY = -1, -2
"""Values in place of a period: for a failed point, and for runaway slip."""
FEW = replace(SWEPT, longest_period=2, max_points=60, max_branches=5)
"""Branches over one part of an axis."""
SEEDS = 24
LOWEST, HIGHEST = np.array([-50.0, -0.1, -20.0]), np.array([200.0, 0.3, 20.0])
"""Initial states in the search for attractors: number, and ranges of slip speed, plate angle and plate speed."""
Values = Mapping[str, Value]


@dataclass(frozen=True)
class ColdStartMotion:
    """One motion from the initial state (13): period of the settled motion (0 for none up to 16, RUNAWAY or FAILED),
    largest |slip speed| after the dropped cycles, rad/s (NaN for a failure), and exponent, if requested.
    """

    period: int
    largest: float
    lyapunov: Lyapunov | None = None


@result_class
class Motion:
    """Stable motion along a curve, independent of the initial state."""

    curve: str = reported("curve of the figure; empty if there is one only")
    over: str = reported("name of the axis")
    from_start: Sequence[float] = reported("places at which the initial state (13) leads to it")
    stretch: StableSegment = reported("its period and ends", spread=True)

    @reporting("the motion in a sentence")
    def words(self) -> str:
        at, where = self.from_start, "nowhere"
        if at:
            where = f"at {' to '.join(dict.fromkeys(f'{x:g}' for x in (min(at), max(at))))} " \
                    f"({counted(len(at), 'value')})"
        name, stretch = f"{self.curve}{': ' if self.curve else ''}", self.stretch
        return (f"{name}period {stretch.period}, stable over {self.over} from {stretch.low} to {stretch.high}; within "
                f"{CYCLES + RUNS * LATER} cycles (13) leads to it {where}")


@dataclass
class Evidence:
    """Sweeps, motions and stable branches of Sections 5 and 6, cached.

    rtol : tolerance of the smoothed engine
    jobs : number of threads; None for all cores
    progress : whether to show a bar for every sweep on a terminal
    pressure : mean pressure of Figs. 4 to 18, Pa
    factors : factors of thresholds
    used : names of the thresholds used so far
    known : results that do not depend on the tolerance of the sweeps, by kind, rows and axes as text; evidence at
        several tolerances shares them
    """

    rtol: float
    jobs: int | None = None
    progress: bool = False
    pressure: float = PRESSURE
    factors: Mapping[str, float] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    known: dict[str, Any] = field(default_factory=dict)
    _sweeps: dict[tuple[Curve, Plan], Sweep] = field(default_factory=dict)
    _motions: dict[tuple[System, bool], ColdStartMotion] = field(default_factory=dict)
    _settled: dict[tuple[Curve, Plan], list[Summary | None]] = field(default_factory=dict)

    def limit(self, name: str) -> float:
        """Return a threshold, and note its use."""
        self.used.add(name)
        return self.factors.get(name, 1.0) * THRESHOLDS[name][0]

    def varied(self, name: str, factor: float) -> Evidence:
        """Return evidence with the same sweeps and motions, and with one threshold times a factor."""
        return replace(self, factors={name: factor}, used=set())

    @property
    def most(self) -> float:
        """Fraction of the cases in which a statement must hold."""
        return 1.0 - self.limit("missing")

    def system(self, row: Values) -> System:
        """Return the system of a row, at this mean pressure unless the row states another."""
        if "pressure.mean" in row:
            return paper_system(row)
        amplitude = float(row.get("pressure.amplitude", 0.0))  # type: ignore[arg-type]
        return paper_system({**row, "pressure.mean": self.pressure,
                             "pressure.amplitude": amplitude * (self.pressure / PRESSURE)})

    def curves(self, rows: Sequence[Values], axis: Floats, *, over: str = FREQUENCY, direction: str = "cold",
               damping: bool = False) -> list[Sweep]:
        """Return a sweep for every row, over omega/omega_n, mu_k/mu_s, or the values of another key."""
        wanted = [Curve(self.system(row), over, values_at(over, axis)) for row in rows]
        return swept(wanted, self.plan(rows[0], direction=direction, damping=damping), self._sweeps, self.jobs,
                     self.progress) if rows else []

    def maxima(self, rows: Sequence[Values], axis: Floats, *, direction: str = "cold") -> Floats:
        """Return (rows, values) largest |slip speed|, rad/s, over omega/omega_n."""
        return np.array([s.column("max_slip_speed") for s in self.curves(rows, axis, direction=direction)])

    def plan(self, row: Values, **how: Any) -> Plan:
        """Return the paper's rule at this tolerance."""
        return Plan(cycles=CYCLES, discard=DISCARD, rtol=self._rtol(self.system(row)), **how)

    def motion(self, row: Values, *, lyapunov: bool = False) -> ColdStartMotion:
        """Return the motion from the initial state (13), with the period of the settled motion."""
        system = self.system(row)
        if (system, lyapunov) not in self._motions:
            point = solve_point(system, 0.0, self.plan(row, lyapunov=lyapunov))
            largest = math.nan if point.summary is None else point.summary.max_slip_speed
            self._motions[system, lyapunov] = ColdStartMotion(period_of(self._settle(system, point)), largest,
                                                              point.lyapunov)
        return self._motions[system, lyapunov]

    def motions_near(self, row: Values, ratio: float, *distances: float,
                     lyapunov: bool = False) -> list[ColdStartMotion]:
        """Return the motions from (13) at some distances from a frequency ratio."""
        return [self.motion({**row, FREQUENCY: (ratio + d) * OMEGA_N}, lyapunov=lyapunov) for d in distances]

    def periods(self, sweep: Sweep) -> NDArray[np.int64]:
        """Return (n,) periods of the settled motions, as in `ColdStartMotion`."""
        return np.array([period_of(summary) for summary in self._settled_in(sweep)], dtype=np.int64)

    def slips(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return (n,) whether the settled motion slips."""
        return np.array([summary is not None and summary.regime != "stick" for summary in self._settled_in(sweep)],
                        dtype=bool)

    def _settled_in(self, sweep: Sweep) -> list[Summary | None]:
        """Return the settled motion of every point of a sweep."""
        name = (sweep.curve, sweep.plan)
        if name not in self._settled:
            with workers(self.jobs, None) as (threads, _):
                self._settled[name] = list(threads.map(
                    self._settle, map(sweep.curve.at, range(len(sweep.points))), sweep.points))
        return self._settled[name]

    def _settle(self, system: System, point: Point | None) -> Summary | None:
        """Return the motion of a point, from further cycles if its section does not repeat yet, since a transient is
        neither periodic nor aperiodic; None if it failed.
        """
        if point is None or point.summary is None or point.summary.settled or point.summary.runaway:
            return None if point is None else point.summary
        summary = later(system, point.end, self._rtol(system))
        return None if summary is None else summary[0]

    def _rtol(self, system: System) -> float:
        """Return the tolerance of the smoothed engine, or that of the exact engine of the set-valued law."""
        return SOLVERS["event_driven"].default if system.friction.law == "set_valued" else self.rtol

    def run(self, system: System, cycles: int, *, samples: int = 0, start_cycle: int = 0,
            state: State | None = None) -> Trajectory:
        """Solve some cycles at this tolerance, with `samples` per cycle."""
        return solve(system, cycles=cycles, samples_per_cycle=samples, start_cycle=start_cycle, state=state,
                     rtol=self._rtol(system)).raise_for_status()

    def last_cycles(self, row: Values, cycles: int, samples: int) -> Trajectory:
        """Solve some cycles with samples, after those of the paper's rule."""
        system = self.system(row)
        before = self.run(system, CYCLES)
        return self.run(system, cycles, samples=samples, start_cycle=CYCLES, state=before.final)

    def exponent(self, row: Values, begin: int, cycles: int) -> Lyapunov:
        """Return the largest Lyapunov exponent over many cycles, after the first `begin` of them from (13)."""
        system = self.system(row)
        return largest_lyapunov_exponent(system, self.run(system, begin).final, cycles=cycles, start_cycle=begin)

    def jumps(self, row: Values, axis: Floats) -> list[tuple[float, float]]:
        """Return omega/omega_n and the change of the largest slip speed at every true jump of a curve from (13).

        Where neighbours differ by more than the threshold, the interval is halved BISECTIONS times, always
        towards the larger change; a change that mostly remains on an interval 2^-8 as wide is a jump.
        """
        values = self.maxima([row], axis)[0]
        size = float(np.nanmax(values))
        jumps = []
        for k in steep(values, self.limit("jump")):
            a, b, fa, fb = float(axis[k]), float(axis[k + 1]), float(values[k]), float(values[k + 1])
            first = abs(fb - fa)
            for _ in range(BISECTIONS):
                middle = 0.5 * (a + b)
                fm = self.motions_near(row, middle, 0.0)[0].largest
                a, fa, b, fb = (a, fa, middle, fm) if abs(fm - fa) >= abs(fb - fm) else (middle, fm, b, fb)
            if abs(fb - fa) > 0.5 * first and abs(fb - fa) > self.limit("jump") * size:
                jumps.append((0.5 * (a + b), fb - fa))
        return jumps

    def stretches(self, rows: Sequence[Values], axis: Floats, *, over: str = FREQUENCY) -> list[list[StableSegment]]:
        """Return for every row the stable stretches of the branches through the motions of sweeps in all DIRECTIONS.

        Their parameter is that of `curves`. Orbits are solved at 1e-12 for any tolerance of the sweeps.
        """
        def followed(sweeps: Sequence[Sweep]) -> list[StableSegment]:
            curve = sweeps[0].curve
            branches = surveyed(curve, [s for sweep in sweeps for s in seen_in(sweep)], settings=FEW)
            return stable_segments(branches, min(curve.values), max(curve.values), NORMALISED[over][1])

        names = [json.dumps(["stretches", sorted(row.items()), axis.tolist(), over]) for row in rows]
        missing = {name: row for name, row in zip(names, rows) if name not in self.known}
        ways = [self.curves(list(missing.values()), axis, over=over, direction=way) for way in DIRECTIONS]
        with workers(self.jobs, None) as (pool, _), progress_bar("branches", len(missing), shown=self.progress) as bar:
            for name, stretches in zip(missing, pool.map(followed, zip(*ways))):
                self.known[name] = stretches
                bar.update()
        return [self.known[name] for name in names]

    def reached(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[int | None]:
        """Return for every value the number of the stretch that (13) leads to; None if it is on none."""
        among = self.stretches([row], axis, over=over)[0]
        sweep = self.curves([row], axis, over=over)[0]
        unit, seen = NORMALISED[over][1], seen_in(sweep)
        size = diagram.amplitude_of(seen)
        at = {s.value: segment_of(replace(s, value=s.value / unit), among, size) for s in seen}
        return [at.get(value) for value in sweep.curve.values]

    def motions(self, rows: Mapping[str, Values], axis: Floats, *, over: str = FREQUENCY) -> list[Motion]:
        """Return every stretch of some curves with its ends, and the values at which (13) leads to it."""
        return [Motion(curve, NORMALISED[over][0], [float(x) for x, number in zip(axis, on) if number == k], s)
                for (curve, row), among in zip(rows.items(), self.stretches(list(rows.values()), axis, over=over))
                for on in [self.reached(row, axis, over=over)] for k, s in enumerate(among)]

    def jump_ends(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[float]:
        """Return the sorted values at which a stable motion ends in a jump."""
        among = self.stretches([row], axis, over=over)[0]
        return sorted({end.value for s in among for end in (s.low, s.high) if end.jumps})

    def amplitudes(self, row: Values, axis: Floats) -> list[list[float]]:
        """Return for every frequency ratio the largest slip speeds of all stable motions, first of that from (13)."""
        among = self.stretches([row], axis)[0]
        return [[float(c), *(h for s in among if math.isfinite(h := s.amplitude(float(x))))]
                for x, c in zip(axis, self.maxima([row], axis)[0])]

    def periodic_at(self, row: Values, axis: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether Newton's method finds a stable periodic orbit at a motion of a sweep."""
        name = json.dumps(["periodic", sorted(row.items()), axis.tolist()])
        if name not in self.known:
            periodic = np.zeros(len(axis), dtype=bool)
            for way in DIRECTIONS:
                curve = (sweep := self.curves([row], axis, direction=way)[0]).curve
                of, span = DrivelineMap(curve.system, (curve.key,)), ParameterRange(curve.values[0], curve.values[-1])
                for seen in seen_in(sweep):
                    k = curve.values.index(seen.value)
                    if seen.period and not periodic[k]:
                        point = point_of(of, span, seen)
                        periodic[k] = point is not None and point.stable
            self.known[name] = periodic
        return np.array(self.known[name])

    def attractors(self, row: Values) -> list[tuple[int, float]]:
        """Return period and largest slip speed of every attractor, from (13) and from many initial states."""
        name = json.dumps(["attractors", sorted(row.items())])
        if name not in self.known:
            system = self.system(row)
            starts = [np.array(State.at_start(system).numbers), *(LOWEST + (HIGHEST - LOWEST) * halton(SEEDS, 3))]
            attractors = find_attractors(DrivelineMotion(system), starts)
            self.known[name] = sorted((a.period, a.largest) for a in attractors)
        return list(self.known[name])


def swept(curves: Sequence[Curve], plan: Plan, kept: dict[tuple[Curve, Plan], Sweep], jobs: int | None = None,
          progress: bool = False) -> list[Sweep]:
    """Return the sweep of every curve; compute those that `kept` lacks together, and add them to it."""
    missing = [curve for curve in curves if (curve, plan) not in kept]
    if missing:
        kept.update({(sweep.curve, plan): sweep for sweep in sweep_curves(missing, plan, jobs=jobs, progress=progress)})
    return [kept[curve, plan] for curve in curves]


def period_of(summary: Summary | None) -> int:
    """Return the period of a settled motion, as in `ColdStartMotion`."""
    return FAILED if summary is None else RUNAWAY if summary.runaway else summary.period


def steep(values: Floats, jump: float = JUMP) -> NDArray[np.int64]:
    """Return the indices at which neighbours differ by more than `jump` of the largest value: jumps or steep rises."""
    return np.flatnonzero(np.abs(np.diff(values)) > jump * float(np.nanmax(values)))


def first_half(run: Trajectory) -> float:
    """Return the fraction of the positive slip angle in the first half of the engine cycle; NaN without slip."""
    phase = np.mod(run.t / run.cycle + 1e-12, 1.0)
    slip = np.where(run.state == 1, np.maximum(run.slip_speed, 0.0), 0.0)
    total = float(slip.sum())
    return float(slip[phase < 0.5].sum()) / total if total > 0.0 else math.nan


def rms_apart(values: Floats, reference: Floats) -> float:
    """Return the root mean square difference of a slip speed from another, over the largest magnitude of the latter."""
    return float(np.sqrt(np.mean((values - reference) ** 2)) / np.abs(reference).max())


def two_digits(x: float) -> float:
    """Return a number with two digits, which an average over an aperiodic motion has."""
    return float(f"{x:.2g}")


def with_kinetic(ratio: float, row: Values | None = None) -> dict[str, Value]:
    """Return a row with mu_k = ratio mu_s."""
    return {**(row or {}), KINETIC: ratio * STATIC}
