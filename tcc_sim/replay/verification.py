"""Verify a recording by solving it again from its scenes and inputs with the kernel of the driveline."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, counted
from tcc_sim.model.profile import START
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.stamps import Break
from tcc_sim.replay.result import STEP_TOLERANCE, Verification
from tcc_sim.replay.timeline import Timeline
from tcc_sim.scene import parse_scene
from tcc_sim.solvers.fixed_step import Reached, Stepper
from tcc_sim.solvers.terms import Terms, terms_from
from tcc_sim.topics import INPUTS, topic
from tcc_sim.trajectory import Floats

COLUMNS = topic("joint_states").fields
"""Columns of a row: angles (rad) and speeds (rad/s) of flywheel and plate, engine and friction torque (N m)."""
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

    A commanded input is constant within a tick and has the recorded value. A fallback to the scene's harmonics varies
    within the tick; the driveline's announcements give the source. Without announcements every input counts as
    commanded. For an actuator with a lag, two successive recorded pressures define the pressure within the tick
    (`model.actuator`). The far end of the shaft continues from its recorded angle at the recorded speed.

    Parameters
    ----------
    size : size of the recording, bytes, which bounds the work
    progress : function called with the number of states just compared
    """
    verifier = _Verifier(line, size)
    for states in line.runs:
        for block in states.blocks():
            verifier.feed(block)
            if progress is not None:
                progress(len(block))
    return verifier.result()


