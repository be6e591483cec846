"""What a solve of an adaptive engine keeps of a run, and how it is read afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers.loads import loads_of, room_for_loads
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.step_output import CYCLE, Store, transitions_of
from tcc_sim.trajectory import Cycles, Floats, Status, Transitions


class Kept:
    """Room for the cycles, samples, transitions and loads of a problem.

    Parameters
    ----------
    columns : numbers of a sample
    """

    def __init__(self, problem: Problem, columns: int) -> None:
        start, count = problem.state, problem.whole_cycles
        self.problem = problem
        self.samples = np.empty((problem.samples_per_cycle * (count + 1), columns))
        self.cycles = np.zeros((count + 2, CYCLE.itemsize // 8))
        self.cycles[0, :3] = start.slip_speed, start.plate_angle, start.plate_speed
        self.records = self.cycles.view(CYCLE)[:, 0]
        self.loads = room_for_loads(problem)
        self.moves: list[NDArray[Any]] = []

    def store(self, moves: NDArray[Any], done: int = 0) -> Store:
        """Where a call of the kernel keeps what comes after so many cycles."""
        per_cycle = self.problem.samples_per_cycle
        return Store(self.records[done:], self.samples[done * per_cycle:], per_cycle, moves,
                     None if self.loads is None else self.loads[done:])

    def sampled(self, first: tuple[float, ...], last: tuple[float, ...], filled: int, status: Status,
                reached: float) -> tuple[Floats, Floats]:
        """Times, s, and samples kept, of a run that ended early those up to its end; `first` and `last` at the start
        and where it ended, at the time `reached`.
        """
        problem, done = self.problem, status is Status.DONE
        end = problem.end if done else reached
        if not problem.samples_per_cycle:
            return np.array([problem.start, end]), np.array([first, last])
        times = problem.sample_times()
        filled = len(times) - 1 if done else min(filled, len(times) - 1, int(np.searchsorted(times, reached)))
        return np.append(times[:filled], end), np.vstack([self.samples[:filled], last])

    def cycles_and_transitions(self, whole: int) -> tuple[Cycles, Transitions]:
        """What the first `whole` cycles came to, and all transitions."""
        transitions = transitions_of(self.moves)
        highest, lowest, stick_time = self.cycles[:whole, 3:].T.copy()
        return Cycles(self.cycles[:whole + 1, :3].copy(), highest, lowest, stick_time,
                      loads_of(self.loads, self.problem, whole)), transitions
