"""Solvers for comparison: SciPy's methods by name, with a compiled right-hand side and an analytic Jacobian for those
that are implicit; and two explicit Runge-Kutta methods by a tableau, whose steps are compiled: the classical method,
and Dormand and Prince's pair of order 5(4).

The classical method has a fixed step, for contrast: it needs steps below about 2.8/(beta Ts sigma). The pair is the
paper's "Runge-Kutta 4th(5th) order". Its coefficients, step control (Hairer, Norsett and Wanner, Solving Ordinary
Differential Equations I, II.4) and interpolant of order 4 (Shampine 1986) are those of `scipy.integrate.RK45`, which
takes the same steps. Stability limits them to 3.3/(beta Ts r sigma) in stick, so that calls of Python would take most
of the time.
"""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import BDF, DOP853, LSODA, RK45, Radau

from tcc_sim.compiling.compiled import Call, compiled, timed
from tcc_sim.model.equations import matrix_of
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.fixed_step import piece_at, torques_now
from tcc_sim.solvers.model_kernels import accelerations, lost_torque, smoothed_and_slope, smoothed_coefficient
from tcc_sim.solvers.per_cycle import cycles_of_states
from tcc_sim.solvers.terms import Problem, Terms, assemble, peak_load, piece_of, terms_of
from tcc_sim.trajectory import Floats, Statistics, Status, Trajectory, split_cycles

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


STEPS, STEPS_OF_RK4 = 10_000_000, 2_000_000_000
"""Most steps of one solve."""
POINTS = 256
"""Least number of points per engine cycle or natural period, the shorter; at most 64 per step."""


def rates_of(terms: Terms, size: int) -> Callable[[float, Floats], Floats]:
    """Return a function of t and y that returns y' of (1), (2) with the smoothed law; one thread may use it.

    size : length of y: slip speed, plate angle, plate speed, and with 4 the flywheel's angle
    """
    return _repeated(rates, terms, np.empty(size))


def jacobian_of(terms: Terms, size: int) -> Callable[[float, Floats], Floats]:
    """Return a function of t and y that returns the derivative of `rates_of` by y; one thread may use it."""
    out = np.zeros((size, size))
    out[:3, :3] = matrix_of(terms.linear)
    out[3:, [0, 2]] = 1.0
    return _repeated(_jacobian, terms, out)


def _repeated(kernel: Callable[..., object], terms: Terms, out: Floats) -> Callable[[float, Floats], Floats]:
    """Return a function of time and state that gives a copy of what a kernel fills `out` with."""
    state, call = np.empty(len(out)), Call(kernel, 0, "d")
    call.use(0.0, state, terms, out)

    def copied(t: float, y: Floats) -> Floats:
        state[:] = y
        call(t)
        copy: Floats = out.copy()
        return copy

    return copied


@compiled
def _jacobian(t: float, y: Floats, terms: Any, out: Floats) -> None:
    """Fill the two derivatives that vary, those of the accelerations by the slip speed."""
    _, slope = smoothed_and_slope(y[0], terms.smoothing, terms.stribeck)
    rate = slope * torques_now(t, piece_at(terms.profile, t), terms.profile, terms)[1]
    linear = terms.linear
    flywheel, plate = linear.flywheel, linear.plate
    on_plate = lost_torque(1.0, linear.plate_by_slip)
    out[0, 0] = (-rate * (1.0 / flywheel + 1.0 / plate) + on_plate / plate
                 - lost_torque(1.0, linear.flywheel_by_slip) / flywheel)
    out[2, 0] = (rate - on_plate) / plate


def _scales(problem: Problem, terms: Terms) -> Floats:
    """Return sizes of absolute errors: slip speed in stick, static twist, twist at omega_n."""
    engine = problem.system.engine
    torque = max(abs(engine.mean_torque) + engine.torque_amplitude + sum(engine.harmonic_amplitudes), 1.0)
    twist = torque / terms.linear.stiffness
    assert terms.smoothing is not None
    scales = [max(1.0 / terms.smoothing, 1e-6), twist, twist * problem.system.natural_frequency]
    return np.array([*scales, 1.0] if problem.flywheel_angle else scales)


