"""A loop that must not drift: absolute deadlines on the monotonic clock, and what its thread asks of Linux, which is
timer slack, priority, cores, and memory that stays in place. Free of ROS.

The names and meanings of the last three are those of ros2_control's controller manager.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

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
TIMER_SLACK_NS = 1
"""How much later than asked for the kernel may wake the thread, ns; 50 000 by default."""
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE = 1, 2


def tick_time_of(rate: float, factor: float) -> float:
    """Return the real time of a tick, s; 0 where it is as fast as possible.

    Parameters
    ----------
    rate : ticks per simulated second, Hz
    factor : simulated seconds per second of real time
    """
    return 1.0 / (rate * factor) if factor > 0.0 else 0.0


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


def prepare_thread(priority: int = 0, cores: Sequence[int] = (), lock_memory: bool = False,
                   timer_slack_ns: int = TIMER_SLACK_NS) -> list[str]:
    """Prepare the calling thread for deadlines; gives a sentence for each wish that was refused, which changes nothing.

    Parameters
    ----------
    priority : 1 to 99 asks for SCHED_FIFO with it; 0 leaves the policy as it is
    cores : those that the thread may run on; empty: as it is
    lock_memory : keep the memory of the whole process in place, present and future
    timer_slack_ns : how much later than asked for the kernel may wake the thread
    """
    if sys.platform != "linux":
        wished = bool(priority), bool(cores), lock_memory
        return ["thread_priority, cpu_affinity and lock_memory need Linux"] if any(wished) else []
    refused = []
    library = ctypes.CDLL(None, use_errno=True)
    library.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(timer_slack_ns), 0, 0, 0)
    if cores:
        try:
            os.sched_setaffinity(0, cores)
        except OSError as error:
            there = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            refused.append(f"cpu_affinity {list(cores)} was not granted ({error.strerror}): the thread stays on "
                           f"{there}")
    if priority:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            refused.append(f"thread_priority {priority} was not granted ({error.strerror}): the thread keeps its "
                           "scheduling; it needs CAP_SYS_NICE or an rtprio limit")
    if lock_memory and library.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        refused.append(f"lock_memory was not granted ({os.strerror(ctypes.get_errno())}): memory stays as it is; "
                       "it needs CAP_IPC_LOCK or a memlock limit")
    return refused


def attend(priority: int, except_for: Sequence[int | None] = ()) -> None:
    """Schedule every thread of this process one below its real-time thread, which has `priority`; 0 takes that back.

    The real-time thread waits for whoever holds the interpreter or a lock of the middleware, and with them for every
    other program of the machine that they have to wait for.

    Parameters
    ----------
    priority : of the real-time thread
    except_for : native ids of the threads that stay as they are
    """
    if sys.platform != "linux":
        return
    policy, level = (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, max(priority - 1, 1)) if priority else (os.SCHED_OTHER, 0)
    for thread in map(int, os.listdir("/proc/self/task")):
        if thread not in except_for:
            with suppress(OSError):  # Without the right to it, or the thread has ended.
                os.sched_setscheduler(thread, policy, os.sched_param(level))


def release_memory() -> None:
    """Take `lock_memory` back."""
    if sys.platform == "linux":
        ctypes.CDLL(None).munlockall()
