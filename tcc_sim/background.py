"""Work in a thread that no end of the process waits for, and that Ctrl-C does not wait for either."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Done = TypeVar("Done")
LOOK = 0.2
"""Seconds between two looks at work that is waited for; Ctrl-C is noticed by then."""


def begun(work: Callable[[], Done], name: str = "background") -> tuple[Future[Done], threading.Thread]:
    """Start `work` in a daemon thread; gives the future of its result and the thread.

    The future holds the result or whatever `work` raised. The executors of `concurrent.futures` wait for their
    threads when the process ends, and so cannot leave one behind.
    """
    found: Future[Done] = Future()

    def body() -> None:
        try:
            found.set_result(work())
        except BaseException as error:
            found.set_exception(error)

    thread = threading.Thread(target=body, name=name, daemon=True)
    thread.start()
    return found, thread


def awaited(work: Callable[[], Done]) -> Done:
    """Return what `work` gives; in the main thread another one does it, since Ctrl-C cannot interrupt compiled code or
    the compiler.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    found, thread = begun(work)
    while thread.is_alive():
        thread.join(LOOK)
    return found.result()
