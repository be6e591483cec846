"""A recording read once: through the analysis, to Rerun, and compared with its own solution."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.analysis.control import Control
from tcc_sim.analysis.damping import Damping, damping_as_json, damping_of_cycles
from tcc_sim.analysis.frequency import FrequencyFinder
from tcc_sim.analysis.periodicity import AFTER_A_GAP, enough_after_a_gap
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.analysis.summary import Summary
from tcc_sim.errors import InputError, counted, printable
from tcc_sim.output.files import draft
from tcc_sim.output.table import damping_row, rows, summary_rows
from tcc_sim.recording.commands import TARGET, Commands
from tcc_sim.recording.input_sources import MOST_SOURCES, input_sources
from tcc_sim.recording.reader import Run, Tap, open_run
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.replay.control_log import ControlLog
from tcc_sim.replay.pace import Pace
from tcc_sim.replay.places import MOST_SCENES, Place, Places, Said
from tcc_sim.replay.segments import MOST_SEGMENTS, Segment, SegmentLog
from tcc_sim.replay.tail import Tail
from tcc_sim.replay.verification import Verification, Verifier
from tcc_sim.scene import Scene, load_scene, parse_scene
from tcc_sim.solvers.terms import natural_frequency, terms_of
from tcc_sim.trajectory import Cycles, Trajectory, modes_of

if TYPE_CHECKING:
    from tcc_sim.views.rerun_stream import RerunStream

SEGMENTS_SHOWN = 20
"""Most segments in the table; --json has them all."""
SOURCES = {"given": "as given", "scene": "as the scene says", "found": "found in the recorded engine torque"}


@dataclass(frozen=True, repr=False)
class Replay:
    """What a recording comes to.

    summary : of its longest run
    trajectory : the last cycles of that run, at most 200 000 samples
    cycles, first_cycle : every engine cycle of that run, NaN where a gap was, and the number of the first
    frequency, frequency_source : rad/s that the cycles are counted with; given, scene or found
    continuity : what the stamps say: gaps, missing ones, uneven ones, runs, resets and restarts
    messages, lost_messages : joint_states read, and those missing between them
    complete : False where the recording was cut short
    warnings : one sentence per damage
    pace : simulated seconds per second of real time between the first and the last message, by when they were received
    control : target, pressures, cycle means and events of that run
    segments : the figures from each start, reset, restart or change of parameters to the next
    verification, damping : where they were asked for
    """

    path: Path
    scene: Scene
    summary: Summary
    trajectory: Trajectory
    cycles: Cycles
    first_cycle: int
    frequency: float
    frequency_source: str
    continuity: StampCounter
    messages: int
    lost_messages: int
    complete: bool
    warnings: tuple[str, ...]
    pace: float
    control: Control
    segments: tuple[Segment, ...] = ()
    verification: Verification | None = None
    damping: Damping | None = None

    def __repr__(self) -> str:
        found, ended = self.summary, "complete" if self.complete else "cut short"
        period = f"period {found.period}" if found.period else "no period"
        return (f"<Replay of {self.path.name}: {counted(self.messages, 'message')}, {self.lost_messages} lost, "
                f"{ended}; {counted(found.cycles, 'cycle')}, {period}, {found.regime}; largest |slip speed| "
                f"{found.max_slip_speed:.5g} rad/s>")

    def json(self) -> dict[str, Any]:
        """The values of `analyse --json`."""
        found = self.summary.as_json()
        found.update(messages=self.messages, lost_messages=self.lost_messages, complete=self.complete,
                     warnings=list(self.warnings), scene=self.scene.description or self.scene.name,
                     frequency=self.frequency,
                     frequency_source=self.frequency_source, gaps=self.continuity.gaps,
                     uneven_stamps=self.continuity.uneven,
                     tick_s=self.continuity.tick * 1e-9, runs=self.continuity.runs,
                     real_time_factor=self.pace if math.isfinite(self.pace) else None,
                     segments=[segment.as_json() for segment in self.segments])
        if self.damping is not None:
            found.update(damping_as_json(self.damping))
        if self.verification is not None:
            largest = self.verification.largest_difference
            found.update(verified=self.verification.verified,
                         largest_difference=largest if math.isfinite(largest) else None,
                         verification=self.verification.sentence())
        return found

    def lines(self) -> list[str]:
        """The result for a terminal."""
        stamps = f"{self.continuity.tick * 1e-6:.6g} ms apart" if self.continuity.tick else "single"
        gaps = self.continuity.gaps
        stamps += f", {counted(gaps, 'gap')}" if gaps else ", no gap"
        if self.continuity.uneven:
            stamps += f", {self.continuity.uneven} of them uneven"
        if self.continuity.runs > 1:
            stamps += f"; {self.continuity.runs} runs, the figures are those of the longest"
        table = [("recording", "complete" if self.complete else "cut short; what was flushed is read"),
                 ("messages", f"{self.messages} of joint_states, {self.lost_messages} lost"), ("stamps", stamps),
                 *self._pace(),
                 ("frequency", f"{self.frequency:.9g} rad/s, {SOURCES[self.frequency_source]}"),
                 *summary_rows(self.summary)]
        if self.damping is not None:
            table.append(damping_row(self.damping))
        if self.verification is not None:
            table.append(("solved again", self.verification.sentence()))
        if len(self.segments) > 1 or any(segment.tracking is not None for segment in self.segments):
            for number, segment in enumerate(self.segments[:SEGMENTS_SHOWN], 1):
                table += segment.rows(number)
            if len(self.segments) > SEGMENTS_SHOWN:
                table.append(("", f"--json has {counted(len(self.segments) - SEGMENTS_SHOWN, 'more segment')}"))
        notes = [f"  note: {text}" for text in self.warnings]
        lines = [f"{self.path}: {self.scene.description or self.scene.name}", *rows(table), *notes]
        return [printable(line) for line in lines]

    def _pace(self) -> list[tuple[str, str]]:
        """The rate that was reached, where real time was recorded."""
        if not math.isfinite(self.pace) or not self.continuity.tick:
            return []
        return [("rate", f"{self.pace * 1e9 / self.continuity.tick:.2f} Hz reached, {self.pace:.5f} of real time")]

    def markdown(self) -> str:
        """The result as a Markdown table."""
        cells = [line.strip().split("  ", 1) for line in self.lines()[1:]]
        table = [f"| {cell[0]} | {cell[1].strip()} |" if len(cell) > 1 else f"| | {cell[0]} |" for cell in cells]
        return "\n".join([f"# {self.path.name}", "", "| | |", "|---|---|", *table, ""])


def replay(path: Path | str, *, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
           discard: int | None = None, frequency: float | None = None, scene: str | None = None, verify: bool = False,
           damping: bool = False, progress: bool = False) -> Replay:
    """Read a recording in bounded memory through the analysis and, if asked, to Rerun while reading.

    Parameters
    ----------
    path : bag directory or .mcap file, complete or cut short
    rrd, spawn, connect : at most one of a new Rerun file, a viewer to start, and the URL of a running one
    discard : engine cycles dropped; None drops 50, or half of them where there are fewer than 100
    frequency : of the engine torque, rad/s; None takes the scene's or, where the torque came from a topic, finds it,
        which reads the recording once more
    scene : name or file, for a recording that holds none
    verify : solve the run again from the recording alone
    damping : work out the equivalent damping (21) of the last cycles
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
    >>> from tcc_sim.recording.trajectory_bag import write_trajectory
    >>> scene = tcc_sim.load_scene("slip")
    >>> run = tcc_sim.solve(scene, cycles=60, samples_per_cycle=50)
    >>> write_trajectory(folder / "slip.mcap", run, scene.text())
    >>> tcc_sim.analyse(folder / "slip.mcap", discard=30).summary.regime
    'slip'
    """
    path = Path(path)
    if frequency is not None and not 1e-3 <= frequency <= 1e5:
        raise InputError(f"frequency is {frequency:g} rad/s; it must be 0.001 to 100000 rad/s")
    began = time.perf_counter()
    run = open_run(path)
    own = _scene(run, path, scene)
    if damping:
        _check_damping(own)
    omega, source = _frequency(run, own, frequency, progress)
    system = replace(own.system, engine=replace(own.system.engine, frequency=omega))
    cycle = 2.0 * math.pi / omega
    stream, tail = CycleStream(system, cycle), Tail(system, cycle)
    places = _places(run, run.scenes[:MOST_SCENES], "scenes", progress)
    sources = input_sources(run) if verify else []
    held = [(place.index, sources[place.number].commanded) for place in _places(run, sources, "inputs", progress)]
    verifier, pace = Verifier(run.scenes, places, own, run.size, held) if verify else None, Pace()
    commands = Commands(run.joint_states_topic)
    control = ControlLog(own, run.scenes, places, cycle)
    with ExitStack() as stack:
        stack.enter_context(np.errstate(all="ignore"))  # Any double may stand in a file.
        controlled = commands.has_target(run.topics)
        segments = SegmentLog(own, run.scenes, places, None if source == "scene" else omega, controlled, stream,
                              discard)
        view = _view(stack, path.name, cycle, own, rrd, spawn, connect, controlled)
        for batch in _watched(run, "reading", stack, progress, commands.take):
            slip_speed = batch.flywheel_speed - batch.plate_speed
            state = modes_of(np.nan_to_num(slip_speed), tail.stick_speed)
            pieces = stream.feed(batch.stamp_ns, slip_speed, batch.plate_angle, batch.plate_speed, batch.engine_torque,
                                 batch.friction_torque, batch.run)
            commanded = commands.until(batch)
            segments.feed(batch, slip_speed, commanded.get(TARGET))
            tail.add(batch, slip_speed, state, stream)
            fresh = control.add(batch, slip_speed, stream, commanded)
            pace.add(batch)
            if verifier is not None:
                verifier.feed(batch)
            if view is not None:
                view.samples(batch.stamp_ns, slip_speed, batch.plate_angle, batch.plate_speed, batch.engine_torque,
                             batch.friction_torque, state, new_run=tail.run_started)
                for piece in pieces:
                    view.cycles(piece.cycles, piece.first)
                view.control(fresh.signals, fresh.events)
        solver = run.result.get("solver") if run.result is not None else None
        summary = replace(stream.summary(discard), solver=solver if isinstance(solver, str) else "fixed_step",
                          elapsed_s=time.perf_counter() - began)
        longest = stream.longest()[1]
        cycles, first, _ = longest.kept(0)
        warnings = list(run.warnings)
        kept, begin, _ = longest.kept(discard)
        if not enough_after_a_gap(kept):
            warnings.append(f"no period is given: it takes {AFTER_A_GAP} engine cycles or more after the last gap")
        averages = damping_of_cycles(system, kept, begin, summary.period) if damping else None
        if len({record.parameters for record in run.scenes}) > 1:
            warnings.append(f"it holds {len(run.scenes)} scenes that differ; the figures above the segments are worked "
                            "out with the first")
        if len(run.scenes) > MOST_SCENES:
            warnings.append(f"only the first {MOST_SCENES} scenes are followed")
        if len(sources) == MOST_SOURCES:
            warnings.append(f"only the first {MOST_SOURCES} changes of the source of an input are followed")
        told = segments.finish(summary.solver, summary.elapsed_s)
        if segments.count > MOST_SEGMENTS:
            warnings.append(f"only the first {MOST_SEGMENTS} of {segments.count} segments have figures of their own")
        found = Replay(path, own, summary, tail.trajectory(summary.solver), cycles, first, omega, source,
                       run.stamps, run.stamps.messages, run.lost_messages, run.complete, tuple(warnings), pace.factor(),
                       control.control(stream), tuple(told), verifier.result() if verifier is not None else None,
                       averages)
        if view is not None:
            view.text(found.markdown())
    return found


def _scene(run: Run, path: Path, given: str | None) -> Scene:
    """The scene that the recording holds, or the one given where it holds none."""
    if run.scene_text is not None:
        return parse_scene(run.scene_text, path.stem)
    if given is None:
        raise InputError(f"{path} holds no scene; name the one that it was made with (--scene)")
    return load_scene(given)


def _check_damping(scene: Scene) -> None:
    """Raise InputError where an input came from a topic: between two points of the section it is not the scene's."""
    for name, source in (("engine.source", scene.system.engine.source),
                         ("pressure.source", scene.system.pressure.source)):
        if source == "topic":
            raise InputError(f"{name} is topic; --damping is for recordings of harmonic torque and pressure")


