"""How far long work is: a bar on a terminal and in a notebook, elsewhere a line a minute on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

EVERY = 60.0
"""Seconds between two lines, where there is no terminal."""
_lock = threading.RLock()
"""Of all bars of a process. tqdm's own is a semaphore of the system too, which a process that is ended leaves behind.
"""


class ProgressLines:
    """Progress where there is no terminal: `update` prints a line on standard error where the last one, or the start,
    is EVERY seconds ago. Methods as those of tqdm's bars.

    unit, total, done : as those of `progress_bar`
    clock : seconds that pass
    """

    def __init__(self, unit: str, total: float | None, done: float, clock: Callable[[], float]) -> None:
        self.n, self.total, self._unit, self._clock, self._words = done, total, unit.strip(), clock, ""
        self._began = self._last = clock()

    def update(self, count: float = 1) -> None:
        """Count parts that are done."""
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
        """Print nothing more."""


def in_notebook() -> bool:
    """Whether IPython runs this in a kernel, whose standard error shows bars although it is no terminal."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def begin_progress(unit: str, total: float | None = None, done: float = 0, shown: bool = True,
                   clock: Callable[[], float] = time.monotonic, **look: Any) -> Any:
    """A bar or lines as `progress_bar`, which the caller closes."""
    if shown and not in_notebook() and not sys.stderr.isatty():
        return ProgressLines(unit, total, done, clock)
    from tqdm import tqdm

    tqdm.set_lock(_lock)
    return tqdm(total=total, initial=done, disable=not shown, unit=unit, **{"smoothing": 0.05, **look})


@contextmanager
def progress_bar(unit: str, total: float | None = None, done: float = 0, shown: bool = True,
                 clock: Callable[[], float] = time.monotonic, **look: Any) -> Iterator[Any]:
    """A bar, moved by its `update`; where standard error is neither a terminal nor a notebook's, lines.

    Parameters
    ----------
    unit : what a part is called
    total : parts; None where nobody knows
    done : parts at the start
    shown : False: neither a bar nor lines
    clock : seconds that pass, for the lines
    look : keywords of tqdm, for the bar
    """
    bar = begin_progress(unit, total, done, shown, clock, **look)
    try:
        yield bar
    finally:
        bar.close()


@contextmanager
def point_bar(shown: bool = True) -> Iterator[Callable[[Any], None]]:
    """A function to call with every point of a branch, which moves a count of them and names the last."""
    with progress_bar("point", shown=shown) as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.orbit.period}", refresh=False)
            bar.update()

        yield tick
