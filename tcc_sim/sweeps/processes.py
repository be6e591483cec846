"""Work of a few large parts, each in a process: what follows branches holds the interpreter lock most of the time."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from tcc_sim.errors import WorkersLost, counted
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.workers import cores

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

    Where a process is killed, as where memory runs out, what is done is kept, and what is not is done by half as many.

    Raises
    ------
    WorkersLost
        A process that was left to itself was killed too.
    """
    count = processes_for(len(parts), jobs)
    if count < 2:
        return [work(part) for part in parts]
    found: dict[int, Any] = {}
    with progress_bar(unit, len(parts), shown=progress) as bar:
        while True:
            _in_a_pool(work, parts, count, found, bar)
            if len(found) == len(parts):
                return [found[i] for i in range(len(parts))]
            if count == 1:
                raise WorkersLost(f"a process was killed, perhaps because memory ran out; {len(found)} of "
                                  f"{counted(len(parts), unit)} were done")
            count //= 2


def _in_a_pool(work: Callable[[Part], Any], parts: Sequence[Part], count: int, found: dict[int, Any], bar: Any) -> None:
    """Work on what is missing in `found` until all is there or a process was killed."""
    others = set(multiprocessing.active_children())
    # Ctrl-C ends the pool, which ends its processes; they are not to report it themselves.
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), signal.signal,
                               (signal.SIGINT, signal.SIG_IGN))
    try:
        futures: dict[Future[Any], int] = {pool.submit(work, part): i for i, part in enumerate(parts) if i not in found}
        for future in as_completed(futures):
            try:
                found[futures[future]] = future.result()
                bar.update()
            except BrokenProcessPool:
                continue
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
