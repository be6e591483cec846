"""Finding the first event and the extremes of an arc with certainty: Hermite cubics with a bound of the fourth derivative.

A cell [a, b] is passed only with a proof: the cubic through value and slope at its ends differs from the signal by at most
B h^4/384, its slope by at most 0.00802 B h^3, and the linear interpolant of the second derivative by at most B h^2/8, where
B bounds the fourth derivative. Where the proof fails, the cell is cut. End-point signs alone decide nothing, so two events
in one cell, grazing and a start at zero are told apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_arcs import BEND, FREE, SIZE, STICK, Floats, evaluate, fourth_bound

NONE = -1
EXHAUSTED = -2


@compiled
def evaluate_series(tau: float, rows: int, series: Floats, work: Floats, slot: int) -> None:
    """`evaluate` for an arc that is a power series: series (3, order + 1) of the signals in tau."""
    last = series.shape[1] - 1
    for j in range(0, rows, 2):
        value, slope, bend = series[j, last], 0.0, 0.0
        for i in range(last - 1, -1, -1):
            bend = bend * tau + slope
            slope = slope * tau + value
            value = value * tau + series[j, i]
        work[slot, j, 0] = value
        work[slot, j, 1] = slope
        work[slot, j, 2] = 2.0 * bend


@compiled
def look(tau: float, u: float, mode: int, rows: int, row: Floats, phase: Floats, arc: Floats, series: Any,
         work: Floats, slot: int) -> tuple[float, float]:
    """Evaluate the arc, whichever kind it is; a power series where mode is negative."""
    if series is None:
        return evaluate(tau, u, rows, row, phase, arc, work, slot)
    else:
        if mode < 0:
            evaluate_series(tau, rows, series, work, slot)
            return 1.0, 1.0
        return evaluate(tau, u, rows, row, phase, arc, work, slot)


@compiled
def find_root(a: float, b: float, j: int, u: float, mode: int, rows: int, row: Floats, phase: Floats, arc: Floats,
              series: Any, work: Floats, at_zero: bool, counts: Any) -> float:
    """The one root of signal j in (a, b], by Newton's method within a bracket; work[2] is left near it."""
    left, right = work[0, j, 0], work[1, j, 0]
    x = b if at_zero else a + (b - a) * left / (left - right)
    low, high = a, b
    for _ in range(80):
        look(x, u, mode, rows, row, phase, arc, series, work, 2)
        counts[0] += 1
        value, slope = work[2, j, 0], work[2, j, 1]
        if value > 0.0:
            low = x
        else:
            high = x
        following = x - value / slope if slope != 0.0 else 0.5 * (low + high)
        if not low < following < high:
            if abs(following - x) <= 4e-16 * (abs(u) + b):
                return x
            following = 0.5 * (low + high)
        if value == 0.0 or abs(following - x) <= 2e-16 * (abs(u) + b) or high - low <= 2e-16 * (abs(u) + b):
            return following
        x = following
    return x


@compiled
def find_extreme(a: float, b: float, u: float, mode: int, row: Floats, phase: Floats, arc: Floats, series: Any,
                 work: Floats, size: float, counts: Any) -> float:
    """The value of signal 0 where its slope, of opposite sign at a and b, is 0."""
    p, q = work[0, 0, 1], work[1, 0, 1]
    x = a + (b - a) * p / (p - q)
    low, high = a, b
    for _ in range(60):
        look(x, u, mode, 1, row, phase, arc, series, work, 2)
        counts[0] += 1
        slope, bend = work[2, 0, 1], work[2, 0, 2]
        if (slope > 0.0) == (p > 0.0):
            low = x
        else:
            high = x
        step = -slope / bend if bend != 0.0 else 0.0
        if abs(slope * step) <= 1e-15 * size or high - low <= 1e-15 * b:
            return work[2, 0, 0] + 0.5 * slope * step  # type: ignore[no-any-return]
        x = x + step if low < x + step < high else 0.5 * (low + high)
    return work[2, 0, 0]  # type: ignore[no-any-return]


