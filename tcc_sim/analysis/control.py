"""What a controller is judged by: cycle means beside the target, pressures, events, and how well it held it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.trajectory import Floats

MOST_STEPS = 200_000
"""Most values of a held signal that are kept for a picture; the earliest go first."""
SETTLED = 0.02
"""Part of the step, or of the target where that is larger, within which the cycle mean counts as settled."""


@dataclass(frozen=True)
class Steps:
    """A signal that holds its value until the next one: times (s) and values, (n,) arrays."""

    t: Floats
    values: Floats

    def until(self, end: float) -> Steps:
        """The same with its last value again at `end`, for drawing."""
        if not len(self.t) or self.t[-1] >= end:
            return self
        return Steps(np.append(self.t, end), np.append(self.values, self.values[-1]))

    @staticmethod
    def none() -> Steps:
        """Nothing was said."""
        return Steps(np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Event:
    """An instant of simulation time, s, at which something other than physics changed the run, and what that was."""

    t: float
    text: str


@dataclass(frozen=True)
class Control:
    """One run of a recording as a controller's test.

    t, mean_slip : (n,) ends of the whole engine cycles, s, and the mean slip speed of each, rad/s
    target : what the slip controller was asked to hold, rad/s
    command, applied : actuation pressure, Pa, as commanded and as each cycle applied it last
    events : changed parameters, fallbacks and resets
    """

    t: Floats
    mean_slip: Floats
    target: Steps = field(default_factory=Steps.none)
    command: Steps = field(default_factory=Steps.none)
    applied: Steps = field(default_factory=Steps.none)
    events: tuple[Event, ...] = ()

    @property
    def controlled(self) -> bool:
        """Whether a pressure or a target was recorded."""
        return bool(len(self.target.t) or len(self.command.t) or len(self.applied.t))


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
