"""The shell of both engines: the compiled loop, a solve, and motions with derivatives.

A law adds to the loop how a motion starts, and one step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import compiled, fast
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.changes import LANES
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.run_output import DONE, FULL, GOES_ON, STATUSES, STEP_LIMIT, RunOutput, Store, full, work_space
from tcc_sim.solvers.series import COLUMNS, load_phase
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import Floats, Statistics, Trajectory

SCALES = np.array([10.0, 0.1, 10.0])
"""Natural sizes of slip speed (rad/s), plate angle (rad) and plate speed (rad/s)."""
VALUE, GROWS, GRADIENT = 0, 1, 2
"""Columns of margins: the value; 1 where stick's margin grows at that end of slip; derivatives by the disturbances."""
TRANSITIONS_OF_STEP = 2 * COLUMNS
"""Most transitions of one step."""
COUNTERS = np.dtype([("steps", np.int64), ("rejected", np.int64), ("iterations", np.int64),
                     ("iterations_max", np.int64), ("limited", np.int64), ("events", np.int64)])
"""Steps taken and rejected; Newton iterations in all and most in a step; steps that count towards the limit; events of
the present engine cycle."""


class Setup(NamedTuple):
    """A system at a tolerance; every solve has its own `waves`, which hold sines.

    limits : tolerances and rates of the engine
    ratio : omega_f/omega
    tables : of collocation, None where no step needs it
    """

    limits: Any
    terms: Terms
    ratio: float
    waves: Any
    tables: Any


class Memory(NamedTuple):
    """Records that a solve changes: DRIVE of `series`, WORK of `collocation`, COUNTERS, OUTPUT of `run_output`;
    `state` and `control` are the engine's.
    """

    state: Any
    control: Any
    drive: Any
    work: Any
    counters: Any
    output: Any


class Tangent(NamedTuple):
    """Derivatives of a motion, which a loop carries along.

    groups, along : array of CHANGES, and record of ALONG
    shared : record of the engine's, with `fastest`, the rate in rad/s of the fastest sine by whose amplitude there are
        derivatives (0 for none), which limits the steps even where the motion does not have that sine; and `extended`,
        whether the engine computes its further results
    peaks : (cycles, groups, LANES) changes of the largest |slip speed| of every cycle
    margins : (3, GRADIENT + groups * LANES) `exact_engine`; None under the smoothed law
    """

    groups: Any
    along: Any
    shared: Any
    peaks: Any
    margins: Any


Span = tuple[Any, ...]
"""Whole cycles from the start of the solve, and seconds of the cycle after them; those of `loop_through` are arrays."""
Stretch = tuple[Callable[..., int], Span, Setup]
"""A call of a loop."""
SEGMENT = np.dtype([("first", np.int64), ("cycles", np.int64), ("tau", np.float64), ("tail", np.float64),
                    ("steps", np.int64), ("state", np.float64, 3), ("status", np.int64), ("transitions", np.int64),
                    ("mode", np.int64), ("stick_time", np.float64)])
"""A segment of a motion: number of the cycle in which it starts, ends of cycles that it passes, time at its start
within that cycle, and at its end within the last one (s); the most steps; the state at its start, then at its end; its
result; number of transitions; the mode at its end; its time in stick (s)."""


class SegmentBuffers(NamedTuple):
    """Arguments, results and work space of segments, used again by the next ones.

    segments : (m,) array of SEGMENT
    transitions : (m, k) array of TRANSITION
    ends : (m, groups, 3, LANES) array, the tangents at their ends
    heights, climbs : (m, n), (m, n, groups, LANES) arrays, the largest |slip speed| of every cycle or part of one, and
        its change
    """

    segments: Any
    transitions: Any
    ends: Any
    heights: Any
    climbs: Any
    tangent: Tangent
    memory: Memory
    cycles: Any
    samples: Any


