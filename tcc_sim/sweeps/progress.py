"""Progress of long work: a bar on a terminal and in a notebook, elsewhere a line a minute on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

EVERY = 60.0
"""Time between two lines without a terminal, s."""
_lock = threading.RLock()
"""Lock of all bars of a process. tqdm's own lock is a system semaphore, which a killed process leaves behind."""


class ProgressLines:
    """Progress without a terminal, with the methods of tqdm's bars.

    `update` prints a line on standard error if EVERY seconds have passed since the last line or the start. Parameters
    as
    for `progress_bar`.
    """

    def __init__(self, unit: str, total: float | None, done: float, clock: Callable[[], float]) -> None:
        self.n, self.total, self._unit, self._clock, self._words = done, total, unit.strip(), clock, ""
        self._began = self._last = clock()

    def update(self, count: float = 1) -> None:
        """Count finished parts."""
        self.n += count
        now = self._clock()
        if now - self._last >= EVERY:
            self._last = now
            of = "" if self.total is None else f" of {self.total:.0f}"
            units = self._unit if self._unit.endswith("s") else f"{self._unit}s"
            sys.stderr.write(f"tcc-sim: {self.n:.0f}{of} {units} after {now - self._began:.0f} s"
                             f"{self._words and f': {self._words}'}\n")
            sys.stderr.flush()

    def set_postfix_str(self, words: str, refresh: bool = False) -> None:
        """Name the last part, or the next."""
        self._words = words

    set_description_str = set_postfix_str

    def close(self) -> None:
        """Stop printing."""


def in_notebook() -> bool:
    """Return whether an IPython kernel runs this: its standard error shows bars although it is no terminal."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def begin_progress(unit: str, total: float | None = None, done: float = 0, shown: bool = True,
                   clock: Callable[[], float] = time.monotonic, **look: Any) -> Any:
    """Return a bar or lines as `progress_bar`; the caller must close it."""
    if shown and not in_notebook() and not sys.stderr.isatty():
        return ProgressLines(unit, total, done, clock)
    from tqdm import tqdm

    tqdm.set_lock(_lock)
    return tqdm(total=total, initial=done, disable=not shown, unit=unit, **{"smoothing": 0.05, **look})


@contextmanager
def progress_bar(unit: str, total: float | None = None, done: float = 0, shown: bool = True,
                 clock: Callable[[], float] = time.monotonic, **look: Any) -> Iterator[Any]:
    """Yield a bar that its `update` moves; lines if standard error is neither a terminal nor that of a notebook.

    Parameters
    ----------
    unit : name of a part
    total : number of parts; None if it is unknown
    done : parts finished at the start
    shown : False for neither a bar nor lines
    clock : function that returns the time for the lines, s
    look : keywords of tqdm for the bar
    """
    bar = begin_progress(unit, total, done, shown, clock, **look)
    try:
        yield bar
    finally:
        bar.close()


@contextmanager
def point_bar(shown: bool = True) -> Iterator[Callable[[Any], None]]:
    """Yield a function to call with every point of a branch; it counts the points and shows the last one."""
    with progress_bar("point", shown=shown) as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.orbit.period}", refresh=False)
            bar.update()

        yield tick
