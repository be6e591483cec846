"""The stroboscopic map of a scene by the engine of its friction law, with its exact derivatives; and whole cycles of
many systems, or of many motions of one, without samples, transitions and a Trajectory.

The arguments that do not depend on the system are laid out once for a thread; the calls of the compiled loop for all
systems are one call, during which other threads run. Numbers are those of `solvers.solve`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Call, Calls
from tcc_sim.errors import NumericalFailure
from tcc_sim.model.equations import Linear, check_supported
from tcc_sim.model.parameters import System
from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers import engine as shell
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import ALONG, ALONG_ALL, CHANGES, LANES
from tcc_sim.solvers.engine import EngineShell, SegmentBuffers, Setup, Store, Tangent
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import NO_ORBITS, Floats, Orbits, Runs, State, event_sequence


class Stroboscopic(NamedTuple):
    """The state after some engine cycles, with derivatives.

    state : (3,) slip speed, plate angle, plate speed after them
    derivatives : (3, 3 + P) by the state before, and by the keys, each at constant phase omega t; under the set-valued
        law a start in stick is projected on v = 0
    events : modes in order: S stick, + and - slip, F free
    heights : (N,) the largest |slip speed| of every cycle or part of one, rad/s
    heights_derivatives : (N, 3 + P) of `heights`
    stick_time : s
    transitions : (time in s, mode before, mode after) of each change of mode
    margins : (3, 2 + 3 + P) rows GRAZING, ARRIVAL, STUCK of `exact_engine`: value, whether stick's margin
        grows, derivatives by the state and the keys; inf where there is no such place. None unless requested, and under
        the smoothed law
    """

    state: Floats
    derivatives: Floats
    events: str
    heights: Floats
    heights_derivatives: Floats
    stick_time: float
    transitions: Sequence[tuple[float, int, int]] = ()
    margins: Floats | None = None

    @property
    def derivative(self) -> Floats:
        """(3, 3) array of derivatives by the state before."""
        return self.derivatives[:, :3]

    @property
    def by_parameter(self) -> Floats:
        """(3, P) array of derivatives by the keys."""
        return self.derivatives[:, 3:]


class Prepared:
    """A system with keys, ready to be evaluated at many states by the engine of its friction law.

    by : (groups, len(NUMBERS), LANES) `key_derivatives`, columns in lanes behind those of the state
    forced : (groups,) a bit for every lane of a key
    later : whether a number of several exponentials changes with a key
    shaped : the same, or whether a_1 or sigma does
    period, count : engine cycle, s; columns of the derivatives
    fastest : see `engine.Tangent`
    """

    def __init__(self, system: System, keys: tuple[str, ...], rtol: float) -> None:
        check_mapped(system)
        self.engine, changes = engine_of(system), of.key_derivatives(system, keys)
        self.period, self.count = system.cycle, 3 + len(keys)
        terms, omega, self.fastest = terms_of(system), system.engine.frequency, 0.0
        if changes[of.TORQUE_AMPLITUDE].any():
            terms, self.fastest = terms._replace(torque=terms.torque or (0.0, omega)), omega
        if changes[of.LOAD_AMPLITUDE].any():
            pulsation = terms.pulsation or (0.0, system.pressure.frequency_ratio * omega, system.pressure.phase)
            terms, self.fastest = terms._replace(pulsation=pulsation), max(self.fastest, pulsation[1])
        if terms.stribeck is None and changes[of.EXCESS_RATIO].any():
            terms = terms._replace(stribeck=(0.0, system.friction.decay))
        absent = {name: 0.0 for name, by in zip(Linear._fields, changes) if by.any() and getattr(
            terms.linear, name) is None}
        terms = terms._replace(linear=terms.linear._replace(**absent))
        self.by = np.zeros((-(-self.count // LANES), len(of.NUMBERS), LANES))
        for k in range(3, self.count):
            self.by[k // LANES, :, k % LANES] = changes[:, k - 3]
        self.forced = [(1 << self.count) - 8 >> LANES * k & (1 << LANES) - 1 for k in range(len(self.by))]
        curve = terms.stribeck is not None and len(terms.stribeck) > 2
        self.later = curve and bool(changes[of.EXCESSES + of.DECAYS].any())
        self.shaped = self.later or bool(changes[[of.DECAY, of.SMOOTHING]].any())
        self.setup = self.engine.setup_of_changes(system, terms, changes, rtol)

    def over(self, state: Floats, start: float, end: float, margins: bool = False) -> Stroboscopic:
        """Map a state at the phase `start` to the phase `end`, in engine cycles; see `stroboscopic_map`."""
        image, = self.each(state[None], [start], [end], margins)
        return image

    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """Map several states, (m, 3), by one compiled call; margins are those of the last of them."""
        buffers = self.passed(states, starts, ends, margins)
        count, most = len(states), buffers.heights.shape[1]
        by = self._derivatives(buffers, count)
        heights = buffers.heights[:count].copy()
        peaks = buffers.climbs[:count].reshape(count, most, -1)[..., :self.count].copy()
        least = buffers.tangent.margins if margins else None
        if least is not None:
            least = least[:, :shell.GRADIENT + self.count].copy()
        out = []
        for k, segment in enumerate(buffers.segments[:count].copy()):
            _, cycles, _, tail, _, state, _, moved, mode, stick_time = segment.item()
            n, transitions = cycles + (tail > 0.0), buffers.transitions[k, :moved]
            out.append(Stroboscopic(
                state, by[k], event_sequence([*transitions["before"][:1].tolist(), *transitions["after"].tolist()]
                                             or [mode]),
                heights[k, :n], peaks[k, :n], stick_time, transitions.tolist(), least))
        return out

    def along(self, state: Floats, phases: Sequence[float]) -> tuple[Floats, Floats]:
        """Map a state from each of the phases, (n + 1,), to the next one; return the states at all of them, (n + 1, 3),
        and the derivatives over each part, (n, 3, 3 + P), those of `Stroboscopic`.
        """
        states, parts = [state[None]], []
        for k in range(0, len(phases) - 1, TOGETHER):
            starts, ends = phases[k:-1][:TOGETHER], phases[k + 1:][:TOGETHER]
            buffers = self.passed(states[-1][-1:], starts, ends, follow=True)
            states.append(buffers.segments["state"][:len(ends)].copy())
            parts.append(self._derivatives(buffers, len(ends)))
        return np.concatenate(states), np.concatenate(parts)

    def _derivatives(self, buffers: SegmentBuffers, count: int) -> Floats:
        """Return the derivatives of the states at the ends of segments, (count, 3, 3 + P)."""
        out: Floats = buffers.ends[:count].transpose(0, 2, 1, 3).reshape(count, 3, -1)[..., :self.count].copy()
        return out

    def passed(self, states: Floats, starts: Sequence[float], ends: Sequence[float], extended: bool = False,
               follow: bool = False) -> SegmentBuffers:
        """Integrate several states, or one from each start to the next one, into this thread's SegmentBuffers;
        `extended` is that of `engine.Tangent`.

        Raises NumericalFailure: the engine stopped early.
        """
        period, count, setup, engine = self.period, len(starts), self.setup, self.engine
        spans = [(math.floor(start), math.floor(end), start, end) for start, end in zip(starts, ends)]
        most = max([last - first for first, last, _, _ in spans]) + 1
        buffers: SegmentBuffers = shell.work_space.of(segment_buffers, engine, self.later, len(self.by),
                                                      sizes=(most, count))
        tangent = buffers.tangent
        tangent.groups["by"], tangent.groups["forced"], tangent.along["shaped"] = self.by, self.forced, self.shaped
        tangent.shared["fastest"], tangent.shared["extended"] = self.fastest, extended
        for k, (first, last, start, end) in enumerate(spans):
            buffers.segments[k] = (first, last - first, (start - first) * period, (end - last) * period,
                                   engine.steps_of_changes(setup, last - first + 1), states[0 if follow else k],
                                   shell.DONE, 0, 0, 0.0)
        engine.segments(buffers, count, follow, setup)
        for k, status in enumerate(buffers.segments["status"][:count].tolist()):
            if status != shell.DONE:
                why = engine.why(status, int(buffers.segments["steps"][k]), setup) or shell.STATUSES[status].value
                raise NumericalFailure(f"{engine.name}: {why} after phase {starts[k]:g} of the period of excitation")
        return buffers


def segment_buffers(engine: EngineShell, later: bool, groups: int, most: int, count: int) -> SegmentBuffers:
    """Return buffers for so many groups of lanes, cycles in a segment, and segments."""
    along = np.zeros(1, ALONG_ALL if later else ALONG)[0]
    tangent = Tangent(np.zeros(groups, CHANGES), along, np.zeros(1, engine.shared)[0], np.zeros((most, groups, LANES)),
                      np.zeros((3, shell.GRADIENT + groups * LANES)) if engine.columns else None)
    transitions = np.zeros((count, engine.transitions_per_cycle * most), shell.TRANSITION)
    return SegmentBuffers(np.zeros(count, shell.SEGMENT), transitions, np.empty((count, groups, 3, LANES)),
                          np.empty((count, most)), np.empty((count, most, groups, LANES)), tangent,
                          engine.memories(1)[2][0], np.zeros(most + 1, shell.CYCLE), np.empty((0, engine.columns or 3)))


def check_mapped(system: System) -> None:
    """Raise InputError unless the section's map of a system exists and supports every term of it."""
    system.check_repeats("a map of the section")
    check_supported("section map", system, "a map of the section")


