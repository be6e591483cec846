"""Section points of many motions of one system in one compiled call, for work that asks for nothing else."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiling.compiled import compiled, fast
from tcc_sim.solvers.event_driven import integrate as event_driven_loop
from tcc_sim.solvers.event_driven import setup as event_driven
from tcc_sim.solvers.event_driven.solve import STEP_MAXIMUM, setup_of, work_of
from tcc_sim.solvers.excitation import DRIVE
from tcc_sim.solvers.smoothed import integrate as smoothed_loop
from tcc_sim.solvers.smoothed import setup as smoothed
from tcc_sim.solvers.smoothed.solve import STEPS_AT_FIRST, own_setup
from tcc_sim.solvers.smoothed.switching import CALM, PATIENCE
from tcc_sim.solvers.step_output import CYCLE, OUTPUT, Store
from tcc_sim.solvers.stroboscopic import SCALES
from tcc_sim.trajectory import NO_ORBITS, Floats, Orbits

WITHIN = 1.0 - 1e-9
"""Part of a reach that a motion must be within to end: whoever asks again, with other roundings, finds the same."""


@fast
def by(point: Any, k: int, orbits: Orbits) -> bool:
    """Whether a section point is by that of an orbit."""
    slip_speed = point[0] / SCALES[0] - orbits.points[k, 0]
    plate_angle = point[1] / SCALES[1] - orbits.points[k, 1]
    plate_speed = point[2] / SCALES[2] - orbits.points[k, 2]
    square = slip_speed * slip_speed + plate_angle * plate_angle + plate_speed * plate_speed
    return bool(square <= WITHIN * orbits.reach[k])


@fast
def ends(section: Any, since: int, until: int, output: Any, first: int, cycles: Any, orbits: Orbits) -> bool:
    """Take the points of a motion after cycle `since`; whether it ends there, as where it did not come to `until`."""
    for i in range(since + 1, output.cycle + 1):
        section[i, 0], section[i, 1], section[i, 2] = cycles[i].slip_speed, cycles[i].plate_angle, cycles[i].plate_speed
        for k in range(orbits.reach.shape[0]):
            if ((first + i - 1 - orbits.cycle[k]) % orbits.forcing == 0 and by(section[i - 1], k, orbits)
                    and by(section[i], orbits.following[k], orbits)):
                return True
    return bool(output.cycle < until)


@fast
def smoothed_each(first: int, count: int, stride: int, step_limit: int, setup: smoothed.Setup,
                  memories: smoothed.Memory, store: Store, orbits: Orbits, sections: Any) -> None:
    """`integrate` for every state, by itself, `stride` cycles at a time until it ends; `sections` (m, count + 1, 3) is
    filled as far as each was solved. `memories` holds arrays (m,) of states, controls, counters and outputs.
    """
    states, controls, drive, work, counters, outputs = memories
    for k in range(sections.shape[0]):
        for since in range(0, count, stride):
            until = min(since + stride, count)
            smoothed_loop.integrate(first, until, 0.0, step_limit, setup, smoothed.Memory(
                states[k], controls[k], drive, work, counters[k], outputs[k]), None, store, None)
            if ends(sections[k], since, until, outputs[k], first, store.cycles, orbits):
                break


@compiled
def event_driven_each(first: int, count: int, stride: int, setup: event_driven.Setup, memories: event_driven.Memory,
                      store: Store, orbits: Orbits, sections: Any) -> None:
    """As `smoothed_each`, with arrays of states, counters and outputs."""
    states, drive, counters, outputs, work = memories
    for k in range(sections.shape[0]):
        for since in range(0, count, stride):
            until = min(since + stride, count)
            event_driven_loop.integrate(first, until, 0.0, STEP_MAXIMUM, setup, event_driven.Memory(
                states[k], drive, counters[k], outputs[k], work), store, None)
            if ends(sections[k], since, until, outputs[k], first, store.cycles, orbits):
                break


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float,
             orbits: Orbits = NO_ORBITS) -> Floats:
    """(m, cycles + 1, 3) slip speed, plate angle and plate speed at the starts of cycles `first` to `first + cycles`.

    Parameters
    ----------
    starts : (m, 3) states at the start of cycle `first`
    rtol : relative tolerance
    orbits : where a motion ends, once two points in a row are by those of one; their points are in the sizes of SCALES

    Returns
    -------
    Section points, NaN from where a motion ended or could not be solved further. The interpreter's lock is free
    meanwhile.
    """
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    outputs = np.zeros(len(starts), OUTPUT)
    outputs["highest"] = outputs["lowest"] = starts[:, 0]
    set_valued = system.friction.law == "set_valued"
    # An end of a cycle costs the exact engine a step; the other one's steps are no fewer without.
    stride = (2 if set_valued else 1) if len(orbits.reach) else cycles
    (_set_valued if set_valued else _smoothed)(system, rtol, (first, cycles, stride), outputs, orbits, out)
    return out


def _smoothed(system: System, rtol: float, span: tuple[int, int, int], outputs: NDArray[Any], orbits: Orbits,
              out: Floats) -> None:
    """Fill `out` by the engine for the smoothed law."""
    setup, starts, slip, count = own_setup(system, rtol), out[:, 0], out[:, 0, 0], span[1]
    states, controls, counters = (np.zeros(len(out), kind)
                                  for kind in (smoothed.STATE, smoothed.CONTROL, smoothed.COUNTERS))
    states["slip_speed"], states["plate_angle"], states["plate_speed"] = starts.T
    controls["patience"], controls["calm"] = PATIENCE, CALM
    controls["slip_now"], controls["speed_now"] = np.abs(slip), np.abs(starts[:, 2])
    outputs["mode"] = np.where(np.abs(slip) <= setup.limits.stick_speed, 0, np.sign(slip))
    memories = smoothed.Memory(states, controls, np.zeros(1, DRIVE)[0], np.zeros(1, smoothed.WORK)[0], counters,
                               outputs)
    smoothed_each(*span, STEPS_AT_FIRST + setup.limits.steps * count, setup._replace(waves=setup.waves.copy()),
                  memories, Store(np.zeros(count + 1, CYCLE), np.empty((0, 3)), 0, None), orbits, out)


def _set_valued(system: System, rtol: float, span: tuple[int, int, int], outputs: NDArray[Any], orbits: Orbits,
                out: Floats) -> None:
    """Fill `out` by the engine for the set-valued law."""
    setup, count = setup_of(system, rtol), span[1]
    states, counters = np.zeros(len(out), event_driven.STATE), np.zeros(len(out), event_driven.COUNTERS)
    states["slip_speed"], states["plate_angle"], states["plate_speed"] = out[:, 0].T
    states["mode"] = states["first_mode"] = event_driven.UNKNOWN
    states["load_edge"] = math.inf
    memories = event_driven.Memory(states, np.zeros(1, DRIVE)[0], counters, outputs, work_of(setup.bounds))
    event_driven_each(*span, setup._replace(waves=setup.waves.copy()), memories,
                      Store(np.zeros(count + 2, CYCLE), np.empty((0, 5)), 0, None), orbits, out)
