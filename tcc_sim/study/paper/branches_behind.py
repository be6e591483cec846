"""Branches behind the paper's sweeps: causes of jumps for `figure --branches`, and stable motions for the claims.

For claims, branches are followed only over the part of an axis that a claim is about, and with few points. They do not
depend on the initial state, but a motion that no sweep reached is not found.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.summary import CycleTimes, summarise_cycles
from tcc_sim.errors import counted
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.parameters import System
from tcc_sim.result import reported, reporting
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.study.basins.attractors import find_attractors
from tcc_sim.study.basins.compute import DrivelineMotion, halton
from tcc_sim.study.continuation import diagram
from tcc_sim.study.continuation.bifurcations import SMOOTH, Bifurcation
from tcc_sim.study.continuation.branch import Branch
from tcc_sim.study.continuation.diagram import (
    ALIKE,
    SWEPT,
    SettledMotion,
    StableSegment,
    jumps_of,
    point_of,
    segment_of,
    stable_segments,
)
from tcc_sim.study.continuation.motions import DrivelineMap
from tcc_sim.study.continuation.orbits import ParameterRange, Settings, shifts
from tcc_sim.study.paper.catalogue import NORMALISED
from tcc_sim.study.paper.evidence import CYCLES, FREQUENCY, JUMP, LATER, Evidence, Values, later, share_where
from tcc_sim.study.paper.figure_results import JumpBehind, MotionsBehind
from tcc_sim.sweeps.executors import each_in_a_process, processes_for, workers
from tcc_sim.sweeps.progress import point_bar, progress_bar
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Sweep
from tcc_sim.trajectory import Floats, State

NEAR = 0.1
"""Largest distance, in natural sizes, between a motion that still settles and the orbit that it approaches."""
RUNS = 5
"""Largest number of continuations by LATER cycles until a motion has a period; it settles slowly near bifurcations."""
CREEP = 3.0
"""Largest slip speed of a motion that creeps in stick, relative to the stick speed of law (7)."""
SMOOTHING = "friction.smoothing"
FEW = replace(SWEPT, longest_period=2, max_points=60, max_branches=5)
"""Branches over one part of an axis."""
WAYS = ("cold", "up", "down")
"""Starts of the values of a sweep: from (13), or from the neighbour below or above."""
SEEDS = 24
LOWEST, HIGHEST = np.array([-50.0, -0.1, -20.0]), np.array([200.0, 0.3, 20.0])
"""Initial states in the search for attractors: number, and ranges of slip speed, plate angle and plate speed."""


def seen_in(sweep: Sweep) -> list[SettledMotion]:
    """Return the motions of a sweep; unsettled ones are continued as for the claims."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> SettledMotion | None:
    """Return one motion of a sweep, continued until it settles if it does."""
    value, point = sweep.curve.values[k], sweep.points[k]
    if point is None or point.summary is None:
        return None
    summary = point.summary
    if not summary.settled:
        return _later(sweep.curve, k, point.end)
    amplitude = summary.max_slip_speed
    if summary.period:  # The maximum in the sweep may belong to a transient.
        system = sweep.curve.at(k)
        together = math.lcm(summary.period, common_cycles(system) or 1)
        cycles = solve(system, cycles=together, start_cycle=point.end.cycle, state=point.end.state).solved_cycles
        amplitude = summarise_cycles(cycles, CycleTimes(system.cycle)).max_slip_speed
    return SettledMotion(value, np.array(point.end.state.numbers), point.end.cycle, summary.period, amplitude)


def _later(curve: Curve, k: int, start: Start) -> SettledMotion | None:
    """Continue a motion from `start` until it settles; it has no period if none is found after RUNS."""
    late = None
    for _ in range(RUNS):
        settled = later(curve.at(k), start)
        if settled is None:
            break
        summary, start = settled
        motion = SettledMotion(curve.values[k], np.array(start.state.numbers), start.cycle, summary.period,
                               summary.max_slip_speed)
        late = approached(curve, motion, summary.settled)
        if late.period:
            break
    return late