COMPILED = "rk4", "rk45"
METHODS: dict[str, Any] = {"rk4": None, "rk45": RK45, "dop853": DOP853, "radau": Radau, "bdf": BDF, "lsoda": LSODA}
"""Classical Runge-Kutta with equal steps between ends of cycles; Dormand and Prince's explicit methods of order 5(4)
and 8(5,3); Radau IIA of order 5; backward differentiation of order 1 to 5; and, of ODEPACK, Adams' methods with
automatic switching to it. The steps of the first two are compiled.
"""


def _solve(problem: Problem, name: str) -> Trajectory:
    """Solve by a method, with dense output at the cycle ends and at enough points for the extremes, and at the samples,
    on which the cycles do not depend.

    Too large a step of rk4 blows up, and the run ends with Status.NOT_FINITE at the last finite state; or stick rings,
    and the run's `detail` says so.
    """
    terms, fixed, y0 = terms_of(problem.system), name == "rk4", np.array(problem.first)
    rtol = SOLVERS[name].default if problem.rtol is None else problem.rtol
    step = SOLVERS[name].default if problem.step is None else problem.step
    options: dict[str, Any] = {"rtol": rtol, "atol": rtol * _scales(problem, terms)}
    samples, ends = problem.sample_times(), problem.cycle_starts()
    total = (problem.end - problem.start) / step
    if fixed and total > STEPS_OF_RK4:
        return assemble(problem, name, samples[:1], y0[None, :], status=Status.REFUSED,
                        detail=f"{total:.3g} steps of {step:g} s are more than {STEPS_OF_RK4:.3g}")
    marks = np.union1d(samples[[0, -1]], np.minimum(ends, samples[-1]))
    spacing = min(problem.system.cycle, 2.0 * np.pi / problem.system.natural_frequency) / POINTS
    begin, end = problem.breaks()[:2]

    def solver_of(begin: float, end: float, y: Floats) -> Any:
        """Return SciPy's solver for a time within which the excitation has no corner; for rk4 the length of the fewest
        equal steps to the end, as such a solver has it.
        """
        if fixed:
            count = max(math.ceil((end - begin) / step * (1.0 - 1e-12)), 1)
            return SimpleNamespace(h_abs=(end - begin) / count, rtol=0.0, atol=np.ones(4))
        piece = piece_of(terms, begin, end)
        implicit = {"jac": jacobian_of(piece, len(y))} if name in ("radau", "bdf", "lsoda") else {}
        return METHODS[name](rates_of(piece, len(y)), begin, y, end, **options, **implicit)

    solver_of(begin, end, y0)  # Compile what it calls.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        through = partial(_compiled_through, name) if name in COMPILED else _solve_through
        outcome = through(solver_of, problem, y0, marks, samples, spacing)
    times, states, sampled, status, detail, steps, seconds = outcome
    reached = samples[:len(sampled)]
    if times[-1] > reached[-1]:
        reached, sampled = np.append(reached, times[-1]), np.concatenate([sampled, states[-1:]])
    cycles = rest = None
    if len(times) > 1:
        starts = ends[:np.searchsorted(ends, times[-1], side="right")]
        with np.errstate(all="ignore"):  # A run that blows up overflows before it ends.
            cycles, rest = split_cycles(cycles_of_states(times, states, terms, starts), problem.whole_cycles)
    stuck = any(part is not None and part.stick_time.any() for part in (cycles, rest))
    limit = rk4_limit(problem.system) if fixed and stuck and status is Status.DONE else math.inf
    if fixed and step > limit:
        detail = f"the step of {step:g} s is above {limit:.3g} s, the largest one that is stable in stick"
    return assemble(problem, name, reached, sampled, cycles=cycles, rest=rest, status=status,
                    detail=detail, statistics=Statistics(steps=steps, seconds=seconds))


rk4, rk45, dop853, radau, bdf, lsoda = (partial(_solve, name=name) for name in METHODS)


