"""The motions that sweeps came to, settled where they settle at all, and the branches through them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.diagram import SWEPT, bifurcation_diagram, point_of, state_at_phase_0
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.newton import shifts
from tcc_sim.continuation.on_branch import SettledMotion
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.model.parameters import System
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.evidence import LATER, later
from tcc_sim.solvers import solve
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.sweep import Curve, Sweep
from tcc_sim.trajectory import State

NEAR = 0.1
"""Distance, in natural sizes, of a motion that still settles from the orbit that it is taken to come to."""
RUNS = 5
"""Times that a motion goes on for LATER cycles until it has a period: near a bifurcation it settles slowly."""


def seen_in(sweep: Sweep) -> list[SettledMotion]:
    """The motions of a sweep; what has not settled within its cycles goes on, as the claims have it."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> SettledMotion | None:
    """One motion of a sweep, settled where it settles at all."""
    value, record = sweep.curve.values[k], sweep.records[k]
    if record is None or record["max_slip_speed"] is None:
        return None
    if record.get("settled", True):
        final, cycle, period, amplitude = (record[k] for k in ("final", "final_cycle", "period", "max_slip_speed"))
        if period:
            amplitude = largest_of(sweep.curve.at(k), final, cycle, period)
        return SettledMotion(value, np.array(final), cycle, period, amplitude)
    return _later(sweep.curve, k, record)


def _later(curve: Curve, k: int, record: Mapping[str, Any]) -> SettledMotion | None:
    """The motion that a record still settles to; without a period where RUNS do not tell one."""
    late = None
    for _ in range(RUNS):
        settled = later(curve.at(k), record)
        if settled is None:
            break
        found, final = settled
        state, cycle = (final.slip_speed, final.plate_angle, final.plate_speed), record["final_cycle"] + LATER
        late = approached(curve,
                          SettledMotion(curve.values[k], np.array(state), cycle, found.period, found.max_slip_speed),
                          found.settled)
        if late.period:
            break
        record = {"final": state, "final_cycle": cycle}
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


def largest_of(system: System, state: Sequence[float], cycle: int, period: int) -> float:
    """Largest |slip speed| of a periodic motion, rad/s: a sweep's may be that of a transient before it.

    Parameters
    ----------
    state : slip speed (rad/s), plate angle (rad), plate speed (rad/s) at the start of engine cycle `cycle`
    period : cycles after which the section repeats
    """
    together = math.lcm(period, common_cycles(system) or 1)
    cycles = solve(system, cycles=together, start_cycle=cycle, state=State(*state)).raise_for_status().cycles
    assert cycles is not None
    return summarise_cycles(cycles, system.cycle).max_slip_speed


def still_higher(sweep: Sweep, seen: Sequence[SettledMotion]) -> int:
    """How many points of a sweep are higher than the motions that they come to: a transient outlasts what is dropped.
    """
    amplitudes = {s.value: s.amplitude for s in seen if s.period}
    shown = ((r["max_slip_speed"], amplitudes.get(v)) for v,
             r in zip(sweep.curve.values, sweep.records) if r is not None)
    return sum(h is not None and top is not None and top > (1.0 + DEFAULTS.alike) * h for top, h in shown)


def surveyed(curve: Curve, seen: Sequence[SettledMotion], progress: bool = False,
             settings: Settings = SWEPT) -> list[Branch]:
    """The branches through motions along a curve, over the range of its values.

    Parameters
    ----------
    progress : show a count of points on a terminal
    """
    of = DrivelineMap(curve.system, (curve.key,))
    with counted(progress) as tick:
        return bifurcation_diagram(of, ParameterRange(min(curve.values), max(curve.values), name=curve.key), seen, tick,
                                   settings)


@contextmanager
def counted(progress: bool) -> Iterator[Callable[[Any], None]]:
    """A function to call with every point; it moves a count where that is wanted and standard error is a terminal."""
    with progress_bar("point", shown=progress) as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.orbit.period}", refresh=False)
            bar.update()

        yield tick
