"""Analyse a recording, stream it to Rerun, and verify it against its own solution."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.analysis.loop import BAND
from tcc_sim.analysis.loop.tracking import LARGEST_BAND, Limits, checked_limits, target_steps
from tcc_sim.analysis.measured.stream import CyclePiece, CycleStream
from tcc_sim.analysis.steady.damping import damping_of_cycles
from tcc_sim.code_version import differences_from
from tcc_sim.errors import InputError, counted, printable
from tcc_sim.output.files import draft
from tcc_sim.recording.announcements import LATE_SHARE, MOST_SCENES
from tcc_sim.recording.columns import JointStates, Window
from tcc_sim.recording.commands import LATE
from tcc_sim.replay.control import signals_of
from tcc_sim.replay.inputs import age_of, command_notes, held_input
from tcc_sim.replay.recorded import Recording
from tcc_sim.replay.result import Replay
from tcc_sim.replay.segments import MOST_SEGMENTS, segments_of
from tcc_sim.replay.timeline import TORQUES, Timeline, trajectory_of
from tcc_sim.replay.timing import Timing, default_of, frequency_changes, pace_of, timing_of
from tcc_sim.replay.verification import verify as verification_of
from tcc_sim.scene import Scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.topics import INPUTS, SHAFT, TARGET
from tcc_sim.trajectory import Floats, modes_of

if TYPE_CHECKING:
    from tcc_sim.views.rerun_stream import RerunStream

TAIL_CYCLES = 24
"""Number of engine cycles at the end of the run whose samples are kept, for a picture."""
TAIL_SAMPLES = 200_000
"""Largest number of samples kept."""


def replay(path: Path | str | Recording, *, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
           discard: int | None = None, frequency: float | None = None, verify: bool = False, damping: bool = False,
           window: Window | None = None, target: float | Mapping[float, float] | None = None, band: float = BAND,
           limits: Limits | None = None, progress: bool = False) -> Replay:
    """Analyse a recording and optionally send it to Rerun; options and errors are those of `tcc_sim.analyse`.

    Parameters
    ----------
    path : bag directory or .mcap file, complete or cut short; or an opened Recording
    window : a run and a part of its time; None for the whole recording
    """
    began = time.perf_counter()
    recording = path if isinstance(path, Recording) else Recording(path)
    run, chosen = recording.file, window or Window()
    if not 0.0 < band <= LARGEST_BAND:
        raise InputError(f"band is {band:g} rad/s; it must be above 0 and at most {LARGEST_BAND:g} rad/s")
    checked_limits(limits)
    aim = None if target is None else target_steps(target)
    with ExitStack() as stack:
        stack.enter_context(np.errstate(all="ignore"))  # A file may hold any double.
        bar = partial(progress_bar, " states", shown=progress, unit_scale=True, leave=False)
        with bar(desc="reading"):
            whole = recording.line(None if verify else chosen)
        line = whole.within(chosen)
        if not line.runs:
            chosen.refuse(run.stamps.runs)
        if aim is not None:
            line = line.with_target(aim)
        shown = line.scene_at(line.longest.index)
        if damping:
            _check_damping(line, shown)
        estimated, line = [name for name in TORQUES if name in line.absent], line.with_torques()
        timing = timing_of(shown, frequency, line.runs, frequency_changes(run), run.scene_text is None)
        view = None
        if rrd is not None or spawn or connect is not None:
            from tcc_sim.views.rerun_stream import RerunStream

            sources = shown.system.engine.source, shown.system.pressure.source
            topic = f"{run.joint_states_topic.rpartition('/')[0]}/{TARGET}"
            view = stack.enter_context(RerunStream(
                printable(recording.path.name), timing.clock.cycle, spawn=spawn, url=connect,
                file=stack.enter_context(draft(rrd)) if rrd is not None else None,
                controlled=topic in run.topics or aim is not None or "topic" in sources,
                topics=[*line.commands, *[SHAFT] * (SHAFT in line.recorded), *line.runs[0].shown()],
                length=1e-9 * sum(int(np.ptp(states.stamp_ns)) for states in line.runs)))
        result = _analysed(recording, line, shown, timing, default_of(discard, timing, shown), damping, view, bar,
                           began, band, limits or line.limits)
        notes = list(result.warnings)
        if verify:
            notes += filter(None, map(differences_from, dict.fromkeys(scene.version for scene in run.scenes)))
            with bar(desc="solving") as solving:
                result = replace(result, verification=verification_of(whole, run.size, solving.update))
        if estimated:
            notes.append(f"no state has a number for {' and '.join(estimated)} (efforts): estimated from the recorded "
                         "speeds by (2a) and (2b)")
        result = replace(result, warnings=(*notes, *filter(None, [chosen.sentence()])))
        if view is not None:
            view.text(result.markdown())
    return result


def _analysed(recording: Recording, line: Timeline, scene: Scene, timing: Timing, discard: int | None, damping: bool,
              view: RerunStream | None, bar: Callable[..., AbstractContextManager[Any]], began: float, band: float,
              limits: Limits | None) -> Replay:
    """Compute all figures except the verification, those of the longest run with the scene at its begin."""
    run, clock, system = recording.file, timing.clock, scene.system
    if timing.source in ("given", "found"):
        system = replace(system, engine=replace(system.engine, frequency=timing.frequency))
    stream = CycleStream(system, clock)
    with bar(desc="analysing") as analysing:
        for states in line.runs:
            for block in states.blocks():
                pieces = line.feed(stream, block)
                if view is not None:
                    stick_speed = line.along(block, lambda held: stick_speed_of(terms_of(held)))
                    _show(view, block, stick_speed, pieces if clock.identified else [],
                          new_run=block.index == states.index, longest=stream.continuity.longest)
                analysing.update(len(block))
            if view is not None:
                signals = signals_of(line, states, clock, stream.continuity.tick)
                view.control(signals.signals, signals.events)
    elapsed = time.perf_counter() - began
    number = stream.longest()[0]
    states = next(states for states in line.runs if stream.numbers.get(states.run) == number)
    if line.scene_at(states.index).system != scene.system and line.longest.run in stream.numbers:
        states, number = line.longest, stream.numbers[line.longest.run]
    longest = stream.runs[number]
    summary = replace(stream.summary(discard, number), solver=run.solver, elapsed_s=elapsed)
    start = int(states.stamp_ns[-1]) - round(TAIL_CYCLES * clock.cycle * 1e9)
    end = states[max(int(np.searchsorted(states.stamp_ns, start)), len(states) - TAIL_SAMPLES):]
    at_end = line.scene_at(end.index).system
    if timing.source in ("given", "found"):
        at_end = replace(at_end, engine=replace(at_end.engine, frequency=timing.frequency))
    cycles, first = longest.kept(0)[:2]
    kept, begin = longest.kept(discard if clock.identified else 0)[:2]
    warnings = [*run.warnings, *_warnings(recording, line, timing)]
    far = sum(int(np.isnan(one.far_end.angle + one.far_end.speed).sum()) for one in line.runs)
    if far:
        warnings.append(f"output_state is missing at {counted(far, 'tick')}, which count as lost in the figures: the "
                        "motion of the shaft's far end is unknown there")
    if stream.not_finite > far:
        count = stream.not_finite - far
        warnings.append(f"{counted(count, 'state')} {'is' if count == 1 else 'are'} not finite and counted as lost")
    pace, note = pace_of(line)
    warnings += [note] if note else []
    segments, count = segments_of(line, timing.segment_clock, discard, solver=run.solver, elapsed_s=elapsed,
                                  stream=stream, band=band, limits=limits)
    if count > MOST_SEGMENTS:
        warnings.append(f"only the first {MOST_SEGMENTS} of {count} segments are analysed")
    inputs, age = {name: held_input(line, name) for name in INPUTS}, age_of(line, run.stamps.tick)
    tracked = any(segment.tracking is not None for segment in segments)
    warnings += command_notes(line, inputs, age, run.stamps.tick, tracked)
    late, paced = (line.counts.get(key) for key in ("late ticks", "paced ticks"))
    share = late / paced if late is not None and paced else math.nan
    late_first, late_last, latest = (line.counts[key] * 1e-9 if late and key in line.counts else math.nan
                                     for key in LATE)
    if share > LATE_SHARE:
        warnings.append(f"{100.0 * share:.3g} % of the ticks came more than a period late: the driveline did not keep "
                        "real time")
    return Replay(
        inputs=inputs, command_age=age, missed_ticks=line.counts.get("missed ticks"),
        late_ticks=late, late_share=share, late_first=late_first, late_last=late_last, latest_tick=latest,
        path=recording.path, scene=scene, summary=summary,
        trajectory=trajectory_of(line, end, at_end, clock, run), cycles=cycles,
        first_cycle=first, timing=timing, continuity=run.stamps, messages=run.stamps.messages,
        drivelines=tuple(run.drivelines), lost_messages=run.stamps.lost, complete=run.complete,
        warnings=tuple(warnings), pace=pace, parts_missing=run.parts_missing,
        control=signals_of(line, states, clock, stream.continuity.tick).control(clock.cycle), run=states.run,
        segments=segments, damping=damping_of_cycles(system, kept, begin, summary.period) if damping else None)


def _warnings(recording: Recording, line: Timeline, timing: Timing) -> Iterator[str]:
    """Iterate over warnings other than damage."""
    scenes = recording.file.scenes
    if timing.note:
        yield timing.note
    if len({record.parameters for record in scenes}) > 1:
        yield (f"the recording holds {len(scenes)} scenes that differ; the figures above the segments are those of the "
               "longest run, whose cycles are the ones of the scene at its begin")
    pressures = [states.further["applied_pressure"] for states in line.runs if "applied_pressure" in states.further
                 and (line.scene_at(states.index).system.pressure.source == "topic"
                      or np.isfinite(states.further["applied_pressure"]).any())]
    if missing := sum(int(np.isnan(pressure).sum()) for pressure in pressures):
        yield f"the applied pressure is missing at {counted(missing, 'tick')}"
    if line.scene.system.pressure.source == "topic" and not any("applied_pressure" in states.further
                                                                for states in line.runs):
        yield ("pressure.source is topic, and no pressure was recorded on applied_pressure, or on another topic that "
               "the recording names as such: the pressure at the plates is unknown")
    if len(scenes) > MOST_SCENES:
        yield f"only the first {MOST_SCENES} scenes are used"


def _show(view: RerunStream, states: JointStates, stick_speed: Floats, pieces: list[CyclePiece], *, new_run: bool,
          longest: int) -> None:
    """Send states and the engine cycles that they complete to Rerun; `longest` as for `RerunStream.samples`."""
    states, stick_speed = states[states.known], stick_speed[states.known]
    slip_speed = states.flywheel_speed - states.plate_speed
    view.samples(states.stamp_ns, slip_speed, states.plate_angle, states.plate_speed, states.engine_torque,
                 states.friction_torque, modes_of(slip_speed, stick_speed), new_run=new_run,
                 longest=longest)
    for piece in pieces:
        view.cycles(piece.cycles, piece.first)


def _check_damping(line: Timeline, scene: Scene) -> None:
    """Raise InputError if an input came from a topic: it then differs from the scene's between section points."""
    for name, source in (("engine.source", scene.system.engine.source),
                         ("pressure.source", scene.system.pressure.source)):
        if source == "topic":
            raise InputError(f"{name} is topic; --damping is for recordings of harmonic torque and pressure")
    if any(np.isfinite(states.of("output_speed")).any() for states in line.runs):
        raise InputError("the far end of the shaft moved; --damping is for recordings in which it stands still")
