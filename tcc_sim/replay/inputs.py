"""Who held the inputs of a recorded driveline, and how late its commands acted."""

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
    """One input of the driveline; the fields are JSON keys of `analyse`."""

    topic: float | None = field(metadata=reported(
        "simulation time in which a command held it; null where the recording holds neither commands nor the "
        "driveline's announcements", "s"))
    fallback: float | None = field(metadata=reported(
        "time in which no command came although it is taken from a topic; null likewise", "s"))
    scene: float = field(metadata=reported("time in which the scene said it", "s"))
    refused: int | None = field(metadata=reported(
        "number of commands that the driveline refused; null where no diagnostics were recorded"))
    publishers: int = field(metadata=reported("number of publishers that commanded it"))

    def sentence(self) -> str:
        """The input for people."""
        if self.topic is None:
            return "by commands or the fallback, which was not recorded"
        held = [f"{seconds:.6g} s by {what}" for seconds, what in (
            (self.topic, "commands"), (self.fallback, "the fallback"), (self.scene, "the scene")) if seconds]
        said = [counted(self.publishers, "publisher")] if self.publishers else []
        said += [f"{self.refused} refused"] if self.refused else []
        return "; ".join([f"for {', '.join(held)}" if held else "for no time", *said])


@dataclass(frozen=True)
class CommandAge:
    """Simulation time, s, between the state that a command answers and the tick that it first acts in; 0 in lock-step.
    """

    median: float = field(metadata=reported("median age", "s"))
    p95: float = field(metadata=reported("age that 95 % stay within", "s"))
    largest: float = field(metadata=reported("largest age", "s"))

    def sentence(self) -> str:
        """The ages for people."""
        return f"median {self.median:.4g} s, 95 % within {self.p95:.4g} s, largest {self.largest:.4g} s"


def held_inputs(line: Timeline) -> dict[str, HeldInput]:
    """Find out for each input, by the name of its topic, who held it how long.

    Where the driveline did not say it, a command counts as held from the first one of a run on.
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
    """Simulation time of a run in which a command held an input, s."""
    end = states.index + len(states)
    if line.sources:
        changes = [(max(index, states.index), name in held) for index, held in line.sources if index < end]
    else:
        rows = line.commands.get(name, Commanded.none()).rows
        first = int(np.searchsorted(rows, states.index))
        changes = [(int(rows[first]), True)] if first < len(rows) and rows[first] < end else []
    total = 0.0
    for (begin, held), (after, _) in zip(changes, [*changes[1:], (end, False)]):
        if held:  # What holds from a state on acted in the tick that ended there.
            total += float(states.stamp_ns[after - 1 - states.index] - states.stamp_ns[max(begin - 1 - states.index, 0)]
                           ) * 1e-9 if after > begin else 0.0
    return total


def command_age(line: Timeline, tick: int) -> CommandAge | None:
    """Find out how late the pressure commands acted that say which state they answer; None where most do not.

    Parameters
    ----------
    tick : distance of stamps, ns
    """
    rows, _, answers = line.commands.get("actuation_pressure", Commanded.none())
    ages, count = [np.empty(0, np.int64)], 0
    for states in line.runs:
        low, high = np.searchsorted(rows, [states.index + 1, states.index + len(states)])
        acts = np.diff(rows[low:high], append=-1) != 0  # Of several before one tick the last acts.
        answered, acted = answers[low:high][acts], states.stamp_ns[rows[low:high][acts] - states.index]
        count += len(answered)
        said = (answered > 0) & (answered >= states.stamp_ns[0]) & (answered < acted)  # 0 is no stamp.
        ages.append(np.maximum(acted[said] - answered[said] - tick, 0))
    every = np.concatenate(ages) * 1e-9
    if 2 * len(every) <= count or not len(every):
        return None
    return CommandAge(*np.quantile(every, [0.5, 0.95, 1.0]).tolist())
