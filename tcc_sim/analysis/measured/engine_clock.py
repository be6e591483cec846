"""Start times of the engine cycles of a run: from the scene, from the phases of a torque, or unknown.

Phases are measured in blocks of samples; between blocks the frequency is constant, or drifts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import System
from tcc_sim.solvers.per_cycle import cycle_starts, starts_of
from tcc_sim.trajectory import Floats

SLACK = 1e-9  # Part of a period of excitation by which a sample may miss the instant at which the cycle starts.
PHASE_MEMORY = 6  # Blocks from which the next phase is expected, by a parabola.
FULL_SIZE = 0.7
"""Part of the amplitude of the next block that the first of a stretch must have, and the last of the one before it."""
STEADY = 0.02  # Rms deviation of the phases from uniform rotation up to which a frequency is constant, rad.
NOISE_FACTOR = 3.0  # The same in units of their own noise.
FEWEST_FOR_NOISE = 6  # Blocks from which their noise can be told.
LARGEST_NOISE = 0.17  # The largest that a constant frequency may have, rad.

Stretch = tuple[int, Floats]
"""Consecutive engine cycles: the number of the first, and their start times with the end of the last, s."""


@dataclass(frozen=True)
class Uniform:
    """Cycle n starts at t = n cycle, in every run.

    If not `identified`, slices of time replace unknown engine cycles: they have extremes, but neither section nor
    period.
    """

    cycle: float
    identified: bool = True

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Return the stretches as `EngineClock`."""
        first = math.ceil(begin / self.cycle - SLACK)
        return [(first, cycle_starts(first, end, self.cycle))]

    def cycles_until(self, t: float) -> float:
        """Return the number of cycles from time 0 to t, s."""
        return t / self.cycle

    def start_of(self, number: int) -> float:
        """Return the start of a cycle, s."""
        return number * self.cycle


@dataclass(frozen=True)
class Scheduled:
    """Cycles of a scene with a frequency that varies in time, in every run from its reset on."""

    system: System
    identified: bool = True

    @property
    def cycle(self) -> float:
        """Shortest cycle, s."""
        return self.system.cycle

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Return the stretches as `EngineClock`."""
        first = math.ceil(self.system.cycles_until(begin) - SLACK)
        return [(first, starts_of(self.system, first, end))]

    def cycles_until(self, t: float) -> float:
        """Return the number of cycles from time 0 to t, s."""
        return float(self.system.cycles_until(t))

    def start_of(self, number: int) -> float:
        """Return the start of a cycle, s."""
        return float(self.system.cycle_start(number))


@dataclass(frozen=True)
class Tracked:
    """Cycles of a frequency that may vary, known in stretches of some runs.

    cycle : median length, s
    runs : by number the cycles with known start, (n,), and these times, s, ascending; a missing number begins another
        stretch
    """

    cycle: float
    runs: Mapping[int, tuple[NDArray[np.int64], Floats]] = field(default_factory=dict)
    identified: bool = True

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Return the stretches as `EngineClock`; the last start before an unknown stretch begins no cycle."""
        if run not in self.runs:
            return []
        numbers, starts = self.runs[run]
        slack = SLACK * self.cycle
        low, high = (int(np.searchsorted(starts, t)) for t in (begin - slack, end + slack))
        cuts = (1 + low + np.flatnonzero(np.diff(numbers[low:high]) > 1)).tolist()
        stretches = []
        for a, b in zip([low, *cuts], [*cuts, high]):
            if b > a and (b - a > 1 or (b < len(numbers) and numbers[b] == numbers[a] + 1)):
                stretches.append((int(numbers[a]), starts[a:b]))
        return stretches


EngineClock = Uniform | Scheduled | Tracked
"""Engine cycles of every run of a recording.

`cycle` is a typical length, s; `identified` is False for slices of time instead of cycles; `stretches` returns the
cycles of a run that start between two times, s, one stretch for each group of consecutive cycles.
"""


def clock_of_scene(system: System) -> EngineClock:
    """Return the engine cycles for the torque and frequency of a scene."""
    return Uniform(system.cycle) if system.profile is None else Scheduled(system)


class Block(NamedTuple):
    """Phase (rad) in the middle of a block of samples (s), amplitude (N m), share of the variance in the line, and the
    block's begin and end (s).
    """

    t: float
    phase: float
    amplitude: float
    share: float
    begin: float
    end: float


Blocks = list[Block]
"""Consecutive blocks."""


def trim(stretch: Blocks) -> None:
    """Remove a block at either end that the oscillation fills only in part."""
    for end, neighbour in ((0, 1), (-1, -2)):
        if len(stretch) > 2 and stretch[end].amplitude < FULL_SIZE * stretch[neighbour].amplitude:
            del stretch[end]