def _compiled_through(name: str, solver_of: Any, problem: Problem, y: Floats, marks: Floats, samples: Floats,
                      spacing: float) -> tuple[Floats, Floats, Floats, Status, str, int, float]:
    """Do as `_solve_through` in compiled steps; a solver gives the length of the first one of each piece. Those of rk4
    end with the cycles too, and only their ends are points.
    """
    terms, breaks, tableau, fixed = terms_of(problem.system), problem.breaks(), tableau_of(name), name == "rk4"
    if fixed:
        breaks, spacing = np.union1d(breaks, marks), math.inf
    rows, ended, steps, seconds = [np.concatenate([breaks[:1], y])[None, :]], GOES_ON, 0, 0.0
    y, new, k = y.copy(), y.copy(), np.zeros((len(tableau.error), len(y)))
    sampled, done = np.array([y] * len(samples)), np.ones(1, np.int64)
    for begin, end in itertools.pairwise(breaks.tolist()):
        first, piece = solver_of(begin, end, y), piece_of(terms, begin, end)
        at, inner = np.array([begin, first.h_abs, begin]), marks[(marks > begin) & (marks <= end)]
        while at[0] < end and ended == GOES_ON:
            room = np.empty((len(inner) + 8 * KEPT_PER_CYCLE, 1 + len(y)))
            wanted = Wanted(inner, spacing, problem.system.cycle / KEPT_PER_CYCLE)
            (used, taken, ended), spent = timed(_march, at, end, y, new, k, piece, tableau, fixed, first.rtol,
                                                first.atol, wanted, room, samples, sampled, done)
            inner = inner[np.searchsorted(inner, at[2], side="right"):]
            steps, seconds = steps + taken, seconds + spent
            rows.append(room[:used].copy())
        if ended != GOES_ON:
            break
    joined = np.concatenate(rows)
    status = {GOES_ON: Status.DONE, TOO_SMALL: Status.STEP_TOO_SMALL, NOT_FINITE: Status.NOT_FINITE}[ended]
    return joined[:, 0], joined[:, 1:].copy(), sampled[:done[0]], status, "", steps, seconds


def _solve_through(solver_of: Any, problem: Problem, y: Floats, marks: Floats, samples: Floats,
                   spacing: float) -> tuple[Floats, Floats, Floats, Status, str, int, float]:
    """Return times, with every mark among them, states, those at the samples, status, detail, number of steps and the
    run time, s.
    """
    began, breaks = time.perf_counter(), problem.breaks()
    times, states, sampled = [breaks[:1]], [np.array(y)[None, :]], [np.array(y)[None, :]]
    steps, status, detail = 0, Status.DONE, ""
    for begin, end in itertools.pairwise(breaks.tolist()):
        solver = solver_of(begin, end, states[-1][-1])
        while solver.status == "running":
            if steps >= STEPS:
                status = Status.STEP_LIMIT
                break
            detail = solver.step() or ""
            if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
                status = Status.STEP_TOO_SMALL if np.all(np.isfinite(solver.y)) else Status.NOT_FINITE
                break
            steps += 1
            inner, due = (those[slice(*np.searchsorted(those, [solver.t_old, solver.t], side="right"))]
                          for those in (marks, samples))
            pieces = int(min(np.ceil((solver.t - solver.t_old) / spacing), 64))
            if len(inner) or pieces > 1:
                points = solver.t_old + (solver.t - solver.t_old) * np.arange(1, pieces) / pieces
                points = np.union1d(points, inner)
                points = points[points < solver.t]
                if len(points):
                    times.append(points)
                    states.append(solver.dense_output()(points).T)
            if len(due):
                sampled.append(np.where(due == solver.t, solver.y[:, None], solver.dense_output()(due)).T)
            times.append(np.array([solver.t]))
            states.append(np.array(solver.y)[None, :])
        if status is not Status.DONE:
            break
    t, y = np.concatenate(times), np.concatenate(states)
    fresh = np.concatenate([[True], np.diff(t) > 0.0])
    return t[fresh], y[fresh], np.concatenate(sampled), status, detail, steps, time.perf_counter() - began
