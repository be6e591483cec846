"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. Which mode follows is decided from the torques, never from the sign of a rounded slip speed; in
stick v = 0 exactly.
"""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
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
from tcc_sim.solvers.loads import loads_of, room_for_loads
from tcc_sim.solvers.per_system import per_system
from tcc_sim.solvers.polynomial import WORKSPACE
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.step_output import CYCLE, OUTPUT, Store, room_for_moves, transitions_of
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Cycles, Floats, Modes, Statistics, Status, Trajectory

STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""
MOVES = 65536
"""Transitions kept in one call of the compiled loop, and those of one more cycle."""
STATUS = {DONE: Status.DONE, CHATTERING: Status.EVENT_LIMIT, EXHAUSTED: Status.STEP_LIMIT,
          NOT_FINITE: Status.NOT_FINITE}


_compiled: set[tuple[bool, ...]] = set()
"""Which terms are absent, for every kernel that has been called."""


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
    times = problem.sample_times()
    state, counters, output = np.zeros(1, STATE), np.zeros(1, COUNTERS), np.zeros(1, OUTPUT)
    s = problem.state
    state[0] = (s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle, UNKNOWN, 0.0, 0.0, math.inf, 0, UNKNOWN,
                0.0)
    output["highest"] = output["lowest"] = s.slip_speed
    cycles, samples = np.zeros((whole + 2, CYCLE.itemsize // 8)), np.zeros((len(times), 5))
    cycles[0, :3] = s.slip_speed, s.plate_angle, s.plate_speed
    moves = room_for_moves(MOVES + limit)
    work = work_of(setup.bounds)
    loads = room_for_loads(problem)
    given = (setup._replace(waves=setup.waves.copy()),
             Memory(state[0], np.zeros(1, DRIVE)[0], counters[0], output[0], work),
             Store(cycles.view(CYCLE)[:, 0], samples, problem.samples_per_cycle, moves, loads),
             True if problem.flywheel_angle else None)
    variant = problem.flywheel_angle, loads is None, work.nodes is None, terms.pulsation is None, terms.stribeck is None
    if variant not in _compiled:
        integrate(problem.start_cycle, 0, 0.0, STEP_MAXIMUM, *given)
        _compiled.add(variant)  # Compiling is not solving.
    began = time.perf_counter()
    kept: list[NDArray[Any]] = []
    while True:
        ended = integrate(problem.start_cycle, whole, rest, STEP_MAXIMUM, *given)
        n = int(output["moves"][0])
        if n:
            kept.append(moves[:n].copy())
            output["moves"] = 0
        if ended != FULL:
            break
    seconds = time.perf_counter() - began
    status = STATUS[ended]
    done = min(int(output["cycle"][0]), whole)
    times, samples = _with_end(times, samples, int(output["samples"][0]), problem, state[0], done * cycle, status)
    modes = samples[:, 4].astype(np.int8)
    highest, lowest, stick_time = cycles[:done, 3:].T.copy()
    transitions = transitions_of(kept)
    out = assemble(problem, "event_driven", times, samples[:, :4 if problem.flywheel_angle else 3],
                   friction_torque=friction_torques(terms, times, samples, modes),
                   cycles=Cycles(cycles[:done + 1, :3].copy(), highest, lowest, stick_time,
                                 loads_of(loads, transitions, problem, done)),
                   transitions=transitions, status=status, detail=_detail(status, limit),
                   statistics=Statistics(steps=int(counters["steps"][0]), seconds=seconds))
    return dataclasses.replace(out, state=np.where(modes == FREE, np.sign(samples[:, 0]), modes).astype(np.int8))


def _with_end(times: Floats, samples: Floats, filled: int, problem: Problem, last: Any, done: float,
              status: Status) -> tuple[Floats, Floats]:
    """Samples with the state where the run ended as the last one, at the end or where it failed."""
    if problem.samples_per_cycle < 1:
        filled = 1
        s = problem.state
        samples[0, :4] = s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle
        samples[0, 4] = last["first_mode"]
    filled = min(filled, len(times) - 1)
    row = [last["slip_speed"], last["plate_angle"], last["plate_speed"], last["flywheel_angle"], last["mode"]]
    samples[filled] = row
    if status is not Status.DONE:
        times[filled] = problem.start + done + last["tau"]
    return times[:filled + 1], samples[:filled + 1]


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
