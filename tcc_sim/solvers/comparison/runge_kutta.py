"""Explicit Runge-Kutta methods as compiled loops: the classical one, and Dormand and Prince's pair of order 5(4).

The first has a fixed step, for contrast: it needs steps below about 2.8/(beta Ts sigma). The second is the paper's
"Runge-Kutta 4th(5th) order". Its coefficients, step control (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, II.4) and interpolant of order 4 (Shampine 1986) are those of `scipy.integrate.RK45`, which takes the same
steps. Stability limits them to 3.3/(beta Ts r sigma) in stick, so that calls of Python would take most of the time.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import accelerations, compiled, smoothed_coefficient
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.per_cycle import cycles_of_states
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.terms import Terms, peak_load, piece_of, terms_of
from tcc_sim.solvers.torques import piece_at, torques_now
from tcc_sim.trajectory import Floats, Statistics, Status, Trajectory, concatenated, split_cycles

STEPS = 2_000_000_000
"""Most steps of one solve."""
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
GOES_ON, TOO_SMALL = 0, 1
REACH = {"rk4": 2.785, "rk45": 3.3, "dop853": 6.0}
"""Length of the stability region of an explicit method along the negative real axis (Hairer and Wanner, IV.2)."""


def stick_rate(system: System) -> float:
    """Return the fastest rate beta Ts r sigma of the smoothed law, 1/s: that of stick under the largest load."""
    return system.inverse_inertia * peak_load(terms_of(system)) * system.friction_ratio * system.friction.smoothing


def rk4_limit(system: System) -> float:
    """Return the largest step, s, at which the classical method is stable in stick: 2.785/(beta Ts r sigma)."""
    return REACH["rk4"] / stick_rate(system)


def rk4(problem: Problem) -> Trajectory:
    """Solve by classical Runge-Kutta (Kutta 1901) with equal steps of at most `problem.step` between ends of cycles.

    A sample within a step comes from a shorter step of its own, so that samples change nothing else. Too large a step
    blows up, and the run ends with Status.NOT_FINITE at the last finite sample; or stick rings, and the run's `detail`
    says so.
    """
    terms = terms_of(problem.system)
    step = SOLVERS["rk4"].default if problem.step is None else problem.step
    cycle = problem.system.cycle
    y, width = np.array([*problem.state.numbers, problem.state.flywheel_angle]), len(problem.first)
    samples, ends = problem.sample_times(), problem.cycle_starts()
    total = (problem.end - problem.start) / step
    if total > STEPS:
        return assemble(problem, "rk4", samples[:1], y[None, :width], status=Status.REFUSED,
                        detail=f"{total:.3g} steps of {step:g} s are more than {STEPS:.3g}")
    inner = problem.breaks()[1:-1]
    _advance(problem.start, step, 0, 1, y.copy(), terms, np.empty((1, 4)), samples[:0], np.empty((0, 4)))
    began = time.perf_counter()
    stored, sections, steps, status, reached = [y.copy()[None, :]], [], 0, Status.DONE, problem.start
    for n, low in enumerate(ends):
        high = ends[n + 1] if n + 1 < len(ends) else samples[-1]
        marks = np.append(inner[(inner > low) & (inner < high)], high)
        rows = []
        for a, b in pairwise([low, *marks] if low < high else []):
            count = max(math.ceil((b - a) / step * (1.0 - 1e-12)), 1)
            stride = max(math.ceil(count * cycle / (b - a) / KEPT_PER_CYCLE), 1)
            out = np.empty(((count - 1) // stride + 2, 4))
            within = samples[(samples > a) & (samples <= b)]
            sampled = np.empty((len(within), 4))
            used = _advance(a, (b - a) / count, count, stride, y, piece_of(terms, a, b), out, within, sampled)
            steps += count
            out[used - 1, 0] = b
            finite = int(np.isfinite(sampled).all(axis=1).sum())
            stored.append(sampled[:finite])
            if not np.all(np.isfinite(y)):
                status = Status.NOT_FINITE
                break
            rows += [out[:used - (b < high)]]
            reached, last = b, y.copy()
        if status is not Status.DONE:
            break
        if rows:
            r = np.concatenate(rows)
            sections.append(replace(cycles_of_states(r[:, 0], r[:, 1:], terms, ends[n:n + 2]), starts=ends[n:n + 2]))
    states = np.concatenate(stored)[:, :width]
    times = samples[:len(states)]
    if reached > times[-1]:  # The end of the last cycle before the run was no longer finite.
        times, states = np.append(times, reached), np.concatenate([states, last[None, :width]])
    whole, rest = split_cycles(concatenated(sections), problem.whole_cycles) if sections else (None, None)
    stuck = any(part is not None and part.stick_time.any() for part in (whole, rest))
    limit = rk4_limit(problem.system) if stuck and status is Status.DONE else math.inf
    return assemble(problem, "rk4", times, states, cycles=whole, rest=rest, status=status, detail=(
                    f"the step of {step:g} s is above {limit:.3g} s, the largest one that is stable in stick"
                    if step > limit else ""),
                    statistics=Statistics(steps=steps, seconds=time.perf_counter() - began))


@compiled
def slopes(t: float, v: float, plate_angle: float, plate_speed: float, terms: Any) -> tuple[float, float]:
    """Return v' and omega2' of (2) with the smoothed law (7), rad/s^2."""
    engine, load = torques_now(t, piece_at(terms.profile, t), terms.profile, terms)
    friction = smoothed_coefficient(v, terms.smoothing, terms.stribeck) * load
    return accelerations(v, plate_angle, plate_speed, engine, friction, terms.linear)  # type: ignore[no-any-return]


@compiled
def rates(t: float, y: Floats, terms: Any, out: Floats) -> None:
    """Fill `out` with y' of (1), (2); y is (slip speed, plate angle, plate speed[, flywheel angle])."""
    out[0], out[2] = slopes(t, y[0], y[1], y[2], terms)
    out[1] = y[2]
    if len(y) > 3:
        out[3] = y[0] + y[2]


