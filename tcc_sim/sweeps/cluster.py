"""The tasks of a sweep on a Dask cluster, an engine that reschedules what a lost worker had in hand."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from tcc_sim.background import begun
from tcc_sim.errors import InputError, WorkersLost, require
from tcc_sim.sweeps.settings import DEFAULTS
from tcc_sim.sweeps.workers import Attendance

ADDRESS = re.compile(r"(?:(tcp|tls|ws|wss)://)?(\[[0-9a-fA-F:.%]+\]|[^\s:/\[\]]+):(\d{1,5})/?")
"""Protocol, host and port."""


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
            return sum(within(time.monotonic() + 0.25 * self._connect, self._client.nthreads).values())
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
        # A plain connection says at once that nothing listens; Dask would try again until its time is over.
        within(deadline, lambda: socket.create_connection((parts[2].strip("[]"), int(parts[3])), connect).close())
        import distributed

        client = within(max(deadline, time.monotonic() + 0.5 * connect), lambda: distributed.Client(
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


def within(deadline: float, function: Callable[[], Any]) -> Any:
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
