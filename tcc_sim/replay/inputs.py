"""Sources of the inputs of a recorded driveline, its commands by what became of them, and the ages of those held.

A command counts as applied if the driveline held it. The announced sources and the recorded inputs show that; the order
in which a recorder received the messages does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.tracking import Counts
from tcc_sim.errors import counted
from tcc_sim.plant.closed_loop import COMMAND_RANGES, doubt_of
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.replay.timeline import Timeline
from tcc_sim.result import reported
from tcc_sim.topics import INPUTS
from tcc_sim.trajectory import Floats


@dataclass(frozen=True)
class HeldInput:
    """Sources of one input over time; the fields are JSON keys of `analyse`."""

    topic: float | None = field(metadata=reported(
        "simulation time during which it followed commands; null if neither commands nor announcements were recorded",
        "s"))
    fallback: float | None = field(metadata=reported(
        "simulation time on the fallback, without a command although its source is topic; null likewise", "s"))
    scene: float = field(metadata=reported("simulation time during which the scene set it", "s"))
    refused: int | None = field(metadata=reported(
        "number of commands that the driveline refused; null without recorded diagnostics"))
    publishers: int = field(metadata=reported("number of publishers of its commands"))
    commands: int = field(default=0, metadata=reported("number of recorded commands"))
    applied: int = field(default=0, metadata=reported("number of them that the driveline held during a tick or more"))
    superseded: int = field(default=0, metadata=reported(
        "number of them that a later one replaced before the next tick"))
    ignored: int = field(default=0, metadata=reported(
        "number of the others: the driveline refused them or never received them"))

    def sentence(self) -> str:
        """Return the sources as text."""
        if self.topic is None:
            return "by commands or the fallback; the recording does not show which"
        held = [f"{seconds:.6g} s by {what}" for seconds, what in (
            (self.topic, "commands"), (self.fallback, "the fallback"), (self.scene, "the scene")) if seconds]
        counts = [counted(self.publishers, "publisher")] if self.publishers else []
        if self.commands:
            counts.append(f"{self.applied} of {counted(self.commands, 'command')} applied")
        counts += [f"{number} {what}" for number, what in (
            (self.superseded, "superseded"), (self.ignored, "not applied"), (self.refused, "refused")) if number]
        return "; ".join([f"for {', '.join(held)}" if held else "for no time", *counts])


@dataclass(frozen=True)
class CommandAge:
    """Simulation time, s, from the state that the held command answers to each tick; 0 in lock-step."""

    median: float = field(metadata=reported("median age over the ticks", "s"))
    p95: float = field(metadata=reported("95th percentile of the age", "s"))
    largest: float = field(metadata=reported("largest age", "s"))

    def sentence(self) -> str:
        """Return the ages as text."""
        return f"median {self.median:.4g} s, 95 % within {self.p95:.4g} s, largest {self.largest:.4g} s"


@dataclass(frozen=True)
class HeldCommands:
    """Commands on one topic in one run, (n,) arrays, and what each state shows of them.

    t : simulation time of the first state after each command, s
    acts : index of that state in the run
    applied, superseded : whether the driveline held the command, and whether another one came before the next tick
    stamps : stamp of the state that the command answers, ns; negative without
    held : (m,) index of the command held through the tick before each state; -1 for none
    values : (m,) the value of that command; NaN for none
    """

    t: Floats
    acts: NDArray[np.int64]
    applied: NDArray[np.bool_]
    superseded: NDArray[np.bool_]
    stamps: NDArray[np.int64]
    held: NDArray[np.int64]
    values: Floats

    def counts(self, begin: float, end: float) -> Counts:
        """Return the numbers of commands that acted after `begin` and up to `end`, s."""
        inside = (self.t > begin + 1e-9) & (self.t <= end + 1e-9)
        return Counts(int(self.applied[inside].sum()), int(self.superseded[inside].sum()))


def held_commands(line: Timeline, states: JointStates, name: str) -> HeldCommands | None:
    """Return the commands on one topic in a run; None if none were recorded.

    Of the commands between two states the driveline holds the last; the others are superseded. Where the recorded input
    differs from its value, it was not the one: the command acted in a later tick, which shows its value, or one that
    came later superseded it, or the driveline refused it or never received it. In ticks for which the driveline
    announced the fallback, none acted.
    """
    if name not in line.commands:
        return None
    rows, values, stamps = line.commands[name]
    low, high = np.searchsorted(rows, [states.index, states.index + len(states)])
    acts, values, stamps = np.maximum(rows[low:high] - states.index, 1), values[low:high], stamps[low:high]
    inside = acts < len(states)
    acts, values, stamps = acts[inside].astype(np.int64), values[inside], stamps[inside]
    follows, meant = _follows(line, states, name, acts), COMMAND_RANGES[name]
    valid = (values >= meant.low) & (values <= meant.high)
    good, due = follows[acts] & valid, acts
    shown = _shown(line, states, name)
    if shown is not None:
        good &= shown[acts] == values
        acts = _acted(acts, values, valid & ~good, np.where(follows, shown, np.nan), states.stamp_ns)
        good |= acts > due
    order = np.argsort(acts, kind="stable")
    numbers = order[good[order]]
    applied = np.zeros(len(acts), np.bool_)
    applied[numbers[np.append(np.diff(acts[numbers]) != 0, True)[:len(numbers)]]] = True
    # Commands of one connected publisher arrive in their order, so that a later one which acted has replaced those
    # before it. Of several publishers, one may be ignored, and a replaced command was no later than its successor.
    numbers = np.flatnonzero(applied)
    following = np.searchsorted(numbers, np.arange(len(acts)))
    superseded = valid & ~applied & (following < len(numbers))
    others, connected = numbers[following[superseded]], line.publishers.get(name, 0) <= 1
    superseded[superseded] = (due[others] - due[superseded] <= acts[others] - due[others]) | (
        follows[due[superseded]] & connected)
    acts, values, stamps = acts[order], values[order], stamps[order]
    applied, superseded = applied[order], superseded[order]
    begins = acts[applied]
    place = np.searchsorted(begins, np.arange(len(states)), side="right") - 1
    held = np.where(follows & (place >= 0), np.flatnonzero(applied)[np.maximum(place, 0)] if applied.any() else -1, -1)
    return HeldCommands(states.stamp_ns[acts].astype(np.float64) * 1e-9, acts, applied, superseded, stamps, held,
                        np.where(held >= 0, values[np.maximum(held, 0)] if len(values) else np.nan, np.nan))


def _follows(line: Timeline, states: JointStates, name: str, acts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return for each state of a run whether a command acted in the tick before it, (n,).

    Without announcements, the input counts as commanded from the first command on.
    """
    group = "engine" if name == INPUTS[0] else "pressure"
    if getattr(line.scene_at(states.index).system, group).source != "topic":
        return np.zeros(len(states), np.bool_)
    commanded = line.commanded(states)[name]
    if not line.sources:
        commanded[:acts[0] if len(acts) else len(states)] = False
    return commanded


