"""Engine torque and actuation pressure from data, in the place of the scene's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Inputs:
    """What drives a plant from outside, as lines: (k, 3) arrays of time (s), value there and change in a second.

    torque : N m; None leaves the scene's own
    pressure : Pa; None leaves the scene's own
    end : time up to which they are known, s
    """

    torque: Floats | None
    pressure: Floats | None
    end: float


def held(t: Floats, values: Floats) -> Floats:
    """Values held from each time to the next, as lines; before the first time it is the first value."""
    return _from_the_start(np.stack([t, values, np.zeros(len(t))], axis=1))


def joined(t: Floats, values: Floats) -> Floats:
    """Values joined by straight lines, constant outside."""
    return _from_the_start(np.stack([t, values, np.append(np.diff(values) / np.diff(t), 0.0)], axis=1))


def _from_the_start(lines: Floats) -> Floats:
    """Lines that begin at time 0."""
    return lines if lines[0, 0] <= 0.0 else np.concatenate([[[0.0, lines[0, 1], 0.0]], lines])
