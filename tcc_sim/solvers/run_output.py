"""Output of an engine's run: samples, section points, extremes, time in stick and transitions from the polynomials of
the steps, and the Trajectory of all calls of the compiled loop.

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

from tcc_sim.compiling.compiled import fast, timed
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.bernstein import BERNSTEIN, HIGH, LOW, later_part, to_bernstein
from tcc_sim.solvers.loads import empty_loads, keep_breakaway, loads_of
from tcc_sim.solvers.problem import LEAST_REST, Problem, assemble
from tcc_sim.solvers.series import ANGLE, FLYWHEEL, SLIP, SPEED
from tcc_sim.trajectory import Cycles, Floats, Statistics, Status, Trajectory, Transitions

DONE, FULL, STEP_LIMIT, STEP_TOO_SMALL, EVENT_LIMIT, NOT_FINITE, DEGENERATE = range(7)
"""Result of a call of an engine's loop: at the end; out of room for transitions, so call again; or a failure, the last
one where slip ends with v' = 0 and there is no derivative.
"""
GOES_ON = -1
"""No result: the call goes on."""
STATUSES = {DONE: Status.DONE, STEP_LIMIT: Status.STEP_LIMIT, STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
            EVENT_LIMIT: Status.EVENT_LIMIT, NOT_FINITE: Status.NOT_FINITE}

CYCLE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("highest", np.float64), ("lowest", np.float64), ("stick_time", np.float64)])
"""An engine cycle: the state at its start; the largest and smallest slip speed and the time in stick within it."""

TRANSITION = np.dtype([("time", np.float64), ("before", np.int64), ("after", np.int64)])
"""A transition: seconds since the start of cycle 0, mode before and after."""

OUTPUT = np.dtype([("started", np.int64), ("cycle", np.int64), ("samples", np.int64), ("transitions", np.int64),
                   ("mode", np.int64), ("highest", np.float64), ("lowest", np.float64), ("stick_time", np.float64)])
"""Progress of the output: whether the run has started; whole cycles, samples and transitions so far; the mode now; the
extremes and the time in stick of the cycle so far.
"""

TRANSITIONS_MAXIMUM = 65536
"""Room for transitions in one call of the compiled loop."""


class Store(NamedTuple):
    """Arrays that receive a run: of CYCLE, of states (rows of samples), of TRANSITION, and of LOADS or None; and the
    samples per cycle. Without an array of TRANSITION only the state at the start of each cycle is stored.
    """

    cycles: Any
    samples: Any
    per_cycle: int
    transitions: Any
    loads: Any = None


class _Scratch(threading.local):
    """Work space of a thread's solves, one after the other: to allocate it costs more than a short solve.

    transitions : array of TRANSITION
    memories : the memory of each engine by name, and the same as bytes
    """

    def __init__(self) -> None:
        self.transitions = np.empty(0, TRANSITION)
        self.memories: dict[str, tuple[NDArray[np.uint8], Any]] = {}


scratch = _Scratch()


@fast
def begin_output(output: Any, slip_speed: float, mode: int) -> None:
    """Reset the output at the start of a run."""
    output.started, output.cycle, output.samples, output.transitions, output.mode = 1, 0, 0, 0, mode
    output.highest, output.lowest, output.stick_time = slip_speed, slip_speed, 0.0


@fast
def full(transitions: Any, needed: int) -> bool:
    """Return whether so many transitions do not fit; False if none are stored."""
    return transitions is not None and needed > transitions.shape[0]


@fast
def keep_samples(rows: Any, degree: int, unit: float, x: float, tau: float, period: float, per_cycle: int, output: Any,
                 samples: Any, angle: Any) -> None:
    """Store the samples, uniform in time, before the end of the step: rows of v, theta2, theta2' (and theta1)."""
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
    """Add the part [start, end] of a step in stick up to `cut`, the end of the cycle; return the rest, s."""
    output.stick_time += max(min(end, cut) - start, 0.0) * unit
    return max(end - max(start, cut), 0.0) * unit


@fast
def end_of_cycle(tau: float, after: float, period: float, unit: float, x: float) -> float:
    """Return the place in [0, x] of a step from `tau` to `after` at which the engine cycle ends, else infinity."""
    if after == period:
        return x
    return min((period - tau) / unit, x) if after >= period else math.inf


