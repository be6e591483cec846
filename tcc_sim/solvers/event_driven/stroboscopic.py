"""The stroboscopic map of the set-valued law with its exact derivatives, by the state and by the scene's keys.

The motion is that of the exact engine, step by step; disturbances of the state and of scene keys are carried along
(`sensitivity`), with the largest slip and, on request, the margins to other event sequences (`margins`). Nothing is
ever inverted or solved backwards: stick forgets the slip speed, so one multiplier of a motion with stick is exactly 0.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.bernstein import WORKSPACE
from tcc_sim.solvers.changes import ALONG, CHANGES, LANES, changed_at, end_changes, expand_sines, hold_phase
from tcc_sim.solvers.compiling.compiled import Partial, compiled, fast
from tcc_sim.solvers.event_driven.integrate import begin, finish, step_on
from tcc_sim.solvers.event_driven.margins import (
    GRADIENT,
    VALUE,
    note_arrival,
    note_gradient,
    note_step,
    smallest_dip,
)
from tcc_sim.solvers.event_driven.sensitivity import carry, land, unresolved
from tcc_sim.solvers.event_driven.setup import COUNTERS, STATE, UNKNOWN, Bounds, Memory, Setup, Work, bounds_of
from tcc_sim.solvers.event_driven.step import FALLING_ORDER, SHAPE, Step, monotone
from tcc_sim.solvers.excitation import DRIVE, load_phase, waves_of
from tcc_sim.solvers.kept import DONE, EVENT_LIMIT, MOVE, NOT_FINITE, OUTPUT, STEP_LIMIT, note_move
from tcc_sim.solvers.key_derivatives import DECAY, EXCESS_RATIO
from tcc_sim.solvers.series import SLIP
from tcc_sim.solvers.stroboscopic import Prepared, Stroboscopic
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, STICK, Floats, event_sequence

DEGENERATE = 9
"""How the loop ends where slip ends with v' = 0; else as `kept` says."""
LINEAR_REACH, FALLING_REACH = 3.3, 1.6
"""Rates times length at which the last term of a disturbance's series is 1e-14 of it, to the orders of the two."""
SHORTER = 0.6
"""Factor of a step in which the friction's exponential has not converged, though the motion has (mu_k near mu_s)."""
WHY = {NOT_FINITE: "the state is not finite", STEP_LIMIT: "its derivatives take too many steps in one engine cycle",
       DEGENERATE: "slip ends where its rate is 0 too", EVENT_LIMIT: "too many events in one engine cycle"}