@compiled
def _advance(start: float, h: float, count: int, stride: int, y: Floats, terms: Terms, out: Floats, samples: Floats,
             sampled: Floats) -> int:
    """Take `count` steps in place; fill rows (t, v, theta2, omega2) every `stride` steps and at the end, and return
    their number. Fill `sampled` with the states at `samples`, which rise from `start` to the end.
    """
    state = (y[0], y[1], y[2], y[3])
    used = mark = 0
    for i in range(count + 1):
        t = start + i * h
        if i % stride == 0 or i == count:
            out[used, 0], out[used, 1], out[used, 2], out[used, 3] = t, state[0], state[1], state[2]
            used += 1
        while mark < len(samples) and (i == count or samples[mark] < t + h * (1.0 - 1e-9)):
            rest = samples[mark] - t
            at = _stepped(t, rest, state, terms) if i < count and rest > 1e-9 * h else state
            for k in range(4):
                sampled[mark, k] = at[k]
            mark += 1
        if i < count:
            state = _stepped(t, h, state, terms)
    for k in range(4):
        y[k] = state[k]
    return used


@compiled
def _stepped(t: float, h: float, state: tuple[float, float, float, float],
             terms: Any) -> tuple[float, float, float, float]:
    """Return the state (v, theta2, omega2, theta1) after one step."""
    v, q, w, f = state
    a1, b1 = slopes(t, v, q, w, terms)
    v2, w2 = v + 0.5 * h * a1, w + 0.5 * h * b1
    a2, b2 = slopes(t + 0.5 * h, v2, q + 0.5 * h * w, w2, terms)
    v3, w3 = v + 0.5 * h * a2, w + 0.5 * h * b2
    a3, b3 = slopes(t + 0.5 * h, v3, q + 0.5 * h * w2, w3, terms)
    v4, w4 = v + h * a3, w + h * b3
    a4, b4 = slopes(t + h, v4, q + h * w3, w4, terms)
    return (v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4), q + h / 6.0 * (w + 2.0 * (w2 + w3) + w4),
            w + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4),
            f + h / 6.0 * (v + w + 2.0 * (v2 + w2 + v3 + w3) + v4 + w4))


class Tableau(NamedTuple):
    """Butcher tableau: weights of the stages, (6, 5) and (6,), their times, (6,), error, (7,), interpolant, (7, 4)."""

    stages: Floats
    weights: Floats
    times: Floats
    error: Floats
    interpolant: Floats


@cache
def dormand_prince() -> Tableau:
    """Return SciPy's tableau of Dormand and Prince."""
    from scipy.integrate import RK45

    return Tableau(RK45.A, RK45.B, RK45.C, RK45.E, RK45.P)