def approached(curve: Curve, late: SettledMotion, settled: bool) -> SettledMotion:
    """Return a motion with the period and size of the stable orbit within NEAR that it approaches.

    It has no period if that orbit is unstable, or if there is no such orbit and it has not `settled`. A motion without
    a recognised period may approach a period-one orbit, on alternate sides of it.
    """
    span, goal = ParameterRange(min(curve.values), max(curve.values)), replace(late, period=late.period or 1)
    point = point_of(DrivelineMap(curve.system, (curve.key,)), span, goal)
    if point is not None:
        of, orbit = point.shooting.map, point.orbit
        points = np.array(shifts(of, orbit.section, orbit.values, orbit.period))
        if np.abs((points - diagram.state_at_phase_0(of, late)) / of.scales).max(axis=1).min() < NEAR:
            return replace(goal, amplitude=orbit.seen.largest) if orbit.stable else replace(late, period=0)
    return late if settled else replace(late, period=0)


def still_higher(sweep: Sweep, seen: Sequence[SettledMotion]) -> int:
    """Return how many points of a sweep exceed their motions, since a transient outlasts the dropped cycles."""
    amplitudes = {s.value: s.amplitude for s in seen if s.period}
    shown = ((p.summary.max_slip_speed, amplitudes.get(v)) for v, p in zip(sweep.curve.values, sweep.points)
             if p is not None and p.summary is not None)
    return sum(h is not None and top > (1.0 + ALIKE) * h for top, h in shown)


def surveyed(curve: Curve, seen: Sequence[SettledMotion], progress: bool = False,
             settings: Settings = SWEPT) -> list[Branch]:
    """Follow the branches through motions along a curve, over its values; `progress` shows a count on a terminal."""
    span = ParameterRange(min(curve.values), max(curve.values), name=curve.key)
    with point_bar(progress) as tick:
        return diagram.bifurcation_diagram(DrivelineMap(curve.system, (curve.key,)), span, seen, tick, settings)


def motions_behind(sweeps: Sequence[Sweep], progress: bool = False) -> list[MotionsBehind]:
    """Return branches, bifurcations and jumps behind sweeps of one system over the same values of one key."""
    seen = [seen_in(sweep) for sweep in sweeps]
    branches = surveyed(sweeps[0].curve, [s for row in seen for s in row], progress)
    base = common_cycles(sweeps[0].curve.system)
    bifurcations = [f for branch in branches for f in branch.bifurcations]
    followed, special = [b.as_json() for b in branches], [f.as_json() for f in bifurcations]
    out = []
    for sweep, row in zip(sweeps, seen):
        forward = sorted(row, key=lambda s: s.value)
        jumps = []
        for jump in jumps_of(forward, branches, JUMP, base, sweep.plan.direction):
            ends_stick = jump.bifurcation is not None and creeps(jump.bifurcation, sweep.curve.system)
            number = next((k for k, f in enumerate(bifurcations) if f is jump.bifurcation), None)
            jumps.append(JumpBehind(jump.value, (jump.low, jump.high), (jump.before, jump.after),
                                    "stick_border" if ends_stick else jump.cause, number))
        sentences = diagram.left_out(row, branches, base)
        if higher := still_higher(sweep, row):
            sentences.append(f"{higher} of {len(row)} points show a transient that outlasts the cycles that are "
                             "dropped")
        out.append(MotionsBehind(followed, special, jumps, sentences))
    return out


def motions_behind_each(sweeps: Sequence[Sweep], jobs: int | None = None,
                        progress: bool = False) -> list[MotionsBehind]:
    """Return `motions_behind` for sweeps of different systems, each in a process."""
    if processes_for(len(sweeps), jobs) < 2:
        return [motions_behind([sweep], progress)[0] for sweep in sweeps]
    return [motions for motions, in each_in_a_process(motions_behind, [[s] for s in sweeps], jobs, "curve", progress)]


def creeps(bifurcation: Bifurcation, system: System) -> bool:
    """Return whether a bifurcation of the smoothed law is an end of stick, that is, its motion creeps."""
    if system.friction.law != "smoothed" or bifurcation.kind not in SMOOTH:
        return False
    limit = stick_speed_of(terms_of(system))
    return math.isfinite(limit) and bifurcation.point.orbit.seen.largest <= CREEP * limit


def orbit_behind(system: System, final: State, cycle: int, period: int, largest: float) -> dict[str, Any] | None:
    """Return the periodic orbit at a settled motion with the names of `continue --json`; None without a period."""
    if not period:
        return None
    omega = system.engine.frequency
    point = point_of(DrivelineMap(system, (FREQUENCY,)), ParameterRange(0.5 * omega, 1.5 * omega),
                     SettledMotion(omega, np.array(final.numbers), cycle, period, largest))
    return None if point is None else {"period": point.orbit.period, **point.orbit.figures.as_json()}


