"""Absolute deadlines on the monotonic clock, for a loop that must not drift. Free of ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

CATCH_UP = 0.1
"""Real time, s, that a late loop makes good by ticks without a wait; beyond it the deadlines are moved."""
SLICE = 0.05
"""Longest sleep, s, between two looks at whether to stop."""
LEAD, LEAD_PART = 3e-5, 0.1
"""Most real time, s and as a part of the period, that a sleep ends ahead of the deadline; the rest is waited for
awake.
"""
_LEAD_UP, _LEAD_DOWN = 3e3, 1e3
"""Steps, ns, of the lead after a wake-up that was later or earlier than it: it follows the upper quartile."""


class Pacer:
    """Deadlines one period apart, counted from an anchor, and what was late.

    A late wake-up shortens the next waits, so that the loop is back on its deadlines after at most CATCH_UP seconds'
    worth of ticks. Where it is later than that, the anchor moves to now: the ticks in between are missed in real time
    (never in simulated time) and counted.

    A sleeper is woken some time after what it asked for. The sleep before a deadline ends ahead by as much as three of
    four recent wake-ups were late, within LEAD, and what is left is waited for awake: a tick is never early.

    Parameters
    ----------
    period : real time between ticks, s
    kept : how many of the last latenesses are kept for `lateness`
    clock : monotonic time, ns
    sleep : sleeps for so many seconds
    lead : most that a sleep ends ahead of the deadline, s; 0 sleeps until the deadline
    """

    def __init__(self, period: float, kept: int = 10_000, clock: Callable[[], int] = time.monotonic_ns,
                 sleep: Callable[[float], object] = time.sleep, lead: float = LEAD) -> None:
        self.period_ns = period * 1e9
        self._clock, self._sleep = clock, sleep
        self.ticks = 0
        self.late_ticks = 0
        self.missed_ticks = 0
        self.lateness_max = 0.0
        self._lead_limit = lead * 1e9
        self._lead = 0.0
        self._recent = [0.0] * kept
        self.anchor()

    def anchor(self) -> None:
        """Count deadlines from now: at the start, after a pause, after a change of the period."""
        self._anchor = self._first = self._last = float(self._clock())
        self._anchor_tick = self._first_tick = self.ticks
        self._most_lead = min(self._lead_limit, LEAD_PART * self.period_ns)

    @property
    def drift(self) -> float:
        """Real time at the last tick since the last `anchor()`, beyond what the ticks since then stand for, s."""
        return (self._last - self._first - (self.ticks - self._first_tick) * self.period_ns) * 1e-9

    def wait(self, interrupted: Callable[[], bool]) -> bool:
        """Sleep until the next deadline; True when it has come, also where it had passed before.

        False as soon as `interrupted()` holds, which is looked at every SLICE: the deadline is then still the next one.
        """
        deadline = self._anchor + (self.ticks - self._anchor_tick + 1) * self.period_ns
        now = float(self._clock())
        while now < deadline:
            if interrupted():
                return False
            began, asked = now, deadline - now - self._lead
            if asked > 0.0:
                self._sleep(min(asked * 1e-9, SLICE))
            now = float(self._clock())
            if 0.0 < asked <= SLICE * 1e9:
                lead = self._lead + (_LEAD_UP if now - began - asked > self._lead else -_LEAD_DOWN)
                self._lead = min(max(lead, 0.0), self._most_lead)
        late = now - deadline
        lateness = late * 1e-9
        self._recent[self.ticks % len(self._recent)] = lateness
        self.ticks += 1
        self._last = now
        if lateness > self.lateness_max:
            self.lateness_max = lateness
        if late > self.period_ns:
            self.late_ticks += 1
        if lateness > CATCH_UP:
            self.missed_ticks += int(late // self.period_ns)
            self._anchor, self._anchor_tick = now, self.ticks
        return True

    def latenesses(self) -> NDArray[np.float64]:
        """Lateness of the last ticks, s, in no order."""
        return np.array(self._recent[:self.ticks])

    def lateness(self) -> tuple[float, float]:
        """Median and 99th percentile of the lateness of the last ticks, s."""
        if not self.ticks:
            return 0.0, 0.0
        middle, high = np.percentile(self.latenesses(), (50, 99))
        return float(middle), float(high)
