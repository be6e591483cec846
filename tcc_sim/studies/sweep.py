"""Sweeps over a scene key: every point of one or more curves, on all cores or on a Dask cluster, in value order.

Points are independent where the direction is cold; up and down go along a curve from neighbour to neighbour, so there
only the curves run side by side. The results do not depend on how many workers there are, nor on which of them did
what.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, SweepInterrupted
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import check_setting, choose
from tcc_sim.studies.point import SUMMARY_KEYS, Plan, Point, solve_points
from tcc_sim.studies.sweep_file import SweepFile
from tcc_sim.trajectory import State

MOST_VALUES = 1_000_000
PAPER = Plan()
"""150 cycles of which 50 are dropped, every point from the initial state."""
NOT_SOLVED = "not solved: the sweep was interrupted"
DASK_BATCH = 8
"""Points in one task on a cluster: a task costs the scheduler about a millisecond."""

Record = dict[str, Any]


@dataclass(frozen=True)
class Curve:
    """A system at many values of one scene key.

    Raises
    ------
    InputError
        No value or too many, an unknown key, or a value out of its range.
    """

    system: System
    key: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.values) <= MOST_VALUES:
            raise InputError(f"a sweep has {len(self.values)} values; it must have 1 to {MOST_VALUES}")
        for value in self.values:
            replace(self.system, {self.key: value})

    def at(self, index: int) -> System:
        """The system at one of the values."""
        return replace(self.system, {self.key: self.values[index]})


@dataclass(frozen=True)
class Sweep:
    """The results along one curve, in the order of its values.

    records : per value what `Point.as_json` gives; None where the sweep was interrupted before
    seconds : wall time of the whole call
    """

    curve: Curve
    plan: Plan
    records: list[Record | None]
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every value was tried."""
        return all(r is not None for r in self.records)

    @property
    def values(self) -> NDArray[np.float64]:
        """(n,) values of the key."""
        return np.array(self.curve.values)

    def column(self, name: str) -> NDArray[np.float64]:
        """A number per value, (n,), NaN where there is none."""
        found = [None if r is None else r.get(name) for r in self.records]
        return np.array([np.nan if x is None else float(x) for x in found])

    def as_json(self) -> dict[str, Any]:
        """`over`, `values`, how it was done, and per value the keys of `simulate --json` in lists."""
        plan, records = self.plan, self.records
        names = [*SUMMARY_KEYS, "confirmed"]
        names += [n for n in ("theta2", "equivalent_damping", "negative_slope_mean", "lyapunov")
                  if any(r is not None and n in r for r in records)]
        out: dict[str, Any] = {
            "over": self.curve.key, "values": list(self.curve.values), "direction": plan.direction,
            "discard": "default" if plan.discard is None else plan.discard, "complete": self.complete,
            "seconds": self.seconds}
        for name in names:
            out[name] = [None if r is None else r.get(name) for r in records]
        out["status"] = [NOT_SOLVED if r is None else r["status"] for r in records]
        return out


def sweep(system: System, key: str, values: Sequence[float], plan: Plan = PAPER, **how: Any) -> Sweep:
    """Solve `system` at every value of one scene key; `how` is as `sweep_curves` takes it.

    Examples
    --------
    >>> import tcc_sim
    >>> found = tcc_sim.sweep(tcc_sim.load_scene("slip").system, "engine.frequency", [100.0, 120.0])
    >>> found.as_json()["regime"]
    ['slip', 'slip']
    """
    return sweep_curves([Curve(system, key, tuple(map(float, values)))], plan, **how)[0]


def sweep_grid(system: System, key: str, values: Sequence[float], second_key: str, second_values: Sequence[float],
               plan: Plan = PAPER, **how: Any) -> list[Sweep]:
    """Solve a grid of two scene keys: one Sweep over `key` for every value of `second_key`, in order.

    Examples
    --------
    >>> import tcc_sim
    >>> rows = tcc_sim.sweep_grid(tcc_sim.load_scene("slip").system, "engine.frequency", [100.0, 120.0],
    ...                           "engine.torque_amplitude", [50.0, 60.0, 70.0])
    >>> len(rows), len(rows[0].values)
    (3, 2)
    """
    row = tuple(map(float, values))
    return sweep_curves([Curve(replace(system, {second_key: x}), key, row) for x in second_values], plan, **how)


def sweep_curves(curves: Sequence[Curve], plan: Plan = PAPER, *, jobs: int | None = None, dask: str | None = None,
                 out: Path | None = None, said: Mapping[str, Any] | None = None, progress: bool = False) -> list[Sweep]:
    """Solve every point of every curve.

    Parameters
    ----------
    jobs : threads (the kernels release the interpreter lock); all available cores by default
    dask : address of a Dask scheduler whose workers do the work instead
    out : file that takes every point as it is done; where it holds points of the same sweep, those are not solved again
    said : what the first line of that file says besides, such as scene and command
    progress : show a bar on a terminal

    Raises
    ------
    InputError
        A wrong plan or number of jobs, or a file that holds something else.
    SweepInterrupted
        Ctrl-C; it carries what was done until then.
    MissingPackage
        `dask` without the package distributed.
    """
    for curve in curves:
        check_setting(choose(curve.system, plan.solver), plan.rtol, plan.step)
        if plan.lyapunov and curve.system.friction.law != "smoothed":
            raise InputError(f"friction.law is {curve.system.friction.law}; the Lyapunov exponent is that of the smoothed model")
    if jobs is not None and not 1 <= jobs <= 1024:
        raise InputError(f"jobs is {jobs}; it must be 1 to 1024")
    began = time.perf_counter()
    records: list[list[Record | None]] = [[None] * len(curve.values) for curve in curves]
    file = SweepFile(out, curves, plan, said) if out is not None else None
    try:
        if file is not None:
            for c, i, record in file.stored:
                records[c][i] = record
        with _executor(jobs, dask) as (executor, width), _bar(records, progress) as tick:
            for c, i, point in _solved(curves, plan, executor, width, DASK_BATCH if dask else 1, records):
                record = {**point.as_json(), "final": list(point.final)}
                records[c][i] = record
                if file is not None:
                    file.append(c, i, record)
                tick()
    except KeyboardInterrupt:
        raise SweepInterrupted(_results(curves, plan, records, began)) from None
    finally:
        if file is not None:
            file.close()
    return _results(curves, plan, records, began)