@dataclass(frozen=True)
class Motion:
    """Stable motion along a curve, independent of the initial state."""

    curve: str = field(metadata=reported("curve of the figure; empty if there is one only"))
    over: str = field(metadata=reported("name of the axis"))
    from_start: Sequence[float] = field(metadata=reported("places at which the initial state (13) leads to it"))
    stretch: StableSegment = field(metadata=reported("its period and ends", spread=True))

    @property
    @reporting("the motion in a sentence")
    def words(self) -> str:
        """The motion in a sentence."""
        at, where = self.from_start, "nowhere"
        if at:
            where = f"at {' to '.join(dict.fromkeys(f'{x:g}' for x in (min(at), max(at))))} " \
                    f"({counted(len(at), 'value')})"
        name, stretch = f"{self.curve}{': ' if self.curve else ''}", self.stretch
        return (f"{name}period {stretch.period}, stable over {self.over} from {stretch.low} to {stretch.high}; within "
                f"{CYCLES + RUNS * LATER} cycles (13) leads to it {where}")


@dataclass
class StableMotions(Evidence):
    """Evidence with branches.

    known : results that do not depend on the tolerance of the sweeps, by kind, rows and axes as text; evidence at
        several tolerances shares them
    """

    known: dict[str, Any] = field(default_factory=dict)

    def varied(self, name: str, factor: float) -> StableMotions:
        """Return evidence with the same sweeps and motions, and with one threshold times a factor."""
        changed = replace(self.thresholds, **{name: factor * getattr(self.thresholds, name)})
        return replace(self, thresholds=changed, used=set())

    def stretches(self, rows: Sequence[Values], axis: Floats, *, over: str = FREQUENCY) -> list[list[StableSegment]]:
        """Return for every row the stable stretches of the branches through the motions of sweeps in all WAYS.

        Their parameter is that of `curves`. Orbits are solved at 1e-12 for any tolerance of the sweeps.
        """
        def followed(sweeps: Sequence[Sweep]) -> list[StableSegment]:
            curve = sweeps[0].curve
            branches = surveyed(curve, [s for sweep in sweeps for s in seen_in(sweep)], settings=FEW)
            return stable_segments(branches, min(curve.values), max(curve.values), NORMALISED[over][1])

        names = [json.dumps(["stretches", sorted(row.items()), axis.tolist(), over]) for row in rows]
        missing = {name: row for name, row in zip(names, rows) if name not in self.known}
        ways = [self.curves(list(missing.values()), axis, over=over, direction=way) for way in WAYS]
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
        base, size = common_cycles(sweep.curve.system), diagram.amplitude_of(seen)
        at = {s.value: segment_of(replace(s, value=s.value / unit), among, size, base) for s in seen}
        return [at.get(value) for value in sweep.curve.values]

    def motions(self, curve: str, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[Motion]:
        """Return every stretch of a curve with its ends, and the values at which (13) leads to it."""
        among = self.stretches([row], axis, over=over)[0]
        on = self.reached(row, axis, over=over)
        return [Motion(curve, NORMALISED[over][0], [float(x) for x, number in zip(axis, on) if number == k], s)
                for k, s in enumerate(among)]

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
            for way in WAYS:
                curve = (sweep := self.curves([row], axis, direction=way)[0]).curve
                of, span = DrivelineMap(curve.system, (curve.key,)), ParameterRange(curve.values[0], curve.values[-1])
                for seen in seen_in(sweep):
                    k = curve.values.index(seen.value)
                    if seen.period and not periodic[k]:
                        point = point_of(of, span, seen)
                        periodic[k] = point is not None and point.orbit.stable
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


def highest_shares(curves: Sequence[Sequence[Sequence[float]]], where: Any, negligible: float = 0.05,
                   slipping: float = 0.1) -> tuple[float, float]:
    """Return the fractions of the slipping places at which the first curve is the highest, for every choice of a motion
    on each curve and for some choice, from the largest slip speeds of all stable motions, per curve and place, rad/s.
    """
    every, some, moving = np.array([
        (min(first) >= max(map(max, others)) - negligible, max(first) >= max(map(min, others)) - negligible,
         max(map(max, (first, *others))) > slipping) for first, *others in zip(*curves)], dtype=bool).T
    return share_where(every, where & moving), share_where(some, where & moving)
