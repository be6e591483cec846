"""What is kept of a run of an engine: samples, section points, extremes, time in stick and transitions of every step,
all from its polynomial; and the Trajectory that is made of all calls of the compiled loop.

A step runs over [0, x] in its own unit of time from `tau`, seconds into the engine cycle with number `output.cycle`,
and may run across the end of that cycle; its polynomials are the rows SLIP, ANGLE, SPEED (and FLYWHEEL) of `rows`.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import BERNSTEIN, HIGH, LOW, later_part, to_bernstein
from tcc_sim.solvers.compiling.compiled import fast, timed
from tcc_sim.solvers.loads import keep_breakaway, loads_of, room_for_loads
from tcc_sim.solvers.problem import LEAST_REST, Problem, assemble
from tcc_sim.solvers.series import ANGLE, FLYWHEEL, SLIP, SPEED
from tcc_sim.trajectory import Cycles, Floats, Statistics, Status, Trajectory, Transitions

DONE, FULL, STEP_LIMIT, STEP_TOO_SMALL, EVENT_LIMIT, NOT_FINITE, DEGENERATE = range(7)
"""How a call of an engine's loop ends: at the end, to go on with room for transitions, or with a failure, the last one
of which is that of derivatives where slip ends with v' = 0.
"""
STATUSES = {DONE: Status.DONE, STEP_LIMIT: Status.STEP_LIMIT, STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
            EVENT_LIMIT: Status.EVENT_LIMIT, NOT_FINITE: Status.NOT_FINITE}

CYCLE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("highest", np.float64), ("lowest", np.float64), ("stick_time", np.float64)])
"""An engine cycle: the state at its start; the largest and smallest slip speed and the time in stick within it."""

MOVE = np.dtype([("time", np.float64), ("before", np.int64), ("after", np.int64)])
"""A transition: seconds since the start of cycle 0, mode before and after."""

OUTPUT = np.dtype([("started", np.int64), ("cycle", np.int64), ("samples", np.int64), ("moves", np.int64),
                   ("mode", np.int64), ("highest", np.float64), ("lowest", np.float64), ("stick_time", np.float64)])
"""How far the output is: whether the run has started; whole cycles, samples and transitions kept; the mode now; what
the cycle has come to so far.
"""

MOVES = 65536
"""Transitions kept in one call of the compiled loop."""


class Store(NamedTuple):
    """Where a run is kept: arrays of CYCLE, of states (rows of samples), of MOVE, and of LOADS where those are asked
    for; and how many samples to a cycle. Without an array of MOVE a cycle is no more than the state at its start.
    """

    cycles: Any
    samples: Any
    per_cycle: int
    moves: Any
    loads: Any = None


class _Scratch(threading.local):
    """What a thread's solves work in, one after the other: to ask for it anew costs more than a short solve.

    moves : where transitions are kept
    memories : an engine's memory by its name, and all of that as bytes
    """

    def __init__(self) -> None:
        self.moves = np.empty(0, MOVE)
        self.memories: dict[str, tuple[NDArray[np.uint8], Any]] = {}


scratch = _Scratch()


def transitions_of(found: list[NDArray[Any]]) -> Transitions:
    """The transitions of all calls of a solve, from their records of MOVE."""
    if not found:
        return Transitions.none()
    moves = found[0] if len(found) == 1 else np.concatenate(found)
    return Transitions(moves["time"].copy(), moves["before"].astype(np.int8), moves["after"].astype(np.int8))


@fast
def begin_output(output: Any, slip_speed: float, mode: int) -> None:
    """Nothing is kept yet of a run that starts now."""
    output.started, output.cycle, output.samples, output.moves, output.mode = 1, 0, 0, 0, mode
    output.highest, output.lowest, output.stick_time = slip_speed, slip_speed, 0.0


@fast
def full(moves: Any, needed: int) -> bool:
    """Whether there is no room for so many transitions, where any are kept."""
    return moves is not None and needed > moves.shape[0]


@fast
def keep_samples(rows: Any, degree: int, unit: float, x: float, tau: float, period: float, per_cycle: int, output: Any,
                 samples: Any, angle: Any) -> None:
    """Samples, uniform in time, that fall before the end of the step: rows of v, theta2, theta2' (and theta1)."""
    spacing = period / per_cycle
    first = output.cycle * per_cycle
    end = tau + x * unit
    while output.samples < samples.shape[0] and (output.samples - first) * spacing < end:
        at = min(max(((output.samples - first) * spacing - tau) / unit, 0.0), x)
        row = output.samples
        samples[row, SLIP], samples[row, ANGLE], samples[row, SPEED] = polynomial.values(rows, degree, at)
        if angle is not None:
            samples[row, FLYWHEEL] = polynomial.value(rows, FLYWHEEL, degree, at)
        output.samples += 1


