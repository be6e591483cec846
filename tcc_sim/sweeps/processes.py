"""Work of a few large parts, each in a process: what follows branches holds the interpreter lock most of the time."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.sweep import cores

Part = TypeVar("Part")


def processes_for(parts: int, jobs: int | None = None) -> int:
    """How many processes so many parts are given, of at most `jobs`, by default one for every core."""
    return min(parts, jobs or cores())


def each_in_a_process(work: Callable[[Part], Any], parts: Sequence[Part], jobs: int | None = None, unit: str = "part",
                      progress: bool = False) -> list[Any]:
    """What `work`, a function of a module, makes of every part, in order.

    Parameters
    ----------
    jobs : processes, all cores by default; with one, or for one part, `work` is called here
    unit, progress : what a part is called, and whether a bar counts them on a terminal
    """
    count = processes_for(len(parts), jobs)
    if count < 2:
        return [work(part) for part in parts]
    # Ctrl-C ends the pool, which ends its processes; they are not to report it themselves.
    with multiprocessing.get_context("spawn").Pool(count, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool, \
            progress_bar(unit, len(parts), shown=progress) as bar:
        out = []
        for found in pool.imap(work, parts, chunksize=1):
            out.append(found)
            bar.update()
        return out
