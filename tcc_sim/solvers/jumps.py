"""Derivatives and peaks of samples that do not cross a jump, which has two samples a rounding apart."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tcc_sim.trajectory import Floats

BENT = 4.0
"""Largest ratio of second differences of power at neighbouring samples of a smooth top."""


def _pieces(t: Floats) -> NDArray[np.int64]:
    """Return the first sample of each piece between jumps and the number of samples, (k + 1,)."""
    return np.concatenate([[0], np.flatnonzero(np.diff(t) <= 2.0 * np.spacing(t[1:])) + 1, [len(t)]])


def slopes_between_jumps(t: Floats, y: Floats) -> Floats:
    """Return derivatives of samples, of second order within each piece between jumps; 0 for a single sample."""
    out: Floats = np.zeros(len(t))
    pieces = _pieces(t)
    for a, b in pairwise(pieces.tolist()):
        if b - a > 1:
            out[a:b] = np.gradient(y[a:b], t[a:b], edge_order=2 if b - a > 2 else 1)
    return out


def with_peaks(t: Floats, y: Floats) -> Floats:
    """Return samples with maxima raised to the vertex of the parabola through each and its neighbours.

    A maximum beside a jump stays as it is, and one whose parabola is bent `BENT` times as much as a neighbour's: such
    samples show no smooth top.
    """
    out: Floats = np.array(y)
    if len(y) < 3:
        return out
    h = np.diff(t)
    apart = h <= 2.0 * np.spacing(t[1:])
    slope = np.diff(y) / h
    left, right = slope[:-1], slope[1:]
    bend = np.where(apart[:-1] | apart[1:], 0.0, (right - left) / (h[:-1] + h[1:]))
    tilt = (left * h[1:] + right * h[:-1]) / (h[:-1] + h[1:])
    neighbours = np.concatenate([bend[1:2], bend, bend[-2:-1]]) if len(bend) > 1 else np.tile(bend, 3)
    # A neighbour beside a jump has no parabola of its own, and leaves the other one to say.
    least = np.fmax(np.where(neighbours[:-2] == 0.0, np.nan, neighbours[:-2]), np.where(neighbours[2:] == 0.0, np.nan,
                                                                                        neighbours[2:]))
    top = (left >= 0.0) & (right <= 0.0) & (bend < 0.0) & (BENT * least <= bend)
    out[1:-1] += np.where(top, tilt**2 / np.where(top, -4.0 * bend, 1.0), 0.0)
    return out
