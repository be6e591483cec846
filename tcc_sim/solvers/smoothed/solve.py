"""The fast adaptive engine for the smoothed friction law (7).

Outside the layer |v| < 19/sigma tanh is exactly 1 and slip is not stiff: Taylor series of high order with variable
step, without the exponential too where that is below rounding. Inside the layer the series hold tanh as well, as long
as the layer's own rate beta Ts sigma does not limit the step; then (in stick) Radau IIA of order 9 takes over, its five
stages reduced to scalar equations. Steps end at the edges of these regions, found on the step's polynomial by a search
that cannot pass a root; section points are step ends.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers import step_output as keeping
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.smoothed import collocation_step as radau
from tcc_sim.solvers.smoothed import kernel as marching
from tcc_sim.solvers.smoothed.series_step import ORDER_MAXIMUM
from tcc_sim.solvers.terms import Terms, peak_load, stick_speed_of, terms_of
from tcc_sim.trajectory import Cycles, Statistics, Status, Trajectory, Transitions

BATCH = 4096
TRANSITIONS_MAXIMUM = 1_000_000
LOCAL = 0.03
"""Tolerance of one step per relative tolerance asked for: leaving stick amplifies what a step leaves behind."""
STATUSES = {marching.DONE: Status.DONE, marching.STEP_LIMIT: Status.STEP_LIMIT,
            marching.STEP_TOO_SMALL: Status.STEP_TOO_SMALL, marching.NOT_FINITE: Status.NOT_FINITE}

_compiled: set[tuple[bool, ...]] = set()
"""Which terms are absent, for every kernel that has been called."""

Floats = NDArray[np.float64]
Moves = tuple[Floats, NDArray[np.int8], NDArray[np.int8]]


def solve(problem: Problem) -> Trajectory:
    """Solve `problem` with the smoothed law (7), only with the terms that its system has.

    Returns
    -------
    Trajectory with `cycles` and `transitions`; a run that cannot go on ends early, with its Status and the states so
    far.
    """
    return solve_terms(problem, terms_of(problem.system))


def orders(rtol: float) -> tuple[int, int]:
    """Order of the Taylor series with friction's recurrences (cost p^2) and without (cost p) for this tolerance."""
    digits = -math.log(rtol)
    return int(np.clip(0.5 * digits + 4.0, 8, ORDER_MAXIMUM)), int(np.clip(digits, 10, ORDER_MAXIMUM))


def solve_terms(problem: Problem, terms: Terms) -> Trajectory:
    """`solve` with given terms of the same system, own or general."""
    smoothing = terms.smoothing
    assert smoothing is not None
    rtol = SOLVERS["smoothed"].default if problem.rtol is None else problem.rtol
    rtol = max(LOCAL * rtol, 1e-13)
    count, period = problem.whole_cycles, problem.system.cycle
    tail = 0.0 if problem.cycles is not None else max((problem.duration or 0.0) - count * period, 0.0)
    tail = 0.0 if tail < 1e-12 * period else tail
    own = terms_of(problem.system)
    stick_speed = stick_speed_of(own)
    start = problem.state
    state = np.array([start.slip_speed, start.plate_angle, start.plate_speed, start.flywheel_angle])
    sample_times = problem.sample_times()
    samples = np.empty((len(sample_times) if problem.samples_per_cycle else 0, 4))
    section, highest, lowest = np.empty((count + 1, 3)), np.empty(count), np.empty(count)
    stick_time = np.empty(count)
    section[0] = state[:3]
    tally = np.zeros(9, np.int64)
    tally[keeping.MODE] = 0 if abs(state[0]) <= stick_speed else (1 if state[0] > 0.0 else -1)
    torques = abs(terms.mean_torque) + (terms.torque[0] if terms.torque is not None else 0.0) + peak_load(terms)
    scales = np.zeros(6)
    scales[2], scales[3] = abs(state[0]), abs(state[2])
    scales[4] = 1e-6 * torques / math.sqrt(terms.linear[3] * terms.linear[1]) + 1e-12
    order, linear_order = orders(rtol)
    limit = 400_000 + 2_000 * count
    found: list[Moves] = []
    seconds, kept, done = 0.0, 0, 0
    def march(cycles: int, rest: float, moves: Moves) -> None:
        """March on through some cycles and the rest of one."""
        marching.march(state, tally, scales, problem.start_cycle + done, cycles, rest, period,
                       problem.system.pressure.frequency_ratio, limit, rtol, order, linear_order,
                       problem.samples_per_cycle,
                       samples, section[done:], highest[done:], lowest[done:], stick_time[done:], *moves, stick_speed,
                       True if problem.flywheel_angle else None, terms.linear, terms.mean_torque, terms.torque,
                       terms.harmonics, terms.mean_load, terms.pulsation, smoothing, terms.stribeck)

    kernel = problem.flywheel_angle, *(term is None for term in terms)
    if kernel not in _compiled:
        march(0, 0.0, _room(0))  # Compiling is not solving.
        _compiled.add(kernel)
    while True:
        batch = min(BATCH, count - done)
        moves = _room(min(16 * batch + 4096, TRANSITIONS_MAXIMUM - kept))
        last = done + batch == count
        tally[keeping.TRANSITIONS] = 0
        begin = time.perf_counter()
        march(batch, tail if last else 0.0, moves)
        seconds += time.perf_counter() - begin
        filled = int(tally[keeping.TRANSITIONS])
        kept += filled
        found.append((moves[0][:filled], moves[1][:filled], moves[2][:filled]))
        done += batch
        if last or tally[keeping.STATUS] != marching.DONE:
            break
    status = STATUSES[int(tally[keeping.STATUS])]
    whole = int(tally[keeping.CYCLES])
    cycles = Cycles(section[:whole + 1], highest[:whole], lowest[:whole], stick_time[:whole])
    columns = 4 if problem.flywheel_angle else 3
    initial = np.array([start.slip_speed, start.plate_angle, start.plate_speed, start.flywheel_angle])
    if status is Status.DONE:
        t = sample_times
        states = samples if problem.samples_per_cycle else np.stack([initial, state])
        states[-1] = state
    else:
        reached = (problem.start_cycle + whole) * period + float(scales[5])
        filled = min(int(tally[keeping.SAMPLES]), int(np.searchsorted(sample_times, reached)))
        t = np.append(sample_times[:filled],
                      reached) if problem.samples_per_cycle else np.array([problem.start, reached])
        states = np.vstack([samples[:filled] if problem.samples_per_cycle else initial[None], state])
    changes = Transitions(*(np.concatenate([part[i] for part in found]) for i in range(3)))
    statistics = Statistics(int(tally[keeping.STEPS]), int(tally[keeping.REJECTED]), int(tally[keeping.ITERATIONS]),
                            int(tally[keeping.ITERATIONS_MAX]), radau.ITERATIONS_MAXIMUM, seconds)
    trajectory = assemble(problem, "smoothed", t, states[:, :columns], cycles=cycles, transitions=changes,
                          status=status,
                          statistics=statistics)
    return trajectory if status is not Status.NOT_FINITE else replace(trajectory, detail="the state grew without bound")


def _room(count: int) -> Moves:
    """Where `count` transitions are put."""
    return np.empty(count), np.empty(count, np.int8), np.empty(count, np.int8)
