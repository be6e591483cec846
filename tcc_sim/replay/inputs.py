"""Sources of the inputs of a recorded driveline, and ages of its commands."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.replay.timeline import Timeline
from tcc_sim.result import reported
from tcc_sim.topics import INPUTS


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

    def sentence(self) -> str:
        """Return the sources as text."""
        if self.topic is None:
            return "by commands or the fallback; the recording does not show which"
        held = [f"{seconds:.6g} s by {what}" for seconds, what in (
            (self.topic, "commands"), (self.fallback, "the fallback"), (self.scene, "the scene")) if seconds]
        counts = [counted(self.publishers, "publisher")] if self.publishers else []
        counts += [f"{self.refused} refused"] if self.refused else []
        return "; ".join([f"for {', '.join(held)}" if held else "for no time", *counts])


@dataclass(frozen=True)
class CommandAge:
    """Simulation time, s, from the state that a command answers to the first tick that applies it; 0 in lock-step."""

    median: float = field(metadata=reported("median age", "s"))
    p95: float = field(metadata=reported("95th percentile of the age", "s"))
    largest: float = field(metadata=reported("largest age", "s"))

    def sentence(self) -> str:
        """Return the ages as text."""
        return f"median {self.median:.4g} s, 95 % within {self.p95:.4g} s, largest {self.largest:.4g} s"


def held_inputs(line: Timeline) -> dict[str, HeldInput]:
    """Return the times on each source for each input, by the name of its topic.

    Without the driveline's announcements, an input counts as commanded from the first command of a run on.
    """
    found = {}
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
        refused = line.counts.get(f"{name} refused")
        found[name] = HeldInput(topic, fallback, scene, refused=refused, publishers=line.publishers.get(name, 0))
    return found


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


def command_age(line: Timeline, tick: int) -> CommandAge | None:
    """Return the ages of the pressure commands with a stamp; None if most have none.

    Parameters
    ----------
    tick : time between stamps, ns
    """
    rows, _, answers = line.commands.get("actuation_pressure", Commanded.none())
    ages, count = [np.empty(0, np.int64)], 0
    for states in line.runs:
        low, high = np.searchsorted(rows, [states.index + 1, states.index + len(states)])
        acts = np.diff(rows[low:high], append=-1) != 0  # The last of several commands before a tick acts.
        answered, acted = answers[low:high][acts], states.stamp_ns[rows[low:high][acts] - states.index]
        count += len(answered)
        said = (answered > 0) & (answered >= states.stamp_ns[0]) & (answered < acted)  # 0 is no stamp.
        ages.append(np.maximum(acted[said] - answered[said] - tick, 0))
    every = np.concatenate(ages) * 1e-9
    if 2 * len(every) <= count or not len(every):
        return None
    return CommandAge(*np.quantile(every, [0.5, 0.95, 1.0]).tolist())
