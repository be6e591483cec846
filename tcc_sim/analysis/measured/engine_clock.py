"""Start times of the engine cycles of a run: from the scene, from the phases of a torque, or unknown.

Without a scene, a recorded torque is a mean, which may drift, and a strongest line A sin(phi), which is followed from
block to block of samples while the frequency drifts; engine cycle n starts at phi = 2 pi n. Between blocks the
frequency is constant, or drifts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.signals import BRIDGED_TICKS
from tcc_sim.model.parameters import System
from tcc_sim.recording.stamps import Break, StampCounter, Stamps
from tcc_sim.solvers.per_cycle import starts_of
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
class Scheduled:
    """Cycles of a frequency that is known in advance, in every run from its reset on: of a constant one at t = n cycle.

    cycle : length, s; the shortest one if they differ
    identified : False for slices of time in place of unknown cycles: they have extremes, but neither section nor period
    system : of a scene whose frequency varies in time; None without
    """

    cycle: float
    identified: bool = True
    system: System | None = None

    def stretches(self, run: int, begin: float, end: float) -> list[Stretch]:
        """Return the stretches as `EngineClock`."""
        first = math.ceil(self.cycles_until(begin) - SLACK)
        return [(first, starts_of(self.system, first, end, self.cycle))]

    def cycles_until(self, t: float) -> float:
        """Return the number of cycles from time 0 to t, s."""
        return t / self.cycle if self.system is None else float(self.system.cycles_until(t))

    def start_of(self, number: int) -> float:
        """Return the start of a cycle, s."""
        return number * self.cycle if self.system is None else float(self.system.cycle_start(number))


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


EngineClock = Scheduled | Tracked
"""Engine cycles of every run of a recording.

