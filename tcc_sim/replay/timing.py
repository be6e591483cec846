"""Timing of a recording: starts of engine cycles (given, from the scene, or from the torque), and real-time factor."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.engine_clock import EngineClock, PhaseTracker, Scheduled, clock_of, clock_of_scene
from tcc_sim.analysis.measured.signals import Phase, phase_of_cycles
from tcc_sim.analysis.measured.stream import DRIFTING
from tcc_sim.errors import InputError, counted
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.reader import Run
from tcc_sim.recording.stamps import Stamps
from tcc_sim.replay.timeline import Timeline
from tcc_sim.result import reported, reporting, result_class
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed
from tcc_sim.trajectory import Trajectory

SOURCES = {"given": "as given", "scene": "from the scene", "found": "found in the recorded engine torque"}
SLICE, TICKS = 0.1, 20
"""Length of a time slice without engine cycles, s, and its smallest number of samples."""
MOST_LOOKED_AT = 1000
"""Largest number of scenes searched for a change of frequency."""
LEAST_REAL = 1e-5
"""Smallest real time per simulated time; a recording with less has no times of receipt."""
STRETCH = 100_000_000
"""Length of the stretches of simulation time whose times of receipt are compared, ns."""
COMPLETE = 0.98
"""Fraction of a run with identified cycles below which a note is added."""

CLOCK_STEP, CLOCK_SHARE = 1e8, 0.2
"""Least advance of receipt against simulation time that counts as a step of the clock, ns, and its least share of the
time between two receipts.
"""

FEWEST_STRETCHES, FEWEST_FOR_STEPS = 2, 4
"""Least number of times between receipts of stretches that show the real time, and that show a usual one."""


@result_class
class Timing:
    """Timing of the engine cycles of a recording.

    clock : start times of the cycles
    low, high : smallest and largest frequency in the longest run, rad/s; equal if constant; NaN if unknown
    note : a sentence if some or all cycles could not be identified
    """

    clock: EngineClock
    source: str = reported("given, scene, found or none", name="frequency_source")
    low: float
    high: float
    note: str = ""

    @property
    def segment_clock(self) -> EngineClock | None:
        """Start times of cycles in every segment; None if each segment uses its scene's frequency."""
        return None if self.source == "scene" else self.clock

    @reporting("in the longest run; null if unknown", "rad/s")
    def frequency_range(self) -> tuple[float, float]:
        """Smallest and largest frequency in the longest run, rad/s; NaN if unknown."""
        return self.low, self.high

    @reporting("that of a typical cycle; null if no cycle was identified", "rad/s")
    def frequency(self) -> float:
        """Frequency of a typical engine cycle, rad/s; NaN if no cycle was identified."""
        if not self.clock.identified:
            return math.nan
        return self.low if self.low == self.high else 2.0 * math.pi / self.clock.cycle

    def phase_of(self, run: Trajectory) -> Phase | None:
        """Return the phase of a run by the given frequency or that found in its torque; None for the scene's."""
        if self.source == "given":
            each = self.clock.cycle
            return run.t / each, lambda turns: turns * each
        return phase_of_cycles(run) if self.source == "found" else None

    def sentence(self) -> str:
        """Return the frequency as text."""
        if not self.clock.identified:
            return "unknown"
        if self.low == self.high:
            return f"{speed(self.frequency, 9, engine=True)}, {SOURCES[self.source]}"
        return f"{speed(self.low, 6, self.high, engine=True)}, {SOURCES[self.source]}"


def timing_of(scene: Scene, given: float | None, runs: Iterable[JointStates], changed: bool = False,
              foreign: bool = False) -> Timing:
    """Return the timing of the engine cycles of a recording of this scene; InputError for a frequency out of range.

    Parameters
    ----------
    given : angular frequency of the engine torque, rad/s, or None
    runs : states, used only if the torque came from a topic or its frequency was changed
    changed : whether the frequency was changed while running
    foreign : whether the recording holds no scene: the frequency of its torque then precedes another one of the scene
    """
    if given is not None and not 1e-3 <= given <= 1e5:
        raise InputError(f"frequency is {given:g} rad/s; it must be 0.001 to 100000 rad/s")
    if given is not None:
        return Timing(Scheduled(2.0 * math.pi / given), "given", given, given)
    engine = scene.system.engine
    if engine.source == "topic" or changed:
        return _phase_found(runs)
    values = engine.frequency_values or (engine.frequency,)
    of_scene = Timing(clock_of_scene(scene.system), "scene", min(values), max(values))
    if not foreign:
        return of_scene
    timing = _phase_found(runs)
    # The strongest line of the torque may be a harmonic.
    ratios = np.array([timing.low / of_scene.low, timing.high / of_scene.high])
    if not timing.clock.identified or (np.abs(ratios / np.maximum(np.round(ratios), 1.0)
                                              - 1.0) <= DRIFTING).all():
        return of_scene
    to = of_scene.high if of_scene.high > of_scene.low else None
    note = f"the scene's engine frequency is {speed(of_scene.low, 6, to, engine=True)}"
    return replace(timing, note="; ".join([f"{note}, and differs from that of the recorded torque, which is used",
                                           *([timing.note] if timing.note else [])]))


