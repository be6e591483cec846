"""Solving a recording again from what it holds, scene and applied inputs, with the kernel that ran it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.input_sources import InputSource
from tcc_sim.recording.scene_records import SceneRecord
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.solvers.terms import Terms, general_terms, holding, terms_of
from tcc_sim.trajectory import Floats

STEP_TOLERANCE = 1e-6
"""Largest difference, relative to each signal's maximum, where a tick is solved from the recorded state before it: the
slip speed is then a difference of two recorded speeds, and a slip that starts amplifies the digits that it loses.
"""
COLUMNS = ("flywheel_angle", "plate_angle", "flywheel_speed", "plate_speed", "engine_torque", "friction_torque")


@dataclass(frozen=True)
class Verification:
    """How a recording compares with its own solution.

    verified : every recorded value is the one solved again: to the last bit where a run is there from its start, within
        STEP_TOLERANCE where it is not
    largest_difference : of any value, relative to its signal's maximum; inf where one is not finite
    compared : messages compared
    exact : of these, those that had to agree to the last bit
    first_difference_ns : stamp of the first message that differs by more than it may
    detail : why nothing was compared, or what the first difference may mean
    """

    verified: bool
    largest_difference: float
    compared: int
    exact: int
    first_difference_ns: int | None
    detail: str

    def sentence(self) -> str:
        """The result for people."""
        if self.verified:
            how = "to the last bit" if self.exact == self.compared else f"within {STEP_TOLERANCE:g} (exactly for {self.exact})"
            return f"verified: {self.compared} messages agree {how} with their solution from the recording alone"
        return f"not verified: {self.detail}"


class Verifier:
    """Compares batches with the solution of their scene, one tick after the other.

    A run that starts at stamp 0 is solved from the scene's initial state and goes on exactly across gaps, as long as no
    input comes from a topic. Otherwise each tick is solved from the recorded state before it.

    Where parameters were changed while running, the driveline said its scene again, with the stamp of the first state
    that the change led to and the kernel that went on; the change is made at that tick, in a gap too. A scene counts
    from the first message on that was sent after it was said, so a reset, after which the changed values hold, goes on
    with the last one. A pause leaves no trace.

    An input that a command held is the constant that the message says. One that fell back to the scene's harmonics
    varies within the tick, so `sources`, what the driveline said on input_source, tells which it was. In a recording
    without that topic every input counts as commanded.
    """

    def __init__(self, scenes: Sequence[SceneRecord], fallback: Scene, sources: Sequence[InputSource] = ()) -> None:
        self._scenes = sorted(scenes, key=lambda s: s.log_ns)
        self._sources, self._source = sources, 0
        self._place = -1
        self._scene, self._general = fallback, False
        self._run = -1
        self._harmonic = False, False
        self._stepper: Stepper | None = None
        self._exact = False
        self._largest = np.zeros(len(COLUMNS))
        self._size = np.zeros(len(COLUMNS))
        self._compared = self._exactly = 0
        self._first: int | None = None
        self._refusal = ""

    def feed(self, batch: JointStates) -> None:
        """Compare the next batch."""
        if not len(batch) or self._refusal:
            return
        recorded = np.stack([getattr(batch, name) for name in COLUMNS], axis=1)
        self._size = np.maximum(self._size, np.nan_to_num(np.abs(recorded), posinf=0.0).max(axis=0))
        pressure = batch.applied_pressure.tolist() if batch.applied_pressure is not None else [math.nan] * len(batch)
        solved = np.full_like(recorded, math.nan)
        exact = np.zeros(len(batch), dtype=np.bool_)
        begin = 0
        try:
            if batch.run != self._run:
                self._begin(batch)
                begin = 1
                self._follow_sources(int(batch.sent_ns[0]))
                solved[0], exact[0] = self._now(recorded[0], pressure[0]), self._exact
                if not self._exact:
                    solved[0] = recorded[0]
            rows = recorded.tolist()
            for k in range(begin, len(batch)):
                solved[k] = self._next(int(batch.stamp_ns[k]), int(batch.sent_ns[k]), rows[k], pressure[k])
                exact[k] = self._exact
        except InputError as error:
            self._refusal = str(error)
            return
        self._compare(batch, recorded, solved, exact)

    def result(self) -> Verification:
        """The verdict on all batches."""
        if self._refusal or not self._compared:
            return Verification(False, math.inf, 0, 0, None, self._refusal or "the recording holds no joint_states")
        ratio = np.divide(self._largest, self._size, out=self._largest.copy(), where=self._size > 0.0)
        largest, detail = float(ratio.max()), ""
        if self._first is not None:
            detail = (f"the message of {self._first * 1e-9:.9g} s is the first that differs; the largest difference is "
                      f"{largest:.3g} of its signal's maximum (a changed value, a scene that is missing, or another version or "
                      "machine)")
            if any(self._harmonic) and not self._sources:
                detail += "; the topic input_source was not recorded, so every input counts as commanded"
        return Verification(self._first is None, largest, self._compared, self._exactly, self._first, detail)

    def _begin(self, batch: JointStates) -> None:
        """Start on a new run with the scene in force."""
        stamp = int(batch.stamp_ns[0])
        if not self._take_over(int(batch.sent_ns[0]), stamp, beginning=True) and self._place < 0 and self._scenes:
            self._take_scene(0)
        scene = self._scene
        self._run = batch.run
        self._stamp_step = 1e9 / scene.operation.rate
        engine, pressure = scene.system.engine, scene.system.pressure
        self._topics = engine.source == "topic", pressure.source == "topic"
        self._harmonic = self._topics[0] and engine.harmonic, self._topics[1] and pressure.harmonic
        stepper = self._stepper = Stepper(scene.system, 1.0 / scene.operation.rate)
        self._use_scene()
        stepper.tick = self._tick(stamp)
        self._exact = stepper.tick == 0
        if not self._exact:
            self._take(batch, 0)

    def _take_over(self, sent_ns: int, stamp_ns: int, beginning: bool = False) -> bool:
        """Go on to the last scene that was said by `sent_ns` and leads to the state of `stamp_ns`; whether there was
        one.

        Within a run they follow one another; where one begins, those of the run before it may still stand in between.
        """
        latest = self._place
        for place in range(self._place + 1, len(self._scenes)):
            record = self._scenes[place]
            if record.log_ns > sent_ns or (record.first_stamp_ns > stamp_ns and not beginning):
                break
            if record.first_stamp_ns <= stamp_ns:
                latest = place
        if latest == self._place:
            return False
        self._take_scene(latest)
        return True

    def _take_scene(self, place: int) -> None:
        """Read the scene at this place."""
        self._place, record = place, self._scenes[place]
        self._scene, self._general = parse_scene(record.text, self._scene.name), record.general

    def _use_scene(self) -> None:
        """Solve with the scene's terms from the next tick on, in the kernel that the driveline had."""
        assert self._stepper is not None
        system = self._scene.system
        self._terms: Terms = general_terms(system) if self._general else terms_of(system)
        self._held: tuple[float | None, float | None] = None, None
        self._stepper.use(self._terms)

    def _tick(self, stamp: int) -> int:
        """The tick that a stamp belongs to."""
        tick = round(stamp / self._stamp_step)
        if round(tick * self._stamp_step) != stamp:
            raise InputError(f"stamp {stamp * 1e-9:.9g} s is not that of a tick at {self._scene.operation.rate:g} Hz; "
                             "the driveline node did not make this recording")
        return tick

    def _take(self, batch: JointStates, k: int) -> None:
        """Go on from the recorded state of row k."""
        assert self._stepper is not None
        self._stepper.state[:] = (batch.flywheel_speed[k] - batch.plate_speed[k], batch.plate_angle[k],
                                  batch.plate_speed[k],
                                  batch.flywheel_angle[k])

    def _next(self, stamp: int, sent: int, row: list[float], pressure: float) -> list[float]:
        """Solve up to `stamp` with the scenes and inputs that its ticks applied; what the message should hold."""
        stepper = self._stepper
        assert stepper is not None
        begin, end = stepper.tick, self._tick(stamp)
        if end <= begin:
            raise InputError(f"stamp {stamp * 1e-9:.9g} s comes twice")
        known = (end == begin + 1 or not any(self._topics)) and self._applied_is_known(row[4], pressure)
        for tick in range(begin + 1 if known else end, end + 1):
            if self._place + 1 < len(self._scenes) and self._take_over(sent, round(tick * self._stamp_step)):
                self._use_scene()
            self._follow_sources(sent)
            self._apply(row[4], pressure)
            if known:
                stepper.advance()
        solved = self._values() if known else row
        if not known:
            self._exact, stepper.tick = False, end
        if not self._exact:
            stepper.state[:] = row[2] - row[3], row[1], row[3], row[0]
        return solved

    def _applied_is_known(self, engine: float, pressure: float) -> bool:
        """Whether the recording holds the inputs of this tick."""
        return not (self._topics[0] and math.isnan(engine)) and not (
            self._topics[1] and math.isnan(pressure) and not self._harmonic[1])

    def _now(self, row: Floats, pressure: float) -> list[float]:
        """What the message of the state as it is should hold."""
        self._apply(float(row[4]), pressure)
        return self._values()

    def _apply(self, engine: float, pressure: float) -> None:
        """Take the inputs that come from topics as the node does."""
        stepper = self._stepper
        assert stepper is not None
        torque, load = self._held
        if self._topics[0] and not math.isnan(engine):
            torque = engine
        if self._topics[1] and not math.isnan(pressure):
            load = self._scene.system.torque_per_pressure * pressure
        if self._harmonic[0] and not self._commanded("engine_torque"):
            torque = None
        if self._harmonic[1] and not self._commanded("actuation_pressure"):
            load = None
        if (torque, load) != self._held:
            self._held = torque, load
            stepper.use(holding(self._terms, torque, load))

    def _follow_sources(self, sent_ns: int) -> None:
        """Go on to the last source that was said before the state that was sent at `sent_ns`."""
        while self._source + 1 < len(self._sources) and self._sources[self._source + 1].log_ns <= sent_ns:
            self._source += 1

    def _commanded(self, name: str) -> bool:
        """Whether a command held this input, as the driveline said."""
        return not self._sources or name in self._sources[self._source].commanded

    def _values(self) -> list[float]:
        """The columns of a message about the state as it is."""
        assert self._stepper is not None
        v, plate_angle, plate_speed, flywheel_angle = self._stepper.state.tolist()
        return [flywheel_angle, plate_angle, v + plate_speed, plate_speed, *self._stepper.torques()]

    def _compare(self, batch: JointStates, recorded: Floats, solved: Floats, exact: NDArray[np.bool_]) -> None:
        """Take the differences of a batch into account."""
        difference = np.abs(recorded - solved)
        difference[np.isnan(difference)] = math.inf
        self._largest = np.maximum(self._largest, difference.max(axis=0))
        self._compared += len(batch)
        self._exactly += int(np.count_nonzero(exact))
        allowed = np.where(exact[:, None], 0.0, STEP_TOLERANCE * self._size)
        wrong = np.flatnonzero((difference > allowed).any(axis=1))
        if len(wrong) and self._first is None:
            self._first = int(batch.stamp_ns[wrong[0]])
