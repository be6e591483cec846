"""Section points of many motions of one system by the exact engine, in one compiled call."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiling.compiled import compiled
from tcc_sim.solvers.event_driven.integrate import COUNTERS, FULL, UNKNOWN, Memory, Setup, Work, integrate
from tcc_sim.solvers.event_driven.modes import STATE
from tcc_sim.solvers.event_driven.solve import MOVES, STEP_MAXIMUM, setup_of, work_of
from tcc_sim.solvers.excitation import DRIVE
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT, Store
from tcc_sim.trajectory import Floats


@compiled
def integrate_each(first: int, count: int, setup: Setup, states: Any, drive: Any, counters: Any, outputs: Any,
                   work: Work, store: Store, sections: Any) -> None:
    """`integrate` for every state, by itself; `sections` (m, count + 1, 3) is filled as far as each was solved."""
    for k in range(sections.shape[0]):
        while True:
            ended = integrate(first, count, 0.0, STEP_MAXIMUM, setup,
                              Memory(states[k], drive, counters[k], outputs[k], work), store, None)
            if ended != FULL:
                break
            outputs[k].moves = 0
        for i in range(1, outputs[k].cycle + 1):
            sections[k, i, 0] = store.cycles[i].slip_speed
            sections[k, i, 1] = store.cycles[i].plate_angle
            sections[k, i, 2] = store.cycles[i].plate_speed


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float) -> Floats:
    """As `smoothed.sections.sections`, for the set-valued law (6)."""
    setup = setup_of(system, rtol)
    states, outputs, counters = (np.zeros(len(starts), kind) for kind in (STATE, OUTPUT, COUNTERS))
    for name, column in zip(("slip_speed", "plate_angle", "plate_speed"), starts.T):
        states[name] = column
    states["mode"] = states["first_mode"] = UNKNOWN
    states["load_edge"] = math.inf
    outputs["highest"] = outputs["lowest"] = starts[:, 0]
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    integrate_each(first, cycles, setup._replace(waves=setup.waves.copy()), states, np.zeros(1, DRIVE)[0], counters,
                   outputs, work_of(setup.bounds), Store(np.zeros(cycles + 2, CYCLE), np.zeros((2, 5)), 0,
                                                         np.zeros(MOVES + setup.event_limit, MOVE)), out)
    return out
