"""Phase of the excitation in a table of measurements: from engine speed, tacho pulses, or the engine torque.

Each reference is checked by itself, mended where that is certain, and compared with the strongest line of the torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.engine_clock import RunPhase
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.tacho import pulses_of
from tcc_sim.analysis.torque_phase import PhaseTracker
from tcc_sim.errors import InputError, counted
from tcc_sim.tables.chosen_columns import REFERENCES
from tcc_sim.tables.measured_table import MeasuredTable, longest_part
from tcc_sim.tables.sampling import Spans, in_words, merged
from tcc_sim.trajectory import Floats, integral

UNITS_BY_RATIO = {30.0 / math.pi: "rpm", 0.5 / math.pi: "hz", 180.0 / math.pi: "deg/s"}
"""Units in which an engine speed may be by mistake, by the ratio of its numbers to those in rad/s."""
MOST_POINTS = 1 << 17
"""Largest number of points of the torque in which its strongest line is looked for."""


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
    tacho : signal with `pulses` rising edges in a revolution (None: 1), see `tacho.pulses_of`
    engine_torque : its strongest line is the excitation

    Raises
    ------
    InputError
        None of these columns; more than one of `pulses` for another column than tacho; one without rotation, or that is
        implausible; or a speed or tacho that contradicts the torque's strongest line.
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
    holes: Spans = np.empty((0, 2))
    notes: list[str] = []
    if references[0] == "engine_speed":
        t, values, holes, notes = plausible_speed(t, values, source, order)
        turns, times = integral(values, t) * order / (2.0 * math.pi), t
    elif references[0] == "tacho":
        pulse_phase = pulses_of(t, values, pulses or 1, source)
        turns, times = pulse_phase.counts * order / pulse_phase.per_revolution, pulse_phase.times
        holes, notes = pulse_phase.holes, pulse_phase.notes
    else:
        tracked = _tracked(t, values)
        if len(tracked.starts) < 2:
            raise InputError(f"{source}: the engine torque shows no excitation of which periods could be counted"
                             + (f" ({tracked.why})" if tracked.why else "")
                             + f"; add the column {' or '.join(REFERENCES)}")
        turns, times = tracked.numbers.astype(np.float64), tracked.starts
        lost = np.flatnonzero(np.diff(tracked.numbers) > 1)
        holes = np.stack([times[lost], times[lost + 1]], axis=1)
    holes = merged(np.concatenate([holes, long_holes(table.holes(references[0]), turns, times)]))
    phase = MeasuredPhase(turns, times, holes, tuple(f"{source}: {note}" for note in notes))
    return phase if references[0] == "engine_torque" else _agreeing(table, phase, references[0], order, pulses or 1)


def long_holes(holes: Spans, turns: Floats, times: Floats) -> Spans:
    """Return the holes longer than `Settings.bridged_hole`, and those that the phase does not cover."""
    begin, end = (np.interp(holes[:, k], times, turns) for k in (0, 1))
    inside = (holes[:, 0] >= times[0]) & (holes[:, 1] <= times[-1])
    return np.asarray(holes[(end - begin > DEFAULTS.bridged_hole) | ~inside])


def _tracked(t: Floats, torque: Floats) -> RunPhase:
    """Return the phase of the strongest line of a torque."""
    tracker = PhaseTracker()
    tracker.feed(np.rint(t * 1e9).astype(np.int64), torque)
    return tracker.runs()[0]


def plausible_speed(t: Floats, speed: Floats, source: str,
                    order: float) -> tuple[Floats, Floats, Spans, list[str]]:
    """Return times and values of an engine speed in its plausible rows, the stretches across which the phase is not
    certain, and sentences on rows left out.

    From the longest stretch without a jump, rows count in both directions as long as they go on from the last one that
    counts. A speed that stands still while it moved before and after is left out too.

    Raises
    ------
    InputError
        The speed is nowhere above 0, or implausible in more than `Settings.lost_speed` of the rows.
    """
    if speed.max() <= 0.0:
        raise InputError(f"{source}: engine_speed is at most {speed.max():g} rad/s; it must be above 0")
    good = _continuous(t, speed) & ~_stuck(t, speed, order)
    bad = ~good
    if not bad.any():
        return t, speed, np.empty((0, 2)), []
    if bad.mean() > DEFAULTS.lost_speed:
        k = int(np.flatnonzero(bad)[0])
        raise InputError(f"{source}: engine_speed jumps or stands still in {100.0 * bad.mean():.0f} % of its rows, "
                         f"first at {t[k]:.6g} s with {speed[k]:.6g} rad/s; the phase is not known")
    numbers = np.flatnonzero(good)
    cuts = np.flatnonzero(np.diff(numbers) > 1)
    before, after = numbers[cuts], numbers[cuts + 1]
    spans = np.stack([t[before], t[after]], axis=1)
    turned = (spans[:, 1] - spans[:, 0]) * order / (2.0 * math.pi)
    sure = turned * np.minimum(0.5 * np.abs(speed[after] - speed[before]), np.maximum(
        speed[after], speed[before])) < DEFAULTS.bridged_phase
    notes = [f"engine_speed is implausible in {counted(int(bad.sum()), 'row')}, {in_words(_spans(t, bad))}"
             + ("; straight lines replace them" if sure.any() else "")]
    return t[good], speed[good], spans[~sure], notes


def _spans(t: Floats, bad: NDArray[np.bool_]) -> Spans:
    """Return begin and end of the stretches of marked rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
    return np.stack([t[edges[::2]], t[edges[1::2] - 1]], axis=1)


