"""A recording read once: through the analysis, to Rerun, and compared with its own solution."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tcc_sim.analysis.damping import damping_of_cycles
from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.periodicity import enough_after_a_gap
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.output.files import draft
from tcc_sim.recording.announcements import MOST_SCENES, MOST_SOURCES, input_sources, places_of
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.commands import TARGET, Commands, Rows
from tcc_sim.recording.reader import Run, Tap, open_run
from tcc_sim.replay.control_log import ControlLog
from tcc_sim.replay.recorded import Window, trajectory_of
from tcc_sim.replay.result import Replay
from tcc_sim.replay.segments import MOST_SEGMENTS, SegmentLog
from tcc_sim.replay.timing import Pace, Timing, frequency_changes, recorded_scene, timing_of
from tcc_sim.replay.verification import Verifier
from tcc_sim.scene import Scene
from tcc_sim.solvers.terms import natural_frequency, stick_speed_of, terms_of
from tcc_sim.trajectory import Floats, Trajectory, modes_of

if TYPE_CHECKING:
    from tcc_sim.views.rerun_stream import RerunStream

TAIL_CYCLES = 24
"""Engine cycles kept as samples, for a picture of the end of the run."""
TAIL_SAMPLES = 200_000
"""Most samples kept."""


def replay(path: Path | str, *, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
           discard: int | None = None, frequency: float | None = None, scene: str | None = None, verify: bool = False,
           damping: bool = False, window: Window | None = None, joints: Mapping[str, str] | None = None,
           progress: bool = False) -> Replay:
    """Read a recording in bounded memory through the analysis and, if asked, to Rerun while reading.

    Parameters
    ----------
    path : bag directory or .mcap file, complete or cut short
    rrd, spawn, connect : at most one of a new Rerun file, a viewer to start, and the URL of a running one
    discard : engine cycles dropped; None drops 50, or half of them where there are fewer than 100, and none of a scene
        with profiles
    frequency : of the engine torque, rad/s; None takes the scene's or, where the torque came from a topic, follows the
        phase of the torque, which reads the recording once more
    scene : name or file, for a recording that holds none
    verify : solve the run again from the recording alone, all of it
    damping : work out the equivalent damping (21) of the last cycles
    window : a run and a part of its time; None for all of the recording
    joints : names that flywheel and clutch_plate have in the recording, where they have others
    progress : show a bar on a terminal

    Raises
    ------
    InputError
        A recording that cannot be read or holds no whole engine cycle, an output that exists, or a wrong argument.
    MissingPackage
        Rerun was asked for and is not installed.

    Examples
    --------
    >>> import tcc_sim
    >>> from tcc_sim.output.samples import write_trajectory
    >>> scene = tcc_sim.load_scene("slip")
    >>> write_trajectory(folder / "slip.mcap", tcc_sim.solve(scene, cycles=60, samples_per_cycle=50), scene.text())
    >>> tcc_sim.analyse(folder / "slip.mcap", discard=30).summary.regime
    'slip'
    """
    began = time.perf_counter()
    run = open_run(path, joints=joints)
    own = recorded_scene(run, scene)
    if damping:
        _check_damping(own)
    part = window or Window()
    timing = timing_of(own, frequency, part.of(_watched(run, "frequency", progress)), frequency_changes(run))
    with ExitStack() as stack:
        stack.enter_context(np.errstate(all="ignore"))  # Any double may stand in a file.
        reading = _Reading(run, own, timing, discard, verify, progress)
        where = (rrd, spawn, connect) if rrd is not None or spawn or connect is not None else None
        view = _view(stack, Path(path).name, timing, own, where, reading.controlled) if where else None
        for batch in _watched(run, "reading", progress, reading.commands.take):
            reading.verify(batch)
            for kept, commanded in part.cut(batch, reading.commands.until(batch)):
                reading.take(kept, commanded, view)
        part.check(run.stamps.runs)
        found = reading.result(Path(path), damping, began)
        if part.sentence():
            found = replace(found, warnings=(*found.warnings, part.sentence()))
        if view is not None:
            view.text(found.markdown())
    return found


class _Reading:
    """Everything that a batch goes through, and what it comes to."""

    def __init__(self, run: Run, scene: Scene, timing: Timing, discard: int | None, verify: bool,
                 progress: bool) -> None:
        if discard is None and timing.source == "scene" and scene.system.profile is not None:
            discard = 0  # Nothing of a manoeuvre is transient.
        self._run, self._scene, self._timing, self._discard = run, scene, timing, discard
        clock, self._system = timing.clock, scene.system
        if timing.source in ("given", "found"):
            self._system = replace(scene.system, engine=replace(scene.system.engine, frequency=timing.frequency))
        places = places_of(run.scenes[:MOST_SCENES], _watched(run, "scenes", progress))
        self.commands = Commands(run.joint_states_topic)
        self.controlled = self.commands.has_target(run.topics)
        self._stream, self._tail = CycleStream(self._system, clock), Tail(self._system, clock)
        self._control, self._pace = ControlLog(scene, run.scenes, places, clock), Pace()
        self._segments = SegmentLog(scene, run.scenes, places, None if timing.source == "scene" else clock,
                                    self.controlled, self._stream, discard)
        self._sources = input_sources(run) if verify else []
        held = [(place.index, self._sources[place.number].commanded)
                for place in places_of(self._sources, _watched(run, "inputs", progress))]
        self._verifier = Verifier(run.scenes, places, scene, run.size, held) if verify else None

    def verify(self, batch: JointStates) -> None:
        """Solve the next batch again, where that was asked for."""
        if self._verifier is not None:
            self._verifier.feed(batch)

    def take(self, batch: JointStates, commanded: Mapping[str, tuple[Rows, Floats]],
             view: RerunStream | None) -> None:
        """Analyse the next batch, with the commands that came with it, and show it."""
        slip_speed = batch.flywheel_speed - batch.plate_speed
        samples = (batch.stamp_ns, slip_speed, batch.plate_angle, batch.plate_speed, batch.engine_torque,
                   batch.friction_torque)
        pieces = self._stream.feed(*samples, batch.run)
        self._segments.feed(batch, slip_speed, commanded.get(TARGET))
        self._tail.add(batch, self._stream)
        fresh = self._control.add(batch, slip_speed, self._stream, commanded)
        self._pace.add(batch)
        if view is not None:
            state = modes_of(np.nan_to_num(slip_speed), self._tail.stick_speed)
            view.samples(*samples, state, new_run=self._tail.run_started)
            for piece in pieces if self._timing.clock.told else ():
                view.cycles(piece.cycles, piece.first)
            view.control(fresh.signals, fresh.events)

    def result(self, path: Path, damping: bool, began: float) -> Replay:
        """What all batches come to."""
        run, told = self._run, self._timing.clock.told
        solver = run.result.get("solver") if run.result is not None else None
        summary = replace(self._stream.summary(self._discard), elapsed_s=time.perf_counter() - began,
                          solver=solver if isinstance(solver, str) else "fixed_step")
        number, longest = self._stream.longest()
        shown = next(run for run, at in self._stream.numbers.items() if at == number)
        cycles, first, _ = longest.kept(0)
        kept, begin, _ = longest.kept(self._discard) if told else (cycles, first, 0)
        averages = damping_of_cycles(self._system, kept, begin, summary.period) if damping else None
        warnings = [*run.warnings, *self._warnings()]
        if told and not enough_after_a_gap(kept):
            warnings.append(f"no period is given: it takes {DEFAULTS.after_a_gap} engine cycles or more after the last "
                            "gap")
        segments = self._segments.finish(summary.solver, summary.elapsed_s)
        if self._segments.count > MOST_SEGMENTS:
            warnings.append(f"only the first {MOST_SEGMENTS} of {self._segments.count} segments have figures of their "
                            "own")
        return Replay(path, self._scene, summary, self._tail.trajectory(summary.solver), cycles, first, self._timing,
                      run.stamps, run.stamps.messages, run.lost_messages, run.complete, tuple(warnings),
                      self._pace.factor(), self._control.control(self._stream), shown, tuple(segments),
                      self._verifier.result() if self._verifier is not None else None, averages)

    def _warnings(self) -> Iterator[str]:
        """What is to be said beside the damage."""
        scenes = self._run.scenes
        if self._timing.note:
            yield self._timing.note
        if len({record.parameters for record in scenes}) > 1:
            yield (f"it holds {len(scenes)} scenes that differ; the figures above the segments are worked out with the "
                   "first")
        if len(scenes) > MOST_SCENES:
            yield f"only the first {MOST_SCENES} scenes are followed"
        if len(self._sources) == MOST_SOURCES:
            yield f"only the first {MOST_SOURCES} changes of the source of an input are followed"


class Tail:
    """The last samples of the longest run so far, bounded."""

    def __init__(self, system: System, clock: EngineClock) -> None:
        self.stick_speed = stick_speed_of(terms_of(system))
        self.run_started = False
        self._system, self._clock, self._cycle = system, clock, clock.cycle
        self._parts: deque[JointStates] = deque()
        self._held = 0
        self._kept: tuple[int, deque[JointStates]] | None = None
        self._number = -1

    def add(self, batch: JointStates, stream: CycleStream) -> None:
        """Take the next batch; `stream` has it already."""
        number = len(stream.runs) - 1
        self.run_started = number != self._number and self._number >= 0
        if self.run_started:
            self._keep_longer(stream)
            self._parts, self._held = deque(), 0
        self._number = number
        self._parts.append(batch)
        self._held += len(batch)
        self._stream = stream
        start = int(batch.stamp_ns[-1]) - round(TAIL_CYCLES * self._cycle * 1e9)
        while len(self._parts) > 1 and (self._parts[0].stamp_ns[-1] < start or self._held > 2 * TAIL_SAMPLES):
            self._held -= len(self._parts.popleft())

    def trajectory(self, solver: str) -> Trajectory:
        """The samples of the longest run's end."""
        self._keep_longer(self._stream)
        assert self._kept is not None
        parts, left = self._kept[1], TAIL_SAMPLES
        start = int(parts[-1].stamp_ns[-1]) - round(TAIL_CYCLES * self._cycle * 1e9)
        late = []
        for part in reversed(parts):
            first = max(int(np.searchsorted(part.stamp_ns, start)), len(part) - left)
            left -= len(part) - first
            late.append(part[first:])
        return trajectory_of(late[::-1], self._system, self._clock, solver)

    def _keep_longer(self, stream: CycleStream) -> None:
        """Keep the end of the run at hand unless the one kept has more whole cycles."""
        if self._kept is None or stream.runs[self._number].observed() >= stream.runs[self._kept[0]].observed():
            self._kept = self._number, self._parts


