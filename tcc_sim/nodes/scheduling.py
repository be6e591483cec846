"""What a real-time thread asks of Linux for itself: timer slack, priority, cores, and memory that stays in place.

The names and meanings of the last three are those of ros2_control's controller manager.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE = 1, 2
TIMER_SLACK_NS = 1
"""How much later than asked for the kernel may wake the thread, ns; 50 000 by default."""


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