EVENTS_PER_CYCLE = 1000
FINER = 1e-2
"""Tolerance of a step per that of a solve: derivatives want more digits than states."""
REACH = 10.0
"""Most that a step with derivatives is long, per time in which the fastest part dies down."""
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, that stands for 0."""


class Disturbed(NamedTuple):
    """A motion and its disturbances: work space and results, used again by the next motion.

    memory : of the engine
    moves : (m,) array of MOVE
    groups, along : array of CHANGES, and record of ALONG
    heights, climbs : (n,), (n, groups, LANES) the largest |slip speed| of every cycle, and how it changes
    least : (3, GRADIENT + groups * LANES) smallest margins
    places, room : (3,) and (LANES,) arrays to work in
    """

    memory: Memory
    moves: Any
    groups: Any
    along: Any
    heights: Any
    climbs: Any
    least: Any
    places: Any
    room: Any


@fast
def longest_step(bounds: Bounds, linear: Linear, load: float, stribeck: Stribeck, fastest: float, state: Any) -> float:
    """Length up to which the series of disturbances hold, s, whatever the motion shows of the rates they have."""
    mode, inertia = state.mode, linear[1]
    if mode == STICK:
        inertia += linear[0]
    rate = max(math.sqrt(linear[3] / inertia) + linear[2] / inertia, fastest)
    if stribeck is not None and mode != STICK and mode != FREE and abs(state.slip_speed) <= 1.01 * bounds.far:
        fall = stribeck[1] * abs(stribeck[0]) * math.exp(-stribeck[1] * abs(state.slip_speed))
        for j in range(2, len(stribeck), 2):
            fall += stribeck[j + 1] * abs(stribeck[j]) * math.exp(-stribeck[j + 1] * abs(state.slip_speed))
        return FALLING_REACH / (rate + fall * load * (1.0 / linear[0] + 1.0 / linear[1]))
    return LINEAR_REACH / rate


@fast
def note_height(mode: int, step: Step, rows: Any, height: float, workspace: Any) -> tuple[float, float, float]:
    """The largest |slip speed| so far after a step, its place in it, and its sign; place -1 where it lies before."""
    place, sign = -1.0, 0.0
    if mode == STICK or abs(rows[SLIP, 0]) + step.reach <= height:
        return height, place, sign
    one_way = monotone(rows, step.degree, step.x, step.reach)
    end = polynomial.value(rows, SLIP, step.degree, step.x)
    for k in range(2):
        side = 1.0 - 2.0 * k
        if mode != FREE and side != mode:
            continue
        if not one_way:
            value, at = smallest_dip(rows, SLIP, step.degree, step.x, -side, -height, workspace)
            if at > 0.0:
                height, place, sign = -value, at, side
        if side * end > height:
            height, place, sign = side * end, step.x, side
    return height, place, sign


@fast
def note_start(n: int, v: float, groups: Any, heights: Any, climbs: Any) -> None:
    """The height of a cycle at its start."""
    heights[n] = abs(v)
    for block in range(groups.shape[0]):
        for lane in range(LANES):
            climbs[n, block, lane] = math.copysign(1.0, v) * groups[block].now[0, lane]


@compiled
def resolved_step(until: float, setup: Setup, fastest: float, memory: Memory,
                  room: Any) -> tuple[Step, float, bool]:
    """The next step, no longer than the series of disturbances hold; the time that it was to reach (s into the cycle),
    and whether the friction coefficient varies in it.
    """
    bounds, terms, waves, _, _ = setup
    state, drive, counters, rows = memory.state, memory.drive, memory.counters, memory.work.rows
    mode, tau = state.mode, state.tau
    amplitude: float = terms.pulsation[0]  # type: ignore[index]
    goal = min(until, tau + longest_step(bounds, terms.linear, terms.mean_load + amplitude, terms.stribeck, fastest,
                                          state))
    while True:
        step = step_on(bounds, terms, waves, state, drive, goal, memory.work, memory.work.tables)
        counters.steps += 1
        falls = False
        if terms.stribeck is not None:
            falls = step.degree == FALLING_ORDER and mode != STICK and mode != FREE
        if not (falls and step.x > 0.0 and unresolved(step, mode, terms.stribeck, rows, room)):
            return step, goal, falls
        goal = tau + SHORTER * step.x * step.unit


@compiled
def integrate_disturbed(disturbed: Disturbed, setup: Setup, first: int, passes: int, tail: float, fastest: float,
                        wanted: bool) -> int:
    """From `state.tau` seconds into cycle `first` over `passes` ends of cycles to `tail` seconds behind the last one.

    fastest : `stroboscopic.Prepared.fastest`
    wanted : whether margins are looked for
    """
    memory, moves, groups, along, heights, climbs, least, places, room = disturbed
    bounds, terms, waves, ratio, _ = setup
    state, drive, counters, output, (rows, workspace, _, _) = memory
    period, n = bounds.period, 0
    total = passes + (1 if tail > 0.0 else 0)
    state.shift = load_phase(ratio, terms.pulsation, first)
    begin(bounds, terms, waves, state, drive)
    state.first_mode = state.mode
    if state.mode == STICK:
        for block in range(groups.shape[0]):
            groups[block].now[0, :] = 0.0
    note_start(0, state.slip_speed, groups, heights, climbs)
    while n < total:
        until, mode = period if n < passes else tail, state.mode
        step, goal, falls = resolved_step(until, setup, fastest, memory, along.sines[0])
        length, degree = step.x * step.unit, step.degree
        if not step.x >= 0.0:
            return NOT_FINITE
        if counters.steps > bounds.steps * total:
            return STEP_LIMIT
        if length > 0.0:
            found = wanted and note_step(mode, degree, step.x, rows, least, places, workspace)
            heights[n], peak, side = note_height(mode, step, rows, heights[n], workspace)
            if mode == STICK:
                output.stick_time += length
            expand_sines(along.sines, degree + 1, step.unit, waves, terms.pulsation, drive)
            carry(mode, falls, step, bounds.ratio, terms, groups, along, rows, terms.pulsation, terms.stribeck, found)
            for block in range(groups.shape[0]):
                group = groups[block]
                if peak > 0.0:
                    for lane in range(LANES):
                        climbs[n, block, lane] = side * changed_at(group, SLIP, lane, degree, degree, peak, rows)
                if found:
                    note_gradient(mode, degree, block, group, rows, least, places)
                end_changes(degree, group.now, group.rows, step.x)
                hold_phase(group, degree, step.x, rows)
        event = finish(bounds, terms, waves, step, goal, state, drive, rows, None)
        if not abs(state.slip_speed) + abs(state.plate_angle) + abs(state.plate_speed) < math.inf:
            return NOT_FINITE
        if event and state.mode != mode:
            note_move((first + n) * period + state.tau, mode, state.mode, output, moves)
            if output.moves >= moves.shape[0]:
                return EVENT_LIMIT
            if mode != STICK and mode != FREE and state.mode != FREE and length > 0.0:
                if wanted:
                    note_arrival(mode, step, state, drive, terms.linear, bounds.ratio, groups, along.sines,
                                 terms.pulsation, room, least)
                if not land(mode, state.mode, state, drive, bounds.ratio, terms.linear, groups):
                    return DEGENERATE
        if state.tau >= until:
            n += 1
            if n < total:
                state.tau -= period
                state.load_edge -= period
                state.shift = load_phase(ratio, terms.pulsation, first + n)
                note_start(n, state.slip_speed, groups, heights, climbs)
    return DONE


class SetValued(Prepared):
    """By the exact engine."""

    def __init__(self, system: System, keys: tuple[str, ...], rtol: float) -> None:
        super().__init__(system, keys)
        terms, numbers = self.terms, self.changes
        if terms.stribeck is not None:
            terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST), *terms.stribeck[2:]))
        bounds, waves = exact_bounds(terms, system, FINER * rtol, numbers), waves_of(terms)
        if bounds.stiff_slip and bounds.slip_rate * bounds.period > REACH * bounds.steps:
            raise InputError(f"driveline.damping is {system.driveline.damping:g} N m s/rad; over "
                             f"driveline.plate_inertia it decays at {bounds.slip_rate:.3g} 1/s, and the derivatives of "
                             f"the set-valued motion, which follow that decay, take more than {bounds.steps} steps a "
                             "cycle; those of friction.law smoothed step over it")
        pressure = system.pressure
        if terms.pulsation is None:
            terms = terms._replace(pulsation=(0.0, pressure.frequency_ratio * system.engine.frequency, pressure.phase))
        # The engine's sines are in the waves, and one compiled kernel serves with and without a pulsating load.
        self.setup = Setup(bounds, terms._replace(torque=None, harmonics=None, smoothing=None), waves,
                           pressure.frequency_ratio, EVENTS_PER_CYCLE)

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3), one after the other."""
        return [self._over(*each, margins) for each in zip(states, starts, ends)]

    def _over(self, state: Floats, start: float, end: float, margins: bool) -> Stroboscopic:
        """See `over`."""
        first, last = math.floor(start), math.floor(end)
        tail = (end - last) * self.period
        n = last - first + (1 if tail > 0.0 else 0)
        room, start_of, solve = room_of(len(self.by), n)
        memory, moves, groups, along, heights, climbs, least, _, _ = room
        groups["by"], groups["forced"], groups["now"] = self.by, self.forced, 0.0
        groups["now"][0, :, :3], along["shaped"] = np.eye(3), self.shaped
        at, counters, output = start_of
        at[0] = (state[0], state[1], state[2], 0.0, UNKNOWN, (start - first) * self.period, 0.0, math.inf, 0, UNKNOWN,
                 0.0)
        counters[0], output[0] = NO_COUNTS, NOTHING
        least[:], least[:, VALUE] = 0.0, np.inf
        ended = solve(self.setup, first, last - first, tail, self.fastest, margins)
        if ended != DONE:
            raise NumericalFailure(f"event_driven: {WHY[ended]}")
        last_state, derivative = memory.state, groups["now"].transpose(1, 0, 2).reshape(3, -1).copy()
        seen = moves[:int(memory.output["moves"])]
        return Stroboscopic(
            np.array([last_state["slip_speed"], last_state["plate_angle"], last_state["plate_speed"]]),
            derivative[:, :self.count],
            event_sequence([*seen["before"][:1], *seen["after"]] or [last_state["first_mode"]]), heights.copy(),
            climbs.reshape(n, -1)[:, :self.count].copy(), float(memory.output["stick_time"]), seen.tolist(),
            least[:, :GRADIENT + self.count].copy() if margins else None)


