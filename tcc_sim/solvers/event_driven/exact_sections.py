"""Section points of many motions of one system by the exact engine, in one compiled call."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_driven.bounds import Bounds, bounds_of
from tcc_sim.solvers.event_driven.modes import STATE
from tcc_sim.solvers.event_driven.sequence import COUNTERS, FULL, UNKNOWN, integrate
from tcc_sim.solvers.event_driven.solution import STEP_MAXIMUM, constant_law, event_limit
from tcc_sim.solvers.event_driven.stiff_arcs import MATRICES, VALUES
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats


@compiled
def integrate_each(first: int, count: int, event_limit: int, phase: tuple[float, float], bounds: Bounds, terms: Terms,
                   waves: Any, states: Any, drive: Any, counters: Any, outputs: Any, cycles: Any, samples: Any,
                   moves: Any, nodes: Any, matrices: Any, sections: Any) -> None:
    """`integrate` for every state, by itself; `sections` (m, count + 1, 3) is filled as far as each was solved."""
    for k in range(sections.shape[0]):
        while True:
            ended = integrate(first, count, 0.0, 0, STEP_MAXIMUM, event_limit, phase, bounds, terms, waves, states[k],
                              drive, counters[k], outputs[k], cycles, samples, moves, None, nodes, matrices)
            if ended != FULL:
                break
            outputs[k].moves = 0
        for i in range(1, outputs[k].cycle + 1):
            sections[k, i, 0] = cycles[i].slip_speed
            sections[k, i, 1] = cycles[i].plate_angle
            sections[k, i, 2] = cycles[i].plate_speed


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float) -> Floats:
    """As `smoothed.sections.sections`, for the set-valued law (6)."""
    terms = constant_law(terms_of(system))
    bounds = bounds_of(terms, system.cycle, rtol)
    states, outputs, counters = (np.zeros(len(starts), kind) for kind in (STATE, OUTPUT, COUNTERS))
    for name, column in zip(("slip_speed", "plate_angle", "plate_speed"), starts.T):
        states[name] = column
    states["mode"] = states["first_mode"] = UNKNOWN
    states["load_edge"] = math.inf
    outputs["highest"] = outputs["lowest"] = starts[:, 0]
    nodes = matrices = None
    if bounds.stiff_slip or bounds.stiff_stick:
        nodes, matrices = np.zeros(VALUES), np.zeros(MATRICES)
    limit = event_limit(terms, system.cycle)
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    integrate_each(first, cycles, limit, (system.pressure.frequency_ratio, system.pressure.phase), bounds, terms,
                   waves_of(terms), states, np.zeros(1, DRIVE)[0], counters, outputs, np.zeros(cycles + 2, CYCLE),
                   np.zeros((2, 5)), np.zeros(65536 + limit, MOVE), nodes, matrices, out)
    return out
