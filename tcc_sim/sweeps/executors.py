"""Run tasks in threads, in processes, or on the workers of a Dask cluster.

A cluster reschedules the tasks of a lost worker. Following branches holds the interpreter lock most of the time and
therefore runs in processes.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, TypeVar

from tcc_sim.background import begun, without_working_directory
from tcc_sim.errors import InputError, WorkersLost, counted, require
from tcc_sim.sweeps.progress import progress_bar

Task = TypeVar("Task")
Done = TypeVar("Done")
Part = TypeVar("Part")
LOOK = 2.0
"""Time without a result after which the workers are checked, s."""
CONNECT, PATIENCE = 8.0, 60.0
"""Time that a scheduler has to answer, and time without an answer or without workers before work is given up, s."""
AHEAD, LOST_WORKERS = 3, 10
"""Tasks submitted ahead per thread, and workers that may die over one task before the task is given up."""
ADDRESS = re.compile(r"(?:(tcp|tls|ws|wss)://)?(\[[0-9a-fA-F:.%]+\]|[^\s:/\[\]]+):(\d{1,5})/?")
"""Protocol, host and port."""


class Attendance:
    """Number of threads that work on tasks; threads exist as long as their process.

    look : time without a result after which they are checked, s
    """

    def __init__(self, threads: int, look: float = LOOK) -> None:
        self.threads, self.look = threads, look

    def check(self) -> None:
        """Raise WorkersLost if there have been no workers for long."""


@contextmanager
def workers(jobs: int | None, dask: str | None) -> Iterator[tuple[Executor, Attendance]]:
    """Yield an executor with `jobs` threads (default: all cores) or on the cluster at `dask`, and its attendance."""
    if jobs is not None and not 1 <= jobs <= 1024:
        raise InputError(f"jobs is {jobs}; it must be 1 to 1024")
    if dask is not None:
        with cluster(dask) as client:
            yield client
        return
    count = jobs or cores()
    executor = futures.ThreadPoolExecutor(count, thread_name_prefix="sweep")
    try:
        yield executor, Attendance(count)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def each_done(attendance: Attendance, take: Callable[[], Task | None],
              submit: Callable[[Task], Future[Done]]) -> Iterator[tuple[Task, Done]]:
    """Yield tasks with their results as they complete, those before a failure of the same moment first.

    Few tasks are submitted ahead, so that memory does not grow and Ctrl-C takes effect soon.

    take : function that returns the next task; None if there is none now

    Raises WorkersLost: no workers are left.
    """
    running: dict[Future[Done], Task] = {}
    try:
        while True:
            while len(running) < AHEAD * max(attendance.threads, 1) and (task := take()) is not None:
                running[submit(task)] = task
            if not running:
                return
            while not (done := futures.wait(running, attendance.look, futures.FIRST_COMPLETED).done):
                attendance.check()
            if any(future.cancelled() or isinstance(future.exception(), futures.CancelledError) for future in done):
                raise WorkersLost("the workers gave it up")
            for future in sorted(done, key=lambda future: future.exception() is not None):
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Scheduler(Attendance):
    """Attendance of a Dask cluster, by asking its scheduler.

    address : of the scheduler, for messages
    connect : time for an answer, s
    patience : time without an answer or without workers before work is given up, s
    """

    def __init__(self, client: Any, address: str, connect: float, patience: float = PATIENCE) -> None:
        self._client, self._address, self._connect, self._patience = client, address, connect, patience
        super().__init__(self._ask(), min(LOOK, patience))
        self._seen = time.monotonic()

    def check(self) -> None:
        """Raise WorkersLost if scheduler or workers have been absent for too long."""
        self.threads = self._ask()
        if self.threads:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > self._patience:
            gone = "has no workers" if self._client.status == "running" else "is gone"
            raise WorkersLost(f"--dask {self._address}: the scheduler {gone} for {self._patience:g} s now")

    def _ask(self) -> int:
        try:
            return sum(in_time(time.monotonic() + 0.25 * self._connect, self._client.nthreads).values())
        except Exception:
            return 0  # Clients without a scheduler raise various exceptions.


@contextmanager
def cluster(address: str, connect: float = CONNECT,
            patience: float = PATIENCE) -> Iterator[tuple[Executor, Scheduler]]:
    """Yield an executor on the workers of the scheduler at `address`, and their attendance.

    The package must be installed on the workers. `connect` and `patience` are those of `Scheduler`.

    Raises MissingPackage: distributed is not installed. Raises InputError: `address` is not an address, no scheduler
    answers there in time, or it has no workers.
    """
    require("distributed", "--dask")
    parts = ADDRESS.fullmatch(address)
    if parts is None or not 0 < int(parts[3]) < 65536:
        raise InputError(f"--dask is {address!r}; it must be an address such as tcp://127.0.0.1:8786")
    deadline = time.monotonic() + connect
    try:
        import socket

        # A plain connection fails at once if nothing listens; Dask would retry until its timeout.
        in_time(deadline, lambda: socket.create_connection((parts[2].strip("[]"), int(parts[3])), connect).close())
        import distributed

        client = in_time(max(deadline, time.monotonic() + 0.5 * connect), lambda: distributed.Client(
            address, timeout=0.4 * connect, set_as_default=False))
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"--dask {address}: no Dask scheduler answers ({error or type(error).__name__})") from None
    with client:
        scheduler = Scheduler(client, address, connect, patience)
        if not scheduler.threads:
            raise InputError(f"--dask {address}: the scheduler has no workers; start some with dask worker {address}")
        yield _OnWorkers(client), scheduler


class _OnWorkers(Executor):
    """Executor on the workers of a Dask client.

    Dask's own fails with a ValueError where a worker dies while its result is fetched: it takes the state of a task
    that is computed again for an error.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, function: Callable[..., Done], /, *words: Any, **options: Any) -> Future[Done]:
        """Return the future of a task that a worker computes."""
        from distributed.comm import CommClosedError

        local: Future[Done] = Future()
        remote = self._client.submit(function, *words, **options, pure=False, retries=LOST_WORKERS)

        async def hand_over() -> None:
            result: Any = None
            error: BaseException | None = None
            try:
                result = await remote
            except BaseException as raised:  # Dask raises errors of tasks, and several kinds of its own.
                error = raised
            if remote.cancelled() or isinstance(error, CommClosedError):  # The scheduler has gone.
                local.cancel()
            if local.set_running_or_notify_cancel():
                local.set_result(result) if error is None else local.set_exception(error)

        local.add_done_callback(lambda done: remote.cancel() if done.cancelled() and not remote.cancelled() else None)
        self._client.loop.add_callback(hand_over)
        return local