@fast
def store_transition(time: float, before: int, after: int, output: Any, transitions: Any) -> None:
    """Store a transition if there is room for it."""
    if transitions is not None and output.transitions < transitions.shape[0]:
        transitions[output.transitions].time = time
        transitions[output.transitions].before = before
        transitions[output.transitions].after = after
        output.transitions += 1


@fast
def keeps_mode(mode: int, stick_speed: float, workspace: Any) -> bool:
    """Return whether the slip speed is in `mode` all the step, by its Bernstein coefficients."""
    low, high = workspace[BERNSTEIN, LOW], workspace[BERNSTEIN, HIGH]
    if mode == 0:
        return bool(-stick_speed <= low and high <= stick_speed)
    return bool(low > stick_speed if mode > 0 else high < -stick_speed)


@fast
def keep_modes(rows: Any, degree: int, unit: float, x: float, cut: float, time: float, stick_speed: float, output: Any,
               transitions: Any, loads: Any, workspace: Any) -> float:
    """Store transitions, breakaways and time in stick; return the time in stick behind `cut`, the end of the cycle."""
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
        store_transition(time + at * unit, mode, new, output, transitions)
        mode = new
        start = at
        sticks = abs(workspace[BERNSTEIN, degree]) <= stick_speed
        if sticks == (mode == 0) and polynomial.one_way(degree, 0.0, workspace):
            break
    if mode == 0:
        behind += keep_stick(output, start, x, cut, unit)
    output.mode = mode
    return behind


@fast
def end_cycle(output: Any, cycles: Any, slip_speed: float, plate_angle: float, plate_speed: float,
              stick_time: float) -> None:
    """Store the results of the cycle and begin the next one in the given state."""
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
    """Store extremes, and the section at `cut`, the end of the cycle (beyond x: none); `behind` is the time in stick
    after it. The first row of the workspace holds the Bernstein coefficients of the slip speed over [0, x].
    """
    if cut > x:
        output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, x, output.highest, output.lowest,
                                                               workspace)
    else:
        if cut < x:
            to_bernstein(rows, SLIP, degree, cut, workspace)
        output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, cut, output.highest, output.lowest,
                                                               workspace)
        keep_section(rows, degree, cut, behind, output, cycles)
        if cut < x:
            to_bernstein(rows, SLIP, degree, x, workspace)
            later_part(workspace, BERNSTEIN, degree, cut / x)
            output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, x, output.highest,
                                                                   output.lowest, workspace)


@fast
def keep_step(work: Any, degree: int, unit: float, x: float, cut: float, tau: float, time: float, period: float,
              stick_speed: float, output: Any, store: Store, angle: Any) -> None:
    """Store the output of a step over [0, x].

    Parameters
    ----------
    work : its `rows`, and `bernstein`, whose first row holds the Bernstein coefficients of the slip speed over [0, x]
    cut : end of the engine cycle in [0, x], or beyond
    tau, time : start of the step in its cycle, and since the start of cycle 0, s
    stick_speed : |v| up to which the mode is stick
    angle : not None where theta1 is stored too
    """
    rows = work.rows
    if store.per_cycle > 0:
        keep_samples(rows, degree, unit, x, tau, period, store.per_cycle, output, store.samples, angle)
    keep_motion(rows, degree, unit, x, cut, time, stick_speed, output, store.cycles, store.transitions, store.loads,
                work.bernstein)


@fast
def keep_section(rows: Any, degree: int, cut: float, stick_time: float, output: Any, cycles: Any) -> None:
    """End the cycle at `cut` of a step."""
    slip_speed, plate_angle, plate_speed = polynomial.values(rows, degree, cut)
    end_cycle(output, cycles, slip_speed, plate_angle, plate_speed, stick_time)


@fast
def keep_motion(rows: Any, degree: int, unit: float, x: float, cut: float, time: float, stick_speed: float, output: Any,
                cycles: Any, transitions: Any, loads: Any, workspace: Any) -> None:
    """Store transitions, breakaways, time in stick, extremes and section; only the section where `transitions` is
    None.
    """
    if transitions is not None:
        behind = keep_modes(rows, degree, unit, x, cut, time, stick_speed, output, transitions, loads, workspace)
        keep_cycle(rows, degree, x, cut, behind, output, cycles, workspace)
    elif cut <= x:
        keep_section(rows, degree, cut, 0.0, output, cycles)


