"""The fast adaptive engine for the smoothed friction law (7).

Outside the layer |v| < about 10/sigma tanh is 1 to the tolerance and slip is not stiff: steps are Taylor series of high
order and variable length, without the exponential where that is below the tolerance. Inside the layer the series
contain tanh too, until the layer's own rate beta Ts sigma limits their length; then, in stick, one collocation step of
16 nodes replaces ten series or more. Steps end at the edges of these regions, which a certified search finds on the
step's polynomial, and run across the section points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tcc_sim.model import profile as of
from tcc_sim.model.equations import completed
from tcc_sim.model.parameters import System
from tcc_sim.solvers import collocation
from tcc_sim.solvers.engine import COUNTERS, EngineShell, Memory, Setup, Stretch
from tcc_sim.solvers.excitation import DRIVE, load_phase, waves_of
from tcc_sim.solvers.key_derivatives import EXCESSES
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.run_output import NOT_FINITE, OUTPUT
from tcc_sim.solvers.smoothed.integrate import integrate
from tcc_sim.solvers.smoothed.sensitivity_series import SHARED
from tcc_sim.solvers.smoothed.setup import CONTROL, STATE, limits_of
from tcc_sim.solvers.stages import ITERATIONS_MAXIMUM, WORK
from tcc_sim.solvers.terms import Terms, load_frequency, per_system, steps_allowed, terms_of
from tcc_sim.trajectory import Floats

STEPS_AT_FIRST = 400_000
"""Steps of a solve beside those allowed to its cycles."""
MORE_STEPS = 10
"""Steps with derivatives per those of a solve."""
BATCH = 4096
"""Engine cycles in one call of the compiled loop."""
NEAR = 1e-9
"""Distance of a corner from the end of a cycle, in cycles, below which it counts as at the end."""


@per_system
def prepared(system: System, rtol: float) -> Setup:
    """Return `setup_of` the terms of a system; a solve copies `waves`."""
    setup = setup_of(system, terms_of(system), rtol)
    setup.waves.setflags(write=False)
    return setup._replace(terms=setup.terms._replace(pulsation=setup.terms.pulsation or (0.0, 1.0, 0.0)))


def setup_of(system: System, terms: Terms, rtol: float, excess: float = 0.0) -> Setup:
    """Return the setup of a system with given terms; `excess` is that of `limits_of`."""
    longest, period = system.cycle, system.cycle
    if terms.profile is not None:
        frequency = terms.profile[:, of.FREQUENCY]
        longest, period = 2.0 * math.pi / float(frequency.min()), 2.0 * math.pi / float(frequency.max())
    limits = limits_of(terms, terms_of(system), period, rtol, excess)
    waves = waves_of(terms)
    top, levels = collocation.ladder_of(limits.fastest, longest)
    if terms.profile is None:
        tables = collocation.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms), top, levels)
    else:
        limits = limits._replace(steps=steps_allowed(terms, longest))
        tables = collocation.nodal_tables(terms.linear, top, levels + math.ceil(2.0 * math.log2(longest / period)))
        terms = terms._replace(pulsation=terms.pulsation or (0.0, 1.0, 0.0))
    terms = terms._replace(linear=completed(terms.linear), torque=None, harmonics=None)  # The sines are the waves.
    return Setup(limits, terms, system.pressure.frequency_ratio, waves, tables)


def _varying(problem: Problem, setup: Setup, profile: Floats) -> Iterator[Stretch]:
    """Yield the calls engine cycle by engine cycle, and within one from corner to corner."""
    first, count, terms = problem.start_cycle, problem.whole_cycles, setup.terms
    starts = problem.system.cycle_start(first + np.arange(count + 2)).tolist()
    for n in range(count + 1):
        start, following = starts[n], starts[n + 1]
        period, end = following - start, problem.end if n == count else following
        if end - start < NEAR * period:
            return
        near = NEAR * period
        times = profile[:, of.TIME]
        inner = times[(times > start + near) & (times < end - near)].tolist()
        shift = load_phase(setup.ratio, terms.pulsation, first + n)
        limits, phase = setup.limits._replace(period=period), 0.0
        for begin, stop in zip([start, *inner], [*inner, end]):
            row = profile_row(profile, begin, stop, start, phase, shift)
            whole = n < count and stop == following
            varied = setup._replace(limits=limits, terms=terms._replace(profile=row))
            yield varied, n + whole, 0.0 if whole else stop - start
            past = stop - begin
            phase += past * (row[of.FREQUENCY] + 0.5 * row[of.FREQUENCY_RATE] * past)


def profile_row(profile: Floats, begin: float, stop: float, start: float, phase: float, shift: float) -> Floats:
    """Return the kernel's row from `begin` to `stop`, s, within the cycle that started at `start`; `phase` is the angle
    since then, and `shift` the load's angle at the start, rad.
    """
    k = int(of.pieces(profile, 0.5 * (begin + stop)))
    piece, past = profile[k], begin - profile[k, of.TIME]
    row: Floats = piece.copy()
    row[of.TIME], row[1] = begin - start, phase
    for column in (*range(of.FREQUENCY, of.LOAD_RATE, 2), *range(of.SWELLS + 2, len(piece), of.SWELL)):
        row[column] = piece[column] + piece[column + 1] * past
    ends = profile[k + 1, of.TIME] if k + 1 < len(profile) else math.inf
    row[of.UNTIL], row[of.STARTED], row[of.SHIFT] = max(ends, stop) - start, start, shift
    return row


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives."""
    # The derivative of mubar by mu_s/mu_k decays with slip as exp(-alpha |v|), even for mu_s/mu_k near 1.
    setup = setup_of(system, terms, rtol, 1.0 if changes[EXCESSES].any() else 0.0)
    ladder = collocation.ladder_of(setup.limits.fastest, system.cycle)
    return setup._replace(tables=setup.tables._replace(torque=collocation.response(terms.linear, *ladder).torque))


def stretches(problem: Problem, setup: Setup) -> Iterator[Stretch]:
    """Yield calls of many cycles, or, where the excitation varies in time, piece by piece."""
    if setup.terms.profile is not None:
        yield from _varying(problem, setup, setup.terms.profile)
        return
    for cycles in range(BATCH, problem.whole_cycles, BATCH):
        yield setup, cycles, 0.0
    yield setup, problem.whole_cycles, problem.rest


ENGINE = EngineShell("smoothed", integrate, Memory(STATE, CONTROL, DRIVE, WORK, COUNTERS, OUTPUT), SHARED, prepared,
                setup_of_changes, lambda setup, cycles: STEPS_AT_FIRST + setup.limits.steps * cycles,
                lambda setup, cycles: MORE_STEPS * setup.limits.steps * cycles,
                lambda ended, *_: "the state grew without bound" if ended == NOT_FINITE else "",
                transitions_per_cycle=256, stretches=stretches, bound=ITERATIONS_MAXIMUM)
solve = ENGINE.solve
