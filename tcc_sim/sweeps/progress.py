"""Progress of long work: a bar on a terminal and in a notebook, otherwise a line a minute on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tcc_sim.background import begun

EVERY = 60.0
"""Time between two lines where there is no terminal, s."""
_lock = threading.RLock()
"""Lock of all bars of a process; tqdm's own is a semaphore of the system too, which a killed process leaves behind."""


class ProgressLines:
    """Progress where there is no terminal: a line on standard error from time to time. Methods as those of tqdm's bars.

    unit, total, done : those of `progress_bar`
    every : time between two lines, s
    """

    def __init__(self, unit: str, total: float | None, done: float, every: float = EVERY) -> None:
        self.n, self.total, self._words, self._every = done, total, "", every
        self._unit = unit.strip() if unit.endswith("s") else f"{unit.strip()}s"
        self._began, self._closed = time.monotonic(), threading.Event()
        begun(self._lines, "progress")

    def _lines(self) -> None:
        while not self._closed.wait(self._every):
            self.tell(time.monotonic() - self._began)

    def tell(self, seconds: float) -> None:
        """Print the parts done after so many seconds."""
        of = "" if self.total is None else f" of {self.total:.0f}"
        words = self._words and f": {self._words}"
        sys.stderr.write(f"tcc-sim: {self.n:.0f}{of} {self._unit} after {seconds:.0f} s{words}\n")
        sys.stderr.flush()

    def update(self, count: float = 1) -> None:
        """Count finished parts."""
        self.n += count

    def set_postfix_str(self, words: str, refresh: bool = False) -> None:
        """Name the last part, or the next."""
        self._words = words

    set_description_str = set_postfix_str

    def close(self) -> None:
        """End the lines."""
        self._closed.set()


def in_notebook() -> bool:
    """Return whether IPython runs in a kernel, whose standard error shows bars although it is no terminal."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


@contextmanager
def progress_bar(unit: str, total: float | None = None, done: float = 0, shown: bool = True,
                 **look: Any) -> Iterator[Any]:
    """Yield a bar, which `update` moves; lines where standard error is neither a terminal nor that of a notebook.

    unit : name of a part
    total : number of parts; None if unknown
    done : number of parts at the start
    shown : False for neither a bar nor lines
    look : keywords of tqdm, for the bar
    """
    if shown and not in_notebook() and not sys.stderr.isatty():
        bar: Any = ProgressLines(unit, total, done)
    else:
        from tqdm import tqdm

        tqdm.set_lock(_lock)
        bar = tqdm(total=total, initial=done, disable=not shown, unit=unit, **{"smoothing": 0.05, **look})
    try:
        yield bar
    finally:
        bar.close()


@contextmanager
def point_bar(shown: bool = True) -> Iterator[Callable[[Any], None]]:
    """Yield a function to call with every point of a branch: it counts the points and names the last one."""
    with progress_bar("point", shown=shown) as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.period}", refresh=False)
            bar.update()

        yield tick


@contextmanager
def counted_bar(unit: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show progress of a task; call the yielded function with the number of parts done, of all parts, and the name of
    the next one.
    """
    with progress_bar(unit, leave=False) as bar:
        def done(count: int, total: int, following: str) -> None:
            bar.total = total
            bar.set_description_str(following, refresh=False)
            bar.update(count - bar.n)

        yield done


@contextmanager
def seconds_bar(name: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show progress of a task that runs for `total` s; call the yielded function with the seconds done so far."""
    with progress_bar("s", total, desc=name, leave=False,
                      bar_format="{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s") as bar:
        yield lambda done: bar.update(done - bar.n)
