"""How well a controller holds its target: the slip speed's mean over each engine cycle against what was asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcc_sim.trajectory import Floats

SETTLED = 0.02
"""Part of the step, or of the target where that is larger, within which the cycle mean counts as settled."""


@dataclass(frozen=True)
class Tracking:
    """The cycle mean of the slip speed against a target that was held; the fields are JSON keys of `analyse`.

    target, mean_slip : rad/s; the mean over the kept cycles
    rms_error, largest_error : of the cycle mean minus the target over the kept cycles, rad/s
    overshoot : how far the cycle mean went beyond the target, seen from where it started, rad/s, in all cycles
    settling_time : s until the cycle mean stays within SETTLED; NaN where it does not
    """

    target: float
    mean_slip: float
    rms_error: float
    largest_error: float
    overshoot: float
    settling_time: float


def tracking(target: float, means: Floats, cycle: float, discard: int) -> Tracking:
    """Judge cycle means, (n,) array in rad/s, NaN where a cycle was not observed.

    Parameters
    ----------
    target : rad/s
    cycle : engine cycle, s
    discard : cycles dropped from mean and errors
    """
    error = means - target
    kept = error[discard:][np.isfinite(error[discard:])]
    seen = error[np.isfinite(error)]
    if not len(seen):
        return Tracking(target, *(math.nan,) * 5)
    start = float(seen[0])
    beyond = -seen if start > 0.0 else seen
    outside = np.flatnonzero(~(np.abs(error) <= SETTLED * max(abs(start), abs(target))))
    settled = int(outside[-1]) + 1 if len(outside) else 0
    return Tracking(
        target=target, mean_slip=float(kept.mean()) + target if len(kept) else math.nan,
        rms_error=float(np.sqrt(np.mean(kept * kept))) if len(kept) else math.nan,
        largest_error=float(np.abs(kept).max()) if len(kept) else math.nan,
        overshoot=max(float(beyond.max()), 0.0), settling_time=settled * cycle if settled < len(error) else math.nan)
