"""Settle a motion: solve it until its section repeats."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.analysis.measured.orders import SPECTRUM_POINTS, Spectrum, spectrum_of
from tcc_sim.analysis.measured.signals import run_signals
from tcc_sim.analysis.repetition import LONGEST
from tcc_sim.analysis.steady.summary import periodicity, sizes_of
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.trajectory import Cycles, Floats, State, Status, Trajectory, concatenated

SPECTRUM_CYCLES = 1024  # Length that a motion without a period is solved on for, cycles of the excitation.

SETTLED = 1e-6
"""Repetition of a settled section, relative to the size of the motion."""
WINDOW, BLOCK = 50, 25
"""Engine cycles over which a section repeats, three longest periods, and those that are solved at a time."""


class Start(NamedTuple):
    """Start of a run: a state on the section, and the number of the engine cycle, which sets the phase of the load."""

    state: State
    cycle: int


class SettledRun(NamedTuple):
    """A motion solved until it settled.

    run : the last block, with the status and the time of all blocks
    cycles : cycles of all blocks; None if the solver stopped early
    after : cycles after which the section repeats to the end; None if it does not
    """

    run: Trajectory
    cycles: Cycles | None
    after: int | None


def solve_to_steady_state(system: System, start: Start, most: int, **how: Any) -> SettledRun:
    """Solve a motion from a start until it settles, or for `most` engine cycles.

    Fig. 2 with the set-valued law takes about 700. `how` are options of `solvers.solve`, such as rtol.
    """
    parts: list[Cycles] = []
    done, seconds, after = 0, 0.0, None
    while after is None and done < most:
        count = min(BLOCK, most - done)
        run = solve(system, cycles=count, state=start.state, start_cycle=start.cycle, **how)
        seconds += run.statistics.seconds
        run = replace(run, statistics=replace(run.statistics, seconds=seconds))
        if run.status is not Status.DONE or run.cycles is None:
            return SettledRun(run, None, None)
        parts.append(run.cycles)
        done, start = done + count, Start(run.final, start.cycle + count)
        cycles = concatenated(parts)
        after = repeats_after(cycles) if done >= WINDOW else None
    return SettledRun(run, cycles, after)


def settled_from_start(system: System, most: int, **how: Any) -> tuple[Cycles, int]:
    """Return the cycles from a scene's initial state, and the period (0: none); raise NumericalFailure."""
    settled = solve_to_steady_state(system, Start(State.at_start(system), 0), most, **how)
    settled.run.raise_for_status()
    cycles = settled.cycles
    assert cycles is not None  # Whole cycles were asked for.
    return cycles, periodicity(cycles[len(cycles) // 2 if settled.after is None else settled.after:]).period


def steady_spectrum(system: System, start: Start, period: int, **how: Any) -> Spectrum:
    """Return the spectrum of a settled motion, solved from `start`; `how` are options of `solvers.solve`.

    period : in engine cycles; 0 for none

    Raises InputError: the excitation does not repeat. Raises NumericalFailure: the solver stopped early.
    """
    system.check_repeats("a spectrum")
    run = solve(system, cycles=period or SPECTRUM_CYCLES, state=start.state, start_cycle=start.cycle,
                samples_per_cycle=SPECTRUM_POINTS, **how).raise_for_status()
    count = len(run.t) - 1
    turns = start.cycle + np.arange(count + 1) / SPECTRUM_POINTS
    return spectrum_of(run_signals(run, (turns, lambda at: at * system.cycle)), period)


def repeats_after(cycles: Cycles) -> int | None:
    """Return the number of cycles after which the section repeats with a period up to 16 to the end; None for none.

    All points that are a period apart are within the tolerance of the last ones, relative to the size of the motion,
    over at least the last `WINDOW` cycles less one period.
    """
    points: Floats = cycles.section
    near = SETTLED * sizes_of(points[-WINDOW:], cycles.highest[-WINDOW:])
    away = (np.abs(points[-2:-2 - LONGEST:-1] - points[-1]) > near).any(axis=1)
    for period in (np.flatnonzero(~away) + 1).tolist():
        number = np.arange(len(points))
        image = len(points) - period + (number - len(points)) % period
        far = (np.abs(points - points[image]) > near).any(axis=1)
        after = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
        if len(points) - 1 - after >= max(WINDOW // 2, 2 * period):
            return after
    return None
