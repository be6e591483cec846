"""Split a recording into segments at starts, resets, restarts and changes of parameters, and analyse each."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from tcc_sim.analysis.loop import BAND
from tcc_sim.analysis.loop.control import Steps, handovers
from tcc_sim.analysis.loop.loop_verdict import NO_SIGNAL, SETTLED_CYCLES, Signal
from tcc_sim.analysis.loop.tracking import Limits, Loop, Tracking, loop_cycles, target_jumps
from tcc_sim.analysis.measured.engine_clock import EngineClock, Scheduled, Tracked, clock_of_scene
from tcc_sim.analysis.measured.signals import BRIDGED_TICKS
from tcc_sim.analysis.measured.stream import CycleStream
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import OutOfRange, counted
from tcc_sim.messages import held
from tcc_sim.model.parameters import values_of
from tcc_sim.output.tables import tracking_lines
from tcc_sim.recording.columns import JointStates
from tcc_sim.replay.inputs import counts_between
from tcc_sim.replay.timeline import Timeline, slip_between_gaps
from tcc_sim.replay.timing import SLICE, TICKS
from tcc_sim.result import Described, reported, result_class
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed
from tcc_sim.topics import INPUTS, TARGET

MOST_SEGMENTS = 1000
"""Largest number of segments that are analysed; the others are only counted."""


@result_class
class Segment(Described):
    """Part of a recording from a start, reset, restart or change of parameters to the next."""

    run: int = reported("number of its run")
    start: float = reported("simulation time", "s")
    end: float = reported("simulation time", "s")
    began_by: str | None = reported(
        "start, reset, restart, parameters, fallback, controller (commands begin, return, or come from a new "
        "publisher) or pause; null where the run began before the recording")
    changes: Mapping[str, object] = reported("new values of changed scene keys or target_slip_speed", "{*}")
    summary: Summary | None = reported(
        "figures of the segment; null without a whole period of excitation after the dropped ones", spread=True,
        of=(Summary,))
    tracking: Tracking | None = reported("tracking of a recorded target", optional=True)

    def rows(self, number: int) -> list[tuple[str, str]]:
        """Return the segment as rows for a terminal."""
        what = ", ".join(f"{key} = {value}" for key, value in self.changes.items())
        when = f"{self.start:.6g} to {self.end:.6g} s"
        by = self.began_by or "begun before"
        out = [(f"segment {number}", f"{when}, {by}{f': {what}' if what else ''}")]
        if self.summary is not None:
            s = self.summary
            period = f"period {s.period}" if s.period else "no period"
            out.append(("", f"largest |slip speed| {speed(s.max_slip_speed)}, {s.regime}, {period}, "
                            f"{counted(s.cycles, 'cycle')}"))
        else:
            out.append(("", "no whole period of excitation after the dropped ones"))
        return out if self.tracking is None else [*out, *(("", text) for text in tracking_lines(self.tracking))]


@dataclass(frozen=True)
class Cut:
    """A segment before analysis: its states, reason of the start, and whether the target jumps there or the run starts
    (None: the slip speed may begin anywhere, as under another controller).
    """

    states: JointStates
    began_by: str | None
    changes: Mapping[str, object]
    scene: Scene
    stepped: bool | None


def cuts_of(line: Timeline, band: float = BAND, clock: EngineClock | None = None) -> list[list[Cut]]:
    """Split the runs of a recording into segments, also at jumps of the target of `band` rad/s or more; the clock has
    the start times of engine cycles, None for those of each scene.
    """
    changes = deque(line.changes)
    cuts_of_runs: list[list[Cut]] = []
    scene, target = line.scene, None
    for states in line.runs:
        end = states.index + len(states)
        reference = line.target_in(states)
        cycle = (clock or clock_of_scene(line.scene_at(states.index).system)).cycle
        jumps = target_jumps(reference, band, SETTLED_CYCLES * cycle)
        at = states.index + np.searchsorted(states.stamp_ns, np.rint(jumps.t * 1e9).astype(np.int64))
        targets = {index: value for index, value in zip(at.tolist(), jumps.values.tolist()) if index < end}
        if len(reference.t) and reference.t[0] * 1e9 <= states.stamp_ns[0] + 0.5:
            targets.setdefault(states.index, float(reference.values[0]))
        cuts: list[Cut] = []
        handed = _handed_over(states, cycle)
        inside = {index for index in (*(index for index, *_ in changes), *targets, *handed)
                  if states.index < index < end}
        for index in [states.index, *sorted(inside)]:
            before = dict(values_of(scene.system))
            while changes and changes[0][0] <= index:
                scene = changes.popleft()[1]
            changed: dict[str, object] = {key: value for key, value in values_of(scene.system) if value != before[key]}
            if index in targets:
                if target not in (None, targets[index]):
                    changed[TARGET] = targets[index]
                target = targets[index]
            if not cuts or changed or index in handed:
                if cuts:
                    cuts[-1] = replace(cuts[-1], states=cuts[-1].states[:index - cuts[-1].states.index])
                began = None if states.cut else states.began.value
                cuts.append(Cut(states[index - states.index:], began if not cuts else "parameters"
                                if changed else handed[index], changed, scene,
                                not cuts or TARGET in changed or (None if index in handed else False)))
        if len(reference.t):
            target = float(reference.values[-1])
        cuts_of_runs.append(cuts)
    return cuts_of_runs


def _handed_over(states: JointStates, cycle: float) -> dict[int, str]:
    """Return the first states under a fallback of the pressure that lasts for a cycle, s, under a controller or a new
    publisher of commands, and after a pause.
    """
    step = float(np.median(np.diff(states.stamp_ns))) * 1e-9 if len(states) > 1 else cycle
    source = states.input(INPUTS[1], "source")
    known = np.flatnonzero(np.isfinite(source))
    edges = handovers(source[known] == held.COMMAND, max(round(cycle / step), 1))
    publishers = states.input(INPUTS[1], "publisher")
    latest = np.maximum.accumulate(np.nan_to_num(publishers))
    paused = [] if states.held is None else states.held[states.held[:, held.LAST] == held.PAUSED, held.TIME]
    rows = dict.fromkeys(np.searchsorted(states.stamp_ns, paused, side="right").tolist(), "pause")
    rows |= dict.fromkeys((1 + np.flatnonzero((np.diff(latest) > 0) & (latest[:-1] > 0))).tolist(), "controller")
    rows |= {int(known[row]): "controller" if commanded else "fallback" for row, commanded in edges}
    return {states.index + row: what for row, what in rows.items()}


def segments_of(line: Timeline, clock: EngineClock | None, discard: int | None, *, solver: str, elapsed_s: float = 0.0,
                stream: CycleStream | None = None, band: float = BAND,
                limits: Limits | None = None) -> tuple[tuple[Segment, ...], int]:
    """Return the analysed first MOST_SEGMENTS segments, and the number of all segments.

    Parameters
    ----------
    clock : start times of engine cycles in every segment; None for each scene's own frequency
    discard : number of engine cycles dropped from each segment; None for the default, which drops none from its
        tracking
    stream : cycles of the whole recording, used if every segment is a run
    band : least error of a controlled run that counts, rad/s
    limits : of the pressure as stated, Pa; None if nobody stated them
    """
    runs = cuts_of(line, band, clock)
    shared = stream if not line.changes and all(len(cuts) == 1 for cuts in runs) else None
    segments: list[Segment] = []
    for cuts in runs:
        tracking = _tracking_of(line, cuts, clock, discard or 0, band, limits)
        for cut in cuts[:MOST_SEGMENTS - len(segments)]:
            stamps = cut.states.stamp_ns
            segment = Segment(cut.states.run, int(stamps[0]) * 1e-9, int(stamps[-1]) * 1e-9, cut.began_by, cut.changes,
                              _summary(cut, clock, shared, discard), next(tracking))
            segments.append(segment if segment.summary is None else replace(
                segment, summary=replace(segment.summary, solver=solver, elapsed_s=elapsed_s)))
    return tuple(segments), sum(map(len, runs))


def _summary(cut: Cut, clock: EngineClock | None, shared: CycleStream | None, discard: int | None) -> Summary | None:
    """Return the summary of a segment; None without a whole cycle."""
    stream = shared or CycleStream(cut.scene.system, clock)
    if shared is None:
        for block in cut.states.blocks():
            stream.feed_states(block)
    if cut.states.run in stream.numbers:
        with suppress(OutOfRange):
            return stream.summary(discard, number=stream.numbers[cut.states.run])
    return None


def _tracking_of(line: Timeline, cuts: list[Cut], clock: EngineClock | None, discard: int, band: float,
                 limits: Limits | None) -> Iterator[Tracking | None]:
    """Iterate over the tracking of each segment of a run from its first target on; None for one without a target."""
    states = next(states for states in line.runs if states.run == cuts[0].states.run)
    reference, loop = line.target_in(states), None
    for cut in cuts:
        begin, end = (float(cut.states.stamp_ns[k]) * 1e-9 for k in (0, -1))
        if not len(reference.t) or reference.t[0] > end:
            yield None
            continue
        loop = loop or _loop_of(states, cuts[0].scene, reference, clock, band, limits)
        late = float(reference.t[0]) > begin + 1e-9
        begin = max(begin, float(reference.t[0]))
        yield loop.tracking(begin, end, stepped=True if late else cut.stepped, discard=discard,
                            commands=counts_between(states, begin, end))


def _loop_of(states: JointStates, scene: Scene, reference: Steps, clock: EngineClock | None, band: float,
             limits: Limits | None) -> Loop:
    """Return the controlled run with these states."""
    clock = clock or clock_of_scene(scene.system)
    # Without pulsation any slice of time gives the mean.
    sought = isinstance(clock, Tracked) or not clock.identified
    torque = states.engine_torque[np.isfinite(states.engine_torque)]
    # The torque is constant apart from a few steps.
    slices = (sought and len(states) > 1 and len(torque) > 0
              and 100 * np.count_nonzero(np.diff(torque)) < len(torque))
    if slices:
        clock = Scheduled(max(SLICE, TICKS * 1e-9 * float(np.median(np.diff(states.stamp_ns)))))
    stream = CycleStream(scene.system, clock)
    pieces = [piece for block in states.blocks() for piece in stream.feed_states(block)]
    course, slip = loop_cycles(clock, slip_between_gaps(states, stream.continuity.tick), pieces, states.run)
    pressure = states.further.get("applied_pressure")
    bridged = [gap for run in stream.runs for gap in run.gaps
               if gap[1] - gap[0] <= BRIDGED_TICKS * stream.continuity.tick_s]
    why = "" if clock.identified else "periods of excitation could not be identified, so there is no cycle mean"
    note = f"; means over {clock.cycle:.3g} s, as the engine torque does not pulsate" if slices else ""
    applied = NO_SIGNAL if pressure is None else Signal(states.stamp_ns.astype(np.float64) * 1e-9, pressure)
    return Loop(course, reference, applied, limits=limits, floor=band, why=why, note=note,
                bridged=np.array(bridged).reshape(-1, 2), slip=slip)