def loop_by(start: Callable[..., None], take_step: Callable[..., int], name: str) -> Callable[..., int]:
    """Return the compiled loop of an engine.

    Parameters
    ----------
    start : (setup, memory, tangent), sets up all but the state, where a motion starts
    take_step : (first, count, tail, setup, memory, tangent, store, angle), takes a step or none, across the end of one
        engine cycle at most; a result or GOES_ON
    name : of the engine
    """
    def integrate(first: int, count: int, tail: float, step_limit: int, setup: Setup, memory: Memory, tangent: Any,
                  store: Store, angle: bool) -> int:
        """Solve `count` engine cycles from cycle `first` on, then `tail` seconds of one more; return the result.

        A motion whose output has not `started` starts from the state; else it goes on after `output.cycle` cycles.
        `tangent` is None without derivatives; `angle` is whether to carry theta1.
        """
        state, counters, output = memory.state, memory.counters, memory.output
        period = setup.limits.period
        if output.started == 0:
            counters.limited, counters.events = 0, 0
            state.shift = load_phase(setup.ratio, setup.terms.pulsation, first)
            start(setup, memory, tangent)
        while output.cycle < count or state.tau < tail:
            if counters.limited >= step_limit:
                return STEP_LIMIT
            if tangent is None and full(store.transitions, output.transitions + TRANSITIONS_OF_STEP):
                return FULL
            counters.limited += 1
            status = take_step(first, count, tail, setup, memory, tangent, store, angle)
            if status != GOES_ON:
                return status
            if state.tau >= period:
                state.tau -= period
                state.shift = load_phase(setup.ratio, setup.terms.pulsation, first + output.cycle)
        return DONE

    return compiled(integrate, f"{name}.integrate")


def loop_through(integrate: Callable[..., int], name: str) -> Callable[..., int]:
    """Return the compiled loop of an engine through an excitation that varies in time, by its loop `integrate`."""
    def through(first: int, counts: Any, tails: Any, rows: Any, at: Any, step_limit: int, setup: Setup, memory: Memory,
                tangent: Any, store: Store, angle: bool) -> int:
        """Solve piece by piece, from piece at[0] on, where the solve goes on after it returned FULL.

        counts, tails : (m,) ends of the pieces, as those of `integrate`
        rows : (m, n) rows of the profile, which take the place of `setup.terms.profile` in turn
        """
        row: Any = setup.terms.profile
        while at[0] < len(counts):
            k = at[0]
            for column in range(len(row)):
                row[column] = rows[k, column]
            status = integrate(first, counts[k], tails[k], step_limit, setup, memory, tangent, store, angle)
            if status != DONE:
                return status
            at[0] = k + 1
        return DONE

    return compiled(through, f"{name}.through")


