"""Explicit Runge-Kutta steps by a tableau, compiled: the classical method, and Dormand and Prince's pair of order 5(4).

The first has a fixed step, for contrast: it needs steps below about 2.8/(beta Ts sigma). The second is the paper's
"Runge-Kutta 4th(5th) order". Its coefficients, step control (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, II.4) and interpolant of order 4 (Shampine 1986) are those of `scipy.integrate.RK45`, which takes the same
steps. Stability limits them to 3.3/(beta Ts r sigma) in stick, so that calls of Python would take most of the time.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import accelerations, compiled, smoothed_coefficient
from tcc_sim.model.parameters import System
from tcc_sim.solvers.terms import Terms, peak_load, terms_of
from tcc_sim.solvers.torques import piece_at, torques_now
from tcc_sim.trajectory import Floats

KEPT_PER_CYCLE = 4096
"""Most states per cycle for its extremes and stick time."""
SAFETY, LEAST_FACTOR, MOST_FACTOR = 0.9, 0.2, 10.0
"""Factors to the length of a step, as in SciPy."""
PIECES = 64
"""Most points within one step beside the marks."""
AT_ONCE = 1_000_000
"""Steps between two looks at signals."""
SMALLEST = 10.0 * 2.0**-52
"""The shortest step, relative to the time."""
GOES_ON, TOO_SMALL, NOT_FINITE = range(3)
REACH = {"rk4": 2.785, "rk45": 3.3, "dop853": 6.0}
"""Length of the stability region of an explicit method along the negative real axis (Hairer and Wanner, IV.2)."""


def stick_rate(system: System) -> float:
    """Return the fastest rate beta Ts r sigma of the smoothed law, 1/s: that of stick under the largest load."""
    return system.inverse_inertia * peak_load(terms_of(system)) * system.friction_ratio * system.friction.smoothing


def rk4_limit(system: System) -> float:
    """Return the largest step, s, at which the classical method is stable in stick: 2.785/(beta Ts r sigma)."""
    return REACH["rk4"] / stick_rate(system)


@compiled
def rates(t: float, y: Floats, terms: Any, out: Floats) -> None:
    """Fill `out` with y' of (1), (2) with the smoothed law (7); y is (slip speed, plate angle, plate speed[, flywheel
    angle]).
    """
    engine, load = torques_now(t, piece_at(terms.profile, t), terms.profile, terms)
    friction = smoothed_coefficient(y[0], terms.smoothing, terms.stribeck) * load
    out[0], out[2] = accelerations(y[0], y[1], y[2], engine, friction, terms.linear)
    out[1] = y[2]
    if len(y) > 3:
        out[3] = y[0] + y[2]


class Tableau(NamedTuple):
    """Butcher tableau of s stages: weights of the stages, (s, s - 1 or more) and (s,), their times, (s,); error and
    interpolant, (s + 1,) and (s + 1, 4), of which the last row belongs to the slope at the end of the step.
    """

    stages: Floats
    weights: Floats
    times: Floats
    error: Floats
    interpolant: Floats


@cache
def tableau_of(name: str) -> Tableau:
    """Return SciPy's tableau of Dormand and Prince for rk45; that of Kutta (1901) for rk4, with the cubic through both
    ends and their slopes as its interpolant.
    """
    if name == "rk45":
        from scipy.integrate import RK45

        return Tableau(RK45.A, RK45.B, RK45.C, RK45.E, RK45.P)
    weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    interpolant = np.outer(np.append(weights, 0.0), [0.0, 3.0, -2.0, 0.0])
    interpolant[0] += 1.0, -2.0, 1.0, 0.0
    interpolant[-1] += 0.0, -1.0, 1.0, 0.0
    return Tableau(np.diag([0.5, 0.5, 1.0], -1), weights, np.array([0.0, 0.5, 0.5, 1.0]), np.zeros(5), interpolant)


class Wanted(NamedTuple):
    """Rows to store: at marks, s, at most a spacing apart, and step ends at least `least` behind the last row."""

    marks: Floats
    spacing: float
    least: float


def march(name: str, terms: Terms, begin: float, end: float, y: Floats, first_step: float, rtol: float, atol: Floats,
          marks: Floats, samples: Floats, spacing: float, cycle: float) -> tuple[Floats, Floats, int, int]:
    """Solve from `begin` to `end`, within which the excitation has no corner.

    Parameters
    ----------
    name : rk45, or rk4, whose steps are all as long as the first
    y : (n,) array, state at `begin`
    first_step : s
    rtol, atol : tolerances, the latter (n,)
    marks, samples : (m,) and (k,) arrays, rising times in (begin, end] of rows and of samples
    spacing : s, longest time between two rows, as far as PIECES in a step allow
    cycle : s; step ends within 1/KEPT_PER_CYCLE of it after the last row get none

    Returns
    -------
    rows (t, state); states at the samples that were reached; GOES_ON at `end`, else TOO_SMALL or NOT_FINITE; number of
    steps
    """
    points: list[Floats] = []
    ended, steps, tableau, fixed = GOES_ON, 0, tableau_of(name), name == "rk4"
    at, y, k = np.array([begin, first_step, begin]), y.copy(), np.zeros((len(tableau.error), len(y)))
    new, sampled, done = y.copy(), np.empty((len(samples), len(y))), np.zeros(1, np.int64)
    while not points or (at[0] < end and ended == GOES_ON):
        rows = np.empty((len(marks) + 8 * KEPT_PER_CYCLE, 1 + len(y)))
        used, taken, ended = _march(at, end, y, new, k, terms, tableau, fixed, rtol, atol,
                                    Wanted(marks, spacing, cycle / KEPT_PER_CYCLE), rows, samples, sampled, done)
        marks = marks[np.searchsorted(marks, at[2], side="right"):]
        steps += taken
        points.append(rows[:used].copy())
    return np.concatenate(points), sampled[:done[0]], ended, steps


@compiled
def _stages(t: float, h: float, y: Floats, new: Floats, k: Floats, terms: Any, tableau: Tableau) -> None:
    """Fill the rows of k from the second on with the slopes of a step from y, and `new` with the state at its end."""
    count = len(tableau.weights)
    for s in range(1, count + 1):
        for i in range(len(y)):
            total = 0.0
            for j in range(s):
                total += k[j, i] * (tableau.stages[s, j] if s < count else tableau.weights[j])
            new[i] = y[i] + h * total
        rates(t + h * (tableau.times[s] if s < count else 1.0), new, terms, k[s])


@compiled
def _error(h: float, y: Floats, new: Floats, k: Floats, error: Floats, rtol: float, atol: Floats) -> float:
    """Return the sum of the squares of a step's errors per tolerance."""
    square = 0.0
    for i in range(len(y)):
        total = 0.0
        for j in range(len(error)):
            total += k[j, i] * error[j]
        square += (h * total / (atol[i] + rtol * max(abs(y[i]), abs(new[i]))))**2
    return square


