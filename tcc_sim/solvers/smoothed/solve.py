"""The fast adaptive engine for the smoothed friction law (7): the driver of its compiled loop.

Outside the layer |v| < about 10/sigma tanh is 1 to the tolerance and slip is not stiff: Taylor series of high order
with variable step, without the exponential too where that is below the tolerance. Inside the layer the series hold tanh
as well, as long as the layer's own rate beta Ts sigma does not limit the step; then, in stick, one collocation step of
16 nodes does what ten series could not. Steps end at the edges of these regions, found on the step's polynomial by a
search that cannot pass a root, and run across the section points, which are values of the polynomial.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.loads import loads_of, room_for_loads
from tcc_sim.solvers.per_system import per_system
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.smoothed import collocation_tables
from tcc_sim.solvers.smoothed import integrate as kernel
from tcc_sim.solvers.smoothed.setup import Limits, limits_of
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
    Memory,
)
from tcc_sim.solvers.smoothed.stretches import Stretch, longest_and_shortest_cycle, stretches_of
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT, Store, room_for_moves, transitions_of
from tcc_sim.solvers.terms import Terms, load_frequency, steps_allowed, terms_of
from tcc_sim.trajectory import Cycles, Floats, State, Statistics, Status, Trajectory

STEPS_AT_FIRST = 400_000
"""Steps of a solve before those of its cycles are counted."""
TRANSITIONS_MAXIMUM = 1_000_000
STATUSES = {DONE: Status.DONE, STEP_LIMIT: Status.STEP_LIMIT, STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
            NOT_FINITE: Status.NOT_FINITE}

_compiled: set[tuple[bool, ...]] = set()
"""Which terms are absent, for every kernel that has been called."""


KINDS = Memory(STATE, CONTROL, DRIVE, WORK, COUNTERS, OUTPUT)


class Scratch(threading.local):
    """Memory of a thread, which its solves take one after the other: to ask for it anew costs more than a short
    solve.
    """

    def __init__(self) -> None:
        self.whole = np.zeros(1, np.dtype(list(KINDS._asdict().items())))
        self.bytes = self.whole.view(np.uint8)
        self.memory = Memory(*(self.whole[0][name] for name in Memory._fields))

    def at(self, start: State, limits: Limits) -> Memory:
        """The memory as a solve finds it at its start."""
        self.bytes.fill(0)
        v, speed = start.slip_speed, start.plate_speed
        self.whole["state"] = v, start.plate_angle, speed, start.flywheel_angle, 0.0
        control, output = self.memory.control, self.memory.output
        control["patience"], control["calm"] = PATIENCE, CALM
        control["slip_now"], control["speed_now"] = abs(v), abs(speed)
        output["mode"] = 0 if abs(v) <= limits.stick_speed else (1 if v > 0.0 else -1)
        output["highest"] = output["lowest"] = v
        return self.memory


scratch = Scratch()


def solve(problem: Problem) -> Trajectory:
    """Solve `problem` with the smoothed law (7), only with the terms that its system has.

    Returns
    -------
    Trajectory with `cycles` and `transitions`; a run that cannot go on ends early, with its Status and the states so
    far.
    """
    rtol = SOLVERS["smoothed"].default if problem.rtol is None else problem.rtol
    return _solve(problem, own_setup(problem.system, rtol))


@per_system
def own_setup(system: System, rtol: float) -> kernel.Setup:
    """`setup_of` for the terms that a system has."""
    return setup_of(system, terms_of(system), rtol)


def setup_of(system: System, terms: Terms, rtol: float) -> kernel.Setup:
    """What a solve of a system with given terms needs to know beforehand; `waves` is to be copied for every solve."""
    longest, period = system.cycle, system.cycle
    if terms.course is not None:
        longest, period = longest_and_shortest_cycle(terms.course)
    limits = limits_of(terms, terms_of(system), period, rtol)
    waves = waves_of(terms)
    top, levels = collocation_tables.ladder_of(limits.fastest, longest)
    if terms.course is None:
        tables = collocation_tables.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms), top,
                                           levels)
    else:
        limits = limits._replace(steps=steps_allowed(terms, longest))
        tables = collocation_tables.nodal_tables(terms.linear, top,
                                                 levels + math.ceil(2.0 * math.log2(longest / period)))
        terms = terms._replace(pulsation=terms.pulsation or (0.0, 1.0, 0.0))
    waves.setflags(write=False)
    return kernel.Setup(limits, terms._replace(torque=None, harmonics=None),  # They are the waves.
                        system.pressure.frequency_ratio, waves, tables)


def _solve(problem: Problem, setup: kernel.Setup) -> Trajectory:
    """Solve batch by batch."""
    count = problem.whole_cycles
    memory, start, per_cycle = scratch.at(problem.state, setup.limits), problem.state, problem.samples_per_cycle
    setup = setup._replace(waves=setup.waves.copy())
    samples = np.empty((per_cycle * (count + 1), 4 if problem.flywheel_angle else 3))
    cycles = np.zeros((count + 1, CYCLE.itemsize // 8))
    cycles[0, :3] = start.slip_speed, start.plate_angle, start.plate_speed
    records = cycles.view(CYCLE)[:, 0]
    loads = room_for_loads(problem)
    limit = STEPS_AT_FIRST + setup.limits.steps * (count + 1)
    angle = True if problem.flywheel_angle else None

    def integrate(stretch: Stretch, moves: NDArray[Any]) -> int:
        """March on through some cycles and the rest of one."""
        done = stretch.done
        store = Store(records[done:], samples[done * per_cycle:], per_cycle, moves,
                      None if loads is None else loads[done:])
        return kernel.integrate(problem.start_cycle + done, stretch.cycles, stretch.rest, limit, stretch.setup, memory,
                                store, angle, None)

    found: list[NDArray[Any]] = []
    seconds, kept, status = 0.0, 0, DONE
    output = memory.output
    for stretch in stretches_of(problem, setup):
        output["cycle"], output["samples"], output["moves"] = 0, _samples_before(stretch, memory, per_cycle), 0
        terms = stretch.setup.terms
        variant = (problem.flywheel_angle, loads is None, terms.pulsation is None, terms.stribeck is None,
                   terms.course is None)
        if variant not in _compiled:
            integrate(stretch._replace(cycles=0, rest=0.0), np.empty(0, MOVE))  # Compiling is not solving.
            _compiled.add(variant)
        moves = room_for_moves(min(16 * stretch.cycles + 4096, TRANSITIONS_MAXIMUM - kept))
        begin = time.perf_counter()
        status = integrate(stretch, moves)
        seconds += time.perf_counter() - begin
        cycle, filled_samples, filled = output.item()[:3]
        if filled:
            kept += filled
            found.append(moves[:filled].copy())
        if status != DONE:
            break
    whole, state = stretch.done + cycle, memory.state.item()
    t, states = sampled(problem, state[:4], samples, stretch.done * per_cycle + filled_samples, STATUSES[status],
                        _reached(problem, stretch, cycle, state[4]))
    steps, rejected, iterations, iterations_max = memory.counters.item()
    transitions = transitions_of(found)
    highest, lowest, stick_time = cycles[:whole, 3:].T.copy()
    trajectory = assemble(
        problem, "smoothed", t, states, transitions=transitions, status=STATUSES[status],
        cycles=Cycles(cycles[:whole + 1, :3].copy(), highest, lowest, stick_time,
                      loads_of(loads, transitions, problem, whole)),
        statistics=Statistics(steps, rejected, iterations, iterations_max, ITERATIONS_MAXIMUM, seconds))
    return trajectory if status != NOT_FINITE else replace(trajectory, detail="the state grew without bound")


def _samples_before(stretch: Stretch, memory: Memory, per_cycle: int) -> int:
    """Samples of the cycle at hand that were kept already, where a call goes on within it."""
    return int(memory.output["samples"]) if memory.state["tau"] > 0.0 else 0


def _reached(problem: Problem, stretch: Stretch, cycle: int, tau: float) -> float:
    """The time of the state, s, some cycles after the start of a stretch."""
    if stretch.setup.terms.course is not None:
        return float(problem.system.cycle_start(problem.start_cycle + stretch.done + cycle)) + tau
    return (problem.start_cycle + stretch.done + cycle) * stretch.setup.limits.period + tau


def sampled(problem: Problem, final: tuple[float, ...], samples: Floats, filled: int, status: Status,
            reached: float) -> tuple[Floats, Floats]:
    """Times and states kept; of a run that ended early those up to its end."""
    start, columns = problem.state, samples.shape[1]
    end = problem.end if status is Status.DONE else reached
    if not problem.samples_per_cycle:
        initial = start.slip_speed, start.plate_angle, start.plate_speed, start.flywheel_angle
        return np.array([problem.start, end]), np.array([initial[:columns], final[:columns]])
    times = problem.sample_times()
    if status is Status.DONE:
        filled = len(times) - 1
    else:
        filled = min(filled, len(times) - 1, int(np.searchsorted(times, reached)))
    return np.append(times[:filled], end), np.vstack([samples[:filled], final[:columns]])
