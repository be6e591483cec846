"""The shell of both engines: the compiled loop, the output of a run, a solve, and motions with derivatives.

A law adds to the loop how a motion starts, and one step. A step runs over [0, x] in its own unit of time from `tau`,
seconds into the engine cycle with number `output.cycle`, and may run across the end of that cycle; its polynomials are
the rows SLIP, ANGLE, SPEED (and FLYWHEEL) of `rows`. They give samples, section points, extremes, time in stick and
transitions, and the Trajectory of all calls of the loop.

Loads of clutch and shaft in a step are work and power of the friction torque, and the torque in the shaft. (2b) gives
the friction torque from the polynomials of the plate's motion, Tf = I2 theta2'' + C23 theta2' + K23 theta2 + p_v v
(`model.equations.Linear`), under any law and in any mode. Integrals over a step are sums by the rule of Lobatto with
eight points, exact for polynomials up to degree thirteen (M. Abramowitz and I. A. Stegun (1964), 25.4.32). The first
row of the workspace, the hull of the step, is not changed.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from operator import lt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import compiled, fast, timed
from tcc_sim.compiling.unrolled import unrolled, where
from tcc_sim.model.equations import Linear
from tcc_sim.model.parameters import System
from tcc_sim.polynomials import polynomial
from tcc_sim.polynomials.polynomial import BERNSTEIN, HIGH, LOW, PER_BINOMIAL, later_part, to_bernstein
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.changes import LANES
from tcc_sim.solvers.series import ANGLE, COLUMNS, FLYWHEEL, SLIP, SPEED, load_phase
from tcc_sim.solvers.terms import LEAST_REST, Problem, Terms, assemble
from tcc_sim.trajectory import Cycles, Floats, Loads, Statistics, Status, Trajectory, Transitions

LOADS = np.dtype([("energy", np.float64), ("peak_power", np.float64), ("highest_shaft_torque", np.float64),
                  ("lowest_shaft_torque", np.float64), ("breakaways", np.float64), ("coupling_energy", np.float64),
                  ("wanted", np.float64)])
"""An engine cycle: the fields of `Loads`, and 1 where they are computed."""

COUNT = 8
POINTS = np.array([0.0, 0.06412992574519669, 0.20414990928342885, 0.3953503910487606,
                   0.6046496089512394, 0.7958500907165712, 0.9358700742548033, 1.0])
WEIGHTS = np.array([0.017857142857142856, 0.10535211357175302, 0.17056134624175218, 0.20622939732935194,
                    0.20622939732935194, 0.17056134624175218, 0.10535211357175302, 0.017857142857142856])
"""Abscissae and weights of the rule on [0, 1]."""
PLACE, POWER, SHAFT, CLOSER, SQUARE = 1, 2, 3, 3, 7
"""Rows of the workspace: places in a step, power and torque there; CLOSER rows further on the same, closer together;
the square of the slip speed at the last of these places.
"""
MARGIN = 0.1
"""Largest distance of an extreme from the values at the points, relative to their range."""
SHIFTS = 16
"""Most shifts of the closer places; fourteen take them from one end of their range to the other."""


def begin_loads(records: NDArray[Any], first: int | None) -> None:
    """Reset records of LOADS of engine cycles (last axis), which are wanted from cycle `first` on; None for nowhere."""
    records[:] = np.zeros((), LOADS)
    records["highest_shaft_torque"], records["lowest_shaft_torque"] = -math.inf, math.inf
    if first is not None:
        records["wanted"][..., first:] = 1.0


def staged_loads(lanes: int) -> Any:
    """Return the staged function of `evaluate_loads` for degrees below `lanes`."""
    def staged(rows: Any, per_binomial: Any, unit: Any, linear: Any, places: Any, power: Any, shaft: Any,
               square: Any) -> None:
        x = places.row(0, count=COUNT)
        v, angle, speed, rise = 0.0, 0.0, 0.0, 0.0
        for i in range(lanes - 8, -1, -8):
            inside = per_binomial.row(i, count=8)
            a, b, c = (where(inside, ">", 0.0, rows.row(row, i, count=8), 0.0) for row in (SLIP, ANGLE, SPEED))
            for k in range(7, -1, -1):
                rise = x * rise + speed
                v, angle, speed = x * v + a[k], x * angle + b[k], x * speed + c[k]
        torque = speed * linear.damping + angle * linear.stiffness
        shaft.set_row(torque, 0)
        friction = rise * (linear.plate / unit) + torque + v * linear.plate_by_slip
        square.set_row(v * v, 0)
        power.set_row(friction * v, 0)

    return staged


loads_24, loads_32 = unrolled(staged_loads(24)), unrolled(staged_loads(32))


@fast
def evaluate_loads(rows: Any, degree: int, unit: float, linear: Linear, closer: int, workspace: Any) -> None:
    """Fill power of the friction torque, W, and torque in the shaft, N m, at COUNT places; `closer` is 0 or CLOSER."""
    places, power, shaft = workspace[PLACE + closer], workspace[POWER + closer], workspace[SHAFT + closer]
    if degree < 24:
        loads_24(0, rows, PER_BINOMIAL[degree], unit, linear, places, power, shaft, workspace[SQUARE])
    else:
        loads_32(0, rows, PER_BINOMIAL[degree], unit, linear, places, power, shaft, workspace[SQUARE])


@fast
def largest_near(rows: Any, degree: int, unit: float, which: int, sign: float, at: int, linear: Linear,
                 workspace: Any) -> float:
    """Return the largest of `sign` times POWER or SHAFT, whose value at the place `at` is the largest.

    It is the vertex of a parabola through three closer places, which are about the vertex of one through the places
    next to `at`, and move on as long as their largest value is at their end.
    """
    closer, most, moved = 0, -math.inf, 0
    low, high, middle, apart = 0.0, 0.0, 0.0, 0.0
    while True:
        most = max(most, sign * workspace[which + closer, at])
        towards = -1.0 if at == 0 else 1.0 if at == COUNT - 1 else 0.0
        following = min(max(middle + towards * apart, low + apart), high - apart)
        if closer > 0 and following != middle and moved < SHIFTS:
            middle, moved = following, moved + 1
        else:
            at = min(max(at, 1), COUNT - 2)
            a, b, c = (workspace[PLACE + closer, at - 1], workspace[PLACE + closer, at],
                       workspace[PLACE + closer, at + 1])
            p, q, r = (sign * workspace[which + closer, at - 1], sign * workspace[which + closer, at],
                       sign * workspace[which + closer, at + 1])
            left, right = (q - p) / (b - a), (r - q) / (c - b)
            bend = (right - left) / (c - a)
            vertex = 0.5 * (a + b) - 0.5 * left / bend if bend < 0.0 else math.copysign(math.inf, towards)
            if closer > 0:
                if a < vertex < c:
                    most = max(most, p + (vertex - a) * (left + bend * (vertex - b)))
                return float(most)
            low, high, apart = a, c, (c - a) / 16.0
            middle, closer = min(max(vertex, a + apart), c - apart), CLOSER
        for i in range(COUNT):
            workspace[PLACE + closer, i] = middle + apart * (2.0 * POINTS[i] - 1.0)
        evaluate_loads(rows, degree, unit, linear, closer, workspace)
        at = 0
        for i in range(COUNT):
            if sign * workspace[which + closer, i] > sign * workspace[which + closer, at]:
                at = i


@fast
def wanted(loads: Any, cycle: int) -> bool:
    """Return whether the loads of an engine cycle are computed."""
    if loads is None:
        return False
    else:
        return bool(loads[cycle].wanted > 0.0)


@fast
def keep_loads(loads: Any, rows: Any, degree: int, unit: float, x: float, cut: float, cycle: int,
               linear: Linear, workspace: Any) -> None:
    """Add a step over [0, x] to the records of LOADS, if any, of `cycle` and, behind `cut`, of the next one."""
    if loads is not None:
        if wanted(loads, cycle):
            add_part(rows, degree, unit, 0.0, min(x, cut), linear, loads[cycle], workspace)
        if cut < x and wanted(loads, cycle + 1):
            add_part(rows, degree, unit, cut, x, linear, loads[cycle + 1], workspace)


@fast
def keep_breakaway(loads: Any, cycle: int) -> None:
    """Count a change from stick to slip in a cycle."""
    if loads is not None:
        loads[cycle].breakaways += 1.0


@fast
def add_part(rows: Any, degree: int, unit: float, start: float, end: float, linear: Any, load: Any,
             workspace: Any) -> None:
    """Add the part [start, end] of a step to a cycle's record of LOADS."""
    width = end - start
    if not width > 0.0:
        return
    for i in range(COUNT):
        workspace[PLACE, i] = start + POINTS[i] * width
    evaluate_loads(rows, degree, unit, linear, 0, workspace)
    energy, square, least = 0.0, 0.0, math.inf
    most_at, high_at, low_at = 0, 0, 0
    most, high, low = workspace[POWER, 0], workspace[SHAFT, 0], workspace[SHAFT, 0]
    for i in range(COUNT):
        power, shaft = workspace[POWER, i], workspace[SHAFT, i]
        energy += WEIGHTS[i] * power
        square += WEIGHTS[i] * workspace[SQUARE, i]
        least = min(least, power)
        if power > most:
            most, most_at = power, i
        if shaft > high:
            high, high_at = shaft, i
        if shaft < low:
            low, low_at = shaft, i
    load.energy += width * unit * energy
    load.coupling_energy -= width * unit * linear.plate_by_slip * square  # Of the torque -p_v v beside friction.
    margin = MARGIN * (high - low)
    if most + MARGIN * (most - least) > load.peak_power:
        load.peak_power = max(load.peak_power, largest_near(rows, degree, unit, POWER, 1.0, most_at, linear, workspace))
    if high + margin > load.highest_shaft_torque:
        load.highest_shaft_torque = max(load.highest_shaft_torque,
                                        largest_near(rows, degree, unit, SHAFT, 1.0, high_at, linear, workspace))
    if low - margin < load.lowest_shaft_torque:
        load.lowest_shaft_torque = min(load.lowest_shaft_torque,
                                       -largest_near(rows, degree, unit, SHAFT, -1.0, low_at, linear, workspace))


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
    samples per cycle.
    """

    cycles: Any
    samples: Any
    per_cycle: int
    transitions: Any
    loads: Any = None


class _WorkSpace(threading.local):
    """Work space of a thread, used again while it is large enough: to allocate it costs more than a short solve."""

    def __init__(self) -> None:
        self._made: dict[tuple[Any, ...], tuple[tuple[int, ...], Any]] = {}

    def of(self, make: Callable[..., Any], *key: Any, sizes: tuple[int, ...] = ()) -> Any:
        """Return what `make` makes of a key and sizes, at least as large as those."""
        which = make, *key
        before, made = self._made.get(which, ((), None))
        if made is None or any(map(lt, before, sizes)):
            sizes = tuple(map(max, before, sizes)) if before else sizes
            made = make(*key, *sizes)
            self._made[which] = sizes, made
        return made


work_space = _WorkSpace()


def transition_room() -> NDArray[Any]:
    """Return room for the transitions of one call of the compiled loop."""
    return np.empty(TRANSITIONS_MAXIMUM, TRANSITION)


@fast
def begin_output(output: Any, slip_speed: float, mode: int) -> None:
    """Reset the output at the start of a run."""
    output.started, output.cycle, output.samples, output.transitions, output.mode = 1, 0, 0, 0, mode
    output.highest, output.lowest, output.stick_time = slip_speed, slip_speed, 0.0


@fast
def keep_samples(rows: Any, degree: int, unit: float, x: float, tau: float, period: float, store: Store, output: Any,
                 angle: bool) -> None:
    """Store the samples, uniform in time, before the end of the step: rows of v, theta2, theta2' (and theta1)."""
    spacing, samples = period / store.per_cycle, store.samples
    first = output.cycle * store.per_cycle
    end = tau + x * unit
    while output.samples < samples.shape[0] and (output.samples - first) * spacing < end:
        at = min(max(((output.samples - first) * spacing - tau) / unit, 0.0), x)
        row = output.samples
        samples[row, SLIP], samples[row, ANGLE], samples[row, SPEED] = polynomial.values(rows, degree, at)
        if angle:
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
    if output.transitions < transitions.shape[0]:
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
    """Store transitions, breakaways and time in stick of a step over [0, x] from `time` on, s since cycle 0 began;
    return the time in stick behind `cut`, the end of the cycle.
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
def end_cycle(rows: Any, degree: int, cut: float, stick_time: float, output: Any, cycles: Any) -> None:
    """Store the results of the cycle, which ends at `cut` of a step, and begin the next one, with a time in stick."""
    slip_speed, plate_angle, plate_speed = polynomial.values(rows, degree, cut)
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
        end_cycle(rows, degree, cut, behind, output, cycles)
        if cut < x:
            to_bernstein(rows, SLIP, degree, x, workspace)
            later_part(workspace, BERNSTEIN, degree, cut / x)
            output.highest, output.lowest = polynomial.extremes_of(rows, SLIP, degree, x, output.highest,
                                                                   output.lowest, workspace)


class RunOutput:
    """Cycles, samples, transitions and loads of a solve.

    output : record of OUTPUT of the run
    columns : numbers of a sample
    """

    def __init__(self, problem: Problem, output: Any, columns: int) -> None:
        count = problem.whole_cycles
        self.problem, self.output, self.seconds = problem, output, 0.0
        self.samples = np.empty((problem.samples_per_cycle * (count + 1), columns))
        self.cycles = np.zeros((count + 2, CYCLE.itemsize // 8))
        self.cycles[0, :3] = problem.state.numbers
        self.loads = np.empty(count + 2, LOADS)
        begin_loads(self.loads, problem.loads_from)
        self.transitions: list[NDArray[Any]] = []
        self.store = Store(self.cycles.view(CYCLE)[:, 0], self.samples, problem.samples_per_cycle,
                           work_space.of(transition_room), self.loads)

    def run(self, loop: Callable[..., object], *arguments: Any) -> int:
        """Call an engine's loop, with the store and `angle` behind its arguments, until it ends; return its result."""
        ended, angle = FULL, bool(self.problem.flywheel_angle)
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
        t, samples = np.array([problem.start, end]), np.array([first, last])
        if problem.samples_per_cycle:
            times = problem.sample_times()
            filled = len(times) - 1 if status is Status.DONE else min(
                int(self.output["samples"]), len(times) - 1, int(np.searchsorted(times, end)))
            t, samples = np.append(times[:filled], end), np.vstack([self.samples[:filled], last])
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
        highest, lowest, stick_time = self.cycles[first:end, 3:].T.copy()
        loads, wanted_from = None, self.problem.loads_from
        if wanted_from is not None:
            columns = self.loads[first:end].view(np.float64).reshape(end - first, LOADS.itemsize // 8)[:, :-1].T.copy()
            columns[:, :max(wanted_from - first, 0)] = math.nan
            loads = Loads(*columns)
        return Cycles(section, highest, lowest, stick_time, loads)


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
    """Records that a solve changes: DRIVE of `series`, WORK of `collocation`, COUNTERS, OUTPUT;
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
            if tangent is None and output.transitions + TRANSITIONS_OF_STEP > store.transitions.shape[0]:
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
        """The kernel that integrates every segment, with the identity as the tangent at its start; from the end of the
        one before, if they follow each other.
        """
        integrate = self.integrate

        def segments(buffers: SegmentBuffers, count: int, follow: bool, setup: Setup) -> None:
            segments, transitions, ends, heights, climbs, tangent, memory, cycles, samples = buffers
            state, output, groups = memory.state, memory.output, tangent.groups
            for k in range(count):
                segment = segments[k]
                if follow and k > 0:
                    for i in range(3):
                        segment.state[i] = segments[k - 1].state[i]
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

    def memories(self, count: int) -> tuple[NDArray[np.uint8], NDArray[Any], list[Memory]]:
        """Return new memory of a number of runs: all bytes, (count, n), which are 0; the array; and its records."""
        present = {name: kind for name, kind in self.kinds._asdict().items() if kind is not None}
        whole = np.zeros(count, np.dtype(list(present.items())))
        return whole.view(np.uint8).reshape(count, -1), whole, [
            Memory(*(memory[name] if name in present else None for name in Memory._fields)) for memory in whole]

    def solve(self, problem: Problem) -> Trajectory:
        """Solve (1), (2) with the engine's law, only with the terms that the system has; return a Trajectory with
        `cycles` and `transitions`, which after a failure has its Status and ends early.
        """
        setup = self.setup(problem.system, SOLVERS[self.name].default if problem.rtol is None else problem.rtol)
        setup = setup._replace(waves=setup.waves.copy())
        content, _, (memory,) = work_space.of(EngineShell.memories, self, 1)
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
