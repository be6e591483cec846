"""What is behind the paper's sweeps: the motions that they came to, settled where they settle at all, the branches of
periodic motions through these with what each jump is (`figure --branches`), and charts, which the paper has not, of
where motions double, fold and stick in a plane of omega and a second key.

For a chart bifurcations are looked for along some rows of a grid of cold starts and followed in both keys; what a curve
has passed already is not followed again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.continuation.branch import Branch, SettledMotion
from tcc_sim.continuation.codim2 import BifurcationCurve, Ranges, bifurcation_curve, border_curve
from tcc_sim.continuation.diagram import SWEPT, bifurcation_diagram, left_out, point_of, state_at_phase_0
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.loss_of_stability import jumps_of
from tcc_sim.continuation.newton import shifts
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.continuation.special_points import SMOOTH, Bifurcation, chandrupatla
from tcc_sim.model.parameters import System
from tcc_sim.model.pure_stick import stick_margin
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.catalogue import NORMALISED, QUICK_SHARE, FigureOptions, PaperFigure, series_system
from tcc_sim.paper.evidence import JUMP, later
from tcc_sim.paper.figure_results import Chart, ChartCurve, JumpBehind, MotionsBehind
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.sweeps.executors import each_in_a_process, point_bar, processes_for
from tcc_sim.sweeps.simulation import Plan
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Sweep, sweep_grid
from tcc_sim.trajectory import State

NEAR = 0.1
"""Distance, in natural sizes, of a motion that still settles from the orbit that it is taken to come to."""
RUNS = 5
"""Times that a motion goes on for LATER cycles until it has a period: near a bifurcation it settles slowly."""
CREEP = 3.0
"""Largest slip speed, in those up to which law (7) counts as stick, at which a motion still creeps in stick."""
FOLLOWED = ("fold", "period_doubling")
LONGEST = 2
FEW = replace(SWEPT, longest_period=LONGEST)
"""Longest period, in those of the excitation, whose bifurcations are followed."""
ENDING = 1.001
"""Largest multiplier of a bifurcation at which stable motions begin or end; others are of unstable ones alone."""
PASSED = 4e-3
"""Distance from a curve, in parts of the axes, within which a bifurcation of its kind and period lies on it."""


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
    """The branches through motions along a curve, over the range of its values.

    Parameters
    ----------
    progress : show a count of points on a terminal
    """
    of = DrivelineMap(curve.system, (curve.key,))
    with point_bar(progress) as tick:
        return bifurcation_diagram(of, ParameterRange(min(curve.values), max(curve.values), name=curve.key), seen, tick,
                                   settings)


def motions_behind(sweeps: Sequence[Sweep], progress: bool = False) -> list[MotionsBehind]:
    """Branches, bifurcations and jumps behind sweeps of one system, for each of them.

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