def in_time(deadline: float, function: Callable[[], Any]) -> Any:
    """Call a function in a thread, as a name lookup cannot be interrupted; raise TimeoutError after `deadline`, s."""
    outcome, thread = begun(function)
    thread.join(max(deadline - time.monotonic(), 0.0))
    if not outcome.done():
        raise TimeoutError("timed out")
    return outcome.result()


def processes_for(parts: int, jobs: int | None = None) -> int:
    """Return the number of processes for so many parts: at most `jobs`, by default one per core."""
    return min(parts, jobs or cores())


def each_in_a_process(work: Callable[[Part], Any], parts: Sequence[Part], jobs: int | None = None, unit: str = "part",
                      progress: bool = False) -> list[Any]:
    """Return the results of `work`, a function of a module, for every part, in order.

    If a process is killed, for instance because memory runs out, finished parts are kept, and half as many processes do
    the others.

    jobs : number of processes (default: all cores); with one, or for one part, `work` is called in this process
    unit, progress : name of a part, and whether progress is shown

    Raises WorkersLost: a process that ran alone was killed too.
    """
    count = processes_for(len(parts), jobs)
    if count < 2:
        return [work(part) for part in parts]
    results: dict[int, Any] = {}
    with progress_bar(unit, len(parts), shown=progress) as bar:
        while True:
            with without_working_directory():
                _in_a_pool(work, parts, count, results, bar)
            if len(results) == len(parts):
                return [results[i] for i in range(len(parts))]
            if count == 1:
                raise WorkersLost(f"a process was killed, perhaps because memory ran out; {len(results)} of "
                                  f"{counted(len(parts), unit)} were done")
            count //= 2


def _in_a_pool(work: Callable[[Part], Any], parts: Sequence[Part], count: int, results: dict[int, Any],
               bar: Any) -> None:
    """Compute the parts missing in `results` until all are there or a process was killed."""
    import multiprocessing
    from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor

    others = set(multiprocessing.active_children())
    # Ctrl-C ends the pool, which ends its processes; the processes must not report it too.
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), signal.signal,
                               (signal.SIGINT, signal.SIG_IGN))
    try:
        missing: dict[Future[Any], int] = {pool.submit(work, part): i for i, part in enumerate(parts)
                                           if i not in results}
        for future in futures.as_completed(missing):
            try:
                results[missing[future]] = future.result()
                bar.update()
            except BrokenProcessPool:
                continue
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
