"""The samples of a solved or recorded run as a file: NumPy arrays (.npz), a table (.csv), or a recording (.mcap)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcc_sim.errors import check_suffix
from tcc_sim.output.files import draft
from tcc_sim.trajectory import Trajectory

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