def engine_of(system: System) -> EngineShell:
    """Import the engine of a system's friction law."""
    if system.friction.law == "set_valued":
        from tcc_sim.solvers import exact_engine as exact

        return exact.ENGINE
    from tcc_sim.solvers import smoothed_engine as smooth

    return smooth.ENGINE


def stroboscopic_map(system: System, state: Floats, cycles: float, *, start_cycle: float = 0, rtol: float = 1e-12,
                     parameters: Sequence[str] = (), margins: bool = False) -> Stroboscopic:
    """Return the state after engine cycles (whole ones or parts), and its derivatives by the state and by scene keys.

    state : (3,) slip speed (rad/s), plate angle (rad), plate speed (rad/s)
    cycles, start_cycle : number of engine cycles, and the phase of the start in cycles
    rtol : relative tolerance of the steps
    parameters : scene keys that are one number each
    margins : whether to return the set-valued law's margins to other event sequences

    Raises InputError: a key that is not one number, or that the motion does not depend on continuously.
    NumericalFailure: The engine stopped early, the state is not finite, or has no derivative.
    """
    return Prepared(system, tuple(parameters), rtol).over(state, start_cycle, start_cycle + cycles, margins)


def slope_integrals(system: System, state: Floats, cycle: int, rtol: float) -> Floats:
    """Return the integrals over engine cycle number `cycle` of dT/dv v^2, v^2 and min(dT/dv, 0), (3,), by quadrature on
    the polynomials of the steps; see (21). Only for the smoothed law.

    Raises NumericalFailure: the engine stopped early.
    """
    buffers = Prepared(system, (), rtol).passed(state[None], [cycle], [cycle + 1], extended=True)
    integrals: Floats = buffers.tangent.shared["slopes"].copy()
    return integrals


