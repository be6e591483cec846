"""Arrays as files: samples of a run as NumPy arrays (.npz), a table (.csv) or a recording (.mcap), labels of basins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.errors import check_suffix
from tcc_sim.output.files import draft
from tcc_sim.trajectory import Trajectory

if TYPE_CHECKING:
    from tcc_sim.basins.compute import Axis, Basins

ARRAYS = tuple(Trajectory.UNITS)
"""Arrays of the .npz file and columns of the .csv file: s, rad/s, rad, rad/s, N m, N m, N m, and -1, 0, 1."""
SUFFIXES = (".npz", ".csv", ".mcap")


def write_samples(path: Path, trajectory: Trajectory, scene_text: str, *, head: bool = False) -> None:
    """Write every sample of `trajectory`.

    A .npz holds the units too, in the order of ARRAYS, and the scene (YAML), as a .mcap does. A .csv keeps every digit;
    with `head` the units and the scene stand before its columns, in lines that begin with #.

    Raises
    ------
    InputError
        Another suffix than those of SUFFIXES.
    """
    check_suffix(path, SUFFIXES)
    with draft(path) as part:
        if path.suffix == ".mcap":
            from tcc_sim.recording.trajectory_bag import write_trajectory

            write_trajectory(part, trajectory, scene_text)
        elif path.suffix == ".npz":
            np.savez(part, **{name: getattr(trajectory, name) for name in ARRAYS},
                     units=np.array(list(Trajectory.UNITS.values())), scene=np.array(scene_text))
        else:
            columns = [getattr(trajectory, name).tolist() for name in ARRAYS]
            units = ", ".join(f"{name} ({unit})" if unit else name for name, unit in Trajectory.UNITS.items())
            with part.open("w", encoding="utf-8", newline="\n") as file:
                if head:
                    file.writelines(f"# {line}\n" for line in (units, *scene_text.splitlines()))
                file.write(",".join(ARRAYS) + "\n")
                file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*columns))


def write_basins(path: Path, found: Sequence[Basins], over: Axis | None) -> None:
    """Write `labels` and `cycles`, (second, first) arrays, and the values of both axes; `over` adds a first axis.

    Labels: -1 undecided, -2 runaway, else an index into the attractors of the JSON.
    """
    labels, cycles = np.stack([one.labels for one in found]), np.stack([one.cycles for one in found])
    first, second = found[0].plane
    arrays: dict[str, Any] = {"first_values": np.array(first.values), "second_values": np.array(second.values)}
    if over is None:
        labels, cycles = labels[0], cycles[0]
    else:
        arrays["over_values"] = np.array(over.values)
    with draft(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, labels=labels, cycles=cycles, **arrays)
