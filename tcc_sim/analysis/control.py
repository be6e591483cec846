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


class CycleMeans:
    """The mean slip speed of whole engine cycles from samples as they come, by the trapezoidal rule.

    Parameters
    ----------
    cycle : engine cycle, s; cycle n starts at t = n cycle
    """

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self.restart()

    def restart(self) -> None:
        """Forget the samples at hand: time has started again, or there is a gap."""
        self._t, self._v = np.empty(0), np.empty(0)

    def feed(self, t: Floats, slip_speed: Floats) -> tuple[Floats, Floats]:
        """Take the next samples, (n,) arrays in s and rad/s; ends and means of the cycles that they complete."""
        t, v = np.concatenate([self._t, t]), np.concatenate([self._v, slip_speed])
        slack = 1e-9
        first, last = int(np.ceil(t[0] / self._cycle - slack)), int(np.floor(t[-1] / self._cycle + slack))
        if last <= first:
            self._t, self._v = t, v
            return np.empty(0), np.empty(0)
        ends = np.arange(first, last + 1, dtype=np.float64) * self._cycle
        area = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        left = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, len(t) - 2)
        part = np.clip(ends - t[left], 0.0, None)
        slope = (v[left + 1] - v[left]) / (t[left + 1] - t[left])
        means: Floats = np.diff(area[left] + part * (v[left] + 0.5 * part * slope)) / self._cycle
        keep = max(int(np.searchsorted(t, ends[-1] + slack * self._cycle, side="right")) - 1, 0)
        self._t, self._v = t[keep:].copy(), v[keep:].copy()
        return ends[1:], means