ENGINES = "smoothed", "event_driven"
"""Solvers that solve many runs at once."""
LONGEST = 4096
"""Most engine cycles of a run; `solvers.solve` divides longer ones into several calls."""
TOGETHER = 64
"""Most motions whose section points are computed side by side."""
WITHIN = 1.0 - 1e-9
"""Share of a radius within which a motion ends, so that a repetition with other rounding ends too."""


class Slots:
    """Memory and arrays of a number of runs of an engine, in a thread, used again by the next ones."""

    def __init__(self, engine: EngineShell, count: int, cycles: int) -> None:
        self.count, self.cycles = count, cycles
        self.content, self.memory, self.records = engine.memories(count)
        self.results = np.zeros((count, cycles + 2), shell.CYCLE)
        self.raw: Any = self.results.view(np.float64).reshape(count, cycles + 2, -1)
        self.loads = np.zeros((count, cycles + 2), shell.LOADS)
        samples = np.empty((0, engine.columns or 3))
        transitions = shell.work_space.of(shell.transition_room)
        self.last = [(memory, None, Store(self.results[k], samples, 0, transitions, self.loads[k]), False)
                     for k, memory in enumerate(self.records)]
        self.calls = Calls(engine.integrate, self.last)

    def begin(self, states: Floats, loads_from: int) -> None:
        """Begin runs with these states, (m, 3), whose loads are worked out from an engine cycle on."""
        many = len(states)
        self.content[:many] = 0
        for k, name in enumerate(("slip_speed", "plate_angle", "plate_speed")):
            self.memory["state"][name][:many] = self.results[name][:many, 0] = states[:, k]
        shell.begin_loads(self.loads[:many], loads_from)


