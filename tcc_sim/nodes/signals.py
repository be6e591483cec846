"""SIGINT, SIGTERM and SIGHUP in the process of a node, from its first statement to its last. Loads nothing slow.

A node's process takes them before it imports NumPy, Numba and rclpy, and a thread waits for what their handlers write
into a pipe. While the process starts (imports, ROS 2, compiling) nothing is open that has to be saved, and a signal
ends it at once with status 0; where a call of the middleware holds the interpreter, by itself (`left_to_the_system`).
Once `leave_to_ros` was called a signal shuts the ROS 2 context down, and the node ends in order; it does so between two
`deferred` blocks, never within one.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn
from weakref import WeakSet

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_STARTING, _RUNNING, _ENDING = "starting", "running", "ending"
_phase = ""
_turn = threading.Lock()
"""Who has it reads or changes the phase."""
_holding = threading.RLock()
"""Who has it can rely on the context to stay as it is."""
_before: dict[signal.Signals, Any] = {}
_pipe: tuple[int, int] = (-1, -1)
_waiter: threading.Thread | None = None
_spinning: WeakSet[Any] = WeakSet()
"""Executors that are woken when a signal has shut the context down, as long as somebody else holds them."""
asked = threading.Event()
"""Set when a signal has come since `leave_to_ros`."""


def take() -> None:
    """From now on a signal ends the process at once with status 0; the first thing that a node's process does.

    Only what starts a process calls it: an importer of the nodes keeps its own handlers. SIGHUP stays ignored where it
    is, as under nohup.
    """
    global _phase, _pipe, _waiter
    if _phase or threading.current_thread() is not threading.main_thread():
        return
    _phase, _pipe = _STARTING, os.pipe()
    os.set_blocking(_pipe[1], False)
    signal.set_wakeup_fd(_pipe[1], warn_on_full_buffer=False)
    for number in ENDING:
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            _before[number] = signal.getsignal(number)
            _handle(number, _written)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    _waiter = threading.Thread(target=_wait, name="signals", daemon=True)
    _waiter.start()


def _handle(number: signal.Signals, handler: Any) -> None:
    """Have a handler; no call of a library fails because its signal came."""
    signal.signal(number, handler)
    signal.siginterrupt(number, False)


def _written(number: int, frame: FrameType | None) -> None:
    """Nothing more: the number is in the pipe already, whichever thread has got the signal."""


def _wait() -> None:
    """End the process at once while it starts; shut the context down while it runs; nothing while it ends."""
    while os.read(_pipe[0], 1):
        with _turn:
            if _phase == _STARTING:
                os._exit(0)
            running = _phase == _RUNNING
        if running:
            asked.set()
            with _holding:
                _shut_down()


def _shut_down() -> None:
    """Shut the context down, which leaves its nodes to those who have them, and wake who spins."""
    import rclpy

    handle = rclpy.get_default_context().handle
    if handle is not None:
        with handle:
            if handle.ok():
                handle.shutdown()
    for executor in list(_spinning):
        executor.wake()


@contextmanager
def left_to_the_system() -> Iterator[None]:
    """Within it a signal ends the process by itself: for calls that hold the interpreter while nothing is open."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: handler for number in ENDING if callable(handler := signal.getsignal(number))}
    for number in handlers:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            _handle(number, handler)


@contextmanager
def deferred() -> Iterator[None]:
    """Within it no signal shuts the context down, and in a command none is a KeyboardInterrupt; one that comes
    meanwhile has its effect afterwards.
    """
    with _holding:
        if _phase or threading.current_thread() is not threading.main_thread():
            yield
            return
        handlers = {number: handler for number in ENDING if callable(handler := signal.getsignal(number))}
        came: list[signal.Signals] = []
        for number in handlers:
            signal.signal(number, lambda number, _: came.append(signal.Signals(number)))
        try:
            yield
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    if came:
        handlers[came[0]](came[0], None)


def wake_when_asked(executor: Any) -> None:
    """Have an executor of rclpy woken when a signal has shut the context down."""
    _spinning.add(executor)


def leave_to_ros() -> None:
    """From now on a signal shuts the ROS 2 context down and the node ends in order; none is lost in between."""
    global _phase
    with _turn:
        if _phase == _STARTING:
            _phase = _RUNNING


def end(status: int) -> NoReturn:
    """The last thing that a node's process does: it ends here with `status`, and signals change nothing any more.

    The interpreter is not taken down: that takes up to a second on a busy machine, saves nothing, and a thread that
    still compiles would not survive it.
    """
    global _phase
    with _turn:
        _phase = _ENDING
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            status = status or 1
    os._exit(status)


def give_back() -> None:
    """The signals as they were before `take`, where there is no node to run after all."""
    global _phase, _waiter
    if _waiter is None:
        return
    with _turn:
        _phase = ""
    signal.set_wakeup_fd(-1)
    for number, handler in _before.items():
        signal.signal(number, handler)
    _before.clear()
    os.close(_pipe[1])
    _waiter.join()
    _waiter = None
    os.close(_pipe[0])
