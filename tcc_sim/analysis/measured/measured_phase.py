"""Signals in a table of measurements, and the phase of the excitation: from engine speed, tacho pulses, or the engine
torque.

Each reference is checked by itself, mended where that is certain, and compared with the strongest line of the torque.
Pulses of a tacho have edges with hysteresis; pulses may be missing or extra, wheels may lack teeth, and edges are
smoothed. Signals are interpolated within the stretches that the table covers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.engine_clock import PhaseTracker, RunPhase
from tcc_sim.analysis.measured.signals import DRIVEN, Signals, driven_orders
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import System
from tcc_sim.tables.chosen_columns import REFERENCES
from tcc_sim.tables.measured_table import MeasuredTable, longest_part
from tcc_sim.tables.sampling import Spans, in_words, merged
from tcc_sim.topics import FAR_END
from tcc_sim.trajectory import Floats, integral

BRIDGED_HOLE = 0.0625  # Longest hole of a table that a cubic bridges, periods of excitation.
HYSTERESIS = 0.2  # Level above and below the middle of a tacho's range that an edge must pass, relative to the range.
SAMPLES_PER_PULSE = 3.5  # Samples from pulse to pulse that a tacho must have.
PLAUSIBLE = 0.25  # Largest deviation of an interval between pulses from its neighbours, relative.
IMPLAUSIBLE = 0.02  # Largest share of pulses that may be missing or extra.
JITTERY = 0.005  # Jitter of pulses from which on a sentence names it, relative to their distance.
JUMP = 0.2  # Largest change of an engine speed from row to row, relative.
LOST_SPEED = 0.25  # Largest share of rows in which an engine speed may be implausible.
BRIDGED_PHASE = 0.1
"""Uncertainty of the phase across rows without a plausible speed up to which they are bridged, periods of excitation.
"""
SHARP = 0.2  # Share of a torque's variance in its strongest line that makes the line certain.
AGREEMENT = 0.01  # Largest deviation of that line from a multiple of the excitation, relative.

UNITS_BY_RATIO = {30.0 / math.pi: "rpm", 0.5 / math.pi: "hz", 180.0 / math.pi: "deg/s"}
"""Units in which an engine speed may be by mistake, by the ratio of its numbers to those in rad/s."""
MOST_POINTS = 1 << 17  # Largest number of points of the torque in which its strongest line is looked for.
_AROUND = 11  # Intervals of which the median is the expected one.
_PARTS = (16, 64, 256, 1024)
"""Parts into which a signal with a drifting level is cut, where no other division gives regular pulses."""
_SMOOTHED = 20_000
"""Largest number of edges that are smoothed: with more, a wheel has so many teeth that jitter does not matter."""
_FINE = 8  # Points in an interval between two edges, between which the phase is linear.


@dataclass(frozen=True)
class MeasuredPhase:
    """Periods of the excitation passed, known at some times.

    turns, times : (m,) ascending, s
    holes : (k, 2) stretches of time across which the number of periods is not certain, s
    notes : sentences on what was mended
    """

    turns: Floats
    times: Floats
    holes: Spans
    notes: tuple[str, ...] = ()

    @property
    def when(self) -> Callable[[Floats], Floats]:
        """Function from periods of the excitation to times, s."""
        return lambda turns: np.interp(turns, self.turns, self.times)


def measured_phase(table: MeasuredTable, order: float = 1.0, pulses: int | None = None) -> MeasuredPhase:
    """Return the phase of the excitation in a table, from the first of these columns.

    engine_speed : of the crankshaft, rad/s, with `order` periods of the excitation in a revolution
    tacho : signal with `pulses` rising edges in a revolution (None: 1)
    engine_torque : its strongest line is the excitation

    Raises InputError: none of these columns; more than one of `pulses` for another column than tacho; one without
    rotation, or that is implausible; or a speed or tacho that contradicts the torque's strongest line.
    """
    source = table.source
    references = [name for name in (*REFERENCES, "engine_torque")
                  if name in table.columns and np.isfinite(table.columns[name]).any()]
    if not references:
        raise InputError(f"{source}: orders need one of the columns {', '.join(REFERENCES)}, engine_torque, which tell "
                         "the phase of the excitation")
    if pulses not in (None, 1) and references[0] != "tacho":
        raise InputError(f"{source}: the phase is that of the column {references[0]}; --pulses {pulses} is for a tacho")
    t, values = table.filled(references[0])
    if len(t) < 4:
        raise InputError(f"{source}: the column {references[0]} has {counted(len(t), 'value')}; 4 or more are needed")
    if references[0] == "engine_speed":
        phase = _phase_of_speed(t, values, source, order)
    elif references[0] == "tacho":
        phase = _phase_of_pulses(t, values, source, order, pulses or 1)
    else:
        phase = _phase_of_torque(t, values, source)
    holes = merged(np.concatenate([phase.holes, long_holes(table.holes(references[0]), phase.turns, phase.times)]))
    phase = replace(phase, holes=holes, notes=tuple(f"{source}: {note}" for note in phase.notes))
    return phase if references[0] == "engine_torque" else _agreeing(table, phase, references[0], order, pulses or 1)


def long_holes(holes: Spans, turns: Floats, times: Floats) -> Spans:
    """Return the holes longer than `BRIDGED_HOLE`, and those that the phase does not cover."""
    begin, end = (np.interp(holes[:, k], times, turns) for k in (0, 1))
    inside = (holes[:, 0] >= times[0]) & (holes[:, 1] <= times[-1])
    return np.asarray(holes[(end - begin > BRIDGED_HOLE) | ~inside])


def _tracked(t: Floats, torque: Floats) -> RunPhase:
    """Return the phase of the strongest line of a torque."""
    tracker = PhaseTracker()
    tracker.feed(np.rint(t * 1e9).astype(np.int64), torque)
    return tracker.runs()[0]


def _phase_of_torque(t: Floats, torque: Floats, source: str) -> MeasuredPhase:
    """Return the phase of the strongest line of a torque; raise InputError without one."""
    tracked = _tracked(t, torque)
    if len(tracked.starts) < 2:
        raise InputError(f"{source}: the engine torque shows no excitation of which periods could be counted"
                         + (f" ({tracked.why})" if tracked.why else "") + f"; add the column {' or '.join(REFERENCES)}")
    lost = np.flatnonzero(np.diff(tracked.numbers) > 1)
    return MeasuredPhase(tracked.numbers.astype(np.float64), tracked.starts,
                         np.stack([tracked.starts[lost], tracked.starts[lost + 1]], axis=1))


def _phase_of_speed(t: Floats, speed: Floats, source: str, order: float) -> MeasuredPhase:
    """Return the phase by the plausible rows of an engine speed.

    From the longest stretch without a jump, rows count in both directions as long as they go on from the last one that
    counts. A speed that stands still while it moved before and after is left out too.

    Raises InputError: the speed is nowhere above 0, or implausible in more than `LOST_SPEED` of the rows.
    """
    if speed.max() <= 0.0:
        raise InputError(f"{source}: engine_speed is at most {speed.max():g} rad/s; it must be above 0")
    good = _continuous(t, speed) & ~_stuck(t, speed, order)
    bad = ~good
    if bad.mean() > LOST_SPEED:
        k = int(np.flatnonzero(bad)[0])
        raise InputError(f"{source}: engine_speed jumps or stands still in {100.0 * bad.mean():.0f} % of its rows, "
                         f"first at {t[k]:.6g} s with {speed[k]:.6g} rad/s; the phase is not known")
    numbers = np.flatnonzero(good)
    cuts = np.flatnonzero(np.diff(numbers) > 1)
    before, after = numbers[cuts], numbers[cuts + 1]
    spans = np.stack([t[before], t[after]], axis=1)
    turned = (spans[:, 1] - spans[:, 0]) * order / (2.0 * math.pi)
    sure = turned * np.minimum(0.5 * np.abs(speed[after] - speed[before]), np.maximum(
        speed[after], speed[before])) < BRIDGED_PHASE
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
    left_out = in_words(np.stack([t[edges[::2]], t[edges[1::2] - 1]], axis=1))
    notes = [f"engine_speed is implausible in {counted(int(bad.sum()), 'row')}, {left_out}"
             + ("; straight lines replace them" if sure.any() else "")] if bad.any() else []
    return MeasuredPhase(integral(speed[good], t[good]) * order / (2.0 * math.pi), t[good], spans[~sure], tuple(notes))


def _continuous(t: Floats, speed: Floats) -> NDArray[np.bool_]:
    """Return which rows go on from their neighbours without a jump."""
    log = np.log(np.maximum(speed, 1e-9 * speed.max()))
    cuts = np.flatnonzero(np.abs(np.diff(log)) > JUMP) + 1
    bounds = [0, *cuts.tolist(), len(t)]
    parts = list(pairwise(bounds))
    longest = max(range(len(parts)), key=lambda k: parts[k][1] - parts[k][0])
    good = np.zeros(len(t), dtype=bool)
    good[slice(*parts[longest])] = True
    for run, end, start in ((range(longest + 1, len(parts)), -1, 0), (range(longest - 1, -1, -1), 0, -1)):
        last = range(*parts[longest])[end]
        for k in run:
            rows = range(*parts[k])
            allowed = JUMP + abs(t[rows[start]] - t[last])
            if speed[rows[start]] > 0.0 and abs(log[rows[start]] - log[last]) <= min(allowed, 2.0 * JUMP):
                good[slice(*parts[k])] = True
                last = rows[end]
    return good & (speed > 0.0)


def _stuck(t: Floats, speed: Floats, order: float) -> NDArray[np.bool_]:
    """Return the rows in which a speed stands still for long, and then jumps to where it would have been."""
    changes = np.flatnonzero(np.diff(speed) != 0.0) + 1
    starts, ends = np.concatenate([[0], changes]), np.concatenate([changes, [len(t)]])
    lengths = ends - starts
    bad = np.zeros(len(t), dtype=bool)
    if len(starts) < 20:
        return bad
    usual = float(np.quantile(lengths, 0.9))
    for k in np.flatnonzero(lengths > 10.0 * usual).tolist():
        if 0 < k < len(starts) - 1:
            a, b = int(starts[k]), int(ends[k])
            lost = 0.5 * abs(speed[b] - speed[a]) * (t[b] - t[a]) * order / (2.0 * math.pi)
            bad[a + 1:b] = lost > BRIDGED_PHASE
    return bad


def _agreeing(table: MeasuredTable, phase: MeasuredPhase, name: str, order: float, pulses: int) -> MeasuredPhase:
    """Return the phase, with a note where the strongest line of the torque does not confirm it; raise InputError where
    it contradicts.

    Without a torque the slip speed gives a note at most, because a friction-induced line may be stronger than those of
    the excitation.
    """
    by = next((column for column in ("engine_torque", "slip_speed")
               if column in table.columns and np.isfinite(table.columns[column]).any()), None)
    if by is None:
        return phase
    line = _strongest_order(table, phase, by)
    if line is None:
        if by == "engine_torque":
            _check_drift(table, phase, name)
        return phase
    frequency, tolerance, fundamental = line
    whole = round(frequency)
    if whole >= 1 and abs(frequency - whole) <= tolerance and (fundamental or whole == 1):
        return phase
    reference = f"{name} with --pulses {pulses}" if name == "tacho" else name
    says = f"the strongest line of {by} is at {frequency:.4g} times the excitation by {reference}"
    unit = next((unit for ratio, unit in UNITS_BY_RATIO.items() for k in (1, 2, 3, 4)
                 if name == "engine_speed" and abs(frequency * ratio / k - 1.0) < 0.01), None)
    if unit is not None and (by == "engine_torque" or abs(frequency - whole) > tolerance):
        hint = (f"engine_speed looks as if it were in {unit}; if so, say it with --columns engine_speed=COLUMN:{unit}")
    elif any(abs(frequency * 1e3 / k - 1.0) < 0.01 for k in (1, 2, 3, 4)):
        hint = "if the times are in ms, say so with --columns t=COLUMN:ms"
    else:
        hint = f"check {'--pulses' if name == 'tacho' else 'its unit'} and engine.order, which is {order:g}"
    if by == "engine_torque" and (abs(frequency - whole) > tolerance or whole < 1 or order != 1.0):
        raise InputError(f"{table.source}: the phase by {reference} contradicts the torque: {says}; {hint}")
    if by == "slip_speed" and unit is None and whole >= 1 and abs(frequency - whole) <= tolerance:
        return phase
    return replace(phase, notes=(*phase.notes, f"{table.source}: {says}; {hint}"))


def _strongest_order(table: MeasuredTable, phase: MeasuredPhase, by: str) -> tuple[float, float, bool] | None:
    """Return the strongest line of a column in periods of the excitation, its tolerance, and whether the excitation
    itself has a line; None where no line is certain.
    """
    t, values = table.filled(by)
    begin, end = longest_part(phase.times, merged(np.concatenate([phase.holes, table.holes(by)])))
    inside = (t >= max(begin, phase.times[0])) & (t <= min(end, phase.times[-1]))
    t, values = t[inside], values[inside]
    if len(t) < 64:
        return None
    turns = np.interp(t, phase.times, phase.turns)
    count = min(len(t), MOST_POINTS)
    span = float(turns[-1] - turns[0]) * count / (count - 1)  # That of the transform: one step more than the samples'.
    even = np.linspace(turns[0], turns[-1], count)
    signal = np.interp(even, turns, values)
    drift = np.polynomial.polynomial.polyfit(even, signal, 3)
    signal = signal - np.polynomial.polynomial.polyval(even, drift)
    if np.ptp(signal) <= 1e-9 * np.abs(values).max():
        return None
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(count)))
    low = 6
    k = low + int(np.argmax(spectrum[low:]))
    share = float(np.sum(spectrum[k - 2:k + 3] ** 2) / np.sum(spectrum**2))
    if share < SHARP or k >= len(spectrum) - 1:
        return None
    a, b, c = np.log(spectrum[k - 1:k + 2])
    strongest = (k + 0.5 * float(a - c) / float(a - 2.0 * b + c)) / span
    first = round(span)
    near = spectrum[max(first - 2, low):first + 3]
    fundamental = first + 3 < len(spectrum) and bool(near.max() > DRIVEN * spectrum[k])
    return strongest, max(AGREEMENT * strongest, 1.5 / span), fundamental


def _check_drift(table: MeasuredTable, phase: MeasuredPhase, name: str) -> None:
    """Raise InputError where the torque has a line that drifts against the phase."""
    tracked = _tracked(*table.filled("engine_torque"))
    inside = (tracked.starts >= phase.times[0]) & (tracked.starts <= phase.times[-1])
    numbers, starts = tracked.numbers[inside], tracked.starts[inside]
    if len(starts) < 32:
        return
    turns = np.interp(starts, phase.times, phase.turns)
    step = len(starts) // 16
    ratios = np.diff(turns[::step]) / np.diff(numbers[::step])
    low, high = np.quantile(ratios, [0.1, 0.9]).tolist()
    if high - low > 0.05 * abs(high):
        raise InputError(f"{table.source}: the phase by {name} contradicts the torque: one period of the torque's "
                         f"strongest line is {low:.4g} to {high:.4g} periods by {name}; the phase is not known")


def _phase_of_pulses(t: Floats, signal: Floats, source: str, order: float, pulses: int) -> MeasuredPhase:
    """Return the phase by the teeth in a tacho signal.

    signal : (n,) in any unit, with `pulses` rising edges in a revolution; or, for a wheel with missing teeth, with one
        longer gap in a revolution

    Raises InputError: fewer than two edges, too few samples between edges, more than a few implausible intervals, or a
    wheel with missing teeth that `pulses` does not describe.
    """
    edges = _edges_in(t, signal)
    if len(edges) < 2:
        raise InputError(f"{source}: the column tacho has {counted(len(edges), 'rising edge')} between "
                         f"{signal.min():.4g} and {signal.max():.4g}; it must have 2 or more")
    _check_sampled(t, edges, source)
    kept, steps, extra = _counted(edges)
    per_revolution, notes = _wheel(steps, pulses, source)
    broken = np.isnan(steps)
    gaps = np.zeros(len(steps), dtype=bool) if notes else steps >= 2.0
    faults = extra + int(np.count_nonzero(gaps)) + int(np.count_nonzero(broken))
    if faults > max(3, IMPLAUSIBLE * len(edges)):
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
    return MeasuredPhase(counts * order / per_revolution, times, holes, tuple(notes))


def _at(times: Floats) -> str:
    """Return some times in words."""
    return ", ".join(f"{x:.6g} s" for x in times[:3].tolist()) + (" and later" if len(times) > 3 else "")


def _edges_in(t: Floats, signal: Floats) -> Floats:
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
            if _regular(tried[-1]) > 1.0 - IMPLAUSIBLE:
                break
    return max(tried[::-1], key=_regular)


def _regular(edges: Floats) -> float:
    """Return the share of the intervals between edges that are about as long as the one before."""
    steps = np.diff(edges)
    return float(np.mean(np.abs(np.diff(np.log(steps))) < PLAUSIBLE)) if len(steps) > 2 else 0.0


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
    side = np.where(x > HYSTERESIS, 1, np.where(x < -HYSTERESIS, -1, 0))
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
    if means.min() < SAMPLES_PER_PULSE:
        k = int(means.argmin())
        raise InputError(f"{source}: the tacho has a pulse every {means[k]:.3g} samples at {edges[k]:.6g} s; at least "
                         f"{SAMPLES_PER_PULSE:g} are needed, so it was sampled too slowly for its pulses")


def _counted(edges: Floats) -> tuple[Floats, Floats, int]:
    """Return the plausible edges, the teeth from each to the next (NaN where that is not certain), and how many edges
    are extra.
    """
    from scipy.ndimage import median_filter

    intervals = np.diff(edges)
    usual = median_filter(intervals, min(_AROUND, len(intervals) // 2 * 2 + 1), mode="nearest")
    if np.abs(intervals / usual - 1.0).max() <= PLAUSIBLE:
        return edges, np.ones(len(intervals)), 0
    kept, steps, k = [0], [], 0
    while k + 1 < len(edges):
        expected, j = usual[min(k, len(usual) - 1)], k + 1
        while j + 1 < len(edges) and (edges[j] - edges[k] < (1.0 - PLAUSIBLE) * expected or abs(
                edges[j + 1] - edges[k] - expected) < abs(edges[j] - edges[k] - expected)):
            j += 1
        ratios = [(edges[j] - edges[k]) / usual[min(i, len(usual) - 1)] for i in (max(k - 1, 0), j)]
        whole = max(round(0.5 * sum(ratios)), 1)
        sure = all(abs(ratio - whole) <= PLAUSIBLE for ratio in ratios)
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
        dense = np.asarray(CubicSpline(n, smoothed)(fine)) if len(at) >= 4 else fine
        if len(at) < 4 or not (np.diff(dense) > 0.0).all():
            fine, dense = n, smoothed
        out_counts.append(fine)
        out_times.append(dense)
    if max(moved) > JITTERY:
        notes.append(f"edges of the tacho jitter by {100.0 * max(moved):.2g} % of their distance (rms); they were "
                     "smoothed")
    counts, times = np.concatenate(out_counts), np.concatenate(out_times)
    rising = np.concatenate([[True], np.diff(times) > 0.0])
    return counts[rising], times[rising]


def signals_in(table: MeasuredTable, system: System, pulses: int | None = None) -> Signals:
    """Return the signals in a table with a slip speed.

    The shaft torque is that of plate_angle and plate_speed, minus output_angle and output_speed if the far end moved.
    Holes of a sixteenth of a period of the excitation or less are bridged by cubics; longer ones are holes of the
    signals.

    system : stiffness and damping of the shaft, and `engine.order`
    pulses : of the tacho in a crank revolution

    Raises InputError: the phase is unknown, or the slip speed has too few values.
    """
    phase = measured_phase(table, system.engine.order, pulses)
    t, slip = table.filled("slip_speed")
    if len(t) < 4:
        raise InputError(f"{table.source}: the column slip_speed has {counted(len(t), 'value')}; 4 or more are needed")
    slip_holes = table.holes("slip_speed")
    holes = long_holes(slip_holes, phase.turns, phase.times)
    short = slip_holes[~np.isin(slip_holes[:, 0], holes[:, 0])]
    notes = [] if not len(short) else [
        f"{table.source}: {counted(len(short), 'hole')} of at most {np.diff(short).max():.3g} s, a sixteenth of a "
        "period of the excitation or less, bridged by cubics"]
    blank = merged(np.concatenate([holes, phase.holes]))
    if len(blank):
        notes.append(f"{table.source}: no slip speed or no phase from {in_words(blank)}; windows that touch "
                     f"{'this hole' if len(blank) == 1 else 'these holes'} are left blank")
    v, shaft, name = _curve(t, slip, holes), _shaft_torque(table, system, phase), "engine_torque"
    torque: Callable[[Floats], Floats] = _unknown
    if name in table.columns and np.count_nonzero(np.isfinite(table.columns[name])) >= 4:
        torque = _curve(*table.filled(name), long_holes(table.holes(name), phase.turns, phase.times))

    def at(times: Floats) -> tuple[Floats, Floats, Floats]:
        """Cubic splines through the samples, NaN in holes."""
        return v(times), shaft(times), torque(times)

    turns = np.interp(t, phase.times, phase.turns)
    inside = (t >= phase.times[0]) & (t <= phase.times[-1])
    if np.count_nonzero(inside) < 4:
        raise InputError(f"{table.source}: the phase of the excitation is known from {phase.times[0]:.6g} to "
                         f"{phase.times[-1]:.6g} s only, where there is no slip speed")
    return Signals(system, turns[inside], phase.when, at,
                   None if "engine_torque" in table.columns else driven_orders(system), None, t[inside],
                   np.full(np.count_nonzero(inside), np.nan), blank,
                   (*notes, *phase.notes), splined=True)


def _curve(t: Floats, values: Floats, holes: Spans) -> Callable[[Floats], Floats]:
    """Return the cubic spline through samples, NaN in holes."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, values)

    def at(times: Floats) -> Floats:
        inside = np.searchsorted(holes[:, 0], times, side="right") > np.searchsorted(holes[:, 1], times, side="right")
        return np.where(inside, np.nan, spline(times))

    return at


def _unknown(times: Floats) -> Floats:
    return np.full(len(times), np.nan)


def _shaft_torque(table: MeasuredTable, system: System, phase: MeasuredPhase) -> Callable[[Floats], Floats]:
    """Return the shaft torque as a curve, NaN where the plate's angle is unknown."""
    from scipy.interpolate import CubicSpline

    names = [name for name in ("plate_angle", "plate_speed", FAR_END, "output_angle") if name in table.columns]
    complete = np.all([np.isfinite(table.columns[name]) for name in ("t", *names)], axis=0)
    if "plate_angle" not in names or np.count_nonzero(complete) < 4:
        return _unknown
    t, d = table.t[complete], system.driveline
    columns = {name: table.columns[name][complete] for name in names}
    angle = columns["plate_angle"]
    speed = columns["plate_speed"] if "plate_speed" in columns else np.asarray(CubicSpline(t, angle)(t, 1))
    if FAR_END in columns:
        speed = speed - columns[FAR_END]
        angle = angle - (columns["output_angle"] if "output_angle" in columns else integral(columns[FAR_END], t))
    holes = long_holes(table.holes(*names), phase.turns, phase.times)
    return _curve(t, d.damping * speed + d.stiffness * angle, holes)
