"""Solve and judge many points of a sweep at once, as arrays; results are those of `solve_point`, point for point."""

from __future__ import annotations

from collections.abc import Sequence

from tcc_sim.analysis.blocks import confirmed_by_repetition, summaries_of
from tcc_sim.analysis.periodicity import stays
from tcc_sim.analysis.summary import Summary, default_discard
from tcc_sim.model.parameters import System
from tcc_sim.solvers import choose
from tcc_sim.solvers.runs import ENGINES, LONGEST, solve_runs
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.simulation import Plan, angles_of, confirming_cycles, requested, start_of
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.trajectory import Runs, State, Status


def in_blocks(systems: Sequence[System], plan: Plan) -> bool:
    """Return whether `solve_block` solves these systems: whole cycles from their initial states by an engine."""
    return (plan.direction == "cold" and plan.orders is None and plan.discard != "auto" and plan.most <= LONGEST
            and len({system.friction.law for system in systems}) == 1
            and all(system.profile is None and plan.seconds(system) is None
                    and choose(system, plan.solver) in ENGINES for system in systems))


def solve_block(systems: Sequence[System], values: Sequence[float], plan: Plan) -> list[Point | None]:
    """Return the points of systems, for which `in_blocks` holds; None where the solver stopped early."""
    plan.check(systems[0])
    discarded = plan.dropped(plan.most, default_discard(plan.most))
    starts = [start_of(system) for system in systems]
    runs = solve_runs(systems, [start.state for start in starts], [start.cycle for start in starts], plan.most,
                      plan.rtol, discarded)
    out: list[Point | None] = [None] * len(systems)
    at = [k for k, done in enumerate(runs.done.tolist()) if done]
    if not at:
        return out
    kept = runs.chosen(at, discarded)
    first = [starts[k].cycle + discarded for k in at]
    summaries, sections = summaries_of(kept, [systems[k].cycle for k in at], first, discarded)
    ends = [Start(State(*last), starts[k].cycle + plan.most) for k, last in zip(at, kept.section[:, -1].tolist())]
    confirmed = _confirmed([systems[k] for k in at], plan, kept, summaries, ends)
    for i, k in enumerate(at):
        system, summary, cycles = systems[k], summaries[i], kept.cycles(i)
        out[k] = Point(values[k], summary, sections[i][:, [1, 0]], confirmed[i], Status.DONE.value,
                       angles_of(plan, cycles) if plan.section_points else None,
                       *requested(system, plan, cycles, first[i], summary.period, ends[i]), ends[i])
    return out


def _confirmed(systems: Sequence[System], plan: Plan, runs: Runs, summaries: Sequence[Summary],
               ends: Sequence[Start]) -> list[bool]:
    """Return for which runs the section has settled and further cycles keep its period."""
    counts = [confirming_cycles(summary.period) for summary in summaries]
    confirmed = confirmed_by_repetition(runs, summaries, [5 * count // 2 for count in counts])
    open_ = [k for k, summary in enumerate(summaries) if summary.period and summary.settled and not confirmed[k]]
    for count in {counts[k] for k in open_}:
        at = [k for k in open_ if counts[k] == count]
        further = solve_runs([systems[k] for k in at], [ends[k].state for k in at], [ends[k].cycle for k in at], count,
                             plan.rtol)
        for i, k in enumerate(at):
            confirmed[k] = bool(further.done[i]) and stays(runs.cycles(k), further.cycles(i), summaries[k].period)
    return confirmed
