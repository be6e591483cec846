"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. Every arc is in closed form,
except slip with mu_k < mu_s below the slip speed where exp(-alpha |v|) vanishes in rounding: there it is a power series
of order 20. Which mode follows is decided from the torques, never from the sign of a rounded slip speed; in stick v = 0
exactly.
"""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.event_driven.arcs import Floats, tables_of
from tcc_sim.solvers.event_driven.sequence import CHATTERING, EXHAUSTED_STEPS, NOT_FINITE, march
from tcc_sim.solvers.event_driven.slip_series import ORDER
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.terms import Terms, peak_load, terms_of
from tcc_sim.trajectory import Cycles, Modes, Statistics, Status, Trajectory, Transitions

EVALUATIONS = 5_000_000
"""Most evaluations of one engine cycle."""
NEGLIGIBLE = 39.0
"""exp(-39) is below half a unit in the last place of 1."""
STATUS = {CHATTERING: Status.EVENT_LIMIT, EXHAUSTED_STEPS: Status.STEP_LIMIT, NOT_FINITE: Status.NOT_FINITE}
MODES = np.array([0, 1, -1, 2], dtype=np.int8)


def solve(problem: Problem) -> Trajectory:
    """Solve (1), (2) with the set-valued law (6), exact to rounding where mu_k = mu_s.

    `problem.rtol` bounds the truncation of the power series where mu_k < mu_s. Transitions are the changes of mode.

    Undamped resonances are solved with a stiffness moved by about 1e-8, critical damping with a frequency moved by
    1e-10: the closed form has no digits left there.
    """
    system, terms = problem.system, _law(terms_of(problem.system))
    cycle, whole = system.cycle, problem.whole_cycles
    tables = tables_of(system, terms)
    rest = 0.0
    if problem.cycles is None:
        rest = problem.end - problem.start - whole * cycle
        rest = rest if rest > 1e-12 * cycle else 0.0
    limit = _event_limit(terms, cycle)
    rtol = SOLVERS["event_driven"].default if problem.rtol is None else problem.rtol
    times = problem.sample_times()
    s = problem.state
    state = np.array([s.slip_speed, s.plate_angle, s.plate_speed, s.flywheel_angle - s.plate_angle])
    rows = np.empty((len(times), 6))
    section = np.empty((whole + 1, 3))
    highest, lowest, stick_time = np.empty(whole), np.empty(whole), np.empty(whole)
    torque = max(abs(terms.mean_torque) + _swing(terms) + (1.0 + _excess(terms)) * peak_load(terms), 1e-300)
    settings = np.array([cycle, rest, tables.noise * torque, _far(terms), 1e-3 * rtol,
                         torque / math.sqrt(terms.linear[3] * terms.linear[1]), problem.samples_per_cycle])
    progress = np.array([-1, 0, 0, 0, 0, 0, 0, EVALUATIONS, limit], dtype=np.int64)
    series = None if terms.stribeck is None else np.zeros((3, ORDER + 1))
    flywheel = True if problem.flywheel_angle else None
    kept: list[tuple[Floats, Modes, Modes]] = []
    buffer, kinds = np.empty((65536 + limit, 2)), np.empty((65536 + limit, 2), dtype=np.int64)

    def go_on(state: Floats, progress: NDArray[np.int64]) -> None:
        """March until the end, a failure or a full buffer."""
        march(problem.start_cycle, whole, state, settings, progress, tables, terms.stribeck, series, flywheel, rows,
              section,
              highest, lowest, stick_time, buffer, kinds)

    go_on(state.copy(), np.where(np.arange(len(progress)) == 5, whole + 1, progress))  # Compiling is not solving.
    began = time.perf_counter()
    while progress[4] == 0 and progress[5] < whole + (rest > 0.0):
        progress[3] = 0
        go_on(state, progress)
        n = int(progress[3])
        kept.append((buffer[:n, 0] * cycle + buffer[:n, 1], MODES[kinds[:n, 0]], MODES[kinds[:n, 1]]))
    seconds = time.perf_counter() - began
    status = STATUS.get(int(progress[4]), Status.DONE)
    filled, done = int(progress[2]), min(int(progress[5]), whole)
    rows = rows[:filled]
    modes = MODES[rows[:, 4].astype(np.int64)]
    transitions = Transitions(*(np.concatenate(parts) for parts in zip(*kept))) if kept else Transitions.none()
    states = rows[:, [0, 1, 2, 5]] if problem.flywheel_angle else rows[:, :3]
    out = assemble(problem, "event_driven", times[:filled], states, friction_torque=rows[:, 3],
                   cycles=Cycles(section[:done + 1], highest[:done], lowest[:done], stick_time[:done]),
                   transitions=transitions,
                   status=status, detail=_detail(status, limit),
                   statistics=Statistics(steps=int(progress[6]), iterations=int(progress[6]), seconds=seconds))
    return dataclasses.replace(out, state=np.where(modes == 2, np.sign(rows[:, 0]), modes).astype(np.int8))


def _law(terms: Terms) -> Terms:
    """The terms, with the static coefficient as the only one where the coefficient does not decay with slip speed."""
    if terms.stribeck is None or terms.stribeck[1] > 0.0:
        return terms
    ratio, load = 1.0 + terms.stribeck[0], terms.pulsation
    return terms._replace(stribeck=None, mean_load=ratio * terms.mean_load,
                          pulsation=None if load is None else (ratio * load[0], *load[1:]))


def _swing(terms: Terms) -> float:
    """The sum of the amplitudes of the engine torque, N m."""
    first = terms.torque[0] if terms.torque is not None else 0.0
    return first + (float(terms.harmonics[:, 1].sum()) if terms.harmonics is not None else 0.0)


def _excess(terms: Terms) -> float:
    """mu_s/mu_k - 1."""
    return terms.stribeck[0] if terms.stribeck is not None else 0.0


def _far(terms: Terms) -> float:
    """The slip speed, rad/s, beyond which the kinetic coefficient is mu_k to the last bit; inf where it never is."""
    if terms.stribeck is None:
        return 0.0
    excess, decay = terms.stribeck
    return max(NEGLIGIBLE + math.log(excess), 1.0) / decay


def _event_limit(terms: Terms, cycle: float) -> int:
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
    return f"{EVALUATIONS} evaluations in one engine cycle" if status is Status.STEP_LIMIT else ""