def solve_runs(systems: Sequence[System], states: Sequence[State], first: Sequence[int], cycles: int,
               rtol: float | None, loads_from: int) -> Runs:
    """Solve systems with the same friction law and a periodic excitation by its engine, in this thread.

    systems, states, first : (m,) systems, their initial states, and the numbers of their first engine cycles
    cycles : number of engine cycles of each, 1 to LONGEST
    rtol : relative tolerance; None for the engine's
    loads_from : engine cycle of each run from which on loads are worked out
    """
    engine, many = engine_of(systems[0]), len(systems)
    slots: Slots = shell.work_space.of(Slots, engine, sizes=(many, cycles))
    rtol = SOLVERS[engine.name].default if rtol is None else rtol
    setups = [engine.setup(system, rtol) for system in systems]
    slots.begin(np.array([initial.numbers for initial in states]), loads_from)
    began = time.perf_counter()
    ended = slots.calls([(start, cycles, 0.0, engine.steps(setup, cycles + 1)) for start, setup in zip(first, setups)],
                        [(setup._replace(waves=setup.waves.copy()),) for setup in setups])
    spent = time.perf_counter() - began
    section = slots.raw[:many, :cycles + 1, :3].copy()
    loads = slots.loads.view(np.float64).reshape(slots.count, -1, shell.LOADS.itemsize // 8)[:many, :cycles, :-1]
    values = np.ascontiguousarray(np.concatenate([slots.raw[:many, :cycles, 3:], loads], axis=2).transpose(0, 2, 1))
    values[:, 3:, :loads_from] = math.nan
    steps = slots.memory["counters"]["steps"][:many]
    finite = np.isfinite(section).all(axis=(1, 2)) & np.isfinite(values[:, :3].sum(axis=1)).all(axis=1)
    return Runs(engine.name, section, values, spent * steps / max(int(steps.sum()), 1),
                finite & (np.array(ended) == shell.DONE))


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float,
             orbits: Orbits = NO_ORBITS) -> Floats:
    """Return slip speed, plate angle and plate speed at the starts of cycles `first` to `first + cycles`.

    starts : (m, 3) states at the start of cycle `first`
    rtol : relative tolerance
    orbits : a motion ends once two points in a row are near those of an orbit, whose points are in units of SCALES
    returns : (m, cycles + 1, 3) section points, NaN after the end or the failure of a motion. Other threads run
        meanwhile.
    """
    check_mapped(system)
    engine = engine_of(system)
    setup = engine.setup(system, rtol)
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    for begin in range(0, len(out), TOGETHER):
        _fill(out[begin:begin + TOGETHER], engine, setup, first, orbits)
    return out


def _fill(out: Floats, engine: EngineShell, setup: Setup, first: int, orbits: Orbits) -> None:
    """Fill `out`, which holds the starts, with section points, until each motion ends."""
    many, cycles = len(out), out.shape[1] - 1
    slots: Slots = shell.work_space.of(Slots, engine, sizes=(many, cycles))
    limit, calls = engine.steps(setup, cycles), list[Call]()
    slots.begin(out[:, 0], cycles)
    for last in slots.last[:many]:
        calls.append(Call(engine.integrate, 1, "q"))
        calls[-1].use(first, 0, 0.0, limit, setup._replace(waves=setup.waves.copy()), *last)
    output, points, going = slots.memory["output"], slots.raw[:many, :cycles + 1, :3], np.arange(many)
    # The end of a call costs the exact engine a step, so it tests every `stride` cycles whether a motion ends.
    stride = engine.stride if len(orbits.reach) else min(cycles, LONGEST)
    for since in range(0, cycles, stride):
        until = min(since + stride, cycles)
        for k in going.tolist():
            while calls[k](until) == shell.FULL:
                output["transitions"][k] = 0
        solved, block = output["cycle"][going] - since, points[going, since:until + 1]
        ends = _ends(block, first + since, orbits)
        stays = np.where(ends.any(axis=1), ends.argmax(axis=1) + 1, until - since)
        past = np.arange(until - since) >= np.minimum(stays, solved)[:, None]
        out[going, since + 1:until + 1] = np.where(past[:, :, None], np.nan, block[:, 1:])
        going = going[(solved == until - since) & ~ends.any(axis=1)]


def _ends(points: Floats, first: int, orbits: Orbits) -> NDArray[np.bool_]:
    """Return whether two points in a row, (m, n + 1, 3) from cycle `first` on, are near those of an orbit, (m, n)."""
    with np.errstate(over="ignore", invalid="ignore"):  # A motion that runs away is near nothing.
        apart = points[:, :, None] / shell.SCALES - orbits.points
        near = (apart * apart).sum(axis=3) <= WITHIN * orbits.reach
    in_phase = (np.arange(points.shape[1] - 1)[:, None] + first - orbits.cycle) % orbits.forcing == 0
    out: NDArray[np.bool_] = (near[:, :-1] & near[:, 1:, orbits.following] & in_phase).any(axis=2)
    return out
