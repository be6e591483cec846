"""Section points of many motions of one system in one compiled call, for work that asks for nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.excitation import DRIVE
from tcc_sim.solvers.smoothed.integrate import Setup, integrate
from tcc_sim.solvers.smoothed.solve import STEPS_AT_FIRST, own_setup
from tcc_sim.solvers.smoothed.state import CONTROL, COUNTERS, STATE, WORK, Memory
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.step_output import CYCLE, MOVE, OUTPUT, Store
from tcc_sim.trajectory import Floats


@fast
def integrate_each(first: int, count: int, step_limit: int, setup: Setup, states: Any, controls: Any, drive: Any,
                   work: Any, counters: Any, outputs: Any, store: Store, sections: Any) -> None:
    """`integrate` for every state, by itself; `sections` (m, count + 1, 3) is filled as far as each was solved."""
    for k in range(sections.shape[0]):
        integrate(first, count, 0.0, step_limit, setup,
                  Memory(states[k], controls[k], drive, work, counters[k], outputs[k]), store, None, None)
        for i in range(1, outputs[k].cycle + 1):
            sections[k, i, 0] = store.cycles[i].slip_speed
            sections[k, i, 1] = store.cycles[i].plate_angle
            sections[k, i, 2] = store.cycles[i].plate_speed


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
    setup = own_setup(system, rtol)
    states, controls, outputs, counters = (np.zeros(len(starts), kind) for kind in (STATE, CONTROL, OUTPUT, COUNTERS))
    for name, column in zip(("slip_speed", "plate_angle", "plate_speed"), starts.T):
        states[name] = column
    slip = starts[:, 0]
    controls["patience"], controls["calm"] = PATIENCE, CALM
    controls["slip_now"], controls["speed_now"] = np.abs(slip), np.abs(starts[:, 2])
    outputs["mode"] = np.where(np.abs(slip) <= setup.limits.stick_speed, 0, np.sign(slip))
    outputs["highest"] = outputs["lowest"] = slip
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    integrate_each(first, cycles, STEPS_AT_FIRST + setup.limits.steps * cycles,
                   setup._replace(waves=setup.waves.copy()), states, controls, np.zeros(1, DRIVE)[0],
                   np.zeros(1, WORK)[0], counters, outputs,
                   Store(np.zeros(cycles + 1, CYCLE), np.empty((0, 3)), 0, np.empty(0, MOVE)), out)
    return out