@fast
def keep_stick(output: Any, start: float, end: float, cut: float, unit: float) -> float:
    """Count a part of a step in stick; of what lies behind `cut`, the end of the cycle, the length is returned."""
    output.stick_time += max(min(end, cut) - start, 0.0) * unit
    return max(end - max(start, cut), 0.0) * unit


@fast
def end_of_cycle(tau: float, after: float, period: float, unit: float, x: float) -> float:
    """Where in [0, x] of a step from `tau` to `after` the engine cycle ends; infinity where it does not."""
    if after == period:
        return x
    return min((period - tau) / unit, x) if after >= period else math.inf


@fast
def note_move(time: float, before: int, after: int, output: Any, moves: Any) -> None:
    """Keep a transition, where any are kept and there is room."""
    if moves is not None and output.moves < moves.shape[0]:
        moves[output.moves].time = time
        moves[output.moves].before = before
        moves[output.moves].after = after
        output.moves += 1


@fast
def keeps_mode(mode: int, stick_speed: float, workspace: Any) -> bool:
    """Whether the slip speed is in `mode` all the step, by its Bernstein coefficients."""
    low, high = workspace[BERNSTEIN, LOW], workspace[BERNSTEIN, HIGH]
    if mode == 0:
        return bool(-stick_speed <= low and high <= stick_speed)
    return bool(low > stick_speed if mode > 0 else high < -stick_speed)


@fast
def keep_modes(rows: Any, degree: int, unit: float, x: float, cut: float, time: float, stick_speed: float, output: Any,
               moves: Any, loads: Any, workspace: Any) -> float:
    """Transitions, breakaways and time in stick; returns the time in stick behind `cut`, the end of the cycle.

    The first row of the workspace holds the Bernstein coefficients of the slip speed over [0, x].
    """
    behind = 0.0
    mode = output.mode
    start = 0.0
    for _ in range(2 * degree):  # Rounding may put one crossing upon the other, for ever.
        if keeps_mode(mode, stick_speed, workspace):
            break
        at = polynomial.stick_crossing(rows, SLIP, degree, start, x, mode, stick_speed, workspace)
        if at > x:
            break
        new = 0
        if mode == 0:
            behind += keep_stick(output, start, at, cut, unit)
            keep_breakaway(loads, output.cycle if at < cut else output.cycle + 1)
            new = 1 if polynomial.value(rows, SLIP, degree, at) > 0.0 else -1
        note_move(time + at * unit, mode, new, output, moves)
        mode = new
        start = at
        there = abs(workspace[BERNSTEIN, degree]) <= stick_speed
        if there == (mode == 0) and polynomial.one_way(degree, 0.0, workspace):
            break
    if mode == 0:
        behind += keep_stick(output, start, x, cut, unit)
    output.mode = mode
    return behind


@fast
def end_cycle(output: Any, cycles: Any, slip_speed: float, plate_angle: float, plate_speed: float,
              stick_time: float) -> None:
    """Keep what the cycle has come to, and begin the next one in the given state."""
    done = cycles[output.cycle]
    done.highest = max(output.highest, slip_speed)
    done.lowest = min(output.lowest, slip_speed)
    done.stick_time = output.stick_time
    output.cycle += 1
    following = cycles[output.cycle]
    following.slip_speed = slip_speed
    following.plate_angle = plate_angle
    following.plate_speed = plate_speed
    output.highest = slip_speed
    output.lowest = slip_speed
    output.stick_time = stick_time


@fast
def keep_cycle(rows: Any, degree: int, x: float, cut: float, behind: float, output: Any, cycles: Any,
               workspace: Any) -> None:
    """Extremes of a step that the end of the cycle cuts at `cut` (beyond x: not at all); time in stick `behind` it.

    The first row of the workspace holds the Bernstein coefficients of the slip speed over [0, x].
    """
    if cut > x:
        output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, x, output.highest, output.lowest,
                                                               workspace)
    else:
        if cut < x:
            to_bernstein(rows, SLIP, degree, cut, workspace)
        output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, cut, output.highest, output.lowest,
                                                               workspace)
        slip_speed, plate_angle, plate_speed = polynomial.values(rows, degree, cut)
        end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, behind)
        if cut < x:
            to_bernstein(rows, SLIP, degree, x, workspace)
            later_part(workspace, BERNSTEIN, degree, cut / x)
            output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, x, output.highest,
                                                                   output.lowest, workspace)


