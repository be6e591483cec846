"""Flaws of measured columns: stretches in which the numbers of a sensor are not those of what it measures.

A flaw is a hole: its rows become NaN, and a sentence names column, kind, rows and times. What a motion may do is none:
steps, constant stretches of an input, stick at 0, spikes of stick-slip that last for several rows or come again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, counted
from tcc_sim.trajectory import Floats

Rows = NDArray[np.bool_]
MOVING = ("slip_speed", "plate_speed", "plate_angle")
"""Columns that never stand still but at 0."""
PULSATING = (*MOVING, "engine_torque")
"""Columns whose peaks are round."""
JUDGED = (*PULSATING, "actuation_pressure", "output_speed")
"""Columns that are judged here; engine speed and tacho are judged with the phase that they give."""
MOST = 0.25
"""Largest share of a column's values that may be flawed."""
ABSENT = (-9999.0, 9999.0, -999.0, -99999.0, 99999.0, 65535.0, 32767.0, -32768.0, 1e30, -1e30)
"""Numbers that loggers write for an absent value."""
FAR, STEEP = 3.0, 6.0
"""Distance of a wrong value from all others, relative to their range, and of a spike from both neighbours, relative to
the largest change beside it.
"""
FEWEST = 16
"""Values from which a column is judged."""
FROZEN, NEAR, BRISK = 20, 20, 0.3
"""Least rows of a frozen stretch, and rows on either side of it whose mean change is at least this part of the usual
one.
"""
HELD, ALIKE = 3, 0.8
"""Least rows of a held sample, and share of the samples that last as long."""
PLATEAU, PLATEAUS, ABRUPT = 3, 3, 0.55
"""Least rows at an extreme that was clipped, least number of such stretches, and least change into one, relative to the
usual one.
"""
ROUNDED, LEVEL, SLOWLY = 2.0, 4.0, 4
"""Rounding explains a leap by ROUNDED steps of quantisation, and a stretch of one value that is reached and left
slowly: in a SLOWLY-th part of its rows by LEVEL steps, or by ROUNDED ones at a peak.
"""
COARSE = 50.0
"""Number of steps of quantisation in a column's range below which a sentence names them."""
_SHOWN = 3


def without_flaws(columns: dict[str, Floats], t: Floats, source: str) -> tuple[dict[str, Floats], list[str]]:
    """Return columns, (n,) each, with NaN in flawed rows, and sentences on them; raise InputError if more than a
    quarter of a column's values are flawed.
    """
    out, notes = dict(columns), []
    for name in JUDGED:
        if name not in columns:
            continue
        known = np.flatnonzero(np.isfinite(columns[name]))
        if len(known) < FEWEST:
            continue
        values = columns[name][known]
        bad = np.zeros(len(known), dtype=np.bool_)
        for kind, find in KINDS.items():
            found = np.zeros(len(known), dtype=np.bool_)
            found[~bad] = find(values[~bad], name)
            if not found.any():
                continue
            if kind != "held":
                notes.append(f"{name}: {_in_words(kind, found, known, t)}, left out")
            elif (share := int(np.count_nonzero(~found))) > 1:
                notes.append(f"{name}: samples of {t[known[~found]][1] - t[known[~found]][0]:.4g} s are repeated to "
                             f"fill the rows; {counted(share, 'sample')} of {len(known)} rows used")
            if kind != "held" and (bad | found).mean() > MOST:
                raise InputError(f"{source}: {name}: {_in_words(kind, found, known, t)}: "
                                 f"{100.0 * (bad | found).mean():.0f} % of its values; at most {100.0 * MOST:g} % may "
                                 "be flawed")
            bad |= found
        if bad.any():
            out[name] = columns[name].copy()
            out[name][known[bad]] = np.nan
        if step := quantum_of(values[~bad]):
            notes.append(f"{name} is quantised in steps of {step:.4g}: {np.ptp(values[~bad]) / step:.0f} of them in "
                         "its range")
    return out, notes


