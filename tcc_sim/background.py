"""Work in a daemon thread, which delays neither the end of the process nor Ctrl-C; start processes of Python safely."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TypeVar

Done = TypeVar("Done")
LOOK = 0.2
"""Interval between two checks for the end of the work, and thus for Ctrl-C, s."""


def begun(work: Callable[[], Done], name: str = "background") -> tuple[Future[Done], threading.Thread]:
    """Start `work` in a daemon thread; return the future of its result, and the thread.

    The future holds the result, or the exception that `work` raised. The executors of `concurrent.futures` are no
    alternative: they wait for their threads when the process ends.
    """
    outcome: Future[Done] = Future()

    def body() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:
            outcome.set_exception(error)

    thread = threading.Thread(target=body, name=name, daemon=True)
    thread.start()
    return outcome, thread


def awaited(work: Callable[[], Done]) -> Done:
    """Return the result of `work`. Called in the main thread, this runs `work` in another one, because Ctrl-C cannot
    interrupt compiled code or the compiler.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    outcome, thread = begun(work)
    while thread.is_alive():
        thread.join(LOOK)
    return outcome.result()


@contextmanager
def without_working_directory() -> Iterator[None]:
    """Keep the working directory off the path of Python processes that start in a `with` block, from Python 3.11 on.

    Otherwise a file there named as a module, such as `queue.py`, would be imported in place of it.
    """
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before