@fast
def keep_step(work: Any, degree: int, unit: float, x: float, cut: float, tau: float, time: float, period: float,
              stick_speed: float, output: Any, store: Store, angle: Any) -> None:
    """Keep what a step over [0, x] says.

    Parameters
    ----------
    work : its `rows`, and `bernstein`, whose first row holds the Bernstein coefficients of the slip speed over [0, x]
    cut : where in [0, x] the engine cycle ends; beyond x where it does not
    tau, time : start of the step in its cycle, and since the start of cycle 0, s
    stick_speed : |v| up to which the mode is stick
    output, store : how far the output is (OUTPUT), and where it is kept
    angle : not None where theta1 is kept too
    """
    if store.per_cycle > 0:
        keep_samples(work.rows, degree, unit, x, tau, period, store.per_cycle, output, store.samples, angle)
    keep_motion(work.rows, degree, unit, x, cut, time, stick_speed, output, store.cycles, store.moves, store.loads,
                work.bernstein)


@fast
def keep_motion(rows: Any, degree: int, unit: float, x: float, cut: float, time: float, stick_speed: float, output: Any,
                cycles: Any, moves: Any, loads: Any, workspace: Any) -> None:
    """Transitions, breakaways, time in stick, extremes and section; only the section where `moves` are None."""
    if moves is not None:
        behind = keep_modes(rows, degree, unit, x, cut, time, stick_speed, output, moves, loads, workspace)
        keep_cycle(rows, degree, x, cut, behind, output, cycles, workspace)
    elif cut <= x:
        slip_speed, plate_angle, plate_speed = polynomial.values(rows, degree, cut)
        end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, 0.0)


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
        if len(scratch.moves) < MOVES + more:
            scratch.moves = np.empty(MOVES + more, MOVE)
        self.store = Store(self.cycles.view(CYCLE)[:, 0], self.samples, problem.samples_per_cycle,
                           scratch.moves[:MOVES + more], self.loads)

    def run(self, loop: Callable[..., object], *arguments: Any) -> int:
        """Call an engine's loop, with the store and whether theta1 is asked for behind its arguments, until it ends;
        how it did.
        """
        ended, angle = FULL, True if self.problem.flywheel_angle else None
        while ended == FULL:
            self.output["moves"] = 0
            ended, spent = timed(loop, *arguments, self.store, angle)
            self.seconds += spent
            self.moves.append(self.store.moves[:int(self.output["moves"])].copy())
        return ended

    def trajectory(self, solver: str, status: Status, first: tuple[float, ...], last: tuple[float, ...], tau: float,
                   detail: str, statistics: Statistics, modes: bool = False) -> Trajectory:
        """What a run came to: its samples at the start and where it ended, `tau` seconds into the engine cycle."""
        problem = self.problem
        whole = min(int(self.output["cycle"]), problem.whole_cycles)
        reached = float(problem.system.cycle_start(problem.start_cycle + whole)) + tau
        t, samples = self._sampled(first, last, status, reached)
        transitions = transitions_of(self.moves)
        cycles = self._cycles(0, whole, self.cycles[:whole + 1, :3].copy())
        begun, rest = reached - tau, None
        if tau > LEAST_REST * (float(problem.system.cycle_start(problem.start_cycle + whole + 1)) - begun):
            self.cycles[whole, 3:] = self.output[["highest", "lowest", "stick_time"]].item()
            rest = dataclasses.replace(self._cycles(whole, whole + 1, np.array([self.cycles[whole, :3], last[:3]])),
                                       starts=np.array([begun, problem.end if status is Status.DONE else reached]))
        states = samples[:, :len(problem.first)]
        return assemble(problem, solver, t, states, modes=samples[:, 4].astype(np.int8) if modes else None,
                        cycles=cycles, rest=rest, transitions=transitions, status=status, detail=detail,
                        statistics=dataclasses.replace(statistics, seconds=self.seconds))

    def _cycles(self, first: int, end: int, section: Floats) -> Cycles:
        """What was kept of the cycles `first` to `end`."""
        highest, lowest, stick_time = self.cycles[first:end, 3:].T.copy()
        return Cycles(section, highest, lowest, stick_time, loads_of(self.loads, self.problem, first, end))

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