def _check_damping(scene: Scene) -> None:
    """Raise InputError where an input came from a topic: between two points of the section it is not the scene's."""
    for name, source in (("engine.source", scene.system.engine.source),
                         ("pressure.source", scene.system.pressure.source)):
        if source == "topic":
            raise InputError(f"{name} is topic; --damping is for recordings of harmonic torque and pressure")


def _view(stack: ExitStack, name: str, timing: Timing, scene: Scene, where: tuple[Path | None, bool, str | None],
          controlled: bool) -> RerunStream:
    """The stream to Rerun: a new file, which appears when it is whole, a viewer to start, or a URL."""
    from tcc_sim.views.rerun_stream import RerunStream

    rrd, spawn, connect = where
    file = stack.enter_context(draft(rrd)) if rrd is not None else None
    system = scene.system
    commanded = "topic" in (system.engine.source, system.pressure.source)
    return stack.enter_context(RerunStream(name, timing.clock.cycle, natural_frequency(terms_of(system)), file=file,
                                           spawn=spawn, url=connect, controlled=controlled or commanded))


def _watched(run: Run, what: str, progress: bool, tap: Tap | None = None) -> Iterator[JointStates]:
    """The batches of a run, with a bar on a terminal."""
    from tqdm import tqdm

    with tqdm(desc=what, unit=" messages", unit_scale=True, leave=False, disable=None if progress else True) as bar:
        for batch in run.batches(tap):
            yield batch
            bar.update(len(batch))
