"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. Which mode follows is decided from the torques, never from the sign of a rounded slip speed; in
stick v = 0 exactly.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.compiling.compiled import timed
from tcc_sim.solvers.event_driven.integrate import (
    CHATTERING,
    COUNTERS,
    DONE,
    EXHAUSTED,
    FULL,
    NOT_FINITE,
    UNKNOWN,
    Memory,
    Setup,
    Work,
    integrate,
)
from tcc_sim.solvers.event_driven.modes import FREE, STATE, STICK
from tcc_sim.solvers.event_driven.setup import Bounds, bounds_of
from tcc_sim.solvers.event_driven.step import SHAPE
from tcc_sim.solvers.event_driven.stiff_step import MATRICES, VALUES
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.kept import Kept
from tcc_sim.solvers.per_system import per_system
from tcc_sim.solvers.polynomial import WORKSPACE
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.step_output import OUTPUT, room_for_moves
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats, Modes, Statistics, Status, Trajectory

STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""
MOVES = 65536
"""Transitions kept in one call of the compiled loop, and those of one more cycle."""
STATUS = {DONE: Status.DONE, CHATTERING: Status.EVENT_LIMIT, EXHAUSTED: Status.STEP_LIMIT,
          NOT_FINITE: Status.NOT_FINITE}


@per_system
def setup_of(system: System, rtol: float) -> Setup:
    """What a solve of a system needs to know beforehand; `waves` is to be copied for every solve."""
    terms = constant_law(terms_of(system))
    waves = waves_of(terms)
    waves.setflags(write=False)
    return Setup(bounds_of(terms, system.cycle, rtol),
                 terms._replace(torque=None, harmonics=None, smoothing=None), waves,  # They are the waves.
                 (system.pressure.frequency_ratio, system.pressure.phase), event_limit(terms, system.cycle))


def work_of(bounds: Bounds) -> Work:
    """Work space for a solve."""
    stiff = (np.zeros(VALUES), np.zeros(MATRICES)) if bounds.stiff_slip or bounds.stiff_stick else (None, None)
    return Work(np.zeros(SHAPE), np.zeros(WORKSPACE), *stiff)


def solve(problem: Problem) -> Trajectory:
    """Solve (1), (2) with the set-valued law (6), exact to rounding where mu_k = mu_s.

    `problem.rtol` bounds the truncation of the power series where mu_k < mu_s. Transitions are the changes of mode.
    After a failure the trajectory ends with the state and the time that were reached.
    """
    system = problem.system
    cycle, whole = system.cycle, problem.whole_cycles
    rest = 0.0
    if problem.cycles is None:
        rest = problem.end - problem.start - whole * cycle
        rest = rest if rest > 1e-12 * cycle else 0.0
    setup = setup_of(system, SOLVERS["event_driven"].default if problem.rtol is None else problem.rtol)
    terms, limit = constant_law(terms_of(system)), setup.event_limit
    state, counters, output = np.zeros(1, STATE), np.zeros(1, COUNTERS), np.zeros(1, OUTPUT)
    s = problem.state
    state[0] = (s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle, UNKNOWN, 0.0, 0.0, math.inf, 0, UNKNOWN,
                0.0)
    output["highest"] = output["lowest"] = s.slip_speed
    kept, moves, seconds = Kept(problem, 5), room_for_moves(MOVES + limit), 0.0
    given = (setup._replace(waves=setup.waves.copy()),
             Memory(state[0], np.zeros(1, DRIVE)[0], counters[0], output[0], work_of(setup.bounds)),
             kept.store(moves), True if problem.flywheel_angle else None)
    ended = FULL
    while ended == FULL:
        output["moves"] = 0
        ended, spent = timed(integrate, problem.start_cycle, whole, rest, STEP_MAXIMUM, *given)
        seconds += spent
        kept.moves.append(moves[:int(output["moves"][0])].copy())
    status, last = STATUS[ended], state[0]
    done = min(int(output["cycle"][0]), whole)
    first = s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle, last["first_mode"]
    times, samples = kept.sampled(
        first, tuple(last[["slip_speed", "plate_angle", "plate_speed", "flywheel_angle", "mode"]]),
        int(output["samples"][0]), status, problem.start + done * cycle + float(last["tau"]))
    modes = samples[:, 4].astype(np.int8)
    cycles, transitions = kept.cycles_and_transitions(done)
    out = assemble(problem, "event_driven", times, samples[:, :4 if problem.flywheel_angle else 3],
                   friction_torque=friction_torques(terms, times, samples, modes), cycles=cycles,
                   transitions=transitions, status=status, detail=_detail(status, limit),
                   statistics=Statistics(steps=int(counters["steps"][0]), seconds=seconds))
    return dataclasses.replace(out, state=np.where(modes == FREE, np.sign(samples[:, 0]), modes).astype(np.int8))


def friction_torques(terms: Terms, t: Floats, samples: Floats, modes: Modes) -> Floats:
    """Tf, N m, of samples in known modes: the law in slip, lambda in stick, 0 when free."""
    load = np.asarray(equations.saturation_torque(t, terms.mean_load, terms.pulsation))
    engine = equations.engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics)
    law = np.sign(modes) * load
    if terms.stribeck is not None:
        law = law * (1.0 + terms.stribeck[0] * np.exp(-terms.stribeck[1] * np.abs(samples[:, 0])))
    held = equations.interface_torque(samples[:, 1], samples[:, 2], engine, terms.linear)
    out: Floats = np.where(modes == STICK, held, np.where(modes == FREE, 0.0, law))
    return out


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


def _detail(status: Status, limit: int) -> str:
    """What the limit was."""
    if status is Status.EVENT_LIMIT:
        return f"{limit} events in one engine cycle"
    return f"{STEP_MAXIMUM} steps in one engine cycle" if status is Status.STEP_LIMIT else ""