def _acted(due: NDArray[np.int64], values: Floats, unseen: NDArray[np.bool_], shown: Floats,
           stamp_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the state at which each command acts: `due`, or that of a later change of the input to its value.

    Parameters
    ----------
    due : (n,) index of the first state after each command
    unseen : (n,) which commands that state does not show
    shown : (m,) input that each state shows
    """
    changes = 1 + np.flatnonzero(shown[1:] != shown[:-1])
    changes = np.setdiff1d(changes[np.isfinite(shown[changes])], due[~unseen])
    numbers = np.flatnonzero(unseen)
    numbers = numbers[np.argsort(values[numbers], kind="stable")]
    if not (len(numbers) and len(changes)):
        return due
    place = np.searchsorted(values[numbers], shown[changes], side="right") - 1
    acted = numbers[np.maximum(place, 0)]
    same = (place >= 0) & (values[acted] == shown[changes]) & (due[acted] < changes) & (
        stamp_ns[changes] - stamp_ns[due[acted]] <= LATEST)
    acts: NDArray[np.int64] = due.copy()
    acts[acted[same]] = changes[same]
    return acts


def _shown(line: Timeline, states: JointStates, name: str) -> Floats | None:
    """Return the input that each state shows, if it is the command itself: an actuator changes a pressure."""
    if name == INPUTS[0]:
        return states.engine_torque
    if line.scene_at(states.index).system.pressure.actuated or states.applied_pressure is None:
        return None
    return states.applied_pressure if np.isfinite(states.applied_pressure).any() else None


LATEST = 250_000_000
"""Longest simulation time from the first state after a command to the one that shows it, ns."""
A_YEAR = 365 * 86_400 * 1_000_000_000
"""Time by which a stamp of the wall clock is ahead of simulation time at least, ns."""


def held_inputs(line: Timeline) -> dict[str, HeldInput]:
    """Return the times on each source for each input, by the name of its topic.

    Without the driveline's announcements, an input counts as commanded from the first command of a run on.
    """
    inputs = {}
    for name, group in zip(INPUTS, ("engine", "pressure")):
        topic: float | None = 0.0
        fallback: float | None = 0.0
        scene = 0.0
        unknown = not line.sources and name not in line.commands
        for states in line.runs:
            span = float(states.stamp_ns[-1] - states.stamp_ns[0]) * 1e-9
            if getattr(line.scene_at(states.index).system, group).source != "topic":
                scene += span
            elif unknown:
                topic = fallback = None
            elif topic is not None and fallback is not None:
                held = _commanded(line, states, name)
                topic, fallback = topic + held, fallback + span - held
        inputs[name] = HeldInput(topic, fallback, scene, line.counts.get(f"{name} refused"),
                                 line.publishers.get(name, 0), *_became(line, name))
    return inputs


def _commanded(line: Timeline, states: JointStates, name: str) -> float:
    """Return the simulation time of a run during which an input followed commands, s."""
    end = states.index + len(states)
    if line.sources:
        changes = [(max(index, states.index), name in held) for index, held in line.sources if index < end]
    else:
        rows = line.commands.get(name, Commanded.none()).rows
        first = int(np.searchsorted(rows, states.index))
        changes = [(int(rows[first]), True)] if first < len(rows) and rows[first] < end else []
    total = 0.0
    for (begin, held), (after, _) in zip(changes, [*changes[1:], (end, False)]):
        if held:  # A source with the index of a state acted in the tick before that state.
            total += float(states.stamp_ns[after - 1 - states.index] - states.stamp_ns[max(begin - 1 - states.index, 0)]
                           ) * 1e-9 if after > begin else 0.0
    return total


def _became(line: Timeline, name: str) -> tuple[int, int, int, int]:
    """Return the numbers of recorded, applied, superseded and ignored commands on one topic."""
    runs = [held for states in line.runs if (held := held_commands(line, states, name)) is not None]
    commands, applied, superseded = (sum(map(len, (held.t for held in runs))), *(
        sum(int(getattr(held, what).sum()) for held in runs) for what in ("applied", "superseded")))
    return commands, applied, superseded, commands - applied - superseded


class Ages:
    """Ages of the held pressure commands of a recording, and what their stamps are.

    Parameters
    ----------
    tick : time between stamps, ns
    """

    def __init__(self, line: Timeline, tick: int) -> None:
        self._line, self._tick = line, tick
        self._runs = [(states, held) for states in line.runs
                      if (held := held_commands(line, states, "actuation_pressure")) is not None]

    @cached_property
    def age(self) -> CommandAge | None:
        """The ages over all ticks with a command; None if most of these commands carry no stamp of an earlier state."""
        ages, ticks = [np.empty(0, np.int64)], 0
        for states, held in self._runs:
            acts = held.held >= 0
            answered, acted = held.stamps[held.held[acts]], states.stamp_ns[acts]
            ticks += len(acted)
            said = (answered > 0) & (answered >= states.stamp_ns[0]) & (answered < acted)  # 0 is no stamp.
            ages.append(np.maximum(acted[said] - answered[said] - self._tick, 0))
        every = np.concatenate(ages) * 1e-9
        if 2 * len(every) <= ticks or not len(every):
            return None
        return CommandAge(*np.quantile(every, [0.5, 0.95, 1.0]).tolist())

    @property
    def largest(self) -> float:
        """The largest size of an applied pressure command, Pa; 0 without one."""
        return max((float(np.nanmax(np.abs(held.values))) for _, held in self._runs if (held.held >= 0).any()),
                   default=0.0)

    def stamps(self) -> Iterator[str]:
        """Iterate over sentences on stamps that are not those of the answered states."""
        wall = future = repeated = count = 0
        for states, held in self._runs:
            stamps, acted = held.stamps[held.applied], states.stamp_ns[held.acts[held.applied]]
            ahead = stamps - acted
            wall += int((ahead > A_YEAR).sum())
            future += int(((ahead >= 0) & (ahead <= A_YEAR)).sum())
            repeated += int(((np.diff(stamps) == 0) & (stamps[1:] > 0)).sum())
            count += len(stamps)
        if wall:
            yield (f"{wall} of {counted(count, 'pressure command')} carry stamps of the wall clock, not of the state "
                   "that they answer, so their age is unknown; copy the state's stamp, or set use_sim_time")
        if future:
            yield (f"{future} of {counted(count, 'pressure command')} carry stamps that are later than the state "
                   "before which they acted, so their age is unknown")
        if 2 * repeated > count:
            yield (f"{repeated} of {counted(count, 'pressure command')} repeat the stamp of the command before, from "
                   "which their age counts; copy the stamp of the newest state")


def command_notes(inputs: Mapping[str, HeldInput], ages: Ages, tick: int, tracked: bool) -> Iterator[str]:
    """Iterate over sentences on commands that did not act, acted late, or had no target.

    Parameters
    ----------
    tick : time between stamps, ns
    tracked : whether a target is known
    """
    for name, held in inputs.items():
        if held.commands and not held.applied:
            yield (f"none of the {counted(held.commands, 'recorded command')} on {name} was applied: the driveline "
                   "takes commands where its source is topic, and from reliable publishers only, so check the scene "
                   "and the publisher's quality of service")
    yield from ages.stamps()
    if doubt := doubt_of(INPUTS[1], ages.largest):
        yield doubt
    age = ages.age
    if age is not None and tick and age.median >= tick * 1e-9 and tracked:
        yield (f"the held pressure command was {age.median:.4g} s old (median), "
               f"{counted(round(age.median * 1e9 / tick), 'tick')}: this delay adds to the tracking error")
    if inputs["actuation_pressure"].applied and not tracked:
        yield ("a controller commanded the pressure, but no target was recorded; give --target RAD_PER_S for tracking "
               "errors and a verdict")
