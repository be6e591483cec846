"""When the engine cycles of a recording start: as given, as its scene says, or as its torque tells; how fast it ran."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from tcc_sim.analysis.engine_clock import EngineClock, Uniform, clock_of_scene
from tcc_sim.analysis.torque_phase import PhaseTracker, clock_of
from tcc_sim.errors import InputError
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.reader import Run
from tcc_sim.scene import Scene, load_scene, parse_scene

SOURCES = {"given": "as given", "scene": "as the scene says", "found": "found in the recorded engine torque"}
SLICE, TICKS = 0.1, 20
"""Seconds, and samples at least, of a slice of time where there are no engine cycles."""
MOST_LOOKED_AT = 1000
"""Scenes of a recording in which a change of frequency is looked for."""
COMPLETE = 0.98
"""Part of a run in which cycles are known that needs no words."""


@dataclass(frozen=True)
class Timing:
    """How the engine cycles of a recording are counted.

    clock : when they start
    source : given, scene, found, or none
    low, high : smallest and largest frequency in the longest run, rad/s; equal where it is constant; NaN for none
    note : a sentence where some or all of them are not known
    """

    clock: EngineClock
    source: str
    low: float
    high: float
    note: str = ""

    @property
    def frequency(self) -> float:
        """That of a typical cycle, rad/s; NaN where there is none."""
        if not self.clock.told:
            return math.nan
        return self.low if self.low == self.high else 2.0 * math.pi / self.clock.cycle

    def sentence(self) -> str:
        """The frequency for people."""
        if not self.clock.told:
            return "not known"
        if self.low == self.high:
            return f"{self.frequency:.9g} rad/s, {SOURCES[self.source]}"
        return f"{self.low:.6g} to {self.high:.6g} rad/s, {SOURCES[self.source]}"


def timing_of(scene: Scene, given: float | None, batches: Iterable[JointStates], changed: bool = False) -> Timing:
    """How the cycles of a recording of this scene are counted.

    Parameters
    ----------
    given : angular frequency of the engine torque, rad/s, or None
    batches : the recording, which is read only where the torque came from a topic or its frequency was changed
    changed : the frequency was changed while running, so that the phase went on at another pace

    Raises
    ------
    InputError
        A frequency out of range.
    """
    if given is not None and not 1e-3 <= given <= 1e5:
        raise InputError(f"frequency is {given:g} rad/s; it must be 0.001 to 100000 rad/s")
    if given is not None:
        return Timing(Uniform(2.0 * math.pi / given), "given", given, given)
    engine = scene.system.engine
    if engine.source != "topic" and not changed:
        said = engine.frequency_values or (engine.frequency,)
        return Timing(clock_of_scene(scene.system), "scene", min(said), max(said))
    tracker = PhaseTracker()
    for batch in batches:
        tracker.feed(batch.stamp_ns, batch.engine_torque, batch.run)
    runs = tracker.runs()
    clock = clock_of(runs)
    longest = runs[tracker.longest()] if runs else None
    if clock is None or longest is None:
        why = longest.why if longest is not None else "there are no samples"
        return Timing(Uniform(max(SLICE, TICKS * tracker.tick), told=False), "none", math.nan, math.nan,
                      f"no engine cycle can be told, so there is no section, period or cycle mean: {why}")
    note = longest.why and f"the engine cycles of the longest run cannot be told: {longest.why}"
    if longest.known and longest.known < COMPLETE:
        note = (f"engine cycles are told in {100.0 * longest.known:.0f} % of the longest run: elsewhere no oscillation "
                "of the engine torque can be followed")
    found = longest if not longest.why else max(runs.values(), key=lambda run: len(run.starts))
    return Timing(clock, "found", found.low, found.high, note)


def frequency_changes(run: Run) -> bool:
    """Whether the engine's frequency was changed while the driveline ran."""
    texts = [record.parameters for record in run.scenes[:MOST_LOOKED_AT]]
    said = [re.findall(r"^ +frequency: *(\S+)", text, re.MULTILINE) for text in texts]
    return any(record.first_stamp_ns and after != before
               for record, before, after in zip(run.scenes[1:], said, said[1:]))


def recorded_scene(run: Run, given: str | None = None) -> Scene:
    """The scene that a recording holds, or the one given where it holds none.

    Raises
    ------
    InputError
        It holds none and none is given, or the one that it holds, or the one given, is no scene.
    """
    scene = None if given is None else load_scene(given)
    if run.scene_text is not None:
        return parse_scene(run.scene_text, run.path.stem)
    if scene is None:
        raise InputError(f"{run.path} holds no scene; name the one that it was made with (--scene)")
    return scene


class Pace:
    """Simulated time against the real time at which messages were received; resets and restarts count from anew.

    The first batch of a run only sets the start: its messages may have waited for the recorder to be discovered.
    """

    def __init__(self) -> None:
        self._simulated = self._real = 0.0
        self._last: tuple[int, int, int] | None = None

    def add(self, batch: JointStates) -> None:
        """Take the next messages, all of one run."""
        if len(batch):
            before, self._last = self._last, (batch.run, int(batch.stamp_ns[-1]), int(batch.log_ns[-1]))
            begin = before if before is not None and before[0] == batch.run else self._last
            if self._last[2] < begin[2]:
                return  # The clock was set back: this batch says nothing.
            self._simulated += self._last[1] - begin[1]
            self._real += self._last[2] - begin[2]

    def factor(self) -> float:
        """Simulated over real time; NaN where no real time passed, as in a recording that was not made live."""
        return self._simulated / self._real if self._real > 0.0 else math.nan
