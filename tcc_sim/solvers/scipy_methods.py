"""ODE methods for comparison: SciPy's by name, with a compiled right-hand side and an analytic Jacobian for those that
are implicit, and the two explicit methods whose steps are compiled too (`explicit`).
"""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import BDF, DOP853, LSODA, RK45, Radau

from tcc_sim.compiling.compiled import Call, compiled, lost_torque, smoothed_and_slope
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.explicit import GOES_ON, NOT_FINITE, TOO_SMALL, march, rates, rk4_limit
from tcc_sim.solvers.per_cycle import cycles_of_states
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.terms import Terms, piece_of, terms_of
from tcc_sim.solvers.torques import piece_at, torques_now
from tcc_sim.trajectory import Floats, Statistics, Status, Trajectory, split_cycles

STEPS, STEPS_OF_RK4 = 10_000_000, 2_000_000_000
"""Most steps of one solve."""
POINTS = 256
"""Least number of points per engine cycle or natural period, the shorter; at most 64 per step."""


def rates_of(terms: Terms, size: int) -> Callable[[float, Floats], Floats]:
    """Return a function of t and y that returns y' of (1), (2) with the smoothed law; one thread may use it.

    Parameters
    ----------
    size : length of y: slip speed, plate angle, plate speed, and with 4 the flywheel's angle
    """
    return _repeated(rates, terms, np.empty(size))


def jacobian_of(terms: Terms, size: int) -> Callable[[float, Floats], Floats]:
    """Return a function of t and y that returns the derivative of `rates_of` by y; one thread may use it."""
    return _repeated(_jacobian, terms, np.zeros((size, size)))


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
    """Fill `out` with the derivative of `rates` by y."""
    _, slope = smoothed_and_slope(y[0], terms.smoothing, terms.stribeck)
    rate = slope * torques_now(t, piece_at(terms.profile, t), terms.profile, terms)[1]
    linear = terms.linear
    flywheel, plate = linear.flywheel, linear.plate
    on_plate = lost_torque(1.0, linear.plate_by_slip)
    out[0, 0] = (-rate * (1.0 / flywheel + 1.0 / plate) + on_plate / plate
                 - lost_torque(1.0, linear.flywheel_by_slip) / flywheel)
    out[0, 1] = linear.stiffness / plate
    out[0, 2] = linear.damping / plate
    out[1, 2] = 1.0
    out[2, 0] = (rate - on_plate) / plate
    out[2, 1] = -linear.stiffness / plate
    out[2, 2] = -linear.damping / plate
    if len(y) > 3:
        out[3, 0] = 1.0
        out[3, 2] = 1.0


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
    solver_of = partial(_equal_steps, step) if fixed else lambda begin, end, y: _solver(
        name, piece_of(terms, begin, end), begin, end, y, options)
    solver_of(begin, end, y0)  # Compile what it calls.
    if name in COMPILED:
        march(name, piece_of(terms, begin, end), 0.0, 0.0, y0, 0.0, 0.0, y0, y0[:0], y0[:0], 0.0, 0.0)
    began = time.perf_counter()
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        through = partial(_compiled_through, name) if name in COMPILED else _solve_through
        times, states, sampled, status, detail, steps = through(solver_of, problem, y0, marks, samples, spacing)
    seconds = time.perf_counter() - began
    reached = samples[:len(sampled)]
    if times[-1] > reached[-1]:
        reached, sampled = np.append(reached, times[-1]), np.concatenate([sampled, states[-1:]])
    cycles = rest = None
    if len(times) > 1:
        starts = ends[:np.searchsorted(ends, times[-1], side="right")]
        with np.errstate(all="ignore"):  # A run that blows up overflows before it ends.
            cycles, rest = split_cycles(replace(cycles_of_states(times, states, terms, starts), starts=starts),
                                        problem.whole_cycles)
    stuck = any(part is not None and part.stick_time.any() for part in (cycles, rest))
    limit = rk4_limit(problem.system) if fixed and stuck and status is Status.DONE else math.inf
    if fixed and step > limit:
        detail = f"the step of {step:g} s is above {limit:.3g} s, the largest one that is stable in stick"
    return assemble(problem, name, reached, sampled, cycles=cycles, rest=rest, status=status,
                    detail=detail, statistics=Statistics(steps=steps, seconds=seconds))


