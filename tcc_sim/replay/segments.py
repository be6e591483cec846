"""A recording in segments: each begins with a start, a reset, a restart or changed parameters, and has figures of its
own.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tcc_sim.analysis.control import MeansOfCycles, Tracking, tracking
from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.analysis.summary import Summary, default_discard
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import values_of
from tcc_sim.recording.announcements import ScenePlace, SceneRecord
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.commands import TARGET, Rows
from tcc_sim.result import json_of
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.trajectory import Floats

MOST_SEGMENTS = 1000
"""Segments that are told one by one; the others are counted."""


@dataclass(frozen=True)
class Segment:
    """From a start, a reset, a restart or a change of parameters to the next.

    start, end : simulation time, s
    began_by : start, reset, restart or parameters
    changes : the scene keys, or target_slip_speed, that have another value than before
    summary : its figures, None where it has no whole engine cycle that is kept
    tracking : where a target was recorded
    """

    start: float
    end: float
    began_by: str
    changes: Mapping[str, object]
    summary: Summary | None
    tracking: Tracking | None

    def as_json(self) -> dict[str, Any]:
        """An entry of `segments` of `analyse --json`."""
        figures = self.summary.as_json() if self.summary is not None else {f.name: None for f in fields(Summary)}
        found = {"start": self.start, "end": self.end, "began_by": self.began_by, "changes": dict(self.changes)}
        found |= figures
        return found | ({"tracking": json_of(self.tracking)} if self.tracking is not None else {})

    def rows(self, number: int) -> list[tuple[str, str]]:
        """The segment for a terminal."""
        what = ", ".join(f"{key} = {value}" for key, value in self.changes.items())
        when = f"{self.start:.6g} to {self.end:.6g} s"
        out = [(f"segment {number}", f"{when}, {self.began_by}{f': {what}' if what else ''}")]
        if self.summary is not None:
            s = self.summary
            period = f"period {s.period}" if s.period else "no period"
            out.append(("", f"largest |slip speed| {s.max_slip_speed:.6g} rad/s, {s.regime}, {period}, "
                            f"{counted(s.cycles, 'cycle')}"))
        else:
            out.append(("", "no whole engine cycle that is kept"))
        if self.tracking is not None:
            t = self.tracking
            settled = f"settled after {t.settling_time:.4g} s" if math.isfinite(t.settling_time) else "not settled"
            out.append(("", f"target {t.target:g} rad/s: mean {t.mean_slip:.6g}, rms error {t.rms_error:.4g}, largest "
                            f"{t.largest_error:.4g}, overshoot {t.overshoot:.4g} rad/s, {settled}"))
        return out


@dataclass
class _Open:
    """The segment at hand."""

    began_by: str
    changes: dict[str, object]
    stream: CycleStream
    run: int | None
    start_ns: int
    end_ns: int = 0
    means: MeansOfCycles | None = None
    target: float = math.nan


class SegmentLog:
    """Cuts a recording into segments while it is read, and works out the figures of each.

    Parameters
    ----------
    scene : the first
    scenes, places : all that the recording holds, and from which state on they hold
    clock : when engine cycles start, in every segment; None takes each scene's own frequency
    controlled : a target slip speed was recorded
    stream : the whole recording's, which has each batch before this: where every segment is a run, its cycles serve
    discard : engine cycles dropped from each segment; None for the default
    """

    def __init__(self, scene: Scene, scenes: Sequence[SceneRecord], places: Sequence[ScenePlace],
                 clock: EngineClock | None,
                 controlled: bool, stream: CycleStream, discard: int | None) -> None:
        self.segments: list[Segment] = []
        self.count = 0
        self._scene, self._scenes, self._clock, self._discard = scene, scenes, clock, discard
        self._places = deque(place for place in places if place.number)
        self._targets: deque[tuple[int, float]] = deque()
        self._shared = None if self._places or controlled else stream
        self._target: float | None = None
        self._run = -1
        self._open: _Open | None = None

    def feed(self, batch: JointStates, slip_speed: Floats, targets: tuple[Rows, Floats] | None = None) -> None:
        """Take the next states, all of one run, and the targets that came with them: the row of the first state after
        each, and its value.
        """
        begin = 0
        if targets is not None:
            said = self._target
            for row, value in zip(targets[0].tolist(), targets[1].tolist()):
                if value != said:
                    self._targets.append((row, value))
                    said = value
        while begin < len(batch):
            self._enter(batch, begin)
            end = self._next_cut(batch, begin)
            self._take(batch[begin:end], slip_speed[begin:end])
            begin = end
        self._targets.clear()

    def finish(self, solver: str, elapsed_s: float) -> list[Segment]:
        """All segments."""
        self._close()
        return [s if s.summary is None else replace(s, summary=replace(s.summary, solver=solver, elapsed_s=elapsed_s))
                for s in self.segments]

    def _enter(self, batch: JointStates, row: int) -> None:
        """Begin a segment where there is a reason to at this state."""
        before, target = dict(values_of(self._scene.system)), self._target
        while self._places and self._places[0].index <= batch.index + row:
            record = self._scenes[self._places.popleft().number]
            with suppress(InputError):  # Whoever solves it again says what is wrong with it.
                self._scene = parse_scene(record.parameters, self._scene.name)
        while self._targets and self._targets[0][0] <= row:
            self._target = self._targets.popleft()[1]
        changes: dict[str, object] = {key: value for key, value in values_of(self._scene.system)
                                      if value != before[key]}
        if target is not None and self._target != target:
            changes[TARGET] = self._target
        fresh = batch.run != self._run
        if fresh or changes:
            self._close()
            self._run = batch.run
            self._open = self._opened(batch.began.value if fresh else "parameters", changes, int(batch.stamp_ns[row]))
        if self._target is not None and self._open is not None and self._open.means is None:
            self._open.means, self._open.target = MeansOfCycles(self._open.stream.clock), self._target

    def _opened(self, began_by: str, changes: dict[str, object], stamp_ns: int) -> _Open | None:
        """A new segment, or None where there are too many."""
        self.count += 1
        if self.count > MOST_SEGMENTS:
            return None
        if self._shared is not None:
            return _Open(began_by, changes, self._shared, self._run, stamp_ns)
        return _Open(began_by, changes, CycleStream(self._scene.system, self._clock), None, stamp_ns)

    def _next_cut(self, batch: JointStates, row: int) -> int:
        """The next state at which something may have changed."""
        end = len(batch)
        if self.count > MOST_SEGMENTS:
            return end
        if self._places:
            end = min(end, max(self._places[0].index - batch.index, row + 1))
        if self._targets:
            end = min(end, self._targets[0][0])
        return end

    def _take(self, batch: JointStates, slip_speed: Floats) -> None:
        """Add states to the segment at hand."""
        now = self._open
        if now is None:
            return
        if now.run is None:
            now.stream.feed(batch.stamp_ns, slip_speed, batch.plate_angle, batch.plate_speed, batch.engine_torque,
                            batch.friction_torque, batch.run)
        if now.means is not None:
            stamps, tick = batch.stamp_ns[np.isfinite(slip_speed)], now.stream.continuity.tick
            slip_speed = slip_speed[np.isfinite(slip_speed)]
            gaps = np.flatnonzero(2 * np.diff(stamps, prepend=now.end_ns) > 3 * tick).tolist() if tick else []
            for begin, end in zip([0, *gaps], [*gaps, len(stamps)]):
                if begin in gaps:
                    now.means.interrupt()
                if end > begin:
                    now.means.feed(stamps[begin:end].astype(np.float64) * 1e-9, slip_speed[begin:end],
                                   batch.run)
        now.end_ns = int(batch.stamp_ns[-1])

    def _close(self) -> None:
        """End the segment at hand."""
        now, self._open = self._open, None
        if now is None:
            return
        summary: Summary | None = None
        if now.run is None or now.run in now.stream.numbers:
            with suppress(InputError):
                number = now.stream.numbers[now.run] if now.run is not None else None
                summary = now.stream.summary(self._discard, number=number)
        judged = None
        if now.means is not None:
            means = now.means.means()
            dropped = default_discard(len(means)) if self._discard is None else self._discard
            judged = tracking(now.target, means, now.stream.clock.cycle, dropped)
        self.segments.append(Segment(now.start_ns * 1e-9, now.end_ns * 1e-9, now.began_by, now.changes, summary,
                                     judged))