@dataclass(frozen=True, eq=False)
class EngineShell:
    """An engine: its loop and the properties of its law.

    name : of SOLVERS
    integrate : loop by `loop_by`
    kinds : dtypes of the records of `Memory`; None for none
    shared : dtype of the record of `Tangent`
    setup : (system, rtol); a solve copies `waves`
    setup_of_changes : (system, terms, `key_derivatives`, rtol), with derivatives
    steps, steps_of_changes : (setup, cycles), most steps, as the loop counts them
    why : (result, most steps, setup), a sentence on a failure
    stretches : the calls that make a solve; None for one call
    transitions_per_cycle : room for transitions of a segment, per engine cycle
    columns : numbers of a sample with the mode; 0 where the mode follows from the slip speed
    stride : engine cycles between two tests whether a motion ends at an orbit
    bound : most iterations
    """

    name: str
    integrate: Callable[..., int]
    kinds: Memory
    shared: Any
    setup: Callable[[System, float], Setup]
    setup_of_changes: Callable[[System, Terms, Floats, float], Setup]
    steps: Callable[[Setup, int], int]
    steps_of_changes: Callable[[Setup, int], int]
    why: Callable[[int, int, Setup], str]
    transitions_per_cycle: int
    stretches: Callable[[Problem, Setup], Iterable[Stretch]] | None = None
    columns: int = 0
    stride: int = 1
    bound: int = 0

    @cached_property
    def segments(self) -> Callable[..., None]:
        """The kernel that integrates every segment, with the identity as the tangent at its start."""
        integrate = self.integrate

        def segments(buffers: SegmentBuffers, count: int, setup: Setup) -> None:
            segments, transitions, ends, heights, climbs, tangent, memory, cycles, samples = buffers
            state, output, groups = memory.state, memory.output, tangent.groups
            for k in range(count):
                segment = segments[k]
                state.slip_speed, state.plate_angle = segment.state[0], segment.state[1]
                state.plate_speed, state.tau, output.started = segment.state[2], segment.tau, 0
                for i in range(groups.shape[0]):
                    for c in range(3):
                        for lane in range(LANES):
                            groups[i].now[c, lane] = 1.0 if i == 0 and c == lane else 0.0
                segment.status = integrate(segment.first, segment.cycles, segment.tail, segment.steps, setup, memory,
                                           tangent, Store(cycles, samples, 0, transitions[k], None), False)
                if segment.status != DONE:
                    return
                segment.state[0], segment.state[1] = state.slip_speed, state.plate_angle
                segment.state[2], segment.transitions, segment.mode = state.plate_speed, output.transitions, output.mode
                segment.stick_time = output.stick_time if segment.tail > 0.0 else 0.0
                for n in range(segment.cycles):
                    segment.stick_time += cycles[n].stick_time
                    heights[k, n] = max(cycles[n].highest, -cycles[n].lowest)
                if segment.tail > 0.0:
                    heights[k, segment.cycles] = max(output.highest, -output.lowest)
                for i in range(groups.shape[0]):
                    for lane in range(LANES):
                        for c in range(3):
                            ends[k, i, c, lane] = groups[i].now[c, lane]
                        for n in range(segment.cycles):
                            climbs[k, n, i, lane] = tangent.peaks[n, i, lane]
                        if segment.tail > 0.0:
                            climbs[k, segment.cycles, i, lane] = groups[i].peak[lane]

        return fast(segments, f"{self.name}.segments")

    def memory(self) -> tuple[NDArray[np.uint8], Memory]:
        """Return new memory: all bytes, which are 0, and its records."""
        content, _, (records,) = self.memories(1)
        return content, records

    def memories(self, count: int) -> tuple[NDArray[np.uint8], NDArray[Any], list[Memory]]:
        """Return new memory of a number of runs: all bytes, (count, n), which are 0; the array; and its records."""
        present = {name: kind for name, kind in self.kinds._asdict().items() if kind is not None}
        whole = np.zeros(count, np.dtype(list(present.items())))
        return whole.view(np.uint8).reshape(count, -1), whole, [
            Memory(*(memory[name] if name in present else None for name in Memory._fields)) for memory in whole]

    def solve(self, problem: Problem) -> Trajectory:
        """Solve (1), (2) with the engine's law, only with the terms that the system has.

        Returns
        -------
        Trajectory with `cycles` and `transitions`; after a failure it has its Status and ends early.
        """
        setup = self.setup(problem.system, SOLVERS[self.name].default if problem.rtol is None else problem.rtol)
        setup = setup._replace(waves=setup.waves.copy())
        content, memory = work_space.of(EngineShell.memory, self)
        content.fill(0)
        state, counters, numbers = memory.state, memory.counters, (*problem.state.numbers, problem.state.flywheel_angle)
        state["slip_speed"], state["plate_angle"], state["plate_speed"], state["flywheel_angle"] = numbers
        output = RunOutput(problem, memory.output, self.columns or len(problem.first))
        limit = self.steps(setup, problem.whole_cycles + 1)
        calls = (((self.integrate, (problem.whole_cycles, problem.rest), setup),) if self.stretches is None else
                 self.stretches(problem, setup))
        for loop, span, stretch_setup in calls:
            ended = output.run(loop, problem.start_cycle, *span, limit, stretch_setup, memory, None)
            if ended != DONE:
                break
        first: tuple[float, ...] = problem.first
        if self.columns:
            first = *numbers, state["first_mode"]
        steps, rejected, iterations, most, _, _ = counters.item()
        statistics = Statistics(steps, rejected, iterations, most, self.bound)
        return output.trajectory(self.name, STATUSES[ended], first, state.item()[:len(first)], float(state["tau"]),
                                 self.why(ended, limit, setup), statistics, modes=bool(self.columns))