@dataclass(frozen=True)
class RunPhase:
    """Start times of a run's cycles, or the reason why they are unknown.

    numbers, starts : as in `Tracked`
    low, high : smallest and largest frequency, rad/s; equal if it is constant
    known : part of the run in which they are known
    why : reason in a sentence if none are known
    """

    numbers: NDArray[np.int64]
    starts: Floats
    low: float
    high: float
    known: float = 0.0
    why: str = ""


def cycles_between(stretches: list[Blocks], known: float) -> RunPhase:
    """Return a run's cycles from its stretches, known in the part `known`; their phases are joined first."""
    blocks = [(np.array([b.t for b in s]), np.array([b.phase for b in s])) for s in stretches]
    t, phase = blocks[0]
    for number, (later, ahead) in enumerate(blocks[1:], 1):
        steady = _steady(t, phase)
        tail = slice(0, None) if steady else slice(-PHASE_MEMORY, None)
        slope, value = np.polyfit(t[tail] - later[0], phase[tail], 1)
        turns = np.round((value - ahead[0]) / (2.0 * math.pi))
        blocks[number] = later, ahead + 2.0 * math.pi * turns
        t, phase = np.concatenate([t, later]), np.concatenate([phase, blocks[number][1]])
    slope, start = np.polyfit(t - t[0], phase, 1).tolist()
    steady = _steady(t, phase)
    numbers, starts, low, high = [], [], math.inf, 0.0
    zero = start - slope * t[0] if steady else phase[0] - float(np.gradient(phase[:2], t[:2])[0]) * t[0]
    shift = zero - math.remainder(zero, 2.0 * math.pi)
    for stretch, (where, values) in zip(stretches, blocks):
        if steady:
            ends = [start + slope * (at - t[0]) - shift for at in (stretch[0].begin, stretch[-1].end)]
            here = np.arange(math.ceil(ends[0] / (2.0 * math.pi) - 1e-9), ends[1] / (2.0 * math.pi) + 1e-9)
            times, rates = t[0] + (2.0 * math.pi * here + shift - start) / slope, np.array([slope])
        else:
            here, times, rates = _varying(stretch, where, values - shift)
        numbers.append(here.astype(np.int64))
        starts.append(np.maximum(times, stretch[0].begin))
        inner = rates[1:-1] if len(rates) > 2 else rates
        low, high = min(low, float(inner.min())), max(high, float(inner.max()))
    return RunPhase(np.concatenate(numbers), np.concatenate(starts), low, high, known)


def _steady(t: Floats, phase: Floats) -> bool:
    """Return whether phases follow a uniform rotation within their own noise, by their third differences."""
    if len(t) < 3:
        return True
    slope, start = np.polyfit(t - t[0], phase, 1)
    deviation = float(np.sqrt(np.mean((phase - start - slope * (t - t[0])) ** 2)))
    if len(t) < FEWEST_FOR_NOISE:
        return deviation <= STEADY
    noise = float(np.sqrt(np.mean(np.diff(phase, 3) ** 2) / 20.0))
    return deviation <= max(1e-6, NOISE_FACTOR * min(noise, LARGEST_NOISE))


def _varying(stretch: Blocks, t: Floats, phase: Floats) -> tuple[Floats, Floats, Floats]:
    """Return numbers and start times of the cycles of one stretch, and the frequencies at its blocks."""
    # Cubic through local parabolas over five blocks, which average the noise of single blocks.
    from scipy.interpolate import CubicHermiteSpline

    begin, end = stretch[0].begin, stretch[-1].end
    knots = np.concatenate([[begin], t, [end]])
    values, rates = np.empty(len(knots)), np.empty(len(knots))
    for k, at in enumerate(knots.tolist()):
        first = min(max(k - 3, 0), max(len(t) - 5, 0))
        near = slice(first, first + 5)
        _, rates[k], values[k] = np.polyfit(t[near] - at, phase[near], min(2, len(t[near]) - 1)) if len(t) > 2 else (
            0.0, *np.polyfit(t - at, phase, 1))
    keep = np.concatenate([np.diff(knots) > 0.0, [True]])
    curve = CubicHermiteSpline(knots[keep], values[keep], rates[keep])
    here = np.arange(math.ceil(values[0] / (2.0 * math.pi)), values[-1] / (2.0 * math.pi))
    times = np.interp(2.0 * math.pi * here, values[keep], knots[keep])
    for _ in range(4):
        times = np.clip(times - (curve(times) - 2.0 * math.pi * here) / curve(times, 1), begin, end)
    return here, times, rates