def _in_words(kind: str, found: Rows, known: NDArray[np.int64], t: Floats) -> str:
    """Return kind, rows (counted from 1) and times of flawed rows."""
    edges = np.flatnonzero(np.diff(found.astype(np.int8), prepend=0, append=0))
    spans = [(known[a], known[b - 1]) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist())]
    shown = ", ".join(f"row {a + 1} at {t[a]:.6g} s" if a == b else
                      f"rows {a + 1} to {b + 1}, {t[a]:.6g} to {t[b]:.6g} s" for a, b in spans[:_SHOWN])
    more = f" and {len(spans) - _SHOWN} more stretches" if len(spans) > _SHOWN else ""
    return f"{counted(int(found.sum()), 'row')} {kind} ({shown}{more})"


def far_off(values: Floats, name: str) -> Rows:
    """Return the values that are apart from all others by more than FAR times their range.

    They are single rows, or one number again and again, such as -9999 or 65535: a motion that leaps has values of its
    own before and after. At the first and the last row it may leap too, and beside a constant: there only the usual
    numbers for an absent value count.
    """
    out = np.zeros(len(values), dtype=np.bool_)
    for sign in (1.0, -1.0):
        ordered = np.sort(sign * values)
        tail = ordered[len(ordered) // 2:]
        at = int(np.argmax(np.diff(tail)))
        far = sign * values > tail[at]
        rest = float(tail[at] - ordered[0])
        middle = float(ordered[int(0.9 * at + 0.45 * len(ordered))] - ordered[len(ordered) // 20])
        rest = min(rest, 10.0 * middle) if middle > 0.0 else rest
        if rest == 0.0:
            out |= far & np.isin(values, ABSENT)
        elif tail[at + 1] - tail[at] > FAR * rest and (
                len(np.unique(values[far])) == 1 or not (far[1:] & far[:-1]).any()) and (
                far[1:-1].any() or np.isin(values[far], ABSENT).all()) and (
                tail[at + 1] - tail[at] > ROUNDED * _quantum_from(values, _decade_of(tail[at + 1]))):
            out |= far
    return out


def spikes(values: Floats, name: str) -> Rows:
    """Return single values beyond both neighbours by more than STEEP times any change elsewhere, in 1 % at most."""
    out = np.zeros(len(values), dtype=np.bool_)
    step = np.diff(values)
    height = np.where(step[:-1] * step[1:] < 0.0, np.minimum(np.abs(step[:-1]), np.abs(step[1:])), 0.0)
    few = max(len(values) // 100, 1)
    highest = np.argsort(height)[::-1][:few + 1]
    for count in range(min(few, len(highest) - 1), 0, -1):
        chosen = highest[:count]
        beside = np.ones(len(step), dtype=np.bool_)
        beside[chosen] = beside[chosen + 1] = False
        others = float(np.abs(step[beside]).max(initial=0.0))
        if others > 0.0 and height[chosen[-1]] > STEEP * others:
            out[chosen + 1] = True
            break
        if count > 64:   # Many are no single spikes.
            return out
    return out


def frozen(values: Floats, name: str) -> Rows:
    """Return stretches of one value, not 0, between rows that all differ and move as briskly as usual, or to the end.
    """
    out = np.zeros(len(values), dtype=np.bool_)
    step = np.diff(values)
    edges = np.flatnonzero(np.diff((step == 0.0).astype(np.int8), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    long = ends - begins >= FROZEN
    rest = np.count_nonzero(step == 0.0) - int((ends - begins)[long].sum())
    if not long.any() or rest > 0.05 * len(step):
        return out
    usual = float(np.median(np.abs(step[step != 0.0]))) if (step != 0.0).any() else 0.0
    quantum = cache(partial(_quantum_from, values))
    for begin, end in zip(begins[long].tolist(), ends[long].tolist()):
        moves = [begin > NEAR and np.abs(step[begin - NEAR:begin]).mean() > BRISK * usual,
                 end < len(step) - NEAR and np.abs(step[end + 1:end + 1 + NEAR]).mean() > BRISK * usual]
        dead = name in MOVING and moves[0] and end == len(step) and begin > 0.5 * len(step)
        near = (end - begin) // SLOWLY
        away = np.abs(values[max(begin - near, 0):end + 1 + near] - values[begin]).max()
        if values[begin] != 0.0 and (all(moves) or dead) and away > LEVEL * quantum(_decade_of(values[begin])):
            out[begin + 1:end + 1] = True
    return out


def repeated_samples(values: Floats, name: str) -> Rows:
    """Return the repeats of a signal that was sampled more slowly than the table: all but the first row of each."""
    out = np.zeros(len(values), dtype=np.bool_)
    changes = np.flatnonzero(np.diff(values)) + 1
    if name not in MOVING or len(changes) < FEWEST or len(changes) * HELD > len(values):
        return out
    lengths = np.diff(changes)
    usual = float(np.median(lengths))
    if usual < HELD or np.mean(np.abs(lengths - usual) <= 1.0) < ALIKE:
        return out
    out[:] = True
    out[0] = False
    out[changes] = False
    # A value that comes twice is a sample too.
    for begin, length in zip(changes[:-1].tolist(), lengths.tolist()):
        if length > 1.5 * usual:
            out[np.rint(begin + usual * np.arange(1, round(length / usual))).astype(int)] = False
    return out


def clipped(values: Floats, name: str) -> Rows:
    """Return the rows at an extreme, not 0, that flattens several peaks."""
    out = np.zeros(len(values), dtype=np.bool_)
    extremes = float(values.max()), float(values.min())
    between = ~np.isin(values, extremes)
    # A coarse signal has flat peaks too.
    step = np.diff(values)
    fine = len(np.unique(values[between])) > 0.5 * np.count_nonzero(between)
    if name not in PULSATING or not fine or between.mean() < 0.3:
        return out
    for extreme in extremes:
        at = values == extreme
        edges = np.flatnonzero(np.diff(at.astype(np.int8), prepend=0, append=0))
        begins, sizes = edges[::2], edges[1::2] - edges[::2]
        begins, sizes = (each[(sizes >= PLATEAU) & (begins > 0)] for each in (begins, sizes))
        # A peak that is rounded to a step of quantisation is reached slowly.
        into, usual = np.abs(step[begins - 1]), float(np.median(np.abs(step[step != 0.0])))
        if extreme != 0.0 and len(begins) >= PLATEAUS and np.median(into) > ABRUPT * usual:
            rise = [np.abs(extreme - values[max(begin - max(size // SLOWLY, 1), 0):begin]).max()
                    for begin, size in zip(begins.tolist(), sizes.tolist())]
            out |= at & (np.median(rise) > ROUNDED * _quantum_from(values, _decade_of(extreme)))
    return out


KINDS: dict[str, Callable[[Floats, str], Rows]] = {
    "far from all others": far_off, "in single spikes": spikes, "frozen at one value": frozen, "held": repeated_samples,
    "clipped at an extreme": clipped}
"""Functions that find the flawed rows of a column, by the kind of flaw."""


def _decade_of(value: float) -> float:
    """Return the power of ten of the first digit of a value; 0 for 0."""
    return 10.0 ** math.floor(math.log10(abs(value))) if value else 0.0


def _quantum_from(values: Floats, least: float) -> float:
    """Return the step of quantisation of the values of at least this size, which is a power of ten, since numbers of a
    few significant digits, two or more, have one step up to the next; 0 without rounding.
    """
    step = _step_in(np.unique(values[np.abs(values) >= least])) * (1.0 + 1e-3)
    return step if step < 0.11 * least else 0.0  # Two values far from each other are no rounding.


def _step_in(levels: Floats) -> float:
    """Return the least difference of ascending levels if all are whole multiples of it; else 0."""
    steps = np.diff(levels)
    least = float(steps.min(initial=math.inf))
    return least if len(steps) and np.abs(steps / least - np.rint(steps / least)).max() < 1e-3 else 0.0


def quantum_of(values: Floats) -> float:
    """Return the step of quantisation of a column, if there are few of them in its range; else 0."""
    levels = np.unique(values)
    if not FEWEST // 4 < len(levels) < COARSE or len(values) < 10 * len(levels):
        return 0.0
    return _step_in(levels)
