"""The one way that a run is timed here: the least CPU time of repeated calls."""

from __future__ import annotations

import math
import resource
import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def least_seconds(run: Callable[[], Result], repeats: int, patience: float = math.inf,
                  clock: Callable[[], float] = time.process_time) -> tuple[float, Result]:
    """The least CPU time of `run`, s, and its last result.

    Parameters
    ----------
    repeats : most calls; there is one at least
    patience : s; no further call once the calls have taken as long
    clock : CPU seconds so far; those of this process, or `of_children` for other programs
    """
    best, spent, count = math.inf, 0.0, 0
    while not count or (count < repeats and spent < patience):
        began = clock()
        found = run()
        used = clock() - began
        best, spent, count = min(best, used), spent + used, count + 1
    return best, found


def of_children() -> float:
    """CPU seconds of the processes that this one has started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
