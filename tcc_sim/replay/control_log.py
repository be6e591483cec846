"""What a controller did during a recording, gathered while it is read: for pictures and Rerun."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.control import Control, CycleMeans, Event, Steps, joined_means
from tcc_sim.analysis.engine_clock import EngineClock
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import values_of
from tcc_sim.recording.announcements import ScenePlace, SceneRecord
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.commands import SOURCE, SOURCE_BITS, TARGET, Rows
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.trajectory import Floats

INPUTS = {"engine_torque": ("engine", "engine torque"), "actuation_pressure": ("pressure", "pressure")}
"""Command topics with the group of the scene that says whether they are used, and what they command."""
PER_CYCLE = 50
"""Values of a signal kept in each engine cycle, for a picture."""
MOST_PARTS = 64
"""Pieces of a signal, one for each batch that brought some of it, that are kept before they are joined."""
AT_A_RESET = 0.01
"""Seconds before the end of a run in which an input falls back because of the reset, and not for want of commands."""
Signal = tuple[NDArray[np.int64], Floats]


class Fresh(NamedTuple):
    """What one batch brought: signals by name, (stamps in ns, values), and events at simulation time."""

    signals: dict[str, Signal]
    events: list[Event]


class ControlLog:
    """Cycle means, target, pressures and events of the run at hand; keeps those of the longest.

    Parameters
    ----------
    scene : the recording's first
    scenes, places : all that it holds, and from which state on they hold
    clock : when engine cycles start
    """

    def __init__(self, scene: Scene, scenes: Sequence[SceneRecord], places: Sequence[ScenePlace],
                 clock: EngineClock) -> None:
        self._scene, self._scenes, self._cycle = scene, scenes, clock.cycle
        self._places = deque(place for place in places if place.number)
        self._means = CycleMeans(clock)
        self._run = -1
        self._kept: tuple[int, Control] | None = None
        self._target: float | None = None
        self._sources_said = False
        self._begin()

    def _begin(self) -> None:
        """Start on a run."""
        self._steps: dict[str, list[Signal]] = {}
        self._events: list[Event] = []
        self._last: dict[str, float] = {}
        self._end = -math.inf
        self._commanded: int | None = None
        self._fell_back = -math.inf
        self._means.restart()

    def add(self, batch: JointStates, slip_speed: Floats, stream: CycleStream,
            commands: Mapping[str, tuple[Rows, Floats]]) -> Fresh:
        """Take the next batch, which `stream` has already, and the commands that came with it, by the row of the first
        state after each.
        """
        number, fresh = len(stream.runs) - 1, Fresh({}, [])
        if number != self._run:
            if self._run >= 0:
                if self._end - self._fell_back < AT_A_RESET:
                    self._events.pop()
                self._events.append(Event(self._end, "reset or restart"))
            self._keep(stream)
            self._begin()
            self._run = number
        if not len(batch):
            return fresh
        t = batch.stamp_ns.astype(np.float64) * 1e-9
        ends, means = joined_means(self._means.feed(t, slip_speed, batch.run))
        if len(ends):
            fresh.signals["mean_slip"] = ends, means
        for name, (rows, values) in commands.items():
            if name != SOURCE:
                fresh.signals[name] = batch.stamp_ns[rows], values
        self._carry_target(batch, fresh)
        if batch.applied_pressure is not None:
            change = np.flatnonzero(np.diff(batch.applied_pressure, prepend=math.nan) != 0.0)
            fresh.signals["applied_pressure"] = batch.stamp_ns[change], batch.applied_pressure[change]
        self._changes(batch, fresh)
        self._sources(t, commands.get(SOURCE), fresh)
        if not self._sources_said:
            self._fallbacks(float(t[-1]), fresh)
        for name, signal in fresh.signals.items():
            self._hold(name, signal)
        self._events += fresh.events
        self._end = float(t[-1])
        return fresh

    def control(self, stream: CycleStream) -> Control:
        """Of the longest run."""
        self._keep(stream)
        return self._kept[1] if self._kept is not None else Control(np.empty(0), np.empty(0))

    def _hold(self, name: str, signal: Signal) -> None:
        """Keep the last value in each PER_CYCLE-th part of an engine cycle, and `Settings.most_steps` of these."""
        part = signal[0] // max(round(self._cycle * 1e9 / PER_CYCLE), 1)
        last = np.flatnonzero(np.diff(part, append=-1))
        held = self._steps.setdefault(name, [])
        held.append((signal[0][last], signal[1][last]))
        if len(held) > MOST_PARTS:
            held[:] = [_joined(held)]

    def _changes(self, batch: JointStates, fresh: Fresh) -> None:
        """Parameters that were changed up to the end of a batch; what a new run begins with is no event of it."""
        while self._places and self._places[0].index < batch.index + len(batch):
            place = self._places.popleft()
            record, row = self._scenes[place.number], place.index - batch.index
            try:
                scene = parse_scene(record.text, self._scene.name)
            except InputError:
                continue
            before, after = dict(values_of(self._scene.system)), dict(values_of(scene.system))
            changed = [f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}"
                       for key, value in after.items() if value != before[key]]
            self._scene = scene
            if changed and record.first_stamp_ns and row >= 0:
                fresh.events.append(Event(int(batch.stamp_ns[row]) * 1e-9, ", ".join(changed)))

    def _carry_target(self, batch: JointStates, fresh: Fresh) -> None:
        """The target of the run before holds in the next one too, until another is said."""
        stamps, values = fresh.signals.get(TARGET, (np.empty(0, np.int64), np.empty(0)))
        begins = not math.isfinite(self._end)
        if begins and self._target is not None and not (len(stamps) and stamps[0] == batch.stamp_ns[0]):
            stamps, values = np.append(batch.stamp_ns[0], stamps), np.append(self._target, values)
            fresh.signals[TARGET] = stamps, values
        if len(values):
            self._target = float(values[-1])

    def _sources(self, t: Floats, said: tuple[Rows, Floats] | None, fresh: Fresh) -> None:
        """Inputs that fell back as the driveline said it; what a run begins with is no event of it."""
        for row, value in zip(*(column.tolist() for column in said)) if said is not None else ():
            before, self._commanded, self._sources_said = self._commanded, int(value), True
            for name, (_, what) in INPUTS.items():
                if before is not None and before & ~self._commanded & SOURCE_BITS[name]:
                    limit = self._scene.operation.command_timeout
                    fresh.events.append(Event(float(t[row]), f"{what} falls back: no command for {limit:g} s"))
                    self._fell_back = float(t[row])

    def _fallbacks(self, end: float, fresh: Fresh) -> None:
        """Inputs that fell back since no command came for command_timeout, where the driveline did not say so."""
        limit = self._scene.operation.command_timeout
        for name, (group, what) in INPUTS.items():
            if limit <= 0.0 or getattr(self._scene.system, group).source != "topic":
                continue
            came = fresh.signals[name][0] * 1e-9 if name in fresh.signals else np.empty(0)
            last = self._last.get(name)
            times = np.concatenate([[] if last is None else [last], came, [end]])
            if last is None and not len(came):
                continue
            late = np.flatnonzero(np.diff(times) > limit + 1e-9)
            found = [Event(float(times[k]) + limit, f"{what} falls back: no command for {limit:g} s") for k in late]
            said = {event.t for event in self._events}
            fresh.events.extend(event for event in found if event.t not in said)
            self._last[name] = float(times[-2])

    def _keep(self, stream: CycleStream) -> None:
        """Keep the run at hand unless the one kept has more whole cycles."""
        if self._run < 0:
            return
        if self._kept is not None and stream.runs[self._run].observed() < stream.runs[self._kept[0]].observed():
            return
        joined = {name: _joined(parts) for name, parts in self._steps.items()}
        steps = {name: Steps(stamps.astype(np.float64) * 1e-9, values) for name, (stamps, values) in joined.items()}
        means = steps.get("mean_slip", Steps.none())
        self._kept = self._run, Control(
            means.t, means.values, steps.get("target_slip_speed", Steps.none()),
            steps.get("actuation_pressure", Steps.none()), steps.get("applied_pressure", Steps.none()),
            tuple(sorted(self._events, key=lambda event: event.t)))


def _joined(parts: list[Signal]) -> Signal:
    """Parts one after the other, the last `Settings.most_steps` values of them."""
    stamps, values = zip(*parts)
    return np.concatenate(stamps)[-DEFAULTS.most_steps:], np.concatenate(values)[-DEFAULTS.most_steps:]
