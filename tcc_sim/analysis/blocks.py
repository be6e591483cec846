"""Verdicts on many runs of one length at once: those of `summary` and `periodicity`, point for point.

Operations on arrays and one compiled call judge all runs together; a run whose slip may grow is judged alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tcc_sim.analysis.periodicity import Periodicity, drifts, finely_repeated, longest_tried, of_points
from tcc_sim.analysis.repetition import repetitions
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.summary import Span, Summary, section_of, slip_grows, sums_from, without_section
from tcc_sim.trajectory import Floats, Runs


def summaries_of(runs: Runs, cycles: Sequence[float], first: Sequence[int],
                 dropped: int) -> tuple[list[Summary], list[Floats]]:
    """Return the summaries that `summarise_cycles` gives of runs, all of them done and with loads, without their
    section; and the section, (n, 3) arrays of slip speed, plate angle and plate speed.

    cycles, first : (m,) length of an engine cycle of each run, s, and the number of its first cycle
    dropped : number of cycles dropped before
    """
    section, high, low, stick = runs.section, runs.highest, runs.lowest, runs.stick_time
    assert runs.loads is not None
    count = high.shape[1]
    away = [maybe and slip_grows(runs.cycles(k)) for k, maybe in enumerate(_slips_at_the_end(high, low, stick))]
    most = longest_tried(count + 1)
    points = section / _sizes_of(section, high, low)[:, None]
    repeating = ([Periodicity(*each, most) for each in repetitions(points, most, DEFAULTS.tolerance)] if most else
                 [of_points(each, most, DEFAULTS.tolerance) for each in points])
    without = np.array([not each.period for each in repeating])
    drifting = without.copy()
    drifting[without] = drifts(np.maximum(np.abs(high), np.abs(low))[without])
    loads = runs.loads
    sums = zip(loads[:, 0].sum(axis=1).tolist(), loads[:, 1].max(axis=1).tolist(), loads[:, 2].max(axis=1).tolist(),
               loads[:, 3].min(axis=1).tolist(), loads[:, 4].sum(axis=1).tolist(), loads[:, 5].sum(axis=1).tolist())
    out, sections = list[Summary](), list[Floats]()
    for k, (top, bottom, stuck, each, seconds) in enumerate(zip(
            high.max(axis=1).tolist(), low.min(axis=1).tolist(), stick.sum(axis=1).tolist(), sums,
            runs.seconds.tolist())):
        since = first[k] * cycles[k]
        span = Span(since, since + count * cycles[k])
        summary = without_section(
            repeating[k], away[k], bool(drifting[k]), span, sums_from(top, bottom, stuck, span.seconds, each),
            cycles=count + dropped, dropped=dropped, solver=runs.solver, elapsed=seconds)
        out.append(summary)
        sections.append(section_of(section[k, 1:], first[k], summary.period))
    return out, sections


def confirmed_by_repetition(runs: Runs, summaries: Sequence[Summary], counts: Sequence[int]) -> list[bool]:
    """Return which runs with a settled period repeat as closely as `repeats_finely` asks, over `counts` cycles each."""
    fine = [False] * len(summaries)
    for period in {summary.period for summary in summaries if summary.settled and summary.period}:
        at = [k for k, summary in enumerate(summaries) if summary.settled and summary.period == period]
        points = runs.section[at, max(runs.section.shape[1] - counts[at[0]] - period, 0):]
        if points.shape[1] < counts[at[0]] + period:
            continue
        for k, close in zip(at, finely_repeated(points, period).tolist()):
            fine[k] = close
    return fine


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
