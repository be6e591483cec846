"""Solve whole engine cycles of many systems at once: no sample, no transition and no Trajectory is kept of them.

The arguments that do not depend on the system are laid out once for a thread; the calls of the compiled loop for all
systems are one call, during which other threads run. Numbers are those of `solvers.solve`.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import Calls
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.engine import EngineShell
from tcc_sim.solvers.run_output import CYCLE, DONE, LOADS, TRANSITION, TRANSITIONS_MAXIMUM, Store, begin_loads, scratch
from tcc_sim.solvers.stroboscopic import engine_of
from tcc_sim.trajectory import Runs, State

ENGINES = "smoothed", "event_driven"
"""Solvers that solve many runs at once."""
LONGEST = 4096
"""Most engine cycles of a run; `solvers.solve` divides longer ones into several calls."""


class Slots:
    """Memory and arrays of a number of runs of an engine, in a thread, used again by the next ones."""

    def __init__(self, engine: EngineShell, count: int, cycles: int) -> None:
        self.count, self.cycles = count, cycles
        self.content, self.memory, records = engine.memories(count)
        self.results = np.zeros((count, cycles + 2), CYCLE)
        self.loads = np.zeros((count, cycles + 2), LOADS)
        samples = np.empty((0, engine.columns or 3))
        if len(scratch.transitions) < TRANSITIONS_MAXIMUM:
            scratch.transitions = np.empty(TRANSITIONS_MAXIMUM, TRANSITION)
        transitions = scratch.transitions[:TRANSITIONS_MAXIMUM]
        self.calls = Calls(engine.integrate, [
            (memory, None, Store(self.results[k], samples, 0, transitions, self.loads[k]), False)
            for k, memory in enumerate(records)])


class _Kept(threading.local):
    """The slots of a thread, by solver."""

    def __init__(self) -> None:
        self.slots: dict[str, Slots] = {}

    def of(self, engine: EngineShell, count: int, cycles: int) -> Slots:
        """Return slots for so many runs of so many cycles."""
        slots = self.slots.get(engine.name)
        if slots is None or slots.count < count or slots.cycles < cycles:
            if slots is not None:
                count, cycles = max(count, slots.count), max(cycles, slots.cycles)
            slots = self.slots[engine.name] = Slots(engine, count, cycles)
        return slots


kept = _Kept()


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
    slots = kept.of(engine, many, cycles)
    rtol = SOLVERS[engine.name].default if rtol is None else rtol
    setups = [engine.setup(system, rtol) for system in systems]
    slots.content[:many] = 0
    state = slots.memory["state"][:many]
    numbers = np.array([initial.numbers for initial in states])
    for k, name in enumerate(("slip_speed", "plate_angle", "plate_speed")):
        state[name] = slots.results[name][:many, 0] = numbers[:, k]
    begin_loads(slots.loads[:many], loads_from)
    began = time.perf_counter()
    ended = slots.calls([(start, cycles, 0.0, engine.steps(setup, cycles + 1)) for start, setup in zip(first, setups)],
                        [(setup._replace(waves=setup.waves.copy()),) for setup in setups])
    spent = time.perf_counter() - began
    raw: Any = slots.results.view(np.float64).reshape(slots.count, -1, CYCLE.itemsize // 8)[:many]
    section = raw[:, :cycles + 1, :3].copy()
    highest, lowest, stick_time = np.ascontiguousarray(raw[:, :cycles, 3:].transpose(2, 0, 1))
    records = slots.loads.view(np.float64).reshape(slots.count, -1, LOADS.itemsize // 8)[:many, :cycles, :-1]
    loads = np.ascontiguousarray(records.transpose(0, 2, 1))
    loads[:, :, :loads_from] = math.nan
    steps = slots.memory["counters"]["steps"][:many]
    finite = np.isfinite(section).all(axis=(1, 2)) & np.isfinite(highest + lowest + stick_time).all(axis=1)
    return Runs(engine.name, section, highest, lowest, stick_time, loads, spent * steps / max(int(steps.sum()), 1),
                finite & (np.array(ended) == DONE))
