"""Solve whole engine cycles of many systems, or of many motions of one, without samples, transitions and a Trajectory.

The arguments that do not depend on the system are laid out once for a thread; the calls of the compiled loop for all
systems are one call, during which other threads run. Numbers are those of `solvers.solve`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Call, Calls
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.engine import SCALES, EngineShell, Setup
from tcc_sim.solvers.run_output import (
    CYCLE,
    DONE,
    FULL,
    LOADS,
    Store,
    begin_loads,
    transition_room,
    work_space,
)
from tcc_sim.solvers.stroboscopic import check_mapped, engine_of
from tcc_sim.trajectory import NO_ORBITS, Floats, Orbits, Runs, State

ENGINES = "smoothed", "event_driven"
"""Solvers that solve many runs at once."""
LONGEST = 4096
"""Most engine cycles of a run; `solvers.solve` divides longer ones into several calls."""
TOGETHER = 64
"""Most motions whose section points are computed side by side."""
WITHIN = 1.0 - 1e-9
"""Share of a radius within which a motion ends, so that a repetition with other rounding ends too."""


class Slots:
    """Memory and arrays of a number of runs of an engine, in a thread, used again by the next ones."""

    def __init__(self, engine: EngineShell, count: int, cycles: int) -> None:
        self.count, self.cycles = count, cycles
        self.content, self.memory, self.records = engine.memories(count)
        self.results = np.zeros((count, cycles + 2), CYCLE)
        self.raw: Any = self.results.view(np.float64).reshape(count, cycles + 2, -1)
        self.loads = np.zeros((count, cycles + 2), LOADS)
        samples = np.empty((0, engine.columns or 3))
        transitions = work_space.of(transition_room)
        self.last = [(memory, None, Store(self.results[k], samples, 0, transitions, self.loads[k]), False)
                     for k, memory in enumerate(self.records)]
        self.calls = Calls(engine.integrate, self.last)

    def begin(self, states: Floats, loads_from: int) -> None:
        """Begin runs with these states, (m, 3), whose loads are worked out from an engine cycle on."""
        many = len(states)
        self.content[:many] = 0
        for k, name in enumerate(("slip_speed", "plate_angle", "plate_speed")):
            self.memory["state"][name][:many] = self.results[name][:many, 0] = states[:, k]
        begin_loads(self.loads[:many], loads_from)

    def points(self, many: int, cycles: int) -> Floats:
        """Return the section points of runs, (many, cycles + 1, 3), in the memory of the slots."""
        out: Floats = self.raw[:many, :cycles + 1, :3]
        return out


def solve_runs(systems: Sequence[System], states: Sequence[State], first: Sequence[int], cycles: int,
               rtol: float | None, loads_from: int) -> Runs:
    """Solve systems with the same friction law and a periodic excitation by its engine, in this thread.

    Parameters
    ----------
    systems, states, first : (m,) systems, their initial states, and the numbers of their first engine cycles
    cycles : number of engine cycles of each, 1 to LONGEST
    rtol : relative tolerance; None for the engine's
    loads_from : engine cycle of each run from which on loads are worked out
    """
    engine, many = engine_of(systems[0]), len(systems)
    slots: Slots = work_space.of(Slots, engine, sizes=(many, cycles))
    rtol = SOLVERS[engine.name].default if rtol is None else rtol
    setups = [engine.setup(system, rtol) for system in systems]
    slots.begin(np.array([initial.numbers for initial in states]), loads_from)
    began = time.perf_counter()
    ended = slots.calls([(start, cycles, 0.0, engine.steps(setup, cycles + 1)) for start, setup in zip(first, setups)],
                        [(setup._replace(waves=setup.waves.copy()),) for setup in setups])
    spent = time.perf_counter() - began
    section = slots.points(many, cycles).copy()
    highest, lowest, stick_time = np.ascontiguousarray(slots.raw[:many, :cycles, 3:].transpose(2, 0, 1))
    records = slots.loads.view(np.float64).reshape(slots.count, -1, LOADS.itemsize // 8)[:many, :cycles, :-1]
    loads = np.ascontiguousarray(records.transpose(0, 2, 1))
    loads[:, :, :loads_from] = math.nan
    steps = slots.memory["counters"]["steps"][:many]
    finite = np.isfinite(section).all(axis=(1, 2)) & np.isfinite(highest + lowest + stick_time).all(axis=1)
    return Runs(engine.name, section, highest, lowest, stick_time, loads, spent * steps / max(int(steps.sum()), 1),
                finite & (np.array(ended) == DONE))


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float,
             orbits: Orbits = NO_ORBITS) -> Floats:
    """Return slip speed, plate angle and plate speed at the starts of cycles `first` to `first + cycles`.

    Parameters
    ----------
    starts : (m, 3) states at the start of cycle `first`
    rtol : relative tolerance
    orbits : a motion ends once two points in a row are near those of an orbit, whose points are in units of SCALES

    Returns
    -------
    (m, cycles + 1, 3) section points, NaN after the end or the failure of a motion. Other threads run meanwhile.
    """
    check_mapped(system)
    engine = engine_of(system)
    setup = engine.setup(system, rtol)
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    for begin in range(0, len(out), TOGETHER):
        _fill(out[begin:begin + TOGETHER], engine, setup, first, orbits)
    return out


def _fill(out: Floats, engine: EngineShell, setup: Setup, first: int, orbits: Orbits) -> None:
    """Fill `out`, which holds the starts, with section points, until each motion ends."""
    many, cycles = len(out), out.shape[1] - 1
    slots: Slots = work_space.of(Slots, engine, sizes=(many, cycles))
    limit, calls = engine.steps(setup, cycles), list[Call]()
    slots.begin(out[:, 0], cycles)
    for last in slots.last[:many]:
        calls.append(Call(engine.integrate, 1, "q"))
        calls[-1].use(first, 0, 0.0, limit, setup._replace(waves=setup.waves.copy()), *last)
    output, points, going = slots.memory["output"], slots.points(many, cycles), np.arange(many)
    # The end of a call costs the exact engine a step, so it tests every `stride` cycles whether a motion ends.
    stride = engine.stride if len(orbits.reach) else min(cycles, LONGEST)
    for since in range(0, cycles, stride):
        until = min(since + stride, cycles)
        for k in going.tolist():
            while calls[k](until) == FULL:
                output["transitions"][k] = 0
        solved, block = output["cycle"][going] - since, points[going, since:until + 1]
        ends = _ends(block, first + since, orbits)
        stays = np.where(ends.any(axis=1), ends.argmax(axis=1) + 1, until - since)
        past = np.arange(until - since) >= np.minimum(stays, solved)[:, None]
        out[going, since + 1:until + 1] = np.where(past[:, :, None], np.nan, block[:, 1:])
        going = going[(solved == until - since) & ~ends.any(axis=1)]


def _ends(points: Floats, first: int, orbits: Orbits) -> NDArray[np.bool_]:
    """Return whether two points in a row, (m, n + 1, 3) from cycle `first` on, are near those of an orbit, (m, n)."""
    with np.errstate(over="ignore", invalid="ignore"):  # A motion that runs away is near nothing.
        apart = points[:, :, None] / SCALES - orbits.points
        near = (apart * apart).sum(axis=3) <= WITHIN * orbits.reach
    in_phase = (np.arange(points.shape[1] - 1)[:, None] + first - orbits.cycle) % orbits.forcing == 0
    out: NDArray[np.bool_] = (near[:, :-1] & near[:, 1:, orbits.following] & in_phase).any(axis=2)
    return out
