"""Finding the first event and the extremes of an arc with certainty: Hermite cubics with a bound of the fourth
derivative.

A cell [a, b] is passed only with a proof: the cubic through value and slope at its ends differs from the signal by at
most B h^4/384, its slope by at most 0.00802 B h^3, and the linear interpolant of the second derivative by at most B
h^2/8, where B bounds the fourth derivative. Where the proof fails, the cell is cut. End-point signs alone decide
nothing, so two events in one cell, grazing and a start at zero are told apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_driven.arcs import (
    ARC,
    COUNT,
    FREE,
    HERE,
    HIGHEST,
    LEFT,
    LOWEST,
    MOST,
    RIGHT,
    SIZE,
    STICK,
    Floats,
    evaluate,
    fourth_bound,
)

NONE = -1
EXHAUSTED = -2


@compiled
def evaluate_series(tau: float, rows: int, series: Floats, pad: Floats) -> None:
    """`evaluate` for an arc that is a power series: series (3, order + 1) of the signals in tau."""
    last = series.shape[1] - 1
    for j in range(0, rows, 2):
        value, slope, bend = series[j, last], 0.0, 0.0
        for i in range(last - 1, -1, -1):
            bend = bend * tau + slope
            slope = slope * tau + value
            value = value * tau + series[j, i]
        pad[HERE + 3 * j] = value
        pad[HERE + 3 * j + 1] = slope
        pad[HERE + 3 * j + 2] = 2.0 * bend


@compiled
def look(tau: float, u: float, mode: int, rows: int, pad: Floats, series: Any) -> tuple[float, float]:
    """Evaluate the arc, whichever kind it is; a power series where mode is negative."""
    if series is None:
        return evaluate(tau, u, rows, pad)
    else:
        if mode < 0:
            evaluate_series(tau, rows, series, pad)
            return 1.0, 1.0
        return evaluate(tau, u, rows, pad)


@compiled
def find_root(a: float, b: float, j: int, u: float, mode: int, rows: int, pad: Floats, series: Any,
              at_zero: bool) -> float:
    """The one root of signal j in (a, b], by Newton's method within a bracket; the look HERE is left near it."""
    left, right = pad[LEFT + 3 * j], pad[RIGHT + 3 * j]
    x = b if at_zero else a + (b - a) * left / (left - right)
    low, high = a, b
    for _ in range(80):
        look(x, u, mode, rows, pad, series)
        pad[COUNT] += 1.0
        value, slope = pad[HERE + 3 * j], pad[HERE + 3 * j + 1]
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
def find_extreme(a: float, b: float, u: float, mode: int, pad: Floats, series: Any, size: float) -> float:
    """The value of signal 0 where its slope, of opposite sign at a and b, is 0."""
    p, q = pad[LEFT + 1], pad[RIGHT + 1]
    x = a + (b - a) * p / (p - q)
    low, high = a, b
    for _ in range(60):
        look(x, u, mode, 2 if mode == STICK else 1, pad, series)
        pad[COUNT] += 1.0
        slope, bend = pad[HERE + 1], pad[HERE + 2]
        if (slope > 0.0) == (p > 0.0):
            low = x
        else:
            high = x
        step = -slope / bend if bend != 0.0 else 0.0
        if abs(slope * step) <= 1e-15 * size or high - low <= 1e-15 * b:
            return pad[HERE] + 0.5 * slope * step  # type: ignore[no-any-return]
        x = x + step if low < x + step < high else 0.5 * (low + high)
    return pad[HERE]  # type: ignore[no-any-return]


