"""A solve as calls of the kernel: many cycles at once, or, where the excitation varies in time, piece by piece."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tcc_sim.model.course import FREQUENCY, FREQUENCY_RATE, TIME, pieces
from tcc_sim.solvers.excitation import SHIFT, STARTED, UNTIL, load_phase
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.smoothed.integrate import Setup
from tcc_sim.trajectory import Floats

BATCH = 4096
"""Engine cycles in one call of the compiled loop."""
NEAR = 1e-9
"""Corners that lie nearer to the end of a cycle, in cycles, count as there."""


class Stretch(NamedTuple):
    """One call: with what, up to how many cycles from the start of the solve, and how many seconds of the one after."""

    setup: Setup
    cycles: int
    rest: float


def stretches_of(problem: Problem, setup: Setup) -> Iterator[Stretch]:
    """The calls that make a solve."""
    if setup.terms.course is not None:
        yield from _varying(problem, setup, setup.terms.course)
        return
    count = problem.whole_cycles
    for cycles in range(BATCH, count, BATCH):
        yield Stretch(setup, cycles, 0.0)
    yield Stretch(setup, count, problem.rest)


def _varying(problem: Problem, setup: Setup, course: Floats) -> Iterator[Stretch]:
    """Engine cycle by engine cycle, and within one from corner to corner."""
    first, count, terms = problem.start_cycle, problem.whole_cycles, setup.terms
    starts = problem.system.cycle_start(first + np.arange(count + 2)).tolist()
    for n in range(count + 1):
        start, following = starts[n], starts[n + 1]
        period, end = following - start, problem.end if n == count else following
        if end - start < NEAR * period:
            return
        near = NEAR * period
        inner = course[:, TIME][(course[:, TIME] > start + near) & (course[:, TIME] < end - near)].tolist()
        shift = load_phase(setup.ratio, terms.pulsation, first + n)
        limits, phase = setup.limits._replace(period=period), 0.0
        for begin, stop in zip([start, *inner], [*inner, end]):
            row = row_of(course, begin, stop, start, phase, shift)
            whole = n < count and stop == following
            yield Stretch(setup._replace(limits=limits, terms=terms._replace(course=row)), n + whole,
                          0.0 if whole else stop - start)
            past = stop - begin
            phase += past * (row[FREQUENCY] + 0.5 * row[FREQUENCY_RATE] * past)


def row_of(course: Floats, begin: float, stop: float, start: float, phase: float, shift: float) -> Floats:
    """The row that the kernel is given from `begin` to `stop`, s, within the cycle that started at `start`; `phase` is
    that since then, and `shift` the load's at the start, rad.
    """
    k = int(pieces(course, 0.5 * (begin + stop)))
    piece, past = course[k], begin - course[k, TIME]
    row = np.empty(SHIFT + 1)
    row[TIME], row[1] = begin - start, phase
    for column in range(FREQUENCY, len(piece), 2):
        row[column], row[column + 1] = piece[column] + piece[column + 1] * past, piece[column + 1]
    ends = course[k + 1, TIME] if k + 1 < len(course) else math.inf
    row[UNTIL], row[STARTED], row[SHIFT] = max(ends, stop) - start, start, shift
    return row


def longest_and_shortest_cycle(course: Floats) -> tuple[float, float]:
    """Bounds of the length of an engine cycle, s."""
    return 2.0 * math.pi / float(course[:, FREQUENCY].min()), 2.0 * math.pi / float(course[:, FREQUENCY].max())
