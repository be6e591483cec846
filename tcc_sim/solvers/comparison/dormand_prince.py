"""Dormand and Prince's explicit pair of order 5(4), the paper's "Runge-Kutta 4th(5th) order", as one compiled loop.

Coefficients, step control (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.4) and the
interpolant of order 4 (Shampine 1986) are those of `scipy.integrate.RK45`, which takes the same steps; stability holds
them below 3.3/(beta Ts r sigma) in stick, and a call of Python for each of those is what made it slow.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import RK45

from tcc_sim.solvers.comparison.runge_kutta import KEPT_PER_CYCLE, rates
from tcc_sim.solvers.compiling.compiled import compiled
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import Floats

SAFETY, LEAST_FACTOR, MOST_FACTOR = 0.9, 0.2, 10.0
"""By how much the length of a step changes, as in SciPy."""
PIECES = 64
"""Most points kept within one step beside the times asked for."""
AT_ONCE = 1_000_000
"""Steps between two looks at signals."""
SMALLEST = 10.0 * 2.0**-52
"""The shortest step, relative to the time."""
GOES_ON, TOO_SMALL = 0, 1


class Tables(NamedTuple):
    """The Butcher tableau: weights of the stages, (6, 5) and (6,), their times, (6,), error, (7,), interpolant, (7, 4).
    """

    stages: Floats
    weights: Floats
    times: Floats
    error: Floats
    interpolant: Floats


TABLES = Tables(RK45.A, RK45.B, RK45.C, RK45.E, RK45.P)


class Wanted(NamedTuple):
    """Which rows are kept: at times, s, no more than a spacing apart, and step ends no nearer to the last row than
    `least`.
    """

    marks: Floats
    spacing: float
    least: float


class Piece(NamedTuple):
    """What a march through a piece of time came to: rows (t, state), how it ended (GOES_ON at `end`), and steps."""

    rows: Floats
    ended: int
    steps: int


def prepare(terms: Terms, y: Floats) -> None:
    """Compile what `march` calls for these terms and states like `y`."""
    march(terms, 0.0, 0.0, y, 0.0, 0.0, y, y[:0], 0.0, 0.0)


def march(terms: Terms, begin: float, end: float, y: Floats, first_step: float, rtol: float, atol: Floats,
          marks: Floats, spacing: float, cycle: float) -> Piece:
    """Solve from `begin` to `end`, within which the excitation has no corner.

    Parameters
    ----------
    y : (n,) array, state at `begin`
    first_step : s, tried first
    rtol, atol : tolerances, the latter (n,)
    marks : (m,) array, rising times in (begin, end] that get rows of their own
    spacing : s, the longest way between two rows, as far as PIECES in a step allow
    cycle : s; step ends nearer than 1/KEPT_PER_CYCLE of it to the last row get none
    """
    found: list[Floats] = []
    ended, steps = GOES_ON, 0
    at, y, k = np.array([begin, first_step, begin]), y.copy(), np.zeros((7, len(y)))
    new = y.copy()
    while not found or (at[0] < end and ended == GOES_ON):
        rows = np.empty((len(marks) + 8 * KEPT_PER_CYCLE, 1 + len(y)))
        used, taken, ended = _advance(at, end, y, new, k, terms, TABLES, rtol, atol,
                                      Wanted(marks, spacing, cycle / KEPT_PER_CYCLE), rows)
        marks = marks[np.searchsorted(marks, at[2], side="right"):]
        steps += taken
        found.append(rows[:used].copy())
    return Piece(np.concatenate(found), ended, steps)


@compiled
def _stages(t: float, h: float, y: Floats, new: Floats, k: Floats, terms: Any, tables: Tables) -> None:
    """The slopes of a step from y into rows 1 to 6 of k, and the state at its end into `new`."""
    for s in range(1, 7):
        for i in range(len(y)):
            total = 0.0
            for j in range(s):
                total += k[j, i] * (tables.stages[s, j] if s < 6 else tables.weights[j])
            new[i] = y[i] + h * total
        rates(t + h * (tables.times[s] if s < 6 else 1.0), new, terms, k[s])


@compiled
def _error(h: float, y: Floats, new: Floats, k: Floats, error: Floats, rtol: float, atol: Floats) -> float:
    """The sum of the squares of a step's errors, relative to what is allowed."""
    square = 0.0
    for i in range(len(y)):
        total = 0.0
        for j in range(7):
            total += k[j, i] * error[j]
        square += (h * total / (atol[i] + rtol * max(abs(y[i]), abs(new[i]))))**2
    return square


@compiled
def _within(row: Floats, x: float, h: float, y: Floats, k: Floats, interpolant: Floats) -> None:
    """The state at the share x of a step into row[1:]."""
    for i in range(len(y)):
        row[1 + i] = y[i]
    for j in range(7):
        p = interpolant[j, 2] + x * interpolant[j, 3]
        share = h * x * (interpolant[j, 0] + x * (interpolant[j, 1] + x * p))
        for i in range(len(y)):
            row[1 + i] += share * k[j, i]


@compiled
def _advance(at: Floats, end: float, y: Floats, new: Floats, k: Floats, terms: Any, tables: Tables, rtol: float,
             atol: Floats, wanted: Wanted, rows: Floats) -> tuple[int, int, int]:
    """Steps until `end`, AT_ONCE of them or `rows` is full; `at` is time, length of the next step and time of the last
    row, (3,). Gives rows used, steps taken and how it ended.
    """
    n, marks = len(y), wanted.marks
    t, h, last = at[0], at[1], at[2]
    used, steps, mark, rejected = 0, 0, 0, False
    rates(t, y, terms, k[0])
    while t < end and steps < AT_ONCE and used + len(marks) - mark + PIECES + 2 < len(rows):
        smallest = SMALLEST * max(abs(t), 1e-300)
        if not rejected:
            h = max(h, smallest)
        if not h >= smallest:
            return used, steps, TOO_SMALL
        following = min(t + h, end)
        h = following - t
        _stages(t, h, y, new, k, terms, tables)
        square = _error(h, y, new, k, tables.error, rtol, atol)
        factor = MOST_FACTOR if square == 0.0 else SAFETY * (square / n)**-0.1
        if not square < n:
            h *= max(factor, LEAST_FACTOR) if square < math.inf else LEAST_FACTOR
            rejected = True
            continue
        steps += 1
        stride = max(wanted.spacing, h / PIECES)
        while True:
            marked = mark < len(marks) and marks[mark] <= last + stride
            target = marks[mark] if marked else last + stride
            if target >= following:
                break
            rows[used, 0] = last = target
            _within(rows[used], (target - t) / h, h, y, k, tables.interpolant)
            used += 1
            mark += marked
        marked = mark < len(marks) and marks[mark] == following
        if marked or following - last >= wanted.least or following == end:
            rows[used, 0] = last = following
            for i in range(n):
                rows[used, 1 + i] = new[i]
            used += 1
            mark += marked
        t = following
        for i in range(n):
            y[i], k[0, i] = new[i], k[6, i]
        h *= min(factor, 1.0 if rejected else MOST_FACTOR)
        rejected = False
    at[0], at[1], at[2] = t, h, last
    return used, steps, GOES_ON