@compiled
def search(span: float, u: float, mode: int, upward: float, offset: float, tolerance: float, steepest: float,
           shortest: float,
           pad: Floats, series: Any, bend: float, size: float) -> tuple[int, float]:
    """The first event in (0, span] of the arc that starts at u; the extremes of v until then, less its ends, go to the
    pad.

    Returns (signal, tau), or (NONE, span), or (EXHAUSTED, tau) where the evaluations run out. A signal that starts at
    `tolerance` or below starts at its root, which is no event unless it falls faster than `steepest`. `mode` is
    negative for a power series, whose fourth derivative is bounded by `bend`. v = upward (signal 0 + offset).
    """
    rows = 2 if mode == STICK else 1
    fade, other = look(0.0, u, mode, rows, pad, series)
    for i in range(6):
        pad[LEFT + i] = pad[HERE + i]
    fresh0, fresh1 = mode != FREE and pad[LEFT] <= tolerance, rows == 2 and pad[LEFT + 3] <= tolerance
    if fresh0 and pad[LEFT + 1] < -steepest:
        return 0, 0.0
    a, grow = 0.0, np.inf
    while a < span:
        bound0, bound1 = bend, 0.0
        if mode >= 0:
            free = abs(pad[ARC + 2]) * fade + abs(pad[ARC + 3]) * other
            bound0 = fourth_bound(0, fade, other, pad)
            size = pad[SIZE] + free + abs(pad[LEFT])
            if rows == 2:
                bound1 = fourth_bound(1, fade, other, pad)
        room = 4.0 * size / max(bound0, bound1) if max(bound0, bound1) > 0.0 else np.inf
        h = min(np.sqrt(np.sqrt(room)), grow)
        if a + 1.2 * h >= span:
            h = span - a
        crossing = False
        while True:
            b = a + h if a + h < span else span
            fade, other = look(b, u, mode, rows, pad, series)
            for i in range(6):
                pad[RIGHT + i] = pad[HERE + i]
            pad[COUNT] += 1.0
            if pad[COUNT] > pad[MOST] or not np.isfinite(pad[RIGHT]):
                return EXHAUSTED, a
            proven, crossing = True, False
            if mode != FREE:
                for j in range(rows):
                    verdict = passes(h, j, bound0 if j == 0 else bound1, fresh0 if j == 0 else fresh1, pad)
                    proven, crossing = proven and verdict >= 0, crossing or verdict == 1
            if proven and mode != STICK:
                proven = note_inside(a, b, u, mode, upward, offset, crossing, pad, series, bound0, size)
            if proven:
                break
            if h <= shortest:
                crossing = mode != FREE and ((pad[RIGHT] <= 0.0 and not fresh0)
                                             or (rows == 2 and pad[RIGHT + 3] <= 0.0 and not fresh1))
                break
            h *= 0.5
        if crossing:
            first, signal = np.inf, NONE
            for j in range(rows):
                if pad[RIGHT + 3 * j] <= 0.0:
                    at_zero = fresh0 if j == 0 else fresh1
                    tau = find_root(a, b, j, u, mode, rows, pad, series, at_zero)
                    if tau < first:
                        first, signal = tau, j
            return signal, first
        a = b
        grow = 2.0 * h
        for i in range(6):
            pad[LEFT + i] = pad[RIGHT + i]
        fresh0, fresh1 = fresh0 and pad[LEFT] <= tolerance, fresh1 and pad[LEFT + 3] <= tolerance
        if mode == FREE:
            note(pad[LEFT], pad)
        elif mode != STICK:
            note(upward * max(pad[LEFT] + offset, 0.0), pad)
    return NONE, span


@compiled
def note(v: float, pad: Floats) -> None:
    """Widen the extremes (largest, smallest) to take in v."""
    pad[HIGHEST] = max(pad[HIGHEST], v)
    pad[LOWEST] = min(pad[LOWEST], v)


@compiled
def note_inside(a: float, b: float, u: float, mode: int, upward: float, offset: float, crossing: bool, pad: Floats,
                series: Any, fourth: float, size: float) -> bool:
    """Take in an extreme inside the cell, if it matters; False where the cell is too long to tell whether there is one.
    """
    h = b - a
    slack = fourth * h * h * h
    e = slack * h / 384.0
    g, p, g1, q = pad[LEFT], pad[LEFT + 1], pad[RIGHT], pad[RIGHT + 1]
    one, two = g + h * p / 3.0, g1 - h * q / 3.0
    top = upward * (max(max(g, one), max(two, g1)) + e + offset)
    foot = upward * (min(min(g, one), min(two, g1)) - e + offset)
    if max(top, foot) <= pad[HIGHEST] and min(top, foot) >= pad[LOWEST]:
        return True
    curve = bent(h, pad[LEFT + 2], pad[RIGHT + 2], fourth)
    if curve != 0 and (p > 0.0) != (q > 0.0):
        value = find_extreme(a, b, u, mode, pad, series, size)
        if mode == FREE:
            note(value, pad)
        elif value > 0.0 or not crossing:
            note(upward * max(value + offset, 0.0), pad)
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
def passes(h: float, j: int, fourth: float, at_zero: bool, pad: Floats) -> int:
    """0: no root in (a, b] is proven; 1: exactly one is proven (or the one at b); -1: neither."""
    g, p, g1, p1 = pad[LEFT + 3 * j], pad[LEFT + 3 * j + 1], pad[RIGHT + 3 * j], pad[RIGHT + 3 * j + 1]
    curve = bent(h, pad[LEFT + 3 * j + 2], pad[RIGHT + 3 * j + 2], fourth)
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
