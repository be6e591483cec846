"""`figure --branches`: the branches of periodic motions behind a figure's points, and what each of its jumps is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcc_sim.continuation.diagram import left_out, point_of
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.jumps import jumps_of
from tcc_sim.continuation.on_branch import SettledMotion
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.continuation.special_points import SMOOTH, Bifurcation
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.evidence import JUMP
from tcc_sim.paper.figure_results import MotionsBehind
from tcc_sim.paper.seen_motions import seen_in, still_higher, surveyed
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.sweeps.processes import each_in_a_process, processes_for
from tcc_sim.sweeps.sweep import Sweep
from tcc_sim.trajectory import State

STICK_BORDER = "stick_border"
CREEP = 3.0
"""Largest slip speed, in those up to which law (7) counts as stick, at which a motion still creeps in stick."""


def motions_behind(sweeps: Sequence[Sweep], progress: bool = False) -> list[MotionsBehind]:
    """Branches, bifurcations and jumps behind sweeps of one system over the same values of one key, for each of them.
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
            entry = jump.as_json(bifurcations)
            if jump.found is not None and creeps(jump.found, sweep.curve.system):
                entry["cause"] = STICK_BORDER
            jumps.append(entry)
        higher, sentences = still_higher(sweep, row), left_out(row, branches, base)
        if higher:
            sentences.append(f"{higher} of {len(row)} points show a transient that outlasts the cycles that are "
                             "dropped")
        out.append(MotionsBehind(followed, special, jumps, sentences))
    return out


def motions_behind_each(sweeps: Sequence[Sweep], jobs: int | None = None,
                        progress: bool = False) -> list[MotionsBehind]:
    """`motions_behind` of every sweep, of systems that differ, each in a process."""
    if processes_for(len(sweeps), jobs) < 2:
        return [motions_behind([sweep], progress)[0] for sweep in sweeps]
    tasks = [[sweep] for sweep in sweeps]
    return [found for found, in each_in_a_process(motions_behind, tasks, jobs, "curve", progress)]


def creeps(found: Bifurcation, system: System) -> bool:
    """Whether a bifurcation of the smoothed law is the end of stick: its motion still creeps."""
    if system.friction.law != "smoothed" or found.kind not in SMOOTH:
        return False
    limit = stick_speed_of(terms_of(system))
    return math.isfinite(limit) and found.point.orbit.seen.largest <= CREEP * limit


def orbit_behind(system: System, final: State, cycle: int, period: int, largest: float) -> dict[str, Any] | None:
    """The periodic orbit at a settled motion, with the names of `continue --json`; None where it has no period."""
    omega = system.engine.frequency
    of = DrivelineMap(system, ("engine.frequency",))
    state = np.array(final.numbers)
    if not period:
        return None
    point = point_of(of, ParameterRange(0.5 * omega, 1.5 * omega), SettledMotion(omega, state, cycle, period, largest))
    return None if point is None else {"period": point.orbit.period, **point.orbit.as_json()}