def _frequency(run: Run, scene: Scene, given: float | None, progress: bool) -> tuple[float, str]:
    """Angular frequency of the engine torque, rad/s, and where it comes from."""
    if given is not None:
        return given, "given"
    if scene.system.engine.source == "topic":
        finder = FrequencyFinder()
        with ExitStack() as stack:
            for batch in _watched(run, "frequency", stack, progress):
                finder.feed(batch.stamp_ns, batch.engine_torque, batch.run)
        line = finder.line()
        if line is not None:
            return line.frequency, "found"
    return scene.system.engine.frequency, "scene"


def _places(run: Run, said: Sequence[Said], what: str, progress: bool) -> list[Place]:
    """From which states on what the driveline said holds; the recording is read once more for more than one message."""
    if len(said) < 2:
        return [Place(0, 0)] if said else []
    found = Places(said)
    with ExitStack() as stack:
        for batch in _watched(run, what, stack, progress):
            found.feed(batch)
    return found.places()


def _watched(run: Run, what: str, stack: ExitStack, progress: bool, tap: Tap | None = None) -> Any:
    """The batches of a run, with a bar on a terminal."""
    from tqdm import tqdm

    bar = stack.enter_context(tqdm(desc=what, unit=" messages", unit_scale=True, leave=False,
                                   disable=None if progress else True))
    for batch in run.batches(tap):
        yield batch
        bar.update(len(batch))


def _view(stack: ExitStack, name: str, cycle: float, scene: Scene, rrd: Path | None, spawn: bool,
          connect: str | None, controlled: bool) -> RerunStream | None:
    """The stream to Rerun, where one was asked for; a file appears when it is whole."""
    if rrd is None and not spawn and connect is None:
        return None
    from tcc_sim.views.rerun_stream import RerunStream

    file = stack.enter_context(draft(rrd)) if rrd is not None else None
    system = scene.system
    return stack.enter_context(RerunStream(name, cycle, natural_frequency(terms_of(system)), file=file, spawn=spawn,
                                           url=connect, controlled=controlled or "topic" in (
                                               system.engine.source, system.pressure.source)))