def _continuous(t: Floats, speed: Floats) -> NDArray[np.bool_]:
    """Return which rows go on from their neighbours without a jump."""
    log = np.log(np.maximum(speed, 1e-9 * speed.max()))
    cuts = np.flatnonzero(np.abs(np.diff(log)) > DEFAULTS.jump) + 1
    bounds = [0, *cuts.tolist(), len(t)]
    parts = list(pairwise(bounds))
    longest = max(range(len(parts)), key=lambda k: parts[k][1] - parts[k][0])
    good = np.zeros(len(t), dtype=bool)
    good[slice(*parts[longest])] = True
    for run, end, start in ((range(longest + 1, len(parts)), -1, 0), (range(longest - 1, -1, -1), 0, -1)):
        last = range(*parts[longest])[end]
        for k in run:
            rows = range(*parts[k])
            allowed = DEFAULTS.jump + abs(t[rows[start]] - t[last])
            if speed[rows[start]] > 0.0 and abs(log[rows[start]] - log[last]) <= min(allowed, 2.0 * DEFAULTS.jump):
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
            bad[a + 1:b] = lost > DEFAULTS.bridged_phase
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
        return _drifting(table, phase, name) if by == "engine_torque" else phase
    frequency, tolerance, fundamental = line
    whole = round(frequency)
    if whole >= 1 and abs(frequency - whole) <= tolerance and (fundamental or whole == 1):
        return phase
    what = f"the phase by {name}" + (f" with --pulses {pulses}" if name == "tacho" else "")
    says = (f"the strongest line of {by} is at {frequency:.4g} times the excitation by {name}"
            + (f" and --pulses {pulses}" if name == "tacho" else ""))
    unit = next((unit for ratio, unit in UNITS_BY_RATIO.items() for k in (1, 2, 3, 4)
                 if name == "engine_speed" and abs(frequency * ratio / k - 1.0) < 0.01), None)
    if unit is not None and (by == "engine_torque" or abs(frequency - whole) > tolerance):
        hint = (f"engine_speed looks as if it were in {unit}; if so, say it with --columns engine_speed=COLUMN:{unit}")
    elif any(abs(frequency * 1e3 / k - 1.0) < 0.01 for k in (1, 2, 3, 4)):
        hint = "if the times are in ms, say so with --columns t=COLUMN:ms"
    else:
        hint = f"check {'--pulses' if name == 'tacho' else 'its unit'} and engine.order, which is {order:g}"
    if by == "engine_torque" and (abs(frequency - whole) > tolerance or whole < 1 or order != 1.0):
        raise InputError(f"{table.source}: {what} contradicts the torque: {says}; {hint}")
    if by == "slip_speed" and unit is None and whole >= 1 and abs(frequency - whole) <= tolerance:
        return phase
    return MeasuredPhase(phase.turns, phase.times, phase.holes, (*phase.notes, f"{table.source}: {says}; {hint}"))


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
    if share < DEFAULTS.sharp or k >= len(spectrum) - 1:
        return None
    a, b, c = np.log(spectrum[k - 1:k + 2])
    strongest = (k + 0.5 * float(a - c) / float(a - 2.0 * b + c)) / span
    first = round(span)
    near = spectrum[max(first - 2, low):first + 3]
    fundamental = first + 3 < len(spectrum) and bool(near.max() > DEFAULTS.driven * spectrum[k])
    return strongest, max(DEFAULTS.agreement * strongest, 1.5 / span), fundamental


def _drifting(table: MeasuredTable, phase: MeasuredPhase, name: str) -> MeasuredPhase:
    """Return the phase; raise InputError where the torque has a line that drifts against it."""
    tracked = _tracked(*table.filled("engine_torque"))
    inside = (tracked.starts >= phase.times[0]) & (tracked.starts <= phase.times[-1])
    numbers, starts = tracked.numbers[inside], tracked.starts[inside]
    if len(starts) < 32:
        return phase
    turns = np.interp(starts, phase.times, phase.turns)
    step = len(starts) // 16
    ratios = np.diff(turns[::step]) / np.diff(numbers[::step])
    low, high = np.quantile(ratios, [0.1, 0.9]).tolist()
    if high - low > 0.05 * abs(high):
        raise InputError(f"{table.source}: the phase by {name} contradicts the torque: one period of the torque's "
                         f"strongest line is {low:.4g} to {high:.4g} periods by {name}; the phase is not known")
    return phase
