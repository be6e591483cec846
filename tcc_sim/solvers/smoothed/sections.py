"""Section points of many motions of one system in one compiled call, for work that asks for nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiled import fast
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.smoothed import collocation_tables
from tcc_sim.solvers.smoothed.collocation_tables import Tables
from tcc_sim.solvers.smoothed.kernel import integrate
from tcc_sim.solvers.smoothed.limits import Limits, limits_of
from tcc_sim.solvers.smoothed.state import CONTROL, COUNTERS, STATE, WORK
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats


@fast
def integrate_each(first: int, count: int, step_limit: int, limits: Limits, terms: Terms, ratio: float, waves: Any,
                   tables: Tables, states: Any, controls: Any, drive: Any, work: Any, counters: Any, outputs: Any,
                   cycles: Any, samples: Any, moves: Any, sections: Any) -> None:
    """`integrate` for every state, by itself; `sections` (m, count + 1, 3) is filled as far as each was solved."""
    for k in range(sections.shape[0]):
        integrate(first, count, 0.0, step_limit, limits, terms, ratio, waves, tables, states[k], controls[k], drive,
                  work, counters[k], outputs[k], cycles, samples, 0, moves, None, None)
        for i in range(1, outputs[k].cycle + 1):
            sections[k, i, 0] = cycles[i].slip_speed
            sections[k, i, 1] = cycles[i].plate_angle
            sections[k, i, 2] = cycles[i].plate_speed


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float) -> Floats:
    """(m, cycles + 1, 3) slip speed, plate angle and plate speed at the starts of cycles `first` to `first + cycles`.

    Parameters
    ----------
    starts : (m, 3) states at the start of cycle `first`
    rtol : relative tolerance

    Returns
    -------
    Section points, NaN from where a motion could not be solved further. The interpreter's lock is free meanwhile.
    """
    terms, period = terms_of(system), system.cycle
    limits = limits_of(terms, terms, period, rtol)
    waves = waves_of(terms)
    tables = collocation_tables.tables(terms.linear, tuple(waves["rate"].tolist()),
                                       0.0 if terms.pulsation is None else terms.pulsation[1],
                                       collocation_tables.top_of(period), collocation_tables.levels_of(limits.sigma))
    states, controls, outputs, counters = (np.zeros(len(starts), kind) for kind in (STATE, CONTROL, OUTPUT, COUNTERS))
    for name, column in zip(("slip_speed", "plate_angle", "plate_speed"), starts.T):
        states[name] = column
    slip = starts[:, 0]
    controls["patience"], controls["calm"] = PATIENCE, CALM
    controls["slip_now"], controls["speed_now"] = np.abs(slip), np.abs(starts[:, 2])
    outputs["mode"] = np.where(np.abs(slip) <= limits.stick_speed, 0, np.sign(slip))
    outputs["highest"] = outputs["lowest"] = slip
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    integrate_each(first, cycles, 400_000 + 2_000 * cycles, limits, terms._replace(torque=None, harmonics=None),
                   system.pressure.frequency_ratio, waves, tables, states, controls, np.zeros(1, DRIVE)[0],
                   np.zeros(1, WORK)[0], counters, outputs, np.zeros(cycles + 1, CYCLE), np.empty((0, 3)),
                   np.empty(0, MOVE), out)
    return out
