"""Pulses of a tacho: edges with hysteresis, missing and extra pulses, wheels with missing teeth, and smoothed edges."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.errors import InputError, counted
from tcc_sim.tables.sampling import Spans, in_words
from tcc_sim.trajectory import Floats

_AROUND = 11
"""Intervals of which the median is the expected one."""
_PARTS = (16, 64, 256, 1024)
"""Parts into which a signal with a drifting level is cut, where no other division gives regular pulses."""
_SMOOTHED = 20_000
"""Largest number of edges that are smoothed: with more, a wheel has so many teeth that jitter does not matter."""
_FINE = 8
"""Points in an interval between two edges, between which the phase is linear."""


class Pulses(NamedTuple):
    """Teeth of a wheel that have passed.

    counts, times : (m,) numbers of teeth, not whole between edges, and times, s
    per_revolution : teeth in a revolution, those that the wheel lacks included
    holes : (k, 2) stretches in which the number of teeth is not certain, s
    notes : sentences on what was mended
    """

    counts: Floats
    times: Floats
    per_revolution: int
    holes: Spans
    notes: list[str]


def pulses_of(t: Floats, signal: Floats, pulses: int, source: str) -> Pulses:
    """Return the teeth in a tacho signal.

    Parameters
    ----------
    signal : (n,) in any unit, with `pulses` rising edges in a revolution; or, for a wheel with missing teeth, with one
        longer gap in a revolution
    source : name of the table, for errors

    Raises
    ------
    InputError
        Fewer than two edges, too few samples between edges, more than a few implausible intervals, or a wheel with
        missing teeth that `pulses` does not describe.
    """
    edges = edges_in(t, signal)
    if len(edges) < 2:
        raise InputError(f"{source}: the column tacho has {counted(len(edges), 'rising edge')} between "
                         f"{signal.min():.4g} and {signal.max():.4g}; it must have 2 or more")
    _check_sampled(t, edges, source)
    kept, steps, extra = _counted(edges)
    per_revolution, notes = _wheel(steps, pulses, source)
    broken = np.isnan(steps)
    gaps = np.zeros(len(steps), dtype=bool) if notes else steps >= 2.0
    faults = extra + int(np.count_nonzero(gaps)) + int(np.count_nonzero(broken))
    if faults > max(3, DEFAULTS.implausible * len(edges)):
        raise InputError(f"{source}: {faults} of {len(edges) - 1} intervals between the pulses of the tacho differ "
                         "from their neighbours as if pulses were missing or extra; the phase is not known")
    long = broken | (gaps & (steps > 2.0))
    whole = np.concatenate([[0.0], np.cumsum(np.where(broken, 1.0, steps))])
    mended = kept[:-1][gaps & ~long]
    if len(mended):
        notes.append(f"{counted(len(mended), 'missing pulse')} of the tacho inserted, after {_at(mended)}")
    if extra:
        lost = np.setdiff1d(edges, kept)
        notes.append(f"{counted(extra, 'extra pulse')} of the tacho left out, at {_at(lost)}")
    holes = np.stack([kept[:-1][long], kept[1:][long]], axis=1)
    if len(holes):
        notes.append(f"the tacho has no plausible pulses from {in_words(holes)}")
    counts, times = _smooth(whole, kept, long, notes)
    return Pulses(counts, times, per_revolution, holes, notes)


def _at(times: Floats) -> str:
    """Return some times in words."""
    return ", ".join(f"{x:.6g} s" for x in times[:3].tolist()) + (" and later" if len(times) > 3 else "")


def edges_in(t: Floats, signal: Floats) -> Floats:
    """Return the times of the rising edges, at the middle of the signal's local range, with hysteresis.

    Levels are those of the signal around an edge, so that offset and amplitude may drift; single spikes do not count.
    """
    few = max(3, len(signal) // 2000)
    ordered = np.partition(signal, [few - 1, len(signal) - few])
    low, high = ordered[few - 1], ordered[len(signal) - few]
    if not high > low:
        return np.empty(0)
    tried = [_edges(t, (signal - 0.5 * (low + high)) / (high - low))]
    around = 8.0 * np.median(np.diff(tried[0])) / np.median(np.diff(t)) if len(tried[0]) >= 8 else np.inf
    for length in (around, *(len(signal) / parts for parts in _PARTS)):
        if 16 <= length <= len(signal) / 3:
            tried.append(_edges(t, _levelled(signal, int(length), float(high - low))))
            if _regular(tried[-1]) > 1.0 - DEFAULTS.implausible:
                break
    return max(tried[::-1], key=_regular)


def _regular(edges: Floats) -> float:
    """Return the share of the intervals between edges that are about as long as the one before."""
    steps = np.diff(edges)
    return float(np.mean(np.abs(np.diff(np.log(steps))) < DEFAULTS.plausible)) if len(steps) > 2 else 0.0


def _levelled(signal: Floats, length: int, whole: float) -> Floats:
    """Return the signal about its local middle, relative to its local range, by blocks of `length` samples."""
    from scipy.ndimage import median_filter

    parts = np.array_split(signal, len(signal) // length)
    low, high = (median_filter(np.array([f(part) for part in parts]), 5, mode="nearest") for f in (np.min, np.max))
    middle = np.cumsum([len(part) for part in parts]) - 0.5 * len(parts[0])
    n = np.arange(len(signal))
    low, high = np.interp(n, middle, low), np.interp(n, middle, high)
    levelled: Floats = (signal - 0.5 * (low + high)) / np.maximum(high - low, 0.05 * whole)
    return levelled


def _edges(t: Floats, x: Floats) -> Floats:
    """Return the times of the rising crossings of 0 by a signal that goes from below a band to above it."""
    side = np.where(x > DEFAULTS.hysteresis, 1, np.where(x < -DEFAULTS.hysteresis, -1, 0))
    sure = np.flatnonzero(side)
    rising = sure[1:][(side[sure[1:]] == 1) & (side[sure[:-1]] == -1)]
    zero = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    at = zero[np.searchsorted(zero, rising) - 1] if len(zero) else zero
    edges: Floats = t[at] + (t[at + 1] - t[at]) * x[at] / (x[at] - x[at + 1])
    return edges


def _check_sampled(t: Floats, edges: Floats, source: str) -> None:
    """Raise InputError if edges follow each other too fast for the samples."""
    step, intervals = float(np.median(np.diff(t))), np.diff(edges)
    width = min(len(intervals), 20)
    means = np.convolve(intervals, np.ones(width) / width, mode="valid") / step
    if means.min() < DEFAULTS.samples_per_pulse:
        k = int(means.argmin())
        raise InputError(f"{source}: the tacho has a pulse every {means[k]:.3g} samples at {edges[k]:.6g} s; at least "
                         f"{DEFAULTS.samples_per_pulse:g} are needed, so it was sampled too slowly for its pulses")


def _counted(edges: Floats) -> tuple[Floats, Floats, int]:
    """Return the plausible edges, the teeth from each to the next (NaN where that is not certain), and how many edges
    are extra.
    """
    from scipy.ndimage import median_filter

    intervals = np.diff(edges)
    usual = median_filter(intervals, min(_AROUND, len(intervals) // 2 * 2 + 1), mode="nearest")
    if np.abs(intervals / usual - 1.0).max() <= DEFAULTS.plausible:
        return edges, np.ones(len(intervals)), 0
    kept, steps, k = [0], [], 0
    while k + 1 < len(edges):
        expected, j = usual[min(k, len(usual) - 1)], k + 1
        while j + 1 < len(edges) and (edges[j] - edges[k] < (1.0 - DEFAULTS.plausible) * expected or abs(
                edges[j + 1] - edges[k] - expected) < abs(edges[j] - edges[k] - expected)):
            j += 1
        ratios = [(edges[j] - edges[k]) / usual[min(i, len(usual) - 1)] for i in (max(k - 1, 0), j)]
        whole = max(round(0.5 * sum(ratios)), 1)
        sure = all(abs(ratio - whole) <= DEFAULTS.plausible for ratio in ratios)
        kept.append(j)
        steps.append(float(whole) if sure else np.nan)
        k = j
    return edges[kept], np.array(steps), len(edges) - len(kept)


def _wheel(steps: Floats, pulses: int, source: str) -> tuple[int, list[str]]:
    """Return the teeth in a revolution, and the sentence on a wheel with missing teeth, if it is one.

    Its gap comes once in a revolution; `pulses` may be its teeth with or without the missing ones.
    """
    gaps, counts = np.flatnonzero(steps >= 2.0), np.cumsum(np.nan_to_num(steps, nan=1.0))
    if len(gaps) < 3:
        return pulses, []
    apart = np.diff(counts[gaps])
    teeth, missing = int(np.median(apart)), int(np.median(steps[gaps])) - 1
    if np.mean(apart == teeth) < 0.9 or len(gaps) < 0.5 * counts[-1] / teeth:
        return pulses, []
    if pulses not in (teeth, teeth - missing):
        raise InputError(f"{source}: the tacho shows a wheel of {teeth} teeth of which {missing} are missing, and "
                         f"--pulses is {pulses}; give --pulses {teeth}")
    return teeth, [f"the tacho shows a wheel of {teeth} teeth of which {missing} are missing; they were inserted"]


def _smooth(counts: Floats, times: Floats, broken: NDArray[np.bool_], notes: list[str]) -> tuple[Floats, Floats]:
    """Return counts and times with a few points between edges, from smoothing splines between the breaks."""
    from scipy.interpolate import CubicSpline, make_smoothing_spline

    cuts = [0, *(np.flatnonzero(broken) + 1).tolist(), len(times)]
    out_counts, out_times, moved = [], [], [0.0]
    for a, b in pairwise(cuts):
        n, at = counts[a:b], times[a:b]
        smoothed = at
        if 12 <= len(at) <= _SMOOTHED:
            smoothed = np.asarray(make_smoothing_spline(n - n[0], at - at[0])(n - n[0])) + at[0]
            if not (np.diff(smoothed) > 0.0).all():
                smoothed = at
        if len(at) > 1:
            moved.append(float(np.sqrt(np.mean((smoothed - at) ** 2)) / np.median(np.diff(at))))
        fine = np.unique(np.concatenate([n + k / _FINE * np.append(np.diff(n), 0.0) for k in range(_FINE)]))
        if len(at) >= 4:
            dense = np.asarray(CubicSpline(n, smoothed)(fine))
            if not (np.diff(dense) > 0.0).all():
                fine, dense = n, smoothed
        else:
            fine, dense = n, smoothed
        out_counts.append(fine)
        out_times.append(dense)
    if max(moved) > DEFAULTS.jittery:
        notes.append(f"edges of the tacho jitter by {100.0 * max(moved):.2g} % of their distance (rms); they were "
                     "smoothed")
    counts, times = np.concatenate(out_counts), np.concatenate(out_times)
    rising = np.concatenate([[True], np.diff(times) > 0.0])
    return counts[rising], times[rising]
