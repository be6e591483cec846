"""Sweeps over one scene key or a grid of two, on all cores or on a Dask cluster, with results in value order.

Points are independent with the direction cold; up and down follow a curve from neighbour to neighbour, so that only
curves run in parallel. Results do not depend on the number of workers nor on the distribution of tasks.

Workers are threads, for sweeps of any size: the compiled calls of a block of points are one call without the
interpreter lock, which a thread holds for a tenth of its time. Processes would import a user's script again.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.analysis.measured.orders import judder_of
from tcc_sim.analysis.repetition import repetitions
from tcc_sim.analysis.steady import summary as steady
from tcc_sim.analysis.steady.summary import Periodicity, Span, Summary
from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError, SweepInterrupted, WorkersLost
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.parameters import System, given_values, refuse_related
from tcc_sim.model.quantity import MOST_VALUES, sequence_of_numbers
from tcc_sim.result import json_of
from tcc_sim.scene import Scene, system_of
from tcc_sim.solvers import SOLVERS, choose
from tcc_sim.solvers.stroboscopic import ENGINES, LONGEST, solve_runs
from tcc_sim.sweeps import simulation
from tcc_sim.sweeps.executors import AHEAD, Attendance, each_done, workers
from tcc_sim.sweeps.file import SweepFile
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.results import Curve, Grid, Point, Sweep, check_effect, varied
from tcc_sim.sweeps.simulation import Plan, Start
from tcc_sim.trajectory import Floats, Runs, State, Status, joined_runs

RTOL = 1e-6
"""Default relative tolerance of a sweep: that of sections (fig02: 4e-8, set-valued 2e-7). Over the curves of Figs. 4 to
18, 57 values each, the period is that at 1e-10 in all but three of 1995 points.
"""
PHASES_TRIED = 1000
"""Engine cycles among which the nearest phase of the load is searched."""
BATCH, BATCH_CYCLES, DASK_BATCH = 32, 4800, 8
"""Most points that a thread judges at once, most cycles of them, and points in one task on a cluster, which costs the
scheduler about a millisecond.
"""
Points = list[list[Point | None]]
"""Result per curve and value; None if it was not tried yet."""


@simulation.with_plan_fields
def sweep(scene: Scene | System | str, key: str, values: Sequence[float], plan: Plan | None = None, *,
          jobs: int | None = None, dask: str | None = None, out: Path | None = None, progress: bool = False,
          **settings: Any) -> Sweep:
    """Solve a scene at every value of one scene key.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    plan : how; alternatively the fields of `Plan` one by one, such as ``cycles=20``
    jobs, dask, out, progress : as for `sweep_curves`

    Examples
    --------
    >>> result = sweep("slip", "engine.torque_amplitude", [0.0, 20.0], cycles=20)
    >>> result
    <Sweep over engine.torque_amplitude: 2 values from 0 to 20; 2 solved>
    >>> result.columns()["period"].tolist()
    [1, 1]
    """
    curve = Curve(system_of(scene), key, sequence_of_numbers(key, values))
    return sweep_curves([curve], Plan.of(plan, settings), jobs=jobs, dask=dask, out=out, progress=progress)[0]


@simulation.with_plan_fields
def sweep_grid(scene: Scene | System | str, key: str, values: Sequence[float], second_key: str,
               second_values: Sequence[float], plan: Plan | None = None, *, jobs: int | None = None,
               dask: str | None = None, out: Path | None = None, progress: bool = False, **settings: Any) -> Grid:
    """Solve a grid of two scene keys; up and down follow the first one within every row. Otherwise as `sweep`.

    Examples
    --------
    >>> result = sweep_grid("slip", "engine.frequency", [100.0, 120.0],
    ...                    "engine.torque_amplitude", [50.0, 60.0, 70.0], cycles=20)
    >>> len(result.second_values)
    3
    """
    values, second_values = sequence_of_numbers(key, values), sequence_of_numbers(second_key, second_values)
    return Grid(second_key, second_values,
                sweep_curves(curves_of(system_of(scene), key, values, second_key, second_values),
                             Plan.of(plan, settings), jobs=jobs, dask=dask, out=out, progress=progress))


def curves_of(system: System, key: str, values: Sequence[float], second_key: str,
              second_values: Sequence[float]) -> list[Curve]:
    """Return the rows of a grid: one curve over `key` for every value of `second_key`.

    Raises InputError: the same key twice, no value or too many, an unknown key, or a value out of its range.
    """
    if key == second_key:
        raise InputError(f"{key} is swept twice; a grid has two keys")
    refuse_related((key, second_key))
    check_effect(system, second_key)
    if not 1 <= len(values) * len(second_values) <= MOST_VALUES:
        raise InputError(f"a grid has {len(values)} by {len(second_values)} values; it must have 1 to "
                         f"{MOST_VALUES}")
    row = tuple(map(float, values))
    return [Curve(varied(system, second_key, float(x)), key, row) for x in second_values]


def sweep_curves(curves: Sequence[Curve], plan: Plan = simulation.PAPER, *, jobs: int | None = None,
                 dask: str | None = None, out: Path | None = None, head: Mapping[str, Any] | None = None,
                 progress: bool = False, tick: Callable[[Point], None] | None = None) -> list[Sweep]:
    """Solve every point of every curve.

    jobs : threads, which the kernels do not hold up (default: all available cores)
    dask : address of a Dask scheduler whose workers solve instead, such as tcp://127.0.0.1:8786
    out : file to which every point is appended; points of the same sweep in it are not solved again
    head : further values of the first line of that file, such as scene and command
    progress : show a bar on a terminal or in a notebook, elsewhere a line a minute
    tick : called with every point, once it is in the file

    Raises InputError: a wrong plan or number of jobs, no scheduler, or a file with something else; SweepInterrupted:
    Ctrl-C; it carries the finished points; WorkersLost: the scheduler or all of its workers are gone; it carries the
    finished points; MissingPackage: `dask` without the package distributed.
    """
    for curve in curves:
        plan.check(curve.system)
        if plan.seconds(curve.system) is None:
            plan.dropped(plan.most, 0)
    began = time.perf_counter()
    points: Points = [[None] * len(curve.values) for curve in curves]

    def take(c: int, i: int, record: dict[str, Any]) -> None:
        if not (0 <= c < len(curves) and 0 <= i < len(curves[c].values)):
            raise ValueError(f"the sweep has no value {i} of curve {c}")
        points[c][i] = Point.from_record(record, curves[c].at(i))

    try:
        with workers(jobs, dask) as (executor, attendance), closing(
                SweepFile(out, _header(curves, plan), take, head=head)) as file:
            done = sum(p is not None for curve_points in points for p in curve_points)
            with progress_bar("point", sum(map(len, points)), done, progress) as bar:
                batch = DASK_BATCH if dask else _batch(plan, sum(map(len, points)), attendance.threads)
                for c, i, point in _solved(curves, plan, executor, attendance, batch, points):
                    points[c][i] = point
                    if out is not None:
                        file.append(c, i, point.as_record())
                    bar.update()
                    if tick is not None:
                        tick(point)
    except KeyboardInterrupt:
        raise SweepInterrupted(_results(curves, plan, points, began)) from None
    except WorkersLost as lost:
        lost.sweeps = _results(curves, plan, points, began)
        raise
    return _results(curves, plan, points, began)


def _batch(plan: Plan, points: int, threads: int) -> int:
    """Return the number of points that a thread solves in a row and judges at once: more cost less each, but leave the
    threads less to share at the end, and delay Ctrl-C.
    """
    if plan.direction != "cold":
        return 1
    return max(1, min(BATCH, BATCH_CYCLES // plan.most, points // (AHEAD * threads)))


def _header(curves: Sequence[Curve], plan: Plan) -> dict[str, Any]:
    return {"version": code_version(), "plan": json_of(plan),
            "curves": [{"over": c.key, "values": c.values, "scene": given_values(c.system)} for c in curves]}


def _results(curves: Sequence[Curve], plan: Plan, points: Points, began: float) -> list[Sweep]:
    seconds = time.perf_counter() - began
    return [Sweep(curve, plan, curve_points, seconds) for curve, curve_points in zip(curves, points)]


Task = tuple[list[tuple[int, int]], Start | None]
"""Points in the order of solving, each by the numbers of its curve and of its value, and the start; those behind the
first batch are solved from its end.
"""


def _solved(curves: Sequence[Curve], plan: Plan, executor: Executor, attendance: Attendance, batch: int,
            points: Points) -> Iterator[tuple[int, int, Point]]:
    ready = _tasks(curves, plan, batch, points)
    following: deque[Task] = deque()
    plans = [with_sweep_tolerance(curve.system, plan) for curve in curves]

    def submit(task: Task) -> Future[list[Point]]:
        places, start = task[0][:batch], task[1]
        systems, values = [curves[c].at(i) for c, i in places], [curves[c].values[i] for c, i in places]
        return executor.submit(solve_points, systems, values, plans[places[0][0]], start)

    for (places, _), solved in each_done(attendance, lambda: following.popleft() if following else next(ready, None),
                                         submit):
        if rest := places[batch:]:
            (c, last), (_, i) = places[batch - 1], rest[0]
            following.append((rest, _passed_on(curves[c], last, solved[-1], i)))
        for (c, i), point in zip(places, solved):
            yield c, i, point


def _passed_on(curve: Curve, before: int, point: Point, following: int) -> Start:
    """Return the start of a value from the end of its neighbour."""
    return handed_over(curve.at(before), point.end, curve.at(following))


def _tasks(curves: Sequence[Curve], plan: Plan, batch: int, points: Points) -> Iterator[Task]:
    """Yield the tasks that can start: all missing points in batches, or for up and down those of each curve.

    Without a direction a task has points of several curves of a law, since a curve of a scatter may have one value.
    """
    if plan.direction == "cold":
        missing = ((c, i) for c, curve in enumerate(curves) for i in range(len(curve.values)) if points[c][i] is None)
        for _, alike in itertools.groupby(missing, lambda place: curves[place[0]].system.friction.law):
            while places := list(itertools.islice(alike, batch)):
                yield places, None
        return
    for c, curve in enumerate(curves):
        order = np.argsort(curve.values, kind="stable").tolist()[::1 if plan.direction == "up" else -1]
        # A file is written in the order of solving, so what is missing is the end of the curve.
        done = next((k for k, i in enumerate(order) if points[c][i] is None), len(order))
        neighbour = points[c][order[done - 1]] if done else None
        if done < len(order):
            yield [(c, i) for i in order[done:]], None if neighbour is None else _passed_on(
                curve, order[done - 1], neighbour, order[done])


def solve_point(system: System, value: float, plan: Plan, start: Start | None = None) -> Point:
    """Solve one point of a sweep from `start`, by default the system's initial state.

    A numerical failure is the status of the point, without a summary, and its last state is not passed on.
    """
    sampled = system.profile is not None or plan.orders is not None
    result = simulation.simulate(system, with_sweep_tolerance(system, plan), start=start,
                                 samples_per_cycle=simulation.ORDER_SAMPLES if sampled else 0)
    summary, section, judder = result.summary, np.empty((0, 2)), None
    if summary is not None:
        judder = judder_of(result.trajectory, summary.covers[0]) if sampled else None
        section = np.array(summary.section, dtype=np.float64).reshape(-1, 2)
        summary = dataclasses.replace(summary, section=[], section_states=None)
    return Point(value, summary, section, result.confirmed, result.status, result.angles if plan.section_points
                 else None, result.damping, result.lyapunov, result.end, judder, result.orders_at_speeds)


def with_sweep_tolerance(system: System, plan: Plan) -> Plan:
    """Return the plan with the tolerance of a sweep if it has none; settling needs a finer one."""
    entry = SOLVERS[choose(system, plan.solver)]
    if plan.rtol is not None or plan.discard == "auto" or entry.setting != "rtol" or entry.default >= RTOL:
        return plan
    return dataclasses.replace(plan, rtol=RTOL)


def solve_points(systems: Sequence[System], values: Sequence[float], plan: Plan, start: Start | None) -> list[Point]:
    """Solve points one after the other; up and down continue from the previous end."""
    if start is None and in_blocks(systems, plan):
        together = solve_block(systems, values, with_sweep_tolerance(systems[0], plan))
        return [solve_point(system, value, plan) if point is None else point
                for system, value, point in zip(systems, values, together)]
    points: list[Point] = []
    for k, (system, value) in enumerate(zip(systems, values)):
        if k and plan.direction != "cold":
            start = handed_over(systems[k - 1], points[-1].end, system)
        points.append(solve_point(system, value, plan, start))
    return points


def handed_over(before: System, end: Start, system: System) -> Start:
    """Return the start at which a system takes over the motion of another one.

    The state is that on the section, so that the phase of the torque and of its harmonics continues. The phase of the
    load is 2 pi (omega_f/omega) n + psi at cycle n. It continues too if both systems have the same ratio, at any engine
    frequency. For another ratio, n is the cycle of the first thousand with the nearest phase of the load, so that psi
    keeps its meaning.
    """
    ratio, earlier = system.pressure.frequency_ratio, before.pressure.frequency_ratio
    repeats = common_cycles(system)
    if ratio == earlier or repeats == 1:
        return Start(end.state, end.cycle % repeats if repeats else end.cycle)
    trial = np.arange(repeats or PHASES_TRIED)
    turn = ratio * trial - earlier * end.cycle + (system.pressure.phase - before.pressure.phase) / (2.0 * math.pi)
    apart = np.abs(turn - np.round(turn))
    return Start(end.state, int(np.flatnonzero(apart <= apart.min() + 1e-9)[0]))


def in_blocks(systems: Sequence[System], plan: Plan) -> bool:
    """Return whether `solve_block` solves these systems: whole cycles from their initial states by an engine."""
    return (plan.direction == "cold" and plan.orders is None and plan.most <= LONGEST
            and len({system.friction.law for system in systems}) == 1
            and all(system.profile is None and plan.seconds(system) is None
                    and choose(system, plan.solver) in ENGINES for system in systems))


def solve_block(systems: Sequence[System], values: Sequence[float], plan: Plan) -> list[Point | None]:
    """Return the points of systems, for which `in_blocks` holds; None where the solver stopped early."""
    plan.check(systems[0])
    out: list[Point | None] = [None] * len(systems)
    for at, kept, discarded in _kept_runs(systems, plan):
        chosen, count = [systems[k] for k in at], discarded + kept.values.shape[2]
        summaries, sections = summaries_of(kept, [system.cycle for system in chosen], discarded)
        if plan.discard == "auto":
            summaries = [summary if summary.settled or summary.runaway else dataclasses.replace(summary, transient=True)
                         for summary in summaries]
        ends = [Start(State(*last), count) for last in kept.section[:, -1].tolist()]
        confirmed = _confirmed(chosen, plan, kept, summaries, ends)
        for i, k in enumerate(at):
            summary, cycles = summaries[i], kept.cycles(i)
            out[k] = Point(values[k], summary, sections[i][:, [1, 0]], confirmed[i], Status.DONE.value,
                           simulation.angles_of(plan, cycles) if plan.section_points else None,
                           *simulation.requested(chosen[i], plan, cycles, discarded, summary.period, ends[i]), ends[i])
    return out


Kept = tuple[list[int], Runs, int]
"""Numbers of systems, their runs without the dropped cycles, all of one length, and the number of these."""


def _kept_runs(systems: Sequence[System], plan: Plan) -> Iterator[Kept]:
    """Yield the runs; with discard auto each as soon as its section repeats, as `simulation.solve_to_steady_state`."""
    auto = plan.discard == "auto"
    dropped = 0 if auto else plan.dropped(plan.most, steady.default_discard(plan.most))
    going, states, done = list(range(len(systems))), [State.at_start(system) for system in systems], 0
    runs: Runs | None = None
    while going:
        count = min(simulation.BLOCK, plan.most - done) if auto else plan.most
        latest = solve_runs([systems[k] for k in going], states, [done] * len(going), count, plan.rtol, dropped)
        solved, done = np.flatnonzero(latest.done).tolist(), done + count
        if not solved:
            return
        parts = [latest] if runs is None else [runs, latest]
        going, runs = [going[i] for i in solved], joined_runs([part.chosen(solved) for part in parts])
        after = [simulation.repeats_after(runs.cycles(i)) if auto and done >= simulation.WINDOW else None
                 for i in range(len(going))]
        unsettled = min(max(steady.DISCARD, (done + 1) // 2), done - 1) if auto else dropped
        drops = [unsettled if cycles is None else cycles for cycles in after]
        ended = [i for i, cycles in enumerate(after) if cycles is not None or done >= plan.most]
        for discarded in sorted({drops[i] for i in ended}):
            alike = [i for i in ended if drops[i] == discarded]
            yield [going[i] for i in alike], runs.chosen(alike, discarded), discarded
        left = [i for i in range(len(going)) if i not in ended]
        runs, going = runs.chosen(left), [going[i] for i in left]
        states = [State(*last) for last in runs.section[:, -1].tolist()]


def _confirmed(systems: Sequence[System], plan: Plan, runs: Runs, summaries: Sequence[Summary],
               ends: Sequence[Start]) -> list[bool]:
    """Return for which runs the section has settled and further cycles keep its period."""
    confirmed, left = [False] * len(summaries), dict[int, list[int]]()
    for k, summary in enumerate(summaries):
        if summary.period and summary.settled:
            count = simulation.confirming_cycles(summary.period)
            confirmed[k] = steady.repeats_finely(runs.cycles(k), summary.period, 5 * count // 2)
            if not confirmed[k]:
                left.setdefault(count, []).append(k)
    for count, at in left.items():
        # Loads from the end on, so none.
        further = solve_runs([systems[k] for k in at], [ends[k].state for k in at], [ends[k].cycle for k in at], count,
                             plan.rtol, count)
        for i, k in enumerate(at):
            confirmed[k] = bool(further.done[i]) and steady.stays(runs.cycles(k), further.cycles(i),
                                                                  summaries[k].period)
    return confirmed


def summaries_of(runs: Runs, cycles: Sequence[float], dropped: int) -> tuple[list[Summary], list[Floats]]:
    """Return the summaries that `summarise_cycles` gives of runs, all of them done and with loads, without their
    section; and the section, (n, 3) arrays of slip speed, plate angle and plate speed.

    cycles : (m,) length of an engine cycle of each run, s
    dropped : number of cycles dropped before, from cycle 0 on
    """
    section, count = runs.section, runs.values.shape[2]
    most = steady.longest_tried(count + 1)
    points = section / np.array([steady.sizes_of(each, *runs.values[k, :2]) for k, each in enumerate(section)])[:, None]
    repeating = ([Periodicity(*each, most) for each in repetitions(points, most, steady.TOLERANCE)] if most else
                 [steady.of_points(each, most, steady.TOLERANCE) for each in points])
    out, sections = list[Summary](), list[Floats]()
    for k, seconds in enumerate(runs.seconds.tolist()):
        each, since = runs.cycles(k), dropped * cycles[k]
        span = Span(since, since + count * cycles[k])
        summary = steady.without_section(
            repeating[k], steady.slip_grows(each), not repeating[k].period and steady.cycles_drift(each), span,
            steady.sums_of(each, span.seconds), cycles=count + dropped, dropped=dropped, solver=runs.solver,
            elapsed=seconds)
        out.append(summary)
        sections.append(steady.section_of(section[k, 1:], dropped, summary.period))
    return out, sections


__all__ = ["Curve", "Grid", "Plan", "Sweep", "curves_of", "sweep", "sweep_curves", "sweep_grid"]
