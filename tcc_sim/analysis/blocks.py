"""Verdicts on many runs of one length at once: those of `summary` and `periodicity`, point for point.

Operations on arrays judge all runs together. A run that grows or has not settled is judged alone, by the functions for
a single run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcc_sim.analysis import periodicity as one
from tcc_sim.analysis.periodicity import Periodicity
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.summary import Known, slip_grows, sums_from
from tcc_sim.trajectory import Cycles, Floats


def known_of(runs: Sequence[Cycles], seconds: Sequence[float]) -> list[Known | None]:
    """Return what `summarise_cycles` needs to know of runs with the same number of cycles, which last so many seconds;
    None for all where one of them is not finite or has no loads.
    """
    section = np.array([run.section for run in runs])
    high, low, stick = (np.array([getattr(run, name) for run in runs]) for name in ("highest", "lowest", "stick_time"))
    whole = np.isfinite(section).all() and np.isfinite(high + low + stick).all()
    if not whole or any(run.loads is None for run in runs):
        return [None] * len(runs)
    loads = np.array([run.loads.columns() for run in runs if run.loads is not None])
    away = [maybe and slip_grows(run) for maybe, run in zip(_slips_at_the_end(high, low, stick), runs)]
    found = _periodicities(section / _sizes_of(section, high, low)[:, None], DEFAULTS.tolerance)
    highest, lowest, stuck = high.max(axis=1).tolist(), low.min(axis=1).tolist(), stick.sum(axis=1).tolist()
    energy, breakaways = loads[:, 0].sum(axis=1).tolist(), loads[:, 4].sum(axis=1).tolist()
    heat = loads[:, 5].sum(axis=1).tolist()
    rest = loads[:, 1].max(axis=1).tolist(), loads[:, 2].max(axis=1).tolist(), loads[:, 3].min(axis=1).tolist()
    return [Known(grows, own, sums_from(top, bottom, stuck_in, lasts, sums)) for grows, own, top, bottom, stuck_in,
            lasts, sums in zip(away, found, highest, lowest, stuck, seconds, zip(energy, *rest, breakaways, heat))]


def _slips_at_the_end(high: Floats, low: Floats, stick: Floats) -> list[bool]:
    """Return whether the last ninth of the cycles of each run slips in one direction, without which none runs away."""
    last = max(high.shape[1] // 9, 1) * 3
    slips = (high[:, -last:] * low[:, -last:] > 0.0) & (stick[:, -last:] == 0.0)
    found: list[bool] = slips.all(axis=1).tolist()
    return found


def _sizes_of(section: Floats, high: Floats, low: Floats) -> Floats:
    """Return `sizes_of` for every run."""
    v, angle, w = np.abs(section).max(axis=1).T
    speed = np.maximum.reduce([v, w, np.abs(high).max(axis=1), np.abs(low).max(axis=1)])
    fast, far = np.maximum(speed, 1e-6 * angle), np.maximum(angle, 1e-6 * speed)
    fast, far = np.where(fast == 0.0, 1.0, fast), np.where(far == 0.0, 1.0, far)
    return np.stack([fast, far, fast], axis=1)


def _periodicities(points: Floats, tolerance: float) -> list[Periodicity]:
    """Return the repetition of every run's points, (runs, points, 3), in units of the motion's size."""
    count = points.shape[1]
    most = one.longest_tried(count)
    if most < 1:
        return [one.of_points(own, most, tolerance) for own in points]
    changes = np.abs(points[:, -1:] - points[:, -1 - most:-1][:, ::-1]).max(axis=2)
    found: list[Periodicity | None] = [None] * len(points)
    open_, settled = np.arange(len(points)), changes <= tolerance
    for period in range(1, most + 1):
        near = open_[settled[open_, period - 1]]
        if not len(near):
            continue
        tail = points[near, count - one.repeats_of(count, period) * period:].reshape(len(near), -1, period, 3)
        repeats = np.abs(tail.max(axis=1) - tail.min(axis=1)).max(axis=(1, 2)) <= tolerance
        near = near[repeats]
        if len(near):
            calm = _at_rest(points[near], period, tolerance)
            change = np.abs(points[near, -period:] - points[near, -2 * period:-period]).max(axis=(1, 2)).tolist()
            for k, still, size in zip(near.tolist(), calm, change):
                alone = not still or any(one.may_vanish(points[k], q, period, tolerance) for q in one.divisors(period))
                found[k] = one.of_points(points[k], most, tolerance) if alone else Periodicity(period, True, size, most)
            open_ = np.setdiff1d(open_, near, assume_unique=True)
    return [own if own is not None else one.of_points(points[k], most, tolerance) for k, own in enumerate(found)]


def _at_rest(points: Floats, period: int, tolerance: float) -> list[bool]:
    """Return for which runs the last third's differences of points a period apart are too small to grow."""
    size = np.abs(points[:, period:] - points[:, :-period]).max(axis=2)
    width = size.shape[1] // 3 // period * period
    found: list[bool] = (size[:, size.shape[1] - max(width, 1):].max(axis=1) <= 0.01 * tolerance).tolist()
    return found
