"""The basins of a scene row by row: on all cores or a Dask cluster, into a file from which they can go on."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim import __version__
from tcc_sim.basins.attractors import find_attractors
from tcc_sim.basins.compute import (
    Axis,
    Basins,
    Counts,
    Labels,
    check_plane,
    seeds_of,
    starts,
)
from tcc_sim.basins.driveline import DrivelineMotion
from tcc_sim.basins.proximity import UNDECIDED, Attractor, ProximityMapper, follow
from tcc_sim.basins.settings import DEFAULTS
from tcc_sim.errors import BasinsInterrupted, InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import Scene, system_of
from tcc_sim.sweeps.file import SweepFile
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.workers import Attendance, first_done, workers

FORMAT = "tcc_sim basin_rows 1"
Tick = Callable[[], object]
Row = tuple[list[int], list[int]]
Stored = tuple[int, int, dict[str, Any]]
"""Index of the value, row, and what stands in the file."""


def solve_row(system: System, plane: tuple[Axis, Axis], row: int, attractors: Sequence[Attractor], most: int) -> Row:
    """Labels and cycles of one row of cells; what a worker does."""
    motion = DrivelineMotion(system)
    mapper = ProximityMapper(attractors, motion.map.scales, motion.map.forcing_period)
    labels, cycles = follow(motion, mapper, starts(system, plane, row), most)
    return labels.tolist(), cycles.tolist()


@dataclass
class _Progress:
    """What is known of one plane: its attractors, and the rows that are done."""

    system: System
    attractors: list[Attractor]
    labels: Labels
    cycles: Counts
    done: set[int] = field(default_factory=set)


def basins(scene: Scene | System | str, plane: Sequence[Axis], *, cycles: int = DEFAULTS.cycles,
           over: Axis | None = None,
           jobs: int | None = None, dask: str | None = None, part: Path | None = None, progress: bool = False,
           said: Mapping[str, Any] | None = None) -> list[Basins]:
    """Attractors and their basins in a plane of two initial conditions, one for every value of `over`.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    plane : two axes of initial.* keys
    cycles : most engine cycles that a cell is followed, 16 to 1000000
    over : a scene key and its values; the plane is worked out for each
    jobs : threads; all available cores by default
    dask : address of a Dask scheduler whose workers do the work instead
    part : file that takes every row as it is done, and from which the same call goes on
    said : what the first line of that file says besides, such as the command
    progress : show a bar on a terminal

    Raises
    ------
    InputError
        A wrong plane, number of cycles or jobs, or a file that holds something else.
    BasinsInterrupted
        Ctrl-C; what was done stands in `part`.

    Examples
    --------
    >>> from tcc_sim.basins.compute import Axis
    >>> plane = [Axis("initial.slip_speed", (0.0, 50.0)), Axis("initial.plate_angle", (0.0, 0.1))]
    >>> found, = basins("stick", plane)
    >>> found.fraction(0)
    1.0
    """
    system = system_of(scene)
    axes = check_plane(plane)
    _check(axes, over, cycles, jobs)
    systems = [system] if over is None else [replace(system, {over.key: x}) for x in over.values]
    for each in systems:
        DrivelineMotion(each)
    stored: list[Stored] = []
    file = None
    if part is not None:
        file = SweepFile(part, _header(system, axes, cycles, over), lambda *row: stored.append(row), form=FORMAT,
                         kind="basin map", said=said)
    out: list[Basins] = []
    try:
        rows = len(systems) * len(axes[1].values)
        with workers(jobs, dask) as (executor, there), progress_bar("row", rows, shown=progress) as bar:
            for index, each in enumerate(systems):
                mine = [(row, record) for i, row, record in stored if i == index]
                found = _one(each, axes, cycles, mine, executor, there, partial(_keep, file, index), bar.update)
                out.append(found if over is None else dataclasses.replace(found, over=(over.key, over.values[index])))
    except KeyboardInterrupt:
        raise BasinsInterrupted from None
    finally:
        if file is not None:
            file.close()
    return out


def _check(plane: tuple[Axis, Axis], over: Axis | None, cycles: int, jobs: int | None) -> None:
    """InputError for what no basins can be worked out for."""
    if over is not None and over.key in (plane[0].key, plane[1].key):
        raise InputError(f"over is {over.key}, an axis of the plane; it must be another key")
    if not 16 <= cycles <= 1_000_000:
        raise InputError(f"cycles is {cycles}; it must be 16 to 1000000")
    if jobs is not None and not 1 <= jobs <= 1024:
        raise InputError(f"jobs is {jobs}; it must be 1 to 1024")


def _one(system: System, plane: tuple[Axis, Axis], most: int, stored: Sequence[tuple[int, dict[str, Any]]],
         executor: Executor, there: Attendance, keep: Callable[[int, dict[str, Any]], None],
         tick: Tick) -> Basins:
    """One plane: attractors from seeds, rows, and attractors again from the cells that came to none."""
    began = time.perf_counter()
    motion = DrivelineMotion(system)
    shape = len(plane[1].values), len(plane[0].values)
    state = _Progress(system, [], np.full(shape, UNDECIDED, np.int16), np.zeros(shape, np.int32))
    state.attractors = find_attractors(motion, seeds_of(system, plane))
    _take(state, stored, tick)
    _rows(state, plane, most, executor, there, lambda row: keep(row, _record(state, row)), tick)
    for _ in range(DEFAULTS.rounds):
        lost = np.argwhere(state.labels == UNDECIDED)
        if not len(lost):
            break
        chosen = lost[np.unique(np.linspace(0, len(lost) - 1, DEFAULTS.searched).astype(int))]
        seeds = [starts(system, plane, int(j))[int(i)] for j, i in chosen]
        more = find_attractors(motion, seeds, state.attractors)
        if len(more) == len(state.attractors):
            break
        shrunk = any(a.radius < b.radius for a, b in zip(more, state.attractors))
        state.attractors = more
        state.done = set() if shrunk else set(range(shape[0])) - {int(j) for j in lost[:, 0]}
        _rows(state, plane, most, executor, there, lambda row: None, lambda: None)
    return Basins(plane, tuple(state.attractors), state.labels, state.cycles, time.perf_counter() - began)


def _rows(state: _Progress, plane: tuple[Axis, Axis], most: int, executor: Executor, there: Attendance,
          keep: Callable[[int], None], tick: Tick) -> None:
    """Solve every row that is not done; few are handed out ahead, so that memory does not grow."""
    waiting = iter([row for row in range(len(plane[1].values)) if row not in state.done])
    running: dict[Future[Row], int] = {}
    try:
        while True:
            while len(running) < DEFAULTS.ahead * max(there.threads(), 1):
                row = next(waiting, None)
                if row is None:
                    break
                running[executor.submit(solve_row, state.system, plane, row, state.attractors, most)] = row
            if not running:
                return
            for future in first_done(running, there):
                row = running.pop(future)
                state.labels[row], state.cycles[row] = future.result()
                state.done.add(row)
                keep(row)
                tick()
    finally:
        for future in running:
            future.cancel()


def _keep(file: SweepFile | None, index: int, row: int, record: dict[str, Any]) -> None:
    """Put a row that is done into the file."""
    if file is not None:
        file.append(index, row, record)


def _record(state: _Progress, row: int) -> dict[str, Any]:
    """A row as it stands in the file."""
    return {"attractors": len(state.attractors), "labels": state.labels[row].tolist(),
            "cycles": state.cycles[row].tolist()}


def _take(state: _Progress, stored: Sequence[tuple[int, dict[str, Any]]], tick: Tick) -> None:
    """Take the rows of a file; those that the same attractors were not known for are solved again."""
    for row, found in stored:
        labels, cycles = found["labels"], found["cycles"]
        if found["attractors"] == len(state.attractors) and len(labels) == state.labels.shape[1] == len(cycles):
            state.labels[row], state.cycles[row] = labels, cycles
            state.done.add(row)
            tick()


def _header(system: System, plane: tuple[Axis, Axis], cycles: int, over: Axis | None) -> dict[str, Any]:
    """What tells one piece of work from another."""
    axes = [{"key": axis.key, "values": list(axis.values)} for axis in plane]
    return {"version": __version__, "plane": axes, "cycles": cycles, "scene": dict(values_of(system)),
            "over": None if over is None else {"key": over.key, "values": list(over.values)}}