def _phase_found(runs: Iterable[JointStates]) -> Timing:
    tracker = PhaseTracker()
    for states in runs:
        for block in states.blocks():
            tracker.feed(block.stamp_ns, block.engine_torque, block.run)
    phases = tracker.runs()
    clock = clock_of(phases)
    longest = phases[tracker.longest()] if phases else None
    if clock is None or longest is None:
        why = longest.why if longest is not None else "there are no samples"
        return Timing(Scheduled(max(SLICE, TICKS * tracker.tick), identified=False), "none", math.nan, math.nan,
                      f"periods of excitation could not be identified, so there is no section, period or cycle mean: "
                      f"{why}")
    note = longest.why and f"periods of excitation of the longest run could not be identified: {longest.why}"
    if longest.known and longest.known < COMPLETE:
        note = (f"periods of excitation were identified in {100.0 * longest.known:.0f} % of the longest run: elsewhere "
                "the engine torque has no oscillation that can be followed")
    best = longest if not longest.why else max(phases.values(), key=lambda run: len(run.starts))
    return Timing(clock, "found", best.low, best.high, note)


def default_of(discard: int | None, timing: Timing, scene: Scene) -> int | None:
    """Return the number of engine cycles to drop: by default none for a scene with profiles, since no part of a
    manoeuvre is a transient.
    """
    if discard is None and timing.source == "scene" and scene.system.profile is not None:
        return 0
    return discard


def frequency_changes(run: Run) -> bool:
    """Return whether the engine's frequency was changed while the driveline ran."""
    texts = [record.parameters for record in run.scenes[:MOST_LOOKED_AT]]
    values = [re.findall(r"^ +frequency: *(\S+)", text, re.MULTILINE) for text in texts]
    return any(record.first_stamp_ns and after != before
               for record, before, after in zip(run.scenes[1:], values, values[1:]))


def pace_of(line: Timeline) -> tuple[float, str]:
    """Return simulated time per real time by times of receipt, within runs, and a sentence on times that it leaves out;
    NaN if no real time passed, as in a recording that was not made live.

    Both are compared at the ends of stretches of simulation time, however the file is divided. The first stretch of a
    run only sets the start, since its messages may have waited for the discovery of the recorder. Left out is where
    receipt advances against simulation time and the next stretch does not make up for it: somebody set
    the clock, or the driveline paused or stalled. Times of receipt alone cannot distinguish these. Nothing is left out
    of a run whose scene is not paced by real time.
    """
    operation = line.scene.operation
    paced = operation.pacing == "real_time" and operation.real_time_factor > 0.0
    simulated, real, at, ahead, count, stretches = 0, 0, 0.0, 0, 0, 0
    for states in line.runs:
        ends = np.flatnonzero(np.diff(states.stamp_ns // STRETCH, append=-1))
        if np.array_equal(states.log_ns[ends], states.stamp_ns[ends]):  # `simulate --out` has no other times.
            continue
        stamps, received = np.diff(states.stamp_ns[ends]), np.diff(states.log_ns[ends])
        steps = _steps(stamps, received) & paced
        stretches += len(steps)
        simulated += int(stamps[~steps].sum())
        real += int(received[~steps].sum())
        if steps.any():
            at = at if count else float(states.stamp_ns[ends[int(steps.argmax())]]) * 1e-9
            count += int(steps.sum())
            ahead += int((received - stamps)[steps].sum())
    note = (f"times of receipt went {'ahead' if ahead > 0 else 'back'} by {abs(ahead) * 1e-9:.6g} s against simulation "
            f"time, {counted(count, 'time')}, first after {at:.6g} s: the clock was set, or the driveline paused or "
            "stalled; the rate leaves this out") if count else ""
    known = stretches >= FEWEST_STRETCHES and real > LEAST_REAL * simulated
    return simulated / real if known else math.nan, note


def _steps(stamps: Stamps, received: Stamps) -> NDArray[np.bool_]:
    """Return in which stretches the clock of the receipt was set, or simulation time did not advance with it, (n,), by
    the simulation time of each stretch and the time between its receipts, ns, (n,).
    """
    back = received < 0
    advancing = ~back & (stamps > 0)
    if np.count_nonzero(advancing) < FEWEST_FOR_STEPS:
        return back
    ratios = np.sort(received[advancing] / stamps[advancing])
    typical = float(ratios[(len(ratios) - 1) // 2])
    excess = received - typical * stamps
    lasting = np.minimum(excess, excess + np.append(excess[1:], 0.0))
    return np.asarray(back | (lasting > np.maximum(CLOCK_STEP, CLOCK_SHARE * received)))