@compiled
def search(span: float, u: float, mode: int, upward: float, offset: float, tolerance: float, steepest: float, shortest: float,
           row: Floats, phase: Floats, arc: Floats, series: Any, bend: float, size: float, work: Floats, extremes: Floats,
           counts: Any) -> tuple[int, float]:
    """The first event in (0, span] of the arc that starts at u; the extremes of v until then, less its ends, go to `extremes`.

    Returns (signal, tau), or (NONE, span), or (EXHAUSTED, tau) where `counts` (evaluations, limit) run out. A signal that
    starts at `tolerance` or below starts at its root, which is no event unless it falls faster than `steepest`. `mode` is
    negative for a power series, whose fourth derivative is bounded by `bend`. v = upward (signal 0 + offset).
    """
    rows = 2 if mode == STICK else 1
    fade, other = look(0.0, u, mode, rows, row, phase, arc, series, work, 0)
    fresh0, fresh1 = mode != FREE and work[0, 0, 0] <= tolerance, rows == 2 and work[0, 1, 0] <= tolerance
    if fresh0 and work[0, 0, 1] < -steepest:
        return 0, 0.0
    a, grow = 0.0, np.inf
    while a < span:
        bound0, bound1 = bend, 0.0
        if mode >= 0:
            free = abs(arc[0, 2]) * fade + abs(arc[0, 3]) * other
            bound0 = row[BEND] + fourth_bound(arc[0, 2], arc[0, 3], fade, other, row)
            size = row[SIZE] + free + abs(work[0, 0, 0])
            if rows == 2:
                bound1 = row[BEND + 1] + fourth_bound(arc[1, 2], arc[1, 3], fade, other, row)
        room = 8.0 * size / max(bound0, bound1) if max(bound0, bound1) > 0.0 else np.inf
        h = min(np.sqrt(np.sqrt(room)), grow)
        if a + 1.2 * h >= span:
            h = span - a
        crossing = False
        while True:
            b = a + h if a + h < span else span
            fade, other = look(b, u, mode, rows, row, phase, arc, series, work, 1)
            counts[0] += 1
            if counts[0] > counts[1] or not np.isfinite(work[1, 0, 0]):
                return EXHAUSTED, a
            proven, crossing = True, False
            if mode != FREE:
                verdict = passes(h, work, 0, bound0, fresh0)
                proven, crossing = verdict >= 0, verdict == 1
            if rows == 2:
                verdict = passes(h, work, 1, bound1, fresh1)
                proven, crossing = proven and verdict >= 0, crossing or verdict == 1
            if proven and mode != STICK:
                proven = note_inside(a, b, u, mode, upward, offset, crossing, row, phase, arc, series, bound0, size, work,
                                     extremes, counts)
            if proven:
                break
            if h <= shortest:
                crossing = mode != FREE and ((work[1, 0, 0] <= 0.0 and not fresh0)
                                             or (rows == 2 and work[1, 1, 0] <= 0.0 and not fresh1))
                break
            h *= 0.5
        if crossing:
            first, signal = np.inf, NONE
            for j in range(rows):
                if work[1, j, 0] <= 0.0:
                    at_zero = fresh0 if j == 0 else fresh1
                    tau = find_root(a, b, j, u, mode, rows, row, phase, arc, series, work, at_zero, counts)
                    if tau < first:
                        first, signal = tau, j
            return signal, first
        a = b
        grow = 2.0 * h
        for j in range(rows):
            for i in range(3):
                work[0, j, i] = work[1, j, i]
        fresh0, fresh1 = fresh0 and work[0, 0, 0] <= tolerance, fresh1 and work[0, 1, 0] <= tolerance
        if mode == FREE:
            note(work[0, 0, 0], extremes)
        elif mode != STICK:
            note(upward * max(work[0, 0, 0] + offset, 0.0), extremes)
    return NONE, span


@compiled
def note(v: float, extremes: Floats) -> None:
    """Widen the extremes (largest, smallest) to take in v."""
    extremes[0] = max(extremes[0], v)
    extremes[1] = min(extremes[1], v)


@compiled
def note_inside(a: float, b: float, u: float, mode: int, upward: float, offset: float, crossing: bool, row: Floats,
                phase: Floats, arc: Floats, series: Any, fourth: float, size: float, work: Floats, extremes: Floats,
                counts: Any) -> bool:
    """Take in an extreme inside the cell, if it matters; False where the cell is too long to tell whether there is one."""
    h = b - a
    slack = fourth * h * h * h
    e = slack * h / 384.0
    g, p, g1, q = work[0, 0, 0], work[0, 0, 1], work[1, 0, 0], work[1, 0, 1]
    one, two = g + h * p / 3.0, g1 - h * q / 3.0
    top = upward * (max(max(g, one), max(two, g1)) + e + offset)
    foot = upward * (min(min(g, one), min(two, g1)) - e + offset)
    if max(top, foot) <= extremes[0] and min(top, foot) >= extremes[1]:
        return True
    curve = bent(h, work[0, 0, 2], work[1, 0, 2], fourth)
    if curve != 0 and (p > 0.0) != (q > 0.0):
        value = find_extreme(a, b, u, mode, row, phase, arc, series, work, size, counts)
        if mode == FREE:
            note(value, extremes)
        elif value > 0.0 or not crossing:
            note(upward * max(value + offset, 0.0), extremes)
        return True
    return curve != 0 or steady(h, g, p, g1, q, fourth) != 0 or e <= 1e-15 * size


@compiled
def bent(h: float, s: float, s1: float, fourth: float) -> int:
    """1 or -1 where the second derivative is proven to keep that sign over the cell, else 0."""
    lean = fourth * h * h / 8.0
    if s > lean and s1 > lean:
        return 1
    return -1 if s < -lean and s1 < -lean else 0


@compiled
def steady(h: float, g: float, p: float, g1: float, q: float, fourth: float) -> int:
    """1 or -1 where the slope is proven to keep that sign over the cell, else 0."""
    slack = 0.00802 * fourth * h * h * h
    middle = 3.0 * (g1 - g) / h - p - q
    if p > slack and q > slack and middle > slack:
        return 1
    return -1 if p < -slack and q < -slack and middle < -slack else 0


@compiled
def passes(h: float, work: Floats, j: int, fourth: float, at_zero: bool) -> int:
    """0: no root in (a, b] is proven; 1: exactly one is proven (or the one at b); -1: neither."""
    g, p, g1, p1 = work[0, j, 0], work[0, j, 1], work[1, j, 0], work[1, j, 1]
    curve = bent(h, work[0, j, 2], work[1, j, 2], fourth)
    if g1 <= 0.0:
        if curve < 0 or (not at_zero and (curve > 0 or steady(h, g, p, g1, p1, fourth) < 0)):
            return 1
        return -1
    if at_zero:
        if curve < 0 or (p >= 0.0 and (curve > 0 or steady(h, g, p, g1, p1, fourth) > 0)):
            return 0
        return 0 if (3.0 * g1 / h - 2.0 * p - p1) / h + max(p, 0.0) / h > fourth * h * h / 24.0 else -1
    if curve < 0:
        return 0
    third, e = h / 3.0, fourth * h * h * h * h / 384.0
    return 0 if g > e and g1 > e and g + third * p > e and g1 - third * p1 > e else -1