`cycle` is a typical length, s; `identified` is False for slices of time instead of cycles; `stretches` returns the
cycles of a run that start between two times, s, one stretch for each group of consecutive cycles.
"""


def clock_of_scene(system: System) -> EngineClock:
    """Return the engine cycles for the torque and frequency of a scene."""
    return Scheduled(system.cycle, system=None if system.profile is None else system)


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


SHORTEST_OPENING = 1 << 8
"""Samples from which the line is found before it is followed; the shortest stretch that shows it serves."""
LONGEST_OPENING = 1 << 14  # The most of them.
OPENING_CYCLES = 6.0  # Cycles of the line that such a stretch must hold.
STEEPEST = 0.12  # Largest relative change of frequency, either way, that is tried on it, 1/s.
DRIFT_COUNT = 13  # How many such changes are tried, evenly.
CYCLES_PER_BLOCK = 2  # Least size of a block, which has one phase, cycles of the line.
SAMPLES_PER_BLOCK = 32  # The same, samples.
STRONGEST_LINE = 0.2  # Part of the variance of a block, its drift apart, that the line must hold.
LARGEST_SURPRISE = 1.0  # Largest difference of a block's phase from what the blocks before it let expect, rad.
FASTEST_DRIFT = 0.3  # Largest relative change of frequency that is expected, 1/s.
LARGEST_TWIST = 0.5  # Largest difference between the phases of the halves of a block, rad.
MISSES = 2  # Blocks one after the other that may fail within a stretch.
FEWEST_BLOCKS = 4  # A run of fewer is fitted as a whole, with a constant frequency.
FEW_BLOCKS = 12  # So is a run of fewer than these where that holds as much of its variance as the blocks do.
AS_MUCH = 0.02  # Part of the variance by which these may differ.
LEAST_KNOWN = 0.25  # Part of a run in which the phase must be known.

DRIFTS = np.linspace(-STEEPEST, STEEPEST, DRIFT_COUNT)
"""Relative changes of frequency, 1/s, that are tried on the opening."""


class _Fit(NamedTuple):
    """Share of a sine in the variance beside a drifting mean, its phase lead (rad), and its amplitude."""

    share: float
    ahead: float
    amplitude: float


class PhaseTracker:
    """Phase of the torque from batches in the order of recording."""

    def __init__(self) -> None:
        self._continuity = StampCounter()
        self._runs: dict[int, list[list[tuple[Floats, Floats]]]] = {}

    def feed(self, stamp_ns: Stamps, engine_torque: Floats, run: int = 0) -> None:
        """Take the next batch of a run: stamps in ns, torques in N m."""
        finite = np.isfinite(engine_torque)
        stamp_ns, engine_torque = stamp_ns[finite], engine_torque[finite]
        for piece, preceded in self._continuity.pieces(stamp_ns, run):
            t, parts = stamp_ns[piece].astype(np.float64) * 1e-9, self._runs.setdefault(run, [])
            if not parts or not (preceded is Break.NOTHING or (
                    preceded is Break.GAP and t[0] - parts[-1][-1][0][-1] <= BRIDGED_TICKS * self.tick)):
                parts.append([])
            parts[-1].append((t, engine_torque[piece]))

    @property
    def tick(self) -> float:
        """Time between stamps, s."""
        return self._continuity.tick * 1e-9

    def runs(self) -> dict[int, RunPhase]:
        """Return the phase of every run by its number."""
        return {number: _phase_in([[np.concatenate(column) for column in zip(*part)] for part in parts])
                for number, parts in self._runs.items()}

    def longest(self) -> int:
        """Return the number of the run with the most samples, the last of several."""
        return max(self._runs, key=lambda number: (sum(len(t) for part in self._runs[number] for t, _ in part), number))


def clock_of(runs: dict[int, RunPhase]) -> Tracked | None:
    """Return the cycles of all runs; None without any."""
    lengths = [np.diff(run.starts)[np.diff(run.numbers) == 1] for run in runs.values()]
    every = np.concatenate(lengths) if lengths else np.empty(0)
    if not len(every):
        return None
    return Tracked(float(np.median(every)), {number: (run.numbers, run.starts) for number, run in runs.items()})


def _phase_in(parts: list[list[Floats]]) -> RunPhase:
    """Return the cycles of a run from times, s, and torques, N m, in parts without a gap."""
    t, torque = (np.concatenate(column) for column in zip(*parts))
    none, low, high = (np.empty(0, np.int64), np.empty(0), math.nan, math.nan), float(torque.min()), float(torque.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        return RunPhase(*none, why="the engine torque is constant")
    stretches = [stretch for part in parts for stretch in _Follower(*part).stretches]
    shares = [block.share for stretch in stretches for block in stretch]
    whole = _fitted(t, torque) if len(shares) < FEW_BLOCKS and len(t) <= LONGEST_OPENING else None
    few = len(shares) < FEWEST_BLOCKS
    if whole is not None and (few or whole[0].share >= float(np.mean(shares)) - AS_MUCH):
        stretches = [whole]
    elif few:
        return RunPhase(*none, why="the engine torque does not oscillate with one frequency, or with one that changes "
                        "by 10 % a second or less")
    known = sum(stretch[-1].end - stretch[0].begin for stretch in stretches) / float(t[-1] - t[0])
    if known < LEAST_KNOWN:
        return RunPhase(*none, why="the oscillation of the engine torque can be followed for "
                        f"{100.0 * known:.0f} % of the time only; {100.0 * LEAST_KNOWN:.0f} % or more are needed")
    return cycles_between(stretches, known)


class _Follower:
    """The stretches of samples without a gap in which the strongest line of a torque is followed."""

    def __init__(self, t: Floats, torque: Floats) -> None:
        self._t, self._torque, self._tried = t, torque, 0
        self._model: tuple[float, ...] = ()
        """Time, phase then, frequency and its rate; empty where no line is followed."""
        self._sure_until = -math.inf
        self._misses = 0
        self._stretch: Blocks = []
        self.stretches: list[Blocks] = []
        while self._follow() if self._model else self._search():
            pass
        if self._stretch and not self._misses and len(self._t):
            self._take_rest()
        self._release()

    def _search(self) -> bool:
        """Look for the line in the next samples; return whether there were more of them than before."""
        size = min(max(2 * self._tried, SHORTEST_OPENING), len(self._t))
        if size == self._tried or size < SHORTEST_OPENING // 2:
            return False
        self._tried = size
        line = _strongest_line(self._t[:size], self._torque[:size])
        if line is not None:
            frequency, drift = line
            self._model = float(self._t[0]), 0.0, frequency, drift * frequency
            count = self._block()
            ahead = _fit(self._t[:count], self._torque[:count], self._expected(self._t[:count])).ahead
            self._model = float(self._t[0]), ahead, frequency, drift * frequency
            self._sure_until, self._misses, self._tried = float(self._t[size - 1]), 0, 0
        elif size >= LONGEST_OPENING:
            self._t, self._torque, self._tried = self._t[size // 2:], self._torque[size // 2:], 0
        return True

    def _expected(self, t: Floats) -> Floats:
        at, phase, frequency, change = self._model
        return phase + (t - at) * (frequency + 0.5 * change * (t - at))

    def _block(self) -> int:
        """Return the number of samples in the next block."""
        at, _, frequency, change = self._model
        now = max(frequency + change * (float(self._t[0]) - at), 0.5 * frequency)
        end = float(self._t[0]) + CYCLES_PER_BLOCK * 2.0 * math.pi / now
        return max(int(np.searchsorted(self._t, end)), SAMPLES_PER_BLOCK)

    def _follow(self) -> bool:
        """Turn the next samples into a block; return whether there were enough."""
        count = self._block()
        if len(self._t) <= count:
            return False
        t, fit = self._t[:count], self._measured(count)
        if fit is not None:
            self._misses = 0
            self._add(fit, float(t[0]), float(self._t[count]), float(t[-1]))
            self._learn()
        else:
            self._misses += 1
            if self._misses > MISSES and float(t[0]) > self._sure_until:
                self._release()
                return True
        self._t, self._torque = self._t[count:], self._torque[count:]
        return True

    def _measured(self, count: int) -> _Fit | None:
        """Fit the line to the next samples; None if it is weak or differs from the prediction."""
        # The first block sets the phase: an opening may begin before the oscillation. The halves of a block must
        # agree: a line of another frequency may have the predicted phase in the middle.
        expected = self._expected(self._t[:count])
        fit, *halves = (_fit(self._t[part], self._torque[part], expected[part])
                        for part in (slice(0, count), slice(0, count // 2), slice(count // 2, count)))
        apart = math.remainder(halves[1].ahead - halves[0].ahead, 2.0 * math.pi)
        agrees = abs(fit.ahead) <= LARGEST_SURPRISE or not self._stretch
        agrees = agrees and abs(apart) <= LARGEST_TWIST
        return fit if fit.share >= STRONGEST_LINE and agrees else None

    def _add(self, fit: _Fit, begin: float, end: float, last: float) -> None:
        """Add a block to the stretch: its samples go from `begin` to `last`, the next block begins at `end`."""
        middle = 0.5 * (begin + last)
        phase = float(self._expected(np.array(middle))) + fit.ahead
        self._stretch.append(Block(middle, phase, fit.amplitude, fit.share, begin, end))

    def _take_rest(self) -> None:
        """Make the rest at the end a block of its own, or a part of the last block if it is short."""
        begin, last = float(self._t[0]), float(self._t[-1])
        if 2 * len(self._t) >= self._block():
            fit = self._measured(len(self._t))
            if fit is not None:
                self._add(fit, begin, last, last)
                return
        self._stretch[-1] = self._stretch[-1]._replace(end=last)

    def _learn(self) -> None:
        """Update the model from the last blocks."""
        t, phase = np.array([(block.t, block.phase) for block in self._stretch[-PHASE_MEMORY:]]).T
        at, now, (frequency, change) = float(t[-1]), float(phase[-1]), self._model[2:]
        frequency += change * (at - self._model[0])
        if len(t) > 3:
            span = at - float(t[0])
            x = (t - at) / span
            design = np.array([x * x, x, np.ones_like(x)])
            half, slope, above = np.linalg.solve(design @ design.T, design @ (phase - now)).tolist()
            change, frequency, now = 2.0 * half / (span * span), slope / span, now + above
        elif len(t) > 1:
            frequency = float(phase[-1] - phase[-2]) / float(t[-1] - t[-2]) + 0.5 * change * float(t[-1] - t[-2])
        limit = FASTEST_DRIFT * abs(frequency)
        self._model = at, now, frequency, min(max(change, -limit), limit)

    def _release(self) -> None:
        """End the stretch, without a block at either end that the oscillation fills only in part."""
        stretch = self._stretch
        if len(stretch) > MISSES:
            for end, neighbour in ((0, 1), (-1, -2)):
                if len(stretch) > 2 and stretch[end].amplitude < FULL_SIZE * stretch[neighbour].amplitude:
                    del stretch[end]
            self.stretches.append(stretch)
        self._stretch, self._model, self._misses = [], (), 0


def _fit(t: Floats, torque: Floats, phase: Floats) -> _Fit:
    """Fit a sine of this phase and a drifting mean by least squares, with the smallest factors if several fit."""
    design = np.stack([np.ones_like(t), t - t[0], np.sin(phase), np.cos(phase)], axis=1)
    factors = np.linalg.lstsq(design, torque, rcond=None)[0]
    drift = design[:, :2]
    rest, apart = torque - design @ factors, torque - drift @ np.linalg.lstsq(drift, torque, rcond=None)[0]
    variance, in_phase, ahead = float(apart @ apart), float(factors[2]), float(factors[3])
    smallest = len(t) * (1e-9 * float(np.abs(torque).max())) ** 2
    return _Fit(1.0 - float(rest @ rest) / variance if variance > smallest else 0.0, math.atan2(ahead, in_phase),
                math.hypot(in_phase, ahead))


def _strongest_line(t: Floats, torque: Floats) -> tuple[float, float] | None:
    """Return frequency (rad/s) at the start and relative drift (1/s) of the strongest line; None for none."""
    # In the time s = (t - t0) + drift (t - t0)^2/2 a drifting line is one of constant frequency.
    span, best = float(t[-1] - t[0]), (0.0, 0.0, 0.0)
    middle = t - t[0] - 0.5 * span
    for drift in DRIFTS[np.abs(DRIFTS) * span <= 1.0].tolist():
        warped = middle + 0.5 * drift * middle * middle
        even = np.linspace(warped[0], warped[-1], len(t))
        height, frequency = _strongest(even, np.interp(even, warped, torque))
        if height > best[0] * (1.0 + 1e-6 * (drift != 0.0)):
            best = height, frequency, drift
    _, frequency, drift = best
    if frequency * span < 2.0 * math.pi * OPENING_CYCLES:
        return None
    if _fit(t, torque, frequency * (middle + 0.5 * drift * middle * middle)).share < STRONGEST_LINE:
        return None
    return frequency * (1.0 - 0.5 * drift * span), drift


def _strongest(t: Floats, torque: Floats) -> tuple[float, float]:
    """Return height and frequency (rad/s) of the largest peak of a Hann spectrum, refined by a parabola; 0 for none.

    Samples that are not evenly spaced are joined by straight lines.
    """
    if len(t) < 16:
        return 0.0, 0.0
    even = np.linspace(t[0], t[-1], len(t))
    torque = torque if np.allclose(t, even, rtol=0.0, atol=1e-3 * (even[1] - even[0])) else np.interp(even, t, torque)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    size = 4 * (1 << (len(t) - 1).bit_length())
    spectrum = np.abs(np.fft.rfft((torque - torque.mean()) * np.hanning(len(t)), size))
    lowest = 8 * size // (2 * len(t))
    k = lowest + int(np.argmax(spectrum[lowest:]))
    if spectrum[k] <= 1e-9 * max(float(np.abs(torque).max()), 1e-300) * len(t):
        return 0.0, 0.0
    shift = 0.0
    if 0 < k < len(spectrum) - 1 and spectrum[k - 1] > 0.0 and spectrum[k + 1] > 0.0:
        a, b, c = np.log(spectrum[k - 1:k + 2])
        shift = 0.5 * (a - c) / (a - 2.0 * b + c) if a - 2.0 * b + c != 0.0 else 0.0
    return float(spectrum[k]), 2.0 * math.pi * (k + float(shift)) / (size * step)


def _fitted(t: Floats, torque: Floats) -> Blocks | None:
    """Fit a sine of constant frequency to few cycles, from 0.6 to 1.4 times the frequency of the Fourier peak."""
    from scipy.optimize import minimize_scalar

    rough = _strongest(t, torque)[1]
    if not rough:
        return None

    def left(factor: float) -> float:
        return -_fit(t, torque, factor * rough * (t - t[0])).share

    guess = min(np.linspace(0.6, 1.4, 81).tolist(), key=left)
    best = minimize_scalar(left, bounds=(guess - 0.01, guess + 0.01), method="bounded", options={"xatol": 1e-10})
    fit, ends = _fit(t, torque, float(best.x) * rough * (t - t[0])), (float(t[0]), float(t[-1]))
    if fit.share < STRONGEST_LINE:
        return None
    return [Block(at, fit.ahead + float(best.x) * rough * (at - ends[0]), fit.amplitude, fit.share, *ends)
            for at in ends]
