"""Pace a loop without drift by absolute deadlines, and set timer slack, priority, cores and memory locking on Linux.

The names and meanings of the last three are those of ros2_control's controller manager. No ROS is needed here.
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
"""Largest lateness, s, that the loop makes up by ticks without a wait; beyond it the deadlines move."""
SLICE = 0.05
"""Longest sleep between two checks for an interruption, s."""
LEAD, LEAD_PART = 3e-5, 0.1
"""Largest time by which a sleep ends before the deadline, s and as a fraction of the period; a busy wait follows."""
_LEAD_UP, _LEAD_DOWN = 3e3, 1e3
"""Steps of the lead, ns, after a wake-up that was later or earlier than it: the lead follows the upper quartile."""
TIMER_SLACK_NS = 1
"""Largest delay of a wake-up allowed to the kernel, ns; 50 000 by default."""
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE = 1, 2


def tick_time_of(rate: float, factor: float) -> float:
    """Return the real time of a tick, s; 0 for as fast as possible.

    rate : ticks per simulated second, Hz
    factor : simulated seconds per second of real time
    """
    return 1.0 / (rate * factor) if factor > 0.0 else 0.0


class Pacer:
    """Deadlines one period apart from an anchor, with counts of late ticks.

    A late wake-up shortens the next waits, so that the loop catches up a lateness of at most CATCH_UP. If it is later
    than that, the anchor moves to the current time: the ticks between are missed in real time (never in simulated time)
    and counted.

    The system wakes a sleeping thread late. The sleep before a deadline therefore ends earlier by the lateness that
    three of four recent wake-ups did not exceed, at most LEAD, and a busy wait follows: a tick is never early.

    Parameters
    ----------
    period : real time between ticks, s
    kept : number of last latenesses stored for `latenesses`
    clock : function that returns monotonic time, ns
    sleep : function that sleeps for a number of seconds
    lead : largest time by which a sleep ends before the deadline, s; 0 to sleep until the deadline

    Attributes
    ----------
    ticks, late_ticks : numbers of ticks, and of those more than a period late
    missed_ticks : number of ticks missed in real time
    missed_by : lateness at the last ticks that were missed, s
    """

    def __init__(self, period: float, kept: int = 10_000, clock: Callable[[], int] = time.monotonic_ns,
                 sleep: Callable[[float], object] = time.sleep, lead: float = LEAD) -> None:
        self.period_ns = period * 1e9
        self._clock, self._sleep = clock, sleep
        self.ticks = 0
        self.late_ticks = 0
        self.missed_ticks = 0
        self.lateness_max = self.missed_by = 0.0
        self._lead_limit = lead * 1e9
        self._lead = 0.0
        self._recent = np.zeros(kept)
        self.anchor()

    def anchor(self) -> None:
        """Count deadlines from now on; call it at the start, after a pause, and after a change of the period."""
        self._anchor = self._first = self._last = float(self._clock())
        self._anchor_tick = self._first_tick = self.ticks
        self._most_lead = min(self._lead_limit, LEAD_PART * self.period_ns)

    @property
    def drift(self) -> float:
        """Real time from the last `anchor()` to the last tick minus the periods of the ticks between, s."""
        return (self._last - self._first - (self.ticks - self._first_tick) * self.period_ns) * 1e-9

    def wait(self, interrupted: Callable[[], bool]) -> bool:
        """Sleep until the next deadline and return True, also if it had passed before.

        Return False as soon as `interrupted()`, checked every SLICE, is true; the next deadline stays the same.
        """
        deadline = self._anchor + (self.ticks - self._anchor_tick + 1) * self.period_ns
        now = float(self._clock())
        while now < deadline:
            if interrupted():
                return False
            began, remaining = now, deadline - now - self._lead
            if remaining > 0.0:
                self._sleep(min(remaining * 1e-9, SLICE))
            now = float(self._clock())
            if 0.0 < remaining <= SLICE * 1e9:
                lead = self._lead + (_LEAD_UP if now - began - remaining > self._lead else -_LEAD_DOWN)
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
            self.missed_by = lateness
            self._anchor, self._anchor_tick = now, self.ticks
        return True

    def latenesses(self) -> NDArray[np.float64]:
        """Return the latenesses of the last ticks, s, unordered."""
        return np.array(self._recent[:self.ticks])


def prepare_thread(priority: int = 0, cores: Sequence[int] = (), lock_memory: bool = False,
                   timer_slack_ns: int = TIMER_SLACK_NS) -> list[str]:
    """Prepare the calling thread for deadlines; return a sentence for each setting that the system refused.

    priority : SCHED_FIFO priority, 1 to 99; 0 leaves the policy unchanged
    cores : cores on which the thread may run; empty for no change
    lock_memory : whether to lock the present and future memory of the process
    timer_slack_ns : largest delay of a wake-up allowed to the kernel, ns
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
            allowed = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            refused.append(f"cpu_affinity {list(cores)} was not granted ({error.strerror}): the thread stays on "
                           f"{allowed}")
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
    """Schedule every thread of this process one below its real-time thread, which has `priority`; 0 undoes this.

    The real-time thread waits for any thread that holds the interpreter or a lock of the middleware. At the default
    priority, that thread would wait for the other programs of the machine.

    priority : priority of the real-time thread
    except_for : native ids of the threads to leave unchanged
    """
    if sys.platform != "linux":
        return
    policy, level = (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, max(priority - 1, 1)) if priority else (os.SCHED_OTHER, 0)
    for thread in map(int, os.listdir("/proc/self/task")):
        if thread not in except_for:
            with suppress(OSError):  # Not permitted, or the thread has ended.
                os.sched_setscheduler(thread, policy, os.sched_param(level))


def release_memory() -> None:
    """Undo `lock_memory`."""
    if sys.platform == "linux":
        ctypes.CDLL(None).munlockall()
