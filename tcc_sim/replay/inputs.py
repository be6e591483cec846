"""Sources of the inputs of a recorded driveline, counts of its commands, and the ages of those held, by `held`.

A recording of version 1.0 or of another program does not state which commands acted: those figures are null.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.messages import held
from tcc_sim.plant.driveline import doubt_of
from tcc_sim.recording.columns import Commanded, JointStates
from tcc_sim.replay.timeline import GROUPS, Timeline
from tcc_sim.result import reported, result_class
from tcc_sim.topics import INPUTS

A_YEAR = 365 * 86_400 * 1_000_000_000
"""Time by which a stamp of the wall clock is ahead of simulation time at least, ns."""
UNNAMED = "the recording does not state which commands acted, as the topic held does"


@result_class
class HeldInput:
    """Sources of one input over time; the fields are JSON keys of `analyse`."""

    topic: float | None = reported("time in which it followed commands; null if not recorded", "s")
    fallback: float | None = reported("time on the fallback, without a command; null likewise", "s")
    scene: float = reported("time in which the scene set it", "s")
    refused: int | None = reported("commands that the driveline refused; null likewise")
    publishers: int = reported("publishers of its commands")
    commands: int | None = reported("recorded commands; null likewise", default=0)
    applied: int | None = reported("commands held during a tick or more; null likewise", default=None)
    superseded: int | None = reported("commands replaced before the next tick; null likewise", default=None)
    ignored: int | None = reported("recorded commands not received, or refused; null likewise", default=None)
    lost: int | None = reported("commands lost between publisher and driveline; null likewise", default=None)
    unknown: float = reported("time of missing messages and unknown source", "s", default=0.0)
    why: str = reported("why fields are null", default="")

    def sentence(self) -> str:
        """Return the sources as text."""
        if self.topic is None and not self.scene:
            return f"by commands or the fallback: {self.why}"
        seconds = [f"{seconds:.6g} s by {what}" for seconds, what in (
            (self.topic, "commands"), (self.fallback, "the fallback"), (self.scene, "the scene"),
            (self.unknown, "an unknown source")) if seconds]
        counts = [counted(self.publishers, "publisher")] if self.publishers else []
        if self.applied is not None and self.superseded is not None and (self.commands or self.applied):
            every = max(self.commands or 0, self.applied + self.superseded)
            counts.append(f"{self.applied} of {counted(every, 'command')} applied")
        counts += [f"{number} {what}" for number, what in (
            (self.superseded, "superseded"), (self.ignored, "not received"), (self.refused, "refused"),
            (self.lost, "lost on the way")) if number]
        return "; ".join([f"for {', '.join(seconds)}" if seconds else "for no time", *counts])


@result_class
class CommandAge:
    """Simulation time, s, from the state that the held command answers to each tick; 0 in lock-step."""

    median: float = reported("over the ticks", "s")
    p95: float = reported("95th percentile", "s")
    largest: float = reported("largest one", "s")

    def sentence(self) -> str:
        """Return the ages as text."""
        return f"median {self.median:.4g} s, 95 % within {self.p95:.4g} s, largest {self.largest:.4g} s"


def counts_between(states: JointStates, begin: float, end: float) -> tuple[int, int] | None:
    """Return the numbers of pressure commands that acted or were superseded after `begin` and up to `end`, s; None if
    the recording does not state them.
    """
    rows = np.searchsorted(states.stamp_ns * 1e-9, np.array([begin, end]) + 1e-9, side="right") - 1
    ends = states[np.clip(rows, 0, len(states) - 1)]
    received, superseded = (np.diff(ends.input(INPUTS[1], name))[0] for name in ("received", "superseded"))
    if not np.isfinite(received + superseded):
        return None
    return int(received - superseded), int(superseded)


def held_input(line: Timeline, name: str) -> HeldInput:
    """Return sources and counts of the input of a topic."""
    seconds = dict.fromkeys((held.SCENE, held.FALLBACK, held.COMMAND), 0.0)
    unknown, stated, counts = 0.0, False, np.zeros(4)
    for states in line.runs:
        span = float(states.stamp_ns[-1] - states.stamp_ns[0]) * 1e-9
        if getattr(line.scene_at(states.index).system, GROUPS[name]).source != "topic":
            seconds[held.SCENE] += span
            continue
        source, steps = states.input(name, "source")[1:], np.diff(states.stamp_ns) * 1e-9
        if np.isnan(source).all():
            unknown += span
            continue
        stated = True
        for one in seconds:
            seconds[one] += float(steps[source == one].sum())
        unknown += float(steps[np.isnan(source)].sum())
        for number, what in enumerate(("received", "superseded", "refused", "lost")):
            values = states.input(name, what)
            values = values[np.isfinite(values)]
            # From the begin of the run if the states begin there.
            before = values[0] if len(values) and states.stamp_ns[0] > 0 else 0.0
            counts[number] += values[-1] - before if len(values) else np.nan
    recorded, ignored, commands, why = line.recorded.get(name, 0), None, None, ""
    result = HeldInput(seconds[held.COMMAND], seconds[held.FALLBACK], seconds[held.SCENE],
                       line.counts.get(f"{name} refused"), line.publishers.get(name, 0),
                       recorded if line.whole else None, unknown=unknown, why=UNNAMED)
    if unknown and not stated:
        return replace(result, topic=None, fallback=None)
    if np.isnan(counts).any() or (recorded and not line.keyed):
        return result
    received, superseded, refused, lost = (int(count) for count in counts)
    known = line.received.get(name, 0)
    if known is None:
        why = "commands to another driveline, repeats, or messages of another topic are among those recorded"
    else:
        ignored = max(recorded - known, 0)
        if line.whole:
            commands = recorded
        elif recorded >= known:  # Those that were not received belong to no time.
            commands = received + ignored
        else:
            why = "commands are missing in the recording"
    return replace(result, refused=refused, commands=commands, applied=received - superseded, superseded=superseded,
                   ignored=ignored, lost=lost, why=why)


def age_of(line: Timeline, tick: int) -> CommandAge | None:
    """Return the ages of the held pressure commands over all ticks with a command; None if the recording does not state
    it, or if most of these commands carry no stamp of an earlier state. `tick` is the time between stamps, ns.
    """
    ages, ticks = [np.empty(0)], 0
    for states in line.runs:
        acts = states.input(INPUTS[1], "source") == held.COMMAND
        answered, acted = states.input(INPUTS[1], "stamp")[acts], states.stamp_ns[acts]
        ticks += len(acted)
        said = (answered >= 0.0) & (answered < acted)
        ages.append(np.maximum(acted[said] - answered[said] - tick, 0.0))
    every = np.concatenate(ages) * 1e-9
    if 2 * len(every) <= ticks or not len(every):
        return None
    return CommandAge(*np.quantile(every, [0.5, 0.95, 1.0]).tolist())


def _stamp_notes(line: Timeline) -> Iterator[str]:
    """Iterate over sentences on stamps of pressure commands that are not those of the answered states."""
    commands = line.commands.get(INPUTS[1], Commanded.none())
    count, stamps = len(commands.rows), commands.answers
    if not count:
        return
    ahead = stamps - line.stamps_at(commands.rows)
    wall, future = int((ahead > A_YEAR).sum()), int(((ahead >= 0) & (ahead <= A_YEAR)).sum())
    repeated = int(((np.diff(stamps) == 0) & (stamps[1:] > 0)).sum())
    if wall:
        yield (f"{wall} of {counted(count, 'pressure command')} carry stamps of the wall clock, not of the state "
               "that they answer, so their age is unknown; copy the state's stamp, or set use_sim_time")
    if future:
        yield (f"{future} of {counted(count, 'pressure command')} carry stamps that are later than the state "
               "before which they acted, so their age is unknown")
    if 2 * repeated > count:
        yield (f"{repeated} of {counted(count, 'pressure command')} repeat the stamp of the command before, from "
               "which their age counts; copy the stamp of the newest state")


def command_notes(line: Timeline, inputs: Mapping[str, HeldInput], age: CommandAge | None, tick: int,
                  tracked: bool) -> Iterator[str]:
    """Iterate over sentences on commands that did not act, acted late, or had no target (`tracked`: it has one); `tick`
    is the time between stamps, ns.
    """
    for name, one in inputs.items():
        if one.commands and one.applied == 0:
            yield (f"none of the {counted(one.commands, 'recorded command')} on {name} was applied: the driveline "
                   "takes commands where its source is topic, and from reliable publishers only, so check the scene "
                   "and the publisher's quality of service")
    yield from _stamp_notes(line)
    values = line.commands.get(INPUTS[1], Commanded.none()).values
    if doubt := doubt_of(INPUTS[1], float(np.abs(values).max(initial=0.0))):
        yield doubt
    if age is not None and tick and age.median >= tick * 1e-9 and tracked:
        yield (f"the held pressure command was {age.median:.4g} s old (median), "
               f"{counted(round(age.median * 1e9 / tick), 'tick')}: this delay adds to the tracking error")
    if (inputs[INPUTS[1]].applied or (inputs[INPUTS[1]].applied is None and inputs[INPUTS[1]].topic)) and not tracked:
        yield ("target_slip_speed was not recorded with the pressure commands; if their sender holds a slip speed, "
               "--target RAD_PER_S adds tracking errors and a verdict")
