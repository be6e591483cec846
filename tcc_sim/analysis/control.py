"""What a controller is judged by: the cycle means of the slip speed beside the target, pressures, and events."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tcc_sim.trajectory import Floats

MOST_STEPS = 200_000
"""Most values of a held signal that are kept for a picture; the earliest go first."""


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
