"""SIGINT and SIGTERM in the process of a node, from its first statement to its last. Loads nothing slow.

A node's process takes the signals before it imports NumPy, Numba and rclpy. While it starts (imports, ROS 2, compiling)
nothing is open that has to be saved, and a signal ends the process at once with status 0: the handler does where the
interpreter runs, a thread that waits for the same signal does where the main thread is in a long call, such as LLVM's.
Once `leave_to_ros` was called a signal shuts the context down, as in any ROS 2 node, and the node ends in order.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType
from typing import Any

COMPILER = "compiler"
"""Name of a thread that may be in LLVM when the process ends."""
ENDING = frozenset({signal.SIGINT, signal.SIGTERM})
_taken = False
_starting = False
_before: dict[signal.Signals, Any] = {}


def take() -> None:
    """From now on SIGINT and SIGTERM end the process at once with status 0; the first thing that a node's process does.

    Only what starts a process calls it: an importer of the nodes keeps its own handlers.
    """
    global _taken, _starting
    if _taken or threading.current_thread() is not threading.main_thread():
        return
    _taken = _starting = True
    for number in ENDING:
        _before[number] = signal.signal(number, _on_signal)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    # The thread inherits the mask: the signals are delivered to the main thread.
    hold()
    threading.Thread(target=_watch, args=(reader,), name="signals", daemon=True).start()
    release()


def _on_signal(number: int, frame: FrameType | None) -> None:
    """End at once while starting; later ROS 2 has its own handler before this one."""
    if _starting:
        os._exit(0)


def _watch(reader: int) -> None:
    """End at once on the first signal while starting, though the main thread is in a call that takes long."""
    while (numbers := os.read(reader, 16)) and _starting:
        if ENDING & set(numbers):
            os._exit(0)


def hold() -> None:
    """Let SIGINT and SIGTERM wait."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


def release() -> None:
    """Take SIGINT and SIGTERM again, those that waited first."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


def leave_to_ros() -> None:
    """From now on a signal shuts the ROS 2 context down and the node ends in order; none is lost in between."""
    global _starting
    from rclpy.signals import SignalHandlerOptions, install_signal_handlers

    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    _starting = False
    install_signal_handlers(SignalHandlerOptions.ALL)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end(status: int) -> int:
    """The last thing before the process ends with `status`, which it gives: signals change nothing any more.

    Where a thread still compiles it ends here: LLVM does not survive that the interpreter is taken down under it.
    """
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if any(thread.name == COMPILER for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def give_back() -> None:
    """The handlers as they were before `take`, where there is no node to run after all."""
    global _taken, _starting
    _taken = _starting = False
    signal.set_wakeup_fd(-1)
    for number, handler in _before.items():
        signal.signal(number, handler)
    _before.clear()