def chart(row: PaperFigure, options: FigureOptions) -> Chart:
    """Figs. 19 and 20: the grid of cold starts, and the curves."""
    system = series_system(row.series[0], options)
    share = QUICK_SHARE if options.quick else 1
    x, y = (np.linspace(*span, (count - 1) // share + 1)
            for span, count in ((row.span, row.count), (row.second_span, row.second_count)))
    cuts = np.array(row.cuts[::2] if options.quick else row.cuts)
    y = np.unique(np.concatenate([y, cuts]))
    (x_name, x_unit), (y_name, y_unit) = NORMALISED[row.over], NORMALISED[row.second]
    plan = Plan(cycles=100 if options.quick else 150, discard=50)
    grid = sweep_grid(system, row.over, (x * x_unit).tolist(), row.second, (y * y_unit).tolist(), plan,
                      jobs=options.jobs, progress=options.progress)
    ranges = (ParameterRange(row.span[0] * x_unit, row.span[1] * x_unit, name=row.over),
               ParameterRange(row.second_span[0] * y_unit, row.second_span[1] * y_unit, name=row.second))
    curves = stick_borders(system, (row.over, row.second), ranges)
    both = DrivelineMap(system, (row.over, row.second))
    for cut in cuts:
        sweep = grid.sweeps[int(np.argmin(np.abs(y - cut)))]
        for branch in surveyed(sweep.curve, seen_in(sweep), options.progress, FEW):
            for found in branch.bifurcations:
                curve = followed(found, both, ranges, float(cut) * y_unit, curves)
                if curve is not None:
                    curves.append(_charted(curve, found.point.orbit.period, creeps(found, sweep.curve.system)))
    summaries = [[None if p is None else p.summary for p in sweep.points] for sweep in grid.sweeps]
    return Chart(x_name, x.tolist(), x_unit, row.over, y_name, y.tolist(), y_unit, row.second,
                 plan.cycles, 50, curves,
                 period=[[None if s is None else s.period for s in line] for line in summaries],
                 regime=[[None if s is None else "runaway" if s.runaway else s.regime for s in line]
                         for line in summaries])


def followed(found: Bifurcation, of: DrivelineMap, ranges: Ranges, second: float,
              known: list[ChartCurve]) -> BifurcationCurve | None:
    """The curve of a bifurcation; None where it is not of those followed, or lies on a curve that is known."""
    orbit = found.point.orbit
    if found.kind not in FOLLOWED or orbit.period > LONGEST * of.forcing_period or abs(orbit.multipliers[0]) > ENDING:
        return None
    at = np.array([ranges[0].scaled(found.value), ranges[1].scaled(second)])
    for curve in known:
        if (curve.kind, curve.period) == (found.kind, orbit.period) and distance(at, _scaled(curve, ranges)) < PASSED:
            return None
    return bifurcation_curve(found, of, ranges, second, DEFAULTS)


def _scaled(curve: ChartCurve, ranges: Ranges) -> Floats:
    """(n, 2) points of a curve in parts of the axes."""
    return np.array([[ranges[0].scaled(a), ranges[1].scaled(b)] for a, b in zip(curve.value, curve.second)])


def _charted(curve: BifurcationCurve, period: int, creep: bool) -> ChartCurve:
    """A curve as the chart has it."""
    words = f"{curve.kind}, period {period}".replace("_", " ")
    words = "pure stick ends, by (10)" if curve.kind == "stick_border" else words
    return ChartCurve(words, curve.kind, period, creep, curve.values, curve.second, [str(end) for end in curve.ended],
                      [end.reason.name.lower() for end in curve.ended], curve.special)


def distance(at: Floats, line: Floats) -> float:
    """Of a point (2,) from a line through points (n, 2)."""
    if len(line) < 2:
        return float(np.linalg.norm(line - at, axis=1).min(initial=math.inf))
    a, d = line[:-1], np.diff(line, axis=0)
    size = np.maximum((d * d).sum(axis=1), 1e-300)
    part = np.clip(((at - a) * d).sum(axis=1) / size, 0.0, 1.0)
    return float(np.linalg.norm(a + part[:, None] * d - at, axis=1).min())


def stick_borders(system: System, keys: tuple[str, str], ranges: Ranges,
                  count: int = 150) -> list[ChartCurve]:
    """Curves on which pure stick ends by (10), corrected, in the plane of two keys."""
    of = DrivelineMap(system, keys)

    def margin(first: float, second: float) -> float:
        at = of.system_at((first, second))
        return stick_margin(at).torque / (at.friction_ratio * at.saturation_mean)

    out: list[ChartCurve] = []
    for part in (0.0, 0.25, 0.5, 0.75, 1.0):
        second = ranges[1].value(part)
        values = [ranges[0].value(u) for u in np.linspace(0.0, 1.0, count)]
        margins = np.array([margin(v, second) for v in values])
        for k in np.flatnonzero(margins[1:] * margins[:-1] < 0.0):
            root = chandrupatla(partial(margin, second=second), values[k], values[k + 1])
            at = np.array([ranges[0].scaled(root), part])
            if any(distance(at, _scaled(known, ranges)) < PASSED for known in out):
                continue
            curve = border_curve(margin, ranges, root, second)
            if curve is not None:
                out.append(_charted(curve, 1, False))
    return out
