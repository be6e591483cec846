"""Branches behind the paper's sweeps, and causes of jumps for `figure --branches`.

Branches do not depend on the initial state, but a motion that no sweep reached is not found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.summary import CycleTimes, Summary, summarise_cycles
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.parameters import System
from tcc_sim.result import reported, result_class
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.study.continuation import branch as diagram
from tcc_sim.study.continuation.bifurcations import Bifurcation
from tcc_sim.study.continuation.branch import ALIKE, SWEPT, Branch, Jump, SettledMotion, jumps_of, point_of
from tcc_sim.study.continuation.motions import DrivelineMap
from tcc_sim.study.continuation.orbits import ParameterRange, Settings, shifts
from tcc_sim.sweeps.executors import each_in_a_process, processes_for
from tcc_sim.sweeps.progress import point_bar
from tcc_sim.sweeps.simulation import Start
from tcc_sim.sweeps.sweep import Curve, Sweep
from tcc_sim.trajectory import State, Status

JUMP = 0.08
"""Least size of a jump, over the curve's largest value."""
LATER, LAST = 500, 100
"""Further cycles for a motion that has not settled, and number of the last ones that determine its period."""
NEAR = 0.1
"""Largest distance, in natural sizes, between a motion that still settles and the orbit that it approaches."""
RUNS = 5
"""Largest number of continuations by LATER cycles until a motion has a period; it settles slowly near bifurcations."""
CREEP = 3.0
"""Largest slip speed of a motion that creeps in stick, relative to the stick speed of law (7)."""


@result_class
class MotionsBehind:
    """Motions behind a curve."""

    branches: list[dict[str, Any]] = reported("as `continue --json` has them", of=(Branch,))
    bifurcations: list[dict[str, Any]] = reported("as `continue --json` has them", of=(Bifurcation,))
    jumps: list[Jump] = reported("jumps of the largest slip speed between neighbours")
    left_out: list[str] = reported("sentences on what was not followed")


def seen_in(sweep: Sweep) -> list[SettledMotion]:
    """Return the motions of a sweep; unsettled ones are continued as for the claims."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> SettledMotion | None:
    """Return one motion of a sweep, continued until it settles; it has no period if none is found after RUNS."""
    value, point = sweep.curve.values[k], sweep.points[k]
    if point is None or point.summary is None:
        return None
    system, summary, start, late = sweep.curve.at(k), point.summary, point.end, None
    excitation = common_cycles(system) or 1
    if summary.settled:
        amplitude, together = summary.max_slip_speed, math.lcm(summary.period, excitation)
        if summary.period:  # The maximum in the sweep may belong to a transient.
            cycles = solve(system, cycles=together, start_cycle=start.cycle, state=start.state).solved_cycles
            amplitude = summarise_cycles(cycles, CycleTimes(system.cycle)).max_slip_speed
        return SettledMotion(value, np.array(start.state.numbers), start.cycle, together, amplitude)
    for _ in range(RUNS):
        settled = later(system, start)
        if settled is None:
            break
        summary, start = settled
        motion = SettledMotion(value, np.array(start.state.numbers), start.cycle,
                               math.lcm(summary.period, excitation), summary.max_slip_speed)
        late = approached(sweep.curve, motion, summary.settled)
        if late.period:
            break
    return late


def approached(curve: Curve, late: SettledMotion, settled: bool) -> SettledMotion:
    """Return a motion with the period and size of the stable orbit within NEAR that it approaches.

    It has no period if that orbit is unstable, or if there is no such orbit and it has not `settled`. A motion without
    a recognised period may approach a period-one orbit, on alternate sides of it.
    """
    span, goal = ParameterRange(min(curve.values), max(curve.values)), replace(
        late, period=late.period or common_cycles(curve.system) or 1)
    point = point_of(DrivelineMap(curve.system, (curve.key,)), span, goal)
    if point is not None:
        of = point.equations.map
        points = np.array(shifts(of, point.section, point.values, point.period))
        if np.abs((points - diagram.state_at_phase_0(of, late)) / of.scales).max(axis=1).min() < NEAR:
            return replace(goal, amplitude=point.seen.largest) if point.stable else replace(late, period=0)
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
        jumps = [replace(jump, cause="stick_border") if jump.bifurcation is not None and creeps(
                     bifurcations[jump.bifurcation], sweep.curve.system) else jump
                 for jump in jumps_of(forward, branches, JUMP, sweep.plan.direction)]
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
    if system.friction.law != "smoothed":
        return False
    limit = stick_speed_of(terms_of(system))
    return math.isfinite(limit) and bifurcation.point.seen.largest <= CREEP * limit


def orbit_behind(system: System, final: State, cycle: int, period: int, largest: float) -> dict[str, Any] | None:
    """Return the periodic orbit at a settled motion with the names of `continue --json`; None without a period."""
    if not period:
        return None
    omega = system.engine.frequency
    point = point_of(DrivelineMap(system, ("engine.frequency",)), ParameterRange(0.5 * omega, 1.5 * omega),
                     SettledMotion(omega, np.array(final.numbers), cycle, period, largest))
    return None if point is None else {"period": point.period, **point.figures.as_json()}


def later(system: System, start: Start, rtol: float | None = None) -> tuple[Summary, Start] | None:
    """Return a summary of the last LAST of LATER further cycles and their end; None if they could not be solved."""
    run = solve(system, cycles=LATER, start_cycle=start.cycle, state=start.state, rtol=rtol)
    if run.status is not Status.DONE or run.cycles is None:
        return None
    first = start.cycle + LATER - LAST
    return summarise_cycles(run.cycles[LATER - LAST:], CycleTimes(system.cycle, first)), Start(run.final, first + LAST)
