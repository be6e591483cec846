"""The fast adaptive engine for the smoothed friction law (7): the driver of its compiled loop.

Outside the layer |v| < about 10/sigma tanh is 1 to the tolerance and slip is not stiff: Taylor series of high order with
variable step, without the exponential too where that is below the tolerance. Inside the layer the series hold tanh as
well, as long as the layer's own rate beta Ts sigma does not limit the step; then, in stick, one collocation step of 16
nodes does what ten series could not. Steps end at the edges of these regions, found on the step's polynomial by a
search that cannot pass a root, and run across the section points, which are values of the polynomial.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.smoothed import collocation_tables, kernel
from tcc_sim.solvers.smoothed.limits import Limits, limits_of
from tcc_sim.solvers.smoothed.stages import ITERATIONS_MAXIMUM
from tcc_sim.solvers.smoothed.state import (
    CONTROL,
    COUNTERS,
    DONE,
    NOT_FINITE,
    STATE,
    STEP_LIMIT,
    STEP_TOO_SMALL,
    WORK,
)
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Cycles, Floats, Statistics, Status, Trajectory, Transitions

BATCH = 4096
"""Engine cycles in one call of the compiled loop."""
TRANSITIONS_MAXIMUM = 1_000_000
STATUSES = {DONE: Status.DONE, STEP_LIMIT: Status.STEP_LIMIT, STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
            NOT_FINITE: Status.NOT_FINITE}

_compiled: set[tuple[bool, ...]] = set()
"""Which terms are absent, for every kernel that has been called."""


class Memory(NamedTuple):
    """What one solve changes as it goes."""

    state: Any
    control: Any
    drive: Any
    work: Any
    counters: Any
    output: Any


def solve(problem: Problem) -> Trajectory:
    """Solve `problem` with the smoothed law (7), only with the terms that its system has.

    Returns
    -------
    Trajectory with `cycles` and `transitions`; a run that cannot go on ends early, with its Status and the states so
    far.
    """
    return solve_terms(problem, terms_of(problem.system))


def solve_terms(problem: Problem, terms: Terms) -> Trajectory:
    """`solve` with given terms of the same system, own or general."""
    rtol = SOLVERS["smoothed"].default if problem.rtol is None else problem.rtol
    count, period = problem.whole_cycles, problem.system.cycle
    tail = 0.0 if problem.cycles is not None else max((problem.duration or 0.0) - count * period, 0.0)
    tail = 0.0 if tail < 1e-12 * period else tail
    limits = limits_of(terms, terms_of(problem.system), period, rtol)
    waves = waves_of(terms)
    tables = collocation_tables.tables(terms.linear, tuple(waves["rate"].tolist()),
                                       0.0 if terms.pulsation is None else terms.pulsation[1],
                                       collocation_tables.top_of(period), collocation_tables.levels_of(limits.sigma))
    memory = memory_of(problem, limits)
    given = terms._replace(torque=None, harmonics=None)  # They are the waves.
    columns = 4 if problem.flywheel_angle else 3
    samples = np.empty((problem.samples_per_cycle * (count + 1) if problem.samples_per_cycle else 0, columns))
    cycles = np.zeros(count + 1, CYCLE)
    start = problem.state
    cycles[0] = (start.slip_speed, start.plate_angle, start.plate_speed, 0.0, 0.0, 0.0)
    limit = 400_000 + 2_000 * count
    angle = True if problem.flywheel_angle else None

    def integrate(done: int, batch: int, rest: float, moves: NDArray[Any]) -> int:
        """March on through some cycles and the rest of one."""
        return int(kernel.integrate(
            problem.start_cycle + done, batch, rest, limit, limits, given, problem.system.pressure.frequency_ratio,
            waves, tables, memory.state, memory.control, memory.drive, memory.work, memory.counters, memory.output,
            cycles[done:], samples[done * problem.samples_per_cycle:], problem.samples_per_cycle, moves, angle, None))

    variant = problem.flywheel_angle, terms.pulsation is None, terms.stribeck is None
    if variant not in _compiled:
        integrate(0, 0, 0.0, np.empty(0, MOVE))  # Compiling is not solving.
        _compiled.add(variant)
    found: list[NDArray[Any]] = []
    seconds, kept, done = 0.0, 0, 0
    output = memory.output
    while True:
        batch = min(BATCH, count - done)
        moves = np.empty(min(16 * batch + 4096, TRANSITIONS_MAXIMUM - kept), MOVE)
        last = done + batch == count
        output["cycle"], output["samples"], output["moves"] = 0, 0, 0
        begin = time.perf_counter()
        status = integrate(done, batch, tail if last else 0.0, moves)
        seconds += time.perf_counter() - begin
        filled = int(output["moves"])
        kept += filled
        found.append(moves[:filled])
        if last or status != DONE:
            break
        done += batch
    whole = done + int(output["cycle"])
    reached = (problem.start_cycle + whole) * period + float(memory.state["tau"])
    t, states = sampled(problem, memory, samples, done, STATUSES[status], reached)
    counters = memory.counters
    trajectory = assemble(
        problem, "smoothed", t, states[:, :columns], cycles=cycles_of(cycles, whole), transitions=transitions_of(found),
        status=STATUSES[status],
        statistics=Statistics(int(counters["steps"]), int(counters["rejected"]), int(counters["iterations"]),
                              int(counters["iterations_max"]), ITERATIONS_MAXIMUM, seconds))
    return trajectory if status != NOT_FINITE else replace(trajectory, detail="the state grew without bound")


def memory_of(problem: Problem, limits: Limits) -> Memory:
    """What a solve changes, at its start."""
    kinds = (STATE, CONTROL, DRIVE, WORK, COUNTERS, OUTPUT)
    memory = Memory(*(np.zeros(1, kind)[0] for kind in kinds))
    start = problem.state
    for name in ("slip_speed", "plate_angle", "plate_speed", "flywheel_angle"):
        memory.state[name] = getattr(start, name)
    memory.control["patience"], memory.control["calm"] = PATIENCE, CALM
    memory.control["slip_now"], memory.control["speed_now"] = abs(start.slip_speed), abs(start.plate_speed)
    mode = 0 if abs(start.slip_speed) <= limits.stick_speed else (1 if start.slip_speed > 0.0 else -1)
    memory.output["mode"] = mode
    memory.output["highest"] = memory.output["lowest"] = start.slip_speed
    return memory


def sampled(problem: Problem, memory: Memory, samples: Floats, done: int, status: Status,
            reached: float) -> tuple[Floats, Floats]:
    """Times and states kept; of a run that ended early those up to its end."""
    start, state = problem.state, memory.state
    initial = [start.slip_speed, start.plate_angle, start.plate_speed, start.flywheel_angle]
    final = [float(state[name]) for name in ("slip_speed", "plate_angle", "plate_speed", "flywheel_angle")]
    if not problem.samples_per_cycle:
        return np.array([problem.start, problem.end if status is Status.DONE else reached]), np.array([initial, final])
    times = problem.sample_times()
    filled = len(times) - 1
    if status is not Status.DONE:
        filled = min(done * problem.samples_per_cycle + int(memory.output["samples"]), int(np.searchsorted(times, reached)))
    times = np.append(times[:filled], problem.end if status is Status.DONE else reached)
    return times, np.vstack([samples[:filled], final[:samples.shape[1]]])


def cycles_of(cycles: NDArray[Any], whole: int) -> Cycles:
    """Per-cycle results of the whole cycles."""
    kept = cycles[:whole + 1]
    section = np.stack([kept["slip_speed"], kept["plate_angle"], kept["plate_speed"]], axis=1)
    return Cycles(section, kept["highest"][:whole].copy(), kept["lowest"][:whole].copy(), kept["stick_time"][:whole].copy())


def transitions_of(found: list[NDArray[Any]]) -> Transitions:
    """The transitions of all batches."""
    moves = np.concatenate(found)
    return Transitions(moves["time"].copy(), moves["before"].astype(np.int8), moves["after"].astype(np.int8))
