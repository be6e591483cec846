"""The real-time solver offline, in the ticks that the node would take."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tcc_sim.compiling.compiled import timed
from tcc_sim.errors import OutOfRange
from tcc_sim.solvers.fixed_step import ITERATION_BOUND, advance_ticks
from tcc_sim.solvers.per_cycle import STAMP, cycles_of_states, hermite
from tcc_sim.solvers.problem import Problem, assemble, rates_along
from tcc_sim.solvers.terms import for_ticks, substeps, terms_of
from tcc_sim.trajectory import Statistics, Status, Trajectory, concatenated, split_cycles

BATCH = 400_000
"""Sub-steps kept in memory at a time."""


def solve(problem: Problem) -> Trajectory:
    """The real-time solver offline, in the ticks that the node would take; `problem.step` is the tick, 1 ms by default.

    Results within a cycle come from every sub-step, so they are as exact as the method and not as coarse as the ticks.
    """
    step = problem.step or 1e-3
    terms = terms_of(problem.system)
    kernel_terms = for_ticks(terms)
    state, flywheel = np.array(problem.first), True if problem.flywheel_angle else None
    t, states = np.array([problem.start]), state[None, :].copy()
    try:
        n = substeps(terms, step)
    except OutOfRange as error:
        return assemble(problem, "fixed_step", t, states, status=Status.REFUSED, detail=str(error))
    ticks = math.ceil((problem.end - problem.start) / step * (1.0 - 1e-13))
    times = problem.sample_times()
    samples, cycles, ends = [states[:0]], [], problem.cycle_starts()
    kept, first, done, total, most, status, seconds = 0, 0, 0, 0, 0, Status.DONE, 0.0
    while done < ticks:
        block = min(ticks - done, max(1, BATCH // n))
        out = np.empty((block * n, len(state)))
        (count, worst), spent = timed(advance_ticks, state, problem.start, step, done, block, n, kernel_terms,
                                       flywheel, out)
        seconds += spent
        total, most = total + count, max(most, worst)
        fresh = problem.start + np.arange(done, done + block)[:, None] * step + np.arange(1, n + 1) * (step / n)
        t, states = np.concatenate([t, fresh.ravel()]), np.concatenate([states, out])
        done += block
        if not np.all(np.isfinite(out)):
            status = Status.NOT_FINITE
            break
        rates = rates_along(t, states, terms)
        due = len(times) if done == ticks else int(np.searchsorted(times, t[-1], side="right"))
        samples.append(np.stack([hermite(times[kept:due], t, states[:, i], rates[:, i]) for i in range(len(state))],
                                axis=1))
        kept = due
        starts = ends[first:] if done == ticks else ends[first:np.searchsorted(ends, t[-1] + STAMP, side="right")]
        cycles.append(replace(cycles_of_states(t, states, terms, starts), starts=starts))
        first += len(cycles[-1])
        keep = max(int(np.searchsorted(t, min(ends[first], t[-1]), side="right")) - 2, 0)
        t, states = t[keep:], states[keep:]
    statistics = Statistics(steps=done * n, iterations=total, iterations_max=most, iterations_bound=ITERATION_BOUND,
                            seconds=seconds)
    whole, rest = split_cycles(concatenated(cycles), problem.whole_cycles) if cycles else (None, None)
    return assemble(problem, "fixed_step", times[:kept], np.concatenate(samples), cycles=whole, rest=rest,
                    status=status, statistics=statistics)
