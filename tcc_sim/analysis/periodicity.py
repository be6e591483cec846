"""The period of a motion in engine cycles, found on its stroboscopic section and confirmed on further cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tcc_sim.trajectory import Cycles

MAXIMUM_PERIOD = 16
TOLERANCE = 1e-4
"""Repetition, relative to the size of the motion, that counts as settled."""
WINDOWS = 6
"""The kept cycles are cut into as many windows to see whether the section still settles geometrically."""
CONVERGING_CHANGE = 0.05
"""Largest change over a period, relative to the size of the motion, at the end of a run that still settles."""
CONVERGING_DISTANCE = 0.1
"""Largest distance that such a run may have left to its limit, relative to the size of the motion."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Periodicity:
    """The repetition of a section.

    period : in engine cycles, 0 where none up to 16 is found
    settled : whether the section repeats within the tolerance; a period that is found while the section still
        converges geometrically is not settled
    change : largest difference between the last two periods (of one cycle where there is no period), relative to the
        size
        of the motion; NaN where there are too few cycles
    """

    period: int
    settled: bool
    change: float


def periodicity(cycles: Cycles, tolerance: float = TOLERANCE, maximum: int = MAXIMUM_PERIOD) -> Periodicity:
    """The smallest number of engine cycles after which the section repeats.

    A period p is accepted in two ways. Settled: over the last quarter of the cycles, and at least three periods, points
    that are p cycles apart stay within `tolerance` of one another; a slow drift does not pass, since all of them are
    compared and not only neighbours. Converging: the change over p cycles shrinks geometrically through the run, is
    small at its end, and the motion has a small distance left to its limit. Speeds are measured by the largest speed of
    the motion and angles by the largest angle on the section.

    Parameters
    ----------
    cycles : consecutive engine cycles, the transient dropped; NaN marks cycles that were not observed, and only those
        after the last gap are looked at
    tolerance : relative to the size of the motion
    maximum : longest period looked for, engine cycles
    """
    points = _scaled(cycles)
    for period in range(1, maximum + 1):
        if len(points) < 3 * period:
            break
        repeats = max(3, len(points) // 4 // period)
        tail = points[len(points) - repeats * period:].reshape(repeats, period, -1)
        change = _largest(tail[-1] - tail[-2])
        if _largest(tail.max(axis=0) - tail.min(axis=0)) <= tolerance:
            shorter = _fading_to(points, period)
            if shorter:
                return Periodicity(shorter, False, _largest(points[-1] - points[-1 - shorter]))
            return Periodicity(period, True, change)
        if _converges(points, period):
            return Periodicity(period, False, change)
    return Periodicity(0, False, _largest(points[-1] - points[-2]) if len(points) > 1 else math.nan)


def _converges(points: Floats, period: int) -> bool:
    """Whether the change over one period shrinks geometrically, to a limit that is near."""
    change = np.abs(points[period:] - points[:-period]).max(axis=1)
    width = len(change) // WINDOWS // period * period
    if width < 3:
        return False
    largest = change[len(change) - WINDOWS * width:].reshape(WINDOWS, width).max(axis=1)[1:]
    last = float(largest[-1])
    if last <= 0.0 or last > CONVERGING_CHANGE or last > float(largest.min()):
        return False
    k = np.arange(len(largest))
    logs = np.log(largest)
    slope, start = np.polyfit(k, logs, 1)
    decay = -float(slope) * (len(k) - 1)
    if decay < 0.5 or float(np.std(logs - (start + slope * k))) > 0.15 * max(1.0, decay):
        return False
    # A spiral or an alternation goes nowhere while it shrinks: what counts is the net way of the last window.
    way = _largest(points[-1] - points[-1 - width])
    return way * math.exp(float(slope)) / -math.expm1(float(slope)) <= CONVERGING_DISTANCE


def _fading_to(points: Floats, period: int) -> int:
    """A divisor of a period whose repetition only seems settled: what tells the two apart shrinks, to less than half;
    or 0.

    A slow alternation that dies out repeats after two cycles within any tolerance that is wider than its decay. The
    limit of its size over three windows is that of A. C. Aitken's delta-squared process.
    """
    for shorter in [q for q in range(1, period) if period % q == 0]:
        size = np.abs(points[shorter:] - points[:-shorter]).max(axis=1)
        width = len(size) // 3 // period * period
        if width == 0:
            continue
        a, b, c = (float(size[len(size) - (3 - i) * width:][:width].max()) for i in range(3))
        if c < b < a and (b - c) < (a - b) and c - (b - c) ** 2 / ((a - b) - (b - c)) < 0.5 * c:
            return shorter
    return 0


def _scaled(cycles: Cycles) -> Floats:
    """The section points after the last unobserved cycle, (n, 3), in units of the motion's size."""
    whole = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest)
    broken = np.flatnonzero(~whole)
    first = int(broken[-1]) + 1 if len(broken) else 0
    points = cycles.section[first:]
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        points = points[int(np.flatnonzero(~finite)[-1]) + 1:]
    if not len(points):
        return points
    speed = max(_largest(cycles.highest[first:]), _largest(cycles.lowest[first:]), _largest(points[:, [0, 2]]))
    angle = max(_largest(points[:, 1]), 1e-6 * speed)
    scaled: Floats = points / np.array([speed or 1.0, angle or 1.0, speed or 1.0])
    return scaled


def _largest(x: Floats) -> float:
    """Largest magnitude, 0 for none."""
    return float(np.abs(x).max()) if x.size else 0.0
