"""The basins of a scene row by row: on all cores or a Dask cluster, into a file from which they can go on."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim import __version__
from tcc_sim.basins.attractors import find_attractors
from tcc_sim.basins.compute import Axis, Basins, check_plane, seeds_of, starts
from tcc_sim.basins.driveline import DrivelineMotion
from tcc_sim.basins.proximity import UNDECIDED, Attractor, ProximityMapper, follow
from tcc_sim.basins.settings import DEFAULTS
from tcc_sim.errors import BasinsInterrupted, InputError
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.scene import Scene, system_of
from tcc_sim.sweeps.executors import Attendance, each_done, progress_bar, workers
from tcc_sim.sweeps.file import SweepFile

FORMAT = "tcc_sim basin_rows 1"
Row = tuple[list[int], list[int]]
Stored = tuple[int, int, dict[str, Any]]
"""Index of the value, row, and what stands in the file."""


def solve_row(system: System, plane: tuple[Axis, Axis], row: int, attractors: Sequence[Attractor], most: int) -> Row:
    """Labels and cycles of one row of cells; what a worker does."""
    motion = DrivelineMotion(system, DEFAULTS.rtol_cells)
    mapper = ProximityMapper(attractors, motion.map.scales, motion.map.forcing_period)
    labels, cycles = follow(motion, mapper, starts(system, plane, row), most)
    return labels.tolist(), cycles.tolist()


def basins(scene: Scene | System | str, plane: Sequence[Axis], *, cycles: int = DEFAULTS.cycles,
           over: Axis | None = None, jobs: int | None = None, dask: str | None = None, part: Path | None = None,
           progress: bool = False, said: Mapping[str, Any] | None = None) -> list[Basins]:
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
    if over is not None and over.key in (axes[0].key, axes[1].key):
        raise InputError(f"over is {over.key}, an axis of the plane; it must be another key")
    if not 16 <= cycles <= 1_000_000:
        raise InputError(f"cycles is {cycles}; it must be 16 to 1000000")
    systems = [system] if over is None else [replace(system, {over.key: x}) for x in over.values]
    for each in systems:
        DrivelineMotion(each)
    stored: list[Stored] = []
    out: list[Basins] = []
    try:
        with workers(jobs, dask) as (executor, there), closing(
                SweepFile(part, _header(system, axes, cycles, over), lambda *row: stored.append(row), form=FORMAT,
                          kind="basin map", said=said)) as file, progress_bar(
                    "row", len(systems) * len(axes[1].values), shown=progress) as bar:
            for index, each in enumerate(systems):
                mine = [(row, record) for i, row, record in stored if i == index]
                found = _one(each, axes, cycles, mine, executor, there, partial(file.append, index), bar.update)
                value = None if over is None else (over.key, over.values[index])
                out.append(dataclasses.replace(found, over=value))
    except KeyboardInterrupt:
        raise BasinsInterrupted from None
    return out


def _one(system: System, plane: tuple[Axis, Axis], most: int, stored: Sequence[tuple[int, dict[str, Any]]],
         executor: Executor, there: Attendance, keep: Callable[[int, dict[str, Any]], None],
         tick: Callable[[], object]) -> Basins:
    """One plane: attractors from seeds, rows, and attractors again from the cells that came to none."""
    began = time.perf_counter()
    motion = DrivelineMotion(system)
    shape = len(plane[1].values), len(plane[0].values)
    labels, cycles = np.full(shape, UNDECIDED, np.int16), np.zeros(shape, np.int32)
    attractors, missing = find_attractors(motion, seeds_of(system, plane)), set(range(shape[0]))

    def solved(rows: set[int]) -> Iterator[int]:
        """The rows as they are done."""
        waiting = iter(sorted(rows))
        for row, found in each_done(there, lambda: next(waiting, None), lambda row: executor.submit(
                solve_row, system, plane, row, attractors, most)):
            labels[row], cycles[row] = found
            yield row

    for row, found in stored:
        # Those of a file that the same attractors were not known for are solved again.
        if found["attractors"] == len(attractors) and len(found["labels"]) == shape[1] == len(found["cycles"]):
            labels[row], cycles[row] = found["labels"], found["cycles"]
            missing.discard(row)
            tick()
    for row in solved(missing):
        keep(row, {"attractors": len(attractors), "labels": labels[row].tolist(), "cycles": cycles[row].tolist()})
        tick()
    for _ in range(DEFAULTS.rounds):
        lost = np.argwhere(labels == UNDECIDED)
        if not len(lost):
            break
        chosen = lost[np.unique(np.linspace(0, len(lost) - 1, DEFAULTS.searched).astype(int))]
        seeds = [starts(system, plane, int(j))[int(i)] for j, i in chosen]
        more = find_attractors(motion, seeds, attractors)
        if len(more) == len(attractors):
            break
        shrunk = any(a.radius < b.radius for a, b in zip(more, attractors))
        attractors = more
        for _ in solved(set(range(shape[0]) if shrunk else lost[:, 0].tolist())):
            pass
    return Basins(plane, tuple(attractors), labels, cycles, time.perf_counter() - began)


def _header(system: System, plane: tuple[Axis, Axis], cycles: int, over: Axis | None) -> dict[str, Any]:
    """What tells one piece of work from another."""
    axes = [{"key": axis.key, "values": list(axis.values)} for axis in plane]
    return {"version": __version__, "plane": axes, "cycles": cycles, "scene": dict(values_of(system)),
            "over": None if over is None else {"key": over.key, "values": list(over.values)}}
