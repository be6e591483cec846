"""Motions behind the paper's sweeps, branches of periodic motions through them, and causes of the jumps
(`figure --branches`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.diagram import SWEPT, SettledMotion, bifurcation_diagram, left_out, point_of, state_at_phase_0
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.loss_of_stability import jumps_of
from tcc_sim.continuation.newton import shifts
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.continuation.special_points import SMOOTH, Bifurcation
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.evidence import JUMP, later
from tcc_sim.paper.figure_results import JumpBehind, MotionsBehind
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.sweeps.executors import each_in_a_process, processes_for
from tcc_sim.sweeps.progress import point_bar
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Sweep
from tcc_sim.trajectory import State

NEAR = 0.1
"""Largest distance, in natural sizes, between a motion that still settles and the orbit that it approaches."""
RUNS = 5
"""Largest number of continuations by LATER cycles until a motion has a period; it settles slowly near bifurcations."""
CREEP = 3.0
"""Largest slip speed of a motion that creeps in stick, relative to the stick speed of law (7)."""


def seen_in(sweep: Sweep) -> list[SettledMotion]:
    """Return the motions of a sweep; unsettled ones are continued as for the claims."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> SettledMotion | None:
    """Return one motion of a sweep, continued until it settles if it does."""
    value, point = sweep.curve.values[k], sweep.points[k]
    if point is None or point.summary is None:
        return None
    found = point.summary
    if not found.settled:
        return _later(sweep.curve, k, point.end)
    amplitude = found.max_slip_speed
    if found.period:  # The maximum in the sweep may belong to a transient.
        system = sweep.curve.at(k)
        together = math.lcm(found.period, common_cycles(system) or 1)
        cycles = solve(system, cycles=together, start_cycle=point.end.cycle, state=point.end.state).solved_cycles
        amplitude = summarise_cycles(cycles, system.cycle).max_slip_speed
    return SettledMotion(value, np.array(point.end.state.numbers), point.end.cycle, found.period, amplitude)


def _later(curve: Curve, k: int, start: Start) -> SettledMotion | None:
    """Continue a motion from `start` until it settles; it has no period if none is found after RUNS."""
    late = None
    for _ in range(RUNS):
        settled = later(curve.at(k), start)
        if settled is None:
            break
        found, start = settled
        motion = SettledMotion(curve.values[k], np.array(start.state.numbers), start.cycle, found.period,
                               found.max_slip_speed)
        late = approached(curve, motion, found.settled)
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
        if np.abs((points - state_at_phase_0(of, late)) / of.scales).max(axis=1).min() < NEAR:
            return replace(goal, amplitude=orbit.seen.largest) if orbit.stable else replace(late, period=0)
    return late if settled else replace(late, period=0)


def still_higher(sweep: Sweep, seen: Sequence[SettledMotion]) -> int:
    """Return how many points of a sweep exceed their motions, since a transient outlasts the dropped cycles."""
    amplitudes = {s.value: s.amplitude for s in seen if s.period}
    shown = ((p.summary.max_slip_speed, amplitudes.get(v)) for v, p in zip(sweep.curve.values, sweep.points)
             if p is not None and p.summary is not None)
    return sum(h is not None and top > (1.0 + DEFAULTS.alike) * h for top, h in shown)


def surveyed(curve: Curve, seen: Sequence[SettledMotion], progress: bool = False,
             settings: Settings = SWEPT) -> list[Branch]:
    """Follow the branches through motions along a curve, over the range of its values.

    Parameters
    ----------
    progress : show a count of points on a terminal
    """
    of = DrivelineMap(curve.system, (curve.key,))
    with point_bar(progress) as tick:
        return bifurcation_diagram(of, ParameterRange(min(curve.values), max(curve.values), name=curve.key), seen, tick,
                                   settings)


def motions_behind(sweeps: Sequence[Sweep], progress: bool = False) -> list[MotionsBehind]:
    """Return branches, bifurcations and jumps behind each of several sweeps of one system.

    Parameters
    ----------
    sweeps : over the same values of one key, in different directions
    progress : show a count of points on a terminal
    """
    found = [seen_in(sweep) for sweep in sweeps]
    branches = surveyed(sweeps[0].curve, [s for row in found for s in row], progress)
    base = common_cycles(sweeps[0].curve.system)
    bifurcations = [f for branch in branches for f in branch.bifurcations]
    followed, special = [b.as_json() for b in branches], [f.as_json() for f in bifurcations]
    out = []
    for sweep, row in zip(sweeps, found):
        forward = sorted(row, key=lambda s: s.value)
        jumps = []
        for jump in jumps_of(forward, branches, JUMP, base, sweep.plan.direction):
            ends_stick = jump.found is not None and creeps(jump.found, sweep.curve.system)
            number = next((k for k, f in enumerate(bifurcations) if f is jump.found), None)
            jumps.append(JumpBehind(jump.value, (jump.low, jump.high), (jump.before, jump.after),
                                    "stick_border" if ends_stick else jump.cause, number))
        higher, sentences = still_higher(sweep, row), left_out(row, branches, base)
        if higher:
            sentences.append(f"{higher} of {len(row)} points show a transient that outlasts the cycles that are "
                             "dropped")
        out.append(MotionsBehind(followed, special, jumps, sentences))
    return out


def motions_behind_each(sweeps: Sequence[Sweep], jobs: int | None = None,
                        progress: bool = False) -> list[MotionsBehind]:
    """Return `motions_behind` for sweeps of different systems, each in a process."""
    if processes_for(len(sweeps), jobs) < 2:
        return [motions_behind([sweep], progress)[0] for sweep in sweeps]
    tasks = [[sweep] for sweep in sweeps]
    return [found for found, in each_in_a_process(motions_behind, tasks, jobs, "curve", progress)]


def creeps(found: Bifurcation, system: System) -> bool:
    """Return whether a bifurcation of the smoothed law is an end of stick, that is, its motion creeps."""
    if system.friction.law != "smoothed" or found.kind not in SMOOTH:
        return False
    limit = stick_speed_of(terms_of(system))
    return math.isfinite(limit) and found.point.orbit.seen.largest <= CREEP * limit


def orbit_behind(system: System, final: State, cycle: int, period: int, largest: float) -> dict[str, Any] | None:
    """Return the periodic orbit at a settled motion with the names of `continue --json`; None without a period."""
    omega = system.engine.frequency
    of = DrivelineMap(system, ("engine.frequency",))
    state = np.array(final.numbers)
    if not period:
        return None
    point = point_of(of, ParameterRange(0.5 * omega, 1.5 * omega), SettledMotion(omega, state, cycle, period, largest))
    return None if point is None else {"period": point.orbit.period, **point.orbit.figures.as_json()}