rk4, rk45, dop853, radau, bdf, lsoda = (partial(_solve, name=name) for name in METHODS)


def _solver(name: str, terms: Terms, begin: float, end: float, y: Floats, options: dict[str, Any]) -> Any:
    """Return SciPy's solver for a time within which the excitation has no corner."""
    if name in ("radau", "bdf", "lsoda"):
        options = {**options, "jac": jacobian_of(terms, len(y))}
    return METHODS[name](rates_of(terms, len(y)), begin, y, end, **options)


class FirstStep(NamedTuple):
    """Length of the first step, s, and tolerances, as the attributes of SciPy's solvers."""

    h_abs: float
    rtol: float = 0.0
    atol: Floats = np.ones(4)


def _equal_steps(step: float, begin: float, end: float, _: Floats) -> FirstStep:
    """Return the first of the fewest equal steps of at most `step` from begin to end."""
    return FirstStep((end - begin) / max(math.ceil((end - begin) / step * (1.0 - 1e-12)), 1))


def _compiled_through(name: str, solver_of: Any, problem: Problem, y: Floats, marks: Floats, samples: Floats,
                      spacing: float) -> tuple[Floats, Floats, Floats, Status, str, int]:
    """Do as `_solve_through` in compiled steps; a solver gives the length of the first one of each piece. Those of rk4
    end with the cycles too, and only their ends are points.
    """
    terms, breaks = terms_of(problem.system), problem.breaks()
    if name == "rk4":
        breaks, spacing = np.union1d(breaks, marks), math.inf
    rows, ended, steps, sampled = [np.concatenate([breaks[:1], y])[None, :]], GOES_ON, 0, [y[None, :]]
    for begin, end in itertools.pairwise(breaks.tolist()):
        y = rows[-1][-1, 1:]
        first = solver_of(begin, end, y)
        inner, within = (x[(x > begin) & (x <= end)] for x in (marks, samples))
        further, states, ended, taken = march(name, piece_of(terms, begin, end), begin, end, y, first.h_abs, first.rtol,
                                              first.atol, inner, within, spacing, problem.system.cycle)
        rows.append(further)
        sampled.append(states)
        steps += taken
        if ended != GOES_ON:
            break
    joined = np.concatenate(rows)
    status = {GOES_ON: Status.DONE, TOO_SMALL: Status.STEP_TOO_SMALL, NOT_FINITE: Status.NOT_FINITE}[ended]
    return joined[:, 0], joined[:, 1:].copy(), np.concatenate(sampled), status, "", steps


def _solve_through(solver_of: Any, problem: Problem, y: Floats, marks: Floats, samples: Floats,
                   spacing: float) -> tuple[Floats, Floats, Floats, Status, str, int]:
    """Return times, with every mark among them, states, those at the samples, status, detail and number of steps."""
    breaks = problem.breaks()
    times, states, sampled = [breaks[:1]], [np.array(y)[None, :]], [np.array(y)[None, :]]
    following, further, steps, status, detail = 1, 1, 0, Status.DONE, ""
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
            last = int(np.searchsorted(marks, solver.t, side="right"))
            inner = marks[following:last]
            following = last
            pieces = int(min(np.ceil((solver.t - solver.t_old) / spacing), 64))
            if len(inner) or pieces > 1:
                points = solver.t_old + (solver.t - solver.t_old) * np.arange(1, pieces) / pieces
                points = np.union1d(points, inner)
                points = points[points < solver.t]
                if len(points):
                    times.append(points)
                    states.append(solver.dense_output()(points).T)
            last = int(np.searchsorted(samples, solver.t, side="right"))
            if last > further:
                inner = samples[further:last]
                sampled.append(np.where(inner == solver.t, solver.y[:, None], solver.dense_output()(inner)).T)
                further = last
            times.append(np.array([solver.t]))
            states.append(np.array(solver.y)[None, :])
        if status is not Status.DONE:
            break
    t, y = np.concatenate(times), np.concatenate(states)
    fresh = np.concatenate([[True], np.diff(t) > 0.0])
    return t[fresh], y[fresh], np.concatenate(sampled), status, detail, steps
