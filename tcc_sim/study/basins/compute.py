"""Compute basins of attraction in a plane of two initial conditions, of the driveline as a `DynamicalSystem`.

Every cell is followed until it is near an attractor with a validated radius (`attractors`). A certain runaway has a
separate label; a cell that is undecided after the allowed cycles is counted, never guessed. Rows run on all cores
or a Dask cluster; a file stores them, so that an interrupted run can continue. Uncertainty exponent of the boundary:
C. Grebogi, S. W. McDonald, E. Ott, J. A. Yorke, Final state sensitivity, Phys. Lett. A 99 (1983).
"""

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
from numpy.typing import NDArray

from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError
from tcc_sim.model.friction import exponentials
from tcc_sim.model.parameters import DEFAULTS as SCENE_KEYS
from tcc_sim.model.parameters import System, given_values, replace, unknown_key
from tcc_sim.scene import Scene, system_of
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import sections
from tcc_sim.solvers.terms import peak_load, terms_of
from tcc_sim.study.basins.attractors import UNDECIDED, Attractor, ProximityMapper, find_attractors, labelled, numbered
from tcc_sim.study.basins.results import Axis, Basins
from tcc_sim.study.continuation.motions import DrivelineMap
from tcc_sim.study.continuation.orbits import Floats, ParameterMap
from tcc_sim.sweeps.executors import AHEAD, Attendance, each_done, workers
from tcc_sim.sweeps.file import SweepFile
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.results import check_effect
from tcc_sim.trajectory import NO_ORBITS, Orbits, State

ATTRACTOR_RTOL = 1e-8  # relative tolerance of the motions that find attractors
CONSTANT_FROM = 40.0  # times 1/alpha, a slip speed with the law's exponential below 1e-17 of the rest


class DrivelineMotion:
    """Driveline as a dynamical system: its section at phase 0 of the engine torque.

    States are slip speed (rad/s), plate angle (rad) and plate speed (rad/s). `rtol` is the relative
    tolerance of its sections.
    """

    def __init__(self, system: System, rtol: float = ATTRACTOR_RTOL) -> None:
        self.system, self._rtol = system, rtol
        self.map: ParameterMap = DrivelineMap(system, ())
        terms = terms_of(system)
        slowest = min([rate for _, rate in exponentials(terms.stribeck)], default=0.0)
        self._constant = CONSTANT_FROM / slowest if slowest > 0.0 else 0.0
        # A torque that grows with slip ends any growth.
        self._drift = 0.0 if terms.linear.flywheel_by_slip else terms.mean_torque
        self._drag = mean_load(system) * (system.friction_ratio if terms.stribeck and slowest == 0.0 else 1.0)
        torques = abs(terms.mean_torque) + system.engine.torque_amplitude + sum(system.engine.harmonic_amplitudes)
        torque = torques + system.largest_friction_ratio * peak_load(terms)
        plate_speed = torque / terms.linear.stiffness * system.natural_frequency
        self._swing = torques / terms.linear.flywheel * system.cycle + 4.0 * plate_speed
        """Bound of the swing of slip about its mean within a few cycles, rad/s."""

    def sections(self, starts: Floats, first: int, cycles: int, orbits: Orbits = NO_ORBITS) -> Floats:
        """Return (m, cycles + 1, 3) states at the starts of cycles first to first + cycles.

        States are NaN after a failure and after two consecutive points near one of the `orbits`.
        """
        return sections(self.system, starts, first, cycles, self._rtol, orbits)

    def runs_away(self, points: Floats) -> NDArray[np.bool_]:
        """Return (m,) whether slip is so fast that friction is constant and below the mean engine torque.

        Slip then gains (Tm - Tsm)/I1 per second on average, (1a) with a bounded plate, and never returns. With a
        coupling b it ends at (Tm - Tsm)/b.
        """
        v = points[:, 0]
        out: NDArray[np.bool_] = (np.abs(v) > self._constant + self._swing) & (self._drift * np.sign(v) > self._drag)
        return out

    def largest(self, x: Floats, first: int, cycles: int) -> float:
        """Return the largest |slip speed| over these cycles, rad/s."""
        cycles_of = solve(self.system, cycles=cycles, state=State.of(x), start_cycle=first, rtol=self._rtol).cycles
        assert cycles_of is not None
        return max(float(cycles_of.highest.max()), -float(cycles_of.lowest.min()))


def mean_load(system: System) -> float:
    """Return the time average of the saturation torque Ts, clamped at 0, N m."""
    terms = terms_of(system)
    if terms.pulsation is None or abs(terms.pulsation[0]) <= terms.mean_load:
        return terms.mean_load
    edge = np.arcsin(-terms.mean_load / terms.pulsation[0])
    return float((terms.mean_load * (np.pi - 2.0 * edge) + 2.0 * terms.pulsation[0] * np.cos(edge)) / (2.0 * np.pi))


