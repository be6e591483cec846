"""Work in a thread of its own, which may be waited for in parts, and left behind."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


def begun(work: Callable[[], Result], name: str = "background") -> tuple[Future[Result], threading.Thread]:
    """What `work` will give, and the daemon thread that does it, which no end of the process waits for.

    The future holds the result or whatever `work` raised. The executors of `concurrent.futures` wait for their
    threads when the process ends, and so cannot leave one behind.
    """
    found: Future[Result] = Future()

    def body() -> None:
        try:
            found.set_result(work())
        except BaseException as error:
            found.set_exception(error)

    thread = threading.Thread(target=body, name=name, daemon=True)
    thread.start()
    return found, thread
