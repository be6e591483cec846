"""Period of a motion in engine cycles, from its stroboscopic section.

A period is stated if the section repeats with it and with no divisor of it, now or, while it still settles, in the
limit of its decay. Otherwise there is none yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.repetition import LONGEST, repetitions
from tcc_sim.trajectory import Cycles, Floats

TOLERANCE = 1e-4  # Repetition, relative to the size of the motion, that counts as settled.
FINE = 1e-8
"""Repetition of each coordinate, relative to its largest value, over cycles after which fewer need not be seen."""
DRIFT = 4.0  # Change of the largest slip speeds over a run without a period that marks a transient, in standard errors.
AFTER_A_GAP = 16
"""Least length without a gap before a period is stated after one: that of the longest, periods of excitation."""


@dataclass(frozen=True)
class Periodicity:
    """Repetition of a section.

    period : in engine cycles, 0 if none up to 16 can be stated yet
    settled : whether the section repeats within the tolerance; False for a period of the limit of a decay
    change : largest difference between the last two periods (of one cycle without a period), relative to the size of
        the motion; NaN for too few cycles
    longest : longest period that was looked for; 0 for too few cycles
    """

    period: int
    settled: bool
    change: float
    longest: int = 0


def longest_tried(points: int, maximum: int = LONGEST) -> int:
    """Return the longest period that so many section points can show, periods of excitation."""
    return min(maximum, points // 3)


def periodicity(cycles: Cycles, tolerance: float = TOLERANCE,
                maximum: int = LONGEST) -> Periodicity:
    """Return the smallest number of engine cycles after which the section repeats.

    Settled: over the last quarter of the cycles, and at least three periods, points p cycles apart stay within
    `tolerance` of one another. All of them are compared, not only neighbours, so that a slow drift does not pass.
    Settling: the differences of points p cycles apart decay like a linear map of up to three modes, and its limit is
    near and repeats after p cycles. In both cases there is no period yet if the differences of points a divisor of p
    apart may be decaying to zero, or if those p apart still grow. The size of speeds is the largest speed of the
    motion, that of angles the largest angle on the section.

    Parameters
    ----------
    cycles : consecutive engine cycles without the transient; NaN marks cycles that were not observed. Only those after
        the last gap are used, if there are at least `AFTER_A_GAP`
    tolerance : relative to the size of the motion
    maximum : longest period, engine cycles
    """
    first = _after_gap(cycles)
    points = _scaled(cycles, first)
    return of_points(points, longest_tried(len(points), maximum) if not first or enough_after_a_gap(cycles) else 0,
                     tolerance)


def of_points(points: Floats, most: int, tolerance: float) -> Periodicity:
    """Return the repetition of section points, (n, 3), in units of the motion's size, with a period of at most `most`.
    """
    if len(points) < 2 or most < 1:
        return Periodicity(0, False, _largest(points[-1] - points[-2]) if len(points) > 1 else math.nan)
    return Periodicity(*repetitions(points[None], most, tolerance)[0], most)


def cycles_drift(cycles: Cycles) -> bool:
    """Return whether the largest slip speeds of cycles without a period still grow or decay (`drifts`)."""
    return bool(drifts(cycles.largest[np.isfinite(cycles.largest)][None])[0])


def drifts(largest: Floats) -> NDArray[np.bool_]:
    """Return whether the largest slip speeds of each run, (m, N), still grow or decay.

    The means over their quarters change in one direction, in all by more than `DRIFT` standard errors, which
    is rare for a torus or chaos, and by more than the tolerance. Too few cycles for quarters count as a drift.
    """
    runs, width = len(largest), largest.shape[1] // 4
    if width < 2:
        return np.ones(runs, np.bool_)
    quarters = largest[:, largest.shape[1] - 4 * width:].reshape(runs, 4, width)
    means, error = quarters.mean(axis=2), np.sqrt(quarters.var(axis=2).mean(axis=1) * 2.0 / width)
    change: Any = np.diff(means, axis=1)
    least = np.maximum(DRIFT * error, TOLERANCE * largest.max(axis=1))
    out: NDArray[np.bool_] = (np.abs(change.sum(axis=1)) > least) & (
        (change > 0.0).all(axis=1) | (change < 0.0).all(axis=1))
    return out


def enough_after_a_gap(cycles: Cycles) -> bool:
    """Return whether enough cycles follow the last gap; fewer may repeat by chance."""
    first = _after_gap(cycles)
    return first == 0 or len(cycles) - first >= AFTER_A_GAP


def _after_gap(cycles: Cycles) -> int:
    """Return the number of the first cycle after the last gap; 0 without a gap."""
    observed = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest)
    return 0 if observed.all() else int(np.flatnonzero(~observed)[-1]) + 1


def stays(cycles: Cycles, further: Cycles, period: int, tolerance: float = TOLERANCE) -> bool:
    """Return whether the section of further cycles stays within `tolerance` of the last period before."""
    last = cycles.section[len(cycles.section) - period:]
    apart = further.section - last[(np.arange(len(further.section)) - 1) % period]
    apart /= sizes_of(cycles.section, cycles.highest, cycles.lowest)
    return bool(np.abs(apart).max() <= tolerance)


def repeats_finely(cycles: Cycles, period: int, count: int) -> bool:
    """Return whether the last `count` cycles repeat so closely that 0.4 `count` further ones stay within the tolerance.

    A difference that grew from rounding to `fine` in so many cycles needs more cycles to leave.
    """
    points = cycles.section[-count - period:]
    return len(points) == count + period and bool(finely_repeated(points[None], period)[0])


def finely_repeated(points: Floats, period: int) -> NDArray[np.bool_]:
    """Return whether the points of each run, (m, n, 3), repeat after a period within `FINE` of their size."""
    apart = np.abs(points[:, period:] - points[:, :-period]).max(axis=1)
    out: NDArray[np.bool_] = (apart <= FINE * np.abs(points).max(axis=1)).all(axis=1)
    return out


def _scaled(cycles: Cycles, first: int) -> Floats:
    """Return the section points from cycle `first` on, (n, 3), in units of the motion's size."""
    points = cycles.section[first:]
    finite = np.isfinite(points)
    if not finite.all():
        points = points[int(np.flatnonzero(~finite.all(axis=1))[-1]) + 1:]
    if not len(points):
        return points
    return points / sizes_of(points, cycles.highest[first:], cycles.lowest[first:])


def sizes_of(points: Floats, *speeds: Floats) -> Floats:
    """Return the size of a motion: of slip and plate speed the largest speed, of angles the largest on the section.

    Neither is below 1e-6, in s or 1/s, of the other: at rest the speeds are rounding errors.
    """
    v, angle, w = np.abs(points).max(axis=0).tolist() if len(points) else (0.0, 0.0, 0.0)
    speed = max(v, w, *map(_largest, speeds))
    fast, far = max(speed, 1e-6 * angle) or 1.0, max(angle, 1e-6 * speed) or 1.0
    return np.array([fast, far, fast])


def _largest(x: Floats) -> float:
    """Return the largest magnitude, 0 for an empty array."""
    return float(np.abs(x).max()) if x.size else 0.0
