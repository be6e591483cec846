"""Collect a controller's signals and events in one run of a recording, for pictures and Rerun."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop.control import Control, CycleMeans, Event, Steps, joined_means
from tcc_sim.analysis.measured.engine_clock import EngineClock
from tcc_sim.messages.held import COMMAND, FALLBACK
from tcc_sim.model.parameters import values_of
from tcc_sim.recording.columns import JointStates
from tcc_sim.replay.timeline import Timeline, slip_between_gaps
from tcc_sim.topics import INPUTS, SHAFT, TARGET
from tcc_sim.trajectory import Floats

MOST_STEPS = 200_000  # Most values of a held signal that are kept for a picture; the earliest go first.

PER_CYCLE = 50
"""Largest number of values of a signal per engine cycle in a picture."""
Signal = tuple[NDArray[np.int64], Floats]


class RunSignals(NamedTuple):
    """Signals of a run by name (stamps in ns, values), events by simulation time, and the reset or restart after it."""

    signals: dict[str, Signal]
    events: list[Event]
    ended: Event | None

    def control(self, cycle: float) -> Control:
        """Return the signals thinned for a picture: the last value in each 1/PER_CYCLE of an engine cycle (s)."""
        steps = {name: _thinned(signal, cycle) for name, signal in self.signals.items()}
        events = [*self.events, *([self.ended] if self.ended is not None else [])]
        means, none = steps.get("mean_slip", Steps.none()), Steps.none()
        return Control(means.t, means.values, steps.get(TARGET, none), steps.get("actuation_pressure", none),
                       steps.get("applied_pressure", none), tuple(sorted(events, key=lambda event: event.t)))


def signals_of(line: Timeline, states: JointStates, clock: EngineClock, tick: int) -> RunSignals:
    """Collect cycle means, target, pressures and events of a run or a part of it; `tick` is the time between stamps,
    ns.
    """
    signals: dict[str, Signal] = {}
    means, cycle_means = CycleMeans(clock), []
    for after_gap, t, slip_speed in slip_between_gaps(states, tick):
        if after_gap:
            means.restart()
            cycle_means.append((0, t[:1], np.array([np.nan])))  # A line through the means ends here.
        cycle_means += means.feed(t, slip_speed, states.run)
    if any(np.isfinite(mean).any() for *_, mean in cycle_means):
        signals["mean_slip"] = joined_means(cycle_means)
    end = states.index + len(states)
    for name, (rows, values, _) in line.commands.items():
        low, high = np.searchsorted(rows, [states.index, end])
        if high > low:
            signals[name] = states.stamp_ns[rows[low:high] - states.index], values[low:high]
    if line.recorded.get(SHAFT):
        driveline, far = line.scene_at(states.index).system.driveline, states.far_end
        signals[SHAFT] = states.stamp_ns, (driveline.stiffness * (states.plate_angle - far.angle)
                                           + driveline.damping * (states.plate_speed - far.speed))
    target = line.target_in(states)
    if len(target.t):
        signals[TARGET] = np.rint(target.t * 1e9).astype(np.int64), target.values
    for name, values in states.shown().items():
        change = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        signals[name] = states.stamp_ns[change], values[change]
    last = float(states.stamp_ns[-1]) * 1e-9
    events, followed = list(_changes(line, states)), any(run.index >= end for run in line.runs)
    events += _fallbacks(line, states)
    return RunSignals(signals, events, Event(last, "reset or restart") if followed else None)


def _thinned(signal: Signal, cycle: float) -> Steps:
    """Return the last value in each part of an engine cycle, at most the last `MOST_STEPS`."""
    stamps, values = signal
    part = stamps // max(round(cycle * 1e9 / PER_CYCLE), 1)
    last = np.flatnonzero(np.diff(part, append=-1))[-MOST_STEPS:]
    return Steps(stamps[last].astype(np.float64) * 1e-9, values[last])


def _changes(line: Timeline, states: JointStates) -> Iterator[Event]:
    scene = line.scene_at(states.index)
    for index, after, _ in line.changes:
        if states.index < index < states.index + len(states):
            before = dict(values_of(scene.system))
            changed = [f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}"
                       for key, value in values_of(after.system) if value != before[key]]
            scene = after
            if changed:
                yield Event(int(states.stamp_ns[index - states.index]) * 1e-9, ", ".join(changed))


def _fallbacks(line: Timeline, states: JointStates) -> Iterator[Event]:
    """Iterate over the times from which the driveline states that an input fell back within the run."""
    for name, what in zip(INPUTS, ("engine torque", "pressure")):
        source = states.input(name, "source")
        for k in (1 + np.flatnonzero((source[:-1] == COMMAND) & (source[1:] == FALLBACK))).tolist():
            limit = line.scene_at(states.index + k).operation.command_timeout
            yield Event(float(states.stamp_ns[k]) * 1e-9, f"{what} falls back: no command for {limit:g} s")