class Wanted(NamedTuple):
    """Rows to store: at marks, s, at most a spacing apart, and step ends at least `least` behind the last row."""

    marks: Floats
    spacing: float
    least: float


def march(terms: Terms, begin: float, end: float, y: Floats, first_step: float, rtol: float, atol: Floats,
          marks: Floats, samples: Floats, spacing: float, cycle: float) -> tuple[Floats, Floats, int, int]:
    """Solve from `begin` to `end`, within which the excitation has no corner.

    Parameters
    ----------
    y : (n,) array, state at `begin`
    first_step : s
    rtol, atol : tolerances, the latter (n,)
    marks, samples : (m,) and (k,) arrays, rising times in (begin, end] of rows and of samples
    spacing : s, longest time between two rows, as far as PIECES in a step allow
    cycle : s; step ends within 1/KEPT_PER_CYCLE of it after the last row get none

    Returns
    -------
    rows (t, state); states at the samples that were reached; GOES_ON at `end`, else TOO_SMALL; number of steps
    """
    points: list[Floats] = []
    ended, steps = GOES_ON, 0
    at, y, k = np.array([begin, first_step, begin]), y.copy(), np.zeros((7, len(y)))
    new, sampled, done = y.copy(), np.empty((len(samples), len(y))), np.zeros(1, np.int64)
    while not points or (at[0] < end and ended == GOES_ON):
        rows = np.empty((len(marks) + 8 * KEPT_PER_CYCLE, 1 + len(y)))
        used, taken, ended = _march(at, end, y, new, k, terms, dormand_prince(), rtol, atol,
                                    Wanted(marks, spacing, cycle / KEPT_PER_CYCLE), rows, samples, sampled, done)
        marks = marks[np.searchsorted(marks, at[2], side="right"):]
        steps += taken
        points.append(rows[:used].copy())
    return np.concatenate(points), sampled[:done[0]], ended, steps


@compiled
def _stages(t: float, h: float, y: Floats, new: Floats, k: Floats, terms: Any, tableau: Tableau) -> None:
    """Fill rows 1 to 6 of k with the slopes of a step from y, and `new` with the state at its end."""
    for s in range(1, 7):
        for i in range(len(y)):
            total = 0.0
            for j in range(s):
                total += k[j, i] * (tableau.stages[s, j] if s < 6 else tableau.weights[j])
            new[i] = y[i] + h * total
        rates(t + h * (tableau.times[s] if s < 6 else 1.0), new, terms, k[s])


@compiled
def _error(h: float, y: Floats, new: Floats, k: Floats, error: Floats, rtol: float, atol: Floats) -> float:
    """Return the sum of the squares of a step's errors per tolerance."""
    square = 0.0
    for i in range(len(y)):
        total = 0.0
        for j in range(7):
            total += k[j, i] * error[j]
        square += (h * total / (atol[i] + rtol * max(abs(y[i]), abs(new[i]))))**2
    return square


@compiled
def _within(row: Floats, x: float, h: float, y: Floats, k: Floats, interpolant: Floats) -> None:
    """Fill a row with the state at the share x of a step."""
    for i in range(len(y)):
        row[i] = y[i]
    for j in range(7):
        p = interpolant[j, 2] + x * interpolant[j, 3]
        share = h * x * (interpolant[j, 0] + x * (interpolant[j, 1] + x * p))
        for i in range(len(y)):
            row[i] += share * k[j, i]


@compiled
def _march(at: Floats, end: float, y: Floats, new: Floats, k: Floats, terms: Any, tableau: Tableau, rtol: float,
           atol: Floats, wanted: Wanted, rows: Floats, samples: Floats, sampled: Floats,
           done: Any) -> tuple[int, int, int]:
    """Step until `end`, AT_ONCE steps or until `rows` is full; `at` is time, length of the next step, time of the last
    row. Fill `sampled` from its row done[0] on. Return rows, steps, and GOES_ON or TOO_SMALL.
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
        _stages(t, h, y, new, k, terms, tableau)
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
            y[i], k[0, i] = new[i], k[6, i]
        h *= min(factor, 1.0 if rejected else MOST_FACTOR)
        rejected = False
    at[0], at[1], at[2] = t, h, last
    return used, steps, GOES_ON
