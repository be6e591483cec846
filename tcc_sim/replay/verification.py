"""Verify a recording by solving it again from its scenes and inputs with the kernel of the driveline."""

from __future__ import annotations

import ctypes
import itertools
import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Kernel
from tcc_sim.errors import InputError, counted
from tcc_sim.model.profile import START
from tcc_sim.recording.columns import BLOCK, JointStates
from tcc_sim.recording.stamps import Break
from tcc_sim.replay.result import STEP_TOLERANCE, Verification
from tcc_sim.replay.timeline import Timeline, inputs_of_ticks
from tcc_sim.solvers.fixed_step import Stepper, course, tick
from tcc_sim.solvers.terms import Terms, for_ticks, holding, substeps, terms_from
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

COLUMNS = topic("joint_states").fields
"""Columns of a row: angles (rad) and speeds (rad/s) of flywheel and plate, engine and friction torque (N m)."""
TICKS_AT_ONCE, WITH_PROFILES = 1 << 14, 1 << 8
"""Largest number of ticks in one compiled call, without and with a profile for each."""
RESULTS = 7
"""Numbers in `fixed_step.Reached`, of which the last counts iterations."""
SMALLEST_WORK, WORK_PER_BYTE = 30_000_000, 1000
"""Largest number of sub-steps for a verification: a constant, and a number for each byte of the recording. A tick
counts as 20 more. Gaps may use half of the total.
"""


def verify(line: Timeline, size: int, progress: Callable[[int], Any] | None = None) -> Verification:
    """Compare a recording with the solution of its scenes, tick by tick.

    A run that starts at stamp 0 is solved from the scene's initial state and continues exactly across gaps, as long as
    no input comes from a topic. Otherwise each tick is solved from the recorded state before it.

    After a change of parameters, the driveline published its scene with the stamp of the first state that the change
    affects and the kernel used; the change is applied at that tick, also within a gap. A pause leaves no trace.

    The inputs of each tick are those of `timeline.inputs_of_ticks`. For an actuator with a lag, two successive recorded
    pressures define the pressure within the tick (`model.actuator`). The far end of the shaft continues from its
    recorded angle at the recorded speed.

    Parameters
    ----------
    size : size of the recording, bytes, which bounds the work
    progress : function called with the number of states just compared
    """
    verifier = _Verifier(line, size)
    try:
        for states in line.runs:
            run = _Run(verifier, states)
            for begin in range(0, len(states), BLOCK):
                verifier.compare(states[begin:begin + BLOCK], *run.solved(begin, min(begin + BLOCK, len(states))))
                if progress is not None:
                    progress(min(BLOCK, len(states) - begin))
    except InputError as error:
        return Verification(False, math.inf, 0, 0, 0, None, str(error))
    return verifier.result()


class _Verifier:
    """Scene that applies, work that is left, and the differences so far."""

    def __init__(self, line: Timeline, size: int) -> None:
        self.line, self._size = line, np.zeros(len(COLUMNS))
        self._absent = np.isin(COLUMNS, line.absent)
        self._work = self._work_limit = SMALLEST_WORK + WORK_PER_BYTE * size
        self._gap_work = self._work_limit // 2
        self._largest = np.zeros(len(COLUMNS))
        self._states_compared = self._exactly = self._leapt = 0
        self.solved = self.unknown = 0
        """Number of states that were solved, and of those without a known input."""
        self.sources_matter = False
        """Whether an input may fall back to harmonics although the recording does not state its sources."""
        self.broken: float | None = None
        """Time of the first state of a run that begins after a reset, but not at 0; None without one."""
        self._first: int | None = None

    def result(self) -> Verification:
        """Return the result of all runs."""
        ratio = np.divide(self._largest, self._size, out=self._largest.copy(), where=self._size > 0.0)
        largest, detail = float(ratio.max()), ""
        if self._leapt:
            detail = (f"; {counted(self._leapt, 'gap')} could not be solved through within the limit of "
                      f"{self._work_limit} sub-steps")
        if self._first is not None:
            detail = (f"the message of {self._first * 1e-9:.9g} s is the first that differs; the largest difference is "
                      f"{largest:.3g} of its signal's maximum (possible reasons: a changed or missing value or scene, "
                      "another version or machine)")
            if self.sources_matter:
                detail += "; the recording does not state the sources of its inputs, so every one counts as commanded"
        elif self.unknown:
            detail = f"{self.unknown} of {counted(self._states_compared, 'state')} have no known input"
        elif self.broken is not None:
            detail = (f"a run begins at {self.broken:.9g} s after a reset, which must lead to 0: messages are missing "
                      "or mixed up")
        elif not self.solved:
            detail = "there is no state before any of them to solve from"
        if self._absent.any():
            detail += f"; not recorded, so not compared: {', '.join(self.line.absent)}"
        verified = self._first is None and self.solved > 0 and not self.unknown and self.broken is None
        return Verification(verified, largest, self._states_compared, self.solved, self._exactly, self._first, detail)

    def bridged(self, cost: int) -> bool:
        """Return whether the work that is left suffices for the ticks of a gap, and subtract it."""
        if cost > self._gap_work:
            self._leapt += 1
            return False
        self._gap_work -= cost
        return True

    def work(self, cost: int) -> None:
        """Subtract work; raise InputError if it is more than is left."""
        self._work -= cost
        if self._work < 0:
            raise InputError(f"solving it again takes more than {self._work_limit} sub-steps, the most allowed for a "
                             "recording of its size")

    def compare(self, block: JointStates, solved: Floats, exact: NDArray[np.bool_]) -> None:
        """Add the differences of some states."""
        recorded = rows_of(block)
        self._size = np.maximum(self._size, np.abs(recorded).max(axis=0, initial=0.0, where=np.isfinite(recorded)))
        difference = np.abs(recorded - solved)
        difference[np.isnan(difference)] = math.inf
        difference[:, self._absent] = 0.0
        self._largest = np.maximum(self._largest, difference.max(axis=0))
        self._states_compared += len(block)
        self._exactly += int(np.count_nonzero(exact))
        allowed = np.where(exact[:, None], 0.0, STEP_TOLERANCE * self._size)
        wrong = np.flatnonzero((difference > allowed).any(axis=1))
        if len(wrong) and self._first is None:
            self._first = int(block.stamp_ns[wrong[0]])


