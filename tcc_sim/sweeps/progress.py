"""A bar on a terminal for work of many equal parts."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.RLock()
"""Of all bars of a process. tqdm's own is a semaphore of the system too, which a process that is ended leaves behind.
"""


@contextmanager
def progress_bar(unit: str, total: int | None = None, done: int = 0, shown: bool = True) -> Iterator[Any]:
    """A bar, moved by its `update`; there is none where standard error is no terminal.

    Parameters
    ----------
    unit : what a part is called
    total : parts; None where nobody knows
    done : parts at the start
    shown : False: none on a terminal either
    """
    from tqdm import tqdm

    tqdm.set_lock(_lock)
    with tqdm(total=total, initial=done, disable=None if shown else True, unit=unit, smoothing=0.05) as bar:
        yield bar


@contextmanager
def point_bar(shown: bool = True) -> Iterator[Callable[[Any], None]]:
    """A function to call with every point of a branch, which moves a count of them and names the last."""
    with progress_bar("point", shown=shown) as bar:
        def tick(point: Any) -> None:
            bar.set_postfix_str(f"{point.value:.6g}, period {point.orbit.period}", refresh=False)
            bar.update()

        yield tick
