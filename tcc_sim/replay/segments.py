"""Split a recording into segments at starts, resets, restarts and changes of parameters, and analyse each."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from tcc_sim.analysis.control import MeansOfCycles, Tracking, tracking
from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.analysis.summary import Summary, default_discard
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import values_of
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.recording.commands import TARGET
from tcc_sim.replay.timeline import Timeline, slip_between_gaps
from tcc_sim.result import Described, reported
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed

MOST_SEGMENTS = 1000
"""Largest number of segments that are analysed; the others are only counted."""


@dataclass(frozen=True)
class Segment(Described):
    """Part of a recording from a start, reset, restart or change of parameters to the next."""

    start: float = field(metadata=reported("simulation time of the start", "s"))
    end: float = field(metadata=reported("simulation time of the end", "s"))
    began_by: str = field(metadata=reported("start, reset, restart or parameters"))
    changes: Mapping[str, object] = field(metadata=reported(
        "new values of changed scene keys or target_slip_speed", "{*}"))
    summary: Summary | None = field(metadata=reported(
        "figures of the segment; null without a whole period of excitation after the dropped ones",
        spread=True, of=(Summary,)))
    tracking: Tracking | None = field(metadata=reported(
        "tracking error of the target, if a target was recorded", asked_for=True))

    def rows(self, number: int) -> list[tuple[str, str]]:
        """Return the segment as rows for a terminal."""
        what = ", ".join(f"{key} = {value}" for key, value in self.changes.items())
        when = f"{self.start:.6g} to {self.end:.6g} s"
        out = [(f"segment {number}", f"{when}, {self.began_by}{f': {what}' if what else ''}")]
        if self.summary is not None:
            s = self.summary
            period = f"period {s.period}" if s.period else "no period"
            out.append(("", f"largest |slip speed| {speed(s.max_slip_speed)}, {s.regime}, {period}, "
                            f"{counted(s.cycles, 'cycle')}"))
        else:
            out.append(("", "no whole period of excitation after the dropped ones"))
        if self.tracking is not None:
            t = self.tracking
            settled = f"settled after {t.settling_time:.4g} s" if math.isfinite(t.settling_time) else "not settled"
            if not math.isfinite(t.mean_slip):
                return [*out, ("", f"target {speed(t.target)}: no whole period of excitation to compare with it")]
            out.append(("", f"target {speed(t.target)}: mean {speed(t.mean_slip)}, rms error {speed(t.rms_error, 4)}, "
                            f"largest {speed(t.largest_error, 4)}, overshoot {speed(t.overshoot, 4)}, {settled}"))
        return out


@dataclass(frozen=True)
class Cut:
    """A segment before analysis: states of one run, reason of the start, and first target (index of a state, value)."""

    states: JointStates
    began_by: str
    changes: Mapping[str, object]
    scene: Scene
    target: tuple[int, float] | None


def cuts_of(line: Timeline) -> list[Cut]:
    """Split a recording into segments."""
    rows, values, _ = line.commands.get(TARGET, Commanded.none())
    targets, changes = deque(zip(rows.tolist(), values.tolist())), deque(line.changes)
    found: list[Cut] = []
    scene, target = line.scene, None
    for states in line.runs:
        opened: Cut | None = None
        inside = {index for index, _ in (*changes, *targets) if states.index < index < states.index + len(states)}
        for index in [states.index, *sorted(inside)]:
            before, aim = dict(values_of(scene.system)), target
            while changes and changes[0][0] <= index:
                scene = changes.popleft()[1]
            while targets and targets[0][0] <= index:
                target = targets.popleft()[1]
            changed: dict[str, object] = {key: value for key, value in values_of(scene.system) if value != before[key]}
            if aim is not None and target != aim:
                changed[TARGET] = target
            if opened is None or changed:
                if opened is not None:
                    found.append(replace(opened, states=opened.states[:index - opened.states.index]))
                opened = Cut(states[index - states.index:], "parameters" if opened else states.began.value, changed,
                             scene, None)
            if opened.target is None and target is not None:
                opened = replace(opened, target=(index, target))
        if opened is not None:
            found.append(opened)
    return found


def segments_of(line: Timeline, clock: EngineClock | None, discard: int | None, *, controlled: bool, solver: str,
                elapsed_s: float = 0.0, stream: CycleStream | None = None) -> tuple[tuple[Segment, ...], int]:
    """Return the analysed first MOST_SEGMENTS segments, and the number of all segments.

    Parameters
    ----------
    clock : start times of engine cycles in every segment; None for each scene's own frequency
    discard : number of engine cycles dropped from each segment; None for the default
    controlled : whether a target slip speed was recorded
    solver, elapsed_s : values for the summaries
    stream : cycles of the whole recording, used if every segment is a run
    """
    cuts = cuts_of(line)
    shared = stream if not line.changes and not controlled else None
    found = [_judged(cut, clock, shared, discard) for cut in cuts[:MOST_SEGMENTS]]
    return tuple(s if s.summary is None else replace(s, summary=replace(s.summary, solver=solver, elapsed_s=elapsed_s))
                 for s in found), len(cuts)


def _judged(cut: Cut, clock: EngineClock | None, shared: CycleStream | None, discard: int | None) -> Segment:
    """Analyse one segment."""
    states, stream = cut.states, shared or CycleStream(cut.scene.system, clock)
    if shared is None:
        for block in states.blocks():
            stream.feed_states(block)
    summary: Summary | None = None
    if states.run in stream.numbers:
        with suppress(InputError):
            summary = stream.summary(discard, number=stream.numbers[states.run])
    judged = None
    if cut.target is not None:
        first, target = cut.target
        running = MeansOfCycles(stream.clock)
        for after_gap, t, slip in slip_between_gaps(states[first - states.index:], stream.continuity.tick):
            if after_gap:
                running.interrupt()
            running.feed(t, slip, states.run)
        means = running.means()
        dropped = default_discard(len(means)) if discard is None else discard
        judged = tracking(target, means, stream.clock.cycle, dropped)
    return Segment(int(states.stamp_ns[0]) * 1e-9, int(states.stamp_ns[-1]) * 1e-9, cut.began_by, cut.changes, summary,
                   judged)