class _Run:
    """A run that is solved again: its scenes, and inputs, number and knowledge of each tick."""

    def __init__(self, verifier: _Verifier, states: JointStates) -> None:
        self._verifier, self._states = verifier, states
        places, scenes, first = verifier.line.places, verifier.line.scenes, int(states.stamp_ns[0])
        later = bisect_left(places, (states.index, 0))
        while later < len(places) and places[later][0] == states.index and (
                scenes[places[later][1]].first_stamp_ns <= first):
            later += 1
        scene, origin = verifier.line.scene_of(places[later - 1][1] if later else 0)
        self._step, pressure = 1.0 / scene.operation.rate, scene.system.pressure
        self._stepper = Stepper(scene.system, self._step)
        self._ticks = self._numbers(scene.operation.rate)
        made = {-1: (scene, START if first == 0 else origin)}
        for begin, number in self._changed(places[later:], 1e9 / scene.operation.rate).items():
            made[begin] = verifier.line.scene_of(number)
        self._changes = list(made)
        self._terms = [terms_from(scene.system, origin) for scene, origin in made.values()]
        self._per_pressure = [scene.system.torque_per_pressure for scene, _ in made.values()]
        self._inputs = inputs_of_ticks(verifier.line, states)
        verifier.sources_matter |= states.held is None and any(
            group.source == "topic" and group.harmonic for group in (scene.system.engine, pressure))
        self._lag = (pressure.time_constant, pressure.rate_limit) if pressure.lagged else None
        self._torque = states.engine_torque
        self._pressure, self._angle, self._speed = map(states.of, ("applied_pressure", "output_angle", "output_speed"))
        self._moved = np.append(False, states.stamp_ns[:-1] >= states.moved_ns)
        if states.began is Break.RESET and self._ticks[0] and verifier.broken is None and not verifier.line.keyed:
            verifier.broken = float(states.stamp_ns[0]) * 1e-9
        topics = "topic" in (scene.system.engine.source, pressure.source)
        self._gaps = self._solvable(topics)
        self._exact = np.logical_and.accumulate(np.append(self._ticks[0] == 0, self._gaps[1:] > 0))
        verifier.solved += int(self._exact[0]) + int(np.count_nonzero(self._gaps))

    def _changed(self, places: Sequence[tuple[int, int]], step_ns: float) -> dict[int, int]:
        """Return the numbers of scenes that a run changes to, by the first tick made with each."""
        states, numbers = self._states, dict[int, int]()
        for at, number in places:
            stamp, row = self._verifier.line.scenes[number].first_stamp_ns, max(at - states.index, 0)
            if row < len(states) and (row == 0 or states.stamp_ns[row] < stamp):
                row += 1
                stamp = 0
            if row >= len(states):
                break
            begin = int(stamp / step_ns)
            begin += round(begin * step_ns) < stamp
            numbers[max(min(max(begin, int(self._ticks[row - 1]) + 1), int(self._ticks[row])), *numbers, 0)] = number
        return numbers

    def _numbers(self, rate: float) -> NDArray[np.int64]:
        """Return the number of the tick at each state; raise InputError unless its stamp is that of a tick."""
        step, stamps = 1e9 / rate, self._states.stamp_ns
        ticks: NDArray[np.int64] = np.rint(stamps / step).astype(np.int64)
        odd = np.flatnonzero(np.rint(ticks * step).astype(np.int64) != stamps)
        if len(odd):
            raise InputError(f"stamp {stamps[odd[0]] * 1e-9:.9g} s is not that of a tick at {rate:g} Hz; the driveline "
                             "node did not make this recording")
        return ticks

    def _solvable(self, topics: bool) -> NDArray[np.int64]:
        """Return the number of ticks to make from the state before to each state; 0 where it cannot be solved."""
        moves = np.isfinite(self._speed)
        given = np.all([one.known for one in self._inputs.values()], axis=0) & (moves | ~self._moved)
        given[1:] &= ~(self._moved[1:] & np.isnan(self._angle[:-1]))
        self._verifier.unknown += int(np.count_nonzero(~given[1:]))
        ticks = np.where(given, np.diff(self._ticks, prepend=self._ticks[0]), 0)
        if self._lag is not None:
            ticks[1:][np.isnan(self._pressure[:-1])] = 0
        ticks[(ticks > 1) & (topics | moves)] = 0
        cost = substeps(self._terms[0], self._step) + 20
        for k in np.flatnonzero(ticks > 1).tolist():
            if not self._verifier.bridged(int(ticks[k]) * cost):
                ticks[k] = 0
        return ticks

    def solved(self, begin: int, end: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return what the states from `begin` to `end` must be, (m, 6), and which of them follow exactly."""
        solved = rows_of(self._states[begin:end])
        if not begin and self._exact[0]:
            solved[0] = self._now()
        before = self._states[max(begin - 1, 0):end - 1]
        starts = list(np.stack([before.flywheel_speed - before.plate_speed, before.plate_angle, before.plate_speed,
                                before.flywheel_angle], axis=1))
        first = max(begin, 1)
        ends = np.cumsum(self._gaps[first:end])
        varies = any(one.profile is not None for one in self._terms) and any(
            one.commanded.any() for one in self._inputs.values())
        at_once = WITH_PROFILES if varies else TICKS_AT_ONCE
        for at in range(0, int(ends[-1]) if len(ends) else 0, at_once):
            place = np.arange(at, min(at + at_once, int(ends[-1])))
            row = np.searchsorted(ends, place, side="right")
            rows = first + row
            ticks = self._ticks[rows] - (ends[row] - place)
            state = [self._stepper.state if exact else starts[k]
                     for k, exact in zip(row.tolist(), self._exact[rows].tolist())]
            reached, last = self._made(rows, ticks, state), place + 1 == ends[row]
            v, plate_angle, plate_speed, flywheel_angle, engine, friction = reached[last].T
            solved[rows[last] - begin] = np.stack([flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine,
                                                   friction], axis=1)
        return solved, self._exact[begin:end]

    def _now(self) -> list[float]:
        torque, pressure = (float(values[0]) if self._inputs[name].commanded[0] and math.isfinite(values[0]) else None
                            for name, values in zip(INPUTS, (self._torque, self._pressure)))
        if math.isfinite(self._pressure[0]):
            self._stepper.press(self._pressure[0], self._pressure[0], self._per_pressure[0])
        self._stepper.hold(self._terms[0], torque, None if pressure is None else self._per_pressure[0] * pressure)
        v, plate_angle, plate_speed, flywheel_angle, engine, friction, _ = self._stepper.now()
        return [flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine, friction]

    def _made(self, rows: NDArray[np.int64], ticks: NDArray[np.int64], states: Sequence[Floats]) -> Floats:
        """Make ticks that end at or before the states of these rows; return states and torques after each, (n, 6)."""
        out, moves = np.empty((len(rows), len(COLUMNS))), np.isfinite(self._speed[rows])
        scene = np.searchsorted(self._changes, ticks + 1, side="right") - 1
        held = [self._inputs[name].commanded[rows] for name in INPUTS]
        kind = (scene * 2 + held[0]) * 4 + held[1] * 2 + moves
        cuts = np.append(0, 1 + np.flatnonzero(np.diff(kind))).tolist()
        for begin, end in zip(cuts, [*cuts[1:], len(rows)]):
            at, row = slice(begin, end), rows[begin:end]
            terms, per_pressure = self._terms[scene[begin]], self._per_pressure[scene[begin]]
            after = self._pressure[row]
            before = after if self._lag is None else self._pressure[row - 1]
            torque = self._torque[row] if held[0][begin] else None
            load = per_pressure * np.maximum(before, after) if held[1][begin] else None
            approach = None if self._lag is None else np.array([
                course(*one, per_pressure, *self._lag, self._step)
                for one in zip((ticks[at] * self._step).tolist(), before.tolist(), after.tolist())])
            far = None if not moves[begin] else np.stack([
                ticks[at] * self._step, np.where(self._moved[row], self._angle[row - 1], 0.0), self._speed[row],
                np.zeros(len(row))], axis=1)
            count = substeps_of_ticks(terms, self._step, torque, load, len(row))
            self._verifier.work(int(count.sum()) + 20 * len(row))
            out[at] = solve_ticks(terms, self._step, ticks[at], states[at], count, torque, load, approach, far)
        return out


def rows_of(states: JointStates) -> Floats:
    """Return states as rows, (n, 6)."""
    return np.stack([getattr(states, name) for name in COLUMNS], axis=1)


def substeps_of_ticks(terms: Terms, step: float, torque: Floats | None, load: Floats | None,
                      ticks: int) -> NDArray[np.int64]:
    """Return the sub-steps of ticks with the inputs of `solve_ticks`, (ticks,); OutOfRange for too many.

    More load never needs fewer, so a load between two that need as many needs no count.
    """
    held = None if torque is None else float(torque[0])
    if load is None:
        return np.full(ticks, substeps(holding(terms, held, None), step))
    loads, place = np.unique(load, return_inverse=True)
    counts, parts = np.zeros(len(loads), np.int64), [(0, len(loads) - 1)]
    for low, high in parts:
        for k in (low, high):
            counts[k] = counts[k] or substeps(holding(terms, held, float(loads[k])), step)
        if counts[low] == counts[high]:
            counts[low:high] = counts[low]
        elif high > low + 1:
            parts += [(low, (low + high) // 2), ((low + high) // 2, high)]
    return counts[place]


def solve_ticks(terms: Terms, step: float, first: NDArray[np.int64], states: Sequence[Floats], count: NDArray[np.int64],
                torque: Floats | None = None, load: Floats | None = None, approach: Floats | None = None,
                far: Floats | None = None) -> Floats:
    """Make n ticks one after the other, to the last bit as a Stepper makes them, in one compiled call.

    Parameters
    ----------
    terms : of the scene, as `terms_of`
    step : length of a tick, s
    first : (n,) number of each tick, which begins at this number times the step
    states : n arrays (4,), which the ticks change in place; the same one where a tick follows the one before
    count : (n,) sub-steps, as `substeps_of_ticks`
    torque, load : (n,) commanded engine torque and saturation torque, N m; None for those of the scene
    approach, far : (n, 4) rows of `Terms`; None without a lag, and where the far end stands still

    Returns
    -------
    (n, 6) v, theta2, omega2, theta1, engine and friction torque after each tick
    """
    varies = terms.profile is not None and not (torque is None and load is None)
    held = [itertools.repeat(None) if values is None else values.tolist() for values in (torque, load)]
    own = [for_ticks(holding(terms, *inputs)) for inputs, _ in zip(zip(*held), first if varies else range(1))]
    # The last fields of the terms, of which each tick has its own.
    arrays: dict[str, Sequence[Any]] = {"profile": [one.profile for one in own]} if varies else {}
    arrays |= {} if approach is None else {"approach": list(approach[:, None])}
    arrays |= {"far": [own[0].far] * len(first) if far is None else list(far[:, None])}
    numbers = first * step, (first + 1) * step, count, step / count, *(
        np.full(len(first), mean) if values is None else values
        for values, mean in ((torque, own[0].mean_torque), (load, own[0].mean_load)))

    def addresses(rows: Sequence[Any]) -> NDArray[np.int64]:
        return np.fromiter(map(id, rows), np.int64, len(rows))

    first_terms = own[0]._replace(**{name: rows[0] for name, rows in arrays.items()})
    entry, block = cast(Kernel, tick).laid_out((states[0], *(column[0].item() for column in numbers), first_terms))
    # Machine code takes the arguments of each call of `tick` one after the other.
    one = np.frombuffer(block, np.float64)[1:]
    laid = np.empty(1 + len(first) * len(one))
    laid[:1].view(np.int64)[0] = len(first)
    rows, inputs = laid[1:].reshape(len(first), len(one)), len(one) - RESULTS
    rows[:] = one
    for place, column in ((0, addresses(states)), *enumerate(numbers, 1),
                          *((inputs - 1 - k, addresses(of)) for k, of in enumerate(reversed([*arrays.values()])))):
        rows[:, place] = column.view(np.float64)
    entry.run((ctypes.c_char * laid.nbytes).from_buffer(laid.data))
    return rows[:, inputs:-1]
