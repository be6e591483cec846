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
from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.model.profile import (
    FREQUENCY,
    FREQUENCY_RATE,
    LOAD_RATE,
    SHIFT,
    STARTED,
    SWELL,
    SWELLS,
    TIME,
    UNTIL,
    pieces,
)
from tcc_sim.solvers import SOLVERS, collocation
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.excitation import DRIVE, load_phase, waves_of
from tcc_sim.solvers.kept import CYCLE, OUTPUT, Kept, Store
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.smoothed.integrate import integrate
from tcc_sim.solvers.smoothed.setup import CONTROL, COUNTERS, STATE, Limits, Memory, Setup, limits_of
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.stages import ITERATIONS_MAXIMUM, WORK
from tcc_sim.solvers.stroboscopic import ends
from tcc_sim.solvers.terms import Terms, load_frequency, per_system, steps_allowed, terms_of
from tcc_sim.trajectory import Floats, Orbits, State, Statistics, Status, Trajectory

STEPS_AT_FIRST = 400_000
"""Steps of a solve before those of its cycles are counted."""

BATCH = 4096
"""Engine cycles in one call of the compiled loop."""
NEAR = 1e-9
"""Corners that lie nearer to the end of a cycle, in cycles, count as there."""

Stretch = tuple[Setup, int, float]
"""One call: with what, up to how many cycles from the start of the solve, and how many seconds of the one after."""
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
    setup = own_setup(problem.system, SOLVERS["smoothed"].default if problem.rtol is None else problem.rtol)
    memory, setup = scratch.at(problem.state, setup.limits), setup._replace(waves=setup.waves.copy())
    kept = Kept(problem, memory.output, len(problem.first))
    limit = STEPS_AT_FIRST + setup.limits.steps * (problem.whole_cycles + 1)
    for own, cycles, rest in stretches_of(problem, setup):
        status = kept.run(integrate, problem.start_cycle, cycles, rest, limit, own, memory, None)
        if status is not Status.DONE:
            break
    *last, tau = memory.state.item()
    steps, rejected, iterations, iterations_max = memory.counters.item()
    return kept.trajectory("smoothed", status, problem.first, tuple(last[:len(problem.first)]), tau,
                           "the state grew without bound" if status is Status.NOT_FINITE else "",
                           Statistics(steps, rejected, iterations, iterations_max, ITERATIONS_MAXIMUM))


@per_system
def own_setup(system: System, rtol: float) -> Setup:
    """`setup_of` for the terms that a system has; `waves` is to be copied for every solve."""
    setup = setup_of(system, terms_of(system), rtol)
    setup.waves.setflags(write=False)
    return setup


def setup_of(system: System, terms: Terms, rtol: float, excess: float = 0.0) -> Setup:
    """What a solve of a system with given terms needs to know beforehand; `excess` is that of `limits_of`."""
    longest, period = system.cycle, system.cycle
    if terms.profile is not None:
        longest, period = longest_and_shortest_cycle(terms.profile)
    limits = limits_of(terms, terms_of(system), period, rtol, excess)
    waves = waves_of(terms)
    top, levels = collocation.ladder_of(limits.fastest, longest)
    if terms.profile is None:
        tables = collocation.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms), top,
                                           levels)
    else:
        limits = limits._replace(steps=steps_allowed(terms, longest))
        tables = collocation.nodal_tables(terms.linear, top,
                                                 levels + math.ceil(2.0 * math.log2(longest / period)))
        terms = terms._replace(pulsation=terms.pulsation or (0.0, 1.0, 0.0))
    return Setup(limits, terms._replace(torque=None, harmonics=None),  # They are the waves.
                        system.pressure.frequency_ratio, waves, tables)


def stretches_of(problem: Problem, setup: Setup) -> Iterator[Stretch]:
    """The calls that make a solve: many cycles at once, or, where the excitation varies in time, piece by piece."""
    if setup.terms.profile is not None:
        yield from _varying(problem, setup, setup.terms.profile)
        return
    count = problem.whole_cycles
    for cycles in range(BATCH, count, BATCH):
        yield setup, cycles, 0.0
    yield setup, count, problem.rest


