"""Who does the tasks of long work: threads, one that may be left behind, processes, or workers of a Dask cluster.

A cluster reschedules what a lost worker had in hand. What follows branches holds the interpreter lock most of the time,
and is given to processes.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from contextlib import contextmanager
from typing import Any, TypeVar

from tcc_sim.background import begun
from tcc_sim.errors import InputError, WorkersLost, counted, require
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.settings import DEFAULTS

Task = TypeVar("Task")
Done = TypeVar("Done")
Part = TypeVar("Part")
ADDRESS = re.compile(r"(?:(tcp|tls|ws|wss)://)?(\[[0-9a-fA-F:.%]+\]|[^\s:/\[\]]+):(\d{1,5})/?")
"""Protocol, host and port."""


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


class Scheduler(Attendance):
    """Asks a scheduler whether it and its workers are still there.

    Parameters
    ----------
    client : of the scheduler
    address : its address, for the sentence
    connect : seconds that it has to answer
    """

    def __init__(self, client: Any, address: str, connect: float) -> None:
        self._client, self._address, self._connect = client, address, connect
        super().__init__(self._ask())
        self._seen = time.monotonic()

    def check(self) -> None:
        """Raise WorkersLost where scheduler or workers have been gone for `patience` seconds."""
        self.threads = self._ask()
        if self.threads:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > DEFAULTS.patience:
            gone = "has no workers" if self._client.status == "running" else "is gone"
            raise WorkersLost(f"--dask {self._address}: the scheduler {gone} for {DEFAULTS.patience:g} s now")

    def _ask(self) -> int:
        """Threads of all workers; 0 where no answer comes."""
        try:
            return sum(in_time(time.monotonic() + 0.25 * self._connect, self._client.nthreads).values())
        except Exception:
            return 0  # Whatever a client raises whose scheduler is gone.


@contextmanager
def cluster(address: str, connect: float = DEFAULTS.connect_timeout) -> Iterator[tuple[Executor, Scheduler]]:
    """An executor on the workers of the scheduler at `address`, which has `connect` seconds to answer, and who of
    them is there.

    The package must be installed on the workers.

    Raises
    ------
    MissingPackage
        distributed is not installed.
    InputError
        Not an address, no scheduler answers there in time, or it has no workers.
    """
    require("distributed", "--dask")
    parts = ADDRESS.fullmatch(address)
    if parts is None or not 0 < int(parts[3]) < 65536:
        raise InputError(f"--dask is {address!r}; it must be an address such as tcp://127.0.0.1:8786")
    deadline = time.monotonic() + connect
    try:
        import socket

        # A plain connection says at once that nothing listens; Dask would try again until its time is over.
        in_time(deadline, lambda: socket.create_connection((parts[2].strip("[]"), int(parts[3])), connect).close())
        import distributed

        client = in_time(max(deadline, time.monotonic() + 0.5 * connect), lambda: distributed.Client(
            address, timeout=0.4 * connect, set_as_default=False))
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"--dask {address}: no Dask scheduler answers ({error or type(error).__name__})") from None
    with client:
        there = Scheduler(client, address, connect)
        if not there.threads:
            raise InputError(f"--dask {address}: the scheduler has no workers; start some with dask worker {address}")
        executor = client.get_executor(pure=False, retries=DEFAULTS.lost_workers)
        try:
            yield executor, there
        finally:
            executor.shutdown(wait=False)


def in_time(deadline: float, function: Callable[[], Any]) -> Any:
    """What a function gives until a time of the monotonic clock, in a thread: looking up a name cannot be cut short.

    Raises
    ------
    TimeoutError
        It has not come back by then.
    """
    found, thread = begun(function)
    thread.join(max(deadline - time.monotonic(), 0.0))
    if not found.done():
        raise TimeoutError("timed out")
    return found.result()


def processes_for(parts: int, jobs: int | None = None) -> int:
    """How many processes so many parts are given, of at most `jobs`, by default one for every core."""
    return min(parts, jobs or cores())


def each_in_a_process(work: Callable[[Part], Any], parts: Sequence[Part], jobs: int | None = None, unit: str = "part",
                      progress: bool = False) -> list[Any]:
    """What `work`, a function of a module, makes of every part, in order.

    Parameters
    ----------
    jobs : processes, all cores by default; with one, or for one part, `work` is called here
    unit, progress : what a part is called, and whether progress is shown

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
    import multiprocessing
    from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor

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
