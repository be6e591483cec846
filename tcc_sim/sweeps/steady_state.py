"""The one way to settle a motion: solve it on until its section repeats, or until a caller's Newton closes its orbit.

How others use it: a caller with a map gives `closed`, which is called after every block with the state on the section,
its cycle and the period that the last cycles seem to have, and returns the state of a closed orbit nearby once it has
one (`continuation.newton` in `continuation/`, `basins.attractors` in `basins/`); a slow approach is then cut short. A
caller without one waits until the section repeats within `Settling.tolerance`. Both say in `Settling.most` when a
motion counts as one that does not settle, so that no horizon of its own stands anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.analysis.periodicity import MAXIMUM_PERIOD, periodicity, sizes_of
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.trajectory import Cycles, Floats, State, Status, Trajectory, concatenated


class Start(NamedTuple):
    """Where a run starts: a state on the section, and the number of the engine cycle, which sets the phase of the load.
    """

    state: State
    cycle: int


@dataclass(frozen=True)
class Settling:
    """When a motion counts as settled.

    most : engine cycles after which one that has not settled is given up; Fig. 2 with the set-valued law takes some 700
    block : cycles solved at a time
    window : cycles over which a settled section must repeat; three periods of the longest that is looked for
    tolerance : repetition, relative to the size of the motion
    """

    most: int = 4800
    block: int = 25
    window: int = 50
    tolerance: float = 1e-6


class Settled(NamedTuple):
    """A motion that was solved on until it settled.

    run : the last block, whose status says whether all went well; its time is that of all blocks
    cycles : of all blocks; None where the solver stopped early
    after : cycles after which the section repeats until the end; None where it does not
    end : where the motion goes on from, on the closed orbit where there is one
    """

    run: Trajectory
    cycles: Cycles | None
    after: int | None
    end: Start


Closing = Callable[[State, int, int], State | None]
"""From a state on the section, its engine cycle and a period (0: unknown), the state of a closed orbit, or None."""
AT_ONCE = Settling()


def settle(system: System, start: Start, settling: Settling = AT_ONCE, *, closed: Closing | None = None,
           **how: Any) -> Settled:
    """Solve a motion until it settles.

    start : where it starts
    closed : ends it by Newton's method; see the head of this module
    how : as `solvers.solve` takes it, such as rtol
    """
    parts: list[Cycles] = []
    done, seconds = 0, 0.0
    while True:
        count = min(settling.block, settling.most - done)
        run = solve(system, cycles=count, state=start.state, start_cycle=start.cycle, **how)
        seconds += run.statistics.seconds
        run = replace(run, statistics=replace(run.statistics, seconds=seconds))
        if run.status is not Status.DONE or run.cycles is None:
            return Settled(run, None, None, start)
        parts.append(run.cycles)
        done, start = done + count, Start(run.final, start.cycle + count)
        cycles = concatenated(parts)
        if done >= settling.window:
            after = repeats_after(cycles, settling)
            if after is not None:
                return Settled(run, cycles, after, start)
            if closed is not None:
                seen = periodicity(cycles[done - settling.window:]).period
                orbit = closed(start.state, start.cycle, seen)
                if orbit is not None:
                    return Settled(run, cycles, done, Start(orbit, start.cycle))
        if done >= settling.most:
            return Settled(run, cycles, None, start)


def repeats_after(cycles: Cycles, settling: Settling = AT_ONCE) -> int | None:
    """After how many cycles the section repeats with some period up to 16 until the end; None where it does not.

    All points that are a period apart lie within the tolerance of the last ones, relative to the size of the motion,
    over at least the last `window` cycles less one period.
    """
    points: Floats = cycles.section
    window = settling.window
    scale = sizes_of(points[-window:], cycles.highest[-window:])
    for period in range(1, MAXIMUM_PERIOD + 1):
        if len(points) <= 2 * period:
            return None
        number = np.arange(len(points))
        image = len(points) - period + (number - len(points)) % period
        far = (np.abs(points - points[image]) > settling.tolerance * scale).any(axis=1)
        after = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
        if len(points) - 1 - after >= max(window // 2, 2 * period):
            return after
    return None
