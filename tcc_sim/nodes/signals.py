"""SIGINT, SIGTERM and SIGHUP in the process of a node, from its first statement to its last. Loads nothing slow.

A node's process blocks them before it imports NumPy, Numba and rclpy; all its threads inherit that, and one of them
waits for a signal. While the process starts (imports, ROS 2, compiling), nothing is open that has to be saved, and
a signal ends it at once with status 0. After `end_in_order` a signal sets `asked`: the node looks at it several times
a second and ends by itself. Its ROS 2 context stays valid until then.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

Made = TypeVar("Made")
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
asked = threading.Event()
"""Set when a signal has come since `end_in_order`."""
_turn = threading.Lock()
"""Guards `_phase`."""
_phase = ""


def take() -> None:
    """Let a signal end the process at once with status 0, from now on; the first thing that a node's process does.

    Only a process that is a node calls it: a program that imports the nodes keeps its own handlers. SIGHUP stays
    ignored where it is, as under nohup.
    """
    global _phase
    if _phase or threading.current_thread() is not threading.main_thread():
        return
    _phase = "starting"
    numbers = [n for n in ENDING if n != signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    for number in numbers:
        signal.signal(number, signal.SIG_DFL)
    threading.Thread(target=_wait, args=(numbers,), name="signals", daemon=True).start()


def _wait(numbers: list[signal.Signals]) -> None:
    """Wait for signals: end the process while it starts, set `asked` afterwards."""
    while True:
        signal.sigwait(numbers)
        with _turn:
            if _phase == "starting":
                os._exit(0)
        asked.set()


def end_in_order() -> None:
    """Leave the end to the node: from now on a signal sets `asked`."""
    global _phase
    with _turn:
        _phase = _phase and "running"


def end(status: int) -> NoReturn:
    """End the process with `status`; the last thing that a node's process does.

    The interpreter is not taken down: that takes up to a second on a busy machine, saves nothing, and a thread that
    still compiles would not survive it.
    """
    end_in_order()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            status = status or 1
    os._exit(status)


def left_to_the_system(create: Callable[[], Made]) -> Made:
    """Call `create` while a signal ends the process by itself: the middleware may hold the interpreter for minutes.

    `create` runs in another thread, so that threads of the middleware start with the signals of a node blocked.
    """
    if threading.current_thread() is not threading.main_thread():
        return create()
    found: list[Any] = []
    unblocked = threading.Event()

    def work() -> None:
        unblocked.wait()
        try:
            found.append(create())
        except BaseException as error:
            found.extend((None, error))

    thread = threading.Thread(target=work, name="creation", daemon=True)
    with _handled(signal.SIG_DFL):
        thread.start()
        mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        try:
            unblocked.set()
            thread.join()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    if len(found) > 1:
        raise found[1]
    made: Made = found[0]
    return made


@contextmanager
def deferred() -> Iterator[None]:
    """Hold back the KeyboardInterrupt of a command: a signal that comes within the block has its effect afterwards."""
    came: list[signal.Signals] = []
    with _handled(lambda number, _: came.append(signal.Signals(number))) as handlers:
        yield
    if came:
        handlers[came[0]](came[0], None)


@contextmanager
def _handled(handler: Any) -> Iterator[dict[signal.Signals, Any]]:
    """Replace the handlers written in Python, which a command has, for the time of a `with`; gives those handlers."""
    mine = threading.current_thread() is threading.main_thread()
    handlers = {n: own for n in ENDING if mine and callable(own := signal.getsignal(n))}
    for number in handlers:
        signal.signal(number, handler)
    try:
        yield handlers
    finally:
        for number, own in handlers.items():
            signal.signal(number, own)