def _results(curves: Sequence[Curve], plan: Plan, records: list[list[Record | None]], began: float) -> list[Sweep]:
    """One Sweep per curve."""
    seconds = time.perf_counter() - began
    return [Sweep(curve, plan, found, seconds) for curve, found in zip(curves, records)]


Task = tuple[int, list[int], State | None]
"""Number of a curve, indices of its values in the order of solving, and where to go on from."""


def _solved(curves: Sequence[Curve], plan: Plan, executor: Executor, width: Callable[[], int], batch: int,
            records: list[list[Record | None]]) -> Iterator[tuple[int, int, Point]]:
    """Every point that has no record yet, as it is done; few tasks are handed out ahead, so memory does not grow."""
    ready = _tasks(curves, plan, batch, records)
    following: deque[Task] = deque()
    running: dict[Future[list[Point]], Task] = {}
    try:
        while True:
            while len(running) < 3 * max(width(), 1):
                task = following.popleft() if following else next(ready, None)
                if task is None:
                    break
                c, indices, state = task
                systems, values = [curves[c].at(i) for i in indices], [curves[c].values[i] for i in indices]
                running[executor.submit(solve_points, systems, values, plan, state)] = task
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                c, indices, _ = running.pop(future)
                points = future.result()
                if plan.direction != "cold":
                    rest = _order(curves[c], plan)
                    rest = rest[rest.index(indices[-1]) + 1:]
                    if rest:
                        following.append((c, rest[:batch], State(*points[-1].final)))
                for i, point in zip(indices, points):
                    yield c, i, point
    finally:
        for future in running:
            future.cancel()


def _tasks(curves: Sequence[Curve], plan: Plan, batch: int, records: list[list[Record | None]]) -> Iterator[Task]:
    """What can be done at once: all that is missing, or for up and down the first missing piece of every curve."""
    for c, curve in enumerate(curves):
        order = _order(curve, plan)
        missing = [i for i in order if records[c][i] is None]
        if plan.direction == "cold":
            for k in range(0, len(missing), batch):
                yield c, missing[k:k + batch], None
        elif missing:
            # A file is written in the order of solving, so what is missing is the end of the curve.
            place = order.index(missing[0])
            before = records[c][order[place - 1]] if place else None
            yield c, order[place:place + batch], State(*before["final"]) if before is not None else None


def _order(curve: Curve, plan: Plan) -> list[int]:
    """Indices of the values in the order of solving."""
    if plan.direction == "cold":
        return list(range(len(curve.values)))
    rising = [int(i) for i in np.argsort(curve.values, kind="stable")]
    return rising if plan.direction == "up" else rising[::-1]


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _executor(jobs: int | None, dask: str | None) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """Where tasks run, and a function that says how many run at a time."""
    if dask is not None:
        from tcc_sim.studies.cluster import cluster

        with cluster(dask) as found:
            yield found
        return
    count = jobs or cores()
    executor = ThreadPoolExecutor(count, thread_name_prefix="sweep")
    try:
        yield executor, lambda: count
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _bar(records: Sequence[Sequence[Record | None]], progress: bool) -> Iterator[Callable[[], Any]]:
    """A function to call after every point; it moves a bar where standard error is a terminal."""
    from tqdm import tqdm

    total, done = sum(map(len, records)), sum(r is not None for found in records for r in found)
    with tqdm(total=total, initial=done, disable=None if progress else True, unit="point", smoothing=0.05) as bar:
        yield bar.update


def values_of_range(text: str) -> tuple[str, list[float]]:
    """KEY and the evenly spaced values of KEY=START:STOP:COUNT, both ends included.

    Raises
    ------
    InputError
        Anything else.
    """
    key, equals, numbers = text.partition("=")
    parts = numbers.split(":")
    wrong = InputError(f"--over is {text!r}; it must be KEY=START:STOP:COUNT")
    if not equals or len(parts) != 3:
        raise wrong
    try:
        start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise wrong from None
    if not (np.isfinite(start) and np.isfinite(stop)):
        raise wrong
    if not 1 <= count <= MOST_VALUES:
        raise InputError(f"--over has a count of {count}; it must be 1 to {MOST_VALUES}")
    return key, [float(x) for x in np.linspace(start, stop, count)]


__all__ = ["Curve", "Plan", "Sweep", "sweep", "sweep_curves", "sweep_grid", "values_of_range"]