def _varying(problem: Problem, setup: Setup, profile: Floats) -> Iterator[Stretch]:
    """Engine cycle by engine cycle, and within one from corner to corner."""
    first, count, terms = problem.start_cycle, problem.whole_cycles, setup.terms
    starts = problem.system.cycle_start(first + np.arange(count + 2)).tolist()
    for n in range(count + 1):
        start, following = starts[n], starts[n + 1]
        period, end = following - start, problem.end if n == count else following
        if end - start < NEAR * period:
            return
        near = NEAR * period
        inner = profile[:, TIME][(profile[:, TIME] > start + near) & (profile[:, TIME] < end - near)].tolist()
        shift = load_phase(setup.ratio, terms.pulsation, first + n)
        limits, phase = setup.limits._replace(period=period), 0.0
        for begin, stop in zip([start, *inner], [*inner, end]):
            row = profile_row(profile, begin, stop, start, phase, shift)
            whole = n < count and stop == following
            own = setup._replace(limits=limits, terms=terms._replace(profile=row))
            yield own, n + whole, 0.0 if whole else stop - start
            past = stop - begin
            phase += past * (row[FREQUENCY] + 0.5 * row[FREQUENCY_RATE] * past)


def profile_row(profile: Floats, begin: float, stop: float, start: float, phase: float, shift: float) -> Floats:
    """The row that the kernel is given from `begin` to `stop`, s, within the cycle that started at `start`; `phase` is
    that since then, and `shift` the load's at the start, rad.
    """
    k = int(pieces(profile, 0.5 * (begin + stop)))
    piece, past = profile[k], begin - profile[k, TIME]
    row: Floats = piece.copy()
    row[TIME], row[1] = begin - start, phase
    for column in (*range(FREQUENCY, LOAD_RATE, 2), *range(SWELLS + 2, len(piece), SWELL)):
        row[column], row[column + 1] = piece[column] + piece[column + 1] * past, piece[column + 1]
    ends = profile[k + 1, TIME] if k + 1 < len(profile) else math.inf
    row[UNTIL], row[STARTED], row[SHIFT] = max(ends, stop) - start, start, shift
    return row


def longest_and_shortest_cycle(profile: Floats) -> tuple[float, float]:
    """Bounds of the length of an engine cycle, s."""
    return 2.0 * math.pi / float(profile[:, FREQUENCY].min()), 2.0 * math.pi / float(profile[:, FREQUENCY].max())


@fast
def integrate_each(first: int, count: int, stride: int, step_limit: int, setup: Setup, memories: Memory, store: Store,
                   orbits: Orbits, sections: Any) -> None:
    """`integrate` for every state, by itself, `stride` cycles at a time until it ends; `sections` (m, count + 1, 3) is
    filled as far as each was solved. `memories` holds arrays (m,) of states, controls, counters and outputs.
    """
    states, controls, drive, work, counters, outputs = memories
    for k in range(sections.shape[0]):
        for since in range(0, count, stride):
            until = min(since + stride, count)
            integrate(first, until, 0.0, step_limit, setup, Memory(
                states[k], controls[k], drive, work, counters[k], outputs[k]), None, store, None)
            if ends(sections[k], since, until, outputs[k], first, store.cycles, orbits):
                break


def fill_sections(out: Floats, system: System, first: int, rtol: float, orbits: Orbits) -> None:
    """Fill `out`, in which the starts are, with what `stroboscopic.sections` returns."""
    setup, count, slip = own_setup(system, rtol), out.shape[1] - 1, out[:, 0, 0]
    states, controls, counters, outputs = (np.zeros(len(out), kind) for kind in (STATE, CONTROL, COUNTERS, OUTPUT))
    states["slip_speed"], states["plate_angle"], states["plate_speed"] = out[:, 0].T
    controls["patience"], controls["calm"] = PATIENCE, CALM
    controls["slip_now"], controls["speed_now"] = np.abs(slip), np.abs(out[:, 0, 2])
    outputs["mode"] = np.where(np.abs(slip) <= setup.limits.stick_speed, 0, np.sign(slip))
    outputs["highest"] = outputs["lowest"] = slip
    memories = Memory(states, controls, np.zeros(1, DRIVE)[0], np.zeros(1, WORK)[0], counters, outputs)
    integrate_each(first, count, 1 if len(orbits.reach) else count, STEPS_AT_FIRST + setup.limits.steps * count,
                   setup._replace(waves=setup.waves.copy()), memories,
                   Store(np.zeros(count + 1, CYCLE), np.empty((0, 3)), 0, None), orbits, out)
