"""Verdicts on many runs of one length at once: those of `summary` and `periodicity`, point for point.

Operations on arrays judge all runs together. A run that grows or has not settled is judged alone, by the functions for
a single run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcc_sim.analysis.periodicity import Periodicity, longest_tried, of_points
from tcc_sim.analysis.repetition import repetitions
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
    most = longest_tried(section.shape[1])
    points = section / _sizes_of(section, high, low)[:, None]
    periodicities = ([Periodicity(*own, most) for own in repetitions(points, most, DEFAULTS.tolerance)] if most else
                     [of_points(own, most, DEFAULTS.tolerance) for own in points])
    highest, lowest, stuck = high.max(axis=1).tolist(), low.min(axis=1).tolist(), stick.sum(axis=1).tolist()
    energy, breakaways = loads[:, 0].sum(axis=1).tolist(), loads[:, 4].sum(axis=1).tolist()
    heat = loads[:, 5].sum(axis=1).tolist()
    rest = loads[:, 1].max(axis=1).tolist(), loads[:, 2].max(axis=1).tolist(), loads[:, 3].min(axis=1).tolist()
    return [Known(grows, own, sums_from(top, bottom, stuck_in, lasts, sums)) for grows, own, top, bottom, stuck_in,
            lasts, sums in zip(away, periodicities, highest, lowest, stuck, seconds,
                               zip(energy, *rest, breakaways, heat))]


def _slips_at_the_end(high: Floats, low: Floats, stick: Floats) -> list[bool]:
    """Return whether the last ninth of the cycles of each run slips in one direction, without which none runs away."""
    last = max(high.shape[1] // 9, 1) * 3
    slips = (high[:, -last:] * low[:, -last:] > 0.0) & (stick[:, -last:] == 0.0)
    slipping: list[bool] = slips.all(axis=1).tolist()
    return slipping


def _sizes_of(section: Floats, high: Floats, low: Floats) -> Floats:
    """Return `sizes_of` for every run."""
    v, angle, w = np.abs(section).max(axis=1).T
    speed = np.maximum.reduce([v, w, np.abs(high).max(axis=1), np.abs(low).max(axis=1)])
    fast, far = np.maximum(speed, 1e-6 * angle), np.maximum(angle, 1e-6 * speed)
    fast, far = np.where(fast == 0.0, 1.0, fast), np.where(far == 0.0, 1.0, far)
    return np.stack([fast, far, fast], axis=1)
