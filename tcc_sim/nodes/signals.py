"""Handle SIGINT, SIGTERM and SIGHUP in a node's process, from its first statement on; imports nothing slow.

A node's process blocks these signals before it imports NumPy, Numba and rclpy; its threads inherit this, and one thread
waits for a signal. While the process starts (imports, ROS 2, compiling), no data has to be saved, and a signal ends it
at once with status 0. After `end_in_order` a signal sets `end_requested`, which the node checks several times a second
to end by itself. Its ROS 2 context stays valid until then.
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
end_requested = threading.Event()
"""Set by the first signal after `end_in_order`."""
_turn = threading.Lock()
"""Lock of `_phase`."""
_phase = ""


def take() -> None:
    """Let a signal end the process at once with status 0; a node's process calls this first.

    A program that only imports the nodes does not call it and keeps its own handlers. SIGHUP stays ignored if it was,
    as under nohup.
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
    """Wait for signals: end the process during its start, set `end_requested` afterwards."""
    while True:
        signal.sigwait(numbers)
        with _turn:
            if _phase == "starting":
                os._exit(0)
        end_requested.set()


def end_in_order() -> None:
    """Let a signal set `end_requested` from now on, so that the node ends by itself."""
    global _phase
    with _turn:
        _phase = _phase and "running"


def end(status: int) -> NoReturn:
    """End the process with `status`; a node's process calls this last.

    The interpreter is not shut down: this would take up to a second on a busy machine, saves nothing, and could crash a
    thread that still compiles.
    """
    end_in_order()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            status = status or 1
    os._exit(status)


def left_to_the_system(create: Callable[[], Made]) -> Made:
    """Call `create` while signals have their default effect: the middleware may block the interpreter for minutes.

    `create` runs in another thread, so that threads of the middleware start with the node's signals blocked.
    """
    if threading.current_thread() is not threading.main_thread():
        return create()
    handlers: list[Any] = []
    unblocked = threading.Event()

    def work() -> None:
        unblocked.wait()
        try:
            handlers.append(create())
        except BaseException as error:
            handlers.extend((None, error))

    thread = threading.Thread(target=work, name="creation", daemon=True)
    with _handled(signal.SIG_DFL):
        thread.start()
        mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        try:
            unblocked.set()
            thread.join()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    if len(handlers) > 1:
        raise handlers[1]
    made: Made = handlers[0]
    return made


@contextmanager
def deferred() -> Iterator[None]:
    """Delay the KeyboardInterrupt of a command: a signal during the `with` block takes effect after it."""
    came: list[signal.Signals] = []
    with _handled(lambda number, _: came.append(signal.Signals(number))) as handlers:
        yield
    if came:
        handlers[came[0]](came[0], None)


@contextmanager
def _handled(handler: Any) -> Iterator[dict[signal.Signals, Any]]:
    """Replace the process's Python handlers for the duration of a `with` block, and yield the replaced handlers."""
    mine = threading.current_thread() is threading.main_thread()
    handlers = {n: previous for n in ENDING if mine and callable(previous := signal.getsignal(n))}
    for number in handlers:
        signal.signal(number, handler)
    try:
        yield handlers
    finally:
        for number, previous in handlers.items():
            signal.signal(number, previous)
