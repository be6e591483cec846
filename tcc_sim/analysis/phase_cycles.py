"""Engine cycles from phases that were measured in blocks: one frequency, or one that drifts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tcc_sim.recording.stamps import Stamps
from tcc_sim.trajectory import Floats

MEMORY = 6
"""Blocks from which the next phase is expected, by a parabola."""
FULL_SIZE = 0.7
"""Part of the amplitude of the next block that the first of a stretch must have, and the last of the one before it."""
STEADY, NOISE = 0.02, 3.0
"""Rms deviation of the phases from uniform rotation, rad, up to which a frequency is constant, and in units of their
own noise."""
FEWEST_FOR_NOISE, LARGEST_NOISE = 6, 0.17
"""Blocks from which their noise can be told, and the largest, rad, that a constant frequency may have."""


class Block(NamedTuple):
    """A phase (rad) with the middle of its block, s, its amplitude (N m), the part of the variance that the line holds,
    and where the block begins and ends, s.
    """

    t: float
    phase: float
    amplitude: float
    share: float
    begin: float
    end: float


Stretch = list[Block]
"""Blocks that follow each other."""


def trim(stretch: Stretch) -> None:
    """Leave out a block at either end that the oscillation fills in part only."""
    for end, beside in ((0, 1), (-1, -2)):
        if len(stretch) > 2 and stretch[end].amplitude < FULL_SIZE * stretch[beside].amplitude:
            del stretch[end]


@dataclass(frozen=True)
class RunPhase:
    """What a run comes to: when its cycles start, or why nobody knows.

    numbers, starts : as Tracked has them
    low, high : smallest and largest frequency, rad/s; equal where it is constant
    known : part of the run in which they are known
    why : a sentence where there are none
    """

    numbers: Stamps
    starts: Floats
    low: float
    high: float
    known: float = 0.0
    why: str = ""


def cycles_between(stretches: list[Stretch], known: float) -> RunPhase:
    """A run's cycles from its stretches, the `known` part of it, whose phases are first made to follow each other."""
    blocks = [(np.array([b.t for b in s]), np.array([b.phase for b in s])) for s in stretches]
    t, phase = blocks[0]
    for number, (later, ahead) in enumerate(blocks[1:], 1):
        steady = _steady(t, phase)
        tail = slice(0, None) if steady else slice(-MEMORY, None)
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
            found, rates = t[0] + (2.0 * math.pi * here + shift - start) / slope, np.array([slope])
        else:
            here, found, rates = _varying(stretch, where, values - shift)
        numbers.append(here.astype(np.int64))
        starts.append(np.maximum(found, stretch[0].begin))
        inner = rates[1:-1] if len(rates) > 2 else rates
        low, high = min(low, float(inner.min())), max(high, float(inner.max()))
    return RunPhase(np.concatenate(numbers), np.concatenate(starts), low, high, known)


def _steady(t: Floats, phase: Floats) -> bool:
    """Whether phases follow a uniform rotation as well as their own noise lets them, which third differences tell."""
    if len(t) < 3:
        return True
    slope, start = np.polyfit(t - t[0], phase, 1)
    deviation = float(np.sqrt(np.mean((phase - start - slope * (t - t[0])) ** 2)))
    if len(t) < FEWEST_FOR_NOISE:
        return deviation <= STEADY
    noise = float(np.sqrt(np.mean(np.diff(phase, 3) ** 2) / 20.0))
    return deviation <= max(1e-6, NOISE * min(noise, LARGEST_NOISE))


def _varying(stretch: Stretch, t: Floats, phase: Floats) -> tuple[Floats, Floats, Floats]:
    """Numbers and times of the cycles of one stretch, and frequencies at its blocks."""
    # The phase is the cubic through local parabolas over five blocks, which carry no noise of single ones.
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
    found = np.interp(2.0 * math.pi * here, values[keep], knots[keep])
    for _ in range(4):
        found = np.clip(found - (curve(found) - 2.0 * math.pi * here) / curve(found, 1), begin, end)
    return here, found, rates
