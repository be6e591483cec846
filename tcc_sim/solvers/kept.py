"""A run of an adaptive engine: calls of its compiled loop, what is kept of them, and the Trajectory made of that."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers.compiling.compiled import timed
from tcc_sim.solvers.loads import loads_of, room_for_loads
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.step_output import CYCLE, FULL, STATUSES, Store, room_for_moves, transitions_of
from tcc_sim.trajectory import Cycles, Floats, Statistics, Status, Trajectory

MOVES = 65536
"""Transitions kept in one call of the compiled loop."""


class Kept:
    """Room for the cycles, samples, transitions and loads of a problem.

    Parameters
    ----------
    output : record of OUTPUT of the run
    columns : numbers of a sample
    more : transitions for which a call asks for room beforehand
    """

    def __init__(self, problem: Problem, output: Any, columns: int, more: int = 0) -> None:
        count = problem.whole_cycles
        self.problem, self.output, self.seconds = problem, output, 0.0
        self.samples = np.empty((problem.samples_per_cycle * (count + 1), columns))
        self.cycles = np.zeros((count + 2, CYCLE.itemsize // 8))
        self.cycles[0, :3] = problem.state.numbers
        self.loads = room_for_loads(problem)
        self.moves: list[NDArray[Any]] = []
        self.store = Store(self.cycles.view(CYCLE)[:, 0], self.samples, problem.samples_per_cycle,
                           room_for_moves(MOVES + more), self.loads)

    def run(self, loop: Callable[..., object], *arguments: Any) -> Status:
        """Call an engine's loop, with the store and whether theta1 is asked for behind its arguments, until it ends."""
        ended, angle = FULL, True if self.problem.flywheel_angle else None
        while ended == FULL:
            self.output["moves"] = 0
            ended, spent = timed(loop, *arguments, self.store, angle)
            self.seconds += spent
            self.moves.append(self.store.moves[:int(self.output["moves"])].copy())
        return STATUSES[ended]

    def trajectory(self, solver: str, status: Status, first: tuple[float, ...], last: tuple[float, ...], tau: float,
                   detail: str, statistics: Statistics, modes: bool = False) -> Trajectory:
        """What a run came to: its samples at the start and where it ended, `tau` seconds into the engine cycle."""
        problem = self.problem
        whole = min(int(self.output["cycle"]), problem.whole_cycles)
        reached = float(problem.system.cycle_start(problem.start_cycle + whole)) + tau
        t, samples = self._sampled(first, last, status, reached)
        transitions = transitions_of(self.moves)
        highest, lowest, stick_time = self.cycles[:whole, 3:].T.copy()
        cycles = Cycles(self.cycles[:whole + 1, :3].copy(), highest, lowest, stick_time,
                        loads_of(self.loads, problem, whole))
        states = samples[:, :len(problem.first)]
        return assemble(problem, solver, t, states, modes=samples[:, 4].astype(np.int8) if modes else None,
                        cycles=cycles, transitions=transitions, status=status, detail=detail,
                        statistics=dataclasses.replace(statistics, seconds=self.seconds))

    def _sampled(self, first: tuple[float, ...], last: tuple[float, ...], status: Status,
                 reached: float) -> tuple[Floats, Floats]:
        """Times, s, and samples kept, of a run that ended early those up to its end at the time `reached`."""
        problem, done = self.problem, status is Status.DONE
        end = problem.end if done else reached
        if not problem.samples_per_cycle:
            return np.array([problem.start, end]), np.array([first, last])
        times = problem.sample_times()
        filled = len(times) - 1
        if not done:
            filled = min(int(self.output["samples"]), filled, int(np.searchsorted(times, reached)))
        return np.append(times[:filled], end), np.vstack([self.samples[:filled], last])
