"""When the engine cycles of a recording start: as given, as its scene says, or as its torque tells; how fast it ran."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.analysis.engine_clock import EngineClock, Uniform, clock_of_scene
from tcc_sim.analysis.torque_phase import PhaseTracker, clock_of
from tcc_sim.errors import InputError
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.reader import Run
from tcc_sim.replay.timeline import Timeline
from tcc_sim.result import reported, reporting
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
    low, high : smallest and largest frequency in the longest run, rad/s; equal where it is constant; NaN for none
    note : a sentence where some or all of them are not known
    """

    clock: EngineClock
    source: str = field(metadata=reported(
        "given, scene, found, or none where no engine cycle is known", name="frequency_source"))
    low: float
    high: float
    note: str = ""

    @property
    def segment_clock(self) -> EngineClock | None:
        """That of every segment; None where each takes its scene's own frequency."""
        return None if self.source == "scene" else self.clock

    @property
    @reporting("smallest and largest frequency in the longest run; equal where it is constant, null where it is not "
               "known", "rad/s")
    def frequency_range(self) -> tuple[float, float]:
        """Smallest and largest frequency in the longest run, rad/s; NaN for none."""
        return self.low, self.high

    @property
    @reporting("frequency of a typical engine cycle; null where no cycle is known", "rad/s")
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


def timing_of(scene: Scene, given: float | None, runs: Iterable[JointStates], changed: bool = False) -> Timing:
    """How the cycles of a recording of this scene are counted.

    Parameters
    ----------
    given : angular frequency of the engine torque, rad/s, or None
    runs : its states, which are looked at only where the torque came from a topic or its frequency was changed
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
    for states in runs:
        for block in states.blocks():
            tracker.feed(block.stamp_ns, block.engine_torque, block.run)
    phases = tracker.runs()
    clock = clock_of(phases)
    longest = phases[tracker.longest()] if phases else None
    if clock is None or longest is None:
        why = longest.why if longest is not None else "there are no samples"
        return Timing(Uniform(max(SLICE, TICKS * tracker.tick), told=False), "none", math.nan, math.nan,
                      f"no engine cycle can be told, so there is no section, period or cycle mean: {why}")
    note = longest.why and f"the engine cycles of the longest run cannot be told: {longest.why}"
    if longest.known and longest.known < COMPLETE:
        note = (f"engine cycles are told in {100.0 * longest.known:.0f} % of the longest run: elsewhere no oscillation "
                "of the engine torque can be followed")
    found = longest if not longest.why else max(phases.values(), key=lambda run: len(run.starts))
    return Timing(clock, "found", found.low, found.high, note)


def default_of(discard: int | None, timing: Timing, scene: Scene) -> int | None:
    """Engine cycles to be dropped: none of a scene with profiles where nothing is given, as no part of a manoeuvre is a
    transient.
    """
    if discard is None and timing.source == "scene" and scene.system.profile is not None:
        return 0
    return discard


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


def pace_of(line: Timeline) -> float:
    """Simulated time against the real time at which messages were received, resets and restarts apart; NaN where no
    real time passed, as in a recording that was not made live.

    The first chunk of a run only sets the start: its messages may have waited for the recorder to be discovered. One in
    which the clock was set back counts for nothing.
    """
    simulated = real = 0
    for states in line.runs:
        starts = line.starts[(line.starts > states.index) & (line.starts < states.index + len(states))] - states.index
        ends = np.append(starts, len(states)) - 1
        stamps, received = np.diff(states.stamp_ns[ends]), np.diff(states.log_ns[ends])
        simulated += int(stamps[received >= 0].sum())
        real += int(received[received >= 0].sum())
    return simulated / real if real > 0 else math.nan