class RunOutput:
    """Cycles, samples, transitions and loads of a solve.

    Parameters
    ----------
    output : record of OUTPUT of the run
    columns : numbers of a sample
    """

    def __init__(self, problem: Problem, output: Any, columns: int) -> None:
        count = problem.whole_cycles
        self.problem, self.output, self.seconds = problem, output, 0.0
        self.samples = np.empty((problem.samples_per_cycle * (count + 1), columns))
        self.cycles = np.zeros((count + 2, CYCLE.itemsize // 8))
        self.cycles[0, :3] = problem.state.numbers
        self.loads = empty_loads(problem)
        self.transitions: list[NDArray[Any]] = []
        if len(scratch.transitions) < TRANSITIONS_MAXIMUM:
            scratch.transitions = np.empty(TRANSITIONS_MAXIMUM, TRANSITION)
        self.store = Store(self.cycles.view(CYCLE)[:, 0], self.samples, problem.samples_per_cycle,
                           scratch.transitions[:TRANSITIONS_MAXIMUM], self.loads)

    def run(self, loop: Callable[..., object], *arguments: Any) -> int:
        """Call an engine's loop, with the store and `angle` behind its arguments, until it ends; return its result."""
        ended, angle = FULL, True if self.problem.flywheel_angle else None
        while ended == FULL:
            self.output["transitions"] = 0
            ended, spent = timed(loop, *arguments, self.store, angle)
            self.seconds += spent
            self.transitions.append(self.store.transitions[:int(self.output["transitions"])].copy())
        return ended

    def trajectory(self, solver: str, status: Status, first: tuple[float, ...], last: tuple[float, ...], tau: float,
                   detail: str, statistics: Statistics, modes: bool = False) -> Trajectory:
        """Return the run, its first sample `first` and its last one `last`, at `tau` seconds into the engine cycle."""
        problem = self.problem
        whole = min(int(self.output["cycle"]), problem.whole_cycles)
        begun = float(problem.system.cycle_start(problem.start_cycle + whole))
        reached = begun + tau
        end = problem.end if status is Status.DONE else reached
        t, samples = self._sampled(first, last, status, end)
        rows = np.concatenate(self.transitions) if self.transitions else np.empty(0, TRANSITION)
        transitions = Transitions(rows["time"].copy(), rows["before"].astype(np.int8), rows["after"].astype(np.int8))
        cycles, rest = self._cycles(0, whole, self.cycles[:whole + 1, :3].copy()), None
        if tau > LEAST_REST * (float(problem.system.cycle_start(problem.start_cycle + whole + 1)) - (reached - tau)):
            self.cycles[whole, 3:] = self.output[["highest", "lowest", "stick_time"]].item()
            rest = dataclasses.replace(self._cycles(whole, whole + 1, np.array([self.cycles[whole, :3], last[:3]])),
                                       starts=np.array([reached - tau, end]))
        return assemble(problem, solver, t, samples[:, :len(problem.first)],
                        modes=samples[:, 4].astype(np.int8) if modes else None, cycles=cycles, rest=rest,
                        transitions=transitions, status=status, detail=detail,
                        statistics=dataclasses.replace(statistics, seconds=self.seconds))

    def _cycles(self, first: int, end: int, section: Floats) -> Cycles:
        """Return the cycles `first` to `end`."""
        highest, lowest, stick_time = self.cycles[first:end, 3:].T.copy()
        return Cycles(section, highest, lowest, stick_time, loads_of(self.loads, self.problem, first, end))

    def _sampled(self, first: tuple[float, ...], last: tuple[float, ...], status: Status,
                 end: float) -> tuple[Floats, Floats]:
        """Return times, s, and samples of a run up to its end at the time `end`."""
        problem = self.problem
        if not problem.samples_per_cycle:
            return np.array([problem.start, end]), np.array([first, last])
        times = problem.sample_times()
        filled = len(times) - 1
        if status is not Status.DONE:
            filled = min(int(self.output["samples"]), filled, int(np.searchsorted(times, end)))
        return np.append(times[:filled], end), np.vstack([self.samples[:filled], last])
