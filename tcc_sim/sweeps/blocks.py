"""Solve and judge many points of a sweep at once, as arrays; results are those of `solve_point`, point for point."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from tcc_sim.analysis.repetition import repetitions
from tcc_sim.analysis.steady.summary import (
    DISCARD,
    TOLERANCE,
    Periodicity,
    Span,
    Summary,
    default_discard,
    drifts,
    finely_repeated,
    longest_tried,
    of_points,
    section_of,
    slip_grows,
    stays,
    sums_from,
    without_section,
)
from tcc_sim.model.parameters import System
from tcc_sim.solvers import choose
from tcc_sim.solvers.stroboscopic import ENGINES, LONGEST, solve_runs
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.simulation import Plan, angles_of, confirming_cycles, requested, start_of
from tcc_sim.sweeps.steady_state import BLOCK, WINDOW, Start, repeats_after
from tcc_sim.trajectory import Floats, Runs, State, Status, joined_runs


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
    for at, kept, discarded in (_settled_runs if plan.discard == "auto" else _whole_runs)(systems, plan):
        chosen, count = [systems[k] for k in at], discarded + kept.highest.shape[1]
        summaries, sections = summaries_of(kept, [system.cycle for system in chosen], [discarded] * len(at), discarded)
        if plan.discard == "auto":
            summaries = [summary if summary.settled or summary.runaway else dataclasses.replace(summary, transient=True)
                         for summary in summaries]
        ends = [Start(State(*last), count) for last in kept.section[:, -1].tolist()]
        confirmed = _confirmed(chosen, plan, kept, summaries, ends)
        for i, k in enumerate(at):
            summary, cycles = summaries[i], kept.cycles(i)
            out[k] = Point(values[k], summary, sections[i][:, [1, 0]], confirmed[i], Status.DONE.value,
                           angles_of(plan, cycles) if plan.section_points else None,
                           *requested(chosen[i], plan, cycles, discarded, summary.period, ends[i]), ends[i])
    return out


Kept = tuple[list[int], Runs, int]
"""Numbers of systems, their runs without the dropped cycles, all of one length, and the number of these."""


def _whole_runs(systems: Sequence[System], plan: Plan) -> Iterator[Kept]:
    discarded = plan.dropped(plan.most, default_discard(plan.most))
    runs = solve_runs(systems, [start_of(system).state for system in systems], [0] * len(systems), plan.most, plan.rtol,
                      discarded)
    at = np.flatnonzero(runs.done).tolist()
    if at:
        yield at, runs.chosen(at, discarded), discarded


def _settled_runs(systems: Sequence[System], plan: Plan) -> Iterator[Kept]:
    """Yield the runs until their sections repeat, as `steady_state.solve_to_steady_state` solves them."""
    going, states, done = list(range(len(systems))), [start_of(system).state for system in systems], 0
    runs: Runs | None = None
    while going:
        count = min(BLOCK, plan.most - done)
        latest = solve_runs([systems[k] for k in going], states, [done] * len(going), count, plan.rtol, 0)
        solved, done = np.flatnonzero(latest.done).tolist(), done + count
        if not solved:
            return
        parts = [latest] if runs is None else [runs, latest]
        going, runs = [going[i] for i in solved], joined_runs([part.chosen(solved) for part in parts])
        after = [repeats_after(runs.cycles(i)) if done >= WINDOW else None for i in range(len(going))]
        unsettled = min(max(DISCARD, (done + 1) // 2), done - 1)
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
    counts = [confirming_cycles(summary.period) for summary in summaries]
    confirmed = confirmed_by_repetition(runs, summaries, [5 * count // 2 for count in counts])
    open_ = [k for k, summary in enumerate(summaries) if summary.period and summary.settled and not confirmed[k]]
    for count in {counts[k] for k in open_}:
        at = [k for k in open_ if counts[k] == count]
        # Loads from the end on, so none.
        further = solve_runs([systems[k] for k in at], [ends[k].state for k in at], [ends[k].cycle for k in at], count,
                             plan.rtol, count)
        for i, k in enumerate(at):
            confirmed[k] = bool(further.done[i]) and stays(runs.cycles(k), further.cycles(i), summaries[k].period)
    return confirmed


def summaries_of(runs: Runs, cycles: Sequence[float], first: Sequence[int],
                 dropped: int) -> tuple[list[Summary], list[Floats]]:
    """Return the summaries that `summarise_cycles` gives of runs, all of them done and with loads, without their
    section; and the section, (n, 3) arrays of slip speed, plate angle and plate speed.

    cycles, first : (m,) length of an engine cycle of each run, s, and the number of its first cycle
    dropped : number of cycles dropped before
    """
    section, high, low, stick = runs.section, runs.highest, runs.lowest, runs.stick_time
    assert runs.loads is not None
    count = high.shape[1]
    away = [maybe and slip_grows(runs.cycles(k)) for k, maybe in enumerate(_slips_at_the_end(high, low, stick))]
    most = longest_tried(count + 1)
    points = section / _sizes_of(section, high, low)[:, None]
    repeating = ([Periodicity(*each, most) for each in repetitions(points, most, TOLERANCE)] if most else
                 [of_points(each, most, TOLERANCE) for each in points])
    without = np.array([not each.period for each in repeating])
    drifting = without.copy()
    drifting[without] = drifts(np.maximum(np.abs(high), np.abs(low))[without])
    loads = runs.loads
    sums = zip(loads[:, 0].sum(axis=1).tolist(), loads[:, 1].max(axis=1).tolist(), loads[:, 2].max(axis=1).tolist(),
               loads[:, 3].min(axis=1).tolist(), loads[:, 4].sum(axis=1).tolist(), loads[:, 5].sum(axis=1).tolist())
    out, sections = list[Summary](), list[Floats]()
    for k, (top, bottom, stuck, each, seconds) in enumerate(zip(
            high.max(axis=1).tolist(), low.min(axis=1).tolist(), stick.sum(axis=1).tolist(), sums,
            runs.seconds.tolist())):
        since = first[k] * cycles[k]
        span = Span(since, since + count * cycles[k])
        summary = without_section(
            repeating[k], away[k], bool(drifting[k]), span, sums_from(top, bottom, stuck, span.seconds, each),
            cycles=count + dropped, dropped=dropped, solver=runs.solver, elapsed=seconds)
        out.append(summary)
        sections.append(section_of(section[k, 1:], first[k], summary.period))
    return out, sections


def confirmed_by_repetition(runs: Runs, summaries: Sequence[Summary], counts: Sequence[int]) -> list[bool]:
    """Return which runs with a settled period repeat as closely as `repeats_finely` asks, over `counts` cycles each."""
    fine = [False] * len(summaries)
    for period in {summary.period for summary in summaries if summary.settled and summary.period}:
        at = [k for k, summary in enumerate(summaries) if summary.settled and summary.period == period]
        points = runs.section[at, max(runs.section.shape[1] - counts[at[0]] - period, 0):]
        if points.shape[1] < counts[at[0]] + period:
            continue
        for k, close in zip(at, finely_repeated(points, period).tolist()):
            fine[k] = close
    return fine


def _slips_at_the_end(high: Floats, low: Floats, stick: Floats) -> list[bool]:
    """Return whether the last ninth of the cycles of each run slips in one direction, without which none runs away."""
    last = max(high.shape[1] // 9, 1) * 3
    slips = (high[:, -last:] * low[:, -last:] > 0.0) & (stick[:, -last:] == 0.0)
    slipping: list[bool] = slips.all(axis=1).tolist()
    return slipping


def _sizes_of(section: Floats, high: Floats, low: Floats) -> Floats:
    v, angle, w = np.abs(section).max(axis=1).T
    speed = np.maximum.reduce([v, w, np.abs(high).max(axis=1), np.abs(low).max(axis=1)])
    fast, far = np.maximum(speed, 1e-6 * angle), np.maximum(angle, 1e-6 * speed)
    fast, far = np.where(fast == 0.0, 1.0, fast), np.where(far == 0.0, 1.0, far)
    return np.stack([fast, far, fast], axis=1)