CELL_CYCLES = 600  # longest time that a cell is followed, cycles
CELLS_TOGETHER = 128  # most cells of a task with several rows
SEEDS = 48  # cells from which the search starts, beside the corners and the middle
ROUNDS, SEARCHED = 3, 24  # number of further searches from undecided cells, and number of these cells
MOST_CELLS = 4_000_000  # largest number of cells of a plane
# Relative tolerance of the motions that label cells. It moves edges of basins by 1e-5 rad/s (median of 195 of two
# scenes, with either law; at most 1e-4); one of 117 000 cells of seven scenes has another label than at 1e-9.
# Attractors need a smaller one: with this tolerance a motion leaves the chaotic attractor of omega/omega_n = 0.36,
# mu_k = 0.7 mu_s for one of period 2.
CELL_RTOL = 3e-5

PLANE_KEYS = ("initial.slip_speed", "initial.plate_angle", "initial.plate_speed")
FORMAT = "tcc_sim basin_rows 1"
Row = tuple[list[int], list[int]]
Stored = tuple[int, int, dict[str, Any]]
"""Index of the value, row, and record in the file."""


def axis_of(given: Axis | tuple[str, Sequence[float]]) -> Axis:
    """Return an axis from an axis or from a key and its values; InputError for anything else."""
    try:
        return given if isinstance(given, Axis) else Axis(*given)
    except TypeError:
        raise InputError(f"an axis is {given!r:.100}; it must be a key and its values") from None


def check_plane(given: Sequence[Axis | tuple[str, Sequence[float]]]) -> tuple[Axis, Axis]:
    """Return the two axes of a plane, given as axes or as keys with values.

    Raises InputError: there are not two axes, a key is repeated or no initial condition, or there are no or too many
    cells.
    """
    if len(given) != 2:
        raise InputError(f"a plane has 2 axes; {len(given)} are given")
    plane = [axis_of(axis) for axis in given]
    for axis in plane:
        if axis.key not in SCENE_KEYS:
            raise unknown_key(axis.key, SCENE_KEYS)
        if axis.key not in PLANE_KEYS:
            raise InputError(f"{axis.key} is no initial condition; a plane is made of two of {', '.join(PLANE_KEYS)}")
    if plane[0].key == plane[1].key:
        raise InputError(f"{plane[0].key} is given twice; a plane is made of two keys")
    cells = len(plane[0].values) * len(plane[1].values)
    if not 1 <= cells <= MOST_CELLS:
        raise InputError(f"the plane has {cells} cells; it must have 1 to {MOST_CELLS}")
    return plane[0], plane[1]


def starts(system: System, plane: tuple[Axis, Axis], row: int) -> Floats:
    """Return (len(first), 3) initial states of one row of the plane."""
    out = np.tile(State.at_start(system).numbers, (len(plane[0].values), 1))
    out[:, PLANE_KEYS.index(plane[0].key)] = plane[0].values
    out[:, PLANE_KEYS.index(plane[1].key)] = plane[1].values[row]
    return out


def seeds_of(system: System, plane: tuple[Axis, Axis]) -> Floats:
    """Return (seeds + 6, 3) initial states of the search: the scene's own, corners, middle, a Halton set."""
    edges = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    unit = np.concatenate([edges, halton(SEEDS, 2)])
    out = np.tile(State.at_start(system).numbers, (len(unit) + 1, 1))
    for axis, part in zip(plane, unit.T):
        low, high = min(axis.values), max(axis.values)
        out[1:, PLANE_KEYS.index(axis.key)] = low + (high - low) * part
    return out


def halton(count: int, dimensions: int) -> Floats:
    """Return (count, dimensions) points that fill the unit cube evenly (J. H. Halton, Numer. Math. 2, 1960)."""
    from scipy.stats.qmc import Halton

    return np.asarray(Halton(dimensions, scramble=False).random(count + 1)[1:])


def solve_rows(system: System, plane: tuple[Axis, Axis], rows: Sequence[int], attractors: Sequence[Attractor],
               most: int) -> list[Row]:
    """Return labels and cycles of rows of cells, which are solved and judged together; called in a worker."""
    motion = DrivelineMotion(system, CELL_RTOL)
    mapper = ProximityMapper(attractors, motion.map.scales, motion.map.forcing_period)
    labels, cycles = labelled(motion, mapper, np.concatenate([starts(system, plane, row) for row in rows]), most)
    return list(zip(labels.reshape(len(rows), -1).tolist(), cycles.reshape(len(rows), -1).tolist()))


