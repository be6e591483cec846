"""Who does the tasks of a sweep: threads of this process, or the workers of a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, Protocol

from tcc_sim.errors import WorkersLost
from tcc_sim.sweeps.settings import DEFAULTS


class Attendance(Protocol):
    """Who is there to work."""

    def threads(self) -> int:
        """How many tasks run at a time."""

    def check(self) -> None:
        """Raise WorkersLost where nobody has been there for long."""


class Here:
    """Threads of this process."""

    def __init__(self, count: int) -> None:
        self._count = count

    def threads(self) -> int:
        """As many as were asked for."""
        return self._count

    def check(self) -> None:
        """They are there as long as this process is."""


@contextmanager
def workers(jobs: int | None, dask: str | None) -> Iterator[tuple[Executor, Attendance]]:
    """Where tasks run, and who is there to do them: `jobs` threads, all cores by default, or the cluster at `dask`."""
    if dask is not None:
        from tcc_sim.sweeps.cluster import cluster

        with cluster(dask) as found:
            yield found
        return
    count = jobs or cores()
    executor = ThreadPoolExecutor(count, thread_name_prefix="sweep")
    try:
        yield executor, Here(count)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


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
