"""The samples of a solved run as a file: NumPy arrays (.npz), a table (.csv), or a recording (.mcap)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.output.files import draft
from tcc_sim.trajectory import Trajectory

ARRAYS = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
          "state")
"""Arrays of the .npz file and columns of the .csv file: s, rad/s, rad, rad/s, N m, N m, N m, and -1, 0, 1."""
SUFFIXES = (".npz", ".csv", ".mcap")


def check_suffix(path: Path) -> None:
    """Raise InputError unless the name of the file ends in one of SUFFIXES."""
    if path.suffix not in SUFFIXES:
        raise InputError(f"--out {path} must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def write_samples(path: Path, trajectory: Trajectory, scene_text: str) -> None:
    """Write every sample of `trajectory`; a .csv keeps every digit, a .mcap holds the scene (YAML) too."""
    check_suffix(path)
    with draft(path) as part:
        if path.suffix == ".mcap":
            from tcc_sim.recording.trajectory_bag import write_trajectory

            write_trajectory(part, trajectory, scene_text)
        elif path.suffix == ".npz":
            np.savez(part, **{name: getattr(trajectory, name) for name in ARRAYS})
        else:
            columns = [getattr(trajectory, name).tolist() for name in ARRAYS]
            with part.open("w", encoding="ascii", newline="\n") as file:
                file.write(",".join(ARRAYS) + "\n")
                file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*columns))
