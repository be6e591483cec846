"""Who does the tasks of a sweep: threads of this process, or the workers of a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

from tcc_sim.errors import InputError, WorkersLost
from tcc_sim.sweeps.settings import DEFAULTS

Task = TypeVar("Task")
Done = TypeVar("Done")


class Attendance:
    """Who is there to work, and how many tasks run at a time: threads are there as long as their process is."""

    def __init__(self, threads: int) -> None:
        self.threads = threads

    def check(self) -> None:
        """Raise WorkersLost where nobody has been there for long."""


@contextmanager
def workers(jobs: int | None, dask: str | None) -> Iterator[tuple[Executor, Attendance]]:
    """Where tasks run, and who is there to do them: `jobs` threads, all cores by default, or the cluster at `dask`;
    InputError for a number of jobs that makes no sense.
    """
    if jobs is not None and not 1 <= jobs <= 1024:
        raise InputError(f"jobs is {jobs}; it must be 1 to 1024")
    if dask is not None:
        from tcc_sim.sweeps.cluster import cluster

        with cluster(dask) as found:
            yield found
        return
    count = jobs or cores()
    executor = ThreadPoolExecutor(count, thread_name_prefix="sweep")
    try:
        yield executor, Attendance(count)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def each_done(there: Attendance, take: Callable[[], Task | None],
              submit: Callable[[Task], Future[Done]]) -> Iterator[tuple[Task, Done]]:
    """Tasks with what they gave, as they are done; few are handed out ahead, so that memory does not grow and Ctrl-C
    ends soon.

    take : gives the next task; None where there is none now
    """
    running: dict[Future[Done], Task] = {}
    try:
        while True:
            while len(running) < DEFAULTS.ahead * max(there.threads, 1) and (task := take()) is not None:
                running[submit(task)] = task
            if not running:
                return
            for future in first_done(running, there):
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()


def first_done(running: Collection[Future[Any]], there: Attendance) -> set[Future[Any]]:
    """Those of some tasks that are done, at least one.

    Raises
    ------
    WorkersLost
        Nobody is there to do them any more.
    """
    while not (done := wait(running, DEFAULTS.look, FIRST_COMPLETED).done):
        there.check()
    if any(future.cancelled() or isinstance(future.exception(), CancelledError) for future in done):
        raise WorkersLost("those who worked on it gave it up")
    return done


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