_rooms = threading.local()
NO_COUNTS, NOTHING = np.zeros((), COUNTERS), np.zeros((), OUTPUT)


def room_of(groups: int, cycles: int) -> tuple[Disturbed, Sequence[Any], Partial]:
    """Room of this thread for so many groups of lanes and cycles; its state, counters and output as arrays; the kernel
    with it.
    """
    known: dict[tuple[int, int], tuple[Disturbed, Sequence[Any], Partial]] = _rooms.__dict__.setdefault("known", {})
    found = known.get((groups, cycles))
    if found is None:
        work = Work(np.zeros(SHAPE), np.zeros(WORKSPACE), None, None)
        state, drive, counters, output = (np.zeros(1, kind) for kind in (STATE, DRIVE, COUNTERS, OUTPUT))
        room = Disturbed(Memory(state[0], drive[0], counters[0], output[0], work),
                         np.zeros(EVENTS_PER_CYCLE * cycles, MOVE), np.zeros(groups, CHANGES), np.zeros(1, ALONG)[0],
                         np.zeros(cycles), np.zeros((cycles, groups, LANES)),
                         np.zeros((3, GRADIENT + groups * LANES)), np.zeros(3), np.zeros(LANES))
        found = known[groups, cycles] = room, (state, counters, output), Partial(integrate_disturbed, room)
    return found


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """The bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not (numbers[EXCESS_RATIO].any() or numbers[DECAY].any()):
        return bounds_of(terms, system.cycle, rtol)
    excess, decay = terms.stribeck[:2]
    wide = bounds_of(terms._replace(stribeck=(max(abs(excess), 1.0), decay)), system.cycle, rtol)
    return wide._replace(ratio=1.0 + excess)