def basins(scene: Scene | System | str, plane: Sequence[Axis | tuple[str, Sequence[float]]], *,
           cycles: int = CELL_CYCLES, over: Axis | tuple[str, Sequence[float]] | None = None,
           jobs: int | None = None, dask: str | None = None, part: Path | None = None, progress: bool = False,
           head: Mapping[str, Any] | None = None) -> list[Basins]:
    """Compute attractors and their basins in a plane of two initial conditions, for every value of `over`.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    plane : an initial.* key and its values, for each of two axes
    cycles : most periods of excitation solved for a cell, 16 to 1000000 (default 600)
    over : a scene key and its values; there is a plane for each, and attractors have the same numbers in all
    jobs : threads (default: all available cores)
    dask : address of a Dask scheduler whose workers solve instead, such as tcp://127.0.0.1:8786
    part : file of finished rows; the same call continues from it
    head : further keys of that file's first line, such as the command
    progress : whether to show a bar on a terminal or in a notebook, elsewhere a line a minute

    Raises
    ------
    InputError
        The plane or a number of cycles or jobs is wrong, or the file has other content.
    KeyboardInterrupt
        Ctrl-C; `part` holds the finished rows.

    Examples
    --------
    >>> plane = [("initial.slip_speed", (0.0, 50.0)), ("initial.plate_angle", (0.0, 0.1))]
    >>> basins("stick", plane)[0].fraction(0)
    1.0
    """
    system = system_of(scene)
    axes, over = check_plane(plane), None if over is None else axis_of(over)
    if over is not None and over.key in (axes[0].key, axes[1].key):
        raise InputError(f"over is {over.key}, an axis of the plane; it must be another key")
    if over is not None:
        check_effect(system, over.key)
    if not 16 <= cycles <= 1_000_000:
        raise InputError(f"cycles is {cycles}; it must be 16 to 1000000")
    systems = [system] if over is None else [replace(system, {over.key: x}) for x in over.values]
    for each in systems:
        DrivelineMotion(each)
    stored: list[Stored] = []
    out: list[Basins] = []
    with workers(jobs, dask) as (executor, attendance), closing(
            SweepFile(part, _header(system, axes, cycles, over), lambda *row: stored.append(row), form=FORMAT,
                      kind="basin map", head=head)) as file, progress_bar(
                "row", len(systems) * len(axes[1].values), shown=progress) as bar:
        for index, each in enumerate(systems):
            mine = [(row, record) for i, row, record in stored if i == index]
            plane_basins = _one(each, axes, cycles, mine, executor, attendance, partial(file.append, index),
                                bar.update)
            value = None if over is None else (over.key, over.values[index])
            known = numbered(DrivelineMotion(each), [one.attractors for one in out], plane_basins.attractors)
            out.append(dataclasses.replace(plane_basins, over=value, attractors=known))
    return out


def _one(system: System, plane: tuple[Axis, Axis], most: int, stored: Sequence[tuple[int, dict[str, Any]]],
         executor: Executor, attendance: Attendance, keep: Callable[[int, dict[str, Any]], None],
         tick: Callable[[], object]) -> Basins:
    """Compute one plane: find attractors from seeds, label rows, search again from undecided cells."""
    began = time.perf_counter()
    motion = DrivelineMotion(system)
    shape = len(plane[1].values), len(plane[0].values)
    labels, cycles = np.full(shape, UNDECIDED, np.int16), np.zeros(shape, np.int32)
    attractors, missing = find_attractors(motion, seeds_of(system, plane)), set(range(shape[0]))

    def solved(rows: set[int]) -> Iterator[int]:
        """Yield rows as they are finished."""
        # Short rows share the cost of a task, and every thread has several tasks.
        size = max(1, min(CELLS_TOGETHER // shape[1], len(rows) // (AHEAD * max(attendance.threads, 1))))
        tasks = iter([sorted(rows)[k:k + size] for k in range(0, len(rows), size)])
        for together, labelled_rows in each_done(attendance, lambda: next(tasks, None), lambda task: executor.submit(
                solve_rows, system, plane, task, attractors, most)):
            for row, row_labels in zip(together, labelled_rows):
                labels[row], cycles[row] = row_labels
                yield row

    for row, saved in stored:
        # Rows that were labelled with other attractors are solved again.
        if saved["attractors"] == len(attractors) and len(saved["labels"]) == shape[1] == len(saved["cycles"]):
            labels[row], cycles[row] = saved["labels"], saved["cycles"]
            missing.discard(row)
            tick()
    for row in solved(missing):
        keep(row, {"attractors": len(attractors), "labels": labels[row].tolist(), "cycles": cycles[row].tolist()})
        tick()
    for _ in range(ROUNDS):
        lost = np.argwhere(labels == UNDECIDED)
        if not len(lost):
            break
        chosen = lost[np.unique(np.linspace(0, len(lost) - 1, SEARCHED).astype(int))]
        seeds = [starts(system, plane, int(j))[int(i)] for j, i in chosen]
        more = find_attractors(motion, seeds, attractors)
        if len(more) == len(attractors):
            break
        shrunk = any(a.radius < b.radius for a, b in zip(more, attractors))
        attractors = more
        for _ in solved(set(range(shape[0]) if shrunk else lost[:, 0].tolist())):
            pass
    return Basins(plane, tuple(attractors), labels, cycles, time.perf_counter() - began, system)


def _header(system: System, plane: tuple[Axis, Axis], cycles: int, over: Axis | None) -> dict[str, Any]:
    """Return the first line of the file, which identifies the work."""
    axes = [{"key": axis.key, "values": list(axis.values)} for axis in plane]
    return {"version": code_version(), "plane": axes, "cycles": cycles, "scene": given_values(system),
            "over": None if over is None else {"key": over.key, "values": list(over.values)}}
