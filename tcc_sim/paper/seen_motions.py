"""The motions that sweeps came to, settled where they settle at all, and the branches through them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.diagram import SWEPT, bifurcation_diagram, point_of, state_at_phase_0
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.newton import shifts
from tcc_sim.continuation.on_branch import SettledMotion
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.evidence import later
from tcc_sim.solvers import solve
from tcc_sim.sweeps.progress import point_bar
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Sweep

NEAR = 0.1
"""Distance, in natural sizes, of a motion that still settles from the orbit that it is taken to come to."""
RUNS = 5
"""Times that a motion goes on for LATER cycles until it has a period: near a bifurcation it settles slowly."""


def seen_in(sweep: Sweep) -> list[SettledMotion]:
    """The motions of a sweep; what has not settled within its cycles goes on, as the claims have it."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> SettledMotion | None:
    """One motion of a sweep, settled where it settles at all."""
    value, point = sweep.curve.values[k], sweep.points[k]
    if point is None or point.summary is None:
        return None
    found = point.summary
    if not found.settled:
        return _later(sweep.curve, k, point.end)
    amplitude = found.max_slip_speed
    if found.period:  # A sweep's may be that of a transient before the motion.
        system = sweep.curve.at(k)
        together = math.lcm(found.period, common_cycles(system) or 1)
        cycles = solve(system, cycles=together, start_cycle=point.end.cycle, state=point.end.state).solved_cycles
        amplitude = summarise_cycles(cycles, system.cycle).max_slip_speed
    return SettledMotion(value, np.array(point.end.state.numbers), point.end.cycle, found.period, amplitude)


def _later(curve: Curve, k: int, start: Start) -> SettledMotion | None:
    """The motion that one settles to from `start`; without a period where RUNS do not tell one."""
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
    """A motion with period and size of the stable orbit NEAR that it comes to; without a period where that orbit is
    unstable, which it then leaves, or where there is none and it has not `settled`.

    A motion of which no period can be told yet may still come to one of period one, turn by turn on either side of it.
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
    """How many points of a sweep are higher than the motions that they come to: a transient outlasts what is dropped.
    """
    amplitudes = {s.value: s.amplitude for s in seen if s.period}
    shown = ((p.summary.max_slip_speed, amplitudes.get(v)) for v, p in zip(sweep.curve.values, sweep.points)
             if p is not None and p.summary is not None)
    return sum(h is not None and top > (1.0 + DEFAULTS.alike) * h for top, h in shown)


def surveyed(curve: Curve, seen: Sequence[SettledMotion], progress: bool = False,
             settings: Settings = SWEPT) -> list[Branch]:
    """The branches through motions along a curve, over the range of its values."""
    of = DrivelineMap(curve.system, (curve.key,))
    with point_bar(progress) as tick:
        return bifurcation_diagram(of, ParameterRange(min(curve.values), max(curve.values), name=curve.key), seen, tick,
                                   settings)
