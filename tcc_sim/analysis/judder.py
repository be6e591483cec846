"""Judder of a controlled run: an oscillation of the slip speed that is too fast for the cycle means to show it.

Cycle means sample the slip speed once per engine cycle. They show an oscillation that is faster than a third of their
rate with another amplitude, and one beyond half of it with another frequency. Its frequency and amplitude are therefore
those of a sine fitted to the slip speed itself, after the part that repeats in each engine cycle is taken away. An
average over one period of this sine is free of it.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.trajectory import Floats, integral


class Signal(NamedTuple):
    """Samples of a signal: times, s, and values, (n,) arrays."""

    t: Floats
    values: Floats

    def stretches(self) -> list[Signal]:
        """Return the parts between gaps (`Settings.bridged`)."""
        if len(self.t) < 2:
            return []
        steps = np.diff(self.t)
        edges = [0, *(np.flatnonzero(steps > DEFAULTS.bridged * float(np.median(steps))) + 1).tolist(), len(self.t)]
        return [Signal(self.t[a:b], self.values[a:b]) for a, b in pairwise(edges) if b - a > 1]


NO_SIGNAL = Signal(np.empty(0), np.empty(0))


class JudderLine(NamedTuple):
    """A sine in the slip speed: amplitude, rad/s, and frequency, Hz."""

    amplitude: float
    frequency: float


def judder_line(slip: Signal, starts: Floats, ends: Floats, floor: float) -> JudderLine | None:
    """Return the judder in engine cycles, (n,) arrays of their starts and ends, s; None without any.

    Parameters
    ----------
    slip : slip speed, rad/s
    floor : least amplitude that counts, rad/s
    """
    first = _longest_run(starts, ends)
    starts, ends = starts[first], ends[first]
    n = len(starts)
    inside = (slip.t >= starts[0] - 1e-9) & (slip.t <= ends[-1] + 1e-9) if n else np.zeros(len(slip.t), dtype=np.bool_)
    points = min(int(np.count_nonzero(inside)) // max(n, 1), DEFAULTS.judder_points)
    if n < DEFAULTS.judder_cycles or points < DEFAULTS.least_samples:
        return None
    phases = (np.arange(points) + 0.5) / points
    t = starts[:, None] + (ends - starts)[:, None] * phases
    x = np.interp(t, slip.t, slip.values)
    floor = max(floor, DEFAULTS.judder_least * float(np.ptp(x.mean(axis=1))))   # Sidelobes of a slow change.
    turns = np.arange(n) - 0.5 * (n - 1)
    columns = np.stack([np.ones(n), turns, turns**2], axis=1)
    x -= columns @ np.linalg.lstsq(columns, x, rcond=None)[0]   # Excitation, and its slow change.
    spectrum = np.fft.rfft(x.ravel() * np.hanning(x.size))
    power = np.abs(spectrum) ** 2
    orders = np.arange(len(power)) / n
    slow = orders < DEFAULTS.judder
    swing = float(orders[slow][power[slow].argmax()])
    # Hann's window spreads a line over two bins; a slow swing modulates what repeats in each cycle.
    near = 2.5 / n + (1.5 * swing if power[slow].max() > 0.1 * power[~slow].max() else 0.0)
    apart = np.abs(orders - np.rint(orders))
    power[slow | (apart <= near) | (orders > 0.5 * points)] = 0.0
    total, best = float(power.sum()), int(power.argmax())
    if total == 0.0 or float(power[max(best - 2, 0):best + 3].sum()) < DEFAULTS.judder_share * total:
        return None
    at, y = (np.arange(n)[:, None] + phases).ravel(), x.ravel()
    order, amplitude = float(orders[best]), 0.0
    for width in (1.0, 0.2, 0.04):
        tried = order + width / n * np.linspace(-1.0, 1.0, 11)
        sizes = [_amplitude(at, y, each) for each in tried]
        amplitude, order = max(zip(sizes, tried.tolist()))
    return JudderLine(amplitude, order * n / float(ends[-1] - starts[0])) if amplitude > floor else None


def _longest_run(starts: Floats, ends: Floats) -> slice:
    """Return the longest run of cycles that follow each other."""
    breaks = np.flatnonzero(starts[1:] > ends[:-1] + 1e-6 * np.diff(starts)) + 1
    edges = [0, *breaks.tolist(), len(starts)]
    return max((slice(a, b) for a, b in pairwise(edges)), key=lambda part: part.stop - part.start)


def _amplitude(at: Floats, y: Floats, order: float) -> float:
    """Return the amplitude of the sine of an order that fits a signal best."""
    phase = 2.0 * math.pi * order * at
    columns = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    return float(np.hypot(*np.linalg.lstsq(columns, y, rcond=None)[0]))


def means_without(slip: Signal, starts: Floats, ends: Floats, period: float) -> Floats:
    """Return the means over cycles, (n,), of the slip speed's average over one period of a judder, s; NaN where a
    stretch without a gap is shorter than that.
    """
    out = np.full(len(starts), math.nan)
    for t, values in slip.stretches():
        inside = (starts >= t[0] - 1e-9) & (ends <= t[-1] + 1e-9) & (t[-1] - t[0] > period + ends - starts)
        # The mean over a cycle of which the start runs through a period of the judder, centred unless the stretch ends.
        length = (ends - starts)[inside]
        first = np.clip(starts[inside] - 0.5 * period, t[0], t[-1] - period - length)
        area = integral(integral(values, t), t)
        corners = [np.interp(first + shift, t, area) for shift in (0.0, length, period, period + length)]
        out[inside] = (corners[3] - corners[2] - corners[1] + corners[0]) / (period * length)
    return out
