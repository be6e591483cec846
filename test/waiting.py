"""Wait for another process or thread without taking the processor from it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")
LOOK, SHORT_LOOK = 0.05, 0.001
"""Time between two checks, s; the second one if a step is done between them."""


def until(predicate: Callable[[], Found], *, step: Callable[[], object] | None = None, limit: float = 120.0) -> Found:
    """Check the predicate until it holds, and return its value; fail after `limit` seconds.

    Parameters
    ----------
    step : called between two checks
    """
    never, end = threading.Event(), time.monotonic() + limit
    while not (result := predicate()):
        assert time.monotonic() < end, "the condition did not come true in time"
        if step is not None:
            step()
        never.wait(LOOK if step is None else SHORT_LOOK)
    return result


def until_or_ended(predicate: Callable[[], Found], process: object, **how: float) -> Found:
    """Do as `until`, and fail if the process ends before."""
    def looked() -> Found:
        assert process.poll() is None, "the process has ended"  # type: ignore[attr-defined]
        return predicate()

    return until(looked, **how)
