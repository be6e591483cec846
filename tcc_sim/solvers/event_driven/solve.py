"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. Which mode follows is decided from the torques, never from the sign of a rounded slip speed; in
stick v = 0 exactly.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS, collocation
from tcc_sim.solvers.bernstein import WORKSPACE
from tcc_sim.solvers.compiling.compiled import compiled
from tcc_sim.solvers.event_driven.integrate import integrate
from tcc_sim.solvers.event_driven.setup import COUNTERS, STATE, UNKNOWN, Memory, Setup, Work, bounds_of
from tcc_sim.solvers.event_driven.step import SHAPE
from tcc_sim.solvers.event_driven.stiff_step import FRESH
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.kept import CYCLE, OUTPUT, Kept, Store
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.stages import WORK
from tcc_sim.solvers.stroboscopic import ends
from tcc_sim.solvers.terms import Terms, load_frequency, per_system, terms_of
from tcc_sim.trajectory import Floats, Orbits, Statistics, Status, Trajectory

STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""


@per_system
def setup_of(system: System, rtol: float) -> Setup:
    """What a solve of a system needs to know beforehand; `waves` is to be copied for every solve."""
    terms = constant_law(terms_of(system))
    waves = waves_of(terms)
    waves.setflags(write=False)
    return Setup(bounds_of(terms, system.cycle, rtol),
                 terms._replace(torque=None, harmonics=None, smoothing=None), waves,  # They are the waves.
                 system.pressure.frequency_ratio, event_limit(terms, system.cycle))


def work_of(setup: Setup) -> Work:
    """Work space for a solve."""
    bounds = setup.bounds
    if not (bounds.stiff_slip or bounds.stiff_stick):
        return Work(np.zeros(SHAPE), np.zeros(WORKSPACE), None, None)
    stages = np.zeros(1, WORK)[0]
    rates = tuple(setup.waves["rate"].tolist())
    ladder = collocation.ladder_of(bounds.slip_rate, bounds.period)
    tables = collocation.tables(setup.terms.linear, rates, load_frequency(setup.terms), *ladder)
    return Work(stages["rows"], stages["bernstein"], stages, tables)


def solve(problem: Problem) -> Trajectory:
    """Solve (1), (2) with the set-valued law (6), exact to rounding where mu_k = mu_s.

    `problem.rtol` bounds the truncation of the power series where mu_k < mu_s. Transitions are the changes of mode.
    After a failure the trajectory ends with the state and the time that were reached.
    """
    setup = setup_of(problem.system, SOLVERS["event_driven"].default if problem.rtol is None else problem.rtol)
    setup = setup._replace(waves=setup.waves.copy())
    state, counters, output = np.zeros(1, STATE), np.zeros(1, COUNTERS), np.zeros(1, OUTPUT)
    s = problem.state
    state[0] = (s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle, UNKNOWN, 0.0, 0.0, math.inf, 0, UNKNOWN,
                FRESH)
    output["highest"] = output["lowest"] = s.slip_speed
    kept = Kept(problem, output[0], 5, setup.event_limit)
    memory = Memory(state[0], np.zeros(1, DRIVE)[0], counters[0], output[0], work_of(setup))
    status = kept.run(integrate, problem.start_cycle, problem.whole_cycles, problem.rest, STEP_MAXIMUM, setup, memory)
    last = state[0]
    detail = {Status.EVENT_LIMIT: f"{setup.event_limit} events in one engine cycle",
              Status.STEP_LIMIT: f"{STEP_MAXIMUM} steps in one engine cycle"}.get(status, "")
    return kept.trajectory(
        "event_driven", status, (s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle, last["first_mode"]),
        tuple(last[["slip_speed", "plate_angle", "plate_speed", "flywheel_angle", "mode"]]), float(last["tau"]), detail,
        Statistics(int(counters["steps"][0])), modes=True)


def constant_law(terms: Terms) -> Terms:
    """The terms, with the static coefficient as the only one where the coefficient does not decay with slip speed."""
    if terms.stribeck is None or terms.stribeck[1] > 0.0:
        return terms
    ratio, load = 1.0 + terms.stribeck[0], terms.pulsation
    return terms._replace(stribeck=None, mean_load=ratio * terms.mean_load,
                          pulsation=None if load is None else (ratio * load[0], *load[1:]))


def event_limit(terms: Terms, cycle: float) -> int:
    """Most events of one engine cycle: 1000, and 40 for each natural or excitation period in it."""
    fastest: Any = math.sqrt(terms.linear[3] / terms.linear[1])
    if terms.pulsation is not None:
        fastest = max(fastest, terms.pulsation[1])
    if terms.harmonics is not None:
        fastest = max(fastest, float(terms.harmonics[:, 0].max()))
    return 1000 + int(min(40.0 * fastest * cycle / (2.0 * math.pi), 1e6))


@compiled
def integrate_each(first: int, count: int, stride: int, setup: Setup, memories: Memory, store: Store, orbits: Orbits,
                   sections: Any) -> None:
    """`integrate` for every state, by itself, `stride` cycles at a time until it ends; `sections` (m, count + 1, 3) is
    filled as far as each was solved. `memories` holds arrays (m,) of states, counters and outputs.
    """
    states, drive, counters, outputs, work = memories
    for k in range(sections.shape[0]):
        for since in range(0, count, stride):
            until = min(since + stride, count)
            integrate(first, until, 0.0, STEP_MAXIMUM, setup, Memory(
                states[k], drive, counters[k], outputs[k], work), store, None)
            if ends(sections[k], since, until, outputs[k], first, store.cycles, orbits):
                break


def fill_sections(out: Floats, system: System, first: int, rtol: float, orbits: Orbits) -> None:
    """Fill `out`, in which the starts are, with what `stroboscopic.sections` returns."""
    setup, count = setup_of(system, rtol), out.shape[1] - 1
    states, counters, outputs = (np.zeros(len(out), kind) for kind in (STATE, COUNTERS, OUTPUT))
    states["slip_speed"], states["plate_angle"], states["plate_speed"] = out[:, 0].T
    states["mode"] = states["first_mode"] = UNKNOWN
    states["load_edge"], states["level"] = math.inf, FRESH
    outputs["highest"] = outputs["lowest"] = out[:, 0, 0]
    memories = Memory(states, np.zeros(1, DRIVE)[0], counters, outputs, work_of(setup))
    # Whether a motion ends is asked every other cycle: the end of one costs a step.
    integrate_each(first, count, 2 if len(orbits.reach) else count, setup._replace(waves=setup.waves.copy()), memories,
                   Store(np.zeros(count + 2, CYCLE), np.empty((0, 5)), 0, None), orbits, out)