class _Verifier:
    """State of the comparison: solver, applied scene and inputs, and the differences so far."""

    def __init__(self, line: Timeline, size: int) -> None:
        self._scenes, self._places, self._place = line.scenes, line.places, -1
        self._line, self._commanded = line, (True, True)
        self._absent = np.isin(COLUMNS, line.absent)
        self._next_place = 0
        self._work = self._work_limit = SMALLEST_WORK + WORK_PER_BYTE * size
        self._leapt = 0
        self._scene, self._origin = line.scene, START
        self._run = -1
        self._harmonic, self._lagged = (False, False), False
        self._pressed = self._far_angle = math.nan
        self._last_ns = self._moved_ns = 0
        self._stepper: Stepper
        self._exact = False
        self._largest = np.zeros(len(COLUMNS))
        self._size = np.zeros(len(COLUMNS))
        self._count_compared = self._exactly = self._solved = self._unknown = 0
        self._stated = True
        self._broken: float | None = None
        self._first: int | None = None
        self._refusal = ""

    def feed(self, batch: JointStates) -> None:
        """Compare the next batch."""
        if not len(batch) or self._refusal:
            return
        recorded = rows_of(batch)
        self._size = np.maximum(self._size, np.abs(recorded).max(axis=0, initial=0.0, where=np.isfinite(recorded)))
        pressure, angle, speed = recorded_inputs(batch)
        commanded = list(zip(*(column.tolist() for column in self._line.commanded(batch).values())))
        solved = np.full_like(recorded, math.nan)
        exact = np.zeros(len(batch), dtype=np.bool_)
        begin = 0
        try:
            self._moved_ns = batch.moved_ns
            self._stated &= batch.held is not None
            known = np.ones(len(batch), np.bool_) if batch.held is None and not self._line.keyed else np.all(
                [np.isfinite(batch.input(name, "source")) for name in INPUTS], axis=0)
            if batch.run != self._run:
                self._begin(batch)
                begin = 1
                self._commanded = commanded[0]
                solved[0], exact[0] = self._now(recorded[0], pressure[0]), self._exact
                self._far_angle, self._last_ns = angle[0], int(batch.stamp_ns[0])
                self._solved += self._exact
                if not self._exact:
                    solved[0] = recorded[0]
            rows = recorded.tolist()
            for k in range(begin, len(batch)):
                self._commanded, self._source_known = commanded[k], bool(known[k])
                solved[k] = self._next(int(batch.stamp_ns[k]), batch.index + k, rows[k], pressure[k], speed[k])
                self._far_angle, self._last_ns = angle[k], int(batch.stamp_ns[k])
                exact[k] = self._exact
        except InputError as error:
            self._refusal = str(error)
            return
        self._compare(batch, recorded, solved, exact)

    def result(self) -> Verification:
        """Return the result of all batches."""
        if self._refusal or not self._count_compared:
            return Verification(False, math.inf, 0, 0, 0, None, self._refusal or "the recording holds no joint_states")
        ratio = np.divide(self._largest, self._size, out=self._largest.copy(), where=self._size > 0.0)
        largest, detail = float(ratio.max()), ""
        if self._leapt:
            detail = (f"; {counted(self._leapt, 'gap')} could not be solved through within the limit of "
                      f"{self._work_limit} sub-steps")
        if self._first is not None:
            detail = (f"the message of {self._first * 1e-9:.9g} s is the first that differs; the largest difference is "
                      f"{largest:.3g} of its signal's maximum (possible reasons: a changed value, a missing scene, "
                      "another version or machine)")
            if any(self._harmonic) and not self._stated:
                detail += "; the recording does not state the sources of its inputs, so every one counts as commanded"
        elif self._unknown:
            detail = f"{self._unknown} of {counted(self._count_compared, 'state')} have no known input"
        elif self._broken is not None:
            detail = (f"a run begins at {self._broken:.9g} s after a reset, which must lead to 0: messages are missing "
                      "or mixed up")
        elif not self._solved:
            detail = "there is no state before any of them to solve from"
        if self._absent.any():
            detail += f"; not recorded, so not compared: {', '.join(self._line.absent)}"
        verified = self._first is None and self._solved > 0 and not self._unknown and self._broken is None
        return Verification(verified, largest, self._count_compared, self._solved, self._exactly, self._first, detail)

    def _begin(self, batch: JointStates) -> None:
        """Begin a new run with the scene that applies."""
        stamp = int(batch.stamp_ns[0])
        if not self._take_over(batch.index, stamp) and self._place < 0 and self._scenes:
            self._take_scene(0)
        scene = self._scene
        self._run = batch.run
        self._stamp_step = 1e9 / scene.operation.rate
        engine, pressure = scene.system.engine, scene.system.pressure
        self._topics, self._lagged = (engine.source == "topic", pressure.source == "topic"), pressure.lagged
        self._harmonic = self._topics[0] and engine.harmonic, self._topics[1] and pressure.harmonic
        stepper = self._stepper = Stepper(scene.system, 1.0 / scene.operation.rate)
        if stamp == 0:
            self._origin = START
        self._use_scene()
        stepper.tick = self._tick(stamp)
        self._exact = stepper.tick == 0
        if batch.began is Break.RESET and stepper.tick and self._broken is None and not self._line.keyed:
            self._broken = stamp * 1e-9
        if not self._exact:
            stepper.state[:] = state_of(rows_of(batch[:1])[0].tolist())

    def _take_over(self, index: int, stamp_ns: int) -> bool:
        """Take the last new scene that applies at the state with this index and stamp; return whether there is one."""
        latest = None
        while self._next_place < len(self._places):
            at, number = self._places[self._next_place]
            if at > index or (self._scenes[number].first_stamp_ns > stamp_ns and at == index):
                break
            latest, self._next_place = number, self._next_place + 1
        if latest is None:
            return False
        self._take_scene(latest)
        return True

    def _take_scene(self, place: int) -> None:
        """Read the scene with this number."""
        self._place, record = place, self._scenes[place]
        self._scene, self._origin = parse_scene(record.text, self._scene.name), record.origin

    def _use_scene(self) -> None:
        """Use the scene's terms from the next tick on."""
        system = self._scene.system
        self._terms: Terms = terms_from(system, self._origin)
        self._held: tuple[float | None, float | None] = None, None
        self._stepper.use(self._terms)

    def _tick(self, stamp: int) -> int:
        tick = round(stamp / self._stamp_step)
        if round(tick * self._stamp_step) != stamp:
            raise InputError(f"stamp {stamp * 1e-9:.9g} s is not that of a tick at {self._scene.operation.rate:g} Hz; "
                             "the driveline node did not make this recording")
        return tick

    def _next(self, stamp: int, index: int, row: list[float], pressure: float, far_speed: float) -> list[float]:
        """Solve up to `stamp` with the scenes and inputs of its ticks; return the expected message."""
        stepper = self._stepper
        begin, end = stepper.tick, self._tick(stamp)
        if end <= begin:
            raise InputError(f"stamp {stamp * 1e-9:.9g} s comes twice")
        far_moved, far_moves = self._last_ns >= self._moved_ns, not math.isnan(far_speed)
        given = (self._source_known or not any(self._harmonic)) and self._applied_is_known(row[4], pressure) and (
            far_moves or not far_moved) and not (far_moved and math.isnan(self._far_angle))
        self._unknown += not given
        known = given and (end == begin + 1 or not (any(self._topics) or far_moves)) and not (
            self._lagged and math.isnan(self._pressed)) and self._afford(end - begin)
        solved = row
        for tick in range(begin + 1 if known else end, end + 1):
            if self._next_place < len(self._places) and self._take_over(index, round(tick * self._stamp_step)):
                self._use_scene()
            self._apply(row[4], pressure)
            if far_moves:
                stepper.move_far_end(far_speed, self._far_angle if far_moved else 0.0)
            if known:
                solved = message_row(stepper.advance())
        self._solved += known
        self._pressed = pressure
        if not known:
            self._exact, stepper.tick = False, end
        if not self._exact:
            stepper.state[:] = state_of(row)
        return solved

    def _afford(self, ticks: int) -> bool:
        """Subtract the work of `ticks` from the limit; return whether it sufficed; InputError if not for one tick."""
        cost = ticks * (self._stepper.substeps + 20)
        if cost <= self._work - (self._work_limit // 2 if ticks > 1 else 0):
            self._work -= cost
            return True
        if ticks == 1:
            raise InputError(f"solving it again takes more than {self._work_limit} sub-steps, the most allowed for a "
                             "recording of its size")
        self._leapt += 1
        return False

    def _applied_is_known(self, engine: float, pressure: float) -> bool:
        """Return whether the recording holds the inputs of this tick."""
        return not (self._topics[0] and math.isnan(engine)) and not (
            self._topics[1] and math.isnan(pressure)
            and not (self._harmonic[1] and not self._commanded[1]))

    def _now(self, row: Floats, pressure: float) -> list[float]:
        """Return the expected message of the current state."""
        self._pressed = pressure
        self._apply(float(row[4]), pressure)
        return message_row(self._stepper.now())

    def _apply(self, engine: float, pressure: float) -> None:
        """Apply the inputs from topics as the node does."""
        stepper = self._stepper
        torque, load = self._held
        if self._topics[0] and not math.isnan(engine):
            torque = engine
        per_pressure = self._scene.system.torque_per_pressure
        if self._topics[1] and not math.isnan(pressure):
            before = self._pressed if self._lagged and not math.isnan(self._pressed) else pressure
            load = per_pressure * max(before, pressure)
            self._stepper.press(before, pressure, per_pressure)
        if self._harmonic[0] and not self._commanded[0]:
            torque = None
        if self._harmonic[1] and not self._commanded[1]:
            load = None
        if (torque, load) != self._held:
            self._held = torque, load
            stepper.hold(self._terms, torque, load)

    def _compare(self, batch: JointStates, recorded: Floats, solved: Floats, exact: NDArray[np.bool_]) -> None:
        """Add the differences of a batch."""
        difference = np.abs(recorded - solved)
        difference[np.isnan(difference)] = math.inf
        difference[:, self._absent] = 0.0
        self._largest = np.maximum(self._largest, difference.max(axis=0))
        self._count_compared += len(batch)
        self._exactly += int(np.count_nonzero(exact))
        allowed = np.where(exact[:, None], 0.0, STEP_TOLERANCE * self._size)
        wrong = np.flatnonzero((difference > allowed).any(axis=1))
        if len(wrong) and self._first is None:
            self._first = int(batch.stamp_ns[wrong[0]])


def rows_of(batch: JointStates) -> Floats:
    """Return states as rows, (n, 6)."""
    return np.stack([getattr(batch, name) for name in COLUMNS], axis=1)


def recorded_inputs(batch: JointStates) -> tuple[list[float], list[float], list[float]]:
    """Return the applied pressures, Pa, and angles (rad) and speeds (rad/s) of the far end; NaN if not recorded."""
    pressure, angle, speed = ([math.nan] * len(batch) if column is None else column.tolist() for column in (
        batch.applied_pressure, batch.output_angle, batch.output_speed))
    return pressure, angle, speed


def state_of(row: list[float]) -> tuple[float, float, float, float]:
    """Return the solver's state, slip speed, plate angle, plate speed and flywheel angle, at a row."""
    return row[2] - row[3], row[1], row[3], row[0]


def message_row(reached: Reached) -> list[float]:
    """Return the row of a solver state."""
    v, plate_angle, plate_speed, flywheel_angle, engine, friction, _ = reached
    return [flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine, friction]
