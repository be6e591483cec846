"""The tasks of a sweep on a Dask cluster, an engine that reschedules what a lost worker had in hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from tcc_sim.errors import InputError, require

CONNECT_TIMEOUT = 10.0
"""Seconds to wait for the scheduler."""
LOST_WORKERS = 10
"""How many workers may die over one task before the task is given up."""


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """An executor on the workers of the scheduler at `address`, and a function that says how many threads they have
    now.

    The package must be installed on the workers.

    Raises
    ------
    MissingPackage
        distributed is not installed.
    InputError
        No scheduler answers at `address`.
    """
    require("distributed", "--dask")
    import distributed

    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--dask {address}: no Dask scheduler answers ({error})") from None
    with client:
        executor = client.get_executor(pure=False, retries=LOST_WORKERS)
        try:
            yield executor, lambda: sum(client.nthreads().values())
        finally:
            executor.shutdown(wait=False)