@compiled
def _within(row: Floats, x: float, h: float, y: Floats, k: Floats, interpolant: Floats) -> None:
    """Fill a row with the state at the share x of a step."""
    for i in range(len(y)):
        row[i] = y[i]
    for j in range(len(interpolant)):
        p = interpolant[j, 2] + x * interpolant[j, 3]
        share = h * x * (interpolant[j, 0] + x * (interpolant[j, 1] + x * p))
        for i in range(len(y)):
            row[i] += share * k[j, i]


@compiled
def _march(at: Floats, end: float, y: Floats, new: Floats, k: Floats, terms: Any, tableau: Tableau, fixed: bool,
           rtol: float, atol: Floats, wanted: Wanted, rows: Floats, samples: Floats, sampled: Floats,
           done: Any) -> tuple[int, int, int]:
    """Step until `end`, AT_ONCE steps or until `rows` is full; `at` is time, length of the next step, time of the last
    row. Fill `sampled` from its row done[0] on. Return rows, steps, and GOES_ON, TOO_SMALL or NOT_FINITE.
    """
    n, marks = len(y), wanted.marks
    t, h, last = at[0], at[1], at[2]
    used, steps, mark, rejected, length = 0, 0, 0, False, h
    rates(t, y, terms, k[0])
    while t < end and steps < AT_ONCE and used + len(marks) - mark + PIECES + 2 < len(rows):
        smallest = SMALLEST * max(abs(t), 1e-300)
        if not rejected:
            h = max(h, smallest)
        if not h >= smallest:
            return used, steps, TOO_SMALL
        following = min(t + h, end)
        if fixed and following > end - 1e-6 * h:  # The sum of equal steps is rounded.
            following = end
        h = following - t
        _stages(t, h, y, new, k, terms, tableau)
        factor = 1.0
        if fixed:
            size = 0.0
            for i in range(n):
                size += abs(new[i])
            if not size < math.inf:
                return used, steps, NOT_FINITE
        else:
            square = _error(h, y, new, k, tableau.error, rtol, atol)
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
            _within(rows[used, 1:], (target - t) / h, h, y, k, tableau.interpolant)
            used += 1
            mark += marked
        marked = mark < len(marks) and marks[mark] == following
        if marked or following - last >= wanted.least or following == end:
            rows[used, 0] = last = following
            for i in range(n):
                rows[used, 1 + i] = new[i]
            used += 1
            mark += marked
        while done[0] < len(samples) and samples[done[0]] <= following:
            row = sampled[done[0]]
            _within(row, (samples[done[0]] - t) / h, h, y, k, tableau.interpolant)
            for i in range(n):
                row[i] = new[i] if samples[done[0]] == following else row[i]
            done[0] += 1
        t = following
        for i in range(n):
            y[i], k[0, i] = new[i], k[len(k) - 1, i]
        h = length if fixed else h * min(factor, 1.0 if rejected else MOST_FACTOR)
        rejected = False
    at[0], at[1], at[2] = t, h, last
    return used, steps, GOES_ON
